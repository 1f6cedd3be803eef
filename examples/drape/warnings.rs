//! Formats warnings, one line each.

use cloth_deformer::{Cause, Crossing, Warning};

/// Formats a warning in terms of the command line. `sixtieths` is the length of a step in units of 1/60 s, by which `--substeps` counts.
pub(crate) fn describe(warning: Warning, sixtieths: f32) -> String {
    match warning {
        Warning::BendingLimited { vertices } => {
            format!("bending is softened at {vertices} vertices to stay stable; use more --substeps for its full stiffness")
        }
        Warning::ExplicitLimit { substeps, needed } => {
            let enough = (needed as f32 / sixtieths).ceil();
            format!("springs are unstable at {substeps} substeps per frame; use --substeps {enough}, or --method small-steps")
        }
        Warning::Slivers { edges, worst: [a, b] } => {
            format!(
                "{edges} edges are a hundred times shorter than their triangles, the worst between vertices {a} and {b}; merge their ends"
            )
        }
        Warning::Crossings { pairs, first: Crossing { edge: [a, b], triangle: [c, d, e], .. } } => {
            format!(
                "{pairs} edges pass through triangles at the start of contact, the first the edge between vertices {a} and {b} through triangle {c}, {d}, {e}; contact ignores them until they have separated"
            )
        }
        Warning::StrainMissed { stretch, promised, cause } => {
            let because = match cause {
                Cause::Pins => "by accelerated pins",
                Cause::Collider => "by a fast collider",
                Cause::Wind => "by the wind",
                _ => "by its own motion",
            };
            let [stretch, promised] = [stretch, promised].map(|share| 100.0 * share);
            format!(
                "the cloth was stretched by {stretch:.1} %, more than the bound of {promised:.1} %, {because}; move it more slowly, or ask for more --substeps"
            )
        }
        Warning::PinOutruns { pin, speed, carried } => {
            format!(
                "pin {pin} moves at {speed:.1} m/s, faster than the {carried:.1} m/s that the cloth can follow with these substeps; move it more slowly, or ask for more --substeps"
            )
        }
        Warning::ColliderOutruns { collider, speed, carried } => {
            format!(
                "collider {collider} moves at {speed:.1} m/s, faster than the {carried:.1} m/s that the cloth can follow with these substeps; move it more slowly, or ask for more --substeps"
            )
        }
        Warning::BodyCrossings { pairs, collider } => {
            format!(
                "cloth and mesh colliders cross at the start of contact in {pairs} pairs of an edge and a triangle, the first with collider {collider}; contact ignores them until they have separated"
            )
        }
        Warning::ContactOutruns { speed, resolved } => {
            format!(
                "pins or mesh colliders move relative to each other at {speed:.1} m/s, faster than the {resolved:.1} m/s that contact resolves with these substeps; move them more slowly, or ask for more --substeps"
            )
        }
        other => format!("{other:?}"),
    }
}
