//! A device provided by the caller, and the buffers that a renderer draws from.
#![cfg(feature = "gpu")]

mod common;

use cloth_deformer::glam::{DVec3, Vec3, Vec4};
use cloth_deformer::{Attributes, Backend, Binding, Collider, Deformer, Fabric, Gpu, Mesh, Options, Quality, wgpu};
use common::{FRAME, device, play, rms};

/// A device as a renderer has it.
fn modest() -> Gpu {
    let gpu = device("the caller's", |_| ());
    assert_eq!(gpu.device().limits().max_storage_buffers_per_shader_stage, 8);
    gpu
}

/// Reads the contents of a buffer.
fn read<T: bytemuck::Pod>(gpu: &Gpu, buffer: &wgpu::Buffer) -> Vec<T> {
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let staging = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: buffer.size(),
        usage,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
    gpu.queue().submit([encoder.finish()]);
    staging.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
    gpu.device().poll(wgpu::PollType::wait_indefinitely()).unwrap();
    bytemuck::pod_collect_to_vec(&staging.get_mapped_range(..).unwrap())
}

/// A crumpled sheet near the origin, with special cases of meshes: a vertex without triangles, a thread, and a triangle
/// too small to see.
fn sheet() -> Mesh {
    let mut mesh = Mesh::grid(13, 11, 1.0, 0.9);
    let wave = |k: usize, f: f32| (k as f32 * f).sin();
    mesh.positions.iter_mut().enumerate().for_each(|(k, x)| *x += 0.02 * Vec3::new(wave(k, 0.7), wave(k, 1.1), wave(k, 1.7)));
    let next = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::Y, Vec3::X, 2.0 * Vec3::X]);
    mesh.triangles.extend([[next + 1, next + 2, next + 2], [0, 0, 1]]);
    mesh.positions.extend([Vec3::ZERO, 1e-11 * Vec3::X, 1e-11 * Vec3::Z].map(|x| x + 2.0 * Vec3::Y));
    mesh.triangles.push([next + 3, next + 5, next + 4]);
    mesh
}

/// Vertex normals from their definition, in double precision, in the mesh's order.
fn normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize].as_dvec3());
        triangle.iter().for_each(|&vertex| sums[vertex as usize] += (b - a).cross(c - a));
    }
    sums.into_iter().map(DVec3::normalize_or_zero).collect()
}

