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
//!    at the substep's start, with the shifted compliance;
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
//! Pins are the coarse cloth's own worst place, as they are the fine one's: the worst edge there is better by a few times only.
//! Where the substeps resolve the stiffness, levels have nothing to add.
//!
//! What the levels carry the fine edges need not, and so wrinkles smaller than an aggregate are held less taut. At rest nothing
//! feeds them. In wind something does: the length that the fine edges still have too much of, half or less of what it
//! was, is then seen as small wrinkles instead of as stretch. A sheet of 65 by 65 in gusts of 8 m/s, 20 substeps: mean strain
//! 7.7e-3 against 1.7e-2, and 18 m of folds against 13, where 8 m are right; at 30 m/s it is a waffle of aggregates. Smooth
//! weights make no difference. So no levels are chosen in a gale; what helps there is substeps.
//!
//! Tethers (long-range attachments: Kim, Chentanez & Müller 2012) are not built beside the levels. Cheaper by a tenth of a
//! substep, they leave 6.5e-3 of strain and 0.057 m of error where levels leave 2.4e-3 and 0.006 m (a sheet of 129 hung
//! by an edge, 20 substeps; 6.8e-2 and 0.20 m with neither), and need pins.

use std::ops::Range;

use glam::DVec3;

use crate::model::cloth::{Cloth, Link};
use crate::model::csr::Csr;
use crate::multigrid::aggregation::{Bisection, holding};
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

/// An aggregate at rest; a vertex is one by itself.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Aggregate {
    /// Mass (kg), and its center (m).
    pub mass: f64,
    pub center: DVec3,
    pub pinned: bool,
    /// Sum of the normals, each as long as the area it stands for.
    pub normal: DVec3,
}

impl Aggregate {
    fn inverse_mass(&self) -> f64 {
        if self.pinned { 0.0 } else { 1.0 / self.mass }
    }
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
mod tests {
    use std::collections::BTreeSet;

    use glam::Vec3;

    use super::*;
    use crate::{Mesh, Options};

    /// What holds for the levels of any mesh. Gives them back.
    fn check(mesh: &Mesh, options: Options) -> Vec<Level> {
        let cloth = Cloth::new(mesh, &options).unwrap();
        let levels = Hierarchy::new(&cloth).levels;
        let mut masses: Vec<f64> = cloth.mass.iter().map(|&mass| f64::from(mass)).collect();
        let mut pinned: Vec<bool> = cloth.rest.iter().map(|x| x.w == 0.0).collect();
        let mut of_vertex: Vec<u32> = (0..masses.len() as u32).collect();
        for level in &levels {
            let count = level.inverse_mass.len();
            assert_eq!(level.label.len(), masses.len(), "every item is in an aggregate");
            assert!(3 * count <= 2 * masses.len(), "a level is much smaller than the one below");
            let mut sums = vec![0.0; count];
            for (item, &aggregate) in level.label.iter().enumerate() {
                sums[aggregate as usize] += masses[item];
                assert_eq!(pinned[item], level.inverse_mass[aggregate as usize] == 0.0, "the pinned are apart");
            }
            for (aggregate, sum) in sums.iter().enumerate() {
                let span = level.members.spans[aggregate];
                let range = span.start as usize..span.end as usize;
                let items = &level.members.items[range.clone()];
                assert!(!items.is_empty() && items.iter().all(|&item| level.label[item as usize] == aggregate as u32));
                for (&item, share) in items.iter().zip(&level.share[range]) {
                    assert!((f64::from(*share) * sum / masses[item as usize] - 1.0).abs() < 1e-5, "shares are by mass");
                }
                let inverse = f64::from(level.inverse_mass[aggregate]);
                assert!(inverse == 0.0 || (inverse * sum - 1.0).abs() < 1e-5);
            }
            of_vertex.iter_mut().for_each(|item| *item = level.label[*item as usize]);
            (masses, pinned) = (sums, level.inverse_mass.iter().map(|&w| w == 0.0).collect());

            // The free vertices of an aggregate are connected: as many joins as it takes.
            let mut joined: Vec<u32> = (0..of_vertex.len() as u32).collect();
            for _ in 0..of_vertex.len() {
                let mut changed = false;
                for link in holding(&cloth) {
                    let [a, b] = link.ends.map(|vertex| vertex as usize);
                    if of_vertex[a] == of_vertex[b] && joined[a] != joined[b] {
                        (joined[a], joined[b], changed) = (joined[a].min(joined[b]), joined[a].min(joined[b]), true);
                    }
                }
                if !changed {
                    break;
                }
            }
            let names: BTreeSet<(u32, u32)> =
                of_vertex.iter().copied().zip(joined).filter(|(of, _)| !pinned[*of as usize]).collect();
            let free = level.inverse_mass.iter().filter(|&&w| w > 0.0).count();
            assert_eq!(names.len(), free, "an aggregate is in one piece");

            let mut visited = 0;
            for range in &level.colors {
                let mut seen = BTreeSet::new();
                for link in &level.links[range.clone()] {
                    let weights = link.ends.map(|end| level.inverse_mass[end as usize]);
                    assert!(weights[0] + weights[1] > 0.0, "no edge between pins");
                    assert!(link.rest > 0.0 && link.rest.is_finite() && link.stiffness > 0.0, "{link:?}");
                    assert!(link.ends.iter().all(|end| seen.insert(*end)), "edges of a color share no end");
                    visited += 1;
                }
            }
            assert_eq!(visited, level.links.len());
        }
        let again = Hierarchy::new(&cloth).levels;
        assert!(levels.iter().zip(&again).all(|(a, b)| a.label == b.label), "the same mesh gives the same levels");
        levels
    }

