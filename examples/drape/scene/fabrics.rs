//! Fabrics of several cloths in one mesh: one fabric and factors on it.

use std::collections::HashMap;

use cloth_deformer::{Fabric, Mesh, Options};

/// The material of a piece of the mesh. A scene has no inextensible fabrics.
pub(super) struct Material {
    pub(super) fabric: Fabric,
    /// Number of the piece's vertices, which follow those of the pieces before it.
    pub(super) vertices: usize,
    /// Factors on the stretch stiffness of some of its edges ([`soft_diagonals`]), by the piece's own indices.
    pub(super) diagonals: Vec<([u32; 2], f32)>,
}

/// The fabric and the factors that give each piece of a mesh its own material, in the mesh's order.
///
/// The common stretch stiffness is the lowest, because the strain promise leaves out edges that are softened; the common rigidity is the
/// highest. Fails with the number of the first piece whose fabric does not go with those before it, and why.
pub(super) fn combine(mesh: &Mesh, pieces: &[Material]) -> Result<Options, (usize, &'static str)> {
    let Some(&Material { fabric: first, .. }) = pieces.first() else { return Ok(Options::default()) };
    if pieces.iter().all(|piece| piece.fabric == first && piece.diagonals.is_empty()) {
        return Ok(Options { fabric: first, ..Options::default() });
    }
    let mut common = first;
    for (number, Material { fabric, .. }) in pieces.iter().enumerate() {
        if fabric.bending > 0.0 && common.bending > 0.0 && fabric.damping != common.damping {
            return Err((number, "its damping must be that of the other cloths; give `fabric = { preset = .., damping = .. }`"));
        }
        if common.bending == 0.0 {
            common.damping = fabric.damping;
        }
        common.stretch = common.stretch.min(fabric.stretch);
        common.bending = common.bending.max(fabric.bending);
    }
    let of_vertex: Vec<Fabric> = pieces.iter().flat_map(|piece| std::iter::repeat_n(piece.fabric, piece.vertices)).collect();
    // Both are 0 if nothing bends.
    let ratio = |of: f32, common: f32| if of == common { 1.0 } else { of / common };
    let mut diagonals = HashMap::new();
    let mut first = 0;
    for Material { vertices, diagonals: of_piece, .. } in pieces {
        diagonals.extend(of_piece.iter().map(|&(ends, scale)| (ends.map(|vertex| vertex + first), scale)));
        first += *vertices as u32;
    }
    let scale = |ends: [u32; 2]| {
        let soft = diagonals.get(&sorted(ends)).copied().unwrap_or(1.0);
        soft * ratio(of_vertex[ends[0] as usize].stretch, common.stretch)
    };
    let edge_scale = mesh.edges().into_iter().map(scale).collect();
    let bending_scale = of_vertex.iter().map(|fabric| ratio(fabric.bending, common.bending)).collect();
    let mass = areas(mesh).iter().zip(&of_vertex).map(|(area, fabric)| area * fabric.density).collect();
    let [mass, edge_scale, bending_scale] = [mass, edge_scale, bending_scale].map(Some);
    Ok(Options { fabric: common, mass, edge_scale, bending_scale, ..Options::default() })
}

/// Factors on the stretch stiffness K of the diagonals of a mesh's quads that give it the shear stiffness `shear` (N/m). `corners`
/// holds the number of corners of each polygon, whose triangles follow one another.
///
/// A diagonal of length l in a quad of area A that turns by the shear angle g stretches by `g A/l²` for small angles, and its energy is
/// `K scale A strain²/2`, so that `scale = (shear/K) (l²/A)²`: four times `shear/K` for squares. Quads without an area or a diagonal
/// keep theirs. Fails with the largest shear stiffness that the mesh can have, or with nothing if it has no quads.
pub(super) fn soft_diagonals(
    mesh: &Mesh,
    corners: impl Iterator<Item = usize>,
    stretch: f32,
    shear: f32,
) -> Result<Vec<([u32; 2], f32)>, Option<f64>> {
    let mut soft = Vec::new();
    let (mut triangle, mut most) = (0, f64::INFINITY);
    for corners in corners {
        if corners == 4 {
            let [one, other] = [mesh.triangles[triangle], mesh.triangles[triangle + 1]];
            let shared: Vec<u32> = one.into_iter().filter(|vertex| other.contains(vertex)).collect();
            if let &[a, b] = shared.as_slice() {
                let [x, y] = [a, b].map(|vertex| mesh.positions[vertex as usize].as_dvec3());
                let slope = (area(mesh, one) + area(mesh, other)) / x.distance_squared(y);
                if slope > 0.0 && slope.is_finite() {
                    most = most.min(f64::from(stretch) * slope * slope);
                    soft.push((sorted([a, b]), (f64::from(shear) / f64::from(stretch) / (slope * slope)) as f32));
                }
            }
        }
        triangle += corners - 2;
    }
    match soft.is_empty() {
        true => Err(None),
        false if f64::from(shear) <= most => Ok(soft),
        false => Err(Some(most)),
    }
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// The area (m²) of a triangle.
fn area(mesh: &Mesh, triangle: [u32; 3]) -> f64 {
    let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize].as_dvec3());
    (b - a).cross(c - a).length() / 2.0
}

/// Area (m²) of each vertex; the mean of the others where there is none.
fn areas(mesh: &Mesh) -> Vec<f32> {
    let areas = mesh.vertex_areas();
    let count = areas.iter().filter(|&&area| area > 0.0).count().max(1);
    let mean = areas.iter().sum::<f64>() / count as f64;
    areas.iter().map(|&area| if area > 0.0 { area } else { mean } as f32).collect()
}
