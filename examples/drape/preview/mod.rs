//! A contact sheet of a cloth in motion, drawn without a GPU.
//!
//! Every cell is drawn in two passes. Visibility: the colliders are traced by ray, the triangles rasterized, both into one
//! depth buffer. Shading: each sample finds its point again from its ray and its depth, asks a shadow map how much of the
//! light reaches it, and the samples of a pixel are averaged in linear light. All cells share one camera, which holds the
//! whole motion.

mod shapes;
mod view;

use cloth_deformer::glam::{Vec2, Vec3, Vec3Swizzles};
use cloth_deformer::{Collider, Mesh, Shape};
use rayon::prelude::*;

use shapes::{collider_normal, corners, shrunk, trace};
use view::{Frame, rasterise};

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

/// A frame to be drawn.
#[derive(Debug)]
pub(crate) struct Cell {
    pub(crate) frame: u32,
    /// Where the cloth was (m).
    pub(crate) positions: Vec<Vec3>,
    /// The colliders that were there.
    pub(crate) colliders: Vec<Collider>,
}

/// Draws each frame into a cell of its own, row by row, four to a row; returns the picture as a PNG file's bytes.
///
/// # Errors
/// If the PNG encoder refuses; a sheet without cells is not a picture.
pub(crate) fn contact_sheet(frames: &[Cell], triangles: &[[u32; 3]]) -> Result<Vec<u8>, png::EncodingError> {
    let scene = Scene::new(frames, triangles);
    let cells: Vec<Vec<[u8; 3]>> = frames.par_iter().map(|cell| scene.draw(cell)).collect();

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
    camera: Frame,
    light: Frame,
    /// Middle and radius of all that moves or stands there (m).
    middle: Vec3,
    radius: f32,
    /// The cloth's longest edge (m) in the first frame.
    edge: f32,
}

impl<'a> Scene<'a> {
    fn new(frames: &[Cell], triangles: &'a [[u32; 3]]) -> Scene<'a> {
        let mut points: Vec<Vec3> = frames.iter().flat_map(|cell| cell.positions.iter().copied()).collect();
        points.extend(frames.iter().flat_map(|cell| &cell.colliders).flat_map(|collider| corners(&collider.shape)));
        let (low, high) = bounds(&points);
        let middle = 0.5 * (low + high);
        let radius = points.iter().map(|point| point.distance(middle)).fold(f32::MIN_POSITIVE, f32::max);
        Scene {
            triangles,
            camera: Frame::perspective(&points),
            light: Frame::parallel(middle, radius),
            middle,
            radius,
            edge: frames.first().map_or(0.0, |cell| longest_edge(&cell.positions, triangles)),
        }
    }

    /// One cell, in sRGB.
    fn draw(&self, cell: &Cell) -> Vec<[u8; 3]> {
        let colliders = cell.colliders.iter().map(|collider| shrunk(collider, self.edge, self.radius)).collect();
        let normals_of = |collider: &Collider| body(collider).map(|mesh| vertex_normals(&mesh.positions, &mesh.triangles));
        let body_normals = cell.colliders.iter().map(|collider| normals_of(collider).unwrap_or_default()).collect();
        let moment = Moment { scene: self, positions: &cell.positions, colliders, body_normals };
        let shadow = moment.visible(&self.light, SHADOW, SHADOW);
        let seen = moment.visible(&self.camera, WIDTH * SAMPLES, HEIGHT * SAMPLES);
        let normals = vertex_normals(&cell.positions, self.triangles);

        let mut pixels = vec![Vec3::ZERO; WIDTH * HEIGHT];
        for (index, sample) in seen.iter().enumerate() {
            let (column, row) = (index % (WIDTH * SAMPLES), index / (WIDTH * SAMPLES));
            let color = moment.shade(sample, column, row, &normals, &shadow);
            pixels[row / SAMPLES * WIDTH + column / SAMPLES] += color / (SAMPLES * SAMPLES) as f32;
        }
        label(&mut pixels, cell.frame);
        pixels.into_iter().map(srgb).collect()
    }
}

/// The scene in one frame.
struct Moment<'a> {
    scene: &'a Scene<'a>,
    positions: &'a [Vec3],
    /// The colliders, a little smaller than they are: see [`shrunk`].
    colliders: Vec<Collider>,
    /// Normals at the vertices of those that are meshes.
    body_normals: Vec<Vec<Vec3>>,
}

