//! The scenes of the page.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Collider, Fabric, Mesh};

/// Amplitude (m) of the cape wearer's swing, and angular frequencies (1/s) of that swing and of the ball that passes through
/// the curtain.
const SWING: f32 = 0.35;
const RATES: [f32; 2] = [2.2, 1.3];

/// A cloth and its surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Preset {
    Towel,
    Flag,
    Cape,
    Curtain,
}

impl Preset {
    pub(crate) fn named(name: &str) -> Option<Preset> {
        let known = [("towel", Preset::Towel), ("flag", Preset::Flag), ("cape", Preset::Cape), ("curtain", Preset::Curtain)];
        known.into_iter().find(|(known, _)| *known == name).map(|(_, preset)| preset)
    }

    /// The mesh at rest with about `size` vertices per side, and the pinned vertices.
    pub(crate) fn mesh(self, size: u32) -> (Mesh, Vec<u32>) {
        let (columns, rows, width, height) = match self {
            Preset::Towel => (size, size, 1.0, 1.0),
            Preset::Flag => (size * 5 / 4, size * 5 / 6, 1.2, 0.8),
            Preset::Cape => (size * 4 / 5, size, 0.7, 1.0),
            Preset::Curtain => (size * 6 / 5, size, 1.3, 1.1),
        };
        let mut mesh = Mesh::grid(columns, rows, width, height);
        let place = |x: Vec3| match self {
            Preset::Towel => Vec3::new(x.x, 0.8, x.z),
            Preset::Flag => Vec3::new(x.x, 1.1 - x.z, 0.0),
            // Laid around the shoulders.
            Preset::Cape => {
                let angle = x.x / 0.24;
                Vec3::new(
                    0.24 * angle.sin(),
                    1.28 - (x.z + 0.5 * height) * 0.97,
                    -0.24 * angle.cos() - 0.25 * (x.z + 0.5 * height),
                )
            }
            Preset::Curtain => Vec3::new(x.x, 0.8 - x.z, 0.0),
        };
        mesh.positions.iter_mut().for_each(|x| *x = place(*x));
        let pinned = match self {
            Preset::Towel => Vec::new(),
            Preset::Flag => (0..rows).map(|row| row * columns).collect(),
            Preset::Cape => (0..columns).collect(),
            Preset::Curtain => (0..columns).filter(|column| column % 5 == 0 || column + 1 == columns).collect(),
        };
        (mesh, pinned)
    }

    pub(crate) fn fabric(self) -> Fabric {
        match self {
            Preset::Towel => Fabric::TOWEL,
            _ => Fabric::COTTON,
        }
    }

    /// The wind speed (m/s) at the start.
    pub(crate) fn wind(self) -> f32 {
        match self {
            Preset::Towel | Preset::Curtain => 0.0,
            Preset::Flag => 7.0,
            Preset::Cape => 2.0,
        }
    }

    /// Displacement (m) of the pins from their initial positions at `time` (s).
    pub(crate) fn lead(self, time: f32) -> Vec3 {
        match self {
            Preset::Cape => Vec3::X * SWING * (1.0 - (-time).exp()) * (RATES[0] * time).sin(),
            _ => Vec3::ZERO,
        }
    }

    /// The attributes at `time` (s), without the pins, for a wind (m/s) and gravity (m/s²).
    pub(crate) fn attributes(self, time: f32, wind: f32, gravity: f32) -> Attributes {
        let gust = 1.0 + 0.25 * (2.1 * time).sin() + 0.15 * (5.3 * time).sin();
        let way = match self {
            Preset::Flag => Vec3::new(1.0, 0.05 * (3.0 * time).sin(), 0.35 * (4.4 * time).sin()),
            _ => Vec3::new(0.2 * (1.7 * time).sin(), 0.0, -1.0),
        };
        let (colliders, damping) = match self {
            Preset::Towel => {
                let ball = Collider::sphere(Vec3::new(0.0, 0.4, 0.0), 0.25).with_friction(0.3);
                (vec![ball, Collider::plane(Vec3::ZERO, Vec3::Y).with_friction(0.3)], 0.0)
            }
            Preset::Flag => (Vec::new(), 0.0),
            Preset::Cape => {
                let lead = self.lead(time);
                (vec![Collider::capsule(lead + Vec3::Y * 0.3, lead + Vec3::Y * 1.1, 0.2).with_friction(0.2)], 0.1)
            }
            Preset::Curtain => {
                let ball = Vec3::new(0.3, 0.55, 0.7 * (RATES[1] * time).cos());
                (vec![Collider::sphere(ball, 0.18).with_friction(0.1)], 0.1)
            }
        };
        Attributes {
            gravity: Vec3::NEG_Y * gravity,
            wind: way * (wind * gust),
            air_density: if wind > 0.0 { 1.225 } else { 0.0 },
            damping,
            colliders,
            ..Attributes::default()
        }
    }
}
