//! Point caches: every byte is where other programs expect it, and files are complete or do not exist.

use std::fs;
use std::path::Path;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{PointCache, PointCacheError};

/// Two samples of three vertices, in which all numbers differ.
fn samples() -> [Vec<Vec3>; 2] {
    let position = |sample: usize, vertex: usize| Vec3::new(0.5, -1.25, 3e-7) * (3 * sample + vertex + 1) as f32;
    [0, 1].map(|sample| (0..3).map(|vertex| position(sample, vertex)).collect())
}

fn write(path: &Path) -> Result<(), PointCacheError> {
    let mut cache = PointCache::create(path, 3, 2)?;
    for sample in samples() {
        cache.push(&sample)?;
    }
    cache.finish()
}

fn names(folder: &Path) -> Vec<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// Parses the format: `<12siiffi`, then `<fff` for each vertex of each sample.
#[test]
fn a_file_has_every_number_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.pc2");
    write(&path).unwrap();
    let bytes = fs::read(&path).unwrap();
    assert_eq!(&bytes[..12], b"POINTCACHE2\0");
    let word = |at: usize| <[u8; 4]>::try_from(&bytes[at..at + 4]).unwrap();
    let (whole, real) = (|at| i32::from_le_bytes(word(at)), |at| f32::from_le_bytes(word(at)));
    assert_eq!((whole(12), whole(16), real(20), real(24), whole(28)), (1, 3, 1.0, 1.0, 2));
    assert_eq!(bytes.len(), 32 + 2 * 3 * 12);
    for (k, position) in samples().concat().iter().enumerate() {
        let at = 32 + 12 * k;
        assert_eq!([real(at), real(at + 4), real(at + 8)], position.to_array(), "position {k}");
    }
    assert_eq!(names(folder.path()), ["towel.pc2"]);
}

#[test]
fn a_cache_that_is_not_finished_leaves_no_trace() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.pc2");
    let [sample, _] = samples();
    for before in [None, Some("something else")] {
        if let Some(before) = before {
            fs::write(&path, before).unwrap();
        }
        let expected: &[&str] = if before.is_some() { &["towel.pc2"] } else { &[] };
        let unchanged = || {
            assert_eq!(names(folder.path()), expected);
            assert_eq!(fs::read_to_string(&path).ok().as_deref(), before);
        };

        let mut cache = PointCache::create(&path, 3, 2).unwrap();
        cache.push(&sample).unwrap();
        drop(cache);
        unchanged();

        let mut cache = PointCache::create(&path, 3, 2).unwrap();
        cache.push(&sample).unwrap();
        let message = cache.finish().unwrap_err().to_string();
        assert_eq!(message, "the cache was created for 2 samples, not 1; write exactly that many");
        unchanged();
    }
    write(&path).unwrap();
    assert_eq!(fs::read(&path).unwrap().len(), 32 + 2 * 3 * 12, "a finished cache takes the other file's place");
}

/// Samples that are refused are not written, and the cache can be continued.
#[test]
fn a_sample_that_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.pc2");
    let [first, second] = samples();
    let mut cache = PointCache::create(&path, 3, 2).unwrap();
    cache.push(&first).unwrap();
    let mut broken = second.clone();
    broken[1].y = f32::NAN;
    let message = cache.push(&broken).unwrap_err().to_string();
    assert!(message.starts_with("sample 2 has vertex 1 at [") && message.contains("NaN"), "{message}");
    let message = cache.push(&second[..2]).unwrap_err().to_string();
    assert_eq!(message, "sample 2 has 2 positions; give a finite position for each of the cache's 3 vertices");
    cache.push(&second).unwrap();
    assert!(matches!(cache.push(&first), Err(PointCacheError::Samples { given: 3, expected: 2 })));
    cache.finish().unwrap();
    let whole = folder.path().join("whole.pc2");
    write(&whole).unwrap();
    assert_eq!(fs::read(&path).unwrap(), fs::read(&whole).unwrap());

    let too_many = 1 << 31;
    assert!(matches!(PointCache::create(&path, too_many, 1), Err(PointCacheError::TooMany { things: "vertices", .. })));
    assert!(matches!(PointCache::create(&path, 1, too_many), Err(PointCacheError::TooMany { things: "samples", .. })));
    let nowhere = folder.path().join("none/towel.pc2");
    assert!(matches!(PointCache::create(&nowhere, 1, 1), Err(PointCacheError::Write { file, .. }) if file == nowhere));
    assert!(matches!(PointCache::create(folder.path(), 0, 0).and_then(PointCache::finish), Err(PointCacheError::Write { .. })));
}

/// A device is written to directly, and an error is reported when it is full.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error() {
    use std::os::unix::fs::FileTypeExt;
    let message = write(Path::new("/dev/full")).unwrap_err().to_string();
    assert!(message.starts_with("/dev/full: cannot be written: No space left"), "{message}");
    assert!(fs::metadata("/dev/full").unwrap().file_type().is_char_device());
}

/// A cache that was truncated cannot become complete again, even if there is room later.
#[cfg(target_os = "linux")]
#[test]
fn a_cache_that_a_write_cut_short_is_never_finished() {
    use std::fs::OpenOptions;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe.pc2");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    // Longer than the writer's buffer, shorter than the pipe's.
    let sample = vec![Vec3::ONE; 2000];
    // Opened for writing too, so that opening it does not wait for a writer.
    let reader = || OpenOptions::new().read(true).write(true).open(&path).unwrap();
    let first = reader();
    let mut cache = PointCache::create(&path, sample.len(), 1).unwrap();
    drop(first);
    assert!(matches!(cache.push(&sample), Err(PointCacheError::Write { .. })), "nobody reads");
    let _again = reader();
    let message = cache.push(&sample).unwrap_err().to_string();
    assert!(message.contains("pipe.pc2: sample 1 was cut short") && message.contains("anew"), "{message}");
    assert!(matches!(cache.finish(), Err(PointCacheError::CutShort { sample: 1, .. })));
}
