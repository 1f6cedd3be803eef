//! Numbers side by side, for loops that do the same to many: sixteen with AVX-512, eight with AVX2, four wherever glam runs.
//!
//! Vectors of four lie in the same lanes, a quarter as many: so they are loaded, four times over, and transposed.
//!
//! What is computed is written once over [`Wide`]; a function that enables the instructions calls it, so everything here is
//! inlined into that.

use std::ops::{Add, Div, Mul, Sub};

use glam::{BVec4A, Mat4, Vec4};

use crate::cpu::shared::Shared;

pub(crate) mod aligned;
#[cfg(target_arch = "x86_64")]
mod eight;
#[cfg(target_arch = "x86_64")]
mod sixteen;

#[cfg(target_arch = "x86_64")]
pub(crate) use eight::Eight;
#[cfg(target_arch = "x86_64")]
pub(crate) use sixteen::Sixteen;

/// What the processor can do.
#[derive(Debug, Clone, Copy, Default, PartialEq, PartialOrd)]
pub(crate) enum Breadth {
    /// The plain kernels, one after another: the oracle of the others.
    #[cfg(test)]
    One,
    /// Four at once, on every machine that glam is made for.
    #[default]
    Four,
    /// Eight, with AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Eight,
    /// Sixteen, with AVX-512F besides.
    #[cfg(target_arch = "x86_64")]
    Sixteen,
}

impl Breadth {
    /// The widest here.
    pub(crate) fn detected() -> Breadth {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return if is_x86_feature_detected!("avx512f") { Breadth::Sixteen } else { Breadth::Eight };
        }
        Breadth::Four
    }

    /// The widest here of no more than so many lanes.
    pub(crate) fn at_most(lanes: usize) -> Breadth {
        Breadth::all().into_iter().rfind(|breadth| breadth.lanes() <= lanes).unwrap_or_default()
    }

    /// All that there are here, the widest last.
    pub(crate) fn all() -> Vec<Breadth> {
        let mut all = vec![Breadth::Four];
        #[cfg(target_arch = "x86_64")]
        all.extend([Breadth::Eight, Breadth::Sixteen]);
        all.retain(|&breadth| breadth <= Breadth::detected());
        all
    }

    /// Numbers at once.
    pub(crate) fn lanes(self) -> usize {
        match self {
            #[cfg(test)]
            Breadth::One => 4,
            Breadth::Four => 4,
            #[cfg(target_arch = "x86_64")]
            Breadth::Eight => 8,
            #[cfg(target_arch = "x86_64")]
            Breadth::Sixteen => 16,
        }
    }
}

/// A loop that is compiled for each breadth; what it calls must be inlined into it.
#[expect(unsafe_code, reason = "loops share state with other threads")]
pub(crate) trait Loop {
    /// # Safety
    /// The processor can do it; and as the loop itself says.
    unsafe fn run<W: Wide>(self);
}

/// Runs a loop as broadly as said.
///
/// # Safety
/// The processor can do it ([`Breadth::detected`]); and as the loop itself says.
#[expect(unsafe_code, reason = "see the safety section")]
#[cfg_attr(not(target_arch = "x86_64"), expect(unused_variables, reason = "there is one breadth"))]
pub(crate) unsafe fn run(breadth: Breadth, work: impl Loop) {
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx2,fma")]
    unsafe fn sixteen(work: impl Loop) {
        // SAFETY: the caller's promise.
        unsafe { work.run::<Sixteen>() };
    }
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    unsafe fn eight(work: impl Loop) {
        // SAFETY: the caller's promise.
        unsafe { work.run::<Eight>() };
    }
    #[cfg(target_arch = "x86_64")]
    // SAFETY: the caller's promise.
    match breadth {
        Breadth::Sixteen => return unsafe { sixteen(work) },
        Breadth::Eight => return unsafe { eight(work) },
        Breadth::Four => {}
        #[cfg(test)]
        Breadth::One => {}
    }
    // SAFETY: the caller's promise.
    unsafe { work.run::<Vec4>() };
}

/// Where vectors side by side are: one after another from here on, or the first so many of these.
#[derive(Debug, Clone, Copy)]
pub(crate) enum At {
    Beside(usize),
    Apart([usize; 4]),
}

/// Vectors that are where these say, a quarter as many as lanes.
#[inline(always)]
pub(crate) fn listed<W: Wide>(places: &[u32]) -> At {
    let vertex = |k: usize| if k < W::LANES / 4 { places[k] as usize } else { 0 };
    At::Apart([vertex(0), vertex(1), vertex(2), vertex(3)])
}

/// The same of ascending places, or some and then lower ones: often they are one after another.
#[inline(always)]
pub(crate) fn ascending<W: Wide>(places: &[u32]) -> At {
    let last = W::LANES / 4 - 1;
    if places[last] == places[0] + last as u32 { At::Beside(places[0] as usize) } else { listed::<W>(places) }
}

