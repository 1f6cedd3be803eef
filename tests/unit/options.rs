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

#[test]
fn warnings_are_sentences_with_their_numbers() {
    let first = Crossing { edge: [1, 2], triangle: [3, 4, 5] };
    let [vertices, edges, pairs, needed, pin, collider] = [11, 12, 13, 14, 15, 16];
    let [stretch, promised, speed, carried, resolved] = [0.55, 0.03, 7.25, 6.5, 4.75];
    for (warning, parts) in [
        (Warning::BendingLimited { vertices }, vec!["11 vertices"]),
        (Warning::ExplicitLimit { substeps: 9, needed: needed as u32 }, vec!["9 substeps", "14"]),
        (Warning::StrainMissed { stretch, promised, cause: Cause::Wind }, vec!["55.0 %", "3.0 %", "by the wind"]),
        (Warning::Slivers { edges, worst: [6, 7] }, vec!["12 edges", "6 and 7"]),
        (Warning::PinOutruns { pin, speed, carried }, vec!["pin 15", "7.2 m/s", "6.5 m/s"]),
        (Warning::ColliderOutruns { collider, speed, carried }, vec!["collider 16", "7.2 m/s", "6.5 m/s"]),
        (Warning::ContactOutruns { speed, resolved }, vec!["7.2 m/s", "4.8 m/s"]),
        (Warning::BodyCrossings { pairs, collider }, vec!["13 pairs", "collider 16"]),
        (Warning::Crossings { pairs, first }, vec!["13 edges", "1 and 2", "3, 4, 5"]),
    ] {
        let text = warning.to_string();
        assert!(parts.iter().all(|part| text.contains(part)), "{text}");
    }
}

/// What exceeds a bound by little is not said to be the bound.
#[test]
fn numbers_in_warnings_differ() {
    for (stretch, parts) in [
        (0.0304, ["by 3.04 %", "of 3.00 %"]),
        (0.03004, ["by 3.004 %", "of 3.000 %"]),
        (f32::from_bits(0.03_f32.to_bits() + 1), ["by 3.0000001 %", "of 2.9999999 %"]),
    ] {
        let text = Warning::StrainMissed { stretch, promised: 0.03, cause: Cause::Wind }.to_string();
        assert!(parts.iter().all(|part| text.contains(part)), "{text}");
    }
    let text = Warning::ContactOutruns { speed: 6.02, resolved: 6.0 }.to_string();
    assert!(text.contains("6.02 m/s") && text.contains("6.00 m/s"), "{text}");
}
