//! The `flag` example's picture, drawn from the deformer's buffers, compared with positions projected and rasterized
//! here.
#![cfg(feature = "gpu")]

use cloth_deformer::glam::{Vec2, Vec3, Vec4};
use cloth_deformer::{Backend, Deformer, Gpu, wgpu};

#[allow(dead_code, reason = "the example writes files, the test does not")]
#[path = "../examples/flag/render.rs"]
mod render;
#[path = "../examples/flag/scene.rs"]
mod scene;

type Failure = Box<dyn std::error::Error>;

const SIZE: [u32; 2] = [360, 240];

fn device() -> Gpu {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).unwrap();
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
    Gpu::new(device, queue, "the test's".to_owned())
}

/// What is visible at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cloth {
    None,
    Red,
    Teal,
    Cream,
}

/// The nearest part of the flag at the center of each pixel, from projecting and rasterizing its triangles, and the
/// cosine between the sun and the normal of the visible side.
fn expected(positions: &[Vec3]) -> Vec<(Cloth, f32)> {
    let [width, height] = SIZE.map(|side| side as usize);
    let mesh = scene::mesh();
    let uv = scene::uv(&mesh);
    let camera = scene::camera(width as f32 / height as f32);
    let clip: Vec<Vec4> = positions.iter().map(|x| camera * x.extend(1.0)).collect();
    let pixel = |c: Vec4| Vec2::new((0.5 + 0.5 * c.x / c.w) * width as f32, (0.5 - 0.5 * c.y / c.w) * height as f32);
    let flat = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a);
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in &mesh.triangles {
        let normal = flat(triangle.map(|vertex| positions[vertex as usize]));
        triangle.iter().for_each(|&vertex| normals[vertex as usize] += normal);
    }
    let mut nearest = vec![(0.0, Cloth::None, 0.0); width * height];
    for triangle in &mesh.triangles {
        let corners = triangle.map(|vertex| clip[vertex as usize]);
        let [a, b, c] = corners.map(pixel);
        let area = (b - a).perp_dot(c - a);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        for row in low.y.floor() as usize..=high.y.ceil() as usize {
            for column in low.x.floor() as usize..=high.x.ceil() as usize {
                let at = Vec2::new(column as f32 + 0.5, row as f32 + 0.5);
                let share = [(b - at).perp_dot(c - at), (c - at).perp_dot(a - at), (a - at).perp_dot(b - at)].map(|s| s / area);
                if row >= height || column >= width || share.iter().any(|&share| share < 0.0) {
                    continue;
                }
                // 1/w and uv/w are linear on the screen.
                let weight = [0, 1, 2].map(|k| share[k] / corners[k].w);
                let nearness: f32 = weight.iter().sum();
                if nearness > nearest[row * width + column].0 {
                    let uv = (0..3).map(|k| uv[triangle[k] as usize] * weight[k]).sum::<Vec2>() / nearness;
                    let field = if uv.x > 1.5 * uv.y { Cloth::Teal } else { Cloth::Red };
                    let kind = if uv.distance(Vec2::new(0.75, 0.5)) < 0.27 { Cloth::Cream } else { field };
                    let normal = (0..3).map(|k| normals[triangle[k] as usize].normalize() * weight[k]).sum::<Vec3>().normalize();
                    let facing = normal.dot(render::SUN.normalize());
                    // The y of pixels points down, so what is counter-clockwise in the world is clockwise here.
                    nearest[row * width + column] = (nearness, kind, if area < 0.0 { facing } else { -facing });
                }
            }
        }
    }
    nearest.into_iter().map(|(_, kind, facing)| (kind, facing)).collect()
}

/// Classifies a pixel of the picture by its hue; `empty` is the picture without a flag.
fn found(picture: &[u8], empty: &[u8]) -> Vec<Cloth> {
    let kind = |(pixel, sky): (&[u8], &[u8])| {
        let [r, g, _, alpha] = [0, 1, 2, 3].map(|k| f32::from(pixel[k]));
        assert_eq!(alpha, 255.0);
        match () {
            () if pixel.iter().zip(sky).all(|(a, b)| a.abs_diff(*b) <= 2) => Cloth::None,
            () if r > 1.7 * g => Cloth::Red,
            () if g > 1.25 * r => Cloth::Teal,
            () => Cloth::Cream,
        }
    };
    picture.chunks_exact(4).zip(empty.chunks_exact(4)).map(kind).collect()
}

