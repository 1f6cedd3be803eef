//! Fabrics: the material of the cloth, in SI units.

/// A fabric, described by quantities that a laboratory measures, in SI units, independent of mesh and time step.
///
/// The presets lie within the range measured on several hundred garment fabrics (areal density at the 5th, 50th and
/// 95th percentile: 0.031, 0.197 and 0.488 kg/m²; bending rigidity along the warp: 1.1e-6, 1.4e-5 and 1.1e-4 N m;
/// membrane stiffness 1 to 10 kN/m woven, 50 to 500 N/m knitted). Stiffness above 5 kN/m is hardly visible and costs
/// substeps. Shear has no parameter here: use [`Options::edge_scale`](crate::Options::edge_scale).
///
/// Write `Fabric { .., ..Fabric::default() }` or start from a preset, `Fabric { damping: 0.2, ..Fabric::SILK }`, so
/// that fields added later do not break your code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fabric {
    /// Areal density (kg/m²); at least 1e-20.
    pub density: f32,
    /// Membrane stiffness K (N/m): tension per width and strain along the rows of a grid, above 0. [`f32::INFINITY`] means
    /// inextensible.
    ///
    /// Edges are springs, so the stiffness depends on direction and mesh, and there is no Poisson's ratio. On a grid, whose
    /// diagonals all run one way, it is K along these, too, but a third of it across them; on irregular meshes 0.6 to 0.9 of it.
    /// An edge without triangles, as of a thread, has an axial stiffness (N) of K times its length.
    pub stretch: f32,
    /// Bending rigidity B (N m): moment per width and curvature. The rest shape is flat, as cloth is cut. 0: no bending
    /// term, at no cost.
    ///
    /// A strip whose first two columns of vertices are pinned is clamped halfway between them, so it is half a cell longer than
    /// from the second column on. With substeps that do not resolve K, a narrow strip curls across its length and sags as if
    /// it were less rigid, the more the narrower it is and the finer its mesh.
    pub bending: f32,
    /// Retardation time of bending (s). The moment is `B (kappa + damping dkappa/dt)` (Kelvin-Voigt), with rates
    /// measured relative to the local rotation of the cloth, so it damps folding without slowing the fall or the
    /// rotation of the cloth. Swinging as a whole, such as that of a free corner, is damped by the air instead
    /// ([`Attributes::damping`](crate::Attributes::damping)). 0: undamped, at no cost. The effect depends on
    /// `damping * bending / density`: with 0.06 s, 1e-4 N m and 0.2 kg/m², a dropped towel comes to rest in about two
    /// seconds. In a substep it takes at most half of the velocity of the shortest waves of the mesh, and of longer ones in
    /// proportion. So few substeps on a fine mesh apply a shorter time than this, from which on a larger number changes nothing:
    /// [`Forecast::damping`](crate::Forecast::damping) is what remains.
    ///
    /// This is a time and not a rate, because with a rate 0 would mean infinite damping.
    pub damping: f32,
}

impl Fabric {
    /// A towel: heavy (between the median and the 95th percentile of density), thick (near the 95th percentile of
    /// bending) and strongly damped. Used by the main example.
    pub const TOWEL: Fabric = Fabric { density: 0.4, stretch: 5000.0, bending: 1e-4, damping: 0.12 };
    /// Plain woven cotton: the median of density and of bending along the warp.
    pub const COTTON: Fabric = Fabric { density: 0.2, stretch: 5000.0, bending: 1.4e-5, damping: 0.06 };
    /// Light woven silk: density and bending between the 5th percentile and the median.
    pub const SILK: Fabric = Fabric { density: 0.06, stretch: 3000.0, bending: 3e-6, damping: 0.06 };
    /// Denim: density just inside the 95th percentile, bending along the warp at the 95th percentile, and the upper end
    /// of the stretch stiffness of woven fabrics.
    pub const DENIM: Fabric = Fabric { density: 0.45, stretch: 10_000.0, bending: 1.1e-4, damping: 0.06 };
    /// A knitted jersey: median density, bending between the 5th percentile and the median, and stretch in the middle
    /// of the range of knits, more than ten times softer than woven cloth.
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
    /// A fabric of median density that resists only stretching: no bending and no damping.
    fn default() -> Fabric {
        Fabric { density: 0.2, stretch: 5000.0, bending: 0.0, damping: 0.0 }
    }
}
