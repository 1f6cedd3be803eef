//! The main binary from outside: exit codes, one-line errors, and the files it writes.

#[allow(dead_code, unreachable_pub, reason = "each program of tests takes its own part")]
#[path = "common/crossings.rs"]
mod crossings;
#[allow(dead_code, unreachable_pub, reason = "each program of tests takes its own part")]
#[path = "common/program.rs"]
mod program;

use std::{collections::BTreeSet, fs, io::BufReader, path::Path, process::Command};

use cloth_deformer::{Mesh, glam::Vec3};
use program::{drape, fails, read_png, run, stderr, succeeds};
use serde_json::Value;
use tempfile::TempDir;

/// Names of all files in a directory, including hidden ones.
fn names(directory: impl AsRef<Path>) -> BTreeSet<String> {
    fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

fn frames(count: u32) -> BTreeSet<String> {
    (1..=count).map(|frame| format!("frame_{frame:04}.obj")).collect()
}

fn set<const N: usize>(names: [&str; N]) -> BTreeSet<String> {
    names.map(str::to_owned).into()
}

fn bits(positions: &[Vec3]) -> Vec<[u32; 3]> {
    positions.iter().map(|position| position.to_array().map(f32::to_bits)).collect()
}

/// Writes a mesh whose coordinates have no short decimal form to a directory.
fn crooked(directory: &TempDir) -> Mesh {
    let mut mesh = Mesh::grid(7, 5, 0.8, 0.6);
    for (vertex, position) in mesh.positions.iter_mut().enumerate() {
        let x = vertex as f32;
        *position = *position * std::f32::consts::FRAC_1_PI + 0.013 * Vec3::new(x.sin(), x.cos(), (2.0 * x).sin());
    }
    // Neither the order of vertices nor that of faces may change.
    mesh.triangles.reverse();
    mesh.save_obj(directory.path().join("crooked.obj")).unwrap();
    mesh
}

#[test]
fn with_no_arguments_the_towel_falls_for_120_frames() {
    let directory = TempDir::new().unwrap();
    let output = drape(&directory, &[]).output().unwrap();
    succeeds(&output);
    assert_eq!(names(&directory), set(["frames"]));
    assert_eq!(names(directory.path().join("frames")), frames(120));

    let frame = |number: u32| Mesh::load_obj(directory.path().join(format!("frames/frame_{number:04}.obj"))).unwrap();
    let (first, last) = (frame(1), frame(120));
    assert_eq!(first.positions.len(), 64 * 64);
    assert_eq!(first.triangles, last.triangles);
    assert!(first.positions.iter().all(|position| position.y.to_bits() == 0.7_f32.to_bits()), "it starts level");
    let sphere = Vec3::new(0.0, 0.3, 0.0);
    for (vertex, position) in last.positions.iter().enumerate() {
        assert!(position.distance(sphere) > 0.3 - 2e-3 && position.y > -2e-3, "vertex {vertex} is inside at {position}");
    }
    let highest = last.positions.iter().map(|position| position.y).fold(f32::MIN, f32::max);
    let lowest = last.positions.iter().map(|position| position.y).fold(f32::MAX, f32::min);
    assert!((0.58..0.65).contains(&highest), "it lies on the sphere, at {highest}");
    assert!(lowest < 0.3, "it hangs down, to {lowest}");

    let stdout = String::from_utf8_lossy(&output.stdout);
    assert_eq!(stdout.lines().count(), 1, "{stdout}");
    for word in ["cpu", "4096 vertices", "120 frames", "ms", "strain", "penetration"] {
        assert!(stdout.contains(word), "no `{word}` in: {stdout}");
    }
    assert!(!stderr(&output).contains('\r'), "no progress bar in a pipe");
}

#[test]
fn frame_1_is_the_input_bit_for_bit_and_faces_stay() {
    let directory = TempDir::new().unwrap();
    let mesh = crooked(&directory);
    succeeds(&run(&directory, &["crooked.obj", "--out", "deep/er", "--frames", "3", "--quiet"]));
    assert_eq!(names(directory.path().join("deep/er")), frames(3));
    let frame = |number: u32| Mesh::load_obj(directory.path().join(format!("deep/er/frame_{number:04}.obj"))).unwrap();
    assert_eq!(bits(&frame(1).positions), bits(&mesh.positions));
    assert_ne!(bits(&frame(2).positions), bits(&mesh.positions), "frame 2 is a step on");
    for number in 1..=3 {
        assert_eq!(frame(number).triangles, mesh.triangles, "frame {number}");
    }
}

#[test]
fn quiet_says_nothing() {
    let directory = TempDir::new().unwrap();
    let output = run(&directory, &["--frames", "2", "--quiet"]);
    succeeds(&output);
    assert!(output.stdout.is_empty());
    assert!(output.stderr.is_empty(), "{}", stderr(&output));
}

#[test]
fn help_goes_to_stdout() {
    let directory = TempDir::new().unwrap();
    let output = run(&directory, &["--help"]);
    succeeds(&output);
    let stdout = String::from_utf8_lossy(&output.stdout);
    for option in ["--out", "--strain", "--no-floor", "--report", "numbers from 0", "frames are written in meters", "Exit codes"]
    {
        assert!(stdout.contains(option), "no `{option}` in:\n{stdout}");
    }
}

#[test]
fn the_version_goes_to_stdout() {
    let directory = TempDir::new().unwrap();
    let output = run(&directory, &["--version"]);
    succeeds(&output);
    assert_eq!(String::from_utf8_lossy(&output.stdout), format!("drape {}\n", env!("CARGO_PKG_VERSION")));
}

#[test]
fn self_contact_is_told_in_the_report() {
    let directory = TempDir::new().unwrap();
    let pressed = |more: &[&str]| {
        let mut arguments = vec!["--frames", "40", "--substeps", "20", "--report", "r.json", "--quiet"];
        arguments.extend(more);
        succeeds(&run(&directory, &arguments));
        let report: Value = serde_json::from_str(&fs::read_to_string(directory.path().join("r.json")).unwrap()).unwrap();
        report["frames"].as_array().unwrap().iter().map(|row| row["contacts"].as_u64().unwrap()).sum::<u64>()
    };
    assert_eq!(pressed(&[]), 0);
    assert!(pressed(&["--self-contact"]) > 0);
    assert!(pressed(&["--self-contact", "0.01"]) > 0);
    fails(&run(&directory, &["--self-contact", "0"]), 2, &["--self-contact"]);
}

#[test]
fn untangle_parts_a_start_before_frame_1() {
    let directory = TempDir::new().unwrap();
    // A strip along half of a figure of eight: its end goes through its beginning.
    let mut mesh = Mesh::grid(5, 41, 0.1, 1.0);
    for x in &mut mesh.positions {
        let t = (x.z + 0.5) * (std::f32::consts::PI + 1.0) - 0.5;
        *x = Vec3::new(x.x + 0.005 * t, 0.3 + 0.1 * (2.0 * t).sin(), 0.2 * t.sin());
    }
    mesh.save_obj(directory.path().join("strip.obj")).unwrap();
    let frame_1 = || Mesh::load_obj(directory.path().join("frames/frame_0001.obj")).unwrap();
    let plain = run(&directory, &["strip.obj", "--frames", "2", "--self-contact"]);
    succeeds(&plain);
    assert_eq!(bits(&frame_1().positions), bits(&mesh.positions));
    let before = crossings::crossings(&mesh, &mesh.positions).len();
    assert!(
        before > 0 && stderr(&plain).contains(&format!("frame 2: {before} edges pass through triangles, the first")),
        "{}",
        stderr(&plain)
    );

    let parted = run(&directory, &["strip.obj", "--frames", "2", "--self-contact", "--untangle"]);
    succeeds(&parted);
    assert!(stderr(&parted).contains(&format!("note: untangled: {before} crossings, 0 left")), "{}", stderr(&parted));
    assert!(!stderr(&parted).contains("pass through triangles"), "{}", stderr(&parted));
    let parted = frame_1().positions;
    assert!(crossings::crossings(&mesh, &parted).is_empty());
    let moved = parted.iter().zip(&mesh.positions).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    assert!(moved < 0.1, "moved by {moved} m");

    let scene = "[[cloth]]\nmesh = \"strip.obj\"\n[contact]\nuntangle = true\n";
    fs::write(directory.path().join("strip.toml"), scene).unwrap();
    succeeds(&run(&directory, &["--scene", "strip.toml", "--frames", "2", "--out", "scene"]));
    let of_scene = Mesh::load_obj(directory.path().join("scene/frame_0001.obj")).unwrap();
    assert_eq!(bits(&of_scene.positions), bits(&parted));
}

#[test]
fn the_report_has_its_keys_in_order_and_finite_numbers() {
    let directory = TempDir::new().unwrap();
    let mesh = crooked(&directory);
    let arguments =
        ["crooked.obj", "--frames", "12", "--method", "relaxation", "--iterations", "7", "--substeps", "3", "--report", "r.json"];
    succeeds(&run(&directory, &arguments));
    assert_eq!(names(&directory), set(["crooked.obj", "frames", "r.json"]));
    let text = fs::read_to_string(directory.path().join("r.json")).unwrap();

    // Checked in the text, because a parser may sort.
    let keys = ["adapter", "backend", "method", "vertices", "edges", "colours", "frames"];
    let row_keys = [
        "frame", "ms", "substeps", "mean_strain", "max_strain", "stretch_share", "energy", "penetration", "contacts", "warnings",
    ];
    let places = |keys: &[&str], text: &str| -> Vec<usize> {
        keys.iter().map(|key| text.find(&format!("\"{key}\":")).unwrap_or_else(|| panic!("no {key} in {text}"))).collect()
    };
    assert!(places(&keys, &text).is_sorted(), "{text}");
    let rows = text.find("\"frames\":").unwrap();
    assert!(places(&row_keys, &text[rows..]).is_sorted(), "{text}");

    let report: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report.as_object().unwrap().len(), keys.len());
    assert!(report["adapter"].is_null());
    assert_eq!(report["backend"], "cpu");
    assert_eq!(report["method"], "relaxation");
    assert_eq!(report["vertices"], mesh.positions.len());
    assert_eq!(report["edges"], mesh.edges().len());
    assert!(report["colours"].as_u64().unwrap() >= 1);
    let rows = report["frames"].as_array().unwrap();
    assert_eq!(rows.len(), 12);
    for (index, row) in rows.iter().enumerate() {
        assert_eq!(row.as_object().unwrap().len(), row_keys.len());
        assert_eq!(row["frame"], index + 1);
        assert_eq!(row["substeps"], if index == 0 { 0 } else { 3 });
        // A value that is not finite would have become null.
        for key in &row_keys[..row_keys.len() - 1] {
            assert!(row[key].as_f64().is_some_and(f64::is_finite), "{key} of {row}");
        }
    }
    assert_eq!(rows[0]["ms"], 0.0);
    assert!(rows[1]["ms"].as_f64().unwrap() > 0.0);
}

