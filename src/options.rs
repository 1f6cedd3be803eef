//! The settings a cloth is created with, and the report that each step returns.

use crate::device::Gpu;
use crate::error::BuildError;
use crate::fabric::Fabric;
use crate::kernels::statistics::SLOW;
use crate::limits::MAX_SUBSTEPS;

/// The processor that runs the simulation. All backends compute the same motion, up to rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Backend {
    /// A hardware GPU if there is one and the mesh has at least 16384 vertices, otherwise the CPU. [`Options::contact`]
    /// and [`Quality::Budget`] always select the CPU, because the GPU is not faster at the first and does not support the
    /// second. A step with a mesh collider ([`Collider::mesh`](crate::Collider::mesh)) moves the cloth to the CPU for
    /// good; `Deformer::position_buffer` and `Deformer::surface` then return `None`.
    #[default]
    Auto,
    /// The threads of the current rayon pool. The result is bit for bit the same on any number of threads.
    Cpu,
    /// The GPU computes the forces that differ between vertices (wind, bending, springs); the CPU solves edges and
    /// contact. Data goes back and forth in every substep, as in the 2013 plug-in.
    Hybrid,
    /// The GPU does everything. Positions are read back only when they are asked for.
    Gpu,
}

/// The solver for the edges of the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Method {
    /// XPBD with small steps (Macklin et al. 2019): one sweep over the edges per substep, second-order accurate in the
    /// substep. See "How it works" on the [front page](crate).
    #[default]
    SmallSteps,
    /// Position Verlet with Jakobsen's relaxation (2001), as in the 2013 plug-in. Stiffness depends on the iterations
    /// and the length of the substep, not on [`Fabric::stretch`]. With [`Quality::Strain`] it takes one substep per
    /// 1/60 s.
    Relaxation {
        /// Sweeps over the edges per substep.
        iterations: u32,
    },
    /// Springs integrated by explicit leapfrog: accurate when the substeps resolve the stiffness, unstable above the
    /// explicit limit ([`Warning::ExplicitLimit`]).
    Springs,
}

/// How many substeps a step is divided into.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Quality {
    /// A fixed number of substeps per 1/60 s. A step of length `dt` takes `ceil(60 dt n)`, so that its substeps are
    /// never longer than those of a step of 1/60 s. Cloth that is too stiff for its substeps stretches as much as the
    /// substep's length lets it; keeping that length makes it stretch equally whatever `dt` is.
    Substeps(u32),
    /// In every step, 99 percent of the cloth's area is stretched by at most this much beyond what the fabric itself
    /// yields under its load. Short for [`Quality::Hold`] with a share of 0.99.
    Strain(f32),
    /// As few substeps as keep the stretch of most of the cloth's area below a bound, chosen anew for every step.
    /// Before the step the number is predicted from what acts on the cloth (gravity, wind, its speed, how pins and
    /// colliders move) by the law `S = S* sqrt(2 sigma f / (K stretch))`, where `S*` is the number that resolves the
    /// stiffness K and sigma is the membrane stress. After the step the factor f is corrected from the measured
    /// stretch. The number is at least 5 per 1/60 s and at most 1.4 `S*`. If a step exceeded the bound,
    /// [`Warning::StrainMissed`] says by how much, and why.
    ///
    /// The choice is the same on any number of threads. On the GPU the measurements are three steps old, because a step
    /// never waits for one that was submitted shortly before. Pass [`StepReport::in_a_sixtieth`] to
    /// [`Quality::Substeps`] to repeat a step bit for bit. Only for [`Method::SmallSteps`].
    Hold {
        /// Largest stretch, `l/l0 - 1`, beyond the fabric's own stretch under the same load; 0.03 is three percent.
        stretch: f32,
        /// Share of the area that keeps the bound, 0.5 to 1. Each edge counts with the area of its triangles.
        share: f32,
    },
    /// As many substeps as fit into this time (ms) per step, estimated from the time that previous steps took, and at
    /// most 1.4 `S*` (see [`Quality::Hold`]). Timings differ between runs, so a run cannot be repeated exactly;
    /// [`StepReport::in_a_sixtieth`] repeats a single step. Not available on the GPU, where a step returns before the
    /// work is done. [`Deformer::step_all`](crate::Deformer::step_all) does not time individual cloths: one that was
    /// never stepped by itself takes 5 substeps per 1/60 s. Only for [`Method::SmallSteps`].
    Budget(f32),
}

impl Quality {
    /// Share of the area that [`Quality::Strain`] applies to.
    pub(crate) const MOST_OF_THE_AREA: f32 = 0.99;
}

impl Default for Quality {
    fn default() -> Quality {
        Quality::Strain(0.03)
    }
}

