//! Failures of a GPU: it may refuse a request, run out of memory, or be lost. All are reported as errors, and the
//! program continues.
#![cfg(feature = "gpu")]

mod common;

use std::sync::Arc;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{
    Attributes, Backend, BuildError, Collider, Contact, Deformer, Fabric, Gpu, Levels, Mesh, Options, Quality, StepError,
};
use common::{FRAME, device, rms};

fn on(gpu: &Gpu, backend: Backend) -> Options {
    Options { backend, gpu: Some(gpu.clone()), pinned: vec![0], quality: Quality::Substeps(2), ..Options::default() }
}

fn air() -> Attributes {
    Attributes { air_density: 1.2, wind: Vec3::X, ..Attributes::default() }
}

/// Asserts that a step, or one of the next, fails.
fn failing(deformer: &mut Deformer) -> StepError {
    (0..24).find_map(|_| deformer.step(FRAME, &air()).err()).expect("it is said within sixteen steps")
}

/// A GPU's steps return before they are done, so they cannot be fitted into a time.
#[test]
fn a_gpu_has_no_budget() {
    let budget = Quality::Budget(1.0);
    let mesh = Mesh::grid(4, 4, 1.0, 1.0);
    let refused = |error: Option<BuildError>| {
        assert!(matches!(&error, Some(BuildError::Value { name, .. }) if name == "quality: Budget"), "{error:?}");
    };
    let options = Options { backend: Backend::Gpu, ..Options::default() };
    refused(Deformer::new(&mesh, Options { quality: budget, ..options.clone() }).err());
    refused(Deformer::new(&mesh, options).unwrap().set_quality(budget).err());
}

