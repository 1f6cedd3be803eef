//! The preroll of scenes: before frame 1, pins go from the mesh and colliders from their starts to where they are at frame 1, and
//! the cloth settles.

#[allow(dead_code, unreachable_pub, reason = "each program of tests takes its own part")]
#[path = "common/program.rs"]
mod program;

use std::fmt::Write;
use std::fs;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Mesh, PointCacheReader};
use program::{fails, run, succeeds};
use serde_json::Value;
use tempfile::TempDir;

/// Runs a scene's text in a directory of its own.
#[track_caller]
fn played(text: &str, arguments: &[&str]) -> TempDir {
    let directory = TempDir::new().unwrap();
    fs::write(directory.path().join("s.toml"), text).unwrap();
    succeeds(&run(&directory, &[&["--scene", "s.toml", "--quiet"], arguments].concat()));
    directory
}

/// Reads the positions of a frame.
fn frame(directory: &TempDir, number: u32) -> Vec<Vec3> {
    Mesh::load_obj(directory.path().join(format!("frames/frame_{number:04}.obj"))).unwrap().positions
}

/// Sum of the squares of the distances that the vertices move from a frame to the next (m²), a measure of kinetic energy.
fn motion(directory: &TempDir, number: u32) -> f32 {
    frame(directory, number).iter().zip(frame(directory, number + 1)).map(|(a, b)| a.distance_squared(b)).sum()
}

/// The way of least jerk from 0 to 1 over the first half of a preroll of this many frames.
fn ease(passed: u32, frames: u32) -> f64 {
    let s = (2.0 * f64::from(passed) / f64::from(frames)).min(1.0);
    10.0 * s.powi(3) - 15.0 * s.powi(4) + 6.0 * s.powi(5)
}

/// Key frames of a vector, one for each frame of the way from `from` to `to`, in the single precision of the program.
fn keys(from: Vec3, to: Vec3, frames: u32) -> String {
    let key = |passed: u32| {
        let value = from.lerp(to, ease(passed, frames) as f32).to_array();
        format!("{{ time = {}, value = {value:?} }}", f64::from(passed) / 60.0)
    };
    format!("[{}]", (0..=frames).map(key).collect::<Vec<_>>().join(", "))
}

/// A sheet that hangs from its upper edge beside a ball, in air.
const SHEET: &str = "
frames = 12
[quality]
substeps = 20
[wind]
velocity = [0, 0, 1]
[[cloth]]
grid = { columns = 9, rows = 9, width = 0.8, height = 0.8 }
rotate = [90, 0, 0]
";

/// A preroll is a run whose key frames lead along the same way, of which only the end is written: bit for bit.
#[test]
fn a_preroll_is_a_run_with_its_key_frames() {
    let pins = [
        ("move", Vec3::ZERO, Vec3::new(0.5, 0.1, 0.2)),
        ("rotate", Vec3::ZERO, Vec3::new(0.0, 60.0, 10.0)),
        ("scale", Vec3::ONE, Vec3::new(0.8, 1.0, 1.0)),
    ];
    let (from, to) = (Vec3::new(-0.5, -0.2, 0.3), Vec3::new(0.4, -0.1, 0.1));
    let (mut short, mut long) = (format!("preroll = 0.5\n{SHEET}"), SHEET.replace("frames = 12", "frames = 42"));
    for text in [&mut short, &mut long] {
        text.push_str("[[cloth.pin]]\nrule = \"top\"\n");
    }
    for (key, from, to) in pins {
        writeln!(short, "{key} = {:?}", to.to_array()).unwrap();
        writeln!(long, "{key} = {}", keys(from, to, 30)).unwrap();
    }
    let ball = "[[collider]]\nshape = \"sphere\"\nradius = 0.2\ncenter = ";
    let [start, end] = [from, to].map(|at| format!("{:?}", at.to_array()));
    writeln!(short, "{ball}{{ start = {start}, keys = [{{ time = 0, value = {end} }}] }}").unwrap();
    writeln!(long, "{ball}{}", keys(from, to, 30)).unwrap();
    let (short, long) = (played(&short, &[]), played(&long, &[]));
    for number in 1..=12 {
        assert_eq!(frame(&short, number), frame(&long, number + 30), "frame {number}");
    }
}

