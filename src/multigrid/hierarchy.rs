//! Coarse levels: aggregates of the cloth of increasing size, for a correction that in one substep reaches as far as
//! stress does.
//!
//! # Theory
//! One sweep carries an impulse only from each edge to the next. If substeps do not resolve the stiffness (`S < S*`),
//! that is too slow, and the strain grows as `(N/S)²`. So the predicted displacements are first corrected on coarser
//! cloths, whose vertices are aggregates of 16, 64, 256 ... vertices. This is the idea of two-level multigrid and
//! domain decomposition methods (aggregation: Vaněk, Mandel and Brezina 1996; hierarchical position-based dynamics:
//! Müller 2008), here applied to displacements:
//!
//! 1. Restrict by the mass-weighted average, `x_c = sum m_v x_v / m_c`, and `u_c` likewise. This is the adjoint of
//!    piecewise constant prolongation in the metric of the masses, so the correction is a projection and adds no
//!    energy.
//! 2. Sweep over the coarse edges, correcting stretched ones (cloth gives way to compression) along their direction
//!    at the substep's start, and undoing what this shortens others by (`distance::project_coarse`). Their shifted
//!    compliance corresponds to the share of the stiffness that the fine edges do not carry, `1 - (S/S*)²`, or less along
//!    a direction in which the fabric is soft.
//! 3. Prolongate: add to each vertex the correction of its aggregate.
//!
//! Levels are swept from the coarsest to the finest, and the coarser ones, where a sweep costs little, several times, as in the
//! cascadic multigrid method (Bornemann and Deuflhard 1996). What a level leaves uncorrected at its own wavelengths no finer one can
//! correct. So the coarsest level has only a few aggregates, too.
//!
//! Weights are constant in an aggregate, and aggregates are nested. So one pass over the vertices restricts to the
//! finest level, each coarser level is restricted from the next finer one, and the corrections are prolongated from the
//! coarsest level. An impulse `j` along `x_a - x_b` gives the masses of two aggregates the impulses `j` and `-j` and
//! exerts no torque about any point. So linear and angular momentum are conserved for any weights, as long as the
//! direction at the substep's start is used.
//!
//! # Practice
//! Aggregates are formed by halving each connected part of the mesh across its longest side, down to about 16 vertices;
//! on a grid they are blocks. Pieces not connected by edges within a cell are separated, and the pinned vertices of a
//! cell form an aggregate of their own, which moves as they do. Coarse edges join aggregates that share a fine edge,
//! and those with common neighbors on both sides (two-ring links): what matters is the number of directions.
//!
//! The rest length of a coarse edge is the largest distance that the aggregates' centers can have in unstretched cloth.
//! If a transport plan carries one shape onto the other and moves mass by `d` on average, the centers are at most `d`
//! apart (Kantorovich). For shapes that are translated copies this is the distance of their centers; at a pin it is the
//! mean distance to the pin (on the finest levels a little less, because cloth does not gather into a line within a few
//! edges). Where the rest shape bends by an angle t between the aggregates, their centers lie inside the curve and are
//! closer by the factor `((t/2)/sin(t/2))²`; where it has pleats or wrinkles, the distance is that in unfolded cloth
//! ([`unfolding`](super::unfolding)). The stiffness is that of the fabric along the edge, free to contract
//! across it, so that cloth that is soft in shear remains soft.
//!
//! # Limits
//! The mesh of a net gives way to shear without stretching its strands, which aggregates that span it do not see. So a part of the cloth
//! with more holes than aggregates has no coarse edges (`Bisection::of_nets`).
//!
//! Pins are the places with the largest strain on coarse levels as on the fine one: the worst edge there improves only
//! by a few times. Tethers handle lone pins ([`model::tethers`](crate::model::tethers)). Where the substeps resolve the
//! stiffness, levels have nothing to add. Up to 7/8 of `S*` they help: a sheet of 64 by 64 swings down with an error of
//! 3.6e-4 m at 112 substeps, and of 7.2e-4 m without levels.
//!
//! If coarse edges only pulled, the diagonals would contract a hanging sheet sideways, because nothing would push back but the fine
//! edges across, which buckle within an aggregate. A sheet without bending stiffness would flutter at 3 to 7 mm/s without end, and a wind
//! of 1 m/s at 37 degrees would roll up a cotton panel of .5 m by 1 m until its hem is .18 to .32 m wide.
//! - Without bending stiffness, coarse edges push while they are hardly compressed (`distance::hold_coarse`). A compliance floor on the
//!   fine edges would stop the flutter, too, but costs a fifth to a half more error in motion and up to twice the strain. The push
//!   flattens wrinkles shallower than 3 %, and costs a tenth more error at 40 substeps and nothing from 80 on.
//! - That resists bending: the tip of a heavy elastica (G = 100 in `an_elastica_with_levels`) would sag by .4 to .7 of its reach instead of
//!   5.9. So with bending stiffness they undo what other corrections shorten them by, and resist no bend that was predicted
//!   (`distance::project_coarse`), if the cloth has pins; otherwise it does not hang, and they only pull. With the same rule, pushes as weak
//!   as pulls, and no limit, a drape without pins would have 9.6 m of folds instead of 11.8, with the limit 11.3, and has 11.2; and a sheet
//!   without bending stiffness would have a fifth to two fifths more mean strain while it swings.
//! - Soft coarse edges pull little, and push at most fifty times as hard, so soft cloth is still rolled up: a sheet of jersey of 1 m, of
//!   21 by 21 and 41 by 41 vertices, to .79 and .84 m at 5 substeps. If they pushed four hundred times as hard, in a band of a tenth,
//!   that would be cured for 41 by 41 vertices, but not for 21 by 21. What counts is how far the weight stretches the cloth, `rho g L/K`.
//!   In a breeze of 1 m/s at 37 degrees, the hem of sheets of 0.5 to 4 m at the default quality keeps 100 % of its width up to .0016, and
//!   78 to 97 % from .0022 on, with 4 to 30 % of strain at the worst edge. So softer cloth keeps a bound on strain with more substeps
//!   instead: a sheet of jersey of 41 by 41 takes 21 instead of 6, and three times as long, for 5 % at the worst edge instead of 30, and
//!   99 % of the hem instead of 81.
//! - Without the coarser levels, whose edges span the cloth, the finest ones need a wider band: .05 instead of .012 of the squared length
//!   (`distance::SLACK_BAND_OF_FEW`). In the narrow one a panel of .75 m by 1 m with 96 by 128 vertices would be rolled up to .60 m, and by
//!   default on an H200, with the finest level alone, to .18 m.
//!
//! The coarse edges carry nearly all of the load, along a polygon of a few straight chords, and each aggregate is pushed sideways as
//! a block. So hung cloth swings like a chain of that many beads, and the steps between the blocks take the energy of its swings. At 5
//! substeps the second mode of a sheet of 21 by 21 loses half of its amplitude in five seconds, and is slower by a tenth to a third.
//! For the same reason a narrow strip that hangs from its end curls lengthwise: one of 11 by 41 vertices narrows by 5 % under its own
//! weight at 5 substeps, 0.3 % at 10; with a hundredth or more of its stiffness hung on its hem by 15 % and more. Three cures were
//! tried. Rest lengths of coarse edges that follow the mean strain of the fine ones crumple the cloth, and smooth weights change
//! little. Spread over the fine edges between its aggregates, each along its own direction, a coarse edge's impulse gives the right
//! frequency and keeps three quarters or more of most amplitudes, but needs six numbers for each fine edge and, as it is explicit, a
//! bound on the tension beyond which the chords take the rest. It would double the cost of a substep.
//!
//! Diagonal coarse edges contract the cloth across the load in every substep. What the sweeps do not push back shows as wrinkles (mm):
//! along the sides of a cotton curtain of 1 m by 2.4 m with 21 by 49 vertices, and in a towel of 1 m with 21 by 21, after 12 s:
//!
//! | sweeps over the coarser levels | curtain, 5 substeps | curtain, 10 | towel, 20 |
//! |---|---|---|---|
//! | 1 | 6.7 | 7.8 | 2.8 |
//! | 2 | 1.2 | 5.3 | 2.6 |
//! | 3 | 0.0 | 4.3 | 1.2 |
//! | 4 | 0.0 | 3.6 | 0.0 |
//! | 3, over-relaxed by 1.5 | 0.0 | 1.7 | 0.1 |
//! | 4, over-relaxed by 1.6 | 0.0 | 0.6 | 0.0 |
//!
//! So the coarser levels are swept three times, and pulls are over-relaxed. That costs a flag in a gale 1 % more strain
//! (`a_flag_in_a_gale_stays_a_flag`), and cloth that swings neither gains nor loses; with four sweeps over-relaxed by 1.6 its error would
//! be a tenth larger. Levels down to a few aggregates are needed, too: if the coarsest of the curtain had 16, even four plain sweeps would
//! leave 10 mm at 5 substeps. More sweeps over the finest level change little. Smoothing the corrections over the fine
//! edges does not help, nor do other blocks in every other substep, which tremble at 3 mm/s. Sweeps that start from the impulses of the
//! last substep (warm starting) converge on what hangs still, but pump energy into its swings: position errors that are corrected once are
//! then corrected again.
//!
//! Fine edges need not carry what the levels carry, so wrinkles smaller than an aggregate are held less taut. Wind feeds them: the
//! excess length of the fine edges, half or less of what it would be, then shows as small wrinkles instead of as stretch. A sheet of 65 by
//! 65 in gusts of 8 m/s at 20 substeps has a mean strain of 7.7e-3 instead of 1.7e-2, but 18 m of folds instead of 13, where 8 m are
//! right. At 30 m/s the aggregates become visible as a waffle pattern. Smooth weights make no difference. So no levels are chosen
//! automatically in a gale; more substeps help there.
//!
//! In substeps that resolve a coarse edge, it takes away only part of an excess. If it also pushed back only that part of what others
//! shorten it by, hung sheets would get folds: sheets of 1 m of towel, from the foremost to the hindmost vertex, of 19, 16 and 13 mm at 10,
//! 20 and 30 substeps with 21 by 21 vertices, and 0, 1 and 3 mm with 41 by 41. With full pushes 12, 8 and 5 mm are left with 21 by 21,
//! none with 41 by 41, and from 25 by 25 on at most 2.3 mm in towel or cotton. With all levels, too, instead of those that carry the load,
//! 0, 0 and 1 mm are left with 21 by 21. More levels leave the motion of such sheets as it is. Full pushes cost a sheet that falls about
//! its upper edge up to a third more error (1.3 mm instead of 1.0 at 20 substeps after a third of a second), and save one that hangs from
//! two corners a tenth.
//!
//! Tethers (long range attachments: Kim, Chentanez and Müller 2012) cannot replace the levels. Tethers over a whole
//! sheet are cheaper by a tenth of a substep, but leave a strain of 6.5e-3 and an error of 0.057 m, where levels leave
//! 2.4e-3 and 0.006 m (a sheet of 129 by 129 hung by an edge, 20 substeps; 6.8e-2 and 0.20 m with neither). They also
//! need pins.

