//! SIMD access to a shared array of 4-vectors, contiguous or through a list of indices.
//!
//! The unsafe code here rests on the invariants of [`shared`](super). For **Inside**, the types made from a view
//! ([`Row`], [`RowsOf`], [`Gathered`]) are checked against the array's length when they are made and not again; nothing
//! outside this file can make one.

use std::marker::PhantomData;

use glam::Vec4;

use super::View;
use super::lists::Indices;
use crate::simd::{Registers, Vector};

impl<'t> View<'t, Vec4> {
    /// As many contiguous vectors as there are lanes, from `first` on.
    #[inline(always)]
    pub(crate) fn row<L: Registers>(self, first: u32) -> Row<'t, L> {
        let first = first as usize;
        assert!(first + L::LANES <= self.length, "inside the array");
        Row { view: self, first, lanes: PhantomData }
    }

    /// The rows of a list, with `EACH` vectors per lane.
    #[inline(always)]
    pub(crate) fn rows<'p, L: Registers, const EACH: usize>(self, rows: &'p Indices) -> RowsOf<'p, L, EACH>
    where
        't: 'p,
    {
        RowsOf { view: self, starts: rows.inside(self.length, EACH * L::LANES), lanes: PhantomData }
    }

    /// One vector per lane, contiguous from `first` on, transposed to structure of arrays (all x, all y, all z).
    #[inline(always)]
    pub(crate) fn vectors<L: Registers>(self, first: usize) -> Vector<L> {
        let row = self.row::<L>(first as u32);
        L::transpose([row.get(0), row.get(1), row.get(2), row.get(3)])
    }

    /// Stores the vectors that [`View::vectors`] loads, with 0 as the fourth component.
    #[inline(always)]
    pub(crate) fn set_vectors<L: Registers>(self, first: usize, vectors: Vector<L>) {
        let (row, [a, b, c, d]) = (self.row::<L>(first as u32), L::vectors(vectors));
        row.set(0, a);
        row.set(1, b);
        row.set(2, c);
        row.set(3, d);
    }

    /// The vectors at the indices of a list.
    #[inline(always)]
    pub(crate) fn at<'p>(self, places: &'p Indices) -> Gathered<'p>
    where
        't: 'p,
    {
        Gathered { view: self, places: places.inside(self.length, 1) }
    }

    /// A register of contiguous vectors that the caller has checked to be inside.
    #[inline(always)]
    fn load<L: Registers>(self, first: usize) -> L {
        self.reads(first, L::VECTORS);
        // SAFETY: Alive, Inside (the caller has checked), Apart.
        L::load(unsafe { std::slice::from_raw_parts(self.start.wrapping_add(first), L::VECTORS) })
    }

    /// Stores a register of contiguous vectors that the caller has checked to be inside.
    #[inline(always)]
    fn store<L: Registers>(self, first: usize, value: L) {
        self.writes(first, L::VECTORS);
        // SAFETY: Alive, Inside (the caller has checked), Apart.
        value.store(unsafe { std::slice::from_raw_parts_mut(self.start.wrapping_add(first), L::VECTORS) });
    }

    /// The vectors at even and at odd positions of two registers' worth, which the caller has checked to be inside.
    #[inline(always)]
    fn load_pairs<L: Registers>(self, first: usize) -> [L; 2] {
        self.reads(first, 2 * L::VECTORS);
        // SAFETY: Alive, Inside (the caller has checked), Apart.
        L::load_pairs(unsafe { std::slice::from_raw_parts(self.start.wrapping_add(first), 2 * L::VECTORS) })
    }

    /// Stores what [`View::load_pairs`] loads.
    #[inline(always)]
    fn store_pairs<L: Registers>(self, first: usize, pairs: [L; 2]) {
        self.writes(first, 2 * L::VECTORS);
        // SAFETY: Alive, Inside (the caller has checked), Apart.
        L::store_pairs(pairs, unsafe { std::slice::from_raw_parts_mut(self.start.wrapping_add(first), 2 * L::VECTORS) });
    }

    /// The vector at an index from a checked list.
    #[inline(always)]
    fn vector(self, place: u32) -> Vec4 {
        self.reads(place as usize, 1);
        // SAFETY: Alive, Inside (the list's bound), Apart.
        unsafe { *self.start.wrapping_add(place as usize) }
    }

    #[inline(always)]
    fn set_vector(self, place: u32, vector: Vec4) {
        self.writes(place as usize, 1);
        // SAFETY: Alive, Inside (the list's bound), Apart.
        unsafe { *self.start.wrapping_add(place as usize) = vector };
    }
}

/// One vector per lane in four registers, or one pair of vectors per lane in four pairs of registers, wherever they are
/// in memory.
pub(crate) trait Four<R> {
    /// Register `k` of 4, or pair of registers `k`.
    fn get(&self, k: usize) -> R;
    fn set(&self, k: usize, value: R);
}

impl<L, F: Four<L>> Four<[L; 2]> for (F, F) {
    #[inline(always)]
    fn get(&self, k: usize) -> [L; 2] {
        [self.0.get(k), self.1.get(k)]
    }

