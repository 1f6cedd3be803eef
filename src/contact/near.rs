//! Near pairs: those of the lists that may come nearer than their thickness in this substep, with the numbers of their contact; and the
//! vertices that they are made of, by themselves.

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use super::detection::{Kind, Listed, Rows, between, closest, square};
use super::lanes::{corners_of, scattered};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{RELAXATION, impulse};
use crate::simd::{self, Loop, MAX_LANES, Registers, Vector, Width};

/// Pairs that a task looks at.
const GRAIN: usize = 512;
/// A pair that comes as near as this (m per m of thickness) beyond its thickness acts; others are only kept from crossing.
const ACTING: f32 = 0.3;
/// Multipliers of the last substep that this one begins with.
const WARM: f32 = 0.9;

/// A pair in this substep.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    pub corners: [u32; 4],
    pub weights: [f32; 4],
    /// From the second side to the first.
    pub normal: Vec3A,
    /// Half way between the closest points (m).
    pub middle: Vec3A,
    /// How far apart they are at the start (m), and how near they may come.
    pub distance: f32,
    pub thickness: f32,
    /// See [`step_of_lambda`](crate::kernels::pair::step_of_lambda); 0 where the pair does not act.
    pub rate: f32,
    /// Corners of the first side.
    pub first_side: u32,
    /// Where it is listed.
    pub kind: Kind,
    pub listed: u32,
    pub acts: bool,
    /// How far (m) along the normal vertices that are led move its middle plane.
    pub led: f32,
}

/// What holds a pair apart: its multipliers (kg m), xyz along the friction, w along the normal, and the impulse (kg m) that the last step of
/// them gives.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Hold {
    pub lambda: Vec4,
    pub impulse: Vec3A,
}

/// A vertex of near pairs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    pub index: u32,
    /// Position (m), w the inverse mass (1/kg).
    pub x: Vec4,
    /// Displacement (m) in this substep, and what moves it besides without giving it a velocity.
    pub u: Vec3A,
    pub push: Vec3A,
    /// Sum of its weights in the pairs that act.
    pub weight: f32,
    /// How far (m) it was on its way to go with the cloth as a whole left out, and half its least thickness.
    pub travel: f32,
    pub reach: f32,
    /// How much of its displacement it may take.
    pub share: f32,
}

/// What a substep's contact is of. Lists are kept from substep to substep.
#[derive(Debug, Default)]
pub(super) struct Contacts {
    pub pairs: Vec<Near>,
    /// What holds each apart.
    pub holds: Vec<Hold>,
    pub vertices: Vec<Vertex>,
    /// The corners at each vertex: four times the pair, and which of its corners.
    pub corners: Vec<u32>,
    pub corner_starts: Vec<u32>,
    /// Place of each of the cloth's vertices among those of near pairs, plus one.
    place: Vec<u32>,
    found: Vec<Vec<Near>>,
}

/// The state at the start of contact.
#[derive(Clone, Copy)]
pub(super) struct Start<'a> {
    pub x: &'a [Vec4],
    pub u: &'a [Vec4],
    /// What colliders moved vertices besides (m); empty if there are none.
    pub push: &'a [Vec4],
    /// The most of it.
    pub most_push: f32,
    pub mean: Vec3A,
    pub reach: &'a [f32],
    pub is_shared: bool,
    pub width: Width,
}

impl Contacts {
    /// Finds the near pairs of the lists, in their order, and gives them what held them apart in the last substep, times `scale`.
    pub(super) fn gather(&mut self, lists: &mut [Rows; 2], start: Start<'_>, scale: f32) {
        self.find(lists, start);
        self.index(start);
        self.prepare();
        self.holds.clear();
        self.holds.extend(self.pairs.iter().map(|pair| {
            let held = lists[pair.kind as usize].lambda[pair.listed as usize];
            let held = if pair.acts { held * (WARM * scale) } else { Vec4::ZERO };
            let rub = xyz(held);
            let lambda = Vec4::from((rub - pair.normal * pair.normal.dot(rub), held.w));
            Hold { lambda, impulse: impulse(lambda, pair.normal) }
        }));
        // What is not near holds nothing.
        lists.iter_mut().for_each(|rows| rows.lambda.fill(Vec4::ZERO));
    }