/// Pins are exactly where they are at frame 1, and the cloth hangs there almost at rest; without the preroll the same
/// cloth swings down from its mesh.
#[test]
fn cloth_is_at_rest_at_frame_1() {
    let text = SHEET.replace("rotate = [90, 0, 0]\n", "").replace("[0, 0, 1]", "[0, 0, 0]");
    let pins = |motion: &str| format!("{text}[[cloth.pin]]\nrule = \"top\"\n{motion}");
    let still = played(&pins(""), &["--frames", "31"]);
    let swinging: f32 = (1..=30).map(|number| motion(&still, number)).fold(0.0, f32::max);
    let settled = played(&pins("move = [1, 0, 0]\nscale = [0.8, 1, 1]\n"), &["--preroll", "12"]);
    let rest = motion(&settled, 1);
    println!("{rest} m2 instead of {swinging} m2");
    assert!(rest < 1e-3 * swinging, "{rest} m2 instead of {swinging} m2");
    let x = frame(&settled, 1);
    let is_pin = |x: &Vec3| (x.z + 0.4).abs() < 1e-6;
    let grid = Mesh::grid(9, 9, 0.8, 0.8).positions;
    for (vertex, at) in grid.iter().enumerate().filter(|(_, at)| is_pin(at)) {
        assert_eq!(x[vertex], Vec3::X + Vec3::new(0.8, 1.0, 1.0) * *at, "pin {vertex}");
        assert_eq!(x[vertex], frame(&settled, 12)[vertex]);
    }
    assert!(x.iter().all(|x| x.y < 1e-3) && x.iter().any(|x| x.y < -0.7), "it hangs");
}

/// Without gravity and air, pins that go a distance `d` in a time `t` have a speed of at most `15/8 d/t`. What they pull
/// gets at most twice that, the speed of a body that bounces off them.
#[test]
fn a_preroll_adds_no_more_energy_than_the_pins_work() {
    let text = SHEET.replace("velocity = [0, 0, 1]", "velocity = [0, 0, 0]\ndensity = 0");
    let text = format!("gravity = [0, 0, 0]\n{text}[[cloth.pin]]\nrule = \"top\"\nmove = [0.3, 0, 0.6]\n");
    let mass = 0.64 * f64::from(cloth_deformer::Fabric::TOWEL.density);
    for seconds in [0.5, 1.0, 2.0] {
        let directory = played(&text, &["--preroll", &seconds.to_string(), "--report", "r.json"]);
        let report: Value = serde_json::from_slice(&fs::read(directory.path().join("r.json")).unwrap()).unwrap();
        let energy = report["frames"][0]["energy"].as_f64().unwrap();
        let speed = 15.0 / 8.0 * 0.45_f64.sqrt() / (0.5 * seconds);
        let most = 0.5 * mass * (2.0 * speed).powi(2);
        println!("{energy} J of {most} J");
        assert!(energy > 1e-3 * most && energy < most, "{seconds} s: {energy} J of {most} J");
    }
}

/// Gravity and wind are those of frame 1 during the preroll, or come from a start of their own.
#[test]
fn gravity_and_wind_are_those_of_frame_1() {
    let sheet =
        SHEET.replace("velocity = [0, 0, 1]", "velocity = [{ time = 0, value = [0, 0, 0] }, { time = 1, value = [9, 0, 0] }]");
    let later = "gravity = [{ time = 0, value = [0, 0, 0] }, { time = 1, value = [0, -9.81, 0] }]\n";
    let x = frame(&played(&format!("preroll = 0.5\n{later}{sheet}"), &[]), 1);
    let grid = Mesh::grid(9, 9, 0.8, 0.8).positions;
    let off = x.iter().zip(grid).map(|(x, at)| x.distance(Vec3::new(at.x, -at.z, at.y))).fold(0.0, f32::max);
    assert!(off < 1e-6, "{off} m from the mesh");
    // In the step to a frame, gravity is the mean of both frames. In the next step the mean speed is that of its middle.
    let start = "gravity = { start = [0, 0, 0], keys = [{ time = 0, value = [0, -6, 0] }] }\n";
    let sheet = SHEET.replace("velocity = [0, 0, 1]", "velocity = [0, 0, 0]\ndensity = 0");
    let directory = played(&format!("preroll = 1\n{start}{sheet}"), &[]);
    let speed = 60.0 * f64::from(frame(&directory, 1)[40].y - frame(&directory, 2)[40].y);
    let fallen = (1..=60).map(|passed| 0.5 * (ease(passed - 1, 60) + ease(passed, 60))).sum::<f64>() + 0.5;
    assert!((speed - 6.0 / 60.0 * fallen).abs() < 0.005, "{speed} m/s");
}

