//! What depends on the length of the substep: computed once, kept while the length stays.

use crate::kernels::distance::Edge;
use crate::kernels::tether::Tether;
use crate::model::cloth::{Cloth, Link};
use crate::model::tethers::{Held, REACH};
use crate::multigrid::hierarchy::Level;
use crate::options::{Method, Options};
use crate::step::bending::BendRows;
use crate::step::substep_count::Length;

/// The cloth's numbers for substeps of one length.
#[derive(Debug, Clone)]
pub(crate) struct Coefficients {
    /// What they are for.
    pub length: Length,
    /// Edges in color order; none for springs, which are forces.
    pub edges: Vec<Edge>,
    /// Coarse edges of each level in use, the finest first.
    pub levels: Vec<Vec<Edge>>,
    /// Tethers, by vertex; none where there are no lone pins, or the stiffness is resolved.
    pub tethers: Vec<(u32, Tether)>,
    /// Rows of the bending energy; none without bending.
    pub bending: BendRows,
}

impl Coefficients {
    /// For substeps of one length, with the coarse levels in use.
    pub(crate) fn new(cloth: &Cloth, levels: &[Level], options: &Options, length: Length) -> Coefficients {
        let fine = |link: &Link, floor: f64| {
            let weight = cloth.weight(link);
            let inverse_weight = match options.method {
                Method::SmallSteps => inverse_weight(1.0 / link.stiffness, weight, floor, length),
                // Relaxation knows no stiffness; an edge scaled to nothing is still no edge.
                _ if link.shape == 0.0 => 0.0,
                _ => inverse_weight(0.0, weight, 0.0, length),
            };
            edge(link, inverse_weight)
        };
        let in_chain = in_chain(cloth);
        let least = |link: &Link| if in_chain(link) { 0.0 } else { floor(link, cloth.weight(link), length) };
        let swept = if options.method == Method::Springs { &[] } else { cloth.swept() };
        let edges = swept.iter().map(|link| fine(link, least(link))).collect();
        // What the fine edges carry themselves the levels need not: both together are as stiff as the fabric.
        let left = (1.0 - length.resolved).max(0.0);
        let coarse = |level: &Level| {
            let coarse_edge = |link: &Link| {
                let weight = link.ends.iter().map(|&end| f64::from(level.inverse_mass[end as usize])).sum();
                edge(link, inverse_weight(1.0 / (left * link.stiffness), weight, 0.0, length))
            };
            level.links.iter().map(coarse_edge).collect()
        };
        let levels = levels.iter().map(coarse).collect();
        let fabric = options.fabric;
        let bending = if fabric.bending > 0.0 {
            let numbers = [fabric.bending, fabric.damping, length.longest].map(f64::from);
            BendRows::new(cloth.bending(), &cloth.rest, numbers, options.method == Method::SmallSteps)
        } else {
            BendRows::default()
        };
        let tethers = tethers(cloth, length);
        Coefficients { length, edges, levels, tethers, bending }
    }
}

/// Substeps in 1/60 s from which tethers reach less far.
const FULL_REACH: f64 = 20.0;

/// The tethers of vertices that any share is left for. They reach as far as what the sweep leaves too long: the less, the more substeps.
fn tethers(cloth: &Cloth, length: Length) -> Vec<(u32, Tether)> {
    let substeps = 1.0 / (60.0 * f64::from(length.longest));
    let reach = REACH * cloth.extent * (FULL_REACH / substeps).min(1.0);
    let left = 1.0 - length.resolved;
    let tether = |held: &Held| {
        let share = left * (1.0 - f64::from(held.distance) / reach);
        // Finite, or none of it would be no number.
        let slack = (f64::from(held.give) / cloth.stretch).min(1e9) as f32;
        let Held { vertex, anchor, distance, .. } = *held;
        (share > 0.0).then_some((vertex, Tether { anchor, length: distance, slack, share: share as f32 }))
    };
    cloth.tethers.iter().flat_map(|tethers| &tethers.held).filter_map(tether).collect()
}

fn edge(link: &Link, inverse_weight: f64) -> Edge {
    let [a, b] = link.ends;
    Edge { a, b, inverse_rest: 1.0 / link.rest, inverse_weight: inverse_weight as f32 }
}

/// `1 / (w + a')` of an edge of compliance `1/k` (m/N), with the shifted compliance `a' = alpha/h² - w/2`, `w = w_i + w_j`.
///
/// Why half of w: the sweep solves `(D + a' + L) dlambda = -C` once, where the exact implicit step is
/// `A + a`, `a = 1/(k h²)`, `A = L + D + L^T`. At the long wavelengths that carry the load (`A q = 0` to first order) `q.(L + L^T)q = -q.D q`, so
/// `q.L q = -D/2`: one sweep acts as if the compliance were `a' + D/2`. On a chain of two colors this is exact; a larger
/// shift over-corrects.
///
/// Where a substep does not resolve the stiffness nothing is left to take off, and the edge acts as a spring of `2/(h² w)`. Were
/// `h` this substep's, a shorter one would stiffen all that is stretched, which gives it energy: steps of changing length would pump
/// the cloth up. So it is the longest substep that the quality allows: `alpha = max(1/k, h_q² w (1/2 + floor))`.
fn inverse_weight(compliance: f64, weight: f64, floor: f64, length: Length) -> f64 {
    let [h, longest] = [length.h, length.longest].map(f64::from);
    let alpha = compliance.max(longest * longest * weight * (0.5 + floor));
    1.0 / (weight + (alpha / (h * h) - 0.5 * weight).max(0.0))
}

/// Substeps in 1/60 s above which stiff edges are softened.
const MANY: f64 = 100.0;

/// Least `a'/w` of an edge: 0, but for edges that many substeps still do not resolve.
///
/// The sweep's order makes `D + a' + L` unsymmetrical, so that a pair of slow stretching modes of like frequency feeds on itself: by up to
/// `kappa²/(8 (1/2 + floor)²)` a substep, kappa their coupling by `(L - L^T)/2`. Little, but 1000 substeps in 1/60 s are 60,000 a
/// second: a stiff sheet of 17 by 17 gained more than its whole fall. A half of w, approached as substeps grow, divides the rate by nine
/// (measured: spectra of 9 by 9). It costs up to twice the strain, of which so many substeps leave little.
fn floor(link: &Link, weight: f64, length: Length) -> f64 {
    let longest = f64::from(length.longest);
    let substeps = 1.0 / (60.0 * longest);
    if substeps <= MANY {
        return 0.0;
    }
    // (S/S*)² of this edge.
    let resolved = 2.0 / (link.stiffness * longest * longest * weight);
    0.5 * (1.0 - resolved).max(0.0).powi(2) * (1.0 - MANY / substeps)
}

/// Which edges are part of a chain, whose order of visits has no say in stability: none needs a floor.
fn in_chain(cloth: &Cloth) -> impl Fn(&Link) -> bool {
    let mut edges_at = vec![0_u32; cloth.rest.len()];
    cloth.links.iter().flat_map(|link| link.ends).for_each(|vertex| edges_at[vertex as usize] += 1);
    move |link| link.ends.iter().all(|&vertex| edges_at[vertex as usize] <= 2)
}
