//! Scenes that need few substeps at one time and many at another.

use std::path::Path;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Attributes, Backend, Collider, Fabric, Mesh, Options};

/// Duration of a frame (s).
pub(crate) const FRAME: f32 = 1.0 / 60.0;

/// A cloth and its attributes as a function of the frame.
pub(crate) struct Scene {
    pub(crate) name: &'static str,
    pub(crate) mesh: Mesh,
    /// All options except the quality.
    pub(crate) options: Options,
    pub(crate) frames: u32,
    pub(crate) script: Box<dyn Fn(u32) -> Attributes>,
}

/// Scenes made here, and scenes with the meshes of a folder.
pub(crate) fn scenes(backend: Backend, meshes: Option<&Path>) -> Result<Vec<Scene>, cloth_deformer::ObjError> {
    let membrane = Fabric { density: 0.2, stretch: 5000.0, bending: 0.0, damping: 0.0 };
    let mut scenes = vec![
        still("hang64", Mesh::grid(64, 64, 1.0, 1.0), membrane, (0..64).collect()),
        still("two corners", Mesh::grid(64, 64, 1.0, 1.0), membrane, vec![0, 63]),
        towel(),
        cape(),
        flag(),
        jerk(membrane),
    ];
    if let Some(folder) = meshes {
        let load = |name: &str| Mesh::load_obj(folder.join(name));
        for (name, file) in [("square2K", "square2K.obj"), ("tableCloth", "tableCloth.obj")] {
            let mesh = load(file)?;
            let pinned = corners(&mesh);
            scenes.push(still(name, mesh, Fabric::COTTON, pinned));
        }
        scenes.push(skirt(load("skirt4K.obj")?));
    }
    scenes.iter_mut().for_each(|scene| scene.options.backend = backend);
    Ok(scenes)
}

fn options(fabric: Fabric, pinned: Vec<u32>) -> Options {
    Options { fabric, pinned, ..Options::default() }
}

fn seconds(frame: u32) -> f32 {
    frame as f32 * FRAME
}

/// Released, for two seconds.
fn still(name: &'static str, mesh: Mesh, fabric: Fabric, pinned: Vec<u32>) -> Scene {
    Scene { name, mesh, options: options(fabric, pinned), frames: 120, script: Box::new(|_| Attributes::default()) }
}

/// Dropped on a ball over a floor.
fn towel() -> Scene {
    let mut mesh = Mesh::grid(64, 64, 1.0, 1.0);
    mesh.positions.iter_mut().for_each(|x| x.y += 0.6);
    let ball = Collider::sphere(Vec3::new(0.0, 0.2, 0.0), 0.3);
    let colliders = vec![ball, Collider::plane(Vec3::new(0.0, -0.5, 0.0), Vec3::Y)];
    let script = move |_| Attributes { colliders: colliders.clone(), ..Attributes::default() };
    Scene { name: "towel", mesh, options: options(Fabric::COTTON, vec![]), frames: 120, script: Box::new(script) }
}

/// Moved by its upper edge: starts, sways and walks.
fn cape() -> Scene {
    let mesh = Mesh::grid(48, 64, 0.8, 1.2);
    let start = mesh.positions[..48].to_vec();
    let script = move |frame| {
        let t = seconds(frame);
        let begun = 1.0 - (-t).exp();
        let way = Vec3::new(0.3 * begun * (3.0 * t).sin(), 0.05 * (6.0 * t).sin(), -1.5 * (t - begun));
        let pin_targets = Some(start.iter().map(|pin| *pin + way).collect());
        Attributes { pin_targets, air_density: 1.225, ..Attributes::default() }
    };
    Scene { name: "cape", mesh, options: options(Fabric::COTTON, (0..48).collect()), frames: 240, script: Box::new(script) }
}

/// In gusts of 10 m/s.
fn flag() -> Scene {
    let mut mesh = Mesh::grid(61, 41, 1.5, 1.0);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, -x.z, 0.0));
    let script = |frame| {
        let t = seconds(frame);
        let wind = Vec3::new(10.0, 0.3 * (5.0 * t).sin(), 2.0 * (4.4 * t).sin());
        Attributes { wind, air_density: 1.225, ..Attributes::default() }
    };
    let pinned = (0..41).map(|row| 61 * row).collect();
    Scene { name: "flag", mesh, options: options(Fabric::COTTON, pinned), frames: 180, script: Box::new(script) }
}

/// Jerked up by one meter at 5 m/s after one second.
fn jerk(fabric: Fabric) -> Scene {
    let mesh = Mesh::grid(48, 48, 1.0, 1.0);
    let start = mesh.positions[..48].to_vec();
    let script = move |frame: u32| {
        let lift = (5.0 * seconds(frame.saturating_sub(60))).min(1.0);
        let pin_targets = Some(start.iter().map(|pin| *pin + Vec3::new(0.0, lift, 0.0)).collect());
        Attributes { pin_targets, ..Attributes::default() }
    };
    Scene { name: "jerk", mesh, options: options(fabric, (0..48).collect()), frames: 240, script: Box::new(script) }
}

/// Rotated to and fro by its waist.
fn skirt(mesh: Mesh) -> Scene {
    let heights = || mesh.positions.iter().map(|x| x.y);
    let (low, high) = (heights().fold(f32::MAX, f32::min), heights().fold(f32::MIN, f32::max));
    let is_waist = |vertex: &u32| mesh.positions[*vertex as usize].y > high - 0.03 * (high - low);
    let pinned: Vec<u32> = (0..mesh.positions.len() as u32).filter(is_waist).collect();
    let start: Vec<Vec3> = pinned.iter().map(|&vertex| mesh.positions[vertex as usize]).collect();
    let script = move |frame| {
        let t = seconds(frame);
        let turn = Quat::from_rotation_y(1.2 * (1.0 - (-t).exp()) * (4.0 * t).sin());
        Attributes { pin_targets: Some(start.iter().map(|pin| turn * *pin).collect()), ..Attributes::default() }
    };
    Scene { name: "skirt4K", mesh, options: options(Fabric::COTTON, pinned), frames: 180, script: Box::new(script) }
}

/// The vertices farthest toward +z and -x, and toward +z and +x.
fn corners(mesh: &Mesh) -> Vec<u32> {
    let toward = |along: f32| {
        let reach = |vertex: &u32| mesh.positions[*vertex as usize].z + along * mesh.positions[*vertex as usize].x;
        (0..mesh.positions.len() as u32).max_by(|a, b| reach(a).total_cmp(&reach(b))).unwrap_or(0)
    };
    vec![toward(-1.0), toward(1.0)]
}
