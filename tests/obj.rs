//! OBJ input and output: the file's own vertices and faces, or an error that names the line; never a silent repair.

mod common;

use std::fmt::Write;
use std::fs;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Mesh, ObjError, Options, Quality};
use common::meshes;

fn parse(text: &str) -> Mesh {
    Mesh::parse_obj(text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// The error message for a text that must be refused.
fn refusal(text: &str) -> String {
    match Mesh::parse_obj(text) {
        Ok(mesh) => panic!("accepted as {mesh:?}:\n{text}"),
        Err(error) => error.to_string(),
    }
}

fn bits(mesh: &Mesh) -> Vec<[u32; 3]> {
    mesh.positions.iter().map(|position| position.to_array().map(f32::to_bits)).collect()
}

/// A simple reference parser for plain OBJ: without comments after statements, continued lines and weights.
fn oracle(text: &str) -> Mesh {
    let mut mesh = Mesh::default();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.first() {
            Some(&"v") => mesh.positions.push(Vec3::from_array([1, 2, 3].map(|at: usize| words[at].parse().unwrap()))),
            Some(&"f") => {
                let corner = |word: &str| match word.split('/').next().unwrap().parse::<i64>().unwrap() {
                    index if index < 0 => (mesh.positions.len() as i64 + index) as u32,
                    index => index as u32 - 1,
                };
                let corners: Vec<u32> = words[1..].iter().map(|word| corner(word)).collect();
                mesh.triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
            }
            _ => {}
        }
    }
    mesh
}

fn starting(text: &str, keyword: &str) -> usize {
    text.lines().filter(|line| line.split_whitespace().next() == Some(keyword)).count()
}

/// A cloth as modeling tools write it: quads, groups that share borders, a texture seam at every face, unusual numbers.
fn exported(side: u32) -> String {
    let mut text = String::from("# exported\nmtllib gone.mtl\no towel\n");
    let mut rng = fastrand::Rng::with_seed(u64::from(side));
    for vertex in 0..side * side {
        let (column, row) = (vertex % side, vertex / side);
        writeln!(text, "v {column}.{} {} -{row}e-1", rng.u32(..1000), rng.f32()).unwrap();
    }
    for face in 0..(side - 1) * (side - 1) {
        let a = face / (side - 1) * side + face % (side - 1) + 1;
        if face % 3 == 0 {
            writeln!(text, "g panel{}\nusemtl cloth{}\ns {face}", face % 2, face % 2).unwrap();
        }
        let uv = 4 * face + 1;
        writeln!(text, "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 {} 0", face % 2).unwrap();
        let corners = [a, a + 1, a + side + 1, a + side];
        let corners: Vec<_> = corners.iter().zip(uv..).map(|(v, vt)| format!("{v}/{vt}/{}", face + 1)).collect();
        writeln!(text, "f {}", corners.join(" ")).unwrap();
    }
    text
}

#[test]
fn round_trip_is_bit_for_bit() {
    let mut rng = fastrand::Rng::with_seed(1);
    let edge = [0.0, -0.0, 0.1, -1.0 / 3.0, 1e-45, -1e-40, f32::MIN_POSITIVE, f32::MAX, f32::MIN, 16_777_217.0];
    let mut values = edge.to_vec();
    while values.len() < 30_000 {
        let value = f32::from_bits(rng.u32(..));
        values.extend(value.is_finite().then_some(value));
    }
    let positions: Vec<Vec3> = values.chunks_exact(3).map(Vec3::from_slice).collect();
    let count = positions.len() as u32;
    let triangles = (0..5000).map(|_| [rng.u32(..count), rng.u32(..count), rng.u32(..count)]).collect();
    let mesh = Mesh { positions, triangles };

    let text = mesh.write_obj().unwrap();
    assert_eq!((starting(&text, "v"), starting(&text, "f")), (10_000, 5000));
    assert!(text.lines().all(|line| line.split(' ').skip(1).all(|number| !number.contains('e'))), "exponents");
    let back = parse(&text);
    assert_eq!(bits(&back), bits(&mesh));
    assert_eq!(back.triangles, mesh.triangles);
    assert_eq!(back.write_obj().unwrap(), text);
}

#[test]
fn written_lines_are_plain() {
    let mesh = Mesh { positions: vec![Vec3::new(0.1, -0.0, 2.5e-7), Vec3::X, Vec3::Z], triangles: vec![[2, 0, 1]] };
    assert_eq!(mesh.write_obj().unwrap(), "v 0.1 -0 0.00000025\nv 1 0 0\nv 0 0 1\nf 3 1 2\n");
}

#[test]
fn meshes_of_any_size_come_back() {
    for (columns, rows) in [(1, 1), (1, 2), (1, 3), (2, 2), (1, 7), (40, 25)] {
        let mesh = Mesh::grid(columns, rows, 1.5, 0.7);
        assert_eq!(parse(&mesh.write_obj().unwrap()), mesh, "{columns} x {rows}");
    }
}

#[test]
fn seams_and_groups_do_not_cut_the_cloth() {
    let text = exported(12);
    let mesh = parse(&text);
    assert_eq!(mesh.positions.len(), starting(&text, "v"));
    assert_eq!(mesh.triangles.len(), 2 * starting(&text, "f"));
    assert_eq!(mesh, oracle(&text));
    // A grid of quads, each split by one diagonal: the borders of faces and groups are shared, not duplicated.
    assert_eq!(mesh.edges().len(), 2 * 12 * 11 + 11 * 11);
}

#[test]
fn vertices_keep_their_order_used_or_not() {
    let text = "v 9 0 0\nv 1 0 0\nv 2 0 0\nv 8 0 0\nv 3 0 0\nf 5 3 2\n";
    let mesh = parse(text);
    assert_eq!(mesh.positions.iter().map(|position| position.x).collect::<Vec<_>>(), [9.0, 1.0, 2.0, 8.0, 3.0]);
    assert_eq!(mesh.triangles, [[4, 2, 1]]);
}

#[test]
fn equal_positions_stay_two_vertices() {
    let mesh = parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nf 1 2 3\nf 1 4 3");
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 3, 2]]);
}

