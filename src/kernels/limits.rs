//! Limits on the input, which keep the arithmetic within the range of single precision and buffers within what GPUs bind.

use glam::Vec3;

/// Most vertices of a mesh. Their 16-byte records take 256 MiB, which common GPUs can bind as one buffer.
pub(crate) const MAX_VERTICES: usize = 1 << 24;
/// Largest coordinate (m): much beyond it, squares overflow. Displacements and given velocities have the same bound.
/// `limits.wgsl` repeats it.
pub(crate) const MAX_POSITION: f32 = 1e15;
/// Shortest step (s): below it, a displacement no longer gives a velocity in single precision.
pub(crate) const MIN_TIME_STEP: f32 = 1e-9;
/// Most substeps in a step.
pub(crate) const MAX_SUBSTEPS: u32 = 1 << 16;

/// Whether no component of a vector is beyond [`MAX_POSITION`] or NaN.
pub(crate) fn is_bounded(v: Vec3) -> bool {
    v.abs().cmple(Vec3::splat(MAX_POSITION)).all()
}