    /// Two meshes as one.
    fn both(mut a: Mesh, b: &Mesh, by: Vec3) -> Mesh {
        let first = a.positions.len() as u32;
        a.positions.extend(b.positions.iter().map(|x| *x + by));
        a.triangles.extend(b.triangles.iter().map(|corners| corners.map(|vertex| vertex + first)));
        a
    }

    #[test]
    fn a_grids_aggregates_are_blocks() {
        let mass = Some(vec![1e-3; 64 * 64]);
        let levels = check(&Mesh::grid(64, 64, 1.0, 1.0), Options { mass, ..Options::default() });
        assert_eq!(levels.iter().map(|level| level.inverse_mass.len()).collect::<Vec<_>>(), [256, 64, 16]);
        for vertex in 0..64 * 64 {
            let corner = (vertex / 64) / 4 * 4 * 64 + (vertex % 64) / 4 * 4;
            assert_eq!(levels[0].label[vertex], levels[0].label[corner]);
        }
        // Blocks of 4 x 4 are 4 edges apart, along rows and columns; the distance is that of their centers.
        let least = levels[0].links.iter().map(|link| link.rest).fold(f32::INFINITY, f32::min);
        assert!((least * 63.0 - 4.0).abs() < 1e-4);
        for (columns, rows) in [(129, 129), (100, 37), (400, 2), (7, 7), (2, 2)] {
            check(&Mesh::grid(columns, rows, 1.0, 1.0), Options { pinned: vec![0, columns - 1], ..Options::default() });
        }
    }

    #[test]
    fn pins_are_apart() {
        let mesh = Mesh::grid(32, 32, 1.0, 1.0);
        // A line of pins parts what is on its two sides.
        check(&mesh, Options { pinned: (0..32).map(|row| 32 * row + 13).collect(), ..Options::default() });
        check(&mesh, Options { pinned: vec![32 * 14 + 13], ..Options::default() });
        let levels = check(&mesh, Options { pinned: (0..32 * 32).collect(), ..Options::default() });
        assert!(levels.iter().all(|level| level.links.is_empty()), "nothing is free");
        let mass = Some((0..32 * 32).map(|v| 1e-4 * (1.0 + (v % 7) as f32 * 100.0)).collect());
        check(&mesh, Options { mass, ..Options::default() });
    }

