//! Runs a scene of the web page outside a browser, for the page's test, and prints the final positions. Usage:
//! `page_native SCENE SIZE FRAMES`

#[path = "src/preset.rs"]
mod preset;

use cloth_deformer::{Backend, Deformer, Levels, Options, Quality};

/// Length of a frame (s).
const FRAME: f32 = 1.0 / 60.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, size, frames] = arguments.as_slice() else { return Err("a scene, its size and a number of frames".into()) };
    let preset = preset::Preset::named(scene).ok_or("no such scene")?;
    let (mesh, pinned) = preset.mesh(size.parse()?);
    let pins: Vec<_> = pinned.iter().map(|&vertex| mesh.positions[vertex as usize]).collect();
    let (quality, levels) = (Quality::Substeps(20), Levels::Auto);
    let options = Options { backend: Backend::Cpu, fabric: preset.fabric(), pinned, quality, levels, ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options)?;
    let mut time = 0.0;
    for _ in 0..frames.parse::<u32>()? {
        time += FRAME;
        let mut attributes = preset.attributes(time, preset.wind(), 9.81);
        let lead = preset.lead(time);
        attributes.pin_targets = (!pins.is_empty()).then(|| pins.iter().map(|pin| *pin + lead).collect());
        cloth.step(FRAME, &attributes)?;
    }
    let positions: Vec<f32> = cloth.positions()?.iter().flat_map(cloth_deformer::glam::Vec3::to_array).collect();
    println!("{positions:?}");
    Ok(())
}