#[test]
fn polygons_become_fans_in_the_order_of_faces() {
    let points = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nv 4 0 0\nv 5 0 0\n";
    let mesh = parse(&format!("{points}g b\nf 6 5 4 3 2\ng a\nf 1 2 3\nusemtl x\nf 2 3 4 5\ng b\nf 4 5 6\n"));
    let expected = [[5, 4, 3], [5, 3, 2], [5, 2, 1], [0, 1, 2], [1, 2, 3], [1, 3, 4], [3, 4, 5]];
    assert_eq!(mesh.triangles, expected);
}

#[test]
fn negative_indices_count_back_from_the_face() {
    let mesh = parse("v 0 0 0\nv 1 0 0\nv 2 0 0\nf -3 -2 -1\nv 3 0 0\no next\nv 4 0 0\nf -1/-9 -2//-9 1\n");
    assert_eq!(mesh.triangles, [[0, 1, 2], [4, 3, 0]]);
}

#[test]
fn what_cloth_has_no_use_for_is_harmless() {
    let plain = parse("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let rich = [
        "v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n",
        "\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3",
        "\t v 0 0 0\n\n  v\t1 0 0   \nv 0 1 0 # up\n#v 5 5 5\nf 1 2 3# front\n# f 1 1 1\n",
        "v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 0.5 0.5 0.5 1\nf 1 2 3\n",
        "v 0 0 0 2\nv 3 0 0 3\nv 0 1 0 1.0\nf 1 2 3\n",
        "mtllib gone.mtl\nusemtl\nv 0 0 0\nv 1 0 0\nusemtl gone\nv 0 1 0\nf 1 2 3\nusemtl other\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3\np 1\nf 1 2 3\nl 1 2\ns off\n",
        "v 0 0 \\\n 0\nv \\\r\n1 0 0\nv\\\n0 1 0\nf 1 \\\n\\\n2 3",
        "f 1 2 3\nv 0 0 0\no late\nv 1 0 0\nv 0 1 0\n",
        "vt 0\nvn x\nvt nan nan\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/7/7 2/0 3//-9223372036854775808\n",
        "# C:\\\nv 0 0 0\nmtllib C:\\\nv 1 0 0\no C:\\\nv 0 1 0\nf 1 2 3\n",
    ];
    for text in rich {
        assert_eq!(parse(text), plain, "{text:?}");
    }
}

