//! Registers of eight lanes with AVX2, and of sixteen with AVX-512.
//!
//! One of the crate's two pieces of unsafe code. It rests on one invariant:
//!
//! - **Detected**: [`F32x8`] and [`F32x16`] are private to this file, and their methods run only within [`run`], which
//!   is given a [`Width`]. Widths are made only by [`Width::detected`] and what is derived from it, so they name no
//!   instructions that the processor lacks. This would break if one of the types were used elsewhere, or if a width
//!   were made without asking the processor.

#![expect(unsafe_code, reason = "instruction sets")]

#[allow(clippy::wildcard_imports, reason = "the instruction set is the vocabulary here")]
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

use glam::Vec4;

use super::{Instructions, Lanes, Loop, Registers, Vector, Width};

/// Runs a loop at a width beyond the baseline of x86-64.
pub(super) fn run(width: Width, work: impl Loop) {
    #[target_feature(enable = "avx512f,avx2,fma")]
    fn avx512(work: impl Loop) {
        work.run::<F32x16>();
    }
    #[target_feature(enable = "avx2,fma")]
    fn avx2(work: impl Loop) {
        work.run::<F32x8>();
    }
    // SAFETY: Detected.
    unsafe {
        match width.0 {
            Instructions::Avx512 => avx512(work),
            Instructions::Avx2 => avx2(work),
            Instructions::Portable => work.run::<Vec4>(),
        }
    }
}

/// Defines inlined functions whose bodies are intrinsics.
macro_rules! instructions {
    ($(fn $name:ident $arguments:tt -> $result:ty { $($body:tt)* })*) => {$(
        #[inline(always)]
        fn $name $arguments -> $result {
            // SAFETY: Detected; slices that are loaded from or stored to are asserted to be as long as the register, and places
            // in slices to be inside.
            unsafe { $($body)* }
        }
    )*};
}

/// The `k`th register of the given corner: see [`Registers::gather`]. It must be known that the places are inside.
macro_rules! gathered {
    ($lanes:tt, $from:ident, $places:ident, $corner:literal) => {
        [
            gathered!($lanes, $from, $places, $corner, 0),
            gathered!($lanes, $from, $places, $corner, 1),
            gathered!($lanes, $from, $places, $corner, 2),
            gathered!($lanes, $from, $places, $corner, 3),
        ]
    };
    (8, $from:ident, $places:ident, $corner:literal, $k:literal) => {
        F32x8(_mm256_insertf128_ps::<1>(
            _mm256_castps128_ps256(_mm_loadu_ps($from.add($places[$k][$corner] as usize).cast())),
            _mm_loadu_ps($from.add($places[$k + 4][$corner] as usize).cast()),
        ))
    };
    (16, $from:ident, $places:ident, $corner:literal, $k:literal) => {{
        let low = _mm512_castps128_ps512(_mm_loadu_ps($from.add($places[$k][$corner] as usize).cast()));
        let low = _mm512_insertf32x4::<1>(low, _mm_loadu_ps($from.add($places[$k + 4][$corner] as usize).cast()));
        let low = _mm512_insertf32x4::<2>(low, _mm_loadu_ps($from.add($places[$k + 8][$corner] as usize).cast()));
        F32x16(_mm512_insertf32x4::<3>(low, _mm_loadu_ps($from.add($places[$k + 12][$corner] as usize).cast())))
    }};
}

/// Defines arithmetic operators by one intrinsic each.
macro_rules! operators {
    ($register:ident, $($operator:ident, $name:ident, $instruction:ident;)*) => {$(
        impl $operator for $register {
            type Output = $register;
            instructions! {
                fn $name(self, other: $register) -> $register { $register($instruction(self.0, other.0)) }
            }
        }
    )*};
}