/// Corrections on coarse versions of the cloth before each sweep, which keep the strain from growing with the number of
/// vertices. See "How it works" on the [front page](crate). Only for [`Method::SmallSteps`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Levels {
    /// As many levels as improve the result for their cost. None if the substeps resolve the stiffness or nearly do, if
    /// a mesh of fewer than 1000 vertices has at least an eighth of the substeps that would, or if the wind's pressure
    /// is more than ten times the cloth's weight (5 m/s for 0.2 kg/m²), where levels turn stretch into small wrinkles.
    /// With [`Quality::Strain`] or [`Quality::Hold`] on [`Backend::Gpu`], also none below 8192 vertices, where levels take
    /// longer than the additional substeps that keep the same bound without them.
    #[default]
    Auto,
    /// No levels are built or run.
    Off,
    /// This many, or as many as the mesh has. The finest level has aggregates of about 16 vertices; each coarser level
    /// has aggregates four times as large.
    Count(u32),
}

/// When a cloth is put to sleep. A sleeping cloth stays exactly as it is, at no cost, until an attribute changes.
///
/// Write `Sleep { .., ..Sleep::default() }`, so that fields added later do not break your code. By default a cloth
/// sleeps once it has moved more slowly than 1 mm/s on average and 5 mm/s everywhere for half a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sleep {
    /// Largest root mean square of the vertices' speeds (m/s), at most 0.01.
    pub mean_speed: f32,
    /// Largest speed of any vertex (m/s).
    pub speed: f32,
    /// Time (s) for which the cloth must have been this slow, under attributes that did not change.
    pub after: f32,
}

impl Default for Sleep {
    fn default() -> Sleep {
        Sleep { mean_speed: 0.001, speed: 0.005, after: 0.5 }
    }
}

/// Direct attachments of the cloth near a lone pin, or a pair of neighboring pins, whose few edges carry everything
/// that hangs on them. See "How it works" on the [front page](crate). Only for [`Method::SmallSteps`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Tethers {
    /// While the substeps do not resolve the stiffness, each vertex near a lone pin is pulled to within its distance
    /// from the pin along the cloth, by a share that decreases with that distance (long range attachments: Kim,
    /// Chentanez and Müller 2012). A cloth without such a pin builds no tethers.
    #[default]
    Auto,
    /// No tethers are built or run.
    Off,
}

/// The settings a [`Deformer`](crate::Deformer) is created with.
///
/// Write only the fields that differ from the default, so that fields added later do not break your code:
///
/// ```
/// # use cloth_deformer::{Backend, Fabric, Options};
/// let options = Options { backend: Backend::Cpu, fabric: Fabric::SILK, pinned: vec![0], ..Options::default() };
/// # assert!(options.gpu.is_none());
/// ```
///
/// The fields are the same with and without the `gpu` feature.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// The processor that runs the simulation.
    pub backend: Backend,
    /// The solver for the edges.
    pub method: Method,
    /// How many substeps a step is divided into.
    pub quality: Quality,
    /// Coarse levels, which carry stress farther than one edge per substep.
    pub levels: Levels,
    /// When the cloth is put to sleep; `None`: never.
    pub sleep: Option<Sleep>,
    /// Direct attachments of the cloth near a lone pin.
    pub tethers: Tethers,
    /// The material of the cloth.
    pub fabric: Fabric,
    /// The device to use for `Backend::Gpu`, `Hybrid` and `Auto`, for example the renderer's, which can then draw
    /// `Deformer::position_buffer`. `None`: the crate requests one when it needs it. Without the `gpu` feature this is
    /// always `None`.
    pub gpu: Option<Gpu>,
    /// Indices of the vertices that move only as [`Attributes::pin_targets`](crate::Attributes::pin_targets) says; each
    /// index at most once.
    pub pinned: Vec<u32>,
    /// Mass of each vertex (kg). `None`: each triangle gives a third of its `density * area` to each of its vertices.
    pub mass: Option<Vec<f32>>,
    /// Factor on `fabric.stretch` for each edge of [`Mesh::edges`](crate::Mesh::edges), 0 or above. A factor below 1 on
    /// the diagonals gives a soft shear.
    ///
    /// Woven cloth shears at 20 to 100 N/m. The shear stiffness of a grid is a quarter of that of its diagonals,
    /// `scale * stretch / 4`: with 0.02 on the diagonals a stretch of 5 kN/m has a shear stiffness of 25 N/m, and the
    /// cloth yields along the bias as fabric does.
    pub edge_scale: Option<Vec<f32>>,
    /// Factor on [`Fabric::bending`] for each vertex of the mesh, 0 or above; `None`: 1 everywhere.
    ///
    /// Together with `edge_scale` and `mass` it gives pieces of one mesh fabrics of their own, or stiffens a hem. The bending
    /// energy of a vertex's neighborhood is scaled, so momentum is conserved across a change of stiffness.
    pub bending_scale: Option<Vec<f32>>,
    /// Contact of the cloth with itself, which includes contact between the pieces of a mesh. `None`: cloth passes
    /// through cloth. With contact, [`Backend::Auto`] selects the CPU. With [`Backend::Gpu`] each step then waits for the
    /// GPU once, to check that its lists had room for all pairs. In a browser, which cannot wait, that is an error.
    pub contact: Option<Contact>,
}

