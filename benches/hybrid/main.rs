//! How close the hybrid engine comes to its lower bound.
//!
//! ```text
//! cargo bench --bench hybrid                                  # some minutes on a real GPU
//! cargo bench --bench hybrid -- --quick                       # small sheets
//! cargo bench --bench hybrid -- --csv hybrid.csv --date 2026-11-21 --commit 1234567
//! ```
//!
//! The program that cargo builds is self-contained: it can be copied to another machine and run there.

#[path = "../device.rs"]
mod device;
mod floor;
mod scene;

use std::path::PathBuf;
use std::time::Instant;

use clap::{Parser, value_parser};
use cloth_deformer::{Backend, Deformer, Gpu, Options, wgpu};

use crate::device::request;
use crate::floor::{Way, floor};
use crate::scene::{FRAME, SUBSTEPS, Scene};

type Failure = Box<dyn std::error::Error>;

/// Compares the hybrid with the sum of its parts.
#[derive(Debug, Parser)]
struct Arguments {
    /// Small sheets only
    #[arg(long)]
    quick: bool,
    /// Vertices per side of the sheets [default: 64,128,256,512,1024; 32,64 with --quick]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = value_parser!(u32).range(3..=2048))]
    sizes: Vec<u32>,
    /// Also compare where the device reads and writes
    #[arg(long)]
    places: bool,
    /// Write the numbers for a chart to this file
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Date to record
    #[arg(long, default_value = "undated")]
    date: String,
    /// Commit to record
    #[arg(long, default_value = "unknown")]
    commit: String,
    /// Passed by cargo to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse();
    let Some(gpu) = request(wgpu::Features::MAPPABLE_PRIMARY_BUFFERS) else {
        println!("no GPU, not even a software driver: nothing to time");
        return Ok(());
    };
    let threads = rayon::current_num_threads();
    println!("{}, {threads} threads, S = {SUBSTEPS}; {} {}\n", gpu.name(), arguments.date, arguments.commit);
    let mut bench = Bench { gpu, rows: Vec::new() };
    let sizes: &[u32] = if arguments.quick { &[32, 64] } else { &[64, 128, 256, 512, 1024] };
    let sizes = if arguments.sizes.is_empty() { sizes } else { &arguments.sizes };
    if arguments.places {
        bench.places(sizes)?;
    }
    bench.floors(sizes)?;
    if let Some(path) = &arguments.csv {
        std::fs::write(path, bench.csv(&arguments))?;
    }
    Ok(())
}

/// A line of the CSV file.
#[derive(Debug)]
struct Row {
    scene: &'static str,
    n: u32,
    /// Milliseconds per step: transfers alone, force kernels alone, the rest on the CPU alone; the hybrid; everything
    /// on the CPU.
    floor: [f64; 3],
    hybrid: f64,
    cpu: f64,
}

struct Bench {
    gpu: Gpu,
    rows: Vec<Row>,
}

impl Bench {
    /// The hybrid compared with the sum of its parts.
    fn floors(&mut self, sizes: &[u32]) -> Result<(), Failure> {
        println!("us an exchange of 12 bytes a vertex each way, an empty kernel between (medians)\n");
        println!("| N | {} |\n|---|{}", Way::ALL.map(Way::name).join(" | "), "---|".repeat(Way::ALL.len()));
        let mut floors = Vec::new();
        for &n in sizes {
            let times = Way::ALL.map(|way| floor(&self.gpu, way, 12 * u64::from(n * n)));
            println!("| {n} | {} |", times.map(|time| format!("{:.0}", 1e6 * time)).join(" | "));
            floors.push(1e3 * times.into_iter().fold(f64::INFINITY, f64::min));
        }
        println!(
            "\nms a step of {SUBSTEPS} exchanges (medians): a: transfers alone, the best way; b: force kernels alone; c: the"
        );
        println!("CPU's own: the scene without its forces; d: the hybrid; all on the CPU\n");
        println!("| N | scene | a | b | c | a+b+c | d | d/(a+b+c) | Cpu |\n|---|---|---|---|---|---|---|---|---|");
        for (&n, exchange) in sizes.iter().zip(floors) {
            for scene in Scene::all(n) {
                let transfers = if scene.has_forces() { f64::from(SUBSTEPS) * exchange } else { 0.0 };
                self.beside_floor(n, &scene, transfers)?;
            }
        }
        Ok(())
    }

    fn cloth(&self, backend: Backend, scene: &Scene) -> Result<Deformer, Failure> {
        let options = Options { backend, gpu: Some(self.gpu.clone()), ..scene.options.clone() };
        Ok(Deformer::new(&scene.mesh, options)?)
    }

