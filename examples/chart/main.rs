//! Charts error against time per frame for every method and backend: see `--help`.
//!
//! ```text
//! cargo run --release --example chart                              # sheets hung by an edge
//! cargo run --release --example chart -- --quick MESH.obj --pin top    # your own mesh, in a minute
//! ```

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::ExitCode;

use cloth_deformer::{Backend, Deformer, Levels, Mesh, Method, Options};

use crate::arguments::Arguments;
use crate::command::{Failure, say};
use crate::draw::{Axis, Chart, Curve, Line, Look, Marker};
use crate::measure::{Effort, Row, Setting};
use crate::scene::{Scene, Truth};

mod arguments;
#[path = "../../src/io/atomic_file.rs"]
mod atomic_file;
#[path = "../drape/command.rs"]
mod command;
mod draw;
#[allow(unreachable_pub, reason = "the tests' own")]
#[path = "../../tests/common/hang.rs"]
mod hang;
mod measure;
#[path = "../drape/pins.rs"]
mod pins;
#[allow(dead_code, unreachable_pub, reason = "the tests' own")]
#[path = "../../tests/common/reference.rs"]
mod reference;
mod scene;

fn main() -> ExitCode {
    command::run(run)
}

/// Runs the program from top to bottom.
fn run(arguments: &Arguments) -> Result<(), Failure> {
    let own = arguments.mesh.as_ref().map(|path| Scene::load(path, arguments)).transpose()?;
    let out = &arguments.out;
    fs::create_dir_all(out)
        .map_err(|error| Failure::input(format_args!("--out {}: {error}; name a directory that can be made", out.display())))?;
    let (backends, machine) = machine(&arguments.backends)?;
    let origin = [format!("{}; {machine}", arguments.date()), Arguments::command()];
    let effort = Effort::new(arguments, backends);
    if let Some(scene) = own {
        return chart_errors(&scene, &effort, &origin, out);
    }
    let sizes = |default: &[u32]| if arguments.sizes.is_empty() { default.to_vec() } else { arguments.sizes.clone() };
    for n in sizes(if arguments.quick { &[32, 64] } else { &[32, 64, 128] }) {
        chart_errors(&Scene::hang(n), &effort, &origin, out)?;
    }
    chart_strain(&sizes(&[16, 32, 64, 128, 256]), arguments.budget, &effort, &origin, out)
}

/// The backends to run, and a line that describes the machine.
fn machine(wanted: &[Backend]) -> Result<(Vec<Backend>, String), Failure> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let adapter = |backend| {
        // Enough vertices for `Backend::Auto` to select a hardware GPU.
        let mesh = Mesh::grid(128, 128, 1.0, 1.0);
        let made = Deformer::new(&mesh, Options { backend, ..Options::default() });
        made.map(|deformer| deformer.adapter().map(str::to_owned)).map_err(|error| Failure::from(&error))
    };
    let (backends, adapter) = if wanted.is_empty() {
        let found = adapter(Backend::Auto)?;
        let all = [Backend::Cpu, Backend::Hybrid, Backend::Gpu];
        (if found.is_some() { all.to_vec() } else { vec![Backend::Cpu] }, found)
    } else {
        let gpu = wanted.iter().find(|&&backend| backend != Backend::Cpu);
        (wanted.to_vec(), gpu.map(|&backend| adapter(backend)).transpose()?.flatten())
    };
    let adapter = adapter.map_or(String::new(), |name| format!(", {name}"));
    Ok((backends, format!("{cores} CPU threads ({}){adapter}", std::env::consts::ARCH)))
}

