//! Scene files: those that come with the program run, and each key has the effect it states.

#[allow(dead_code, unreachable_pub, reason = "each program of tests takes its own part")]
#[path = "common/program.rs"]
mod program;

use std::fs;
use std::iter;
use std::path::{Path, PathBuf};

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Mesh, UpAxis};
use program::{fails, read_png, run, scene, succeeds};
use serde_json::Value;
use tempfile::TempDir;

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/scenes")
}

/// Reads the positions of a frame.
fn frame(directory: &TempDir, number: u32) -> Vec<Vec3> {
    Mesh::load_obj(directory.path().join(format!("frames/frame_{number:04}.obj"))).unwrap().positions
}

#[test]
fn every_example_runs() {
    let files = fs::read_dir(examples()).unwrap().map(|entry| entry.unwrap().path());
    let mut scenes: Vec<PathBuf> = files.filter(|path| path.extension().is_some_and(|extension| extension == "toml")).collect();
    scenes.sort();
    let names: Vec<&str> = scenes.iter().map(|path| path.file_stem().unwrap().to_str().unwrap()).collect();
    for wanted in ["towel", "flag", "tablecloth", "cape", "curtain", "hammock", "skirt", "heap"] {
        assert!(names.contains(&wanted), "{wanted} among {names:?}");
    }
    for (scene, name) in scenes.iter().zip(names) {
        let directory = TempDir::new().unwrap();
        let arguments = ["--scene", scene.to_str().unwrap(), "--frames", "6", "--report", "r.json", "--quiet"];
        let output = run(&directory, &arguments);
        succeeds(&output);
        let report: Value = serde_json::from_slice(&fs::read(directory.path().join("r.json")).unwrap()).unwrap();
        let rows = report["frames"].as_array().unwrap();
        let most = |key: &str| rows.iter().map(|row| row[key].as_f64().unwrap()).fold(0.0, f64::max);
        println!("{name}: strain {}, penetration {}", most("mean_strain"), most("penetration"));
        assert!(most("mean_strain") < 0.02 && most("penetration") < 1e-3, "{name}: {report}");
        assert_ne!(frame(&directory, 1), frame(&directory, 6), "{name} moves");
    }
}

/// The collar of the cape is gathered to .4 of its width, and its pins close in on the cloth beside them. At a film's rate they left it
/// behind, drawn out to almost three times its length.
#[test]
fn a_gathered_collar_takes_its_cloth_along() {
    let (directory, cape) = (TempDir::new().unwrap(), examples().join("cape.toml"));
    succeeds(&run(&directory, &["--scene", cape.to_str().unwrap(), "--quiet", "--fps", "25", "--frames", "22"]));
    let (columns, cell) = (45, 0.025);
    for number in 18..=22 {
        let x = frame(&directory, number);
        let lengths = (0..columns).map(|pin| x[pin].distance(x[pin + columns]));
        let stretch = lengths.fold(0.0, f32::max) / cell - 1.0;
        assert!(stretch < 0.15, "in frame {number} an edge beside the pins is stretched by {stretch}");
    }
}

#[test]
fn the_towel_is_what_is_played_without_a_scene() {
    let directory = TempDir::new().unwrap();
    succeeds(&run(&directory, &["--frames", "40", "--out", "plain", "--quiet"]));
    let towel = examples().join("towel.toml");
    succeeds(&run(&directory, &["--scene", towel.to_str().unwrap(), "--frames", "40", "--out", "scene", "--quiet"]));
    for number in 1..=40 {
        let read = |folder: &str| fs::read(directory.path().join(folder).join(format!("frame_{number:04}.obj"))).unwrap();
        assert!(read("plain") == read("scene"), "frame {number}");
    }
}

/// A cloth of 3 x 3 vertices without forces, to which a test adds what it checks.
const SHEET: &str = "
frames = 31
gravity = [0, 0, 0]
[[cloth]]
grid = { columns = 3, rows = 3, width = 2, height = 2 }
";

/// Rotation comes before motion, and scale before both. Values are linear between keys, and repeat in a loop.
#[test]
fn pins_go_where_their_keys_say() {
    let text = "
[[cloth.pin]]
box = { low = [-1.1, -1, -1.1], high = [-0.9, 1, 1.1] }
about = [-1, 0, 0]
move = { loop = true, keys = [{ time = 0, value = [0, 0, 0] }, { time = 0.2, value = [0, 0.2, 0] }, { time = 0.4, value = [0, 0, 0] }] }
rotate = [{ time = 0, value = [0, 0, 0] }, { time = 0.5, value = [30, 0, 0] }]
scale = [{ time = 0, value = [1, 1, 1] }, { time = 0.5, value = [1, 1, 0.5] }]
";
    let (directory, output) = scene(&(SHEET.to_owned() + text), &[]);
    succeeds(&output);
    for number in [1, 7, 13, 19, 31] {
        let time = (number - 1) as f32 / 60.0;
        let up = 0.2 - (time.rem_euclid(0.4) - 0.2).abs();
        let turn = Quat::from_rotation_x((60.0 * time).to_radians());
        let x = frame(&directory, number);
        for (vertex, z) in [(0, -1.0), (3, 0.0), (6, 1.0)] {
            let goal = Vec3::new(-1.0, up, 0.0) + turn * Vec3::new(0.0, 0.0, z * (1.0 - time));
            assert!(x[vertex].distance(goal) < 1e-5, "frame {number}, vertex {vertex}: {} and not {goal}", x[vertex]);
        }
    }
}

