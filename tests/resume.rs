//! Output files of the main program: a killed run continues as if it had not been killed, frames keep the input file's
//! content in every format, and frames of different runs are not mixed.

#[allow(dead_code, unreachable_pub, reason = "each program of tests takes its own part")]
#[path = "common/program.rs"]
mod program;

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use cloth_deformer::{Mesh, PointCacheReader};
use tempfile::TempDir;

/// The program in a directory, on the CPU.
fn drape(directory: &TempDir, arguments: &str) -> Command {
    let mut command = Command::new(program::path());
    command.current_dir(directory).args(arguments.split_whitespace()).args(["--backend", "cpu"]);
    command
}

#[track_caller]
fn succeeds(directory: &TempDir, arguments: &str) -> Output {
    let output = drape(directory, arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[track_caller]
fn fails(directory: &TempDir, arguments: &str, words: &[&str]) {
    let output = drape(directory, arguments).output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{text}");
    words.iter().for_each(|word| assert!(text.contains(word), "no `{word}` in: {text}"));
}

fn file(directory: &TempDir, name: &str) -> Vec<u8> {
    fs::read(directory.path().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn frame(number: u32) -> String {
    format!("frames/frame_{number:04}.obj")
}

/// A run that takes long enough to be killed in the middle.
const RUN: &str = "--frames 40 --wind 3,0,1 --fabric denim --pin 0,63 --self-contact --strain 0.01 --save run.save --every 3 --pc2 run.pc2 --preview run.png";

#[test]
fn a_killed_run_goes_on_as_if_it_had_not_been() {
    let whole = TempDir::new().unwrap();
    succeeds(&whole, RUN);
    let killed = TempDir::new().unwrap();
    let mut times = 0;
    for (until, more) in [(5, ""), (17, " --resume run.save")] {
        let mut child = drape(&killed, &format!("{RUN}{more}")).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let start = Instant::now();
        while !killed.path().join(frame(until)).exists() {
            assert!(start.elapsed() < Duration::from_secs(120), "no frame {until} after two minutes");
            sleep(Duration::from_millis(1));
        }
        // The process ends immediately, without a chance to clean up.
        child.kill().unwrap();
        times += u32::from(!child.wait().unwrap().success());
    }
    assert_eq!(times, 2, "it was done before it was killed");
    assert!(!killed.path().join(frame(40)).exists());
    succeeds(&killed, &format!("{RUN} --report run.json --resume run.save"));
    for name in (1..=40).map(frame).chain(["run.pc2", "run.png"].map(str::to_owned)) {
        assert!(file(&whole, &name) == file(&killed, &name), "{name} differs");
    }
    let report: serde_json::Value = serde_json::from_slice(&file(&killed, "run.json")).unwrap();
    let numbers: Vec<u64> = report["frames"].as_array().unwrap().iter().map(|row| row["frame"].as_u64().unwrap()).collect();
    assert_eq!(numbers, (1..=40).collect::<Vec<u64>>());
}

#[test]
fn a_run_killed_in_its_preroll_goes_on_too() {
    let run =
        "--frames 6 --preroll 0.8 --untangle --wind 3,0,1 --pin 0,63 --self-contact --save run.save --every 5 --pc2 run.pc2";
    let whole = TempDir::new().unwrap();
    succeeds(&whole, run);
    let killed = TempDir::new().unwrap();
    let mut child = drape(&killed, run).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while !killed.path().join("run.save").exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "nothing saved after two minutes");
        sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    assert!(!child.wait().unwrap().success() && !killed.path().join(frame(1)).exists(), "it was past its preroll");
    fails(&killed, "--frames 6 --preroll 0.9 --resume run.save", &["run.save", "preroll"]);
    succeeds(&killed, &format!("{run} --resume run.save"));
    for name in (1..=6).map(frame).chain(["run.pc2".to_owned()]) {
        assert!(file(&whole, &name) == file(&killed, &name), "{name} differs");
    }
}

#[test]
fn only_the_same_run_is_resumed() {
    let directory = TempDir::new().unwrap();
    let run = "--frames 4 --save run.save --every 2 --quiet";
    succeeds(&directory, run);
    let more = "--frames 6 --quiet --resume run.save";
    fails(&directory, &format!("{more} --gravity 0,-1,0"), &["run.save", "gravity"]);
    fails(&directory, &format!("{more} --fps 30"), &["run.save", "frames a second"]);
    fails(&directory, &format!("{more} --fabric silk"), &["run.save", "its fabric differs", "--fabric", "scene"]);
    let bare = "--no-sphere --floor 0 --out bare --quiet";
    succeeds(&directory, &format!("--frames 2 --save bare.save {bare}"));
    let words = ["bare.save", "its mesh differs", "MESH.obj and --scale"];
    fails(&directory, &format!("--frames 4 --resume bare.save --scale 0.5 {bare}"), &words);
    fails(&directory, &format!("{more} --substeps 9"), &["run.save", "substeps", "--substeps"]);
    fails(&directory, &format!("{more} --pin top"), &["run.save", "pins differs", "--pin"]);
    fails(&directory, "--frames 3 --out other --resume run.save", &["run.save", "frame 4", "--frames is 3"]);
    fails(&directory, "--resume missing.save", &["missing.save", "--save"]);
    #[cfg(unix)]
    fails(&directory, "--resume /dev/zero", &["/dev/zero", "no file"]);
    fails(&directory, "--every 3", &["--save"]);
    fails(&directory, "--frames 9 --save missing/run.save --out none", &["missing/run.save", "writable"]);
    assert!(!directory.path().join("none").join(frame(9)).exists(), "told before the simulation");
    fails(&directory, &format!("{more} --report run.save"), &["--resume", "--report", "same file"]);
    fails(&directory, "--save run.save --format pc2", &["obj", "--format"]);
    let bytes = file(&directory, "run.save");
    for cut in [0, 10, bytes.len() / 2, bytes.len() - 1] {
        fs::write(directory.path().join("cut.save"), &bytes[..cut]).unwrap();
        fails(&directory, "--frames 6 --resume cut.save", &["cut.save", "truncated or altered"]);
    }
    // The line before the state is text that a hand may change, and its hash, too.
    let text = |from: &str, to: &str, hashes: bool| {
        let mut parts = bytes.splitn(3, |&byte| byte == b'\n');
        let [head, hash, state] = [(); 3].map(|()| parts.next().unwrap());
        let head = String::from_utf8(head.to_vec()).unwrap();
        assert!(head.contains(from), "{head}");
        let head = head.replacen(from, to, 1);
        let fnv = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        let anew = format!("{:016x}", head.bytes().fold(0xcbf2_9ce4_8422_2325, fnv));
        let hash = if hashes { anew.as_bytes() } else { hash };
        fs::write(directory.path().join("cut.save"), [head.as_bytes(), hash, state].join(&b'\n')).unwrap();
        fails(&directory, "--frames 6 --resume cut.save", &["cut.save", "truncated or altered"]);
    };
    ["-9", "0", "3"].into_iter().for_each(|number| text("\"frame\":4,", &format!("\"frame\":{number},"), true));
    text("\"energy\":", "\"energy\":1", false);
    succeeds(&directory, more);
    assert!(directory.path().join(frame(6)).exists());
}

/// Two quads on a slope, with everything that an OBJ can contain.
const QUADS: &str = "mtllib a.mtl\no cloth\nv 0 1 0\nv 1 1 0\nv 1 1.1 1\nv 0 1.1 1\nv 2 1 0\nv 2 1.1 1\nvt 0 0\nvt 1 1\ng left\nusemtl red\ns 1\nf 1/1 4/2 3/1 2/2\ng right\nusemtl blue\ns off\nf 2/1 3/2 6/1 5/2\n";

#[test]
fn frames_are_what_the_file_was_in_every_format() {
    let directory = TempDir::new().unwrap();
    fs::write(directory.path().join("quads.obj"), QUADS).unwrap();
    succeeds(&directory, "quads.obj --frames 3 --fps 24 --format obj,pc2,mdd,usda --quiet");
    let but = |text: &str| text.lines().filter(|line| !line.starts_with("v ")).map(str::to_owned).collect::<Vec<_>>();
    let mut cache = PointCacheReader::open(directory.path().join("frames/cloth.pc2")).unwrap();
    assert_eq!((cache.samples(), cache.vertices()), (3, 6));
    let (mdd, usda) = (file(&directory, "frames/cloth.mdd"), String::from_utf8(file(&directory, "frames/cloth.usda")).unwrap());
    assert_eq!(mdd.len(), 8 + 3 * 4 + 3 * 6 * 12);
    assert!(usda.contains("int[] faceVertexCounts = [4, 4]") && usda.contains("timeCodesPerSecond = 24"), "{usda}");
    let mut sample = Vec::new();
    for number in 1..=3 {
        let text = String::from_utf8(file(&directory, &frame(number))).unwrap();
        assert_eq!(but(&text), but(QUADS), "frame {number}");
        let mesh = Mesh::parse_obj(&text).unwrap();
        cache.read(number as usize - 1, &mut sample).unwrap();
        assert_eq!(mesh.positions, sample);
        let in_mdd = &mdd[8 + 12 + 72 * (number as usize - 1)..][..72];
        let numbers: Vec<f32> = in_mdd.chunks(4).map(|word| f32::from_be_bytes(word.try_into().unwrap())).collect();
        assert_eq!(numbers, mesh.positions.iter().flat_map(cloth_deformer::glam::Vec3::to_array).collect::<Vec<f32>>());
    }
    succeeds(&directory, "quads.obj --frames 3 --out alone --format usda --quiet");
    let names: Vec<_> = fs::read_dir(directory.path().join("alone")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["cloth.usda"]);
    fails(&directory, "quads.obj --format obj,fbx", &["--format", "fbx", "usda"]);
    fails(&directory, "quads.obj --format pc2 --pc2 frames/cloth.pc2", &["--pc2", "--format", "same file"]);
}

#[test]
fn frames_of_a_longer_run_are_not_mistaken_for_this_ones() {
    let directory = TempDir::new().unwrap();
    succeeds(&directory, "--frames 5 --quiet");
    let before = file(&directory, &frame(2));
    fails(&directory, "--frames 3 --quiet --fabric silk", &["frame_0005.obj", "longer run", "--out"]);
    assert!(before == file(&directory, &frame(2)), "what is refused writes nothing");
    assert!(Path::new(&directory.path().join(frame(5))).exists(), "and removes nothing");
    succeeds(&directory, "--frames 5 --quiet --fabric silk");
    succeeds(&directory, "--frames 3 --quiet --out other");
}

/// A body of numbered files has as many as the run has frames, so a longer run goes on from a shorter one; not if a file that was used
/// has changed.
#[test]
fn a_run_with_a_body_of_numbered_files_can_be_made_longer() {
    let whole = TempDir::new().unwrap();
    let longer = TempDir::new().unwrap();
    let write = |directory: &TempDir, frame: u32, height: f32| {
        let text = format!("v -1 {height} -1\nv 1 {height} -1\nv 0 {height} 1\nf 1 3 2\n");
        fs::write(directory.path().join(format!("body_{frame:02}.obj")), text).unwrap();
    };
    for directory in [&whole, &longer] {
        (1..=8).for_each(|frame| write(directory, frame, -0.01 * f32::from(frame as u8)));
    }
    let run = "--body body_##.obj --save run.save";
    succeeds(&whole, &format!("{run} --frames 8"));
    succeeds(&longer, &format!("{run} --frames 5"));
    succeeds(&longer, &format!("{run} --frames 8 --resume run.save"));
    (1..=8).for_each(|number| assert!(file(&whole, &frame(number)) == file(&longer, &frame(number)), "frame {number}"));
    let bodies = (1..=8).map(|frame| longer.path().join(format!("body_{frame:02}.obj")));
    let kept: Vec<_> = bodies.map(|path| (fs::read(&path).unwrap(), path)).collect();
    kept.iter().for_each(|(text, path)| {
        let text = String::from_utf8(text.clone()).unwrap().replace("f 1 3 2", "f 1 2 3");
        fs::write(path, text).unwrap();
    });
    fails(&longer, &format!("{run} --frames 8 --resume run.save"), &["different", "colliders"]);
    kept.iter().for_each(|(text, path)| fs::write(path, text).unwrap());
    write(&longer, 3, 0.02);
    fails(&longer, &format!("{run} --frames 8 --resume run.save"), &["different", "colliders"]);
}

/// A USD without the texture coordinates that the input has is warned of: where a face has none, and of several cloths.
#[test]
fn a_usd_that_loses_its_texture_is_told_of() {
    let directory = TempDir::new().unwrap();
    let write = |name: &str, text: String| fs::write(directory.path().join(name), text).unwrap();
    let sheet = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 2 0 0\nv 2 0 1\nvt 0 0\nf 1/1 2/1 3/1 4/1\n";
    write("whole.obj", format!("{sheet}f 2/1 5/1 6/1 3/1\n"));
    write("part.obj", format!("{sheet}f 2 5 6 3\n"));
    let cloths = ["[[cloth]]\nmesh = \"whole.obj\"", "[[cloth]]\nmesh = \"part.obj\"\nat = [0, 1, 0]"];
    write("one.toml", cloths[0].to_owned());
    write("two.toml", cloths.join("\n"));
    let said = |arguments: &str| {
        String::from_utf8(succeeds(&directory, &format!("{arguments} --frames 2 --out {}", arguments.len())).stderr).unwrap()
    };
    let warning = "the USD has no texture coordinates";
    for arguments in ["whole.obj --format usda", "--scene one.toml --format usda", "part.obj", "--scene two.toml"] {
        assert!(!said(arguments).contains(warning), "{arguments}");
    }
    for (arguments, why) in [("part.obj --format usda", "give a `vt`"), ("--scene two.toml --format obj,usda", "several cloths")]
    {
        let text = said(arguments);
        assert!(text.contains(warning) && text.contains(why), "{arguments}: {text}");
    }
}
