//! The lists in portions of a fixed length. What is found in a portion stays there, so later passes work on portions in
//! parallel, too, and pairs are in the same order on any number of threads.
//!
//! Pairs that act join the groups of their portion and stay there until pairs are listed anew, because most of them act
//! for many substeps. Most other pairs are not near. They are measured again only when they can have become so since
//! they were last measured, given how far the vertices moved meanwhile ([`Bunches`]).

use glam::Vec4;

use super::approach::{ApproachBound, BUNCH, Bunches};
use super::group::{Block, Group, Member};
use crate::contact::ranges::Ranges;
use crate::contact::surface::pairs::Listed;
use crate::contact::workers::Workers;
use crate::kernels::pair::Kind;
use crate::simd::{MAX_LANES, Registers};

/// Listed pairs of a portion.
pub(crate) const PORTION: usize = 512;

/// Consecutive pairs of a list, and what is found among them.
#[derive(Debug, Default)]
pub(crate) struct Portion {
    pub kind: Kind,
    /// Index in the list of the first pair.
    pub first: usize,
    /// The corners of its pairs, as places among the vertices of listed pairs, and their thickness (m).
    pub corners: Vec<[u32; 4]>,
    pub thickness: Vec<f32>,
    /// Up to which bound of approach each pair need not be measured: see [`ApproachBound`]. Infinite if it is in a group.
    pub safe_until: Vec<f32>,
    /// The pairs that have acted since they were listed, in order, and the number of groups in the portions before.
    pub groups: Vec<Group>,
    pub before: usize,
    /// For each group the set of ranges of vertices that have corners there.
    pub ranges: Vec<u64>,
    pub bunches: Bunches,
    pub due_pairs: DuePairs,
    /// Others that act for the first time in this substep, by their place in the portion.
    pub joining: Vec<u16>,
    /// Blocks with the other near pairs; some of their lanes hold pairs that are not near.
    pub blocks: Vec<Block>,
    /// How many pairs are near and how many press, where any are near.
    pub near: u32,
    pub pressing: u32,
    pub truncation: Truncation,
}

/// The pairs of a portion that are due, in order, and copies of what is needed of them, repeated to a multiple of the
/// lanes.
#[derive(Debug, Default)]
pub(crate) struct DuePairs {
    /// Their places in the portion.
    pub places: Vec<u16>,
    pub corners: Vec<[u32; 4]>,
    pub thickness: Vec<f32>,
}

impl DuePairs {
    /// Selects the pairs that are safe only until less than the limits of their bunches.
    #[inline(always)]
    pub(crate) fn select<L: Registers>(&mut self, safe_until: &[f32], approach: &[ApproachBound]) {
        let DuePairs { places, .. } = self;
        places.resize(PORTION + MAX_LANES, 0);
        let mut count = 0;
        for (start, (safe_until, bound)) in (0..).step_by(BUNCH).zip(safe_until.chunks(BUNCH).zip(approach)) {
            let limits = L::splat(bound.limit);
            let (groups, rest) = (safe_until.chunks_exact(L::LANES), safe_until.chunks_exact(L::LANES).remainder());
            let rest_from = start + safe_until.len() - rest.len();
            for (first, safe_until) in (start..).step_by(L::LANES).zip(groups) {
                let lanes = L::bits(L::from_slice(safe_until).lt(limits));
                if lanes == (1 << L::LANES) - 1 {
                    (first..).zip(&mut places[count..count + L::LANES]).for_each(|(place, to)| *to = place as u16);
                    count += L::LANES;
                } else if lanes != 0 {
                    // Without a branch, because pairs that are due alternate with others.
                    for lane in 0..L::LANES {
                        places[count] = (first + lane) as u16;
                        count += (lanes >> lane & 1) as usize;
                    }
                }
            }
            for (place, _) in (rest_from..).zip(rest).filter(|&(_, &safe_until)| safe_until < bound.limit) {
                places[count] = place as u16;
                count += 1;
            }
        }
        places.truncate(count);
    }

    /// Copies what is needed of the pairs, all before any is measured: a wide load right after narrow stores to the same bytes
    /// stalls (store forwarding).
    #[inline(always)]
    pub(crate) fn take<L: Registers>(&mut self, of_pairs: &[[u32; 4]], thickness_of: &[f32]) {
        let DuePairs { places, corners, thickness } = self;
        corners.clear();
        thickness.clear();
        corners.extend(places.iter().map(|&place| of_pairs[usize::from(place)]));
        thickness.extend(places.iter().map(|&place| thickness_of[usize::from(place)]));
        if let (Some(&last), Some(&least)) = (corners.last(), thickness.last()) {
            let count = places.len().next_multiple_of(L::LANES);
            corners.resize(count, last);
            thickness.resize(count, least);
        }
    }
}

impl Portion {
    /// Forgets its pairs.
    pub(crate) fn clear(&mut self) {
        self.corners.clear();
        self.thickness.clear();
        self.safe_until.clear();
        self.groups.clear();
        self.bunches.clear();
    }