/// A loop that does not close is at its beginning in each frame that is at a multiple of its period, however the times are rounded.
#[test]
fn a_loop_begins_anew_in_its_frame() {
    let text = "[[cloth.pin]]\nrule = \"top\"\nmove = { loop = true, keys = [{ time = 0, value = [0, 0, 0] }, { time = 0.1, value = [0, 0.05, 0] }] }\n";
    let (directory, output) = scene(&(SHEET.to_owned() + text), &["--frames", "61"]);
    succeeds(&output);
    for number in 1..=61 {
        let (x, goal) = (frame(&directory, number)[0].y, 0.05 / 6.0 * ((number - 1) % 6) as f32);
        assert!((x - goal).abs() < 1e-6, "frame {number}: {x} m and not {goal}");
    }
}

/// Smooth keys are passed through, between two of them values stay, and the velocity does not jump, also where a loop goes on. With
/// linear keys it does.
#[test]
fn smooth_keys_do_not_jerk() {
    let track = |smooth: bool| {
        let keys = "{ time = 0, value = [0, 0, 0] }, { time = 0.3, value = [0, 0.5, 0] }, { time = 0.5, value = [0, 0.5, 0] }, { time = 0.8, value = [0, 0.9, 0] }, { time = 1, value = [0, 0, 0] }";
        format!("[[cloth.pin]]\nrule = \"top\"\nmove = {{ smooth = {smooth}, loop = true, keys = [{keys}] }}\n")
    };
    let heights = |smooth: bool| -> Vec<f32> {
        let sheet = SHEET.replace("frames = 31", "fps = 240\nframes = 481");
        let (directory, output) = scene(&(sheet + &track(smooth)), &[]);
        succeeds(&output);
        (1..=481).map(|number| frame(&directory, number)[0].y).collect()
    };
    let smooth = heights(true);
    for (time, height) in [(0.0, 0.0), (0.3, 0.5), (0.4, 0.5), (0.5, 0.5), (0.8, 0.9), (1.3, 0.5), (1.8, 0.9), (2.0, 0.0)] {
        let there = smooth[(time * 240.0_f32).round() as usize];
        assert!((there - height).abs() < 1e-4, "{there} m at {time} s");
    }
    assert!(smooth.iter().all(|height| (0.0..=0.9).contains(height)), "{smooth:?}");
    let jerk = |heights: &[f32]| heights.windows(3).map(|x| 240.0 * (x[2] - 2.0 * x[1] + x[0]).abs()).fold(0.0, f32::max);
    let jerks = [jerk(&smooth), jerk(&heights(false))];
    println!("velocities change by {} and {} m/s from frame to frame", jerks[0], jerks[1]);
    assert!(jerks[0] < 0.1 * jerks[1], "{jerks:?}");
}

/// Smooth keys may be so close to each other that single precision does not tell them apart.
#[test]
fn smooth_keys_may_be_close() {
    for next in ["0.1000000000000001", "0.2"] {
        let first = if next == "0.2" { "1e-300" } else { "0.1" };
        let keys = format!(
            "{{ time = {first}, value = [0, 0, 0] }}, {{ time = {next}, value = [0, 0.5, 0] }}, {{ time = 0.3, value = [0, 0.6, 0] }}"
        );
        let keys = if next == "0.2" { format!("{{ time = 0, value = [0, 0, 0] }}, {keys}") } else { keys };
        let pin = format!("[[cloth.pin]]\nrule = \"top\"\nmove = {{ smooth = true, keys = [{keys}] }}\n");
        let (directory, output) = scene(&(SHEET.to_owned() + &pin), &[]);
        succeeds(&output);
        let heights: Vec<f32> = (1..31).map(|number| frame(&directory, number)[0].y).collect();
        assert!(heights.iter().all(|height| (0.0..=0.6).contains(height)) && heights[20] > 0.59, "{heights:?}");
    }
}

/// A table lifts what lies on it from frame to frame.
#[test]
fn colliders_go_where_their_keys_say() {
    let table = "
[[collider]]
shape = \"box\"
center = [{ time = 0, value = [0, -0.5, 0] }, { time = 0.25, value = [0, -0.4, 0] }, { time = 0.5, value = [0, -0.4, 0] }]
half = [1.5, 0.5, 1.5]
";
    let (directory, output) = scene(&(SHEET.replace("gravity = [0, 0, 0]", "") + table), &[]);
    succeeds(&output);
    let height = |number: u32| frame(&directory, number).iter().map(|x| x.y).fold(f32::MAX, f32::min);
    assert!((height(15) - 0.1 * 14.0 / 15.0).abs() < 1e-4, "lifted to {}", height(15));
}

/// What moves from frame 1 on has its velocity in the first step: a table that rises for one frame throws the cloth up.
#[test]
fn colliders_are_in_motion_from_the_first_frame_on() {
    let table = "
[[collider]]
shape = \"box\"
center = [{ time = 0, value = [0, -0.5, 0] }, { time = 0.016666667, value = [0, -0.49, 0] }]
half = [1.5, 0.5, 1.5]
";
    let (directory, output) = scene(&(SHEET.to_owned() + table), &[]);
    succeeds(&output);
    let lowest = frame(&directory, 31).iter().map(|x| x.y).fold(f32::MAX, f32::min);
    assert!((lowest - 0.3).abs() < 1e-3, "0.6 m/s for half a second without gravity: {lowest} m");
}

