//! Tethers: one-sided constraints on the distance between a vertex and a pin (long range attachments).

use bytemuck::{Pod, Zeroable};

use super::contact::Body;
use super::params::Substep;
use crate::simd::{Lanes, Vector};

/// A tether, with coefficients for substeps of one length.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Tether {
    /// The pin, as an index among those that have tethers.
    pub anchor: u32,
    /// Length along the cloth (m).
    pub length: f32,
    /// How much longer (m) the tether is per acceleration of 1 m/s² that loads the cloth.
    pub slack: f32,
    /// Share of the excess length that the vertex is corrected by; 0 where there is no tether.
    pub share: f32,
}

/// The tether is corrected along its direction at the substep's start if it has turned by less than this (cosine: 60
/// degrees) ...
pub(crate) const TETHER_TURN_GUARD: f32 = 0.5;
/// ... and was longer than this share of its length.
pub(crate) const TETHER_SHORT_GUARD: f32 = 0.1;

/// Position of a tether's pin at the substep's start (m), and the pin's displacement in the substep (m). Computed from
/// the prescribed motion, so tethers need not wait until the pin has moved.
#[inline(always)]
pub(crate) fn anchor_path<L: Lanes>(anchor: &Body, substep: &Substep, fraction: f32) -> [Vector<L>; 2] {
    let travel = Vector::splat(anchor.a_travel);
    [travel.mul_add(L::splat(substep.start), Vector::splat(anchor.a)), travel * L::splat(fraction)]
}

/// The correction (m) of a tethered vertex that is at `d0` (m) from the pin at the substep's start and moves by `du`
/// (m) relative to it.
///
/// The constraint is `C = |d0 + du| - reach <= 0` (long range attachments: Kim, Chentanez and Müller 2012). The vertex
/// is corrected by a share of the excess that fades with the distance from the pin: almost all of it near the pin,
/// where edges carry the most load and one sweep leaves them longest, and nothing far from it. The correction is along
/// the direction at the substep's start (SHAKE), which exerts no torque about the pin, unless the tether has turned
/// far.
#[inline(always)]
pub(crate) fn tethered<L: Lanes>(d0: Vector<L>, du: Vector<L>, reach: L, share: L) -> Vector<L> {
    let (zero, d) = (L::splat(0.0), d0 + du);
    let (length0, length) = (d0.dot(d0).sqrt(), d.dot(d).sqrt());
    let excess = L::select(reach.lt(length), length - reach, zero);
    let turned = (L::splat(TETHER_TURN_GUARD) * length0 * length).lt(d0.dot(d));
    let at_start = L::and(turned, (L::splat(TETHER_SHORT_GUARD) * reach).lt(length0));
    let by = share * excess / L::select(at_start, length0, length.max(L::splat(super::distance::MIN_LENGTH)));
    Vector::select(at_start, d0, d) * (zero - by)
}
