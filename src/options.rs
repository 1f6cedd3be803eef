//! What is fixed when a cloth is made, and what a step reports.

use crate::device::Gpu;
use crate::error::BuildError;
use crate::fabric::Fabric;
use crate::kernels::statistics::SLOW;
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
    /// 99 per cent of the cloth's area is stretched by at most this much beyond the fabric's own, in every step:
    /// [`Quality::Hold`] with that share.
    Strain(f32),
    /// As few substeps as hold most of the cloth's area to a stretch, chosen anew in every step: before it from what acts on the cloth
    /// (gravity, wind, how fast it moves, how pins and colliders are moved), by the law `S = S* sqrt(2 sigma f / (K stretch))`, `S*`
    /// the substeps that resolve the stiffness K; after it by what was measured, which corrects the factor f. At least 5 in 1/60 s, at
    /// most 1.4 `S*`. Where that was not enough in a step, [`Warning::StrainMissed`] says by how much, and why.
    ///
    /// The choice is the same on any number of threads. On the GPU what is measured is three steps old: a step never waits for another
    /// that was submitted since. [`StepReport::in_a_sixtieth`], given to [`Quality::Substeps`], repeats a step bit for bit.
    /// For [`Method::SmallSteps`].
    Hold {
        /// Stretch, `l/l0 - 1`, beyond the fabric's own under the same load; 0.03 is three per cent.
        stretch: f32,
        /// Share of the area, 0.5 to 1, each edge being counted with the area of its triangles.
        share: f32,
    },
    /// As many substeps as are done in this time (ms) a step, told from how long those before took, but no more than 1.4 `S*`. No motion is
    /// repeated by it, for no two runs take the same time; [`StepReport::in_a_sixtieth`] repeats one. Not on the GPU, whose steps are
    /// submitted and not waited for. [`Deformer::step_all`](crate::Deformer::step_all) times no cloth by itself: one that was never stepped
    /// alone takes 5 in 1/60 s. For [`Method::SmallSteps`].
    Budget(f32),
}

impl Quality {
    /// Share of the area that [`Quality::Strain`] is a promise for.
    pub(crate) const MOST_OF_THE_AREA: f32 = 0.99;
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
    /// As many as pay: none where the substeps resolve the stiffness or nearly so, the mesh has fewer than 1000 vertices and is short of
    /// that by less than eight times, or the wind's pressure is ten
    /// times the cloth's weight (5 m/s for 0.2 kg/m²), where they would show small wrinkles for stretch.
    #[default]
    Auto,
    /// None: nothing is built or run.
    Off,
    /// This many, or as many as the mesh has; the finest has aggregates of about 16 vertices, each next one of four times as many.
    Count(u32),
}

/// When a cloth falls asleep: it then stays as it is, at no cost, until an attribute changes.
///
/// A plain struct, to be written with `..Sleep::default()`: slower than 1 mm/s on average and 5 mm/s anywhere, for half a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sleep {
    /// Root of the mean square of the vertices' speeds (m/s), at most 0.01.
    pub mean_speed: f32,
    /// Speed (m/s) of the fastest vertex.
    pub speed: f32,
    /// How long (s) it must have been so slow, under attributes that did not change.
    pub after: f32,
}

impl Default for Sleep {
    fn default() -> Sleep {
        Sleep { mean_speed: 0.001, speed: 0.005, after: 0.5 }
    }
}

/// What holds the cloth near a lone pin, or two side by side, whose few edges carry all that hangs on them: see
/// "How it works". For [`Method::SmallSteps`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Tethers {
    /// Where the substeps do not resolve the stiffness each vertex near a lone pin is kept within its distance along the cloth, by a
    /// share that fades with it (long range attachments: Kim, Chentanez & Müller 2012). Nothing is built for a cloth without such a pin.
    #[default]
    Auto,
    /// None: nothing is built or run.
    Off,
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
    /// When it stops to move and to cost anything; `None`: never.
    pub sleep: Option<Sleep>,
    /// What holds the cloth near a lone pin.
    pub tethers: Tethers,
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
    /// Contact of the cloth with itself: of each piece of the mesh with itself and with the others, in triangles. `None`: they pass through one
    /// another. On the CPU alone so far: [`Backend::Auto`] takes it, [`Backend::Gpu`] refuses.
    pub contact: Option<Contact>,
}

/// Contact of cloth with cloth.
///
/// No edge ever comes through a triangle, if none does at the start and pins move by no more than a third of the thickness in a substep
/// against one another ([`Warning::ContactOutruns`]). A start with crossings is reported ([`Warning::Crossings`]); what crosses is let go until it parts;
/// [`Deformer::untangle`](crate::Deformer::untangle) parts it first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// How far apart cloth is held (m), above 0, from itself and from mesh colliders; less from itself where it is finer than that: half the
    /// distance at rest.
    pub thickness: f32,
    /// Coulomb's coefficient of friction of cloth on cloth, 0 or above.
    pub friction: f32,
}

impl Default for Contact {
    /// 5 mm, friction 0.3.
    fn default() -> Contact {
        Contact { thickness: 0.005, friction: 0.3 }
    }
}