/// Nothing else waits for the GPU here, which is slow.
#[test]
fn an_instability_is_told_within_sixteen_steps() {
    let mesh = Mesh::grid(100, 100, 1.0, 1.0);
    let options = Options { backend: Backend::Gpu, quality: Quality::Substeps(40), pinned: vec![0, 99], ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    cloth.step(FRAME, &common::gale(&Attributes::default())).unwrap();
    let told = (1..=40).find(|_| cloth.step(FRAME, &Attributes::default()).is_err());
    assert!(told.is_some_and(|step| step <= 16), "told after {told:?} steps");
}

/// Positions that were requested after a step failed are not there for an engine that was made anew meanwhile.
#[test]
fn a_request_after_a_failure_is_dropped_with_it() {
    let mesh = Mesh::grid(40, 40, 1.0, 1.0);
    let options = Options { backend: Backend::Gpu, pinned: vec![0, 39], quality: Quality::Substeps(2), ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    cloth.step(FRAME, &Attributes::default()).unwrap();
    let good = cloth.positions().unwrap().to_vec();
    cloth.step(FRAME, &common::gale(&Attributes::default())).unwrap();
    cloth.request_positions().unwrap();
    let error = cloth.positions().map(|_| ()).unwrap_err();
    assert!(matches!(error, StepError::Unstable { .. }), "{error}");
    cloth.set_pinned(vec![0]).unwrap();
    assert!(cloth.requested_positions().unwrap().is_none());
    assert!(cloth.positions().unwrap() == good, "as it was before the step that failed");
    cloth.step(FRAME, &Attributes::default()).unwrap();
    cloth.request_positions().unwrap();
}

#[test]
fn a_lost_device_is_named_and_others_go_on() {
    let (lost, sound) = (device("the first", |_| ()), device("the second", |_| ()));
    let mesh = Mesh::grid(12, 12, 1.0, 1.0);
    let build = |gpu: &Gpu, backend| Deformer::new(&mesh, on(gpu, backend)).unwrap();
    let [mut read, mut stepped, mut waited, mut asked, mut arrived, mut drawn] = [(); 6].map(|()| build(&lost, Backend::Gpu));
    let [mut mixed, mut set_back, mut idle] = [(); 3].map(|()| build(&lost, Backend::Hybrid));
    let [mut other, mut twin] = [(); 2].map(|()| build(&sound, Backend::Gpu));
    for deformer in [&mut read, &mut stepped, &mut waited, &mut asked, &mut mixed, &mut set_back, &mut other, &mut twin] {
        deformer.step(FRAME, &air()).unwrap();
    }
    let before = mixed.positions().unwrap().to_vec();
    arrived.step(FRAME, &air()).unwrap();
    arrived.request_positions().unwrap();
    arrived.wait().unwrap();
    drawn.surface().unwrap();
    lost.device().destroy();

    let named = |error: StepError| {
        assert_eq!(error, StepError::GpuLost { gpu: "the first".to_owned() });
        assert!(error.to_string().contains("make a new Deformer"), "{error}");
    };
    named(read.positions().unwrap_err());
    named(failing(&mut stepped));
    named(stepped.step(FRAME, &air()).unwrap_err());
    named(waited.wait().unwrap_err());
    let late = asked.request_positions().and_then(|()| asked.requested_positions().map(|_| ()));
    named(late.unwrap_err());
    named(arrived.requested_positions().map(|_| ()).unwrap_err());
    named(drawn.surface().map(|_| ()).unwrap_err());
    named(failing(&mut mixed));
    assert_eq!(mixed.positions().unwrap(), before, "its state is in memory, and as it was");
    // It must not send the new state through memory that went with the device.
    set_back.reset();
    named(failing(&mut set_back));
    assert_eq!(set_back.positions().unwrap(), mesh.positions);
    // Without forces the hybrid engine does not use its device.
    idle.step(FRAME, &Attributes::default()).unwrap();
    // No call panics after the device is lost.
    let _ = (read.surface(), read.measure(), read.velocities());
    read.reset();

    let together = Deformer::step_all([(&mut read, &air()), (&mut other, &air())], FRAME);
    assert!(together[1].is_ok(), "{together:?}");
    twin.step(FRAME, &air()).unwrap();
    for _ in 0..3 {
        [&mut other, &mut twin].into_iter().for_each(|one| drop(one.step(FRAME, &air()).unwrap()));
    }
    assert_eq!(other.positions().unwrap(), twin.positions().unwrap(), "the other device is unharmed");

    for backend in [Backend::Gpu, Backend::Hybrid] {
        let error = Deformer::new(&mesh, on(&lost, backend)).unwrap_err();
        assert!(matches!(&error, BuildError::GpuLost { gpu, .. } if gpu == "the first"), "{error}");
    }
    // Large enough for `Auto` to choose a GPU.
    let auto = Deformer::new(&Mesh::grid(130, 130, 1.0, 1.0), on(&lost, Backend::Auto)).unwrap();
    assert_eq!(auto.backend(), Backend::Cpu);
}

/// A software driver is slower than the CPU for any cloth, also where it is what the caller has.
#[test]
fn auto_takes_no_software_driver() {
    let gpu = device("any", |_| ());
    let is_software = gpu.device().adapter_info().device_type == wgpu::DeviceType::Cpu;
    let large = Deformer::new(&Mesh::grid(128, 128, 1.0, 1.0), on(&gpu, Backend::Auto)).unwrap();
    assert_eq!(large.backend(), if is_software { Backend::Cpu } else { Backend::Gpu });
}

/// What a device lacks is said when a cloth is made, not in its first step.
#[test]
fn a_device_with_small_limits_is_refused_by_name() {
    type Lower = fn(&mut wgpu::Limits);
    let (mesh, contact) = (Mesh::grid(12, 12, 1.0, 1.0), Some(Contact::default()));
    let lowered: [(&str, Option<Contact>, Lower); 6] = [
        ("max_compute_invocations_per_workgroup", contact, |limits| limits.max_compute_invocations_per_workgroup = 128),
        ("max_compute_workgroup_size_x", contact, |limits| limits.max_compute_workgroup_size_x = 128),
        ("max_uniform_buffers_per_shader_stage", None, |limits| limits.max_uniform_buffers_per_shader_stage = 2),
        ("max_dynamic_uniform_buffers_per_pipeline_layout", None, |limits| {
            limits.max_dynamic_uniform_buffers_per_pipeline_layout = 1;
        }),
        ("max_uniform_buffer_binding_size", None, |limits| limits.max_uniform_buffer_binding_size = 128),
        ("max_bind_groups", None, |limits| limits.max_bind_groups = 1),
    ];
    for (name, contact, lower) in lowered {
        let small = device("a small one", lower);
        let options = Options { contact, ..on(&small, Backend::Gpu) };
        let error = Deformer::new(&mesh, options).unwrap_err();
        assert!(matches!(error, BuildError::GpuLimit { limit, .. } if limit == name), "{name}: {error}");
    }
    // A mesh collider that comes later needs as much as contact.
    let small = device("a small one", |limits| limits.max_compute_invocations_per_workgroup = 128);
    let mut cloth = Deformer::new(&mesh, on(&small, Backend::Gpu)).unwrap();
    let body = Attributes { colliders: vec![Collider::mesh(Arc::new(mesh.clone()))], ..Attributes::default() };
    let error = cloth.step(FRAME, &body).unwrap_err();
    assert!(matches!(error, StepError::GpuLimit { limit: "max_compute_invocations_per_workgroup", .. }), "{error}");
    cloth.step(FRAME, &Attributes::default()).unwrap();
}

/// A device with no more than what is asked for suffices.
#[test]
fn the_least_device_suffices() {
    let least = device("the least", |limits| {
        limits.max_uniform_buffers_per_shader_stage = 3;
        limits.max_dynamic_uniform_buffers_per_pipeline_layout = 2;
        limits.max_uniform_buffer_binding_size = 4096;
        limits.max_bind_groups = 2;
        limits.max_bindings_per_bind_group = 18;
        limits.max_compute_invocations_per_workgroup = 256;
        limits.max_compute_workgroup_size_x = 256;
    });
    let mesh = Mesh::grid(24, 24, 1.0, 1.0);
    for contact in [None, Some(Contact::default())] {
        let fabric = Fabric { bending: 1e-5, damping: 0.01, ..Fabric::default() };
        let options = Options { contact, fabric, levels: Levels::Count(2), ..on(&least, Backend::Gpu) };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        cloth.step(FRAME, &air()).unwrap();
        assert!(cloth.positions().unwrap().iter().all(|x| x.is_finite()));
        assert!(cloth.surface().unwrap().is_some());
    }
}

#[test]
fn a_buffer_beyond_a_limit_is_refused_by_name() {
    let small = device("a small one", |limits| limits.max_storage_buffer_binding_size = 1 << 20);
    let mesh = Mesh::grid(200, 200, 1.0, 1.0);
    for backend in [Backend::Gpu, Backend::Hybrid] {
        let error = Deformer::new(&mesh, on(&small, backend)).unwrap_err();
        println!("{error}");
        let BuildError::GpuLimit { needed, limit, allowed, .. } = error else { panic!("{error}") };
        // A vertex takes 96 bytes for the moments of bending in several passes.
        assert_eq!((needed, limit, allowed), (96 * 40_000, "max_storage_buffer_binding_size", 1 << 20));
        let said = error.to_string();
        assert!(["3840000", "1048576", limit, "split the mesh", "CPU"].iter().all(|part| said.contains(part)), "{said}");
    }
    let mut auto = Deformer::new(&mesh, on(&small, Backend::Auto)).unwrap();
    assert_eq!(auto.backend(), Backend::Cpu);
    auto.step(FRAME, &Attributes::default()).unwrap();
    // The same device still serves requests that fit.
    let fits = Mesh::grid(20, 20, 1.0, 1.0);
    Deformer::new(&fits, on(&small, Backend::Gpu)).unwrap().step(FRAME, &Attributes::default()).unwrap();

    let poor = device("a poor one", |limits| limits.max_storage_buffers_per_shader_stage = 4);
    let error = Deformer::new(&fits, on(&poor, Backend::Gpu)).unwrap_err();
    let BuildError::GpuLimit { needed: 8, limit, allowed: 4, .. } = error else { panic!("{error}") };
    assert_eq!(limit, "max_storage_buffers_per_shader_stage");
}

/// What only some steps need is refused by those steps: ten thousand colliders at 64 bytes each.
#[test]
fn what_a_step_is_the_first_to_need_may_be_too_much() {
    let small = device("a small one", |limits| limits.max_storage_buffer_binding_size = 1 << 18);
    let mesh = Mesh::grid(20, 20, 1.0, 1.0);
    let [mut deformer, mut bare] = [(); 2].map(|()| Deformer::new(&mesh, on(&small, Backend::Gpu)).unwrap());
    let colliders = (0..10_000).map(|k| Collider::sphere(Vec3::new(0.0, -10.0, k as f32), 0.1)).collect();
    let crowded = Attributes { colliders, ..Attributes::default() };
    let before = {
        deformer.step(FRAME, &Attributes::default()).unwrap();
        deformer.positions().unwrap().to_vec()
    };
    for attributes in [&crowded, &crowded, &Attributes::default()] {
        let error = deformer.step(FRAME, attributes).unwrap_err();
        println!("{error}");
        let StepError::GpuLimit { thing: "bodies", needed, limit, allowed } = error else { panic!("{error}") };
        assert!(needed >= 640_000 && allowed == 1 << 18 && limit == "max_storage_buffer_binding_size", "{error}");
        assert_eq!(deformer.positions().unwrap(), before, "the state is as it was");
    }
    // The refusal does not affect a step that asks for less, alone or beside it.
    let crowd = [(&mut deformer, &crowded), (&mut bare, &Attributes::default())];
    let together = Deformer::step_all(crowd, FRAME);
    assert!(matches!(together[0], Err(StepError::GpuLimit { .. })) && together[1].is_ok(), "{together:?}");
    assert_eq!(bare.positions().unwrap(), before);
}

/// A hundred edges at one vertex need a hundred colors. Every tile's table would have room for them, 554 MB for a sheet
/// of 256 x 256, which most devices refuse. A dispatch per color needs no tables.
#[test]
fn a_vertex_of_a_hundred_edges_is_swept_color_by_color() {
    let n = 70_u32;
    let mut mesh = Mesh::grid(n, n, 1.0, 1.0);
    let (hub, first) = (mesh.positions.len() as u32, mesh.positions.len() as u32 + 1);
    mesh.positions.push(Vec3::new(0.0, 0.1, 0.8));
    for k in 0..100 {
        let angle = k as f32 * 0.06;
        mesh.positions.push(Vec3::new(0.2 * angle.cos(), 0.1, 0.8 + 0.2 * angle.sin()));
        mesh.triangles.extend((k > 0).then_some([hub, first + k - 1, first + k]));
    }
    // The fan is attached to the sheet at one corner.
    mesh.triangles.push([n * n - 1, n * n - 2, first]);
    let small = device("of few bytes", |limits| limits.max_storage_buffer_binding_size = 2 << 20);
    let options = Options { levels: Levels::Off, ..on(&small, Backend::Gpu) };
    let mut deformer = Deformer::new(&mesh, options.clone()).unwrap();
    let mut exact = Deformer::new(&mesh, Options { backend: Backend::Cpu, ..options }).unwrap();
    assert!(exact.colors() >= 100, "{} colors", exact.colors());
    for one in [&mut deformer, &mut exact] {
        (0..2).for_each(|_| drop(one.step(FRAME, &Attributes::default()).unwrap()));
    }
    let dispatches = deformer.dispatches().unwrap();
    assert!(dispatches > 2 * 100, "{dispatches} dispatches: one a color, and more");
    let moved = rms(exact.positions().unwrap(), &mesh.positions);
    let apart = rms(exact.positions().unwrap(), deformer.positions().unwrap());
    assert!(apart <= 2e-5 * moved, "{apart} m apart of {moved} m");
}