use std::ops::Range;

use glam::DVec3;

use crate::model::cloth::Cloth;
use crate::model::csr::{Csr, distinct};
use crate::model::link::Link;
use crate::model::mesh::has_edges;
use crate::multigrid::aggregation::{Aggregate, Bisection, holding};
use crate::multigrid::coarse_edges::{Edges, Fiber, PointMasses, Stiffness, two_rings};
use crate::multigrid::unfolding::{OfLevel, Unfolding};

/// Levels have at least so many aggregates that are joined by edges, the finest one more: in cloth with fewer it is not worth its
/// overhead.
const FEWEST: usize = 2;
const FEWEST_OF_FINEST: usize = 6;
/// Sweeps over the edges of a coarser level than the finest, in cloth whose coarse edges undo what others shorten them by
/// (`distance::project_coarse`), if it has at most [`SMALL`] aggregates: a sixteenth of the work of the sweep over the finest one, or less.
const SWEEPS: u32 = 3;
const SMALL: usize = 256;
/// By how much the pulls of edges that are swept several times are over-relaxed (SOR: Young 1954).
pub(crate) const OVER_RELAXATION: f64 = 1.5;
/// Maximum number of levels: the finest level of the largest cloth has a million aggregates, and each next level a
/// quarter as many.
pub(crate) const MAX_LEVELS: usize = 12;

