//! `drape diff A B`: the first frame and vertex in which two runs differ, and why. It compares the frames that are OBJ files, of which
//! positions and faces, then the rest of their text.

use std::collections::BTreeSet;
use std::path::Path;
use std::{fs, io, iter};

use cloth_deformer::Mesh;

use crate::Failure;
use crate::command::say;
use crate::output::{frame_name, frame_number};
use crate::receipt::{Inputs, Receipt};

/// So many characters of a line are shown.
const SHOWN: usize = 80;

/// Prints the first difference between two runs. The failure returned in that case has no message.
pub(crate) fn diff(a: &Path, b: &Path) -> Result<(), Failure> {
    let [of_a, of_b] = [frames(a)?, frames(b)?];
    for frame in of_a.union(&of_b) {
        let found = match (of_a.contains(frame), of_b.contains(frame)) {
            (true, true) => between(&a.join(frame_name(*frame)), &b.join(frame_name(*frame)))?,
            (is_in_a, _) => Some(format!("only {} has this frame", if is_in_a { a } else { b }.display())),
        };
        if let Some(found) = found {
            say(&format!("frame {frame}: {found}; {}", why(a, b)));
            return Err(Failure::new(Failure::DIFFERENT, ""));
        }
    }
    Ok(())
}

/// The numbers of the frames in a folder.
fn frames(folder: &Path) -> Result<BTreeSet<u32>, Failure> {
    let refuse = |why: String| Failure::input(format_args!("{}: {why}", folder.display()));
    if folder.is_file() {
        return Err(refuse("is a file; give the folders of two runs, whose OBJ frames are compared".to_owned()));
    }
    let entries = fs::read_dir(folder).map_err(|error| refuse(format!("cannot be read: {error}; check the path")))?;
    let frames: BTreeSet<u32> = entries.flatten().filter_map(|entry| frame_number(entry.file_name().to_str()?)).collect();
    if frames.is_empty() {
        return Err(refuse(
            "has no OBJ frames, frame_0001.obj and so on, which are compared; write them with --format obj".to_owned(),
        ));
    }
    Ok(frames)
}

/// The first difference between two files, if any.
fn between(a: &Path, b: &Path) -> Result<Option<String>, Failure> {
    let read = |path: &Path| {
        // A pipe or a device may never end.
        let is_file = fs::metadata(path).is_ok_and(|found| found.is_file());
        let bytes = if is_file { fs::read(path) } else { Err(io::Error::other("it is no file")) };
        bytes.map_err(|error| Failure::input(format_args!("{}: cannot be read: {error}; check the path", path.display())))
    };
    let [one, other] = [read(a)?, read(b)?];
    if one == other {
        return Ok(None);
    }
    let [one, other] = [one, other].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    let parse = |path: &Path, text: &str| {
        Mesh::parse_obj(text).map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))
    };
    Ok(first_difference(&parse(a, &one)?, &parse(b, &other)?).or_else(|| first_other_line([(a, &one), (b, &other)])))
}

/// The first line that differs by more than its comment or the spelling of its numbers, if any.
fn first_other_line([(a, one), (b, other)]: [(&Path, &str); 2]) -> Option<String> {
    let [mut one, mut other] = [statements(one), statements(other)];
    let shown = |path: &Path, (number, line): (usize, &str)| {
        format!("line {number} of {} is `{}`", path.display(), line.chars().take(SHOWN).collect::<String>())
    };
    loop {
        return match (one.next(), other.next()) {
            (None, None) => None,
            (Some((_, x)), Some((_, y))) if are_same(x, y) => continue,
            (Some(x), Some(y)) => Some(format!("{} and {}", shown(a, x), shown(b, y))),
            (Some(line), None) => Some(format!("{}, which the other does not have", shown(a, line))),
            (None, Some(line)) => Some(format!("{}, which the other does not have", shown(b, line))),
        };
    }
}

/// The lines of an OBJ that are not empty, with their numbers and without comments.
fn statements(text: &str) -> impl Iterator<Item = (usize, &str)> {
    // Some programs write `1.#QNAN` for a number.
    let is_comment = |line: &str, at: usize| line[..at].chars().next_back().is_none_or(char::is_whitespace);
    let end = move |line: &str| line.match_indices('#').map(|(at, _)| at).find(|&at| is_comment(line, at)).unwrap_or(line.len());
    let bare = text.lines().map(move |line| line[..end(line)].trim());
    (1..).zip(bare).filter(|(_, line)| !line.is_empty())
}

/// Whether two lines have the same words. Coordinates may be spelled in different ways.
fn are_same(x: &str, y: &str) -> bool {
    let has_numbers = ["v ", "vt ", "vn "].iter().any(|word| x.starts_with(word));
    let is_same = |(x, y): (&str, &str)| x == y || has_numbers && x.parse::<f32>().is_ok_and(|number| y.parse() == Ok(number));
    let [count, others] = [x, y].map(|line| line.split_whitespace().count());
    count == others && iter::zip(x.split_whitespace(), y.split_whitespace()).all(is_same)
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
