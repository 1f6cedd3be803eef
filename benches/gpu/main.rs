//! Checks the backends of this machine against each other, finds the substeps that make the motion right, then times
//! them. Writes tables in Markdown and a CSV file, to be kept beside the charts made from them (`benches/results`).
//!
//! ```text
//! cargo bench --bench gpu                                  # everything, some minutes on a hardware GPU
//! cargo bench --bench gpu -- --quick                       # small sheets, a minute
//! cargo bench --bench gpu -- --crowd --unchecked           # many cloths at once alone
//! cargo bench --bench gpu -- --forces --unchecked          # the cost of each force on the GPU alone
//! cargo bench --bench gpu -- --sizes 64,256 --csv gpu.csv --date 2026-11-21 --commit 1234567
//! ```
//!
//! The program that cargo builds is self-contained: it can be copied to another machine and run there.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, value_parser};
use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Gpu, Levels, Options, wgpu};

use crate::checks::Checks;
use crate::device::request;
use crate::hang::{Run, Trial, make, scene};
use crate::limit::Limit;
use crate::timing::{DeviceClock, Times, time};

mod checks;
#[path = "../device.rs"]
mod device;
mod hang;
mod limit;
mod timing;

/// Number of cloths of 64 x 64 vertices in a crowd, without and with `--quick`.
const CROWD: [usize; 2] = [64, 8];
/// NVIDIA Newton 1.8 on the same scene, measured separately on an H200: its rows closest to 1 % mean strain with the
/// right fall (milliseconds per frame, then the strain).
const NEWTON: [(u32, &str); 6] = [
    (32, "0.41 (0.71 %)"),
    (64, "4.45 (0.67 %)"),
    (128, "3.1 (1.1 %)"),
    (256, "7.5 (4.5 %)"),
    (512, "63 (4.7 %)"),
    (1024, "no valid run"),
];

type Failure = Box<dyn std::error::Error>;

/// Checks and times the backends of this machine.
#[expect(clippy::struct_excessive_bools, reason = "switches of a command line")]
#[derive(Debug, Parser)]
struct Arguments {
    /// Fewer checks and small sheets
    #[arg(long)]
    quick: bool,
    /// Vertices per side of the sheets [default: 32,64,128,256,512,1024,2048; 32,64,128 with --quick]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = value_parser!(u32).range(3..=2048))]
    sizes: Vec<u32>,
    /// A mesh on which the backends are checked in addition to the grid
    #[arg(long, value_name = "MESH.obj")]
    mesh: Option<PathBuf>,
    /// Skip the checks and only measure times
    #[arg(long)]
    unchecked: bool,
    /// The crowd alone
    #[arg(long)]
    crowd: bool,
    /// The cost of each force on the GPU alone, without levels too
    #[arg(long)]
    forces: bool,
    /// Longest run of two seconds of motion that is worth it to find the substeps (s)
    #[arg(long, value_name = "S", default_value = "6")]
    patience: f64,
    /// Write the numbers for a chart to this file
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Date to print above the table
    #[arg(long, default_value = "undated")]
    date: String,
    /// Commit to print above the table
    #[arg(long, default_value = "unknown")]
    commit: String,
    /// Passed by cargo to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("gpu: {error}");
            ExitCode::from(2)
        }
    }
}

/// The whole program, from top to bottom. Returns whether all checks pass.
fn run(arguments: &Arguments) -> Result<bool, Failure> {
    let gpu = request(wgpu::Features::TIMESTAMP_QUERY);
    let backends = match gpu {
        Some(_) => vec![Backend::Cpu, Backend::Hybrid, Backend::Gpu],
        None => vec![Backend::Cpu],
    };
    let adapter = gpu.as_ref().map_or("no GPU", Gpu::name).to_owned();
    let threads = std::thread::available_parallelism().map_or(0, usize::from);
    println!("{}, commit {}, adapter {adapter}, {threads} CPU threads\n", arguments.date, arguments.commit);
    let good = arguments.unchecked || Checks::new(&backends, gpu.as_ref()).run(arguments.mesh.as_deref(), arguments.quick)?;

    let clock = gpu.as_ref().and_then(DeviceClock::new);
    if let (true, Some(gpu)) = (arguments.forces, &gpu) {
        let sizes = if arguments.sizes.is_empty() { &[128, 256, 512, 1024] } else { arguments.sizes.as_slice() };
        return forces(gpu, clock.as_ref(), sizes).map(|()| good);
    }
    let limit = gpu.as_ref().map(Limit::new).transpose()?;
    let mut bench = Bench { arguments, adapter, backends, gpu: gpu.as_ref(), clock, limit, rows: Vec::new() };
    bench.crowd()?;
    if arguments.crowd {
        bench.save()?;
        return Ok(good);
    }
    bench.terms(if arguments.quick { &[64] } else { &[128, 512] })?;
    let default: &[u32] = if arguments.quick { &[32, 64, 128] } else { &[32, 64, 128, 256, 512, 1024, 2048] };
    // The largest last, so that what was done when patience ends is kept.
    bench.sheets(if arguments.sizes.is_empty() { default } else { &arguments.sizes })?;
    Ok(good)
}

