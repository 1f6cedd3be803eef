//! Formats warnings, one line each.

use std::mem;

use cloth_deformer::{Cause, Collider, Mesh, Shape, Warning};

use crate::named;

/// Formats a warning in terms of the command line, where colliders are numbered from 1 as in scenes, with what helps. `sixtieths` is the
/// length of a step in units of 1/60 s, by which `--substeps` counts, and `untangles` says whether the run does that already.
fn describe(mut warning: Warning, sixtieths: f32, untangles: bool) -> String {
    if let Warning::ColliderOutruns { collider, .. } | Warning::BodyCrossings { collider, .. } = &mut warning {
        *collider += 1;
    }
    let remedy = match warning {
        Warning::BendingLimited { .. } => "use more --substeps for its full stiffness",
        Warning::ExplicitLimit { needed, .. } => {
            let enough = (needed as f32 / sixtieths).ceil();
            return format!("{warning}; use --substeps {enough}, or --method small-steps");
        }
        Warning::Slivers { .. } => "merge their ends",
        Warning::Crossings { .. } | Warning::BodyCrossings { .. } if untangles => {
            "--untangle tries again; if they stay, give them more room"
        }
        Warning::Crossings { .. } | Warning::BodyCrossings { .. } => "--untangle helps them",
        Warning::StrainMissed { cause, .. } => match cause {
            Cause::Slivers => "merge their ends, or ask for more --substeps",
            Cause::Crossings if untangles => "give it more room",
            Cause::Crossings => "give it more room, and use --untangle",
            Cause::Squeezed => "give it more room, a smaller thickness (--self-contact METERS), or ask for more --substeps",
            Cause::Wind => "let it blow less hard, or ask for more --substeps",
            Cause::Pins | Cause::Collider => "move them more slowly, or ask for more --substeps",
            _ => "ask for more --substeps, or bring what holds it closer together",
        },
        Warning::PinOutruns { .. } | Warning::ColliderOutruns { .. } => "move it more slowly, or ask for more --substeps",
        _ => "move them more slowly, or ask for more --substeps",
    };
    format!("{warning}; {remedy}")
}

/// Whether a warning says that something crosses.
pub(crate) fn is_of_crossings(warning: &Warning) -> bool {
    matches!(warning, Warning::Crossings { .. } | Warning::BodyCrossings { .. })
}

/// The warnings of a run by their kinds.
pub(crate) struct Warned {
    /// As for [`describe`].
    sixtieths: f32,
    untangles: bool,
    kinds: Vec<Kind>,
    /// The texts of those that are not in the report yet.
    texts: Vec<String>,
}

/// A kind of warning: its worst one with its frame, the last frame that had one, and how many frames had one.
struct Kind {
    worst: (Warning, i64),
    last: i64,
    frames: u32,
}

impl Warned {
    /// No warnings yet.
    pub(crate) fn new(sixtieths: f32, untangles: bool) -> Warned {
        Warned { sixtieths, untangles, kinds: Vec::new(), texts: Vec::new() }
    }

    /// Adds a warning of a frame. Returns its text if it is the first of its kind: a limit exceeded in one frame is exceeded in
    /// most of the following.
    pub(crate) fn add(&mut self, frame: i64, warning: Warning) -> Option<String> {
        let text = describe(warning, self.sixtieths, self.untangles);
        self.texts.push(if frame < 1 { format!("{}: {text}", named(frame)) } else { text.clone() });
        let is_same = |kind: &&mut Kind| mem::discriminant(&kind.worst.0) == mem::discriminant(&warning);
        let Some(kind) = self.kinds.iter_mut().find(is_same) else {
            self.kinds.push(Kind { worst: (warning, frame), last: frame, frames: 1 });
            return Some(text);
        };
        if amount(&warning).0 > amount(&kind.worst.0).0 {
            kind.worst = (warning, frame);
        }
        (kind.last, kind.frames) = (frame, kind.frames + 1);
        None
    }

    /// The texts of the warnings for the next row of the report, with those of the preroll in the first.
    pub(crate) fn texts(&mut self) -> &mut Vec<String> {
        &mut self.texts
    }

    /// A line for each kind that there were several of, unless it is of something that does not change.
    pub(crate) fn repeated(&self) -> Vec<String> {
        let several = self.kinds.iter().filter(|kind| kind.frames > 1);
        let line = |Kind { worst: (worst, at), last, frames }: &Kind| {
            let (title, (_, most)) = (title(worst)?, amount(worst));
            Some(format!("{title} in {frames} frames, {most} in {}, the last of them {}", named(*at), named(*last)))
        };
        several.filter_map(line).collect()
    }
}

/// How bad a warning is among those of its kind, as a number and in words.
fn amount(warning: &Warning) -> (f64, String) {
    match *warning {
        Warning::Crossings { pairs, .. } | Warning::BodyCrossings { pairs, .. } => {
            (pairs as f64, format!("most with {pairs} pairs"))
        }
        Warning::StrainMissed { stretch, .. } => (stretch.into(), format!("most by {:.1} %", 100.0 * stretch)),
        Warning::PinOutruns { speed, .. } | Warning::ColliderOutruns { speed, .. } | Warning::ContactOutruns { speed, .. } => {
            (speed.into(), format!("most with {speed:.1} m/s"))
        }
        _ => (0.0, String::new()),
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
