//! Bounds of how much listed pairs have approached. A pair that is not near is due to be measured again only when it can have
//! become near.
//!
//! Vertices are bounded in patches and pairs in bunches, so that a few fast vertices make no other pairs due.

use glam::Vec3A;

use crate::contact::surface::pairs::Listed;
use crate::kernels::pair::Kind;
use crate::simd::Bits;

/// Vertices of a patch, which are consecutive, and pairs of a bunch.
pub(crate) const PATCH: usize = 16;
pub(crate) const BUNCH: usize = 64;
/// By how much (in units of the thickness, and of what the vertices moved) a pair is measured before it can be near,
/// because distances are rounded.
const EARLY: [f32; 2] = [0.01, 1e-5];

/// The patch of a vertex.
pub(crate) fn patch(vertex: u32) -> usize {
    vertex as usize / PATCH
}

/// How the vertices of a patch move, relative to common motions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PatchMotion {
    /// Bounds of their displacements (m) since the last substep.
    pub moved: [Vec3A; 2],
    /// How far (m) they are about to move at most.
    pub travel: f32,
}

impl PatchMotion {
    pub(crate) const NONE: PatchMotion = PatchMotion { moved: [Vec3A::INFINITY, Vec3A::NEG_INFINITY], travel: 0.0 };

    pub(crate) fn join(&mut self, other: &PatchMotion) {
        let ([low, high], [other_low, other_high]) = (self.moved, other.moved);
        self.moved = [low.min(other_low), high.max(other_high)];
        self.travel = self.travel.max(other.travel);
    }
}

/// An upper bound on how much any pair of a bunch has approached since the pairs were listed.
///
/// A pair that had the distance `d` (m) when the total was `t` (m) cannot be closer than its [reach] before the total is
/// `t + d - reach`, which is stored for the pair as `safe_until` (m).
///
/// [reach]: crate::contact::surface::pairs::reach
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ApproachBound {
    /// The sum over the substeps so far (m), which never decreases.
    pub total: f32,
    /// A pair whose `safe_until` is at least this (m) is not near in this substep; the others are due.
    pub limit: f32,
}

impl ApproachBound {
    /// Advances given the motions of the vertices on either side of the pairs.
    fn advance(&mut self, [one, other]: [PatchMotion; 2], most_push: f32, thickness: f32) {
        let travel = one.travel + other.travel + 2.0 * most_push;
        let ([low, high], [other_low, other_high]) = (one.moved, other.moved);
        self.total += (high.max(other_high) - low.min(other_low)).max(Vec3A::ZERO).length();
        self.limit = self.total * (1.0 + EARLY[1]) + travel + EARLY[0] * thickness;
    }
}

/// The bunches of a portion.
#[derive(Debug, Default)]
pub(crate) struct Bunches {
    pub approach: Vec<ApproachBound>,
    /// The patches of the vertices of each bunch, first those of the first side of pairs, and where those of each side end.
    patches: Vec<u32>,
    ends: Vec<[u32; 2]>,
    /// A bit for each patch, for either side.
    marks: [Vec<u64>; 2],
    /// Number of pairs.
    pairs: usize,
}

impl Bunches {
    pub(crate) fn clear(&mut self) {
        self.approach.clear();
        self.ends.clear();
        self.pairs = 0;
    }

    /// Takes the pairs that have been added to these since. Vertices are in so many patches.
    pub(crate) fn take(&mut self, kind: Kind, pairs: &[Listed], patches: usize) {
        if self.pairs == pairs.len() {
            return;
        }
        let whole = self.pairs / BUNCH;
        self.pairs = pairs.len();
        self.ends.truncate(whole);
        self.patches.truncate(self.ends.last().map_or(0, |&[_, end]| end as usize));
        self.approach.resize(pairs.len().div_ceil(BUNCH), ApproachBound::default());
        self.marks.iter_mut().for_each(|marks| marks.resize(patches.div_ceil(64), 0));
        for pairs in pairs.chunks(BUNCH).skip(whole) {
            for pair in pairs {
                for (k, place) in pair.corners.map(patch).into_iter().enumerate() {
                    self.marks[usize::from(k >= kind.first_side())][place / 64] |= 1 << (place % 64);
                }
            }
            let patches = &mut self.patches;
            self.ends.push(self.marks.each_mut().map(|marks| {
                for (first, marks) in (0..).step_by(64).zip(marks) {
                    patches.extend(Bits(std::mem::take(marks)).map(|place| first + place as u32));
                }
                patches.len() as u32
            }));
        }
    }

    /// Advances the bounds by what the vertices of each patch have moved since the last substep. Corrections of positions are at
    /// most `most_push` (m) long, and the thickness is in m, too.
    pub(crate) fn advance(&mut self, motions: &[PatchMotion], most_push: f32, thickness: f32) {
        let mut first = 0;
        for (bound, ends) in self.approach.iter_mut().zip(&self.ends) {
            let sides = ends.map(|end| {
                let mut all = PatchMotion::NONE;
                for &patch in &self.patches[std::mem::replace(&mut first, end as usize)..end as usize] {
                    all.join(&motions[patch as usize]);
                }
                all
            });
            bound.advance(sides, most_push, thickness);
        }
    }
}

#[cfg(test)]
#[path = "../../../../tests/unit/contact_approach.rs"]
mod tests;
