//! Tethers: how far from a pin a vertex may be.

use bytemuck::{Pod, Zeroable};

use super::contact::Body;
use super::params::Substep;
use crate::simd::{Lanes, Vector};

/// What holds a vertex to a pin, ready for one length of substep.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Tether {
    /// The pin, by its number among those that have tethers.
    pub anchor: u32,
    /// Length along the cloth (m).
    pub length: f32,
    /// How much longer (m) it may be in an acceleration of 1 m/s².
    pub slack: f32,
    /// Share of what is too long that the vertex is moved by; 0 where there is no tether.
    pub share: f32,
}

/// The direction at the substep's start is kept while the tether turns by less than this (cosine: 60 degrees) ...
pub(crate) const TETHER_TURN_GUARD: f32 = 0.5;
/// ... and was longer than this share of its length.
pub(crate) const TETHER_SHORT_GUARD: f32 = 0.1;

/// Where the pin of a tether is when a substep begins (m), and what it moves by until its end (m): as it is led. Nobody need wait for
/// the pin to move.
#[inline(always)]
pub(crate) fn anchor_path<L: Lanes>(anchor: &Body, substep: &Substep, fraction: f32) -> [Vector<L>; 2] {
    let travel = Vector::splat(anchor.a_travel);
    [travel.mul_add(L::splat(substep.start), Vector::splat(anchor.a)), travel * L::splat(fraction)]
}

/// What a tether moves its vertex by (m), which is `d0` (m) from the pin when the substep begins and moves by `du` (m) from it.
///
/// `C = |d0 + du| - reach`, where it is positive (long range attachments: Kim, Chentanez & Müller 2012), of which the vertex takes a
/// share that fades with the distance from the pin: near it, where the edges carry the most and one sweep leaves them the longest, nearly
/// all; far from it none. Along the direction at the substep's start (SHAKE), in which it has no torque about the pin, unless it has turned far.
#[inline(always)]
pub(crate) fn tethered<L: Lanes>(d0: Vector<L>, du: Vector<L>, reach: L, share: L) -> Vector<L> {
    let (zero, d) = (L::splat(0.0), d0 + du);
    let (length0, length) = (d0.dot(d0).sqrt(), d.dot(d).sqrt());
    let excess = L::select(reach.lt(length), length - reach, zero);
    let turned = (L::splat(TETHER_TURN_GUARD) * length0 * length).lt(d0.dot(d));
    let at_start = L::and(turned, (L::splat(TETHER_SHORT_GUARD) * reach).lt(length0));
    let by = share * excess / L::select(at_start, length0, length.max(L::splat(super::distance::LEAST_LENGTH)));
    Vector::select(at_start, d0, d) * (zero - by)
}
