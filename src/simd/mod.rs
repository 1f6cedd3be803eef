//! SIMD lanes: 16 with AVX-512, 8 with AVX2, 4 elsewhere (wherever glam runs).
//!
//! Mathematics is written once, generic over [`Lanes`], and works for a single number (`f32`) as for 16. Loops over the
//! cloth are generic over [`Registers`]: the state is stored as 4-vectors, of which a register holds a quarter as many
//! as it has lanes. Four registers are loaded and transposed into one each of x, y and z.
//!
//! An instruction set can be enabled only for whole functions, so everything that a [`Loop`] calls is inlined into one
//! function for each width ([`run`]).
//!
//! Why no SIMD library is used: see `README.md` in this directory.

use std::ops::{Add, Div, Mul, Sub};

use glam::Vec4;

pub(crate) mod aligned;
mod portable;
mod vector;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use vector::Vector;

/// The largest number of lanes. Arrays are padded to whole groups of so many, and tiles begin at multiples of it.
pub(crate) const MAX_LANES: usize = 16;

/// The places of the bits that are set, lowest first.
pub(crate) struct Bits(pub u64);

impl Iterator for Bits {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let place = (self.0 != 0).then(|| self.0.trailing_zeros() as usize);
        self.0 &= self.0.wrapping_sub(1);
        place
    }
}

/// The number of lanes to use. Values can be obtained only by detection, so that the processor supports them.
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
    /// The widest that this processor supports.
    pub(crate) fn detected() -> Width {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return Width(if is_x86_feature_detected!("avx512f") { Instructions::Avx512 } else { Instructions::Avx2 });
        }
        Width(Instructions::Portable)
    }

    /// All widths that this processor supports, widest last.
    #[cfg(any(test, feature = "bench"))]
    pub(crate) fn all() -> Vec<Width> {
        let mut all = vec![Width(Instructions::Portable)];
        #[cfg(target_arch = "x86_64")]
        all.extend([Width(Instructions::Avx2), Width(Instructions::Avx512)]);
        all.retain(|width| width.0 <= Width::detected().0);
        all
    }

    /// The widest supported with at most `lanes` lanes, or the narrowest there is.
    #[cfg(any(test, feature = "bench"))]
    pub(crate) fn at_most(lanes: usize) -> Width {
        Width::all().into_iter().rfind(|width| width.lanes() <= lanes).unwrap_or(Width(Instructions::Portable))
    }

    /// Number of f32 lanes.
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

/// A loop that is compiled once for each width. Everything it calls must be inlined into it.
pub(crate) trait Loop {
    fn run<L: Registers>(self);
}

/// Runs a loop at the given width.
pub(crate) fn run(width: Width, work: impl Loop) {
    match width.0 {
        Instructions::Portable => work.run::<Vec4>(),
        #[cfg(target_arch = "x86_64")]
        _ => x86::run(width, work),
    }
}

/// A group of numbers on which the same operations are done: one per lane.
pub(crate) trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    type Mask: Copy;
    const LANES: usize;
    fn splat(value: f32) -> Self;
    /// `self * by + plus`, with a single rounding (fused) where the instruction set has it.
    fn mul_add(self, by: Self, plus: Self) -> Self;
    /// `plus - self * by`, with a single rounding (fused) where the instruction set has it.
    fn neg_mul_add(self, by: Self, plus: Self) -> Self;
    fn abs(self) -> Self;
    fn sqrt(self) -> Self;
    /// If one of them is NaN, the result depends on the width.
    fn max(self, other: Self) -> Self;
    /// `other` if either is NaN.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(self.lt(other), self, other)
    }
    /// False if either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// False if either is NaN.
    fn eq(self, other: Self) -> Self::Mask;
    fn and(one: Self::Mask, other: Self::Mask) -> Self::Mask;
    fn or(one: Self::Mask, other: Self::Mask) -> Self::Mask;
    fn all(mask: Self::Mask) -> bool;
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }
    /// One bit per lane, the first lane in the lowest bit.
    fn bits(mask: Self::Mask) -> u32;
    /// `yes` in the lanes of the mask, `no` in the others.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
}

