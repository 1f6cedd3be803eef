//! Scene files that cannot be run are refused with their line; what can be run but is probably not meant is warned of.

#[allow(dead_code, unreachable_pub, reason = "each program of tests takes its own part")]
#[path = "common/program.rs"]
mod program;

use std::fs;

use cloth_deformer::Mesh;
use program::{drape, fails, run, scene, stderr, succeeds};
use tempfile::TempDir;

/// A cloth of 3 x 3 vertices, to which a test adds what it checks.
const SHEET: &str = "
frames = 2
[[cloth]]
grid = { columns = 3, rows = 3, width = 2, height = 2 }
";

/// Asserts a single error line that names the file, the line in it and these words, and that nothing was written.
#[test]
fn what_cannot_be_is_refused_with_its_line() {
    let in_cloth = |text: &str| format!("[[cloth]]\ngrid = {{ columns = 3, rows = 3, width = 1, height = 1 }}\n{text}");
    let pin = |text: &str| in_cloth(&format!("[[cloth.pin]]\n{text}"));
    let collider = |text: &str| in_cloth(&format!("[[collider]]\nname = \"it\"\n{text}"));
    let table: Vec<(String, u32, &[&str])> = vec![
        (String::new(), 1, &["no cloth", "[[cloth]]"]),
        ("frames = 0".into(), 1, &["0 is not", "from 1"]),
        ("frames = 3.5".into(), 1, &["3.5", "whole number from 1"]),
        ("frames = \"3\"".into(), 1, &["\"3\"", "whole number from 1"]),
        ("fps = -1".into(), 1, &[": fps: -1.0 is not a finite number above 0"]),
        ("fps = 1e-42\n[[cloth]]".into(), 1, &["finite"]),
        ("fps = 1e30\n[[cloth]]".into(), 1, &["too short", "at most"]),
        ("frames = 3\nframe = 3".into(), 2, &["unknown", "`frame`"]),
        ("frames = [".into(), 1, &[]),
        ("backend = \"abacus\"".into(), 1, &["abacus", "hybrid"]),
        ("gravity = [0, nan, 0]".into(), 1, &["NaN", "finite"]),
        ("gravity = [{ time = 0, value = [0, 0, 0], ease = 1 }]".into(), 1, &["ease"]),
        ("gravity = [\n  { time = 1, value = [0, 0, 0] },\n  { time = 1, value = [0, 0, 0] },\n]".into(), 1, &["1 s", "order"]),
        ("gravity = { loop = true, keys = [] }".into(), 1, &["no keys"]),
        ("gravity = [1, { time = 0, value = [0, 0, 0] }]".into(), 1, &["numbers among its keys"]),
        (
            "[quality]\nstrain = 0.1\nsubsteps = 4\n[[cloth]]\ngrid = { columns = 2, rows = 2, width = 1, height = 1 }".into(),
            1,
            &["one of"],
        ),
        (in_cloth("[quality]\nshare = 0.9"), 3, &["share"]),
        (in_cloth("[quality]\niterations = 3"), 3, &["relaxation"]),
        (in_cloth("[quality]\nsubsteps = 70000"), 3, &["substeps = 70000", "65536"]),
        (in_cloth("[wind]\nvelocity = [0, 0, 0]\nlift = 2"), 3, &["lift = 2", "drag"]),
        ("[[cloth]]\nname = \"it\"".into(), 1, &["it", "mesh", "grid"]),
        ("[[cloth]]\n\nmesh = \"not there.obj\"".into(), 3, &["not there.obj"]),
        ("[[cloth]]\ngrid = 5".into(), 2, &["`5`", "expected a table of columns, rows, width and height"]),
        ("[[cloth]]\ngrid = { columns = 1, rows = 3, width = 1, height = 1 }".into(), 2, &["1 x 3", "2 or more"]),
        ("[[cloth]]\ngrid = { columns = 90000, rows = 90000, width = 1, height = 1 }".into(), 2, &["90000"]),
        (in_cloth("at = [1e16, 0, 0]"), 1, &["1e15 m"]),
        (in_cloth("fabric = \"steel\""), 3, &["steel", "denim"]),
        (in_cloth("fabric = { density = 0 }"), 3, &["cloth.fabric.density: 0.0 is not", "above 0"]),
        (in_cloth("fabric = { colour = 0 }"), 3, &["colour", "density"]),
        (
            in_cloth("\n[[cloth]]\nfabric = \"silk\"\ngrid = { columns = 3, rows = 3, width = 1, height = 1 }"),
            4,
            &["cloth 2", "damping"],
        ),
        (in_cloth("pin = \"top\""), 3, &["\"top\"", "[[cloth.pin]]"]),
        (in_cloth("[collider]\nshape = \"plane\""), 3, &["two brackets", "[[collider]]"]),
        (pin("name = \"it\""), 3, &["it", "one of rule"]),
        (pin("vertices = 8"), 4, &["8", "[.., ..]"]),
        (pin("vertices = [-1]"), 4, &["-1", "whole number from 0"]),
        (pin("vertices = [9]"), 3, &["vertex 9", "9 vertices"]),
        (pin("vertices = [1, 1]"), 3, &["vertex 1", "twice"]),
        (pin("vertices = [1]\n[[cloth.pin]]\nrule = \"top\""), 5, &["vertex 1", "twice"]),
        (pin("color = [1, 0, 0]"), 3, &["grid", "colors"]),
        (in_cloth("[[collider]]\nshape = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nscale = 2"), 3, &["no `scale`"]),
        (pin("box = { low = [5, 5, 5], high = [6, 6, 6] }"), 3, &["no vertex", "reaches"]),
        (
            pin("vertices = [0]\nmove = { start = [5, 0, 0], keys = [{ time = 0, value = [0, 0, 0] }] }"),
            3,
            &["`start` needs a preroll"],
        ),
        (pin("rule = \"left\""), 4, &["left", "corners"]),
        (pin("rule = \"top\"\nmove = [0, 1, 0]"), 3, &["0 s", "move"]),
        (collider("shape = \"cube\""), 5, &["cube", "tapered-capsule"]),
        (collider("shape = \"sphere\"\nradius = 1"), 3, &["it", "center"]),
        (collider("shape = \"sphere\"\ncenter = [0, 0, 0]\nradius = 0"), 3, &["it", "radius", "above 0"]),
        (collider("shape = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nhalf = [1, 1, 1]"), 3, &["half", "center, radius"]),
        (collider("shape = \"plane\"\npoint = [0, 0, 0]\nnormal = [0, 0, 0]"), 3, &["it", "direction", "give a vector"]),
        (collider("shape = \"box\"\ncenter = [0, 0, 0]\nhalf = [1, 0, 1]"), 7, &["above 0"]),
        (
            collider(
                "shape = \"box\"\ncenter = [0, 0, 0]\nhalf = [1, 1, 1]\nradius = [{ time = 0, value = 0 }, { time = 1, value = 3 }]",
            ),
            3,
            &["it", "radius", "least of `half`", "give a smaller radius, or a larger half"],
        ),
        (collider("shape = \"mesh\"\nmesh = \"body.obj\""), 3, &["it", "mesh"]),
        (
            collider("shape = \"plane\"\npoint = [0, 0, 0]\nid = 4\n[[collider]]\nshape = \"plane\"\npoint = [0, 0, 0]\nid = 4"),
            8,
            &["id = 4", "it"],
        ),
        (in_cloth("[output]\nformat = \"pc2\""), 4, &["pc2", "[.., ..]"]),
        (in_cloth("[output]\nformat = [\"mp4\"]"), 4, &["mp4", "usda"]),
        (in_cloth("[output]\nformat = []"), 4, &["no format", "leave it out"]),
        (in_cloth("[wind]\nvelocity = [1, 0, 0]\ngusts = { strength = 1e30 }"), 3, &["gusts.strength", "at most"]),
        (in_cloth("[picture]\nfrom = [0, 0, 0]"), 4, &["not all of them 0"]),
        (in_cloth("[picture]\nbegin = -1"), 4, &[": picture.begin: -1.0 is not", "0 or above"]),
        (in_cloth("color = [1, 0, 1.5]"), 3, &["from 0 to 1"]),
    ];
    for (text, line, words) in table {
        let (directory, output) = scene(&text, &[]);
        println!("{text:?} -> {}", stderr(&output).trim_end());
        fails(&output, 2, &[&[format!("s.toml:{line}: ").as_str()], words].concat());
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1, "nothing is written");
    }
    let directory = TempDir::new().unwrap();
    fails(&run(&directory, &["--scene", "missing.toml"]), 2, &["missing.toml: cannot be read", "check the path"]);
    #[cfg(unix)]
    fails(&run(&directory, &["--scene", "/dev/zero"]), 2, &["/dev/zero", "longer"]);
    let two = "[[cloth]]\nmesh = \"a.obj\"\n[[cloth]]\nmesh = \"a.obj\"\n";
    let (_, output) = scene(two, &["other.obj"]);
    fails(&output, 2, &["s.toml:3", "several cloths"]);
}

