//! Interrupting and resuming a run: `--save` writes its state, and `--resume` continues from it.
//!
//! The file is a line of JSON with the frame number and the statistics so far, a line with its hash, and the bytes of the
//! cloth's [`Snapshot`].

use std::{fs, io};

use cloth_deformer::{Deformer, Mesh, Snapshot, StateError};
use serde::{Deserialize, Serialize};

use crate::{
    Failure,
    arguments::Format,
    command::warn,
    output::{Output, Outputs, frame_name},
    receipt::hash,
    report::Frame,
    scene::Scene,
};

/// The state of a run, besides the cloth.
#[derive(Serialize, Deserialize)]
pub(crate) struct Saved {
    /// The last frame that was simulated. Frames before 1 are of the preroll.
    pub(crate) frame: i64,
    /// Text form of everything that acts on the cloth. A run cannot be resumed with another one.
    scene: String,
    pub(crate) frames: Vec<Frame>,
    /// Texts of warnings of the preroll, for the first of the frames.
    #[serde(default)]
    pub(crate) warnings: Vec<String>,
}

/// Saves the state of the run, if it is wanted after this frame.
pub(crate) fn save(
    scene: &Scene,
    frame: i64,
    is_last: bool,
    deformer: &mut Deformer,
    frames: &[Frame],
    warnings: &[String],
) -> Result<(), Failure> {
    let outputs = &scene.outputs;
    let Some(path) = outputs.save.as_deref().filter(|_| is_last || frame % i64::from(outputs.every) == 0) else {
        return Ok(());
    };
    let snapshot = deformer.snapshot().map_err(|error| scene.failed(frame, &error))?;
    let saved = Saved { frame, scene: scene.acts(frame), frames: frames.to_vec(), warnings: warnings.to_vec() };
    let mut bytes = serde_json::to_vec(&saved).map_err(|error| Failure::input(format_args!("--save: {error}")))?;
    bytes.extend(format!("\n{}\n", hash(&bytes)).bytes());
    bytes.extend(snapshot.to_bytes());
    Output::reserve(path)?.write(&bytes)
}

/// Restores the cloth from a saved run; `None` if the run starts from the beginning.
pub(crate) fn resume(scene: &Scene, deformer: &mut Deformer) -> Result<Option<Saved>, Failure> {
    let outputs = &scene.outputs;
    let Some(path) = &outputs.resume else { return Ok(None) };
    let refuse = |why: &dyn std::fmt::Display| Failure::input(format_args!("--resume {}: {why}", path.display()));
    let unread = |error: io::Error| refuse(&format_args!("{error}; name a file written by --save"));
    // A pipe or a device may never end.
    if !fs::metadata(path).map_err(unread)?.is_file() {
        return Err(refuse(&"it is no file; name a file written by --save"));
    }
    let bytes = fs::read(path).map_err(unread)?;
    let altered = || refuse(&"it was not written by --save, or was truncated or altered");
    let mut parts = bytes.splitn(3, |&byte| byte == b'\n');
    let (Some(head), Some(hashed), Some(snapshot)) = (parts.next(), parts.next(), parts.next()) else { return Err(altered()) };
    if hash(head).as_bytes() != hashed {
        return Err(altered());
    }
    let saved: Saved = serde_json::from_slice(head).map_err(|_| altered())?;
    if saved.frames.len() as i64 != saved.frame.max(0) {
        return Err(altered());
    }
    // Before the scenes are compared, because of bodies only the files of so many frames are read.
    if saved.frame > i64::from(outputs.frames) {
        let message =
            format_args!("it was saved after frame {}, but --frames is {}; ask for more frames", saved.frame, outputs.frames);
        return Err(refuse(&message));
    }
    if saved.scene != scene.acts(saved.frame) {
        let message = "it was saved with different gravity, wind, colliders, pins, preroll or frames a second; use the same ones";
        return Err(refuse(&message));
    }
    if saved.frame < scene.timeline.first() {
        return Err(altered());
    }
    let snapshot = Snapshot::from_bytes(snapshot).map_err(|error| refuse(&error))?;
    deformer.restore(&snapshot).map_err(|error| refuse(&restored(&error)))?;
    let earlier = (1..=outputs.frames).take_while(|&frame| i64::from(frame) <= saved.frame);
    let mut earlier = earlier.map(|frame| outputs.folder.join(frame_name(frame)));
    if let Some(missing) = earlier.find(|path| outputs.writes(Format::Obj) && !path.exists()) {
        warn("warning", &format!("--resume: {} is missing, and is not written again", missing.display()));
    }
    Ok(Some(saved))
}

/// Why a state is of another run, in terms of the command line and of scenes instead of the library's.
fn restored(error: &StateError) -> String {
    let StateError::Other { what } = *error else { return error.to_string() };
    let (what, options) = match what {
        "mesh" => ("mesh", "MESH.obj and --scale"),
        "pinned" => ("choice of pins", "--pin"),
        "fabric" | "mass" | "edge_scale" | "bending_scale" => ("fabric", "--fabric"),
        "quality" => ("number of substeps", "--strain or --substeps"),
        "backend" => ("backend", "--backend"),
        "method" => ("method", "--method and --iterations"),
        "levels" => ("choice of levels", "--levels"),
        "contact" => ("contact of the cloth with itself", "--self-contact and --friction"),
        other => (other, "options"),
    };
    format!("its {what} differs; use the same {options} as for the run that was saved, or the same scene")
}

/// Reads a frame that was written before the run was interrupted.
pub(crate) fn written(outputs: &Outputs, frame: u32, shape: &mut Mesh) -> Result<(), Failure> {
    let path = outputs.folder.join(frame_name(frame));
    let read =
        Mesh::load_obj(&path).map_err(|error| Failure::input(format_args!("--resume needs the frames so far: {error}")))?;
    if read.positions.len() != shape.positions.len() {
        let message =
            format_args!("--resume: {} has {} vertices and is thus of another mesh", path.display(), read.positions.len());
        return Err(Failure::input(message));
    }
    shape.positions = read.positions;
    Ok(())
}