/// A table carries what lies on it from its start to where it is at frame 1: a box, and a mesh with an OBJ file for its start.
#[test]
fn colliders_come_from_their_start() {
    let sheet = "[[cloth]]\ngrid = { columns = 5, rows = 5, width = 0.4, height = 0.4 }\nat = [0.01, 0.005, 0.02]\n";
    let slab =
        "shape = \"box\"\nhalf = [1, 0.1, 1]\ncenter = { start = [0, -0.1, 0], keys = [{ time = 0, value = [0.2, 0.1, 0] }] }\n";
    let patch = "shape = \"mesh\"\nmesh = \"end.obj\"\nstart = \"start.obj\"\n";
    for (table, height) in [(slab, 0.2), (patch, 0.2)] {
        let directory = TempDir::new().unwrap();
        for (name, at) in [("start.obj", Vec3::ZERO), ("end.obj", Vec3::new(0.2, 0.2, 0.0))] {
            let mut mesh = Mesh::grid(3, 3, 2.0, 2.0);
            mesh.positions.iter_mut().for_each(|x| *x += at);
            mesh.save_obj(directory.path().join(name)).unwrap();
        }
        let text = format!("frames = 2\npreroll = 2\n{sheet}[[collider]]\nfriction = 1\n{table}");
        fs::write(directory.path().join("s.toml"), text).unwrap();
        succeeds(&run(&directory, &["--scene", "s.toml", "--quiet"]));
        for (x, at) in frame(&directory, 1).iter().zip(Mesh::grid(5, 5, 0.4, 0.4).positions) {
            assert!((x.y - height).abs() < 0.01 && (x.x - at.x - 0.21).abs() < 0.01, "{x} of {at} on {table}");
        }
    }
}

/// The preroll is not written to any file; one of 0 s changes no byte.
#[test]
fn only_frames_from_1_on_are_written() {
    let text = format!("{SHEET}[[cloth.pin]]\nrule = \"top\"\n");
    let outputs = ["--pc2", "o.pc2", "--preview", "p.png", "--format", "obj,usda", "--frames", "3"];
    let plain = played(&text, &outputs);
    let none = played(&format!("preroll = 0\n{text}"), &outputs);
    let some = played(&text, &[&outputs[..], &["--preroll", "0.001", "--report", "r.json"]].concat());
    for name in ["frames/frame_0001.obj", "frames/frame_0003.obj", "frames/cloth.usda", "o.pc2", "p.png"] {
        let read = |directory: &TempDir| fs::read(directory.path().join(name)).unwrap();
        assert!(read(&plain) == read(&none), "{name}");
        assert!(read(&plain) != read(&some), "a preroll is at least one frame long: {name}");
    }
    // One frame before frame 1: its frame 1 is the plain run's frame 2.
    assert_eq!(frame(&some, 1), frame(&plain, 2));
    assert_eq!(fs::read_dir(some.path().join("frames")).unwrap().count(), 4);
    assert_eq!(PointCacheReader::open(some.path().join("o.pc2")).unwrap().samples(), 3);
    let report: Value = serde_json::from_slice(&fs::read(some.path().join("r.json")).unwrap()).unwrap();
    let numbers: Vec<u64> = report["frames"].as_array().unwrap().iter().map(|row| row["frame"].as_u64().unwrap()).collect();
    assert_eq!(numbers, [1, 2, 3]);
}

