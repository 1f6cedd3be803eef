//! The cloth as a renderer takes it: positions, normals and indices on the device, nothing through the CPU.

use crate::backend::Failure;
use crate::model::cloth::Cloth;

use super::GpuEngine;
use super::device::{Bind, Entry, Gpu, Group, Stage, shader};

/// A cloth on the GPU, ready to be drawn by a renderer on the same device: [`Deformer::surface`](crate::Deformer::surface).
///
/// Vertices are in the order of [`Deformer::vertex_order`](crate::Deformer::vertex_order). The buffers are the cloth's own,
/// the same from call to call: read them, never write to them.
#[derive(Debug, Clone)]
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
    surface: Surface,
    vertices: usize,
    /// The stage knows no frame: what it needs, its buffers say.
    frame: Group,
    stage: Stage,
}

impl Normals {
    fn new(gpu: &Gpu, cloth: &Cloth, positions: &wgpu::Buffer) -> Normals {
        let around = &cloth.panels().around;
        let indices = gpu.index_buffer("triangles", &cloth.triangles);
        let normals = gpu.vertex_buffer("normals", positions.size());
        let spans = gpu.filled("normal spans", &around.spans);
        let around = gpu.filled("triangles around", &around.items);
        let bound = vec![
            (0, Bind::Read(&indices)),
            (1, Bind::Read(&spans)),
            (2, Bind::Read(&around)),
            (3, Bind::Read(positions)),
            (4, Bind::Write(&normals)),
        ];
        let frame = Group::new(gpu, &[]);
        let module = gpu.module("normals", shader!("normals"));
        let stage = Stage::new(gpu, &frame, Entry::new(&module, "gather_normals"), &[bound]);
        let index_count = 3 * cloth.triangles.len() as u32;
        let surface = Surface { positions: positions.clone(), normals, indices, index_count };
        Normals { surface, vertices: cloth.rest.len(), frame, stage }
    }

    fn submit(&self, gpu: &Gpu) {
        let mut encoder = gpu.encoder();
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            self.frame.set(&mut pass, 0, &[]);
            self.stage.encode(&mut pass, 0, &[], self.vertices);
        }
        gpu.queue.submit([encoder.finish()]);
    }
}

impl GpuEngine {
    /// Submits the normals of the state that the steps so far lead to.
    pub(crate) fn surface(&mut self, cloth: &Cloth) -> Result<Surface, Failure> {
        let gpu = self.gpu.clone();
        gpu.checked(|| {
            let x = self.position_buffer().clone();
            let normals = self.normals.get_or_insert_with(|| Normals::new(&gpu, cloth, &x));
            normals.submit(&gpu);
            Ok(normals.surface.clone())
        })
        .map_err(Failure::Gpu)
    }
}
