//! The bounds of what the crate takes.

/// Most vertices: as many as buffers of 16 bytes each can be bound for on common GPUs.
pub(crate) const MAX_VERTICES: usize = 1 << 24;
/// Most bytes of an OBJ that are read: 256 for each of so many vertices, which leaves room for normals, texture and two faces each.
pub(crate) const MAX_OBJ_BYTES: u64 = 256 * MAX_VERTICES as u64;
/// Farther out (m), squares soon overflow. Displacements and given velocities have the same bound, and so has `limits.wgsl`.
pub(crate) const MAX_POSITION: f32 = 1e15;
/// Shortest step (s): below it a displacement no longer gives a velocity in single precision.
pub(crate) const MIN_TIME_STEP: f32 = 1e-9;
/// Most substeps in a step.
pub(crate) const MAX_SUBSTEPS: u32 = 1 << 16;
