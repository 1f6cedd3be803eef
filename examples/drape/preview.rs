//! A contact sheet of a cloth in motion, drawn without a GPU.
//!
//! Every cell is drawn in two passes. Visibility: the colliders are traced by ray, the triangles rasterized, both into one
//! depth buffer. Shading: each sample finds its point again from its ray and its depth, asks a shadow map how much of the
//! light reaches it, and the samples of a pixel are averaged in linear light. All cells share one camera, which holds the
//! whole motion.

use std::ops::Range;

use cloth_deformer::{
    Collider, Shape,
    glam::{Vec2, Vec3, Vec3Swizzles},
};
use rayon::prelude::*;

/// Size of a cell (pixels).
const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// Cells side by side.
const COLUMNS: usize = 4;
/// White line between cells (pixels).
const GAP: usize = 2;
/// Samples a pixel, along each side.
const SAMPLES: usize = 3;
/// Texels of the shadow map, along each side.
const SHADOW: usize = 512;

/// Toward the camera, and toward the light.
const CAMERA: Vec3 = Vec3::new(0.52, 0.50, 1.0);
const LIGHT: Vec3 = Vec3::new(-0.95, 1.25, 0.45);
/// Tangent of half the vertical angle of view: a long lens, so that the cells compare well.
const LENS: f32 = 0.22;

/// Colors in linear light.
const FRONT: Vec3 = Vec3::new(0.62, 0.085, 0.055);
const BACK: Vec3 = Vec3::new(0.80, 0.48, 0.20);
const SOLID: Vec3 = Vec3::new(0.16, 0.25, 0.36);
const TILES: [Vec3; 2] = [Vec3::new(0.64, 0.65, 0.67), Vec3::new(0.50, 0.515, 0.54)];
const HORIZON: Vec3 = Vec3::new(0.90, 0.91, 0.93);
const ZENITH: Vec3 = Vec3::new(0.62, 0.69, 0.78);
const INK: Vec3 = Vec3::new(0.05, 0.06, 0.08);

/// Draws each `(number, positions (m))` into a cell of its own, row by row, four to a row, with the colliders that were
/// there; returns the picture as a PNG file's bytes.
///
/// # Errors
/// If the PNG encoder refuses; a sheet without cells is not a picture.
pub(crate) fn contact_sheet(
    frames: &[(u32, Vec<Vec3>)],
    triangles: &[[u32; 3]],
    colliders: &[Collider],
) -> Result<Vec<u8>, png::EncodingError> {
    let scene = Scene::new(frames, triangles, colliders);
    let cells: Vec<Vec<[u8; 3]>> = frames.par_iter().map(|(number, positions)| scene.draw(*number, positions)).collect();

    let columns = cells.len().min(COLUMNS);
    let rows = cells.len().div_ceil(COLUMNS);
    let width = (columns * (WIDTH + GAP)).saturating_sub(GAP);
    let height = (rows * (HEIGHT + GAP)).saturating_sub(GAP);
    let mut pixels = vec![[u8::MAX; 3]; width * height];
    for (cell, drawn) in cells.iter().enumerate() {
        let corner = cell / COLUMNS * (HEIGHT + GAP) * width + cell % COLUMNS * (WIDTH + GAP);
        for (row, line) in drawn.chunks_exact(WIDTH).enumerate() {
            pixels[corner + row * width..][..WIDTH].copy_from_slice(line);
        }
    }

    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels.as_flattened())?;
    writer.finish()?;
    Ok(file)
}

/// What all cells share.
struct Scene<'a> {
    triangles: &'a [[u32; 3]],
    /// The colliders, a little smaller than they are: see [`shrunk`].
    colliders: Vec<Collider>,
    camera: Frame,
    light: Frame,
    /// Middle and radius of all that moves or stands there (m).
    middle: Vec3,
    radius: f32,
}

