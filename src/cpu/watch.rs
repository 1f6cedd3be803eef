//! Stability checks of the result of a step. The tasks of its last substep test each vertex against bounds within which
//! neither the kinetic energy nor any edge can be too large. Only if a vertex is beyond them are energies added up and
//! edges measured.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use glam::{Vec3A, Vec4};

use crate::error::failure::Defect;
use crate::kernels::integrate::xyz;
use crate::kernels::limits::MAX_POSITION;
use crate::kernels::params::Params;
use crate::kernels::watch::{energy_share, is_long};
use crate::model::cloth::Cloth;
use crate::step::watch::{FEWEST_CHECKED, TURNS};

/// Half the edge of a cube whose points are less than 1 apart: less than `1 / (2 sqrt 3)`, for rounding errors.
const CUBE: f32 = 0.28;
/// A vector whose components are less than this is shorter than 1: less than `1 / sqrt 3`, likewise.
const COMPONENT: f32 = 0.57;

/// What the tasks of a step have found so far.
pub(crate) struct VertexWatch {
    /// Index of the first vertex out of bounds; `usize::MAX` if there is none.
    lost: AtomicUsize,
    /// Whether a vertex is so fast or so far away that energies and edges must be looked at.
    is_suspicious: AtomicBool,
    /// A vertex at the step's start (m), and how far (m) others may be from it along each axis.
    pub center: Vec3A,
    pub distance: f32,
    /// How far (m) a vertex may move along each axis in a substep.
    pub travel: f32,
}

impl VertexWatch {
    /// Nothing yet, in a step from the positions `x` (m).
    pub(crate) fn nothing(params: &Params, x: &[Vec4]) -> VertexWatch {
        // A vertex that cannot move may be far from the cloth.
        let center = x.iter().find(|x| x.w > 0.0).map_or(Vec3A::ZERO, |&x| xyz(x));
        // All within the cube are then within the bounds of positions, too.
        let within = MAX_POSITION - center.abs().max_element();
        VertexWatch {
            lost: AtomicUsize::new(usize::MAX),
            is_suspicious: AtomicBool::new(false),
            center,
            distance: within.min(CUBE * params.longest_edge),
            travel: (COMPONENT / params.per_length).min(MAX_POSITION),
        }
    }

    /// Checks one vertex, now at `x` (m), which moved by `u` (m) in the last substep.
    pub(crate) fn check(&self, vertex: usize, x: Vec3A, u: Vec3A) {
        let within = |v: Vec3A, most: f32| v.abs().cmplt(Vec3A::splat(most)).all();
        // Written so that NaN, which compares false, also counts as out of bounds.
        if !(within(x - self.center, self.distance) && within(u, self.travel)) {
            self.is_suspicious.store(true, Ordering::Relaxed);
            if !(within(x, MAX_POSITION) && within(u, MAX_POSITION)) {
                self.lost.fetch_min(vertex, Ordering::Relaxed);
            }
        }
    }

    /// The most severe defect, if there is any, given the state at the end of a step that follows this many `steps`.
    pub(crate) fn verdict(self, cloth: &Cloth, params: &Params, steps: u32, x: &[Vec4], u: &[Vec4]) -> Option<Defect> {
        let lost = self.lost.into_inner();
        if lost < usize::MAX {
            return Some(Defect::Lost(lost));
        }
        if !self.is_suspicious.into_inner() {
            return None;
        }
        let share = |(u, &mass): (&Vec4, &f32)| {
            let of = |u| f64::from(energy_share(u, mass, params.per_length, params.per_mass));
            of(u.x) + of(u.y) + of(u.z)
        };
        let is_fast = |index: usize| x[index].w > 0.0 && (xyz(u[index]) * params.per_length).length_squared() > 1.0;
        let mut fast = u.iter().zip(&cloth.mass).enumerate().filter(|&(index, _)| is_fast(index)).peekable();
        if let Some(&(first, _)) = fast.peek()
            && fast.map(|(_, of)| share(of)).sum::<f64>() >= 1.0
        {
            return Some(Defect::Energy(first));
        }
        overlong(cloth, params.longest_edge, steps, x).map(Defect::Edge)
    }
}

/// The first edge that is longer than `longest` (m). Each step looks at another part of the edges, 1 in [`TURNS`] but at
/// least [`FEWEST_CHECKED`]: parts of a cloth may be far from each other for good.
fn overlong(cloth: &Cloth, longest: f32, steps: u32, x: &[Vec4]) -> Option<usize> {
    let edges = cloth.swept();
    let each = edges.len().div_ceil(TURNS).max(FEWEST_CHECKED);
    let first = steps as usize % edges.len().div_ceil(each).max(1) * each;
    // An edge without stiffness may have any length.
    let mut part = edges.iter().enumerate().skip(first).take(each).filter(|(_, edge)| cloth.stiffness(edge) > 0.0);
    let is_overlong = |ends: [u32; 2]| is_long(xyz(x[ends[0] as usize]) - xyz(x[ends[1] as usize]), longest);
    part.find(|(_, edge)| is_overlong(edge.ends)).map(|(place, _)| place)
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_watch.rs"]
mod tests;