/// A warning that is printed once is in the report of each frame, and a note tells the worst one.
#[test]
fn every_warning_is_in_the_report() {
    let directory = TempDir::new().unwrap();
    Mesh::grid(9, 9, 1.0, 1.0).save_obj(directory.path().join("m.obj")).unwrap();
    // A sheet that is pulled apart.
    let scene = "[[cloth]]\nmesh = \"m.obj\"\n[[cloth.pin]]\nbox = { low = [-0.51, -1, -1], high = [-0.49, 1, 1] }\n[[cloth.pin]]\n\
                 box = { low = [0.49, -1, -1], high = [0.51, 1, 1] }\n\
                 move = [{ time = 0, value = [0, 0, 0] }, { time = 0.3, value = [0.6, 0, 0] }]\n";
    fs::write(directory.path().join("s.toml"), scene).unwrap();
    let output = run(&directory, &["--scene", "s.toml", "--frames", "20", "--preroll", "0.05", "--report", "r.json"]);
    succeeds(&output);
    let said = stderr(&output);
    let report: Value = serde_json::from_slice(&fs::read(directory.path().join("r.json")).unwrap()).unwrap();
    let stretched = |row: &Value| -> Option<f64> {
        let texts = row["warnings"].as_array().unwrap().iter().map(|text| text.as_str().unwrap());
        let text = texts.into_iter().find_map(|text| text.strip_prefix("the cloth was stretched by "))?;
        Some(text.split(' ').next()?.parse().unwrap())
    };
    let rows: Vec<Option<f64>> = report["frames"].as_array().unwrap().iter().map(stretched).collect();
    assert_eq!(said.matches("the cloth was stretched by ").count(), 1, "{said}");
    let most = rows.iter().flatten().fold(0.0, |most: f64, row| most.max(*row));
    let last = rows.iter().rposition(Option::is_some).unwrap() + 1;
    let count = rows.iter().flatten().count();
    // Which of frames with the same rounded value is the worst cannot be seen in the report.
    let noted = |worst: usize| {
        let note = format!(
            "note: the cloth was stretched beyond the bound in {count} frames, most by {most:.1} % in frame {worst}, the last of them frame {last}"
        );
        rows[worst - 1] == Some(most) && said.lines().any(|line| line == note)
    };
    assert!((1..=rows.len()).any(noted), "most by {most} %, in {count} frames to {last}, but {said}");
}

