//! Edges in lanes of eight that share no vertex, and the loop over them: plain, four at a time, and eight with AVX2.
//!
//! The intricate part of the CPU backend, kept inside this wall: [`kernels::project`] is what it computes, and its oracle.
//! What an edge is corrected by does not depend on the lane that it is in, so that any packing gives the same bits.

#![allow(clippy::inline_always, reason = "instructions can be enabled for whole functions alone")]

use std::ops::Range;

#[cfg(test)]
use glam::Vec3A;
use glam::Vec4;

use crate::crew::Shared;
#[cfg(test)]
use crate::kernels::xyz;
use crate::kernels::{self, Edge};
use crate::stripes::Task;
use crate::wide::{self, IN_ROW, Wide, Wide3};

pub(crate) const WIDTH: usize = 8;

/// How the vertices of eight edges lie in memory; most of a grid's are in rows, which need no gathering.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// From vertices `a`, `a + 1` ... to `b`, `b + 1` ...: two ends are stored.
    Rows,
    /// From `a` to `a + 1`, from `a + 2` to `a + 3` ...: one end is stored.
    Pairs,
    /// Anywhere: eight ends, and eight more.
    Apart,
}

/// What eight edges of one colour are corrected by. A lane without an edge of its own repeats another with no share.
#[repr(C, align(32))]
#[derive(Debug, Clone, Copy)]
struct Lanes {
    inverse_rest: [f32; WIDTH],
    /// The edge's `inverse_weight` times its end's inverse mass: the share of the correction that the end takes.
    share_a: [f32; WIDTH],
    share_b: [f32; WIDTH],
}

/// Lanes of one kind, one after another.
#[derive(Debug, Clone)]
struct Batch {
    kind: Kind,
    lanes: Range<usize>,
    /// Where their ends are.
    ends: usize,
}

/// The lanes of a list of tasks.
#[derive(Debug, Default)]
pub(crate) struct Packed {
    lanes: Vec<Lanes>,
    ends: Vec<u32>,
    batches: Vec<Batch>,
    of: Vec<Range<usize>>,
    vertices: usize,
}

/// Which of the edge kernels a sweep is of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Rule {
    /// [`kernels::project`].
    Project,
    /// [`kernels::project_coarse`].
    Pull,
    /// [`kernels::relax`].
    Relax,
}

/// What the processor can do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Breadth {
    /// The plain kernel, edge after edge: the oracle of the others.
    #[cfg(test)]
    One,
    /// Four edges at once, on every machine that glam is made for.
    Four,
    /// Eight, with AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Eight,
}

impl Breadth {
    /// The widest here.
    pub(crate) fn detected() -> Breadth {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return Breadth::Eight;
        }
        Breadth::Four
    }
}

impl Kind {
    /// How many ends a batch stores for each lane.
    fn ends(self) -> usize {
        match self {
            Kind::Rows => 2,
            Kind::Pairs => 1,
            Kind::Apart => 2 * WIDTH,
        }
    }

    /// The ends of a lane's edges, by lane.
    #[inline(always)]
    fn spell(self, ends: &[u32]) -> [[u32; WIDTH]; 2] {
        match self {
            Kind::Rows => [0, 1].map(|end| IN_ROW.map(|k| ends[end] + k as u32)),
            Kind::Pairs => [0, 1].map(|end| std::array::from_fn(|k| ends[0] + 2 * k as u32 + end)),
            Kind::Apart => [0, WIDTH].map(|first| std::array::from_fn(|k| ends[first + k])),
        }
    }
}

impl Packed {
    /// Packs the edges of `tasks`, which are places in `edges`, colour by colour, given the vertices' inverse masses.
    ///
    /// # Panics
    /// If an edge's vertex has no inverse mass, or a colour names a vertex twice.
    pub(crate) fn pack(&mut self, tasks: &[Task], edges: &[Edge], colors: &[Range<usize>], inverse_mass: &[f32]) {
        self.lanes.clear();
        self.ends.clear();
        self.batches.clear();
        self.of.clear();
        self.vertices = inverse_mass.len();
        // The task and colour that last visited a vertex.
        let mut visited = vec![(usize::MAX, usize::MAX); self.vertices];
        let mut edges_now: Vec<Edge> = Vec::new();
        for (index, task) in tasks.iter().enumerate() {
            let start = self.batches.len();
            // Springs are forces: no edge is swept.
            let mut rest = if edges.is_empty() { &[] } else { task.edges.as_slice() };
            for (color, range) in colors.iter().enumerate() {
                let (now, later) = rest.split_at(rest.partition_point(|&place| (place as usize) < range.end));
                rest = later;
                edges_now.clear();
                edges_now.extend(now.iter().map(|&place| edges[place as usize]));
                for end in edges_now.iter().flat_map(|edge| [edge.a, edge.b]) {
                    let before = std::mem::replace(&mut visited[end as usize], (index, color));
                    assert!(before != (index, color), "vertex {end} has two edges of a colour");
                }
                self.pack_color(&mut edges_now, inverse_mass, start);
            }
            self.of.push(start..self.batches.len());
        }
    }

