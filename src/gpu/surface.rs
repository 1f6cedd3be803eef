//! The buffers that a renderer draws the cloth from: positions, normals and indices on the device, without a copy
//! through the CPU.

use crate::device::Gpu;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, SubmittedStage};
use crate::model::cloth::Cloth;

/// The buffers of a cloth on the GPU, for a renderer on the same device: see
/// [`Deformer::surface`](crate::Deformer::surface).
///
/// Vertices are in the order of [`Deformer::vertex_order`](crate::Deformer::vertex_order). The buffers are the cloth's
/// own and stay the same from call to call: read them, but never write to them.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Surface {
    /// One `vec4<f32>` per vertex, 16 bytes apart: xyz is the position (m) minus
    /// [`Deformer::origin`](crate::Deformer::origin), w is used by the solver. Usages `VERTEX`, `STORAGE`, `COPY_SRC`.
    pub positions: wgpu::Buffer,
    /// One `vec4<f32>` per vertex, 16 bytes apart: the unit normal, the area-weighted mean over the vertex's triangles,
    /// on the side from which they are counter-clockwise; 0 where there is no area. w is 0. Usages as for `positions`.
    pub normals: wgpu::Buffer,
    /// Three `u32` per triangle, in the mesh's order and orientation, without triangles that use a vertex twice. Usages
    /// `INDEX`, `STORAGE`, `COPY_SRC`.
    pub indices: wgpu::Buffer,
    /// Number of indices.
    pub index_count: u32,
}

/// The stage that computes normals, and its buffers.
#[derive(Debug)]
pub(crate) struct Normals {
    pub surface: Surface,
    pub stage: SubmittedStage,
}

impl Normals {
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, positions: &wgpu::Buffer) -> Normals {
        use wgpu::BufferUsages;
        let around = &cloth.panels().around;
        let corners = cloth.triangles.as_flattened();
        // An empty mesh gets a triangle of zeros, because a buffer without bytes cannot be bound.
        let indices = gpu.buffer_for("triangles", size_of_val(corners).max(12) as u64, BufferUsages::INDEX);
        gpu.write(&indices, 0, corners);
        let normals = gpu.buffer_for("normals", positions.size(), BufferUsages::VERTEX);
        let spans = gpu.filled("normal spans", &around.spans);
        let around = gpu.filled("triangles around", &around.items);
        let bound =
            vec![Bind::Read(&indices), Bind::Read(&spans), Bind::Read(&around), Bind::Read(positions), Bind::Write(&normals)];
        let stage = SubmittedStage::new(gpu, shaders::NORMALS.entry("gather_normals"), bound, cloth.rest.len());
        let surface = Surface { positions: positions.clone(), normals, indices, index_count: corners.len() as u32 };
        Normals { surface, stage }
    }
}
