//! Vertices in whole cache lines: two of them in a wide load, and no load across two lines where the first is even.

use std::ops::{Deref, DerefMut};

use bytemuck::{Pod, Zeroable};
use glam::Vec4;

/// As many vectors as were asked for, from the start of a cache line on, and room for whole sixteens of them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lines {
    lines: Vec<Line>,
    length: usize,
}

#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, Zeroable, Pod)]
struct Line([Vec4; 4]);

impl Lines {
    /// Zeros.
    pub(crate) fn new(length: usize) -> Lines {
        Lines { lines: vec![Line::zeroed(); 4 * length.div_ceil(16)], length }
    }

    /// These.
    pub(crate) fn of(vectors: &[Vec4]) -> Lines {
        let mut lines = Lines::new(vectors.len());
        lines.copy_from_slice(vectors);
        lines
    }
}

impl Deref for Lines {
    type Target = [Vec4];

    fn deref(&self) -> &[Vec4] {
        &bytemuck::cast_slice(&self.lines)[..self.length]
    }
}

impl DerefMut for Lines {
    fn deref_mut(&mut self) -> &mut [Vec4] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.length]
    }
}
