//! The scenes: sheets that hang, swing, lie on each other, fall in heaps, and are twisted.

use std::f32::consts::PI;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Collider, Mesh};

pub(crate) struct Scene {
    pub name: &'static str,
    pub mesh: Mesh,
    pub substeps: u32,
    pub pinned: Vec<u32>,
    pub colliders: Vec<Collider>,
    /// Initial positions, if they are not those of the rest shape.
    pub start: Option<Vec<Vec3>>,
    /// Angle (rad) by which the pins at each end are turned per frame, in opposite directions.
    pub twist: f32,
    /// Number of frames before timing, and of frames that are timed.
    pub frames: [u32; 2],
}

pub(crate) fn scenes() -> Vec<Scene> {
    let floor = Collider::plane(Vec3::ZERO, Vec3::Y);
    let grid = |n: u32| Mesh::grid(n, n, 1.0, 1.0);
    let on_edge = |n: u32| {
        let mut mesh = grid(n);
        let turn = Quat::from_rotation_x(1.5);
        // A grid that is exactly flat would fall without folding.
        for (index, x) in (0_u16..).zip(&mut mesh.positions) {
            *x = turn * *x + Vec3::new(0.0, 0.6, 1e-4 * f32::from(index % 7));
        }
        mesh
    };
    let lying = |n: u32| {
        let (mut mesh, other) = (grid(n), grid(n));
        mesh.positions.iter_mut().for_each(|x| x.y += 0.005);
        let above = |&x: &Vec3| Quat::from_rotation_y(0.1) * x + 0.011 * Vec3::Y;
        mesh.positions.extend(other.positions.iter().map(above));
        mesh.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + n * n)));
        mesh
    };
    // One half is folded over the other.
    let (radius, quarter) = (0.05_f32, 0.5 * PI * 0.05);
    let bent = |x: &Vec3| {
        let (z, y) = match x.z {
            along if along < -quarter => (along + quarter, 0.0),
            along if along > quarter => (quarter - along, 2.0 * radius),
            along => {
                let (sin, cos) = ((along + quarter) / radius).sin_cos();
                (radius * sin, radius * (1.0 - cos))
            }
        };
        Vec3::new(x.x, 0.02 + y, z)
    };
    let fold = Some(grid(40).positions.iter().map(bent).collect());
    let row = |n: u32| (0..n).collect();
    vec![
        Scene {
            name: "hangs, 64",
            mesh: grid(64),
            substeps: 40,
            pinned: row(64),
            colliders: vec![],
            start: None,
            twist: 0.0,
            frames: [120, 60],
        },
        Scene {
            name: "swings, 64",
            mesh: grid(64),
            substeps: 40,
            pinned: row(64),
            colliders: vec![],
            start: None,
            twist: 0.0,
            frames: [1, 24],
        },
        Scene {
            name: "two lie, 32",
            mesh: lying(32),
            substeps: 20,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: None,
            twist: 0.0,
            frames: [60, 30],
        },
        Scene {
            name: "fold, 40",
            mesh: grid(40),
            substeps: 20,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: fold,
            twist: 0.0,
            frames: [1, 60],
        },
        Scene {
            name: "heap, 32",
            mesh: on_edge(32),
            substeps: 20,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: None,
            twist: 0.0,
            frames: [20, 70],
        },
        Scene {
            name: "heap, 64",
            mesh: on_edge(64),
            substeps: 40,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: None,
            twist: 0.0,
            frames: [20, 30],
        },
    ]
}

/// Scenes that are large enough for a GPU.
pub(crate) fn large() -> Vec<Scene> {
    let floor = Collider::plane(Vec3::ZERO, Vec3::Y);
    let falling = |n: u32, height: f32| {
        let mut mesh = Mesh::grid(n, n, 1.2, 1.2);
        mesh.positions.iter_mut().for_each(|x| x.y += height);
        mesh
    };
    let stack = |n: u32| {
        let mut mesh = Mesh::default();
        for sheet in 0..10_u32 {
            let (one, first) = (Mesh::grid(n, n, 1.0, 1.0), mesh.positions.len() as u32);
            let turn = Quat::from_rotation_y(0.1 * sheet as f32);
            mesh.positions.extend(one.positions.iter().map(|&x| turn * x + Vec3::Y * (0.008 * (sheet + 1) as f32)));
            mesh.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
        }
        mesh
    };
    let twisted = |n: u32| Scene {
        name: if n == 50 { "twist, 50" } else { "twist, 100" },
        mesh: Mesh::grid(n, n, 1.0, 1.0),
        substeps: 40,
        pinned: (0..n).flat_map(|row| [row * n, row * n + n - 1]).collect(),
        colliders: vec![],
        start: None,
        twist: PI / 180.0,
        frames: [120, 180],
    };
    let drape = |name, height, frames| Scene {
        name,
        mesh: falling(128, height),
        substeps: 20,
        pinned: vec![],
        colliders: vec![Collider::sphere(0.3 * Vec3::Y, 0.3), floor.clone()],
        start: None,
        twist: 0.0,
        frames,
    };
    let mut all = vec![
        drape("drape, 128, falling", 2.2, [4, 26]),
        drape("drape, 128, folding", 0.62, [5, 20]),
        drape("drape, 128, at rest", 0.62, [150, 60]),
        Scene {
            name: "stack of 10, 64",
            mesh: stack(64),
            substeps: 40,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: None,
            twist: 0.0,
            frames: [60, 60],
        },
        twisted(50),
        twisted(100),
    ];
    all.extend(scenes());
    all
}

impl Scene {
    /// The pins' positions in a frame, if they move.
    pub(crate) fn targets(&self, frame: u32) -> Option<Vec<Vec3>> {
        let turned = |&pin: &u32| {
            let x = self.mesh.positions[pin as usize];
            Quat::from_rotation_x(self.twist * frame as f32 * x.x.signum()) * x
        };
        (self.twist > 0.0).then(|| self.pinned.iter().map(turned).collect())
    }
}
