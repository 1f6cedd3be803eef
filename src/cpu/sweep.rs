//! The edge kernels, as many edges at once as the processor takes.
//!
//! The intricate part of the CPU backend, kept inside this wall: [`kernels::project`] is what it computes, and its oracle.

use glam::Vec4;

use crate::cpu::edge_batches::Kind;
use crate::cpu::shared::Shared;
use crate::kernels;
use crate::simd::{self, At, Loop, Wide, Wide3};

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

/// Visits rows of one kind, in order: their `factors` and `ends` as [`Packed`](crate::cpu::edge_batches::Packed) has them.
///
/// To run it, the ends must be items of `x` and `u`, and no other thread may write either there meanwhile, nor read `u`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows<'a> {
    pub rule: Rule,
    pub kind: Kind,
    pub factors: &'a [f32],
    pub ends: &'a [u32],
    pub x: Shared<Vec4>,
    pub u: Shared<Vec4>,
}

#[expect(unsafe_code, reason = "see Rows")]
impl Loop for Rows<'_> {
    #[inline(always)]
    unsafe fn run<W: Wide>(self) {
        // SAFETY: the caller's promise.
        unsafe {
            match self.rule {
                Rule::Project => self.run_by::<W, false, false>(),
                Rule::Pull => self.run_by::<W, true, false>(),
                Rule::Relax => self.run_by::<W, false, true>(),
            }
        }
    }
}

#[expect(unsafe_code, reason = "see Rows")]
impl Rows<'_> {
    /// `PULL`: [`kernels::project_coarse`], `RELAX`: [`kernels::relax`].
    #[inline(always)]
    unsafe fn run_by<W: Wide, const PULL: bool, const RELAX: bool>(self) {
        let group = W::LANES / 4;
        let rows = self.factors.chunks_exact(3 * W::LANES).zip(self.ends.chunks_exact(self.kind.ends(W::LANES)));
        // Loops, for what takes a closure has not the instructions.
        // SAFETY: the caller's promise.
        unsafe {
            match self.kind {
                Kind::Rows => {
                    for (factors, ends) in rows {
                        let (a, b) = (ends[0] as usize, ends[1] as usize);
                        let at = |k| Ends::Of(At::Beside(a + group * k), At::Beside(b + group * k));
                        row::<W, PULL, RELAX, false>(factors, self.x, self.u, at);
                    }
                }
                Kind::Pairs => {
                    for (factors, ends) in rows {
                        let first = ends[0] as usize;
                        row::<W, PULL, RELAX, false>(factors, self.x, self.u, |k| Ends::Pairs(first + 2 * group * k));
                    }
                }
                Kind::Apart => {
                    for (factors, ends) in rows {
                        let at =
                            |k: usize| Ends::Of(simd::apart::<W>(&ends[..W::LANES], k), simd::apart::<W>(&ends[W::LANES..], k));
                        row::<W, PULL, RELAX, true>(factors, self.x, self.u, at);
                    }
                }
            }
        }
    }
}

/// Where both ends of some edges are.
#[derive(Debug, Clone, Copy)]
enum Ends {
    Of(At, At),
    /// First and second of pairs that lie one after another.
    Pairs(usize),
}

#[expect(unsafe_code, reason = "see Rows")]
impl Ends {
    #[inline(always)]
    unsafe fn load<W: Wide>(self, values: Shared<Vec4>) -> [W; 2] {
        // SAFETY: the caller's promise.
        unsafe {
            match self {
                Ends::Of(a, b) => [W::load(values, a), W::load(values, b)],
                Ends::Pairs(first) => W::load_pairs(values, first),
            }
        }
    }

    #[inline(always)]
    unsafe fn store<W: Wide>(self, values: Shared<Vec4>, [a, b]: [W; 2]) {
        // SAFETY: the caller's promise.
        unsafe {
            match self {
                Ends::Of(at_a, at_b) => {
                    a.store(values, at_a);
                    b.store(values, at_b);
                }
                Ends::Pairs(first) => W::store_pairs([a, b], values, first),
            }
        }
    }
}

