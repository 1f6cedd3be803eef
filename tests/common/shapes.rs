//! Meshes for contact: cloth that meets itself, and bodies made of triangles.

use std::f32::consts::PI;

use cloth_deformer::Mesh;
use cloth_deformer::glam::{Quat, Vec3};

/// Adds noise of up to a tenth of a millimeter, so that no two things are exactly aligned.
pub fn jittered(mut mesh: Mesh, seed: u64) -> Mesh {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut noise = || 2e-4 * (random.f32() - 0.5);
    mesh.positions.iter_mut().for_each(|x| *x += Vec3::new(noise(), noise(), noise()));
    mesh
}

/// Maps a point of a flat sheet to the sheet folded over: one half lies 0.1 m above the other, which lies 2 cm above
/// the ground.
pub fn bent(x: &Vec3) -> Vec3 {
    let (radius, quarter) = (0.05_f32, 0.5 * PI * 0.05);
    let (z, y) = match x.z {
        along if along < -quarter => (along + quarter, 0.0),
        along if along > quarter => (quarter - along, 2.0 * radius),
        along => {
            let (sin, cos) = ((along + quarter) / radius).sin_cos();
            (radius * sin, radius * (1.0 - cos))
        }
    };
    Vec3::new(x.x, 0.02 + y + x.y, z)
}

/// `count` sheets stacked above one another, each rotated slightly.
pub fn sheets(count: u32, n: u32, size: f32, gap: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for sheet in 0..count {
        let (one, first) = (Mesh::grid(n, n, size, size), mesh.positions.len() as u32);
        let turn = Quat::from_rotation_y(0.1 * sheet as f32);
        mesh.positions.extend(one.positions.iter().map(|&x| turn * x + Vec3::Y * (gap * (sheet + 1) as f32)));
        mesh.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    }
    mesh
}

/// An open tube around the y-axis.
pub fn tube(radius: f32, height: f32, around: u32, rows: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for row in 0..rows {
        for step in 0..around {
            let (z, x) = (2.0 * PI * step as f32 / around as f32).sin_cos();
            mesh.positions.push(Vec3::new(radius * x, height * (0.5 - row as f32 / (rows - 1) as f32), radius * z));
        }
    }
    for row in 1..rows {
        for step in 0..around {
            let at = |row: u32, step: u32| row * around + step % around;
            let [p, q, r, s] = [at(row - 1, step), at(row - 1, step + 1), at(row, step), at(row, step + 1)];
            mesh.triangles.extend([[p, q, r], [q, s, r]]);
        }
    }
    mesh
}

/// A ball with poles on the x-axis, divided into `rings` rings.
pub fn ball(center: Vec3, radius: f32, rings: u32) -> Mesh {
    capsule(center, center, radius, rings)
}

/// A capsule from `a` to `b`, which must differ along x only: a ball cut in two halves that are moved apart.
pub fn capsule(a: Vec3, b: Vec3, radius: f32, rings: u32) -> Mesh {
    let around = 2 * rings;
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        let (sin, cos) = (PI * ring as f32 / rings as f32).sin_cos();
        let center = if 2 * ring <= rings { a } else { b };
        for step in 0..around {
            let (y, z) = (2.0 * PI * step as f32 / around as f32).sin_cos();
            mesh.positions.push(center + radius * Vec3::new(-cos, sin * y, sin * z));
        }
    }
    for ring in 0..rings {
        for step in 0..around {
            let at = |ring: u32, step: u32| ring * around + step % around;
            let [p, q, r, s] = [at(ring, step), at(ring, step + 1), at(ring + 1, step), at(ring + 1, step + 1)];
            if ring > 0 {
                mesh.triangles.push([p, r, q]);
            }
            if ring + 1 < rings {
                mesh.triangles.push([q, r, s]);
            }
        }
    }
    mesh
}
