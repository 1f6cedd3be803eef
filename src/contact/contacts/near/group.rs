//! Pairs in groups of the largest SIMD width: near ones, and active ones with their multipliers.

use glam::Vec4;

use crate::kernels::pair::SQUEEZED;
use crate::simd::MAX_LANES;

/// As many pairs as there are lanes, with what truncation needs of them, as structure of arrays, each of whole cache
/// lines.
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Block {
    /// Places among the vertices of listed pairs.
    pub corners: [[u32; 4]; MAX_LANES],
    /// Unit vectors from the second side to the first.
    pub normal: [[f32; MAX_LANES]; 3],
    /// The distance (m) of each corner from the plane halfway between the sides, and the clearance (m) that it keeps.
    pub heights: [[f32; MAX_LANES]; 4],
    pub clearance: [f32; MAX_LANES],
    /// The lanes that hold near pairs, one bit each.
    pub near: u32,
}

/// At most as many pairs as there are lanes, as structure of arrays. Other lanes have no effect.
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Group {
    pub block: Block,
    /// Of pairs of edges, vertices of the surface: see [`Around::opposite`](super::voronoi::Around::opposite).
    pub opposite: [[u32; 4]; MAX_LANES],
    /// Indices in the list.
    pub listed: [u32; MAX_LANES],
    /// The distance (m) at which they are held apart, unless [kinematic corners](crate::kernels::pair::held_distance) leave less.
    pub thickness: [f32; MAX_LANES],
    /// The distance (m) between the sides at the start of the substep.
    pub distance: [f32; MAX_LANES],
    pub friction: [f32; MAX_LANES],
    /// By how much (m) they may approach.
    pub gap: [f32; MAX_LANES],
    /// Of all iterations but the last: see [`step_of_lambda`](crate::kernels::pair::step_of_lambda).
    pub rate: [f32; MAX_LANES],
    /// Multipliers (kg m): for friction, and along the normal.
    pub lambda_t: [[f32; MAX_LANES]; 3],
    pub lambda_n: [f32; MAX_LANES],
    pub count: u32,
}

/// The weights of the corners of a group's pairs.
#[repr(align(64))]
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Weights(pub [[f32; MAX_LANES]; 4]);

/// What does not change about a pair in a group.
#[derive(Clone, Copy)]
pub(crate) struct Member {
    pub corners: [u32; 4],
    pub opposite: [u32; 4],
    pub listed: u32,
    pub thickness: f32,
    pub friction: f32,
}

impl Group {
    pub(crate) fn put(&mut self, lane: usize, pair: Member, multiplier: Vec4) {
        let Member { corners, opposite, listed, thickness, friction } = pair;
        (self.block.corners[lane], self.opposite[lane], self.listed[lane]) = (corners, opposite, listed);
        (self.thickness[lane], self.friction[lane]) = (thickness, friction);
        (0..3).for_each(|axis| self.lambda_t[axis][lane] = multiplier[axis]);
        self.lambda_n[lane] = multiplier.w;
    }

    /// A pair, and its multiplier as it is stored in the list.
    pub(crate) fn pair(&self, lane: usize) -> (Member, Vec4) {
        let (corners, opposite, listed) = (self.block.corners[lane], self.opposite[lane], self.listed[lane]);
        let pair = Member { corners, opposite, listed, thickness: self.thickness[lane], friction: self.friction[lane] };
        let [x, y, z] = &self.lambda_t;
        (pair, Vec4::new(x[lane], y[lane], z[lane], self.lambda_n[lane]))
    }

    /// Sets the number of pairs. The other lanes get corners of another pair, so that all are valid.
    pub(crate) fn close(&mut self, count: usize) {
        let [corners, ..] = self.block.corners;
        self.block.corners[count..].fill(corners);
        self.count = count as u32;
    }

    /// How many pairs with a kinematic corner are squeezed.
    pub(crate) fn squeezed(&self, is_kinematic: impl Fn(u32) -> bool) -> usize {
        let depth = |lane: usize| self.thickness[lane] - self.distance[lane];
        let lanes = (0..self.count as usize).filter(|&lane| depth(lane) > SQUEEZED * self.thickness[lane]);
        lanes.filter(|&lane| self.block.corners[lane].into_iter().any(&is_kinematic)).count()
    }

    /// How many pairs press.
    pub(crate) fn pressing(&self) -> usize {
        self.lambda_n[..self.count as usize].iter().filter(|&&lambda_n| lambda_n > 0.0).count()
    }
}
