//! The numbers of a step and of its substeps, as every kernel and shader takes them.

use bytemuck::{Pod, Zeroable};

/// What is the same for every vertex and every substep of a step.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct Params {
    /// Gravity plus the linear drag toward the wind, `g + c v_air` (m/s²).
    pub acceleration: [f32; 3],
    /// Substep (s).
    pub h: f32,
    /// Velocity of the air (m/s).
    pub wind: [f32; 3],
    /// Half the density of the air (kg/m³).
    pub half_density: f32,
    pub drag: f32,
    pub lift: f32,
    /// One over the number of substeps.
    pub fraction: f32,
    pub vertices: u32,
    pub bodies: u32,
    pub pins: u32,
    /// 1 if bending is damped.
    pub damped: u32,
    /// 1 if there is more to predict by than the last displacement and a uniform acceleration: forces, or pins that are led.
    pub predicted: u32,
    pub substeps: u32,
    /// Sweeps over the edges in a substep.
    pub sweeps: u32,
    /// 1 if edges are relaxed (Jakobsen), not projected.
    pub relaxed: u32,
    /// Coarse levels in use.
    pub levels: u32,
    /// How far (m) the pins are led in a substep, on average.
    pub drift: [f32; 3],
    /// 1 if coarse edges hold (`distance::hold_coarse`).
    pub holds: u32,
    /// Edges that are swept.
    pub edges: u32,
    /// What the watch compares with (`kernels::watch`): one over the displacement (m) in a substep at the fastest speed that the scene
    /// explains, one over the free mass (kg), and the longest edge (m) that it does.
    pub per_length: f32,
    pub per_mass: f32,
    pub longest: f32,
    /// 1 if tethers are in use.
    pub tethers: u32,
    /// Acceleration (m/s²) whose load lengthens them.
    pub load: f32,
    pub padding: [u32; 2],
}

/// What differs from one substep to the next.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct Substep {
    /// Share of the last displacement that carries over: drag, and the ratio of this substep to the last.
    pub carry: f32,
    /// Displacement by a unit of acceleration (s²): `h²`, half of it in the first substep (leapfrog start).
    pub gain: f32,
    /// One over the last substep (1/s): turns `p` into a velocity.
    pub rate: f32,
    /// Where the substep begins and ends within the step, 0..1.
    pub start: f32,
    pub end: f32,
}
