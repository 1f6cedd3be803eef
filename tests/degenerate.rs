//! Degenerate meshes: every step stays finite on every backend. Invalid numbers are an error before any step.

mod common;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{
    Attributes, Backend, BuildError, Collider, Contact, Deformer, Fabric, Levels, Mesh, Method, Options, Quality, StepError,
    Warning,
};

use common::{FRAME, play};

on_every_backend!(
    degenerate_meshes_stay_finite,
    degenerate_meshes_with_levels_stay_finite,
    input_that_is_no_number_is_refused,
    vertices_that_no_triangle_uses_stay,
    a_released_vertex_without_edges_stays,
    a_pinned_vertex_without_edges_holds_nothing,
    t_junctions_do_not_touch
);

fn mesh(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Mesh {
    Mesh { positions: positions.iter().map(|&x| x.into()).collect(), triangles: triangles.to_vec() }
}

/// Name, mesh, pins.
fn table() -> Vec<(&'static str, Mesh, Vec<u32>)> {
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]];
    let two = [[0, 2, 1], [1, 2, 3]];
    let grid = Mesh::grid(5, 5, 1.0, 1.0);
    let apart = grid.positions.iter().map(|&x| x + 3.0 * Vec3::X);
    let islands = Mesh {
        positions: grid.positions.iter().copied().chain(apart).collect(),
        triangles: grid.triangles.iter().flat_map(|&t| [t, t.map(|v| v + 25)]).collect(),
    };
    let rim = |k: u32| Vec3::new((0.1 * k as f32).cos(), 0.0, (0.1 * k as f32).sin());
    let fan = Mesh {
        positions: std::iter::once(Vec3::ZERO).chain((0..60).map(rim)).collect(),
        triangles: (1..60).map(|k| [0, k + 1, k]).collect(),
    };
    // Squares of such lengths are the smallest numbers of single precision, or underflow.
    let tiny = |size: f32| Mesh { positions: fan.positions.iter().map(|&x| x * size).collect(), ..fan.clone() };
    let collinear = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let coincident = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
    let book = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 1.0], [0.5, 1.0, 0.0], [0.5, -1.0, 0.0]];
    let sliver = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 1e-7], [0.5, 0.0, 1.0]];
    vec![
        ("a triangle without area", mesh(&collinear, &[[0, 1, 2], [0, 3, 1]]), vec![0]),
        ("nothing but a triangle without area", mesh(&collinear[..3], &[[0, 1, 2]]), vec![0]),
        ("a sliver", mesh(&sliver, &[[0, 2, 1], [0, 3, 2], [2, 3, 1]]), vec![0]),
        ("coincident vertices", mesh(&coincident, &two), vec![0]),
        ("all vertices in one place", mesh(&[[0.5; 3]; 4], &two), vec![0]),
        ("an edge of no length, pinned", mesh(&coincident, &two), vec![2]),
        ("one vertex", mesh(&square[..1], &[]), vec![]),
        ("one vertex, pinned", mesh(&square[..1], &[]), vec![0]),
        ("a triangle that is one vertex", mesh(&square, &[[0, 2, 1], [3, 3, 3]]), vec![0]),
        ("a vertex of no triangle", mesh(&square, &two[..1]), vec![0]),
        ("two islands", islands, vec![0]),
        ("an edge of three triangles", mesh(&book, &[[0, 2, 1], [0, 1, 3], [0, 4, 1]]), vec![0]),
        ("the same triangle twice, once turned over", mesh(&square, &[[0, 2, 1], [0, 2, 1], [0, 1, 2]]), vec![0]),
        ("everything pinned", grid.clone(), (0..25).collect()),
        ("two pinned ends of an edge", mesh(&square, &two), vec![0, 1]),
        ("one triangle, all but one pinned", mesh(&square[..3], &[[0, 2, 1]]), vec![0, 1]),
        ("threads", mesh(&square, &[[0, 1, 1], [1, 3, 3], [3, 2, 2]]), vec![0]),
        ("a thread on a triangle", mesh(&square, &[[0, 2, 1], [1, 3, 3]]), vec![0]),
        ("a fan", fan.clone(), vec![1]),
        ("a fan about its pin", fan.clone(), vec![0]),
        ("a fan of 4e-23 m", tiny(4.4e-23), vec![1]),
        ("a fan of 1e-38 m", tiny(1e-38), vec![1]),
        ("nothing pinned", grid, vec![]),
    ]
}