/// The vectors of register `k`, which are where their lanes say.
#[inline(always)]
pub(crate) fn apart<W: Wide>(places: &[u32], k: usize) -> At {
    let vertex = |lane: usize| if lane < W::LANES { places[lane] as usize } else { 0 };
    At::Apart([vertex(k), vertex(k + 4), vertex(k + 8), vertex(k + 12)])
}

#[inline(always)]
fn every_other(first: usize) -> At {
    At::Apart([first, first + 2, first + 4, first + 6])
}

/// Which of so many vectors one after another a lane has, once they are loaded side by side and transposed.
#[inline(always)]
pub(crate) fn place(lane: usize, lanes: usize) -> usize {
    lanes / 4 * (lane % 4) + lane / 4
}

/// Numbers side by side, or a quarter as many vectors. Whoever makes one knows that the processor can.
#[expect(unsafe_code, reason = "loads and stores where other threads may")]
pub(crate) trait Wide: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    type Mask: Copy;
    const LANES: usize;
    fn splat(value: f32) -> Self;
    /// A vector again and again.
    fn repeat(vector: Vec4) -> Self;
    /// The inverse of [`Wide::transpose`], with 0 as fourth.
    fn vectors(numbers: Wide3<Self>) -> [Self; 4];
    /// Each of these four times over, for its vector.
    ///
    /// # Panics
    /// If there are not as many as vectors.
    fn each(values: &[f32]) -> Self;
    /// # Panics
    /// If there are not as many as lanes.
    fn from_slice(values: &[f32]) -> Self;
    /// `self * by + to`, and `to - self * by`; rounded once where the machine can.
    fn times_plus(self, by: Self, to: Self) -> Self;
    fn times_from(self, by: Self, to: Self) -> Self;
    fn abs(self) -> Self;
    fn sqrt(self) -> Self;
    fn max(self, other: Self) -> Self;
    /// False for NaN, both.
    fn below(self, other: Self) -> Self::Mask;
    fn is(self, other: Self) -> Self::Mask;
    fn both(one: Self::Mask, other: Self::Mask) -> Self::Mask;
    fn either(one: Self::Mask, other: Self::Mask) -> Self::Mask;
    fn all(mask: Self::Mask) -> bool;
    fn choose(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// # Safety
    /// They are there, and nobody writes them meanwhile.
    unsafe fn load(values: Shared<Vec4>, at: At) -> Self;
    /// Of vectors at one place the first is what lasts.
    ///
    /// # Safety
    /// As [`Wide::load`], and nobody reads there meanwhile.
    unsafe fn store(self, values: Shared<Vec4>, at: At);
    /// Every other vector of twice as many from `first` on, and the ones between.
    ///
    /// # Safety
    /// As [`Wide::load`].
    #[inline(always)]
    unsafe fn load_pairs(values: Shared<Vec4>, first: usize) -> [Self; 2] {
        // SAFETY: the caller's promise.
        unsafe { [Self::load(values, every_other(first)), Self::load(values, every_other(first + 1))] }
    }
    /// # Safety
    /// As [`Wide::store`].
    #[inline(always)]
    unsafe fn store_pairs([a, b]: [Self; 2], values: Shared<Vec4>, first: usize) {
        // SAFETY: the caller's promise.
        unsafe {
            a.store(values, every_other(first));
            b.store(values, every_other(first + 1));
        }
    }
    /// The x, y and z of vectors loaded one after another, a register of each; lanes as [`place`] says.
    fn transpose(vectors: [Self; 4]) -> Wide3<Self>;
    /// The vectors added up.
    fn sum(self) -> Vec4;
    /// Each vector's w, four times over.
    fn last(self) -> Self;
    /// Each number four times over, for its vector: register by register as they were transposed.
    fn spread(self) -> [Self; 4];
    fn spread_mask(mask: Self::Mask) -> [Self::Mask; 4];
}

/// Vectors side by side: all x, all y, all z.
pub(crate) type Wide3<W> = [W; 3];

#[inline(always)]
pub(crate) fn dot<W: Wide>(v: Wide3<W>, w: Wide3<W>) -> W {
    v[2].times_plus(w[2], v[1].times_plus(w[1], v[0] * w[0]))
}

#[inline(always)]
pub(crate) fn cross<W: Wide>(v: Wide3<W>, w: Wide3<W>) -> Wide3<W> {
    let part = |i: usize, j: usize| v[j].times_from(w[i], v[i] * w[j]);
    [part(1, 2), part(2, 0), part(0, 1)]
}

#[inline(always)]
pub(crate) fn add<W: Wide>(v: Wide3<W>, w: Wide3<W>) -> Wide3<W> {
    [v[0] + w[0], v[1] + w[1], v[2] + w[2]]
}

#[inline(always)]
pub(crate) fn sub<W: Wide>(v: Wide3<W>, w: Wide3<W>) -> Wide3<W> {
    [v[0] - w[0], v[1] - w[1], v[2] - w[2]]
}

