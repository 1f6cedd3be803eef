//! Culling of leaves: cloth that is turned over is compared with itself.

use glam::{Vec3A, Vec4};

use super::{DetectionScope, Tree, Walk};
use crate::contact::detection::boxes::Boxes;
use crate::contact::input::Path;
use crate::contact::surface::Surface;
use crate::contact::workers::Workers;
use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::{Contact, Options};

/// The leaves that are compared with themselves if the vertices stand still at `x`.
fn compared(surface: &Surface, tree: &mut Tree, x: &[Vec4]) -> Vec<u32> {
    let still = vec![Vec4::ZERO; x.len()];
    let path = Path { x, u: &still, margin: &vec![0.0; x.len()], floats: false, workers: Workers::ALONE };
    let (mut boxes, mut found) = (Boxes::default(), Vec::new());
    boxes.bound(tree.leaves.all()[0].clone(), Workers::ALONE, |triangle| {
        let [a, b, c] = surface.triangles[triangle].map(|vertex| xyz(x[vertex as usize]));
        [a.min(b).min(c), a.max(b).max(c)]
    });
    tree.refit(surface, &boxes, path, 6.0);
    let scope = DetectionScope { substeps: 6.0, thickness: 0.005 };
    tree.walk(Walk { scope, all: true, workers: Workers::ALONE }, &mut found);
    found.into_iter().filter(|[a, b]| a == b).map(|[leaf, _]| leaf).collect()
}

/// One vertex of a flat sheet is moved across the opposite sides of some of its triangles, which turns these over. Each leaf
/// at one of their vertices is compared with itself, even if the triangle belongs to another: the leaf's own triangles on
/// either side of it may cross.
#[test]
fn what_is_beside_a_triangle_that_is_turned_over_is_not_culled() {
    let cloth = Cloth::new(&Mesh::grid(12, 12, 1.1, 1.1), &Options::default()).unwrap();
    let (surface, leaves) = Surface::new(&cloth, Some(Contact { thickness: 0.005, ..Contact::default() })).unwrap();
    let mut tree = Tree::of_cloth(&surface, leaves);
    let leaf_of = tree.leaves.of_triangles();
    assert_eq!(compared(&surface, &mut tree, &surface.rest), []);
    let normal = |x: &[Vec4], corners: [u32; 3]| {
        let [a, b, c] = corners.map(|vertex| xyz(x[vertex as usize]));
        (b - a).cross(c - a)
    };
    for vertex in 0..cloth.rest.len() as u32 {
        let mut x = surface.rest.clone();
        x[vertex as usize] += Vec3A::new(0.16, 0.0, 0.07).extend(0.0);
        let found = compared(&surface, &mut tree, &x);
        let is_over = |&&corners: &&[u32; 3]| normal(&x, corners).dot(normal(&surface.rest, corners)) < 0.0;
        for corners in surface.triangles.iter().filter(is_over) {
            let beside = surface.triangles.iter().zip(&leaf_of).filter(|(other, _)| other.iter().any(|v| corners.contains(v)));
            for (_, leaf) in beside {
                assert!(found.contains(leaf), "vertex {vertex}, triangle {corners:?}, leaf {leaf}");
            }
        }
    }
}
