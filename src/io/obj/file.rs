//! The bytes of a file of limited length.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use crate::io::obj::error::{MAX_OBJ_BYTES, ObjError};

/// Reads a file.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, ObjError> {
    let bytes = read(path).map_err(|reason| ObjError::Read { file: path.to_owned(), reason })?;
    bytes.ok_or_else(|| ObjError::TooLong { file: path.to_owned() })
}

/// Reads a file; `None` if it has more bytes than an OBJ may have.
fn read(path: &Path) -> io::Result<Option<Vec<u8>>> {
    // Only the length of a regular file is known beforehand. A device is not even opened, because opening alone has an
    // effect on some.
    let found = fs::metadata(path)?;
    if is_device(&found) {
        return Err(io::Error::other("it is a device, not a file or a pipe"));
    }
    if found.len() > MAX_OBJ_BYTES {
        return Ok(None);
    }
    up_to(MAX_OBJ_BYTES, File::open(path)?)
}

#[cfg(unix)]
fn is_device(found: &fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    found.file_type().is_char_device() || found.file_type().is_block_device()
}

#[cfg(not(unix))]
fn is_device(_: &fs::Metadata) -> bool {
    false
}

/// Reads everything; `None` if there are more than `limit` bytes.
fn up_to(limit: u64, from: impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    from.take(limit + 1).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= limit).then_some(bytes))
}

#[cfg(test)]
#[path = "../../../tests/unit/io_obj_file.rs"]
mod tests;
