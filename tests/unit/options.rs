//! Unit tests of `src/options/`.

use super::*;

/// Compiled with and without the `gpu` feature: every field has a value in both.
#[test]
fn a_full_literal_does_not_depend_on_a_feature() {
    let full = Options {
        backend: Backend::Auto,
        method: Method::SmallSteps,
        quality: Quality::Strain(0.03),
        levels: Levels::Auto,
        sleep: None,
        tethers: Tethers::Auto,
        fabric: Fabric::default(),
        gpu: None,
        pinned: Vec::new(),
        mass: None,
        edge_scale: None,
        bending_scale: None,
        contact: None,
    };
    assert_eq!(format!("{full:?}"), format!("{:?}", Options::default()));
}