impl<'a> Scene<'a> {
    fn new(frames: &[(u32, Vec<Vec3>)], triangles: &'a [[u32; 3]], colliders: &[Collider]) -> Scene<'a> {
        let mut points: Vec<Vec3> = frames.iter().flat_map(|(_, positions)| positions.iter().copied()).collect();
        points.extend(colliders.iter().flat_map(|collider| corners(collider.shape)));
        let (low, high) = bounds(&points);
        let middle = 0.5 * (low + high);
        let radius = points.iter().map(|point| point.distance(middle)).fold(f32::MIN_POSITIVE, f32::max);
        let edge = frames.first().map_or(0.0, |(_, positions)| longest_edge(positions, triangles));
        Scene {
            triangles,
            colliders: colliders.iter().map(|&collider| shrunk(collider, edge, radius)).collect(),
            camera: Frame::perspective(&points),
            light: Frame::parallel(middle, radius),
            middle,
            radius,
        }
    }

    /// One cell, in sRGB.
    fn draw(&self, number: u32, positions: &[Vec3]) -> Vec<[u8; 3]> {
        let shadow = self.visible(&self.light, positions, SHADOW, SHADOW);
        let seen = self.visible(&self.camera, positions, WIDTH * SAMPLES, HEIGHT * SAMPLES);
        let normals = vertex_normals(positions, self.triangles);

        let mut pixels = vec![Vec3::ZERO; WIDTH * HEIGHT];
        for (index, sample) in seen.iter().enumerate() {
            let (column, row) = (index % (WIDTH * SAMPLES), index / (WIDTH * SAMPLES));
            let color = self.shade(sample, column, row, positions, &normals, &shadow);
            pixels[row / SAMPLES * WIDTH + column / SAMPLES] += color / (SAMPLES * SAMPLES) as f32;
        }
        label(&mut pixels, number);
        pixels.into_iter().map(srgb).collect()
    }

    /// What `frame` sees through the middle of each of its samples.
    fn visible(&self, frame: &Frame, positions: &[Vec3], width: usize, height: usize) -> Vec<Sample> {
        let mut samples: Vec<Sample> = (0..width * height)
            .map(|index| {
                let (origin, direction) = frame.ray(index % width, index / width, width, height);
                let mut nearest = Sample { nearness: f32::NEG_INFINITY, thing: Thing::Nothing };
                for (number, collider) in self.colliders.iter().enumerate() {
                    if let Some(depth) = trace(collider.shape, origin, direction) {
                        nearest = nearest.or(Sample { nearness: frame.nearness(depth), thing: Thing::Collider(number) });
                    }
                }
                nearest
            })
            .collect();
        for (number, &triangle) in self.triangles.iter().enumerate() {
            let corners = triangle.map(|vertex| frame.project(positions[vertex as usize], width, height));
            rasterise(corners, width, height, |index, nearness| {
                samples[index] = samples[index].or(Sample { nearness, thing: Thing::Triangle(number) });
            });
        }
        samples
    }

    /// Light that reaches the camera through one sample, linear.
    fn shade(&self, sample: &Sample, column: usize, row: usize, positions: &[Vec3], normals: &[Vec3], shadow: &[Sample]) -> Vec3 {
        let (origin, direction) = self.camera.ray(column, row, WIDTH * SAMPLES, HEIGHT * SAMPLES);
        let backdrop = HORIZON.lerp(ZENITH, (1.0 - row as f32 / (HEIGHT * SAMPLES) as f32).powf(1.5));
        let point = origin + self.camera.depth(sample.nearness) * direction;
        let to_eye = -direction.normalize();
        match sample.thing {
            Thing::Nothing => backdrop,
            Thing::Triangle(number) => {
                let triangle = self.triangles[number].map(|vertex| vertex as usize);
                let flat = normal(triangle.map(|vertex| positions[vertex]));
                let outside = flat.dot(to_eye) >= 0.0;
                let smooth = interpolate(point, triangle.map(|vertex| positions[vertex]), triangle.map(|vertex| normals[vertex]));
                let facing = if outside { smooth } else { -smooth };
                let lit = self.lit(point, if outside { flat } else { -flat }, shadow);
                let albedo = if outside { FRONT } else { BACK };
                // Cloth scatters grazing light: a faint sheen along the folds' silhouettes.
                let sheen = 0.12 * (1.0 - facing.dot(to_eye).clamp(0.0, 1.0)).powi(3);
                surface(albedo, facing, lit) + sheen * HORIZON
            }
            Thing::Collider(number) => {
                let shape = self.colliders[number].shape;
                let facing = collider_normal(shape, point);
                let lit = self.lit(point, facing, shadow);
                let Shape::Plane { point: on, normal } = shape else {
                    let half = (to_eye + LIGHT.normalize()).normalize();
                    return surface(SOLID, facing, lit) + 0.18 * lit * facing.dot(half).max(0.0).powi(40) * Vec3::ONE;
                };
                let tile = checker(self.middle, self.radius, on, normal, point);
                let far = smoothstep(1.3, 4.5, point.distance(self.middle) / self.radius);
                surface(tile, facing, lit).lerp(backdrop, far)
            }
        }
    }

    /// Part of the light that reaches `point`: the shadow map's neighborhood, weighted by distance, so that shadows are soft.
    fn lit(&self, point: Vec3, facing: Vec3, shadow: &[Sample]) -> f32 {
        const REACH: isize = 3;
        let slope = 1.0 - facing.dot(LIGHT.normalize()).clamp(0.0, 1.0);
        // A texel is wide: lift the point off its own surface, the more the more the light grazes it.
        let lifted = point + facing * self.radius * (0.010 + 0.014 * slope);
        let texel = self.light.project(lifted, SHADOW, SHADOW);
        let (mut light, mut total) = (0.0, 0.0);
        for y in -REACH..=REACH {
            for x in -REACH..=REACH {
                let at = texel.xy().floor() + Vec2::new(x as f32, y as f32);
                let weight = (-texel.xy().distance_squared(at + 0.5) / 5.0).exp();
                let inside = at.min_element() >= 0.0 && at.max_element() < SHADOW as f32;
                let blocked = inside && {
                    let blocker = &shadow[at.y as usize * SHADOW + at.x as usize];
                    // A floor shades nothing, and would shade itself at the map's resolution.
                    blocker.nearness > texel.z && !self.is_plane(blocker.thing)
                };
                total += weight;
                light += if blocked { 0.0 } else { weight };
            }
        }
        light / total
    }

    fn is_plane(&self, thing: Thing) -> bool {
        matches!(thing, Thing::Collider(number) if matches!(self.colliders[number].shape, Shape::Plane { .. }))
    }
}

/// What is seen through one sample, and how near: a number that grows toward the eye and is linear on the screen.
#[derive(Clone, Copy)]
struct Sample {
    nearness: f32,
    thing: Thing,
}

impl Sample {
    fn or(self, other: Sample) -> Sample {
        if other.nearness > self.nearness { other } else { self }
    }
}

#[derive(Clone, Copy)]
enum Thing {
    Nothing,
    Triangle(usize),
    Collider(usize),
}

/// A view of the scene: where from, along which axes, and whether the rays spread.
struct Frame {
    eye: Vec3,
    right: Vec3,
    up: Vec3,
    back: Vec3,
    /// Half the view's height (m): at depth 1 m if the rays spread, everywhere if they are parallel.
    half: f32,
    spreads: bool,
}

impl Frame {
    fn toward(eye: Vec3, back: Vec3, half: f32, spreads: bool) -> Frame {
        let back = back.normalize();
        let right = Vec3::Y.cross(back).normalize();
        Frame { eye, right, up: back.cross(right), back, half, spreads }
    }