/// Error against time: writes chart and table, and returns the settings to recommend.
fn chart_errors(scene: &Scene, effort: &Effort, origin: &[String; 2], out: &Path) -> Result<(), Failure> {
    eprintln!("{}: the reference ..", scene.title);
    let truth = scene.truth(effort.reference)?;
    eprintln!("{}: the settings ..", scene.title);
    let rows = measure::errors(scene, &truth, effort)?;
    let front = measure::pareto(&rows, &truth);
    let cheapest = measure::cheapest(&front);

    let seconds = f64::from(truth.frames) / 60.0;
    let converged = format!(
        "reference: leapfrog in double precision, {} steps a frame; halving its step changed it by {:.1e}{}",
        truth.steps,
        truth.change,
        if truth.predictable { "" } else { "; this motion is chaotic from the start: trust the trend alone" }
    );
    let chart = Chart {
        title: finding(scene, &cheapest),
        subtitle: vec![
            others(&rows, &cheapest),
            format!("Figures along the curves: substeps a frame. Broad line: the best that a given time buys.{}", lost(&rows)),
        ],
        x: Axis { label: "milliseconds a frame".to_owned(), ticks: Vec::new() },
        y: Axis { label: format!("position error at {seconds:.2} s, RMS / {:.2} m", scene.extent), ticks: Vec::new() },
        curves: curves(&rows, |row| (row.ms, row.error)),
        front: front.iter().map(|row| (row.ms, row.error)).collect(),
        bound: None,
        floor: Some((truth.change, format!("the reference is converged to {:.1e}", truth.change))),
        caption: [std::slice::from_ref(&converged), origin].concat(),
    };
    let mut choice = format!("{}: error at {seconds:.2} s within / cheapest setting, for drape\n", scene.title);
    for (decade, row) in cheapest {
        let Row { ms, error, .. } = row;
        writeln!(choice, "  1e{decade}  {}  # {ms:.3} ms a frame, error {error:.1e}", row.setting).map_err(Failure::input)?;
    }
    let heads: Vec<&str> = choice.lines().chain([converged.as_str()]).chain(origin.iter().map(String::as_str)).collect();
    let name = format!("chart_{}", scene.name);
    save(out, &name, &chart, &table(&heads, &rows, Some(&truth)))?;
    say(choice.trim_end());
    Ok(())
}

/// Strain against resolution at the same time per frame.
fn chart_strain(sizes: &[u32], budget: f64, effort: &Effort, origin: &[String; 2], out: &Path) -> Result<(), Failure> {
    eprintln!("strain at {budget} ms a frame ..");
    let mut rows = Vec::new();
    for &n in sizes {
        rows.extend(measure::strain(&Scene::hang(n), budget, effort)?);
    }
    let side = |row: &Row| row.scene.trim_start_matches("hang").parse().unwrap_or(f64::NAN);
    let chart = Chart {
        title: format!("HANG at {budget} ms a frame: how far the cloth stretches as it gets finer"),
        subtitle: vec![
            "Fewer substeps fit as the sheet gets finer, and what they leave unresolved shows as stretch.".to_owned(),
            format!("Figures along the curves: the substeps a frame that fit.{}", lost(&rows)),
        ],
        x: Axis { label: "vertices along a side".to_owned(), ticks: sizes.iter().copied().map(f64::from).collect() },
        y: Axis { label: "mean strain at 2 s".to_owned(), ticks: Vec::new() },
        curves: curves(&rows, |row| (side(row), row.strain[0])),
        front: Vec::new(),
        bound: None,
        floor: None,
        caption: origin.to_vec(),
    };
    let head = format!("HANG, strain at 2 s of the settings that take {budget} ms a frame");
    save(out, "strain", &chart, &table(&[&head, &origin[0], &origin[1]], &rows, None))
}

/// The decade of error in the title: the smallest that is reached, down to 1e-3.
fn headline<'a>(cheapest: &[(i32, &'a Row)]) -> Option<(i32, &'a Row)> {
    cheapest.iter().take(3).next_back().copied()
}

/// The title: the finding of the chart.
fn finding(scene: &Scene, cheapest: &[(i32, &Row)]) -> String {
    match headline(cheapest) {
        Some((decade, Row { setting, ms, .. })) => {
            format!("{}: an error of 1e{decade} costs {} ms a frame ({})", scene.title, rounded(*ms), name(setting))
        }
        None => format!("{}: no setting comes within a tenth of its size", scene.title),
    }
}

/// The cost of the same error with other settings.
fn others(rows: &[Row], cheapest: &[(i32, &Row)]) -> String {
    let Some((decade, best)) = headline(cheapest) else { return String::new() };
    let mut methods: Vec<String> = rows.iter().map(|row| sweeps(&row.setting)).collect();
    methods.sort();
    methods.dedup();
    methods.retain(|method| *method != sweeps(&best.setting));
    let cost = |method: &String| {
        let within = rows.iter().filter(|row| sweeps(&row.setting) == *method && row.error <= 10_f64.powi(decade));
        match within.min_by(|a, b| a.ms.total_cmp(&b.ms)) {
            Some(Row { setting, ms, .. }) => format!("{} ms by {}", rounded(*ms), name(setting)),
            None => format!("not reached by {method}"),
        }
    };
    let costs: Vec<String> = methods.iter().take(3).map(cost).collect();
    if costs.is_empty() { String::new() } else { format!("The same: {}.", costs.join("; ")) }
}