/// A number is said as it was written, not as a list of one, with the key that it is the value of.
#[test]
fn a_wrong_number_is_said_with_its_key() {
    let ball = |text: &str| scene(&format!("{SHEET}[[collider]]\nshape = \"sphere\"\n{text}"), &[]).1;
    fails(&ball("center = 3\nradius = 1"), 2, &["s.toml:7: collider.center: 3.0 is not three finite numbers"]);
    let keys = "center = [0, 0, 0]\nradius = [{ time = 0, value = -1 }]";
    fails(&ball(keys), 2, &["s.toml:8: collider.radius.value: -1.0 is not a finite number, 0 or above"]);
    fails(&scene(&format!("{SHEET}at = \"left\""), &[]).1, 2, &["cloth.at", "\"left\"", "a list of numbers in brackets"]);
    fails(&ball("center = [0, 0]\nradius = 1"), 2, &["s.toml:7: collider.center: [0.0, 0.0] is not three finite numbers"]);
}

/// What only the run finds to be out of range is said with its line and its key there, or with its option.
#[test]
fn what_a_run_refuses_is_said_where_it_was_given() {
    let ball = "[[collider]]\nshape = \"sphere\"\ncenter = [0, -9, 0]\n";
    let named = ball.replace("shape", "name = \"ball\"\nshape");
    let pins = "[[cloth.pin]]\nvertices = [0, 1]\n[[cloth.pin]]\nname = \"hem\"\nvertices = [7, 8]\n";
    let led = format!("{pins}move = [{{ time = 0, value = [0, 0, 0] }}, {{ time = 0.01, value = [1e16, 0, 0] }}]");
    for (more, words) in [
        (led, ["s.toml:7: hem: frame 2: `move` = [1", "1e15 m"]),
        (format!("{ball}radius = 1e16"), ["s.toml:5: collider 1: frame 1: `radius` = 1", "at most 1e15 m"]),
        (format!("{ball}radius = 1\n{named}radius = 1e16"), ["s.toml:9: ball: frame 1: `radius` = 1", "at most 1e15 m"]),
        ("[wind]\nvelocity = [1e20, 0, 0]".to_owned(), ["s.toml:5: wind: frame 1: `velocity` = [1", "within 1e15 m/s"]),
        ("fabric = { density = 1e-30 }".to_owned(), ["s.toml:3: cloth 1: fabric.density = 0.00", "at least 1e-20"]),
    ] {
        fails(&scene(&format!("{SHEET}{more}"), &[]).1, 2, &words);
    }
    fails(
        &scene(&format!("gravity = [0, 1e30, 0]\n{SHEET}"), &[]).1,
        2,
        &["s.toml:1: gravity: frame 1: `gravity` = [0", "1e15 m/s2"],
    );
    fails(&scene(SHEET, &["--gravity", "0,1e30,0"]).1, 2, &["--gravity: frame 1: `gravity` = [0"]);
    fails(&scene(SHEET, &["--wind", "1e30,0,0"]).1, 2, &["--wind: frame 1: `velocity` = [1"]);
    fails(&scene(SHEET, &["--box", "0,0,0,1e16,1,1"]).1, 2, &["--box: frame 1: `half.x` = 1"]);
}