/// Contact of cloth with cloth.
///
/// No edge ever passes through a triangle, provided that none does at the start and that pins move relative to each
/// other by at most a third of the thickness per substep ([`Warning::ContactOutruns`]). A start with crossings is
/// reported ([`Warning::Crossings`]), and contact ignores what crosses until it has separated;
/// [`Deformer::untangle`](crate::Deformer::untangle) separates it beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Distance (m) at which cloth is held from itself and from mesh colliders, above 0. Where two parts of the same
    /// piece of cloth are closer than twice this at rest, they are held at half of their distance at rest.
    pub thickness: f32,
    /// Coefficient of Coulomb friction of cloth on cloth, 0 or above.
    pub friction: f32,
}

impl Default for Contact {
    /// A thickness of 5 mm and friction 0.3.
    fn default() -> Contact {
        Contact { thickness: 0.005, friction: 0.3 }
    }
}

/// What a step did. Nothing is read back from the GPU for it.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct StepReport {
    /// Number of substeps taken.
    pub substeps: u32,
    /// Number of substeps that a step of 1/60 s would have taken, in the unit of [`Quality::Substeps`].
    pub in_a_sixtieth: u32,
    /// Coarse levels used in each substep.
    pub levels: u32,
    /// How the cloth was stretched, measured if the quality bounds the strain or the cloth may sleep, otherwise `None`.
    /// On the GPU the measurement is three steps old, and `None` in the first steps.
    pub stretch: Option<Stretch>,
    /// The cloth slept through the step and did not change: see [`Options::sleep`].
    pub asleep: bool,
    /// Pairs of features of the cloth (vertex and triangle, or two edges) that press on each other at the end of the
    /// step.
    pub contacts: u32,
    /// Conditions that the caller should know of.
    pub warnings: Vec<Warning>,
}

/// Statistics of the stretch `max(0, l/l0 - 1)` of the edges, each edge weighted by the area of its triangles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct Stretch {
    /// Mean stretch over the area.
    pub mean: f32,
    /// Stretch that the promised share of the area does not exceed (99 percent if none is promised), to within a
    /// sixteenth of its value.
    pub share: f32,
    /// Stretch of the worst edge.
    pub worst: f32,
}

/// What caused [`Warning::StrainMissed`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// The weight and motion of the cloth itself.
    Motion,
    /// Pins that accelerated.
    Pins,
    /// A fast collider near the cloth.
    Collider,
    /// The wind.
    Wind,
    /// Too much of the area belongs to slivers: edges that are a hundred times shorter than their triangles.
    Slivers,
}

/// An edge that passes through a triangle with which it shares no vertex. Indices are those of the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Crossing {
    /// The two ends of the edge.
    pub edge: [u32; 2],
    /// The three corners of the triangle.
    pub triangle: [u32; 3],
}

impl Crossing {
    /// The same crossing with every vertex index replaced by `names[index]`.
    pub(crate) fn named(self, names: &[u32]) -> Crossing {
        let name = |vertex: u32| names[vertex as usize];
        Crossing { edge: self.edge.map(name), triangle: self.triangle.map(name) }
    }
}

