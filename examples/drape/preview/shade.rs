//! Light and color.

use cloth_deformer::UpAxis;
use cloth_deformer::glam::Vec3;

/// Colors in linear light.
pub(super) const SOLID: Vec3 = Vec3::new(0.16, 0.25, 0.36);
const TILES: [Vec3; 2] = [Vec3::new(0.64, 0.65, 0.67), Vec3::new(0.50, 0.515, 0.54)];
const HORIZON: Vec3 = Vec3::new(0.90, 0.91, 0.93);
const ZENITH: Vec3 = Vec3::new(0.62, 0.69, 0.78);
const SUNLIGHT: Vec3 = Vec3::new(1.04, 1.01, 0.96);
const SKYLIGHT: Vec3 = Vec3::new(0.92, 0.98, 1.08);

/// The shares of the sun's and the sky's light that reach a point, from 0 to 1.
#[derive(Clone, Copy)]
pub(super) struct Reach {
    pub(super) sun: f32,
    pub(super) sky: f32,
}

/// The directions toward the sun and toward the middle of the sky.
#[derive(Clone, Copy)]
pub(super) struct Sky {
    pub(super) sun: Vec3,
    pub(super) up: Vec3,
}

impl Sky {
    pub(super) fn new(up: UpAxis) -> Sky {
        Sky { sun: up.turn(Vec3::new(-0.80, 1.20, 0.72)).normalize(), up: up.turn(Vec3::Y) }
    }

    /// A matte surface lit by the sun, the sky above and light from the ground.
    pub(super) fn surface(self, albedo: Vec3, facing: Vec3, reach: Reach) -> Vec3 {
        let sun = reach.sun * facing.dot(self.sun).max(0.0) * SUNLIGHT;
        let sky = (0.25 + 0.16 * facing.dot(self.up)) * (0.45 + 0.55 * reach.sky) * SKYLIGHT;
        albedo * (sun + sky)
    }

    /// What thin cloth adds to a matte surface: light of the sun behind it that shines through, tinted by the fabric, and a
    /// faint sheen at grazing angles.
    pub(super) fn thin(self, albedo: Vec3, facing: Vec3, to_eye: Vec3, behind: f32) -> Vec3 {
        let through = 0.22 * behind * (-facing.dot(self.sun)).max(0.0) * SUNLIGHT;
        let sheen = 0.07 * (1.0 - facing.dot(to_eye).clamp(0.0, 1.0)).powi(3);
        albedo * (albedo + 0.25) * through + sheen * HORIZON
    }

    /// The highlight of the sun on a smooth surface.
    pub(super) fn gloss(self, facing: Vec3, to_eye: Vec3, reach: Reach) -> Vec3 {
        let half = (to_eye + self.sun).normalize();
        Vec3::splat(0.18 * reach.sun * facing.dot(half).max(0.0).powi(40))
    }
}

/// The background at a height from 0 (bottom) to 1 (top) of the picture.
pub(super) fn backdrop(height: f32) -> Vec3 {
    HORIZON.lerp(ZENITH, height.powf(1.5))
}

/// The color of a checkered plane at `at`. A tile is a third of `radius` wide, the radius of the scene (m) around
/// `middle`.
pub(super) fn checker(middle: Vec3, radius: f32, on: Vec3, normal: Vec3, at: Vec3) -> Vec3 {
    let (u, v) = normal.normalize().any_orthonormal_pair();
    let origin = middle - normal.normalize() * (middle - on).dot(normal.normalize());
    let tile = |axis: Vec3| ((at - origin).dot(axis) * 3.0 / radius).rem_euclid(2.0) < 1.0;
    TILES[usize::from(tile(u) != tile(v))]
}

/// Increases smoothly from 0 at `low` to 1 at `high`.
pub(super) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Converts linear light to 8-bit sRGB (IEC 61966-2-1).
pub(super) fn srgb(linear: Vec3) -> [u8; 3] {
    linear.to_array().map(|x| {
        let x = x.clamp(0.0, 1.0);
        let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (255.0 * encoded).round() as u8
    })
}
