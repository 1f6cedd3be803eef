//! Warnings as sentences: what happened. What helps depends on the program, and is in the docs of each warning.

use std::fmt;

use super::{Cause, Crossing, Warning};

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Cause::Pins => "by accelerated pins",
            Cause::Collider => "by a fast collider",
            Cause::Wind => "by the wind",
            Cause::Slivers => "by edges a hundred times shorter than their triangles",
            Cause::Crossings => "where it crosses itself or a body",
            Cause::Squeezed => "where bodies or pins leave it less room than its thickness",
            Cause::Motion => "by its weight or motion, or between what holds it",
        })
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Warning::BendingLimited { vertices } => {
                write!(f, "bending is softened at {vertices} vertices to stay stable")
            }
            Warning::ExplicitLimit { substeps, needed } => {
                write!(f, "springs are unstable at {substeps} substeps, and stable from {needed} on")
            }
            Warning::StrainMissed { stretch, promised, cause } => {
                let [stretch, promised] = distinct([stretch, promised].map(|share| 100.0 * f64::from(share)));
                write!(
                    f,
                    "the cloth was stretched by {stretch} % beyond the fabric's own stretch, more than the bound of {promised} %, {cause}"
                )
            }
            Warning::Slivers { edges, worst: [a, b] } => {
                write!(
                    f,
                    "{edges} edges are a hundred times shorter than their triangles, the worst between vertices {a} and {b}"
                )
            }
            Warning::PinOutruns { pin, speed, carried } => {
                let [speed, carried] = distinct([speed, carried].map(f64::from));
                write!(
                    f,
                    "pin {pin} moves at {speed} m/s, faster than the {carried} m/s that the cloth can follow with these substeps"
                )
            }
            Warning::ColliderOutruns { collider, speed, carried } => {
                let [speed, carried] = distinct([speed, carried].map(f64::from));
                write!(
                    f,
                    "collider {collider} and the cloth meet at {speed} m/s, faster than the {carried} m/s that the cloth can follow with these substeps"
                )
            }
            Warning::ContactOutruns { speed, resolved } => {
                let [speed, resolved] = distinct([speed, resolved].map(f64::from));
                write!(
                    f,
                    "pins or mesh colliders move relative to each other at {speed} m/s, faster than the {resolved} m/s that contact resolves with these substeps"
                )
            }
            Warning::BodyCrossings { pairs, collider } => {
                write!(
                    f,
                    "cloth and mesh colliders cross in {pairs} pairs of an edge and a triangle, the first with collider {collider}; contact ignores them until they have separated"
                )
            }
            Warning::Crossings { pairs, first: Crossing { edge: [a, b], triangle: [c, d, e] } } => {
                write!(
                    f,
                    "{pairs} edges pass through triangles, the first the edge between vertices {a} and {b} through triangle {c}, {d}, {e}; contact ignores them until they have separated"
                )
            }
        }
    }
}

/// Two numbers with one decimal, or with as many as show which is larger.
fn distinct(numbers: [f64; 2]) -> [String; 2] {
    let with = |decimals: usize| numbers.map(|number| format!("{number:.decimals$}"));
    // More decimals tell no numbers in single precision apart.
    (1..16).map(with).find(|[a, b]| a != b).unwrap_or_else(|| with(1))
}