    /// For each thread, its share of the portions of either kind.
    pub(crate) fn shared<'a>(portions: &'a mut [Portion], workers: Workers<'a>) -> impl Iterator<Item = [&'a mut [Portion]; 2]> {
        let first = portions.partition_point(|portion| portion.kind == Kind::VertexTriangle);
        let (one, other) = portions.split_at_mut(first);
        let mut left = [one, other];
        let counts = left.each_ref().map(|left| left.len());
        (0..workers.count()).map(move |part| {
            let mut counts = counts.iter().map(|count| workers.share(part, *count));
            left.each_mut().map(|left| left.split_off_mut(..counts.next().unwrap_or(0)).unwrap_or_default())
        })
    }

    /// All near pairs, among others.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = &Block> {
        self.groups.iter().map(|group| &group.block).chain(self.blocks.iter())
    }

    /// Number of pairs in groups.
    fn members(&self) -> usize {
        self.groups.iter().map(|group| group.count as usize).sum()
    }

    /// Adds the pairs of its part of a list that it does not have yet, whose vertices have these places.
    pub(crate) fn add(&mut self, pairs: &[Listed], place: impl Fn(u32) -> u32) {
        let Portion { corners, thickness, safe_until, .. } = self;
        let added = &pairs[corners.len()..];
        // Room for all at once, because a step must not allocate when its lists are hardly longer than those before.
        corners.reserve(PORTION - corners.len());
        thickness.reserve(PORTION - thickness.len());
        safe_until.reserve(PORTION - safe_until.len());
        corners.extend(added.iter().map(|pair| pair.corners.map(&place)));
        thickness.extend(added.iter().map(|pair| pair.thickness));
        safe_until.resize(pairs.len(), f32::NEG_INFINITY);
    }

    /// Adds the joining pairs to the groups, with the multipliers that they have in the list. From now on they are
    /// never due to be measured.
    pub(crate) fn join(&mut self, lambda: &[Vec4], member: impl Fn([u32; 4], u32, f32) -> Member, ranges: Ranges) {
        let mut left = self.members();
        let Portion { first, corners, thickness, safe_until, groups, joining, ranges: of_groups, .. } = self;
        let count = left + joining.len();
        groups.resize(count.div_ceil(MAX_LANES), Group::default());
        let listed = |groups: &[Group], member: usize| groups[member / MAX_LANES].listed[member % MAX_LANES] as usize - *first;
        let mut joining = joining.iter().rev().map(|&place| usize::from(place)).peekable();
        // Merged from the end, so that every pair is moved before its place is taken.
        for place in (0..count).rev() {
            let (group, lane) = (place / MAX_LANES, place % MAX_LANES);
            let (pair, multiplier) = if let Some(pair) = joining.next_if(|&pair| left == 0 || pair > listed(groups, left - 1)) {
                safe_until[pair] = f32::INFINITY;
                (member(corners[pair], (*first + pair) as u32, thickness[pair]), lambda[pair])
            } else {
                left -= 1;
                groups[left / MAX_LANES].pair(left % MAX_LANES)
            };
            groups[group].put(lane, pair, multiplier);
        }
        for (index, group) in groups.iter_mut().enumerate() {
            group.close((count - index * MAX_LANES).min(MAX_LANES));
        }
        let set = |group: &Group| group.block.corners.iter().flatten().fold(0, |all, &vertex| all | ranges.bit(vertex));
        of_groups.clear();
        of_groups.extend(groups.iter().map(set));
    }
}

/// What truncation finds in a portion.
#[derive(Debug, Default)]
pub(crate) struct Truncation {
    /// For each vertex that is shortened, its place and the share of its displacement that is left.
    pub shares: Vec<(u32, f32)>,
    /// For those of pairs with a kinematic side: by which vector (m), at most as long as the thickness, they get beyond the plane, and
    /// in w its square (m²).
    pub beyond: Vec<(u32, Vec4)>,
    /// The corners of pairs whose plane has passed a vertex: see [`crate::contact::contacts::pinches`].
    pub passed: Vec<[u32; 4]>,
    /// The lanes of each block, one bit each, with pairs that are clear, and with those that were until a corner was shortened.
    pub clear: Vec<u32>,
    pub held: Vec<u32>,
}

impl Truncation {
    /// Begins anew, with this many blocks.
    pub(crate) fn begin(&mut self, blocks: usize) {
        self.shares.clear();
        self.beyond.clear();
        self.passed.clear();
        self.held.clear();
        self.clear.clear();
        self.clear.resize(blocks, 0);
    }

    /// Chooses the pairs to be held next: those that were clear and have a corner with this property.
    pub(crate) fn hold_more<'a>(&mut self, blocks: impl Iterator<Item = &'a Block>, is_shortened: impl Fn(u32) -> bool) {
        self.shares.clear();
        self.held.clear();
        for (block, clear) in blocks.zip(&mut self.clear) {
            let lanes = (0..MAX_LANES).filter(|&lane| *clear >> lane & 1 != 0);
            let held = lanes.filter(|&lane| block.corners[lane].iter().any(|&corner| is_shortened(corner)));
            let held = held.fold(0, |held, lane| held | 1 << lane);
            *clear &= !held;
            self.held.push(held);
        }
    }

    /// Whether any pairs are to be held now.
    pub(crate) fn holds(&self) -> bool {
        self.held.iter().any(|&lanes| lanes != 0)
    }
}
