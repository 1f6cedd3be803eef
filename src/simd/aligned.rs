//! Vertices in whole cache lines, so that no wide load is across two that need not be.

use std::ops::{Deref, DerefMut};

use bytemuck::{Pod, Zeroable};
use glam::Vec4;

use crate::cpu::shared::Shared;

/// Cache lines of sixteen vectors.
const WHOLE: usize = 4;

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
        Lines { lines: vec![Line::zeroed(); WHOLE * length.div_ceil(4 * WHOLE)], length }
    }

    /// Adds a number for each of so many lanes.
    pub(crate) fn push(&mut self, lanes: usize, number: impl Fn(usize) -> f32) {
        for four in 0..lanes / 4 {
            if self.length == 4 * self.lines.len() {
                self.lines.extend([Line::zeroed(); WHOLE]);
            }
            let vector = Vec4::from_array([0, 1, 2, 3].map(|k| number(4 * four + k)));
            self.lines[self.length / 4].0[self.length % 4] = vector;
            self.length += 1;
        }
    }

    /// Gives back what pushing took beforehand.
    pub(crate) fn trim(&mut self) {
        self.lines.shrink_to_fit();
    }

    /// These for the tasks of a round, with the room.
    pub(crate) fn share(&mut self) -> Shared<Vec4> {
        Shared::with_room(bytemuck::cast_slice_mut(&mut self.lines), self.length)
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
