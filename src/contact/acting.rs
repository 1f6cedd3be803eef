//! The active pairs, in groups of the largest SIMD width, with their multipliers.

use glam::{Vec3A, Vec4};

use super::detection::{Kind, Rows};
use super::near::{Near, Start, Vertex};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::RELAXATION;
use crate::simd::MAX_LANES;

/// Share of the last substep's multipliers with which this one starts.
pub(super) const WARM: f32 = 0.9;

/// The active pairs. Each kind fills whole groups of [`MAX_LANES`]; the padding of its last group has no effect.
#[derive(Debug, Default)]
pub(super) struct Acting {
    /// Groups of each kind, one kind after the other.
    pub groups: Vec<Group>,
    firsts: [usize; 2],
    /// The impulse (kg m) of each pair from the last iteration of the multipliers.
    pub impulses: Vec<Vec4>,
    /// For each vertex its pairs and its weights in them.
    corners: Vec<(u32, f32)>,
    starts: Vec<u32>,
    /// For each vertex its inverse mass (1/kg) times the sum of its weights.
    mobility: Vec<f32>,
    /// Number of pressing pairs.
    pub pressing: u32,
}

/// At most as many active pairs as there are lanes, as structure of arrays.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    pub corners: [[u32; 4]; MAX_LANES],
    pub listed: [u32; MAX_LANES],
    pub count: u32,
    pub kind: Kind,
    pub normal: [[f32; MAX_LANES]; 3],
    pub free: [f32; MAX_LANES],
    pub last: [f32; MAX_LANES],
    pub friction: [f32; MAX_LANES],
    /// The distance (m) by which they may approach, and the depth (m) at the start.
    pub gap: [f32; MAX_LANES],
    pub depth: [f32; MAX_LANES],
    /// See [`step_of_lambda`](crate::kernels::pair::step_of_lambda).
    pub rate: [f32; MAX_LANES],
    /// Multipliers (kg m): for friction, and along the normal.
    pub rub: [[f32; MAX_LANES]; 3],
    pub press: [f32; MAX_LANES],
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

    /// Sets a pair's multipliers to those of the last substep.
    fn warm(&mut self, lane: usize, held: Vec4) {
        let (normal, rub) = (self.normal(lane), xyz(held));
        let rub = rub - normal * normal.dot(rub);
        (0..3).for_each(|axis| self.rub[axis][lane] = rub[axis]);
        self.press[lane] = held.w;
    }
}

impl Acting {
    /// Collects the active pairs.
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
        // The corners of each vertex, in the order of the pairs.
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

    /// The sum of the impulses that a vertex receives from its pairs.
    pub(super) fn sum(&self, vertex: usize) -> Vec3A {
        let range = self.starts[vertex] as usize..self.starts[vertex + 1] as usize;
        let of = |&(pair, weight): &(u32, f32)| self.impulses[pair as usize] * weight;
        xyz(self.corners[range].iter().map(of).sum::<Vec4>())
    }

    /// Stores the multipliers in the lists.
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
