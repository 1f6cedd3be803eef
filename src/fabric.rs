//! Fabrics: what the cloth is made of, in SI units.

/// A fabric: the numbers a laboratory measures, in SI units, independent of the mesh and of the time step.
///
/// The presets are set inside the range measured on several hundred garment fabrics (areal density 5/50/95 %:
/// 0.031/0.197/0.488 kg/m²; bending rigidity along the warp 1.1e-6/1.4e-5/1.1e-4 N m; membrane stiffness 1..10 kN/m
/// woven, 50..500 N/m knitted). A stiffness above 5 kN/m is hardly visible and costs substeps. Shear has no number of its
/// own: [`Options::edge_scale`](crate::Options::edge_scale) sets it.
///
/// A plain struct, to be written with `..Fabric::default()` or from a preset, `Fabric { damping: 0.2, ..Fabric::SILK }`, which
/// the next version's fields do not break.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fabric {
    /// Areal density (kg/m²); above 0.
    pub density: f32,
    /// Membrane stiffness K (N/m): tension per width and strain. [`f32::INFINITY`]: inextensible. Above 0.
    pub stretch: f32,
    /// Bending rigidity B (N m): moment per width and curvature, from a flat rest shape, as cloth is cut. 0: no bending term,
    /// at no cost.
    pub bending: f32,
    /// Retardation time of bending (s) (Kelvin-Voigt: the moment is `B (kappa + damping dkappa/dt)`), measured against the
    /// cloth's own rotation: it stills folds without slowing the cloth's fall or its turning. What swings as a whole, a
    /// corner that hangs free, is left to the air ([`Attributes::damping`](crate::Attributes::damping)). 0: undamped, at no
    /// cost. What counts is `damping * bending / density`: 0.06 s at 1e-4 N m and 0.2 kg/m² stills a dropped towel in
    /// about two seconds.
    ///
    /// A time, not a rate: a rate would make 0 mean infinitely damped.
    pub damping: f32,
}

impl Fabric {
    /// A towel: heavy (between the median and the 95 % of density) and thick (near the 95 % of bending), quick to settle.
    /// The main example's cloth.
    pub const TOWEL: Fabric = Fabric { density: 0.4, stretch: 5000.0, bending: 1e-4, damping: 0.12 };
    /// Plain woven cotton: the median of density and of bending along the warp.
    pub const COTTON: Fabric = Fabric { density: 0.2, stretch: 5000.0, bending: 1.4e-5, damping: 0.06 };
    /// Light woven silk: density and bending between the 5 % and the median.
    pub const SILK: Fabric = Fabric { density: 0.06, stretch: 3000.0, bending: 3e-6, damping: 0.06 };
    /// Denim: just inside the 95 % of density, at that of bending along the warp, the stiffest woven stretch.
    pub const DENIM: Fabric = Fabric { density: 0.45, stretch: 10_000.0, bending: 1.1e-4, damping: 0.06 };
    /// A knitted jersey: median density, bending between the 5 % and the median, stretch in the middle of the knits', more
    /// than ten times as soft as a woven cloth's.
    pub const JERSEY: Fabric = Fabric { density: 0.2, stretch: 300.0, bending: 5e-6, damping: 0.06 };

    /// Every preset with its name in lower case.
    pub const PRESETS: &'static [(&'static str, Fabric)] = &[
        ("towel", Fabric::TOWEL),
        ("cotton", Fabric::COTTON),
        ("silk", Fabric::SILK),
        ("denim", Fabric::DENIM),
        ("jersey", Fabric::JERSEY),
    ];
}

impl Default for Fabric {
    /// A median fabric that only resists stretching: no bending, no damping, nothing the scene did not ask for.
    fn default() -> Fabric {
        Fabric { density: 0.2, stretch: 5000.0, bending: 0.0, damping: 0.0 }
    }
}
