//! The edges between aggregates: which aggregates are joined, and the rest length and stiffness of each edge. The
//! reasons are in [`hierarchy`](super::hierarchy).

use std::ops::Range;

use glam::{DMat3, DVec3, Vec3};

use crate::model::cloth::Cloth;
use crate::model::coloring;
use crate::model::csr::{Csr, distinct};
use crate::model::link::{Link, Visits};
use crate::multigrid::aggregation::{Aggregate, CROWDED, holding, neighbors};
use crate::multigrid::unfolding::Unfolded;

/// If the stiffness along an edge is less than this share of the aggregate's stiffness in all directions, the edge is
/// omitted.
const SLACK: f64 = 1e-3;
/// Aggregates are in pleats if they are so many times as far apart in unfolded cloth as where it is smooth.
const PLEATED: f64 = 1.1;

/// The items that aggregates consist of, as point masses: vertices, or aggregates two levels finer. They determine the
/// rest lengths of edges to pinned aggregates.
pub(crate) struct PointMasses {
    items: Vec<Aggregate>,
    of: Csr<u32>,
}

impl PointMasses {
    pub(crate) fn new(items: Vec<Aggregate>, label: Vec<u32>, count: usize) -> PointMasses {
        let of = Csr::new(count, label.iter().enumerate().map(|(item, &aggregate)| (aggregate, item as u32)));
        PointMasses { items, of }
    }

    /// Mean distance (m) that mass moves in a transport plan from one aggregate onto the other. The plan is greedy,
    /// nearest pairs first.
    fn transport(&self, aggregates: [u32; 2], masses: [f64; 2]) -> f64 {
        let [mut from, mut to] = [0, 1].map(|side| {
            let of = self.of.of(aggregates[side]).iter();
            of.map(|&item| (self.items[item as usize].center, self.items[item as usize].mass / masses[side])).collect::<Vec<_>>()
        });
        let mut pairs: Vec<(f64, usize, usize)> = Vec::with_capacity(from.len() * to.len());
        for (i, a) in from.iter().enumerate() {
            pairs.extend(to.iter().enumerate().map(|(j, b)| (a.0.distance(b.0), i, j)));
        }
        pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut mean = 0.0;
        for (distance, i, j) in pairs {
            let moved = from[i].1.min(to[j].1);
            from[i].1 -= moved;
            to[j].1 -= moved;
            mean += distance * moved;
        }
        mean
    }
}

/// Membrane stiffness of aggregates along any direction, from all of their inner edges and half of the edges that leave
/// them.
pub(crate) struct Stiffness {
    /// Two orthogonal directions in the plane of each aggregate.
    frames: Vec<[DVec3; 2]>,
    /// Sum of `K l0² q q^T` for K = 1 N/m (m²), where `q = (a², b², sqrt(2) a b)` for an edge with direction `(a, b)`
    /// in that plane.
    tensors: Vec<DMat3>,
    /// The same if all edges were firm; empty if they are.
    firm_tensors: Vec<DMat3>,
}

/// A fine edge as it contributes to the stiffness of the aggregates at its ends; the same for all levels.
pub(crate) struct Fiber {
    ends: [u32; 2],
    direction: DVec3,
    /// Half of `K l0²` for K = 1 N/m (m²).
    weight: f64,
    /// The same if all edges were firm.
    firm_weight: f64,
}

impl Fiber {
    /// The fibers of all edges with stiffness.
    pub(crate) fn all(cloth: &Cloth) -> Vec<Fiber> {
        let fiber = |link: &Link| {
            let [a, b] = link.ends.map(|vertex| cloth.rest[vertex as usize].truncate().as_dvec3());
            let weight = 0.5 * link.shape * f64::from(link.rest).powi(2);
            let firm_weight = weight / cloth.softness(link);
            Fiber { ends: link.ends, direction: (b - a).normalize_or_zero(), weight, firm_weight }
        };
        holding(cloth).map(fiber).collect()
    }
}

