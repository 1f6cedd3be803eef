//! Options of the command line that take the place of keys in a scene. A sweep must not vary such a key: its receipts would
//! tell of values that were not used.

use cloth_deformer::Method;
use toml::{Table, Value};

use crate::arguments::Arguments;
use crate::scene::file::ShapeName;
use crate::scene::replacing;
use crate::sweep::place;

/// The option that overrides a varied key or a part of its values, if any. `table` is the scene.
pub(crate) fn overriding(arguments: &Arguments, table: &Table, key: &str, values: &[Value]) -> Option<&'static str> {
    let words: Vec<&str> = key.split('.').collect();
    let shapes = shapes(table, &words, values);
    let of_shape = || shapes.iter().find_map(|shape| replacing(arguments, shape.clone().try_into::<ShapeName>().ok()?));
    let is_hit = |paths: &[&str]| paths.iter().any(|path| meets(&path.split('.').collect::<Vec<_>>(), &words, values));
    let given = options(arguments).into_iter().find(|&(_, is_given, paths)| is_given && is_hit(paths));
    given.map(|(option, ..)| option).or_else(of_shape)
}

/// Each option that overrides keys, whether it is given, and the keys; `*` is any item of a list. Colliders are replaced by
/// their shape: see [`replacing`].
fn options(arguments: &Arguments) -> Vec<(&'static str, bool, &'static [&'static str])> {
    // Without `..`, so that a new option is not forgotten here.
    #[rustfmt::skip]
    let Arguments {
        mesh, scale, out, frames, preroll, fps, backend, method, substeps, strain, iterations, levels, fabric, pin, gravity, wind,
        self_contact, untangle, friction, format, pc2, preview, animate, report,
        // These replace colliders, or nothing.
        sphere: _, capsule: _, solid_box: _, body: _, plane: _, no_sphere: _, floor: _, no_floor: _,
        task: _, scene: _, list: _, variant: _, tune: _, save: _, every: _, resume: _, quiet: _,
    } = arguments;
    let sweeps_are_unused = method.is_some_and(|method| !matches!(method, Method::Relaxation { .. }));
    vec![
        ("MESH.obj", mesh.is_some(), &["cloth.*.mesh", "cloth.*.grid"]),
        ("--scale", scale.is_some(), &["cloth.*.scale", "collider.*.scale"]),
        ("--out", out.is_some(), &["output.folder"]),
        ("--frames", frames.is_some(), &["frames"]),
        ("--preroll", preroll.is_some(), &["preroll"]),
        ("--fps", fps.is_some(), &["fps"]),
        ("--backend", backend.is_some(), &["backend"]),
        ("--method", method.is_some(), &["quality.method"]),
        ("--method", sweeps_are_unused, &["quality.iterations"]),
        ("--iterations", iterations.is_some(), &["quality.iterations"]),
        ("--substeps", substeps.is_some(), &["quality.substeps", "quality.strain", "quality.share", "quality.budget"]),
        ("--strain", strain.is_some(), &["quality.substeps", "quality.strain", "quality.budget"]),
        ("--levels", levels.is_some(), &["quality.levels"]),
        ("--fabric", fabric.is_some(), &["cloth.*.fabric"]),
        ("--pin", pin.is_some(), &["cloth.*.pin"]),
        ("--gravity", gravity.is_some(), &["gravity"]),
        ("--wind", wind.is_some(), &["wind.velocity"]),
        ("--self-contact", self_contact.is_some(), &["contact.thickness"]),
        ("--untangle", *untangle, &["contact.untangle"]),
        ("--friction", friction.is_some(), &["contact.friction", "collider.*.friction"]),
        ("--format", !format.is_empty(), &["output.format"]),
        ("--pc2", pc2.is_some(), &["output.pc2"]),
        ("--preview", preview.is_some(), &["output.preview"]),
        ("--animate", animate.is_some(), &["output.animation"]),
        ("--report", report.is_some(), &["output.report"]),
    ]
}

/// Whether a key is in what is overridden at `path`, or has values that contain that.
fn meets(path: &[&str], key: &[&str], values: &[Value]) -> bool {
    let agree = path.iter().zip(key).all(|(word, other)| *word == "*" || word == other);
    agree && (key.len() >= path.len() || values.iter().any(|value| contains(value, &path[key.len()..])))
}

fn contains(value: &Value, path: &[&str]) -> bool {
    match (path, value) {
        ([], _) => true,
        (["*", rest @ ..], Value::Array(list)) => list.iter().any(|item| contains(item, rest)),
        ([word, rest @ ..], Value::Table(table)) => table.get(*word).is_some_and(|inner| contains(inner, rest)),
        _ => false,
    }
}

/// The shapes of the colliders that a varied key belongs to.
fn shapes(table: &Table, key: &[&str], values: &[Value]) -> Vec<Value> {
    let of = |collider: &Value| collider.get("shape").cloned();
    match key {
        ["collider"] => values.iter().filter_map(Value::as_array).flatten().filter_map(of).collect(),
        ["collider", _, "shape"] => values.to_vec(),
        ["collider", item, ..] => {
            let list = table.get("collider").and_then(Value::as_array);
            list.and_then(|list| of(&list[place(list, item)?])).into_iter().collect()
        }
        _ => Vec::new(),
    }
}