/// The nested levels of a cloth, finest first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hierarchy {
    pub levels: Vec<Level>,
    /// Whether the levels were built; a small mesh has none even then.
    built: bool,
}

/// The aggregates of one level and the edges between them.
#[derive(Debug, Clone)]
pub(crate) struct Level {
    /// The aggregate of each item of the next finer level: of each vertex, or of each finer aggregate.
    pub label: Vec<u32>,
    /// The items of each aggregate.
    pub members: Csr<u32>,
    /// Share of each member in the mass of its aggregate, in the order of `members.items`.
    pub share: Vec<f32>,
    /// One over the mass (1/kg) of each aggregate; 0 where pinned.
    pub inverse_mass: Vec<f32>,
    /// Edges in color order.
    pub links: Vec<Link>,
    /// The range of edges of each color.
    pub colors: Vec<Range<usize>>,
    /// How often the edges are swept in a substep if they are corrected by `distance::project_coarse`; otherwise once.
    pub sweeps: u32,
}

impl Hierarchy {
    /// Builds the levels if `asked` is not 0 and they were not built before.
    pub(crate) fn build(&mut self, cloth: &Cloth, asked: usize) {
        if asked > 0 && !self.built {
            *self = Hierarchy::new(cloth);
        }
    }

    /// The finest levels: `asked` of them, or all if there are fewer.
    pub(crate) fn finest(&self, asked: usize) -> &[Level] {
        &self.levels[..asked.min(self.levels.len())]
    }

