//! Files that are there whole or not at all, each a file of its own.

use std::{
    fmt::Display,
    fs::{self, OpenOptions},
    io::Write,
    path::{Path, PathBuf},
};

use crate::{Failure, arguments::Format, frames::cache_name};
use atomic_file::AtomicFile;

// The library's own: links are followed, and a pipe or a device is written to, not replaced.
#[expect(dead_code, reason = "the library writes all at once as well")]
#[path = "../../src/io/atomic_file.rs"]
mod atomic_file;

/// Where a run's files are written.
pub(crate) struct Outputs {
    /// The frames', made if it is not there; and their number.
    pub(crate) folder: PathBuf,
    pub(crate) frames: u32,
    /// Frames a second.
    pub(crate) fps: f32,
    pub(crate) formats: Vec<Format>,
    pub(crate) pc2: Option<PathBuf>,
    pub(crate) preview: Option<PathBuf>,
    pub(crate) report: Option<PathBuf>,
    /// Where the run is kept, every so many frames; and where it goes on from.
    pub(crate) save: Option<PathBuf>,
    pub(crate) every: u32,
    pub(crate) resume: Option<PathBuf>,
    /// Files that are read: none is written to.
    pub(crate) read: Vec<PathBuf>,
}

impl Outputs {
    /// Whether frames are written so.
    pub(crate) fn writes(&self, format: Format) -> bool {
        self.formats.contains(&format)
    }
}

/// A file that will be written later. Until then a temporary file beside it shows that it can be; dropped unwritten, it leaves no
/// trace.
pub(crate) struct Output {
    path: PathBuf,
    file: AtomicFile,
}

impl Output {
    /// Fails now if the file could not be written later.
    pub(crate) fn reserve(path: &Path) -> Result<Output, Failure> {
        if path.file_name().is_none() {
            return Err(unwritable(path, "it names no file"));
        }
        if path.is_dir() {
            return Err(unwritable(path, "it is a directory"));
        }
        // Putting a file in place of another needs no right to write the other; asking for it respects a read-only file.
        if path.is_file() {
            OpenOptions::new().append(true).open(path).map_err(|error| unwritable(path, error))?;
        }
        let file = AtomicFile::create(path).map_err(|error| unwritable(path, error))?;
        Ok(Output { path: path.to_owned(), file })
    }

    /// Puts the whole file in its place.
    pub(crate) fn write(mut self, bytes: &[u8]) -> Result<(), Failure> {
        let written = self.file.write_all(bytes).and_then(|()| self.file.finish());
        written.map_err(|error| unwritable(&self.path, error))
    }
}

fn unwritable(path: &Path, why: impl Display) -> Failure {
    Failure::input(format_args!("cannot write {}: {why}; name a file in a directory that is there and writable", path.display()))
}

/// The name of a frame's file in `--out`.
pub(crate) fn frame_name(frame: u32) -> String {
    format!("frame_{frame:04}.obj")
}

/// The frame whose file has a name.
pub(crate) fn frame_number(name: &str) -> Option<u32> {
    let number = name.strip_prefix("frame_")?.strip_suffix(".obj")?.parse().ok()?;
    (name == frame_name(number)).then_some(number)
}

/// Refuses outputs of which one would take the place of another, or of what is read.
pub(crate) fn check_apart(outputs: &Outputs) -> Result<(), Failure> {
    let Outputs { folder, formats, pc2, preview, report, save, read, .. } = outputs;
    let read = read.iter().map(|path| {
        let is_scene = path.extension().is_some_and(|extension| extension == "toml");
        (if is_scene { "the scene" } else { "the mesh" }, resolved(path))
    });
    let read: Vec<(&str, PathBuf)> = read.collect();
    let named = [("--pc2", pc2), ("--preview", preview), ("--report", report), ("--save", save)];
    let named = named.into_iter().filter_map(|(name, path)| Some((name, resolved(path.as_ref()?))));
    let caches = formats.iter().filter_map(|&format| cache_name(format));
    let written = named.chain(caches.map(|name| ("--format", resolved(&folder.join(name)))));
    let files: Vec<(&str, PathBuf)> = read.iter().cloned().chain(written).collect();
    let frames = Frames::new(outputs);
    for (k, (name, path)) in files.iter().enumerate() {
        let shown = path.display();
        // Two cloths may well be of one mesh.
        let earlier = if k < read.len() { &[] } else { &files[..k] };
        if let Some((other, _)) = earlier.iter().find(|(_, other)| other == path) {
            return Err(Failure::input(format_args!("{other} and {name} name the same file, {shown}; give each its own")));
        }
        if let Some(frame) = frames.number_of(path) {
            let message = format_args!("{name} and frame {frame} of --out name the same file, {shown}; give each its own");
            return Err(Failure::input(message));
        }
    }
    Ok(())
}

/// Where the frames go.
struct Frames {
    folder: PathBuf,
    count: u32,
    /// Frames that are links already, and what they lead to.
    links: Vec<(u32, PathBuf)>,
}

impl Frames {
    fn new(outputs: &Outputs) -> Frames {
        let mut frames = Frames { folder: resolved(&outputs.folder), count: outputs.frames, links: Vec::new() };
        // A folder that is not there yet has no links; one that cannot be read is told of where it is written to.
        let entries = fs::read_dir(&frames.folder).into_iter().flatten().flatten();
        let links = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_symlink()));
        frames.links = links.filter_map(|link| Some((frames.named(&link.path())?, resolved(&link.path())))).collect();
        frames
    }

    /// The frame of this name.
    fn named(&self, path: &Path) -> Option<u32> {
        frame_number(path.file_name()?.to_str()?).filter(|&number| (1..=self.count).contains(&number))
    }

    /// The frame that is written to a resolved path.
    fn number_of(&self, path: &Path) -> Option<u32> {
        let link = self.links.iter().find(|(_, led_to)| led_to == path).map(|&(number, _)| number);
        link.or_else(|| (path.parent() == Some(&self.folder)).then(|| self.named(path)).flatten())
    }
}

/// A path without links and dots, of which the last parts need not be there.
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