#[test]
fn a_mesh_in_centimeters_is_told_of_and_scaled() {
    let directory = TempDir::new().unwrap();
    Mesh::grid(3, 3, 70.0, 70.0).save_obj(directory.path().join("m.obj")).unwrap();
    let large = run(&directory, &["m.obj", "--frames", "1", "--quiet"]);
    succeeds(&large);
    assert!(stderr(&large).contains("70 m across") && stderr(&large).contains("--scale"), "{}", stderr(&large));
    let scaled = run(&directory, &["m.obj", "--frames", "1", "--quiet", "--scale", "0.01"]);
    succeeds(&scaled);
    assert_eq!(stderr(&scaled), "");
    let frame = Mesh::load_obj(directory.path().join("frames/frame_0001.obj")).unwrap();
    assert!((frame.positions[0].x + 0.35).abs() < 1e-6);
}

/// Cloth that is kept farther apart than its edges are long is slow, for the same picture.
#[test]
fn a_thickness_above_the_edges_is_told_of() {
    let directory = TempDir::new().unwrap();
    Mesh::grid(9, 9, 0.02, 0.02).save_obj(directory.path().join("m.obj")).unwrap();
    let warned = |thickness| {
        let output = run(&directory, &["m.obj", "--frames", "1", "--quiet", thickness]);
        succeeds(&output);
        stderr(&output)
    };
    let text = warned("--self-contact=0.004");
    assert!(text.contains("kept 0.004 m apart") && text.contains("mm would do"), "{text}");
    assert_eq!(warned("--self-contact=0.001"), "");
}

