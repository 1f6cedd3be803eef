//! What belongs to all active pairs, besides the groups that they are in.

use glam::Vec4;
use rayon::prelude::*;

use super::corners::Corners;
use super::group::Weights;
use super::least;
use super::portions::Portion;
use super::ranges::Ranges;
use super::start::Vertex;
use crate::simd::MAX_LANES;

/// Groups of pairs that are worth a task.
const GROUPS: usize = 16;

/// What belongs to the active pairs. These are in groups, in the portions of the lists.
#[derive(Debug, Default)]
pub(super) struct Acting {
    /// For each group the impulses (kg m) of its pairs from the last iteration of the multipliers, the corrections of
    /// positions, and the weights of each corner, 0 for pairs that do not act in this substep. Weights have one more
    /// group, of zeros.
    pub impulses: Vec<[Vec4; MAX_LANES]>,
    pub pushes: Vec<[Vec4; MAX_LANES]>,
    pub weights: Vec<Weights>,
    /// The pairs of each vertex, in ranges of vertices.
    pub corners: Vec<Corners>,
    pub ranges: Ranges,
    /// For each vertex its inverse mass (1/kg) times the sum of its weights.
    pub mobility: Vec<f32>,
}

impl Acting {
    /// Numbers the groups of portions.
    pub(super) fn number(&mut self, portions: &mut [Portion]) {
        let mut count = 0;
        for portion in portions {
            portion.before = count;
            count += portion.groups.len();
        }
        self.impulses.resize(count, [Vec4::ZERO; MAX_LANES]);
        self.pushes.resize(count, [Vec4::ZERO; MAX_LANES]);
        self.weights.clear();
        self.weights.resize(count + 1, Weights::default());
    }

    /// Takes over the weights of vertices in their pairs; first collects these pairs if they have changed.
    pub(super) fn weigh(&mut self, portions: &[Portion], have_changed: bool, vertices: &mut [Vertex], is_shared: bool) {
        let Acting { weights, ranges, corners, mobility, .. } = self;
        let (ranges, weights) = (*ranges, &**weights);
        corners.resize_with(corners.len().max(ranges.count), Corners::default);
        mobility.resize(vertices.len(), 0.0);
        let tasks = vertices.par_chunks_mut(ranges.len()).zip(mobility.par_chunks_mut(ranges.len())).zip(corners).enumerate();
        tasks.with_min_len(least(is_shared)).for_each(|(range, ((vertices, mobility), corners))| {
            if have_changed {
                corners.collect(portions, ranges, range, vertices.len());
            }
            corners.weigh(weights, |vertex, weight| {
                // The last slice may have places left.
                if let (Some(vertex), Some(mobility)) = (vertices.get_mut(vertex), mobility.get_mut(vertex)) {
                    (vertex.weight, *mobility) = (weight, vertex.x.w * weight);
                }
            });
        });
    }
}

/// Calls `work` for portions and their parts of two arrays that have an item for each group (or none), in parallel if
/// `is_shared`.
pub(super) fn for_portions<A: Send, B: Send>(
    portions: &mut [Portion],
    (mut a, mut b): (&mut [A], &mut [B]),
    is_shared: bool,
    work: &(impl Fn(&mut Portion, &mut [A], &mut [B]) + Sync),
) {
    let groups = portions.iter().map(|portion| portion.groups.len()).sum::<usize>();
    if !is_shared || portions.len() == 1 || groups <= GROUPS {
        for portion in portions.iter_mut().filter(|portion| !portion.groups.is_empty()) {
            let count = portion.groups.len();
            let of_a = a.split_off_mut(..count.min(a.len())).unwrap_or_default();
            work(portion, of_a, b.split_off_mut(..count.min(b.len())).unwrap_or_default());
        }
        return;
    }
    let (portions, others) = portions.split_at_mut(portions.len() / 2);
    let count = others[0].before - portions[0].before;
    let (a, other_a) = a.split_at_mut(count.min(a.len()));
    let (b, other_b) = b.split_at_mut(count.min(b.len()));
    rayon::join(|| for_portions(portions, (a, b), is_shared, work), || for_portions(others, (other_a, other_b), is_shared, work));
}