/// A row of the tables.
#[derive(Debug, Clone)]
struct Row {
    scene: &'static str,
    backend: Backend,
    n: u32,
    substeps: u32,
    times: Times,
    /// Two seconds on the first available of the GPU and the CPU; strain and fall are the same on each.
    run: Option<Run>,
    /// The least time in which the device executes as many dispatches (ms): see [`Limit::of`].
    limit: Option<f64>,
}

/// What all timings share.
struct Bench<'a> {
    arguments: &'a Arguments,
    adapter: String,
    backends: Vec<Backend>,
    gpu: Option<&'a Gpu>,
    clock: Option<DeviceClock>,
    limit: Option<Limit>,
    rows: Vec<Row>,
}

impl Bench<'_> {
    /// Times some cloths and keeps the row.
    fn time(
        &mut self,
        row: (&'static str, u32, u32),
        backend: Backend,
        cloths: &mut [Deformer],
        scene: &Attributes,
    ) -> Result<Times, Failure> {
        let clock = self.clock.as_ref().filter(|_| backend == Backend::Gpu);
        let times = time(cloths, scene, clock)?;
        let (scene, n, substeps) = row;
        let limit = match (&self.limit, &*cloths) {
            (Some(limit), [cloth]) => limit.of(cloth),
            _ => None,
        };
        self.rows.push(Row { scene, backend, n, substeps, times, run: None, limit });
        Ok(times)
    }

    /// HANG at 20 substeps, and at the least number that makes the motion right.
    fn sheets(&mut self, sizes: &[u32]) -> Result<(), Failure> {
        println!(
            "\nHANG, ms per frame (medians, nothing read back), at 20 substeps and at the fewest with the right motion: mean strain"
        );
        println!(
            "at most 1 %, sampled every 20 frames over 2 s; center of mass down by 0.372 m within 2 % at frame 20; no energy gained."
        );
        println!(
            "Queued: frames submitted without waiting; device: the same by the GPU's clock. Limit: as many of the shortest dispatches;"
        );
        println!("over: the device's time divided by the limit.\n");
        println!(
            "| N | S | levels | mean strain | max | drop | motion | Cpu | Hybrid | Gpu | queued | device | limit | over | Newton 1.8 (H200, measured elsewhere) |"
        );
        println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
        let judge = *self.backends.last().ok_or("no backend")?;
        for &n in sizes {
            eprintln!("HANG, N = {n} ..");
            let mut trials = hang::trials(n, judge, Levels::Auto, self.gpu, self.arguments.patience)?;
            if !trials.iter().any(|trial| trial.run.is_right()) {
                println!("| {n} | more | | | | | none right within {} s a run |{}", self.arguments.patience, " |".repeat(8));
            }
            if trials.iter().any(|trial| trial.run.levels > 0) {
                // Without levels too, if there is a number that makes the motion right; there the substeps alone must
                // do it.
                let without = hang::trials(n, judge, Levels::Off, self.gpu, self.arguments.patience)?;
                trials.extend(without.into_iter().filter(|trial| trial.run.is_right()));
            }
            for trial in &mut trials {
                self.sheet(n, trial, judge)?;
            }
            self.save()?;
        }
        Ok(())
    }

    /// Prints a row of the table.
    fn sheet(&mut self, n: u32, trial: &mut Trial, judge: Backend) -> Result<(), Failure> {
        let Trial { substeps, run, cloth } = trial;
        let run = *run;
        let (mut cells, mut deep) = (Vec::new(), String::from("- | - | - | -"));
        for backend in [Backend::Cpu, Backend::Hybrid, Backend::Gpu] {
            // If a frame takes seconds, the limit says nothing more.
            let too_slow = match backend {
                Backend::Hybrid => n > 512 || *substeps > 50,
                Backend::Cpu => n > 1024 || *substeps > 50,
                _ => false,
            };
            if too_slow || !self.backends.contains(&backend) {
                cells.push("-".to_owned());
                continue;
            }
            let row = ("hang", n, *substeps);
            let times = if backend == judge {
                self.time(row, backend, std::slice::from_mut(cloth), &Attributes::default())?
            } else {
                let (mesh, options) = scene::hang(n, *substeps, backend);
                let levels = if run.levels > 0 { Levels::Auto } else { Levels::Off };
                let cloth = make(&mesh, Options { levels, ..options }, self.gpu)?;
                self.time(row, backend, &mut [cloth], &Attributes::default())?
            };
            cells.push(format!("{:.3}", times.frame));
            if backend == Backend::Gpu {
                let device = times.device.map_or("-".to_owned(), |ms| format!("{ms:.3}"));
                let limit = self.rows.last().and_then(|row| row.limit);
                let cell = limit.map_or("- | -".to_owned(), |limit| {
                    let over = times.device.map_or("-".to_owned(), |ms| format!("{:.2}", ms / limit));
                    format!("{limit:.3} | {over}")
                });
                deep = format!("{:.3} | {device} | {cell}", times.queued);
            }
            if let Some(row) = self.rows.last_mut() {
                row.run = Some(run);
            }
        }
        let newton = NEWTON.iter().find(|(size, _)| *size == n).map_or("", |(_, cell)| cell);
        let Run { mean_strain, max_strain, drop, levels, .. } = run;
        let motion = format!("{levels} | {mean_strain:.2e} | {max_strain:.2e} | {drop:.4} | {}", run.verdict());
        println!("| {n} | {substeps} | {motion} | {} | {deep} | {newton} |", cells.join(" | "));
        Ok(())
    }

    /// Writes the rows so far.
    fn save(&self) -> Result<(), Failure> {
        match &self.arguments.csv {
            Some(path) => Ok(std::fs::write(path, csv(&self.rows, &self.adapter, self.arguments))?),
            None => Ok(()),
        }
    }

    /// The cost of each term of a scene, at 20 substeps.
    fn terms(&mut self, sizes: &[u32]) -> Result<(), Failure> {
        println!("\nHANG with more forces, S = 20: ms per frame\n\n| N | scene | {} |", names(&self.backends));
        println!("|---|---|{}", "---|".repeat(self.backends.len()));
        for &n in sizes {
            for (name, fabric, attributes) in terms() {
                let mut cells = Vec::new();
                for backend in self.backends.clone() {
                    let (mesh, options) = scene::hang(n, 20, backend);
                    let cloth = make(&mesh, Options { fabric, ..options }, self.gpu)?;
                    let times = self.time((name, n, 20), backend, &mut [cloth], &attributes)?;
                    cells.push(format!("{:.3}", times.frame));
                }
                println!("| {n} | {name} | {} |", cells.join(" | "));
            }
        }
        Ok(())
    }

    /// Many cloths at once, compared with one.
    fn crowd(&mut self) -> Result<(), Failure> {
        let count = CROWD[usize::from(self.arguments.quick)];
        println!("\n{count} cloths of 64 x 64, S = 20, in the time of one: ms a frame of all\n");
        println!("| scene | backend | levels | one | {count} | times |\n|---|---|---|---|---|---|");
        let [plain, _, _, blown] = terms();
        let scenes = [
            ("crowd", "one of a crowd", Levels::Auto, &plain),
            ("crowd without levels", "one of a crowd", Levels::Off, &plain),
            ("crowd with bending and wind", "one with bending and wind", Levels::Auto, &blown),
            ("crowd with bending and wind and without levels", "one with bending and wind", Levels::Off, &blown),
        ];
        // The GPU first, while it is still at its full clock rate.
        for backend in self.backends.clone().into_iter().rev().filter(|&backend| backend != Backend::Hybrid) {
            for (name, alone, levels, (term, fabric, attributes)) in scenes {
                let gpu = self.gpu;
                let (mesh, options) = scene::hang(64, 20, backend);
                let options = Options { levels, fabric: *fabric, ..options };
                let cloths = |count| (0..count).map(|_| make(&mesh, options.clone(), gpu)).collect::<Result<Vec<_>, _>>();
                let one = self.time((alone, 64, 20), backend, &mut cloths(1)?, attributes)?.frame;
                let all = self.time((name, 64, 20), backend, &mut cloths(count)?, attributes)?.frame;
                println!("| {term} | {backend:?} | {levels:?} | {one:.3} | {all:.3} | {:.2} |", all / one);
            }
        }
        Ok(())
    }
}

