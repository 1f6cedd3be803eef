//! The response: each pair that acts is held apart by a multiplier. All step at once (Jacobi) and are gathered vertex by vertex, in the order of
//! the pairs, so that nothing depends on who computes what.

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use super::detection::{Kind, Rows, between};
use super::lanes::{corners_of, scattered};
use super::near::{Contacts, Near, Start, Vertex};
use crate::kernels::contact::{DEPENETRATION, contact_body};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{RELAXATION, impulse, step_of_lambda};
use crate::kernels::params::Substep;
use crate::simd::{self, Loop, MAX_LANES, Registers, Vector, Width};
use crate::step::plan::Plan;

/// Steps of the multipliers in a substep.
const ITERATIONS: usize = 4;
/// Multipliers of the last substep that this one begins with.
const WARM: f32 = 0.9;
/// Vertices, and groups of pairs, that a task steps.
pub(super) const GRAIN: usize = 512;
const GROUPS: usize = 32;

/// The pairs that act. Those of a kind fill whole groups of [`MAX_LANES`]; what fills the last up holds nothing.
#[derive(Debug, Default)]
pub(super) struct Acting {
    /// Groups of each kind, one kind behind the other.
    groups: Vec<Group>,
    firsts: [usize; 2],
    /// What the last step of the multipliers gives, a pair each: an impulse (kg m).
    impulses: Vec<Vec4>,
    /// What each vertex has of them: pairs and its weights in them.
    corners: Vec<(u32, f32)>,
    starts: Vec<u32>,
    /// Of each vertex its inverse mass (1/kg) times the sum of its weights.
    mobility: Vec<f32>,
    /// How many press.
    pub pressing: u32,
}

/// As many pairs that act as there are lanes at most, by their numbers.
#[derive(Debug, Clone, Copy)]
struct Group {
    corners: [[u32; 4]; MAX_LANES],
    listed: [u32; MAX_LANES],
    count: u32,
    kind: Kind,
    normal: [[f32; MAX_LANES]; 3],
    free: [f32; MAX_LANES],
    last: [f32; MAX_LANES],
    friction: [f32; MAX_LANES],
    /// How far (m) they may approach, and how deep (m) they are at the start.
    gap: [f32; MAX_LANES],
    depth: [f32; MAX_LANES],
    /// See [`step_of_lambda`].
    rate: [f32; MAX_LANES],
    /// Multipliers (kg m): along the friction, and along the normal.
    rub: [[f32; MAX_LANES]; 3],
    press: [f32; MAX_LANES],
}

impl Group {
    const EMPTY: Group = {
        let zero = [0.0; MAX_LANES];
        Group {
            corners: [[0; 4]; MAX_LANES],
            listed: [0; MAX_LANES],
            count: 0,
            kind: Kind::VertexTriangle,
            normal: [zero; 3],
            free: zero,
            last: zero,
            friction: zero,
            gap: zero,
            depth: zero,
            rate: zero,
            rub: [zero; 3],
            press: zero,
        }
    };

    fn normal(&self, lane: usize) -> Vec3A {
        Vec3A::from_array(self.normal.map(|of| of[lane]))
    }

    fn weights(&self, lane: usize) -> [f32; 4] {
        self.kind.weights(self.free[lane], self.last[lane])
    }

    fn add(&mut self, pair: &Near, friction: f32) {
        let lane = self.count as usize;
        self.count += 1;
        (self.corners[lane], self.listed[lane]) = (pair.corners, pair.listed);
        (0..3).for_each(|axis| self.normal[axis][lane] = pair.normal[axis]);
        (self.free[lane], self.last[lane], self.friction[lane]) = (pair.free, pair.last, friction);
        self.gap[lane] = (pair.distance - pair.thickness).max(0.0);
        self.depth[lane] = (pair.thickness - pair.distance).max(0.0);
    }

    /// Gives a pair what held it apart in the last substep.
    fn warm(&mut self, lane: usize, held: Vec4) {
        let (normal, rub) = (self.normal(lane), xyz(held));
        let rub = rub - normal * normal.dot(rub);
        (0..3).for_each(|axis| self.rub[axis][lane] = rub[axis]);
        self.press[lane] = held.w;
    }
}

