//! Tethers: which pins have any, and the distance of each vertex from the nearest of them along the cloth.
//!
//! # Theory
//! A pin's few edges carry the load of all that hangs on it. One sweep leaves an edge too long by `T h² w / l`, where
//! the force T decreases as the inverse of the distance from the pin; coarse levels have their largest strain there
//! too. So a vertex near a pin is held to it directly, within the length of the shortest path between them in
//! unstretched cloth, which their distance cannot exceed (long range attachments: Kim, Chentanez and Müller 2012).
//! Unlike there, the share of the correction fades with the distance. So nothing is held across a whole sheet, each
//! vertex can be corrected independently in any order, and the fabric's own stretch is allowed for.
//!
//! # Practice
//! Only lone pins, or two side by side, have tethers. In a longer row of pins, a pin's load is shared by its neighbors.
//! (With tethers the ends of a row would be better by a fifth, in the tenth worst frame of a sheet that swings down,
//! and the rest no worse. But the strain left by few substeps would no longer follow the law `T h² w / l`, and a row
//! that is moved violently would leave two edges tangled.) Paths run across unfolded triangles, from two corners to the
//! third (fast marching: Kimmel and Sethian 1998, with straight paths instead of a front), and along edges. Where an
//! edge is soft ([`Options::edge_scale`](crate::Options::edge_scale)), cloth stretches along the bias, so paths there
//! follow only firm edges.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DVec3, Vec4};

use crate::model::csr::{Csr, distinct};
use crate::model::disjoint_sets::DisjointSets;
use crate::model::link::{Link, least_firm};

/// Maximum length of tethers as a share of the cloth's extent.
pub(crate) const REACH: f64 = 0.5;
/// A path replaces another only if it is shorter by at least this share.
const SHORTER: f64 = 1e-6;
/// Bound on the mean number of visits per vertex.
const VISITS: usize = 16;

/// What tethers depend on: the fields of the same names of [`Cloth`](crate::model::cloth::Cloth).
#[derive(Debug, Clone, Copy)]
pub(super) struct Hung<'a> {
    pub rest: &'a [Vec4],
    pub links: &'a [Link],
    pub triangles: &'a [[u32; 3]],
    pub pinned: &'a [u32],
    pub mass: &'a [f32],
    pub extent: f64,
    /// The longest of the [`sides`](crate::model::cloth::Cloth::sides).
    pub size: f64,
    pub density: f64,
}

/// The tethers of a cloth with lone pins.
pub(crate) struct Tethers {
    /// Lone pins, as indices into [`Hung::pinned`].
    pub anchors: Vec<u32>,
    /// The vertices near lone pins, ascending.
    pub held: Vec<Held>,
}

/// A vertex that is near a lone pin.
pub(crate) struct Held {
    pub vertex: u32,
    /// Index into [`Tethers::anchors`].
    pub anchor: u32,
    /// Distance along the cloth (m).
    pub distance: f32,
    /// How much the path lengthens (m) under load, for a stiffness of 1 N/m and an acceleration of 1 m/s².
    pub give: f32,
}

impl Tethers {
    /// The tethers of a cloth; `None` if it has no lone pin.
    pub(super) fn new(cloth: Hung<'_>) -> Option<Tethers> {
        let anchors = lone_pins(cloth);
        if anchors.is_empty() {
            return None;
        }
        let mut paths = ShortestPaths::new(cloth);
        anchors.iter().zip(0..).for_each(|(&place, anchor)| paths.start(cloth.pinned[place as usize], anchor));
        paths.march();
        let give = OwnStretch::new(cloth, &anchors);
        let free = (0..cloth.rest.len()).filter(|&v| cloth.rest[v].w > 0.0 && paths.found[v].is_some());
        let held = free.map(|vertex| {
            let (distance, anchor) = paths.found[vertex].expect("filtered");
            // Rounding errors must not make a tether pull on cloth at rest.
            let (length, give) = (distance * (1.0 + 1e-6), give.of(anchor, distance));
            Held { vertex: vertex as u32, anchor, distance: length as f32, give: give as f32 }
        });
        Some(Tethers { held: held.collect(), anchors })
    }
}