/// Formats a number with two significant digits.
fn rounded(value: f64) -> String {
    let digits = (1.0 - value.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.digits$}")
}

/// Lists the settings that are not in the chart.
fn lost(rows: &[Row]) -> String {
    let mut ranges: BTreeMap<&str, (u32, u32)> = BTreeMap::new();
    for setting in rows.iter().filter(|row| !row.is_stable()).map(|row| row.setting) {
        let substeps = setting.substeps;
        let range = ranges.entry(setting.method()).or_insert((substeps, substeps));
        *range = (range.0.min(substeps), range.1.max(substeps));
    }
    let range = |(method, (low, high)): (&&str, &(u32, u32))| {
        if low == high { format!("{method} at {low}") } else { format!("{method} at {low} to {high}") }
    };
    let ranges: Vec<String> = ranges.iter().map(range).collect();
    if ranges.is_empty() { String::new() } else { format!(" Unstable: {}.", ranges.join(", ")) }
}

/// A curve for each method and backend, of the settings that stayed stable.
fn curves(rows: &[Row], at: impl Fn(&Row) -> (f64, f64)) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for row in rows.iter().filter(|row| row.is_stable()) {
        let name = name(&row.setting);
        let (x, y) = at(row);
        let point = (x, y, row.setting.substeps.to_string());
        match curves.iter_mut().find(|curve| curve.name == name) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { name, look: look(&row.setting), points: vec![point] }),
        }
    }
    curves
}

/// The method and its number of sweeps.
fn sweeps(setting: &Setting) -> String {
    match setting.method {
        Method::Relaxation { iterations } => format!("{} x {iterations}", setting.method()),
        _ => setting.method().to_owned(),
    }
}

/// The name of a curve.
fn name(setting: &Setting) -> String {
    format!("{}, {}", sweeps(setting), setting.backend())
}

fn look(setting: &Setting) -> Look {
    let marker = match setting.method {
        Method::SmallSteps if setting.levels == Levels::Off => Marker::Diamond,
        Method::Relaxation { .. } => Marker::Square,
        Method::Springs => Marker::Triangle,
        _ => Marker::Circle,
    };
    let line = match setting.backend {
        Backend::Gpu => Line::Dashed,
        Backend::Hybrid => Line::Dotted,
        _ => Line::Solid,
    };
    Look { marker, line }
}

/// The CSV file. Columns that do not apply stay empty.
fn table(heads: &[&str], rows: &[Row], truth: Option<&Truth>) -> String {
    let mut text: String = heads.iter().fold(String::new(), |text, head| text + "# " + head + "\n");
    text += "scene,method,backend,substeps,iterations,ms_median,error,mean_strain,max_strain,reference_error,note\n";
    let reference = truth.map_or(String::new(), |truth| format!("{:.2e}", truth.change));
    for row in rows {
        let Row { scene, setting, ms, error, strain: [mean, max] } = row;
        let Setting { substeps, .. } = setting;
        let (method, backend, iterations) = (setting.method(), setting.backend(), setting.iterations());
        let ms = if ms.is_nan() { String::new() } else { format!("{ms:.4}") };
        let error = if error.is_nan() { String::new() } else { format!("{error:.3e}") };
        let note = if row.is_stable() { "" } else { "unstable" };
        let figures = format!("{ms},{error},{mean:.3e},{max:.3e},{reference},{note}");
        text += &[scene, method, backend, &substeps.to_string(), &iterations.to_string(), &figures].join(",");
        text += "\n";
    }
    text
}

/// Writes a chart and its table, each completely or not at all.
fn save(out: &Path, name: &str, chart: &Chart, table: &str) -> Result<(), Failure> {
    let svg = chart.svg().map_err(Failure::input)?;
    for (ending, text) in [("csv", table), ("svg", &svg)] {
        let path = out.join(format!("{name}.{ending}"));
        let written = atomic_file::write(&path, text.as_bytes());
        written.map_err(|error| Failure::input(format_args!("{}: {error}; name a writable --out", path.display())))?;
    }
    Ok(())
}
