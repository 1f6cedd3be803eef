//! Closed forms for the number of substeps: to resolve the stiffness, to keep a strain, and for the stability of
//! explicit springs.

use crate::error::StepError;
use crate::kernels::limits::MAX_SUBSTEPS;
use crate::model::cloth::Cloth;
use crate::model::disjoint_sets::DisjointSets;
use crate::model::link::Link;
use crate::options::Fabric;
use crate::options::{Method, Options, Quality};
use crate::record::recorded;

/// Sixtieths of a second in a second: [`Quality`] counts substeps in each.
pub(crate) const SIXTIETHS: f64 = 60.0;

/// The gravity (m/s²) assumed where a choice may not depend on the scene.
pub(crate) const STANDARD_GRAVITY: f64 = 9.81;

/// How a step is divided into substeps.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Division {
    pub substeps: u32,
    pub length: Length,
}

/// The length of a substep and the quantities that coefficients depend on besides.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Length {
    /// The substep (s).
    pub h: f32,
    /// The longest substep (s) that the quality allows, independent of the step; `h` if it is nearly as long.
    pub longest_h: f32,
    /// The longest substep (s) since the cloth was placed, or its quality or bending changed, for which bending is stable: see
    /// [`BendRows::new`](crate::step::bending::BendRows::new).
    pub softest_h: f32,
    /// `(S/S*)²`, the share of the stiffness that one sweep carries in the longest substep; 1 if the stiffness is
    /// resolved.
    pub resolved: f64,
    /// How often the fabric, masses or pins were changed, so that coefficients computed for the cloth before a change
    /// are not used after it.
    pub changes: u32,
}

recorded!(Length { h, longest_h, softest_h, resolved } but { changes });

impl Length {
    /// For tests: a substep about which nothing else is known.
    #[cfg(test)]
    pub(crate) fn of(h: f32) -> Length {
        Length { h, longest_h: h, softest_h: h, resolved: 0.0, changes: 0 }
    }
}

/// The properties of a cloth that the closed forms need.
pub(crate) struct Rates {
    /// Substeps per second that resolve the 95th percentile of the edges, for a stiffness of K = 1 N/m.
    unit: f64,
    /// The same, with each edge weighted by how much of the cloth can hang on it.
    loaded: f64,
    /// Substeps per second at the explicit stability limit; 0 unless the method is explicit.
    pub explicit: f64,
    /// [`Length::changes`].
    changes: u32,
}

impl Rates {
    pub(crate) fn new(cloth: &Cloth, options: &Options) -> Rates {
        let explicit = if options.method == Method::Springs { explicit_rate(cloth, options.fabric) } else { 0.0 };
        let of_part = if cloth.extents.parts > 1 && (options.mass.is_some() || options.edge_scale.is_some()) {
            loads_of_parts(cloth)
        } else {
            Vec::new()
        };
        let load = |link: &Link| cloth.load_share(link) * of_part.get(link.ends[0] as usize).unwrap_or(&1.0);
        Rates { unit: unit_rate(cloth, |_| 1.0), loaded: unit_rate(cloth, load), explicit, changes: 0 }
    }

    /// Recomputed for a cloth that was changed.
    pub(crate) fn changed(&self, cloth: &Cloth, options: &Options) -> Rates {
        Rates { changes: self.changes.wrapping_add(1), ..Rates::new(cloth, options) }
    }

    /// Substeps per second for a quality. `count`, in 1/60 s, is the choice of the
    /// [`Controller`](crate::step::controller::Controller) where the quality leaves it to that. Springs run at 1.05
    /// times their stability limit. There is no strain law for relaxation, which gets one substep in 1/60 s.
    pub(crate) fn substep_rate(&self, options: &Options, count: f64) -> f64 {
        match (options.quality, options.method) {
            (Quality::Substeps(count), _) => SIXTIETHS * f64::from(count),
            (_, Method::SmallSteps) => SIXTIETHS * count,
            (_, Method::Relaxation { .. }) => SIXTIETHS,
            (_, Method::Springs) => (1.05 * self.explicit).max(1.0),
        }
    }

