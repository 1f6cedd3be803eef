//! Corners of pairs in SIMD lanes. Everything that a [`Loop`](crate::simd::Loop) calls must be inlined into it, so
//! nothing here is a closure.

use glam::Vec4;

use crate::simd::{MAX_LANES, Registers, Vector};

/// All corners of as many pairs as lanes, of which `places` has at least as many.
#[inline(always)]
pub(crate) fn corners_of<L: Registers>(from: &[Vec4], places: &[[u32; 4]]) -> [Vector<L>; 4] {
    let [a, b, c, d] = L::gather(from, &places[..L::LANES]);
    [L::transpose(a), L::transpose(b), L::transpose(c), L::transpose(d)]
}

/// All corners of as many pairs as lanes, of which `places` has at least as many, and the w of each corner.
#[inline(always)]
pub(crate) fn whole_corners_of<L: Registers>(from: &[Vec4], places: &[[u32; 4]]) -> ([Vector<L>; 4], [L; 4]) {
    let [a, b, c, d] = L::gather(from, &places[..L::LANES]);
    let vectors = [L::transpose(a), L::transpose(b), L::transpose(c), L::transpose(d)];
    (vectors, [L::fourth(a), L::fourth(b), L::fourth(c), L::fourth(d)])
}

/// Stores the vector of each lane.
#[inline(always)]
pub(crate) fn scattered<L: Registers>(from: Vector<L>, to: &mut [Vec4; MAX_LANES]) {
    let [a, b, c, d] = L::vectors(from);
    let vectors = [a.to_vectors(), b.to_vectors(), c.to_vectors(), d.to_vectors()];
    for index in 0..L::VECTORS {
        for k in 0..4 {
            to[k + 4 * index] = vectors[k][index];
        }
    }
}

/// A number for each lane.
#[inline(always)]
pub(crate) fn number<L: Registers>(of: &[f32; MAX_LANES], first: usize) -> L {
    L::from_slice(&of[first..first + L::LANES])
}

/// A vector for each lane.
#[inline(always)]
pub(crate) fn vector<L: Registers>(of: &[[f32; MAX_LANES]; 3], first: usize) -> Vector<L> {
    Vector::new(number(&of[0], first), number(&of[1], first), number(&of[2], first))
}

/// Stores the number of each lane.
#[inline(always)]
pub(crate) fn store<L: Registers>(to: &mut [f32], from: L) {
    let vectors = from.to_vectors();
    for index in 0..L::VECTORS {
        vectors[index].write_to_slice(&mut to[4 * index..]);
    }
}

/// Stores the vector of each lane by its components.
#[inline(always)]
pub(crate) fn store_vector<L: Registers>(to: &mut [[f32; MAX_LANES]; 3], first: usize, from: Vector<L>) {
    let lanes = first..first + L::LANES;
    store(&mut to[0][lanes.clone()], from.x);
    store(&mut to[1][lanes.clone()], from.y);
    store(&mut to[2][lanes], from.z);
}
