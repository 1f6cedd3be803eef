//! Substeps from closed forms: what resolves the stiffness, what keeps a strain, and what explicit springs can bear.

use crate::attributes::Attributes;
use crate::error::StepError;
use crate::fabric::Fabric;
use crate::limits::MAX_SUBSTEPS;
use crate::model::cloth::{Cloth, Link};
use crate::options::{Levels, Method, Options, Quality};
use crate::record::recorded;
use crate::step::load::pressure;

/// What [`Quality`] counts substeps by: 1/60 s.
pub(crate) const FRAMES: f64 = 60.0;

/// Acceleration of free fall (m/s²) that levels are chosen for.
const STANDARD_GRAVITY: f64 = 9.81;
/// Vertices below which levels cost more than they bring, unless so many times as many substeps would resolve the stiffness.
const SMALL: usize = 1000;
const FAR: f64 = 8.0;
/// Pressure of the wind over the cloth's weight from which levels show small wrinkles for stretch: see [`hierarchy`](crate::multigrid::hierarchy).
const GALE: f64 = 10.0;

/// How a step is divided.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Division {
    pub substeps: u32,
    pub length: Length,
}

/// The length of a substep, and of what it is compared with.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Length {
    /// The substep (s).
    pub h: f32,
    /// The longest substep (s) that the quality allows, whatever the step; `h` if that is nearly as long.
    pub longest: f32,
    /// `(S/S*)²`: the share of the stiffness that one sweep in the longest substep carries; 1 where it is resolved.
    pub resolved: f64,
    /// How often the fabric, the masses or the pins were changed before: what was computed for a length is of that cloth.
    pub changes: u32,
}

recorded!(Division { substeps, length });
recorded!(Length { h, longest, resolved } but { changes });

impl Length {
    /// Of a substep of which nothing else is known.
    #[cfg(test)]
    pub(crate) fn of(h: f32) -> Length {
        Length { h, longest: h, resolved: 0.0, changes: 0 }
    }
}

/// What the closed forms need to know of a cloth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rates {
    /// Substeps a second that resolve the 95th percentile of the edges at K = 1 N/m.
    unit: f64,
    /// The same, each edge weighed by how much of the cloth can hang on it.
    loaded: f64,
    /// Substeps a second at the explicit limit; 0 unless the method is explicit.
    explicit: f64,
    /// [`Length::changes`].
    changes: u32,
}

impl Rates {
    pub(crate) fn new(cloth: &Cloth, options: &Options) -> Rates {
        let explicit = if options.method == Method::Springs { explicit_rate(cloth, options.fabric) } else { 0.0 };
        Rates { unit: unit_rate(cloth, |_| 1.0), loaded: unit_rate(cloth, |link| cloth.load_share(link)), explicit, changes: 0 }
    }

    /// Of a cloth that was changed.
    pub(crate) fn changed(&self, cloth: &Cloth, options: &Options) -> Rates {
        Rates { changes: self.changes.wrapping_add(1), ..Rates::new(cloth, options) }
    }

    /// Substeps a second that the quality comes to; `count` is what [`Controller`](crate::step::controller::Controller) chose in 1/60 s,
    /// where it is its to choose. Springs take their limit, five per cent inside. Relaxation has no law to choose by; it takes one
    /// substep per 1/60 s.
    pub(crate) fn rate(&self, options: &Options, count: f64) -> f64 {
        match (options.quality, options.method) {
            (Quality::Substeps(count), _) => FRAMES * f64::from(count),
            (_, Method::SmallSteps) => FRAMES * count,
            (_, Method::Relaxation { .. }) => FRAMES,
            (_, Method::Springs) => (1.05 * self.explicit).max(1.0),
        }
    }

    /// How a step of `dt` (s) is divided: into as few substeps as are no longer than those of a rate (1/s). That length is the same
    /// for steps of any length.
    pub(crate) fn divide(&self, cloth: &Cloth, options: &Options, dt: f32, rate: f64) -> Result<Division, StepError> {
        let sweeps = if let Method::Relaxation { iterations } = options.method { f64::from(iterations) } else { 1.0 };
        // A step that is longer than so many substeps by no more than rounding takes no more.
        let needed = (f64::from(dt) * rate * (1.0 - 1e-6) - 1e-3).ceil().max(1.0);
        if needed * sweeps > f64::from(MAX_SUBSTEPS) {
            return Err(StepError::TooManySubsteps { needed: needed * sweeps });
        }
        let (substeps, h) = (needed as u32, dt / needed as f32);
        let longest = if rate * f64::from(h) > 0.999 { h } else { (1.0 / rate) as f32 };
        let resolving = self.resolving(cloth.stretch) * f64::from(longest);
        Ok(Division { substeps, length: Length { h, longest, resolved: resolving.max(1.0).powi(-2), changes: self.changes } })
    }

