//! Fabrics: the presets are within the range of measured fabrics, and `edge_scale` makes shear as soft as theirs.

mod common;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Mesh, Options, Quality};
use common::{FRAME, play};

/// The 5 % and 95 % quantiles of measured garment fabrics (see the docs of `Fabric`); stretch from the softest knit to
/// the stiffest woven.
#[test]
fn presets_are_fabrics() {
    for (name, fabric) in Fabric::PRESETS.iter().copied() {
        let stretch = if name == "jersey" { 50.0..=500.0 } else { 1000.0..=10_000.0 };
        assert!((0.031..=0.488).contains(&fabric.density), "{name}: {} kg/m2", fabric.density);
        assert!((0.9e-6..=1.1e-4).contains(&fabric.bending), "{name}: {} N m", fabric.bending);
        assert!(stretch.contains(&fabric.stretch), "{name}: {} N/m", fabric.stretch);
        assert!(fabric.damping > 0.0, "{name}: does not settle");
    }
}

/// A vertex has a third of each triangle around it.
#[test]
fn vertices_share_the_area() {
    let areas = Mesh::grid(3, 3, 2.0, 2.0).vertex_areas();
    assert!((areas.iter().sum::<f64>() - 4.0).abs() < 1e-9, "{areas:?}");
    // In the middle there are six triangles of half a square meter, at the corners one or two.
    for (vertex, triangles) in [(4, 6.0), (0, 1.0), (2, 2.0), (6, 2.0), (8, 1.0)] {
        assert!((areas[vertex] - triangles / 6.0).abs() < 1e-9, "vertex {vertex}: {areas:?}");
    }
}

/// Scale factors for the edges of a grid: `scale` for the diagonals, 1 for the others.
fn soft_diagonals(mesh: &Mesh, scale: f32) -> Vec<f32> {
    let slanted = |[a, b]: &[u32; 2]| {
        let d = mesh.positions[*a as usize] - mesh.positions[*b as usize];
        d.x.abs() > 1e-6 && d.z.abs() > 1e-6
    };
    mesh.edges().iter().map(|edge| if slanted(edge) { scale } else { 1.0 }).collect()
}

/// The shear stiffness of a grid is a quarter of its diagonals': `K scale/4`, which is 25 N/m for 5 kN/m scaled by
/// 0.02.
#[test]
fn the_diagonals_set_the_shear_stiffness() {
    let mesh = Mesh::grid(17, 17, 1.0, 1.0);
    for scale in [1.0, 0.02] {
        let options = Options { backend: Backend::Cpu, edge_scale: Some(soft_diagonals(&mesh, scale)), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let angle = 1e-2_f64;
        let sheared: Vec<Vec3> = mesh.positions.iter().map(|x| Vec3::new(x.x + angle as f32 * x.z, 0.0, x.z)).collect();
        cloth.set_state(&sheared, &vec![Vec3::ZERO; sheared.len()]).unwrap();
        let stiffness = 2.0 * cloth.measure().unwrap().potential_energy / (angle * angle);
        let expected = 5000.0 * f64::from(scale) / 4.0;
        println!("scale {scale}: shear stiffness {stiffness:.2} N/m, expected {expected} N/m");
        assert!((stiffness / expected - 1.0).abs() < 0.02, "scale {scale}: {stiffness} N/m, expected {expected} N/m");
    }
}

/// A fabric that is soft in all edges is measured like any other, so a bound on its strain takes substeps.
#[test]
fn a_bound_on_strain_holds_where_all_edges_are_soft() {
    let mesh = Mesh::grid(17, 17, 1.0, 1.0);
    let pinned: Vec<u32> = (0..17).collect();
    let reports = [(Fabric::default().stretch, 0.4), (0.4 * Fabric::default().stretch, 1.0)].map(|(stretch, scale)| {
        let fabric = Fabric { stretch, ..Fabric::default() };
        let edge_scale = Some(vec![scale; mesh.edges().len()]);
        let options = Options { backend: Backend::Cpu, fabric, edge_scale, pinned: pinned.clone(), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        (0..40).map(|_| cloth.step(FRAME, &Attributes::default()).unwrap()).last().unwrap()
    });
    let [soft, plain] = reports.each_ref().map(|report| report.stretch.unwrap().share);
    assert!(soft > 1e-3 && (soft / plain - 1.0).abs() < 0.3, "{soft}, {plain}");
}

/// Hung by a corner, so that its weight pulls along the bias, a sheet with soft diagonals stretches; a stiff one hardly
/// does.
#[test]
fn soft_diagonals_give_way_along_the_bias() {
    let n = 17;
    let mut mesh = Mesh::grid(n, n, 1.0, 1.0);
    // Standing on its corner in a vertical plane.
    let turn = |x: Vec3| Vec3::new(x.x - x.z, -x.x - x.z, 0.0) * std::f32::consts::FRAC_1_SQRT_2;
    let scales = [1.0, 0.02].map(|scale| Some(soft_diagonals(&mesh, scale)));
    mesh.positions.iter_mut().for_each(|x| *x = turn(*x));
    let stretched = scales.map(|edge_scale| {
        let options =
            Options { backend: Backend::Cpu, edge_scale, pinned: vec![0], quality: Quality::Substeps(80), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        play(&mut cloth, 180, &Attributes { damping: 6.0, ..Attributes::default() });
        let positions = cloth.positions().unwrap();
        (positions[0].distance(positions[(n * n - 1) as usize]) / 2.0_f32.sqrt()) - 1.0
    });
    println!("along the bias: {:.4} with stiff diagonals, {:.4} with soft ones", stretched[0], stretched[1]);
    assert!(stretched[1] > 5.0 * stretched[0] && stretched[1] > 0.01, "{stretched:?}");
}

/// A sheet of jersey hangs as deep as its stiffness says, `rho g L²/2K`, whether levels carry it or not.
#[test]
fn jersey_hangs_by_its_own_stiffness() {
    let (n, side) = (32, 2.0_f32);
    let mut mesh = Mesh::grid(n, n, side, side);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, x.z, 0.0));
    let exact = Fabric::JERSEY.density * 9.81 * side * side / (2.0 * Fabric::JERSEY.stretch);
    for (quality, has_levels) in [(Quality::default(), true), (Quality::Substeps(5), true), (Quality::Substeps(20), false)] {
        let pinned: Vec<u32> = (n * n - n..n * n).collect();
        let options = Options { backend: Backend::Cpu, fabric: Fabric::JERSEY, quality, pinned, ..Options::default() };
        let mut deformer = Deformer::new(&mesh, options).unwrap();
        let damped = Attributes { damping: 1.5, ..Attributes::default() };
        let mut levels = 0;
        (0..360).for_each(|_| levels = deformer.step(FRAME, &damped).unwrap().levels);
        assert_eq!(levels > 0, has_levels, "{quality:?}");
        let x = deformer.positions().unwrap();
        let depth = (0..n as usize).map(|v| mesh.positions[v].y - x[v].y).sum::<f32>() / n as f32;
        println!("{quality:?}: {levels} levels, {:.3} of the exact depth", depth / exact);
        assert!((0.95..1.05).contains(&(depth / exact)), "{quality:?}: {depth} m instead of {exact} m");
    }
}
