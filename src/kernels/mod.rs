//! The mathematics: values in, values out, once for every number of lanes. `shaders/` has the same files and functions.
//!
//! Within a substep of length `h` a vertex is at `x` (m) and will move by `u` (m); `p` (m) is its displacement over the
//! substep before, so its velocity is `p / h`. Everything is written in displacements: formed as `(x - x_prev) / h` in
//! single precision, a velocity loses gravity altogether once `h^2 g` nears the last bit of `x`. Storing `p` rather than
//! `v` spares a division and lets no rounding of `v -> h v -> v` add up over thousands of substeps.

pub(crate) mod bending;
pub(crate) mod contact;
pub(crate) mod distance;
pub(crate) mod integrate;
pub(crate) mod pair;
pub(crate) mod params;
pub(crate) mod rigid;
pub(crate) mod spring;
pub(crate) mod statistics;
pub(crate) mod tether;
pub(crate) mod watch;
pub(crate) mod wind;
