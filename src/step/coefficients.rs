//! Coefficients that depend on the length of the substep. They are computed once and kept while the length stays the
//! same.

use crate::kernels::distance::Edge;
use crate::kernels::params::PROJECT_COARSE;
use crate::kernels::tether::Tether;
use crate::model::cloth::Cloth;
use crate::model::link::Link;
use crate::model::tethers::{Held, REACH};
use crate::multigrid::hierarchy::{Level, OVER_RELAXATION};
use crate::options::{Method, Options};
use crate::step::bending::{BendRows, most_kicked};
use crate::step::levels::{coarse_rule, is_soft};
use crate::step::substep_count::{Length, ONE_WAY, SIXTIETHS, STANDARD_GRAVITY, softening};
use crate::step::watch::TRANSIENT;

/// The coefficients of a cloth for substeps of one length.
pub(crate) struct Coefficients {
    /// The length that they are for.
    pub length: Length,
    /// Edges in color order; empty for springs, which act as forces.
    pub edges: Vec<Edge>,
    /// Coarse edges of each level in use, finest first.
    pub levels: Vec<Vec<Edge>>,
    /// Tethers with their vertices, sorted by vertex; empty where there are no lone pins or the stiffness is resolved.
    pub tethers: Vec<(u32, Tether)>,
    /// Rows of the bending energy; empty without bending.
    pub bending: BendRows,
}

impl Coefficients {
    /// For substeps of one length, with edges for the coarse `levels` in use.
    pub(crate) fn new(cloth: &Cloth, levels: &[Level], options: &Options, length: Length) -> Coefficients {
        let fine = |link: &Link, floor: f64| {
            let weight = cloth.weight(link);
            let inverse_weight = match options.method {
                Method::SmallSteps => inverse_weight(1.0 / cloth.stiffness(link), weight, softening(link), floor, length),
                // Relaxation ignores stiffness, but an edge scaled to zero still has to be absent.
                _ if link.shape == 0.0 => 0.0,
                _ => inverse_weight(0.0, weight, ONE_WAY, 0.0, length),
            };
            edge(link, inverse_weight)
        };
        let in_chain = in_chain(cloth);
        let stress = TRANSIENT * cloth.density * STANDARD_GRAVITY * cloth.extents.extent;
        let least = |link: &Link| {
            if in_chain(link) || link.is_visited_twice() { 0.0 } else { floor(cloth, link, length, stress) }
        };
        let swept = if options.method == Method::Springs { &[] } else { cloth.swept() };
        let edges = swept.iter().map(|link| fine(link, least(link))).collect();
        // The levels carry only the load that the fine sweep does not.
        let left = (1.0 - length.resolved).max(0.0);
        let sum = |links: &[Link]| links.iter().map(|link| link.shape * f64::from(link.rest).powi(2)).sum::<f64>();
        let share = left / levels.len() as f64 * sum(cloth.swept());
        let is_repeated = coarse_rule(cloth, options) == PROJECT_COARSE;
        let coarse = |level: &Level| {
            let shared = (share / sum(&level.links)).min(left);
            let sweeps = if is_repeated { f64::from(level.sweeps) } else { 1.0 };
            let over = if sweeps > 1.0 { OVER_RELAXATION } else { 1.0 };
            let coarse_edge = |link: &Link| {
                // Along a soft direction, the fine sweep carries more of the load.
                let firmness = f64::from(link.scale);
                let is_soft = is_soft(cloth, firmness);
                let left = (if is_soft { shared } else { left }).min((1.0 - length.resolved / firmness).max(0.0));
                let weight = link.ends.iter().map(|&end| f64::from(level.inverse_mass[end as usize])).sum();
                let once = inverse_weight(1.0 / (left * cloth.stiffness(link)), weight, ONE_WAY, 0.0, length);
                // All sweeps over a soft edge correct it, by itself, as much as one would.
                let is_divided = is_soft && sweeps > 1.0;
                let divided = || (1.0 - (1.0 - weight * once).max(0.0).powf(1.0 / sweeps)) / weight;
                edge(link, if is_divided { divided() } else { over * once })
            };
            level.links.iter().map(coarse_edge).collect()
        };
        let levels = levels.iter().map(coarse).collect();
        let fabric = options.fabric;
        let bending = if fabric.bending > 0.0 {
            let [rigidity, tau, h, softest] = [fabric.bending, fabric.damping, length.longest_h, length.softest_h].map(f64::from);
            let kick = (options.method == Method::SmallSteps).then(|| most_kicked(cloth, rigidity, softest));
            BendRows::new(cloth.bending(), &cloth.rest, [rigidity, tau], [h, softest], kick)
        } else {
            BendRows::default()
        };
        let tethers = tethers(cloth, length);
        Coefficients { length, edges, levels, tethers, bending }
    }
}

/// Substeps in 1/60 s above which tethers act only on vertices closer to the pin.
const FULL_REACH: f64 = 20.0;

