//! Coarse levels: the cloth in ever larger aggregates, for a correction that reaches as far in one substep as stress does.
//!
//! # Theory
//! One sweep carries an impulse from an edge to the next. Below the resolved substep (`S < S*`) that is too slow: the
//! strain it leaves grows as `(N/S)²`. So the predicted displacements are first corrected on coarse cloths, whose vertices are
//! aggregates of 16, 64, 256 ... vertices: the two-level idea of multigrid and of domain decomposition (aggregation:
//! Vaněk, Mandel & Brezina 1996; hierarchical position-based dynamics: Müller 2008), here in displacements:
//!
//! 1. restrict by the mass-weighted average, `x_c = sum m_v x_v / m_c`, `u_c` likewise: the adjoint of piecewise constant
//!    prolongation in the metric of the masses, so that the correction is a projection and gives no energy;
//! 2. sweep once over the coarse edges, those that are stretched alone (cloth gives way to compression), along their direction
//!    at the substep's start, with the shifted compliance of what the fine edges leave of the stiffness: `1 - (S/S*)²` of it;
//! 3. add to each vertex what its aggregate was corrected by.
//!
//! Weights are constant in an aggregate and aggregates are nested. So one pass over the vertices restricts to the finest level,
//! each coarser one is restricted from the finer, and what the coarsest are corrected by is handed down.
//! An impulse `j` along `x_a - x_b` moves the aggregates' masses by `j` and `-j` and has no torque about any point, so both
//! momenta are kept, whatever the weights, while the direction is that of the start.
//!
//! # Practice
//! Aggregates come from halving each part of the mesh across its longest side, down to 16 vertices or so; on a grid these are
//! blocks. Pieces that are connected by no edge of their own are told apart, and pinned vertices are an aggregate of their
//! own, which moves as they do. Coarse edges join aggregates with a fine edge in common, and those with two common
//! neighbors on either side: it is the number of directions that counts.
//!
//! An edge's rest length is the most that the aggregates' centers can be apart in unstretched cloth. The centers of two
//! shapes that are carried onto each other by a plan that moves mass by `d` on average are at most `d` apart (Kantorovich):
//! for shapes that are translated copies that is the distance of their centers; about a pin it is the mean distance to it (on
//! the finest levels a little less, for cloth does not gather in one line within a few edges).
//! Where the rest shape bends by the angle t from one to the other, centers are inside of it and `((t/2)/sin(t/2))²` nearer.
//! Stiffness is that of the fabric along the edge, free to contract across it, so that cloth soft in shear stays so.
//!
//! # Limits
//! Pins are the coarse cloth's own worst place, as they are the fine one's: the worst edge there is better by a few times only. Lone pins
//! have tethers for that ([`model::tethers`](crate::model::tethers)).
//! Where the substeps resolve the stiffness, levels have nothing to add. Up to seven eighths of `S*` they do: a sheet of 64 by 64
//! swings down with 3.6e-4 m of error at 112 substeps, and with 7.2e-4 m without them.
//!
//! Of cloth that does not resist bending coarse edges hold (`distance::hold_coarse`): in a hung sheet that they only pull, diagonals
//! pull it narrower, fine edges across are pressed, and it flutters below an aggregate's size by 3 to 7 mm/s for ever. A compliance floor
//! under the fine edges stills that as well, for a fifth to a half more error in motion and up to twice the strain; a coarse edge that
//! holds irons what is flatter than three parts in a hundred, for a tenth more error at 40 substeps and none from 80 on.
//!
//! What the levels carry the fine edges need not, and so wrinkles smaller than an aggregate are held less taut. At rest nothing
//! feeds them. In wind something does: the length that the fine edges still have too much of, half or less of what it
//! was, is then seen as small wrinkles instead of as stretch. A sheet of 65 by 65 in gusts of 8 m/s, 20 substeps: mean strain
//! 7.7e-3 against 1.7e-2, and 18 m of folds against 13, where 8 m are right; at 30 m/s it is a waffle of aggregates. Smooth
//! weights make no difference. So no levels are chosen in a gale; what helps there is substeps.
//!
//! Tethers (long range attachments: Kim, Chentanez & Müller 2012) do not take the levels' place. Those of the whole sheet, cheaper by a
//! tenth of a substep, leave 6.5e-3 of strain and 0.057 m of error where levels leave 2.4e-3 and 0.006 m (a sheet of 129 hung
//! by an edge, 20 substeps; 6.8e-2 and 0.20 m with neither), and need pins.

use std::ops::Range;

use glam::DVec3;

use crate::model::cloth::{Cloth, Link};
use crate::model::csr::Csr;
use crate::multigrid::aggregation::{Aggregate, Bisection, holding};
use crate::multigrid::coarse_edges::{Edges, Fiber, PointMasses, Stiffness, two_rings};

/// A level of fewer aggregates is not worth its overhead.
const FEWEST: usize = 6;
/// The most levels: the finest of the largest cloth has a million aggregates, and each next one a quarter as many.
pub(crate) const MAX_LEVELS: usize = 12;

/// Nested levels, the finest first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hierarchy {
    pub levels: Vec<Level>,
    /// Whether they have been built: a mesh may have none.
    built: bool,
}

