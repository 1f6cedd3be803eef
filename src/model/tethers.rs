//! Tethers of a cloth: which pins have any, and how far each vertex is from the nearest of them along the cloth.
//!
//! # Theory
//! A pin's few edges carry all that hangs on it, and one sweep leaves an edge `T h² w / l` too long, where the force T falls as one over
//! the distance from the pin. Coarse levels have the same worst place. So a vertex near a pin is held to it directly, by the length of
//! the way between them in unstretched cloth: no vertex of whole cloth can be farther away (Kim, Chentanez & Müller 2012). Here the
//! share of the correction fades with the distance, so that nothing is held across a sheet and each vertex is
//! corrected by itself, in no order; and what the fabric itself gives way by is left to it.
//!
//! # Practice
//! Only a lone pin needs them, or two side by side: in a longer row the vertices near a pin have others to hang on. (With tethers the ends of
//! a row are better by a fifth, in the tenth worst frame of a sheet that swings down, and the others no worse; but the law of the strain that
//! few substeps leave in it is then no more `T h² w / l`, and a row that is led wildly leaves two edges tangled.)
//! Ways run over triangles that are unfolded, each from the two nearer corners to the third (fast marching: Kimmel & Sethian 1998,
//! with straight ways instead of a front), and along edges. Where an edge is soft ([`Options::edge_scale`](crate::Options::edge_scale))
//! cloth gives way along the bias: only whole edges are ways there.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashSet};

use glam::DVec3;

use crate::model::cloth::{Cloth, Link};
use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;

/// Tethers reach no farther than this share of the cloth's extent.
pub(crate) const REACH: f64 = 0.5;
/// Edges softer than this share of the fabric's stiffness are no way.
const WHOLE: f32 = 0.5;
/// A way that is shorter by less than this share is no other, and vertices are visited so often at most, on average.
const SHORTER: f64 = 1e-6;
const VISITS: usize = 16;

/// The tethers of a cloth with lone pins.
#[derive(Debug)]
pub(crate) struct Tethers {
    /// Lone pins, as places in [`Cloth::pinned`].
    pub anchors: Vec<u32>,
    /// By vertex.
    pub held: Vec<Held>,
}

/// A vertex that is near a lone pin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Held {
    pub vertex: u32,
    /// Which of [`Tethers::anchors`].
    pub anchor: u32,
    /// Along the cloth (m).
    pub distance: f32,
    /// How much longer the way is (m) where the fabric's stiffness is 1 N/m and acceleration 1 m/s².
    pub give: f32,
}

impl Tethers {
    /// `None` if there is no lone pin.
    pub(crate) fn new(cloth: &Cloth) -> Option<Tethers> {
        let anchors = lone_pins(cloth);
        if anchors.is_empty() {
            return None;
        }
        let mut ways = Ways::new(cloth);
        anchors.iter().zip(0..).for_each(|(&place, anchor)| ways.start(cloth.pinned[place as usize], anchor));
        ways.march();
        let give = Give::new(cloth, &anchors);
        let free = (0..cloth.rest.len()).filter(|&v| cloth.rest[v].w > 0.0 && ways.found[v].is_some());
        let held = free.map(|vertex| {
            let (distance, anchor) = ways.found[vertex].expect("filtered");
            // Rounding must not pull at cloth that is at rest.
            let (length, give) = (distance * (1.0 + 1e-6), give.of(anchor, distance));
            Held { vertex: vertex as u32, anchor, distance: length as f32, give: give as f32 }
        });
        Some(Tethers { held: held.collect(), anchors })
    }
}

/// Pins that hold anything and have no pinned neighbor, or one that has no other, as places in [`Cloth::pinned`].
fn lone_pins(cloth: &Cloth) -> Vec<u32> {
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

/// The shortest ways found so far.
struct Ways<'a> {
    rest: Vec<DVec3>,
    triangles: &'a [[u32; 3]],
    /// Whole edges at each vertex, by their other end; and triangles of whole edges alone.
    edges: Csr<u32>,
    around: Csr<u32>,
    /// Length (m) of the way from the nearest pin to each vertex, and which pin that is.
    found: Vec<Option<(f64, u32)>>,
    /// What is to be visited: the nearest first. Lengths are positive, and their bits ascend with them.
    next: BinaryHeap<Reverse<(u64, u32)>>,
    farthest: f64,
}

