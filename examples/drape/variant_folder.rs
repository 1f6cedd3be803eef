//! The folder of a variant, which is complete or absent even if processes are killed, and its lock.

use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use crate::Failure;
use crate::receipt;

/// The folder of a variant, and those beside it in which it is made and replaced.
pub(crate) struct VariantFolder {
    /// Complete if it exists.
    pub(crate) complete: PathBuf,
    /// What is being made.
    pub(crate) partial: PathBuf,
    /// What was complete, until what replaces it is.
    old: PathBuf,
    lock: PathBuf,
}

/// Held, it keeps other processes from making the variant. The file is removed only while it is held: without that, the next process
/// could lock a new file of this name while another one still holds the old file.
pub(crate) struct Lock {
    path: PathBuf,
    /// Closed, it is free.
    _file: File,
}

impl Lock {
    fn take(path: &Path) -> Result<Lock, Failure> {
        loop {
            let opened = OpenOptions::new().write(true).create(true).truncate(false).open(path);
            let file = opened.map_err(|error| failed(path, error))?;
            match file.try_lock() {
                Err(TryLockError::WouldBlock) => {
                    return Err(Failure::input(format_args!("another process runs it ({} is locked)", path.display())));
                }
                Err(TryLockError::Error(error)) => return Err(failed(path, error)),
                Ok(()) if is_at(path, &file) => return Ok(Lock { path: path.to_owned(), _file: file }),
                // Whoever held it removed it after it was opened here.
                Ok(()) => {}
            }
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // A lock file that stays is locked again by the next process.
        _ = fs::remove_file(&self.path);
    }
}

/// Whether a path leads to an open file.
fn is_at(path: &Path, file: &File) -> bool {
    let found = [fs::metadata(path), file.metadata()].map(|found| found.ok().map(|found| identity(&found)));
    found[0].is_some() && found[0] == found[1]
}

/// What tells files apart.
#[cfg(unix)]
fn identity(found: &Metadata) -> impl PartialEq + use<> {
    use std::os::unix::fs::MetadataExt;
    (found.dev(), found.ino())
}

/// What tells apart files that are made one after another, and never written to.
#[cfg(not(unix))]
fn identity(found: &Metadata) -> impl PartialEq + use<> {
    (found.created().ok(), found.modified().ok())
}

impl VariantFolder {
    /// The folder of a variant in `--out`.
    pub(crate) fn of(out: &Path, number: u32) -> VariantFolder {
        let name = format!("variant_{number:04}");
        let hidden = |suffix: &str| out.join(format!(".{name}{suffix}"));
        VariantFolder { partial: hidden(""), old: hidden(".old"), lock: hidden(".lock"), complete: out.join(name) }
    }

    /// Whether no process makes the variant or was killed while it did.
    pub(crate) fn is_settled(&self) -> bool {
        !self.lock.exists() && !self.old.exists()
    }

    /// Keeps other processes from making the variant, and clears away what one left that was killed while it replaced it. A killed
    /// process releases its lock.
    pub(crate) fn lock(&self) -> Result<Lock, Failure> {
        let lock = Lock::take(&self.lock)?;
        self.settle()?;
        Ok(lock)
    }

    fn settle(&self) -> Result<(), Failure> {
        // It was killed between the two renames.
        if self.old.exists() && !self.complete.exists() {
            return rename(&self.old, &self.complete);
        }
        remove(&self.old)
    }

    /// Makes an empty folder for what is to become the variant.
    pub(crate) fn begin(&self) -> Result<(), Failure> {
        self.abandon()?;
        fs::create_dir(&self.partial).map_err(|error| failed(&self.partial, error))
    }

    /// Removes what was made so far.
    pub(crate) fn abandon(&self) -> Result<(), Failure> {
        remove(&self.partial)
    }

    /// Puts what was made in the place of the variant, which may be there with other inputs. That one goes as a whole: with a part of its
    /// files removed it would still have its receipt, and count as complete.
    pub(crate) fn finish(&self) -> Result<(), Failure> {
        if self.complete.exists() {
            rename(&self.complete, &self.old)?;
        }
        rename(&self.partial, &self.complete)?;
        remove(&self.old)
    }

    /// What to say of the variant with other inputs that is there, if any. Anything else is not to be removed.
    pub(crate) fn replaced(&self) -> Result<&'static str, Failure> {
        let folder = &self.complete;
        match (folder.exists(), folder.join(receipt::NAME).exists()) {
            (false, _) => Ok(""),
            (true, true) => Ok(", and replaces the one there, which had other inputs"),
            (true, false) => {
                let message = format_args!("{} has no receipt of a variant; remove it, or use another --out", folder.display());
                Err(Failure::input(message))
            }
        }
    }
}

fn rename(from: &Path, to: &Path) -> Result<(), Failure> {
    fs::rename(from, to).map_err(|error| failed(to, error))
}

fn remove(folder: &Path) -> Result<(), Failure> {
    if folder.exists() { fs::remove_dir_all(folder).map_err(|error| failed(folder, error)) } else { Ok(()) }
}

/// What was not possible with a file or a folder.
pub(crate) fn failed(path: &Path, error: std::io::Error) -> Failure {
    Failure::input(format_args!("{}: {error}", path.display()))
}
