//! The cost of `Quality::Strain`, compared with one number of substeps for the whole scene: the least that keeps the
//! same promise, which is found by trial and not known beforehand.
//!
//! ```text
//! cargo bench --bench quality                         # some minutes; meshes from the folder that CLOTH_MESHES names, if any
//! cargo bench --bench quality -- --strain 0.05 --only towel
//! cargo bench --bench quality -- --gpu                # a step is then timed until the device has done it
//! ```

mod scenes;

use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use cloth_deformer::{Backend, Deformer, Levels, Options, Quality, Warning};

use crate::scenes::{FRAME, Scene, scenes};

type Failure = Box<dyn std::error::Error>;

/// Runs each scene with a bound on strain and with constant substeps, in turn.
#[derive(Debug, Parser)]
struct Arguments {
    /// Bound on the stretch of 99 % of the area
    #[arg(long, default_value_t = 0.03)]
    strain: f32,
    /// Only scenes whose names contain this
    #[arg(long, default_value = "")]
    only: String,
    /// Run on the GPU
    #[arg(long)]
    gpu: bool,
    /// Without coarse levels
    #[arg(long)]
    no_levels: bool,
    /// Passed by cargo to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// One run of a scene.
#[derive(Default)]
struct Run {
    /// Total number of substeps.
    substeps: u32,
    /// Median and mean time of a step (ms).
    median: f64,
    mean: f64,
    /// Number of frames in which 99 % of the area exceeded the promise, and of frames in which that was reported.
    beyond: u32,
    warned: u32,
}

/// Plays a scene once with each quality, frame by frame in turn, so that other load on the machine slows all alike.
fn play<const N: usize>(scene: &Scene, qualities: [Quality; N], promised: f32) -> Result<[Run; N], Failure> {
    let build = |quality| Deformer::new(&scene.mesh, Options { quality, ..scene.options.clone() });
    let mut cloths = Vec::new();
    for quality in qualities {
        cloths.push((build(quality)?, Run::default(), Vec::new()));
    }
    for frame in 1..=scene.frames {
        let attributes = (scene.script)(frame);
        for (cloth, run, times) in &mut cloths {
            let start = Instant::now();
            let report = cloth.step(FRAME, &attributes)?;
            cloth.wait()?;
            times.push(1e3 * start.elapsed().as_secs_f64());
            run.substeps += report.substeps;
            run.beyond += u32::from(cloth.measure()?.stretch_share > promised);
            run.warned += u32::from(report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. })));
        }
    }
    let mut runs = cloths.into_iter().map(|(_, run, mut times)| {
        let mean = times.iter().sum::<f64>() / times.len() as f64;
        times.sort_by(f64::total_cmp);
        Run { median: times[times.len() / 2], mean, ..run }
    });
    Ok(std::array::from_fn(|_| runs.next().unwrap_or_default()))
}

/// The least constant number of substeps, in steps of a quarter of an octave, with at most the allowed number of frames
/// beyond the promise.
fn fewest(scene: &Scene, promised: f32, allowed: u32) -> Result<u32, Failure> {
    let mut count = 5;
    loop {
        let [run] = play(scene, [Quality::Substeps(count)], promised)?;
        if run.beyond <= allowed || count > 2000 {
            return Ok(count);
        }
        count = (f64::from(count) * 0.25_f64.exp2()).ceil() as u32;
    }
}

fn main() -> Result<(), Failure> {
    let Arguments { strain, only, gpu, no_levels, .. } = Arguments::parse();
    let backend = if gpu { Backend::Gpu } else { Backend::Cpu };
    let meshes = std::env::var_os("CLOTH_MESHES").map(PathBuf::from);
    println!(
        "| scene | vertices | frames | substeps | beyond, warned | ms | even substeps | beyond | ms | substeps, ms over even |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let (mut ratios, mut count) = ([0.0; 2], 0);
    let mut scenes = scenes(backend, meshes.as_deref())?;
    if no_levels {
        scenes.iter_mut().for_each(|scene| scene.options.levels = Levels::Off);
    }
    for scene in scenes.iter().filter(|scene| scene.name.contains(&only)) {
        let even = fewest(scene, strain, scene.frames / 100)?;
        let [kept, fixed] = play(scene, [Quality::Strain(strain), Quality::Substeps(even)], strain)?;
        let mean = |run: &Run| f64::from(run.substeps) / f64::from(scene.frames);
        let ratio = [mean(&kept) / mean(&fixed), kept.mean / fixed.mean];
        println!(
            "| {} | {} | {} | {:.1} | {}, {} | {:.2} | {even} | {} | {:.2} | {:.2}, {:.2} |",
            scene.name,
            scene.mesh.positions.len(),
            scene.frames,
            mean(&kept),
            kept.beyond,
            kept.warned,
            kept.median,
            fixed.beyond,
            fixed.median,
            ratio[0],
            ratio[1],
        );
        ratios.iter_mut().zip(ratio).for_each(|(sum, ratio)| *sum += ratio.ln());
        count += 1;
    }
    let [substeps, time] = ratios.map(|sum| (sum / f64::from(count.max(1))).exp());
    println!("\nGeometric mean over {count} scenes: {substeps:.2} of the even substeps, {time:.2} of their time.");
    Ok(())
}
