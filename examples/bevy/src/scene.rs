//! What is drawn besides the body: the cape, a floor, light, a camera.

use bevy::asset::RenderAssetUsages;
use bevy::camera::visibility::NoFrustumCulling;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::image::{ImageAddressMode, ImageSampler, ImageSamplerDescriptor};
use bevy::light::{CascadeShadowConfigBuilder, GlobalAmbientLight};
use bevy::math::Affine2;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, Face, TextureDimension, TextureFormat};

use crate::cape;
use crate::cloth::CapeMesh;

/// Size of the floor (m).
const FLOOR: f32 = 120.0;
const SKY: Color = Color::srgb(0.78, 0.83, 0.89);

/// Adds the scene.
#[derive(Debug)]
pub(crate) struct ScenePlugin;

impl Plugin for ScenePlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(ClearColor(SKY));
        app.insert_resource(GlobalAmbientLight { brightness: 500.0, ..default() });
        app.add_systems(Startup, (cape, floor, light, camera));
    }
}

/// The cape's mesh, which the cloth fills, and both of its sides.
fn cape(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>, mut materials: ResMut<Assets<StandardMaterial>>) {
    let flat = cape::mesh();
    let positions: Vec<[f32; 3]> = flat.positions.iter().map(|x| x.to_array()).collect();
    let normals = vec![[0.0, 0.0, 1.0]; positions.len()];
    let mesh = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
        .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, cape::uv())
        .with_inserted_indices(Indices::U32(flat.triangles.as_flattened().to_vec()));
    let mesh = meshes.add(mesh);
    commands.insert_resource(CapeMesh(mesh.clone()));
    for (base_color, cull) in [(Color::srgb(0.66, 0.16, 0.13), Face::Back), (Color::srgb(0.86, 0.66, 0.36), Face::Front)] {
        let side = StandardMaterial {
            base_color,
            cull_mode: Some(cull),
            double_sided: true,
            perceptual_roughness: 0.9,
            reflectance: 0.2,
            ..default()
        };
        // Bevy knows where the cape was at first, and not where it is now.
        commands.spawn((Mesh3d(mesh.clone()), MeshMaterial3d(materials.add(side)), NoFrustumCulling));
    }
}

/// Tiles of half a meter.
fn floor(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    mut images: ResMut<Assets<Image>>,
) {
    let (light, dark) = ([206, 208, 212, 255], [176, 180, 186, 255]);
    let texels = [light, dark, dark, light].concat();
    let size = Extent3d { width: 2, height: 2, depth_or_array_layers: 1 };
    let usage = RenderAssetUsages::RENDER_WORLD;
    let mut tiles = Image::new(size, TextureDimension::D2, texels, TextureFormat::Rgba8UnormSrgb, usage);
    let mode = ImageAddressMode::Repeat;
    tiles.sampler = ImageSampler::Descriptor(ImageSamplerDescriptor {
        address_mode_u: mode,
        address_mode_v: mode,
        ..ImageSamplerDescriptor::nearest()
    });
    let material = StandardMaterial {
        base_color_texture: Some(images.add(tiles)),
        uv_transform: Affine2::from_scale(Vec2::splat(FLOOR)),
        perceptual_roughness: 1.0,
        reflectance: 0.1,
        ..default()
    };
    let plane = Plane3d::default().mesh().size(FLOOR, FLOOR);
    commands.spawn((Mesh3d(meshes.add(plane)), MeshMaterial3d(materials.add(material))));
}

fn light(mut commands: Commands) {
    commands.spawn((
        DirectionalLight { illuminance: 6500.0, shadow_maps_enabled: true, ..default() },
        CascadeShadowConfigBuilder { num_cascades: 2, maximum_distance: 14.0, first_cascade_far_bound: 6.0, ..default() }.build(),
        Transform::from_xyz(3.0, 6.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

fn camera(mut commands: Commands) {
    commands.spawn((
        Camera3d::default(),
        Tonemapping::AcesFitted,
        Projection::from(PerspectiveProjection { fov: 0.66, ..default() }),
        DistanceFog { color: SKY, falloff: FogFalloff::Linear { start: 8.0, end: 30.0 }, ..default() },
    ));
}
