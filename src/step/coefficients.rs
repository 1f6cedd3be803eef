//! What depends on the length of the substep: computed once, kept while the length stays.

use crate::kernels::bending::BendRow;
use crate::kernels::distance::Edge;
use crate::model::cloth::{Cloth, Link};
use crate::multigrid::hierarchy::Level;
use crate::options::{Method, Options};

/// The cloth's numbers for substeps of one length.
#[derive(Debug, Clone)]
pub(crate) struct Coefficients {
    /// The substep (s) they are for.
    pub h: f32,
    /// Edges in color order; none for springs, which are forces.
    pub edges: Vec<Edge>,
    /// Coarse edges of each level in use, the finest first.
    pub levels: Vec<Vec<Edge>>,
    /// Rows of the bending energy; empty without bending.
    pub bending: Vec<BendRow>,
    /// Vertices whose bending had to be softened.
    pub bending_limited: usize,
}

impl Coefficients {
    /// For substeps of `h` (s), with the coarse levels in use.
    pub(crate) fn new(cloth: &Cloth, levels: &[Level], options: &Options, h: f32) -> Coefficients {
        let edges = match options.method {
            Method::Springs => Vec::new(),
            method => {
                let h = f64::from(h);
                let edges = cloth.swept().iter().map(|link| Edge {
                    a: link.ends[0],
                    b: link.ends[1],
                    inverse_rest: 1.0 / link.rest,
                    inverse_weight: match method {
                        Method::SmallSteps => shifted(1.0 / (link.stiffness * h * h), cloth.weight(link)),
                        // Relaxation knows no stiffness; an edge scaled to nothing is still no edge.
                        _ if link.shape == 0.0 => 0.0,
                        _ => 1.0 / cloth.weight(link),
                    } as f32,
                });
                edges.collect()
            }
        };
        let coarse = |level: &Level| {
            let edge = |link: &Link| {
                let weight = link.ends.iter().map(|&end| f64::from(level.inverse_mass[end as usize])).sum();
                Edge {
                    a: link.ends[0],
                    b: link.ends[1],
                    inverse_rest: 1.0 / link.rest,
                    inverse_weight: shifted(1.0 / (link.stiffness * f64::from(h).powi(2)), weight) as f32,
                }
            };
            level.links.iter().map(edge).collect()
        };
        let levels = levels.iter().map(coarse).collect();
        let fabric = options.fabric;
        let (bending, bending_limited) = if fabric.bending > 0.0 {
            cloth.bending().rows(&cloth.rest, f64::from(fabric.bending), f64::from(fabric.damping), f64::from(h))
        } else {
            (Vec::new(), 0)
        };
        Coefficients { h, edges, levels, bending, bending_limited }
    }
}

/// `1 / (w + a')` with the shifted compliance `a' = max(0, a - w/2)`, `a = 1/(k h²)`, `w = w_i + w_j`.
///
/// Why half of w: the sweep solves `(D + a' + L) dlambda = -C` once, where the exact implicit step is
/// `A + a`, `A = L + D + L^T`. At the long wavelengths that carry the load (`A q = 0` to first order) `q.(L + L^T)q = -q.D q`, so
/// `q.L q = -D/2`: one sweep acts as if the compliance were `a' + D/2`. On a chain of two colors this is exact; a larger
/// shift over-corrects. Where the substep does not resolve the stiffness, `a < w/2`, nothing is left to take off.
fn shifted(compliance: f64, weight: f64) -> f64 {
    1.0 / (weight + (compliance - 0.5 * weight).max(0.0))
}
