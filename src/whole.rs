//! Files that are there whole or not at all.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

/// Writes `bytes` to `path`, whole or not at all: on an error, what was at `path` is as it was.
///
/// The bytes go to a new file in the same folder, which then takes the name: a rename inside one file system is atomic.
/// It is not synced, so the promise holds for a full disk and for a process that ends midway, not for a power cut; a
/// sync would cost more than the frame it saves.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A link is followed, not replaced. What has no file behind it yet is written where it says.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let existing = fs::metadata(&target).ok();
    if existing.as_ref().is_some_and(|found| !found.is_file() && !found.is_dir()) {
        // A pipe or a device holds nothing that could stay whole, and must not be replaced by a file.
        return OpenOptions::new().write(true).open(&target)?.write_all(bytes);
    }
    let (mut file, temporary) = sibling(&target)?;
    let written = file.write_all(bytes).and_then(|()| match existing {
        Some(found) if found.is_file() => file.set_permissions(found.permissions()),
        _ => Ok(()),
    });
    drop(file); // Windows does not rename an open file.
    let result = written.and_then(|()| fs::rename(&temporary, &target));
    if result.is_err() {
        // The first error is the one to tell.
        _ = fs::remove_file(&temporary);
    }
    result
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