    /// Coarse levels to ask for.
    ///
    /// Level l, its aggregates about `4 2^l` edges wide, is resolved by `S* / (4 2^l)` substeps; the first that is
    /// carries the whole load of an even cloth. One more, for next to nothing, carries that of corners and unstructured
    /// meshes (two pins, 2000 vertices: 2.0e-3 mean strain with it, 3.2e-3 without). From seven eighths of `S*` on none pays; in
    /// small cloths from an eighth on, where they would take as long as more substeps that do better (an inextensible strip of 65 links
    /// by both ends hangs .38 % too deep with them at 20 substeps, and 1.41 % without; .072 % and .046 % at 80).
    pub(crate) fn levels(&self, cloth: &Cloth, options: &Options, length: Length, attributes: &Attributes) -> usize {
        if options.method != Method::SmallSteps {
            return 0;
        }
        match options.levels {
            Levels::Off => 0,
            Levels::Count(count) => count as usize,
            Levels::Auto => {
                let shortfall = self.resolving_what_shows(cloth) * f64::from(length.longest);
                let gale = pressure(attributes) > GALE * cloth.density * STANDARD_GRAVITY;
                let pays_from = if cloth.rest.len() < SMALL { FAR } else { 1.15 };
                if shortfall < pays_from || gale {
                    return 0;
                }
                (shortfall / 4.0).log2().ceil().clamp(0.0, 31.0) as usize + 2
            }
        }
    }

    /// Substeps that explicit springs need in a step of `dt` (s), if more than `substeps`.
    pub(crate) fn explicit_shortfall(&self, dt: f32, substeps: u32) -> Option<u32> {
        let needed = f64::from(dt) * self.explicit;
        (needed > f64::from(substeps)).then_some(needed.ceil().min(f64::from(u32::MAX)) as u32)
    }

    /// Substeps a second that explicit springs need.
    pub(crate) fn explicit(&self) -> f64 {
        self.explicit
    }

    /// Substeps a second that resolve a stiffness (N/m).
    pub(crate) fn resolving(&self, stretch: f64) -> f64 {
        self.unit * stretch.sqrt()
    }

    /// The same for a cloth, whose stiffness shows up to some: beyond what lets its own weight stretch it by a ten-thousandth there is nothing
    /// to resolve.
    pub(crate) fn resolving_what_shows(&self, cloth: &Cloth) -> f64 {
        let useful = cloth.density * STANDARD_GRAVITY * cloth.extent / 1e-4;
        self.resolving(cloth.stretch.min(useful))
    }

    /// The strain beyond the fabric's own that a membrane stress (N/m) leaves with unresolved substeps of some length (s):
    /// `(2 sigma/K) (S*/S)²`, in which K cancels, so that it holds for inextensible cloth.
    pub(crate) fn strain(&self, stress: f64, h: f64) -> f64 {
        2.0 * stress * (self.loaded * h).powi(2)
    }

    /// Substeps a second that leave so much [`Rates::strain`].
    pub(crate) fn keeping(&self, stress: f64, strain: f64) -> f64 {
        self.loaded * (2.0 * stress / strain).sqrt()
    }
}

/// Substeps a second that resolve the 95th percentile of the edges at K = 1 N/m: `sqrt(k_e (w_i + w_j) / 2)`, each edge weighed.
fn unit_rate(cloth: &Cloth, weighed: impl Fn(&Link) -> f64) -> f64 {
    let rate = |link: &Link| (link.shape * cloth.weight(link) / 2.0 * weighed(link)).sqrt();
    let mut rates: Vec<f64> = cloth.swept().iter().map(rate).collect();
    if rates.is_empty() {
        return 0.0;
    }
    let nearest = (rates.len() - 1) * 95 / 100;
    *rates.select_nth_unstable_by(nearest, f64::total_cmp).1
}

/// Substeps a second at the limit of explicit leapfrog, however the cloth is stretched and folded.
///
/// A spring's stiffness is `k (n n^T + (1 - l0/l)(I - n n^T))`, never more than `k` in any direction. So `omega²` is at most the
/// largest eigenvalue `s` of the graph's Laplacian weighed by k and the masses. At rest the directions make it less: on a grid with
/// diagonals a cloth that moves needs a quarter more substeps than one that trembles. Bending adds its own largest eigenvalue `b`, and by its
/// retardation time `tau` half of what velocities lag: `h² s + min(h² b + 2 h tau b, 2) <= 4`, where 2 is what its limiter leaves
/// it (`Bending::rows`).
fn explicit_rate(cloth: &Cloth, fabric: Fabric) -> f64 {
    let stretch = largest_eigenvalue(cloth, |q, out| {
        for link in cloth.swept() {
            let [a, b] = link.ends.map(|vertex| vertex as usize);
            let force = link.stiffness * (q[a] - q[b]);
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

/// The largest eigenvalue (1/s²) of a symmetric stiffness matrix times the inverse masses, by power iteration; `add_product` adds the
/// matrix times a vector to another.
fn largest_eigenvalue(cloth: &Cloth, add_product: impl Fn(&[f64], &mut [f64])) -> f64 {
    let root_weight: Vec<f64> = cloth.rest.iter().map(|x| f64::from(x.w).sqrt()).collect();
    // Any start with all wavelengths in it does; this one is the same every time.
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
