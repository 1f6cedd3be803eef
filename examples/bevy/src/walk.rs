//! The main world: a body that walks by fixed steps, drawn between the last two of them, and what may befall it.

use bevy::prelude::*;
use cloth_deformer::glam;
use glam::Affine3A;

use crate::body::{HEAD, LIMBS, Pose, RADII};
use crate::cape::{self, Event};
use crate::cloth::Happened;

/// The walk so far.
#[derive(Resource, Debug)]
pub(crate) struct Walk {
    steps: u32,
    /// Where its circle is.
    place: Affine3A,
    /// The body after the last step but one, and after the last one.
    poses: [Pose; 2],
    /// Where the body is to be put before the next step, as if the world had moved.
    pub(crate) jump: Option<Affine3A>,
}

impl Walk {
    /// How many steps were taken.
    pub(crate) fn steps(&self) -> u32 {
        self.steps
    }
}

/// A limb of the body, by number.
#[derive(Component, Debug, Clone, Copy)]
struct Limb(usize);

/// Adds the walk.
#[derive(Debug)]
pub(crate) struct WalkPlugin;

impl Plugin for WalkPlugin {
    fn build(&self, app: &mut App) {
        let still = Pose::at(0.0, Affine3A::IDENTITY);
        app.insert_resource(Walk { steps: 0, place: Affine3A::IDENTITY, poses: [still; 2], jump: None });
        app.insert_resource(Time::<Fixed>::from_seconds(f64::from(cape::STEP)));
        app.add_systems(Startup, spawn);
        // No step is taken while the virtual clock is paused, and several in a frame that took long.
        app.add_systems(FixedUpdate, step);
        app.add_systems(Update, show);
        #[cfg(feature = "window")]
        app.add_systems(Update, press.before(show));
    }
}

/// A step of the body, and of its cape.
fn step(mut walk: ResMut<Walk>, mut happened: ResMut<Happened>) {
    if let Some(motion) = walk.jump.take() {
        walk.place = motion * walk.place;
        walk.poses = walk.poses.map(|pose| pose.moved(motion));
        happened.events.push(Event::Warp(motion));
    }
    walk.steps += 1;
    let time = walk.steps as f32 * cape::STEP;
    let now = Pose::at(time, walk.place);
    walk.poses = [walk.poses[1], now];
    happened.events.push(Event::Step(Box::new(cape::attributes(&now, time))));
}

/// Shows the body between its last two steps, as the cape is; the camera goes along.
fn show(
    walk: Res<Walk>,
    time: Res<Time<Fixed>>,
    mut happened: ResMut<Happened>,
    mut limbs: Query<(&Limb, &mut Transform), Without<Camera3d>>,
    mut camera: Query<&mut Transform, With<Camera3d>>,
) {
    happened.part = time.overstep_fraction();
    let pose = walk.poses[0].toward(&walk.poses[1], happened.part);
    for (limb, mut transform) in &mut limbs {
        let [a, b] = pose.limbs[limb.0].map(bevy);
        let rotation = Quat::from_rotation_arc(Vec3::Y, (b - a).normalize_or(Vec3::Y));
        *transform = Transform::from_translation(0.5 * (a + b)).with_rotation(rotation);
    }
    let [eye, at] = [[1.5, 1.45, 3.1], [0.05, 0.98, 0.0]].map(|point| pose.root.transform_point3(point.into()));
    for mut transform in &mut camera {
        *transform = Transform::from_translation(bevy(eye)).looking_at(bevy(at), Vec3::Y);
    }
}

/// Space pauses, T teleports.
#[cfg(feature = "window")]
fn press(keys: Res<ButtonInput<KeyCode>>, mut clock: ResMut<Time<Virtual>>, mut walk: ResMut<Walk>) {
    if keys.just_pressed(KeyCode::Space) {
        if clock.is_paused() { clock.unpause() } else { clock.pause() }
    }
    if keys.just_pressed(KeyCode::KeyT) {
        walk.jump = Some(Affine3A::from_rotation_y(2.0) * Affine3A::from_translation(glam::Vec3::new(3.0, 0.0, -5.0)));
    }
}

/// Bevy's glam is another version's.
fn bevy(vector: glam::Vec3) -> Vec3 {
    Vec3::from_array(vector.to_array())
}

/// The limbs.
fn spawn(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    walk: Res<Walk>,
) {
    let gray =
        materials.add(StandardMaterial { base_color: Color::srgb(0.32, 0.42, 0.52), perceptual_roughness: 0.6, ..default() });
    for limb in 0..LIMBS {
        let [a, b] = walk.poses[1].limbs[limb];
        let mesh =
            if limb == HEAD { Mesh::from(Sphere::new(RADII[limb])) } else { Capsule3d::new(RADII[limb], a.distance(b)).into() };
        commands.spawn((Limb(limb), Mesh3d(meshes.add(mesh)), MeshMaterial3d(gray.clone()), Transform::default()));
    }
}
