//! The cloth of the web page: the functions that `page/page.js` calls.

mod preset;
mod twin;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Backend, Deformer, Gpu, Levels, Mesh, Method, Options, Quality, wgpu};
use wasm_bindgen::prelude::*;

use preset::Preset;
use twin::Twin;

/// Length of a frame (s).
pub const FRAME: f32 = 1.0 / 60.0;
/// Largest distance (m) of a vertex from the pointer's ray at which it can be grabbed.
const REACH: f32 = 0.08;
/// Highest speed (m/s) at which the hand follows the pointer, and the largest length of an edge at the hand, relative to
/// its rest length.
const HAND: f32 = 4.0;
const PULL: f32 = 1.08;
/// Most steps that are given to a GPU before the state that was requested has arrived.
const QUEUED: u32 = 6;
/// Iterations of the plug-in's relaxation.
const ITERATIONS: u32 = 8;

/// A WebGPU device.
#[wasm_bindgen]
pub struct Device(Gpu);

/// Requests a WebGPU device from the browser.
///
/// # Errors
/// If the browser has none.
#[wasm_bindgen]
pub async fn device() -> Result<Device, JsError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default()).await?;
    let (device, queue) = adapter.request_device(&wgpu::DeviceDescriptor::default()).await?;
    Ok(Device(Gpu::new(device, queue, adapter.get_info().name)))
}

/// A cloth in a scene.
#[wasm_bindgen]
pub struct Toy {
    preset: Preset,
    mesh: Mesh,
    options: Options,
    cloth: Deformer,
    twin: Option<Twin>,
    /// Whether the state arrives late, because it is on the GPU.
    on_gpu: bool,
    /// Steps since the state was last requested; and, while that has not arrived, the steps from the state before to it.
    steps: u32,
    requested: Option<u32>,
    time: f32,
    wind: f32,
    gravity: f32,
    /// Initial positions of the pins.
    pins: Vec<Vec3>,
    /// Position of the grabbed vertex, which is the last pin, and the position to move it to.
    held: Option<Vec3>,
    wanted: Vec3,
    /// The state as drawn, and one frame before; velocities as far as they are known.
    positions: Vec<Vec3>,
    velocities: Vec<Vec3>,
    normals: Vec<Vec3>,
    /// Edges with their rest lengths.
    edges: Vec<([u32; 2], f32)>,
    substeps: u32,
    levels: u32,
}

#[wasm_bindgen]
impl Toy {
    /// Creates a scene by name, with about `size` vertices per side; on the GPU if there is a device.
    ///
    /// # Errors
    /// If there is no such scene, or the cloth cannot be created.
    #[wasm_bindgen(constructor)]
    pub fn new(scene: &str, size: u32, device: Option<Device>) -> Result<Toy, JsError> {
        let preset =
            Preset::named(scene).ok_or_else(|| JsError::new(&format!("scene {scene}: not towel, flag, cape or curtain")))?;
        let (mesh, pinned) = preset.mesh(size);
        let on_gpu = device.is_some();
        let backend = if on_gpu { Backend::Gpu } else { Backend::Cpu };
        let gpu = device.map(|device| device.0);
        let pins = pinned.iter().map(|&vertex| mesh.positions[vertex as usize]).collect();
        let options = Options { backend, gpu, fabric: preset.fabric(), pinned, ..Options::default() };
        let cloth = Deformer::new(&mesh, options.clone())?;
        let length = |[a, b]: [u32; 2]| mesh.positions[a as usize].distance(mesh.positions[b as usize]);
        let edges = mesh.edges().into_iter().map(|edge| (edge, length(edge))).collect();
        let mut toy = Toy {
            preset,
            cloth,
            twin: None,
            on_gpu,
            steps: 0,
            requested: None,
            time: 0.0,
            wind: preset.wind(),
            gravity: 9.81,
            pins,
            held: None,
            wanted: Vec3::ZERO,
            positions: mesh.positions.clone(),
            velocities: vec![Vec3::ZERO; mesh.positions.len()],
            normals: vec![Vec3::Y; mesh.positions.len()],
            edges,
            substeps: 0,
            levels: 0,
            mesh,
            options,
        };
        toy.shade();
        Ok(toy)
    }

    /// Selects a method by name, the substeps per 1/60 s (0: as many as keep the stretch of 99 % of the area below 3
    /// %), and whether to use levels.
    ///
    /// # Errors
    /// If there is no such method.
    pub fn set(&mut self, method: &str, substeps: u32, levels: bool) -> Result<(), JsError> {
        let method = match method {
            "small steps" => Method::SmallSteps,
            "relaxation" => Method::Relaxation { iterations: ITERATIONS },
            "springs" => Method::Springs,
            _ => return Err(JsError::new(&format!("method {method}: not small steps, relaxation or springs"))),
        };
        let quality = if substeps == 0 { Quality::Strain(0.03) } else { Quality::Substeps(substeps) };
        let levels = if levels { Levels::Auto } else { Levels::Off };
        if (method, quality, levels) == (self.options.method, self.options.quality, self.options.levels) {
            return Ok(());
        }
        let before = self.options.clone();
        self.options = Options { method, quality, levels, ..before.clone() };
        self.rebuild().inspect_err(|_| self.options = before)
    }

