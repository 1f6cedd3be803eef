//! Starts in which pieces of cloth touch or cross exactly: vertices in triangles, on edges and on vertices, edges
//! through edges, sheets in one plane. What crosses is counted, reported and let go; what merely touches is not, and is
//! held apart.

#[macro_use]
mod common;

use std::sync::Arc;

use cloth_deformer::glam::{DQuat, DVec3, EulerRot, Quat, Vec3};
use cloth_deformer::{Attributes, Backend, Collider, Contact, Deformer, Fabric, Mesh, Options, Quality, StepReport, Warning};
use common::FRAME;
use common::crossings::crossings;
use common::shapes::ball;

on_every_backend!(what_crosses_is_reported_and_what_touches_is_held, what_is_one_piece_and_touches_goes_on);

const CLOTH: Fabric = Fabric { density: 0.2, stretch: 5000.0, bending: 1e-4, damping: 0.03 };
/// Size of a cell of the grids (m).
const CELL: f32 = 0.05;

/// A square grid of `n` by `n` cells in the plane y = 0, with vertices at the origin if `n` is even.
fn sheet(n: u32) -> Mesh {
    Mesh::grid(n + 1, n + 1, n as f32 * CELL, n as f32 * CELL)
}

fn at(mut mesh: Mesh, to: impl Fn(Vec3) -> Vec3) -> Mesh {
    mesh.positions.iter_mut().for_each(|x| *x = to(*x));
    mesh
}

/// A sheet in the plane x = 0.
fn upright(n: u32) -> Mesh {
    at(sheet(n), |x| Vec3::new(0.0, x.x, x.z))
}

fn turned_over(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|[_, b, c]| std::mem::swap(b, c));
    mesh
}