/// The tethers with a share greater than 0. They reach as far from the pin as the sweep leaves edges too long, which is
/// less far the more substeps there are. Like edges, they are as stiff in a shorter substep as in the longest one: otherwise
/// a step of a microsecond would turn what is left of a stretch into hundreds of meters per second.
fn tethers(cloth: &Cloth, length: Length) -> Vec<(u32, Tether)> {
    let substeps = 1.0 / (SIXTIETHS * f64::from(length.longest_h));
    let reach = REACH * cloth.sides.max_element() * (FULL_REACH / substeps).min(1.0);
    let part = (f64::from(length.h) / f64::from(length.longest_h)).powi(2).min(1.0);
    let left = part * (1.0 - length.resolved);
    let tether = |held: &Held| {
        let share = left * (1.0 - f64::from(held.distance) / reach);
        // Bounded, because an infinite slack would become NaN in zero acceleration.
        let slack = (f64::from(held.give) / cloth.membrane_stiffness).min(1e9) as f32;
        let Held { vertex, anchor, distance, .. } = *held;
        (share > 0.0).then_some((vertex, Tether { anchor, length: distance, slack, share: share as f32 }))
    };
    cloth.tethers.iter().flat_map(|tethers| &tethers.held).filter_map(tether).collect()
}

fn edge(link: &Link, inverse_weight: f64) -> Edge {
    let [a, b] = link.ends;
    Edge { a, b, inverse_rest: 1.0 / link.rest, inverse_weight: inverse_weight as f32 }
}

/// `1 / (w + a')` of an edge, with its compliance `1/k` (m/N) shifted: `a' = alpha/h² - w/2`, `w = w_i + w_j`.
///
/// Why half of `w` is subtracted: one sweep solves `(D + a' + L) dlambda = -C`, while the exact implicit step solves
/// `(A + a) dlambda = -C` with `a = 1/(k h²)` and `A = L + D + L^T`. At the long wavelengths that carry the load,
/// `A q = 0` to first order, so `q.(L + L^T)q = -q.D q` and `q.L q = -q.D q/2`: one sweep acts as if the compliance
/// were `a' + D/2`. On a chain of two colors this is exact; a larger shift over-corrects.
///
/// A sweep there and back in all solves `P E^-1 P^T dlambda = -C`, with `P = D + a' + L` and `E = D + 2 a'`. That matrix
/// is symmetric, so the sweep pumps no energy, and positive for any `a'`. As `P = E/2 + (D/2 + L)`, it is
/// `E/4 + A/2 + (D/2 + L) E^-1 (D/2 + L)^T`. The sweep acts as if the compliance were `E/4 = D/4 + a'/2`, so
/// `a' = 2 alpha/h² - w/2`; the last term fades as `D²/alpha` when the stiffness is resolved.
///
/// Where a substep does not resolve the stiffness, nothing is left to subtract from, and the edge acts as a spring of
/// stiffness `2/(h² w)`. If `h` were this substep's length, a shorter substep would stiffen all stretched edges and so
/// raise their energy, and steps of changing length would pump energy into the cloth. So `alpha` is based on the
/// longest substep `h_q` that the quality allows: `alpha = max(1/k, h_q² w (1/2 + floor))`, or 1/4 instead of 1/2.
fn inverse_weight(compliance: f64, weight: f64, softening: f64, floor: f64, length: Length) -> f64 {
    let [h, longest] = [length.h, length.longest_h].map(f64::from);
    let alpha = compliance.max(longest * longest * weight * (softening + floor));
    1.0 / (weight + (alpha / (h * h) - softening * weight).max(0.0) / (2.0 * softening))
}

/// Substeps in 1/60 s above which unresolved edges are softened.
const MANY: f64 = 100.0;
/// The strain that softening may add at any stiffness.
const UNSEEN: f64 = 5e-5;

/// The least value of `a'/w` of an edge: 0, except for edges that even many substeps do not resolve.
///
/// The order of the sweep makes `D + a' + L` unsymmetric, so a pair of slow stretching modes of similar frequency
/// amplifies itself, by up to `kappa²/(8 (1/2 + floor)²)` per substep, with kappa their coupling by `(L - L^T)/2`. That
/// is little, but 1000 substeps in 1/60 s are 60,000 a second, and a stiff sheet of 17 by 17 vertices gained more than
/// the energy of its whole fall. A floor of `w/2`, approached as the number of substeps grows, divides the rate by nine
/// (measured on the spectra of 9 by 9 sheets). It costs up to twice the strain, which is small at so many substeps.
///
/// The floor fades as the substeps come to resolve the edge, because there the accuracy is its stiffness. But it does
/// not fade where twice the strain cannot be seen, since nothing else keeps a sheet of K = 1e7 N/m at 1000 substeps
/// from gaining an eighth of the energy of its fall: under a membrane `stress` (N/m) it adds a strain of
/// `floor h² w k stress/K`, and at most [`UNSEEN`].
fn floor(cloth: &Cloth, link: &Link, length: Length, stress: f64) -> f64 {
    let longest = f64::from(length.longest_h);
    let substeps = 1.0 / (SIXTIETHS * longest);
    if substeps <= MANY {
        return 0.0;
    }
    let most = 0.5 * (1.0 - MANY / substeps);
    let square = longest * longest * cloth.weight(link);
    // `(S/S*)²` of this edge.
    let resolved = 2.0 / (cloth.stiffness(link) * square);
    let fading = most * (1.0 - resolved).max(0.0).powi(2);
    let unseen = UNSEEN / (square * link.shape * stress);
    fading.max(unseen.min(most))
}

/// Tells which edges are part of a chain. The order of visits does not affect the stability of a chain, so its edges
/// need no floor.
fn in_chain(cloth: &Cloth) -> impl Fn(&Link) -> bool {
    let mut edges_at = vec![0_u32; cloth.rest.len()];
    cloth.links.iter().flat_map(|link| link.ends).for_each(|vertex| edges_at[vertex as usize] += 1);
    move |link| link.ends.iter().all(|&vertex| edges_at[vertex as usize] <= 2)
}