/// `v * by`.
#[inline(always)]
pub(crate) fn scaled<W: Wide>(v: Wide3<W>, by: W) -> Wide3<W> {
    [v[0] * by, v[1] * by, v[2] * by]
}

/// `v * by + to`.
#[inline(always)]
pub(crate) fn plus<W: Wide>(v: Wide3<W>, by: W, to: Wide3<W>) -> Wide3<W> {
    [v[0].times_plus(by, to[0]), v[1].times_plus(by, to[1]), v[2].times_plus(by, to[2])]
}

/// Vectors from `first` on, transposed.
///
/// # Safety
/// They are there, and nobody writes them meanwhile.
#[expect(unsafe_code, reason = "see the safety section")]
#[inline(always)]
pub(crate) unsafe fn vertices<W: Wide>(values: Shared<Vec4>, first: usize) -> Wide3<W> {
    let at = |k: usize| At::Beside(first + W::LANES / 4 * k);
    // SAFETY: the caller's promise.
    W::transpose(unsafe { [W::load(values, at(0)), W::load(values, at(1)), W::load(values, at(2)), W::load(values, at(3))] })
}

/// Four on any machine.
#[expect(unsafe_code, reason = "see Wide")]
impl Wide for Vec4 {
    type Mask = BVec4A;
    const LANES: usize = 4;

    #[inline(always)]
    fn splat(value: f32) -> Vec4 {
        Vec4::splat(value)
    }

    #[inline(always)]
    fn repeat(vector: Vec4) -> Vec4 {
        vector
    }

    #[inline(always)]
    fn each(values: &[f32]) -> Vec4 {
        Vec4::splat(values[0])
    }

    #[inline(always)]
    fn from_slice(values: &[f32]) -> Vec4 {
        Vec4::from_slice(values)
    }

    #[inline(always)]
    fn times_plus(self, by: Vec4, to: Vec4) -> Vec4 {
        self * by + to
    }

    #[inline(always)]
    fn times_from(self, by: Vec4, to: Vec4) -> Vec4 {
        to - self * by
    }

    #[inline(always)]
    fn abs(self) -> Vec4 {
        Vec4::abs(self)
    }

    #[inline(always)]
    fn sqrt(self) -> Vec4 {
        Vec4::from_array(self.to_array().map(f32::sqrt))
    }

    #[inline(always)]
    fn max(self, other: Vec4) -> Vec4 {
        Vec4::max(self, other)
    }

    #[inline(always)]
    fn below(self, other: Vec4) -> BVec4A {
        self.cmplt(other)
    }

    #[inline(always)]
    fn is(self, other: Vec4) -> BVec4A {
        self.cmpeq(other)
    }

    #[inline(always)]
    fn both(one: BVec4A, other: BVec4A) -> BVec4A {
        one & other
    }

    #[inline(always)]
    fn either(one: BVec4A, other: BVec4A) -> BVec4A {
        one | other
    }

    #[inline(always)]
    fn all(mask: BVec4A) -> bool {
        mask.all()
    }

    #[inline(always)]
    fn choose(mask: BVec4A, yes: Vec4, no: Vec4) -> Vec4 {
        Vec4::select(mask, yes, no)
    }

    #[inline(always)]
    unsafe fn load(values: Shared<Vec4>, at: At) -> Vec4 {
        let (At::Beside(place) | At::Apart([place, ..])) = at;
        // SAFETY: the caller's promise.
        unsafe { values.get(place) }
    }

    #[inline(always)]
    unsafe fn store(self, values: Shared<Vec4>, at: At) {
        let (At::Beside(place) | At::Apart([place, ..])) = at;
        // SAFETY: the caller's promise.
        unsafe { values.set(place, self) };
    }

    #[inline(always)]
    fn transpose(v: [Vec4; 4]) -> Wide3<Vec4> {
        let t = Mat4::from_cols(v[0], v[1], v[2], v[3]).transpose();
        [t.x_axis, t.y_axis, t.z_axis]
    }

    #[inline(always)]
    fn vectors([x, y, z]: Wide3<Vec4>) -> [Vec4; 4] {
        let t = Mat4::from_cols(x, y, z, Vec4::ZERO).transpose();
        [t.x_axis, t.y_axis, t.z_axis, t.w_axis]
    }

    #[inline(always)]
    fn sum(self) -> Vec4 {
        self
    }

    #[inline(always)]
    fn last(self) -> Vec4 {
        Vec4::splat(self.w)
    }

    #[inline(always)]
    fn spread(self) -> [Vec4; 4] {
        [Vec4::splat(self.x), Vec4::splat(self.y), Vec4::splat(self.z), Vec4::splat(self.w)]
    }

    #[inline(always)]
    fn spread_mask(mask: BVec4A) -> [BVec4A; 4] {
        [0, 1, 2, 3].map(|k| BVec4A::splat(mask.test(k)))
    }
}