    /// The camera: from [`CAMERA`], as near as it can be with every point in sight.
    fn perspective(points: &[Vec3]) -> Frame {
        const MARGIN: f32 = 1.06;
        let mut frame = Frame::toward(Vec3::ZERO, CAMERA, LENS, true);
        let aspect = WIDTH as f32 / HEIGHT as f32;
        let local: Vec<Vec3> =
            points.iter().map(|point| Vec3::new(point.dot(frame.right), point.dot(frame.up), point.dot(frame.back))).collect();
        // A point is in sight when |x| <= slope (eye.z - z): each side's plane is as far out as its outermost point.
        let side = |slope: f32, axis: fn(&Vec3) -> f32| {
            let most = |sign: f32| local.iter().map(|p| sign * axis(p) + slope * p.z).fold(f32::NEG_INFINITY, f32::max);
            let (high, low) = (most(1.0), most(-1.0));
            (0.5 * (high - low), 0.5 * (high + low) / slope)
        };
        let (x, far_x) = side(LENS * aspect / MARGIN, |p| p.x);
        let (y, far_y) = side(LENS / MARGIN, |p| p.y);
        let nearest = local.iter().map(|p| p.z).fold(f32::NEG_INFINITY, f32::max);
        // A single point has no size to fit: stand a step back from it.
        let z = far_x.max(far_y).max(nearest + 1e-3 * (1.0 + nearest.abs()));
        frame.eye = x * frame.right + y * frame.up + z * frame.back;
        frame
    }

    /// The light: parallel rays around everything within `radius` of `middle`.
    fn parallel(middle: Vec3, radius: f32) -> Frame {
        Frame::toward(middle + 2.0 * radius * LIGHT.normalize(), LIGHT, 1.02 * radius, false)
    }