/// The same kinds of meshes, large enough for levels.
fn table_with_levels() -> Vec<(&'static str, Mesh, Vec<u32>)> {
    let n = 24;
    let grid = Mesh::grid(n, n, 1.0, 1.0);
    let count = n * n;
    let moved = |by: fn(Vec3) -> Vec3| Mesh { positions: grid.positions.iter().map(|&x| by(x)).collect(), ..grid.clone() };
    let both = |other: Mesh| Mesh {
        positions: grid.positions.iter().copied().chain(other.positions).collect(),
        triangles: grid.triangles.iter().copied().chain(other.triangles.iter().map(|t| t.map(|v| v + count))).collect(),
    };
    let rim = |k: u32| Vec3::new((0.01 * k as f32).cos(), 0.0, (0.01 * k as f32).sin());
    let fan = Mesh {
        positions: std::iter::once(Vec3::ZERO).chain((0..600).map(rim)).collect(),
        triangles: (1..600).map(|k| [0, k + 1, k]).collect(),
    };
    let thread = Mesh {
        positions: (0..400).map(|k| Vec3::X * (0.01 * k as f32)).collect(),
        triangles: (1..400).map(|k| [k - 1, k, k]).collect(),
    };
    let mut book = both(moved(|x| Vec3::new(x.x, x.z, 0.0)));
    book.triangles.extend((0..n - 1).map(|k| [k, k + 1, count + k]));
    let turned = grid.triangles.iter().map(|&[a, b, c]| [a, c, b]);
    let doubled = Mesh { triangles: grid.triangles.iter().copied().chain(turned).collect(), ..grid.clone() };
    let dust = Mesh { positions: vec![Vec3::ONE; 100], triangles: Vec::new() };
    vec![
        ("all vertices in one place", moved(|_| Vec3::splat(0.5)), vec![0]),
        ("a sheet without width", moved(|x| x.with_z(0.0)), vec![0]),
        ("a sheet that is hardly wide", moved(|x| x.with_z(1e-7 * x.z)), vec![0]),
        ("half of it in one place", moved(|x| if x.x < 0.0 { Vec3::ZERO } else { x }), vec![0]),
        ("folded flat", moved(|x| x.with_x(x.x.abs())), vec![0]),
        ("twice the same", both(grid.clone()), vec![0, count]),
        ("a sheet and dust", both(dust), vec![0, count + 7]),
        ("an edge of three sheets", book, vec![0]),
        ("each triangle twice, once turned over", doubled, vec![0]),
        ("a fan", fan.clone(), vec![1]),
        ("a fan about its pin", fan, vec![0]),
        ("a thread", thread, vec![0, 399]),
        ("every other vertex pinned", grid.clone(), (0..count).step_by(2).collect()),
        ("everything pinned", grid.clone(), (0..count).collect()),
        ("all but one pinned", grid.clone(), (1..count).collect()),
        ("nothing pinned", grid, vec![]),
    ]
}

fn degenerate_meshes_with_levels_stay_finite(backend: Backend) {
    let ball = Collider::sphere(Vec3::new(0.4, -0.2, 0.4), 0.3);
    let windy = Attributes { wind: Vec3::new(3.0, 0.0, 1.0), air_density: 1.2, colliders: vec![ball], ..Attributes::default() };
    for (name, mesh, pinned) in table_with_levels() {
        for fabric in [Fabric { stretch: f32::INFINITY, ..Fabric::default() }, Fabric::TOWEL] {
            let (quality, levels, pinned) = (Quality::Substeps(10), Levels::Count(u32::MAX), pinned.clone());
            let options = Options { backend, quality, fabric, levels, pinned, ..Options::default() };
            let mut deformer = Deformer::new(&mesh, options).unwrap_or_else(|error| panic!("{name}: {error}"));
            play(&mut deformer, 10, &windy);
            for (v, x) in deformer.positions().unwrap().iter().enumerate() {
                assert!(x.is_finite() && x.length() < 100.0, "{name}: vertex {v} is at {x}");
            }
            assert!(deformer.velocities().unwrap().iter().all(|v| v.is_finite()), "{name}");
        }
    }
}

