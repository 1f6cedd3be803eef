//! Files that are replaced atomically: they are written completely or not at all.

use std::{
    fs::{self, File, OpenOptions, Permissions},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

/// How the name of an unfinished file begins. The id of the process that writes it follows, `-`, and more.
pub(crate) const UNFINISHED: &str = ".cloth-deformer-";

/// Writes `bytes` to `path`, completely or not at all: on an error, whatever was at `path` is unchanged.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    file.finish()
}

/// A file being written, for content too long to keep in memory. Until [`AtomicFile::finish`], whatever was at its path
/// is unchanged; dropped before that, it leaves nothing behind.
///
/// The bytes go to a new file in the same folder, which is then renamed, because a rename within a file system is
/// atomic. The file is not synced, so this guards against a full disk and a process that ends early, but not against a
/// power failure; a sync would take longer than the frame that is saved.
#[derive(Debug)]
pub(crate) struct AtomicFile {
    file: Option<BufWriter<File>>,
    /// `None` for a pipe or a device, which is written to directly.
    replacement: Option<Replacement>,
}

/// Which file replaces which.
#[derive(Debug)]
struct Replacement {
    temporary: PathBuf,
    target: PathBuf,
    permissions: Option<Permissions>,
}

impl AtomicFile {
    pub(crate) fn create(path: &Path) -> io::Result<AtomicFile> {
        // A symbolic link is followed, not replaced. A path that does not resolve is used as given.
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        let existing = fs::metadata(&target).ok();
        if existing.as_ref().is_some_and(fs::Metadata::is_dir) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if existing.as_ref().is_some_and(|found| !found.is_file()) {
            // A pipe or a device must not be replaced by a file.
            let file = OpenOptions::new().write(true).open(&target)?;
            return Ok(AtomicFile { file: Some(BufWriter::new(file)), replacement: None });
        }
        let (file, temporary) = sibling(&target)?;
        let permissions = existing.map(|found| found.permissions());
        Ok(AtomicFile { file: Some(BufWriter::new(file)), replacement: Some(Replacement { temporary, target, permissions }) })
    }

    /// Renames the file to its final path.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        // The file is closed at the end of this block, because Windows cannot rename an open file.
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
            // Drops the file without writing what is still in the buffer.
            drop(file.into_parts());
        }
        if let Some(replacement) = &self.replacement {
            // The caller has already seen the first error, which matters more.
            _ = fs::remove_file(&replacement.temporary);
        }
    }
}

/// Creates a new, empty file in the folder of `target`, under a name that no other call uses. The name is not that of
/// `target` with a suffix, which could be too long for the file system.
fn sibling(target: &Path) -> io::Result<(File, PathBuf)> {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    loop {
        let name = format!("{UNFINISHED}{}-{}.tmp", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let path = target.with_file_name(name);
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            // Left behind by a killed process with the same process id.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            opened => return opened.map(|file| (file, path)),
        }
    }
}