/// Defines what moves numbers within each vector of four lanes.
macro_rules! shuffles {
    ($register:ident, $low:ident, $high:ident, $shuffle:ident, $permute:ident, $zero:ident) => {
        instructions! {
            fn transpose([a, b, c, d]: [$register; 4]) -> Vector<$register> {
                let (xy_low, xy_high) = ($low(a.0, b.0), $low(c.0, d.0));
                let (zw_low, zw_high) = ($high(a.0, b.0), $high(c.0, d.0));
                Vector {
                    x: $register($shuffle::<0x44>(xy_low, xy_high)),
                    y: $register($shuffle::<0xee>(xy_low, xy_high)),
                    z: $register($shuffle::<0x44>(zw_low, zw_high)),
                }
            }
            fn fourth([a, b, c, d]: [$register; 4]) -> $register {
                $register($shuffle::<0xee>($high(a.0, b.0), $high(c.0, d.0)))
            }
            fn vectors(v: Vector<$register>) -> [$register; 4] {
                let zero = $zero();
                let (xy_low, xy_high) = ($low(v.x.0, v.y.0), $high(v.x.0, v.y.0));
                let (z_low, z_high) = ($low(v.z.0, zero), $high(v.z.0, zero));
                [
                    $register($shuffle::<0x44>(xy_low, z_low)),
                    $register($shuffle::<0xee>(xy_low, z_low)),
                    $register($shuffle::<0x44>(xy_high, z_high)),
                    $register($shuffle::<0xee>(xy_high, z_high)),
                ]
            }
            fn w(self) -> $register { $register($permute::<0xff>(self.0)) }
            fn spread(self) -> [$register; 4] {
                [
                    $register($permute::<0x00>(self.0)),
                    $register($permute::<0x55>(self.0)),
                    $register($permute::<0xaa>(self.0)),
                    $register($permute::<0xff>(self.0)),
                ]
            }
        }
    };
}

/// Eight lanes: AVX2 with FMA.
#[derive(Debug, Clone, Copy)]
struct F32x8(__m256);

/// Sixteen lanes: AVX-512F.
#[derive(Debug, Clone, Copy)]
struct F32x16(__m512);

operators! { F32x8, Add, add, _mm256_add_ps; Sub, sub, _mm256_sub_ps; Mul, mul, _mm256_mul_ps; Div, div, _mm256_div_ps; }
operators! { F32x16, Add, add, _mm512_add_ps; Sub, sub, _mm512_sub_ps; Mul, mul, _mm512_mul_ps; Div, div, _mm512_div_ps; }

impl Lanes for F32x8 {
    type Mask = F32x8;
    const LANES: usize = 8;

    instructions! {
        fn splat(value: f32) -> F32x8 { F32x8(_mm256_set1_ps(value)) }
        fn mul_add(self, by: F32x8, plus: F32x8) -> F32x8 { F32x8(_mm256_fmadd_ps(self.0, by.0, plus.0)) }
        fn neg_mul_add(self, by: F32x8, plus: F32x8) -> F32x8 { F32x8(_mm256_fnmadd_ps(self.0, by.0, plus.0)) }
        fn abs(self) -> F32x8 { F32x8(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0)) }
        fn sqrt(self) -> F32x8 { F32x8(_mm256_sqrt_ps(self.0)) }
        fn max(self, other: F32x8) -> F32x8 { F32x8(_mm256_max_ps(self.0, other.0)) }
        fn lt(self, other: F32x8) -> F32x8 { F32x8(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) }
        fn eq(self, other: F32x8) -> F32x8 { F32x8(_mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, other.0)) }
        fn and(one: F32x8, other: F32x8) -> F32x8 { F32x8(_mm256_and_ps(one.0, other.0)) }
        fn or(one: F32x8, other: F32x8) -> F32x8 { F32x8(_mm256_or_ps(one.0, other.0)) }
        fn all(mask: F32x8) -> bool { _mm256_movemask_ps(mask.0) == 0xff }
        fn bits(mask: F32x8) -> u32 { _mm256_movemask_ps(mask.0).cast_unsigned() }
        fn select(mask: F32x8, yes: F32x8, no: F32x8) -> F32x8 { F32x8(_mm256_blendv_ps(no.0, yes.0, mask.0)) }
    }
}

