//! What a run warns of, in a line each.

use cloth_deformer::{Cause, Crossing, Warning};

/// A warning in the words of the command line. `sixtieths`: how many times 1/60 s a step is, by which `--substeps` counts.
pub(crate) fn describe(warning: Warning, sixtieths: f32) -> String {
    match warning {
        Warning::BendingLimited { vertices } => {
            format!("bending is softened at {vertices} vertices to stay stable; more --substeps would bring it all")
        }
        Warning::ExplicitLimit { substeps, needed } => {
            let enough = (needed as f32 / sixtieths).ceil();
            format!("springs are unstable at {substeps} substeps a frame; take --substeps {enough}, or --method small-steps")
        }
        Warning::Slivers { edges, worst: [a, b] } => {
            format!(
                "{edges} edges are a hundred times shorter than their triangles, the worst between vertices {a} and {b}; merge their ends"
            )
        }
        Warning::Crossings { pairs, first: Crossing { edge: [a, b], triangle: [c, d, e], .. } } => {
            format!(
                "{pairs} edges go through triangles where contact begins, the first between vertices {a} and {b} through {c}, {d}, {e}; they are let go until they part"
            )
        }
        Warning::StrainMissed { stretch, promised, cause } => {
            let because = match cause {
                Cause::Pins => "by pins that are jerked",
                Cause::Collider => "by a fast collider",
                Cause::Wind => "by the wind",
                _ => "in its motion",
            };
            let [stretch, promised] = [stretch, promised].map(|share| 100.0 * share);
            format!(
                "the cloth was stretched by {stretch:.1} %, more than the {promised:.1} % it is held to, {because}; move it more slowly, or name more substeps"
            )
        }
        Warning::PinOutruns { pin, speed, carried } => {
            format!(
                "pin {pin} is led at {speed:.1} m/s, but {carried:.1} m/s is what the substeps carry on; lead it more slowly, or take more"
            )
        }
        Warning::ColliderOutruns { collider, speed, carried } => {
            format!(
                "collider {collider} moves at {speed:.1} m/s, but {carried:.1} m/s is what the substeps carry on; move it more slowly, or take more"
            )
        }
        Warning::BodyCrossings { pairs, collider } => {
            format!(
                "{pairs} edges and triangles of the cloth and of bodies go through one another where contact begins, the first of collider {collider}; they are let go until they part"
            )
        }
        Warning::ContactOutruns { speed, resolved } => {
            format!(
                "pins or bodies move against one another at {speed:.1} m/s, but {resolved:.1} m/s is what contact resolves with these substeps; lead them more slowly, or take more"
            )
        }
        other => format!("{other:?}"),
    }
}