impl Acting {
    /// Takes the pairs that act, and says how fast they do, if any of their vertices moves.
    pub(super) fn gather(
        &mut self,
        pairs: &[Vec<Near>; 2],
        vertices: &mut [Vertex],
        lists: &[Rows; 2],
        start: Start<'_>,
        scale: f32,
    ) {
        let owner = |place: u32| start.surface.owner[vertices[place as usize].index as usize];
        let friction = |[a, _, _, b]: [u32; 4]| start.friction[owner(a).max(owner(b)) as usize];
        let Acting { groups, firsts, impulses, corners, starts, mobility, pressing } = self;
        groups.clear();
        for kind in Kind::ALL {
            firsts[kind as usize] = groups.len();
            for pair in pairs[kind as usize].iter().filter(|pair| pair.acts) {
                if groups.len() == firsts[kind as usize] || groups.last().is_some_and(|last| last.count as usize == MAX_LANES) {
                    groups.push(Group { kind, ..Group::EMPTY });
                }
                groups.last_mut().into_iter().for_each(|group| group.add(pair, friction(pair.corners)));
            }
        }
        impulses.clear();
        impulses.resize(MAX_LANES * groups.len(), Vec4::ZERO);
        *pressing = 0;
        // Corners of each vertex, in the order of the pairs.
        starts.clear();
        starts.resize(vertices.len() + 1, 0);
        for group in groups.iter() {
            let used = &group.corners[..group.count as usize];
            used.iter().flatten().for_each(|&vertex| starts[vertex as usize + 1] += 1);
        }
        let mut total = 0;
        for start in starts.iter_mut() {
            total += std::mem::replace(start, total);
        }
        corners.clear();
        corners.resize(total as usize, (0, 0.0));
        for (index, group) in groups.iter().enumerate() {
            for lane in 0..group.count as usize {
                for (vertex, weight) in group.corners[lane].into_iter().zip(group.weights(lane)) {
                    let place = &mut starts[vertex as usize + 1];
                    corners[*place as usize] = ((MAX_LANES * index + lane) as u32, weight);
                    vertices[vertex as usize].weight += weight.abs();
                    *place += 1;
                }
            }
        }
        mobility.clear();
        mobility.extend(vertices.iter().map(|vertex| vertex.x.w * vertex.weight));
        for group in groups {
            for lane in 0..group.count as usize {
                let (corners, weights) = (group.corners[lane], group.weights(lane));
                let of = |k: usize| mobility[corners[k] as usize] * weights[k].abs();
                let bound = (of(0) + of(1)) + (of(2) + of(3));
                if bound > 0.0 {
                    group.rate[lane] = RELAXATION / bound;
                    let held = lists[group.kind as usize].lambda[group.listed[lane] as usize];
                    group.warm(lane, held * (WARM * scale));
                }
            }
        }
    }

    /// What of the pairs of a vertex an impulse each gives it.
    fn sum(&self, vertex: usize) -> Vec3A {
        let range = self.starts[vertex] as usize..self.starts[vertex + 1] as usize;
        let of = |&(pair, weight): &(u32, f32)| self.impulses[pair as usize] * weight;
        xyz(self.corners[range].iter().map(of).sum::<Vec4>())
    }

    /// Remembers what holds pairs apart.
    pub(super) fn keep(&mut self, lists: &mut [Rows; 2]) {
        for group in &self.groups {
            for lane in 0..group.count as usize {
                let [x, y, z] = group.rub.map(|rub| rub[lane]);
                let lambda = Vec4::new(x, y, z, group.press[lane]);
                self.pressing += u32::from(lambda.w > 0.0);
                lists[group.kind as usize].lambda[group.listed[lane] as usize] = lambda;
            }
        }
    }
}

impl Contacts {
    /// Moves the vertices of near pairs so that pairs stay apart by their thickness, with friction, and out of the colliders.
    pub(super) fn respond(&mut self, plan: &Plan<'_>, substep: &Substep, is_shared: bool, width: Width) {
        let most = DEPENETRATION * plan.params.h;
        // What held them apart in the last substep most likely does.
        self.step(Turn::Warm, is_shared, width);
        self.give(plan, substep, is_shared);
        for _ in 0..ITERATIONS {
            self.step(Turn::Step, is_shared, width);
            self.give(plan, substep, is_shared);
        }
        self.step(Turn::Push { most }, is_shared, width);
        for (index, vertex) in self.vertices.iter_mut().enumerate().filter(|(_, vertex)| vertex.weight > 0.0) {
            vertex.push += self.acting.sum(index) * vertex.x.w;
        }
    }