impl Registers for F32x8 {
    instructions! {
        fn from_slice(values: &[f32]) -> F32x8 {
            assert!(values.len() == 8, "a number a lane");
            F32x8(_mm256_loadu_ps(values.as_ptr()))
        }
        fn repeat_each(values: &[f32]) -> F32x8 {
            F32x8(_mm256_set_m128(_mm_set1_ps(values[1]), _mm_set1_ps(values[0])))
        }
        fn repeat(vector: Vec4) -> F32x8 { F32x8(_mm256_broadcast_ps(&vector.into())) }
        fn from_vectors([a, b, _, _]: [Vec4; 4]) -> F32x8 {
            F32x8(_mm256_insertf128_ps::<1>(_mm256_castps128_ps256(a.into()), b.into()))
        }
        fn to_vectors(self) -> [Vec4; 4] {
            let (a, b) = (_mm256_castps256_ps128(self.0).into(), _mm256_extractf128_ps::<1>(self.0).into());
            [a, b, a, b]
        }
        fn load(from: &[Vec4]) -> F32x8 {
            assert!(from.len() == 2, "as many as vectors");
            F32x8(_mm256_loadu_ps(from.as_ptr().cast()))
        }
        fn store(self, to: &mut [Vec4]) -> () {
            assert!(to.len() == 2, "as many as vectors");
            _mm256_storeu_ps(to.as_mut_ptr().cast(), self.0);
        }
        fn load_pairs(from: &[Vec4]) -> [F32x8; 2] {
            let (low, high) = (F32x8::load(&from[..2]), F32x8::load(&from[2..]));
            let [even, odd] = [_mm256_permute2f128_ps::<0x20>(low.0, high.0), _mm256_permute2f128_ps::<0x31>(low.0, high.0)];
            [F32x8(even), F32x8(odd)]
        }
        fn store_pairs([even, odd]: [F32x8; 2], to: &mut [Vec4]) -> () {
            F32x8(_mm256_permute2f128_ps::<0x20>(even.0, odd.0)).store(&mut to[..2]);
            F32x8(_mm256_permute2f128_ps::<0x31>(even.0, odd.0)).store(&mut to[2..]);
        }
        fn gather(from: &[Vec4], places: &[[u32; 4]]) -> [[F32x8; 4]; 4] {
            assert!(places.len() == 8, "a row a lane");
            assert!(!from.is_empty() && u32::try_from(from.len()).is_ok(), "there is something to gather");
            let (all, last) = (places.as_ptr().cast::<f32>(), _mm256_set1_epi32((from.len() as u32 - 1).cast_signed()));
            let (a, b) = (_mm256_castps_si256(_mm256_loadu_ps(all)), _mm256_castps_si256(_mm256_loadu_ps(all.add(8))));
            let (c, d) = (_mm256_castps_si256(_mm256_loadu_ps(all.add(16))), _mm256_castps_si256(_mm256_loadu_ps(all.add(24))));
            let (low, high) = (_mm256_max_epu32(a, b), _mm256_max_epu32(c, d));
            let most = _mm256_max_epu32(_mm256_max_epu32(low, high), last);
            let is_inside = _mm256_movemask_epi8(_mm256_cmpeq_epi32(most, last)) == -1;
            assert!(is_inside, "inside the slice");
            let from = from.as_ptr();
            [gathered!(8, from, places, 0), gathered!(8, from, places, 1), gathered!(8, from, places, 2), gathered!(8, from, places, 3)]
        }
        fn sum(self) -> Vec4 {
            _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0)).into()
        }
    }

    shuffles! { F32x8, _mm256_unpacklo_ps, _mm256_unpackhi_ps, _mm256_shuffle_ps, _mm256_permute_ps, _mm256_setzero_ps }

    #[inline(always)]
    fn spread_mask(mask: F32x8) -> [F32x8; 4] {
        mask.spread()
    }
}

impl Lanes for F32x16 {
    type Mask = __mmask16;
    const LANES: usize = 16;

    instructions! {
        fn splat(value: f32) -> F32x16 { F32x16(_mm512_set1_ps(value)) }
        fn mul_add(self, by: F32x16, plus: F32x16) -> F32x16 { F32x16(_mm512_fmadd_ps(self.0, by.0, plus.0)) }
        fn neg_mul_add(self, by: F32x16, plus: F32x16) -> F32x16 { F32x16(_mm512_fnmadd_ps(self.0, by.0, plus.0)) }
        fn abs(self) -> F32x16 { F32x16(_mm512_abs_ps(self.0)) }
        fn sqrt(self) -> F32x16 { F32x16(_mm512_sqrt_ps(self.0)) }
        fn max(self, other: F32x16) -> F32x16 { F32x16(_mm512_max_ps(self.0, other.0)) }
        fn lt(self, other: F32x16) -> __mmask16 { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
        fn eq(self, other: F32x16) -> __mmask16 { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, other.0) }
        fn select(mask: __mmask16, yes: F32x16, no: F32x16) -> F32x16 { F32x16(_mm512_mask_blend_ps(mask, no.0, yes.0)) }
    }

    #[inline(always)]
    fn and(one: __mmask16, other: __mmask16) -> __mmask16 {
        one & other
    }

    #[inline(always)]
    fn or(one: __mmask16, other: __mmask16) -> __mmask16 {
        one | other
    }

    #[inline(always)]
    fn all(mask: __mmask16) -> bool {
        mask == !0
    }

    #[inline(always)]
    fn bits(mask: __mmask16) -> u32 {
        mask.into()
    }
}

