//! `drape diff A B`: the first frame and vertex in which two runs differ, and why.

use std::path::Path;
use std::{fs, iter};

use cloth_deformer::Mesh;

use crate::Failure;
use crate::command::say;
use crate::output::{frame_name, frame_number};
use crate::receipt::{Inputs, Receipt};

/// Prints the first difference between two runs. The failure returned in that case has no message.
pub(crate) fn diff(a: &Path, b: &Path) -> Result<(), Failure> {
    let [last_a, last_b] = [last_frame(a)?, last_frame(b)?];
    for frame in 1..=last_a.max(last_b) {
        let [x, y] = [read(a, frame)?, read(b, frame)?];
        let found = match (x, y) {
            (Some(x), Some(y)) => first_difference(&x, &y),
            (None, None) => None,
            (found, _) => Some(format!("only {} has this frame", if found.is_some() { a } else { b }.display())),
        };
        if let Some(found) = found {
            say(&format!("frame {frame}: {found}; {}", why(a, b)));
            return Err(Failure::new(Failure::DIFFERENT, ""));
        }
    }
    Ok(())
}

/// The number of the last frame in a folder.
fn last_frame(folder: &Path) -> Result<u32, Failure> {
    let unread = |error| Failure::input(format_args!("{}: cannot be read: {error}; check the path", folder.display()));
    let entries = fs::read_dir(folder).map_err(unread)?;
    let frames = entries.flatten().filter_map(|entry| frame_number(entry.file_name().to_str()?));
    let none = || Failure::input(format_args!("{}: no frames, frame_0001.obj and so on", folder.display()));
    frames.max().ok_or_else(none)
}

/// A frame, or `None` if the file does not exist.
fn read(folder: &Path, frame: u32) -> Result<Option<Mesh>, Failure> {
    let path = folder.join(frame_name(frame));
    if path.exists() { Mesh::load_obj(path).map(Some).map_err(Failure::input) } else { Ok(None) }
}

/// The first difference between two meshes, if any.
fn first_difference(x: &Mesh, y: &Mesh) -> Option<String> {
    let [vertices, others] = [x, y].map(|mesh| mesh.positions.len());
    if vertices != others {
        return Some(format!("{vertices} and {others} vertices"));
    }
    if let Some((vertex, (x, y))) = iter::zip(&x.positions, &y.positions).enumerate().find(|(_, (x, y))| x != y) {
        return Some(format!("vertex {vertex} is at {x} and at {y}, {:e} m apart", x.distance(*y)));
    }
    let face = iter::zip(&x.triangles, &y.triangles).position(|(x, y)| x != y);
    let face = face.or((x.triangles.len() != y.triangles.len()).then_some(x.triangles.len().min(y.triangles.len())));
    face.map(|face| format!("triangle {face} differs"))
}

/// The differences between the receipts of two runs.
fn why(a: &Path, b: &Path) -> String {
    let [Some(a), Some(b)] = [a, b].map(Receipt::in_folder) else {
        return "the reason is unknown, because they have no receipts, which --variant writes".to_owned();
    };
    let Inputs { version, values, scene, arguments, files, .. } = &a.inputs;
    let other = &b.inputs;
    let mut reasons = Vec::new();
    for key in values.keys().chain(other.values.keys().filter(|key| !values.contains_key(*key))) {
        let shown = |value: Option<&serde_json::Value>| value.map_or("nothing".to_owned(), ToString::to_string);
        if values.get(key) != other.values.get(key) {
            reasons.push(format!("{key} is {} and {}", shown(values.get(key)), shown(other.values.get(key))));
        }
    }
    let is_scene = scene != &other.scene && reasons.is_empty();
    let inputs = [
        (is_scene, "the scene"),
        (arguments != &other.arguments, "the command line"),
        (files != &other.files, "a file that the scene names"),
    ];
    reasons.extend(inputs.into_iter().filter(|&(differs, _)| differs).map(|(_, what)| format!("{what} differs")));
    let mut compare = |what: &str, a: String, b: String| {
        if a != b {
            reasons.push(format!("the {what} is {a} and {b}"));
        }
    };
    compare("version", version.clone(), other.version.clone());
    compare("backend", a.backend, b.backend);
    compare("GPU", format!("{:?}", a.adapter), format!("{:?}", b.adapter));
    compare("number of lanes", a.lanes.to_string(), b.lanes.to_string());
    if reasons.is_empty() {
        return "inputs, version, backend and lanes are the same, so the frames should be equal".to_owned();
    }
    reasons.join(", ")
}
