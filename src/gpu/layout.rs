//! Test: the shaders are valid, and their structs are laid out as the Rust structs that are copied into them.

use std::collections::BTreeSet;
use std::mem::offset_of;

use naga::valid::{Capabilities, ValidationFlags, Validator};

use crate::gpu::{Batch, Member, WORKGROUP, shader};
use crate::kernels::{BendEntry, BendRow, Body, Edge, Panel, Params, Pin, Spring, Substep};
use crate::model::csr::Span;

/// A struct as Rust lays it out.
struct Layout {
    name: &'static str,
    size: usize,
    members: Vec<(&'static str, usize)>,
}

macro_rules! layout {
    ($name:ident { $($member:ident),+ }) => {
        Layout { name: stringify!($name), size: size_of::<$name>(), members: vec![$((stringify!($member), offset_of!($name, $member))),+] }
    };
}

#[rustfmt::skip]
fn structs() -> Vec<Layout> {
    vec![
        layout!(Params { acceleration, h, wind, half_density, drag, lift, fraction, vertices, bodies, pins, damped, predicted, substeps, sweeps, relaxed, levels }),
        layout!(Substep { carry, gain, rate, start, end }),
        layout!(Span { start, end }),
        layout!(Pin { origin, vertex, goal, padding }),
        layout!(BendRow { stiffness, tau, diagonal }),
        layout!(BendEntry { other, forward, backward }),
        layout!(Panel { corners, mass }),
        layout!(Spring { other, rest, stiffness }),
        layout!(Edge { a, b, inverse_rest, inverse_weight }),
        layout!(Batch { first, count }),
        layout!(Member { item, share }),
        layout!(Body { a, radius, b, friction, a_travel, radius_travel, b_travel, kind }),
    ]
}

/// Every shader as the crate assembles it.
fn modules() -> Vec<(&'static str, naga::Module)> {
    let sources = [
        ("forces", shader!("predict", "forces")),
        ("bending", shader!("predict", "forces", "bending")),
        ("wind", shader!("wind")),
        ("springs", shader!("springs")),
        ("project", shader!("edge", "project")),
        ("contact", shader!("body", "contact")),
        ("commit", shader!("bounds", "commit")),
        ("restrict", shader!("predict", "restrict")),
        ("level", shader!("edge", "runs", "table", "level")),
        ("top", shader!("edge", "runs", "levels", "top")),
        ("coarse", shader!("edge", "coarse")),
        ("patch", shader!("predict", "edge", "body", "runs", "table", "patch")),
        ("whole", shader!("predict", "edge", "body", "bounds", "runs", "table", "levels", "whole")),
        ("normals", shader!("normals")),
        ("exchange", shader!("exchange")),
    ];
    sources
        .into_iter()
        .map(|(name, source)| match naga::front::wgsl::parse_str(source) {
            Ok(module) => (name, module),
            Err(error) => panic!("{name}.wgsl: {}", error.emit_to_string(source)),
        })
        .collect()
}

#[test]
fn shaders_are_valid_and_share_a_workgroup_size() {
    for (name, module) in modules() {
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::default());
        validator.validate(&module).unwrap_or_else(|error| panic!("{name}.wgsl: {error:?}"));
        assert!(!module.entry_points.is_empty());
        for entry in &module.entry_points {
            // Or one that the pipeline is told.
            let told = entry.workgroup_size_overrides.is_some();
            assert!(told || entry.workgroup_size == [WORKGROUP as u32, 1, 1], "{name}.wgsl: {}", entry.name);
        }
    }
}

#[test]
fn shared_structs_agree_member_for_member() {
    let ours = structs();
    let mut compared = BTreeSet::new();
    for (file, module) in modules() {
        for (_, shape) in module.types.iter() {
            let (Some(name), naga::TypeInner::Struct { members, span }) = (&shape.name, &shape.inner) else { continue };
            // Structs of the shader alone never cross over.
            if ["Path", "Touch", "Moment", "Ring", "Spin", "Stored", "Runs", "Four", "Item"].contains(&name.as_str()) {
                continue;
            }
            let twin = ours.iter().find(|layout| layout.name == name);
            let twin = twin.unwrap_or_else(|| panic!("{file}.wgsl: {name} has no twin in Rust"));
            let theirs: Vec<(&str, usize)> =
                members.iter().map(|member| (member.name.as_deref().unwrap_or(""), member.offset as usize)).collect();
            assert_eq!(theirs, twin.members, "{file}.wgsl: members of {name}");
            assert_eq!(*span as usize, twin.size, "{file}.wgsl: size of {name}");
            compared.insert(twin.name);
        }
    }
    assert_eq!(compared, ours.iter().map(|layout| layout.name).collect(), "every shared struct was met in a shader");
}