/// A percentage for a share, and cloth that begins inside a collider, run, but are told of. Pins may be inside.
#[test]
fn what_is_probably_not_meant_is_told_of() {
    let warned = |more: &str, arguments: &[&str]| {
        let (_, output) = scene(&format!("{SHEET}{more}"), arguments);
        succeeds(&output);
        stderr(&output)
    };
    for (more, arguments) in [("[quality]\nstrain = 3", &[][..]), ("", &["--strain", "3"])] {
        let text = warned(more, arguments);
        assert!(text.contains("strain of 3") && text.contains("300 %") && text.contains("0.03"), "{text}");
    }
    assert_eq!(warned("[quality]\nstrain = 0.9", &[]), "");
    let ball = |radius: f32, more: &str| {
        let ball = "shape = \"sphere\"\ncenter = [0, 0, 0]";
        format!("{more}[[collider]]\nshape = \"plane\"\npoint = [0, -9, 0]\n[[collider]]\n{ball}\nradius = {radius}\n")
    };
    let text = warned(&ball(1.3, ""), &[]);
    // The vertex in the middle; edges are 1 m and 1.41 m long.
    assert!(text.contains("begins inside collider 2, vertex 4 by 1.300 m"), "{text}");
    let inside = |more: &str, radius: f32| warned(&ball(radius, more), &[]).contains("begins inside");
    assert!(!inside("", 0.9) && !inside("[[cloth.pin]]\nvertices = [4]\n", 1.3));
}

/// A name that several cloths have names none of them.
#[test]
fn a_varied_name_must_be_unique() {
    let cloth = "[[cloth]]\nname = \"it\"\ngrid = { columns = 3, rows = 3, width = 2, height = 2 }\n";
    let vary = |key: &str| format!("{cloth}{cloth}at = [0, 1, 0]\n[[vary]]\nkey = \"{key}\"\nvalues = [\"silk\", \"denim\"]\n");
    fails(&scene(&vary("cloth.it.fabric"), &["--variant", "1"]).1, 2, &["s.toml:8", "`it`", "number"]);
    succeeds(&scene(&vary("cloth.2.fabric"), &["--list"]).1);
}

/// Pictures are PNG files, and have no other name.
#[test]
fn pictures_are_not_named_as_something_else() {
    fails(&scene(SHEET, &["--preview", "p.jpg"]).1, 2, &["--preview", "p.jpg", ".png"]);
    fails(&scene(&format!("{SHEET}[output]\nanimation = \"a.gif\"\n"), &[]).1, 2, &["--animate", "a.gif", ".png"]);
    let (directory, output) = scene(SHEET, &["--preview", "p.PNG"]);
    succeeds(&output);
    assert!(directory.path().join("p.PNG").exists());
}

/// A scene file and its meshes are not overwritten.
#[test]
fn nothing_is_written_over_the_scene() {
    let text = SHEET.to_owned() + "[output]\nreport = \"s.toml\"\n";
    let (directory, output) = scene(&text, &[]);
    fails(&output, 2, &["the scene", "--report"]);
    assert_eq!(fs::read_to_string(directory.path().join("s.toml")).unwrap(), text);
    let output = drape(&directory, &["--scene", "s.toml", "--preview", "s.toml", "--report", "r.json"]).output().unwrap();
    fails(&output, 2, &["the scene", "--preview"]);
}
