//! Bevy's side of the cape: it is stepped on Bevy's device in the render world, and fills a mesh there with no copy through the CPU.
//!
//! The main world says what happened since the last frame ([`Happened`]); the render world takes it over when it extracts, steps the cloth,
//! and a compute shader writes positions and normals, between the last two steps, into the mesh's part of Bevy's vertex buffers. All of
//! it goes to Bevy's own queue before the frame that draws it. From there the mesh is like any other: with any material, shadows and all.

use bevy::prelude::*;
use bevy::render::mesh::allocator::{MeshAllocator, MeshAllocatorSettings};
use bevy::render::renderer::{RenderAdapterInfo, RenderDevice, RenderQueue};
use bevy::render::{ExtractSchedule, MainWorld, Render, RenderApp, RenderStartup, RenderSystems};
use cloth_deformer::glam::Affine3A;
use cloth_deformer::wgpu::util::{BufferInitDescriptor, DeviceExt};
use cloth_deformer::{Backend, Deformer, Gpu, wgpu};

use crate::body::Pose;
use crate::cape::{self, Event};

/// Steps a cape, and fills [`CapeMesh`] with it.
#[derive(Debug)]
pub(crate) struct ClothPlugin;

/// What has happened to the cape since the last frame, and how far between the last two steps (0 to 1) the frame is.
#[derive(Resource, Debug, Default)]
pub(crate) struct Happened {
    pub(crate) events: Vec<Event>,
    pub(crate) part: f32,
}

/// The mesh that is filled: as many vertices as [`cape::mesh`], of position, normal and texture coordinates, in its order.
#[derive(Resource, Debug, Clone)]
pub(crate) struct CapeMesh(pub(crate) Handle<Mesh>);

impl Plugin for ClothPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Happened>();
        let Some(render) = app.get_sub_app_mut(RenderApp) else { return };
        render.init_resource::<Work>();
        render.add_systems(RenderStartup, make);
        render.add_systems(ExtractSchedule, extract);
        // Meshes have their place in the vertex buffers by then, and nothing is drawn yet.
        render.add_systems(Render, (step, fill).chain().in_set(RenderSystems::PrepareResources));
    }

    fn finish(&self, app: &mut App) {
        let Some(render) = app.get_sub_app_mut(RenderApp) else { return };
        // The vertex buffers are written to by a shader.
        render.world_mut().resource_mut::<MeshAllocatorSettings>().extra_buffer_usages |= wgpu::BufferUsages::STORAGE;
    }
}

/// [`Happened`] in the render world, and the mesh.
#[derive(Resource, Default)]
struct Work {
    events: Vec<Event>,
    part: f32,
    mesh: Option<AssetId<Mesh>>,
}

/// The cape on Bevy's device.
#[derive(Resource)]
struct Cape {
    deformer: Deformer,
    /// Positions and normals after the last step but one.
    old: [wgpu::Buffer; 2],
    order: wgpu::Buffer,
    /// `Fill` of `fill.wgsl`.
    fill: wgpu::Buffer,
    pipeline: wgpu::ComputePipeline,
}

/// Makes the cape as soon as there is a device.
fn make(mut commands: Commands, device: Res<RenderDevice>, queue: Res<RenderQueue>, adapter: Res<RenderAdapterInfo>) -> Result {
    let device = device.wgpu_device();
    let gpu = Gpu::new(device.clone(), wgpu::Queue::clone(&queue), adapter.name.clone());
    let mut deformer = cape::deformer(&Pose::at(0.0, Affine3A::IDENTITY), Backend::Gpu, Some(gpu))?;
    let surface = deformer.surface()?.ok_or("the cape is not on the GPU")?;
    let buffer = |label, size, usage| {
        let usage = usage | wgpu::BufferUsages::COPY_DST;
        device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
    };
    let order: Vec<u8> = deformer.vertex_order().iter().flat_map(|vertex| vertex.to_ne_bytes()).collect();
    let module = device.create_shader_module(wgpu::include_wgsl!("fill.wgsl"));
    commands.insert_resource(Cape {
        old: [&surface.positions, &surface.normals].map(|now| buffer("old", now.size(), wgpu::BufferUsages::STORAGE)),
        order: device.create_buffer_init(&BufferInitDescriptor {
            label: Some("order"),
            contents: &order,
            usage: wgpu::BufferUsages::STORAGE,
        }),
        fill: buffer("fill", 32, wgpu::BufferUsages::UNIFORM),
        pipeline: device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("fill"),
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        }),
        deformer,
    });
    Ok(())
}

/// Takes over what happened in the main world.
fn extract(mut main: ResMut<MainWorld>, mut work: ResMut<Work>) {
    work.mesh = main.get_resource::<CapeMesh>().map(|mesh| mesh.0.id());
    let mut happened = main.resource_mut::<Happened>();
    work.events.append(&mut happened.events);
    work.part = happened.part;
}

/// Steps the cape through what happened.
fn step(mut cape: ResMut<Cape>, mut work: ResMut<Work>, device: Res<RenderDevice>, queue: Res<RenderQueue>) -> Result {
    let last = work.events.iter().rposition(|event| matches!(event, Event::Step(_)));
    for (number, event) in work.events.drain(..).enumerate() {
        match event {
            Event::Warp(motion) => cape.deformer.warp(motion)?,
            Event::Step(attributes) => {
                if Some(number) == last
                    && let Some(surface) = cape.deformer.surface()?
                {
                    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                    for (now, old) in [&surface.positions, &surface.normals].into_iter().zip(&cape.old) {
                        encoder.copy_buffer_to_buffer(now, 0, old, 0, now.size());
                    }
                    queue.submit([encoder.finish()]);
                }
                cape.deformer.step(cape::STEP, &attributes)?;
            }
        }
    }
    Ok(())
}

/// Fills the mesh, if it has its place among the vertices already.
fn fill(
    mut cape: ResMut<Cape>,
    work: Res<Work>,
    meshes: Res<MeshAllocator>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) -> Result {
    let Some(vertices) = work.mesh.and_then(|mesh| meshes.mesh_vertex_slice(&mesh)) else { return Ok(()) };
    let Some(surface) = cape.deformer.surface()? else { return Ok(()) };
    let count = cape.deformer.vertex_order().len() as u32;
    let [x, y, z] = cape.deformer.origin().to_array();
    let numbers = [x.to_bits(), y.to_bits(), z.to_bits(), work.part.to_bits(), vertices.range.start, count, 0, 0];
    queue.write_buffer(&cape.fill, 0, &numbers.map(u32::to_ne_bytes).concat());

    let device = device.wgpu_device();
    let [old_positions, old_normals] = &cape.old;
    let buffers = [&cape.fill, old_positions, old_normals, &surface.positions, &surface.normals, &cape.order, vertices.buffer];
    let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
        .zip(buffers)
        .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
        .collect();
    let layout = cape.pipeline.get_bind_group_layout(0);
    let bound = device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&cape.pipeline);
        pass.set_bind_group(0, &bound, &[]);
        pass.dispatch_workgroups(count.div_ceil(64), 1, 1);
    }
    queue.submit([encoder.finish()]);
    Ok(())
}