/// Aggregates, and the edges between them.
#[derive(Debug, Clone)]
pub(crate) struct Level {
    /// The aggregate of each item below: of each vertex, or of each aggregate of the next finer level.
    pub label: Vec<u32>,
    /// The items of each aggregate.
    pub members: Csr<u32>,
    /// Share of each of them in their aggregate's mass.
    pub share: Vec<f32>,
    /// One over the mass (1/kg) of each aggregate, 0 where pinned.
    pub inverse_mass: Vec<f32>,
    /// Edges in color order.
    pub links: Vec<Link>,
    /// The edges of each color.
    pub colors: Vec<Range<usize>>,
}

impl Hierarchy {
    /// Builds the levels if any are asked for and there are none yet.
    pub(crate) fn build(&mut self, cloth: &Cloth, asked: usize) {
        if asked > 0 && !self.built {
            *self = Hierarchy::new(cloth);
        }
    }

    /// The finest levels, as many as asked for or as there are.
    pub(crate) fn finest(&self, asked: usize) -> &[Level] {
        &self.levels[..asked.min(self.levels.len())]
    }

    pub(crate) fn new(cloth: &Cloth) -> Hierarchy {
        let bisection = Bisection::new(cloth);
        let fibers = Fiber::all(cloth);
        let mut levels: Vec<Level> = Vec::new();
        let mut pairs: Vec<[u32; 2]> = holding(cloth).map(|link| link.ends).collect();
        // The aggregates of the last level (to begin with, the vertices) and of the one before, and which of the last each vertex is in.
        let mut last = vertices(cloth);
        let mut before: Option<Vec<Aggregate>> = None;
        let mut item_of: Vec<u32> = (0..last.len() as u32).collect();
        for index in 0..MAX_LEVELS as u32 {
            let (aggregate_of, count) = bisection.of_level(cloth, index);
            if count < FEWEST || 3 * count > 2 * last.len() {
                break;
            }
            let mut label = vec![0; last.len()];
            item_of.iter().zip(&aggregate_of).for_each(|(&item, &aggregate)| label[item as usize] = aggregate);
            let aggregates = merged(&last, &label, count);
            let members = Csr::new(count, label.iter().enumerate().map(|(item, &aggregate)| (aggregate, item as u32)));
            let share = |&item: &u32| (last[item as usize].mass / aggregates[label[item as usize] as usize].mass) as f32;
            let share = members.items.iter().map(share).collect();

            let moved = pairs.iter().map(|pair| pair.map(|item| label[item as usize]));
            let moved = moved.map(|[a, b]| [a.min(b), a.max(b)]);
            pairs =
                moved.filter(|[a, b]| a != b && !(aggregates[*a as usize].pinned && aggregates[*b as usize].pinned)).collect();
            pairs.sort_unstable();
            pairs.dedup();
            let masses = match (&before, levels.last()) {
                (Some(before), Some(level)) => {
                    PointMasses::new(before.clone(), level.label.iter().map(|&item| label[item as usize]).collect(), count)
                }
                _ => PointMasses::new(last.clone(), label.clone(), count),
            };
            let rings = two_rings(&pairs, &aggregates);
            // Near a lone pin fine cloth does not gather in one line, as the farthest that centers can be apart takes it to be.
            let pin_share = 1.0 - 0.2 * 0.5_f64.powi(index as i32);
            let edges = Edges {
                cloth,
                aggregates: &aggregates,
                masses: &masses,
                pin_share,
                stiffness: Stiffness::new(&fibers, &aggregates, &aggregate_of),
            };
            let (links, colors) = edges.color(&[rings, pairs.clone()]);
            let inverse_mass = aggregates.iter().map(|aggregate| aggregate.inverse_mass() as f32).collect();
            levels.push(Level { label, members, share, inverse_mass, links, colors });
            (before, last, item_of) = (Some(last), aggregates, aggregate_of);
        }
        Hierarchy { levels, built: true }
    }
}

/// The vertices as aggregates of one.
fn vertices(cloth: &Cloth) -> Vec<Aggregate> {
    let aggregate = |(x, &mass): (&glam::Vec4, &f32)| Aggregate {
        mass: f64::from(mass),
        center: x.truncate().as_dvec3(),
        pinned: x.w == 0.0,
        normal: DVec3::ZERO,
    };
    let mut aggregates: Vec<Aggregate> = cloth.rest.iter().zip(&cloth.mass).map(aggregate).collect();
    for corners in &cloth.triangles {
        let [a, b, c] = corners.map(|vertex| aggregates[vertex as usize].center);
        let normal = (b - a).cross(c - a);
        corners.iter().for_each(|&vertex| aggregates[vertex as usize].normal += normal);
    }
    aggregates
}

/// Aggregates made of smaller ones, by the label of each.
fn merged(items: &[Aggregate], label: &[u32], count: usize) -> Vec<Aggregate> {
    let mut aggregates = vec![Aggregate::default(); count];
    for (item, &label) in items.iter().zip(label) {
        let aggregate = &mut aggregates[label as usize];
        aggregate.mass += item.mass;
        aggregate.center += item.center * item.mass;
        aggregate.pinned = item.pinned;
        aggregate.normal += item.normal;
    }
    aggregates.iter_mut().for_each(|aggregate| aggregate.center /= aggregate.mass);
    aggregates
}

#[cfg(test)]
#[path = "../../tests/unit/multigrid_hierarchy.rs"]
mod tests;
