//! The crate's errors: one enum for each operation. Every message names what is wrong, its value and a remedy.

pub(crate) mod failure;

use std::fmt::Display;

use glam::Vec3;

/// Why [`Deformer::new`](crate::Deformer::new) failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The mesh has no vertices.
    #[error("the mesh has no vertices; give it at least one")]
    NoVertices,
    /// The mesh has more vertices than buffers can hold on common GPUs.
    #[error("the mesh has {vertices} vertices, more than {limit}; split it", limit = crate::kernels::limits::MAX_VERTICES)]
    TooManyVertices {
        /// Number of vertices.
        vertices: usize,
    },
    /// A vertex is not finite, or so far from the origin that squares overflow.
    #[error("vertex {vertex} is at {position}; positions must be finite and within 1e15 m")]
    Position {
        /// The vertex.
        vertex: usize,
        /// Its position.
        position: Vec3,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} names vertex {index}, but the mesh has {vertices} vertices (numbered from 0)")]
    Index {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex index in it.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A pin refers to a vertex that does not exist.
    #[error("pinned[{slot}] = {index}, but the mesh has {vertices} vertices (numbered from 0)")]
    Pin {
        /// Position in the list.
        slot: usize,
        /// The vertex index there.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A vertex is pinned twice, which would give it two targets.
    #[error("pinned[{slot}] = {index} is pinned already; name each vertex once")]
    PinTwice {
        /// Position of the second mention in the list.
        slot: usize,
        /// The vertex.
        index: u32,
    },
    /// A list in the options has the wrong length.
    #[error("{name} has {given} values, but the mesh has {expected} {things}; give one for each")]
    Length {
        /// The option.
        name: &'static str,
        /// Its length.
        given: usize,
        /// The length it must have.
        expected: usize,
        /// What it must have one value for: `vertices` or `edges`.
        things: &'static str,
    },
    /// A number in the options is out of its range.
    #[error("{name} = {value}; {remedy}")]
    Value {
        /// The option, with an index if it is a list.
        name: String,
        /// The value given.
        value: String,
        /// The values it may have.
        remedy: &'static str,
    },
    /// A step of [`tune`](crate::tune()) failed.
    #[error("frame {frame}: {error}")]
    Step {
        /// The frame, counted from 1; 0 if the initial state could not be set.
        frame: u32,
        /// The step's error.
        error: StepError,
    },
    /// There is no GPU for the requested backend.
    #[error("no GPU for {backend}: {reason}, or ask for the CPU")]
    NoGpu {
        /// The backend.
        backend: &'static str,
        /// The reason given by the driver, or that the build has no GPU support; and what to do about it.
        reason: String,
    },
    /// The device was lost before or while the cloth was created on it.
    #[error("no GPU for {backend}: {gpu} was lost; make a new device, or ask for the CPU")]
    GpuLost {
        /// The backend.
        backend: &'static str,
        /// The device.
        gpu: String,
    },
    /// The device is out of memory.
    #[error("no GPU for {backend}: out of memory ({reason}); free some memory, split the mesh, or ask for the CPU")]
    GpuMemory {
        /// The backend.
        backend: &'static str,
        /// The driver's message.
        reason: String,
    },
    /// The cloth exceeds a limit of the device.
    #[error(
        "no GPU for {backend}: {thing}: {needed}, but {limit} of the device is {allowed}; request a device with more, split the mesh, or ask for the CPU"
    )]
    GpuLimit {
        /// The backend.
        backend: &'static str,
        /// What exceeds it.
        thing: &'static str,
        /// The amount needed: bytes of a buffer, or a count.
        needed: u64,
        /// The field of `wgpu::Limits`.
        limit: &'static str,
        /// The device's value of that limit.
        allowed: u64,
    },
}

impl BuildError {
    /// A number that is out of its range.
    pub(crate) fn value(name: impl Display, value: impl Display, remedy: &'static str) -> BuildError {
        BuildError::Value { name: name.to_string(), value: value.to_string(), remedy }
    }
}