/// The cost of each term of a scene on the GPU, at 20 substeps, frames queued, with levels and without. Bending is also so weak
/// that it takes a single pass.
fn forces(gpu: &Gpu, clock: Option<&DeviceClock>, sizes: &[u32]) -> Result<(), Failure> {
    println!(
        "HANG, S = 20: us per substep, frames queued, with levels and without\n\n| N | scene | levels | no levels |\n|---|---|---|---|"
    );
    for &n in sizes {
        let [plain, bent, blown, both] = terms();
        let weak = Fabric { bending: 1e-4 * (20.0 / n as f32).powi(4), ..bent.1 };
        let [once, once_blown] = [("bending in one pass", &bent), ("bending in one pass, wind", &both)]
            .map(|(name, term)| (name, weak, term.2.clone()));
        for (name, fabric, attributes) in [plain, once, blown, once_blown, bent, both] {
            let mut cells = Vec::new();
            for levels in [Levels::Auto, Levels::Off] {
                let (mesh, options) = scene::hang(n, 20, Backend::Gpu);
                let cloth = make(&mesh, Options { fabric, levels, ..options }, Some(gpu))?;
                let times = time(&mut [cloth], &attributes, clock)?;
                cells.push(format!("{:.1}", times.device.unwrap_or(times.queued) * 1e3 / 20.0));
            }
            println!("| {n} | {name} | {} |", cells.join(" | "));
        }
    }
    Ok(())
}