/// A condition found in a step that the caller should know of.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The bending stiffness had to be reduced to stay stable with these substeps, by more than 5 percent on average
    /// over the cloth. [`Method::SmallSteps`] filters bending in up to sixteen passes per substep and warns only if
    /// those are not enough. More substeps restore the full stiffness.
    BendingLimited {
        /// Number of vertices with reduced stiffness.
        vertices: usize,
    },
    /// Explicit springs take fewer substeps than their stability limit: cloth that moves may become unstable.
    ExplicitLimit {
        /// Number of substeps taken.
        substeps: u32,
        /// Number of substeps that is stable however the cloth moves.
        needed: u32,
    },
    /// A larger share of the area than promised was stretched by more than promised.
    StrainMissed {
        /// Stretch that the promised share of the area did not exceed, beyond the fabric's own stretch.
        stretch: f32,
        /// The largest stretch that was promised.
        promised: f32,
        /// What loaded the cloth most in that step.
        cause: Cause,
    },
    /// Some edges are a hundred times shorter than their triangles, which makes them so stiff that with few substeps
    /// they stretch to many times their length. The strain that [`Quality::Strain`] promises leaves them out. Merge
    /// their ends, or remesh with rounder triangles.
    Slivers {
        /// Number of such edges.
        edges: usize,
        /// The worst of them, as indices of the mesh.
        worst: [u32; 2],
    },
    /// A pin moves farther in a substep than an edge is long, which is as far as one sweep carries its motion. While it
    /// does so, the edges at it stretch to more than twice their length. Move it more slowly or take more substeps; for
    /// a jump use [`Deformer::warp`](crate::Deformer::warp) or [`Deformer::set_state`](crate::Deformer::set_state).
    PinOutruns {
        /// Its position in the list [`Options::pinned`].
        pin: usize,
        /// Its speed (m/s).
        speed: f32,
        /// The highest speed (m/s) that the substeps can carry: one edge length per substep.
        carried: f32,
    },
    /// A collider moves farther in a substep than an edge is long, wherever the cloth is. It does not tunnel, but cloth
    /// that it hits is stretched. Move it more slowly, take more substeps, or mark it as
    /// [`teleported`](crate::Collider::teleported).
    ColliderOutruns {
        /// Its position in the list [`Attributes::colliders`](crate::Attributes::colliders).
        collider: usize,
        /// Its speed (m/s).
        speed: f32,
        /// The highest speed (m/s) that the substeps can carry: one edge length per substep.
        carried: f32,
    },
    /// Pins or mesh colliders move relative to each other by more than a third of the contact thickness per substep, so
    /// that they may pass through cloth that is caught between them. Take more substeps ([`Quality::Strain`] takes up
    /// to 256 per 1/60 s for this), increase [`Contact::thickness`], or move them more slowly.
    ContactOutruns {
        /// The largest speed (m/s) of any of them relative to the midpoint of the range of their velocities. A velocity
        /// that all have in common does not count.
        speed: f32,
        /// The largest such speed (m/s) that the substeps resolve.
        resolved: f32,
    },
    /// The cloth and a mesh collider crossed each other when one of them was put in place. Contact ignores the crossing
    /// parts until they have separated, and holds them from then on.
    BodyCrossings {
        /// Number of crossing pairs of an edge and a triangle, over all mesh colliders.
        pairs: usize,
        /// The first such collider, as its position in [`Attributes::colliders`](crate::Attributes::colliders).
        collider: usize,
    },
    /// Edges passed through triangles of the cloth when the state was set ([`Options::contact`]). Contact ignores the
    /// crossing parts until they have separated, and holds them from then on.
    Crossings {
        /// Number of crossing pairs of an edge and a triangle.
        pairs: usize,
        /// The first of them.
        first: Crossing,
    },
}

impl Options {
    /// Checks everything that does not depend on the mesh.
    pub(crate) fn check_numbers(&self) -> Result<(), BuildError> {
        let refuse = |name: &str, value: String, remedy| Err(BuildError::Value { name: name.to_owned(), value, remedy });
        match self.quality {
            Quality::Substeps(count) if !(1..=MAX_SUBSTEPS).contains(&count) => {
                return refuse("quality: Substeps", count.to_string(), "must be 1 to 65536");
            }
            Quality::Strain(stretch) | Quality::Hold { stretch, .. } if !(stretch > 0.0 && stretch.is_finite()) => {
                return refuse("quality: stretch", stretch.to_string(), "must be finite and above 0; 0.03 is three percent");
            }
            Quality::Hold { share, .. } if !(0.5..=1.0).contains(&share) => {
                return refuse("quality: Hold share", share.to_string(), "must be 0.5 to 1; 0.99 is what Strain holds");
            }
            Quality::Budget(time) if !(time > 0.0 && time.is_finite()) => {
                return refuse("quality: Budget", time.to_string(), "must be finite and above 0 ms");
            }
            _ => {}
        }
        if let Some(sleep) = self.sleep {
            let speeds = [("sleep: mean_speed", sleep.mean_speed, SLOW), ("sleep: speed", sleep.speed, f32::MAX)];
            for (name, value, most) in speeds {
                if !(value > 0.0 && value <= most) {
                    return refuse(name, value.to_string(), "must be above 0 m/s, a mean speed at most 0.01");
                }
            }
            if !(sleep.after >= 0.0 && sleep.after.is_finite()) {
                return refuse("sleep: after", sleep.after.to_string(), "must be finite and 0 s or above");
            }
        }
        if let Some(Contact { thickness, friction }) = self.contact {
            if !(thickness > 0.0 && thickness.is_finite()) {
                return refuse("contact.thickness", thickness.to_string(), "must be finite and above 0 m");
            }
            if !(friction >= 0.0 && friction.is_finite()) {
                return refuse("contact.friction", friction.to_string(), "must be finite and 0 or above");
            }
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