    /// Divides a step of `dt` (s) into the fewest substeps that are no longer than `rate` (1/s) says. That longest
    /// length does not depend on the step. Steps so far allowed substeps of at most `softest` (s).
    pub(crate) fn divide(
        &self,
        cloth: &Cloth,
        options: &Options,
        dt: f32,
        rate: f64,
        softest: f64,
    ) -> Result<Division, StepError> {
        let sweeps = if let Method::Relaxation { iterations } = options.method { f64::from(iterations) } else { 1.0 };
        // A step may exceed a whole number of substeps by rounding errors without taking one more.
        let needed = (f64::from(dt) * rate * (1.0 - 1e-6) - 1e-3).ceil().max(1.0);
        if needed * sweeps > f64::from(MAX_SUBSTEPS) {
            return Err(StepError::TooManySubsteps { needed: needed * sweeps });
        }
        let (substeps, h) = (needed as u32, dt / needed as f32);
        let longest_h = if rate * f64::from(h) > 0.999 { h } else { (1.0 / rate) as f32 };
        let softest_h = if 0.999 * rate * softest > 1.0 { softest as f32 } else { longest_h };
        let resolved = (self.resolving(cloth.membrane_stiffness) * f64::from(longest_h)).max(1.0).powi(-2);
        Ok(Division { substeps, length: Length { h, longest_h, softest_h, resolved, changes: self.changes } })
    }

    /// The number of substeps that explicit springs need in a step of `dt` (s), if it is more than `substeps`.
    pub(crate) fn explicit_shortfall(&self, dt: f32, substeps: u32) -> Option<u32> {
        let needed = f64::from(dt) * self.explicit;
        (needed > f64::from(substeps)).then_some(needed.ceil().min(f64::from(u32::MAX)) as u32)
    }

    /// Substeps per second that resolve a stiffness (N/m).
    pub(crate) fn resolving(&self, stretch: f64) -> f64 {
        // Without edges there is nothing to resolve, however stiff.
        if self.unit > 0.0 { self.unit * stretch.sqrt() } else { 0.0 }
    }

    /// Substeps per second that resolve the cloth's stiffness, up to the stiffness at which its own weight stretches it
    /// by 1e-4; resolving more has no visible effect.
    pub(crate) fn resolving_what_shows(&self, cloth: &Cloth) -> f64 {
        let useful = cloth.density * STANDARD_GRAVITY * cloth.extents.extent / 1e-4;
        self.resolving(cloth.membrane_stiffness.min(useful))
    }

    /// The strain beyond the fabric's own that a membrane stress (N/m) causes with unresolved substeps of length `h`
    /// (s): `(2 sigma/K) (S*/S)²`. K cancels, so this holds for inextensible cloth too.
    pub(crate) fn strain(&self, stress: f64, h: f64) -> f64 {
        2.0 * stress * (self.loaded * h).powi(2)
    }

    /// Substeps per second at which [`Rates::strain`] is `strain`.
    pub(crate) fn keeping(&self, stress: f64, strain: f64) -> f64 {
        self.loaded * (2.0 * stress / strain).sqrt()
    }
}

/// The compliance that a sweep adds to each edge that it visits once, as a multiple of `h² w`.
pub(crate) const ONE_WAY: f64 = 0.5;
/// The same for edges that it visits twice, in one order and in its reverse.
const BOTH_WAYS: f64 = 0.25;

/// The compliance that the sweep adds to an edge, as a multiple of `h² w`: derived in
/// [`step::coefficients`](crate::step::coefficients).
pub(crate) fn softening(link: &Link) -> f64 {
    if link.is_visited_twice() { BOTH_WAYS } else { ONE_WAY }
}

/// Substeps per second that resolve the 95th percentile of the edges at K = 1 N/m: `sqrt(k_e (w_i + w_j) / 2)`, in shells
/// `sqrt(k_e (w_i + w_j) / 4)`, with a weight per edge.
fn unit_rate(cloth: &Cloth, weighed: impl Fn(&Link) -> f64) -> f64 {
    let rate = |link: &Link| (link.shape * cloth.weight(link) * softening(link) * weighed(link)).sqrt();
    let mut rates: Vec<f64> = cloth.swept().iter().map(rate).collect();
    if rates.is_empty() {
        return 0.0;
    }
    let nearest = (rates.len() - 1) * 95 / 100;
    *rates.select_nth_unstable_by(nearest, f64::total_cmp).1
}