/// HANG as it is, with bending, with wind, and with both: a name, the fabric and what acts on it.
fn terms() -> [(&'static str, Fabric, Attributes); 4] {
    let plain = scene::hang(3, 20, Backend::Cpu).1.fabric;
    let bent = Fabric { bending: 1e-4, damping: 0.03, ..plain };
    let breeze = Attributes { wind: Vec3::new(1.0, 0.0, 2.0), air_density: 1.225, ..Attributes::default() };
    [
        ("hang", plain, Attributes::default()),
        ("bending", bent, Attributes::default()),
        ("wind", plain, breeze.clone()),
        ("bending, wind", bent, breeze),
    ]
}

fn names(backends: &[Backend]) -> String {
    backends.iter().map(|backend| format!("{backend:?}")).collect::<Vec<_>>().join(" | ")
}

/// One line per row. What was not measured stays empty.
fn csv(rows: &[Row], adapter: &str, arguments: &Arguments) -> String {
    let mut text = String::from(
        "scene,backend,method,n,substeps,ms,mean_strain,max_strain,drop,adapter,date,commit,levels,ms_queued,ms_device,ms_limit,over\n",
    );
    for Row { scene, backend, n, substeps, times, run, limit } in rows.iter().cloned() {
        let figure = |figure: Option<f64>| figure.map_or(String::new(), |figure| format!("{figure:.4e}"));
        let motion =
            [run.map(|run| run.mean_strain), run.map(|run| run.max_strain), run.map(|run| run.drop)].map(figure).join(",");
        let levels = run.map_or(String::new(), |run| run.levels.to_string());
        let over = times.device.zip(limit).map(|(ms, limit)| ms / limit);
        let backend = format!("{backend:?}").to_lowercase();
        let adapter = if backend == "cpu" { "" } else { adapter }.replace(',', ";");
        let (scene, device) = (scene.replace(',', " and"), figure(times.device));
        let Arguments { date, commit, .. } = arguments;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{scene},{backend},small-steps,{n},{substeps},{:.4},{motion},{adapter},{date},{commit},{levels},{:.4},{device},{},{}",
            times.frame,
            times.queued,
            figure(limit),
            figure(over),
        );
    }
    text
}
