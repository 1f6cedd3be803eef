//! Unit tests of `src/model/tethers.rs`.

use glam::Vec3;

use super::*;
use crate::model::cloth::Cloth;
use crate::options::{self, Method, Options};
use crate::{Fabric, Mesh};

fn tethers(mesh: &Mesh, pinned: &[u32], options: Options) -> Option<Tethers> {
    Cloth::new(mesh, &Options { pinned: pinned.to_vec(), ..options }).unwrap().tethers
}

/// Distances along the cloth, by the mesh's vertices; infinite where there is no tether.
fn distances(mesh: &Mesh, pinned: &[u32], options: Options) -> Vec<f64> {
    let cloth = Cloth::new(mesh, &Options { pinned: pinned.to_vec(), ..options }).unwrap();
    let mut found = vec![f64::INFINITY; mesh.positions.len()];
    for held in &cloth.tethers.as_ref().unwrap().held {
        found[cloth.order[held.vertex as usize] as usize] = f64::from(held.distance);
    }
    found
}

/// A grid with random diagonals whose vertices are displaced within its plane.
fn jittered(n: u32, size: f32) -> Mesh {
    let mut random = fastrand::Rng::with_seed(3);
    let mut mesh = Mesh::grid(n, n, 1.0, 1.0);
    for triangles in mesh.triangles.chunks_mut(2).filter(|_| random.bool()) {
        let corners: Vec<u32> = triangles.iter().flatten().copied().collect();
        let [a, b] = [corners.iter().min().unwrap(), corners.iter().max().unwrap()].map(|&corner| corner);
        triangles.copy_from_slice(&[[a, b - 1, b], [a, b, a + 1]]);
    }
    let mut jitter = || size / n as f32 * (random.f32() - 0.5);
    // Its outline stays straight, because straight lines between vertices would otherwise leave it.
    let inside = mesh.positions.iter_mut().filter(|x| x.x.abs().max(x.z.abs()) < 0.499);
    inside.for_each(|x| *x += Vec3::new(jitter(), 0.0, jitter()));
    mesh
}

/// In a plane the shortest path is the straight line. The computed length must not be less, or tethers would pull on
/// cloth at rest, and hardly more.
#[test]
fn ways_in_a_plane_are_straight() {
    for (mesh, pin, excess) in
        [(Mesh::grid(21, 31, 1.0, 1.3), 0, 3e-6), (jittered(25, 0.6), 0, 0.01), (jittered(25, 0.6), 312, 0.01)]
    {
        let far = distances(&mesh, &[pin], Options::default());
        let mut met = 0;
        for (v, x) in mesh.positions.iter().enumerate().filter(|(v, _)| *v != pin as usize) {
            let straight = f64::from(x.distance(mesh.positions[pin as usize]));
            if straight < 0.49 {
                met += 1;
                assert!(far[v] >= straight * (1.0 - 1e-7), "vertex {v}: {} m, straight {straight}", far[v]);
                assert!(far[v] <= straight * (1.0 + excess), "vertex {v}: {} m, straight {straight}", far[v]);
            }
        }
        assert!(met > 50);
    }
}

/// Distances in a rolled sheet are those of the unrolled one, and paths bend around the corner of an L shape.
#[test]
fn ways_follow_the_cloth() {
    let flat = Mesh::grid(41, 21, 2.0, 1.0);
    let mut rolled = flat.clone();
    rolled.positions.iter_mut().for_each(|x| *x = Vec3::new(0.3 * (x.x / 0.3).sin(), 0.3 * (x.x / 0.3).cos(), x.z));
    let far = distances(&rolled, &[20], Options::default());
    let mut met = 0;
    for (v, x) in flat.positions.iter().enumerate().filter(|(v, _)| far[*v] < 0.45 && *v != 20) {
        let straight = f64::from(x.distance(flat.positions[20]));
        // Chords are shorter than the arc by a share of (l/r)²/24.
        assert!((far[v] / straight - 1.0).abs() < 2e-3, "vertex {v}: {} m, unrolled {straight}", far[v]);
        met += usize::from(rolled.positions[v].distance(rolled.positions[20]) < 0.95 * far[v] as f32);
    }
    assert!(met > 10, "{met} are nearer through the air");

    let mut corner = Mesh::grid(41, 41, 1.0, 1.0);
    corner
        .triangles
        .retain(|t| !t.iter().all(|&v| corner.positions[v as usize].x >= 0.0 && corner.positions[v as usize].z >= 0.0));
    let at = |x: f32, z: f32| corner.positions.iter().position(|p| p.distance(Vec3::new(x, 0.0, z)) < 1e-4).unwrap();
    let (pin, tip) = (at(0.1, -0.1), at(-0.1, 0.2));
    let far = distances(&corner, &[pin as u32], Options::default())[tip];
    let bent = 0.02_f64.sqrt() + 0.05_f64.sqrt();
    assert!(far > bent * (1.0 - 1e-6) && far < 1.01 * bent, "{far} m about the corner, {bent} by hand");
}

