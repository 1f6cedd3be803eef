//! Vectors of four of a shared array, by lanes: one after another, or at the places of a list.
//!
//! The unsafe code here rests on the invariants of [`shared`](super). For **Inside**, what is made of a view ([`Row`], [`RowsOf`],
//! [`Gathered`]) is compared with the array's length when it is made, and not again: nothing outside this file makes one.

use std::marker::PhantomData;

use glam::Vec4;

use super::View;
use super::lists::{Places, Rows};
use crate::simd::{Registers, Vector};

impl<'t> View<'t, Vec4> {
    /// As many vectors as lanes, one after another from `first` on.
    #[inline(always)]
    pub(crate) fn row<L: Registers>(self, first: u32) -> Row<'t, L> {
        let first = first as usize;
        assert!(first + L::LANES <= self.length, "inside the array");
        Row { view: self, first, lanes: PhantomData }
    }

    /// The rows of a list, `EACH` vectors for each lane.
    #[inline(always)]
    pub(crate) fn rows<'p, L: Registers, const EACH: usize>(self, rows: &'p Rows) -> RowsOf<'p, L, EACH>
    where
        't: 'p,
    {
        RowsOf { view: self, starts: rows.inside(self.length, EACH * L::LANES), lanes: PhantomData }
    }

    /// As many vectors as lanes, one after another from `first` on: all x, all y, all z.
    #[inline(always)]
    pub(crate) fn vectors<L: Registers>(self, first: usize) -> Vector<L> {
        let row = self.row::<L>(first as u32);
        L::transpose([row.get(0), row.get(1), row.get(2), row.get(3)])
    }

    /// The inverse of [`View::vectors`], with 0 as fourth.
    #[inline(always)]
    pub(crate) fn set_vectors<L: Registers>(self, first: usize, vectors: Vector<L>) {
        let (row, [a, b, c, d]) = (self.row::<L>(first as u32), L::vectors(vectors));
        row.set(0, a);
        row.set(1, b);
        row.set(2, c);
        row.set(3, d);
    }

    /// The vectors at the places of a list.
    #[inline(always)]
    pub(crate) fn at<'p>(self, places: &'p Places) -> Gathered<'p>
    where
        't: 'p,
    {
        Gathered { view: self, places: places.inside(self.length) }
    }

    /// A register of vectors that are known to be inside.
    #[inline(always)]
    fn load<L: Registers>(self, first: usize) -> L {
        self.reads(first, L::VECTORS);
        // SAFETY: Alive, Inside (whoever calls this has compared), Apart.
        L::load(unsafe { std::slice::from_raw_parts(self.start.wrapping_add(first), L::VECTORS) })
    }

    #[inline(always)]
    fn store<L: Registers>(self, first: usize, value: L) {
        self.writes(first, L::VECTORS);
        // SAFETY: Alive, Inside (whoever calls this has compared), Apart.
        value.store(unsafe { std::slice::from_raw_parts_mut(self.start.wrapping_add(first), L::VECTORS) });
    }

    /// The even and the odd ones of twice as many vectors that are known to be inside.
    #[inline(always)]
    fn load_pairs<L: Registers>(self, first: usize) -> [L; 2] {
        self.reads(first, 2 * L::VECTORS);
        // SAFETY: Alive, Inside (whoever calls this has compared), Apart.
        L::load_pairs(unsafe { std::slice::from_raw_parts(self.start.wrapping_add(first), 2 * L::VECTORS) })
    }

    #[inline(always)]
    fn store_pairs<L: Registers>(self, first: usize, pairs: [L; 2]) {
        self.writes(first, 2 * L::VECTORS);
        // SAFETY: Alive, Inside (whoever calls this has compared), Apart.
        L::store_pairs(pairs, unsafe { std::slice::from_raw_parts_mut(self.start.wrapping_add(first), 2 * L::VECTORS) });
    }

    /// A vector at a place of a list that was compared.
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

/// As many vectors as lanes in four registers, wherever they are in memory; or as many pairs in four pairs of registers.
pub(crate) trait Four<R> {
    /// Register `k`, below 4, or the pair of registers.
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

/// Vectors one after another, `EACH` for each lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'t, L, const EACH: usize = 1> {
    view: View<'t>,
    /// There are `EACH` times as many as lanes from here on.
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

/// The even ones and the odd ones.
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
#[derive(Debug, Clone, Copy)]
pub(crate) struct RowsOf<'p, L, const EACH: usize> {
    view: View<'p>,
    /// All inside.
    starts: &'p [u32],
    lanes: PhantomData<L>,
}

impl<'p, L: Registers, const EACH: usize> RowsOf<'p, L, EACH> {
    #[inline(always)]
    pub(crate) fn row(self, index: usize) -> Row<'p, L, EACH> {
        Row { view: self.view, first: self.starts[index] as usize, lanes: PhantomData }
    }
}

/// Vectors anywhere: register `k` holds those of lanes `k`, `k + 4` ...
#[derive(Debug, Clone, Copy)]
pub(crate) struct Listed<'t, L> {
    view: View<'t>,
    /// As many as lanes, all inside.
    places: &'t [u32],
    lanes: PhantomData<L>,
}

impl<L: Registers> Listed<'_, L> {
    #[inline(always)]
    fn of_lane(&self, lane: usize) -> u32 {
        self.places[if lane < L::LANES { lane } else { 0 }]
    }
}

impl<L: Registers> Four<L> for Listed<'_, L> {
    #[inline(always)]
    fn get(&self, k: usize) -> L {
        let vector = |lane: usize| self.view.vector(self.of_lane(lane));
        L::from_vectors([vector(k), vector(k + 4), vector(k + 8), vector(k + 12)])
    }

    /// Of vectors at one place the first is what lasts.
    #[inline(always)]
    fn set(&self, k: usize, value: L) {
        let vectors = value.to_vectors();
        for index in (0..L::VECTORS).rev() {
            self.view.set_vector(self.of_lane(k + 4 * index), vectors[index]);
        }
    }
}

/// Vectors at the places of a list.
#[derive(Debug, Clone, Copy)]
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

    /// As many vectors as lanes, from an index of the list on.
    #[inline(always)]
    pub(crate) fn row<L: Registers>(self, first: usize) -> Listed<'p, L> {
        Listed { view: self.view, places: &self.places[first..first + L::LANES], lanes: PhantomData }
    }

    /// The same: all x, all y, all z.
    #[inline(always)]
    pub(crate) fn vectors<L: Registers>(self, first: usize) -> Vector<L> {
        let listed = self.row::<L>(first);
        L::transpose([listed.get(0), listed.get(1), listed.get(2), listed.get(3)])
    }

    /// As many vectors as a register holds, from an index of the list on.
    #[inline(always)]
    pub(crate) fn register<L: Registers>(self, first: usize) -> L {
        let places = &self.places[first..first + L::VECTORS];
        let vector = |k: usize| self.view.vector(places[if k < L::VECTORS { k } else { 0 }]);
        L::from_vectors([vector(0), vector(1), vector(2), vector(3)])
    }

    /// The same of a list that ascends, or ascends and then repeats its first: often they are one after another.
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