    /// Packs the edges of one colour, which may come in any order: rows first, then what is left over.
    fn pack_color(&mut self, edges: &mut [Edge], inverse_mass: &[f32], open: usize) {
        // Edges of one row have one offset, and come one after another.
        let offset = |edge: &Edge| edge.b.wrapping_sub(edge.a);
        edges.sort_unstable_by_key(|edge| (offset(edge), edge.a));
        let step = |edge: &Edge| if offset(edge) == 1 { 2 } else { 1 };
        let follows = |one: &Edge, next: &Edge| offset(one) == offset(next) && next.a - one.a == step(one);
        let mut apart: Vec<Edge> = Vec::new();
        for run in edges.chunk_by(follows) {
            if run.len() < WIDTH {
                apart.extend(run);
                continue;
            }
            for start in (0..run.len()).step_by(WIDTH) {
                // The last lanes of a row begin earlier, and leave alone what the lanes before have done.
                let first = start.min(run.len() - WIDTH);
                let edge = |k: usize| (run[first + k], first + k >= start);
                match step(&run[0]) {
                    1 => self.push(Kind::Rows, IN_ROW.map(edge), inverse_mass, open),
                    _ => self.push(Kind::Pairs, std::array::from_fn(edge), inverse_mass, open),
                }
            }
        }
        apart.sort_unstable_by_key(|edge| (edge.a, edge.b));
        for edges in apart.chunks(WIDTH) {
            let edge = |k: usize| (edges[k.min(edges.len() - 1)], k < edges.len());
            self.push(Kind::Apart, std::array::from_fn(edge), inverse_mass, open);
        }
    }

    /// Adds eight edges, given which of them count, to the last batch of those from `open` on, or a new one.
    fn push(&mut self, kind: Kind, edges: [(Edge, bool); WIDTH], inverse_mass: &[f32], open: usize) {
        match self.batches[open..].last_mut() {
            Some(batch) if batch.kind == kind => batch.lanes.end += 1,
            _ => {
                let lanes = self.lanes.len()..self.lanes.len() + 1;
                self.batches.push(Batch { kind, lanes, ends: self.ends.len() });
            }
        }
        let all = edges.map(|(edge, _)| [edge.a, edge.b]);
        let ends: [u32; 2 * WIDTH] = std::array::from_fn(|k| all[k % WIDTH][k / WIDTH]);
        let ends = if kind == Kind::Apart { &ends } else { &all[0][..kind.ends()] };
        debug_assert_eq!(kind.spell(ends), [all.map(|[a, _]| a), all.map(|[_, b]| b)]);
        self.ends.extend(ends);
        let share = |(edge, counts): (Edge, bool), end: u32| {
            let share = edge.inverse_weight * inverse_mass[end as usize];
            if counts { share } else { 0.0 }
        };
        self.lanes.push(Lanes {
            inverse_rest: edges.map(|(edge, _)| edge.inverse_rest),
            share_a: edges.map(|lane| share(lane, lane.0.a)),
            share_b: edges.map(|lane| share(lane, lane.0.b)),
        });
    }

