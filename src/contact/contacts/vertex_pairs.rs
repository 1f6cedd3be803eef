//! The active pairs of each vertex, in slices of several vertices that are padded to the longest list of a slice (sliced ELLPACK;
//! Monakov, Lokhmotov and Avetisyan 2010). So vertices are summed up at once by SIMD lanes, each in the order of its pairs.

use glam::Vec4;

use crate::contact::contacts::near::group::Weights;
use crate::contact::contacts::near::portions::Portion;
use crate::contact::ranges::Ranges;
use crate::simd::{Loop, MAX_LANES, Registers};

/// Vertices of a slice: as many as the largest register has 4-vectors.
pub(crate) const SLICE: usize = MAX_LANES / 4;

/// The active pairs of a range of vertices.
#[derive(Debug, Default)]
pub(crate) struct VertexPairs {
    /// A pair of each vertex of a slice, then the next of each; the weights there, and their places among all weights.
    pairs: Vec<[u32; SLICE]>,
    weights: Vec<[f32; SLICE]>,
    places: Vec<[u32; SLICE]>,
    /// Where those of each slice begin, and the last one's end.
    starts: Vec<u32>,
    /// Number of pairs of each vertex.
    counts: Vec<u32>,
    /// Room for a sum of each vertex.
    pub sums: Vec<[Vec4; SLICE]>,
}

impl VertexPairs {
    /// Collects the pairs of `vertices` vertices, which are those of a range. Places that are left get a weight that is
    /// always 0.
    pub(crate) fn collect(&mut self, portions: &[Portion], ranges: Ranges, range: usize, vertices: usize) {
        let VertexPairs { pairs, weights, places, starts, counts, .. } = self;
        let groups = || {
            let groups = portions.iter().flat_map(|portion| (portion.before..).zip(&portion.groups).zip(&portion.ranges));
            groups.filter(|(_, ranges)| **ranges >> range & 1 != 0).map(|(group, _)| group)
        };
        let slices = vertices.div_ceil(SLICE);
        counts.clear();
        counts.resize(slices * SLICE, 0);
        for (_, group) in groups() {
            for &vertex in group.block.corners[..group.count as usize].iter().flatten() {
                let (of, place) = ranges.place(vertex);
                if of == range {
                    counts[place] += 1;
                }
            }
        }
        starts.clear();
        starts.push(0);
        let mut total = 0;
        for counts in counts.as_chunks::<SLICE>().0 {
            total += counts.iter().max().copied().unwrap_or(0);
            starts.push(total);
        }
        let zero = portions.last().map_or(0, |last| 4 * MAX_LANES * (last.before + last.groups.len()));
        pairs.clear();
        pairs.resize(total as usize, [0; SLICE]);
        places.clear();
        places.resize(total as usize, [zero as u32; SLICE]);
        weights.resize(total as usize, [0.0; SLICE]);
        counts.fill(0);
        for (index, group) in groups() {
            for lane in 0..group.count as usize {
                for (k, vertex) in group.block.corners[lane].into_iter().enumerate() {
                    let (of, place) = ranges.place(vertex);
                    if of == range {
                        let row = (starts[place / SLICE] + counts[place]) as usize;
                        counts[place] += 1;
                        pairs[row][place % SLICE] = (MAX_LANES * index + lane) as u32;
                        places[row][place % SLICE] = (MAX_LANES * (4 * index + k) + lane) as u32;
                    }
                }
            }
        }
    }

    /// Takes over the weights of vertices in their pairs, and tells the sum of each vertex.
    pub(crate) fn weigh(&mut self, from: &[Weights], mut tell: impl FnMut(usize, f32)) {
        for (slice, of) in self.starts.windows(2).enumerate() {
            let of = of[0] as usize..of[1] as usize;
            let mut sum = Vec4::ZERO;
            for (weights, places) in self.weights[of.clone()].iter_mut().zip(&self.places[of]) {
                *weights =
                    places.map(|place| from[place as usize / (4 * MAX_LANES)].0.as_flattened()[place as usize % (4 * MAX_LANES)]);
                sum += Vec4::from_array(*weights).abs();
            }
            (0..SLICE).for_each(|vertex| tell(slice * SLICE + vertex, sum[vertex]));
        }
    }
}

/// Sums up what vertices receive from their pairs; `from` has one vector for each pair.
pub(crate) struct Sums<'a> {
    pub pairs: &'a VertexPairs,
    pub from: &'a [Vec4],
    pub to: &'a mut Vec<[Vec4; SLICE]>,
}

impl Loop for Sums<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Sums { pairs: VertexPairs { pairs, weights, starts, .. }, from, to } = self;
        to.resize(starts.len() - 1, [Vec4::ZERO; SLICE]);
        for (slice, to) in to.iter_mut().enumerate() {
            let of = starts[slice] as usize..starts[slice + 1] as usize;
            for first in (0..SLICE).step_by(L::VECTORS) {
                let mut sum = L::splat(0.0);
                for (pairs, weights) in pairs[of.clone()].iter().zip(&weights[of.clone()]) {
                    let mut vectors = [from[pairs[first] as usize]; 4];
                    for index in 1..L::VECTORS {
                        vectors[index] = from[pairs[first + index] as usize];
                    }
                    sum = sum + L::from_vectors(vectors) * L::repeat_each(&weights[first..first + L::VECTORS]);
                }
                sum.store(&mut to[first..first + L::VECTORS]);
            }
        }
    }
}
