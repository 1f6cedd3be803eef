//! No pair is measured later than it can be near.

use fastrand::Rng;

use super::*;

const VERTICES: usize = 100;
const PAIRS: usize = 150;
const THICKNESS: f32 = 0.005;

fn vector(random: &mut Rng, size: f32) -> Vec3A {
    Vec3A::from_array([0; 3].map(|_| size * (2.0 * random.f32() - 1.0)))
}

/// Vertices move at random, those of a patch about as one, and pairs are added meanwhile. No distance between the sides
/// of a pair has shrunk by more than the total of its bound, nor can it shrink in a substep by more than is between the
/// bound and its limit.
#[test]
fn no_distance_shrinks_by_more_than_its_bound() {
    for (kind, seed) in Kind::ALL.into_iter().flat_map(|kind| (0..20).map(move |seed| (kind, seed))) {
        let mut random = Rng::with_seed(seed);
        let mut x: Vec<Vec3A> = (0..VERTICES).map(|_| vector(&mut random, 0.1)).collect();
        let mut u = vec![Vec3A::ZERO; VERTICES];
        // The sides of pairs are of different halves, which move differently.
        let half = VERTICES as u32 / 2;
        let corners = |random: &mut Rng| [0, 1, 2, 3].map(|k| random.u32(0..half) + if k < kind.first_side() { 0 } else { half });
        let pairs: Vec<Listed> =
            (0..PAIRS).map(|_| Listed { corners: corners(&mut random), other: 0, thickness: THICKNESS }).collect();
        let across = |pair: &Listed| -> Vec<[usize; 2]> {
            let [first, second] = [&pair.corners[..kind.first_side()], &pair.corners[kind.first_side()..]];
            first.iter().flat_map(|&a| second.iter().map(move |&b| [a as usize, b as usize])).collect()
        };
        let (mut bunches, mut listed_at) = (Bunches::default(), Vec::new());
        for substep in 0..10 {
            let moved = std::mem::take(&mut u);
            x.iter_mut().zip(&moved).for_each(|(x, moved)| *x += *moved);
            let patches = VERTICES.div_ceil(PATCH);
            let of_patch: Vec<Vec3A> = (0..patches).map(|_| vector(&mut random, 0.002)).collect();
            u = (0..VERTICES).map(|vertex| of_patch[vertex / PATCH] + vector(&mut random, 0.0002)).collect();
            let mut motions = vec![PatchMotion::NONE; patches];
            for vertex in 0..VERTICES {
                let motion = PatchMotion { moved: [moved[vertex]; 2], travel: u[vertex].length() };
                motions[patch(vertex as u32)].join(&motion);
            }
            // Some whole bunches, and pairs that fill one up.
            let count = [100, 100, 120, PAIRS][substep.min(3)];
            listed_at.resize(count, x.clone());
            let before = bunches.approach.clone();
            bunches.take(kind, &pairs[..count], patches);
            bunches.advance(&motions, 0.0, THICKNESS);
            for (index, pair) in pairs[..count].iter().enumerate() {
                let bound = bunches.approach[index / BUNCH];
                // A pair that is added is due at once, at the total before the bound advances.
                let since = if listed_at[index] == x { before.get(index / BUNCH).map_or(0.0, |bound| bound.total) } else { 0.0 };
                for [a, b] in across(pair) {
                    let distance = |x: &[Vec3A]| x[a].distance(x[b]);
                    let shrunk = distance(&listed_at[index]) - distance(&x);
                    assert!(shrunk <= bound.total - since + 1e-6, "{kind:?} {seed} {substep}: {shrunk}, {bound:?}");
                    let travel = u[a].length() + u[b].length();
                    assert!(bound.limit - bound.total >= travel, "{kind:?} {seed} {substep}: {travel}, {bound:?}");
                }
            }
        }
    }
}
