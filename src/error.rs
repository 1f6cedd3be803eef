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
    /// A step of a run that [`tune`](crate::tune()) needs failed.
    #[error("frame {frame}: {error}")]
    Step {
        /// The frame, numbered from 1.
        frame: u32,
        /// Why.
        error: StepError,
    },
    /// No adapter for the backend that was asked for.
    #[error("no GPU for {backend}: {reason}; install a Vulkan, Metal or DX12 driver, or ask for the CPU")]
    NoGpu {
        /// The backend.
        backend: &'static str,
        /// What the driver or the build said.
        reason: String,
    },
    /// The device was lost before or while the cloth was built on it.
    #[error("no GPU for {backend}: {gpu} was lost; make a new device, or ask for the CPU")]
    GpuLost {
        /// The backend.
        backend: &'static str,
        /// The device.
        gpu: String,
    },
    /// The device has no memory left.
    #[error("no GPU for {backend}: out of memory ({reason}); free some, split the mesh, or ask for the CPU")]
    GpuMemory {
        /// The backend.
        backend: &'static str,
        /// What the driver said.
        reason: String,
    },
    /// The device does not take so much.
    #[error(
        "no GPU for {backend}: {thing}: {needed}, but {limit} of the device is {allowed}; request a device with more, split the mesh, or ask for the CPU"
    )]
    GpuLimit {
        /// The backend.
        backend: &'static str,
        /// What is too much.
        thing: &'static str,
        /// How much it is: bytes of a buffer, or a number.
        needed: u64,
        /// The limit, by its name in `wgpu::Limits`.
        limit: &'static str,
        /// What the device has.
        allowed: u64,
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
    /// The motion ran away during a step; the state is that of the step before.
    #[error("unstable: {cause}, in step {frame}; {remedy}")]
    Unstable {
        /// The first vertex out of bounds, the first that is too fast, or an end of the edge.
        vertex: usize,
        /// What went wrong.
        cause: Instability,
        /// The step, counted from 1 since the cloth was made, reset or put somewhere.
        frame: u32,
        /// What helps.
        remedy: String,
    },
    /// The device was lost, and with it the state of every cloth on it; those elsewhere go on. Found at once by what waits for the device or
    /// reads from it, and by a step at most sixteen steps later.
    #[error("{gpu} was lost, and the cloth's state with it; make a new Deformer on a new device, or on the CPU")]
    GpuLost {
        /// The device.
        gpu: String,
    },
    /// The device has no memory left for what the step is the first to need.
    #[error("the GPU is out of memory ({reason}); free some and make a new Deformer, or ask for the CPU")]
    GpuMemory {
        /// What the driver said.
        reason: String,
    },
    /// What the step is the first to need is more than the device takes.
    #[error("{thing}: {needed}, but {limit} of the GPU is {allowed}; make a new Deformer on a device with more, or on the CPU")]
    GpuLimit {
        /// What is too much.
        thing: &'static str,
        /// How much it is: bytes of a buffer, or a number.
        needed: u64,
        /// The limit, by its name in `wgpu::Limits`.
        limit: &'static str,
        /// What the device has.
        allowed: u64,
    },
    /// More of the cloth is in one place than contact can look at.
    #[error(
        "contact: {pairs} pairs of groups of triangles are near one another, as if all cloth were in one place; spread it out, or lower contact.thickness"
    )]
    Crowded {
        /// Pairs of groups of a few triangles.
        pairs: usize,
    },
    /// The GPU refused the work.
    #[error("the GPU failed: {reason}; make a new Deformer, or ask for the CPU")]
    Gpu {
        /// What the driver said.
        reason: String,
    },
}

/// How a motion ran away. The bounds are eight times what everything in the scene together explains, so that a wild motion passes
/// none: see [`StepError::Unstable`].
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Instability {
    /// A vertex is farther out than 1e15 m, or nowhere.
    #[error("vertex {vertex} left all bounds (1e15 m, or not a number)")]
    NotFinite {
        /// The first such vertex.
        vertex: usize,
    },
    /// The cloth has more kinetic energy than gravity, air, pins, colliders, its elasticity and what it was given can have brought.
    #[error(
        "the cloth, vertex {vertex} among others, moves faster than {speed} m/s (root mean square), eight times what gravity, wind, pins, colliders and elasticity explain"
    )]
    Energy {
        /// The first vertex that is faster.
        vertex: usize,
        /// The bound on the cloth's speed (m/s): the root of twice its kinetic energy over its mass.
        speed: f32,
    },
    /// An edge is longer than all of the cloth, many times over. A step looks at a few of the edges, the next at the next, so that every one is
    /// seen once in 128 steps.
    #[error("edge {}-{} is longer than {length} m, eight times the cloth with all that its weight and speed stretch it by", ends[0], ends[1])]
    Edge {
        /// Its ends.
        ends: [u32; 2],
        /// The bound on its length (m).
        length: f32,
    },
}

/// Why a [`Snapshot`](crate::Snapshot) cannot be gone on from. The state is what it was before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// Bytes that do not begin as a snapshot does.
    #[error("these bytes are no snapshot; give those of Snapshot::to_bytes")]
    Foreign,
    /// A snapshot of another version of the form.
    #[error("the snapshot has form {found}, but this version of the crate reads form {known}; use the version that wrote it")]
    Version {
        /// Its form.
        found: u32,
        /// The form that is read here.
        known: u32,
    },
    /// A snapshot that was cut, lengthened or altered since it was made.
    #[error("the snapshot was cut or altered; take another copy, or an earlier one")]
    Altered,
    /// A snapshot of a cloth that was made of another mesh or with other options.
    #[error(
        "the snapshot is of a cloth whose {what} differs; make the Deformer with the mesh and the options that it was taken with"
    )]
    Other {
        /// What differs first: `mesh`, or the name of an option.
        what: &'static str,
    },
    /// The processor computes on another number of lanes at once, and so rounds differently.
    #[error(
        "the snapshot was taken on a processor with {taken} lanes, and this one has {here}, which gives other bits; restore it on one with {taken}"
    )]
    Lanes {
        /// Lanes where it was taken.
        taken: u32,
        /// Lanes here.
        here: u32,
    },
    /// The GPU did not take it.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// Why [`Deformer::set_fabric`](crate::Deformer::set_fabric), `set_mass` or `set_pinned` refused. The cloth is what it was before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ChangeError {
    /// What was given is out of its range.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The state could not be read from the GPU, or the GPU has no room.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// Why [`Deformer::warp`](crate::Deformer::warp) refused. The cloth is where it was before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WarpError {
    /// A motion that does more than turn and move.
    #[error("motion {problem}: {motion}; give a rotation and a translation")]
    NotRigid {
        /// What it does besides.
        problem: &'static str,
        /// The motion.
        motion: Box<glam::Affine3A>,
    },
    /// A motion to where positions are no longer computed with.
    #[error("motion takes vertex {vertex} beyond 1e15 m; move it less far")]
    TooFar {
        /// The vertex.
        vertex: usize,
    },
    /// The state could not be read from the GPU.
    #[error(transparent)]
    Step(#[from] StepError),
}