/// The ground under the cloth reaches behind the camera: all around the cloth the picture shows it, in one color.
#[test]
fn a_body_may_surround_the_camera() {
    let directory = TempDir::new().unwrap();
    let ground = "v -20 -0.02 -20\nv 20 -0.02 -20\nv 20 -0.02 20\nv -20 -0.02 20\nf 1 4 3 2\n";
    fs::write(directory.path().join("ground.obj"), ground).unwrap();
    succeeds(&run(&directory, &["--body", "ground.obj", "--no-floor", "--frames", "2", "--preview", "p.png"]));
    let (_, _, pixels) = read_png(&directory.path().join("p.png"));
    let of_ground = pixels.chunks_exact(3).filter(|pixel| *pixel == &pixels[..3]).count();
    let share = of_ground as f32 / (pixels.len() / 3) as f32;
    assert!((0.5..0.98).contains(&share), "{share} of the picture is ground");
}

#[test]
fn the_preview_is_a_picture_of_twelve_cells() {
    let directory = TempDir::new().unwrap();
    crooked(&directory);
    succeeds(&run(&directory, &["crooked.obj", "--frames", "30", "--preview", "p.png"]));
    assert_eq!(names(&directory), set(["crooked.obj", "frames", "p.png"]));
    let (width, height, pixels) = read_png(&directory.path().join("p.png"));
    // 4 x 3 cells of 320 x 240 pixels with lines of 2 pixels between them.
    assert_eq!((width, height), (4 * 322 - 2, 3 * 242 - 2));
    let colors: BTreeSet<&[u8]> = pixels.chunks_exact(3).collect();
    assert!(colors.len() > 1000, "{} colors", colors.len());
    // The upper side of the cloth is red; it is visible in the first cell and in the last.
    let is_red = |pixel: &&[u8]| i32::from(pixel[0]) > i32::from(pixel[1]) + 60;
    let red = |column: usize, row: usize| {
        let cell = (0..240).flat_map(|y| {
            let start = 3 * ((row * 242 + y) * width as usize + column * 322);
            pixels[start..start + 3 * 320].chunks_exact(3)
        });
        cell.filter(is_red).count()
    };
    assert!(red(0, 0) > 500 && red(3, 2) > 500, "{} and {} red pixels", red(0, 0), red(3, 2));
}

#[test]
fn a_preview_of_few_frames_has_few_cells() {
    for (count, size) in [("1", (320, 240)), ("5", (4 * 322 - 2, 2 * 242 - 2))] {
        let directory = TempDir::new().unwrap();
        crooked(&directory);
        succeeds(&run(&directory, &["crooked.obj", "--frames", count, "--preview", "p.png"]));
        let (width, height, _) = read_png(&directory.path().join("p.png"));
        assert_eq!((width, height), size, "{count} frames");
    }
}

