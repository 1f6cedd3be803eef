//! Point caches in other formats, and reading them: every number is where other programs expect it, and invalid files
//! are refused.

use std::fs;
use std::path::Path;

use cloth_deformer::glam::{Vec2, Vec3};
use cloth_deformer::{CacheForm, Pc2ReadError, PointCache, PointCacheError, PointCacheReader, UpAxis};

/// Two samples of four vertices, in which all numbers differ.
fn samples() -> [Vec<Vec3>; 2] {
    let position = |sample: usize, vertex: usize| Vec3::new(0.5, -1.25, 3e-7) * (4 * sample + vertex + 1) as f32;
    [0, 1].map(|sample| (0..4).map(|vertex| position(sample, vertex)).collect())
}

fn write(form: CacheForm, path: &Path) -> Result<(), PointCacheError> {
    let mut cache = PointCache::create_as(form, path, 4, 2)?;
    samples().iter().try_for_each(|sample| cache.push(sample))?;
    cache.finish()
}

#[test]
fn an_mdd_has_every_number_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.mdd");
    write(CacheForm::Mdd { fps: 25.0 }, &path).unwrap();
    let bytes = fs::read(&path).unwrap();
    let word = |index: usize| <[u8; 4]>::try_from(&bytes[4 * index..4 * index + 4]).unwrap();
    let (whole, real) = (|index| i32::from_be_bytes(word(index)), |index| f32::from_be_bytes(word(index)));
    assert_eq!((whole(0), whole(1), real(2), real(3)), (2, 4, 0.0, 0.04));
    assert_eq!(bytes.len(), 4 * (4 + 2 * 4 * 3));
    for (k, number) in samples().concat().iter().flat_map(Vec3::to_array).enumerate() {
        assert_eq!(real(4 + k), number, "number {k}");
    }
}

#[test]
fn a_usd_has_the_mesh_and_a_sample_a_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("towel.usda");
    let texture = (0..7).map(|corner| Vec2::new(corner as f32, 0.5)).collect();
    write(CacheForm::Usda { fps: 24.0, up: UpAxis::Z, faces: vec![vec![0, 1, 2, 3], vec![3, 1, 0]], texture }, &path).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("#usda 1.0\n("));
    for line in [
        "metersPerUnit = 1",
        "upAxis = \"Z\"",
        "timeCodesPerSecond = 24",
        "startTimeCode = 1",
        "endTimeCode = 2",
        "int[] faceVertexCounts = [4, 3]",
        "texCoord2f[] primvars:st = [(0, 0.5), (1, 0.5), (2, 0.5), (3, 0.5), (4, 0.5), (5, 0.5), (6, 0.5)] (",
        "int[] faceVertexIndices = [0, 1, 2, 3, 3, 1, 0]",
        "1: [(0.5, -1.25, 0.0000003), (1, -2.5, 0.0000006), (1.5, -3.75, 0.00000090000003), (2, -5, 0.0000012)],",
        "2: [(2.5, -10, 0.0000015), (4, -6.25, 0.0000024)],",
    ] {
        assert!(text.lines().any(|found| found.trim() == line), "no `{line}` in {text}");
    }
    let count = |sign: char| text.matches(sign).count();
    assert_eq!([count('('), count('['), count('{')], [count(')'), count(']'), count('}')]);
}

