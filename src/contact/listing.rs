//! When pairs are listed: anew for all vertices, or around those that strayed from their paths; and what is not listed, because
//! it crosses.

use glam::{Vec3A, Vec4};

use super::TriangleContact;
use super::crossings::known::{KnownCrossings, Posed};
use super::detection::DetectionInput;
use super::detection::paths::{Last, Paths};
use super::detection::tree::DetectionScope;
use super::input::Path;
use super::surface::Surface;
use super::workers::Workers;
use crate::kernels::integrate::xyz;
use crate::simd::Width;

/// Least margin within which a vertex may stray from its path before it gets a new one, in units of the thickness.
const MIN_MARGIN: f32 = 0.1;

impl TriangleContact {
    /// Ignores the pairs of what crosses at the end of the substep because it is pinched.
    pub(crate) fn ignore_pinched(&mut self, x: &[Vec4], u: &[Vec4]) {
        let TriangleContact { surface, contacts, crossings, paths, .. } = self;
        let pinched = contacts.pinched(surface.thickness);
        if !pinched.is_empty() {
            crossings.note(&pinched, surface);
            let ends: Vec<Vec4> = x.iter().zip(u).map(|(x, u)| x + u.with_w(0.0)).collect();
            let vertices: Vec<u32> = pinched.iter().flat_map(|pair| pair.corners).collect();
            if crossings.follow(Posed { surface, x: &ends, is_shared: false }, &vertices) {
                paths.end();
            }
        }
    }

    /// Lists the pairs that may meet from here on; the first `moving` vertices may have strayed. Returns false if there are
    /// too many pairs, or if the state is not finite, which the end of the step reports.
    pub(crate) fn detect(&mut self, path: Path<'_>, moving: usize, width: Width) -> bool {
        let sum: Vec3A = path.x.iter().zip(path.u).map(|(x, u)| xyz(*x) + xyz(*u)).sum();
        if !sum.is_finite() {
            return false;
        }
        let posed = Posed { surface: &self.surface, x: path.x, is_shared: path.workers.count() > 1 };
        if self.kinematics_moved && self.crossings.are_all {
            self.crossings.are_all = !KnownCrossings::kinematics_cross(posed);
        }
        let are_all = self.crossings.look_around(posed);
        let moving_path = Path { x: &path.x[..moving], u: &path.u[..moving], ..path };
        let crosses = !are_all || !self.crossings.pairs.is_empty();
        let is_listed = !crosses && self.lists.iter().all(|rows| !rows.starts.is_empty());
        let mut strayed = std::mem::take(&mut self.detection.strayed);
        let listed = if is_listed && self.paths.strayed(moving_path, &mut strayed) {
            self.list_around(&strayed, path, width)
        } else {
            self.tally.detections += 1;
            self.list_all(path, width)
        };
        self.detection.strayed = strayed;
        if let Err(too_many) = listed {
            (self.too_many, self.detection.is_fitted) = (too_many, false);
            return false;
        }
        true
    }

    /// Lists all pairs, for new paths.
    fn list_all(&mut self, path: Path<'_>, width: Width) -> Result<(), usize> {
        let TriangleContact { surface, trees: [of_cloth, of_bodies], lists, detection, paths, bodies, .. } = self;
        let listed: usize = lists.iter().map(|rows| rows.pairs.len()).sum();
        // A short list may become longer: margins are as large as the surface allows. A list is long if it has several times as
        // many pairs as a substep works on, which are the vertices' and the near ones.
        let last = Last {
            is_short: 4 * listed < path.x.len(),
            is_long: listed > 4 * (path.x.len() + self.tally.near as usize),
            crosses: !self.crossings.pairs.is_empty(),
        };
        paths.adapt(path, last, surface, MIN_MARGIN * surface.thickness);
        let is_covered = !path.margin.is_empty();
        if is_covered {
            paths.cover(path.margin);
        }
        if bodies.are_still {
            paths.margin[bodies.first..].fill(0.0);
        }
        self.contacts.store_multipliers(lists, path.workers);
        detection.mark_pressed(lists, path.x);
        paths.begin(path.x, path.u, if is_covered { &[] } else { &detection.pressed }, surface);
        self.crossings.search(Posed { surface, x: path.x, is_shared: path.workers.count() > 1 }, &[]);
        let input = detection_input(surface, bodies.are_known, paths, path.workers, width);
        bodies.are_known = bodies.are_still;
        let crossings = &self.crossings;
        self.contacts.forget();
        detection.run(input, [of_cloth, of_bodies], lists, &|kind, first, pair| crossings.ignores(kind, first, pair))
    }

    /// Lists more pairs, around some vertices that get new paths.
    fn list_around(&mut self, strayed: &[u32], path: Path<'_>, width: Width) -> Result<(), usize> {
        let TriangleContact { surface, trees: [of_cloth, of_bodies], lists, detection, paths, bodies, .. } = self;
        if !detection.is_fitted {
            detection.fit(detection_input(surface, false, paths, path.workers, width), [of_cloth, of_bodies]);
        }
        self.contacts.store_multipliers(lists, path.workers);
        detection.mark_pressed(lists, path.x);
        paths.restart(strayed, path, &detection.pressed, surface, MIN_MARGIN * surface.thickness);
        bodies.are_known &= bodies.are_still;
        let input = detection_input(surface, false, paths, path.workers, width);
        detection.run_around(input, strayed, [of_cloth, of_bodies], lists)
    }
}

/// The input of a detection along some paths.
fn detection_input<'a>(
    surface: &'a Surface,
    bodies_rest: bool,
    paths: &'a Paths,
    workers: Workers<'a>,
    width: Width,
) -> DetectionInput<'a> {
    let path = Path { x: &paths.from, u: &paths.by, margin: &paths.margin, floats: false, workers };
    let scope = DetectionScope { substeps: paths.ahead, thickness: surface.thickness };
    DetectionInput { surface, bodies_rest, path, scope, width }
}
