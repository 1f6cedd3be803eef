//! Runs a scene from top to bottom: steps and files.

use std::{
    io::{self, IsTerminal},
    mem,
    sync::atomic::{AtomicBool, Ordering},
    time::Instant,
};

use cloth_deformer::{Attributes, Deformer, Measure, Mesh, ObjTemplate, StepError, Untangled};
use indicatif::{ProgressBar, ProgressStyle};
use png::EncodingError;

use crate::{
    Failure,
    arguments::Format,
    command::warn,
    frames::Frames,
    named,
    output::{self, Output},
    preview::{self, Cell},
    report::{Frame, Report},
    save,
    scene::Scene,
    warnings::{self, Warned},
};

/// Most cells of the contact sheet.
const CELLS: u32 = 12;

/// Steps a scene through all of its frames and writes its files. `interrupted` says when to stop; `listen` begins to
/// watch for signals once there are files that must not be left half written.
pub(crate) fn play(
    scene: &Scene,
    quiet: bool,
    listen: impl FnOnce() -> Result<(), Failure>,
    interrupted: &AtomicBool,
) -> Result<Report, Failure> {
    let Scene { mesh, template, options, outputs, .. } = scene;
    output::check_apart(outputs)?;
    let dt = scene.dt();
    let mut deformer = Deformer::new(mesh, options.clone()).map_err(|error| scene.not_built(&error))?;

    listen()?;

    // Outputs that cannot be written are detected now, not after the simulation.
    let mut frames = Frames::begin(outputs, mesh, template.as_ref(), scene.look.up)?;
    let reserve = |path: &Option<_>| path.as_deref().map(Output::reserve).transpose();
    let (report_file, _) = (reserve(&outputs.report)?, reserve(&outputs.save)?);
    let preview_file = reserve(&outputs.preview)?;
    let animation_file = reserve(&outputs.animation)?;

    let mut report = Report::new(&deformer, options.method, mesh);
    let (mut cells, mut moving): (Vec<Cell>, Vec<Cell>) = (Vec::new(), Vec::new());
    let mut warned = Warned::new(60.0 * dt, scene.untangle);
    // In this frame the cloth is the mesh: frame 1, or one before it if there is a preroll.
    let first = scene.timeline.first();
    // The forecast warns of what the scene asks too much of before the first frame.
    for warning in deformer.forecast(dt, &scene.attributes(first)).map_err(|error| scene.failed(first, &error))?.warnings {
        warned.add(first, warning).inspect(|line| warn("warning", line));
    }
    let resumed = save::resume(scene, &mut deformer)?;
    let done = resumed.as_ref().map(|saved| saved.frame);
    if let Some(saved) = resumed {
        report.frames = saved.frames;
        *warned.texts() = saved.warnings;
    }
    check_frames(scene);
    let progress = progress(quiet, u64::from(outputs.frames) + u64::from(scene.timeline.preroll));
    progress.set_position(done.map_or(0, |done| 1 + done.abs_diff(first)));
    let mut shape = mesh.clone();
    if done.is_none() {
        begin(scene, &mut deformer, &mut shape)?;
    }
    let is_cell = |frame| preview_file.is_some() && is_shown(frame, outputs.frames);
    let is_moving = |frame| animation_file.is_some() && scene.is_animated(frame);
    let mut keep = |frame: u32, shape: &Mesh| {
        let cell = || Cell { frame, positions: shape.positions.clone(), colliders: scene.attributes(frame.into()).colliders };
        cells.extend(is_cell(frame).then(cell));
        moving.extend(is_moving(frame).then(cell));
    };
    for frame in (1..=outputs.frames).take_while(|&frame| done >= Some(frame.into())) {
        if frames.has_caches() || is_cell(frame) || is_moving(frame) {
            save::written(outputs, frame, &mut shape)?;
        }
        frames.cache(&shape.positions)?;
        keep(frame, &shape);
    }
    for frame in done.map_or(first, |done| done + 1)..=outputs.frames.into() {
        let failed = |error: StepError| scene.failed(frame, &error);
        let (mut seconds, mut counts) = (0.0, [0, 0]);
        if frame > first {
            let attributes = scene.attributes(frame);
            let start = Instant::now();
            let done = deformer.step(dt, &attributes).map_err(failed)?;
            // A GPU has only received its commands: the step ends when they are done.
            deformer.wait().map_err(failed)?;
            seconds = start.elapsed().as_secs_f64();
            counts = [done.substeps, done.contacts];
            let crosses = done.warnings.iter().any(warnings::is_of_crossings);
            // Each kind only once, with its first frame.
            for line in done.warnings.into_iter().filter_map(|warning| warned.add(frame, warning)) {
                progress.suspend(|| warn("warning", &format!("{}: {line}", named(frame))));
            }
            // Cloth that was pinched may hook on a body, and there may be room for it again.
            if scene.untangle && crosses && (frame - first) % scene.untangled_every() == 0 {
                let parted = untangle(&mut deformer, &attributes).map_err(failed)?;
                parted.into_iter().for_each(|line| progress.suspend(|| warn("note", &format!("{}: {line}", named(frame)))));
            }
            shape.positions.copy_from_slice(deformer.positions().map_err(failed)?);
        }
        // Frames before 1 are of the preroll.
        if let Some(frame) = u32::try_from(frame).ok().filter(|&frame| frame > 0) {
            // The first frame is the input mesh bit for bit unless it was untangled, because it has not passed through
            // the deformer.
            frames.write(frame, &shape)?;
            keep(frame, &shape);
            let measure = deformer.measure().map_err(failed)?;
            report.frames.push(row(frame, seconds, counts, measure, mem::take(warned.texts()))?);
        }
        progress.inc(1);
        let is_interrupted = interrupted.load(Ordering::Relaxed);
        let is_last = is_interrupted || frame == i64::from(outputs.frames);
        save::save(scene, frame, is_last, &mut deformer, &report.frames, warned.texts())?;
        if is_interrupted {
            progress.finish_and_clear();
            tell_repeated(&warned, quiet);
            let message = format_args!("interrupted: {} of {} frames written", frame.max(0), outputs.frames);
            return Err(Failure::new(Failure::INTERRUPTED, message));
        }
    }
    progress.finish_and_clear();
    tell_repeated(&warned, quiet);
    frames.finish()?;
    if let Some(file) = report_file {
        file.write(&report.json()?)?;
    }
    let drawn = |option, picture| drawn(option, picture, outputs.frames);
    if let Some(file) = preview_file {
        let sheet = preview::contact_sheet(&cells, &shape.triangles, &scene.look, interrupted);
        file.write(&drawn("--preview", sheet)?)?;
    }
    if let Some(file) = animation_file {
        let delay = dt * scene.animated_every() as f32;
        let animation = preview::animation(&moving, &shape.triangles, &scene.look, delay, interrupted);
        file.write(&drawn("--animate", animation)?)?;
    }
    Ok(report)
}