/// A loop whose ends differ restarts without a velocity: a table that sinks and jumps back up throws nothing.
#[test]
fn a_loop_that_does_not_close_throws_nothing() {
    // Divided by such periods and rates, the times of frames are rounded down and up.
    for (fps, period) in [(60, 0.25), (25, 0.2), (50, 0.4), (24, 0.125)] {
        let table = format!(
            "
[[collider]]
shape = \"box\"
center = {{ loop = true, keys = [{{ time = 0, value = [0, -0.5, 0] }}, {{ time = {period}, value = [0, -0.6, 0] }}] }}
half = [1.5, 0.5, 1.5]
"
        );
        let (directory, output) =
            scene(&(SHEET.replace("gravity = [0, 0, 0]", &format!("fps = {fps}")) + &table), &["--frames", "61"]);
        succeeds(&output);
        let highest = |number: u32| frame(&directory, number).iter().map(|x| x.y).fold(f32::MIN, f32::max);
        let restart = (period * f64::from(fps)).round() as u32;
        // Or as far as it falls in that time, if the table is faster.
        let time = f64::from(restart - 1) / f64::from(fps);
        let sunk = (0.1 * time / period).min(0.5 * 9.81 * time * time) as f32;
        assert!(highest(restart) < -0.965 * sunk, "it sank with the table, to {} m of -{sunk}", highest(restart));
        // From -0.1 m to 0 m within a frame would be 2.5 to 6 m/s.
        assert!((restart + 1..=61).all(|number| highest(number) < 0.05), "{fps} a second, {period} s: thrown");
    }
}

/// A box that loops from 0 to 360 degrees turns on as one that goes further does: both are the same pose.
#[test]
fn a_loop_of_whole_turns_turns_on() {
    let turned = |rotate: &str| {
        let table = format!(
            "[[collider]]\nshape = \"box\"\ncenter = [0, -0.501, 0]\nhalf = [1.5, 0.5, 1.5]\nfriction = 2\nrotate = {rotate}\n"
        );
        let (directory, output) = scene(&(SHEET.replace("gravity = [0, 0, 0]", "") + &table), &["--frames", "41"]);
        succeeds(&output);
        frame(&directory, 41)
    };
    let ramp = |angles: [i32; 3]| {
        let [x, y, z] = angles;
        turned(&format!("[{{ time = 0, value = [0, 0, 0] }}, {{ time = 5, value = [{x}, {y}, {z}] }}]"))
    };
    let repeated = |angles: [i32; 3]| {
        let [x, y, z] = angles;
        turned(&format!(
            "{{ loop = true, keys = [{{ time = 0, value = [0, 0, 0] }}, {{ time = 0.5, value = [{x}, {y}, {z}] }}] }}"
        ))
    };
    // A jump would stop the cloth for a frame, in which the box turns by 12 degrees.
    for sign in [1, -1] {
        let apart =
            iter::zip(ramp([0, sign * 3600, 0]), repeated([0, sign * 360, 0])).map(|(x, y)| x.distance(y)).fold(0.0, f32::max);
        assert!(apart < 1e-4, "{apart} m apart after a repetition of {sign} turn");
    }
}

/// A box that turns back at each repetition jumps there: it throws nothing.
#[test]
fn a_loop_of_less_than_a_turn_throws_nothing() {
    let table = "
[[collider]]
shape = \"box\"
center = [0, -0.5, 0]
half = [1.5, 0.5, 1.5]
rotate = { loop = true, keys = [{ time = 0, value = [0, 0, 0] }, { time = 0.25, value = [0, 0, 10] }] }
";
    let (directory, output) = scene(&(SHEET.replace("gravity = [0, 0, 0]", "") + table), &["--frames", "31"]);
    succeeds(&output);
    let highest = (16..=31).flat_map(|number| frame(&directory, number)).map(|x| x.y).fold(f32::MIN, f32::max);
    assert!(highest < 0.3, "thrown to {highest} m");
}

/// The length of a normal has no meaning, so a loop that changes nothing else does not stop a plane that rises.
#[test]
fn a_loop_of_a_normal_s_length_stops_nothing() {
    let lifted = |normal: &str| {
        let floor =
            "[[collider]]\nshape = \"plane\"\npoint = [{ time = 0, value = [0, 0, 0] }, { time = 1, value = [0, 1, 0] }]\n";
        let (directory, output) = scene(&format!("{SHEET}{floor}normal = {normal}\n"), &["--frames", "14"]);
        succeeds(&output);
        frame(&directory, 14)
    };
    let longer = "{ loop = true, keys = [{ time = 0, value = [0, 1, 0] }, { time = 0.2, value = [0, 3, 0] }] }";
    assert_eq!(lifted("[0, 1, 0]"), lifted(longer));
}

#[test]
fn the_wind_and_gravity_go_as_their_keys_say() {
    // In dense air, without gravity, cloth soon moves with the wind; damping is the same for every vertex.
    let wind = "
[wind]
velocity = [{ time = 0, value = [0, 0, 0] }, { time = 0.25, value = [1, 0, 0] }]
density = 0
damping = 1000
";
    let (directory, output) = scene(&(SHEET.to_owned() + wind), &[]);
    succeeds(&output);
    let speed = |number: u32| 60.0 * (frame(&directory, number + 1)[4].x - frame(&directory, number)[4].x);
    // A step uses the wind halfway between its frames.
    assert!((speed(9) - 8.5 / 15.0).abs() < 0.01 && (speed(25) - 1.0).abs() < 1e-3, "{} and {} m/s", speed(9), speed(25));

    let text = SHEET
        .replace("gravity = [0, 0, 0]", "gravity = [{ time = 0.2, value = [0, 0, 0] }, { time = 0.201, value = [0, -6, 0] }]");
    let (directory, output) = scene(&text, &[]);
    succeeds(&output);
    assert!(frame(&directory, 13)[4].y.abs() < 1e-6);
    let (fallen, time) = (-frame(&directory, 31)[4].y, 18.0 / 60.0);
    assert!((fallen - 3.0 * time * time).abs() < 0.02 * fallen, "fallen by {fallen} m");
}

