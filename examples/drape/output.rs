//! Output files, which are written completely or not at all.

use std::{
    ffi::OsStr,
    fmt::Display,
    fs::{self, OpenOptions},
    io::Write,
    path::{Path, PathBuf},
};

use crate::{Failure, arguments::Format, frames::cache_name};
use atomic_file::{AtomicFile, UNFINISHED};

// The library's own module: links are followed, and a pipe or a device is written to, not replaced.
#[expect(dead_code, reason = "the library writes all at once as well")]
#[path = "../../src/io/atomic_file.rs"]
mod atomic_file;

/// The files that a run writes and reads.
pub(crate) struct Outputs {
    /// The folder for the frames, created if it does not exist, and their number.
    pub(crate) folder: PathBuf,
    pub(crate) frames: u32,
    /// Frames a second.
    pub(crate) fps: f32,
    pub(crate) formats: Vec<Format>,
    pub(crate) pc2: Option<PathBuf>,
    pub(crate) preview: Option<PathBuf>,
    pub(crate) animation: Option<PathBuf>,
    pub(crate) report: Option<PathBuf>,
    /// The file with the state of the run, the number of frames between saves, and the state to continue from.
    pub(crate) save: Option<PathBuf>,
    pub(crate) every: u32,
    pub(crate) resume: Option<PathBuf>,
    /// Files that must not be overwritten: the input, and the receipt.
    pub(crate) read: Vec<PathBuf>,
}

impl Outputs {
    /// Whether frames are written in this format.
    pub(crate) fn writes(&self, format: Format) -> bool {
        self.formats.contains(&format)
    }
}

/// A file to be written later. Until then a temporary file beside it proves that it can be; dropped before, it leaves
/// nothing behind.
pub(crate) struct Output {
    path: PathBuf,
    file: AtomicFile,
}

impl Output {
    /// Fails now if the file could not be written later.
    pub(crate) fn reserve(path: &Path) -> Result<Output, Failure> {
        check(path)?;
        let file = AtomicFile::create(path).map_err(|error| unwritable(path, error))?;
        Ok(Output { path: path.to_owned(), file })
    }

    /// Writes the file and moves it to its path.
    pub(crate) fn write(mut self, bytes: &[u8]) -> Result<(), Failure> {
        let written = self.file.write_all(bytes).and_then(|()| self.file.finish());
        written.map_err(|error| unwritable(&self.path, error))
    }
}

/// Removes from the folder of the frames what killed processes left unfinished. Elsewhere, a process of another machine may be writing,
/// whose id tells nothing here; to this folder two may not write at once.
pub(crate) fn remove_unfinished(folder: &Path) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
        if path.file_name().and_then(OsStr::to_str).and_then(writer).is_some_and(is_gone) {
            // It is in the way of nothing.
            _ = fs::remove_file(path);
        }
    }
}

/// The process that writes to an unfinished file of this name.
fn writer(name: &str) -> Option<u32> {
    name.strip_prefix(UNFINISHED)?.strip_suffix(".tmp")?.split_once('-')?.0.parse().ok()
}

/// Whether a process has ended. Only where that is known: on Linux.
fn is_gone(process: u32) -> bool {
    Path::new("/proc/self").exists() && !Path::new("/proc").join(process.to_string()).exists()
}

/// Fails now if the first frame could not be written to a folder later. A pipe or a device there is not opened, which may wait or have
/// an effect.
pub(crate) fn check_folder(folder: &Path) -> Result<(), Failure> {
    let path = folder.join(frame_name(1));
    if fs::metadata(&path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
        return Ok(());
    }
    let made = AtomicFile::create(&path).map(drop);
    made.map_err(|error| {
        Failure::input(format_args!("cannot write {}: {error}; use another --out, or make it writable", path.display()))
    })
}

/// Fails if a file at this path could not be replaced.
pub(crate) fn check(path: &Path) -> Result<(), Failure> {
    if path.file_name().is_none() {
        return Err(unwritable(path, "the path is empty, or ends in a directory"));
    }
    if path.is_dir() {
        return Err(unwritable(path, "it is a directory"));
    }
    // Replacing a file needs no permission to write to it. Checking for that permission respects a read-only file.
    if path.is_file() {
        OpenOptions::new().append(true).open(path).map_err(|error| unwritable(path, error))?;
    }
    Ok(())
}