    fn beside_floor(&mut self, n: u32, scene: &Scene, transfers: f64) -> Result<(), Failure> {
        // With the same number of levels; without its forces, a scene might have others.
        let levels = self.cloth(Backend::Cpu, scene)?.step(FRAME, &scene.attributes)?.levels;
        let bare = scene.bare(levels);
        let cloths = [(Backend::Cpu, &bare), (Backend::Hybrid, scene), (Backend::Cpu, scene)];
        let mut cloths = cloths.map(|(backend, scene)| self.cloth(backend, scene).map(|cloth| (scene, cloth, Vec::new())));
        // The force kernels are repeated so that their time is a millisecond or so.
        let many = ((1 << 20) / (n * n)).clamp(6, 101);
        let mut kernels = [const { Vec::new() }; 2];
        let start = Instant::now();
        // In turn, so that other load on the machine affects all alike; the less important ones a few times only.
        for round in 0..41 {
            for (index, cloth) in cloths.iter_mut().enumerate() {
                let Ok((scene, cloth, times)) = cloth else { return Err("a cloth is missing".into()) };
                if index == 2 && round > 4 {
                    continue;
                }
                // Two in a row, because the second one finds its own state in the caches.
                cloth.step(FRAME, &scene.attributes)?;
                let start = Instant::now();
                cloth.step(FRAME, &scene.attributes)?;
                times.push(1e3 * start.elapsed().as_secs_f64());
                // Right after a step and only briefly: a GPU that works without pause for a tenth of a second runs
                // three times as fast as in the hybrid, where it waits for the CPU.
                if index == 1 && scene.has_forces() {
                    for (repeats, times) in [1, many].into_iter().zip(&mut kernels) {
                        let start = Instant::now();
                        cloth.run_forces(FRAME, &scene.attributes, repeats)?;
                        times.push(1e3 * start.elapsed().as_secs_f64());
                    }
                }
            }
            if round > 6 && start.elapsed().as_secs_f64() > 6.0 {
                break;
            }
        }
        let [own, hybrid, all] = cloths.map(|cloth| cloth.map(|(_, _, mut times)| median(&mut times)));
        let (own, hybrid, all) = (own?, hybrid?, all?);
        let [once, often] = kernels.map(|mut times| if scene.has_forces() { median(&mut times) } else { 0.0 });
        let kernels = f64::from(SUBSTEPS) * (often - once) / f64::from(many - 1);
        let sum = transfers + kernels + own;
        let ratio = hybrid / sum;
        println!(
            "| {n} | {} | {transfers:.2} | {kernels:.2} | {own:.2} | {sum:.2} | {hybrid:.2} | {ratio:.2} | {all:.2} |",
            scene.name
        );
        self.rows.push(Row { scene: scene.name, n, floor: [transfers, kernels, own], hybrid, cpu: all });
        Ok(())
    }

    /// The hybrid by where its device reads and writes: milliseconds per step.
    fn places(&self, sizes: &[u32]) -> Result<(), Failure> {
        let places = [("copied", [false, false]), ("outbox in place", [true, false]), ("both in place", [true, true])];
        println!("\nms a step by whether the device uses mapped memory itself\n");
        println!("| N | scene | {} |\n|---|---|---|---|---|", places.map(|place| place.0).join(" | "));
        for &n in sizes {
            for scene in Scene::all(n).iter().filter(|scene| ["bending", "wind"].contains(&scene.name)) {
                let mut cloth = self.cloth(Backend::Hybrid, scene)?;
                let mut times = [const { Vec::new() }; 3];
                for _ in 0..7 {
                    for (times, place) in times.iter_mut().zip(places) {
                        cloth.exchange_in_place(place.1);
                        cloth.step(FRAME, &scene.attributes)?;
                        let start = Instant::now();
                        cloth.step(FRAME, &scene.attributes)?;
                        times.push(1e3 * start.elapsed().as_secs_f64());
                    }
                }
                println!(
                    "| {n} | {} | {} |",
                    scene.name,
                    times.map(|mut times| format!("{:.2}", median(&mut times))).join(" | ")
                );
            }
        }
        Ok(())
    }

    fn csv(&self, arguments: &Arguments) -> String {
        let mut text =
            String::from("scene,n,substeps,transfers_ms,kernels_ms,cpu_own_ms,hybrid_ms,cpu_ms,adapter,date,commit,command\n");
        for Row { scene, n, floor, hybrid, cpu } in &self.rows {
            let floor = floor.map(|part| format!("{part:.4e}")).join(",");
            let adapter = self.gpu.name().replace(',', ";");
            let Arguments { date, commit, .. } = arguments;
            let line = format!(
                "{},{n},{SUBSTEPS},{floor},{hybrid:.4},{cpu:.4e},{adapter},{date},{commit},cargo bench --bench hybrid\n",
                scene.replace(',', " and")
            );
            text.push_str(&line);
        }
        text
    }
}

pub(crate) fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