/// The same scene with z up gives the same frames, turned: the grid, its far side, the floor and the default normal of a plane.
#[test]
fn z_is_up_where_gravity_acts_along_it() {
    let text = |gravity: &str, at: &str, ball: &str| {
        format!(
            "frames = 6\ngravity = {gravity}\n[[cloth]]\ngrid = {{ columns = 9, rows = 7, width = 0.8, height = 0.6 }}\nat = {at}\n\
             [[cloth.pin]]\nrule = \"top\"\n[[collider]]\nshape = \"plane\"\npoint = [0, 0, 0]\n\
             [[collider]]\nshape = \"sphere\"\ncenter = {ball}\nradius = 0.1\n"
        )
    };
    let ways = ["--format", "obj,usda", "--preview", "p.png"];
    let (y_up, output) = scene(&text("[0, -9.81, 0]", "[0, 0.02, 0]", "[0.1, -0.08, 0.2]"), &ways);
    succeeds(&output);
    let (z_up, output) = scene(&text("[0, 0, -9.81]", "[0, 0, 0.02]", "[0.1, -0.2, -0.08]"), &ways);
    succeeds(&output);
    for number in [1, 6] {
        let apart = frame(&y_up, number).into_iter().zip(frame(&z_up, number)).map(|(y, z)| UpAxis::Z.turn(y).distance(z));
        let most = apart.fold(0.0, f32::max);
        // The order of the edges, and so the error, depends on the axes.
        assert!(most < 5e-4, "frame {number} is {most} m off");
    }
    let moved = frame(&z_up, 1).iter().zip(frame(&z_up, 6)).map(|(a, b)| a.distance(b)).fold(0.0, f32::max);
    assert!(moved > 0.01, "the cloth falls onto the ball and the floor by {moved} m");
    for (directory, axis) in [(&y_up, "upAxis = \"Y\""), (&z_up, "upAxis = \"Z\"")] {
        assert!(fs::read_to_string(directory.path().join("frames/cloth.usda")).unwrap().contains(axis));
    }
    let [(_, _, one), (_, _, other)] = [&y_up, &z_up].map(|directory| read_png(&directory.path().join("p.png")));
    let differing = one.iter().zip(&other).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    assert!(differing < one.len() / 200, "{differing} of {} numbers of the pictures differ", one.len());
}

/// Gusts are the same in every run with one seed, differ for another, and stay within their strength.
#[test]
fn gusts_have_a_seed() {
    let text = |seed: u32| {
        format!(
            "{SHEET}\n[wind]\nvelocity = [1, 0, 0]\ndensity = 0\ndamping = 1000\ngusts = {{ strength = 0.5, period = 0.1, seed = {seed} }}"
        )
    };
    let [(one, _), (again, _), (other, _)] = [1, 1, 2].map(|seed| scene(&text(seed), &[]));
    assert_eq!(frame(&one, 31), frame(&again, 31));
    assert_ne!(frame(&one, 31), frame(&other, 31));
    let speeds: Vec<f32> = (5..30).map(|number| 60.0 * (frame(&one, number + 1)[4].x - frame(&one, number)[4].x)).collect();
    let [low, high] = [speeds.iter().copied().fold(f32::MAX, f32::min), speeds.iter().copied().fold(f32::MIN, f32::max)];
    assert!(low > 0.49 && high < 1.51 && high - low > 0.2, "from {low} to {high} m/s");
}

/// Gusts turn about the vertical, also where that is z: a wind along it stays as it is.
#[test]
fn gusts_turn_about_the_vertical() {
    for (gravity, velocity) in [("[0, -1, 0]", "[0, 3, 0]"), ("[0, 0, -1]", "[0, 0, 3]")] {
        let blown = |gusts: &str| {
            let text = format!("{SHEET}\n[wind]\nvelocity = {velocity}\ngusts = {{ strength = 0{gusts}, period = 0.1 }}");
            let (directory, output) =
                scene(&text, &["--frames", "11", "--gravity", &gravity[1..gravity.len() - 1].replace(' ', "")]);
            succeeds(&output);
            frame(&directory, 11)
        };
        let (steady, gusty) = (blown(""), blown(", turn = 90"));
        let apart = steady.iter().zip(&gusty).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        assert!(apart < 1e-5, "{apart} m with gravity {gravity}");
    }
}

