//! A render mesh that follows a cloth on its GPU.

use bytemuck::{Pod, Zeroable};

use crate::device::fault::GpuFault;
use crate::device::{Entry, Gpu};
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, BindGroup, Stage};
use crate::gpu::surface::Normals;
use crate::model::cloth::Cloth;

/// A vertex of the render mesh as `stages/follow.wgsl` reads it. Corners are in the cloth's own vertex order.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct BoundVertex {
    pub corners: [u32; 3],
    pub along: f32,
    pub weights: [f32; 3],
    pub padding_1: u32,
    pub normal_weights: [f32; 3],
    pub padding_2: u32,
}

/// A render mesh bound to a cloth on its GPU, made by [`Deformer::bind`](crate::Deformer::bind). It follows the cloth
/// without a copy through the CPU.
///
/// It reads the cloth's own buffers, which stay the same for the lifetime of the [`Deformer`](crate::Deformer). After
/// that, it shows the cloth's last state.
#[derive(Debug)]
pub struct BoundMesh {
    positions: wgpu::Buffer,
    gpu: Gpu,
    normals: Normals,
    /// Empty, because the kernel takes all numbers from its buffers.
    uniforms: BindGroup,
    stage: Stage,
    vertices: usize,
}

impl BoundMesh {
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, x: &wgpu::Buffer, vertices: &[BoundVertex]) -> Result<BoundMesh, GpuFault> {
        gpu.meets("the render mesh's vertices", size_of_val(vertices) as u64)?;
        gpu.checked(|| {
            let normals = Normals::new(gpu, cloth, x);
            let bound = gpu.filled("bound vertices", vertices);
            let size = (16 * vertices.len().max(1)) as u64;
            let positions = gpu.buffer_for("render mesh", size, wgpu::BufferUsages::VERTEX);
            let uniforms = BindGroup::new(gpu, &[]);
            let entry = Entry { shader: shaders::FOLLOW, name: "follow", constants: &[] };
            let binds = vec![Bind::Read(&bound), Bind::Read(x), Bind::Read(&normals.surface.normals), Bind::Write(&positions)];
            let stage = Stage::new(gpu, &uniforms, entry, &[binds]);
            Ok(BoundMesh { positions, gpu: gpu.clone(), normals, uniforms, stage, vertices: vertices.len() })
        })
    }

    /// Positions of the render mesh's vertices, in its order, for a renderer on the same device (usages `VERTEX`,
    /// `STORAGE`, `COPY_SRC`). Each is a `vec4<f32>`: xyz (m) relative to
    /// [`Deformer::origin`](crate::Deformer::origin), and w = 1.
    #[must_use]
    pub fn positions(&self) -> &wgpu::Buffer {
        &self.positions
    }

    /// Submits the computation of the positions after all steps submitted so far. Call it in each frame, and submit the
    /// commands that draw them to the same queue, after this call and before the next one that changes the cloth: a step,
    /// `reset`, `restore`, `warp` and so on.
    pub fn apply(&self) {
        self.normals.submit(&self.gpu);
        self.stage.submit(&self.gpu, &self.uniforms, self.vertices);
    }
}