impl Stiffness {
    pub(crate) fn new(fibers: &[Fiber], aggregates: &[Aggregate], aggregate_of: &[u32]) -> Stiffness {
        let of = |fiber: &Fiber| fiber.ends.map(|vertex| aggregate_of[vertex as usize] as usize);
        // Threads and tubes have no normal; any plane through a thread serves as its plane.
        let mut along = vec![DVec3::ZERO; aggregates.len()];
        for fiber in fibers {
            let d = fiber.direction;
            for aggregate in of(fiber) {
                let sum = &mut along[aggregate];
                *sum += if d.dot(*sum) < 0.0 { -d } else { d };
            }
        }
        let frame = |(aggregate, along): (&Aggregate, &DVec3)| {
            let side = aggregate.normal().cross(*along);
            let side =
                if side.length_squared() > 0.0 { side.normalize() } else { along.any_orthogonal_vector().normalize_or_zero() };
            let normal = aggregate.normal().normalize_or_zero();
            let e = (*along - normal * normal.dot(*along)).normalize_or_zero();
            [e, side]
        };
        let frames: Vec<[DVec3; 2]> = aggregates.iter().zip(&along).map(frame).collect();
        let sum = |weight: fn(&Fiber) -> f64| {
            let mut tensors = vec![DMat3::ZERO; aggregates.len()];
            for fiber in fibers {
                for aggregate in of(fiber) {
                    let q = mandel(fiber.direction, frames[aggregate]);
                    tensors[aggregate] += DMat3::from_cols(q * q.x, q * q.y, q * q.z) * weight(fiber);
                }
            }
            tensors
        };
        let tensors = sum(|fiber| fiber.weight);
        let are_firm = fibers.iter().all(|fiber| fiber.weight == fiber.firm_weight);
        let firm_tensors = if are_firm { Vec::new() } else { sum(|fiber| fiber.firm_weight) };
        Stiffness { frames, tensors, firm_tensors }
    }

    /// Stiffness times area (m²) along `n` for K = 1 N/m, with the cloth free to contract across it; and its share of
    /// the stiffness of all directions together.
    fn along(&self, aggregate: u32, n: DVec3) -> (f64, f64) {
        along(self.tensors[aggregate as usize], mandel(n, self.frames[aggregate as usize]))
    }

    /// That stiffness as a share of what it would be if all edges were firm, at most 1.
    fn firmness(&self, aggregate: u32, n: DVec3) -> f64 {
        let Some(&firm) = self.firm_tensors.get(aggregate as usize) else { return 1.0 };
        let q = mandel(n, self.frames[aggregate as usize]);
        let [soft, firm] = [self.tensors[aggregate as usize], firm].map(|tensor| along(tensor, q).0);
        if firm > 0.0 { (soft / firm).min(1.0) } else { 1.0 }
    }
}

/// See [`Stiffness::along`].
fn along(tensor: DMat3, q: DVec3) -> (f64, f64) {
    let trace = tensor.x_axis.x + tensor.y_axis.y + tensor.z_axis.z;
    if trace == 0.0 {
        return (0.0, 0.0);
    }
    let q = q.normalize_or_zero();
    if q == DVec3::ZERO {
        return (0.0, 0.0);
    }
    let compliance = q.dot((tensor + DMat3::IDENTITY * (1e-6 * trace)).inverse() * q);
    (1.0 / compliance, 1.0 / (compliance * trace))
}

/// `(a², b², sqrt(2) a b)` of a direction in a plane: its scalar product with the strain tensor (in Mandel notation) is
/// the strain along it.
fn mandel(n: DVec3, [e, f]: [DVec3; 2]) -> DVec3 {
    let (a, b) = (n.dot(e), n.dot(f));
    DVec3::new(a * a, b * b, std::f64::consts::SQRT_2 * a * b)
}

/// Everything needed to make the coarse edges of a level.
pub(crate) struct Edges<'a> {
    pub aggregates: &'a [Aggregate],
    pub masses: &'a PointMasses,
    /// Factor on the transport distance at pins.
    pub pin_share: f64,
    pub stiffness: Stiffness,
}

