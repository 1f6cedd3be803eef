//! Files that are there whole or not at all.

use std::{
    error::Error,
    fmt::Display,
    fs::OpenOptions,
    io::Write,
    path::{Path, PathBuf},
};

use tempfile::{Builder, NamedTempFile};

use crate::Failure;

/// The place of a file that will be written later. Until then a temporary file beside it shows that it can be;
/// dropped unwritten, it leaves no trace.
pub(crate) struct Output {
    path: PathBuf,
    file: NamedTempFile,
}

impl Output {
    /// Fails now if the file could not be written later.
    pub(crate) fn reserve(path: &Path) -> Result<Output, Failure> {
        let name = path.file_name().ok_or_else(|| unwritable(path, "it names no file"))?;
        if path.is_dir() {
            return Err(unwritable(path, "it is a directory"));
        }
        // Putting a file in place of another needs no right to write the other; asking for it respects a read-only file.
        if path.exists() {
            OpenOptions::new().append(true).open(path).map_err(|error| unwritable(path, error))?;
        }
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = Builder::new();
        builder.prefix(name).suffix(".tmp");
        #[cfg(unix)]
        {
            // Temporary files are private; this one becomes a file like any other, as the umask has it.
            use std::{fs::Permissions, os::unix::fs::PermissionsExt};
            builder.permissions(Permissions::from_mode(0o666));
        }
        let file = builder.tempfile_in(parent).map_err(|error| match error.source() {
            // Without the temporary file's own name, which tells the user nothing.
            Some(cause) => unwritable(path, cause),
            None => unwritable(path, error),
        })?;
        Ok(Output { path: path.to_owned(), file })
    }

    /// Puts the whole file in its place.
    pub(crate) fn write(mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.file.write_all(bytes).map_err(|error| unwritable(&self.path, error))?;
        self.file.persist(&self.path).map_err(|error| unwritable(&self.path, error.error))?;
        Ok(())
    }
}

fn unwritable(path: &Path, why: impl Display) -> Failure {
    Failure::input(format_args!("cannot write {}: {why}; name a file in a directory that is there and writable", path.display()))
}