/// In cloth that is soft in shear, the distance along the bias is that along the threads.
#[test]
fn soft_edges_are_no_way() {
    let mesh = Mesh::grid(21, 21, 1.0, 1.0);
    let across = |ends: &[u32; 2]| if ends[1] - ends[0] == 1 || ends[1] - ends[0] == 21 { 1.0 } else { 0.02 };
    let options = Options { edge_scale: Some(mesh.edges().iter().map(across).collect()), ..Options::default() };
    let far = distances(&mesh, &[220], options);
    for (v, x) in mesh.positions.iter().enumerate().filter(|(v, _)| *v != 220) {
        let by_threads = f64::from(x.x.abs() + x.z.abs());
        assert!(by_threads > 0.49 || (far[v] / by_threads - 1.0).abs() < 1e-5, "vertex {v}: {} m, {by_threads}", far[v]);
    }
}

/// Each vertex is tethered to the nearest pin. One pin or two side by side are lone pins, a row is not.
#[test]
fn lone_pins_have_tethers() {
    let mesh = Mesh::grid(9, 9, 1.0, 1.0);
    let of = |pinned: &[u32]| tethers(&mesh, pinned, Options::default());
    let anchors = |pinned: &[u32]| of(pinned).map(|tethers| tethers.anchors);
    assert_eq!(anchors(&[0, 8]), Some(vec![0, 1]));
    assert_eq!(anchors(&[4, 40, 41, 5]), Some(vec![0, 1, 2, 3]), "two side by side");
    assert_eq!(anchors(&[40, 0, 1, 2, 3]), Some(vec![0]), "a row has none");
    let border: Vec<u32> = (0..81).filter(|v| v % 9 == 0 || v % 9 == 8 || v / 9 == 0 || v / 9 == 8).collect();
    assert_eq!(anchors(&border), None);
    assert_eq!(anchors(&[]), None);
    assert_eq!(anchors(&(0..81).collect::<Vec<_>>()), None);
    let both = of(&[0, 8]).unwrap();
    assert!(both.held.iter().all(|held| (held.vertex % 9 < 4) == (held.anchor == 0) || held.vertex % 9 == 4));
    let alone = Mesh { positions: vec![Vec3::ZERO; 3], triangles: Vec::new() };
    assert!(tethers(&alone, &[0], Options::default()).is_none(), "it holds nothing");
    for method in [Method::Springs, Method::Relaxation { iterations: 2 }] {
        assert!(tethers(&mesh, &[0], Options { method, ..Options::default() }).is_none());
    }
    assert!(tethers(&mesh, &[0], Options { tethers: options::Tethers::Off, ..Options::default() }).is_none());
}

/// For a thread, `give` is twice the stretch `W d/(K l)` plus that from the stress of the whole sheet.
#[test]
fn the_fabric_is_let_give_way() {
    let mesh = Mesh {
        positions: (0..11).map(|k| Vec3::X * 0.05 * k as f32).collect(),
        triangles: (0..10).map(|k| [k, k + 1, k + 1]).collect(),
    };
    let fabric = Fabric { density: 0.2, ..Fabric::default() };
    let found = tethers(&mesh, &[0], Options { fabric, mass: Some(vec![0.01; 11]), ..Options::default() }).unwrap();
    let held = found.held.iter().find(|held| held.vertex == 4).unwrap();
    let give = 2.0 * 0.1 * 0.2 / 0.05;
    assert!(held.give >= give && held.give < 2.0 * give, "{} m, {give} by the thread's law", held.give);
}
