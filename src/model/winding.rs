//! Consistent winding: neighboring triangles turn the same way, so that their normals can be summed and compared.

use crate::model::mesh::{EdgeIndex, follows, sides, triangles_at};

/// Winds triangles alike that share an edge with no third one, by turning over at most half of each connected part. A part
/// that cannot be wound alike, like a Möbius strip, has a line across which it is not. `edges` are those of the triangles,
/// sorted.
pub(crate) fn wind_alike(triangles: &mut [[u32; 3]], edges: &[[u32; 2]], vertices: usize) {
    let index = EdgeIndex::new(edges, vertices);
    let at_edges = triangles_at(edges, triangles, &index);
    let goes_along = |triangle: u32, ends: [u32; 2]| follows(triangles[triangle as usize], ends);
    let mut is_turned: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut turned = Vec::new();
    for first in 0..triangles.len() as u32 {
        if is_turned[first as usize].is_some() {
            continue;
        }
        let mut part = vec![(first, false)];
        is_turned[first as usize] = Some(false);
        let mut next = 0;
        while let Some(&(triangle, turn)) = part.get(next) {
            next += 1;
            for side in sides(triangles[triangle as usize]) {
                let &[one, other] = at_edges.of(index.of(side) as u32) else { continue };
                let beside = if one == triangle { other } else { one };
                // Of a triangle that is there twice, either may be meant.
                let is_same = triangles[beside as usize].iter().all(|corner| triangles[triangle as usize].contains(corner));
                if !is_same && is_turned[beside as usize].is_none() {
                    let turn = turn ^ (goes_along(triangle, side) == goes_along(beside, side));
                    is_turned[beside as usize] = Some(turn);
                    part.push((beside, turn));
                }
            }
        }
        let most = 2 * part.iter().filter(|(_, turn)| *turn).count() > part.len();
        turned.extend(part.into_iter().filter(|(_, turn)| *turn != most).map(|(triangle, _)| triangle));
    }
    turned.into_iter().for_each(|triangle| triangles[triangle as usize].swap(1, 2));
}

#[cfg(test)]
#[path = "../../tests/unit/model_winding.rs"]
mod tests;