#[test]
fn forms_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none");
    let textured = |faces: &[&[u32]], texture: &[Vec2]| {
        let faces = faces.iter().map(|face| face.to_vec()).collect();
        CacheForm::Usda { fps: 24.0, up: UpAxis::Y, faces, texture: texture.to_vec() }
    };
    let faces = |faces: &[&[u32]]| textured(faces, &[]);
    for (form, words) in [
        (CacheForm::Mdd { fps: 0.0 }, ["fps = 0", "above 0"]),
        (CacheForm::Mdd { fps: 1e-45 }, ["fps = 0.00", "2 samples"]),
        (CacheForm::Mdd { fps: f32::NAN }, ["fps = NaN", "finite"]),
        (faces(&[&[0, 1, 2], &[0, 1, 4]]), ["face 1", "4 vertices"]),
        (faces(&[&[0, 1]]), ["face 0", "three"]),
        (textured(&[&[0, 1, 2]], &[Vec2::ZERO; 2]), ["2 texture coordinates", "3 corners"]),
        (textured(&[&[0, 1, 2]], &[Vec2::NAN; 3]), ["texture[0]", "finite"]),
    ] {
        let refusal = write(form, &path).unwrap_err().to_string();
        words.iter().for_each(|word| assert!(refusal.contains(word), "{refusal}"));
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Before there are any samples that would be lost.
#[test]
fn a_directory_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = PointCache::create(folder.path(), 4, 2).unwrap_err().to_string();
    assert!(refusal.contains("cannot be written: is a directory"), "{refusal}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_pc2_is_read_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("body.pc2");
    write(CacheForm::Pc2, &path).unwrap();
    let mut cache = PointCacheReader::open(&path).unwrap();
    assert_eq!((cache.vertices(), cache.samples(), cache.frame(0), cache.frame(1)), (4, 2, 1.0, 2.0));
    let mut read = vec![Vec3::ONE; 9];
    for sample in [1, 0, 1] {
        cache.read(sample, &mut read).unwrap();
        assert_eq!(read, samples()[sample]);
    }
    let refusal = cache.read(2, &mut read).unwrap_err();
    assert!(matches!(refusal, Pc2ReadError::Sample { sample: 2, samples: 2, .. }), "{refusal}");
    assert_eq!(read, samples()[1], "what is refused changes nothing");
}

#[test]
fn files_that_are_no_pc2_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("body.pc2");
    write(CacheForm::Pc2, &path).unwrap();
    let whole = fs::read(&path).unwrap();
    let refused = |bytes: &[u8], word: &str| {
        fs::write(&path, bytes).unwrap();
        let refusal = PointCacheReader::open(&path).unwrap_err().to_string();
        assert!(refusal.contains("body.pc2") && refusal.contains(word), "{refusal}");
    };
    for cut in 0..whole.len() {
        refused(&whole[..cut], if cut < 32 { "no PC2" } else { "cut" });
    }
    refused(&[&whole[..], b"more"].concat(), "altered");
    let altered = |at: usize, word: [u8; 4]| [&whole[..at], &word, &whole[at + 4..]].concat();
    refused(&altered(0, *b"MDD2"), "no PC2");
    refused(&altered(12, 2_i32.to_le_bytes()), "version 2");
    refused(&altered(16, (-1_i32).to_le_bytes()), "-1 vertices");
    refused(&altered(16, i32::MAX.to_le_bytes()), "cut or altered");
    refused(&altered(28, i32::MAX.to_le_bytes()), "cut or altered");
    refused(&altered(20, f32::NAN.to_le_bytes()), "NaN");
    assert!(PointCacheReader::open(folder.path()).is_err());
    assert!(PointCacheReader::open(folder.path().join("missing")).unwrap_err().to_string().contains("missing"));
    #[cfg(unix)]
    {
        // Opening a pipe that nobody writes to would never return.
        let pipe = folder.path().join("pipe.pc2");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert!(PointCacheReader::open(&pipe).unwrap_err().to_string().contains("is no file"));
    }
    // Positions are only checked when they are read.
    fs::write(&path, altered(32 + 12, f32::INFINITY.to_le_bytes())).unwrap();
    let (mut cache, mut read) = (PointCacheReader::open(&path).unwrap(), Vec::new());
    let refusal = cache.read(0, &mut read).unwrap_err().to_string();
    assert!(refusal.contains("sample 0") && refusal.contains("vertex 1"), "{refusal}");
    cache.read(1, &mut read).unwrap();
}