/// Several cloths are parts of one mesh, each from its own file or grid and in its own place; pins select vertices of
/// one cloth.
#[test]
fn cloths_are_pieces_of_one_mesh() {
    let directory = TempDir::new().unwrap();
    let obj = "v 0 0 0 1 0 0\nv 100 0 0 1 1 1\nv 0 0 100 1.0 0.0 0.0 # red\nf 1 3 2\n";
    fs::write(directory.path().join("t.obj"), obj).unwrap();
    fs::create_dir(directory.path().join("scenes")).unwrap();
    let text = "
[[cloth]]
grid = { columns = 2, rows = 2, width = 1, height = 1 }
pin = [{ vertices = [3] }]
[[cloth]]
mesh = \"../t.obj\"
scale = 0.01
rotate = [0, 0, 90]
at = [0, 5, 0]
pin = [{ color = [1, 0, 0] }]
";
    fs::write(directory.path().join("scenes/s.toml"), text).unwrap();
    succeeds(&run(&directory, &["--scene", "scenes/s.toml", "--frames", "4", "--quiet"]));
    let (first, last) = (frame(&directory, 1), frame(&directory, 4));
    let expected = [Vec3::new(0.0, 5.0, 0.0), Vec3::new(0.0, 6.0, 0.0), Vec3::new(0.0, 5.0, 1.0)];
    assert!(first.len() == 7 && first[4..].iter().zip(expected).all(|(x, goal)| x.distance(goal) < 1e-6), "{first:?}");
    let held: Vec<usize> = (0..7).filter(|&vertex| first[vertex] == last[vertex]).collect();
    assert_eq!(held, [3, 4, 6]);
    let faces = Mesh::load_obj(directory.path().join("frames/frame_0004.obj")).unwrap().triangles;
    assert_eq!(faces.last(), Some(&[4, 6, 5]));
}

/// A byte order mark, tabs, continued lines, and comments and paths that end like these, are no reason to pin another vertex.
#[test]
fn colors_are_those_of_their_vertices() {
    let directory = TempDir::new().unwrap();
    let obj = "\u{feff}v 0 0 0 1 0 0\n# C:\\work\\\nmtllib C:\\work\\\nv\t1 0 0 0 0 1\n  v 1 \\\n 0 1 1 0 0 # red\nv 0 0 1 0 0 1\nf 1 2 3 4\n";
    fs::write(directory.path().join("m.obj"), obj).unwrap();
    fs::write(directory.path().join("s.toml"), "[[cloth]]\nmesh = \"m.obj\"\npin = [{ color = [1, 0, 0] }]\n").unwrap();
    succeeds(&run(&directory, &["--scene", "s.toml", "--frames", "4", "--quiet"]));
    let (first, last) = (frame(&directory, 1), frame(&directory, 4));
    assert_eq!((0..4).filter(|&vertex| first[vertex] == last[vertex]).collect::<Vec<_>>(), [0, 2]);
}

/// A mesh may come through a pipe, from which it can be read only once, also if its pins have colors. A sweep reads it again.
#[cfg(unix)]
#[test]
fn a_mesh_may_be_a_pipe() {
    let directory = TempDir::new().unwrap();
    let pipe = directory.path().join("pipe.obj");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let text = "[[cloth]]\nmesh = \"pipe.obj\"\npin = [{ color = [1, 0, 0] }]\n";
    fs::write(directory.path().join("s.toml"), text).unwrap();
    std::thread::spawn(move || {
        // A second reader gets nothing; without one, the thread waits here until the tests are over.
        for obj in ["v 0 0 0 1 0 0\nv 1 0 0 0 0 1\nv 1 0 1 1 0 0 # red\nf 1 2 3\n", ""] {
            fs::write(&pipe, obj).unwrap();
        }
    });
    succeeds(&run(&directory, &["--scene", "s.toml", "--frames", "4", "--quiet"]));
    let (first, last) = (frame(&directory, 1), frame(&directory, 4));
    assert_eq!((0..3).filter(|&vertex| first[vertex] == last[vertex]).collect::<Vec<_>>(), [0, 2]);

    fs::write(directory.path().join("s.toml"), format!("{text}[[vary]]\nkey = \"cloth.1.fabric\"\nvalues = [\"silk\"]\n"))
        .unwrap();
    fails(
        &run(&directory, &["--scene", "s.toml", "--frames", "4", "--variant", "1", "--quiet"]),
        2,
        &["pipe.obj", "is a pipe", "give a file"],
    );
}

/// Two cloths of one scene, of silk and of denim, move as each does in a scene of its own.
#[test]
fn cloths_have_fabrics_of_their_own() {
    let cloth = |fabric: &str, x: f32| {
        format!(
            "[[cloth]]\nfabric = \"{fabric}\"\nat = [{x}, 0, 0]\ngrid = {{ columns = 9, rows = 9, width = 0.4, height = 0.4 }}\n\
             [[cloth.pin]]\nvertices = [0, 8]\n"
        )
    };
    let rest = "[quality]\nsubsteps = 40\nlevels = \"off\"\n[wind]\nvelocity = [0, 0, 3]\n";
    let played = |cloths: &[String]| {
        let (directory, output) = scene(&(cloths.concat() + rest), &["--no-floor", "--frames", "25"]);
        succeeds(&output);
        frame(&directory, 25)
    };
    let (silk, denim) = (cloth("silk", 0.0), cloth("denim", 1.0));
    let [alone_silk, alone_denim] = [&silk, &denim].map(|cloth| played(std::slice::from_ref(cloth)));
    let apart = |x: &[Vec3], alone: &[Vec3]| x.iter().zip(alone).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    let moved: Vec<Vec3> = alone_silk.iter().map(|x| x + Vec3::X).collect();
    assert!(apart(&moved, &alone_denim) > 0.05, "the fabrics differ");
    let both = played(&[silk, denim]);
    for (name, x, alone) in [("silk", &both[..81], &alone_silk), ("denim", &both[81..], &alone_denim)] {
        assert!(apart(x, alone) < 2e-3, "{name} is {} m from where it is alone", apart(x, alone));
    }
}