impl Edges<'_> {
    /// The edges between given pairs of aggregates, with colors that are separate for each group of pairs, in color
    /// order.
    pub(crate) fn color(&self, groups: &[Vec<([u32; 2], Unfolded)>]) -> (Vec<Link>, Vec<Range<usize>>) {
        let centers: Vec<Vec3> = self.aggregates.iter().map(|aggregate| aggregate.center.as_vec3()).collect();
        let (mut links, mut colors) = (Vec::new(), Vec::new());
        let is_pleated = self.is_pleated(groups.iter().flatten());
        for pairs in groups {
            let made = pairs.iter().filter_map(|&(pair, unfolded)| self.between(pair, self.length(pair, unfolded, is_pleated)?));
            let made: Vec<Link> = made.collect();
            let ends: Vec<[u32; 2]> = made.iter().map(|link| link.ends).collect();
            let batches = coloring::color(&ends, &centers).batches();
            let first = links.len();
            links.extend(batches.items.iter().map(|&place| made[place as usize]));
            colors.extend(batches.spans.iter().map(|span| first + span.start as usize..first + span.end as usize));
        }
        (links, colors)
    }

    /// Whether so many aggregates are farther apart in unfolded cloth than where it is smooth that others, which cannot be unfolded, may
    /// be, too.
    fn is_pleated<'a>(&self, pairs: impl Iterator<Item = &'a ([u32; 2], Unfolded)>) -> bool {
        let (mut known, mut longer) = (0, 0);
        for &(pair, unfolded) in pairs {
            if let Unfolded::At(distance) = unfolded {
                known += 1;
                longer += usize::from(distance > PLEATED * self.smooth_length(pair));
            }
        }
        longer * 10 > known
    }

    /// The largest distance (m) of two aggregates, if it is known.
    fn length(&self, pair: [u32; 2], unfolded: Unfolded, is_pleated: bool) -> Option<f64> {
        let length = self.smooth_length(pair);
        match unfolded {
            Unfolded::At(distance) if is_pleated || distance > PLEATED * length => Some(distance.max(length)),
            Unfolded::Torn if is_pleated => None,
            _ => Some(length),
        }
    }

    /// The largest distance (m) of two aggregates of smooth cloth.
    fn smooth_length(&self, pair: [u32; 2]) -> f64 {
        let [a, b] = pair.map(|aggregate| &self.aggregates[aggregate as usize]);
        let turn = 0.5 * a.normal().angle_between(b.normal());
        let bent = if turn > 1e-3 { (turn / turn.sin()).powi(2) } else { 1.0 };
        // The center of a curved aggregate comes to either side of its surface when it bends the other way.
        let length = (a.center.distance(b.center) * bent).hypot(a.sagitta() + b.sagitta());
        if a.pinned || b.pinned {
            return length.max(self.pin_share * self.masses.transport(pair, [a.mass, b.mass]));
        }
        length
    }

    /// The edge of this rest length (m) between two aggregates; none if the cloth does not connect them along it.
    fn between(&self, pair: [u32; 2], rest: f64) -> Option<Link> {
        let [a, b] = pair.map(|aggregate| &self.aggregates[aggregate as usize]);
        let n = (b.center - a.center).normalize_or_zero();
        let along = pair.map(|aggregate| self.stiffness.along(aggregate, n));
        // A pinned aggregate may consist of one vertex with hardly any edges, so the free aggregate alone determines
        // the stiffness.
        let (area, part) = match (a.pinned, b.pinned) {
            (true, _) => along[1],
            (_, true) => along[0],
            _ => (0.5 * (along[0].0 + along[1].0), along[0].1.min(along[1].1)),
        };
        // Also omits edges whose rest length is 0 or not finite.
        if !(rest.is_normal() && rest > 0.0 && part > SLACK) {
            return None;
        }
        let firmness = pair.map(|aggregate| self.stiffness.firmness(aggregate, n));
        Some(Link {
            visits: Visits::Once,
            ends: pair,
            rest: rest as f32,
            shape: area / (rest * rest),
            scale: firmness[0].min(firmness[1]).max(SLACK) as f32,
        })
    }
}

/// Pairs of aggregates that are not neighbors but have common neighbors on both sides of the line between them, so that
/// they are not separated by a slit.
pub(crate) fn two_rings(pairs: &[[u32; 2]], aggregates: &[Aggregate]) -> Vec<[u32; 2]> {
    let near = neighbors(aggregates.len(), pairs);
    let mut found = Vec::new();
    for a in 0..aggregates.len() as u32 {
        // The aggregates two rings away, with the sides of the line to them on which there is a common neighbor.
        let mut sides: Vec<[u32; 2]> = Vec::new();
        for &between in near.of(a).iter().filter(|&&between| near.of(between).len() <= CROWDED) {
            for &b in near.of(between) {
                // Neighbors are sorted because the pairs are.
                if b <= a || near.of(a).binary_search(&b).is_ok() {
                    continue;
                }
                let [x, y, z] = [a, between, b].map(|aggregate| aggregates[aggregate as usize].center);
                let side = (y - x).cross(z - x).dot(aggregates[a as usize].normal() + aggregates[b as usize].normal());
                sides.push([b, u32::from(side > 0.0)]);
            }
        }
        let held = |b: u32| !(aggregates[a as usize].pinned && aggregates[b as usize].pinned);
        let both = |sides: &[[u32; 2]]| (sides[0][0] == sides[1][0] && held(sides[0][0])).then_some([a, sides[0][0]]);
        found.extend(distinct(sides).windows(2).filter_map(both));
    }
    found
}