    fn find(&mut self, lists: &[Rows; 2], start: Start<'_>) {
        self.pairs.clear();
        for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
            let rows = &lists[kind as usize];
            let tasks = rows.pairs.len().div_ceil(GRAIN);
            if self.found.len() < tasks {
                self.found.resize_with(tasks, Vec::new);
            }
            let look = |(task, (found, pairs)): (usize, (&mut Vec<Near>, &[Listed]))| {
                found.clear();
                simd::run(start.width, Find { kind, first: task * GRAIN, pairs, start: &start, found });
            };
            let found = &mut self.found[..tasks];
            if start.is_shared && tasks > 1 {
                found.par_iter_mut().zip(rows.pairs.par_chunks(GRAIN)).enumerate().for_each(look);
            } else {
                found.iter_mut().zip(rows.pairs.chunks(GRAIN)).enumerate().for_each(look);
            }
            found.iter().for_each(|found| self.pairs.extend_from_slice(found));
        }
    }

    /// Numbers the vertices of near pairs, lists the corners at each, and gives them the state.
    fn index(&mut self, start: Start<'_>) {
        self.place.clear();
        self.place.resize(start.x.len(), 0);
        self.pairs.iter().flat_map(|pair| pair.corners).for_each(|vertex| self.place[vertex as usize] += 1);
        self.vertices.clear();
        self.corner_starts.clear();
        self.corner_starts.push(0);
        let mut total = 0;
        for (index, place) in self.place.iter_mut().enumerate().filter(|(_, place)| **place > 0) {
            let (x, u) = (start.x[index], xyz(start.u[index]));
            let push = start.push.get(index).map_or(Vec3A::ZERO, |&push| xyz(push));
            let travel = (u + push - start.mean).length();
            self.vertices.push(Vertex {
                index: index as u32,
                x,
                u,
                push,
                weight: 0.0,
                travel,
                reach: start.reach[index],
                share: 1.0,
            });
            self.corner_starts.push(total);
            total += *place;
            *place = self.vertices.len() as u32;
        }
        self.corners.clear();
        self.corners.resize(total as usize, 0);
        for (index, pair) in self.pairs.iter_mut().enumerate() {
            for (corner, vertex) in pair.corners.iter_mut().enumerate() {
                *vertex = self.place[*vertex as usize] - 1;
                let end = &mut self.corner_starts[*vertex as usize + 1];
                self.corners[*end as usize] = (4 * index + corner) as u32;
                *end += 1;
            }
        }
    }

    /// Says how fast pairs act, if any of their vertices moves.
    fn prepare(&mut self) {
        let Contacts { pairs, vertices, corners, corner_starts, .. } = self;
        for (vertex, range) in vertices.iter_mut().zip(corner_starts.windows(2)) {
            let corners = &corners[range[0] as usize..range[1] as usize];
            let acting =
                corners.iter().map(|&corner| (&pairs[corner as usize / 4], corner as usize % 4)).filter(|(pair, _)| pair.acts);
            vertex.weight = acting.map(|(pair, corner)| pair.weights[corner].abs()).sum();
        }
        for pair in pairs.iter_mut().filter(|pair| pair.acts) {
            let of = |corner: usize| {
                let vertex = &vertices[pair.corners[corner] as usize];
                vertex.x.w * pair.weights[corner].abs() * vertex.weight
            };
            let bound: f32 = (0..4).map(of).sum();
            pair.acts = bound > 0.0;
            pair.rate = if pair.acts { RELAXATION / bound } else { 0.0 };
        }
    }

    /// Remembers what holds pairs apart.
    pub(super) fn keep(&self, lists: &mut [Rows; 2]) {
        for (pair, hold) in self.pairs.iter().zip(&self.holds) {
            lists[pair.kind as usize].lambda[pair.listed as usize] = hold.lambda;
        }
    }
}