/// Sheared by an angle, a sheet has the energy `G angle² area / 2`, whatever the shape of its cells.
#[test]
fn shear_is_as_stiff_as_it_says() {
    let grid = Mesh::grid(5, 9, 0.8, 0.6);
    let quads = (0..4).flat_map(|column| (0..8).map(move |row| 5 * row + column + 1)).map(|a| [a, a + 5, a + 6, a + 1]);
    let vertices = grid.positions.iter().map(|x| format!("v {} {} {}", x.x, x.y, x.z));
    let faces = quads.map(|[a, b, c, d]| format!("f {a} {b} {c} {d}"));
    let obj = vertices.chain(faces).collect::<Vec<_>>().join("\n");
    let energy = |mesh: &str, shear: &str| {
        let text = format!(
            "frames = 11\nfps = 10\ngravity = [0, 0, 0]\n[[cloth]]\nfabric = {{ stretch = 5000, bending = 0 }}\n\
             rotate = [0, 45, 0]\n{mesh}\n{shear}\n[[cloth.pin]]\nbox = {{ low = [-1, -1, -1], high = [1, 1, 1] }}\n\
             scale = [{{ time = 0, value = [1, 1, 1] }}, {{ time = 1, value = [1.01, 1, 0.99] }}]\n"
        );
        let directory = TempDir::new().unwrap();
        fs::write(directory.path().join("s.toml"), text).unwrap();
        fs::write(directory.path().join("quads.obj"), &obj).unwrap();
        succeeds(&run(&directory, &["--scene", "s.toml", "--quiet", "--no-floor", "--report", "r.json"]));
        let report: Value = serde_json::from_slice(&fs::read(directory.path().join("r.json")).unwrap()).unwrap();
        report["frames"].as_array().unwrap().last().unwrap()["energy"].as_f64().unwrap()
    };
    let expected = |shear: f64| shear * 0.02_f64.powi(2) * 0.48 / 2.0;
    for mesh in ["grid = { columns = 5, rows = 9, width = 0.8, height = 0.6 }", "mesh = \"quads.obj\""] {
        let soft = energy(mesh, "shear = 50");
        assert!((soft / expected(50.0) - 1.0).abs() < 0.02, "{mesh}: {soft} J, {} expected", expected(50.0));
        // The diagonal of cells of 0.2 m x 0.075 m stretches by 0.329 times the angle.
        let stiff = energy(mesh, "");
        assert!((stiff / expected(5000.0 * 0.329_f64.powi(2)) - 1.0).abs() < 0.02, "{mesh}: {stiff} J without");
    }
}

/// A mesh collider in centimeters holds the cloth where it is in meters; `--scale` scales all meshes.
#[test]
fn mesh_colliders_have_a_scale() {
    let directory = TempDir::new().unwrap();
    let obj = "v -100 -20 -100\nv -100 -20 100\nv 100 -20 100\nv 100 -20 -100\nf 1 2 3 4\n";
    fs::write(directory.path().join("table.obj"), obj).unwrap();
    for (scale, size, argument) in [("scale = 0.01", 0.5, &[][..]), ("", 50.0, &["--scale", "0.01"])] {
        let cloth = format!("[contact]\n[[cloth]]\ngrid = {{ columns = 5, rows = 5, width = {size}, height = {size} }}\n");
        let text = format!("{cloth}[[collider]]\nshape = \"mesh\"\nmesh = \"table.obj\"\n{scale}\n");
        fs::write(directory.path().join("s.toml"), text).unwrap();
        let arguments = [&["--scene", "s.toml", "--frames", "40", "--no-floor", "--quiet"], argument].concat();
        succeeds(&run(&directory, &arguments));
        let height = frame(&directory, 40)[12].y;
        assert!((height + 0.195).abs() < 2e-3, "{scale} {argument:?}: {height} m");
    }
}

/// Gravity that grows linearly from 0 to 6 m/s² in one second moves a free sheet by 1 m, at few frames per second, too. Its mean in each
/// frame adds `6 dt²/12`. Its value at the end of each frame would add `6/2 dt/2`, and from half a substep before each frame on `6/2 h/2`.
#[test]
fn forces_between_keys_act_as_their_mean_in_each_frame() {
    let text = "gravity = [{ time = 0, value = [0, 0, 0] }, { time = 1, value = [6, 0, 0] }]\n\
                [[cloth]]\ngrid = { columns = 3, rows = 3, width = 1, height = 1 }\n";
    for fps in [10, 60] {
        let frames = (fps + 1).to_string();
        let arguments = ["--no-floor", "--substeps", "5", "--frames", &frames, "--fps", &fps.to_string(), "--out", "frames"];
        let (directory, output) = scene(text, &arguments);
        succeeds(&output);
        let by = frame(&directory, fps + 1)[4].x - frame(&directory, 1)[4].x;
        let expected = 1.0 + 0.5 / (fps * fps) as f32;
        assert!((by - expected).abs() < 1e-4, "{fps} frames per second: {by} m instead of {expected}");
    }
}

/// A quad without an area has no shear stiffness; the others have theirs.
#[test]
fn shear_leaves_out_quads_without_an_area() {
    let directory = TempDir::new().unwrap();
    let obj = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 0 1\nv 1 0 1\nv 2 0 1\nv 3 0 0\nf 1 4 5 2\nf 2 5 6 3\nf 1 2 3 7\n";
    fs::write(directory.path().join("quads.obj"), obj).unwrap();
    let most = |shear: &str| {
        let text =
            format!("frames = 2\n[[cloth]]\nmesh = \"quads.obj\"\nfabric = {{ stretch = 5000, bending = 0 }}\nshear = {shear}\n");
        fs::write(directory.path().join("s.toml"), text).unwrap();
        run(&directory, &["--scene", "s.toml", "--quiet", "--no-floor"])
    };
    succeeds(&most("50"));
    fails(&most("1251"), 2, &["shear = 1251 N/m", "1250 N/m at most"]);
}

