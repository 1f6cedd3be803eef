//! The settings a cloth is created with, and the report that each step returns.

mod checks;
mod display;
mod fabric;
mod quality;
mod report;

pub use fabric::Fabric;
pub use quality::Quality;
pub use report::{Cause, Crossing, StepReport, Stretch, Warning};

use crate::device::Gpu;

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
    /// Mass of each vertex (kg), instead of the fabric's density. `None`: each triangle gives a third of its `density * area` to each
    /// of its vertices.
    pub mass: Option<Vec<f32>>,
    /// Factor on `fabric.stretch` for each edge of [`Mesh::edges`](crate::Mesh::edges), 0 or above. A factor below 1 on
    /// the diagonals gives a soft shear.
    ///
    /// Woven cloth shears at 20 to 100 N/m. The shear stiffness of a grid is a quarter of that of its diagonals,
    /// `scale * stretch / 4`: with 0.02 on the diagonals a stretch of 5 kN/m has a shear stiffness of 25 N/m, and the
    /// cloth yields along the bias as fabric does. Edges of less than half of the fabric's stiffness, or of the stiffest edge
    /// if none has that, do not count for the strain that [`Quality::Strain`] bounds.
    pub edge_scale: Option<Vec<f32>>,
    /// Factor on [`Fabric::bending`] for each vertex of the mesh, 0 or above; `None`: 1 everywhere.
    ///
    /// Together with `edge_scale` and `mass` it gives pieces of one mesh fabrics of their own, or stiffens a hem. The bending
    /// energy of a vertex's neighborhood is scaled, so momentum is conserved across a change of stiffness.
    pub bending_scale: Option<Vec<f32>>,
    /// Contact of the cloth with itself, which includes contact between the pieces of a mesh. `None`: cloth passes
    /// through cloth. On a GPU each step with contact waits for the device once, to check that its lists had room for all pairs.
    /// In a browser, which cannot wait, [`Backend::Gpu`] with contact is an error.
    pub contact: Option<Contact>,
}

/// The processor that runs the simulation. All backends compute the same motion, up to rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Backend {
    /// A hardware GPU if there is one and the mesh has at least 16384 vertices, or 4096 with [`Options::contact`]; otherwise
    /// the CPU. [`Quality::Budget`] always selects the CPU, because a GPU does not support it. Mesh colliders that come later do
    /// not change the choice.
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
    /// XPBD with small steps (Macklin et al. 2019): one sweep over the edges per substep (there and back in closed shells; the
    /// diagonals of tubes are visited first and last), second-order accurate in the substep. See "How it works" on the [front page](crate).
    #[default]
    SmallSteps,
    /// Position Verlet with Jakobsen's relaxation (2001), as in the 2013 plug-in. Stiffness depends on the iterations
    /// and the length of the substep, not on [`Fabric::stretch`]. With any quality but [`Quality::Substeps`] it takes one
    /// substep per 1/60 s.
    Relaxation {
        /// Sweeps over the edges per substep.
        iterations: u32,
    },
    /// Springs integrated by explicit leapfrog: accurate when the substeps resolve the stiffness, unstable above the
    /// explicit limit ([`Warning::ExplicitLimit`]). With any quality but [`Quality::Substeps`] it takes 1.05 times that many.
    Springs,
}

/// Corrections on coarse versions of the cloth before each sweep, which keep the strain from growing with the number of
/// vertices. See "How it works" on the [front page](crate). Only for [`Method::SmallSteps`].
///
/// They are made for cloth that its load stretches. With few substeps they also act on what hangs slack. Swings are damped, the second
/// mode of a hung sheet of 21 x 21 at 5 substeps by half in five seconds, and slowed, the more the smaller they are: those of a sheet of
/// 1 m (41 x 41, cotton's bending stiffness) that hangs by an edge take 1 % longer at default quality where the hem swings by 10 cm, 5 %
/// by 2 cm and 9 % by 1 cm, its second mode 14 % by 2 cm and 67 % by 1 cm; with 20 substeps at most 1 and 7 %. Soft cloth, and fine cloth
/// with too few of its levels, is rolled up by a light wind from the side, and in still air hangs in folds of up to a few hundredths of
/// its width. Where that matters, turn them [`Off`](Levels::Off) and take more substeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Levels {
    /// As many levels as improve the result for their cost. None if the substeps resolve the stiffness or nearly do, or if
    /// the wind's pressure is more than ten times the cloth's weight (5 m/s for 0.2 kg/m²), where levels turn stretch into
    /// small wrinkles. So that gusts do not switch them, they go off at 15 times the weight, and on again below 7.
    ///
    /// Cloth that hangs from more than lone pins (or from any pins, if [`Tethers`] are off), and that its weight would stretch by more than
    /// 0.2 % (density times gravity times size over stretch: jersey from 0.3 m on), keeps a bound on strain by more substeps instead,
    /// because levels would roll it up.
    ///
    /// On [`Backend::Gpu`] with [`Quality::Strain`] or [`Quality::Hold`] and no contact of triangles: none below 8192 vertices,
    /// because more substeps cost less there; above, only down to the first level with at most 4096 aggregates, because coarser
    /// ones save no substeps.
    #[default]
    Auto,
    /// No levels are built or run.
    Off,
    /// This many, or as many as the mesh has. The finest level has aggregates of about 16 vertices; each coarser level
    /// has aggregates four times as large.
    Count(u32),
}