#[test]
fn a_surface_is_the_cloth() {
    let gpu = modest();
    // Far from 0, the buffer holds positions relative to an origin.
    for offset in [Vec3::ZERO, Vec3::splat(5e3)] {
        let mut mesh = sheet();
        mesh.positions.iter_mut().for_each(|x| *x += offset);
        let quality = Quality::Substeps(60);
        let options =
            Options { backend: Backend::Gpu, gpu: Some(gpu.clone()), quality, pinned: vec![0, 12], ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let first = cloth.surface().unwrap().unwrap();
        for frame in 0..3 {
            let surface = cloth.surface().unwrap().unwrap();
            assert_eq!(surface.positions, first.positions, "the same buffers from frame to frame");
            assert_eq!((&surface.normals, &surface.indices), (&first.normals, &first.indices));
            assert_eq!(&surface.positions, cloth.position_buffer().unwrap());

            let order = cloth.vertex_order().to_vec();
            let indices: Vec<[u32; 3]> = read(&gpu, &surface.indices);
            let named: Vec<[u32; 3]> = indices.iter().map(|triangle| triangle.map(|vertex| order[vertex as usize])).collect();
            let whole: Vec<[u32; 3]> = mesh.triangles.iter().copied().filter(|[a, b, c]| a != b && b != c && c != a).collect();
            assert_eq!(named, whole);
            assert_eq!(surface.index_count as usize, 3 * whole.len());

            let (local, found): (Vec<Vec4>, Vec<Vec4>) = (read(&gpu, &surface.positions), read(&gpu, &surface.normals));
            let origin = cloth.origin();
            let positions = cloth.positions().unwrap();
            let mut relative = vec![Vec3::ZERO; positions.len()];
            for (x, &vertex) in local.iter().zip(&order) {
                assert_eq!(x.truncate() + origin, positions[vertex as usize]);
                relative[vertex as usize] = x.truncate();
            }
            let expected = normals(&relative, &mesh.triangles);
            let mut turned = 0.0_f64;
            for (normal, &vertex) in found.iter().zip(&order) {
                let apart = normal.truncate().as_dvec3().distance(expected[vertex as usize]);
                assert!(
                    normal.w == 0.0 && apart <= 1e-5,
                    "frame {frame}, vertex {vertex}: {normal}, {}",
                    expected[vertex as usize]
                );
                turned = turned.max(normal.truncate().as_dvec3().distance(DVec3::Y));
            }
            assert!(turned > 0.1, "nothing but a flat sheet");
            let (lone, small) = (mesh.positions.len() - 6, mesh.positions.len() - 3);
            assert_eq!(expected[lone], DVec3::ZERO);
            assert!(offset != Vec3::ZERO || expected[small].y > 0.99, "{}", expected[small]);
            play(&mut cloth, 4, &Attributes { wind: Vec3::new(1.0, 0.5, 2.0), air_density: 1.2, ..Attributes::default() });
        }
    }
}

/// A finer mesh with a thickness, bound to a sheet that is bent and turned: on the GPU where it is on the CPU.
#[test]
fn a_bound_mesh_is_where_the_cpu_puts_it() {
    let gpu = modest();
    for offset in [Vec3::ZERO, Vec3::new(3.0, -2.0, 1.0)] {
        let mut mesh = Mesh::grid(13, 11, 1.0, 0.9);
        let wave = |k: usize, f: f32| (k as f32 * f).sin();
        mesh.positions.iter_mut().enumerate().for_each(|(k, x)| *x += offset + 0.01 * Vec3::Y * wave(k, 0.7));
        let mut drawn = Mesh::grid(40, 37, 1.02, 0.91);
        drawn.positions.iter_mut().enumerate().for_each(|(k, x)| *x += offset + 0.02 * Vec3::Y * wave(k, 0.37).max(0.0));
        let at_rest: Vec<Vec3> = (0..drawn.positions.len()).map(|k| Vec3::new(wave(k, 0.5), 1.0, wave(k, 0.9))).collect();
        let binding = Binding::with_normals(&drawn, &at_rest, &mesh).unwrap();
        let quality = Quality::Substeps(20);
        let options =
            Options { backend: Backend::Gpu, gpu: Some(gpu.clone()), quality, pinned: vec![0, 12], ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let bound = cloth.bind(&binding).unwrap().unwrap();
        let (mut expected, mut expected_normals) = (drawn.positions.clone(), at_rest.clone());
        for frame in 0..3 {
            bound.apply();
            let found: Vec<Vec4> = read(&gpu, bound.positions());
            let origin = cloth.origin();
            binding.apply(cloth.positions().unwrap(), &mut expected).unwrap();
            assert_eq!(found.len(), expected.len());
            let apart = |(found, expected): (&Vec4, &Vec3)| (found.truncate() + origin).distance(*expected);
            let apart = found.iter().zip(&expected).map(apart).fold(0.0, f32::max);
            assert!(apart <= 4e-6, "frame {frame}: {apart} m apart");
            let found: Vec<Vec4> = read(&gpu, bound.normals().unwrap());
            binding.apply_normals(cloth.positions().unwrap(), &mut expected_normals).unwrap();
            assert_eq!(found.len(), expected_normals.len());
            let apart = |(found, expected): (&Vec4, &Vec3)| found.distance(expected.extend(0.0));
            let apart = found.iter().zip(&expected_normals).map(apart).fold(0.0, f32::max);
            assert!(apart <= 2e-5, "frame {frame}: normals {apart} apart");
            play(&mut cloth, 6, &Attributes { wind: Vec3::new(1.0, 0.5, 2.0), air_density: 1.2, ..Attributes::default() });
        }
        assert!(rms(&expected, &drawn.positions) > 0.02, "the cloth moved");
        let turned = rms(&expected_normals, &at_rest.iter().map(|normal| normal.normalize()).collect::<Vec<_>>());
        assert!(turned > 0.1, "the cloth turned: {turned}");
        // Without normals, the positions are the same.
        let bare = cloth.bind(&Binding::new(&drawn, &mesh).unwrap()).unwrap().unwrap();
        assert!(bare.normals().is_none());
        bare.apply();
        bound.apply();
        assert_eq!(read::<Vec4>(&gpu, bare.positions()), read::<Vec4>(&gpu, bound.positions()));
        // A cloth of another mesh is refused, and one that is not on a GPU has nothing to bind to.
        let other = Deformer::new(&Mesh::grid(3, 3, 1.0, 1.0), Options { backend: Backend::Cpu, ..Options::default() }).unwrap();
        let refused = other.bind(&binding).unwrap_err().to_string();
        assert!(refused.contains("143 vertices") && refused.contains("has 9"), "{refused}");
        let cpu = Deformer::new(&mesh, Options { backend: Backend::Cpu, ..Options::default() }).unwrap();
        assert!(cpu.bind(&binding).unwrap().is_none());
    }
}

#[test]
fn only_a_cloth_on_the_gpu_has_a_surface() {
    for backend in [Backend::Cpu, Backend::Hybrid] {
        let mut cloth = Deformer::new(&Mesh::grid(3, 3, 1.0, 1.0), Options { backend, ..Options::default() }).unwrap();
        assert!(cloth.surface().unwrap().is_none());
    }
    // A single vertex has a surface without triangles.
    let mesh = Mesh { positions: vec![Vec3::ONE], triangles: Vec::new() };
    let mut cloth = Deformer::new(&mesh, Options { backend: Backend::Gpu, ..Options::default() }).unwrap();
    assert_eq!(cloth.surface().unwrap().unwrap().index_count, 0);
}

/// A scene with all features, on both backends that need a device, agrees with the CPU as closely as on a device with
/// higher limits.
#[test]
fn default_limits_are_enough() {
    let gpu = modest();
    let mesh = Mesh::grid(41, 37, 1.0, 0.9);
    let attributes = Attributes {
        wind: Vec3::new(1.0, 0.0, 2.0),
        air_density: 1.2,
        colliders: vec![Collider::sphere(Vec3::new(0.0, -0.32, 0.0), 0.3), Collider::plane(0.5 * Vec3::NEG_Y, Vec3::Y)],
        pin_targets: Some(vec![mesh.positions[0] + 0.02 * Vec3::Y]),
        ..Attributes::default()
    };
    let run = |backend, gpu: Option<&Gpu>| {
        let (fabric, quality) = (Fabric::TOWEL, Quality::Substeps(20));
        let options = Options { backend, fabric, quality, pinned: vec![0], gpu: gpu.cloned(), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        for _ in 0..6 {
            cloth.step(FRAME, &attributes).unwrap();
        }
        assert_eq!(cloth.adapter(), gpu.map(Gpu::name));
        cloth.positions().unwrap().to_vec()
    };
    let cpu = run(Backend::Cpu, None);
    let moved = rms(&cpu, &mesh.positions);
    for backend in [Backend::Hybrid, Backend::Gpu] {
        let apart = rms(&cpu, &run(backend, Some(&gpu)));
        assert!(moved > 0.01 && apart <= 1e-4 * moved, "{backend:?}: {apart} m apart, moved {moved} m");
    }
}