/// One row, given where the ends of its edges are, register by register.
///
/// Differences are of vectors side by side, so that one instruction applies the results of several edges.
#[expect(unsafe_code, reason = "see Rows")]
#[inline(always)]
unsafe fn row<W: Wide, const PULL: bool, const RELAX: bool, const KEEP: bool>(
    factors: &[f32],
    x: Shared<Vec4>,
    u: Shared<Vec4>,
    at: impl Fn(usize) -> Ends,
) {
    let factor = |index: usize| W::from_slice(&factors[index * W::LANES..(index + 1) * W::LANES]);
    // SAFETY: the caller's promise.
    unsafe {
        let mut d0 = [W::splat(0.0); 4];
        let (mut du, mut ends) = (d0, [[d0[0]; 2]; 4]);
        for k in 0..4 {
            let [x_a, x_b] = at(k).load::<W>(x);
            ends[k] = at(k).load::<W>(u);
            (d0[k], du[k]) = (x_a - x_b, ends[k][0] - ends[k][1]);
        }
        let (scale, rigid) = correction::<W, PULL, RELAX>(W::transpose(d0), W::transpose(du), factor(0));
        if RELAX || !W::all(rigid) {
            let rigid = W::spread_mask(rigid);
            for k in 0..4 {
                d0[k] = W::choose(rigid[k], d0[k], d0[k] + du[k]);
            }
        }
        let (by_a, by_b) = ((scale * factor(1)).spread(), (scale * factor(2)).spread());
        for k in 0..4 {
            // Both loaded before either is stored: where rows are 4096 bytes long, a load would wait for the other's store. Loaded again
            // where that is cheaper than to keep them.
            let [a, b] = if KEEP { ends[k] } else { at(k).load::<W>(u) };
            at(k).store(u, [d0[k].times_from(by_a[k], a), d0[k].times_plus(by_b[k], b)]);
        }
    }
}

/// [`kernels::project`] side by side.
///
/// Given `d0` and `du`: how much of the edge's direction to take off, and where that direction is `d0`; elsewhere it is `d0 + du`.
#[inline(always)]
fn correction<W: Wide, const PULL: bool, const RELAX: bool>(s: Wide3<W>, su: Wide3<W>, inverse_rest: W) -> (W, W::Mask) {
    let (zero, one) = (W::splat(0.0), W::splat(1.0));
    let d = simd::add(s, su);
    if RELAX {
        return (stretch(d, inverse_rest), zero.below(zero));
    }
    let less_one = W::splat(-1.0);
    let inverse_square = inverse_rest * inverse_rest;
    let r = simd::dot(d, d).times_plus(inverse_square, less_one);
    let r0 = simd::dot(s, s).times_plus(inverse_square, less_one);
    let c = simd::dot(s, d) * inverse_square;
    let guard = W::splat(kernels::STRETCH_GUARD);
    // Each compared by itself: a maximum would let a NaN pass.
    let hardly = W::both(r.abs().below(guard), r0.abs().below(guard));
    let mut rigid = W::both(W::splat(kernels::TURN_GUARD).below(c), hardly);
    let slack = r.below(zero);
    if PULL {
        // What is slack is left alone, whichever way it points.
        rigid = W::either(rigid, slack);
    }
    let unit = r0.times_from(r0.times_from(W::splat(0.375), W::splat(0.5)), one);
    let inner = r.times_from(r.times_from(W::splat(0.0625), W::splat(0.125)), W::splat(0.5));
    let mut scale = unit * r * inner;
    if !W::all(rigid) {
        scale = W::choose(rigid, scale, stretch(d, inverse_rest));
    }
    if PULL {
        scale = W::choose(slack, zero, scale);
    }
    (scale, rigid)
}

/// [`kernels::relax`].
#[inline(always)]
fn stretch<W: Wide>(d: Wide3<W>, inverse_rest: W) -> W {
    let (one, least) = (W::splat(1.0), W::splat(kernels::LEAST_LENGTH));
    one - one / (inverse_rest * simd::dot(d, d).sqrt().max(least))
}

/// The edges one after another, by the plain kernel: the oracle. `end` tells a vertex by row, end and lane.
#[cfg(test)]
#[expect(unsafe_code, reason = "see Rows")]
pub(crate) unsafe fn each(
    factors: &[f32],
    lanes: usize,
    end: impl Fn(usize, usize, usize) -> u32,
    x: Shared<Vec4>,
    u: Shared<Vec4>,
    rule: Rule,
) {
    let kernel = rule.kernel();
    for (row, factors) in factors.chunks_exact(3 * lanes).enumerate() {
        let ends = |lane: usize| (end(row, 0, lane), end(row, 1, lane));
        // A lane that repeats another is that edge once more.
        for lane in (0..lanes).filter(|&lane| lane == 0 || ends(lane) != ends(lane - 1)) {
            let (a, b) = ends(lane);
            let edge = kernels::Edge { a, b, inverse_rest: factors[lane], inverse_weight: 1.0 };
            let (a, b) = (a as usize, b as usize);
            // SAFETY: the caller's promise.
            unsafe {
                let (d0, du) = (x.get(a) - x.get(b), u.get(a) - u.get(b));
                let impulse = kernel(kernels::xyz(d0), kernels::xyz(du), &edge).extend(0.0);
                u.set(a, u.get(a) + impulse * factors[lanes + lane]);
                u.set(b, u.get(b) - impulse * factors[2 * lanes + lane]);
            }
        }
    }
}

#[cfg(test)]
impl Rule {
    pub(crate) fn kernel(self) -> fn(glam::Vec3A, glam::Vec3A, &kernels::Edge) -> glam::Vec3A {
        match self {
            Rule::Project => kernels::project,
            Rule::Pull => kernels::project_coarse,
            Rule::Relax => kernels::relax,
        }
    }
}
