//! The parameters of a step and of its substeps, laid out as kernels and shaders share them.

use bytemuck::{Pod, Zeroable};

/// Parameters that are the same for every vertex and every substep of a step.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct Params {
    /// Velocity of the air (m/s).
    pub wind: [f32; 3],
    /// Substep (s).
    pub h: f32,
    /// Half the density of the air (kg/m³).
    pub half_density: f32,
    pub drag: f32,
    pub lift: f32,
    /// One over the number of substeps.
    pub fraction: f32,
    pub vertices: u32,
    /// Number of analytic colliders.
    pub bodies: u32,
    /// Number of pins that follow targets.
    pub pins: u32,
    /// 1 if bending is damped.
    pub damped: u32,
    /// On a GPU: 1 if a stage of its own predicts the displacements. Otherwise the levels and the sweep predict them from
    /// the last ones.
    pub predicted: u32,
    pub substeps: u32,
    /// Sweeps over the edges in a substep.
    pub sweeps: u32,
    /// 1 if edges are corrected by Jakobsen's relaxation instead of projection.
    pub relaxed: u32,
    /// Mean displacement (m) of the pins in a substep.
    pub drift: [f32; 3],
    /// How coarse edges are corrected: [`PULL_COARSE`], [`HOLD_COARSE`] or [`PROJECT_COARSE`].
    pub coarse_rule: u32,
    /// Coarse levels in use.
    pub levels: u32,
    /// Number of edges that are swept.
    pub edges: u32,
    /// Bounds of the instability watch (`kernels::watch`). One over the displacement (m) in a substep at the greatest
    /// RMS speed that the scene explains.
    pub per_length: f32,
    /// One over the mass of all free vertices (1/kg).
    pub per_mass: f32,
    /// The greatest length of an edge (m) that the scene explains.
    pub longest_edge: f32,
    /// 1 if tethers are in use.
    pub tethers: u32,
    /// Acceleration (m/s²) under whose load tethers are lengthened by their slack.
    pub load: f32,
    /// 1 if tiles check the result of the step in its last substep, because nothing follows it.
    pub checks: u32,
    /// The unit vector opposite to gravity; 0 without gravity.
    pub up: [f32; 3],
    /// One over the band in which coarse edges push with [`PROJECT_COARSE`]: `SLACK_BAND` of `kernels::distance`, or
    /// `SLACK_BAND_OF_FEW`.
    pub per_slack: f32,
    /// To the alignment of vectors in shaders.
    pub padding: [f32; 3],
    /// Number of vertices with edges, which come first.
    pub used: u32,
}

/// Values of [`Params::coarse_rule`], named after the functions of `kernels::distance`.
pub(crate) const PULL_COARSE: u32 = 0;
pub(crate) const HOLD_COARSE: u32 = 1;
pub(crate) const PROJECT_COARSE: u32 = 2;

/// Parameters that differ between substeps.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct Substep {
    /// Displacement (m) under the ambient acceleration.
    pub fall: [f32; 3],
    /// Factor from the last displacement to its contribution to this one: drag, and the ratio of this substep to the
    /// last.
    pub carry: f32,
    /// Displacement per unit of acceleration (s²): `h (last h + h)/2`, less with drag. Before the first substep there was
    /// none, so that it is half of `h²` (leapfrog start).
    pub gain: f32,
    /// One over the last substep (1/s), which turns `p` into a velocity.
    pub rate: f32,
    /// Where the substep begins within the step, from 0 to 1.
    pub start: f32,
    /// Where the substep ends within the step, from 0 to 1.
    pub end: f32,
}
