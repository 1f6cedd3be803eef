//! Sixteen numbers, or four vectors, in a register of AVX-512.

#[allow(clippy::wildcard_imports, reason = "the instruction set is the vocabulary here")]
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

use glam::Vec4;

use super::{At, Wide, Wide3};
use crate::cpu::shared::Shared;

/// See the module; no more than AVX-512F is asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sixteen(pub __m512);

macro_rules! operator {
    ($operator:ident, $name:ident, $instruction:ident) => {
        #[expect(unsafe_code, reason = "see Wide")]
        impl $operator for Sixteen {
            type Output = Sixteen;
            #[inline(always)]
            fn $name(self, other: Sixteen) -> Sixteen {
                // SAFETY: see Wide.
                Sixteen(unsafe { $instruction(self.0, other.0) })
            }
        }
    };
}
operator!(Add, add, _mm512_add_ps);
operator!(Sub, sub, _mm512_sub_ps);
operator!(Mul, mul, _mm512_mul_ps);
operator!(Div, div, _mm512_div_ps);

// SAFETY of each block: see Wide.
#[expect(unsafe_code, reason = "see Wide")]
#[allow(clippy::undocumented_unsafe_blocks, reason = "said once, above")]
impl Wide for Sixteen {
    type Mask = __mmask16;
    const LANES: usize = 16;

    #[inline(always)]
    fn splat(value: f32) -> Sixteen {
        Sixteen(unsafe { _mm512_set1_ps(value) })
    }

    #[inline(always)]
    fn repeat(vector: Vec4) -> Sixteen {
        Sixteen(unsafe { _mm512_broadcast_f32x4(vector.into()) })
    }

