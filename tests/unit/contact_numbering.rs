//! Numbering more vertices has the same result as numbering all of them anew.

use fastrand::Rng;

use super::*;
use crate::contact::contacts::near::group::Group;
use crate::contact::surface::pairs::Listed;
use crate::simd::MAX_LANES;

/// Adds pairs of random vertices to either list.
fn add(lists: &mut [Rows; 2], counts: [usize; 2], vertices: std::ops::Range<u32>, random: &mut Rng) {
    for (rows, count) in lists.iter_mut().zip(counts) {
        let pair = || Listed { corners: [0; 4].map(|_| random.u32(vertices.clone())), other: 0, thickness: random.f32() };
        rows.pairs.extend(std::iter::repeat_with(pair).take(count));
        rows.lambda.resize(rows.pairs.len(), Vec4::ZERO);
    }
}

#[test]
fn more_vertices_are_numbered_as_if_all_were() {
    let ranges: &[std::ops::Range<u32>] = &[30..50, 0..100, 45..46, 30..80, 0..31];
    for (seed, added) in (0..).zip(ranges) {
        let (mut random, mut lists) = (Rng::with_seed(seed), <[Rows; 2]>::default());
        let mut contacts = Contacts::default();
        // Pairs of the first list fill one portion, and those that are added two more.
        add(&mut lists, [PORTION - 3, 20], 30..50, &mut random);
        contacts.number(&lists, 100, Workers::ALONE);
        let known = contacts.order.clone();
        contacts.x.iter_mut().zip(&known).for_each(|(x, &vertex)| *x = Vec4::splat(vertex as f32));
        let mut group = Group::default();
        group.block.corners.copy_from_slice(&contacts.portions[1].corners[..MAX_LANES]);
        contacts.portions[1].groups.push(group);
        add(&mut lists, [PORTION + 5, PORTION], added.clone(), &mut random);
        contacts.number_more(&lists, Workers::ALONE);

        let mut anew = Contacts::default();
        anew.number(&lists, 100, Workers::ALONE);
        assert_eq!(contacts.order, anew.order, "{added:?}");
        let portions = |contacts: &Contacts| -> Vec<_> {
            let of = |Portion { kind, first, corners, thickness, safe_until, .. }: &Portion| {
                (*kind, *first, corners.clone(), thickness.clone(), safe_until.len())
            };
            contacts.portions().iter().map(of).collect()
        };
        assert_eq!(portions(&contacts), portions(&anew), "{added:?}");
        for (&vertex, x) in contacts.order.iter().zip(&contacts.x) {
            let is_known = known.contains(&vertex);
            assert_eq!(*x, if is_known { Vec4::splat(vertex as f32) } else { UNKNOWN }, "{added:?}: {vertex}");
        }
        // The group is still with the first portion of the second list.
        let groups: Vec<usize> = contacts.portions[..contacts.used].iter().map(|portion| portion.groups.len()).collect();
        assert_eq!(groups, [0, 0, 0, 1, 0]);
        assert_eq!(contacts.portions[3].groups[0].block.corners, anew.portions[3].corners[..MAX_LANES]);
    }
}