    /// The ray through the middle of a sample: origin, and a direction that is 1 m long along the view.
    fn ray(&self, column: usize, row: usize, width: usize, height: usize) -> (Vec3, Vec3) {
        let pixel = 2.0 * self.half / height as f32;
        let x = (column as f32 + 0.5 - 0.5 * width as f32) * pixel;
        let y = (0.5 * height as f32 - row as f32 - 0.5) * pixel;
        let across = x * self.right + y * self.up;
        if self.spreads { (self.eye, across - self.back) } else { (self.eye + across, -self.back) }
    }

    /// Column, row and nearness of a point.
    fn project(&self, point: Vec3, width: usize, height: usize) -> Vec3 {
        let seen = point - self.eye;
        let depth = -seen.dot(self.back);
        let shrink = if self.spreads { 1.0 / depth } else { 1.0 } * 0.5 * height as f32 / self.half;
        let x = 0.5 * width as f32 + shrink * seen.dot(self.right);
        let y = 0.5 * height as f32 - shrink * seen.dot(self.up);
        Vec3::new(x, y, self.nearness(depth))
    }

    fn nearness(&self, depth: f32) -> f32 {
        if self.spreads { 1.0 / depth } else { -depth }
    }

    fn depth(&self, nearness: f32) -> f32 {
        if self.spreads { 1.0 / nearness } else { -nearness }
    }
}

/// Calls `fill(index, nearness)` for every sample whose middle the triangle covers, whichever way round it is.
fn rasterise([a, b, c]: [Vec3; 3], width: usize, height: usize, mut fill: impl FnMut(usize, f32)) {
    let area = (b - a).xy().perp_dot((c - a).xy());
    // Not `area == 0.0`: what is not finite has no inside either.
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

/// How many `direction`s from `origin` the ray enters the shape, if it does.
fn trace(shape: Shape, origin: Vec3, direction: Vec3) -> Option<f32> {
    let ball = |center: Vec3, radius: f32| {
        let (a, b) = (direction.length_squared(), direction.dot(origin - center));
        let inside = b * b - a * ((origin - center).length_squared() - radius * radius);
        (inside >= 0.0).then(|| (-b - inside.sqrt()) / a)
    };
    let hit = match shape {
        Shape::Sphere { center, radius } => ball(center, radius),
        Shape::Plane { point, normal } => {
            let speed = direction.dot(normal);
            (speed < 0.0).then(|| (point - origin).dot(normal) / speed)
        }
        Shape::Capsule { a, b, radius } => {
            // The tube where the ray meets it between the ends, else the nearer of the end balls.
            let (axis, from) = (b - a, origin - a);
            let long = axis.length_squared();
            let (d, m) = (direction * long - axis * axis.dot(direction), from * long - axis * axis.dot(from));
            let (qa, qb) = (d.length_squared(), d.dot(m));
            let inside = qb * qb - qa * (m.length_squared() - (radius * long).powi(2));
            let tube = (qa > 0.0 && inside >= 0.0).then(|| (-qb - inside.sqrt()) / qa);
            tube.filter(|t| (0.0..=long).contains(&(from + t * direction).dot(axis)))
                .or_else(|| [ball(a, radius), ball(b, radius)].into_iter().flatten().min_by(f32::total_cmp))
        }
        // A shape that is not known here is not drawn.
        _ => None,
    };
    hit.filter(|&t| t > 0.0)
}

fn collider_normal(shape: Shape, at: Vec3) -> Vec3 {
    match shape {
        Shape::Sphere { center, .. } => at - center,
        Shape::Plane { normal, .. } => normal,
        Shape::Capsule { a, b, .. } => {
            let along = (at - a).dot(b - a) / (b - a).length_squared().max(f32::MIN_POSITIVE);
            at - a.lerp(b, along.clamp(0.0, 1.0))
        }
        _ => Vec3::ZERO,
    }
    .normalize_or_zero()
}

/// The collider as it is drawn: cloth that lies on it would flicker through, since its triangles are chords of a ball
/// (sagitta `edge² / 8r` each way) and coincide with a plane.
fn shrunk(collider: Collider, edge: f32, scene: f32) -> Collider {
    let gap = 0.002 * scene;
    let smaller = |radius: f32| (radius - gap - edge * edge / (4.0 * radius)).max(0.9 * radius);
    let shape = match collider.shape {
        Shape::Sphere { center, radius } => Shape::Sphere { center, radius: smaller(radius) },
        Shape::Plane { point, normal } => Shape::Plane { point: point - gap * normal.normalize_or_zero(), normal },
        Shape::Capsule { a, b, radius } => Shape::Capsule { a, b, radius: smaller(radius) },
        other => other,
    };
    Collider { shape, ..collider }
}

/// Corners of a box around a shape of finite size.
fn corners(shape: Shape) -> Vec<Vec3> {
    let around = |center: Vec3, radius: f32| {
        (0..8).map(move |corner| {
            let sign = |bit: i32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
            // A ball's box is loose at its corners: this one touches the ball along the diagonals too.
            center + 0.8 * radius * Vec3::new(sign(0), sign(1), sign(2))
        })
    };
    match shape {
        Shape::Sphere { center, radius } => around(center, radius).collect(),
        Shape::Capsule { a, b, radius } => around(a, radius).chain(around(b, radius)).collect(),
        _ => Vec::new(),
    }
}

fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &point| (low.min(point), high.max(point)))
}