    #[inline(always)]
    fn each(values: &[f32]) -> Sixteen {
        assert!(values.len() == 4, "a number a vector");
        let of = unsafe { _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3) };
        Sixteen(unsafe { _mm512_permutexvar_ps(of, _mm512_castps128_ps512(_mm_loadu_ps(values.as_ptr()))) })
    }

    #[inline(always)]
    fn from_slice(values: &[f32]) -> Sixteen {
        assert!(values.len() == 16, "a number a lane");
        Sixteen(unsafe { _mm512_loadu_ps(values.as_ptr()) })
    }

    #[inline(always)]
    fn times_plus(self, by: Sixteen, to: Sixteen) -> Sixteen {
        Sixteen(unsafe { _mm512_fmadd_ps(self.0, by.0, to.0) })
    }

    #[inline(always)]
    fn times_from(self, by: Sixteen, to: Sixteen) -> Sixteen {
        Sixteen(unsafe { _mm512_fnmadd_ps(self.0, by.0, to.0) })
    }

    #[inline(always)]
    fn abs(self) -> Sixteen {
        Sixteen(unsafe { _mm512_abs_ps(self.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Sixteen {
        Sixteen(unsafe { _mm512_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn max(self, other: Sixteen) -> Sixteen {
        Sixteen(unsafe { _mm512_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn below(self, other: Sixteen) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
    }

    #[inline(always)]
    fn is(self, other: Sixteen) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, other.0) }
    }

    #[inline(always)]
    fn both(one: __mmask16, other: __mmask16) -> __mmask16 {
        one & other
    }

    #[inline(always)]
    fn either(one: __mmask16, other: __mmask16) -> __mmask16 {
        one | other
    }

    #[inline(always)]
    fn all(mask: __mmask16) -> bool {
        mask == !0
    }

    #[inline(always)]
    fn choose(mask: __mmask16, yes: Sixteen, no: Sixteen) -> Sixteen {
        Sixteen(unsafe { _mm512_mask_blend_ps(mask, no.0, yes.0) })
    }

    #[inline(always)]
    unsafe fn load(values: Shared<Vec4>, at: At) -> Sixteen {
        let pointer = |vertex: usize| values.pointer().wrapping_add(vertex).cast::<f32>();
        Sixteen(unsafe {
            match at {
                At::Beside(first) => _mm512_loadu_ps(pointer(first)),
                At::Apart([a, b, c, d]) => {
                    let all = _mm512_castps128_ps512(_mm_load_ps(pointer(a)));
                    let all = _mm512_insertf32x4::<1>(all, _mm_load_ps(pointer(b)));
                    let all = _mm512_insertf32x4::<2>(all, _mm_load_ps(pointer(c)));
                    _mm512_insertf32x4::<3>(all, _mm_load_ps(pointer(d)))
                }
            }
        })
    }

    #[inline(always)]
    unsafe fn store(self, values: Shared<Vec4>, at: At) {
        let pointer = |vertex: usize| values.pointer().wrapping_add(vertex).cast::<f32>();
        unsafe {
            match at {
                At::Beside(first) => _mm512_storeu_ps(pointer(first), self.0),
                At::Apart([a, b, c, d]) => {
                    _mm_store_ps(pointer(d), _mm512_extractf32x4_ps::<3>(self.0));
                    _mm_store_ps(pointer(c), _mm512_extractf32x4_ps::<2>(self.0));
                    _mm_store_ps(pointer(b), _mm512_extractf32x4_ps::<1>(self.0));
                    _mm_store_ps(pointer(a), _mm512_castps512_ps128(self.0));
                }
            }
        }
    }

    #[inline(always)]
    unsafe fn load_pairs(values: Shared<Vec4>, first: usize) -> [Sixteen; 2] {
        unsafe {
            let (low, high) = (Sixteen::load(values, At::Beside(first)), Sixteen::load(values, At::Beside(first + 4)));
            [Sixteen(_mm512_shuffle_f32x4::<0x88>(low.0, high.0)), Sixteen(_mm512_shuffle_f32x4::<0xdd>(low.0, high.0))]
        }
    }

    #[inline(always)]
    unsafe fn store_pairs([a, b]: [Sixteen; 2], values: Shared<Vec4>, first: usize) {
        unsafe {
            let (a, b) = (_mm512_castps_pd(a.0), _mm512_castps_pd(b.0));
            let low = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
            let high = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
            Sixteen(_mm512_castpd_ps(_mm512_permutex2var_pd(a, low, b))).store(values, At::Beside(first));
            Sixteen(_mm512_castpd_ps(_mm512_permutex2var_pd(a, high, b))).store(values, At::Beside(first + 4));
        }
    }

    #[inline(always)]
    fn transpose([a, b, c, d]: [Sixteen; 4]) -> Wide3<Sixteen> {
        unsafe {
            let (xy_low, xy_high) = (_mm512_unpacklo_ps(a.0, b.0), _mm512_unpacklo_ps(c.0, d.0));
            let (zw_low, zw_high) = (_mm512_unpackhi_ps(a.0, b.0), _mm512_unpackhi_ps(c.0, d.0));
            [
                Sixteen(_mm512_shuffle_ps::<0x44>(xy_low, xy_high)),
                Sixteen(_mm512_shuffle_ps::<0xee>(xy_low, xy_high)),
                Sixteen(_mm512_shuffle_ps::<0x44>(zw_low, zw_high)),
            ]
        }
    }

    #[inline(always)]
    fn vectors([x, y, z]: Wide3<Sixteen>) -> [Sixteen; 4] {
        unsafe {
            let zero = _mm512_setzero_ps();
            let (xy_low, xy_high) = (_mm512_unpacklo_ps(x.0, y.0), _mm512_unpackhi_ps(x.0, y.0));
            let (z_low, z_high) = (_mm512_unpacklo_ps(z.0, zero), _mm512_unpackhi_ps(z.0, zero));
            [
                Sixteen(_mm512_shuffle_ps::<0x44>(xy_low, z_low)),
                Sixteen(_mm512_shuffle_ps::<0xee>(xy_low, z_low)),
                Sixteen(_mm512_shuffle_ps::<0x44>(xy_high, z_high)),
                Sixteen(_mm512_shuffle_ps::<0xee>(xy_high, z_high)),
            ]
        }
    }

    #[inline(always)]
    fn sum(self) -> Vec4 {
        unsafe {
            let low = _mm_add_ps(_mm512_castps512_ps128(self.0), _mm512_extractf32x4_ps::<1>(self.0));
            let high = _mm_add_ps(_mm512_extractf32x4_ps::<2>(self.0), _mm512_extractf32x4_ps::<3>(self.0));
            _mm_add_ps(low, high)
        }
        .into()
    }

    #[inline(always)]
    fn last(self) -> Sixteen {
        Sixteen(unsafe { _mm512_permute_ps::<0xff>(self.0) })
    }

    #[inline(always)]
    fn spread(self) -> [Sixteen; 4] {
        unsafe {
            [
                Sixteen(_mm512_permute_ps::<0x00>(self.0)),
                Sixteen(_mm512_permute_ps::<0x55>(self.0)),
                Sixteen(_mm512_permute_ps::<0xaa>(self.0)),
                Sixteen(_mm512_permute_ps::<0xff>(self.0)),
            ]
        }
    }

    #[inline(always)]
    fn spread_mask(mask: __mmask16) -> [__mmask16; 4] {
        // Bit `k` of each four, four times over.
        [0, 1, 2, 3].map(|k| (mask >> k & 0x1111) * 0xf)
    }
}