fn patch(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Mesh {
    Mesh { positions: positions.iter().map(|&x| Vec3::from(x)).collect(), triangles: triangles.to_vec() }
}

/// Two triangles with a common side from (0, 0, -1) to (0, 0, 1), whose other corners are `drop` below it.
fn roof(drop: f32) -> Mesh {
    patch(&[[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, -drop, 0.0], [-1.0, -drop, 0.0]], &[[0, 1, 2], [1, 0, 3]])
}

/// The six sides of a box, which share no vertices.
fn unwelded_box() -> Vec<Mesh> {
    let side = |mesh: Mesh, turn: Quat| at(mesh, move |x| turn * (x + Vec3::Y * CELL));
    let around = (0..4).map(|k| Quat::from_rotation_x(k as f32 * std::f32::consts::FRAC_PI_2));
    let ends = [1.0, -1.0].map(|sign| Quat::from_rotation_z(sign * std::f32::consts::FRAC_PI_2));
    around.chain(ends).map(|turn| at(side(sheet(2), turn), |x| (x / CELL).round() * CELL)).collect()
}

/// Pieces of cloth, and whether any of them crosses another.
fn starts() -> Vec<(&'static str, bool, Vec<Mesh>)> {
    let raised = |mesh: Mesh, by: Vec3| at(mesh, move |x| x + by);
    let above = Vec3::Y * (2.0 * CELL);
    let hanging = |x: Vec3| Vec3::new(x.x.clamp(-CELL, CELL), (CELL - x.x.abs()).min(0.0), x.z);
    let step = |x: Vec3| Vec3::new(x.x.clamp(-CELL, CELL), x.x - x.x.clamp(-CELL, CELL), x.z);
    let tip = at(sheet(4), |x| x + Vec3::Y * x.x.abs().max(x.z.abs()));
    let large = patch(&[[-0.5, 0.0, -0.3], [0.5, 0.0, -0.4], [0.1, 0.0, 0.6]], &[[0, 2, 1]]);
    let wide = patch(&[[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]]);
    let needle = patch(&[[0.0, -0.3, 0.0], [0.0, 0.4, 0.0], [0.3, 0.0, 1.0]], &[[0, 1, 2]]);
    let square = patch(&[[-0.5, 0.0, -0.5], [0.5, 0.0, -0.5], [0.5, 0.0, 0.5], [-0.5, 0.0, 0.5]], &[[0, 2, 1], [0, 3, 2]]);
    vec![
        ("sheets apart", false, vec![sheet(4), raised(upright(4), 2.0 * above)]),
        ("a sheet through a sheet", true, vec![sheet(4), raised(upright(4), Vec3::new(0.013, 0.011, 0.007))]),
        ("vertices on vertices", true, vec![sheet(8), upright(8)]),
        ("vertices on edges", true, vec![sheet(8), raised(upright(8), Vec3::new(0.0, 0.0, 0.5 * CELL))]),
        ("vertices in triangles", true, vec![sheet(8), raised(upright(8), Vec3::new(0.3 * CELL, 0.0, 0.2 * CELL))]),
        ("a row of vertices in a large triangle", true, vec![large.clone(), upright(4)]),
        ("a vertex in a triangle, the next ones beside it", true, vec![large.clone(), at(upright(2), |x| x * 20.0)]),
        ("an edge through an edge", true, vec![square.clone(), needle.clone()]),
        ("an edge through an edge of a grid", true, vec![sheet(8), raised(needle, Vec3::X * 0.5 * CELL)]),
        ("a step down through a plane", true, vec![sheet(8), at(sheet(6), step)]),
        ("a step down through a triangle", true, vec![large.clone(), at(sheet(6), step)]),
        ("a border on vertices", false, vec![sheet(8), raised(upright(4), above)]),
        ("a border on the lower side", false, vec![sheet(8), raised(upright(4), -above)]),
        ("a border beside vertices", false, vec![sheet(8), raised(upright(4), above + Vec3::new(0.3, 0.0, 0.2) * CELL)]),
        ("a border of one large triangle", false, vec![sheet(8), wide.clone()]),
        ("a border of one large triangle, askew", false, vec![sheet(8), at(wide, |x| Quat::from_rotation_y(0.3) * x)]),
        ("a tip on a vertex", false, vec![sheet(8), tip.clone()]),
        ("a tip in a triangle", false, vec![large.clone(), tip]),
        ("one sheet twice", false, vec![sheet(8), sheet(8)]),
        ("one sheet twice, face to face", false, vec![sheet(8), turned_over(sheet(8))]),
        ("sheets in one plane", false, vec![sheet(8), raised(sheet(6), Vec3::new(0.31, 0.0, 0.17) * CELL)]),
        ("sheets side by side", false, vec![sheet(8), raised(sheet(8), Vec3::X * 8.0 * CELL)]),
        ("a curved sheet twice", false, [(); 2].map(|()| at(sheet(8), |x| x + Vec3::Y * (1.5 * x.x * x.x))).to_vec()),
        ("a sheet that hangs down under a sheet", false, vec![sheet(8), at(sheet(6), hanging)]),
        ("a sheet that hangs down under a triangle", false, vec![large, at(sheet(6), hanging)]),
        ("a ridge on an edge", false, vec![at(square, |x| x.with_y(0.0)), at(roof(0.4), |x| Vec3::new(x.z, x.y, -x.x))]),
        ("a ridge on a ridge", false, vec![roof(0.4), at(roof(0.3), |x| Vec3::new(x.z, -x.y, x.x))]),
        ("a border across a border", false, vec![sheet(8), raised(upright(8), Vec3::X * 4.0 * CELL + Vec3::Z * 8.0 * CELL)]),
        ("a box of six pieces", false, unwelded_box()),
    ]
}

/// One mesh of all pieces, and the first vertex of each.
fn joined(pieces: &[Mesh]) -> (Mesh, Vec<usize>) {
    let (mut all, mut firsts) = (Mesh { positions: Vec::new(), triangles: Vec::new() }, Vec::new());
    for piece in pieces {
        let first = all.positions.len();
        all.triangles.extend(piece.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first as u32)));
        all.positions.extend(&piece.positions);
        firsts.push(first);
    }
    (all, firsts)
}

