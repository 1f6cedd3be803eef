//! The part of contact's state that is saved, so that a run can be continued: the lists, their multipliers, and the
//! paths of the last detection.

use std::sync::Arc;

use super::TriangleContact;
use super::bodies::Bodies;
use super::crossings::known::KnownCrossings;
use super::detection::paths::Paths;
use super::detection::rows::Rows;
use super::surface::Surface;
use super::surface::pairs::{Listed, corners};
use crate::kernels::pair::Kind;
use crate::kernels::rigid::Rigid;
use crate::model::mesh::Mesh;
use crate::record::{Recorded, Tape, Unreadable, recorded};

/// The saved state: everything that the next substep depends on. It is also kept at a step's start, to go back to if the step fails;
/// its buffers are then reused from step to step.
#[derive(Debug, Clone, Default)]
pub(crate) struct ContactPast {
    /// The bodies as their triangles were numbered, and at the end of the last step.
    pub numbered: Vec<Arc<Mesh>>,
    pub(super) bodies: Vec<Arc<Mesh>>,
    pub(super) lists: [Rows; 2],
    pub(crate) paths: Paths,
    pub(super) crossings: Vec<[u32; 2]>,
    pub(super) may_cross: bool,
    pub(crate) h: f32,
}

recorded!(ContactPast { numbered, bodies, lists, paths, crossings, may_cross, h });

/// The corners of pairs are not recorded: they follow from the cloth, see [`ContactPast::lists_on`].
impl Recorded for Rows {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let Rows { starts, later, pairs, lambda } = self;
        let mut others: Vec<u32> = pairs.iter().map(|pair| pair.other).collect();
        let mut thickness: Vec<f32> = pairs.iter().map(|pair| pair.thickness).collect();
        starts.record(tape)?;
        later.record(tape)?;
        others.record(tape)?;
        thickness.record(tape)?;
        lambda.record(tape)?;
        if [thickness.len(), lambda.len()] != [others.len(); 2] {
            return Err(Unreadable);
        }
        let pair = |(other, thickness)| Listed { corners: [0; 4], other, thickness };
        if let Tape::In(_) = tape {
            *pairs = others.into_iter().zip(thickness).map(pair).collect();
        }
        Ok(())
    }
}

impl ContactPast {
    /// Number of listed pairs.
    #[cfg(feature = "gpu")]
    pub(crate) fn pairs(&self) -> usize {
        self.lists.iter().map(|rows| rows.pairs.len()).sum()
    }

    /// The lists on a surface with this many vertices. `None` if the state cannot belong to it.
    pub(super) fn lists_on(&self, surface: &Surface, vertices: usize) -> Option<[Rows; 2]> {
        let (edges, triangles) = (surface.edges.len(), surface.triangles.len());
        let crosses = |&[edge, triangle]: &[u32; 2]| (edge as usize) < edges && (triangle as usize) < triangles;
        if !self.paths.are_of(vertices) || !self.crossings.iter().all(crosses) {
            return None;
        }
        let [of_vertices, of_edges] = &self.lists;
        let of_vertices = rows(surface, Kind::VertexTriangle, of_vertices, [vertices, triangles])?;
        Some([of_vertices, rows(surface, Kind::EdgeEdge, of_edges, [edges; 2])?])
    }

    /// Keeps where the bodies are, and what crosses.
    pub(super) fn keep(&mut self, bodies: &Bodies, crossings: &KnownCrossings) {
        self.numbered.clone_from(&bodies.numbered);
        self.bodies.clone_from(&bodies.last);
        self.crossings.clone_from(&crossings.pairs);
        self.may_cross = !crossings.are_all;
    }

    /// Goes back to where the bodies were, and to what crossed. Returns false, and changes nothing, if these are other bodies.
    pub(super) fn put_back(&self, bodies: &mut Bodies, crossings: &mut KnownCrossings, surface: &Surface) -> bool {
        if !bodies.go_back(&self.bodies) {
            return false;
        }
        if crossings.pairs != self.crossings {
            crossings.take(self.crossings.clone(), surface);
        }
        crossings.are_all = !self.may_cross;
        true
    }

    /// Applies a rigid motion of the whole cloth.
    pub(crate) fn warp(&mut self, rigid: &Rigid) {
        self.paths.warp(rigid);
        self.lists.iter_mut().for_each(|rows| rigid.vectors4(&mut rows.lambda));
        // Bodies do not move with the cloth, so pairs with them must be detected again.
        if !self.bodies.is_empty() {
            self.paths.forget();
            self.may_cross = true;
        }
    }
}

impl TriangleContact {
    /// Keeps what a failed step is to leave as it was.
    pub(crate) fn save(&mut self) {
        let mut checkpoint = std::mem::take(&mut self.checkpoint);
        self.save_to(&mut checkpoint);
        self.checkpoint = checkpoint;
    }

    /// Goes back to where the last step began.
    pub(crate) fn roll_back(&mut self) {
        self.checkpoint.put_back(&mut self.bodies, &mut self.crossings, &self.surface);
        let ContactPast { lists, paths, h, .. } = &self.checkpoint;
        self.lists.iter_mut().zip(lists).for_each(|(rows, saved)| rows.copy_from(saved));
        self.paths.copy_from(paths);
        self.contacts.forget();
        (self.detection.is_fitted, self.h) = (false, *h);
    }

    pub(crate) fn past(&self) -> ContactPast {
        let mut past = ContactPast::default();
        self.save_to(&mut past);
        past
    }

    fn save_to(&self, past: &mut ContactPast) {
        let TriangleContact {
            bodies,
            lists,
            paths,
            crossings,
            h,
            // These follow from the cloth and the options, or are recomputed in each substep.
            kinematics_moved: _,
            surface: _,
            friction: _,
            trees: _,
            detection: _,
            contacts: _,
            push: _,
            max_carry: _,
            too_many: _,
            tally: _,
            checkpoint: _,
        } = self;
        past.keep(bodies, crossings);
        past.lists.iter_mut().zip(lists).for_each(|(saved, rows)| saved.copy_from(rows));
        past.paths.copy_from(paths);
        past.h = *h;
    }

    /// Continues from a saved state. Returns false, and changes nothing, if the state cannot belong to this cloth.
    pub(crate) fn resume(&mut self, past: &ContactPast) -> bool {
        let TriangleContact { surface, bodies, crossings, .. } = self;
        let lists = past.lists_on(surface, surface.piece.len()).filter(|_| past.put_back(bodies, crossings, surface));
        let Some(lists) = lists else { return false };
        self.contacts.forget();
        self.detection.is_fitted = false;
        (self.lists, self.paths, self.h) = (lists, past.paths.clone(), past.h);
        true
    }
}

/// Saved lists with this many rows and second features, with the corners of their pairs. `None` if they cannot belong to this cloth.
fn rows(surface: &Surface, kind: Kind, rows: &Rows, [features, other_features]: [usize; 2]) -> Option<Rows> {
    let Rows { starts, later, pairs, .. } = rows;
    let is_whole = starts.is_empty() && pairs.is_empty() && later.is_empty()
        || starts.len() == features + 1
            && starts.is_sorted()
            && starts[0] == 0
            && starts[features] as usize + later.len() == pairs.len()
            && later.iter().all(|&first| (first as usize) < features)
            && pairs.iter().all(|pair| (pair.other as usize) < other_features);
    if !is_whole {
        return None;
    }
    let mut whole = rows.clone();
    for (first, pair) in rows.row_of_each().zip(&mut whole.pairs) {
        pair.corners = corners(surface, kind, [first, pair.other]);
    }
    Some(whole)
}
