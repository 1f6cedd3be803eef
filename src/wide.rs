//! Numbers side by side, for loops that do the same to many: eight with AVX2, four wherever glam runs.
//!
//! What is computed is written once over [`Wide`]; a function that enables the instructions calls it, so everything here is
//! inlined into that.

#![allow(clippy::inline_always, reason = "instructions can be enabled for whole functions alone")]

use std::ops::{Add, Div, Mul, Sub};

use glam::{BVec4A, Mat4, Vec4};

/// Numbers side by side.
pub(crate) trait Wide: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    type Mask: Copy;
    fn splat(value: f32) -> Self;
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
    fn all(mask: Self::Mask) -> bool;
    fn choose(mask: Self::Mask, yes: Self, no: Self) -> Self;
}

/// Which of eight vectors one after another each lane has, once they are loaded by twos and transposed.
pub(crate) const IN_ROW: [usize; 8] = [0, 2, 4, 6, 1, 3, 5, 7];

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

/// Four on any machine.
impl Wide for Vec4 {
    type Mask = BVec4A;

    #[inline(always)]
    fn splat(value: f32) -> Vec4 {
        Vec4::splat(value)
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
    fn all(mask: BVec4A) -> bool {
        mask.all()
    }

    #[inline(always)]
    fn choose(mask: BVec4A, yes: Vec4, no: Vec4) -> Vec4 {
        Vec4::select(mask, yes, no)
    }
}

/// The x, y and z of four vectors, each as four numbers.
#[inline(always)]
pub(crate) fn transpose(v: [Vec4; 4]) -> Wide3<Vec4> {
    let t = Mat4::from_cols(v[0], v[1], v[2], v[3]).transpose();
    [t.x_axis, t.y_axis, t.z_axis]
}

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::{Eight, Two};

#[cfg(target_arch = "x86_64")]
mod avx2 {
    #[allow(clippy::wildcard_imports, reason = "the instruction set is the vocabulary here")]
    use std::arch::x86_64::*;
    use std::ops::{Add, Div, Mul, Sub};

    use glam::Vec4;

    use super::{Wide, Wide3};
    use crate::crew::Shared;

    /// Where two vertices are: both from one place on, or each somewhere.
    #[derive(Debug, Clone, Copy)]
    pub(crate) enum Two {
        Beside(usize),
        Apart(usize, usize),
    }

    /// Eight with AVX2 and FMA. Whoever makes one knows that the processor has both.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Eight(pub __m256);

    macro_rules! operator {
        ($operator:ident, $name:ident, $instruction:ident) => {
            #[expect(unsafe_code, reason = "see Eight")]
            impl $operator for Eight {
                type Output = Eight;
                #[inline(always)]
                fn $name(self, other: Eight) -> Eight {
                    // SAFETY: see Eight.
                    Eight(unsafe { $instruction(self.0, other.0) })
                }
            }
        };
    }
    operator!(Add, add, _mm256_add_ps);
    operator!(Sub, sub, _mm256_sub_ps);
    operator!(Mul, mul, _mm256_mul_ps);
    operator!(Div, div, _mm256_div_ps);

    // SAFETY of each block: see Eight.
    #[expect(unsafe_code, reason = "see Eight")]
    #[allow(clippy::undocumented_unsafe_blocks, reason = "said once, above")]
    impl Wide for Eight {
        type Mask = Eight;

        #[inline(always)]
        fn splat(value: f32) -> Eight {
            Eight(unsafe { _mm256_set1_ps(value) })
        }

        #[inline(always)]
        fn times_plus(self, by: Eight, to: Eight) -> Eight {
            Eight(unsafe { _mm256_fmadd_ps(self.0, by.0, to.0) })
        }

        #[inline(always)]
        fn times_from(self, by: Eight, to: Eight) -> Eight {
            Eight(unsafe { _mm256_fnmadd_ps(self.0, by.0, to.0) })
        }

        #[inline(always)]
        fn abs(self) -> Eight {
            Eight(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }

        #[inline(always)]
        fn sqrt(self) -> Eight {
            Eight(unsafe { _mm256_sqrt_ps(self.0) })
        }

        #[inline(always)]
        fn max(self, other: Eight) -> Eight {
            Eight(unsafe { _mm256_max_ps(self.0, other.0) })
        }

        #[inline(always)]
        fn below(self, other: Eight) -> Eight {
            Eight(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) })
        }

        #[inline(always)]
        fn is(self, other: Eight) -> Eight {
            Eight(unsafe { _mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, other.0) })
        }

        #[inline(always)]
        fn both(one: Eight, other: Eight) -> Eight {
            Eight(unsafe { _mm256_and_ps(one.0, other.0) })
        }