/// Whether pieces cross however each is turned, shifted and shrunk a little.
fn crosses_anyway(pieces: &[Mesh]) -> bool {
    let (all, firsts) = joined(pieces);
    let mut random = fastrand::Rng::with_seed(1);
    (0..400).all(|_| {
        let mut little = || DVec3::from_array([(); 3].map(|()| random.f64() - 0.5)) * 1e-3;
        let motions: Vec<_> =
            firsts.iter().map(|_| (DQuat::from_scaled_axis(little()), little(), 1.0 - little().x.abs())).collect();
        let moved = all.positions.iter().enumerate().map(|(vertex, x)| {
            let piece = firsts.partition_point(|&first| first <= vertex) - 1;
            let middle: Vec3 = pieces[piece].positions.iter().sum::<Vec3>() / pieces[piece].positions.len() as f32;
            let (turn, shift, scale) = motions[piece];
            (turn * (x.as_dvec3() - middle.as_dvec3()) * scale + middle.as_dvec3() + shift).as_vec3()
        });
        !crossings(&all, &moved.collect::<Vec<_>>()).is_empty()
    })
}

#[test]
fn the_starts_are_what_they_are_called() {
    for (name, crosses, pieces) in starts() {
        assert_eq!(crosses_anyway(&pieces), crosses, "{name}");
    }
}

fn deformer(backend: Backend, mesh: &Mesh) -> Deformer {
    let contact = Some(Contact { thickness: 0.005, friction: 0.3 });
    let options = Options { backend, quality: Quality::Substeps(20), fabric: CLOTH, contact, ..Options::default() };
    Deformer::new(mesh, options).unwrap()
}

/// The number of crossings that a step reports.
fn reported(report: &StepReport) -> usize {
    let pairs = |warning: &Warning| if let Warning::Crossings { pairs, .. } = warning { *pairs } else { 0 };
    report.warnings.iter().map(pairs).sum()
}

fn what_crosses_is_reported_and_what_touches_is_held(backend: Backend) {
    let turns = [Quat::IDENTITY, Quat::from_euler(EulerRot::XYZ, 0.3, 0.5, 0.7)];
    for (index, (name, crosses, pieces)) in starts().into_iter().enumerate() {
        let backward: Vec<Mesh> = pieces.iter().rev().cloned().collect();
        let mut all: Vec<_> =
            [(0, &pieces), (1, &backward)].into_iter().flat_map(|order| turns.map(|turn| (order, turn))).collect();
        if backend != Backend::Cpu {
            // A software GPU takes seconds for each.
            all = vec![all[index % 4]];
        }
        for ((backward, order), turn) in all {
            let (mesh, _) = joined(order);
            let mesh = at(mesh, |x| turn * x);
            let name = format!("{name}, turned by {turn}, backward: {backward}");
            let mut cloth = deformer(backend, &mesh);
            let counted = cloth.crossings().unwrap().len();
            assert_eq!(counted > 0, crosses, "{name}: {counted} crossings");
            // Hardly anything moves in a step as short as this.
            let report = cloth.step(1e-6, &Attributes::default()).unwrap();
            let after = cloth.crossings().unwrap().len();
            assert_eq!([reported(&report), after].map(|pairs| pairs > 0), [crosses; 2], "{name}: {report:?}");
            for frame in 0..5 {
                if !crosses {
                    let found = crossings(&mesh, cloth.positions().unwrap());
                    assert!(found.is_empty(), "{name}, frame {frame}: {} crossings", found.len());
                }
                cloth.step(FRAME, &Attributes::default()).unwrap();
            }
        }
    }
}

/// Where grids cross exactly they are untangled as anywhere else; single triangles that large are beyond it. What merely
/// touches is left where it is.
#[test]
fn exact_crossings_are_untangled_and_touches_are_not() {
    for (name, crosses, pieces) in starts() {
        let (mesh, _) = joined(&pieces);
        let mut cloth = deformer(Backend::Cpu, &mesh);
        let parted = cloth.untangle(&Attributes::default()).unwrap();
        println!("{name}: {parted:?}");
        assert_eq!(parted.before > 0, crosses, "{name}: {parted:?}");
        assert_eq!(parted.after, cloth.crossings().unwrap().len(), "{name}");
        assert!(parted.after <= parted.before, "{name}: {parted:?}");
        if ["vertices on vertices", "vertices on edges", "vertices in triangles"].contains(&name) {
            assert_eq!(parted.after, 0, "{name}: {parted:?}");
        }
        assert!(crosses || parted.farthest == 0.0, "{name}: {parted:?}");
    }
}