/// All features at once act on them: bending, air, drag, and a collider that they start inside of.
fn degenerate_meshes_stay_finite(backend: Backend) {
    let fabrics = [Fabric { stretch: f32::INFINITY, ..Fabric::default() }, Fabric::TOWEL];
    let ball = Collider::sphere(Vec3::new(0.4, -0.2, 0.4), 0.3);
    let windy = Attributes { wind: Vec3::new(3.0, 0.0, 1.0), air_density: 1.2, colliders: vec![ball], ..Attributes::default() };
    for (name, mesh, pinned) in table() {
        for (fabric, attributes) in fabrics.iter().zip([&Attributes::default(), &windy]) {
            for method in [Method::SmallSteps, Method::Relaxation { iterations: 4 }] {
                let (fabric, pinned) = (*fabric, pinned.clone());
                let options = Options { backend, method, quality: Quality::Substeps(20), fabric, pinned, ..Options::default() };
                let mut deformer = Deformer::new(&mesh, options).unwrap_or_else(|error| panic!("{name}: {error}"));
                play(&mut deformer, 10, attributes);
                let measure = deformer.measure().unwrap();
                assert!((measure.kinetic_energy + measure.potential_energy).is_finite(), "{name}: {measure:?}");
                for (v, x) in deformer.positions().unwrap().iter().enumerate() {
                    assert!(x.is_finite() && x.length() < 100.0, "{name}: vertex {v} is at {x}");
                }
                assert!(deformer.velocities().unwrap().iter().all(|v| v.is_finite()), "{name}");
            }
        }
    }
}

fn input_that_is_no_number_is_refused(backend: Backend) {
    let grid = Mesh::grid(4, 4, 1.0, 1.0);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut mesh = grid.clone();
        mesh.positions[5].y = bad;
        let refused = Deformer::new(&mesh, Options { backend, ..Options::default() }).unwrap_err();
        assert!(matches!(refused, BuildError::Position { vertex: 5, .. }), "{refused}");
        let mass = Some(vec![bad; 16]);
        let refused = Deformer::new(&grid, Options { backend, mass, ..Options::default() }).unwrap_err();
        assert!(matches!(refused, BuildError::Value { .. }), "{refused}");

        let mut deformer = Deformer::new(&grid, Options { backend, pinned: vec![0], ..Options::default() }).unwrap();
        play(&mut deformer, 1, &Attributes::default());
        let before = deformer.positions().unwrap().to_vec();
        let gravity = Attributes { gravity: Vec3::splat(bad), ..Attributes::default() };
        let damping = Attributes { damping: bad, ..Attributes::default() };
        let targets = Attributes { pin_targets: Some(vec![Vec3::splat(bad)]), ..Attributes::default() };
        let collider = Attributes { colliders: vec![Collider::sphere(Vec3::splat(bad), 1.0)], ..Attributes::default() };
        for attributes in [gravity, damping, targets, collider] {
            let refused = deformer.step(common::FRAME, &attributes).unwrap_err();
            assert!(matches!(refused, StepError::Attribute { .. }), "{refused}");
        }
        let refused = deformer.step(bad, &Attributes::default()).unwrap_err();
        assert!(matches!(refused, StepError::TimeStep { .. }), "{refused}");
        let refused = deformer.set_state(&[Vec3::splat(bad); 16], &[Vec3::ZERO; 16]).unwrap_err();
        assert!(matches!(refused, StepError::State { name: "positions", .. }), "{refused}");
        assert_eq!(deformer.positions().unwrap(), before, "nothing moved");
    }
}

