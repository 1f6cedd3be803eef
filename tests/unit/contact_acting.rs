//! Loops over the groups of portions.

use super::*;
use crate::contact::contacts::near::portions::Portion;

/// Portions of edges that were listed after the groups were numbered, so that their numbers are still those of another
/// list, must not take the places of the groups of vertices and triangles.
#[test]
fn each_group_gets_what_belongs_to_it() {
    let portion = |kind, groups, before| Portion { kind, groups: vec![Group::default(); groups], before, ..Portion::default() };
    let (one, other) = (Kind::VertexTriangle, Kind::EdgeEdge);
    let lists = [
        vec![portion(one, 3, 0), portion(one, 2, 3), portion(other, 4, 5)],
        vec![portion(one, 3, 0), portion(one, 2, 3), portion(other, 0, 0)],
        vec![portion(one, 3, 0), portion(one, 0, 7), portion(other, 0, 1), portion(other, 2, 3)],
        vec![portion(other, 2, 0)],
    ];
    for (index, mut portions) in lists.into_iter().enumerate() {
        let count: usize = portions.iter().map(|portion| portion.groups.len()).sum();
        let mut visits = vec![(Kind::VertexTriangle, usize::MAX); count];
        for_groups(&mut portions, (&mut visits, &mut []), Workers::ALONE, &|kind, before, groups, visits, _: &mut [()]| {
            assert_eq!(groups.len(), visits.len());
            visits.iter_mut().zip(before..).for_each(|(visit, number)| *visit = (kind, number));
        });
        let kinds = portions.iter().flat_map(|portion| portion.groups.iter().map(|_| portion.kind));
        assert_eq!(visits, kinds.zip(0..).collect::<Vec<_>>(), "list {index}");
    }
}
