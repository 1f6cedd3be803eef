//! Vectors in whole cache lines, so that no wide load is across two that need not be.

use std::ops::{Deref, DerefMut};

use bytemuck::{Pod, Zeroable};
use glam::Vec4;

use super::MAX_LANES;

/// As many vectors as were asked for, from the start of a cache line on, and room for whole groups of [`MAX_LANES`] of them.
#[derive(Debug, Clone, Default)]
pub(crate) struct AlignedVec {
    lines: Vec<Line>,
    length: usize,
}

/// A cache line.
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, Zeroable, Pod)]
struct Line([Vec4; IN_LINE]);

const IN_LINE: usize = 4;
/// Cache lines of a whole group.
const WHOLE: usize = MAX_LANES / IN_LINE;

impl AlignedVec {
    /// Zeros.
    pub(crate) fn new(length: usize) -> AlignedVec {
        AlignedVec { lines: vec![Line::zeroed(); WHOLE * length.div_ceil(MAX_LANES)], length }
    }

    /// Makes room for so many vectors, those that there are included; and gives back what is beyond.
    pub(crate) fn make_room(&mut self, vectors: usize) {
        self.lines.resize(WHOLE * vectors.max(self.length).div_ceil(MAX_LANES), Line::zeroed());
    }

    /// Adds a number for each of so many lanes.
    pub(crate) fn push(&mut self, lanes: usize, number: impl Fn(usize) -> f32) {
        for four in 0..lanes / 4 {
            if self.length == IN_LINE * self.lines.len() {
                self.lines.extend([Line::zeroed(); WHOLE]);
            }
            let vector = Vec4::from_array([0, 1, 2, 3].map(|k| number(4 * four + k)));
            self.lines[self.length / IN_LINE].0[self.length % IN_LINE] = vector;
            self.length += 1;
        }
    }

    /// Gives back what pushing took beforehand.
    pub(crate) fn trim(&mut self) {
        self.lines.shrink_to_fit();
    }

    /// All that there is room for.
    pub(crate) fn room(&mut self) -> &mut [Vec4] {
        bytemuck::cast_slice_mut(&mut self.lines)
    }
}

impl Deref for AlignedVec {
    type Target = [Vec4];

    fn deref(&self) -> &[Vec4] {
        &bytemuck::cast_slice(&self.lines)[..self.length]
    }
}

impl DerefMut for AlignedVec {
    fn deref_mut(&mut self) -> &mut [Vec4] {
        let length = self.length;
        &mut self.room()[..length]
    }
}