/// Asserts that picture and projection agree away from borders, and that enough is visible. Returns how well the
/// brightness of sunlit parts follows the cosine (Pearson's correlation).
fn agree(positions: &[Vec3], flag: &mut Deformer, painter: &render::Painter) -> f32 {
    let [width, height] = SIZE.map(|side| side as usize);
    let (picture, empty) = (painter.paint(Some(flag)).unwrap(), painter.paint(None).unwrap());
    assert_eq!(picture.len(), 4 * width * height);
    let (expected, found) = (expected(positions), found(&picture, &empty));
    let (mut compared, mut apart) = ([0; 4], 0);
    let mut lit: Vec<[f32; 2]> = Vec::new();
    for row in 1..height - 1 {
        for column in 1..width - 1 {
            let (kind, facing) = expected[row * width + column];
            let around = (row - 1..=row + 1).flat_map(|row| (column - 1..=column + 1).map(move |column| row * width + column));
            if around.clone().all(|pixel| expected[pixel].0 == kind) {
                compared[kind as usize] += 1;
                apart += usize::from(found[row * width + column] != kind);
                if kind == Cloth::Red && facing > 0.0 {
                    // Approximately linear light.
                    lit.push([facing, (f32::from(picture[4 * (row * width + column)]) / 255.0).powf(2.2)]);
                }
            }
        }
    }
    let correlation = correlation(&lit);
    println!("compared {compared:?}, of these apart {apart}; light follows the cosine by {correlation}");
    assert!(compared.iter().all(|&count| count > 500), "too little to see: {compared:?}");
    assert!(apart <= compared.iter().sum::<usize>() / 1000, "{apart} pixels of {compared:?} are not as projected");
    correlation
}

/// Pearson's correlation coefficient.
fn correlation(pairs: &[[f32; 2]]) -> f32 {
    let mean = [0, 1].map(|k| pairs.iter().map(|pair| pair[k]).sum::<f32>() / pairs.len() as f32);
    let product = |i: usize, j: usize| pairs.iter().map(|pair| (pair[i] - mean[i]) * (pair[j] - mean[j])).sum::<f32>();
    product(0, 1) / (product(0, 0) * product(1, 1)).sqrt()
}

#[test]
fn a_flag_in_the_wind_is_drawn_where_the_cpu_has_it() -> Result<(), Failure> {
    let gpu = device();
    let mut flag = scene::flag(Backend::Gpu, Some(gpu.clone()))?;
    let mut twin = scene::flag(Backend::Cpu, None)?;
    for frame in 0..16 {
        let air = scene::air(frame as f32 * scene::FRAME);
        flag.step(scene::FRAME, &air)?;
        twin.step(scene::FRAME, &air)?;
    }
    let painter = render::Painter::new(&gpu, SIZE);
    let shaded = agree(twin.positions()?, &mut flag, &painter);
    assert!(shaded > 0.95, "light follows the sun's cosine by {shaded} only");
    Ok(())
}

/// Folded over itself in front and, farther away, behind: nearer parts hide farther ones.
#[test]
fn a_fold_hides_what_is_behind_it() -> Result<(), Failure> {
    let gpu = device();
    let mut flag = scene::flag(Backend::Gpu, Some(gpu.clone()))?;
    let painter = render::Painter::new(&gpu, SIZE);
    for side in [0.15, -0.15] {
        let fold = |x: &Vec3| if x.x > 0.9 { Vec3::new(1.8 - x.x, x.y, side * (5.0 * (x.x - 0.9)).min(1.0)) } else { *x };
        let folded: Vec<Vec3> = scene::mesh().positions.iter().map(fold).collect();
        flag.set_state(&folded, &vec![Vec3::ZERO; folded.len()])?;
        agree(&folded, &mut flag, &painter);
    }
    Ok(())
}
