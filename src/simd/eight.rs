//! Eight numbers, or two vectors, in a register of AVX2.

#[allow(clippy::wildcard_imports, reason = "the instruction set is the vocabulary here")]
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

use glam::Vec4;

use super::{At, Wide, Wide3};
use crate::cpu::shared::Shared;

/// See the module; FMA is there too.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eight(pub __m256);

macro_rules! operator {
    ($operator:ident, $name:ident, $instruction:ident) => {
        #[expect(unsafe_code, reason = "see Wide")]
        impl $operator for Eight {
            type Output = Eight;
            #[inline(always)]
            fn $name(self, other: Eight) -> Eight {
                // SAFETY: see Wide.
                Eight(unsafe { $instruction(self.0, other.0) })
            }
        }
    };
}
operator!(Add, add, _mm256_add_ps);
operator!(Sub, sub, _mm256_sub_ps);
operator!(Mul, mul, _mm256_mul_ps);
operator!(Div, div, _mm256_div_ps);

// SAFETY of each block: see Wide.
#[expect(unsafe_code, reason = "see Wide")]
#[allow(clippy::undocumented_unsafe_blocks, reason = "said once, above")]
impl Wide for Eight {
    type Mask = Eight;
    const LANES: usize = 8;

    #[inline(always)]
    fn splat(value: f32) -> Eight {
        Eight(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn repeat(vector: Vec4) -> Eight {
        Eight(unsafe { _mm256_broadcast_ps(&vector.into()) })
    }

    #[inline(always)]
    fn each(values: &[f32]) -> Eight {
        Eight(unsafe { _mm256_set_m128(_mm_set1_ps(values[1]), _mm_set1_ps(values[0])) })
    }

    #[inline(always)]
    fn from_slice(values: &[f32]) -> Eight {
        assert!(values.len() == 8, "a number a lane");
        Eight(unsafe { _mm256_loadu_ps(values.as_ptr()) })
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
    fn either(one: Eight, other: Eight) -> Eight {
        Eight(unsafe { _mm256_or_ps(one.0, other.0) })
    }

    #[inline(always)]
    fn all(mask: Eight) -> bool {
        unsafe { _mm256_movemask_ps(mask.0) == 0xff }
    }

    #[inline(always)]
    fn choose(mask: Eight, yes: Eight, no: Eight) -> Eight {
        Eight(unsafe { _mm256_blendv_ps(no.0, yes.0, mask.0) })
    }

    #[inline(always)]
    unsafe fn load(values: Shared<Vec4>, at: At) -> Eight {
        let pointer = |vertex: usize| values.pointer().wrapping_add(vertex).cast::<f32>();
        Eight(unsafe {
            match at {
                At::Beside(first) => _mm256_loadu_ps(pointer(first)),
                At::Apart([low, high, ..]) => {
                    let low = _mm256_castps128_ps256(_mm_load_ps(pointer(low)));
                    _mm256_insertf128_ps::<1>(low, _mm_load_ps(pointer(high)))
                }
            }
        })
    }

    #[inline(always)]
    unsafe fn store(self, values: Shared<Vec4>, at: At) {
        let pointer = |vertex: usize| values.pointer().wrapping_add(vertex).cast::<f32>();
        unsafe {
            match at {
                At::Beside(first) => _mm256_storeu_ps(pointer(first), self.0),
                At::Apart([low, high, ..]) => {
                    _mm_store_ps(pointer(high), _mm256_extractf128_ps::<1>(self.0));
                    _mm_store_ps(pointer(low), _mm256_castps256_ps128(self.0));
                }
            }
        }
    }

    #[inline(always)]
    fn transpose([a, b, c, d]: [Eight; 4]) -> Wide3<Eight> {
        unsafe {
            let (xy_low, xy_high) = (_mm256_unpacklo_ps(a.0, b.0), _mm256_unpacklo_ps(c.0, d.0));
            let (zw_low, zw_high) = (_mm256_unpackhi_ps(a.0, b.0), _mm256_unpackhi_ps(c.0, d.0));
            [
                Eight(_mm256_shuffle_ps::<0x44>(xy_low, xy_high)),
                Eight(_mm256_shuffle_ps::<0xee>(xy_low, xy_high)),
                Eight(_mm256_shuffle_ps::<0x44>(zw_low, zw_high)),
            ]
        }
    }

    #[inline(always)]
    fn vectors([x, y, z]: Wide3<Eight>) -> [Eight; 4] {
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

    #[inline(always)]
    fn sum(self) -> Vec4 {
        unsafe { _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0)) }.into()
    }

    #[inline(always)]
    fn last(self) -> Eight {
        Eight(unsafe { _mm256_permute_ps::<0xff>(self.0) })
    }

    #[inline(always)]
    fn spread(self) -> [Eight; 4] {
        unsafe {
            [
                Eight(_mm256_permute_ps::<0x00>(self.0)),
                Eight(_mm256_permute_ps::<0x55>(self.0)),
                Eight(_mm256_permute_ps::<0xaa>(self.0)),
                Eight(_mm256_permute_ps::<0xff>(self.0)),
            ]
        }
    }

    #[inline(always)]
    fn spread_mask(mask: Eight) -> [Eight; 4] {
        mask.spread()
    }
}