    pub(crate) fn new(cloth: &Cloth) -> Hierarchy {
        let bisection = Bisection::new(cloth);
        let fibers = Fiber::all(cloth);
        let mut unfolding = None;
        let mut levels: Vec<Level> = Vec::new();
        let mut pairs: Vec<[u32; 2]> = holding(cloth).map(|link| link.ends).collect();
        let mut joined = joined_by(&pairs, cloth.rest.len());
        // The aggregates of the last level (initially the vertices), those of the level before it, and for each vertex
        // its aggregate in the last level.
        let mut last = vertices(cloth);
        let mut before: Option<Vec<Aggregate>> = None;
        let mut item_of: Vec<u32> = (0..last.len() as u32).collect();
        for index in 0..MAX_LEVELS as u32 {
            let (aggregate_of, count) = bisection.of_level(cloth, index);
            let mut label = vec![0; last.len()];
            item_of.iter().zip(&aggregate_of).for_each(|(&item, &aggregate)| label[item as usize] = aggregate);
            let aggregates = merged(&last, &label, count);
            let moved = pairs.iter().map(|pair| pair.map(|item| label[item as usize]));
            let moved = moved.map(|[a, b]| [a.min(b), a.max(b)]);
            let of_net = bisection.of_nets(&aggregate_of, count);
            let is_swept = |[a, b]: &[u32; 2]| {
                a != b && !(aggregates[*a as usize].pinned && aggregates[*b as usize].pinned) && !of_net[*a as usize]
            };
            pairs = distinct(moved.filter(is_swept).collect());
            // Vertices and pieces without edges to others, of which a mesh may have any number, do not count: there is nothing
            // to correct.
            let joined_before = std::mem::replace(&mut joined, joined_by(&pairs, count));
            let fewest = if index == 0 { FEWEST_OF_FINEST } else { FEWEST };
            if joined < fewest || 3 * joined > 2 * joined_before {
                break;
            }
            let members = Csr::new(count, label.iter().enumerate().map(|(item, &aggregate)| (aggregate, item as u32)));
            let share = |&item: &u32| (last[item as usize].mass / aggregates[label[item as usize] as usize].mass) as f32;
            let share = members.items.iter().map(share).collect();

            let masses = match (&before, levels.last()) {
                (Some(before), Some(level)) => {
                    PointMasses::new(before.clone(), level.label.iter().map(|&item| label[item as usize]).collect(), count)
                }
                _ => PointMasses::new(last.clone(), label.clone(), count),
            };
            let rings = two_rings(&pairs, &aggregates);
            let level = OfLevel::new(&aggregates, &aggregate_of, &pairs);
            let groups = [&rings, &pairs].map(|pairs| Unfolding::distances(&mut unfolding, cloth, &level, pairs));
            // The transport distance assumes that cloth gathers into a line, which fine cloth near a lone pin does not
            // do.
            let pin_share = 1.0 - 0.2 * 0.5_f64.powi(index as i32);
            let edges = Edges {
                aggregates: &aggregates,
                masses: &masses,
                pin_share,
                stiffness: Stiffness::new(&fibers, &aggregates, &aggregate_of),
            };
            let (links, colors) = edges.color(&groups);
            let inverse_mass = aggregates.iter().map(|aggregate| aggregate.inverse_mass() as f32).collect();
            let sweeps = if index > 0 && count <= SMALL { SWEEPS } else { 1 };
            levels.push(Level { label, members, share, inverse_mass, links, colors, sweeps });
            (before, last, item_of) = (Some(last), aggregates, aggregate_of);
        }
        Hierarchy { levels, built: true }
    }
}

