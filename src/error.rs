//! What can go wrong, an enum for each operation. Every message names the thing, its value and the way out.

use glam::Vec3;

/// Why [`Deformer::new`](crate::Deformer::new) refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// A mesh without vertices.
    #[error("the mesh has no vertices; give it at least one")]
    NoVertices,
    /// More vertices than an index can name exactly.
    #[error("the mesh has {vertices} vertices, more than {limit}; split it", limit = crate::limits::MAX_VERTICES)]
    TooManyVertices {
        /// Number of vertices.
        vertices: usize,
    },
    /// A vertex at NaN or infinity, or so far out that its square overflows.
    #[error("vertex {vertex} is at {position}; positions must be finite and within 1e15 m")]
    Position {
        /// The vertex.
        vertex: usize,
        /// Its position.
        position: Vec3,
    },
    /// A triangle that names a vertex the mesh lacks.
    #[error("triangle {triangle} names vertex {index}, but the mesh has {vertices} vertices (numbered from 0)")]
    Index {
        /// The triangle.
        triangle: usize,
        /// The index it gives.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A pin on a vertex the mesh lacks.
    #[error("pinned[{slot}] = {index}, but the mesh has {vertices} vertices (numbered from 0)")]
    Pin {
        /// Place in the list.
        slot: usize,
        /// The index it gives.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A vertex pinned twice, so that its target would not be one.
    #[error("pinned[{slot}] = {index} is pinned already; name each vertex once")]
    PinTwice {
        /// Place of the second mention.
        slot: usize,
        /// The vertex.
        index: u32,
    },
    /// A list in the options that is not one value a thing.
    #[error("{name} has {given} values, but the mesh has {expected} {things}; give one for each")]
    Length {
        /// The option.
        name: &'static str,
        /// Its length.
        given: usize,
        /// The length it must have.
        expected: usize,
        /// What it counts.
        things: &'static str,
    },
    /// A number in the options out of its range.
    #[error("{name} = {value}; {remedy}")]
    Value {
        /// The option, with its index where it is a list.
        name: String,
        /// What was given.
        value: String,
        /// What it must be.
        remedy: &'static str,
    },
    /// No adapter for the backend that was asked for.
    #[error("no GPU for {backend}: {reason}; install a Vulkan, Metal or DX12 driver, or ask for the CPU")]
    NoGpu {
        /// The backend.
        backend: &'static str,
        /// What the driver or the build said.
        reason: String,
    },
}

/// Why [`Deformer::step`](crate::Deformer::step) or a read of the state failed. The state is what it was before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// A time step that is no time.
    #[error("dt = {dt} s; the time step must be finite and at least {least} s", least = crate::limits::MIN_TIME_STEP)]
    TimeStep {
        /// The time step.
        dt: f32,
    },
    /// An attribute out of its range.
    #[error("{name} = {value} {remedy}")]
    Attribute {
        /// The attribute.
        name: String,
        /// What was given.
        value: String,
        /// What it must be.
        remedy: String,
    },
    /// Not one target for each pin.
    #[error(
        "pin_targets has {given} positions, but {pinned} vertices are pinned; give one for each, in the order of Options::pinned"
    )]
    PinTargets {
        /// Number of targets.
        given: usize,
        /// Number of pins.
        pinned: usize,
    },
    /// A state that is not one value for each vertex, or not finite.
    #[error("{name}: {problem}; give a finite vector, none beyond 1e15, for each of the mesh's {vertices} vertices")]
    State {
        /// `positions` or `velocities`.
        name: &'static str,
        /// What is wrong with it.
        problem: String,
        /// Number of vertices.
        vertices: usize,
    },
    /// The tolerance asks for more substeps than a step takes.
    #[error(
        "the step needs {needed} substeps (times iterations), more than {limit}; use a shorter dt, a larger strain tolerance or Quality::Substeps",
        limit = crate::limits::MAX_SUBSTEPS
    )]
    TooManySubsteps {
        /// Substeps that the closed form asks for.
        needed: f64,
    },
    /// The state stopped being finite during the step.
    #[error("unstable: vertex {vertex} left all bounds (1e15 m, or not a number); {remedy}")]
    Unstable {
        /// The first such vertex.
        vertex: usize,
        /// What helps.
        remedy: String,
    },
    /// More of the cloth is in one place than contact can look at.
    #[error(
        "contact: {pairs} pairs of groups of triangles are near one another, as if all cloth were in one place; spread it out, or lower contact.thickness"
    )]
    Crowded {
        /// Pairs of groups of a few triangles.
        pairs: usize,
    },
    /// The GPU was lost or refused the work.
    #[error("the GPU failed: {reason}; make a new Deformer, or ask for the CPU")]
    Gpu {
        /// What the driver said.
        reason: String,
    },
}
