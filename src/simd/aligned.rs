//! Arrays of 4-vectors aligned to cache lines, so that no wide load straddles two lines unnecessarily.

use std::ops::{Deref, DerefMut};

use bytemuck::{Pod, Zeroable};
use glam::Vec4;

use super::MAX_LANES;

/// A vector of `length` 4-vectors, aligned to a cache line and padded to whole groups of [`MAX_LANES`] vectors.
#[derive(Debug, Clone, Default)]
pub(crate) struct AlignedVec {
    lines: Vec<Line>,
    length: usize,
}

/// A cache line (64 bytes).
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, Zeroable, Pod)]
struct Line([Vec4; IN_LINE]);

/// Vectors in a cache line.
const IN_LINE: usize = 4;
/// Cache lines of a group of [`MAX_LANES`] vectors.
const WHOLE: usize = MAX_LANES / IN_LINE;

impl AlignedVec {
    /// `length` zero vectors.
    pub(crate) fn new(length: usize) -> AlignedVec {
        AlignedVec { lines: vec![Line::zeroed(); WHOLE * length.div_ceil(MAX_LANES)], length }
    }

    /// Resizes the padding so that there is room for `vectors` vectors in all, and frees the rest. The length stays.
    pub(crate) fn make_room(&mut self, vectors: usize) {
        self.lines.resize(WHOLE * vectors.max(self.length).div_ceil(MAX_LANES), Line::zeroed());
    }

    /// Appends one number per lane, given by its lane. `lanes` must be a multiple of 4.
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

    /// Frees the capacity that `push` has reserved ahead.
    pub(crate) fn trim(&mut self) {
        self.lines.shrink_to_fit();
    }

    /// The vectors including the padding.
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
