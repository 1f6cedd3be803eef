//! The part of contact's state that is saved, so that a run can be continued: the lists, their multipliers, and the
//! paths of the last detection.

use std::sync::Arc;

use glam::Vec4;

use super::TriangleContact;
use super::detection::paths::Paths;
use super::detection::rows::Rows;
use super::surface::Surface;
use super::surface::pairs::{Kind, Listed, corners};
use crate::kernels::rigid::Rigid;
use crate::model::mesh::Mesh;
use crate::record::recorded;

/// The saved state: everything that the next substep depends on.
#[derive(Debug, Clone, Default)]
pub(crate) struct ContactPast {
    /// The bodies as their triangles were numbered, and at the end of the last step.
    pub numbered: Vec<Arc<Mesh>>,
    pub(super) bodies: Vec<Arc<Mesh>>,
    pub(super) lists: [ListedRows; 2],
    pub(super) paths: Paths,
    pub(super) crossings: Vec<[u32; 2]>,
    pub(super) may_cross: bool,
    pub(super) h: f32,
}

impl ContactPast {
    /// Number of listed pairs.
    #[cfg(feature = "gpu")]
    pub(crate) fn pairs(&self) -> usize {
        self.lists.iter().map(|rows| rows.others.len()).sum()
    }
}

/// [`Rows`] without the corners of pairs, which follow from the cloth.
#[derive(Debug, Clone, Default)]
pub(super) struct ListedRows {
    pub starts: Vec<u32>,
    pub later: Vec<u32>,
    pub others: Vec<u32>,
    pub thickness: Vec<f32>,
    pub lambda: Vec<Vec4>,
}

recorded!(ContactPast { numbered, bodies, lists, paths, crossings, may_cross, h });
recorded!(ListedRows { starts, later, others, thickness, lambda });

impl ContactPast {
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

/// The state at the start of a step, to go back to if the step fails. Buffers are kept from step to step.
#[derive(Debug, Default)]
pub(super) struct Checkpoint {
    bodies: Vec<Arc<Mesh>>,
    lists: [Rows; 2],
    paths: Paths,
    crossings: Vec<[u32; 2]>,
    may_cross: bool,
    h: f32,
}

impl TriangleContact {
    /// Keeps what a failed step is to leave as it was.
    pub(crate) fn save(&mut self) {
        let Checkpoint { bodies, lists, paths, crossings, may_cross, h } = &mut self.checkpoint;
        bodies.clone_from(&self.bodies.last);
        lists.iter_mut().zip(&self.lists).for_each(|(saved, rows)| saved.copy_from(rows));
        paths.copy_from(&self.paths);
        crossings.clone_from(&self.crossings.pairs);
        (*may_cross, *h) = (!self.crossings.are_all, self.h);
    }

    /// Goes back to where the last step began.
    pub(crate) fn roll_back(&mut self) {
        let Checkpoint { bodies, lists, paths, crossings, may_cross, h } = &self.checkpoint;
        self.bodies.go_back(bodies);
        self.lists.iter_mut().zip(lists).for_each(|(rows, saved)| rows.copy_from(saved));
        self.paths.copy_from(paths);
        if self.crossings.pairs != *crossings {
            self.crossings.take(crossings.clone(), &self.surface);
        }
        self.contacts.forget();
        (self.detection.is_fitted, self.crossings.are_all, self.h) = (false, !may_cross, *h);
    }

    pub(crate) fn past(&self) -> ContactPast {
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
        let rows = |rows: &Rows| ListedRows {
            starts: rows.starts.clone(),
            later: rows.later.clone(),
            others: rows.pairs.iter().map(|pair| pair.other).collect(),
            thickness: rows.pairs.iter().map(|pair| pair.thickness).collect(),
            lambda: rows.lambda.clone(),
        };
        ContactPast {
            numbered: bodies.numbered.clone(),
            bodies: bodies.last.clone(),
            lists: [rows(&lists[0]), rows(&lists[1])],
            paths: paths.clone(),
            crossings: crossings.pairs.clone(),
            may_cross: !crossings.are_all,
            h: *h,
        }
    }

    /// Continues from a saved state. Returns false, and changes nothing, if the state cannot belong to this cloth.
    pub(crate) fn resume(&mut self, past: &ContactPast) -> bool {
        let Some(lists) = past.lists_on(&self.surface, self.surface.piece.len()).filter(|_| self.bodies.go_back(&past.bodies))
        else {
            return false;
        };
        self.lists = lists;
        self.contacts.forget();
        self.crossings.take(past.crossings.clone(), &self.surface);
        self.detection.is_fitted = false;
        (self.paths, self.crossings.are_all, self.h) = (past.paths.clone(), !past.may_cross, past.h);
        true
    }
}

/// Converts saved lists with this many rows and second features. Returns `None` if they cannot belong to this cloth.
fn rows(surface: &Surface, kind: Kind, rows: &ListedRows, [features, other_features]: [usize; 2]) -> Option<Rows> {
    let ListedRows { starts, later, others, thickness, lambda } = rows;
    let is_whole = starts.is_empty() && others.is_empty() && later.is_empty()
        || starts.len() == features + 1
            && starts.is_sorted()
            && starts[0] == 0
            && starts[features] as usize + later.len() == others.len()
            && later.iter().all(|&first| (first as usize) < features)
            && others.iter().all(|&other| (other as usize) < other_features);
    if !is_whole || [thickness.len(), lambda.len()] != [others.len(); 2] {
        return None;
    }
    let in_rows = (0..).zip(starts.windows(2)).flat_map(|(first, row)| (row[0]..row[1]).map(move |_| first));
    let numbers = others.iter().zip(thickness);
    let pairs = in_rows.chain(later.iter().copied()).zip(numbers).map(|(first, (&other, &thickness))| {
        let corners = corners(surface, kind, [first, other]);
        Listed { corners, other, thickness }
    });
    Some(Rows { pairs: pairs.collect(), starts: starts.clone(), later: later.clone(), lambda: lambda.clone() })
}
