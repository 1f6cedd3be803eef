//! Draws the scene in one frame.

use cloth_deformer::glam::{Vec3, Vec3Swizzles};
use cloth_deformer::{Collider, Mesh, Shape};

use super::mesh::{bounds, interpolate, longest_edge, normal, vertex_normals};
use super::shade::{Reach, SOLID, Sky, backdrop, checker, smoothstep, srgb};
use super::shapes::{collider_normal, corners, shrunk, trace};
use super::view::{Frame, rasterize};
use super::{Cell, Look};

/// Samples per pixel in each direction.
const SAMPLES: usize = 3;
/// The camera need not see colliders that are farther from the cloth than this share of its size.
const AROUND: f32 = 0.46;
/// The largest [`Lamp::softness`].
const MAX_SOFTNESS: usize = 5;

/// What all frames share.
pub(super) struct Stage<'a> {
    triangles: &'a [[u32; 3]],
    look: &'a Look,
    width: usize,
    height: usize,
    camera: Frame,
    sky: Sky,
    lamps: [Lamp; 2],
    /// Center and radius (m) of a sphere around everything that the camera must see.
    middle: Vec3,
    radius: f32,
    /// The longest edge of the cloth (m) in the first frame.
    edge: f32,
}

/// A light with a shadow map: its view, the texels per side of the map, and the radius of the filter (texels).
struct Lamp {
    frame: Frame,
    texels: usize,
    softness: usize,
}

impl<'a> Stage<'a> {
    /// For pictures of these frames with the given width and height (pixels).
    pub(super) fn new(frames: &[Cell], triangles: &'a [[u32; 3]], look: &'a Look, [width, height]: [usize; 2]) -> Stage<'a> {
        let mut points: Vec<Vec3> = frames.iter().flat_map(|cell| cell.positions.iter().copied()).collect();
        let (low, high) = bounds(&points);
        let margin = AROUND * low.distance(high);
        let solids = frames.iter().flat_map(|cell| &cell.colliders).flat_map(|collider| corners(&collider.shape));
        points.extend(solids.map(|point| point.clamp(low - margin, high + margin)));
        let (low, high) = bounds(&points);
        let middle = 0.5 * (low + high);
        let radius = points.iter().map(|point| point.distance(middle)).fold(f32::MIN_POSITIVE, f32::max);
        let sky = Sky::new(look.up);
        Stage {
            triangles,
            look,
            width,
            height,
            camera: Frame::perspective(&points, look.from, sky.up, width as f32 / height as f32),
            sky,
            // The sun, and the sky, which is a very soft light from above.
            lamps: [
                Lamp { frame: Frame::parallel(middle, radius, sky.sun, sky.up), texels: 512, softness: 3 },
                Lamp { frame: Frame::parallel(middle, radius, sky.up, sky.up), texels: 96, softness: MAX_SOFTNESS },
            ],
            middle,
            radius,
            edge: frames.first().map_or(0.0, |cell| longest_edge(&cell.positions, triangles)),
        }
    }

    /// Draws a frame, in sRGB.
    pub(super) fn draw(&self, cell: &Cell) -> Vec<[u8; 3]> {
        let colliders = cell.colliders.iter().map(|collider| shrunk(collider, self.edge, self.radius)).collect();
        let normals_of = |collider: &Collider| body(collider).map(|mesh| vertex_normals(&mesh.positions, &mesh.triangles));
        let body_normals = cell.colliders.iter().map(|collider| normals_of(collider).unwrap_or_default()).collect();
        let normals = vertex_normals(&cell.positions, self.triangles);
        let mut moment = Moment {
            stage: self,
            positions: &cell.positions,
            normals,
            colliders,
            body_normals,
            shadows: [const { Vec::new() }; 2],
        };
        moment.shadows = self.lamps.each_ref().map(|lamp| moment.shadow(lamp));
        let (columns, rows) = (self.width * SAMPLES, self.height * SAMPLES);
        let seen = moment.visible(&self.camera, columns, rows);

        let mut pixels = vec![Vec3::ZERO; self.width * self.height];
        for (index, sample) in seen.iter().enumerate() {
            let (column, row) = (index % columns, index / columns);
            let color = moment.shade(sample, column, row);
            pixels[row / SAMPLES * self.width + column / SAMPLES] += color / (SAMPLES * SAMPLES) as f32;
        }
        pixels.into_iter().map(srgb).collect()
    }
}

/// The scene in one frame.
struct Moment<'a> {
    stage: &'a Stage<'a>,
    positions: &'a [Vec3],
    /// Vertex normals of the cloth.
    normals: Vec<Vec3>,
    /// The colliders, slightly shrunk: see [`shrunk`].
    colliders: Vec<Collider>,
    /// Vertex normals of the mesh colliders; empty for other colliders.
    body_normals: Vec<Vec<Vec3>>,
    /// The shadow map of each light.
    shadows: [Vec<f32>; 2],
}