    /// Steps the multipliers.
    fn step(&mut self, turn: Turn, is_shared: bool, width: Width) {
        let Contacts { acting: Acting { groups, impulses, .. }, u, .. } = self;
        let step = |(groups, impulses): (&mut [Group], &mut [Vec4])| simd::run(width, Step { groups, impulses, u, turn });
        if is_shared && groups.len() > GROUPS {
            groups.par_chunks_mut(GROUPS).zip(impulses.par_chunks_mut(GROUPS * MAX_LANES)).for_each(step);
        } else {
            step((groups, impulses));
        }
    }

    /// Gives vertices the impulses of their pairs, and meets the colliders with them.
    fn give(&mut self, plan: &Plan<'_>, substep: &Substep, is_shared: bool) {
        let Contacts { acting, vertices, u, .. } = self;
        super::for_chunks(is_shared, u, GRAIN, |first, u| {
            for (index, (u, vertex)) in (first..).zip(u.iter_mut().zip(&vertices[first..])) {
                if vertex.x.w == 0.0 || vertex.weight == 0.0 {
                    continue;
                }
                let mut by = xyz(*u) + acting.sum(index) * vertex.x.w;
                for body in plan.bodies {
                    by = contact_body(xyz(vertex.x), by, body, substep, &plan.params).1;
                }
                *u = by.extend(0.0);
            }
        });
    }
}

/// What impulses pairs are to give.
#[derive(Debug, Clone, Copy)]
enum Turn {
    /// Those that they begin with.
    Warm,
    /// Those of a step of the multipliers.
    Step,
    /// Not impulses, but what moves those that are too near apart, by at most so far (m).
    Push { most: f32 },
}

struct Step<'a> {
    groups: &'a mut [Group],
    impulses: &'a mut [Vec4],
    u: &'a [Vec4],
    turn: Turn,
}

impl Loop for Step<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Step { groups, impulses, u, turn } = self;
        for (group, impulses) in groups.iter_mut().zip(impulses.chunks_mut(MAX_LANES)) {
            for first in (0..MAX_LANES).step_by(L::LANES) {
                let lanes = first..first + L::LANES;
                let mut places = [group.corners[first]; MAX_LANES];
                places[..L::LANES].copy_from_slice(&group.corners[lanes.clone()]);
                let normal = vector::<L>(&group.normal, first);
                let (rub, press) = (vector::<L>(&group.rub, first), L::from_slice(&group.press[lanes.clone()]));
                let rate = L::from_slice(&group.rate[lanes.clone()]);
                let given = match turn {
                    Turn::Warm => impulse((rub, press), normal),
                    Turn::Step => {
                        let (free, last) = (L::from_slice(&group.free[lanes.clone()]), L::from_slice(&group.last[lanes.clone()]));
                        let weights = group.kind.wide_weights(free, last);
                        let relative = between(weights, corners_of::<L>(u, &places));
                        let (gap, friction) =
                            (L::from_slice(&group.gap[lanes.clone()]), L::from_slice(&group.friction[lanes.clone()]));
                        let (new_rub, new_press) = step_of_lambda((rub, press), normal, gap, relative, rate, friction);
                        let given = impulse((new_rub - rub, new_press - press), normal);
                        store(&mut group.rub[0][lanes.clone()], new_rub.x);
                        store(&mut group.rub[1][lanes.clone()], new_rub.y);
                        store(&mut group.rub[2][lanes.clone()], new_rub.z);
                        store(&mut group.press[lanes.clone()], new_press);
                        given
                    }
                    Turn::Push { most } => {
                        let (depth, most) = (L::from_slice(&group.depth[lanes.clone()]), L::splat(most));
                        normal * (L::select(depth.lt(most), depth, most) * rate * L::splat(1.0 / RELAXATION))
                    }
                };
                let mut all = [Vec4::ZERO; MAX_LANES];
                scattered(given, &mut all);
                impulses[lanes].copy_from_slice(&all[..L::LANES]);
            }
        }
    }
}

#[inline(always)]
fn vector<L: Registers>(of: &[[f32; MAX_LANES]; 3], first: usize) -> Vector<L> {
    let lanes = first..first + L::LANES;
    let (x, y) = (L::from_slice(&of[0][lanes.clone()]), L::from_slice(&of[1][lanes.clone()]));
    Vector::new(x, y, L::from_slice(&of[2][lanes]))
}

#[inline(always)]
fn store<L: Registers>(to: &mut [f32], from: L) {
    let vectors = from.to_vectors();
    for index in 0..L::VECTORS {
        vectors[index].write_to_slice(&mut to[4 * index..]);
    }
}
