//! Compiled kernels, kept with the device that they belong to.

use std::cell::RefCell;
#[cfg(not(target_arch = "wasm32"))]
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::device::fault::{GpuFault, scoped};
use crate::device::{Gpu, IN_BROWSER};

/// Number of kernels that are kept although nothing uses them any more, since the next cloth is likely to use them again.
const KEPT: usize = 256;

/// The source of a shader, with a unique name. It is kept in parts, one after another, because shaders share files and a
/// program would contain these once for each.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shader {
    pub name: &'static str,
    pub source: &'static [&'static str],
}

impl Shader {
    /// An entry point without constants.
    pub(crate) fn entry(self, name: &'static str) -> Entry<'static> {
        Entry { shader: self, name, constants: &[] }
    }
}

/// An entry point of a shader, with the values of its overridable constants.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry<'a> {
    pub shader: Shader,
    pub name: &'static str,
    pub constants: &'a [(&'static str, f64)],
}

/// The kernels in use, and those used last before: compiling takes longer than everything else that a small cloth needs.
pub(super) type Pipelines = Mutex<Vec<Pipeline>>;

/// A shader, parsed when the first of its entry points is compiled.
#[derive(Debug)]
struct Module {
    shader: Shader,
    parsed: OnceLock<wgpu::ShaderModule>,
}

/// A kernel. All that a step needs are compiled at the same time, each by whichever thread is free first.
#[derive(Debug, Clone)]
pub(crate) struct Pipeline(Arc<Compilation>);

#[derive(Debug)]
struct Compilation {
    device: wgpu::Device,
    module: Arc<Module>,
    name: &'static str,
    constants: Vec<(&'static str, f64)>,
    layout: wgpu::PipelineLayout,
    compiled: OnceLock<(wgpu::ComputePipeline, Option<GpuFault>)>,
}

thread_local! {
    /// The pipelines that [`Gpu::checked`] has yet to wait for on this thread.
    pub(super) static PENDING: RefCell<Vec<Pipeline>> = const { RefCell::new(Vec::new()) };
}

impl Gpu {
    /// The pipeline of an entry point. It is being compiled if this is its first use; [`Gpu::checked`] waits for it and returns
    /// its errors.
    pub(crate) fn pipeline(&self, entry: Entry<'_>, layouts: [&wgpu::BindGroupLayout; 2]) -> Pipeline {
        let Entry { shader, name, constants } = entry;
        let mut pipelines = self.0.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        // What failed for want of memory may succeed the next time. Kernels whose constants depend on a mesh add up.
        let is_unused = |made: &Pipeline| Arc::strong_count(&made.0) == 1;
        let mut beyond = pipelines.iter().filter(|made| is_unused(made)).count().saturating_sub(KEPT);
        pipelines.retain(|made| {
            let is_old = beyond > 0 && is_unused(made);
            beyond -= usize::from(is_old);
            !(made.has_failed() || is_old)
        });
        let mut of_shader = pipelines.iter().filter(|made| made.0.module.shader.name == shader.name);
        let same = of_shader.clone().find(|made| made.0.name == name && made.0.constants == constants).cloned();
        let module = of_shader.next().map(|made| Arc::clone(&made.0.module));
        let pipeline = same.unwrap_or_else(|| {
            let bind_group_layouts = &layouts.map(Some);
            let layout = wgpu::PipelineLayoutDescriptor { label: Some(name), bind_group_layouts, immediate_size: 0 };
            let made = Pipeline(Arc::new(Compilation {
                device: self.device().clone(),
                module: module.unwrap_or_else(|| Arc::new(Module { shader, parsed: OnceLock::new() })),
                name,
                constants: constants.to_vec(),
                layout: self.device().create_pipeline_layout(&layout),
                compiled: OnceLock::new(),
            }));
            // A browser has one thread, and compiles in the background itself.
            #[cfg(not(target_arch = "wasm32"))]
            {
                let pipeline = made.clone();
                // A panic here would end the process. Whoever waits for the pipeline compiles it then, and hears of it.
                rayon::spawn(move || _ = catch_unwind(AssertUnwindSafe(|| _ = pipeline.get())));
            }
            pipelines.push(made.clone());
            made
        });
        // What has failed by now is waited for as well, because its error has to be returned.
        if !IN_BROWSER && !pipeline.has_succeeded() {
            PENDING.with_borrow_mut(|pending| pending.push(pipeline.clone()));
        }
        pipeline
    }
}

impl Pipeline {
    /// Waits for the pipelines that this thread asked for. Returns the first error.
    pub(super) fn finish_all() -> Option<GpuFault> {
        if IN_BROWSER {
            return None;
        }
        PENDING.take().iter().map(|pipeline| pipeline.0.compiled().1.clone()).fold(None, Option::or)
    }

    fn has_failed(&self) -> bool {
        self.0.compiled.get().is_some_and(|(_, fault)| fault.is_some())
    }

    fn has_succeeded(&self) -> bool {
        self.0.compiled.get().is_some_and(|(_, fault)| fault.is_none())
    }

    /// The compiled pipeline.
    pub(crate) fn get(&self) -> &wgpu::ComputePipeline {
        &self.0.compiled().0
    }
}

impl Compilation {
    /// The pipeline, compiled by this thread unless another one has begun to.
    fn compiled(&self) -> &(wgpu::ComputePipeline, Option<GpuFault>) {
        self.compiled.get_or_init(|| {
            scoped(&self.device, || {
                self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(self.name),
                    layout: Some(&self.layout),
                    module: self.module.parsed(&self.device),
                    entry_point: Some(self.name),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants: &self.constants,
                        // No result of a kernel depends on workgroup memory that it has not written.
                        zero_initialize_workgroup_memory: false,
                    },
                    cache: None,
                })
            })
        })
    }
}

impl Module {
    fn parsed(&self, device: &wgpu::Device) -> &wgpu::ShaderModule {
        self.parsed.get_or_init(|| {
            let source = wgpu::ShaderSource::Wgsl(self.shader.source.concat().into());
            device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(self.shader.name), source })
        })
    }
}

#[cfg(test)]
#[path = "../../tests/unit/device_pipelines.rs"]
mod tests;
