//! Kernels as `pipelines.rs` has them, for a browser: it has one thread, and compiles in the background itself. A page downloads
//! this, so it is as small as possible.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use crate::device::Gpu;
use crate::device::fault::GpuFault;

/// Shader, entry point, and its constants as bits.
type Key = (&'static str, &'static str, Vec<(&'static str, u64)>);

/// The source of a shader, with a unique name. It is kept in parts, one after another, because shaders share files and a
/// program would contain these once for each.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shader {
    pub name: &'static str,
    pub source: &'static [&'static str],
}

/// An entry point of a shader, with the values of its overridable constants.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry<'a> {
    pub shader: Shader,
    pub name: &'static str,
    pub constants: &'a [(&'static str, f64)],
}

/// The kernels compiled so far: compiling takes longer than everything else that a small cloth needs.
pub(super) type Pipelines = Mutex<HashMap<Key, wgpu::ComputePipeline>>;

impl Gpu {
    /// The pipeline of an entry point, compiled on first use.
    pub(crate) fn pipeline(&self, entry: Entry<'_>, layouts: [&wgpu::BindGroupLayout; 2]) -> Pipeline {
        let device = self.device();
        let constants = entry.constants.iter().map(|(name, value)| (*name, value.to_bits())).collect();
        let mut pipelines = self.0.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        let pipeline = pipelines.entry((entry.shader.name, entry.name, constants)).or_insert_with(|| {
            let source = wgpu::ShaderSource::Wgsl(entry.shader.source.concat().into());
            let module = wgpu::ShaderModuleDescriptor { label: Some(entry.shader.name), source };
            let module = device.create_shader_module(module);
            let bind_group_layouts = &layouts.map(Some);
            let layout = wgpu::PipelineLayoutDescriptor { label: Some(entry.name), bind_group_layouts, immediate_size: 0 };
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry.name),
                layout: Some(&device.create_pipeline_layout(&layout)),
                module: &module,
                entry_point: Some(entry.name),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: entry.constants,
                    // Every kernel writes workgroup memory before it reads it.
                    zero_initialize_workgroup_memory: false,
                },
                cache: None,
            })
        });
        Pipeline(pipeline.clone())
    }
}

/// A kernel.
#[derive(Debug, Clone)]
pub(crate) struct Pipeline(wgpu::ComputePipeline);

impl Pipeline {
    /// The browser writes errors to its console.
    pub(super) fn finish_all() -> Option<GpuFault> {
        None
    }

    pub(crate) fn get(&self) -> &wgpu::ComputePipeline {
        &self.0
    }
}
