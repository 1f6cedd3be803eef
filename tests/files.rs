//! OBJ files on disk: errors name the file, reading is bounded, a file is saved completely or not at all, and no
//! temporary file remains.

use std::fs;
use std::path::{Path, PathBuf};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Mesh, ObjError};

#[test]
fn errors_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.obj");
    let message = || Mesh::load_obj(&path).unwrap_err().to_string();

    assert!(message().starts_with(&format!("{}: cannot be read: ", path.display())));
    assert!(matches!(Mesh::load_obj(folder.path()), Err(ObjError::Read { .. })), "a folder is no mesh");
    fs::write(&path, "v 0 0 0\nv nan 0 0\n").unwrap();
    assert_eq!(message(), format!("{}:2: vertex 2 is at (nan, 0, 0); positions must be finite numbers", path.display()));
    fs::write(&path, "v 0 0 0\nf 1 1 2\n").unwrap();
    assert_eq!(message(), format!("{}:2: face 1 names vertex 2, but the last one is 1 (counted from 1)", path.display()));
    fs::write(&path, "").unwrap();
    assert_eq!(message(), format!("{}: no vertices; give at least one line `v x y z`", path.display()));
}

#[test]
fn other_encodings_are_harmless_in_names_only() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.obj");
    fs::write(&path, b"# caf\xe9\no \xff\nv 0 0 0\n").unwrap();
    assert_eq!(Mesh::load_obj(&path).unwrap().positions, [Vec3::ZERO]);
    fs::write(&path, b"v 0 \xe9 0\n").unwrap();
    assert!(matches!(Mesh::load_obj(&path), Err(ObjError::Vertex { line: 1, vertex: 1, .. })));
}

/// What a text editor may have made of it is named, instead of what is not found in it.
#[test]
fn other_encodings_of_lines_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.obj");
    let text = "# towel\nv 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n";
    let of_units = |bytes: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(bytes).collect::<Vec<u8>>();
    for (bytes, words) in [
        (of_units(u16::to_le_bytes), "UTF-16 has; save it in UTF-8"),
        (b"POINTCACHE2\0\x01\0\0\0".to_vec(), "a point cache; meshes are OBJ files"),
        (of_units(u16::to_be_bytes), "UTF-16 has; save it in UTF-8"),
        (text.replace('\n', "\r").into_bytes(), "carriage returns alone; save it with line feeds"),
        (text["# towel\n".len()..].replace('\n', "\r").into_bytes(), "carriage returns alone; save it with line feeds"),
    ] {
        fs::write(&path, bytes).unwrap();
        let message = Mesh::load_obj(&path).unwrap_err().to_string();
        assert!(message.contains("towel.obj: it") && message.contains(words), "{message}");
    }
    fs::write(&path, "v 0 0 0\r").unwrap();
    assert_eq!(Mesh::load_obj(&path).unwrap().positions, [Vec3::ZERO]);
}

/// A file beyond the size limit is refused without being read.
#[cfg(unix)]
#[test]
fn a_file_beyond_the_limit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.obj");
    fs::File::create(&path).unwrap().set_len((1 << 32) + 1).unwrap();
    let message = Mesh::load_obj(&path).unwrap_err().to_string();
    let expected =
        "has more than 4294967296 bytes, the most for a mesh of 16777216 vertices; leave out all but `v` and `f`, or split it";
    assert_eq!(message, format!("{}: {expected}", path.display()));
}

/// Among others a file that never ends.
#[cfg(unix)]
#[test]
fn a_device_is_not_read() {
    let message = Mesh::load_obj("/dev/zero").unwrap_err().to_string();
    assert_eq!(message, "/dev/zero: cannot be read: it is a device, not a file or a pipe; check the path");
}

