//! Files that are replaced atomically: complete or not at all.

use std::{
    fs::{self, File, OpenOptions, Permissions},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

/// Writes `bytes` to `path`, completely or not at all: on an error, what was at `path` is as it was.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    file.finish()
}

/// A file in the making, for what is too long to be held. Until it is finished, what was at its path is as it was;
/// dropped before, it leaves no trace.
///
/// The bytes go to a new file in the same folder, which then takes the name: a rename inside one file system is atomic.
/// It is not synced, so the promise holds for a full disk and for a process that ends midway, not for a power cut; a
/// sync would cost more than the frame it saves.
#[derive(Debug)]
pub(crate) struct AtomicFile {
    file: Option<BufWriter<File>>,
    /// `None` for a pipe or a device, which is written to as it is.
    replacement: Option<Replacement>,
}

/// Which file is to take which name.
#[derive(Debug)]
struct Replacement {
    temporary: PathBuf,
    target: PathBuf,
    permissions: Option<Permissions>,
}

impl AtomicFile {
    pub(crate) fn create(path: &Path) -> io::Result<AtomicFile> {
        // A link is followed, not replaced. What has no file behind it yet is written where it says.
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        let existing = fs::metadata(&target).ok();
        if existing.as_ref().is_some_and(|found| !found.is_file() && !found.is_dir()) {
            // A pipe or a device must not be replaced by a file.
            let file = OpenOptions::new().write(true).open(&target)?;
            return Ok(AtomicFile { file: Some(BufWriter::new(file)), replacement: None });
        }
        let (file, temporary) = sibling(&target)?;
        let permissions = existing.filter(fs::Metadata::is_file).map(|found| found.permissions());
        Ok(AtomicFile { file: Some(BufWriter::new(file)), replacement: Some(Replacement { temporary, target, permissions }) })
    }

    /// Puts the file in its place.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        // Closed at the end of this: Windows does not rename an open file.
        if let Some(mut file) = self.file.take() {
            file.flush()?;
            if let Some(permissions) = self.replacement.as_mut().and_then(|replacement| replacement.permissions.take()) {
                file.get_ref().set_permissions(permissions)?;
            }
        }
        if let Some(Replacement { temporary, target, .. }) = &self.replacement {
            fs::rename(temporary, target)?;
            self.replacement = None;
        }
        Ok(())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.as_mut().map_or(Ok(0), |file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.as_mut().map_or(Ok(()), Write::flush)
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            // Without writing what is still in the buffer.
            drop(file.into_parts());
        }
        if let Some(replacement) = &self.replacement {
            // Of two errors the first is the one to tell.
            _ = fs::remove_file(&replacement.temporary);
        }
    }
}

/// A new, empty file in the folder of `target`, under a name that no other call takes: not `target`'s with an ending,
/// which could be too long.
fn sibling(target: &Path) -> io::Result<(File, PathBuf)> {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    loop {
        let name = format!(".cloth-deformer-{}-{}.tmp", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let path = target.with_file_name(name);
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            // Left by a process that was killed and had this number.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            opened => return opened.map(|file| (file, path)),
        }
    }
}