/// For each vertex, the load per stiffness of the edges of its connected part, relative to what [`Rates::strain`] assumes: that parts are
/// as heavy as the cloth in the mean, and that stiffer edges bear more, as they do within a part. Of a part of its own fabric all
/// edges are stiffer, and its weight is its own.
fn loads_of_parts(cloth: &Cloth) -> Vec<f64> {
    let part = DisjointSets::parts_of_links(cloth.rest.len(), &cloth.links);
    // Of each part, at its lowest vertex: mass (kg) and area (m²), the factors on the stiffness of its edges, and their number.
    let mut sums = vec![[0.0; 4]; part.len()];
    part.iter().zip(&cloth.mass).for_each(|(&part, &mass)| sums[part as usize][0] += f64::from(mass));
    for link in &cloth.links {
        let (sums, softness) = (&mut sums[part[link.ends[0] as usize] as usize], cloth.softness(link));
        if softness > 0.0 {
            // Each triangle has three edges.
            sums[1] += link.shape / softness * f64::from(link.rest).powi(2) / 3.0;
            sums[2] += softness;
            sums[3] += 1.0;
        }
    }
    let load = |&part: &u32| {
        let [mass, area, softness, edges] = sums[part as usize];
        if edges > 0.0 { mass * edges / (area * cloth.density * softness) } else { 1.0 }
    };
    part.iter().map(load).collect()
}

/// Substeps per second at the stability limit of explicit leapfrog, for any deformation of the cloth.
///
/// The tangent stiffness of a spring is `k (n n^T + (1 - l0/l)(I - n n^T))`, at most `k` in any direction. So `omega²`
/// is at most the largest eigenvalue `s` of the scalar graph Laplacian weighted by k and the inverse masses. At rest
/// the directions of the edges make it smaller: on a grid with diagonals, a cloth that moves needs a quarter more
/// substeps than one at rest. Bending adds its own largest eigenvalue `b`; its damping with retardation time `tau` uses
/// velocities that lag by half a substep. The limit is `h² s + min(h² b + 2 h tau b, 2) <= 4`, where 2 is the most that
/// the bending limiter admits ([`BendRows::new`](crate::step::bending::BendRows::new)).
fn explicit_rate(cloth: &Cloth, fabric: Fabric) -> f64 {
    let stretch = largest_eigenvalue(cloth, |q, out| {
        for link in cloth.swept() {
            let [a, b] = link.ends.map(|vertex| vertex as usize);
            let force = cloth.stiffness(link) * (q[a] - q[b]);
            out[a] += force;
            out[b] -= force;
        }
    });
    let limited = (0.5 * stretch).sqrt();
    if fabric.bending == 0.0 {
        return 0.5 * stretch.sqrt();
    }
    let bend = f64::from(fabric.bending) * largest_eigenvalue(cloth, |q, out| cloth.bending().add_forces(q, out));
    let lag = f64::from(fabric.damping) * bend;
    limited.min(0.25 * (lag + (lag * lag + 4.0 * (stretch + bend)).sqrt()))
}

/// The largest eigenvalue (1/s²) of a symmetric stiffness matrix times the inverse masses, by power iteration.
/// `add_product` adds the matrix times its first argument to its second.
fn largest_eigenvalue(cloth: &Cloth, add_product: impl Fn(&[f64], &mut [f64])) -> f64 {
    let root_weight: Vec<f64> = cloth.rest.iter().map(|x| f64::from(x.w).sqrt()).collect();
    // The start vector must contain all wavelengths; a fixed one keeps the result reproducible.
    let mut q: Vec<f64> = (0..root_weight.len()).map(|i| if i % 2 == 0 { 1.7 } else { -1.7 } + (i as f64 * 0.7).sin()).collect();
    let mut eigenvalue = 0.0;
    for _ in 0..200 {
        let norm = q.iter().map(|q| q * q).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        q.iter_mut().zip(&root_weight).for_each(|(q, w)| *q *= w / norm);
        let mut next = vec![0.0; q.len()];
        add_product(&q, &mut next);
        next.iter_mut().zip(&root_weight).for_each(|(q, w)| *q *= w);
        eigenvalue = next.iter().map(|q| q * q).sum::<f64>().sqrt();
        q = next;
    }
    eigenvalue
}
