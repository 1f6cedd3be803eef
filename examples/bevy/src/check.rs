//! Tries the example without a window, with frames of very different lengths, and leaves pictures.
//!
//! What Bevy draws from is read back here, and here alone, and compared with a cape on the CPU that takes the same steps and is never
//! teleported.

use std::path::Path;
use std::process::ExitCode;
use std::sync::mpsc;
use std::time::Duration;

use bevy::app::PluginsState;
use bevy::camera::RenderTarget;
use bevy::prelude::*;
use bevy::render::RenderApp;
use bevy::render::mesh::allocator::{MeshAllocator, MeshAllocatorSettings};
use bevy::render::render_resource::TextureFormat;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
use bevy::time::TimeUpdateStrategy;
use bevy::window::ExitCondition;
use cloth_deformer::glam::{self, Affine3A};
use cloth_deformer::{Backend, Deformer, wgpu};

use crate::body::Pose;
use crate::cape;
use crate::cloth::{CapeMesh, ClothPlugin};
use crate::scene::ScenePlugin;
use crate::walk::{Walk, WalkPlugin};

/// Size of the pictures (pixels).
const SIZE: [u32; 2] = [480, 360];
/// Lengths of frames (ms), in turn.
const FRAMES: [u64; 6] = [5, 33, 16, 50, 8, 21];
/// Updates in which no time passes, until shaders are there, and until a picture is.
const WARM_UP: u32 = 20;
/// Where the body is put: whole tiles away, so that the picture stays the same.
const JUMP: glam::Vec3 = glam::Vec3::new(3.0, 0.0, -5.0);
/// How far (m) the vertices may be from those of the CPU's cape, in the mean: before the cape has folds, and when it has. Rounding
/// differs between the backends, and folds amplify it; in one step the body walks 0.025 m.
const SMOOTH: f32 = 1e-4;
const FOLDED: f32 = 0.012;

