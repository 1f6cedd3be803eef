//! Fabrics of several cloths in one mesh: one fabric and factors on it.

use cloth_deformer::{Fabric, Mesh, Options};

/// The fabric and the factors that give each piece of a mesh its own. `pieces` holds the fabric of each piece and the number of its
/// vertices, in the mesh's order.
///
/// The common stretch stiffness is the lowest, because the strain promise leaves out edges that are softened; the common rigidity is the
/// highest. Fails with the number of the first piece whose fabric does not go with those before it, and why.
pub(super) fn combine(mesh: &Mesh, pieces: &[(Fabric, usize)]) -> Result<Options, (usize, &'static str)> {
    let Some(&(first, _)) = pieces.first() else { return Ok(Options::default()) };
    if pieces.iter().all(|(fabric, _)| *fabric == first) {
        return Ok(Options { fabric: first, ..Options::default() });
    }
    let mut common = first;
    for (number, (fabric, _)) in pieces.iter().enumerate() {
        if fabric.stretch.is_infinite() != first.stretch.is_infinite() {
            return Err((number, "it and the first cloth must both be inextensible, or neither"));
        }
        if fabric.bending > 0.0 && common.bending > 0.0 && fabric.damping != common.damping {
            return Err((number, "its damping must be that of the other cloths; give `fabric = { preset = .., damping = .. }`"));
        }
        if common.bending == 0.0 {
            common.damping = fabric.damping;
        }
        common.stretch = common.stretch.min(fabric.stretch);
        common.bending = common.bending.max(fabric.bending);
    }
    let of_vertex: Vec<Fabric> = pieces.iter().flat_map(|&(fabric, vertices)| std::iter::repeat_n(fabric, vertices)).collect();
    let ratio = |of: f32, common: f32| if of == common { 1.0 } else { of / common };
    let edge_scale = mesh.edges().iter().map(|[a, _]| ratio(of_vertex[*a as usize].stretch, common.stretch)).collect();
    let bending_scale = of_vertex.iter().map(|fabric| ratio(fabric.bending, common.bending)).collect();
    let mass = areas(mesh).iter().zip(&of_vertex).map(|(area, fabric)| area * fabric.density).collect();
    let [mass, edge_scale, bending_scale] = [mass, edge_scale, bending_scale].map(Some);
    Ok(Options { fabric: common, mass, edge_scale, bending_scale, ..Options::default() })
}

/// A third of the area (m²) of the triangles at each vertex; the mean of the others where there is none.
fn areas(mesh: &Mesh) -> Vec<f32> {
    let mut areas = vec![0.0; mesh.positions.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize].as_dvec3());
        let third = (b - a).cross(c - a).length() / 6.0;
        triangle.iter().for_each(|&vertex| areas[vertex as usize] += third);
    }
    let count = areas.iter().filter(|&&area| area > 0.0).count().max(1);
    let mean = areas.iter().sum::<f64>() / count as f64;
    areas.iter().map(|&area| if area > 0.0 { area } else { mean } as f32).collect()
}