/// When a cloth is put to sleep. A sleeping cloth stays exactly as it is, at no cost, until an attribute or an option changes, or
/// the cloth or a collider is placed elsewhere.
///
/// Write `Sleep { .., ..Sleep::default() }`, so that fields added later do not break your code. By default a cloth
/// sleeps once it has moved more slowly than 1 mm/s on average and 5 mm/s everywhere for half a second.
///
/// With [`Options::contact`] and no pins, [`Quality::Strain`] and [`Quality::Hold`] take at least 16 substeps in 1/60 s then, because
/// with fewer cloth that lies on itself trembles on. Cloth that wind keeps awake then costs more than without sleep.
///
/// The speeds of cloth far from its [`origin`](crate::Deformer::origin) are rounded: a towel that was warped 32 m away falls asleep as
/// fast as at the origin, and one that was warped 64 m away never does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sleep {
    /// Largest root mean square of the vertices' speeds (m/s), at most 0.01. Speeds above that count as up to an eighth more.
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

/// Contact of cloth with cloth.
///
/// No edge of a triangle ever passes through another triangle, provided that none does at the start and that pins move relative to each
/// other by at most two thirds of the thickness per substep ([`Warning::ContactOutruns`]). Where pins or mesh colliders close on the
/// cloth until no room is left, they pass through it. Such crossings, and those of the start, are reported
/// ([`Warning::Crossings`], [`Warning::BodyCrossings`]), and contact ignores what crosses until it has separated;
/// [`Deformer::untangle`](crate::Deformer::untangle) separates it beforehand. What merely touches at the start does not
/// cross: features closer than a ten-thousandth of the thickness, or than rounding, are moved apart by some micrometers, or sixteen times
/// the rounding.
///
/// A step in which contact stops cloth so suddenly that what follows it would get through, as where layers fall on a body by ten
/// thicknesses in a substep, is taken twice and takes several times as long.
///
/// What lands on cloth or a mesh collider rebounds by at most about 1 % of its velocity, and flat cloth slides over either as its friction
/// says, to 1 %, as long as it slides by at most 1.5 times the thickness in a substep. [`Quality::Substeps`] can see to that, for a
/// thickness of 5 mm with one substep in 1/60 s for each .45 m/s of the slide; other qualities do not look at it. How fast it approaches
/// does not matter: up to 12 times the thickness in a substep were measured for pinned cloth and mesh colliders, 3 times for free cloth of
/// a hundred times its weight. A slide by twice the thickness may be held back by 1.3 times its friction, and by three times the thickness
/// by 2.7 times, most of all by pinned cloth that it approaches slowly, and then it rebounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Distance (m) at which cloth is held from itself and from mesh colliders, above 0. Where two parts of the same
    /// piece of cloth are closer than twice this at rest, they are held at half of their distance at rest. Towards pins it tapers to
    /// nothing, so that cloth beside pins that are closer than this to a mesh collider, or to pins of other cloth, comes to rest.
    ///
    /// At least 1e-4 of the cloth's size, since positions in single precision keep no smaller distance; below 2e-4, a heap needs
    /// over a hundred substeps. At most half of the cloth's size. [`Deformer::new`](crate::Deformer::new) also refuses it if on average
    /// a vertex has more than 16 others within the thickness and there are more than a million such pairs in all: choose less,
    /// or a coarser mesh.
    pub thickness: f32,
    /// Coefficient of Coulomb friction of cloth on cloth, 0 or above. Colliders have their own
    /// ([`Collider::friction`](crate::Collider::friction)). It acts where the two sides are, which are a thickness apart, so it changes
    /// the angular momentum of free cloth a little. Linear momentum stays.
    pub friction: f32,
}

impl Default for Contact {
    /// A thickness of 5 mm and friction 0.3.
    fn default() -> Contact {
        Contact { thickness: 0.005, friction: 0.3 }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/options.rs"]
mod tests;
