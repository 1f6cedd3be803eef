//! Formats warnings, one line each.

use std::mem;

use cloth_deformer::{Cause, Collider, Crossing, Mesh, Shape, Warning};

use crate::named;

/// Formats a warning in terms of the command line, where colliders are numbered from 1 as in scenes. `sixtieths` is the length of
/// a step in units of 1/60 s, by which `--substeps` counts, and `untangles` says whether the run does that already.
pub(crate) fn describe(warning: Warning, sixtieths: f32, untangles: bool) -> String {
    let parted = if untangles { "--untangle tries again; if they stay, give them more room" } else { "--untangle helps them" };
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
                "{pairs} edges pass through triangles, the first the edge between vertices {a} and {b} through triangle {c}, {d}, {e}; contact ignores them until they have separated; {parted}"
            )
        }
        Warning::StrainMissed { stretch, promised, cause } => {
            let because = match cause {
                Cause::Pins => "by accelerated pins",
                Cause::Collider => "by a fast collider",
                Cause::Wind => "by the wind",
                Cause::Slivers => "by edges a hundred times shorter than their triangles",
                Cause::Crossings => "where it crosses itself or a body",
                Cause::Squeezed => "where bodies or pins leave it less room than its thickness",
                _ => "by its weight or motion, or between what holds it",
            };
            let remedy = match cause {
                Cause::Slivers => "merge their ends, or ask for more --substeps",
                Cause::Crossings if untangles => "give it more room",
                Cause::Crossings => "give it more room, and use --untangle",
                Cause::Squeezed => "give it more room, a smaller thickness (--self-contact METRES), or ask for more --substeps",
                Cause::Wind => "let it blow less hard, or ask for more --substeps",
                Cause::Pins | Cause::Collider => "move them more slowly, or ask for more --substeps",
                _ => "ask for more --substeps, or bring what holds it closer together",
            };
            let [stretch, promised] = [stretch, promised].map(|share| 100.0 * share);
            format!("the cloth was stretched by {stretch:.1} %, more than the bound of {promised:.1} %, {because}; {remedy}")
        }
        Warning::PinOutruns { pin, speed, carried } => {
            format!(
                "pin {pin} moves at {speed:.1} m/s, faster than the {carried:.1} m/s that the cloth can follow with these substeps; move it more slowly, or ask for more --substeps"
            )
        }
        Warning::ColliderOutruns { collider, speed, carried } => {
            let number = collider + 1;
            format!(
                "collider {number} moves at {speed:.1} m/s, faster than the {carried:.1} m/s that the cloth can follow with these substeps; move it more slowly, or ask for more --substeps"
            )
        }
        Warning::BodyCrossings { pairs, collider } => {
            let number = collider + 1;
            format!(
                "cloth and mesh colliders cross in {pairs} pairs of an edge and a triangle, the first with collider {number}; contact ignores them until they have separated; {parted}"
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

/// Whether a warning says that something crosses.
pub(crate) fn is_of_crossings(warning: &Warning) -> bool {
    matches!(warning, Warning::Crossings { .. } | Warning::BodyCrossings { .. })
}

/// The warnings of a run by their kinds.
#[derive(Default)]
pub(crate) struct Warned {
    kinds: Vec<Kind>,
}

/// A kind of warning: its first one, the last frame that had one, and how many frames had one.
struct Kind {
    first: Warning,
    last: i64,
    frames: u32,
}

impl Warned {
    /// Adds a warning of a frame. Returns whether it is the first of its kind.
    pub(crate) fn add(&mut self, frame: i64, warning: Warning) -> bool {
        let is_same = |kind: &&mut Kind| mem::discriminant(&kind.first) == mem::discriminant(&warning);
        let same = self.kinds.iter_mut().find(is_same);
        let is_first = same.is_none();
        match same {
            Some(kind) => (kind.last, kind.frames) = (frame, kind.frames + 1),
            None => self.kinds.push(Kind { first: warning, last: frame, frames: 1 }),
        }
        is_first
    }

    /// A line for each kind that there were several of, unless it is of something that does not change.
    pub(crate) fn repeated(&self) -> Vec<String> {
        let several = self.kinds.iter().filter(|kind| kind.frames > 1);
        let line = |Kind { first, last, frames }: &Kind| {
            Some(format!("{} in {frames} frames, the last of them {}", title(first)?, named(*last)))
        };
        several.filter_map(line).collect()
    }
}

/// What a warning is about that may be in some frames and not in others.
fn title(warning: &Warning) -> Option<&'static str> {
    match warning {
        Warning::Crossings { .. } => Some("edges passed through triangles"),
        Warning::BodyCrossings { .. } => Some("cloth and mesh colliders crossed"),
        Warning::StrainMissed { .. } => Some("the cloth was stretched beyond the bound"),
        Warning::PinOutruns { .. } => Some("pins were too fast"),
        Warning::ColliderOutruns { .. } => Some("colliders were too fast"),
        Warning::ContactOutruns { .. } => Some("pins or mesh colliders were too fast for contact"),
        _ => None,
    }
}

/// Warns if a free vertex begins deeper inside a collider than edges are long on average: it is pushed out at
/// 1 m/s, which tears at its neighbors. Pins may be inside.
pub(crate) fn begins_inside(mesh: &Mesh, pinned: &[u32], colliders: &[Collider]) -> Option<String> {
    let edges = mesh.edges();
    let length = |&[a, b]: &[u32; 2]| mesh.positions[a as usize].distance(mesh.positions[b as usize]);
    let mean = edges.iter().map(length).sum::<f32>() / edges.len() as f32;
    let mut is_free = vec![false; mesh.positions.len()];
    edges.iter().flatten().for_each(|&vertex| is_free[vertex as usize] = true);
    pinned.iter().for_each(|&vertex| is_free[vertex as usize] = false);
    let free = (0..).zip(&mesh.positions).filter(|&(vertex, _): &(usize, _)| is_free[vertex]);
    let solid = || (1..).zip(colliders).filter(|(_, collider): &(u32, _)| !matches!(collider.shape, Shape::Mesh { .. }));
    let depths = free.flat_map(|(vertex, x)| solid().map(move |(number, collider)| (-collider.distance(*x), vertex, number)));
    let (depth, vertex, number) = depths.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|&(depth, ..)| depth > mean)?;
    Some(format!(
        "the cloth begins inside collider {number}, vertex {vertex} by {depth:.3} m, and is pushed out at 1 m/s; move one of them, or give the collider a start outside and a preroll"
    ))
}