/// An animation plays in real time and repeats forever. At 60 frames per second it shows every other frame, at 24 every
/// frame. Its frames contain only what changes, and together they are complete pictures.
#[test]
fn an_animation_plays_in_the_run_s_own_time() {
    for (fps, frames, delay) in [("60", 4, 33), ("24", 7, 42)] {
        let directory = TempDir::new().unwrap();
        succeeds(&run(&directory, &["--frames", "7", "--fps", fps, "--substeps", "2", "--format", "pc2", "--animate", "a.png"]));
        assert_eq!(names(&directory), set(["a.png", "frames"]));
        let file = BufReader::new(fs::File::open(directory.path().join("a.png")).unwrap());
        let mut decoder = png::Decoder::new(file);
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let animation = *reader.info().animation_control().unwrap();
        assert_eq!((animation.num_frames, animation.num_plays), (frames, 0), "{fps} frames a second");
        let (mut picture, mut heights) = (vec![0; 480 * 360 * 4], Vec::new());
        for _ in 0..frames {
            let mut part = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut part).unwrap();
            let control = reader.info().frame_control().unwrap();
            assert_eq!((control.delay_num, control.delay_den), (delay, 1000));
            for (row, line) in part.chunks_exact(info.line_size).take(info.height as usize).enumerate() {
                for (column, pixel) in
                    line.chunks_exact(4).take(info.width as usize).enumerate().filter(|(_, pixel)| pixel[3] > 0)
                {
                    let at = (control.y_offset as usize + row) * 480 + control.x_offset as usize + column;
                    picture[4 * at..][..4].copy_from_slice(pixel);
                }
            }
            assert!(picture.chunks_exact(4).all(|pixel| pixel[3] == 255), "every pixel was drawn");
            // The middle of the cloth, which is red and falls.
            let red = |at: &usize| i32::from(picture[4 * at]) > i32::from(picture[4 * at + 1]) + 60;
            let rows: Vec<usize> = (0..480 * 360).filter(red).map(|at| at / 480).collect();
            assert!(rows.len() > 5000, "{} red pixels", rows.len());
            heights.push(rows.iter().sum::<usize>() as f32 / rows.len() as f32);
        }
        assert!(heights.is_sorted() && heights[heights.len() - 1] > heights[0] + 1.0, "it falls: {heights:?}");
    }
}

/// The vertices of the towel that are where falling for ten frames leaves them.
fn held(arguments: &[&str]) -> Vec<usize> {
    let directory = TempDir::new().unwrap();
    let mut all = vec!["--frames", "10", "--no-sphere", "--no-floor", "--substeps", "4"];
    all.extend(arguments);
    succeeds(&run(&directory, &all));
    let frame = |number: u32| Mesh::load_obj(directory.path().join(format!("frames/frame_{number:04}.obj"))).unwrap().positions;
    let (first, last) = (bits(&frame(1)), bits(&frame(10)));
    (0..first.len()).filter(|&vertex| first[vertex] == last[vertex]).collect()
}

#[test]
fn pins_hold_what_they_name() {
    assert_eq!(held(&["--pin", "none"]), [0_usize; 0]);
    // The towel is horizontal, with rows from the lowest z on.
    assert_eq!(held(&["--pin", "top"]), (0..64).collect::<Vec<_>>());
    assert_eq!(held(&["--pin", "corners"]), [0, 63, 64 * 63, 64 * 64 - 1]);
    assert_eq!(held(&["--pin", "5,0"]), [0, 5]);
}