/// Files often have vertices that no face uses, far from the cloth, many of them, and of whatever mass. They stay where they are,
/// and the cloth moves as without them: on the CPU bit for bit, elsewhere up to rounding, since it may be cut into other tiles.
fn vertices_that_no_triangle_uses_stay(backend: Backend) {
    const OTHERS: usize = 1100;
    let mut mesh = Mesh::grid(13, 13, 0.5, 0.5);
    mesh.positions.iter_mut().for_each(|x| *x += Vec3::new(600.0, 0.3, 0.0));
    let triangles = mesh.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + OTHERS as u32)).collect();
    let with = Mesh { positions: [vec![Vec3::ZERO; OTHERS], mesh.positions.clone()].concat(), triangles };
    for contact in [None, Some(Contact::default())] {
        for pinned in [vec![], vec![0, 12]] {
            let cloths = [(&mesh, 0), (&with, OTHERS)].map(|(mesh, first)| {
                let pinned = pinned.iter().map(|pin| pin + first as u32).collect();
                let mass = Some([vec![100.0; first], vec![3e-4; 169]].concat());
                // When statistics arrive from a GPU, and thus how many substeps are chosen, depends on what else it does.
                let quality = if backend == Backend::Gpu { Quality::Substeps(12) } else { Quality::default() };
                Deformer::new(mesh, Options { backend, contact, pinned, mass, quality, ..Options::default() }).unwrap()
            });
            let [mut cloth, mut other] = cloths;
            assert_eq!(cloth.origin(), other.origin());
            let pins: Vec<Vec3> = pinned.iter().map(|&pin| mesh.positions[pin as usize]).collect();
            for frame in 1..20 {
                let by = Vec3::new(0.01, 0.002, 0.0) * frame as f32;
                let floor = Attributes {
                    colliders: vec![Collider::plane(Vec3::ZERO, Vec3::Y)],
                    pin_targets: (!pins.is_empty()).then(|| pins.iter().map(|pin| pin + by).collect()),
                    ..Attributes::default()
                };
                let [report, other_report] = [&mut cloth, &mut other].map(|cloth| cloth.step(FRAME, &floor).unwrap());
                assert_eq!(report.levels, other_report.levels, "frame {frame}");
                if backend == Backend::Cpu {
                    assert_eq!(report, other_report, "frame {frame}");
                }
            }
            let (here, there) = (cloth.positions().unwrap().to_vec(), other.positions().unwrap().to_vec());
            let farthest = here.iter().zip(&there[OTHERS..]).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
            assert!(farthest <= if backend == Backend::Cpu { 0.0 } else { 1e-3 }, "{contact:?}, {pinned:?}: {farthest} m");
            assert!(there[..OTHERS].iter().all(|x| *x == Vec3::ZERO), "{contact:?}, {pinned:?}");
            assert_eq!(cloth.measure().unwrap().penetration, other.measure().unwrap().penetration);
        }
    }
}

/// One that was moved as a pin stays where that left it.
fn a_released_vertex_without_edges_stays(backend: Backend) {
    let mut mesh = Mesh::grid(5, 5, 0.5, 0.5);
    mesh.positions.push(Vec3::ONE);
    let mut cloth = Deformer::new(&mesh, Options { backend, pinned: vec![0, 25], ..Options::default() }).unwrap();
    let targets = |pins: &[usize], frame: i32| {
        let targets = pins.iter().map(|&pin| mesh.positions[pin] + Vec3::X * (0.01 * frame as f32));
        Attributes { pin_targets: Some(targets.collect()), ..Attributes::default() }
    };
    (1..4).for_each(|frame| drop(cloth.step(FRAME, &targets(&[0, 25], frame)).unwrap()));
    let there = cloth.positions().unwrap()[25];
    assert!(there.distance(Vec3::new(1.03, 1.0, 1.0)) < 1e-6);
    cloth.set_pinned(vec![0]).unwrap();
    (4..7).for_each(|frame| drop(cloth.step(FRAME, &targets(&[0], frame)).unwrap()));
    assert_eq!(cloth.positions().unwrap()[25], there);
}

