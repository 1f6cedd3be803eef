//! Sweeps from outside: variants, each in a directory of its own, complete or absent even if processes are killed; and
//! the comparison of two runs.

#[allow(dead_code, unreachable_pub, reason = "each program of tests takes its own part")]
#[path = "common/program.rs"]
mod program;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::Duration;

use cloth_deformer::Mesh;
use program::{drape, fails, run, stderr, succeeds};
use serde_json::Value;
use tempfile::TempDir;

/// A scene with three weights and so many winds.
fn sweep(seeds: u32) -> TempDir {
    let directory = TempDir::new().unwrap();
    Mesh::grid(9, 7, 1.0, 0.8).save_obj(directory.path().join("sheet.obj")).unwrap();
    let text = format!(
        "frames = 6
[[vary]]
key = \"cloth.sheet.fabric.density\"
values = [0.1, 0.2, 0.4]
[[vary]]
key = \"wind.gusts.seed\"
first = 1
count = {seeds}
[[cloth]]
name = \"sheet\"
mesh = \"sheet.obj\"
fabric = {{ preset = \"silk\" }}
pin = [{{ vertices = [0, 8] }}]
[wind]
velocity = [4, 0, 1]
gusts = {{ strength = 0.5, turn = 30, period = 0.1 }}
[output]
format = [\"obj\", \"pc2\"]
"
    );
    fs::write(directory.path().join("s.toml"), text).unwrap();
    directory
}

/// Every file below a directory; one that disappears meanwhile is skipped.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() { folders.push(path) } else { files.push(path.strip_prefix(folder).unwrap().to_owned()) }
        }
    }
    files
}

/// The same with their contents.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    files(folder).into_iter().map(|path| (path.clone(), fs::read(folder.join(path)).unwrap())).collect()
}

