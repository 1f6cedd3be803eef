//! Draws the flag, its pole and the sky into a texture, and reads the texture back.

use std::f32::consts::TAU;

use cloth_deformer::glam::{Mat4, Vec2, Vec3, Vec4};
use cloth_deformer::{Deformer, Gpu, wgpu};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

use crate::{Failure, scene};

const COLOR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Samples per pixel; every adapter supports four.
const SAMPLES: u32 = 4;
/// Direction toward the sun.
pub(crate) const SUN: Vec3 = Vec3::new(-0.55, 0.62, 0.56);
/// Bytes per pixel.
const PIXEL: u32 = 4;

/// The uniform `View` of `flag.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct View {
    matrix: Mat4,
    eye: Vec4,
    origin: Vec4,
    sun: Vec4,
}

/// The pipelines, and the textures to draw into.
#[derive(Debug)]
pub(crate) struct Painter {
    gpu: Gpu,
    size: [u32; 2],
    view: wgpu::Buffer,
    bound: wgpu::BindGroup,
    sky: wgpu::RenderPipeline,
    cloth: wgpu::RenderPipeline,
    solid: wgpu::RenderPipeline,
    picture: wgpu::Texture,
    samples: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl Painter {
    /// Creates them for pictures of `size` (pixels).
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2]) -> Painter {
        let device = gpu.device();
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let view = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("view"),
            size: size_of::<View>() as u64,
            usage,
            mapped_at_creation: false,
        });
        let ty =
            wgpu::BindingType::Buffer { ty: wgpu::BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size: None };
        let visibility = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let entry = wgpu::BindGroupLayoutEntry { binding: 0, visibility, ty, count: None };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &[entry] });
        let entry = wgpu::BindGroupEntry { binding: 0, resource: view.as_entire_binding() };
        let bound = device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &[entry] });

        let module = device.create_shader_module(wgpu::include_wgsl!("flag.wgsl"));
        // Positions and normals of the cloth are one vec4 per vertex, of which three numbers are used.
        let vectors = [0, 1].map(|location| {
            [wgpu::VertexAttribute { format: wgpu::VertexFormat::Float32x3, offset: 0, shader_location: location }]
        });
        let [positions, normals] = vectors.each_ref().map(|attributes| layout_of(size_of::<Vec4>(), attributes));
        let uv = [wgpu::VertexAttribute { format: wgpu::VertexFormat::Float32x2, offset: 0, shader_location: 2 }];
        let uv = layout_of(size_of::<Vec2>(), &uv);
        let pipeline =
            |name: &str, buffers: &[Option<wgpu::VertexBufferLayout<'_>>]| pipeline(device, &layout, &module, name, buffers);
        let texture = |format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: extent(size),
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let drawn = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let whole = wgpu::TextureViewDescriptor::default();
        Painter {
            size,
            sky: pipeline("sky", &[]),
            cloth: pipeline("cloth", &[Some(positions.clone()), Some(normals.clone()), Some(uv)]),
            solid: pipeline("solid", &[Some(positions), Some(normals)]),
            picture: texture(COLOR, 1, drawn | wgpu::TextureUsages::COPY_SRC),
            samples: texture(COLOR, SAMPLES, drawn).create_view(&whole),
            depth: texture(DEPTH, SAMPLES, drawn).create_view(&whole),
            gpu: gpu.clone(),
            view,
            bound,
        }
    }

    /// Draws the scene, with or without a flag: RGBA, row by row.
    pub(crate) fn paint(&self, mut flag: Option<&mut Deformer>) -> Result<Vec<u8>, Failure> {
        let device = self.gpu.device();
        let origin = flag.as_ref().map_or(Vec3::ZERO, |flag| flag.origin());
        let matrix = scene::camera(self.size[0] as f32 / self.size[1] as f32);
        let view = View { matrix, eye: scene::EYE.extend(0.0), origin: origin.extend(0.0), sun: SUN.normalize().extend(0.0) };
        self.gpu.queue().write_buffer(&self.view, 0, bytemuck::bytes_of(&view));

        let filled = |contents: &[u8], usage| device.create_buffer_init(&BufferInitDescriptor { label: None, contents, usage });
        let vertices = |values: &[u8]| filled(values, wgpu::BufferUsages::VERTEX);
        let (at, normals, triangles) = pole();
        let pole_count = triangles.len() as u32;
        let pole = [vertices(bytemuck::cast_slice(&at)), vertices(bytemuck::cast_slice(&normals))];
        let pole_indices = filled(bytemuck::cast_slice(&triangles), wgpu::BufferUsages::INDEX);
        let surface = match &mut flag {
            Some(flag) => flag.surface()?,
            None => None,
        };
        // Per-vertex data of the flag must be in the order of the cloth's buffers.
        let uv = flag.map_or(Vec::new(), |flag| {
            let uv = scene::uv(&scene::mesh());
            flag.vertex_order().iter().map(|&vertex| uv[vertex as usize]).collect()
        });
        let uv = vertices(bytemuck::cast_slice(if uv.is_empty() { &[Vec2::ZERO] } else { &uv }));

        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let target = self.picture.create_view(&wgpu::TextureViewDescriptor::default());
            let mut pass = self.pass(&mut encoder, &target);
            pass.set_bind_group(0, &self.bound, &[]);
            pass.set_pipeline(&self.sky);
            pass.draw(0..3, 0..1);
            pass.set_pipeline(&self.solid);
            pass.set_vertex_buffer(0, pole[0].slice(..));
            pass.set_vertex_buffer(1, pole[1].slice(..));
            pass.set_index_buffer(pole_indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..pole_count, 0, 0..1);
            if let Some(surface) = &surface {
                pass.set_pipeline(&self.cloth);
                pass.set_vertex_buffer(0, surface.positions.slice(..));
                pass.set_vertex_buffer(1, surface.normals.slice(..));
                pass.set_vertex_buffer(2, uv.slice(..));
                pass.set_index_buffer(surface.indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..surface.index_count, 0, 0..1);
            }
        }
        self.read(encoder)
    }

    fn pass<'a>(&self, encoder: &'a mut wgpu::CommandEncoder, target: &wgpu::TextureView) -> wgpu::RenderPass<'a> {
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.samples,
                depth_slice: None,
                resolve_target: Some(target),
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Discard },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        })
    }

    /// Submits the commands and copies the picture out, the only transfer to the CPU.
    fn read(&self, mut encoder: wgpu::CommandEncoder) -> Result<Vec<u8>, Failure> {
        let [width, height] = self.size;
        let row = (width * PIXEL).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let size = u64::from(row * height);
        let staging =
            self.gpu.device().create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        let into = wgpu::TexelCopyBufferInfo { buffer: &staging, layout };
        encoder.copy_texture_to_buffer(self.picture.as_image_copy(), into, extent(self.size));
        self.gpu.queue().submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |_| {});
        self.gpu.device().poll(wgpu::PollType::wait_indefinitely())?;
        let rows = staging.get_mapped_range(..)?;
        Ok(rows.chunks_exact(row as usize).flat_map(|row| &row[..(width * PIXEL) as usize]).copied().collect())
    }

    /// Encodes the picture as PNG.
    pub(crate) fn png(&self, pixels: &[u8]) -> Result<Vec<u8>, Failure> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, self.size[0], self.size[1]);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(pixels)?;
        writer.finish()?;
        Ok(file)
    }
}

