//! Scenes of contact from several starts that differ by a tenth of a millimeter, with crossings counted in every frame.
//! `CLOTH_RUNS=10 cargo test --release --test contact_starts -- --ignored --nocapture` takes half an hour; with
//! `CLOTH_BACKEND=gpu` they run on the GPU.

mod common;

use std::f32::consts::PI;
use std::sync::Arc;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Attributes, Collider, Contact, Deformer, Fabric, Levels, Mesh, Options, Quality};
use common::crossings::{closest, with_itself_and};
use common::shapes::{ball, bent, capsule, jittered, sheets};
use common::{FRAME, backend_by_name};

/// A scene with one of its starts.
struct Start {
    mesh: Mesh,
    options: Options,
    frames: u32,
    attributes: Box<dyn Fn(u32) -> Attributes>,
    /// Initial positions (m), if they are not those of the rest shape.
    bent: bool,
}

impl Start {
    fn new(mesh: Mesh, substeps: u32, frames: u32, colliders: Vec<Collider>) -> Start {
        let contact = Some(Contact { thickness: 0.005, friction: 0.3 });
        let fabric = Fabric { density: 0.2, stretch: 5000.0, bending: 1e-4, damping: 0.03 };
        let quality = Quality::Substeps(substeps);
        let options =
            Options { backend: backend_by_name(), quality, fabric, contact, levels: Levels::Auto, ..Options::default() };
        let attributes = Box::new(move |_| Attributes { colliders: colliders.clone(), ..Attributes::default() });
        Start { mesh, options, frames, attributes, bent: false }
    }

    /// The largest number of crossings in any frame, with itself and with bodies.
    fn play(&self) -> usize {
        let mut cloth = Deformer::new(&self.mesh, self.options.clone()).unwrap();
        if self.bent {
            let start: Vec<Vec3> = self.mesh.positions.iter().map(bent).collect();
            cloth.set_state(&start, &vec![Vec3::ZERO; start.len()]).unwrap();
        }
        let mut most = 0;
        for frame in 1..=self.frames {
            let attributes = (self.attributes)(frame);
            let stepped = cloth.step(FRAME, &attributes);
            stepped.unwrap_or_else(|error| panic!("frame {frame}: {error}"));
            let x = cloth.positions().unwrap();
            let count = with_itself_and(&attributes.colliders, &self.mesh, x).iter().sum();
            if count > 0 && most == 0 {
                println!("    the first in frame {frame}");
            }
            most = most.max(count);
        }
        let (apart, measure) = (closest(&self.mesh, cloth.positions().unwrap()), cloth.measure().unwrap());
        println!(
            "    {most} crossings, {:.2} mm apart, strain {:.4}, {:.3}",
            1e3 * apart,
            measure.mean_strain,
            measure.max_strain
        );
        most
    }
}

fn floor() -> Collider {
    Collider::plane(Vec3::ZERO, Vec3::Y)
}

/// Plays a scene from as many starts as are requested; none may have a crossing.
fn from_all_starts(name: &str, start: impl Fn(u64) -> Start) {
    let runs = std::env::var("CLOTH_RUNS").map_or(1, |runs| runs.parse().expect("a number"));
    let crossed: Vec<usize> = (1..=runs)
        .map(|seed| {
            println!("{name}, start {seed}");
            start(seed).play()
        })
        .collect();
    assert!(crossed.iter().all(|&most| most == 0), "{name}: {crossed:?} crossings");
}

#[test]
#[ignore = "takes minutes"]
fn folds() {
    from_all_starts("fold", |seed| {
        let start = Start::new(jittered(Mesh::grid(32, 32, 1.0, 1.0), seed), 20, 60, vec![floor()]);
        Start { bent: true, ..start }
    });
}

fn heap(n: u32, substeps: u32, frames: u32, seed: u64) -> Start {
    let mut mesh = jittered(Mesh::grid(n, n, 1.0, 1.0), seed);
    mesh.positions.iter_mut().for_each(|x| *x = Quat::from_rotation_x(1.5) * *x + Vec3::Y * 0.6);
    Start::new(mesh, substeps, frames, vec![floor()])
}