/// Pins with free neighbors that have no pinned neighbor, or one that has no other pinned neighbor, as indices into
/// [`Hung::pinned`].
fn lone_pins(cloth: Hung<'_>) -> Vec<u32> {
    let is_pinned = |vertex: u32| cloth.rest[vertex as usize].w == 0.0;
    let both_ways = || cloth.links.iter().map(|link| link.ends).flat_map(|[a, b]| [(a, b), (b, a)]);
    let (mut free, mut pinned) = (vec![0_u32; cloth.rest.len()], vec![0_u32; cloth.rest.len()]);
    both_ways().for_each(|(a, b)| if is_pinned(b) { pinned[a as usize] += 1 } else { free[a as usize] += 1 });
    let mut in_row = pinned.iter().map(|&neighbors| neighbors > 1).collect::<Vec<bool>>();
    both_ways().filter(|&(_, b)| is_pinned(b) && pinned[b as usize] > 1).for_each(|(a, _)| in_row[a as usize] = true);
    let is_lone = |&place: &u32| {
        let pin = cloth.pinned[place as usize] as usize;
        free[pin] > 0 && !in_row[pin]
    };
    (0..cloth.pinned.len() as u32).filter(is_lone).collect()
}

/// A search for the shortest paths from the pins.
struct ShortestPaths<'a> {
    rest: Vec<DVec3>,
    triangles: &'a [[u32; 3]],
    /// For each vertex, the other ends of its firm edges.
    edges: Csr<u32>,
    /// For each vertex, its triangles all of whose edges are firm.
    around: Csr<u32>,
    /// Length (m) of the shortest path to each vertex so far, and the pin that it starts from.
    found: Vec<Option<(f64, u32)>>,
    /// Vertices to visit, nearest first. The key is the bits of the length, which order positive numbers like integers.
    next: BinaryHeap<Reverse<(u64, u32)>>,
    /// Longest path of interest (m).
    farthest: f64,
}

