//! The deformer: a cloth, its state, and the substep loop from top to bottom.

use glam::Vec3;

use crate::{
    Attributes, Fabric, Mesh,
    error::{BuildError, StepError},
};

/// Where the work is done. All three give the same motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// A real GPU if there is one and the mesh is large enough to gain from it, else the CPU.
    #[default]
    Auto,
    /// Rayon over vertices, and over the edges of one colour at a time.
    Cpu,
    /// Forces on the GPU, edges and contact on the CPU, every substep: the shape of the 2013 plug-in.
    Hybrid,
    /// Everything on the GPU; read back when asked for.
    Gpu,
}

/// How the edges hold together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Small-step XPBD, one sweep a substep, second order: see `NUMERICS` in the repository's README.
    #[default]
    SmallSteps,
    /// Position Verlet and Jakobsen relaxation (2001), the 2013 plug-in's own: stiffness depends on iterations and step.
    Relaxation {
        /// Sweeps a substep.
        iterations: u32,
    },
    /// Explicit leapfrog springs: accurate when resolved, unstable past the explicit limit.
    Springs,
}

/// How finely a step is divided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quality {
    /// This many substeps in each step.
    Substeps(u32),
    /// As many as keep the worst stretch strain below this, from closed forms (see [`crate::quality`]).
    Strain(f32),
}

impl Default for Quality {
    fn default() -> Quality {
        Quality::Strain(0.03)
    }
}

/// What is fixed when a [`Deformer`] is made.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Where the work is done.
    pub backend: Backend,
    /// How the edges hold together.
    pub method: Method,
    /// How finely a step is divided.
    pub quality: Quality,
    /// What the cloth is made of.
    pub fabric: Fabric,
    /// Vertices that move only as [`Attributes::pin_targets`] says; each at most once.
    pub pinned: Vec<u32>,
    /// Mass of each vertex [kg]; `None`: a third of each of its triangles' `density * area`.
    pub mass: Option<Vec<f32>>,
    /// Factor on `fabric.stretch` for each of [`Mesh::edges`], 0 or above: below 1 along the diagonals gives soft shear.
    pub edge_scale: Option<Vec<f32>>,
}

/// What one step did, known without reading anything back.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepReport {
    /// Substeps taken.
    pub substeps: u32,
    /// What the caller should know.
    pub warnings: Vec<Warning>,
}

/// Something a step met that is worth knowing.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// Bending was softened at some vertices to stay stable at this substep.
    BendingLimited {
        /// Number of vertices.
        vertices: usize,
    },
    /// Explicit springs run past their stability limit.
    ExplicitLimit {
        /// Substeps taken.
        substeps: u32,
        /// Substeps that would be stable.
        needed: u32,
    },
}

/// Figures of the current state.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measure {
    /// Mean over the edges of `max(0, l/l0 - 1)`.
    pub mean_strain: f32,
    /// Maximum over the edges of `max(0, l/l0 - 1)`.
    pub max_strain: f32,
    /// Kinetic energy [J], of the velocities half a substep back (leapfrog).
    pub kinetic_energy: f64,
    /// Potential energy [J]: gravity (0 at rest), stretch (none if inextensible) and bending.
    pub potential_energy: f64,
    /// Depth [m] of the deepest vertex in the last step's colliders, 0 if none is inside.
    pub penetration: f32,
}

/// A cloth in motion.
#[derive(Debug)]
pub struct Deformer {}

impl Deformer {
    /// Builds the cloth and its state at frame 1: the mesh at rest.
    ///
    /// # Errors
    /// If the mesh or an option is out of its range, or the backend asked for has no GPU.
    pub fn new(_mesh: &Mesh, _options: Options) -> Result<Deformer, BuildError> {
        todo!()
    }
    /// Advances by `dt` [s].
    ///
    /// # Errors
    /// If `dt` or an attribute is out of its range, or the motion left the finite numbers; the state is then as it was.
    pub fn step(&mut self, _dt: f32, _attributes: &Attributes) -> Result<StepReport, StepError> {
        todo!()
    }
    /// Back to frame 1: rest positions, no velocity. What follows replays bit for bit.
    pub fn reset(&mut self) {
        todo!()
    }
    /// Positions [m], one per vertex, in the mesh's order.
    ///
    /// # Errors
    /// If the GPU was lost, or the motion left the finite numbers since the last look.
    pub fn positions(&mut self) -> Result<&[Vec3], StepError> {
        todo!()
    }
    /// Velocities [m/s], one per vertex, in the mesh's order, half a substep back (leapfrog).
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn velocities(&mut self) -> Result<&[Vec3], StepError> {
        todo!()
    }
    /// Puts the cloth somewhere else: positions [m] and velocities [m/s], one per vertex, in the mesh's order.
    ///
    /// # Errors
    /// If a list has another length or a value is not finite.
    pub fn set_state(&mut self, _positions: &[Vec3], _velocities: &[Vec3]) -> Result<(), StepError> {
        todo!()
    }
    /// Strain, energy and penetration of the current state.
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn measure(&mut self) -> Result<Measure, StepError> {
        todo!()
    }
    /// The backend in use, never [`Backend::Auto`].
    #[must_use]
    pub fn backend(&self) -> Backend {
        todo!()
    }
    /// The GPU's name, if one is in use.
    #[must_use]
    pub fn adapter(&self) -> Option<&str> {
        todo!()
    }
    /// Number of colours of the edges.
    #[must_use]
    pub fn colours(&self) -> usize {
        todo!()
    }
}