fn extent([width, height]: [u32; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d { width, height, depth_or_array_layers: 1 }
}

fn layout_of(stride: usize, attributes: &[wgpu::VertexAttribute]) -> wgpu::VertexBufferLayout<'_> {
    wgpu::VertexBufferLayout { array_stride: stride as u64, step_mode: wgpu::VertexStepMode::Vertex, attributes }
}

/// A pipeline with the vertex stage `name` and the fragment stage `name_shade`.
fn pipeline(
    device: &wgpu::Device,
    view: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    name: &str,
    buffers: &[Option<wgpu::VertexBufferLayout<'_>>],
) -> wgpu::RenderPipeline {
    let layout = wgpu::PipelineLayoutDescriptor { label: None, bind_group_layouts: &[Some(view)], immediate_size: 0 };
    let compilation_options = wgpu::PipelineCompilationOptions::default();
    let vertex = wgpu::VertexState { module, entry_point: Some(name), compilation_options: compilation_options.clone(), buffers };
    let shade = format!("{name}_shade");
    let targets = [Some(wgpu::ColorTargetState::from(COLOR))];
    let fragment = wgpu::FragmentState { module, entry_point: Some(&shade), compilation_options, targets: &targets };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(name),
        layout: Some(&device.create_pipeline_layout(&layout)),
        vertex,
        // Both sides of the cloth are visible.
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::LessEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: SAMPLES, ..wgpu::MultisampleState::default() },
        fragment: Some(fragment),
        multiview_mask: None,
        cache: None,
    })
}

/// A round pole with a knob behind the flag's edge: positions, normals, indices.
fn pole() -> (Vec<Vec4>, Vec<Vec4>, Vec<u32>) {
    const SIDES: u32 = 32;
    const RADIUS: f32 = 0.022;
    let top = 0.5 * scene::SIZE.y + 0.06;
    // Height, radius and slope of each ring, from bottom to top.
    let mut rings = vec![(-3.0, RADIUS, 0.0), (top, RADIUS, 0.0)];
    rings.extend((0..=12).map(|k| {
        let angle = (k as f32 / 12.0 - 0.5) * 0.5 * TAU;
        (top + 0.045 * (1.0 + angle.sin()), 0.045 * angle.cos(), angle.sin())
    }));
    let (mut at, mut normals, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    for (ring, &(height, radius, slope)) in (0..).zip(&rings) {
        for side in 0..SIDES {
            let (sin, cos) = (TAU * side as f32 / SIDES as f32).sin_cos();
            at.push(Vec4::new(radius * cos - RADIUS, height, radius * sin, 1.0));
            normals.push((Vec3::new(cos, 0.0, sin) * (1.0 - slope * slope).max(0.0).sqrt()).with_y(slope).extend(0.0));
            if ring > 0 {
                let (a, b) = (ring * SIDES + side, ring * SIDES + (side + 1) % SIDES);
                indices.extend([a - SIDES, a, b - SIDES, b - SIDES, a, b]);
            }
        }
    }
    (at, normals, indices)
}