/// Says how often a run warned of what, unless it is `quiet`.
fn tell_repeated(warned: &Warned, quiet: bool) {
    let lines = if quiet { Vec::new() } else { warned.repeated() };
    lines.iter().for_each(|line| warn("note", line));
}

/// The file of a picture, unless it was interrupted.
fn drawn(option: &str, picture: Result<Option<Vec<u8>>, EncodingError>, frames: u32) -> Result<Vec<u8>, Failure> {
    let file = picture.map_err(|error| Failure::input(format_args!("{option}: {error}")))?;
    let message = format_args!("interrupted: {frames} of {frames} frames written, but not the picture of {option}");
    file.ok_or_else(|| Failure::new(Failure::INTERRUPTED, message))
}

/// Warns of what the frames cannot have as the input has it.
fn check_frames(scene: &Scene) {
    let Scene { name, template, outputs, .. } = scene;
    if template.as_ref().is_some_and(ObjTemplate::shares_normals) {
        let message = "gives one normal to several vertices, which cannot turn with each; export it without normals";
        warn("warning", &format!("{name}: {message}"));
    }
    let texture = template.as_ref().map_or(&[][..], ObjTemplate::texture_coordinates);
    if outputs.writes(Format::Usda) && scene.is_textured && texture.is_empty() {
        let why = match template {
            Some(_) => "some faces of the input have none; give a `vt` to every corner",
            None => "it is of several cloths, whose polygons become triangles, too; run each by itself to keep them",
        };
        warn("warning", &format!("{name}: the USD has no texture coordinates, because {why}"));
    }
}

/// The statistics of a frame.
fn row(frame: u32, seconds: f64, counts: [u32; 2], measure: Measure, warnings: Vec<String>) -> Result<Frame, Failure> {
    Frame::new(frame, seconds, counts, measure, warnings).ok_or_else(|| {
        // Springs beyond their limit grow for some frames before the first position overflows.
        let message = format_args!("frame {frame}: unstable: its energy left the finite numbers; take more --substeps");
        Failure::new(Failure::UNSTABLE, message)
    })
}

/// Places the colliders at the first frame, and separates cloth that crosses there if the scene asks for it.
fn begin(scene: &Scene, deformer: &mut Deformer, shape: &mut Mesh) -> Result<(), Failure> {
    let first = scene.timeline.first();
    let failed = |error: StepError| scene.failed(first, &error);
    let attributes = scene.attributes(first);
    if let Some(inside) = warnings::begins_inside(shape, &scene.options.pinned, &attributes.colliders) {
        warn("warning", &inside);
    }
    // Colliders that are in motion at the first frame move with their velocity from there.
    deformer.place_colliders(&attributes.colliders).map_err(failed)?;
    if !scene.untangle {
        return Ok(());
    }
    if let Some(line) = untangle(deformer, &attributes).map_err(failed)? {
        shape.positions.copy_from_slice(deformer.positions().map_err(failed)?);
        warn("note", &line);
    }
    Ok(())
}

/// Separates cloth that crosses. Returns a line about it if any vertex was moved.
fn untangle(deformer: &mut Deformer, attributes: &Attributes) -> Result<Option<String>, StepError> {
    let Untangled { before, after, farthest, .. } = deformer.untangle(attributes)?;
    let moved = 1e3 * farthest;
    Ok((farthest > 0.0).then(|| format!("untangled: {before} crossings, {after} left; vertices moved by up to {moved:.1} mm")))
}

/// A progress bar on a terminal, nothing otherwise.
fn progress(quiet: bool, frames: u64) -> ProgressBar {
    if quiet || !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(frames);
    match ProgressStyle::with_template("{bar:40} {pos} of {len} frames, {eta} left") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Whether `frame` has a cell on the contact sheet. Cells are evenly spaced and include the first and the last frame.
fn is_shown(frame: u32, frames: u32) -> bool {
    let cells = u64::from(CELLS.min(frames));
    let (index, last) = (u64::from(frame - 1), u64::from(frames - 1));
    // Some cell's frame, `cell * (frames - 1) / (cells - 1)` rounded to the nearest, is this one.
    let steps = (cells - 1).max(1);
    (0..cells).any(|cell| (cell * last + steps / 2) / steps == index)
}