/// Two sheets that fall freely above one another, as they do without a vertex that nothing hangs on.
fn a_pinned_vertex_without_edges_holds_nothing(backend: Backend) {
    let mut mesh = common::shapes::sheets(2, 9, 0.4, 0.004);
    mesh.positions.push(Vec3::ONE);
    let loose = mesh.positions.len() as u32 - 1;
    let contact = Some(Contact { thickness: 5e-3, ..Contact::default() });
    let options = Options { backend, contact, quality: Quality::Substeps(6), pinned: vec![loose], ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    play(&mut cloth, 20, &Attributes { air_density: 0.0, ..Attributes::default() });
    let fallen = -cloth.positions().unwrap()[..loose as usize].iter().map(|x| f64::from(x.y)).sum::<f64>() / f64::from(loose);
    // Of free fall, less the height of the middle between the sheets.
    let t: f64 = 20.0 / 60.0;
    let exact = 0.5 * 9.81 * t * t - 0.006;
    assert!((fallen / exact - 1.0).abs() < 1e-4, "{fallen} m instead of {exact}");
}

/// A sheet with vertices on sides of triangles that do not have them as corners: each is joined by a triangle without area.
fn with_t_junctions(n: u32, every: usize) -> Mesh {
    let mut mesh = Mesh::grid(n, n, 0.6, 0.6);
    let pairs: Vec<[[u32; 3]; 2]> = mesh.triangles.chunks(2).map(|pair| [pair[0], pair[1]]).collect();
    mesh.triangles.clear();
    for (index, [one, other]) in pairs.into_iter().enumerate() {
        mesh.triangles.push(other);
        if index % every != 0 {
            mesh.triangles.push(one);
            continue;
        }
        let place = (0..3).find(|&k| !other.contains(&one[k])).unwrap();
        let [c, a, b] = [0, 1, 2].map(|k| one[(place + k) % 3]);
        let middle = mesh.positions.len() as u32;
        mesh.positions.push(mesh.positions[a as usize].midpoint(mesh.positions[b as usize]));
        mesh.triangles.extend([[a, middle, c], [middle, b, c], [a, b, middle]]);
    }
    mesh
}

/// With contact, but without touching itself, such a sheet swings as without contact. It stood still in the air before the
/// triangles without area were left out there.
fn t_junctions_do_not_touch(backend: Backend) {
    let mesh = with_t_junctions(12, 20);
    let [with, without] = [Some(Contact { thickness: 3e-3, ..Contact::default() }), None].map(|contact| {
        let options =
            Options { backend, contact, quality: Quality::Substeps(20), pinned: (0..12).collect(), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        play(&mut cloth, 15, &Attributes::default());
        cloth.positions().unwrap().to_vec()
    });
    let farthest = with.iter().zip(&without).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    assert!(farthest < 1e-4 && without[143].y < -0.1, "{farthest} m");
}

/// An edge between coincident vertices has no strain, and is warned of.
#[test]
fn edges_without_length_count_in_no_strain() {
    let mut mesh = Mesh::grid(20, 20, 1.0, 1.0);
    mesh.positions[45] = mesh.positions[44];
    let options = Options { backend: Backend::Cpu, pinned: vec![0, 19], ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    for _ in 0..30 {
        let report = cloth.step(FRAME, &Attributes::default()).unwrap();
        assert!(report.warnings.contains(&Warning::Slivers { edges: 1, worst: [44, 45] }), "{:?}", report.warnings);
        let measure = cloth.measure().unwrap();
        assert!(measure.mean_strain < 0.02 && measure.max_strain < 1.0, "{measure:?}");
        assert!(report.stretch.unwrap().worst < 1.0, "{:?}", report.stretch);
    }
}