/// The number of items, of `count`, that are in any of the pairs.
fn joined_by(pairs: &[[u32; 2]], count: usize) -> usize {
    has_edges(pairs, count).into_iter().filter(|&is_joined| is_joined).count()
}

/// The vertices as aggregates of one.
fn vertices(cloth: &Cloth) -> Vec<Aggregate> {
    let aggregate = |(x, &mass): (&glam::Vec4, &f32)| Aggregate {
        mass: f64::from(mass),
        center: x.truncate().as_dvec3(),
        pinned: x.w == 0.0,
        normal: DVec3::ZERO,
        area: 0.0,
    };
    let mut aggregates: Vec<Aggregate> = cloth.rest.iter().zip(&cloth.mass).map(aggregate).collect();
    for corners in &cloth.triangles {
        let [a, b, c] = corners.map(|vertex| aggregates[vertex as usize].center);
        let normal = (b - a).cross(c - a);
        for &vertex in corners {
            let aggregate = &mut aggregates[vertex as usize];
            (aggregate.normal, aggregate.area) = (aggregate.normal + normal, aggregate.area + normal.length());
        }
    }
    aggregates
}

/// Merges items into aggregates according to their labels.
fn merged(items: &[Aggregate], label: &[u32], count: usize) -> Vec<Aggregate> {
    let mut aggregates = vec![Aggregate::default(); count];
    for (item, &label) in items.iter().zip(label) {
        let aggregate = &mut aggregates[label as usize];
        aggregate.mass += item.mass;
        aggregate.center += item.center * item.mass;
        aggregate.pinned = item.pinned;
        aggregate.normal += item.normal;
        aggregate.area += item.area;
    }
    aggregates.iter_mut().for_each(|aggregate| aggregate.center /= aggregate.mass);
    aggregates
}

#[cfg(test)]
#[path = "../../tests/unit/multigrid_hierarchy.rs"]
mod tests;