#[cfg(target_os = "linux")]
#[test]
fn a_pipe_is_read_to_its_end() {
    use std::io::Write;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe.obj");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let mesh = Mesh::grid(20, 20, 1.0, 1.0);
    let text = mesh.write_obj().unwrap();
    let read = std::thread::scope(|scope| {
        scope.spawn(|| fs::OpenOptions::new().write(true).open(&path).unwrap().write_all(text.as_bytes()).unwrap());
        Mesh::load_obj(&path).unwrap()
    });
    assert_eq!(read, mesh);
}

/// Sorted names in a folder.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_save_leaves_the_file_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.obj");
    for mesh in [Mesh::grid(20, 20, 1.0, 1.0), Mesh::grid(3, 2, 1.0, 1.0)] {
        mesh.save_obj(&path).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), mesh.write_obj().unwrap());
        assert_eq!(Mesh::load_obj(&path).unwrap(), mesh);
        assert_eq!(names(folder.path()), ["towel.obj"]);
    }
}

#[test]
fn a_failed_save_leaves_everything_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.obj");
    let mesh = Mesh::grid(2, 2, 1.0, 1.0);
    mesh.save_obj(&path).unwrap();
    let before = fs::read(&path).unwrap();

    let mut nan = mesh.clone();
    nan.positions[3].y = f32::NAN;
    let mut outside = mesh.clone();
    outside.triangles[1][2] = 4;
    let broken = [
        (nan, "vertex 3 is at (0.5, NaN, 0.5); positions must be finite numbers"),
        (outside, "triangle 1 names vertex 4, but the mesh has 4 vertices (numbered from 0)"),
        (Mesh::default(), "the mesh has no vertices; give it at least one"),
    ];
    for (mesh, problem) in broken {
        assert_eq!(mesh.save_obj(&path).unwrap_err().to_string(), format!("{}: {problem}", path.display()));
        assert_eq!(mesh.write_obj().unwrap_err().to_string(), problem);
    }

    // A directory in place of the file, a missing directory, a file in place of a directory, an empty name.
    let taken = folder.path().join("taken");
    fs::create_dir(&taken).unwrap();
    fs::write(taken.join("inside"), "").unwrap();
    for bad in [taken, folder.path().join("none/towel.obj"), path.join("towel.obj"), folder.path().into(), PathBuf::new()] {
        assert!(matches!(mesh.save_obj(&bad), Err(ObjError::Write { file, .. }) if file == bad), "{}", bad.display());
    }
    assert_eq!(names(folder.path()), ["taken", "towel.obj"]);
    assert_eq!(names(&folder.path().join("taken")), ["inside"]);
    assert_eq!(fs::read(&path).unwrap(), before);
}

#[cfg(unix)]
#[test]
fn a_save_replaces_the_file_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.obj");
    fs::write(&path, "v 0 0 0\n").unwrap();
    let reader = fs::File::open(&path).unwrap();
    Mesh::grid(2, 2, 1.0, 1.0).save_obj(&path).unwrap();
    // A reader that has opened the old file can still read all of it: the file was replaced, not overwritten.
    assert_eq!(std::io::read_to_string(reader).unwrap(), "v 0 0 0\n");
}

#[cfg(unix)]
#[test]
fn a_save_follows_links_and_keeps_permissions() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let (path, link) = (folder.path().join("towel.obj"), folder.path().join("link.obj"));
    fs::write(&path, "old").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    symlink(&path, &link).unwrap();
    Mesh::grid(2, 2, 1.0, 1.0).save_obj(&link).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(Mesh::load_obj(&path).unwrap().positions.len(), 4);
    assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
}

#[cfg(target_os = "linux")]
#[test]
fn a_device_is_written_to_not_replaced() {
    use std::os::unix::fs::FileTypeExt;
    let full = Path::new("/dev/full");
    let message = Mesh::grid(2, 2, 1.0, 1.0).save_obj(full).unwrap_err().to_string();
    assert!(message.starts_with("/dev/full: cannot be written: No space left"), "{message}");
    assert!(fs::metadata(full).unwrap().file_type().is_char_device());
}