    /// Visits the edges of one task in order, as broadly as said, which the processor must be able to.
    ///
    /// # Safety
    /// No other thread may write `u` at the task's vertices meanwhile, nor `x`, nor read `u` there; both have as many
    /// items as the inverse masses that the edges were packed with.
    #[expect(unsafe_code, reason = "see the safety section; tasks are kept apart by Stripes and Crew")]
    pub(crate) unsafe fn sweep(&self, task: usize, x: Shared<Vec4>, u: Shared<Vec4>, rule: Rule, breadth: Breadth) {
        debug_assert!(x.len() == self.vertices && u.len() == self.vertices, "one item per vertex");
        for batch in &self.batches[self.of[task].clone()] {
            let lanes = &self.lanes[batch.lanes.clone()];
            let ends = &self.ends[batch.ends..batch.ends + lanes.len() * batch.kind.ends()];
            // SAFETY: the caller's promise; `pack` checked that the ends are vertices.
            unsafe {
                match breadth {
                    #[cfg(target_arch = "x86_64")]
                    Breadth::Eight => match rule {
                        Rule::Project => avx2::sweep::<false, false>(batch.kind, lanes, ends, x, u),
                        Rule::Pull => avx2::sweep::<true, false>(batch.kind, lanes, ends, x, u),
                        Rule::Relax => avx2::sweep::<false, true>(batch.kind, lanes, ends, x, u),
                    },
                    _ => {
                        for (lanes, ends) in lanes.iter().zip(ends.chunks_exact(batch.kind.ends())) {
                            let ends = batch.kind.spell(ends);
                            match (breadth, rule) {
                                #[cfg(test)]
                                (Breadth::One, Rule::Project) => each(lanes, &ends, x, u, kernels::project),
                                #[cfg(test)]
                                (Breadth::One, Rule::Pull) => each(lanes, &ends, x, u, kernels::project_coarse),
                                #[cfg(test)]
                                (Breadth::One, Rule::Relax) => each(lanes, &ends, x, u, kernels::relax),
                                (_, Rule::Project) => fours::<false, false>(lanes, &ends, x, u),
                                (_, Rule::Pull) => fours::<true, false>(lanes, &ends, x, u),
                                (_, Rule::Relax) => fours::<false, true>(lanes, &ends, x, u),
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The eight edges one after another, by the plain kernel.
#[cfg(test)]
#[expect(unsafe_code, reason = "see Packed::sweep")]
#[inline]
unsafe fn each(
    lanes: &Lanes,
    ends: &[[u32; WIDTH]; 2],
    x: Shared<Vec4>,
    u: Shared<Vec4>,
    kernel: impl Fn(Vec3A, Vec3A, &Edge) -> Vec3A,
) {
    for (lane, (&a, &b)) in ends[0].iter().zip(&ends[1]).enumerate() {
        let (a, b) = (a as usize, b as usize);
        let edge = Edge { a: a as u32, b: b as u32, inverse_rest: lanes.inverse_rest[lane], inverse_weight: 1.0 };
        // SAFETY: the caller's promise.
        unsafe {
            let impulse = kernel(xyz(x.get(a) - x.get(b)), xyz(u.get(a) - u.get(b)), &edge).extend(0.0);
            u.set(a, u.get(a) + impulse * lanes.share_a[lane]);
            u.set(b, u.get(b) - impulse * lanes.share_b[lane]);
        }
    }
}

/// [`kernels::project`] side by side, `PULL`: [`kernels::project_coarse`], `RELAX`: [`kernels::relax`].
///
/// Given `d0` and `du`: how much of the edge's direction to take off, and where that direction is `d0`; elsewhere it is `d0 + du`.
#[inline(always)]
fn correction<W: Wide, const PULL: bool, const RELAX: bool>(s: Wide3<W>, su: Wide3<W>, inverse_rest: W) -> (W, W::Mask) {
    let (zero, one) = (W::splat(0.0), W::splat(1.0));
    let d = wide::add(s, su);
    if RELAX {
        return (stretch(d, inverse_rest), zero.below(zero));
    }
    let less_one = W::splat(-1.0);
    let inverse_square = inverse_rest * inverse_rest;
    let r = wide::dot(d, d).times_plus(inverse_square, less_one);
    let r0 = wide::dot(s, s).times_plus(inverse_square, less_one);
    let c = wide::dot(s, d) * inverse_square;
    let guard = W::splat(kernels::STRETCH_GUARD);
    // Each compared by itself: a maximum would let a NaN pass.
    let hardly = W::both(r.abs().below(guard), r0.abs().below(guard));
    let rigid = W::both(W::splat(kernels::TURN_GUARD).below(c), hardly);
    let unit = r0.times_from(r0.times_from(W::splat(0.375), W::splat(0.5)), one);
    let inner = r.times_from(r.times_from(W::splat(0.0625), W::splat(0.125)), W::splat(0.5));
    let mut scale = unit * r * inner;
    if !W::all(rigid) {
        scale = W::choose(rigid, scale, stretch(d, inverse_rest));
    }
    if PULL {
        scale = W::choose(r.below(zero), zero, scale);
    }
    (scale, rigid)
}

/// [`kernels::relax`].
#[inline(always)]
fn stretch<W: Wide>(d: Wide3<W>, inverse_rest: W) -> W {
    let (one, least) = (W::splat(1.0), W::splat(kernels::LEAST_LENGTH));
    one - one / (inverse_rest * wide::dot(d, d).sqrt().max(least))
}

/// Twice four edges at a time.
#[expect(unsafe_code, reason = "see Packed::sweep")]
#[inline]
unsafe fn fours<const PULL: bool, const RELAX: bool>(lanes: &Lanes, ends: &[[u32; WIDTH]; 2], x: Shared<Vec4>, u: Shared<Vec4>) {
    for first in [0, 4] {
        let at = |end: usize, k: usize| ends[end][first + k] as usize;
        let four = |values: &[f32; WIDTH]| Vec4::from_slice(&values[first..first + 4]);
        let of = |values: Shared<Vec4>| {
            // SAFETY: the caller's promise.
            std::array::from_fn::<Vec4, 4, _>(|k| unsafe { values.get(at(0, k)) - values.get(at(1, k)) })
        };
        let (d0, du) = (of(x), of(u));
        let (s, su, inverse_rest) = (wide::transpose(d0), wide::transpose(du), four(&lanes.inverse_rest));
        let (scale, rigid) = correction::<Vec4, PULL, RELAX>(s, su, inverse_rest);
        let rigid = rigid.bitmask();
        let (scale_a, scale_b) = (scale * four(&lanes.share_a), scale * four(&lanes.share_b));
        for k in 0..4 {
            let along = if rigid >> k & 1 == 1 { d0[k] } else { d0[k] + du[k] };
            // SAFETY: the caller's promise.
            unsafe {
                u.set(at(0, k), u.get(at(0, k)) - along * scale_a[k]);
                u.set(at(1, k), u.get(at(1, k)) + along * scale_b[k]);
            }
        }
    }
}

/// Eight edges at a time. Differences are of two vertices side by side, so that one instruction applies two results.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    #[allow(clippy::wildcard_imports, reason = "the instruction set is the vocabulary here")]
    use std::arch::x86_64::*;

    use super::{Kind, Lanes, Shared, Vec4, WIDTH, Wide, correction};
    use crate::wide::{Eight, Two};

    /// Lanes of one kind.
    #[expect(unsafe_code, reason = "see Packed::sweep")]
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn sweep<const PULL: bool, const RELAX: bool>(
        kind: Kind,
        lanes: &[Lanes],
        ends: &[u32],
        x: Shared<Vec4>,
        u: Shared<Vec4>,
    ) {
        // Loops, for what takes a closure has not these instructions.
        // SAFETY: the caller's promise.
        unsafe {
            match kind {
                Kind::Rows => {
                    for (lanes, ends) in lanes.iter().zip(ends.chunks_exact(2)) {
                        let first = [ends[0] as usize, ends[1] as usize];
                        eight::<PULL, RELAX>(lanes, x, u, |end, k| Two::Beside(first[end] + 2 * k));
                    }
                }
                Kind::Pairs => {
                    for (lanes, &first) in lanes.iter().zip(ends) {
                        let first = first as usize;
                        eight::<PULL, RELAX>(lanes, x, u, |end, k| Two::Apart(first + end + 2 * k, first + end + 2 * k + 8));
                    }
                }
                Kind::Apart => {
                    for (lanes, ends) in lanes.iter().zip(ends.chunks_exact(2 * WIDTH)) {
                        let at = |end: usize, k: usize| ends[end * WIDTH + k] as usize;
                        eight::<PULL, RELAX>(lanes, x, u, |end, k| Two::Apart(at(end, k), at(end, k + 4)));
                    }
                }
            }
        }
    }

    /// Eight edges, given where their ends `0` and `1` are, two edges at a time.
    #[expect(unsafe_code, reason = "see Packed::sweep; `Lanes` is aligned for `_mm256_load_ps`, `Vec4` for `_mm_load_ps`")]
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    unsafe fn eight<const PULL: bool, const RELAX: bool>(
        lanes: &Lanes,
        x: Shared<Vec4>,
        u: Shared<Vec4>,
        at: impl Fn(usize, usize) -> Two,
    ) {
        // SAFETY: the caller's promise.
        unsafe {
            let mut d0 = [Eight::splat(0.0); 4];
            let mut du = d0;
            for k in 0..4 {
                d0[k] = Eight::load(x, at(0, k)) - Eight::load(x, at(1, k));
                du[k] = Eight::load(u, at(0, k)) - Eight::load(u, at(1, k));
            }
            let inverse_rest = Eight(_mm256_load_ps(lanes.inverse_rest.as_ptr()));
            let (s, su) = (Eight::transpose(d0), Eight::transpose(du));
            let (scale, rigid) = correction::<Eight, PULL, RELAX>(s, su, inverse_rest);
            if RELAX || !Eight::all(rigid) {
                let rigid = rigid.spread();
                for k in 0..4 {
                    d0[k] = Eight::choose(rigid[k], d0[k], d0[k] + du[k]);
                }
            }
            let by_a = (scale * Eight(_mm256_load_ps(lanes.share_a.as_ptr()))).spread();
            let by_b = (scale * Eight(_mm256_load_ps(lanes.share_b.as_ptr()))).spread();
            for k in 0..4 {
                // Both loaded before either is stored: where rows are 4096 bytes long, a load would wait for the other's store.
                let (a, b) = (Eight::load(u, at(0, k)), Eight::load(u, at(1, k)));
                d0[k].times_from(by_a[k], a).store(u, at(0, k));
                d0[k].times_plus(by_b[k], b).store(u, at(1, k));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloth::Cloth;
    use crate::coefficients::Coefficients;
    use crate::stripes::Stripes;
    use crate::{Fabric, Mesh, Options};

    /// `u` after one sweep, in tasks, or edge by edge in the plain colour order.
    fn swept(cloth: &Cloth, edges: &[Edge], start: &[Vec4], rule: Rule, breadth: Option<Breadth>) -> Vec<Vec4> {
        let kernel = match rule {
            Rule::Project => kernels::project,
            Rule::Pull => kernels::project_coarse,
            Rule::Relax => kernels::relax,
        };
        let (mut x, mut u) = (cloth.rest.clone(), start.to_vec());
        let Some(breadth) = breadth else {
            for edge in edges {
                let (a, b) = (edge.a as usize, edge.b as usize);
                let impulse = kernel(xyz(x[a] - x[b]), xyz(u[a] - u[b]), edge).extend(0.0);
                u[a] += impulse * x[a].w;
                u[b] -= impulse * x[b].w;
            }
            return u;
        };
        let stripes = Stripes::new(&cloth.links, cloth.swept().len(), x.len());
        let weights: Vec<f32> = x.iter().map(|x| x.w).collect();
        for tasks in &stripes.rounds {
            let mut packed = Packed::default();
            packed.pack(tasks, edges, &cloth.colors, &weights);
            for task in 0..tasks.len() {
                #[expect(unsafe_code, reason = "one thread, both slices alive")]
                // SAFETY: nobody else is here.
                unsafe {
                    packed.sweep(task, Shared::new(&mut x), Shared::new(&mut u), rule, breadth);
                }
            }
        }
        u
    }

    /// The same work in the same order: to rounding with every processor, gentle or wild, soft or stiff, pinned or not.
    #[test]
    fn lanes_do_what_the_plain_kernel_does() {
        let mut mesh = Mesh::grid(37, 61, 1.0, 1.6);
        let mut random = fastrand::Rng::with_seed(9);
        let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
        mesh.positions.iter_mut().for_each(|x| *x += vector(0.004));
        for (size, stretch) in [(0.001, 50.0), (0.001, 1e6), (0.05, 5000.0), (2.0, 5000.0)] {
            let fabric = Fabric { stretch, ..Fabric::default() };
            let options = Options { fabric, pinned: vec![0, 36, 500], ..Options::default() };
            let cloth = Cloth::new(&mesh, &options).unwrap();
            let edges = Coefficients::new(&cloth, &options, 1.0 / 1200.0, 0).edges;
            let start: Vec<Vec4> = cloth.rest.iter().map(|x| vector(if x.w > 0.0 { size } else { 0.0 }).extend(0.0)).collect();
            for rule in [Rule::Project, Rule::Pull, Rule::Relax] {
                let plain = swept(&cloth, &edges, &start, rule, None);
                let moved = plain.iter().zip(&start).map(|(u, start)| (u - start).truncate().length()).fold(0.0, f32::max);
                assert!(moved > 0.01 * size, "{size}: something is corrected");
                for breadth in [Breadth::One, Breadth::Four, Breadth::detected()] {
                    let lanes = swept(&cloth, &edges, &start, rule, Some(breadth));
                    let apart = plain.iter().zip(&lanes).map(|(a, b)| (a - b).truncate().length()).fold(0.0, f32::max);
                    assert!(apart <= 3e-6 * (moved + size), "{rule:?} {size} {stretch} {breadth:?}: {apart} of {moved}");
                }
            }
        }
    }
}