impl Moment<'_> {
    /// Determines what `frame` sees through the center of each sample.
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
                for corners in frame.in_front(triangle.map(|vertex| mesh.positions[vertex as usize])) {
                    let corners = corners.map(|corner| frame.project(corner, width, height));
                    rasterize(corners, width, height, |index, nearness| {
                        samples[index] = samples[index].or(Sample { nearness, thing: Thing::Body(number, place) });
                    });
                }
            }
        }
        for (number, &triangle) in self.stage.triangles.iter().enumerate() {
            let corners = triangle.map(|vertex| frame.project(self.positions[vertex as usize], width, height));
            rasterize(corners, width, height, |index, nearness| {
                samples[index] = samples[index].or(Sample { nearness, thing: Thing::Triangle(number) });
            });
        }
        samples
    }

    /// The light that reaches the camera through a sample, linear.
    fn shade(&self, sample: &Sample, column: usize, row: usize) -> Vec3 {
        let (stage, sky, rows) = (self.stage, self.stage.sky, self.stage.height * SAMPLES);
        let (origin, direction) = stage.camera.ray(column, row, stage.width * SAMPLES, rows);
        let backdrop = backdrop(1.0 - row as f32 / rows as f32);
        let point = origin + stage.camera.depth(sample.nearness) * direction;
        let to_eye = -direction.normalize();
        match sample.thing {
            Thing::Nothing => backdrop,
            Thing::Triangle(number) => {
                let triangle = stage.triangles[number];
                let piece = stage.look.pieces.partition_point(|piece| piece.end <= triangle[0]);
                let sides = stage.look.pieces.get(piece).map_or(Look::SIDES, |piece| piece.sides);
                let triangle = triangle.map(|vertex| vertex as usize);
                let corners = triangle.map(|vertex| self.positions[vertex]);
                let flat = normal(corners).normalize_or_zero();
                let side = if flat.dot(to_eye) >= 0.0 { 1.0 } else { -1.0 };
                let facing = side * interpolate(point, corners, triangle.map(|vertex| self.normals[vertex]));
                let albedo = sides[usize::from(side < 0.0)];
                // The sun lights either the visible side of the cloth or the far side, from where light shines through.
                let behind = if facing.dot(sky.sun) < 0.0 { self.lit(0, point, -side * flat) } else { 0.0 };
                sky.surface(albedo, facing, self.reach(point, side * flat)) + sky.thin(albedo, facing, to_eye, behind)
            }
            Thing::Body(number, place) => {
                let Some(mesh) = body(&self.colliders[number]) else { return backdrop };
                let triangle = mesh.triangles[place].map(|vertex| vertex as usize);
                let corners = triangle.map(|vertex| mesh.positions[vertex]);
                let smooth = interpolate(point, corners, triangle.map(|vertex| self.body_normals[number][vertex]));
                let facing = if normal(corners).dot(to_eye) >= 0.0 { smooth } else { -smooth };
                sky.surface(SOLID, facing, self.reach(point, facing))
            }
            Thing::Collider(number) => {
                let shape = &self.colliders[number].shape;
                let facing = collider_normal(shape, point);
                let reach = self.reach(point, facing);
                let Shape::Plane { point: on, normal } = shape else {
                    return sky.surface(SOLID, facing, reach) + sky.gloss(facing, to_eye, reach);
                };
                let tile = checker(stage.middle, stage.radius, *on, *normal, point);
                let far = smoothstep(1.3, 4.5, point.distance(stage.middle) / stage.radius);
                sky.surface(tile, facing, reach).lerp(backdrop, far)
            }
        }
    }

    fn reach(&self, point: Vec3, facing: Vec3) -> Reach {
        Reach { sun: self.lit(0, point, facing), sky: self.lit(1, point, facing) }
    }

    /// The share of a light that reaches `point`: the shadow map, filtered with a Gaussian, so that shadows are soft.
    fn lit(&self, lamp: usize, point: Vec3, facing: Vec3) -> f32 {
        let (Lamp { frame, texels, softness }, shadow) = (&self.stage.lamps[lamp], &self.shadows[lamp]);
        let slope = 1.0 - facing.dot(frame.back()).clamp(0.0, 1.0);
        // Because texels are wide, the point is lifted off its own surface, more at grazing incidence.
        let lifted = point + facing * self.stage.radius * (0.010 + 0.014 * slope) * (512.0 / *texels as f32).sqrt();
        let at = frame.project(lifted, *texels, *texels);
        let first = at.xy().floor() - *softness as f32;
        let width = 0.55 * (softness * softness) as f32;
        let weights = |axis: f32| {
            let mut weights = [0.0; 2 * MAX_SOFTNESS + 1];
            weights.iter_mut().enumerate().for_each(|(k, weight)| *weight = (-(axis - k as f32).powi(2) / width).exp());
            weights
        };
        let offset = at.xy() - first - 0.5;
        let (columns, rows) = (weights(offset.x), weights(offset.y));
        let (mut light, mut total) = (0.0, 0.0);
        for (y, row) in (first.y as isize..).zip(&rows[..=2 * softness]) {
            for (x, column) in (first.x as isize..).zip(&columns[..=2 * softness]) {
                let texel = usize::try_from(y).ok().zip(usize::try_from(x).ok()).filter(|&(y, x)| y < *texels && x < *texels);
                let blocked = texel.is_some_and(|(y, x)| shadow[y * texels + x] > at.z);
                total += row * column;
                light += if blocked { 0.0 } else { row * column };
            }
        }
        light / total
    }

    /// The shadow map of a light: the nearness of what it sees in each texel.
    fn shadow(&self, lamp: &Lamp) -> Vec<f32> {
        let seen = self.visible(&lamp.frame, lamp.texels, lamp.texels);
        // Planes cast no shadow on anything, but would cast one on themselves at the map's resolution.
        seen.iter().map(|sample| if self.is_plane(sample.thing) { f32::NEG_INFINITY } else { sample.nearness }).collect()
    }

    fn is_plane(&self, thing: Thing) -> bool {
        matches!(thing, Thing::Collider(number) if matches!(self.colliders[number].shape, Shape::Plane { .. }))
    }
}

/// What a sample shows. `nearness` increases toward the camera and is linear in screen space.
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
    /// A triangle of a mesh collider: indices of the collider and of the triangle.
    Body(usize, usize),
}

/// The mesh of a mesh collider.
fn body(collider: &Collider) -> Option<&Mesh> {
    if let Shape::Mesh { mesh } = &collider.shape { Some(mesh) } else { None }
}
