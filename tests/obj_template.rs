//! An OBJ file that is written again keeps everything it contained, line for line, except the positions of vertices and
//! the normals.

use std::fmt::Write;

use cloth_deformer::glam::{Quat, Vec2, Vec3};
use cloth_deformer::{Mesh, ObjTemplate};

/// A sheet of quads with everything that modeling tools write: 46 x 31 vertices, 1350 quads.
fn quads() -> String {
    let (columns, rows) = (46, 31);
    let mut text = "# a modeler's\nmtllib sheet.mtl\no Sheet\n".to_owned();
    for row in 0..rows {
        for column in 0..columns {
            _ = writeln!(text, "v {column}.5 0 {row}.250");
            _ = writeln!(text, "vt {} {}", column as f32 / 45.0, row as f32 / 30.0);
        }
    }
    (0..columns * rows).for_each(|_| text.push_str("vn 0 1 0\n"));
    for row in 1..rows {
        _ = writeln!(text, "g row{row} all\ns {}\nusemtl {}", row % 2, if row < 9 { "red" } else { "blue" });
        for column in 1..columns {
            let d = row * columns + column + 1;
            let corner = |v: i32| format!("{v}/{v}/{v}");
            _ = writeln!(text, "f {} {} {} {}", corner(d - columns - 1), corner(d - 1), corner(d), corner(d - columns));
        }
    }
    text + "l 1 2 3\n"
}

fn lines<'a>(text: &'a str, but: &[&str]) -> Vec<&'a str> {
    text.lines().filter(|line| !but.iter().any(|word| line.starts_with(word))).collect()
}

fn text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap()
}

#[test]
fn quads_stay_quads_line_for_line() {
    let given = quads();
    let template = ObjTemplate::parse(given.as_bytes()).unwrap();
    assert_eq!(template.mesh(), &Mesh::parse_obj(&given).unwrap());
    assert_eq!((template.polygons().len(), template.mesh().triangles.len()), (1350, 2700));
    assert!(template.polygons().iter().all(|polygon| polygon.len() == 4));
    let texture = template.texture_coordinates();
    assert_eq!(texture.len(), 4 * 1350);
    for (corner, uv) in template.polygons().iter().flatten().zip(texture) {
        assert_eq!(*uv, Vec2::new((corner % 46) as f32 / 45.0, (corner / 46) as f32 / 30.0));
    }

    let moved: Vec<Vec3> = template.mesh().positions.iter().map(|x| Vec3::new(x.x, (0.3 * x.x).sin(), x.z / 3.0)).collect();
    let written = text(template.write(&moved).unwrap());
    assert_eq!(lines(&given, &["v ", "vn "]), lines(&written, &["v ", "vn "]));
    assert_eq!(given.lines().count(), written.lines().count());
    let places = |text: &str| text.lines().map(|line| line.split(' ').next().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(places(&given), places(&written), "each line is where it was");
    let back = Mesh::parse_obj(&written).unwrap();
    assert_eq!(back.positions, moved, "positions come back bit for bit");
    assert_eq!(back.triangles, template.mesh().triangles);
}

/// Positions that were not moved are written with the file's original digits.
#[test]
fn what_is_odd_stays() {
    let given = "\u{feff}v 1 2 3 0.5 0.25 1 # red\r\nv 4 6 \\\r\n 8 2\r\n#\u{fc}ber v 1 2 3\r\nv 0 0 0.5\r\n\tv   0 1   0\t\r\nf -4 -3\\\n -2 -1 # f 9 9 9";
    let template = ObjTemplate::parse(given.as_bytes()).unwrap();
    assert_eq!(template.mesh().positions[1], Vec3::new(2.0, 3.0, 4.0), "the fourth number is a weight");
    let moved = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(0.1, -2.5e-7, 1e9)];
    let expected = "\u{feff}v 1 0 0 0.5 0.25 1 # red\r\nv 0 1 0\r\n#\u{fc}ber v 1 2 3\r\nv 0 0 1\r\n\tv   0.1 -0.00000025 1000000000\t\r\nf -4 -3\\\n -2 -1 # f 9 9 9";
    assert_eq!(text(template.write(&moved).unwrap()), expected);
    assert_eq!(template.polygons(), [[0, 1, 2, 3]]);
    // Text that is not UTF-8 is kept too.
    let mut bytes = b"# \xff\nv 0 0 0\n".to_vec();
    assert_eq!(ObjTemplate::parse(&bytes).unwrap().write(&[Vec3::ZERO]).unwrap(), bytes);
    // What the parser takes for a space separates words here too.
    bytes.extend("v\u{a0}1\u{2003}2 3\u{2028}\nf\u{a0}1 2\u{3000}1".bytes());
    let template = ObjTemplate::parse(&bytes).unwrap();
    assert_eq!(template.mesh(), &Mesh::parse_obj(&String::from_utf8_lossy(&bytes)).unwrap());
    let written = template.write(&[Vec3::ZERO, Vec3::new(4.0, 5.0, 6.0)]).unwrap();
    let (_, added) = written.split_at(b"# \xff\nv 0 0 0\n".len());
    assert_eq!(added, "v\u{a0}4 5 6\u{2028}\nf\u{a0}1 2\u{3000}1".as_bytes());
}

