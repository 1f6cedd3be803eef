//! Views of the scene from the camera and the lights, with projection and rasterization.

use std::ops::Range;

use cloth_deformer::glam::{Vec2, Vec3, Vec3Swizzles};

/// Tangent of half the vertical angle of view. The angle is small, so that the perspective changes little during a
/// motion.
const LENS: f32 = 0.22;
/// How near to the camera a triangle is drawn, as a share of the distance of its farthest corner.
const NEAR: f32 = 1e-3;

/// A view: its origin, its axes, and whether it is a perspective or an orthographic projection.
pub(super) struct Frame {
    eye: Vec3,
    right: Vec3,
    up: Vec3,
    back: Vec3,
    /// Half of the view's height (m): at a depth of 1 m in perspective, at every depth otherwise.
    half: f32,
    spreads: bool,
}

impl Frame {
    fn toward(eye: Vec3, back: Vec3, up: Vec3, half: f32, spreads: bool) -> Frame {
        let back = back.normalize();
        let right = up.cross(back).normalize_or(Vec3::X);
        Frame { eye, right, up: back.cross(right), back, half, spreads }
    }

    /// The camera: it looks along `-toward` from the shortest distance at which every point is inside a picture
    /// `aspect` times as wide as high.
    pub(super) fn perspective(points: &[Vec3], toward: Vec3, up: Vec3, aspect: f32) -> Frame {
        const MARGIN: f32 = 1.06;
        let mut frame = Frame::toward(Vec3::ZERO, toward, up, LENS, true);
        let local: Vec<Vec3> =
            points.iter().map(|point| Vec3::new(point.dot(frame.right), point.dot(frame.up), point.dot(frame.back))).collect();
        // A point is inside when |x| <= slope (eye.z - z), so the outermost points determine the plane of each side.
        let side = |slope: f32, axis: fn(&Vec3) -> f32| {
            let most = |sign: f32| local.iter().map(|p| sign * axis(p) + slope * p.z).fold(f32::NEG_INFINITY, f32::max);
            let (high, low) = (most(1.0), most(-1.0));
            (0.5 * (high - low), 0.5 * (high + low) / slope)
        };
        let (x, far_x) = side(LENS * aspect / MARGIN, |p| p.x);
        let (y, far_y) = side(LENS / MARGIN, |p| p.y);
        let nearest = local.iter().map(|p| p.z).fold(f32::NEG_INFINITY, f32::max);
        // Points without extent allow any distance; keep a small one.
        let z = far_x.max(far_y).max(nearest + 1e-3 * (1.0 + nearest.abs()));
        frame.eye = x * frame.right + y * frame.up + z * frame.back;
        frame
    }

    /// A light's view: parallel rays along `-toward` that cover a sphere.
    pub(super) fn parallel(middle: Vec3, radius: f32, toward: Vec3, up: Vec3) -> Frame {
        Frame::toward(middle + 2.0 * radius * toward.normalize(), toward, up, 1.02 * radius, false)
    }

    /// The ray through the center of a sample: its origin, and a direction with a component of 1 m along the view.
    pub(super) fn ray(&self, column: usize, row: usize, width: usize, height: usize) -> (Vec3, Vec3) {
        let pixel = 2.0 * self.half / height as f32;
        let x = (column as f32 + 0.5 - 0.5 * width as f32) * pixel;
        let y = (0.5 * height as f32 - row as f32 - 0.5) * pixel;
        let across = x * self.right + y * self.up;
        if self.spreads { (self.eye, across - self.back) } else { (self.eye + across, -self.back) }
    }

    /// The part of a triangle that is in front of the camera, as triangles. The cloth always is, but a body may surround the camera.
    pub(super) fn in_front(&self, corners: [Vec3; 3]) -> Vec<[Vec3; 3]> {
        let depths = corners.map(|corner| (self.eye - corner).dot(self.back));
        let near = NEAR * depths.iter().fold(f32::MIN_POSITIVE, |most, &depth| most.max(depth));
        if !self.spreads || depths.iter().all(|&depth| depth >= near) {
            return vec![corners];
        }
        let mut outline = Vec::new();
        for [from, to] in [[0, 1], [1, 2], [2, 0]] {
            outline.extend((depths[from] >= near).then_some(corners[from]));
            if (depths[from] >= near) != (depths[to] >= near) {
                outline.push(corners[from].lerp(corners[to], (near - depths[from]) / (depths[to] - depths[from])));
            }
        }
        outline.windows(2).skip(1).map(|side| [outline[0], side[0], side[1]]).collect()
    }

    /// The column, row and nearness of a point.
    pub(super) fn project(&self, point: Vec3, width: usize, height: usize) -> Vec3 {
        let seen = point - self.eye;
        let depth = -seen.dot(self.back);
        let shrink = if self.spreads { 1.0 / depth } else { 1.0 } * 0.5 * height as f32 / self.half;
        let x = 0.5 * width as f32 + shrink * seen.dot(self.right);
        let y = 0.5 * height as f32 - shrink * seen.dot(self.up);
        Vec3::new(x, y, self.nearness(depth))
    }

    /// The unit vector opposite to the direction of view.
    pub(super) fn back(&self) -> Vec3 {
        self.back
    }

    pub(super) fn nearness(&self, depth: f32) -> f32 {
        if self.spreads { 1.0 / depth } else { -depth }
    }

    pub(super) fn depth(&self, nearness: f32) -> f32 {
        if self.spreads { 1.0 / nearness } else { -nearness }
    }
}

/// Calls `fill(index, nearness)` for every sample whose center the triangle covers, whatever its orientation.
pub(super) fn rasterize([a, b, c]: [Vec3; 3], width: usize, height: usize, mut fill: impl FnMut(usize, f32)) {
    let area = (b - a).xy().perp_dot((c - a).xy());
    // Not `area == 0.0`, to exclude NaN and infinity as well.
    if !(area.abs() > 0.0 && area.is_finite()) {
        return;
    }
    let span = |low: f32, high: f32, count: usize| -> Range<usize> {
        (low - 0.5).ceil().max(0.0) as usize..((high + 0.5).floor().max(0.0) as usize).min(count)
    };
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    for row in span(low.y, high.y, height) {
        for column in span(low.x, high.x, width) {
            let at = Vec2::new(column as f32 + 0.5, row as f32 + 0.5);
            let beta = (at - a.xy()).perp_dot((c - a).xy()) / area;
            let gamma = (b - a).xy().perp_dot(at - a.xy()) / area;
            if beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 {
                fill(row * width + column, a.z + beta * (b.z - a.z) + gamma * (c.z - a.z));
            }
        }
    }
}