impl Moment<'_> {
    /// What `frame` sees through the middle of each of its samples.
    fn visible(&self, frame: &Frame, width: usize, height: usize) -> Vec<Sample> {
        let mut samples: Vec<Sample> = (0..width * height)
            .map(|index| {
                let (origin, direction) = frame.ray(index % width, index / width, width, height);
                let mut nearest = Sample { nearness: f32::NEG_INFINITY, thing: Thing::Nothing };
                for (number, collider) in self.colliders.iter().enumerate() {
                    if let Some(depth) = trace(&collider.shape, origin, direction) {
                        nearest = nearest.or(Sample { nearness: frame.nearness(depth), thing: Thing::Collider(number) });
                    }
                }
                nearest
            })
            .collect();
        for (number, collider) in self.colliders.iter().enumerate() {
            let Some(mesh) = body(collider) else { continue };
            for (place, &triangle) in mesh.triangles.iter().enumerate() {
                let corners = triangle.map(|vertex| frame.project(mesh.positions[vertex as usize], width, height));
                rasterise(corners, width, height, |index, nearness| {
                    samples[index] = samples[index].or(Sample { nearness, thing: Thing::Body(number, place) });
                });
            }
        }
        for (number, &triangle) in self.scene.triangles.iter().enumerate() {
            let corners = triangle.map(|vertex| frame.project(self.positions[vertex as usize], width, height));
            rasterise(corners, width, height, |index, nearness| {
                samples[index] = samples[index].or(Sample { nearness, thing: Thing::Triangle(number) });
            });
        }
        samples
    }

    /// Light that reaches the camera through one sample, linear.
    fn shade(&self, sample: &Sample, column: usize, row: usize, normals: &[Vec3], shadow: &[Sample]) -> Vec3 {
        let (scene, positions) = (self.scene, self.positions);
        let (origin, direction) = scene.camera.ray(column, row, WIDTH * SAMPLES, HEIGHT * SAMPLES);
        let backdrop = HORIZON.lerp(ZENITH, (1.0 - row as f32 / (HEIGHT * SAMPLES) as f32).powf(1.5));
        let point = origin + scene.camera.depth(sample.nearness) * direction;
        let to_eye = -direction.normalize();
        match sample.thing {
            Thing::Nothing => backdrop,
            Thing::Triangle(number) => {
                let triangle = scene.triangles[number].map(|vertex| vertex as usize);
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
            Thing::Body(number, place) => {
                let Some(mesh) = body(&self.colliders[number]) else { return backdrop };
                let triangle = mesh.triangles[place].map(|vertex| vertex as usize);
                let corners = triangle.map(|vertex| mesh.positions[vertex]);
                let smooth = interpolate(point, corners, triangle.map(|vertex| self.body_normals[number][vertex]));
                let facing = if normal(corners).dot(to_eye) >= 0.0 { smooth } else { -smooth };
                surface(SOLID, facing, self.lit(point, facing, shadow))
            }
            Thing::Collider(number) => {
                let shape = &self.colliders[number].shape;
                let facing = collider_normal(shape, point);
                let lit = self.lit(point, facing, shadow);
                let Shape::Plane { point: on, normal } = shape else {
                    let half = (to_eye + LIGHT.normalize()).normalize();
                    return surface(SOLID, facing, lit) + 0.18 * lit * facing.dot(half).max(0.0).powi(40) * Vec3::ONE;
                };
                let tile = checker(scene.middle, scene.radius, *on, *normal, point);
                let far = smoothstep(1.3, 4.5, point.distance(scene.middle) / scene.radius);
                surface(tile, facing, lit).lerp(backdrop, far)
            }
        }
    }

    /// Part of the light that reaches `point`: the shadow map's neighborhood, weighted by distance, so that shadows are soft.
    fn lit(&self, point: Vec3, facing: Vec3, shadow: &[Sample]) -> f32 {
        const REACH: isize = 3;
        let slope = 1.0 - facing.dot(LIGHT.normalize()).clamp(0.0, 1.0);
        // A texel is wide: lift the point off its own surface, the more the more the light grazes it.
        let lifted = point + facing * self.scene.radius * (0.010 + 0.014 * slope);
        let texel = self.scene.light.project(lifted, SHADOW, SHADOW);
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
    /// A triangle of a collider that is a mesh.
    Body(usize, usize),
}

/// The mesh of a collider that is one.
fn body(collider: &Collider) -> Option<&Mesh> {
    if let Shape::Mesh { mesh } = &collider.shape { Some(mesh) } else { None }
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
