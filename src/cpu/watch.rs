//! Stability checks by the tasks of a step: vertices out of bounds, edges that are too long, and the total kinetic
//! energy.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use glam::Vec4;

use crate::cpu::partition::Piece;
use crate::cpu::tasks::shared::View;
use crate::error::failure::Cause;
use crate::kernels::integrate::xyz;
use crate::kernels::params::Params;
use crate::kernels::watch::is_long;
use crate::model::cloth::Cloth;
use crate::step::watch::{LEAST, TURNS};

/// The allowed kinetic energy as a fixed-point number. Integer sums do not depend on the order in which tasks add.
const WHOLE: f64 = (1_u64 << 40) as f64;

/// The defects that the tasks of a step have found so far.
#[derive(Debug)]
pub(crate) struct Found {
    /// Index of the first vertex out of bounds; `usize::MAX` if there is none.
    lost: AtomicUsize,
    /// Index of the first edge that is too long; `usize::MAX` if there is none.
    long: AtomicUsize,
    /// Kinetic energy in units of the allowed energy over [`WHOLE`].
    energy: AtomicU64,
}

impl Found {
    pub(crate) fn nothing() -> Found {
        Found { lost: AtomicUsize::new(usize::MAX), long: AtomicUsize::new(usize::MAX), energy: AtomicU64::new(0) }
    }

    /// Records a vertex that is out of bounds.
    pub(crate) fn report_lost(&self, vertex: usize) {
        self.lost.fetch_min(vertex, Ordering::Relaxed);
    }

    /// Adds to the kinetic energy, in shares of the allowed energy.
    pub(crate) fn add(&self, share: f32) {
        self.energy.fetch_add((f64::from(share.min(1.0)) * WHOLE) as u64, Ordering::Relaxed);
    }

    /// Checks the length that edges have once their vertices have moved. Each step checks another part of a piece's
    /// edges, 1 in [`TURNS`] but at least [`LEAST`].
    pub(crate) fn check_edges(&self, cloth: &Cloth, piece: &Piece, step: u32, x: View<'_>, u: View<'_>, longest: f32) {
        let each = piece.edges.len().div_ceil(TURNS).max(LEAST);
        let turns = piece.edges.len().div_ceil(each).max(1);
        let Some(edges) = piece.edges.chunks(each).nth(step as usize % turns) else { return };
        for &place in edges {
            let link = &cloth.links[place as usize];
            let [a, b] = link.ends.map(|end| xyz(x.get(end as usize)) + xyz(u.get(end as usize)));
            // An edge without stiffness may have any length.
            if link.stiffness > 0.0 && is_long(a - b, longest) {
                self.long.fetch_min(place as usize, Ordering::Relaxed);
            }
        }
    }

    /// The most severe defect, if any was found, given the state at the step's end.
    pub(crate) fn verdict(self, params: &Params, x: &[Vec4], u: &[Vec4]) -> Option<Cause> {
        let (lost, long) = (self.lost.into_inner(), self.long.into_inner());
        if lost < usize::MAX {
            return Some(Cause::Lost(lost));
        }
        if self.energy.into_inner() as f64 >= WHOLE {
            let is_fast = |(x, u): (&Vec4, &Vec4)| x.w > 0.0 && (xyz(*u) * params.per_length).length_squared() > 1.0;
            return Some(Cause::Energy(x.iter().zip(u).position(is_fast).unwrap_or(0)));
        }
        (long < usize::MAX).then_some(Cause::Edge(long))
    }
}