#[test]
fn a_position_that_is_none_is_named() {
    for word in ["NaN", "nan", "inf", "-inf", "infinity", "1e999", "-1e39", "x", "1,5", "0x10", "--1", "1e", "1.#QNAN", "1.#INF"]
    {
        let message = refusal(&format!("# towel\nv 0 0 0\n\nv 1 {word} 0\nf 1 2 2\n"));
        assert_eq!(message, format!("line 4: vertex 2 is at (1, {word}, 0); positions must be finite numbers"));
    }
    assert_eq!(refusal("v 0 0 0\nv 1 2"), "line 2: vertex 2 has 2 numbers; give it x, y and z");
    assert_eq!(refusal("v\n"), "line 1: vertex 1 has 0 numbers; give it x, y and z");
    for line in ["v 1 2 3 4 5", "v 1 2 3 4 5 6 7 8", "v 0 0 0 v 1 0 0", "v 1 2 3 x", "v 1 2 3 0", "v 1 2 3 inf", "v 1 2 3 1e-44"]
    {
        assert!(refusal(&format!("v 0 0 0\n{line}\n")).starts_with("line 2: vertex 2 has "), "{line}");
    }
}

#[test]
fn a_face_that_is_none_is_named() {
    let points = "v 0 0 0\nv 1 0 0\nv 0 0 1\n";
    let cases = [
        ("f 1 2 4", "names vertex 4, but the last one is 3 (counted from 1)"),
        ("f 1 2 99999999999999", "names vertex 99999999999999, but the last one is 3 (counted from 1)"),
        ("f 0 1 2", "names vertex 0; vertices are counted from 1"),
        ("f 1 2 -4", "names vertex -4, but only 3 come before it; count back from the face"),
        ("f", "has 0 corners; give it three or more"),
        ("f 1 2", "has 2 corners; give it three or more"),
        ("f 1 2 1/x", "has the corner `1/x`; write it as v, v/vt, v//vn or v/vt/vn"),
        ("f 1 2 /3", "has the corner `/3`; write it as v, v/vt, v//vn or v/vt/vn"),
        ("f 1 2 3/1/1/1", "has the corner `3/1/1/1`; write it as v, v/vt, v//vn or v/vt/vn"),
        ("f 1 2 3.0", "has the corner `3.0`; write it as v, v/vt, v//vn or v/vt/vn"),
    ];
    for (line, problem) in cases {
        assert_eq!(refusal(&format!("{points}f 1 2 3\n{line}\nf 3 2 1\n")), format!("line 5: face 2 {problem}"));
    }
    // The fourth vertex comes after the face: a relative index cannot refer to it, an absolute one can.
    assert!(refusal("v 0 0 0\nv 1 0 0\nv 0 0 1\nf -4 -2 -1\nv 2 0 0\n").starts_with("line 4: face 1 names vertex -4"));
}

#[test]
fn continued_lines_keep_the_count_of_lines() {
    assert!(refusal("v 0 \\\n0 \\\n0\nv 1 0 nan\n").starts_with("line 4: vertex 2 "));
}

#[test]
fn no_vertices_is_an_error() {
    for text in ["", "\n\n", "# towel", "f 1 2 3\n", "hello", "vt 0 0\nvn 0 0 0\n", "V 0 0 0\n"] {
        assert_eq!(refusal(text), "no vertices; give at least one line `v x y z`");
    }
}

#[test]
fn more_vertices_than_a_cloth_may_have_are_refused() {
    let text = "v 0 0 0\n".repeat((1 << 24) + 1);
    let error = Mesh::parse_obj(&text).map(|mesh| mesh.positions.len()).unwrap_err();
    assert_eq!(error.to_string(), "more than 16777216 vertices, the most that a mesh may have; split it");
    let mesh = Mesh { positions: vec![Vec3::ZERO; (1 << 24) + 1], triangles: Vec::new() };
    let written = mesh.write_obj().map(|text| text.len()).unwrap_err();
    assert_eq!(written.to_string(), error.to_string(), "nor are they written");
}