/// Frames of an earlier run do not follow on those of one that fails, and its report and pictures do not lie beside them. If that fails before its first frame, they stay.
#[test]
fn a_failed_run_leaves_no_frames_of_an_earlier_one() {
    let directory = TempDir::new().unwrap();
    let frames = || {
        let mut names: Vec<_> =
            fs::read_dir(directory.path().join("frames")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let outputs = ["--format", "obj,pc2", "--report", "r.json", "--preview", "p.png", "--animate", "a.png"];
    let usual = [&["--frames", "9", "--quiet"], &outputs[..]].concat();
    succeeds(&run(&directory, &usual));
    assert_eq!(frames().len(), 10);
    let wild = [&usual[..], &["--method", "springs", "--substeps", "1", "--fabric", "denim"]].concat();
    fails(&run(&directory, &[&wild[..], &["--preroll", "1"]].concat()), 3, &["preroll", "unstable"]);
    assert_eq!(frames().len(), 10);
    assert_eq!(names(&directory), set(["a.png", "frames", "p.png", "r.json"]));
    fails(&run(&directory, &wild), 3, &["unstable"]);
    assert_eq!(names(&directory), set(["frames"]), "neither report nor pictures of the earlier run");
    assert!(
        frames().len() < 9 && frames().iter().all(|name| Path::new(name).extension().is_some_and(|extension| extension == "obj")),
        "{:?}",
        frames()
    );
}

#[test]
fn top_of_an_upright_mesh_is_its_highest_side() {
    let directory = TempDir::new().unwrap();
    let mut mesh = Mesh::grid(4, 3, 1.0, 1.0);
    for position in &mut mesh.positions {
        *position = Vec3::new(position.x, position.z, 0.0);
    }
    mesh.save_obj(directory.path().join("curtain.obj")).unwrap();
    let path = directory.path().join("curtain.obj");
    assert_eq!(held(&[path.to_str().unwrap(), "--pin", "top"]), [8, 9, 10, 11]);
    // A vertex that no face uses is not part of it. It stays where it is, too.
    mesh.positions.push(Vec3::new(5.0, 5.0, 5.0));
    mesh.save_obj(&path).unwrap();
    assert_eq!(held(&[path.to_str().unwrap(), "--pin", "top"]), [8, 9, 10, 11, 12]);
    assert_eq!(held(&[path.to_str().unwrap(), "--pin", "corners"]), [0, 3, 8, 11, 12]);
}

#[test]
fn numbers_may_be_negative() {
    let directory = TempDir::new().unwrap();
    let arguments =
        ["--frames", "2", "--gravity", "-1,-9.81,0", "--floor", "-1", "--sphere", "-1,-0.5,0,0.25", "--wind", "-2,0,0"];
    succeeds(&run(&directory, &arguments));
}

#[test]
fn what_cannot_be_is_refused_in_one_line() {
    const TABLE: &[(&[&str], &[&str])] = &[
        (&["--substeps", "0"], &["--substeps", "0"]),
        (&["--substeps", "-3"], &["--substeps", "-3"]),
        (&["--substeps", "many"], &["--substeps", "many"]),
        (&["--substeps", "4", "--strain", "0.1"], &["--substeps", "--strain"]),
        (&["--substeps", "4294967295"], &["4294967295"]),
        (&["--strain", "nan"], &["--strain", "finite"]),
        (&["--strain", "0"], &["--strain", "above 0"]),
        (&["--strain", "inf"], &["--strain", "finite"]),
        (&["--fps", "0.004"], &["substeps", "--fps", "--strain"]),
        (&["--fps", "1e30"], &["--fps", "at most"]),
        (&["--gravity", "0,1e30,0"], &["gravity", "1e15 m/s2"]),
        (&["--iterations", "4"], &["--iterations", "relaxation"]),
        (&["--method", "relaxation", "--iterations", "0"], &["--iterations"]),
        (&["--method", "magic"], &["--method", "magic", "small-steps"]),
        (&["--backend", "abacus"], &["--backend", "abacus", "hybrid"]),
        (&["--fabric", "steel"], &["--fabric", "steel", "denim"]),
        (&["--self-contact", "-0.1"], &["--self-contact", "-0.1", "above 0"]),
        (&["--self-contact", "mesh.obj"], &["`mesh.obj` is not a number", "--self-contact=0.005", "before"]),
        (&["--self-contact", "--teapot"], &["--teapot"]),
        (&["--frames", "0"], &["--frames"]),
        (&["--frames", "-1"], &["--frames", "-1"]),
        (&["--fps", "0"], &["--fps"]),
        (&["--fps", "-60"], &["--fps"]),
        (&["--fps", "1e-45"], &["--fps", "finite"]),
        (&["--fps", "nan"], &["--fps"]),
        (&["--sphere", "0,0,0,-1"], &["--sphere", "radius"]),
        (&["--sphere", "0,0,0"], &["--sphere", "3 numbers", "give 4"]),
        (&["--sphere", "0,0,0,nan"], &["--sphere", "finite"]),
        (&["--sphere", "0,0,0,1", "--no-sphere"], &["--sphere", "--no-sphere"]),
        (&["--floor", "low"], &["--floor", "`low`"]),
        (&["--floor", "0", "--no-floor"], &["--floor", "--no-floor"]),
        (&["--floor", "--quiet"], &["--floor", "--quiet"]),
        (&["--gravity", "9.81"], &["--gravity", "give 3"]),
        (&["--gravity", "0,-inf,0"], &["--gravity", "finite"]),
        (&["--wind", ""], &["--wind"]),
        (&["--wind", "1,,2"], &["--wind"]),
        (&["--friction", "-0.1"], &["--friction", "0 or above"]),
        (&["--pin", "99999999"], &["--pin", "99999999", "4096 vertices", "from 0 to 4095"]),
        (&["--tune", "0mm"], &["--tune", "0mm", "above 0", "such as 10mm"]),
        (&["--plane", "0,0,0,0,0,0"], &["--plane", "no direction; give"]),
        (&["one.obj", "h/two.obj"], &["`h/two.obj`", "a single MESH.obj"]),
        (&["one.obj", "diff", "a", "b"], &["subcommand 'diff'"]),
        (&["--pin", "3,4,3"], &["--pin", "3"]),
        (&["--pin", "-1"], &["--pin", "-1"]),
        (&["--pin", "left"], &["--pin", "left", "corners"]),
        (&["--pin", ""], &["--pin"]),
        (&["--report", "x", "--preview", "x"], &["--report", "--preview"]),
        (&["--pc2", "x", "--report", "x"], &["--report", "--pc2"]),
        (&["--pc2", "missing/x.pc2"], &["--pc2", "missing"]),
        (&["--report", "missing/x.json"], &["missing"]),
        (&["--preview", "."], &["directory"]),
        (&["--out", ""], &["--out"]),
        (&[""], &["MESH.obj"]),
        (&["missing.obj"], &["missing.obj"]),
        (&["."], &["."]),
        (&["two\nlines.obj"], &["two"]),
        (&["--pc2"], &["--pc2"]),
        (&["--teapot"], &["--teapot"]),
    ];
    for (arguments, words) in TABLE {
        let directory = TempDir::new().unwrap();
        let output = run(&directory, arguments);
        println!("{arguments:?} -> {:?}: {}", output.status.code(), stderr(&output).trim_end());
        fails(&output, 2, words);
        // Nothing is written except the rest state, where only a step can tell how many substeps it needs.
        let left = fs::read_dir(directory.path().join("frames")).map_or(0, Iterator::count);
        assert_eq!(left, usize::from(stderr(&output).contains("frame 2:")), "{arguments:?}");
        assert!(names(&directory).is_subset(&set(["frames"])), "{arguments:?}");
    }
}

#[test]
fn a_bad_mesh_is_refused_by_file_and_place() {
    const TABLE: &[(&str, &[&str])] = &[
        ("", &[]),
        ("v 0 0 zero\n", &["1"]),
        ("v 0 0 0\nv 1 0 0\nv 0 1 nan\nf 1 2 3\n", &[]),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", &[]),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", &["no faces", "f a b c"]),
    ];
    for (text, words) in TABLE {
        let directory = TempDir::new().unwrap();
        fs::write(directory.path().join("bad.obj"), text).unwrap();
        let output = run(&directory, &["bad.obj"]);
        println!("{text:?} -> {}", stderr(&output));
        fails(&output, 2, &[&["bad.obj"], *words].concat());
        assert_eq!(names(&directory), set(["bad.obj"]), "nothing is written");
    }
}

/// A sheet of two panels with vertices of their own along the seam, as a mesh is written whose vertices were split.
#[test]
fn seams_that_do_not_join_are_told_of() {
    let directory = TempDir::new().unwrap();
    let obj = |seam: &str, faces: &str| {
        let corners = "v 0 0 0\nv 0 0 1\nv 1 0 0\nv 1 0 1\nv 2 0 0\nv 2 0 1\n";
        fs::write(directory.path().join("panels.obj"), format!("{corners}{seam}f 1 2 4 3\n{faces}")).unwrap();
        let output = drape(&directory, &["panels.obj", "--frames", "2", "--pin", "0,1"]).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        stderr(&output)
    };
    let split = obj("v 1 0 -0\nv 1 0 1\n", "f 7 8 6 5\n");
    let told = "4 vertices lie exactly where others do, the first of them 2 and 6";
    assert!(split.contains(told), "{split}");
    let joined = obj("", "f 3 4 6 5\n");
    assert!(!joined.contains("vertices lie"), "{joined}");
}

/// Far from the origin single precision rounds vertices onto each other, which merging them would not mend.
#[test]
fn what_the_distance_rounds_is_told_of() {
    let directory = TempDir::new().unwrap();
    let run_at = |far: u32| {
        let vertices = (0..20).map(|row| format!("v {far}.0 0 0.{row:02}\nv {far}.2 0 0.{row:02}\n"));
        let faces = (1..20).map(|row| format!("f {} {} {} {}\n", 2 * row - 1, 2 * row, 2 * row + 2, 2 * row + 1));
        let lines: Vec<String> = vertices.chain(faces).collect();
        fs::write(directory.path().join("far.obj"), lines.concat()).unwrap();
        let output = drape(&directory, &["far.obj", "--frames", "1"]).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        stderr(&output)
    };
    let (near, far) = (run_at(30), run_at(3_000_000));
    assert!(!near.contains("from the origin"), "{near}");
    assert!(far.contains("from the origin") && far.contains("rounded to 357.6 mm") && !far.contains("merge"), "{far}");
}

#[test]
fn a_directory_that_cannot_be_made_is_refused() {
    let directory = TempDir::new().unwrap();
    fs::write(directory.path().join("file"), "not a directory").unwrap();
    for out in ["file", "file/below"] {
        fails(&run(&directory, &["--out", out]), 2, &["--out", out]);
    }
    assert_eq!(names(&directory), set(["file"]));
    assert_eq!(fs::read_to_string(directory.path().join("file")).unwrap(), "not a directory");
}

/// The point cache holds the same values as the frames, to the last bit.
#[test]
fn a_point_cache_has_every_frame() {
    let directory = TempDir::new().unwrap();
    let vertices = crooked(&directory).positions.len();
    succeeds(&run(&directory, &["crooked.obj", "--frames", "5", "--pc2", "cache.pc2"]));
    assert_eq!(names(&directory), set(["cache.pc2", "crooked.obj", "frames"]));
    let cache = fs::read(directory.path().join("cache.pc2")).unwrap();
    let (header, samples) = cache.split_at(32);
    assert_eq!(header[28..], 5_i32.to_le_bytes());
    let numbers: Vec<u32> = samples.chunks(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
    assert_eq!(numbers.len(), 5 * 3 * vertices);
    for (sample, name) in numbers.chunks(3 * vertices).zip(frames(5)) {
        let mesh = Mesh::load_obj(directory.path().join("frames").join(name)).unwrap();
        assert_eq!(sample, bits(&mesh.positions).as_flattened());
    }
}

/// The sphere and the floor of the towel have its scale: it falls as far as its height.
#[test]
fn the_default_colliders_have_the_towel_s_scale() {
    let directory = TempDir::new().unwrap();
    succeeds(&run(&directory, &["--scale", "0.1", "--no-sphere", "--frames", "31", "--quiet"]));
    let towel = Mesh::load_obj(directory.path().join("frames/frame_0031.obj")).unwrap();
    let lowest = towel.positions.iter().map(|x| x.y).fold(f32::MAX, f32::min);
    assert!(lowest.abs() < 1e-3, "it lies {lowest} m above the floor");
}

/// Point caches that could not be written are refused before anything is simulated, as other outputs are.
#[cfg(unix)]
#[test]
fn a_point_cache_that_cannot_be_written_is_refused_at_once() {
    use std::os::unix::fs::PermissionsExt;

    let directory = TempDir::new().unwrap();
    let path = |name: &str| directory.path().join(name);
    fs::create_dir_all(path("frames/cloth.mdd")).unwrap();
    fs::create_dir(path("cache")).unwrap();
    let refuses = |arguments: &[&str], words: &[&str]| {
        fails(&run(&directory, arguments), 2, words);
        assert_eq!(names(path("frames")), set(["cloth.mdd"]), "nothing was written");
    };
    refuses(&["--frames", "2", "--pc2", "cache"], &["--pc2", "cache", "it is a directory", "name a file"]);
    refuses(&["--frames", "2", "--format", "obj,mdd"], &["--format", "cloth.mdd", "it is a directory"]);
    fs::write(path("kept"), "kept").unwrap();
    fs::set_permissions(path("kept"), fs::Permissions::from_mode(0o444)).unwrap();
    // Not for the superuser, who may write to it.
    if fs::OpenOptions::new().append(true).open(path("kept")).is_err() {
        refuses(&["--frames", "2", "--pc2", "kept"], &["--pc2", "kept", "name a file"]);
    }
    assert_eq!(fs::read_to_string(path("kept")).unwrap(), "kept");
}

/// The header of an MDD has a number for each frame, and there may be more frames than memory.
#[cfg(target_os = "linux")]
#[test]
fn a_cache_of_many_frames_takes_no_memory() {
    let directory = TempDir::new().unwrap();
    fs::create_dir(directory.path().join("frames")).unwrap();
    std::os::unix::fs::symlink("/dev/full", directory.path().join("frames/cloth.mdd")).unwrap();
    let limited = "ulimit -v 4000000; exec \"$0\" --backend cpu --frames 2000000000 --format mdd";
    let output = Command::new("sh").args(["-c", limited]).arg(program::path()).current_dir(&directory).output().unwrap();
    fails(&output, 2, &["--format", "cloth.mdd", "space left"]);
}

#[test]
fn springs_past_their_limit_are_unstable() {
    let directory = TempDir::new().unwrap();
    let command = "--method springs --substeps 1 --fabric denim --frames 500 --report r --preview p --pc2 c";
    let arguments: Vec<&str> = command.split(' ').collect();
    let output = run(&directory, &arguments);
    fails(&output, 3, &["frame", "unstable"]);
    let text = stderr(&output);
    // Denim's bending is beyond its limit too.
    for warning in ["warning: springs are unstable at 1 substeps", "warning: bending is softened"] {
        assert_eq!(text.lines().filter(|line| line.starts_with(warning)).count(), 1, "once, not every frame: {text}");
    }
    // Whatever files exist are complete: the frames before the failure. An incomplete file does not exist.
    assert_eq!(names(&directory), set(["frames"]));
    let count = names(directory.path().join("frames")).len();
    assert!((1..500).contains(&count));
    assert_whole(&directory.path().join("frames"));
}

/// On systems where drivers can be hidden, or in a build without a GPU backend.
#[cfg(any(target_os = "linux", not(feature = "gpu")))]
#[test]
fn a_gpu_that_is_not_there_is_an_error() {
    for backend in ["gpu", "hybrid"] {
        let directory = TempDir::new().unwrap();
        let mut command = drape(&directory, &["--backend", backend]);
        command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        fails(&command.output().unwrap(), 4, &["no GPU", "CPU"]);
        assert_eq!(names(&directory), BTreeSet::new());
    }
}

/// Every file is a complete frame of the towel, from its first vertex to its last face, and no frame between is
/// missing.
#[track_caller]
fn assert_whole(directory: &Path) {
    let names = names(directory);
    assert_eq!(names, frames(names.len() as u32));
    for name in names {
        let mesh = Mesh::load_obj(directory.join(&name)).unwrap();
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (64 * 64, 2 * 63 * 63), "{name}");
    }
}

#[cfg(unix)]
#[test]
fn signals_leave_whole_files_only() {
    use std::{
        process::Stdio,
        thread::sleep,
        time::{Duration, Instant},
    };

    for signal in ["-INT", "-TERM", "-HUP"] {
        let directory = TempDir::new().unwrap();
        let mut command =
            drape(&directory, &["--frames", "100000", "--report", "r.json", "--preview", "p.png", "--pc2", "c.pc2"]);
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let start = Instant::now();
        while !directory.path().join("frames/frame_0003.obj").exists() {
            assert!(start.elapsed() < Duration::from_secs(120), "no third frame after two minutes");
            sleep(Duration::from_millis(5));
        }
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        assert_eq!(names(&directory), set(["frames"]), "{signal}: neither report nor preview, nor anything temporary");
        fails(&output, 130, &["interrupted", "of 100000"]);
        assert_whole(&directory.path().join("frames"));
    }
}

/// What a killed process left unfinished is removed by the next run into its folder; what one that runs writes is not.
#[cfg(target_os = "linux")]
#[test]
fn what_a_killed_run_left_is_removed() {
    let directory = TempDir::new().unwrap();
    let mut ended = Command::new("true").spawn().unwrap();
    let gone = ended.id();
    assert!(ended.wait().unwrap().success());
    let name = |process: u32| format!(".cloth-deformer-{process}-7.tmp");
    let kept = [name(std::process::id()), ".cloth-deformer-x.tmp".to_owned()];
    fs::create_dir(directory.path().join("frames")).unwrap();
    for name in kept.iter().chain(&[name(gone)]) {
        fs::write(directory.path().join("frames").join(name), "v 0 0").unwrap();
    }
    succeeds(&run(&directory, &["--frames", "2"]));
    let mut expected = frames(2);
    expected.extend(kept);
    assert_eq!(names(directory.path().join("frames")), expected);
}

/// Before the preroll, which may take long.
#[test]
fn frames_that_cannot_be_written_are_found_at_once() {
    let directory = TempDir::new().unwrap();
    fs::create_dir_all(directory.path().join("frames/frame_0001.obj")).unwrap();
    let arguments = ["--frames", "3", "--preroll", "0.1", "--save", "run.save", "--every", "1"];
    fails(&run(&directory, &arguments), 2, &["frame_0001.obj", "cannot", "another --out"]);
    assert_eq!(names(&directory), set(["frames"]), "no step was taken");
    assert_eq!(names(directory.path().join("frames")), set(["frame_0001.obj"]));
}

/// The pictures are drawn after the last frame, which may take longer than the run.
#[cfg(unix)]
#[test]
fn a_signal_stops_the_drawing_of_pictures() {
    use std::{
        process::Stdio,
        thread::sleep,
        time::{Duration, Instant},
    };

    let directory = TempDir::new().unwrap();
    Mesh::grid(3, 3, 1.0, 1.0).save_obj(directory.path().join("sheet.obj")).unwrap();
    let arguments = ["sheet.obj", "--frames", "300", "--format", "pc2", "--report", "r.json", "--animate", "a.png"];
    let child = drape(&directory, &arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while !directory.path().join("r.json").exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "no report after two minutes");
        sleep(Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    fails(&output, 130, &["interrupted", "300 of 300 frames", "--animate"]);
    assert_eq!(names(&directory), set(["frames", "r.json", "sheet.obj"]), "no animation, nor anything temporary");
}

/// A path given for a file may be a link to one, or not be a regular file.
#[cfg(unix)]
#[test]
fn links_are_followed_and_devices_are_not_replaced() {
    use std::{
        io::Read,
        os::unix::fs::{FileTypeExt, PermissionsExt, symlink},
    };

    let directory = TempDir::new().unwrap();
    let path = |name: &str| directory.path().join(name);
    let kind = |name: &str| fs::symlink_metadata(path(name)).unwrap().file_type();
    let play = |report: &str, preview: &str| {
        drape(&directory, &["--frames", "2", "--quiet", "--report", report, "--preview", preview]).output().unwrap()
    };

    for name in ["r.json", "p.png"] {
        fs::write(path(name), "old").unwrap();
        fs::set_permissions(path(name), fs::Permissions::from_mode(0o640)).unwrap();
    }
    symlink("r.json", path("r.link")).unwrap();
    symlink(path("p.png"), path("p.link")).unwrap();
    succeeds(&play("r.link", "p.link"));
    assert!(kind("r.link").is_symlink() && kind("p.link").is_symlink());
    assert_eq!(
        serde_json::from_slice::<Value>(&fs::read(path("r.json")).unwrap()).unwrap()["frames"].as_array().unwrap().len(),
        2
    );
    assert_eq!(read_png(&path("p.png")).0, 2 * 322 - 2);
    assert_eq!(fs::metadata(path("r.json")).unwrap().permissions().mode() & 0o777, 0o640);

    assert!(Command::new("mkfifo").arg(path("pipe")).status().unwrap().success());
    if cfg!(target_os = "linux") {
        // Opened for writing too, so that opening it does not wait for a writer.
        let mut reader = fs::OpenOptions::new().read(true).write(true).open(path("pipe")).unwrap();
        succeeds(&play("pipe", "p.png"));
        assert!(kind("pipe").is_fifo());
        let mut text = vec![0; 1 << 16];
        let length = reader.read(&mut text).unwrap();
        assert_eq!(serde_json::from_slice::<Value>(&text[..length]).unwrap()["backend"], "cpu");
    }

    // A device node of the test's own, like `/dev/null`, if it is permitted to make and open one.
    let made = Command::new("mknod").arg(path("null")).args(["c", "1", "3"]).output().is_ok_and(|made| made.status.success());
    if cfg!(target_os = "linux") && made && fs::write(path("null"), "").is_ok() {
        succeeds(&play("null", "p.png"));
        succeeds(&play("r.json", "null"));
        assert!(kind("null").is_char_device());
    }
}

/// Otherwise the last one written would overwrite the others.
#[test]
fn two_outputs_never_share_a_file() {
    const TABLE: &[(&[&str], &[&str])] = &[
        (&["--report", "x", "--preview", "./x"], &["--report", "--preview", "x"]),
        (&["--report", "x", "--pc2", "frames/../x"], &["--report", "--pc2", "x"]),
        (&["--report", "frames/frame_0002.obj"], &["--report", "frame 2", "--out"]),
        (&["--preview", "frames/../frames/frame_0120.obj"], &["--preview", "frame 120", "--out"]),
        (&["towel.obj", "--report", "towel.obj"], &["mesh", "--report", "towel.obj"]),
        (&["towel.obj", "--pc2", "frames/../towel.obj"], &["mesh", "--pc2", "towel.obj"]),
        (&["frames/frame_0001.obj"], &["mesh", "frame 1", "--out"]),
        (&["frame_0002.obj", "--out", "."], &["mesh", "frame 2", "--out"]),
    ];
    let directory = TempDir::new().unwrap();
    let text = Mesh::grid(3, 3, 1.0, 1.0).write_obj().unwrap();
    fs::create_dir(directory.path().join("frames")).unwrap();
    for name in ["towel.obj", "frame_0002.obj", "frames/frame_0001.obj"] {
        fs::write(directory.path().join(name), &text).unwrap();
    }
    let before = names(&directory);
    for (arguments, words) in TABLE {
        let output = run(&directory, arguments);
        println!("{arguments:?} -> {}", stderr(&output).trim_end());
        fails(&output, 2, words);
        assert_eq!(names(&directory), before, "{arguments:?}");
        assert_eq!(names(directory.path().join("frames")), set(["frame_0001.obj"]), "{arguments:?}");
    }
    // A name beyond the last frame is free, and so is that of any frame that is not written.
    succeeds(&run(&directory, &["--frames", "2", "--report", "frames/frame_0003.obj"]));
    succeeds(&run(&directory, &["frames/frame_0001.obj", "--frames", "2", "--format", "pc2"]));
}

#[cfg(unix)]
#[test]
fn two_outputs_never_share_a_file_by_links() {
    use std::os::unix::fs::symlink;

    let directory = TempDir::new().unwrap();
    let path = |name: &str| directory.path().join(name);
    fs::create_dir(path("frames")).unwrap();
    ["x", "y"].iter().for_each(|name| fs::write(path(name), "kept").unwrap());
    symlink("x", path("link")).unwrap();
    symlink("frames", path("folder")).unwrap();
    symlink("../y", path("frames/frame_0002.obj")).unwrap();
    for (arguments, words) in [
        (&["--frames", "2", "--report", "x", "--pc2", "link"][..], &["--report", "--pc2"][..]),
        (&["--frames", "2", "--report", "folder/frame_0001.obj"], &["--report", "frame 1"]),
        (&["--frames", "2", "--report", "y"], &["--report", "frame 2"]),
    ] {
        fails(&run(&directory, arguments), 2, words);
        assert!(["x", "y"].iter().all(|name| fs::read_to_string(path(name)).unwrap() == "kept"), "{arguments:?}");
        assert_eq!(names(path("frames")), set(["frame_0002.obj"]), "{arguments:?}");
    }
}

/// Endless input and files that are not meshes are refused before they are read.
#[cfg(unix)]
#[test]
fn a_device_is_no_mesh() {
    let directory = TempDir::new().unwrap();
    fails(&run(&directory, &["/dev/zero"]), 2, &["/dev/zero", "device"]);
    assert_eq!(names(&directory), BTreeSet::new());
}