#[test]
fn the_command_line_overrides_the_file() {
    let text = SHEET.to_owned()
        + "fabric = \"silk\"\n[[collider]]\nshape = \"plane\"\npoint = [0, 0, 0]\n[output]\nfolder = \"of the file\"\n";
    let (directory, output) =
        scene(&text, &["--gravity", "0,-6,0", "--frames", "3", "--fps", "30", "--no-floor", "--out", "frames"]);
    succeeds(&output);
    let fallen = -frame(&directory, 3)[4].y;
    assert!((fallen - 3.0 / 225.0).abs() < 1e-4, "{fallen} m");
    assert!(!directory.path().join("of the file").exists());
    // Without `--no-floor` the floor of the file holds the cloth; `--floor` replaces it.
    for (floor, height) in [(&[][..], 0.0), (&["--floor", "-0.005"][..], -0.005)] {
        let (directory, output) = scene(&text, &[&["--gravity", "0,-6,0", "--out", "frames"], floor].concat());
        succeeds(&output);
        assert!((frame(&directory, 31)[4].y - height).abs() < 1e-5);
    }
}

/// Options of the command line may be repeated.
#[test]
fn colliders_of_the_command_line_repeat() {
    let directory = TempDir::new().unwrap();
    Mesh::grid(9, 9, 2.0, 2.0).save_obj(directory.path().join("m.obj")).unwrap();
    let arguments = "m.obj --frames 40 --quiet --substeps 20 --sphere -0.5,-0.3,-0.5,0.2 --sphere 0.5,-0.3,-0.5,0.2 \
        --capsule -0.5,-0.25,0.5,0.5,-0.25,0.5,0.1 --capsule 0,-0.3,-1,0,-0.3,1,0.05,0.1 \
        --box 0,-0.5,0,0.2,0.2,0.2,0.05 --plane 0,-0.5,0,0,1,0 --plane 0.9,0,0,-1,0,0";
    succeeds(&run(&directory, &arguments.split_whitespace().collect::<Vec<_>>()));
    let x = frame(&directory, 40);
    assert!(x.iter().all(|x| x.y > -0.51 && x.x < 0.901), "on the floor and before the wall");
    assert!(x.iter().all(|x| x.distance(Vec3::new(-0.5, -0.3, -0.5)) > 0.199));
    let mean = x.iter().map(|x| x.y).sum::<f32>() / 81.0;
    assert!(mean > -0.4, "held up by what there is: {mean} m on average");
    for (arguments, words) in [
        (["--capsule", "0,0,0,1,0,0"], ["--capsule", "7"]),
        (["--capsule", "0,0,0,1,0,0,0.1,-1"], ["--capsule", "radius"]),
        (["--box", "0,0,0,1,1"], ["--box", "6"]),
        (["--box", "0,0,0,1,1,0.1,0.2"], ["--box", "0.1"]),
        (["--box", "0,0,0,1,0,1"], ["--box", "above 0"]),
        (["--plane", "0,0,0,0,0,0"], ["--plane", "direction"]),
        (["--scale", "0"], ["--scale", "above 0"]),
    ] {
        fails(&run(&directory, &arguments), 2, &words);
    }
}

/// A scene is tuned for as many steps as it has after its first frame, and nothing is written.
#[test]
fn a_scene_is_tuned() {
    let (directory, output) = scene(SHEET, &["--frames", "21", "--no-floor", "--tune", "10mm"]);
    succeeds(&output);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("| setting |") && text.contains("Options {") && text.contains("method: Method::"), "{text}");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1, "nothing is written");
    let hung = SHEET.replace("gravity = [0, 0, 0]", "") + "pin = [{ vertices = [0, 1] }]\n";
    let (_, output) = scene(&hung, &["--frames", "21", "--no-floor", "--tune", "0.00001%"]);
    succeeds(&output);
    let missed = String::from_utf8(output.stdout).unwrap();
    assert!(missed.contains("No setting kept") && !text.contains("No setting kept"), "{missed}");
    for (arguments, words) in [
        (&["--tune", "10mm", "--fps", "30"][..], &["--tune", "60 frames per second", "leave out --fps"][..]),
        (&["--tune", "10mm", "--frames", "1"], &["frames", "at least 3"]),
        (&["--tune", "10mm", "--frames", "2"], &["frames", "at least 3"]),
        (&["--tune", "10 miles"], &["--tune", "10mm"]),
        (&["--tune", "-1mm"], &["--tune", "-1mm", "above 0", "such as 10mm"]),
        (&["--tune", "3%", "--save", "s"], &["--tune", "--save"]),
        (&["--tune", "3%", "--preview", "p.png"], &["--tune", "--preview"]),
    ] {
        fails(&scene(SHEET, arguments).1, 2, words);
    }
}