/// Only `v` and `f` lines are continued: what ends in a backslash otherwise is no face.
#[test]
fn a_backslash_after_another_keyword_is_ignored() {
    for odd in ["vt\\", "vn\\", "vt 0 0\\", "vn 0 1 0\\"] {
        let given = format!("v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\n{odd}\nf 1 2 3 4\n");
        let template = ObjTemplate::parse(given.as_bytes()).unwrap();
        assert_eq!(template.mesh(), &Mesh::parse_obj(&given).unwrap());
        assert_eq!(template.polygons(), [[0, 1, 2, 3]], "after {odd}");
        assert_eq!(text(template.write(&template.mesh().positions).unwrap()), given);
    }
}

fn normals(text: &str) -> Vec<Vec3> {
    let numbers = |line: &str| -> Vec<f32> { line.split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect() };
    text.lines().filter(|line| line.starts_with("vn ")).map(|line| Vec3::from_slice(&numbers(line))).collect()
}

/// A rotated sheet has rotated normals; a rolled one has those of a cylinder.
#[test]
fn normals_turn_with_the_cloth() {
    let template = ObjTemplate::parse(quads().as_bytes()).unwrap();
    assert!(!template.shares_normals());
    let turn = Quat::from_axis_angle(Vec3::new(1.0, 2.0, -0.5).normalize(), 1.1);
    let turned: Vec<Vec3> = template.mesh().positions.iter().map(|x| turn * *x).collect();
    for normal in normals(&text(template.write(&turned).unwrap())) {
        assert!(normal.distance(turn * Vec3::Y) < 1e-5, "{normal}");
    }
    let rest = text(template.write(&template.mesh().positions).unwrap());
    assert!(normals(&rest).iter().all(|normal| normal.distance(Vec3::Y) < 1e-6));

    let radius = 9.0;
    let roll = |x: &Vec3| Vec3::new(radius * (x.x / radius).sin(), radius * (x.x / radius).cos(), x.z);
    let rolled: Vec<Vec3> = template.mesh().positions.iter().map(roll).collect();
    let written = normals(&text(template.write(&rolled).unwrap()));
    for (normal, x) in written.iter().zip(&rolled) {
        // At the sheet's border the normal deviates by half of an edge's angle.
        assert!(normal.distance(x.with_z(0.0) / radius) < 0.06, "{normal} at {x}");
    }
    let inner = written.iter().zip(&rolled).skip(1).step_by(46).take(31);
    inner.for_each(|(normal, x)| assert!(normal.distance(x.with_z(0.0) / radius) < 1e-4, "{normal} at {x}"));
}