fn longest_edge(positions: &[Vec3], triangles: &[[u32; 3]]) -> f32 {
    let at = |vertex: u32| positions[vertex as usize];
    triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).map(|(i, j)| at(i).distance(at(j))).fold(0.0, f32::max)
}

/// Normal of a triangle, as long as twice its area.
fn normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

/// Normals of the vertices: their triangles' mean by area, not yet of length 1.
fn vertex_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles.iter().map(|triangle| triangle.map(|vertex| vertex as usize)) {
        let flat = normal(triangle.map(|vertex| positions[vertex]));
        for vertex in triangle {
            normals[vertex] += flat;
        }
    }
    normals
}

/// The unit vector at `point` between the vectors at a triangle's corners.
fn interpolate(point: Vec3, [a, b, c]: [Vec3; 3], vectors: [Vec3; 3]) -> Vec3 {
    let flat = normal([a, b, c]);
    let weight = |from: Vec3, to: Vec3| (to - from).cross(point - from).dot(flat);
    let weights = [weight(b, c), weight(c, a), weight(a, b)];
    (0..3)
        .map(|corner| weights[corner] * vectors[corner].normalize_or_zero())
        .sum::<Vec3>()
        .normalize_or(flat.normalize_or_zero())
}

/// A matt surface under the light, with the sky above and the light that the ground throws back.
fn surface(albedo: Vec3, facing: Vec3, lit: f32) -> Vec3 {
    let key = 1.12 * lit * facing.dot(LIGHT.normalize()).max(0.0) * Vec3::new(1.0, 0.97, 0.92);
    let sky = (0.25 + 0.16 * facing.y) * Vec3::new(0.92, 0.98, 1.08);
    albedo * (key + sky)
}

/// The color of a plane's tile at `at`; a tile is about a sixth of the scene.
fn checker(middle: Vec3, radius: f32, on: Vec3, normal: Vec3, at: Vec3) -> Vec3 {
    let (u, v) = normal.normalize().any_orthonormal_pair();
    let origin = middle - normal.normalize() * (middle - on).dot(normal.normalize());
    let tile = |axis: Vec3| ((at - origin).dot(axis) * 3.0 / radius).rem_euclid(2.0) < 1.0;
    TILES[usize::from(tile(u) != tile(v))]
}

fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Writes a number into the cell's upper left corner.
fn label(pixels: &mut [Vec3], number: u32) {
    /// Rows of each digit from the top, three bits a row.
    const DIGITS: [[u8; 5]; 10] = [
        [7, 5, 5, 5, 7],
        [2, 6, 2, 2, 7],
        [7, 1, 7, 4, 7],
        [7, 1, 7, 1, 7],
        [5, 5, 7, 1, 1],
        [7, 4, 7, 1, 7],
        [7, 4, 7, 5, 7],
        [7, 1, 1, 1, 1],
        [7, 5, 7, 5, 7],
        [7, 5, 7, 1, 7],
    ];
    const DOT: usize = 2;
    const MARGIN: usize = 10;
    for (place, digit) in number.to_string().bytes().enumerate() {
        for (row, bits) in DIGITS[usize::from(digit - b'0')].into_iter().enumerate() {
            for column in (0..3).filter(|column| bits >> (2 - column) & 1 == 1) {
                for dot in 0..DOT * DOT {
                    let x = MARGIN + (place * 4 + column) * DOT + dot % DOT;
                    let y = MARGIN + row * DOT + dot / DOT;
                    pixels[y * WIDTH + x] = INK;
                }
            }
        }
    }
}

/// Linear light to sRGB (IEC 61966-2-1), 8 bits.
fn srgb(linear: Vec3) -> [u8; 3] {
    linear.to_array().map(|x| {
        let x = x.clamp(0.0, 1.0);
        let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (255.0 * encoded).round() as u8
    })
}