/// Why [`Deformer::step`](crate::Deformer::step) or reading the state failed. The state is that of the
/// last good step, unless the variant says that it is lost.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// The time step is not finite or too short.
    #[error("dt = {dt} s; the time step must be finite and at least {least} s, or 0 for a step that only checks", least = crate::kernels::limits::MIN_TIME_STEP)]
    TimeStep {
        /// The time step (s).
        dt: f32,
    },
    /// An attribute is out of its range.
    #[error("{name} = {value} {remedy}")]
    Attribute {
        /// The attribute, with an index if it is a list.
        name: String,
        /// The value given.
        value: String,
        /// The values it may have.
        remedy: String,
    },
    /// The number of pin targets is not the number of pins.
    #[error(
        "pin_targets has {given} positions, but {pinned} vertices are pinned; give one for each, in the order of Options::pinned"
    )]
    PinTargets {
        /// Number of targets.
        given: usize,
        /// Number of pins.
        pinned: usize,
    },
    /// A list passed to `set_state` has the wrong length, or a value that is not finite.
    #[error("{name}: {problem}; give a finite vector, none beyond 1e15, for each of the mesh's {vertices} vertices")]
    State {
        /// `positions` or `velocities`.
        name: &'static str,
        /// What is wrong with it.
        problem: String,
        /// Number of vertices.
        vertices: usize,
    },
    /// The step would take more substeps than the limit.
    #[error(
        "the step needs {needed} substeps (times iterations), more than {limit}; use a shorter dt, or fewer substeps or iterations",
        limit = crate::kernels::limits::MAX_SUBSTEPS
    )]
    TooManySubsteps {
        /// Number of substeps the step needs, times the iterations of a relaxation.
        needed: f64,
    },
    /// The motion became unstable during a step. The state is that of the last good step.
    #[error("unstable: {cause}, in step {step}; {remedy}")]
    Unstable {
        /// The first vertex out of bounds, the first that is too fast, or an end of the overlong edge.
        vertex: usize,
        /// What went wrong.
        cause: Instability,
        /// The step, counted from 1 since the cloth was created, reset or given a state.
        step: u32,
        /// What to change.
        remedy: String,
    },
    /// The device was lost, and with it the state of every cloth on it; cloths on other devices are not affected.
    /// Operations that wait for the device or read from it report this at once, steps at most sixteen steps later.
    #[error("{gpu} was lost, and the cloth's state with it; make a new Deformer on a new device, or on the CPU")]
    GpuLost {
        /// The device.
        gpu: String,
    },
    /// The device has no memory left for something that this step is the first to need.
    #[error("the GPU is out of memory ({reason}); free some memory and make a new Deformer, or ask for the CPU")]
    GpuMemory {
        /// The driver's message.
        reason: String,
    },
    /// Something that this step is the first to need exceeds a limit of the device.
    #[error("{thing}: {needed}, but {limit} of the GPU is {allowed}; make a new Deformer on a device with more, or on the CPU")]
    GpuLimit {
        /// What exceeds it.
        thing: &'static str,
        /// The amount needed: bytes of a buffer, or a count.
        needed: u64,
        /// The field of `wgpu::Limits`.
        limit: &'static str,
        /// The device's value of that limit.
        allowed: u64,
    },
    /// So much of the cloth is in one place, or moves through it, that contact cannot process all candidate pairs.
    #[error(
        "contact: {pairs} pairs of features, or more, are close to each other, as if the whole cloth were in one place, or moved by more than its size in a substep; spread it out, slow it down, or lower contact.thickness"
    )]
    Crowded {
        /// Number of pairs of triangles, edges or vertices, or of groups of them, that would have to be compared, at least.
        pairs: usize,
    },
    /// The GPU failed for another reason.
    #[error("the GPU failed: {reason}; make a new Deformer, or ask for the CPU")]
    Gpu {
        /// The driver's message.
        reason: String,
    },
}

