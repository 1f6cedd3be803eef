//! Data shared with the shaders: the status that the kernels keep, and what they list.

use bytemuck::{Pod, Zeroable};
use glam::Vec4;

use crate::contact::surface::pairs;

/// Reasons to stop a step: bits of [`Status::stopped`]. The kernels know another one, for numbers that are not finite, which the check
/// at the commit finds, too.
pub(crate) const NO_ROOM: u32 = 1;
pub(crate) const CROWDED: u32 = 4;
pub(crate) const EARLY: u32 = 8;
pub(crate) const CLOSE: u32 = 16;
pub(crate) const RUN_OVER: u32 = 32;
/// Value of [`Status::since`] before the first detection.
pub(super) const NEVER: f32 = -1.0;

/// What the kernels keep from one dispatch to the next: `Status` of `stages/self_contact/shared.wgsl`, which documents the
/// fields.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Status {
    pub half: u32,
    pub listed: u32,
    pub with_vertices: u32,
    pub with_edges: u32,
    pub since: f32,
    pub ahead: f32,
    pub h: f32,
    pub stopped: u32,
    pub needed: u32,
    pub detections: u32,
    pub near: u32,
    pub acting: u32,
    pub pressing: u32,
    pub strayed: u32,
    pub most_push: u32,
    pub pushed: f32,
    pub detects: u32,
    pub longer: f32,
    pub over: f32,
    pub scale: f32,
    pub mean: [f32; 3],
    pub counted: u32,
    pub vertices_before: u32,
    pub edges_before: u32,
    pub leaf_pairs: u32,
    pub candidates: u32,
    pub edge_candidates: u32,
    pub space_needed: u32,
    pub acted: u32,
    pub passed: u32,
    pub pinched: u32,
    pub again: u32,
    pub needed_carry: u32,
    pub squeezed: u32,
    pub jumped: u32,
    pub shortens: u32,
    pub cuts_more: u32,
    pub drifted: u32,
    pub through: u32,
    pub padding: [u32; 3],
}

impl Status {
    /// The status after the state was replaced.
    pub(super) fn nothing() -> Status {
        Status { since: NEVER, ..Status::zeroed() }
    }

    /// The status at the end of a step of this many substeps, with all of them counted.
    pub(super) fn at_end(self, substeps: usize) -> Status {
        Status { since: self.since + (substeps as u32 - self.counted) as f32, counted: 0, ..self }
    }

    /// The status at the start of a step that continues from this one.
    pub(super) fn at_start(self) -> Status {
        let Status { half, listed, with_vertices, with_edges, since, ahead, h, leaf_pairs, candidates, edge_candidates, .. } =
            self;
        let zero = Status::zeroed();
        Status { half, listed, with_vertices, with_edges, since, ahead, h, leaf_pairs, candidates, edge_candidates, ..zero }
    }
}

/// What the CPU reads after a step: the status, and as far as there is room the corners of the pairs that have moved through each other
/// and of others that are pinched, and the vertices that drift.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct StatusReadback {
    pub status: Status,
    pub through: [[u32; 4]; PINCHED],
    pub pinched: [[u32; 4]; PINCHED],
    pub drifted: [u32; DRIFTED],
}

/// The first of so many items, as far as there was room for them, and whether these are all.
pub(super) fn noted<T>(items: &[T], count: u32) -> (&[T], bool) {
    (&items[..items.len().min(count as usize)], count as usize <= items.len())
}

/// A listed pair: `Listed` of `shared.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct Listed {
    pub corners: [u32; 4],
    pub lambda: Vec4,
    pub other: u32,
    pub thickness: f32,
    pub row: u32,
    pub next: u32,
}

impl Listed {
    pub(crate) fn of(pair: pairs::Listed, lambda: Vec4, row: u32) -> Listed {
        let pairs::Listed { corners, other, thickness } = pair;
        Listed { corners, lambda, other, thickness, row, next: 0 }
    }

    pub(crate) fn pair(&self) -> pairs::Listed {
        let Listed { corners, other, thickness, .. } = *self;
        pairs::Listed { corners, other, thickness }
    }
}

/// The path of a vertex: `Track` of `shared.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Track {
    pub start: Vec4,
    pub by: Vec4,
}

/// `PINCHED` and `DRIFTED` of `shared.wgsl`.
pub(crate) const PINCHED: usize = 64;
pub(crate) const DRIFTED: usize = 256;
/// Sizes in bytes of structs that only the shaders access, for buffers.
pub(super) const VERTEX: usize = 64;
pub(super) const TRACK: usize = 32;
pub(super) const NODE: usize = 96;
pub(super) const BOX: usize = 48;
pub(super) const NORMALS: usize = 32;
pub(super) const NEAR: usize = 80;
/// Size in bytes of a unit of space for what detection compares: `LEAF_PAIRS` pairs of leaves and `CANDIDATES` candidates of
/// `detection.wgsl`.
pub(super) const SPACE: usize = 80;
pub(super) const PART: usize = 32;
/// Number of invocations that bound a leaf: `PARTS` of `tree.wgsl`.
pub(crate) const PARTS: usize = 4;
/// The level of the trees with which a descent begins: `FIRST_LEVEL` of `boxes.wgsl`.
pub(crate) const FIRST_LEVEL: u32 = 6;
/// Number of sums per vertex: `SUMS` of `shared.wgsl`.
pub(crate) const SUMS: usize = 8;
/// The sums of a vertex that nothing touches: the last is the share that truncation leaves, as bits.
pub(super) const NO_SUMS: [u32; SUMS] = [0, 0, 0, 0, 0, 0, 0, 1.0_f32.to_bits()];
/// Detection may be due in every so many substeps, and in every so many of calm cloth.
pub(crate) const SPACING: u32 = 5;
pub(crate) const FAR_SPACING: u32 = 20;