    #[test]
    fn pieces_are_apart() {
        let grid = Mesh::grid(16, 16, 1.0, 1.0);
        // Two sheets closer to each other than their vertices are.
        let levels = check(&both(grid.clone(), &grid, Vec3::Y * 1e-3), Options::default());
        let of = |vertex: usize| levels[0].label[vertex];
        assert!((0..256).all(|vertex| of(vertex) != of(256 + vertex)));
        let lone = Mesh { positions: vec![Vec3::ZERO; 50], triangles: Vec::new() };
        check(&both(grid.clone(), &lone, Vec3::ONE), Options::default());
        assert!(check(&lone, Options::default()).is_empty());
        // Three sheets along one edge.
        let upright = Mesh { positions: grid.positions.iter().map(|x| Vec3::new(x.x, x.z + 0.5, 0.0)).collect(), ..grid.clone() };
        let mut fin = both(grid, &upright, Vec3::ZERO);
        fin.triangles.push([7 * 16, 7 * 16 + 1, 256]);
        check(&fin, Options::default());
    }

    /// A strip cut along its middle but for its end: no coarse edge spans the cut, except near where it ends.
    #[test]
    fn a_slit_is_not_bridged() {
        let mut mesh = Mesh::grid(64, 32, 2.0, 1.0);
        let across = |[a, b, c]: &[u32; 3]| {
            let rows = [a, b, c].map(|vertex| vertex / 64);
            rows.contains(&15) && rows.contains(&16) && [a, b, c].iter().all(|vertex| *vertex % 64 < 48)
        };
        mesh.triangles.retain(|corners| !across(corners));
        let levels = check(&mesh, Options::default());
        let cloth = Cloth::new(&mesh, &Options::default()).unwrap();
        let mut rows = vec![BTreeSet::new(); levels[0].inverse_mass.len()];
        for (x, &aggregate) in cloth.rest.iter().zip(&levels[0].label) {
            if x.x < 0.25 {
                rows[aggregate as usize].insert(x.z < 0.0);
            }
        }
        for link in &levels[0].links {
            let [a, b] = link.ends.map(|end| &rows[end as usize]);
            assert!(a.is_empty() || b.is_empty() || a == b, "{link:?}");
        }
    }

    /// On a tube, centers are inside of it, and the cloth between two of them is longer than their distance.
    #[test]
    fn a_tube_is_not_held_round() {
        let (around, along, radius) = (64_u32, 32_u32, 1.0 / std::f32::consts::TAU);
        let at = |i: u32| {
            let turn = (i % around) as f32 / around as f32 * std::f32::consts::TAU;
            Vec3::new(radius * turn.cos(), (i / around) as f32 / around as f32, radius * turn.sin())
        };
        let positions: Vec<Vec3> = (0..around * along).map(at).collect();
        let quads = (0..around * (along - 1)).flat_map(|i| {
            let next = i / around * around + (i + 1) % around;
            [[i, next, i + around], [next, next + around, i + around]]
        });
        let mesh = Mesh { positions, triangles: quads.collect() };
        let levels = check(&mesh, Options::default());
        let cloth = Cloth::new(&mesh, &Options::default()).unwrap();
        let center = |a: u32| {
            let of = (0..cloth.rest.len()).filter(|&v| levels[0].label[v] == a);
            let (sum, mass) = of.fold((DVec3::ZERO, 0.0), |(sum, mass), v| {
                let m = f64::from(cloth.mass[v]);
                (sum + cloth.rest[v].truncate().as_dvec3() * m, mass + m)
            });
            sum / mass
        };
        for link in &levels[0].links {
            let [a, b] = link.ends.map(center);
            // Flattened: the arc between them, at the tube's own radius, and the way along it.
            let angle = (a.with_y(0.0)).angle_between(b.with_y(0.0));
            let flat = (angle * f64::from(radius)).hypot(a.y - b.y);
            assert!(f64::from(link.rest) > 0.98 * flat, "{link:?}: flat, they are {flat} apart");
            assert!(f64::from(link.rest) < 1.1 * flat, "{link:?}: flat, they are {flat} apart");
        }
    }
}
