//! Corners of pairs in SIMD lanes. Everything that a [`Loop`](crate::simd::Loop) calls must be inlined into it, so
//! nothing here is a closure.

use glam::Vec4;

use crate::simd::{MAX_LANES, Registers, Vector};

/// The registers of one corner: the `k`th has lanes `k`, `k + 4` and so on.
#[inline(always)]
fn gathered<L: Registers>(from: &[Vec4], places: &[[u32; 4]], corner: usize) -> [L; 4] {
    let places = &places[..L::LANES];
    [
        register(from, places, corner, 0),
        register(from, places, corner, 1),
        register(from, places, corner, 2),
        register(from, places, corner, 3),
    ]
}

#[inline(always)]
fn register<L: Registers>(from: &[Vec4], places: &[[u32; 4]], corner: usize, k: usize) -> L {
    let mut vectors = [from[places[k][corner] as usize]; 4];
    for index in 1..L::VECTORS {
        vectors[index] = from[places[k + 4 * index][corner] as usize];
    }
    L::from_vectors(vectors)
}

/// All corners of as many pairs as lanes, of which `places` has at least as many.
#[inline(always)]
pub(super) fn corners_of<L: Registers>(from: &[Vec4], places: &[[u32; 4]]) -> [Vector<L>; 4] {
    [
        L::transpose(gathered(from, places, 0)),
        L::transpose(gathered(from, places, 1)),
        L::transpose(gathered(from, places, 2)),
        L::transpose(gathered(from, places, 3)),
    ]
}

/// The same with the w of each corner.
#[inline(always)]
pub(super) fn whole_corners_of<L: Registers>(from: &[Vec4], places: &[[u32; 4]]) -> ([Vector<L>; 4], [L; 4]) {
    let (a, b) = (gathered::<L>(from, places, 0), gathered::<L>(from, places, 1));
    let (c, d) = (gathered::<L>(from, places, 2), gathered::<L>(from, places, 3));
    let vectors = [L::transpose(a), L::transpose(b), L::transpose(c), L::transpose(d)];
    (vectors, [L::fourth(a), L::fourth(b), L::fourth(c), L::fourth(d)])
}

/// The pairs of a group, which has at most as many as lanes, repeated to as many if it has fewer.
#[inline(always)]
pub(super) fn filled<'a, L: Registers>(group: &'a [[u32; 4]], room: &'a mut [[u32; 4]; MAX_LANES]) -> &'a [[u32; 4]] {
    if group.len() >= L::LANES {
        return group;
    }
    room.fill(group[0]);
    room[..group.len()].copy_from_slice(group);
    room
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
