//! A render mesh that follows a cloth on its GPU.

use std::sync::Arc;

use crate::device::{Entry, Gpu};
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, SubmittedStage};
use crate::gpu::surface::Normals;
use crate::kernels::follow::BoundVertex;

/// A render mesh bound to a cloth on its GPU, made by [`Deformer::bind`](crate::Deformer::bind). It follows the cloth
/// without a copy through the CPU.
///
/// It reads the cloth's own buffers, which stay the same for the lifetime of the [`Deformer`](crate::Deformer). After
/// that, it shows the cloth's last state.
#[derive(Debug)]
pub struct BoundMesh {
    positions: wgpu::Buffer,
    /// Of a single vertex, which is not written, if the mesh was bound without normals.
    render_normals: wgpu::Buffer,
    has_normals: bool,
    gpu: Gpu,
    /// The cloth's, which its other render meshes and its surface share.
    pub(super) normals: Arc<Normals>,
    stage: SubmittedStage,
}

impl BoundMesh {
    pub(crate) fn new(gpu: &Gpu, normals: Arc<Normals>, vertices: &[BoundVertex], has_normals: bool) -> BoundMesh {
        let bound = gpu.filled("bound vertices", vertices);
        let buffer = |label, vertices: usize| gpu.buffer_for(label, 16 * vertices.max(1) as u64, wgpu::BufferUsages::VERTEX);
        let positions = buffer("render mesh", vertices.len());
        let render_normals = buffer("normals of the render mesh", if has_normals { vertices.len() } else { 0 });
        let entry = Entry { shader: shaders::FOLLOW, name: "follow", constants: &[("HAS_NORMALS", f64::from(has_normals))] };
        let read = [&bound, &normals.surface.positions, &normals.surface.normals].map(Bind::Read);
        let binds = read.into_iter().chain([&positions, &render_normals].map(Bind::Write)).collect();
        let stage = SubmittedStage::new(gpu, entry, binds, vertices.len());
        BoundMesh { positions, render_normals, has_normals, gpu: gpu.clone(), normals, stage }
    }

    /// Positions of the render mesh's vertices, in its order, for a renderer on the same device (usages `VERTEX`,
    /// `STORAGE`, `COPY_SRC`). Each is a `vec4<f32>`: xyz (m) relative to
    /// [`Deformer::origin`](crate::Deformer::origin), and w = 1.
    #[must_use]
    pub fn positions(&self) -> &wgpu::Buffer {
        &self.positions
    }

    /// Unit normals of the render mesh's vertices, if it was bound [with normals](crate::Binding::with_normals): as the positions,
    /// with w = 0.
    #[must_use]
    pub fn normals(&self) -> Option<&wgpu::Buffer> {
        self.has_normals.then_some(&self.render_normals)
    }

    /// Submits the computation of positions and normals after all steps submitted so far, also of the normals of
    /// [`Surface`](crate::Surface). Call it in each frame, and submit the commands that draw them to the same queue, after this call
    /// and before the next one that changes the cloth: a step, `reset`, `restore`, `warp` and so on.
    pub fn apply(&self) {
        SubmittedStage::submit(&self.gpu, &[&self.normals.stage, &self.stage]);
    }
}