/// Finds near pairs among some that are listed.
struct Find<'a> {
    kind: Kind,
    first: usize,
    pairs: &'a [Listed],
    start: &'a Start<'a>,
    found: &'a mut Vec<Near>,
}

impl Loop for Find<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Find { kind, first, pairs, start, found } = self;
        let mean = Vector::<L>::splat(start.mean.to_array());
        for (group, listed) in pairs.chunks(L::LANES).enumerate() {
            let mut places = [listed[0].corners; MAX_LANES];
            places.iter_mut().zip(listed).for_each(|(place, pair)| *place = pair.corners);
            let (x, u) = (corners_of::<L>(start.x, &places), corners_of::<L>(start.u, &places));
            let travel = [square(u[0] - mean), square(u[1] - mean), square(u[2] - mean), square(u[3] - mean)];
            let weights = closest(kind, x);
            let apart = between(weights, x);
            let (one, other) = match kind {
                Kind::VertexTriangle => (travel[0], travel[1].max(travel[2]).max(travel[3])),
                Kind::EdgeEdge => (travel[0].max(travel[1]), travel[2].max(travel[3])),
            };
            let left = apart.dot(apart).sqrt() - one.sqrt() - other.sqrt();
            let free = match kind {
                Kind::VertexTriangle => weights[2],
                Kind::EdgeEdge => weights[1],
            };
            let (mut aparts, mut numbers) = ([Vec4::ZERO; MAX_LANES], [Vec4::ZERO; MAX_LANES]);
            scattered(apart, &mut aparts);
            scattered(Vector::new(free, weights[3], left), &mut numbers);
            for (lane, pair) in listed.iter().enumerate() {
                if numbers[lane].z - 2.0 * start.most_push < pair.thickness {
                    let index = first + group * L::LANES + lane;
                    found.extend(near(kind, index, pair, xyz(aparts[lane]), numbers[lane].x, numbers[lane].y, start));
                }
            }
        }
    }
}

/// A near pair; none if it has no direction: then it is where it cannot be held.
#[inline]
fn near(kind: Kind, index: usize, pair: &Listed, apart: Vec3A, free: f32, last: f32, start: &Start<'_>) -> Option<Near> {
    let (weights, first_side) = match kind {
        Kind::VertexTriangle => ([1.0, -1.0 - free - last, free, last], 1),
        Kind::EdgeEdge => ([1.0 - free, free, -1.0 - last, last], 2),
    };
    let distance = apart.length();
    if distance < 1e-12 {
        return None;
    }
    let normal = apart / distance;
    let sum = |of: &dyn Fn(usize) -> Vec3A| (0..4).map(|k| of(pair.corners[k] as usize) * weights[k]).sum::<Vec3A>();
    let relative = sum(&|vertex| xyz(start.u[vertex]));
    let first = (0..first_side as usize).map(|k| xyz(start.x[pair.corners[k] as usize]) * weights[k]).sum::<Vec3A>();
    // Where edges meet at an end, a vertex meets a triangle there, which acts.
    let is_inner = |weight: f32| weight > 0.0 && weight < 1.0;
    let meets = kind == Kind::VertexTriangle || is_inner(free) && is_inner(-last);
    let acts = meets && distance - pair.thickness + normal.dot(relative) < ACTING * pair.thickness;
    Some(Near {
        corners: pair.corners,
        weights,
        normal,
        middle: first - apart * 0.5,
        distance,
        thickness: pair.thickness,
        rate: 0.0,
        first_side,
        kind,
        listed: index as u32,
        acts,
        led: 0.0,
    })
}