/// Runs all of it; says what was wrong, if anything was.
pub(crate) fn check(folder: &Path) -> ExitCode {
    match run(folder) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(folder: &Path) -> Result {
    std::fs::create_dir_all(folder)?;
    let mut trial = Trial::new()?;

    trial.walk(130)?;
    trial.compare("at the start", glam::Vec3::ZERO, SMOOTH)?;
    trial.walk(1200)?;
    trial.compare("after a walk", glam::Vec3::ZERO, FOLDED)?;
    let walked = trial.picture(folder, "walk.png")?;
    let red = |picture: &Image| {
        let pixels = picture.data.as_deref().unwrap_or_default().chunks_exact(4);
        let is_red = |pixel: &&[u8]| pixel[0] > 60 && pixel[0] / 2 > pixel[1].max(pixel[2]);
        pixels.filter(is_red).count() as f32 / (SIZE[0] * SIZE[1]) as f32
    };
    let share = red(&walked);
    println!("walk.png: {:.1} % of it is the cape", 100.0 * share);
    if !(0.03..0.4).contains(&share) {
        return Err(format!("the cape takes {share} of walk.png, where 0.03 to 0.4 was expected").into());
    }

    trial.app.world_mut().resource_mut::<Time<Virtual>>().pause();
    trial.walk(100)?;
    let paused = trial.picture(folder, "paused.png")?;
    if paused.data != walked.data {
        return Err("the picture changed while the clock was paused".into());
    }
    println!("paused.png: the same as walk.png");
    trial.app.world_mut().resource_mut::<Time<Virtual>>().unpause();

    trial.app.world_mut().resource_mut::<Walk>().jump = Some(Affine3A::from_translation(JUMP));
    trial.walk(100)?;
    trial.compare("after a teleport", JUMP, FOLDED)?;
    let share = red(&trial.picture(folder, "teleported.png")?);
    println!("teleported.png: {:.1} % of it is the cape", 100.0 * share);
    if !(0.03..0.4).contains(&share) {
        return Err(format!("the cape takes {share} of teleported.png, where 0.03 to 0.4 was expected").into());
    }
    Ok(())
}

/// An app without a window, and a cape on the CPU that takes the same steps.
struct Trial {
    app: App,
    target: Handle<Image>,
    frame: usize,
    /// Steps that the twin has taken, and where it was before the last one.
    steps: u32,
    twin: Deformer,
    before: Vec<glam::Vec3>,
}

impl Trial {
    fn new() -> Result<Trial> {
        let mut app = App::new();
        let windows = WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() };
        let plugins = DefaultPlugins.set(windows);
        #[cfg(feature = "window")]
        let plugins = plugins.disable::<bevy::winit::WinitPlugin>();
        app.add_plugins((plugins, ClothPlugin, WalkPlugin, ScenePlugin));
        app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
        while app.plugins_state() == PluginsState::Adding {
            bevy::tasks::tick_global_task_pools_on_main_thread();
        }
        app.finish();
        app.cleanup();
        if let Some(render) = app.get_sub_app_mut(RenderApp) {
            render.world_mut().resource_mut::<MeshAllocatorSettings>().extra_buffer_usages |= wgpu::BufferUsages::COPY_SRC;
        }
        let picture = Image::new_target_texture(SIZE[0], SIZE[1], TextureFormat::Rgba8UnormSrgb, None);
        let target = app.world_mut().resource_mut::<Assets<Image>>().add(picture);
        let twin = cape::deformer(&Pose::at(0.0, Affine3A::IDENTITY), Backend::Cpu, None)?;
        let mut trial = Trial { app, target, frame: 0, steps: 0, twin, before: Vec::new() };
        trial.app.update();
        let mut cameras = trial.app.world_mut().query_filtered::<Entity, With<Camera3d>>();
        let camera = cameras.single(trial.app.world())?;
        trial.app.world_mut().entity_mut(camera).insert(RenderTarget::Image(trial.target.clone().into()));
        (0..WARM_UP).for_each(|_| trial.app.update());
        Ok(trial)
    }

    /// Frames of all lengths, for so many milliseconds.
    fn walk(&mut self, milliseconds: u64) -> Result {
        let mut left = milliseconds;
        while left > 0 {
            let length = FRAMES[self.frame % FRAMES.len()].min(left);
            self.frame += 1;
            left -= length;
            self.app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_millis(length)));
            self.app.update();
        }
        self.app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
        let steps = self.app.world().resource::<Walk>().steps();
        for number in self.steps + 1..=steps {
            let time = number as f32 * cape::STEP;
            self.before = self.twin.positions()?.to_vec();
            self.twin.step(cape::STEP, &cape::attributes(&Pose::at(time, Affine3A::IDENTITY), time))?;
        }
        self.steps = steps;
        Ok(())
    }

    /// Compares what Bevy draws from with the twin, `moved` away from it (m).
    fn compare(&mut self, when: &str, moved: glam::Vec3, bound: f32) -> Result {
        let part = self.app.world().resource::<Time<Fixed>>().overstep_fraction();
        let drawn = self.vertices()?;
        let now = self.twin.positions()?;
        let expected = self.before.iter().zip(now).map(|(before, now)| before.lerp(*now, part) + moved);
        let apart: Vec<f32> = drawn.chunks_exact(8).zip(expected).map(|(x, y)| glam::Vec3::from_slice(x).distance(y)).collect();
        let (worst, mean) = (apart.iter().copied().fold(0.0, f32::max), apart.iter().sum::<f32>() / apart.len() as f32);
        println!(
            "{when}: {} vertices after {} steps, {part:.2} between two, {worst:.5} m apart at most, {mean:.6} m in the mean",
            apart.len(),
            self.steps
        );
        let lengths = drawn.chunks_exact(8).map(|vertex| (glam::Vec3::from_slice(&vertex[3..]).length() - 1.0).abs());
        match lengths.fold(0.0, f32::max) {
            off if off > 1e-3 => Err(format!("{when}: a normal is of length 1 +- {off}").into()),
            _ if mean.is_nan() || mean > bound || apart.len() != now.len() => Err(format!("{when}: that is too far").into()),
            _ => Ok(()),
        }
    }

    /// The part of Bevy's vertex buffers that is the cape's.
    fn vertices(&mut self) -> Result<Vec<f32>> {
        let mesh = self.app.world().resource::<CapeMesh>().0.id();
        let render = self.app.sub_app(RenderApp).world();
        let (device, queue) = (render.resource::<RenderDevice>().wgpu_device(), render.resource::<RenderQueue>());
        let slice = render.resource::<MeshAllocator>().mesh_vertex_slice(&mesh).ok_or("the cape is not among the vertices")?;
        let bytes = |vertices: u32| u64::from(vertices) * 32;
        let staging = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("check"),
            size: bytes(slice.range.end - slice.range.start),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(slice.buffer, bytes(slice.range.start), &staging, 0, staging.size());
        queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |_| {});
        device.poll(wgpu::PollType::wait_indefinitely())?;
        let seen = staging.get_mapped_range(..)?;
        Ok(seen.chunks_exact(4).map(|number| f32::from_ne_bytes([number[0], number[1], number[2], number[3]])).collect())
    }

    /// Takes a picture, and keeps it as a file.
    fn picture(&mut self, folder: &Path, name: &str) -> Result<Image> {
        let (send, receive) = mpsc::channel();
        let taken = move |captured: On<ScreenshotCaptured>| drop(send.send(captured.image.clone()));
        self.app.world_mut().spawn(Screenshot::image(self.target.clone())).observe(taken);
        for _ in 0..WARM_UP {
            self.app.update();
            if let Ok(picture) = receive.try_recv() {
                picture.clone().try_into_dynamic()?.to_rgb8().save(folder.join(name))?;
                return Ok(picture);
            }
        }
        Err(format!("{name}: there was no picture after {WARM_UP} frames").into())
    }
}
