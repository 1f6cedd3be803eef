//! Lanes without special instructions: a single number, and four by glam's `Vec4`.

use glam::{BVec4A, Mat4, Vec4};

use super::{Lanes, Registers, Vector};

/// Marks functions as `inline(always)`, so that they become part of the loop that calls them.
macro_rules! inlined {
    ($(fn $name:ident $arguments:tt -> $result:ty { $($body:tt)* })*) => {$(
        #[inline(always)]
        fn $name $arguments -> $result { $($body)* }
    )*};
}

/// The square root of each number. Glam has only that of one number, which compilers combine to one of four, but for
/// WebAssembly only at the highest level of optimization.
#[inline(always)]
fn sqrt(of: Vec4) -> Vec4 {
    #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
    return std::arch::wasm32::f32x4_sqrt(of.into()).into();
    #[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
    Vec4::from_array(of.to_array().map(f32::sqrt))
}

impl Lanes for f32 {
    type Mask = bool;
    const LANES: usize = 1;

    inlined! {
        fn splat(value: f32) -> f32 { value }
        fn mul_add(self, by: f32, plus: f32) -> f32 { self * by + plus }
        fn neg_mul_add(self, by: f32, plus: f32) -> f32 { plus - self * by }
        fn abs(self) -> f32 { f32::abs(self) }
        fn sqrt(self) -> f32 { f32::sqrt(self) }
        fn max(self, other: f32) -> f32 { f32::max(self, other) }
        fn lt(self, other: f32) -> bool { self < other }
        fn eq(self, other: f32) -> bool { self == other }
        fn and(one: bool, other: bool) -> bool { one & other }
        fn or(one: bool, other: bool) -> bool { one | other }
        fn all(mask: bool) -> bool { mask }
        fn bits(mask: bool) -> u32 { u32::from(mask) }
        fn select(mask: bool, yes: f32, no: f32) -> f32 { if mask { yes } else { no } }
    }
}

impl Lanes for Vec4 {
    type Mask = BVec4A;
    const LANES: usize = 4;

    inlined! {
        fn splat(value: f32) -> Vec4 { Vec4::splat(value) }
        fn mul_add(self, by: Vec4, plus: Vec4) -> Vec4 { self * by + plus }
        fn neg_mul_add(self, by: Vec4, plus: Vec4) -> Vec4 { plus - self * by }
        fn abs(self) -> Vec4 { Vec4::abs(self) }
        fn sqrt(self) -> Vec4 { sqrt(self) }
        fn max(self, other: Vec4) -> Vec4 { Vec4::max(self, other) }
        fn lt(self, other: Vec4) -> BVec4A { self.cmplt(other) }
        fn eq(self, other: Vec4) -> BVec4A { self.cmpeq(other) }
        fn and(one: BVec4A, other: BVec4A) -> BVec4A { one & other }
        fn or(one: BVec4A, other: BVec4A) -> BVec4A { one | other }
        fn all(mask: BVec4A) -> bool { mask.all() }
        fn bits(mask: BVec4A) -> u32 { mask.bitmask() }
        fn select(mask: BVec4A, yes: Vec4, no: Vec4) -> Vec4 { Vec4::select(mask, yes, no) }
    }
}

impl Registers for Vec4 {
    inlined! {
        fn from_slice(values: &[f32]) -> Vec4 { Vec4::from_slice(values) }
        fn repeat_each(values: &[f32]) -> Vec4 { Vec4::splat(values[0]) }
        fn repeat(vector: Vec4) -> Vec4 { vector }
        fn from_vectors(vectors: [Vec4; 4]) -> Vec4 { vectors[0] }
        fn to_vectors(self) -> [Vec4; 4] { [self; 4] }
        fn load(from: &[Vec4]) -> Vec4 { from[0] }
        fn store(self, to: &mut [Vec4]) -> () { to[0] = self; }
        fn load_pairs(from: &[Vec4]) -> [Vec4; 2] { [from[0], from[1]] }
        fn store_pairs(pairs: [Vec4; 2], to: &mut [Vec4]) -> () { to.copy_from_slice(&pairs); }
        fn transpose(v: [Vec4; 4]) -> Vector<Vec4> {
            let t = Mat4::from_cols(v[0], v[1], v[2], v[3]).transpose();
            Vector::new(t.x_axis, t.y_axis, t.z_axis)
        }
        fn fourth(v: [Vec4; 4]) -> Vec4 { Vec4::new(v[0].w, v[1].w, v[2].w, v[3].w) }
        fn vectors(v: Vector<Vec4>) -> [Vec4; 4] {
            let t = Mat4::from_cols(v.x, v.y, v.z, Vec4::ZERO).transpose();
            [t.x_axis, t.y_axis, t.z_axis, t.w_axis]
        }
        fn sum(self) -> Vec4 { self }
        fn w(self) -> Vec4 { Vec4::splat(self.w) }
        fn spread(self) -> [Vec4; 4] { [Vec4::splat(self.x), Vec4::splat(self.y), Vec4::splat(self.z), Vec4::splat(self.w)] }
        fn spread_mask(mask: BVec4A) -> [BVec4A; 4] { [0, 1, 2, 3].map(|k| BVec4A::splat(mask.test(k))) }
    }
}