#[test]
fn a_file_cut_short_is_no_other_mesh() {
    let text = exported(4);
    let full = oracle(&text);
    let mut refused = 0;
    for end in 0..text.len() {
        match Mesh::parse_obj(&text[..end]) {
            // A cut within the last number shortens it, which cannot be detected; everything before must be as in the
            // file.
            Ok(mesh) => {
                let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
                assert!(vertices < 2 || mesh.positions[..vertices - 1] == full.positions[..vertices - 1]);
                assert!(triangles < 2 || mesh.triangles[..triangles - 2] == full.triangles[..triangles - 2]);
            }
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 16 * 4, "{refused} of {} cuts", text.len());
}

#[test]
fn hostile_text_neither_panics_nor_passes() {
    const TOKENS: [&str; 24] = [
        "v",
        "f",
        "l",
        "o",
        "g",
        "usemtl",
        "mtllib",
        "vt",
        "vn",
        "nan",
        "inf",
        "1e999",
        "-0",
        "0",
        "-1",
        "99999999999999999999",
        "-9223372036854775808",
        "1/",
        "//",
        "1//1",
        "\\\n",
        "\n",
        "#",
        "\u{2028}",
    ];
    let seeds = [
        exported(3),
        "v 0 0 0 1\nv 1 0 0 2\nv 0 0 1\nf -1 -2 -3 \\\n1\n".to_owned(),
        Mesh::grid(3, 3, 1.0, 1.0).write_obj().unwrap(),
    ];
    let mut rng = fastrand::Rng::with_seed(7);
    let (mut accepted, mut refused) = (0, 0);
    for _ in 0..20_000 {
        let mut bytes = seeds[rng.usize(..seeds.len())].clone().into_bytes();
        for _ in 0..rng.usize(1..6) {
            let at = rng.usize(..bytes.len());
            match rng.u8(..5) {
                0 => bytes[at] = rng.u8(..),
                1 if bytes.len() > 1 => _ = bytes.remove(at),
                2 => _ = bytes.splice(at..at, rng.choice(TOKENS).unwrap().bytes()),
                3 => _ = bytes.splice(at..at, format!(" {} ", rng.choice(TOKENS).unwrap()).into_bytes()),
                _ => bytes.truncate(at.max(1)),
            }
        }
        let text = String::from_utf8_lossy(&bytes);
        match Mesh::parse_obj(&text) {
            Ok(mesh) => {
                accepted += 1;
                assert!(mesh.positions.iter().all(|position| position.is_finite()), "{text}");
                let vertices = mesh.positions.len() as u32;
                assert!(mesh.triangles.as_flattened().iter().all(|&index| index < vertices), "{text}");
                let back = parse(&mesh.write_obj().unwrap());
                assert_eq!((bits(&back), back.triangles), (bits(&mesh), mesh.triangles), "{text}");
            }
            Err(error) => {
                refused += 1;
                assert!(!matches!(error, ObjError::Parser { .. }), "{error}: {text}");
                let message = error.to_string();
                assert!(message.len() < 250 && !message.contains(char::is_control), "{message:?}");
            }
        }
    }
    assert!(accepted > 2000 && refused > 2000, "{accepted} accepted, {refused} refused");
}

#[test]
fn long_input_takes_linear_time() {
    // A polygon, a continued line and a word of a million characters: each would take minutes if anything were
    // quadratic.
    let points = "v 0 0 0\nv 1 0 0\nv 0 0 1\n";
    assert_eq!(parse(&format!("{points}f {}", "1 2 3 ".repeat(170_000))).triangles.len(), 509_998);
    assert_eq!(parse(&format!("{points}f {}", "1 \\\n2 3 ".repeat(120_000))).triangles.len(), 359_998);
    assert!(refusal(&format!("{points}f 1 2 {}", "9".repeat(1_000_000))).len() < 200);
}

/// Files from other programs: every `.obj` in the folder of real meshes with its name; without the folder, generated
/// meshes.
fn inputs() -> Vec<(String, String)> {
    let Some(folder) = meshes::folder() else {
        let mut made = [2, 30, 101].map(|side| (format!("made here, {side} x {side}"), exported(side))).to_vec();
        let unstructured = |seed| (format!("Delaunay {seed}"), meshes::delaunay(40, seed).write_obj().unwrap());
        made.extend([1, 2].map(unstructured));
        return made;
    };
    let entries = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let paths = entries.map(|entry| entry.unwrap().path());
    let objs = paths.filter(|path| path.extension().is_some_and(|extension| extension == "obj"));
    let read: Vec<_> = objs.map(|path| (path.display().to_string(), fs::read_to_string(&path).unwrap())).collect();
    assert!(!read.is_empty(), "{} holds no .obj file", folder.display());
    read
}

#[test]
fn meshes_from_other_programs_load_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in inputs() {
        let path = folder.path().join("mesh.obj");
        fs::write(&path, &text).unwrap();
        let mesh = Mesh::load_obj(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(mesh.positions.len(), starting(&text, "v"), "{name}");
        assert!(mesh.triangles.len() >= starting(&text, "f"), "{name}");
        let expected = oracle(&text);
        assert_eq!((bits(&mesh), &mesh.triangles), (bits(&expected), &expected.triangles), "{name}");

        mesh.save_obj(&path).unwrap();
        let back = Mesh::load_obj(&path).unwrap();
        assert_eq!((bits(&back), back.triangles), (bits(&mesh), mesh.triangles), "{name}");
    }
}

/// Mean over the edges of `max(0, l/l0 - 1)`, with the faces and numbering of `rest`.
fn mean_strain(rest: &Mesh, positions: &[Vec3]) -> f64 {
    let edges = rest.edges();
    let length = |x: &[Vec3], [i, j]: [u32; 2]| x[i as usize].as_dvec3().distance(x[j as usize].as_dvec3());
    let strain = |&edge: &[u32; 2]| (length(positions, edge) / length(&rest.positions, edge) - 1.0).max(0.0);
    edges.iter().map(strain).sum::<f64>() / edges.len() as f64
}

/// Forty frames of each mesh, hung by three vertices and saved: the faces are those of the input, and its vertices are
/// in the input's order.
///
/// Counts do not reveal a changed order. But edge lengths computed with the file's numbering agree with the cloth's own
/// only if the order is right.
#[test]
fn meshes_from_other_programs_come_back_after_forty_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("moved.obj");
    for (name, text) in inputs() {
        let mesh = parse(&text);
        let last = mesh.positions.len() as u32 - 1;
        let pinned = vec![0, last.div_ceil(2), last];
        let options =
            Options { backend: Backend::Cpu, quality: Quality::Substeps(20), pinned: pinned.clone(), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        common::play(&mut cloth, 40, &Attributes::default());
        let strain = f64::from(cloth.measure().unwrap().mean_strain);
        Mesh { positions: cloth.positions().unwrap().to_vec(), triangles: mesh.triangles.clone() }.save_obj(&path).unwrap();

        let back = Mesh::load_obj(&path).unwrap();
        assert_eq!(back.triangles, oracle(&text).triangles, "{name}");
        assert_eq!(back.positions.len(), mesh.positions.len(), "{name}");
        assert!(back.positions.iter().all(|x| x.is_finite()), "{name}");
        for &v in &pinned {
            assert_eq!(back.positions[v as usize], mesh.positions[v as usize], "{name}: pinned vertex {v}");
        }
        let moved = common::rms(&back.positions, &mesh.positions);
        let by_number = mean_strain(&mesh, &back.positions);
        println!("{name}: moved {moved:.3} m, mean strain {strain:.6}, by the file's numbers {by_number:.6}");
        assert!(moved > 0.01, "{name}: moved by {moved} m only");
        assert!((by_number - strain).abs() <= 1e-5 + 1e-3 * strain, "{name}: mean strain {by_number}, the cloth says {strain}");
    }
}
