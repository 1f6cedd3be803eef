//! The folder of a variant, which is complete or absent even if processes are killed.

use std::fs;
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
    pub(crate) lock: PathBuf,
}

impl VariantFolder {
    /// The folder of a variant in `--out`.
    pub(crate) fn of(out: &Path, number: u32) -> VariantFolder {
        let name = format!("variant_{number:04}");
        let hidden = |suffix: &str| out.join(format!(".{name}{suffix}"));
        VariantFolder { partial: hidden(""), old: hidden(".old"), lock: hidden(".lock"), complete: out.join(name) }
    }

    /// Whether nothing is left of a variant that was replaced.
    pub(crate) fn is_settled(&self) -> bool {
        !self.old.exists()
    }

    /// Clears away what a process left that was killed while it replaced the variant. To be called under the lock.
    pub(crate) fn settle(&self) -> Result<(), Failure> {
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
