//! A render mesh follows the coarser cloth that it is bound to: exactly where the cloth is flat, within a millimeter
//! where it is bent.

mod common;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Attributes, Backend, BindError, Binding, Collider, Deformer, Fabric, Mesh, Options};
use common::{meshes, play};

/// 812 vertices are simulated and 5041 drawn: a sheet with a wavy thickness, and a hem of 2 cm beyond the border.
fn meshes_of_a_sheet() -> (Mesh, Mesh) {
    let (cloth, mut drawn) = (Mesh::grid(28, 29, 1.0, 1.0), Mesh::grid(71, 71, 1.04, 1.04));
    for (index, x) in drawn.positions.iter_mut().enumerate() {
        x.y = 0.004 * (index as f32 * 0.37).sin();
    }
    (cloth, drawn)
}

fn applied(binding: &Binding, cloth: &[Vec3], drawn: &Mesh) -> Vec<Vec3> {
    let mut positions = vec![Vec3::NAN; drawn.positions.len()];
    binding.apply(cloth, &mut positions).unwrap();
    positions
}

fn worst(a: &[Vec3], b: &[Vec3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
}

#[test]
fn rigid_motions_are_reproduced_to_rounding() {
    let (cloth, drawn) = meshes_of_a_sheet();
    let binding = Binding::new(&drawn, &cloth).unwrap();
    assert!(worst(&applied(&binding, &cloth.positions, &drawn), &drawn.positions) < 5e-7);
    assert!((0.02..0.03).contains(&binding.farthest()), "{}", binding.farthest());
    let turn = Quat::from_axis_angle(Vec3::new(1.0, -2.0, 0.5).normalize(), 2.0);
    let moved = |x: &Vec3| turn * *x + Vec3::new(0.4, 1.5, -0.8);
    let of = |mesh: &Mesh| mesh.positions.iter().map(moved).collect::<Vec<Vec3>>();
    assert!(worst(&applied(&binding, &of(&cloth), &drawn), &of(&drawn)) < 2e-6);
    // A flat sheet may also be stretched and sheared in its plane, because the weights of the corners are those in the
    // plane.
    let flat = Mesh { positions: drawn.positions.iter().map(|x| x.with_y(0.0)).collect(), ..drawn.clone() };
    let binding = Binding::new(&flat, &cloth).unwrap();
    let sheared = |x: &Vec3| Vec3::new(1.3 * x.x + 0.2 * x.z, 0.7, 0.8 * x.z - 0.1 * x.x);
    let of = |mesh: &Mesh| mesh.positions.iter().map(sheared).collect::<Vec<Vec3>>();
    assert!(worst(&applied(&binding, &of(&cloth), &flat), &of(&flat)) < 1e-6);
}

/// A cloth of random triangles that is curved at rest: a third of a cylinder, with a drawn layer around it.
#[test]
fn a_curved_rest_shape_is_met_and_turned() {
    let roll = |x: &Vec3, radius: f32| Vec3::new(radius * (2.0 * x.x).sin(), radius * (2.0 * x.x).cos(), x.z);
    let mut cloth = meshes::delaunay(24, 3);
    cloth.positions.iter_mut().for_each(|x| *x = roll(x, 0.5));
    let mut drawn = Mesh::grid(41, 37, 0.98, 0.97);
    drawn.positions.iter_mut().for_each(|x| *x = roll(x, 0.507));
    let binding = Binding::new(&drawn, &cloth).unwrap();
    assert!(worst(&applied(&binding, &cloth.positions, &drawn), &drawn.positions) < 2e-6);
    let turn = Quat::from_rotation_z(1.0);
    let of = |mesh: &Mesh| mesh.positions.iter().map(|x| turn * *x).collect::<Vec<Vec3>>();
    assert!(worst(&applied(&binding, &of(&cloth), &drawn), &of(&drawn)) < 3e-6);
    // If the cloth is inflated, the layer keeps its distance from it.
    let blown: Vec<Vec3> = cloth.positions.iter().map(|x| Vec3::new(2.0 * x.x, 2.0 * x.y, x.z)).collect();
    for x in applied(&binding, &blown, &drawn) {
        let away = x.with_z(0.0).length() - 1.0;
        assert!((away - 0.007).abs() < 0.002, "{away}");
    }
}

/// Rolled onto a cylinder of 0.2 m, the drawn vertices are within a millimeter of where the same map takes them.
#[test]
fn a_bent_sheet_is_within_a_millimeter() {
    let (cloth, drawn) = meshes_of_a_sheet();
    let binding = Binding::new(&drawn, &cloth).unwrap();
    let radius = 0.2;
    let roll = |x: &Vec3| {
        let (sin, cos) = (x.x / radius).sin_cos();
        Vec3::new((radius + x.y) * sin, (radius + x.y) * cos - radius, x.z)
    };
    let inner = |x: &&Vec3| x.x.abs() < 0.5 && x.z.abs() < 0.5;
    let rolled: Vec<Vec3> = cloth.positions.iter().map(roll).collect();
    let embedded = applied(&binding, &rolled, &drawn);
    let pairs = || drawn.positions.iter().zip(&embedded).filter(|(x, _)| inner(x));
    let far = pairs().map(|(x, embedded)| embedded.distance(roll(x))).fold(0.0, f32::max);
    println!("{far} m");
    // l²/8R is .86 mm for edges of 37 mm.
    assert!(far < 1e-3, "{far}");
    // Without the heights the error would be 4 mm.
    let flat = Mesh { positions: drawn.positions.iter().map(|x| x.with_y(0.0)).collect(), ..drawn.clone() };
    let flat = applied(&Binding::new(&flat, &cloth).unwrap(), &rolled, &flat);
    let far = drawn.positions.iter().zip(&flat).filter(|(x, _)| inner(x)).map(|(x, y)| y.distance(roll(x))).fold(0.0, f32::max);
    assert!(far > 3e-3, "{far}");
}

/// Normals of the render mesh, which need not be those of its triangles, move with the cloth: exactly if it is turned, and within what
/// the cloth's edges cut off an arc if it is rolled up.
#[test]
fn normals_turn_with_the_cloth() {
    let (cloth, drawn) = meshes_of_a_sheet();
    let any = |index: usize| Vec3::new((index as f32).sin(), (1.7 * index as f32).cos(), (2.3 * index as f32).sin());
    let at_rest: Vec<Vec3> = (0..drawn.positions.len()).map(any).collect();
    let binding = Binding::with_normals(&drawn, &at_rest, &cloth).unwrap();
    let mut normals = vec![Vec3::NAN; at_rest.len()];
    let turn = Quat::from_axis_angle(Vec3::new(1.0, -2.0, 0.5).normalize(), 2.0);
    let turned: Vec<Vec3> = cloth.positions.iter().map(|x| turn * *x + Vec3::ONE).collect();
    binding.apply_normals(&turned, &mut normals).unwrap();
    let unit: Vec<Vec3> = at_rest.iter().map(|normal| normal.normalize()).collect();
    let apart = worst(&normals, &unit.iter().map(|normal| turn * *normal).collect::<Vec<_>>());
    // Positions of up to 2.5 m are rounded by 1.2e-7 m, over edges of 36 mm.
    assert!(apart < 2e-5, "{apart}");
    // Positions are those of a binding without normals.
    let [with, without] = [&binding, &Binding::new(&drawn, &cloth).unwrap()].map(|binding| applied(binding, &turned, &drawn));
    assert_eq!(with, without);

    // Where the cloth is stretched, normals move by the inverse transpose of what moves positions.
    let stretched: Vec<Vec3> = cloth.positions.iter().map(|x| Vec3::new(1.3 * x.x, 0.0, 0.8 * x.z)).collect();
    binding.apply_normals(&stretched, &mut normals).unwrap();
    let expected = unit.iter().map(|n| Vec3::new(n.x / 1.3, n.y, n.z / 0.8).normalize()).collect::<Vec<_>>();
    assert!(worst(&normals, &expected) < 1e-5, "{}", worst(&normals, &expected));

    let radius = 0.2;
    let rolled: Vec<Vec3> =
        cloth.positions.iter().map(|x| Vec3::new(radius * (x.x / radius).sin(), radius * (x.x / radius).cos(), x.z)).collect();
    binding.apply_normals(&rolled, &mut normals).unwrap();
    let inner = |x: &Vec3| x.x.abs() < 0.45 && x.z.abs() < 0.45;
    let pairs = drawn.positions.iter().zip(&unit).zip(&normals).filter(|((x, _), _)| inner(x));
    let apart = pairs.map(|((x, unit), normal)| normal.distance(Quat::from_rotation_z(-x.x / radius) * *unit));
    let farthest = apart.fold(0.0, f32::max);
    // An edge of 37 mm turns by .185 rad, so its middle is apart by half of that at most.
    assert!(farthest < 0.1, "{farthest}");

    let mut few = [Vec3::ONE; 3];
    assert_eq!(Binding::new(&drawn, &cloth).unwrap().apply_normals(&turned, &mut few), Err(BindError::NoNormals));
    let refusal = binding.apply_normals(&turned, &mut few).unwrap_err();
    assert_eq!(refusal, BindError::Length { mesh: "render", given: 3, expected: 5041 });
    assert_eq!(few, [Vec3::ONE; 3]);
    let refused = |normals: &[Vec3]| Binding::with_normals(&drawn, normals, &cloth).unwrap_err();
    assert_eq!(refused(&few), BindError::NormalCount { given: 3, expected: 5041 });
    let mut broken = at_rest.clone();
    broken[7].z = f32::NAN;
    assert!(refused(&broken).to_string().contains("normal of vertex 7"));
    // Normals without a direction, and a cloth without an area, give none.
    let none = Binding::with_normals(&drawn, &vec![Vec3::ZERO; 5041], &cloth).unwrap();
    none.apply_normals(&turned, &mut normals).unwrap();
    assert!(normals.iter().all(|normal| *normal == Vec3::ZERO));
    normals.fill(Vec3::NAN);
    binding.apply_normals(&vec![Vec3::ONE; 812], &mut normals).unwrap();
    assert!(normals.iter().all(|normal| *normal == Vec3::ZERO));
}

/// Over a ball, the drawn mesh keeps its distance outside as the cloth does.
#[test]
fn a_draped_cloth_is_drawn_where_it_is() {
    let (cloth, drawn) = (Mesh::grid(28, 29, 1.0, 1.0), Mesh::grid(71, 71, 1.0, 1.0));
    let binding = Binding::new(&drawn, &cloth).unwrap();
    let options = Options { backend: Backend::Cpu, fabric: Fabric::TOWEL, ..Options::default() };
    let mut deformer = Deformer::new(&cloth, options).unwrap();
    let ball = Collider::sphere(Vec3::Y * -0.32, 0.3);
    play(&mut deformer, 40, &Attributes { colliders: vec![ball.clone()], ..Attributes::default() });
    let positions = applied(&binding, deformer.positions().unwrap(), &drawn);
    let deepest = positions.iter().map(|x| ball.distance(*x)).fold(f32::INFINITY, f32::min);
    assert!(deepest > -1e-3, "{deepest}");
}

#[test]
fn what_cannot_be_bound_is_refused() {
    let (cloth, drawn) = meshes_of_a_sheet();
    let refused = |render: &Mesh, cloth: &Mesh, words: &[&str]| {
        let refusal = Binding::new(render, cloth).unwrap_err().to_string();
        words.iter().for_each(|word| assert!(refusal.contains(word), "{refusal}"));
    };
    refused(&drawn, &Mesh::default(), &["no triangle"]);
    let line = Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0], triangles: vec![[0, 1, 2], [1, 1, 1]] };
    refused(&drawn, &line, &["no triangle"]);
    let mut broken = cloth.clone();
    broken.positions[7].z = f32::NAN;
    refused(&drawn, &broken, &["vertex 7", "cloth", "finite"]);
    refused(&broken, &cloth, &["vertex 7", "render"]);
    // What overflows would be drawn nowhere.
    let far = |x: f32| Mesh { positions: vec![Vec3::ZERO, Vec3::splat(x)], triangles: Vec::new() };
    refused(&far(1e30), &cloth, &["vertex 1", "render", "1e15"]);
    let speck = Mesh { positions: [Vec3::ZERO, Vec3::X, Vec3::Z].map(|x| 1e-12 * x).to_vec(), triangles: vec![[0, 2, 1]] };
    refused(&far(1e10), &speck, &["vertex 1", "too far"]);
    let mut broken = cloth.clone();
    broken.triangles[3][1] = 812;
    refused(&drawn, &broken, &["triangle 3", "812"]);

    let binding = Binding::new(&drawn, &cloth).unwrap();
    let mut positions = vec![Vec3::ONE; 3];
    let refusal = binding.apply(&cloth.positions, &mut positions).unwrap_err();
    assert_eq!(refusal, BindError::Length { mesh: "render", given: 3, expected: 5041 });
    let refusal = binding.apply(&positions.clone(), &mut positions).unwrap_err();
    assert!(refusal.to_string().contains("3 items were given for the 812 vertices of the cloth"), "{refusal}");
    assert_eq!(positions, [Vec3::ONE; 3]);
    assert!(Binding::new(&Mesh::default(), &cloth).unwrap().apply(&cloth.positions, &mut []).is_ok());
    // Collapsed cloth has no normals: the drawn mesh collapses with it and stays finite.
    let collapsed = applied(&binding, &vec![Vec3::ONE; 812], &drawn);
    assert!(collapsed.iter().all(|x| x.distance(Vec3::ONE) < 1e-4));
}

/// A cloth whose triangles are wound in any way carries a render mesh rigidly, too.
#[test]
fn mixed_winding_carries_heights() {
    let mut cloth = Mesh::grid(9, 9, 1.0, 1.0);
    cloth.triangles.iter_mut().step_by(2).for_each(|triangle| triangle.swap(1, 2));
    let drawn = Mesh {
        positions: Mesh::grid(31, 31, 1.0, 1.0).positions.iter().map(|x| *x + 0.05 * Vec3::Y).collect(),
        triangles: vec![],
    };
    let binding = Binding::new(&drawn, &cloth).unwrap();
    let turn = Quat::from_rotation_y(0.6) * Quat::from_rotation_x(0.3);
    let moved: Vec<Vec3> = cloth.positions.iter().map(|x| turn * *x).collect();
    let mut shown = drawn.positions.clone();
    binding.apply(&moved, &mut shown).unwrap();
    let farthest = shown.iter().zip(&drawn.positions).map(|(x, rest)| x.distance(turn * *rest)).fold(0.0, f32::max);
    assert!(farthest < 1e-6, "{farthest} m");
}
