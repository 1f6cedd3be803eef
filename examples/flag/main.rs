//! A flag in the wind, drawn off-screen from the deformer's own buffers: only the finished picture passes through the
//! CPU.
//!
//! ```text
//! cargo run --release --example flag -- --frames 130 --out flag.png
//! ```

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, value_parser};
use cloth_deformer::{Backend, Gpu, wgpu};

use crate::render::Painter;

mod render;
mod scene;

type Failure = Box<dyn std::error::Error>;

/// Simulates a flag on the GPU and draws the last frame into a PNG file.
#[derive(Debug, Parser)]
#[command(name = "flag")]
struct Arguments {
    /// Number of frames of 1/60 s before the picture
    #[arg(long, value_name = "N", default_value = "130")]
    frames: u32,
    /// File for the picture
    #[arg(long, value_name = "FILE.png", default_value = "flag.png")]
    out: PathBuf,
    /// Height of the picture (pixels); its width is one and a half times that
    #[arg(long, value_name = "PIXELS", default_value = "720", value_parser = value_parser!(u32).range(8..=4096))]
    height: u32,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    // The renderer's device, with wgpu's default limits. The cloth uses it too.
    let gpu = request()?;
    let mut flag = scene::flag(Backend::Gpu, Some(gpu.clone()))?;
    for frame in 0..arguments.frames {
        flag.step(scene::FRAME, &scene::air(frame as f32 * scene::FRAME))?;
    }

    let painter = Painter::new(&gpu, [arguments.height * 3 / 2, arguments.height]);
    let pixels = painter.paint(Some(&mut flag))?;
    std::fs::write(&arguments.out, painter.png(&pixels)?)?;
    println!(
        "{}: {} vertices, {} frames on {}",
        arguments.out.display(),
        flag.vertex_order().len(),
        arguments.frames,
        gpu.name()
    );
    Ok(())
}

fn request() -> Result<Gpu, Failure> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let power_preference = wgpu::PowerPreference::HighPerformance;
    let wanted = wgpu::RequestAdapterOptions { power_preference, ..wgpu::RequestAdapterOptions::default() };
    let adapter = pollster::block_on(instance.request_adapter(&wanted))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()))?;
    Ok(Gpu::new(device, queue, adapter.get_info().name))
}
