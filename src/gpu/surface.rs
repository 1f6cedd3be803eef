//! The cloth as a renderer takes it: positions, normals and indices on the device, nothing through the CPU.

use crate::device::{Entry, Gpu};
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, Group, Stage};
use crate::model::cloth::Cloth;

/// A cloth on the GPU, ready to be drawn by a renderer on the same device: [`Deformer::surface`](crate::Deformer::surface).
///
/// Vertices are in the order of [`Deformer::vertex_order`](crate::Deformer::vertex_order). The buffers are the cloth's own,
/// the same from call to call: read them, never write to them.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Surface {
    /// A `vec4<f32>` a vertex, 16 bytes apart: xyz (m) less [`Deformer::origin`](crate::Deformer::origin), w is the
    /// solver's. Usages `VERTEX`, `STORAGE`, `COPY_SRC`.
    pub positions: wgpu::Buffer,
    /// A `vec4<f32>` a vertex, 16 bytes apart: the mean of the triangles around it weighted by area, of length 1 on the side
    /// from which they are counter-clockwise, 0 where there is no area; w is 0. Usages as `positions`.
    pub normals: wgpu::Buffer,
    /// Three `u32` a triangle, in the mesh's order and sense, without triangles that name a vertex twice. Usages `INDEX`,
    /// `STORAGE`, `COPY_SRC`.
    pub indices: wgpu::Buffer,
    /// Number of indices.
    pub index_count: u32,
}

/// The stage that makes normals, and what it makes them from.
#[derive(Debug)]
pub(crate) struct Normals {
    pub surface: Surface,
    vertices: usize,
    /// None: what the stage needs, its buffers say.
    uniforms: Group,
    stage: Stage,
}

impl Normals {
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, positions: &wgpu::Buffer) -> Normals {
        use wgpu::BufferUsages;
        let around = &cloth.panels().around;
        let corners = cloth.triangles.as_flattened();
        // An empty mesh has a triangle of zeros, for a buffer of no bytes cannot be bound.
        let indices = gpu.buffer_for("triangles", size_of_val(corners).max(12) as u64, BufferUsages::INDEX);
        gpu.write(&indices, 0, corners);
        let normals = gpu.buffer_for("normals", positions.size(), BufferUsages::VERTEX);
        let spans = gpu.filled("normal spans", &around.spans);
        let around = gpu.filled("triangles around", &around.items);
        let bound =
            vec![Bind::Read(&indices), Bind::Read(&spans), Bind::Read(&around), Bind::Read(positions), Bind::Write(&normals)];
        let uniforms = Group::new(gpu, &[]);
        let entry = Entry { shader: shaders::NORMALS, name: "gather_normals", constants: &[] };
        let stage = Stage::new(gpu, &uniforms, entry, &[bound]);
        let surface = Surface { positions: positions.clone(), normals, indices, index_count: corners.len() as u32 };
        Normals { surface, vertices: cloth.rest.len(), uniforms, stage }
    }

    /// Submits the normals of the state that the steps so far lead to.
    pub(crate) fn submit(&self, gpu: &Gpu) {
        let mut encoder = gpu.encoder();
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            self.uniforms.set(&mut pass, 0, &[]);
            self.stage.dispatch(&mut pass, 0, &[], self.vertices);
        }
        gpu.queue().submit([encoder.finish()]);
    }
}