/// The mesh of a collider that `--body` replaces need not exist.
#[test]
fn what_is_replaced_is_not_read() {
    let directory = TempDir::new().unwrap();
    Mesh::grid(3, 3, 1.0, 1.0).save_obj(directory.path().join("body.obj")).unwrap();
    let text = format!("{SHEET}\n[[collider]]\nshape = \"mesh\"\nmesh = \"missing.obj\"\n");
    fs::write(directory.path().join("s.toml"), text).unwrap();
    fails(&run(&directory, &["--scene", "s.toml", "--frames", "2"]), 2, &["s.toml:", "missing.obj"]);
    succeeds(&run(&directory, &["--scene", "s.toml", "--frames", "2", "--body", "body.obj"]));
}

/// A body from files lifts the cloth, with the same result from the command line and from a scene; its files are not
/// overwritten.
#[test]
fn a_body_comes_from_numbered_files() {
    let directory = TempDir::new().unwrap();
    let write = |name: &str, height: f32, turn: bool| {
        let mut patch = Mesh::grid(3, 3, 2.0, 2.0);
        patch.positions.iter_mut().for_each(|x| *x += Vec3::new(0.013, height, 0.017));
        if turn {
            patch.triangles.swap(0, 1);
        }
        patch.save_obj(directory.path().join(name)).unwrap();
    };
    (1..=24).for_each(|frame: u32| write(&format!("body_{frame:02}.obj"), -0.06 + 0.01 * frame as f32, false));
    Mesh::grid(7, 7, 0.6, 0.6).save_obj(directory.path().join("sheet.obj")).unwrap();
    let text = "frames = 24\n[[cloth]]\nmesh = \"sheet.obj\"\n[[collider]]\nshape = \"mesh\"\nmesh = \"body_##.obj\"\n";
    fs::write(directory.path().join("s.toml"), text).unwrap();
    succeeds(&run(&directory, &["--scene", "s.toml", "--quiet", "--preview", "p.png"]));
    let lowest = frame(&directory, 24).iter().map(|x| x.y).fold(f32::MAX, f32::min);
    assert!((0.18..0.21).contains(&lowest), "lifted to {lowest} m");
    let told = ["sheet.obj", "--body", "body_##.obj", "--no-floor", "--frames", "24", "--out", "told", "--quiet"];
    succeeds(&run(&directory, &told));
    let written = |folder: &str| fs::read(directory.path().join(folder).join("frame_0024.obj")).unwrap();
    assert!(written("told") == written("frames"));
    fails(&run(&directory, &["sheet.obj", "--body", "body_##.obj", "--frames", "25"]), 2, &["body_25.obj"]);
    // A file may have `#` in its name, even apart.
    fs::copy(directory.path().join("body_01.obj"), directory.path().join("b#1#.obj")).unwrap();
    succeeds(&run(&directory, &["sheet.obj", "--body", "b#1#.obj", "--no-floor", "--frames", "2", "--out", "named", "--quiet"]));
    // The name of a folder has no frame numbers.
    fs::create_dir(directory.path().join("C#")).unwrap();
    ["C#/body.obj", "C#/body_1.obj", "C#/body_2.obj"].iter().for_each(|name| write(name, -0.06, false));
    for body in ["C#/body.obj", "C#/body_#.obj"] {
        let arguments = ["sheet.obj", "--body", body, "--frames", "2", "--out", "sharp", "--quiet"];
        succeeds(&run(&directory, &arguments));
    }
    fails(&run(&directory, &["sheet.obj", "--body", "body_01.obj", "--report", "body_01.obj"]), 2, &["--report"]);
    write("body_07.obj", 0.0, true);
    fails(&run(&directory, &["sheet.obj", "--body", "body_##.obj", "--frames", "9"]), 2, &["body_07.obj", "first frame"]);
}

/// Two cloths have the colors that the scene sets for each of their sides. The animation begins at the time that the scene
/// sets, and has at least one frame.
#[test]
fn a_picture_is_as_the_scene_says() {
    let cloth = |x: i32, color: &str, lining: &str| {
        let place = format!("at = [{x}, 0, 0]\ngrid = {{ columns = 3, rows = 3, width = 0.8, height = 0.8 }}");
        format!("[[cloth]]\n{place}\ncolor = [{color}]\nlining = [{lining}]\n")
    };
    let cloths = cloth(0, "0, 0, 1", "0, 1, 0") + &cloth(1, "1, 0, 0", "1, 1, 0");
    for (from, begin, frames, wanted) in [
        ("[0, 1, 0.2]", 0.0, 5, [[0, 0, 1], [1, 0, 0]]),
        ("[0, -1, 0.2]", 0.1, 2, [[0, 1, 0], [1, 1, 0]]),
        ("[0, 1, 0.2]", 9.0, 1, [[0, 0, 1], [1, 0, 0]]),
    ] {
        let text = format!("frames = 9\ngravity = [0, 0, 0]\n[picture]\nfrom = {from}\nbegin = {begin}\n{cloths}");
        let (directory, output) = scene(&text, &["--animate", "a.png"]);
        succeeds(&output);
        let file = fs::File::open(directory.path().join("a.png")).unwrap();
        let mut decoder = png::Decoder::new(std::io::BufReader::new(file));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, frames, "from {begin} s on");
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        let count = |hue: [u8; 3]| {
            let is = |pixel: &&[u8]| (0..3).all(|channel| (pixel[channel] > 90) == (hue[channel] == 1));
            pixels.chunks_exact(4).filter(is).count()
        };
        for hue in [[0, 0, 1], [0, 1, 0], [1, 0, 0], [1, 1, 0]] {
            assert_eq!(count(hue) > 5000, wanted.contains(&hue), "from {from}: {} pixels of {hue:?}", count(hue));
        }
    }
}