impl<'a> Ways<'a> {
    fn new(cloth: &'a Cloth) -> Ways<'a> {
        let vertices = cloth.rest.len();
        let is_whole = |link: &&Link| link.scale >= WHOLE;
        let whole = cloth.links.iter().filter(is_whole).flat_map(|link| [link.ends, [link.ends[1], link.ends[0]]]);
        let soft: HashSet<[u32; 2]> = cloth.links.iter().filter(|link| !is_whole(link)).map(|link| link.ends).collect();
        let is_soft = |a: u32, b: u32| soft.contains(&[a.min(b), a.max(b)]);
        let of_whole =
            |&(_, &[a, b, c]): &(usize, &[u32; 3])| soft.is_empty() || !(is_soft(a, b) || is_soft(b, c) || is_soft(c, a));
        let triangles = cloth.triangles.iter().enumerate().filter(of_whole);
        Ways {
            rest: cloth.rest.iter().map(|x| x.truncate().as_dvec3()).collect(),
            triangles: &cloth.triangles,
            edges: Csr::new(vertices, whole.map(|[a, b]| (a, b))),
            around: Csr::new(vertices, triangles.flat_map(|(index, corners)| corners.map(|vertex| (vertex, index as u32)))),
            found: vec![None; vertices],
            next: BinaryHeap::new(),
            farthest: REACH * cloth.extent,
        }
    }

    fn start(&mut self, pin: u32, anchor: u32) {
        self.found[pin as usize] = Some((0.0, anchor));
        self.next.push(Reverse((0, pin)));
    }

    /// Notes a way if it is the shortest so far.
    fn note(&mut self, vertex: u32, length: f64, anchor: u32) {
        let longer = self.found[vertex as usize].is_none_or(|(found, _)| length < found * (1.0 - SHORTER));
        if longer && length < self.farthest {
            self.found[vertex as usize] = Some((length, anchor));
            self.next.push(Reverse((length.to_bits(), vertex)));
        }
    }

    /// Follows all ways, those from vertices whose own became shorter again. However few visits are left, what was found is a way.
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

    /// The way across an edge, both of whose ends have one to the same pin, to the corner beyond: straight in the plane of the triangle, from
    /// where the pin is if the other side is unfolded.
    fn across(&mut self, [a, b]: [u32; 2], beyond: u32) {
        let (Some((to_a, anchor)), Some((to_b, other))) = (self.found[a as usize], self.found[b as usize]) else { return };
        let [from, x, y] = [a, b, beyond].map(|vertex| self.rest[vertex as usize]);
        let (edge, base) = (x - from, self.apart(a, b));
        if anchor != other || base <= 0.0 {
            return;
        }
        // Along the edge from a, and away from it.
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

/// What cloth gives way by about a pin at rest, twice: `W/(K phi) (1 + ln(1 + d/l))` in a wedge of angle phi that a weight W hangs on from
/// its tip, the first edge (l) being as long as it is, and the stress `rho g L` of the whole sheet on the way.
struct Give {
    /// Free mass (kg) over angle, for each anchor.
    mass: Vec<f64>,
    /// Mass over area times the extent (kg/m).
    sheet: f64,
    /// Mean length (m) of an edge.
    edge: f64,
    /// Whether it is a thread, which has no angle: `W d/(K l)`.
    is_thread: Vec<bool>,
}

impl Give {
    fn new(cloth: &Cloth, anchors: &[u32]) -> Give {
        let mut parts = DisjointSets::new(cloth.rest.len());
        cloth.links.iter().for_each(|link| parts.join(link.ends));
        let root: Vec<u32> = (0..cloth.rest.len() as u32).map(|vertex| parts.root(vertex)).collect();
        let (mut mass, mut pins) = (vec![0.0; root.len()], vec![0.0; root.len()]);
        for ((x, &root), &vertex_mass) in cloth.rest.iter().zip(&root).zip(&cloth.mass) {
            let part = if x.w > 0.0 { (&mut mass, f64::from(vertex_mass)) } else { (&mut pins, 1.0) };
            part.0[root as usize] += part.1;
        }
        let mut angle = vec![0.0; root.len()];
        for &[a, b, c] in &cloth.triangles {
            for [at, one, other] in [[a, b, c], [b, c, a], [c, a, b]] {
                let [x, y, z] = [at, one, other].map(|vertex| cloth.rest[vertex as usize].truncate().as_dvec3());
                angle[at as usize] += if (y - x).cross(z - x).length() > 0.0 { (y - x).angle_between(z - x) } else { 0.0 };
            }
        }
        let vertices = || anchors.iter().map(|&place| cloth.pinned[place as usize] as usize);
        let per_pin = |vertex: usize| mass[root[vertex] as usize] / pins[root[vertex] as usize];
        let total: f64 = cloth.links.iter().map(|link| f64::from(link.rest)).sum();
        Give {
            mass: vertices().map(|vertex| per_pin(vertex) / if angle[vertex] > 0.0 { angle[vertex] } else { 1.0 }).collect(),
            sheet: cloth.density * cloth.extent,
            edge: total / cloth.links.len() as f64,
            is_thread: vertices().map(|vertex| angle[vertex] == 0.0).collect(),
        }
    }

    /// What a way of some length gives way by (m) where stiffness (N/m) and acceleration (m/s²) are one.
    fn of(&self, anchor: u32, distance: f64) -> f64 {
        let Give { mass, sheet, edge, is_thread } = self;
        let spread = if is_thread[anchor as usize] { distance / edge } else { 1.0 + (1.0 + distance / edge).ln() };
        2.0 * (mass[anchor as usize] * spread + sheet * distance)
    }
}

#[cfg(test)]
#[path = "../../tests/unit/model_tethers.rs"]
mod tests;
