//! The mathematics of the solver as pure functions, generic over the number of SIMD lanes. `shaders/` has the same
//! functions in WGSL, in files of the same names (what is in `contact/` is in one file there).
//!
//! Within a substep of length `h`, a vertex is at `x` (m) and will move by `u` (m). `p` (m) is its displacement over
//! the last substep, so its velocity is `p / h`. Everything is formulated in displacements: computed as
//! `(x - x_prev) / h` in single precision, a velocity would lose gravity altogether once `h² g` approaches the last bit
//! of `x`. Storing `p` instead of `v` saves a division, and the rounding errors of `v -> h v -> v` cannot add up over
//! thousands of substeps.

pub(crate) mod bending;
pub(crate) mod contact;
pub(crate) mod distance;
pub(crate) mod follow;
pub(crate) mod integrate;
pub(crate) mod limits;
pub(crate) mod pair;
pub(crate) mod params;
pub(crate) mod plane;
pub(crate) mod rigid;
pub(crate) mod spring;
pub(crate) mod statistics;
pub(crate) mod tether;
pub(crate) mod watch;
pub(crate) mod wind;
