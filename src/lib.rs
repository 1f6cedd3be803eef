#![doc = include_str!("../README.md")]

mod attributes;
mod backend;
mod binding;
mod contact;
mod cpu;
mod deformer;
#[cfg_attr(not(feature = "gpu"), path = "device/absent.rs")]
mod device;
mod error;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(any(doc, doctest))]
pub mod guide;
#[cfg(feature = "gpu")]
mod hybrid;
mod io;
mod kernels;
mod model;
mod multigrid;
mod options;
#[cfg(test)]
#[allow(unreachable_pub, reason = "the tests of the crate take it too")]
#[path = "../tests/common/oracle.rs"]
mod oracle;
mod past;
mod record;
mod simd;
mod step;
mod tune;

/// Whether there are threads. The module of a web page has none, and does not contain the code for them, which it would download.
pub(crate) const HAS_THREADS: bool = cfg!(not(target_arch = "wasm32"));

/// The number of threads of the current pool.
pub(crate) fn threads() -> usize {
    if HAS_THREADS { rayon::current_num_threads() } else { 1 }
}

pub use attributes::{Attributes, Collider, Shape};
pub use binding::{BindError, Binding};
pub use deformer::{Deformer, Forecast, Measure, Snapshot, Untangled};
pub use device::Gpu;
pub use error::{BuildError, ChangeError, Instability, StateError, StepError, WarpError};
pub use glam;
#[cfg(feature = "gpu")]
pub use gpu::{BoundMesh, Surface};
pub use io::cache_form::{CacheForm, UpAxis};
pub use io::obj::ObjError;
pub use io::obj::template::ObjTemplate;
pub use io::pc2_reader::{Pc2ReadError, PointCacheReader};
pub use io::point_cache::PointCache;
pub use io::point_cache_error::PointCacheError;
pub use model::mesh::Mesh;
pub use options::{
    Backend, Cause, Contact, Crossing, Fabric, Levels, Method, Options, Quality, Sleep, StepReport, Stretch, Tethers, Warning,
};
pub use tune::{Setting, Term, Terms, Tolerance, Trial, Tuned, tune};
#[cfg(feature = "gpu")]
pub use wgpu;