/// Lanes that fill a register, which holds a quarter as many 4-vectors.
pub(crate) trait Registers: Lanes {
    /// Number of 4-vectors in a register.
    const VECTORS: usize = Self::LANES / 4;
    /// One value per lane.
    ///
    /// # Panics
    /// If the slice does not have as many values as lanes.
    fn from_slice(values: &[f32]) -> Self;
    /// Each value repeated in all four lanes of its 4-vector.
    ///
    /// # Panics
    /// If the slice does not have as many values as 4-vectors.
    fn repeat_each(values: &[f32]) -> Self;
    /// The same 4-vector repeated.
    fn repeat(vector: Vec4) -> Self;
    /// The first [`Registers::VECTORS`] of four 4-vectors.
    fn from_vectors(vectors: [Vec4; 4]) -> Self;
    /// The 4-vectors of the register; any beyond their number are unspecified.
    fn to_vectors(self) -> [Vec4; 4];
    /// # Panics
    /// If the slice does not have as many vectors as the register.
    fn load(from: &[Vec4]) -> Self;
    /// # Panics
    /// If the slice does not have as many vectors as the register.
    fn store(self, to: &mut [Vec4]);
    /// The vectors at even and at odd positions of a slice of twice as many as the register holds.
    ///
    /// # Panics
    /// If the slice does not have twice as many vectors as the register.
    fn load_pairs(from: &[Vec4]) -> [Self; 2];
    /// The inverse of [`Registers::load_pairs`].
    ///
    /// # Panics
    /// If the slice does not have twice as many vectors as the register.
    fn store_pairs(pairs: [Self; 2], to: &mut [Vec4]);
    /// Four vectors for each lane, by their places. Of each of the four, the `k`th register has those of the lanes `k`, `k + 4`
    /// and so on, as [`Registers::transpose`] takes them.
    ///
    /// # Panics
    /// If there are not as many rows of places as lanes, or if a place is outside.
    #[inline(always)]
    fn gather(from: &[Vec4], places: &[[u32; 4]]) -> [[Self; 4]; 4] {
        assert!(places.len() == Self::LANES, "a row a lane");
        let mut all = [[Self::splat(0.0); 4]; 4];
        for corner in 0..4 {
            for k in 0..4 {
                let mut vectors = [from[places[k][corner] as usize]; 4];
                for index in 1..Self::VECTORS {
                    vectors[index] = from[places[k + 4 * index][corner] as usize];
                }
                all[corner][k] = Self::from_vectors(vectors);
            }
        }
        all
    }
    /// The x, y and z of the vectors in four registers; [`vector_of_lane`] tells the order of the lanes.
    fn transpose(vectors: [Self; 4]) -> Vector<Self>;
    /// The w of the same vectors.
    fn fourth(vectors: [Self; 4]) -> Self;
    /// The inverse of [`Registers::transpose`], with 0 as the fourth component.
    fn vectors(numbers: Vector<Self>) -> [Self; 4];
    /// The sum of the register's 4-vectors.
    fn sum(self) -> Vec4;
    /// Each vector's w, in all four of its lanes.
    fn w(self) -> Self;
    /// Each lane's number repeated over the four lanes of its vector, in the layout before [`Registers::transpose`].
    fn spread(self) -> [Self; 4];
    /// The same for a mask.
    fn spread_mask(mask: Self::Mask) -> [Self::Mask; 4];
}

/// The position of the vector that a lane holds, among `lanes` contiguous vectors loaded and transposed.
#[inline(always)]
pub(crate) fn vector_of_lane(lane: usize, lanes: usize) -> usize {
    lanes / 4 * (lane % 4) + lane / 4
}

/// As many consecutive vectors as there are lanes. If `from` has fewer, the last one is repeated.
#[inline(always)]
pub(crate) fn load_vectors<L: Registers>(from: &[Vec4]) -> [L; 4] {
    let mut padded = [Vec4::ZERO; MAX_LANES];
    let mut all = from;
    if from.len() < L::LANES {
        padded.fill(from[from.len() - 1]);
        padded[..from.len()].copy_from_slice(from);
        all = &padded;
    }
    let each = L::VECTORS;
    [L::load(&all[..each]), L::load(&all[each..2 * each]), L::load(&all[2 * each..3 * each]), L::load(&all[3 * each..4 * each])]
}

/// The inverse of [`load_vectors`].
#[inline(always)]
pub(crate) fn store_vectors<L: Registers>(vectors: [L; 4], to: &mut [Vec4]) {
    let mut all = [Vec4::ZERO; MAX_LANES];
    for k in 0..4 {
        vectors[k].store(&mut all[k * L::VECTORS..(k + 1) * L::VECTORS]);
    }
    to.copy_from_slice(&all[..to.len()]);
}

#[cfg(test)]
#[path = "../../tests/unit/simd.rs"]
mod tests;
