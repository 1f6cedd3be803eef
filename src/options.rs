//! What is fixed when a cloth is made, and what a step reports.

use crate::device::Gpu;
use crate::error::BuildError;
use crate::fabric::Fabric;
use crate::limits::MAX_SUBSTEPS;

/// Where the work is done. All three give the same motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Backend {
    /// A real GPU if there is one and the mesh is large enough to gain from it, else the CPU.
    #[default]
    Auto,
    /// Rayon's threads: the cloth in tiles, edges in the order of their colors, the same bits on any number of threads.
    Cpu,
    /// Forces that differ from vertex to vertex on the GPU, edges and contact on the CPU, every substep: as the 2013 plug-in did it.
    Hybrid,
    /// Everything on the GPU; read back when asked for.
    Gpu,
}

/// How the edges hold together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Method {
    /// Small-step XPBD, one sweep a substep, second order in the substep: see "How it works".
    #[default]
    SmallSteps,
    /// Position Verlet and Jakobsen relaxation (2001), the 2013 plug-in's own: stiffness depends on iterations and step,
    /// not on [`Fabric::stretch`]. One substep in 1/60 s under [`Quality::Strain`].
    Relaxation {
        /// Sweeps a substep.
        iterations: u32,
    },
    /// Explicit leapfrog springs: accurate when resolved, unstable past the explicit limit.
    Springs,
}

/// How finely a step is divided.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Quality {
    /// This many substeps in 1/60 s, which gives the substep its length. A step of another `dt` takes as many as keep them no longer:
    /// `ceil(60 dt n)`. Cloth that is too stiff for its substeps is as stretchy as they make it, and so it is equally stretchy in steps
    /// of any length.
    Substeps(u32),
    /// As many as keep the worst stretch below this strain beyond the fabric's own, from a closed form:
    /// `S = S* sqrt(2 sigma / (K tolerance))`, `S*` the substeps that resolve the stiffness K, `sigma` five times the stress
    /// `rho g L` of cloth hung at its full extent, plus the wind's, on each edge as much as there is cloth along it. At least 20 in
    /// 1/60 s, at most 1.4 `S*`.
    Strain(f32),
}

impl Default for Quality {
    fn default() -> Quality {
        Quality::Strain(0.03)
    }
}

/// Corrections on coarser cloths ahead of each sweep, which keep strain from growing with the number of vertices: see
/// "How it works". For [`Method::SmallSteps`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Levels {
    /// As many as pay: none where the substeps resolve the stiffness or nearly so, the mesh is small, or the wind's pressure is ten
    /// times the cloth's weight (5 m/s for 0.2 kg/m²), where they would show small wrinkles for stretch.
    #[default]
    Auto,
    /// None: nothing is built or run.
    Off,
    /// This many, or as many as the mesh has; the finest has aggregates of about 16 vertices, each next one of four times as many.
    Count(u32),
}

/// What is fixed when a [`Deformer`](crate::Deformer) is made.
///
/// A plain struct. Write what differs from the default, and the next version's fields do not break you:
///
/// ```
/// # use cloth_deformer::{Backend, Fabric, Options};
/// let options = Options { backend: Backend::Cpu, fabric: Fabric::SILK, pinned: vec![0], ..Options::default() };
/// # assert!(options.gpu.is_none());
/// ```
///
/// Its fields are the same with and without the `gpu` feature.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Where the work is done.
    pub backend: Backend,
    /// How the edges hold together.
    pub method: Method,
    /// How finely a step is divided.
    pub quality: Quality,
    /// What carries stress farther than an edge in one substep.
    pub levels: Levels,
    /// What the cloth is made of.
    pub fabric: Fabric,
    /// A device of the caller's, for `Deformer::position_buffer`; `None`: one is requested when needed.
    /// Always `None` in a build without the `gpu` feature, where there is no [`Gpu`].
    pub gpu: Option<Gpu>,
    /// Vertices that move only as [`Attributes::pin_targets`](crate::Attributes::pin_targets) says; each at most once.
    pub pinned: Vec<u32>,
    /// Mass of each vertex (kg); `None`: a third of each of its triangles' `density * area`.
    pub mass: Option<Vec<f32>>,
    /// Factor on `fabric.stretch` for each of [`Mesh::edges`](crate::Mesh::edges), 0 or above: below 1 along the diagonals gives soft shear.
    ///
    /// Woven cloth shears at 20..100 N/m. A grid's shear stiffness is a quarter of its diagonals', `scale * stretch / 4`:
    /// 0.02 along the diagonals makes 25 N/m of 5 kN/m, and the cloth gives way along the bias as fabric does.
    pub edge_scale: Option<Vec<f32>>,
}

/// What one step did, known without reading anything back.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct StepReport {
    /// Substeps taken.
    pub substeps: u32,
    /// Coarse levels in each of them.
    pub levels: u32,
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
    /// Explicit springs run past their stability limit: cloth that moves may shake itself to pieces.
    ExplicitLimit {
        /// Substeps taken.
        substeps: u32,
        /// Substeps that are stable however the cloth moves.
        needed: u32,
    },
    /// Some edges are a hundred times shorter than their triangles: so stiff that few substeps stretch them by many times their
    /// length, which the strain that [`Quality::Strain`] promises leaves out. Merge their ends, or make the triangles rounder.
    Slivers {
        /// Number of such edges.
        edges: usize,
        /// The worst of them, by the mesh's vertices.
        worst: [u32; 2],
    },
}

impl Options {
    /// Checks what does not depend on the mesh.
    pub(crate) fn check_numbers(&self) -> Result<(), BuildError> {
        let refuse = |name: &str, value: String, remedy| Err(BuildError::Value { name: name.to_owned(), value, remedy });
        match self.quality {
            Quality::Substeps(count) if !(1..=MAX_SUBSTEPS).contains(&count) => {
                return refuse("quality: Substeps", count.to_string(), "must be 1 to 65536");
            }
            Quality::Strain(tolerance) if !(tolerance > 0.0 && tolerance.is_finite()) => {
                return refuse("quality: Strain", tolerance.to_string(), "must be finite and above 0; 0.03 is three per cent");
            }
            _ => {}
        }
        match self.method {
            Method::Relaxation { iterations } if !(1..=MAX_SUBSTEPS).contains(&iterations) => {
                refuse("method: Relaxation iterations", iterations.to_string(), "must be 1 to 65536")
            }
            Method::Springs if self.fabric.stretch.is_infinite() => refuse(
                "fabric.stretch",
                self.fabric.stretch.to_string(),
                "explicit springs cannot be inextensible; use SmallSteps",
            ),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/options.rs"]
mod tests;