fn start(directory: &TempDir, variants: &str) -> Child {
    let arguments = ["--scene", "s.toml", "--variant", variants, "--frames", "40", "--out", "out", "--quiet"];
    drape(directory, &arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

#[test]
fn variants_are_every_value_with_every_other() {
    let directory = sweep(4);
    let listed = run(&directory, &["--scene", "s.toml", "--list"]);
    succeeds(&listed);
    assert_eq!(String::from_utf8_lossy(&listed.stdout), "12\n");
    succeeds(&run(&directory, &["--scene", "s.toml", "--variant", "6", "--out", "out", "--preview", "sheet.png"]));
    let folder = directory.path().join("out/variant_0006");
    let files: Vec<String> = tree(&folder).into_keys().map(|path| path.to_str().unwrap().to_owned()).collect();
    let mut expected: Vec<String> = (1..=6).map(|frame| format!("frame_{frame:04}.obj")).collect();
    expected.extend(["cloth.pc2", "receipt.json", "sheet.png"].map(str::to_owned));
    expected.sort();
    assert_eq!(files, expected);
    assert_eq!(fs::read_dir(directory.path().join("out")).unwrap().count(), 1, "nothing temporary is left");

    let receipt: Value = serde_json::from_slice(&fs::read(folder.join("receipt.json")).unwrap()).unwrap();
    // The second weight and the second wind.
    assert_eq!(receipt["inputs"]["values"]["cloth.sheet.fabric.density"], 0.2);
    assert_eq!(receipt["inputs"]["values"]["wind.gusts.seed"], 2);
    assert_eq!(receipt["inputs"]["version"], env!("CARGO_PKG_VERSION"));
    assert!(receipt["inputs"]["files"][0]["name"] == "sheet.obj" && receipt["lanes"].as_u64() >= Some(4));
    assert_eq!(receipt["figures"]["frames"], 6);
    // A variant equals the scene with these values.
    let text = fs::read_to_string(directory.path().join("s.toml")).unwrap();
    let text =
        text.replace("preset = \"silk\"", "preset = \"silk\", density = 0.2").replace("period = 0.1", "period = 0.1, seed = 2");
    fs::write(directory.path().join("one.toml"), text).unwrap();
    succeeds(&run(&directory, &["--scene", "one.toml", "--out", "one", "--preview", "one/sheet.png"]));
    let mut files = tree(&folder);
    files.remove(Path::new("receipt.json"));
    assert!(files == tree(&directory.path().join("one")));
}

/// A scene with variants that is run without any says so.
#[test]
fn variants_that_are_not_run_are_told_of() {
    let directory = sweep(2);
    let output = run(&directory, &["--scene", "s.toml", "--frames", "2"]);
    succeeds(&output);
    let text = stderr(&output);
    assert!(
        text.starts_with("note: the scene is run without the values of [[vary]]") && text.contains("--variant 1-6"),
        "{text}"
    );
    assert_eq!(stderr(&run(&directory, &["--scene", "s.toml", "--frames", "2", "--quiet"])), "");
    assert_eq!(stderr(&run(&directory, &["--scene", "s.toml", "--variant", "1"])), "");
}

#[test]
fn what_is_done_is_not_done_again() {
    let directory = sweep(1);
    let path = directory.path().join("out/variant_0002");
    let run_it = |more: &[&str]| {
        let arguments = [&["--scene", "s.toml", "--variant", "1-3", "--out", "out"], more].concat();
        succeeds(&run(&directory, &arguments));
        fs::metadata(path.join("frame_0002.obj")).unwrap().modified().unwrap()
    };
    let first = run_it(&[]);
    assert_eq!(run_it(&[]), first, "the same is not run again");
    // Other variants beside it have no effect, but its inputs do.
    let scene = directory.path().join("s.toml");
    let text = fs::read_to_string(&scene).unwrap();
    fs::write(&scene, text.replace("values = [0.1, 0.2, 0.4]", "values = [0.1, 0.2, 0.4, 0.8]")).unwrap();
    assert_eq!(run_it(&[]), first);
    let mut times = vec![first];
    fs::write(&scene, text.replace("0.2, 0.4]", "0.3, 0.4]")).unwrap();
    times.push(run_it(&[]));
    Mesh::grid(9, 7, 1.0, 0.9).save_obj(directory.path().join("sheet.obj")).unwrap();
    times.push(run_it(&[]));
    times.push(run_it(&["--gravity", "0,-5,0"]));
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{times:?}");
    // Missing frames are not noticed; an invalid receipt is. What is replaced is told, and a folder of something else is not
    // replaced.
    fs::write(path.join("receipt.json"), "{}").unwrap();
    assert!(run_it(&["--gravity", "0,-5,0"]) > times[3]);
    let output = run(&directory, &["--scene", "s.toml", "--variant", "2", "--out", "out"]);
    succeeds(&output);
    assert!(String::from_utf8_lossy(&output.stdout).contains("replaces the one there"));
    fs::remove_file(path.join("receipt.json")).unwrap();
    let output = run(&directory, &["--scene", "s.toml", "--variant", "2", "--out", "out"]);
    fails(&output, 2, &["variant_0002 has no receipt", "another --out"]);
    assert!(path.join("frame_0002.obj").exists());
}

/// Two processes are killed again and again, and the remaining variants are completed: the result is byte for byte that
/// of an uninterrupted run.
#[test]
fn a_killed_sweep_is_finished_as_if_nothing_had_been() {
    const SEEDS: u32 = 10;
    const ROUNDS: usize = 6;
    let halves = ["1-15", "16-30"];
    let whole = sweep(SEEDS);
    assert!(halves.map(|half| start(&whole, half)).iter_mut().all(|child| child.wait().unwrap().success()));
    let whole = tree(&whole.path().join("out"));
    assert_eq!(whole.len(), 30 * 42);

    let directory = sweep(SEEDS);
    let out = directory.path().join("out");
    let is_hidden = |path: &Path| path.to_str().unwrap().starts_with('.');
    let mut cut = 0;
    for _ in 0..ROUNDS {
        let mut children = halves.map(|half| start(&directory, half));
        // Usually in the middle of a variant.
        let is_amid = || out.is_dir() && files(&out).iter().any(|path| is_hidden(path) && path.ends_with("frame_0002.obj"));
        while !is_amid() && children.iter_mut().any(|child| child.try_wait().unwrap().is_none()) {
            sleep(Duration::from_micros(200));
        }
        for child in &mut children {
            child.kill().unwrap();
            child.wait().unwrap();
        }
        // A directory that exists is complete.
        for (path, bytes) in tree(&out) {
            cut += u32::from(path.ends_with("frame_0002.obj") && is_hidden(&path));
            assert!(is_hidden(&path) || whole.get(&path) == Some(&bytes), "{}", path.display());
        }
    }
    println!("{cut} variants were cut");
    assert!(cut > 0, "some were cut in their middle");
    assert!(halves.map(|half| start(&directory, half)).iter_mut().all(|child| child.wait().unwrap().success()));
    assert!(tree(&out) == whole);
}

/// A variant that is replaced goes as a whole: killed before what replaces it is there, the next run has it back, and killed after,
/// the next run removes it.
#[test]
fn a_variant_is_there_whole_while_it_is_replaced() {
    let directory = sweep(1);
    let out = directory.path().join("out");
    let [complete, old, lock] = ["variant_0001", ".variant_0001.old", ".variant_0001.lock"].map(|name| out.join(name));
    let one = ["--scene", "s.toml", "--variant", "1", "--out", "out", "--quiet"];
    succeeds(&run(&directory, &one));
    let first = tree(&out);
    let made = || fs::metadata(complete.join("frame_0002.obj")).unwrap().modified().unwrap();
    let then = made();

    fs::rename(&complete, &old).unwrap();
    fs::write(&lock, "").unwrap();
    succeeds(&run(&directory, &one));
    assert!(tree(&out) == first && made() == then, "it is not run again");

    let other = [&one[..], &["--gravity", "0,-5,0"]].concat();
    for arguments in [&one[..], &other] {
        fs::create_dir(&old).unwrap();
        fs::write(old.join("frame_0002.obj"), "").unwrap();
        succeeds(&run(&directory, arguments));
        assert!(files(&out).len() == first.len() && !old.exists(), "nothing of the old one is left");
    }
    assert!(made() > then, "with other inputs it is run again");
}

/// Two processes with the same sweep: one of them runs a variant, and the other skips it.
#[test]
fn two_do_not_run_the_same_variant() {
    let directory = sweep(1);
    let out = directory.path().join("out");
    fs::create_dir(&out).unwrap();
    let lock = fs::File::create(out.join(".variant_0001.lock")).unwrap();
    lock.try_lock().unwrap();
    let one = ["--scene", "s.toml", "--variant", "1", "--out", "out", "--quiet"];
    fails(&run(&directory, &one), 2, &["variant 1", "another process runs it"]);
    assert!(!out.join("variant_0001").exists());
    drop(lock);
    succeeds(&run(&directory, &one));
    // Without its name the file would keep no third process from running the variant.
    let path = out.join(".variant_0001.lock");
    let lock = fs::File::create(&path).unwrap();
    lock.try_lock().unwrap();
    succeeds(&run(&directory, &one));
    assert!(path.exists(), "the lock of another process stays");
    drop(lock);
    succeeds(&run(&directory, &one));
    assert!(!path.exists(), "what a killed process left is removed");

    let directory = sweep(8);
    let mut both = ["1-24"; 2].map(|all| start(&directory, all));
    let codes = both.each_mut().map(|child| child.wait().unwrap().code().unwrap());
    assert!(codes.iter().all(|code| [0, 2].contains(code)), "{codes:?}");
    succeeds(&run(&directory, &["--scene", "s.toml", "--variant", "1-24", "--frames", "40", "--out", "out"]));
    let alone = sweep(8);
    succeeds(&run(&alone, &["--scene", "s.toml", "--variant", "1-24", "--frames", "40", "--out", "out"]));
    assert!(tree(&directory.path().join("out")) == tree(&alone.path().join("out")));
}

/// A variant that cannot be run is reported, and the others are run.
#[test]
fn one_bad_variant_holds_up_no_other() {
    let directory = sweep(1);
    let scene = directory.path().join("s.toml");
    let text = fs::read_to_string(&scene).unwrap();
    fs::write(&scene, text.replace("0.2, 0.4]", "-0.2, 0.4]")).unwrap();
    let output = run(&directory, &["--scene", "s.toml", "--variant", "1-3", "--out", "out", "--quiet"]);
    fails(&output, 2, &["variant 2", "s.toml", "cloth.sheet.fabric.density = -0.2", "above 0"]);
    let mut names: Vec<String> = fs::read_dir(directory.path().join("out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["variant_0001", "variant_0003"]);

    // Each of several is told, and no file takes the place of the receipt.
    fs::write(&scene, text.replace("0.2, 0.4]", "-0.2, -0.4]")).unwrap();
    let output = run(&directory, &["--scene", "s.toml", "--variant", "1-3", "--out", "out", "--quiet"]);
    assert_eq!(output.status.code(), Some(2));
    for bad in ["variant 2", "variant 3"] {
        assert!(stderr(&output).lines().any(|line| line.starts_with(&format!("error: {bad}: "))), "{}", stderr(&output));
    }
    fs::write(&scene, text).unwrap();
    let arguments = ["--scene", "s.toml", "--variant", "1", "--out", "other", "--report", "receipt.json", "--quiet"];
    fails(&run(&directory, &arguments), 2, &["the receipt", "--report", "same file"]);
}

#[test]
fn a_difference_is_named_with_its_reason() {
    let directory = sweep(2);
    succeeds(&run(&directory, &["--scene", "s.toml", "--variant", "1-6", "--out", "a"]));
    succeeds(&run(&directory, &["--scene", "s.toml", "--variant", "1-6", "--out", "b", "--quiet"]));
    let diff = |a: &str, b: &str, code: i32| {
        let output = std::process::Command::new(program::path()).current_dir(&directory).args(["diff", a, b]).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{a} {b}: {}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let contains = |text: &str, words: &[&str]| {
        assert!(text.lines().count() == 1 && words.iter().all(|word| text.contains(word)), "no {words:?} in {text}");
    };
    assert_eq!(diff("a/variant_0003", "b/variant_0003", 0), "");
    contains(&diff("a/variant_0003", "b/variant_0004", 1), &["frame 2: vertex 1 is at", "m apart", "wind.gusts.seed is 1 and 2"]);
    contains(&diff("a/variant_0001", "b/variant_0003", 1), &["cloth.sheet.fabric.density is 0.1 and 0.2"]);
    succeeds(&run(&directory, &["--scene", "s.toml", "--variant", "3", "--out", "c", "--gravity", "0,-5,0"]));
    contains(&diff("a/variant_0003", "c/variant_0003", 1), &["command line"]);

    // A frame from another machine and from another version; a missing frame; and frames whose receipts do not explain
    // the difference.
    let frame = directory.path().join("b/variant_0003/frame_0004.obj");
    let mut mesh = Mesh::load_obj(&frame).unwrap();
    mesh.positions[17].y += 1e-3;
    mesh.save_obj(&frame).unwrap();
    contains(&diff("a/variant_0003", "b/variant_0003", 1), &["frame 4: vertex 17", "the same"]);
    let receipt = directory.path().join("b/variant_0003/receipt.json");
    let text = fs::read_to_string(&receipt).unwrap();
    let lanes = format!("\"lanes\": {}", serde_json::from_str::<Value>(&text).unwrap()["lanes"]);
    fs::write(&receipt, text.replace(&lanes, "\"lanes\": 2").replace(env!("CARGO_PKG_VERSION"), "0.0.1")).unwrap();
    contains(&diff("a/variant_0003", "b/variant_0003", 1), &["frame 4: vertex 17", "lanes", "and 2", "version", "0.0.1"]);
    fs::remove_file(&receipt).unwrap();
    contains(&diff("a/variant_0003", "b/variant_0003", 1), &["frame 4: vertex 17", "no receipts"]);
    fs::remove_file(directory.path().join("b/variant_0004/frame_0006.obj")).unwrap();
    contains(&diff("a/variant_0004", "b/variant_0004", 1), &["frame 6", "only a/variant_0004"]);
    let file = "a/variant_0001/frame_0001.obj";
    for (a, b, word) in [
        ("a", "b", "no OBJ frames"),
        ("missing", "a/variant_0001", "check the path"),
        (file, "a/variant_0001", "give the folders of two runs"),
    ] {
        let output = std::process::Command::new(program::path()).current_dir(&directory).args(["diff", a, b]).output().unwrap();
        fails(&output, 2, &[a, word]);
    }
}

/// Frames with the same positions may differ in the rest of their text. Their numbers may be as far apart as they like.
#[test]
fn a_difference_in_anything_else_is_named_by_its_line() {
    let directory = TempDir::new().unwrap();
    let text =
        "o sheet\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nvt 0 0\nvn 0 1 0\ng left\nf 1/1/1 2/1/1 3/1/1\nf 1/1/1 3/1/1 4/1/1\n";
    let write = |folder: &str, text: &str| {
        let folder = directory.path().join(folder);
        fs::create_dir_all(&folder).unwrap();
        ["frame_0001.obj", "frame_4294967295.obj"].iter().for_each(|name| fs::write(folder.join(name), text).unwrap());
    };
    write("a", text);
    let diff = |to: &str| {
        write("b", to);
        let output = drape_diff(&directory, "a", "b");
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    };
    assert_eq!(diff(text), (Some(0), String::new()));
    assert_eq!(diff(&text.replace("vt 0 0", "vt 0.0 0  # a comment\n")), (Some(0), String::new()));
    let quad = "f 1/1/1 2/1/1 3/1/1 4/1/1";
    for (from, to, words) in [
        ("vt 0 0", "vt 0.5 0", ["line 6 of a/frame_0001.obj is `vt 0 0`", "line 6 of b/frame_0001.obj is `vt 0.5 0`"]),
        ("vn 0 1 0", "vn 0 -1 0", ["line 7", "`vn 0 -1 0`"]),
        ("g left", "g right", ["line 8", "`g right`"]),
        ("f 1/1/1 2/1/1 3/1/1\nf 1/1/1 3/1/1 4/1/1", quad, ["line 9", quad]),
        ("4/1/1\n", "4/1/1\ng end\n", ["line 11 of b/frame_0001.obj is `g end`", "the other does not have"]),
    ] {
        let (code, said) = diff(&text.replace(from, to));
        assert_eq!(code, Some(1), "{to}");
        assert!(said.starts_with("frame 1: ") && words.iter().all(|word| said.contains(word)), "{said}");
    }
    write("b", text);
    fs::write(directory.path().join("b/frame_0777.obj"), text).unwrap();
    let said = String::from_utf8(drape_diff(&directory, "a", "b").stdout).unwrap();
    assert!(said.contains("frame 777: only b has this frame"), "{said}");
}

fn drape_diff(directory: &TempDir, a: &str, b: &str) -> std::process::Output {
    std::process::Command::new(program::path()).current_dir(directory).args(["diff", a, b]).output().unwrap()
}

/// A variant reads its files again for the receipt, which a pipe does not give twice: the cloth's, a body's and its start's.
#[cfg(target_os = "linux")]
#[test]
fn nothing_comes_through_a_pipe() {
    use std::io::Write;
    use std::process::Stdio;

    let directory = sweep(1);
    let path = directory.path().join("s.toml");
    let text = fs::read_to_string(&path).unwrap();
    let refuses = |scene: &str, arguments: &[&str]| {
        fs::write(&path, scene).unwrap();
        let mut command = drape(&directory, &["--scene", "s.toml", "--variant", "1", "--frames", "2", "--quiet"]);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        // It may have ended before it is told anything.
        _ = child.stdin.take().unwrap().write_all(b"v 0 -1 0\nv 1 -1 0\nv 1 -1 1\nf 1 2 3\n");
        fails(&child.wait_with_output().unwrap(), 2, &["/dev/stdin", "it is a pipe", "give a file"]);
    };
    let body = "[[collider]]\nshape = \"mesh\"\nmesh";
    refuses(&text, &["--body", "/dev/stdin"]);
    refuses(&format!("{text}{body} = \"/dev/stdin\"\n"), &[]);
    refuses(&format!("{text}{body} = \"sheet.obj\"\nstart = \"/dev/stdin\"\n"), &["--preroll", "0.1"]);
}

#[test]
fn what_cannot_be_varied_is_refused() {
    let scene = |vary: &str| format!("{vary}\n[[cloth]]\ngrid = {{ columns = 3, rows = 3, width = 1, height = 1 }}\n");
    for (vary, words) in [
        ("", &["s.toml:1", "no [[vary]]"][..]),
        ("[[vary]]\nkey = \"frames\"", &["s.toml:1", "frames", "values"]),
        ("[[vary]]\nkey = \"frames\"\nvalues = [3]\ncount = 3", &["s.toml:1", "values"]),
        ("[[vary]]\nkey = \"frames\"\nvalues = []", &["s.toml:1", "values"]),
        ("[[vary]]\nkey = \"frames\"\nvalue = [3]", &["s.toml:3", "`value`"]),
        ("[[vary]]\nkey = \"frames\"\nvalues = [3]\n[[vary]]\nkey = \"frames\"\nvalues = [3]", &["s.toml:4", "twice"]),
        ("[[vary]]\nkey = \"wind.speed\"\nvalues = [3]", &["s.toml:1", "`wind`"]),
        ("[[vary]]\nkey = \"cloth.2.scale\"\nvalues = [3]", &["s.toml:1", "`2`"]),
        ("[[vary]]\nkey = \"cloth.1\"\nvalues = [3]", &["s.toml:1", "cloth.1 is all of", "cloth.1.name"]),
        ("[[vary]]\nkey = \"frames\"\nfirst = 1\ncount = 4000000", &["s.toml:1", "1000000"]),
        ("[[vary]]\nkey = \"frames\"\nfirst = 1\ncount = 4000000000", &["s.toml:1", "1000000"]),
        ("[[vary]]\nkey = \"farmes\"\nvalues = [3]", &["farmes = 3", "unknown"]),
        ("[[vary]]\nkey = \"frames\"\nvalues = [3, 4]", &["--variant 9", "2 variants"]),
    ] {
        let directory = TempDir::new().unwrap();
        fs::write(directory.path().join("s.toml"), scene(vary)).unwrap();
        let number = if vary.contains("[3, 4]") { "9" } else { "1" };
        let output = run(&directory, &["--scene", "s.toml", "--variant", number]);
        println!("{vary:?} -> {}", stderr(&output).trim_end());
        fails(&output, 2, words);
        if !vary.is_empty() && number == "1" {
            fails(&run(&directory, &["--scene", "s.toml", "--list"]), 2, words);
        }
    }
    let directory = sweep(1);
    for (arguments, word) in [
        (&["--variant", "1"][..], "--scene"),
        (&["--list"], "--scene"),
        (&["--scene", "s.toml", "--variant", "0"], "from 1"),
        (&["--scene", "s.toml", "--variant", "-3"], "from 1"),
        (&["--scene", "s.toml", "--variant", "3-1"], "from 1"),
        (&["--scene", "s.toml", "--variant", "1", "--save", "x"], "--save"),
        (&["--scene", "s.toml", "--variant", "1", "--list"], "--list"),
    ] {
        fails(&run(&directory, arguments), 2, &[word]);
    }
}

/// Values that no scene can have are told before a sweep is started: each written one, and the ends of a count.
#[test]
fn a_list_names_the_first_wrong_value() {
    let directory = TempDir::new().unwrap();
    let list = |vary: &str| {
        let text = format!("[[cloth]]\nname = \"rag\"\ngrid = {{ columns = 3, rows = 3, width = 1, height = 1 }}\n{vary}");
        fs::write(directory.path().join("s.toml"), text).unwrap();
        run(&directory, &["--scene", "s.toml", "--list"])
    };
    let good = "[[vary]]\nkey = \"fps\"\nvalues = [24, 60]\n";
    let bad = "[[vary]]\nkey = \"cloth.rag.scale\"\nvalues = [\n  0.5,\n  -1,\n  -2,\n]\n";
    fails(&list(&format!("{good}{bad}")), 2, &["s.toml:11: cloth.rag.scale = -1: -1.0 is not", "above 0"]);
    let text = "[[vary]]\nkey = \"cloth.rag.fabric\"\nvalues = [\"silk\", { colour = 1 }]\n";
    fails(&list(text), 2, &["s.toml:6: ", "unknown field `colour`"]);
    fails(&list("[[vary]]\nkey = \"frames\"\nfirst = 0\ncount = 3\n"), 2, &["s.toml:4: frames = 0", "from 1"]);
    fails(&list("[[vary]]\nkey = \"frames\"\nfirst = 4294967294\ncount = 3\n"), 2, &["s.toml:4: frames = 4294967296"]);
    let output = list("[[vary]]\nkey = \"frames\"\nfirst = 1\ncount = 1000000\n");
    succeeds(&output);
    assert_eq!(String::from_utf8_lossy(&output.stdout), "1000000\n");
}

/// A receipt must not tell of values that an option has replaced.
#[test]
fn what_is_varied_is_not_overridden() {
    let text = "
frames = 2
[quality]
iterations = 3
method = \"relaxation\"
[[cloth]]
name = \"rag\"
grid = { columns = 3, rows = 3, width = 1, height = 1 }
fabric = { preset = \"silk\" }
pin = [{ vertices = [0] }]
[wind]
velocity = [0, 0, 0]
[[collider]]
name = \"ball\"
shape = \"sphere\"
center = [0, -1, 0]
radius = 0.2
[[vary]]
";
    let directory = TempDir::new().unwrap();
    let start = |key: &str, value: &str, options: &[&str]| {
        let vary = format!("key = \"{key}\"\nvalues = [{value}]\n");
        fs::write(directory.path().join("s.toml"), text.to_owned() + &vary).unwrap();
        run(&directory, &[&["--scene", "s.toml", "--variant", "1", "--out", "out"], options].concat())
    };
    let table: &[(&str, &str, &[&str])] = &[
        ("cloth.rag.fabric.preset", "\"denim\"", &["--fabric", "cotton"]),
        ("cloth.1.fabric", "\"denim\"", &["--fabric", "cotton"]),
        ("cloth", "[{ grid = { columns = 3, rows = 3, width = 1, height = 1 }, fabric = \"denim\" }]", &["--fabric", "cotton"]),
        ("cloth.rag.pin.1.vertices", "[1]", &["--pin", "top"]),
        ("cloth.rag.grid.width", "2", &["missing.obj"]),
        ("cloth.rag.scale", "2", &["--scale", "1"]),
        ("frames", "3", &["--frames", "4"]),
        ("output", "{ folder = \"a\" }", &[]),
        ("wind", "{ velocity = [1, 0, 0] }", &["--wind", "1,0,0"]),
        ("quality.share", "0.9", &["--substeps", "4"]),
        ("quality.iterations", "4", &["--method", "springs"]),
        ("collider.ball.radius", "0.1", &["--no-sphere"]),
        ("collider.1.radius", "0.1", &["--sphere", "0,-2,0,1"]),
        ("collider", "[{ shape = \"plane\", point = [0, -1, 0] }]", &["--floor", "-1"]),
        ("collider.ball.shape", "\"plane\"", &["--no-floor"]),
        ("collider.ball.friction", "0.1", &["--friction", "0"]),
    ];
    for &(key, value, options) in table {
        let option = options.first().map_or("--out", |&option| if option == "missing.obj" { "MESH.obj" } else { option });
        let output = start(key, value, options);
        println!("{key} {options:?} -> {}", stderr(&output).trim_end());
        fails(&output, 2, &["s.toml:18: ", key, option, "leave out"]);
        assert!(!directory.path().join("out").exists());
    }
    // Other parts of a scene may be overridden.
    let table: &[(&str, &str, &[&str])] = &[
        ("cloth.rag.shear", "10", &["--fabric", "cotton"]),
        ("wind.gusts", "{ strength = 1 }", &["--wind", "1,0,0"]),
        ("quality.iterations", "4", &["--method", "relaxation"]),
        ("quality", "{ substeps = 4 }", &["--levels", "off"]),
        ("collider", "[]", &["--floor", "-1"]),
        ("collider.ball.radius", "0.1", &["--plane", "0,-2,0,0,1,0"]),
    ];
    for &(key, value, options) in table {
        println!("{key} {options:?}");
        succeeds(&start(key, value, options));
    }
}
