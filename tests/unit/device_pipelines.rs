//! Kernels are compiled on several threads.

use super::*;

/// A kernel without buffers, or one that is no program.
fn entry(source: &'static [&'static str]) -> Entry<'static> {
    Entry { shader: Shader { name: source[0], source }, name: "main", constants: &[] }
}

/// Asks for pipelines, as a stage does.
fn ask(gpu: &Gpu, entries: &[Entry<'_>]) -> Result<Vec<Pipeline>, GpuFault> {
    let layout = wgpu::BindGroupLayoutDescriptor { label: None, entries: &[] };
    gpu.checked(|| {
        let layout = gpu.device().create_bind_group_layout(&layout);
        Ok(entries.iter().map(|&entry| gpu.pipeline(entry, [&layout, &layout])).collect())
    })
}

const ALONE: &[&str] = &["@compute @workgroup_size(2) fn main() ", "{}"];
const GOOD: &[&str] = &["@compute @workgroup_size(1) fn main() ", "{}"];

/// The error of a kernel is returned wherever it is asked for, and harms no other.
#[test]
fn what_cannot_be_compiled_is_an_error() {
    let gpu = Gpu::shared(true).unwrap();
    // Often enough for another thread to have found the error before this one waits for it.
    for _ in 0..200 {
        let Err(GpuFault::Other(reason)) = ask(&gpu, &[entry(GOOD), entry(&["not a shader"])]) else { panic!("it is none") };
        assert!(reason.contains("not a shader"), "{reason}");
    }
    assert!(ask(&gpu, &[entry(GOOD)]).is_ok());
}

/// When the work is done, all that it asked for is compiled, and what was compiled is used again.
#[test]
fn compiled_once() {
    let gpu = Gpu::shared(true).unwrap();
    let [first, again] = [0, 1].map(|_| ask(&gpu, &[entry(GOOD)]).unwrap().remove(0));
    assert!(first.0.compiled.get().is_some(), "it was waited for");
    assert!(Arc::ptr_eq(&first.0, &again.0));
    let other =
        Entry { constants: &[("LANES", 2.0)], ..entry(&["override LANES: u32; @compute @workgroup_size(LANES) fn main() {}"]) };
    assert!(!Arc::ptr_eq(&first.0, &ask(&gpu, &[other]).unwrap()[0].0));
}

/// A thread compiles itself what no other has begun with, so it waits for none that waits for it.
#[test]
fn threads_of_a_pool_do_not_wait_for_each_other() {
    let gpu = Gpu::shared(true).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| ask(&gpu, &[entry(ALONE), entry(GOOD)])).unwrap();
}

/// Of kernels that nothing uses any more, only so many are kept; one that is used stays.
#[test]
fn unused_kernels_do_not_add_up() {
    const NUMBERED: &[&str] = &["override LANES: u32; @compute @workgroup_size(LANES) fn main() ", "{}"];
    let gpu = Gpu::shared(true).unwrap();
    let ask_for = |lanes: u32| {
        let entry = Entry { constants: &[("LANES", lanes.into())], ..entry(NUMBERED) };
        ask(&gpu, &[entry]).unwrap().remove(0)
    };
    let used = ask_for(1);
    (2..KEPT as u32 + 50).for_each(|lanes| drop(ask_for(lanes)));
    // A thread of the pool that has yet to find out that a kernel is compiled uses it, too.
    let are_few = || {
        ask_for(1);
        let pipelines = gpu.0.pipelines.lock().unwrap();
        let is_unused = |made: &&Pipeline| made.0.module.shader.name == NUMBERED[0] && Arc::strong_count(&made.0) == 1;
        pipelines.iter().filter(is_unused).count() <= KEPT
    };
    assert!((0..1000).any(|_| are_few() || {
        std::thread::sleep(std::time::Duration::from_millis(10));
        false
    }));
    assert!(Arc::ptr_eq(&used.0, &ask_for(1).0));
}
