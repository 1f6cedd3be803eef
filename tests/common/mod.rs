//! Shared by the test files: scenes, the f64 reference, and the list of backends.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

pub mod chain;
pub mod contact_scene;
pub mod crossings;
pub mod energy;
pub mod hang;
pub mod meshes;
pub mod plain_xpbd;
pub mod reference;
pub mod shapes;

#[allow(unused_imports, reason = "each test file uses its own part")]
pub use hang::{grid_masses, hang, top};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer};
#[cfg(feature = "gpu")]
use cloth_deformer::{Gpu, wgpu};

/// The duration of a frame (s).
pub const FRAME: f32 = 1.0 / 60.0;

/// The bits of the positions and velocities.
pub fn bits(deformer: &mut Deformer) -> Vec<[u32; 6]> {
    let x = deformer.positions().unwrap().to_vec();
    let v = deformer.velocities().unwrap();
    x.iter().zip(v).map(|(x, v)| [x.x, x.y, x.z, v.x, v.y, v.z].map(f32::to_bits)).collect()
}

/// Attributes with a wind whose force exceeds single precision: no step can be taken with it.
pub fn gale(attributes: &Attributes) -> Attributes {
    Attributes { wind: Vec3::splat(1e15), air_density: 1e30, ..attributes.clone() }
}

/// A device of the caller's own, with wgpu's default limits after a `change`.
#[cfg(feature = "gpu")]
pub fn device(name: &str, change: impl FnOnce(&mut wgpu::Limits)) -> Gpu {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
    let mut required_limits = wgpu::Limits::default();
    change(&mut required_limits);
    let descriptor = wgpu::DeviceDescriptor { required_limits, ..wgpu::DeviceDescriptor::default() };
    let (device, queue) = pollster::block_on(adapters[0].request_device(&descriptor)).expect("every adapter has as little");
    Gpu::new(device, queue, name.to_owned())
}

/// Steps `frames` frames of 1/60 s.
pub fn play(deformer: &mut Deformer, frames: u32, attributes: &Attributes) {
    for _ in 0..frames {
        deformer.step(FRAME, attributes).expect("the step succeeds");
    }
}

/// Root mean square distance (m) over vertices.
pub fn rms(a: &[Vec3], b: &[Vec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.as_dvec3().distance_squared(b.as_dvec3())).sum();
    (sum / a.len() as f64).sqrt()
}

/// Makes a test of each function for each backend, named `backend::function`. To test the CPU alone, build without the
/// `gpu` feature; with it, these tests fail on a machine without an adapter.
#[macro_export]
macro_rules! on_every_backend {
    ($($test:ident),+ $(,)?) => {
        mod cpu {
            $(#[test] fn $test() { super::$test(cloth_deformer::Backend::Cpu); })+
        }
        #[cfg(feature = "gpu")]
        mod hybrid {
            $(#[test] fn $test() { super::$test(cloth_deformer::Backend::Hybrid); })+
        }
        #[cfg(feature = "gpu")]
        mod gpu {
            $(#[test] fn $test() { super::$test(cloth_deformer::Backend::Gpu); })+
        }
    };
}

/// The CPU, or the GPU with `CLOTH_BACKEND=gpu`.
pub fn backend_by_name() -> Backend {
    match std::env::var("CLOTH_BACKEND").as_deref() {
        Err(_) | Ok("cpu") => Backend::Cpu,
        Ok("gpu") => Backend::Gpu,
        Ok(other) => panic!("CLOTH_BACKEND={other}; give cpu or gpu"),
    }
}