impl Registers for F32x16 {
    instructions! {
        fn from_slice(values: &[f32]) -> F32x16 {
            assert!(values.len() == 16, "a number a lane");
            F32x16(_mm512_loadu_ps(values.as_ptr()))
        }
        fn repeat_each(values: &[f32]) -> F32x16 {
            assert!(values.len() == 4, "a number a vector");
            let of = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
            F32x16(_mm512_permutexvar_ps(of, _mm512_castps128_ps512(_mm_loadu_ps(values.as_ptr()))))
        }
        fn repeat(vector: Vec4) -> F32x16 { F32x16(_mm512_broadcast_f32x4(vector.into())) }
        fn from_vectors([a, b, c, d]: [Vec4; 4]) -> F32x16 {
            let all = _mm512_insertf32x4::<1>(_mm512_castps128_ps512(a.into()), b.into());
            F32x16(_mm512_insertf32x4::<3>(_mm512_insertf32x4::<2>(all, c.into()), d.into()))
        }
        fn to_vectors(self) -> [Vec4; 4] {
            let (a, b) = (_mm512_castps512_ps128(self.0), _mm512_extractf32x4_ps::<1>(self.0));
            [a, b, _mm512_extractf32x4_ps::<2>(self.0), _mm512_extractf32x4_ps::<3>(self.0)].map(Vec4::from)
        }
        fn load(from: &[Vec4]) -> F32x16 {
            assert!(from.len() == 4, "as many as vectors");
            F32x16(_mm512_loadu_ps(from.as_ptr().cast()))
        }
        fn store(self, to: &mut [Vec4]) -> () {
            assert!(to.len() == 4, "as many as vectors");
            _mm512_storeu_ps(to.as_mut_ptr().cast(), self.0);
        }
        fn load_pairs(from: &[Vec4]) -> [F32x16; 2] {
            let (low, high) = (F32x16::load(&from[..4]), F32x16::load(&from[4..]));
            let [even, odd] = [_mm512_shuffle_f32x4::<0x88>(low.0, high.0), _mm512_shuffle_f32x4::<0xdd>(low.0, high.0)];
            [F32x16(even), F32x16(odd)]
        }
        fn store_pairs([even, odd]: [F32x16; 2], to: &mut [Vec4]) -> () {
            let (even, odd) = (_mm512_castps_pd(even.0), _mm512_castps_pd(odd.0));
            let low = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
            let high = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
            F32x16(_mm512_castpd_ps(_mm512_permutex2var_pd(even, low, odd))).store(&mut to[..4]);
            F32x16(_mm512_castpd_ps(_mm512_permutex2var_pd(even, high, odd))).store(&mut to[4..]);
        }
        fn gather(from: &[Vec4], places: &[[u32; 4]]) -> [[F32x16; 4]; 4] {
            assert!(places.len() == 16, "a row a lane");
            assert!(!from.is_empty() && u32::try_from(from.len()).is_ok(), "there is something to gather");
            let (all, last) = (places.as_ptr().cast::<i32>(), _mm512_set1_epi32((from.len() as u32 - 1).cast_signed()));
            let low = _mm512_max_epu32(_mm512_loadu_epi32(all), _mm512_loadu_epi32(all.add(16)));
            let high = _mm512_max_epu32(_mm512_loadu_epi32(all.add(32)), _mm512_loadu_epi32(all.add(48)));
            let is_inside = _mm512_cmple_epu32_mask(_mm512_max_epu32(low, high), last) == !0;
            assert!(is_inside, "inside the slice");
            let from = from.as_ptr();
            [gathered!(16, from, places, 0), gathered!(16, from, places, 1), gathered!(16, from, places, 2), gathered!(16, from, places, 3)]
        }
        fn sum(self) -> Vec4 {
            let low = _mm_add_ps(_mm512_castps512_ps128(self.0), _mm512_extractf32x4_ps::<1>(self.0));
            let high = _mm_add_ps(_mm512_extractf32x4_ps::<2>(self.0), _mm512_extractf32x4_ps::<3>(self.0));
            _mm_add_ps(low, high).into()
        }
    }

    shuffles! { F32x16, _mm512_unpacklo_ps, _mm512_unpackhi_ps, _mm512_shuffle_ps, _mm512_permute_ps, _mm512_setzero_ps }

    #[inline(always)]
    fn spread_mask(mask: __mmask16) -> [__mmask16; 4] {
        // Spreads bit `k` of each group of four bits over the group.
        [0, 1, 2, 3].map(|k| (mask >> k & 0x1111) * 0xf)
    }
}
