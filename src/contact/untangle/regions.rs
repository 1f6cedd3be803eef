//! Regions that went through a surface, and the way back.
//!
//! A contour that runs straight from border to border becomes no shorter wherever it is moved, so that its gradient leads nowhere. But
//! it cuts the surfaces that meet in it into regions, and what lies on one side of it must have gone through (global intersection
//! analysis: Baraff, Witkin and Kass 2003, "Untangling Cloth"). That is taken to be the smallest region that is free to move.

use std::collections::{BTreeMap, VecDeque};

use glam::Vec3A;

use super::Tangle;
use crate::contact::crossings::contours::contours;
use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;

/// Vertices, and the direction in which they get back.
pub(crate) type Region = (Vec<u32>, Vec3A);

/// For each contour the vertices on that side of it that is smaller, and the direction in which they get back. A vertex belongs to the
/// side of a contour that is nearest to it along edges that are not cut. Sides with fixed vertices are left out.
pub(crate) fn regions(tangle: &Tangle<'_>, found: &[[u32; 2]]) -> Vec<Region> {
    let all = contours(found, |edge| tangle.at_edges.of(edge));
    let sides = sides(tangle, found, &all);
    let mut vertices: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    (0..).zip(&sides).for_each(|(vertex, &side)| vertices.entry(side).or_default().push(vertex));
    vertices.retain(|_, vertices| vertices.iter().all(|&vertex| tangle.x[vertex as usize].w > 0.0));
    let mut back = Vec::new();
    for contour in all {
        let mut directions: BTreeMap<u32, Vec3A> = BTreeMap::new();
        for (crossing, _) in contour {
            let [edge, triangle] = found[crossing];
            let [p, q] = tangle.edges[edge as usize];
            let [of_p, of_q] = [p, q].map(|end| sides[end as usize]);
            if of_p != of_q {
                let normal = tangle.normal(triangle);
                let toward_q = normal * 1.0_f32.copysign(normal.dot(tangle.at(q) - tangle.at(p)));
                *directions.entry(of_p).or_default() += toward_q;
                *directions.entry(of_q).or_default() -= toward_q;
            }
        }
        let free = directions.into_iter().filter_map(|(side, toward)| vertices.get(&side).map(|vertices| (vertices, toward)));
        if let Some((vertices, toward)) = free.min_by_key(|(vertices, _)| vertices.len()) {
            back.push((vertices.clone(), toward.normalize_or_zero()));
        }
    }
    back
}

/// The side of a contour to which each vertex belongs, named by a vertex of it; `u32::MAX` if it cannot be reached from any.
fn sides(tangle: &Tangle<'_>, found: &[[u32; 2]], contours: &[Vec<(usize, f32)>]) -> Vec<u32> {
    let mut is_cut = vec![false; tangle.edges.len()];
    let mut contour_of = vec![u32::MAX; tangle.x.len()];
    for (index, contour) in (0..).zip(contours) {
        for &(crossing, _) in contour {
            let edge = found[crossing][0] as usize;
            is_cut[edge] = true;
            tangle.edges[edge].into_iter().for_each(|end| contour_of[end as usize] = contour_of[end as usize].min(index));
        }
    }
    let whole = || tangle.edges.iter().zip(&is_cut).filter_map(|(&edge, &is_cut)| (!is_cut).then_some(edge));
    let beside =
        whole().filter(|[a, b]| contour_of[*a as usize] == contour_of[*b as usize] && contour_of[*a as usize] != u32::MAX);
    let mut sides = DisjointSets::parts(tangle.x.len(), beside);
    let neighbors = Csr::new(tangle.x.len(), whole().flat_map(|[a, b]| [(a, b), (b, a)]));
    let at_contours = |&vertex: &u32| contour_of[vertex as usize] != u32::MAX;
    let mut queue: VecDeque<u32> = (0..tangle.x.len() as u32).filter(at_contours).collect();
    let mut is_reached: Vec<bool> = contour_of.iter().map(|&contour| contour != u32::MAX).collect();
    sides.iter_mut().zip(&is_reached).filter(|(_, is)| !**is).for_each(|(side, _)| *side = u32::MAX);
    while let Some(vertex) = queue.pop_front() {
        for &neighbor in neighbors.of(vertex) {
            if !std::mem::replace(&mut is_reached[neighbor as usize], true) {
                sides[neighbor as usize] = sides[vertex as usize];
                queue.push_back(neighbor);
            }
        }
    }
    sides
}