/// What counts as touching depends on rounding, and so on how far from the origin cloth is, but not on how large a landscape is around
/// it; and nothing is moved apart by more than a share of its edges.
#[test]
fn fine_cloth_is_not_torn_apart_where_coordinates_are_large() {
    let mut sheet = sheet(10);
    sheet.positions.iter_mut().for_each(|x| *x *= 0.1);
    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
    let ground = corners.map(|[x, z]| Vec3::new(1e3 * x, -0.5, 1e3 * z)).to_vec();
    let landscape = Collider::mesh(Arc::new(Mesh { positions: ground, triangles: vec![[0, 1, 2], [0, 2, 3]] }));
    for (colliders, away) in [(vec![landscape], Vec3::ZERO), (vec![], Vec3::new(2e3, 1.0, 0.0)), (vec![], Vec3::Y * 4e3)] {
        let mut cloth = deformer(Backend::Cpu, &sheet);
        let moved: Vec<Vec3> = sheet.positions.iter().map(|x| *x + away).collect();
        cloth.set_state(&moved, &vec![Vec3::ZERO; moved.len()]).unwrap();
        cloth.step(FRAME, &Attributes { colliders, ..Attributes::default() }).unwrap();
        let x = cloth.positions().unwrap();
        let length = |[a, b]: [u32; 2], x: &[Vec3]| x[a as usize].distance(x[b as usize]);
        let longest = sheet.edges().into_iter().map(|edge| length(edge, x) / length(edge, &moved)).fold(0.0, f32::max);
        println!("at {away}: an edge is longer by the factor {longest}");
        assert!(longest < 1.02, "at {away}: an edge is longer by the factor {longest}");
    }
}

/// The poles of a ball whose vertices are not welded are many vertices in one place. If they are pinned, vertices near them
/// touch what cannot move. Without bending, which would flatten the ball.
#[test]
fn pins_that_touch_each_other_move_nothing_else() {
    let mesh = ball(Vec3::ZERO, 0.15, 9);
    let contact = Some(Contact { thickness: 0.0022, friction: 0.4 });
    let (quality, fabric) = (Quality::Substeps(10), Fabric { bending: 0.0, ..CLOTH });
    let options = Options { backend: Backend::Cpu, quality, fabric, contact, pinned: (0..18).collect(), ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    cloth.step(FRAME, &Attributes { gravity: Vec3::ZERO, ..Attributes::default() }).unwrap();
    let moved = cloth.positions().unwrap().iter().zip(&mesh.positions).map(|(x, start)| x.distance(*start)).fold(0.0, f32::max);
    assert!(moved < 1e-4, "{moved} m");
}

/// A ball whose poles are rings of vertices in one place, and a sheet with a pleat that lies flat on it: features of one piece that
/// coincide at rest. Contact cannot tell which is on which side, but the motion goes on.
fn what_is_one_piece_and_touches_goes_on(backend: Backend) {
    let pleat = at(sheet(8), |x| Vec3::new(if x.x > 0.0 { (x.x - 0.1).abs() - 0.1 } else { x.x }, 0.0, x.z));
    for (name, mesh) in [("ball", ball(Vec3::Y * 0.2, 0.15, 9)), ("pleat", at(pleat, |x| x + Vec3::Y * 0.05))] {
        let contact = Some(Contact::default());
        let options = Options { backend, fabric: CLOTH, contact, quality: Quality::Substeps(8), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let floor = Attributes { colliders: vec![Collider::plane(Vec3::ZERO, Vec3::Y)], ..Attributes::default() };
        for frame in 0..40 {
            cloth.step(FRAME, &floor).unwrap_or_else(|error| panic!("{name} {frame}: {error}"));
        }
        let x = cloth.positions().unwrap();
        assert!(x.iter().all(|x| x.is_finite() && x.y > -1e-4 && x.length() < 1.0), "{name}");
    }
}