#[test]
#[ignore = "takes minutes"]
fn heaps() {
    from_all_starts("heap, 32", |seed| heap(32, 20, 90, seed));
}

#[test]
#[ignore = "takes minutes"]
fn fine_heaps() {
    from_all_starts("heap, 64", |seed| heap(64, 40, 60, seed));
}

#[test]
#[ignore = "takes minutes"]
fn stacks() {
    let stack = |seed| jittered(sheets(10, 16, 0.5, 0.012), seed);
    from_all_starts("stack", |seed| Start::new(stack(seed), 40, 60, vec![floor()]));
    let bodies = || vec![Collider::sphere(Vec3::Y * -0.3, 0.3), Collider::plane(Vec3::Y * -0.6, Vec3::Y)];
    from_all_starts("stack on a sphere", |seed| Start::new(stack(seed), 40, 60, bodies()));
    let bodies = || vec![Collider::mesh(Arc::new(ball(Vec3::Y * -0.3, 0.3, 20))), Collider::plane(Vec3::Y * -0.6, Vec3::Y)];
    from_all_starts("stack on a mesh", |seed| Start::new(stack(seed), 40, 60, bodies()));
}

#[test]
#[ignore = "takes minutes"]
fn towels() {
    let towel = |seed| {
        let mut mesh = jittered(Mesh::grid(48, 48, 1.2, 1.2), seed);
        mesh.positions.iter_mut().for_each(|x| x.y += 0.7);
        mesh
    };
    let ground = Vec3::Y * 0.3;
    from_all_starts("towel", |seed| Start::new(towel(seed), 40, 80, vec![Collider::sphere(ground, 0.3), floor()]));
    let spun = |frame: u32| {
        let (mut body, turn) = (ball(Vec3::ZERO, 0.3, 16), Quat::from_rotation_y(0.05 * frame as f32));
        body.positions.iter_mut().for_each(|x| *x = turn * *x + Vec3::Y * 0.3);
        Attributes { colliders: vec![Collider::mesh(Arc::new(body)), floor()], ..Attributes::default() }
    };
    from_all_starts("towel on a spinning mesh", |seed| Start {
        attributes: Box::new(spun),
        ..Start::new(towel(seed), 40, 80, Vec::new())
    });
}

/// A capsule made of triangles passes through a sheet that hangs by its top row.
#[test]
#[ignore = "takes minutes"]
fn limbs() {
    for speed in [1.0_f32, 3.0, 10.0, 20.0] {
        let start = |seed| {
            let mut mesh = jittered(Mesh::grid(32, 32, 1.0, 1.0), seed);
            mesh.positions.iter_mut().for_each(|x| *x = Quat::from_rotation_x(0.5 * PI) * *x);
            let top = (0..1024).filter(|&v| mesh.positions[v as usize].y > 0.499).collect();
            let limb = move |frame: u32| {
                let at = Vec3::new(0.0, -0.1, -0.4 + speed * FRAME * (frame as f32 - 1.0));
                capsule(at - 0.3 * Vec3::X, at + 0.3 * Vec3::X, 0.08, 12)
            };
            let attributes =
                move |frame| Attributes { colliders: vec![Collider::mesh(Arc::new(limb(frame)))], ..Attributes::default() };
            let start = Start::new(mesh, 1, (1.3 / speed / FRAME).min(50.0) as u32, Vec::new());
            let options = Options { pinned: top, quality: Quality::Strain(0.03), ..start.options.clone() };
            Start { options, attributes: Box::new(attributes), ..start }
        };
        from_all_starts(&format!("limb at {speed} m/s"), start);
    }
}