fn unwritable(path: &Path, why: impl Display) -> Failure {
    Failure::input(format_args!("cannot write {}: {why}; name a file in a directory that is there and writable", path.display()))
}

/// The name of a frame's file in `--out`.
pub(crate) fn frame_name(frame: u32) -> String {
    format!("frame_{frame:04}.obj")
}

/// The frame number of a file name.
pub(crate) fn frame_number(name: &str) -> Option<u32> {
    let number = name.strip_prefix("frame_")?.strip_suffix(".obj")?.parse().ok()?;
    (name == frame_name(number)).then_some(number)
}

/// Rejects outputs that would overwrite each other or an input.
pub(crate) fn check_apart(outputs: &Outputs) -> Result<(), Failure> {
    let Outputs { folder, formats, pc2, preview, animation, report, save, resume, read, .. } = outputs;
    let read = read.iter().map(|path| match path.extension().and_then(OsStr::to_str) {
        Some("toml") => ("the scene", resolved(path)),
        Some("json") => ("the receipt", resolved(path)),
        _ => ("the mesh", resolved(path)),
    });
    let resumed = resume.iter().map(|path| ("--resume", resolved(path)));
    let read: Vec<(&str, PathBuf)> = read.chain(resumed).collect();
    let named = [("--pc2", pc2), ("--preview", preview), ("--animate", animation), ("--report", report), ("--save", save)];
    let named = named.into_iter().filter_map(|(name, path)| Some((name, resolved(path.as_ref()?))));
    let caches = formats.iter().filter_map(|&format| cache_name(format));
    let written = named.chain(caches.map(|name| ("--format", resolved(&folder.join(name)))));
    let files: Vec<(&str, PathBuf)> = read.iter().cloned().chain(written).collect();
    let frames = outputs.writes(Format::Obj).then(|| Frames::new(outputs));
    for (k, (name, path)) in files.iter().enumerate() {
        let shown = path.display();
        // Two cloths may use the same mesh.
        let earlier = if k < read.len() { &[] } else { &files[..k] };
        // A run may go on saving to the file from which it was resumed.
        let may_be_same = |other: &str| *name == "--save" && other == "--resume";
        if let Some((other, _)) = earlier.iter().find(|(other, earlier)| earlier == path && !may_be_same(other)) {
            return Err(Failure::input(format_args!("{other} and {name} name the same file, {shown}; give each its own")));
        }
        if let Some(frame) = frames.as_ref().and_then(|frames| frames.number_of(path)) {
            let message = format_args!("{name} and frame {frame} of --out name the same file, {shown}; give each its own");
            return Err(Failure::input(message));
        }
    }
    Ok(())
}

/// The paths of the frames.
struct Frames {
    folder: PathBuf,
    count: u32,
    /// Frames that already exist as links, and their targets.
    links: Vec<(u32, PathBuf)>,
}

impl Frames {
    fn new(outputs: &Outputs) -> Frames {
        let mut frames = Frames { folder: resolved(&outputs.folder), count: outputs.frames, links: Vec::new() };
        // A folder that does not exist has no links. One that cannot be read gives an error when it is written to.
        let entries = fs::read_dir(&frames.folder).into_iter().flatten().flatten();
        let links = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_symlink()));
        frames.links = links.filter_map(|link| Some((frames.named(&link.path())?, resolved(&link.path())))).collect();
        frames
    }

    /// The number of the frame with this file name.
    fn named(&self, path: &Path) -> Option<u32> {
        frame_number(path.file_name()?.to_str()?).filter(|&number| (1..=self.count).contains(&number))
    }

    /// The number of the frame that is written to a resolved path.
    fn number_of(&self, path: &Path) -> Option<u32> {
        let link = self.links.iter().find(|(_, led_to)| led_to == path).map(|&(number, _)| number);
        link.or_else(|| (path.parent() == Some(&self.folder)).then(|| self.named(path)).flatten())
    }
}

/// A path without links and dots. Its last components need not exist.
fn resolved(path: &Path) -> PathBuf {
    if let Ok(found) = fs::canonicalize(path) {
        return found;
    }
    match (path.parent(), path.file_name()) {
        (Some(parent), Some(name)) if parent.as_os_str().is_empty() => resolved(Path::new(".")).join(name),
        (Some(parent), Some(name)) => resolved(parent).join(name),
        _ => path.to_owned(),
    }
}
