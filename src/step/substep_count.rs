//! Substeps from closed forms: what resolves the stiffness, what keeps the strain below a tolerance, and what explicit
//! springs can bear.

use crate::attributes::Attributes;
use crate::error::StepError;
use crate::limits::MAX_SUBSTEPS;
use crate::model::cloth::Cloth;
use crate::options::{Levels, Method, Options, Quality};

/// Fewest substeps a second under `Quality::Strain`: 20 in a frame of 1/60 s.
const LEAST_RATE: f64 = 20.0 * 60.0;
/// Peak stress in motion over the static stress `rho g L`.
const TRANSIENT: f64 = 5.0;

/// Acceleration of free fall (m/s²) that levels are chosen for.
const STANDARD_GRAVITY: f64 = 9.81;
/// Vertices below which levels cost more than they bring.
const SMALL: usize = 1000;
/// Pressure of the wind over the cloth's weight from which levels show small wrinkles for stretch: see [`hierarchy`](crate::multigrid::hierarchy).
const GALE: f64 = 10.0;

/// What the closed forms need to know of a cloth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rates {
    /// Substeps a second that resolve the 95th percentile of the edges at K = 1 N/m.
    unit: f64,
    /// Substeps a second at the explicit limit; 0 unless the method is explicit.
    explicit: f64,
}

impl Rates {
    pub(crate) fn new(cloth: &Cloth, method: Method) -> Rates {
        let explicit = if method == Method::Springs { explicit_rate(cloth) } else { 0.0 };
        Rates { unit: unit_rate(cloth), explicit }
    }

    /// Substeps for a step of `dt` (s).
    ///
    /// Small steps: the worst strain below the resolved substep is `2 sigma/K (S*/S)²` with membrane stress `sigma`, so
    /// `S = S* sqrt(2 sigma / (K tau))`; K cancels, and the form holds for inextensible cloth. `sigma` is five times
    /// `rho g L` (motion, not rest) plus the wind's pressure times L. Springs: the explicit limit, five per cent inside.
    /// Relaxation has no such law; it takes one substep per 1/60 s.
    pub(crate) fn substeps(&self, cloth: &Cloth, options: &Options, dt: f32, attributes: &Attributes) -> Result<u32, StepError> {
        let dt = f64::from(dt);
        let needed = match (options.quality, options.method) {
            (Quality::Substeps(count), _) => f64::from(count),
            (Quality::Strain(_), Method::Relaxation { .. }) => (60.0 * dt - 1e-3).ceil(),
            (Quality::Strain(_), Method::Springs) => (1.05 * dt * self.explicit).ceil(),
            (Quality::Strain(tolerance), Method::SmallSteps) => {
                let gravity = attributes.gravity.as_dvec3().length();
                let stress = TRANSIENT * (cloth.density * gravity + pressure(attributes)) * cloth.extent;
                let rate = self.unit * (2.0 * stress / f64::from(tolerance)).sqrt();
                // Once the stiffness is resolved, and with a margin that is always stable, more substeps show no more.
                let resolved = std::f64::consts::SQRT_2 * self.unit * f64::from(options.fabric.stretch).sqrt();
                coarsened((rate.min(resolved).max(LEAST_RATE) * dt - 1e-3).ceil())
            }
        };
        let sweeps = if let Method::Relaxation { iterations } = options.method { f64::from(iterations) } else { 1.0 };
        let needed = needed.max(1.0);
        if needed * sweeps <= f64::from(MAX_SUBSTEPS) {
            Ok(needed as u32)
        } else {
            Err(StepError::TooManySubsteps { needed: needed * sweeps })
        }
    }

    /// Coarse levels to ask for at substep `h` (s).
    ///
    /// Level l, its aggregates about `4 2^l` edges wide, is resolved by `S* / (4 2^l)` substeps; the first that is
    /// carries the whole load of an even cloth. One more, for next to nothing, carries that of corners and unstructured
    /// meshes (two pins, 2000 vertices: 2.0e-3 mean strain with it, 3.2e-3 without). Where half of `S*` is taken, none pays.
    pub(crate) fn levels(&self, cloth: &Cloth, options: &Options, h: f32, attributes: &Attributes) -> usize {
        if options.method != Method::SmallSteps {
            return 0;
        }
        match options.levels {
            Levels::Off => 0,
            Levels::Count(count) => count as usize,
            Levels::Auto => {
                // Stiffer than what lets its own weight stretch the cloth by a ten-thousandth, there is nothing to resolve.
                let useful = cloth.density * STANDARD_GRAVITY * cloth.extent / 1e-4;
                let shortfall = self.unit * f64::from(options.fabric.stretch).min(useful).sqrt() * f64::from(h);
                let gale = pressure(attributes) > GALE * cloth.density * STANDARD_GRAVITY;
                if shortfall < 2.0 || cloth.rest.len() < SMALL || gale {
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
}

/// Pressure (Pa) of the wind on cloth that stands still across it.
fn pressure(attributes: &Attributes) -> f64 {
    0.5 * f64::from(attributes.air_density) * f64::from(attributes.drag) * attributes.wind.as_dvec3().length_squared()
}

/// Rounded up to five binary digits, so that a breeze does not change the substep every frame.
fn coarsened(count: f64) -> f64 {
    let unit = (count / 16.0).log2().floor().exp2().max(1.0);
    (count / unit).ceil() * unit
}

/// Substeps a second that resolve the 95th percentile of the edges at K = 1 N/m: `sqrt(k_e (w_i + w_j) / 2)`.
fn unit_rate(cloth: &Cloth) -> f64 {
    let mut rates: Vec<f64> = cloth.swept().iter().map(|link| (link.shape * cloth.weight(link) / 2.0).sqrt()).collect();
    if rates.is_empty() {
        return 0.0;
    }
    let nearest = (rates.len() - 1) * 95 / 100;
    *rates.select_nth_unstable_by(nearest, f64::total_cmp).1
}

/// Substeps a second at the limit of explicit leapfrog: `omega_max / 2`, `omega_max` by power iteration on the rest shape.
pub(crate) fn explicit_rate(cloth: &Cloth) -> f64 {
    let at = |vertex: u32| cloth.rest[vertex as usize].truncate().as_dvec3();
    let links = cloth.swept();
    let directions: Vec<_> = links.iter().map(|link| (at(link.ends[1]) - at(link.ends[0])).normalize_or_zero()).collect();
    let root_weight: Vec<f64> = cloth.rest.iter().map(|x| f64::from(x.w).sqrt()).collect();
    // Any start with all wavelengths in it does; this one is the same every time.
    let mut q: Vec<glam::DVec3> = (0..cloth.rest.len())
        .map(|i| glam::DVec3::new(1.0, 1.3, 1.7) * if i % 2 == 0 { 1.0 } else { -1.0 } + (i as f64 * 0.7).sin())
        .collect();
    let mut eigenvalue = 0.0;
    for _ in 0..200 {
        let norm = q.iter().map(|q| q.length_squared()).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        let mut next = vec![glam::DVec3::ZERO; q.len()];
        for (link, &n) in links.iter().zip(&directions) {
            let [a, b] = link.ends.map(|vertex| vertex as usize);
            let force = n * link.stiffness * n.dot(q[a] * root_weight[a] - q[b] * root_weight[b]) / norm;
            next[a] += force * root_weight[a];
            next[b] -= force * root_weight[b];
        }
        eigenvalue = next.iter().map(|q| q.length_squared()).sum::<f64>().sqrt();
        q = next;
    }
    eigenvalue.sqrt() / 2.0
}