    #[inline(always)]
    fn set(&self, k: usize, [a, b]: [L; 2]) {
        self.0.set(k, a);
        self.1.set(k, b);
    }
}

/// Contiguous vectors, `EACH` per lane.
#[derive(Clone, Copy)]
pub(crate) struct Row<'t, L, const EACH: usize = 1> {
    view: View<'t>,
    /// At least `EACH` vectors per lane lie inside from here on.
    first: usize,
    lanes: PhantomData<L>,
}

impl<L: Registers> Four<L> for Row<'_, L> {
    #[inline(always)]
    fn get(&self, k: usize) -> L {
        self.view.load(self.first + k % 4 * L::VECTORS)
    }

    #[inline(always)]
    fn set(&self, k: usize, value: L) {
        self.view.store(self.first + k % 4 * L::VECTORS, value);
    }
}

/// Pairs of the vectors at even and at odd positions.
impl<L: Registers> Four<[L; 2]> for Row<'_, L, 2> {
    #[inline(always)]
    fn get(&self, k: usize) -> [L; 2] {
        self.view.load_pairs(self.first + k % 4 * 2 * L::VECTORS)
    }

    #[inline(always)]
    fn set(&self, k: usize, pairs: [L; 2]) {
        self.view.store_pairs(self.first + k % 4 * 2 * L::VECTORS, pairs);
    }
}

/// The rows of a list.
#[derive(Clone, Copy)]
pub(crate) struct RowsOf<'p, L, const EACH: usize> {
    view: View<'p>,
    /// The start of each row; all rows lie inside.
    starts: &'p [u32],
    lanes: PhantomData<L>,
}

impl<'p, L: Registers, const EACH: usize> RowsOf<'p, L, EACH> {
    #[inline(always)]
    pub(crate) fn row(self, index: usize) -> Row<'p, L, EACH> {
        Row { view: self.view, first: self.starts[index] as usize, lanes: PhantomData }
    }
}

/// Vectors at arbitrary indices: register `k` holds those of lanes `k`, `k + 4` ...
#[derive(Clone, Copy)]
pub(crate) struct VectorsAt<'t, L> {
    view: View<'t>,
    /// One index per lane, all inside.
    places: &'t [u32],
    lanes: PhantomData<L>,
}

impl<L: Registers> VectorsAt<'_, L> {
    #[inline(always)]
    fn of_lane(&self, lane: usize) -> u32 {
        self.places[if lane < L::LANES { lane } else { 0 }]
    }
}

impl<L: Registers> Four<L> for VectorsAt<'_, L> {
    #[inline(always)]
    fn get(&self, k: usize) -> L {
        let vector = |lane: usize| self.view.vector(self.of_lane(lane));
        L::from_vectors([vector(k), vector(k + 4), vector(k + 8), vector(k + 12)])
    }

    /// Where lanes have the same index, the value of the first of them is kept.
    #[inline(always)]
    fn set(&self, k: usize, value: L) {
        let vectors = value.to_vectors();
        for index in (0..L::VECTORS).rev() {
            self.view.set_vector(self.of_lane(k + 4 * index), vectors[index]);
        }
    }
}

/// The vectors at the indices of a list.
#[derive(Clone, Copy)]
pub(crate) struct Gathered<'p> {
    view: View<'p>,
    /// All inside.
    places: &'p [u32],
}

impl<'p> Gathered<'p> {
    #[inline(always)]
    pub(crate) fn get(self, index: usize) -> Vec4 {
        self.view.vector(self.places[index])
    }

    /// One vector per lane, from position `first` of the list on.
    #[inline(always)]
    pub(crate) fn row<L: Registers>(self, first: usize) -> VectorsAt<'p, L> {
        VectorsAt { view: self.view, places: &self.places[first..first + L::LANES], lanes: PhantomData }
    }

    /// The same, transposed to structure of arrays (all x, all y, all z).
    #[inline(always)]
    pub(crate) fn vectors<L: Registers>(self, first: usize) -> Vector<L> {
        let listed = self.row::<L>(first);
        L::transpose([listed.get(0), listed.get(1), listed.get(2), listed.get(3)])
    }

    /// One register of vectors, from position `first` of the list on.
    #[inline(always)]
    pub(crate) fn register<L: Registers>(self, first: usize) -> L {
        let places = &self.places[first..first + L::VECTORS];
        let vector = |k: usize| self.view.vector(places[if k < L::VECTORS { k } else { 0 }]);
        L::from_vectors([vector(0), vector(1), vector(2), vector(3)])
    }

    /// The same for a list that ascends, possibly followed by repeats of its first index. Often the vectors are
    /// contiguous and need no gather.
    #[inline(always)]
    pub(crate) fn ascending<L: Registers>(self, first: usize) -> L {
        let places = &self.places[first..first + L::VECTORS];
        if places[L::VECTORS - 1] == places[0].wrapping_add(L::VECTORS as u32 - 1) {
            self.view.load(places[0] as usize)
        } else {
            self.register(first)
        }
    }
}
