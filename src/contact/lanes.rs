//! Corners of pairs in SIMD lanes. Everything that a [`Loop`](crate::simd::Loop) calls must be inlined into it, so
//! nothing here is a closure.

use glam::Vec4;

use crate::simd::{MAX_LANES, Registers, Vector};

/// One corner of as many pairs as lanes.
#[inline(always)]
fn gathered<L: Registers>(from: &[Vec4], places: &[[u32; 4]; MAX_LANES], corner: usize) -> Vector<L> {
    L::transpose([
        register(from, places, corner, 0),
        register(from, places, corner, 1),
        register(from, places, corner, 2),
        register(from, places, corner, 3),
    ])
}

/// One register of that corner: lanes `k`, `k + 4` and so on.
#[inline(always)]
fn register<L: Registers>(from: &[Vec4], places: &[[u32; 4]; MAX_LANES], corner: usize, k: usize) -> L {
    let mut vectors = [from[places[k][corner] as usize]; 4];
    for index in 1..L::VECTORS {
        vectors[index] = from[places[k + 4 * index][corner] as usize];
    }
    L::from_vectors(vectors)
}

/// All corners of as many pairs as lanes.
#[inline(always)]
pub(super) fn corners_of<L: Registers>(from: &[Vec4], places: &[[u32; 4]; MAX_LANES]) -> [Vector<L>; 4] {
    [gathered(from, places, 0), gathered(from, places, 1), gathered(from, places, 2), gathered(from, places, 3)]
}

/// The w of one corner of as many pairs as lanes.
#[inline(always)]
pub(super) fn fourth_of<L: Registers>(from: &[Vec4], places: &[[u32; 4]; MAX_LANES], corner: usize) -> L {
    let mut numbers = [0.0; MAX_LANES];
    for k in 0..L::LANES {
        numbers[k] = from[places[k][corner] as usize].w;
    }
    L::from_slice(&numbers[..L::LANES])
}

/// Stores the vector of each lane.
#[inline(always)]
pub(super) fn scattered<L: Registers>(from: Vector<L>, to: &mut [Vec4; MAX_LANES]) {
    let [a, b, c, d] = L::vectors(from);
    let vectors = [a.to_vectors(), b.to_vectors(), c.to_vectors(), d.to_vectors()];
    for index in 0..L::VECTORS {
        for k in 0..4 {
            to[k + 4 * index] = vectors[k][index];
        }
    }
}

/// Loads as many consecutive vectors as lanes.
#[inline(always)]
pub(super) fn loaded<L: Registers>(from: &[Vec4]) -> Vector<L> {
    let each = L::VECTORS;
    let (a, b) = (L::load(&from[..each]), L::load(&from[each..2 * each]));
    L::transpose([a, b, L::load(&from[2 * each..3 * each]), L::load(&from[3 * each..4 * each])])
}
