//! How far the fabric itself is stretched under its load, which no substeps change, and what is beyond that.

use crate::model::cloth::Cloth;
use crate::step::load::Load;

/// Pins are lone if the stress near them is more than this multiple of that of the whole cloth, where it bounds a hundredth of the area.
/// For a whole edge that is pinned, the multiple is at most a half.
const LONE: f64 = 1.0;
/// A garment may be narrower than what it is on by this share without a
/// [`Warning::StrainMissed`](crate::Warning::StrainMissed) in every step.
const NARROW: f64 = 0.1;
/// Share of what more substeps could change that always counts as excess, because what is the fabric's own is an estimate.
const DOUBT: f64 = 0.1;
/// The same share of the stretch beyond what the weight explains. Cloth that is flung about is under its largest load only where it is taut: of 240
/// frames of a sheet of jersey that is shaken (`soft_cloth_that_is_shaken_keeps_its_promise`), 70 were stretched by more than the bound
/// beyond the same step resolved, and not reported, when this was a tenth, too.
const DOUBT_IN_MOTION: f64 = 0.5;

/// The largest stretch that is not reported although more substeps do not help: a garment may be narrower than what it is on by
/// [`NARROW`], besides what its load explains.
pub(crate) fn accepted(cloth: &Cloth, load: &Load, known: f64, share: f32) -> f64 {
    let explained = own_stretch(cloth, load.stress(cloth), share, load.cloth_speed);
    if load.is_calm_in_wind(cloth) { known.min(NARROW + explained) } else { 0.0 }
}

/// What was measured in a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    /// The stretch that this share of the area does not exceed.
    pub stretch: f64,
    pub share: f32,
    /// The shares of the stiffness that the substeps resolve: of most edges, and of what holds the cloth ([`resolved_share`]).
    pub resolved: f64,
    pub held: f64,
}

/// The measured stretch beyond the fabric's own. Wind stretches cloth that gives way to it little, and cloth
/// that is held all around much: there, substeps that resolve the share `held` of the stiffness leave as large a
/// share of the stretch whatever they do. Because these are estimates, a part of what more substeps than those that `resolved` this share
/// could change counts as excess in any case: [`DOUBT`], [`DOUBT_IN_MOTION`]. What is `known` to be the fabric's own
/// ([`Controller::own_of`](crate::step::controller::Controller::own_of)) does not.
pub(crate) fn excess(cloth: &Cloth, load: &Load, measured: Measured, known: f64) -> f64 {
    let Measured { stretch, share, resolved, held } = measured;
    let without_wind = load.stress_without_wind(cloth) / load.stress(cloth);
    let by_wind = if load.pressure > 0.0 { held * (1.0 - without_wind) } else { 0.0 };
    let own = own_stretch(cloth, load.stress_without_wind(cloth), share, load.cloth_speed).max(by_wind * stretch);
    let unknown = (stretch - known).max(0.0);
    let by_motion = unknown - own_stretch(cloth, load.weight(cloth), share, load.cloth_speed);
    let doubtful = (1.0 - resolved) * (DOUBT * unknown).max(DOUBT_IN_MOTION * by_motion);
    (stretch - own).min(unknown).max(doubtful)
}

/// The stretch that a share of the area does not exceed under a membrane `stress` (N/m) if every edge is as stiff as its fabric.
///
/// A sheet that hangs by an edge or is swung by it bears the stress `sigma = rho ((|g| + a_pin) L + v²)`, and is stretched by
/// `sigma/K` at rest. What is at the speed v (m/s) and stops adds the strain `v/c`, with the speed of sound `c = sqrt(K/rho)`, and at
/// most as much again. Near lone pins the stress is larger: if the rest of the area, `(1 - share) A`, lies within `r` of them,
/// the line around it is up to `2 (1 - share) A/r` long, and the weight of all cloth passes it, `sigma A/L`. So the
/// stretch is `r sigma/(2 (1 - share) L K)`. With the stiffness resolved, sheets of
/// [`Fabric::JERSEY`](crate::Fabric::JERSEY) with 21 x 21 vertices were stretched by .91 of this (with r of a circle) at one corner, 1.1
/// at two, and .82 in the middle.
pub(crate) fn own_stretch(cloth: &Cloth, stress: f64, share: f32, speed: f64) -> f64 {
    let moving = ((cloth.membrane_stiffness * cloth.density).sqrt() * speed).min(stress);
    (stress * concentration(cloth, share)).max(stress + moving) / cloth.membrane_stiffness
}

/// The stress near lone pins as a multiple of that of the whole cloth: see [`own_stretch`].
fn concentration(cloth: &Cloth, share: f32) -> f64 {
    let rest = rest(cloth, share);
    // Around a pin the area grows with the square of the distance.
    let near = cloth.extents.near * (rest / 0.01).sqrt();
    if near > 0.0 { near / (2.0 * rest * cloth.extents.extent) } else { 0.0 }
}

/// The share of the area whose stretch is not bounded, at least a vertex.
fn rest(cloth: &Cloth, share: f32) -> f64 {
    f64::from(1.0 - share).max(1.0 / cloth.used as f64)
}

/// The share of the stiffness of what holds the cloth that the substeps resolve: `of_most` as of most edges, or `near_pins`, the square
/// of their number relative to as many as help ([`most`](crate::step::controller::most)). Edges at a lone pin pass on what hangs on them,
/// and are resolved by that many: a sail of 31 x 31 that wind holds taut between four pins is stretched by 13.4 % at .93 `S*`, 10.5 at 1.17, 9.6
/// at 1.45 and 8.6 at 12, its mean by 1.66, 1.52, 1.51 and 1.51 %.
pub(crate) fn resolved_share(cloth: &Cloth, share: f32, of_most: f64, near_pins: f64) -> f64 {
    // Of a smaller rest of the area, that of an edge grows as the inverse root.
    if concentration(cloth, share) > LONE * (0.01 / rest(cloth, share)).sqrt() { near_pins } else { of_most }
}

#[cfg(test)]
#[path = "../../tests/unit/step_own_stretch.rs"]
mod tests;