    /// Sets wind (m/s) and gravity (m/s²).
    pub fn blow(&mut self, wind: f32, gravity: f32) {
        (self.wind, self.gravity) = (wind, gravity);
        self.twin.iter_mut().for_each(Twin::begin_anew);
    }

    /// Starts or stops the comparison with a resolved run. On a GPU, where the state arrives late, there is no
    /// comparison.
    pub fn compare(&mut self, compare: bool) {
        if compare == self.twin.is_some() {
            return;
        }
        let attributes = self.preset.attributes(self.time, self.wind, self.gravity);
        self.twin = if compare && !self.on_gpu { Twin::new(&self.mesh, &self.options, &attributes) } else { None };
    }

    /// Whether a step can be taken now. A GPU that is slower than the clock must not be given more and more steps to do.
    #[must_use]
    pub fn ready(&self) -> bool {
        !self.on_gpu || self.requested.is_none() || self.steps < QUEUED
    }

    /// Takes a step of 1/60 s.
    ///
    /// # Errors
    /// If the motion became unstable. The cloth is then unchanged.
    pub fn step(&mut self) -> Result<(), JsError> {
        let time = self.time + FRAME;
        let mut attributes = self.preset.attributes(time, self.wind, self.gravity);
        let lead = self.preset.lead(time);
        let held = self.held.map(|held| self.led(held));
        let targets = self.pins.iter().map(|pin| *pin + lead).chain(held);
        attributes.pin_targets = Some(targets.collect()).filter(|targets: &Vec<Vec3>| !targets.is_empty());
        let report = self.cloth.step(FRAME, &attributes)?;
        (self.time, self.held, self.steps) = (time, held, self.steps + 1);
        (self.substeps, self.levels) = (report.substeps, report.levels);
        if self.on_gpu {
            return Ok(());
        }
        let positions = self.cloth.positions()?.to_vec();
        if let Some(twin) = &mut self.twin {
            twin.step(&attributes, (&self.positions, &self.velocities), &positions, FRAME / report.substeps as f32);
        }
        self.positions = positions;
        self.velocities = self.cloth.velocities()?.to_vec();
        self.shade();
        Ok(())
    }

    /// Requests the state from a GPU, unless it is the one that is shown or one that was requested has not arrived. Returns
    /// whether it did; [`Toy::arrived`] receives the state later.
    ///
    /// # Errors
    /// If the GPU was lost.
    pub fn request(&mut self) -> Result<bool, JsError> {
        if self.requested.is_some() || self.steps == 0 {
            return Ok(false);
        }
        self.cloth.request_positions()?;
        self.requested = Some(std::mem::take(&mut self.steps));
        Ok(true)
    }

    /// How many steps after the previous state the requested one is, if it has arrived; otherwise 0.
    ///
    /// # Errors
    /// As [`Toy::step`]; on a GPU errors arrive late.
    pub fn arrived(&mut self) -> Result<u32, JsError> {
        let Some(steps) = self.requested else { return Ok(0) };
        let positions = match self.cloth.requested_positions() {
            Ok(Some(positions)) => positions,
            Ok(None) => return Ok(0),
            Err(error) => {
                self.requested = None;
                return Err(error.into());
            }
        };
        let rate = 1.0 / (FRAME * steps as f32);
        self.velocities = positions.iter().zip(&self.positions).map(|(now, before)| (*now - *before) * rate).collect();
        self.positions = positions.to_vec();
        self.requested = None;
        self.shade();
        Ok(steps)
    }

    /// Grabs the vertex nearest to the eye that a ray passes. Returns its distance along the ray, or nothing.
    ///
    /// # Errors
    /// If the GPU was lost.
    pub fn grab(&mut self, eye: &[f32], way: &[f32]) -> Result<Option<f32>, JsError> {
        let (eye, way) = (Vec3::from_slice(eye), Vec3::from_slice(way).normalize());
        let along = |x: &Vec3| (*x - eye).dot(way);
        let is_near = |x: &Vec3| along(x) > 0.0 && (*x - eye - way * along(x)).length() < REACH;
        let found =
            self.positions.iter().enumerate().filter(|(_, x)| is_near(x)).min_by(|a, b| along(a.1).total_cmp(&along(b.1)));
        let Some((vertex, &x)) = found.filter(|(vertex, _)| !self.options.pinned.contains(&(*vertex as u32))) else {
            return Ok(None);
        };
        self.options.pinned.push(vertex as u32);
        (self.held, self.wanted) = (Some(x), x);
        self.repin().inspect_err(|_| {
            self.options.pinned.pop();
            self.held = None;
        })?;
        Ok(Some(along(&x)))
    }

    /// Moves the grabbed vertex toward a point (m).
    pub fn drag(&mut self, to: &[f32]) {
        self.wanted = Vec3::from_slice(to);
    }

