//! Numbers side by side, for loops that do the same to many: sixteen with AVX-512, eight with AVX2, four wherever glam runs.
//!
//! Mathematics is written once over [`Lanes`], and is the same for one number (`f32`) as for sixteen. Loops over the cloth are
//! written over [`Registers`]: the state is vectors of four in memory, of which a register holds a quarter as many as it has lanes;
//! four registers are loaded and transposed into all x, all y, all z.
//!
//! Instructions can be enabled for whole functions alone, so all that a [`Loop`] calls is inlined into one function for each
//! width ([`run`]).
//!
//! Why there is no library for this: see `README.md` beside this file.

use std::ops::{Add, Div, Mul, Sub};

use glam::Vec4;

pub(crate) mod aligned;
mod portable;
mod vector;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use vector::Vector;

/// The most lanes that there are. Arrays have room for whole groups of so many, and tiles begin at multiples of it.
pub(crate) const MAX_LANES: usize = 16;

/// How many lanes to compute on: no more than the processor has instructions for, for there is no other way to make one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Width(Instructions);

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
enum Instructions {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Width {
    /// The widest here.
    pub(crate) fn detected() -> Width {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return Width(if is_x86_feature_detected!("avx512f") { Instructions::Avx512 } else { Instructions::Avx2 });
        }
        Width(Instructions::Portable)
    }

    /// All that there are here, the widest last.
    #[cfg(any(test, feature = "bench"))]
    pub(crate) fn all() -> Vec<Width> {
        let mut all = vec![Width(Instructions::Portable)];
        #[cfg(target_arch = "x86_64")]
        all.extend([Width(Instructions::Avx2), Width(Instructions::Avx512)]);
        all.retain(|width| width.0 <= Width::detected().0);
        all
    }

    /// The widest here of no more than so many lanes, or else of the fewest.
    #[cfg(any(test, feature = "bench"))]
    pub(crate) fn at_most(lanes: usize) -> Width {
        Width::all().into_iter().rfind(|width| width.lanes() <= lanes).unwrap_or(Width(Instructions::Portable))
    }

    /// Numbers at once.
    pub(crate) fn lanes(self) -> usize {
        match self.0 {
            Instructions::Portable => 4,
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => 8,
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => 16,
        }
    }
}

/// A loop that is compiled for each width; what it calls must be inlined into it.
pub(crate) trait Loop {
    fn run<L: Registers>(self);
}

/// Runs a loop on so many lanes.
pub(crate) fn run(width: Width, work: impl Loop) {
    match width.0 {
        Instructions::Portable => work.run::<Vec4>(),
        #[cfg(target_arch = "x86_64")]
        _ => x86::run(width, work),
    }
}

/// Numbers side by side.
pub(crate) trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    type Mask: Copy;
    const LANES: usize;
    fn splat(value: f32) -> Self;
    /// `self * by + plus`, rounded once where the machine can.
    fn mul_add(self, by: Self, plus: Self) -> Self;
    /// `plus - self * by`, rounded once where the machine can.
    fn neg_mul_add(self, by: Self, plus: Self) -> Self;
    fn abs(self) -> Self;
    fn sqrt(self) -> Self;
    fn max(self, other: Self) -> Self;
    /// False for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// False for NaN.
    fn eq(self, other: Self) -> Self::Mask;
    fn and(one: Self::Mask, other: Self::Mask) -> Self::Mask;
    fn or(one: Self::Mask, other: Self::Mask) -> Self::Mask;
    fn all(mask: Self::Mask) -> bool;
    /// A bit for each lane, that of the first the lowest.
    fn bits(mask: Self::Mask) -> u32;
    /// `yes` in the lanes of the mask, `no` in the others.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
}

/// Lanes that are a register: a quarter as many vectors of four.
pub(crate) trait Registers: Lanes {
    /// Vectors that a register holds.
    const VECTORS: usize = Self::LANES / 4;
    /// # Panics
    /// If there are not as many as lanes.
    fn from_slice(values: &[f32]) -> Self;
    /// Each of these in all four lanes of its vector.
    ///
    /// # Panics
    /// If there are not as many as vectors.
    fn repeat_each(values: &[f32]) -> Self;
    /// One vector again and again.
    fn repeat(vector: Vec4) -> Self;
    /// The first so many as a register holds.
    fn from_vectors(vectors: [Vec4; 4]) -> Self;
    /// The vectors; what is past those of the register means nothing.
    fn to_vectors(self) -> [Vec4; 4];
    /// # Panics
    /// If there are not as many as vectors.
    fn load(from: &[Vec4]) -> Self;
    /// # Panics
    /// If there are not as many as vectors.
    fn store(self, to: &mut [Vec4]);
    /// The even and the odd ones of twice as many vectors.
    ///
    /// # Panics
    /// If there are not twice as many as vectors.
    fn load_pairs(from: &[Vec4]) -> [Self; 2];
    /// # Panics
    /// If there are not twice as many as vectors.
    fn store_pairs(pairs: [Self; 2], to: &mut [Vec4]);
    /// The x, y and z of the vectors of four registers; lanes as [`vector_of_lane`] says.
    fn transpose(vectors: [Self; 4]) -> Vector<Self>;
    /// The inverse of [`Registers::transpose`], with 0 as fourth.
    fn vectors(numbers: Vector<Self>) -> [Self; 4];
    /// The vectors added up.
    fn sum(self) -> Vec4;
    /// Each vector's w, in all four of its lanes.
    fn w(self) -> Self;
    /// Each number in all four lanes of its vector: register by register as they were transposed.
    fn spread(self) -> [Self; 4];
    fn spread_mask(mask: Self::Mask) -> [Self::Mask; 4];
}

/// Which of so many vectors one after another a lane has, once they are loaded side by side and transposed.
#[inline(always)]
pub(crate) fn vector_of_lane(lane: usize, lanes: usize) -> usize {
    lanes / 4 * (lane % 4) + lane / 4
}