/// What one step did, known without reading anything back.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct StepReport {
    /// Substeps taken.
    pub substeps: u32,
    /// Substeps that 1/60 s would have been given, which is what [`Quality::Substeps`] counts.
    pub in_a_sixtieth: u32,
    /// Coarse levels in each of them.
    pub levels: u32,
    /// How the cloth was stretched, if the quality is a promise about it, or the cloth may sleep. On the GPU as it was three steps ago;
    /// `None` until there is anything.
    pub stretch: Option<Stretch>,
    /// The cloth slept through the step and is as it was: see [`Options::sleep`].
    pub asleep: bool,
    /// Pairs of the cloth's features that press on one another at the end of the step.
    pub contacts: u32,
    /// What the caller should know.
    pub warnings: Vec<Warning>,
}

/// How a cloth is stretched: of its edges `max(0, l/l0 - 1)`, each counted with the area of its triangles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct Stretch {
    /// Mean over the area.
    pub mean: f32,
    /// What the promised share of the area does not exceed (99 per cent if none is promised), to within a sixteenth.
    pub share: f32,
    /// The worst edge's.
    pub worst: f32,
}

/// Why a strain was not kept: see [`Warning::StrainMissed`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// The cloth's own weight and motion.
    Motion,
    /// Pins were jerked.
    Pins,
    /// A collider moved fast beside the cloth.
    Collider,
    /// The wind blew.
    Wind,
    /// So much of the area is at edges that are a hundred times shorter than their triangles.
    Slivers,
}

/// An edge that goes through a triangle with which it shares no vertex, by the mesh's vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Crossing {
    /// The ends of the edge.
    pub edge: [u32; 2],
    /// The corners of the triangle.
    pub triangle: [u32; 3],
}

impl Crossing {
    /// The same by other numbers of the vertices.
    pub(crate) fn named(self, names: &[u32]) -> Crossing {
        let name = |vertex: u32| names[vertex as usize];
        Crossing { edge: self.edge.map(name), triangle: self.triangle.map(name) }
    }
}

/// Something a step met that is worth knowing.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// Bending was softened at some vertices to stay stable at this substep: by more than a twentieth, their mean over the cloth. Small
    /// steps meet it only past what sixteen passes over the bending carry; more substeps bring it all.
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
    /// More of the cloth than promised was stretched farther than promised, beyond the fabric's own.
    StrainMissed {
        /// How far the promised share of the area was stretched beyond the fabric's own.
        stretch: f32,
        /// How far it was to be stretched at most.
        promised: f32,
        /// What acted most on the cloth in that step.
        cause: Cause,
    },
    /// Some edges are a hundred times shorter than their triangles: so stiff that few substeps stretch them by many times their
    /// length, which the strain that [`Quality::Strain`] promises leaves out. Merge their ends, or make the triangles rounder.
    Slivers {
        /// Number of such edges.
        edges: usize,
        /// The worst of them, by the mesh's vertices.
        worst: [u32; 2],
    },
    /// A pin is led farther in a substep than an edge is long, which is as far as a sweep carries it on: the edges at it are stretched by more
    /// than their length while it lasts. Lead it more slowly, or take more substeps; [`Attributes`](crate::Attributes) that jump have
    /// `set_state`.
    PinOutruns {
        /// Its place in [`Options::pinned`].
        pin: usize,
        /// Its speed (m/s).
        speed: f32,
        /// The speed (m/s) of an edge a substep.
        carried: f32,
    },
    /// A collider moves farther in a substep than an edge is long, wherever the cloth is: it tunnels through nothing, but what it meets is
    /// stretched. Move it more slowly, take more substeps, or say that it was [`teleported`](crate::Collider::teleported).
    ColliderOutruns {
        /// Its place in [`Attributes::colliders`](crate::Attributes::colliders).
        collider: usize,
        /// Its speed (m/s).
        speed: f32,
        /// The speed (m/s) of an edge a substep.
        carried: f32,
    },
    /// Pins or mesh colliders move against one another by more than a third of the thickness in a substep: what is caught between them may be
    /// gone through. Take more substeps ([`Quality::Strain`] takes up to 256 in 1/60 s for this), a larger
    /// [`Contact::thickness`], or lead them more slowly.
    ContactOutruns {
        /// How fast (m/s) the fastest moves against the middle between the extremes of all their velocities: what moves all of them alike is
        /// no trouble.
        speed: f32,
        /// How fast (m/s) it may.
        resolved: f32,
    },
    /// Edges and triangles of the cloth and of a mesh collider go through one another, as they did where either appeared. They are let go until
    /// they part, and then held.
    BodyCrossings {
        /// Number of pairs of an edge and a triangle, with all mesh colliders.
        pairs: usize,
        /// The first such collider, by its place in [`Attributes::colliders`](crate::Attributes::colliders).
        collider: usize,
    },
    /// Edges go through triangles of the cloth, as they did where the state was set ([`Options::contact`]). They are let go until they part, and
    /// then held.
    Crossings {
        /// Number of pairs of an edge and a triangle.
        pairs: usize,
        /// The first of them.
        first: Crossing,
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
            Quality::Strain(stretch) | Quality::Hold { stretch, .. } if !(stretch > 0.0 && stretch.is_finite()) => {
                return refuse("quality: stretch", stretch.to_string(), "must be finite and above 0; 0.03 is three per cent");
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
            if self.backend == Backend::Gpu {
                let remedy = "is on the CPU alone so far; use Backend::Cpu, Hybrid or Auto, or leave contact out";
                return refuse("contact", "with Backend::Gpu".to_owned(), remedy);
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