impl<'a> ShortestPaths<'a> {
    fn new(cloth: Hung<'a>) -> ShortestPaths<'a> {
        let (vertices, least) = (cloth.rest.len(), least_firm(cloth.links));
        let firm =
            cloth.links.iter().filter(|link| link.is_firm(least)).flat_map(|link| [link.ends, [link.ends[1], link.ends[0]]]);
        let soft = distinct(cloth.links.iter().filter(|link| !link.is_firm(least)).map(|link| link.ends).collect());
        let is_soft = |a: u32, b: u32| soft.binary_search(&[a.min(b), a.max(b)]).is_ok();
        let of_firm =
            |&(_, &[a, b, c]): &(usize, &[u32; 3])| soft.is_empty() || !(is_soft(a, b) || is_soft(b, c) || is_soft(c, a));
        let triangles = cloth.triangles.iter().enumerate().filter(of_firm);
        ShortestPaths {
            rest: cloth.rest.iter().map(|x| x.truncate().as_dvec3()).collect(),
            triangles: cloth.triangles,
            edges: Csr::new(vertices, firm.map(|[a, b]| (a, b))),
            around: Csr::new(vertices, triangles.flat_map(|(index, corners)| corners.map(|vertex| (vertex, index as u32)))),
            found: vec![None; vertices],
            next: BinaryHeap::new(),
            farthest: REACH * cloth.size,
        }
    }

    fn start(&mut self, pin: u32, anchor: u32) {
        self.found[pin as usize] = Some((0.0, anchor));
        self.next.push(Reverse((0, pin)));
    }

    /// Records a path if it is the shortest to its vertex so far.
    fn note(&mut self, vertex: u32, length: f64, anchor: u32) {
        let is_shorter = self.found[vertex as usize].is_none_or(|(found, _)| length < found * (1.0 - SHORTER));
        if is_shorter && length < self.farthest {
            self.found[vertex as usize] = Some((length, anchor));
            self.next.push(Reverse((length.to_bits(), vertex)));
        }
    }

    /// Extends paths until no vertex's path becomes shorter. If the bound on visits is reached, the paths found are
    /// valid but may not be the shortest.
    fn march(&mut self) {
        for _ in 0..VISITS * self.rest.len() {
            let Some(Reverse((bits, vertex))) = self.next.pop() else { break };
            let Some((length, anchor)) = self.found[vertex as usize] else { continue };
            if length.to_bits() < bits {
                continue;
            }
            for k in 0..self.edges.of(vertex).len() {
                let other = self.edges.of(vertex)[k];
                self.note(other, length + self.apart(vertex, other), anchor);
            }
            for k in 0..self.around.of(vertex).len() {
                let [a, b, c] = self.triangles[self.around.of(vertex)[k] as usize];
                let [second, third] = if vertex == a {
                    [b, c]
                } else if vertex == b {
                    [c, a]
                } else {
                    [a, b]
                };
                self.across([vertex, second], third);
                self.across([vertex, third], second);
            }
        }
    }

    fn apart(&self, a: u32, b: u32) -> f64 {
        self.rest[a as usize].distance(self.rest[b as usize])
    }

    /// The path across an edge to the opposite corner of a triangle, if both ends of the edge have paths to the same
    /// pin. It is straight in the triangle's plane, from the place that the pin has if the other side is unfolded into
    /// that plane.
    fn across(&mut self, [a, b]: [u32; 2], beyond: u32) {
        let (Some((to_a, anchor)), Some((to_b, other))) = (self.found[a as usize], self.found[b as usize]) else { return };
        let [from, x, y] = [a, b, beyond].map(|vertex| self.rest[vertex as usize]);
        let (edge, base) = (x - from, self.apart(a, b));
        if anchor != other || base <= 0.0 {
            return;
        }
        // Coordinates along the edge, from `a`, and perpendicular to it.
        let at = (y - from).dot(edge) / base;
        let height = ((y - from).length_squared() - at * at).max(0.0).sqrt();
        let pin = (to_a * to_a - to_b * to_b + base * base) / (2.0 * base);
        let depth = (to_a * to_a - pin * pin).max(0.0).sqrt();
        let crossing = pin + (at - pin) * depth / (depth + height);
        if depth + height > 0.0 && crossing > 0.0 && crossing < base {
            self.note(beyond, (at - pin).hypot(depth + height), anchor);
        }
    }
}

/// The stretch of the cloth itself between a pin and a vertex under load, times two. Around the pin the cloth is a
/// wedge of angle phi whose tip bears a weight W: it stretches by `W/(K phi) (1 + ln(1 + d/l))`, where the 1 stands for
/// the first edge, of length l. To this is added the stress `rho g L` of the whole sheet along the path.
struct OwnStretch {
    /// Free mass (kg) per pin over the angle, for each anchor.
    mass: Vec<f64>,
    /// Mean areal density times the extent (kg/m).
    sheet: f64,
    /// Mean length (m) of an edge.
    edge: f64,
    /// Whether the anchor holds a thread, which has no angle and stretches by `W d/(K l)`.
    is_thread: Vec<bool>,
}

impl OwnStretch {
    fn new(cloth: Hung<'_>, anchors: &[u32]) -> OwnStretch {
        let root = DisjointSets::parts_of_links(cloth.rest.len(), cloth.links);
        let (mut mass, mut pins) = (vec![0.0; root.len()], vec![0.0; root.len()]);
        for ((x, &root), &vertex_mass) in cloth.rest.iter().zip(&root).zip(cloth.mass) {
            let part = if x.w > 0.0 { (&mut mass, f64::from(vertex_mass)) } else { (&mut pins, 1.0) };
            part.0[root as usize] += part.1;
        }
        let mut angle = vec![0.0; root.len()];
        for &[a, b, c] in cloth.triangles {
            for [at, one, other] in [[a, b, c], [b, c, a], [c, a, b]] {
                let [x, y, z] = [at, one, other].map(|vertex| cloth.rest[vertex as usize].truncate().as_dvec3());
                angle[at as usize] += if (y - x).cross(z - x).length() > 0.0 { (y - x).angle_between(z - x) } else { 0.0 };
            }
        }
        let vertices = || anchors.iter().map(|&place| cloth.pinned[place as usize] as usize);
        let per_pin = |vertex: usize| mass[root[vertex] as usize] / pins[root[vertex] as usize];
        let total: f64 = cloth.links.iter().map(|link| f64::from(link.rest)).sum();
        OwnStretch {
            mass: vertices().map(|vertex| per_pin(vertex) / if angle[vertex] > 0.0 { angle[vertex] } else { 1.0 }).collect(),
            sheet: cloth.density * cloth.extent,
            edge: total / cloth.links.len() as f64,
            is_thread: vertices().map(|vertex| angle[vertex] == 0.0).collect(),
        }
    }

    /// The stretch (m) along a path of a given length, for a stiffness of 1 N/m and an acceleration of 1 m/s².
    fn of(&self, anchor: u32, distance: f64) -> f64 {
        let OwnStretch { mass, sheet, edge, is_thread } = self;
        let spread = if is_thread[anchor as usize] { distance / edge } else { 1.0 + (1.0 + distance / edge).ln() };
        2.0 * (mass[anchor as usize] * spread + sheet * distance)
    }
}

#[cfg(test)]
#[path = "../../tests/unit/model_tethers.rs"]
mod tests;