/// Variants of a scene may differ in the preroll, and each is the run with that preroll.
#[test]
fn a_preroll_can_be_varied() {
    let pins = "[[cloth.pin]]\nrule = \"top\"\n[[vary]]\nkey = \"preroll\"\nvalues = [0, 0.1]\n";
    let text = format!("{SHEET}{pins}");
    let varied = played(&text, &["--variant", "1-2", "--frames", "2"]);
    for (number, seconds) in [(1, "0"), (2, "0.1")] {
        let alone = played(&text, &["--preroll", seconds, "--frames", "2"]);
        let path = varied.path().join(format!("frames/variant_{number:04}/frame_0002.obj"));
        assert_eq!(Mesh::load_obj(path).unwrap().positions, frame(&alone, 2), "{seconds} s");
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let cloth = "[[cloth]]\ngrid = { columns = 3, rows = 3, width = 1, height = 1 }\n";
    let start = "{ start = [0, 1, 0], keys = [{ time = 0, value = [0, 2, 0] }] }";
    let ball = format!("{cloth}[[collider]]\nname = \"it\"\nshape = \"sphere\"\nradius = 1\ncenter = {start}\n");
    let body = format!("{cloth}[[collider]]\nname = \"it\"\nshape = \"mesh\"\nmesh = \"s.obj\"\nstart = \"t.obj\"\n");
    let pin = |text: &str| format!("{cloth}[[cloth.pin]]\nrule = \"top\"\n{text}");
    let table: [(String, &str, &[&str]); 12] = [
        ("preroll = -1".into(), "s.toml:1: ", &["0 or above"]),
        ("preroll = nan".into(), "s.toml:1: ", &["finite"]),
        (format!("frames = 2\npreroll = 1e9\n{cloth}"), "s.toml:2: ", &["1000000000 s", "1000000 frames"]),
        (format!("gravity = {start}\n{cloth}"), "s.toml:1: ", &["`start`", "preroll"]),
        (format!("{cloth}[wind]\nvelocity = {start}\n"), "s.toml:3: ", &["`start`", "preroll"]),
        (ball.clone(), "s.toml:3: ", &["it", "`start`", "preroll"]),
        (body.clone(), "s.toml:3: ", &["it", "`start`", "preroll"]),
        (
            format!("preroll = 1\n{}", ball.replace("start = [0, 1, 0]", "start = [0, 1]")),
            "s.toml:8: ",
            &["three finite numbers"],
        ),
        (format!("preroll = 1\n{body}"), "s.toml:4: ", &["it", "t.obj", "vertices differ", "first frame"]),
        (pin("move = [0, 1, 0]"), "s.toml:3: ", &["0 s", "preroll"]),
        (format!("preroll = 1\n{}", pin(&format!("move = {start}"))), "s.toml:4: ", &["pin 1", "`start`"]),
        (
            format!(
                "preroll = 1\n{cloth}[[collider]]\nname = \"it\"\nshape = \"plane\"\npoint = [0, 0, 0]\nnormal = {{ start = [0, -1, 0], keys = [{{ time = 0, value = [0, 1, 0] }}] }}\n"
            ),
            "s.toml:4: ",
            &["it", "before frame 1", "direction"],
        ),
    ];
    for (text, line, words) in table {
        let directory = TempDir::new().unwrap();
        fs::write(directory.path().join("s.toml"), &text).unwrap();
        Mesh::grid(2, 2, 1.0, 1.0).save_obj(directory.path().join("s.obj")).unwrap();
        Mesh::grid(3, 2, 1.0, 1.0).save_obj(directory.path().join("t.obj")).unwrap();
        let output = run(&directory, &["--scene", "s.toml", "--quiet"]);
        println!("{text:?} -> {}", program::stderr(&output).trim_end());
        fails(&output, 2, &[&[line], words].concat());
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 3, "nothing is written");
    }
    for seconds in ["-1", "nan", "soon", "1e30"] {
        fails(&run(&TempDir::new().unwrap(), &["--preroll", seconds]), 2, &["--preroll"]);
    }
}