/// A sheet held at two opposite edges that rotate against each other.
#[test]
#[ignore = "takes minutes"]
fn twists() {
    from_all_starts("twist", |seed| {
        let mesh = jittered(Mesh::grid(32, 32, 1.0, 1.0), seed);
        let edges: Vec<u32> = (0..32).chain(31 * 32..32 * 32).collect();
        let held: Vec<Vec3> = edges.iter().map(|&v| mesh.positions[v as usize]).collect();
        let led = move |frame: u32| {
            let angle = 0.5 * FRAME * frame as f32 * PI;
            let turned = |(k, x): (usize, &Vec3)| {
                let (side, angle) = if k < 32 { (-1.0, angle) } else { (1.0, -angle) };
                let inward = (0.02 * FRAME * frame as f32).min(0.1);
                Quat::from_rotation_z(angle) * *x - side * inward * Vec3::Z
            };
            let targets = held.iter().enumerate().map(turned).collect();
            Attributes { pin_targets: Some(targets), ..Attributes::default() }
        };
        let start = Start::new(mesh, 20, 240, Vec::new());
        let options = Options { pinned: edges, ..start.options.clone() };
        Start { options, attributes: Box::new(led), ..start }
    });
}

/// Both ends of a sheet turn against each other by 60 degrees a second for ten seconds, three times around and more. The ends stay as far
/// apart as they were, so the cloth is stretched severalfold at the end.
#[test]
#[ignore = "takes minutes"]
fn long_twist() {
    from_all_starts("twist for ten seconds", |seed| {
        let mesh = jittered(Mesh::grid(50, 50, 1.0, 1.0), seed);
        let edges: Vec<u32> = (0..50).chain(49 * 50..50 * 50).collect();
        let held: Vec<Vec3> = edges.iter().map(|&v| mesh.positions[v as usize]).collect();
        let led = move |frame: u32| {
            let angle = FRAME * frame as f32 * PI / 3.0;
            let turned = |(k, x): (usize, &Vec3)| Quat::from_rotation_z(if k < 50 { angle } else { -angle }) * *x;
            let targets = held.iter().enumerate().map(turned).collect();
            Attributes { pin_targets: Some(targets), ..Attributes::default() }
        };
        let start = Start::new(mesh, 20, 600, Vec::new());
        let options = Options { pinned: edges, ..start.options.clone() };
        Start { options, attributes: Box::new(led), ..start }
    });
}

/// Garments of the folder `CLOTH_MESHES`: a skirt that hangs by its top ring, a tablecloth over a box.
#[test]
#[ignore = "takes minutes"]
fn garments() {
    let folder = common::meshes::folder().expect("CLOTH_MESHES names a folder");
    let named = |name: &str, seed| jittered(Mesh::load_obj(folder.join(name)).unwrap(), seed);
    from_all_starts("skirt4K", |seed| {
        let mesh = named("skirt4K.obj", seed);
        let top = mesh.positions.iter().map(|x| x.y).fold(f32::NEG_INFINITY, f32::max);
        let ring = (0..mesh.positions.len() as u32).filter(|&v| mesh.positions[v as usize].y > top - 0.01).collect();
        let start = Start::new(mesh, 20, 60, Vec::new());
        let contact = Some(Contact { thickness: 0.003, friction: 0.3 });
        let options = Options { pinned: ring, contact, quality: Quality::Strain(0.03), ..start.options.clone() };
        Start { options, ..start }
    });
    from_all_starts("tableCloth on a box", |seed| {
        let mut mesh = named("tableCloth.obj", seed);
        // It lies 0.7 m wide, in one plane.
        mesh.positions.iter_mut().for_each(|x| *x -= Vec3::new(-0.13, 0.975, 0.0));
        let table = Collider::rounded_box(Vec3::Y * -0.26, Vec3::new(0.2, 0.24, 0.2), Quat::IDENTITY, 0.01);
        let start = Start::new(mesh, 40, 60, vec![table, Collider::plane(Vec3::Y * -0.7, Vec3::Y)]);
        let options = Options { quality: Quality::Strain(0.03), ..start.options.clone() };
        Start { options, ..start }
    });
}