    /// Releases the grabbed vertex.
    ///
    /// # Errors
    /// If the GPU was lost.
    pub fn release(&mut self) -> Result<(), JsError> {
        let (Some(held), Some(vertex)) = (self.held, self.options.pinned.last().copied()) else { return Ok(()) };
        self.held = None;
        self.options.pinned.pop();
        self.repin().inspect_err(|_| {
            self.options.pinned.push(vertex);
            self.held = Some(held);
        })
    }

    /// Returns to the initial state.
    ///
    /// # Errors
    /// If the GPU was lost.
    pub fn reset(&mut self) -> Result<(), JsError> {
        self.release()?;
        self.cloth.reset();
        (self.time, self.steps, self.requested) = (0.0, 0, None);
        self.positions.clone_from(&self.mesh.positions);
        self.velocities.fill(Vec3::ZERO);
        self.twin.iter_mut().for_each(Twin::begin_anew);
        self.shade();
        Ok(())
    }

    /// Vertex indices of the triangles.
    #[must_use]
    pub fn triangles(&self) -> Vec<u32> {
        self.mesh.triangles.as_flattened().to_vec()
    }

    /// Positions (m), three numbers per vertex.
    #[must_use]
    pub fn positions(&self) -> Vec<f32> {
        flat(&self.positions)
    }

    /// Unit normals, three numbers per vertex.
    #[must_use]
    pub fn normals(&self) -> Vec<f32> {
        flat(&self.normals)
    }

    /// Spheres and capsules as they are now: both ends (m) and the radius (m) of each.
    #[must_use]
    pub fn bodies(&self) -> Vec<f32> {
        let colliders = self.preset.attributes(self.time, self.wind, self.gravity).colliders;
        let seven = |a: Vec3, b: Vec3, radius: f32| [a.x, a.y, a.z, b.x, b.y, b.z, radius];
        let shown = colliders.iter().filter_map(|collider| match collider.shape {
            cloth_deformer::Shape::Sphere { center, radius } => Some(seven(center, center, radius)),
            cloth_deformer::Shape::Capsule { a, b, radius } => Some(seven(a, b, radius)),
            _ => None,
        });
        shown.flatten().collect()
    }

    /// Mean and largest stretch of the edges; kinetic energy (J for one kilogram); substeps and levels of the last
    /// frame; distance (m) of the cloth from the resolved run when the two were last compared, negative if they were
    /// not.
    #[must_use]
    pub fn report(&self) -> Vec<f32> {
        let stretch = |([a, b], rest): &([u32; 2], f32)| {
            (self.positions[*a as usize].distance(self.positions[*b as usize]) / rest - 1.0).max(0.0)
        };
        let (sum, worst) = self.edges.iter().map(stretch).fold((0.0, 0.0_f32), |(sum, worst), s| (sum + s, worst.max(s)));
        let squares: f32 = self.velocities.iter().map(|v| v.length_squared()).sum();
        let error = self.twin.as_ref().and_then(|twin| twin.error).unwrap_or(-1.0);
        let (mean, energy) = (sum / self.edges.len() as f32, 0.5 * squares / self.velocities.len() as f32);
        vec![mean, worst, energy, self.substeps as f32, self.levels as f32, error]
    }
}

impl Toy {
    /// The next position of the hand: on its way to where it is wanted, as far as the surrounding cloth follows.
    fn led(&self, held: Vec3) -> Vec3 {
        let mut led = held + (self.wanted - held).clamp_length_max(HAND * FRAME);
        let Some(&vertex) = self.options.pinned.last() else { return led };
        for ([a, b], rest) in self.edges.iter().filter(|([a, b], _)| *a == vertex || *b == vertex) {
            let other = self.positions[if *a == vertex { *b } else { *a } as usize];
            led = other + (led - other).clamp_length_max(PULL * rest);
        }
        led
    }

    /// Continues from the state as shown, with other options.
    fn rebuild(&mut self) -> Result<(), JsError> {
        let mut cloth = Deformer::new(&self.mesh, self.options.clone())?;
        cloth.set_state(&self.positions, &self.velocities)?;
        self.cloth = cloth;
        // What was requested of the other one does not arrive.
        (self.steps, self.requested) = (0, None);
        if self.twin.is_some() {
            self.compare(true);
        }
        Ok(())
    }

    /// Continues with the current pins of the options. If the state arrives late, this uses the state as shown.
    fn repin(&mut self) -> Result<(), JsError> {
        if self.on_gpu {
            return self.rebuild();
        }
        self.cloth.set_pinned(self.options.pinned.clone())?;
        self.twin.iter_mut().for_each(|twin| twin.set_pinned(&self.options.pinned));
        Ok(())
    }

    /// Computes the normals of the state as shown.
    fn shade(&mut self) {
        self.normals.fill(Vec3::ZERO);
        for triangle in &self.mesh.triangles {
            let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize]);
            let normal = (b - a).cross(c - a);
            triangle.iter().for_each(|&vertex| self.normals[vertex as usize] += normal);
        }
        self.normals.iter_mut().for_each(|normal| *normal = normal.normalize_or(Vec3::Y));
    }
}

fn flat(vectors: &[Vec3]) -> Vec<f32> {
    vectors.iter().flat_map(|v| v.to_array()).collect()
}