        #[inline(always)]
        fn all(mask: Eight) -> bool {
            unsafe { _mm256_movemask_ps(mask.0) == 0xff }
        }

        #[inline(always)]
        fn choose(mask: Eight, yes: Eight, no: Eight) -> Eight {
            Eight(unsafe { _mm256_blendv_ps(no.0, yes.0, mask.0) })
        }
    }

    #[expect(unsafe_code, reason = "see Eight")]
    #[allow(clippy::undocumented_unsafe_blocks, reason = "said once, above")]
    impl Eight {
        /// The x, y and z of eight vectors, of which `v[k]` holds two; in the order first of each, second of each.
        #[inline(always)]
        pub(crate) fn transpose(v: [Eight; 4]) -> Wide3<Eight> {
            unsafe {
                let (xy01, zw01) = (_mm256_unpacklo_ps(v[0].0, v[1].0), _mm256_unpackhi_ps(v[0].0, v[1].0));
                let (xy23, zw23) = (_mm256_unpacklo_ps(v[2].0, v[3].0), _mm256_unpackhi_ps(v[2].0, v[3].0));
                [
                    Eight(_mm256_shuffle_ps::<0x44>(xy01, xy23)),
                    Eight(_mm256_shuffle_ps::<0xee>(xy01, xy23)),
                    Eight(_mm256_shuffle_ps::<0x44>(zw01, zw23)),
                ]
            }
        }

        #[inline(always)]
        pub(crate) fn from_array(values: &[f32; 8]) -> Eight {
            Eight(unsafe { _mm256_loadu_ps(values.as_ptr()) })
        }

        /// Two vectors side by side.
        ///
        /// # Safety
        /// They are there, and nobody writes them meanwhile.
        #[inline(always)]
        pub(crate) unsafe fn load(values: Shared<Vec4>, at: Two) -> Eight {
            unsafe {
                let pointer = |vertex: usize| values.pointer().add(vertex).cast::<f32>();
                Eight(match at {
                    Two::Beside(first) => _mm256_loadu_ps(pointer(first)),
                    Two::Apart(low, high) => {
                        let low = _mm256_castps128_ps256(_mm_load_ps(pointer(low)));
                        _mm256_insertf128_ps::<1>(low, _mm_load_ps(pointer(high)))
                    }
                })
            }
        }

        /// # Safety
        /// As [`Eight::load`], and nobody reads there meanwhile.
        #[inline(always)]
        pub(crate) unsafe fn store(self, values: Shared<Vec4>, at: Two) {
            unsafe {
                let pointer = |vertex: usize| values.pointer().add(vertex).cast::<f32>();
                match at {
                    Two::Beside(first) => _mm256_storeu_ps(pointer(first), self.0),
                    Two::Apart(low, high) => {
                        // If one repeats the other, with no share, it is the higher: what it stores must not last.
                        _mm_store_ps(pointer(high), _mm256_extractf128_ps::<1>(self.0));
                        _mm_store_ps(pointer(low), _mm256_castps256_ps128(self.0));
                    }
                }
            }
        }

        /// The inverse of [`Eight::transpose`], with 0 as fourth.
        #[inline(always)]
        pub(crate) fn vectors([x, y, z]: Wide3<Eight>) -> [Eight; 4] {
            unsafe {
                let zero = _mm256_setzero_ps();
                let (xy_low, xy_high) = (_mm256_unpacklo_ps(x.0, y.0), _mm256_unpackhi_ps(x.0, y.0));
                let (z_low, z_high) = (_mm256_unpacklo_ps(z.0, zero), _mm256_unpackhi_ps(z.0, zero));
                [
                    Eight(_mm256_shuffle_ps::<0x44>(xy_low, z_low)),
                    Eight(_mm256_shuffle_ps::<0xee>(xy_low, z_low)),
                    Eight(_mm256_shuffle_ps::<0x44>(xy_high, z_high)),
                    Eight(_mm256_shuffle_ps::<0xee>(xy_high, z_high)),
                ]
            }
        }

        /// Each number four times over: `[k]` has one for each of the two vectors in [`Eight::transpose`]'s `v[k]`.
        #[inline(always)]
        pub(crate) fn spread(self) -> [Eight; 4] {
            unsafe {
                [
                    Eight(_mm256_permute_ps::<0x00>(self.0)),
                    Eight(_mm256_permute_ps::<0x55>(self.0)),
                    Eight(_mm256_permute_ps::<0xaa>(self.0)),
                    Eight(_mm256_permute_ps::<0xff>(self.0)),
                ]
            }
        }
    }
}