/// How a motion became unstable: see [`StepError::Unstable`]. The bounds on energy and length are eight times what
/// everything in the scene together can explain, so that even a violent motion stays within them.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Instability {
    /// A vertex is beyond 1e15 m, or its position is not a number.
    #[error("vertex {vertex} is beyond 1e15 m or not a number")]
    NotFinite {
        /// The first such vertex.
        vertex: usize,
    },
    /// The cloth has more kinetic energy than gravity, air, pins, colliders, elasticity and its initial state can have
    /// given it.
    #[error(
        "the cloth, vertex {vertex} among others, moves faster than {speed} m/s (root mean square), eight times what gravity, wind, pins, colliders and elasticity can explain"
    )]
    Energy {
        /// The first vertex faster than the bound.
        vertex: usize,
        /// The bound on the cloth's speed (m/s), the root of twice its kinetic energy over its mass.
        speed: f32,
    },
    /// An edge is many times longer than the whole cloth. A step checks only some of the edges, so this may be found up to 128 steps
    /// late, or on a GPU as many as the edges have colors.
    #[error("edge {}-{} is longer than {length} m, eight times the size of the cloth stretched by its weight and speed", ends[0], ends[1])]
    Edge {
        /// The two ends of the edge.
        ends: [u32; 2],
        /// The bound on its length (m).
        length: f32,
    },
}

/// Why a [`Snapshot`](crate::Snapshot) could not be restored. The state is unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// The bytes do not begin like a snapshot.
    #[error("these bytes are not a snapshot; pass what Snapshot::to_bytes returned")]
    Foreign,
    /// The snapshot was written in another version of the format.
    #[error(
        "the snapshot has format version {found}, but this version of the crate reads version {known}; use the version of the crate that wrote it"
    )]
    Version {
        /// Its format version.
        found: u32,
        /// The format version that this crate reads.
        known: u32,
    },
    /// The snapshot was truncated, extended or altered after it was taken.
    #[error("the snapshot was truncated or altered; use another copy, or an earlier snapshot")]
    Altered,
    /// The snapshot is of a cloth with another mesh or other options.
    #[error(
        "the snapshot is of a cloth whose {what} differs; make the Deformer with the mesh and the options of that cloth, or set them as they were"
    )]
    Other {
        /// The first difference: `mesh`, or the name of an option.
        what: &'static str,
    },
    /// The snapshot was taken on a processor with another SIMD width, which rounds differently.
    #[error(
        "the snapshot was taken on a processor with {taken} SIMD lanes, and this one has {here}, which rounds differently; restore it on a processor with {taken}"
    )]
    Lanes {
        /// SIMD lanes where it was taken.
        taken: u32,
        /// SIMD lanes here.
        here: u32,
    },
    /// The GPU did not accept the state.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// Why [`Deformer::set_fabric`](crate::Deformer::set_fabric), `set_mass` or `set_pinned` failed. The cloth is
/// unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ChangeError {
    /// A value is out of its range.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The state could not be read from the GPU, or the GPU has no memory left.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// Why [`Deformer::warp`](crate::Deformer::warp) failed. The cloth is unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WarpError {
    /// The motion is more than a rotation and a translation.
    #[error("motion {problem}: {motion}; give a rotation and a translation")]
    NotRigid {
        /// What else it does: scale, shear or mirror.
        problem: &'static str,
        /// The motion.
        motion: Box<glam::Affine3A>,
    },
    /// The motion moves a vertex beyond the range of valid positions.
    #[error("motion takes vertex {vertex} beyond 1e15 m; use a smaller translation")]
    TooFar {
        /// The vertex.
        vertex: usize,
    },
    /// The state could not be read from the GPU.
    #[error(transparent)]
    Step(#[from] StepError),
}