/// A normal that is none stays as it is, and the others turn. One may be continued on the next line, as a texture coordinate may.
#[test]
fn one_bad_normal_keeps_no_other_from_turning() {
    for odd in ["nan 1 0", "0 1", "0 1.#QNAN 0", "0 1 \\"] {
        let given = format!(
            "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nvt 0 \\\n 0.5\nvn {odd}\nvn 0 \\\n1 \\\n 0\nf 1/1/1 2/1/2 3/1/-1 4/1/9\n"
        );
        let template = ObjTemplate::parse(given.as_bytes()).unwrap();
        assert_eq!(template.texture_coordinates(), [Vec2::new(0.0, 0.5); 4]);
        let turned: Vec<Vec3> = template.mesh().positions.iter().map(|x| Vec3::new(x.y, x.x, x.z)).collect();
        let written = text(template.write(&turned).unwrap());
        let normals: Vec<&str> = written.lines().filter(|line| line.starts_with("vn ")).collect();
        assert_eq!(normals[0], format!("vn {odd}"));
        let turned = normals[1].split(' ').skip(1).map(|word| word.parse().unwrap()).collect::<Vec<f32>>();
        assert!(Vec3::from_slice(&turned).distance(-Vec3::X) < 1e-6, "{written}");
        assert_eq!(lines(&given, &["v ", "vn ", "1 ", " 0"]), lines(&written, &["v ", "vn ", " 0"]));
    }
}

/// A hard edge stays hard: two polygons with different normals at their common vertices.
#[test]
fn hard_edges_stay_hard_and_shared_normals_are_told() {
    let hard = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nv 2 1 0\nv 2 1 1\nvn 0 -1 0\nvn .7071068 -.7071068 0\nf 1//1 2//1 3//1 4//1\nf 2//2 5//2 6//2 3//2\n";
    let template = ObjTemplate::parse(hard.as_bytes()).unwrap();
    assert!(template.shares_normals(), "one normal for four vertices");
    let each = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 2 1 0\nvn 0 -1 0\nvn 0.7071068 -0.7071068 0\nvn 0 -2 0\nf 1 2//1 3//3\nf 2//2 4 3\n";
    let template = ObjTemplate::parse(each.as_bytes()).unwrap();
    assert!(!template.shares_normals());
    let mut moved = template.mesh().positions.clone();
    // The second polygon is folded to lie level; the first one stays.
    moved[3] = Vec3::new(2.0, 0.0, 0.0);
    let written = normals(&text(template.write(&moved).unwrap()));
    assert!(written[0].distance(-Vec3::Y) < 1e-6 && written[1].distance(-Vec3::Y) < 1e-6, "{written:?}");
    assert!(written[2].distance(-2.0 * Vec3::Y) < 1e-6, "its length stays");
    // A polygon without area does not determine how its normal turned.
    let written = normals(&text(template.write(&[Vec3::ZERO; 4]).unwrap()));
    assert!(written[0] == -Vec3::Y && written[2] == -2.0 * Vec3::Y);
}

#[test]
fn positions_are_checked() {
    let template = ObjTemplate::parse(b"v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n").unwrap();
    let refused = |positions: &[Vec3], words: &[&str]| {
        let refusal = template.write(positions).unwrap_err().to_string();
        words.iter().for_each(|word| assert!(refusal.contains(word), "{refusal}"));
    };
    refused(&[Vec3::ZERO; 2], &["2 positions", "3 vertices"]);
    refused(&[Vec3::ZERO, Vec3::NAN, Vec3::ZERO], &["vertex 1", "NaN", "finite"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.obj");
    let refusal = template.save(&[Vec3::ZERO; 2], &path).unwrap_err().to_string();
    assert!(refusal.contains("frame.obj") && !path.exists());
    assert!(ObjTemplate::load(&path).is_err());
    template.save(&[Vec3::ONE; 3], &path).unwrap();
    assert_eq!(ObjTemplate::load(&path).unwrap().mesh().positions, [Vec3::ONE; 3]);
}

/// Meshes from other sources, if available.
#[test]
fn meshes_at_hand_come_back() {
    let Some(folder) = std::env::var_os("CLOTH_MESHES") else { return };
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.extension().is_none_or(|extension| extension != "obj") {
            continue;
        }
        let given = std::fs::read(&path).unwrap();
        let template = ObjTemplate::parse(&given).unwrap();
        let written = text(template.write(&template.mesh().positions).unwrap());
        let given = text(given);
        assert_eq!(lines(&given, &["v ", "vn "]), lines(&written, &["v ", "vn "]), "{}", path.display());
        let unit = |n: &Vec3| n.normalize_or_zero();
        for (normal, given) in normals(&written).iter().zip(normals(&given)) {
            assert!(unit(normal).distance(unit(&given)) < 2e-3, "{normal} was {given}");
        }
    }
}
