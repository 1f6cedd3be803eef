//! The active pairs, in groups of the largest SIMD width, with their multipliers.

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use super::least;
use super::near::{Near, Portion, Start, Vertex};
use super::pairs::Kind;
use super::ranges::Ranges;
use crate::kernels::integrate::xyz;
use crate::simd::MAX_LANES;

/// Groups of pairs per task.
pub(super) const GROUPS: usize = 16;

/// The active pairs. Each kind fills whole groups of [`MAX_LANES`]; the padding of its last group has no effect.
#[derive(Debug, Default)]
pub(super) struct Acting {
    /// Groups of each kind, one kind after the other.
    pub groups: Vec<Group>,
    /// The first group of each kind.
    firsts: [usize; 2],
    /// The impulse (kg m) of each pair from the last iteration of the multipliers, and the correction of positions.
    pub impulses: Vec<Vec4>,
    pub pushes: Vec<Vec4>,
    /// The pairs of each vertex, in ranges of vertices.
    pub corners: Vec<Corners>,
    pub ranges: Ranges,
    /// For each vertex its inverse mass (1/kg) times the sum of its weights.
    pub mobility: Vec<f32>,
}

/// The active pairs of a range of vertices.
#[derive(Debug, Default)]
pub(super) struct Corners {
    /// Pairs and weights, vertex after vertex; where those of each vertex begin, and the last one's end.
    of_vertices: Vec<(u32, f32)>,
    starts: Vec<u32>,
}

/// At most as many active pairs as there are lanes, as structure of arrays.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    pub corners: [[u32; 4]; MAX_LANES],
    pub listed: [u32; MAX_LANES],
    pub count: u32,
    pub kind: Kind,
    /// The ranges of vertices that have corners here.
    ranges: u64,
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
            ranges: 0,
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

    pub(super) fn weights(&self, lane: usize) -> [f32; 4] {
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
    pub(super) fn warm(&mut self, lane: usize, held: Vec4) {
        let [x, y, z] = &self.normal;
        let (normal, rub) = (Vec3A::new(x[lane], y[lane], z[lane]), xyz(held));
        let rub = rub - normal * normal.dot(rub);
        (0..3).for_each(|axis| self.rub[axis][lane] = rub[axis]);
        self.press[lane] = held.w;
    }
}

impl Corners {
    /// Collects the pairs of `vertices` vertices, which are those of a range.
    pub(super) fn collect(&mut self, groups: &[Group], ranges: Ranges, range: usize, vertices: usize) {
        let Corners { of_vertices, starts } = self;
        starts.clear();
        starts.resize(vertices + 1, 0);
        for group in groups.iter().filter(|group| group.ranges >> range & 1 != 0) {
            for &vertex in group.corners[..group.count as usize].iter().flatten() {
                let (of, place) = ranges.place(vertex);
                if of == range {
                    starts[place + 1] += 1;
                }
            }
        }
        let mut total = 0;
        for start in starts.iter_mut() {
            total += std::mem::replace(start, total);
        }
        of_vertices.resize(total as usize, (0, 0.0));
        for (first, group) in (0..).step_by(MAX_LANES).zip(groups).filter(|(_, group)| group.ranges >> range & 1 != 0) {
            for lane in 0..group.count as usize {
                for (vertex, weight) in group.corners[lane].into_iter().zip(group.weights(lane)) {
                    let (of, place) = ranges.place(vertex);
                    if of == range {
                        // The start of the next vertex becomes the end of this one's pairs.
                        let end = &mut starts[place + 1];
                        of_vertices[*end as usize] = ((first + lane) as u32, weight);
                        *end += 1;
                    }
                }
            }
        }
    }

    /// The pairs of a vertex, and its weights in them.
    #[inline]
    pub(super) fn of(&self, vertex: usize) -> &[(u32, f32)] {
        &self.of_vertices[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }

    /// The sum of what a vertex receives from its pairs; `from` has one vector for each pair.
    #[inline]
    pub(super) fn sum(&self, from: &[Vec4], vertex: usize) -> Vec3A {
        xyz(self.of(vertex).iter().map(|&(pair, weight)| from[pair as usize] * weight).sum::<Vec4>())
    }
}

impl Acting {
    /// Collects the active pairs, in order, and sums up the weights of the vertices.
    pub(super) fn gather(&mut self, portions: [&[Portion]; 2], vertices: &mut [Vertex], start: Start<'_>) {
        let Acting { groups, firsts, impulses, pushes, ranges, corners, mobility } = self;
        let counts = portions.map(|of| of.last().map_or(0, |last| last.before as usize + last.acting.len()));
        let [first, second] = counts.map(|count| count.div_ceil(MAX_LANES));
        *firsts = [0, first];
        groups.resize(first + second, Group::EMPTY);
        [&mut *impulses, pushes].into_iter().for_each(|of| of.resize(MAX_LANES * (first + second), Vec4::ZERO));
        *ranges = Ranges::of(vertices.len(), start.is_shared);
        corners.resize_with(corners.len().max(ranges.count), Corners::default);
        let tasks = groups.par_iter_mut().enumerate().with_min_len(GROUPS.max(least(start.is_shared)));
        tasks.for_each(|(index, group)| {
            let kind = Kind::ALL[usize::from(index >= first)];
            let index = MAX_LANES * (index - firsts[kind as usize]);
            if index + MAX_LANES > counts[kind as usize] {
                *group = Group::EMPTY;
            }
            (group.kind, group.count, group.ranges) = (kind, 0, 0);
            (group.rate, group.press, group.rub) = ([0.0; MAX_LANES], [0.0; MAX_LANES], [[0.0; MAX_LANES]; 3]);
            for pair in acting(portions[kind as usize], index).take(MAX_LANES) {
                let owner = |k: usize| start.surface.owner[vertices[pair.corners[k] as usize].index as usize];
                group.ranges |= pair.corners.iter().fold(0, |all, &vertex| all | ranges.bit(vertex));
                group.add(pair, start.friction[owner(0).max(owner(3)) as usize]);
            }
        });
        let (groups, ranges) = (&*groups, *ranges);
        mobility.resize(vertices.len(), 0.0);
        let tasks = vertices.par_chunks_mut(ranges.len()).zip(mobility.par_chunks_mut(ranges.len())).zip(corners).enumerate();
        tasks.with_min_len(least(start.is_shared)).for_each(|(range, ((vertices, mobility), corners))| {
            corners.collect(groups, ranges, range, vertices.len());
            for (place, (vertex, mobility)) in vertices.iter_mut().zip(mobility).enumerate() {
                vertex.weight = corners.of(place).iter().map(|(_, weight)| weight.abs()).sum();
                *mobility = vertex.x.w * vertex.weight;
            }
        });
    }

    /// The index in the list of an active pair, given by its number within its kind, and its multiplier.
    pub(super) fn multiplier(&self, kind: Kind, pair: usize) -> (usize, Vec4) {
        let (group, lane) = (&self.groups[self.firsts[kind as usize] + pair / MAX_LANES], pair % MAX_LANES);
        let [x, y, z] = &group.rub;
        (group.listed[lane] as usize, Vec4::new(x[lane], y[lane], z[lane], group.press[lane]))
    }
}

/// The active pairs of some portions from a given one on.
fn acting(portions: &[Portion], first: usize) -> impl Iterator<Item = &Near> {
    let at = portions.partition_point(|portion| portion.before as usize <= first) - 1;
    portions[at..].iter().flat_map(move |portion| {
        let skipped = first.saturating_sub(portion.before as usize);
        portion.acting[skipped..].iter().map(|&pair| &portion.pairs[pair as usize])
    })
}
