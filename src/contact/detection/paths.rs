//! The straight paths that detection assumes for the vertices, and the test whether vertices are still close to them.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::{Vec3A, Vec4};

use crate::contact::VERTICES_OF_PART;
use crate::contact::input::Path;
use crate::contact::surface::Surface;
use crate::kernels::integrate::xyz;
use crate::kernels::rigid::Rigid;
use crate::record::recorded;
use crate::simd::{self, Loop, Registers, Width, load_vectors};

/// Number of substeps for which a vertex should stay close to its path, extrapolated from how far it strayed before.
pub(crate) const LASTS: f32 = 16.0;
/// The same while anything crosses: pairs that cross are let go and held again when detection runs, and with fewer detections cloth snaps
/// free at several times the speed.
pub(crate) const LASTS_CROSSED: f32 = 12.0;
/// Least share of the last margin that a new margin keeps.
pub(crate) const MARGIN_DECAY: f32 = 0.8;
/// Range of the number of substeps that detection looks ahead.
pub(crate) const AHEAD: [f32; 2] = [6.0, 64.0];
/// Factor by which detection looks farther ahead if the last paths lasted as long as they should.
pub(crate) const FARTHER_AHEAD: f32 = 1.5;
/// Share of the distance that it may stray, from which on a vertex gets a new path when others do.
const NEARLY: f32 = 0.75;
/// Share of all vertices up to which only those get new paths that strayed.
const FEW: f32 = 0.01;
/// Factor by which such a vertex may stray farther.
const LONGER: f32 = 1.5;
/// Share of its margin by which the path of a vertex may lead away from where it is about to move.
const ASIDE: f32 = 0.9;
/// Number of vertices from which the common deviation is estimated.
pub(crate) const SAMPLES: usize = 32;

/// The paths since the last detection.
#[derive(Debug, Clone, Default)]
pub(crate) struct Paths {
    pub from: Vec<Vec4>,
    /// Displacement per substep (m); w is the inverse of the distance that the vertex may stray (1/m).
    pub by: Vec<Vec4>,
    /// The margin of each vertex: how far (m) it may stray.
    pub margin: Vec<f32>,
    /// The number of substeps that the paths cover, and how many of them are over; `None` before the first detection.
    pub ahead: f32,
    pub since: Option<f32>,
    /// How many vertices got new paths since.
    pub renewed: u32,
}

recorded!(Paths { from, by, margin, ahead, since, renewed });

/// What is known of the last list of pairs: whether it is short or long, and whether anything crosses.
pub(crate) struct Last {
    pub is_short: bool,
    pub is_long: bool,
    pub crosses: bool,
}

impl Paths {
    /// Becomes other paths, in its own buffers.
    pub(crate) fn copy_from(&mut self, other: &Paths) {
        self.from.clone_from(&other.from);
        self.by.clone_from(&other.by);
        self.margin.clone_from(&other.margin);
        (self.ahead, self.since, self.renewed) = (other.ahead, other.since, other.renewed);
    }

    /// Whether these are valid paths of this many vertices, or there are none.
    pub(crate) fn are_of(&self, vertices: usize) -> bool {
        let Paths { from, by, margin, since, .. } = self;
        let counts = [from.len(), by.len(), margin.len()];
        counts == [vertices; 3] || counts == [0; 3] && since.is_none()
    }

    /// Applies a rigid motion of the whole cloth.
    pub(crate) fn warp(&mut self, rigid: &Rigid) {
        rigid.points4(&mut self.from);
        rigid.vectors4(&mut self.by);
    }

    /// Discards the paths, because the state was replaced.
    pub(crate) fn forget(&mut self) {
        self.since = None;
    }

    /// Ends the paths, so that the next substep starts new ones.
    pub(crate) fn end(&mut self) {
        self.ahead = 0.0;
    }

    /// Whether any vertex from this one on moves along its path.
    pub(crate) fn move_from(&self, first: usize) -> bool {
        self.by.get(first..).is_some_and(|by| by.iter().any(|by| xyz(*by) != Vec3A::ZERO))
    }

    /// Whether all vertices will be close to their paths after this substep. Of cloth that [floats](Path::floats), the mean deviation
    /// is subtracted first: a common translation brings no two vertices closer to each other.
    pub(crate) fn are_followed(&self, path: Path<'_>, width: Width) -> bool {
        let Some(since) = self.since else { return false };
        if since >= self.ahead || self.from.len() < path.x.len() {
            return false;
        }
        let (substeps, [common, _]) = (since + 1.0, self.common(path));
        let all = AtomicBool::new(true);
        let test = |[x, u, from, by]: [&[Vec4]; 4]| simd::run(width, OnPath { x, u, from, by, substeps, common, all: &all });
        let (count, part) = (path.x.len(), path.workers.part(path.x.len(), VERTICES_OF_PART));
        let state = path.x.chunks(part).zip(path.u.chunks(part));
        let paths = self.from[..count].chunks(part).zip(self.by[..count].chunks(part));
        path.workers.each(state.zip(paths), |((x, u), (from, by))| test([x, u, from, by]));
        all.into_inner()
    }

    /// Finds the vertices that have strayed, or will soon. Returns false if these are many, or if the paths are over.
    pub(crate) fn strayed(&self, path: Path<'_>, strayed: &mut Vec<u32>) -> bool {
        strayed.clear();
        if self.since.is_none_or(|since| since >= self.ahead) || self.from.len() < path.x.len() {
            return false;
        }
        let [common, _] = self.common(path);
        let most = ((FEW * path.x.len() as f32) as usize).saturating_sub(self.renewed as usize);
        let is_near =
            |vertex: usize| ((self.strayed_by(path, vertex) - common) * self.by[vertex].w).length_squared() < NEARLY * NEARLY;
        strayed.extend((0..path.x.len()).filter(|&vertex| !is_near(vertex)).take(most + 1).map(|vertex| vertex as u32));
        strayed.len() <= most
    }

    /// Starts new paths for some vertices, as if they had been on them since the last detection; `pressed` as in [`Paths::begin`].
    pub(crate) fn restart(&mut self, vertices: &[u32], path: Path<'_>, pressed: &[bool], surface: &Surface, least: f32) {
        let [common, rate] = self.common(path);
        let steps = self.since.map_or(0.0, |since| since + 1.0);
        self.renewed += vertices.len() as u32;
        for vertex in vertices.iter().map(|&vertex| vertex as usize) {
            let (x, u, most) = (xyz(path.x[vertex]), xyz(path.u[vertex]), surface.max_margin[vertex]);
            let margin = (LONGER * self.margin[vertex]).clamp(least.min(most), most);
            let (by, margin) = if pressed[vertex] {
                let mean = self.mean_motion(vertex, x).map(|mean| mean - common / steps.max(1.0));
                led_on(mean, u - rate, [margin, most])
            } else {
                (u - rate, margin)
            };
            self.from[vertex] = (x + u - by * steps - common).extend(self.from[vertex].w);
            self.by[vertex] = by.extend(inverse(margin));
            self.margin[vertex] = margin;
        }
    }

    /// How much farther (m) than it may a vertex at `x` with the displacement `u` (m) gets from its path in this substep, which is
    /// counted already.
    pub(crate) fn drift<'a>(&'a self, path: Path<'_>) -> impl Fn(usize, Vec3A, Vec3A) -> f32 + Sync + use<'a> {
        let over = self.since.unwrap_or_default();
        let strayed = move |vertex: usize, x: Vec3A, u: Vec3A| x - xyz(self.from[vertex]) + (u - xyz(self.by[vertex]) * over);
        let common =
            mean_of(path.floats.then_some(path.x.len()), |vertex| strayed(vertex, xyz(path.x[vertex]), xyz(path.u[vertex])));
        move |vertex, x, u| (strayed(vertex, x, u) - common).length() - self.margin[vertex]
    }

    /// The vector (m) by which a vertex will have strayed after this substep.
    fn strayed_by(&self, path: Path<'_>, vertex: usize) -> Vec3A {
        let steps = self.since.map_or(0.0, |since| since + 1.0);
        (xyz(path.x[vertex]) - xyz(self.from[vertex])) + (xyz(path.u[vertex]) - xyz(self.by[vertex]) * steps)
    }

    /// An estimate of the common deviation (m), from a few vertices, and its growth in this substep; zero unless the cloth
    /// [floats](Path::floats). Accuracy does not matter: subtracting the same vector from all vertices is always valid.
    fn common(&self, path: Path<'_>) -> [Vec3A; 2] {
        let growth = |vertex: usize| xyz(path.u[vertex]) - xyz(self.by[vertex]);
        let of = path.x.len();
        [mean_of(path.floats.then_some(of), |vertex| self.strayed_by(path, vertex)), mean_of(path.floats.then_some(of), growth)]
    }

    /// Chooses the margin of each vertex from how far it strayed since the last detection, so that the next paths
    /// last; if the list is short, the margins are the largest that the surface allows. Looks farther ahead if the last paths
    /// lasted, unless the list is long already.
    pub(crate) fn adapt(&mut self, path: Path<'_>, last: Last, surface: &Surface, least: f32) {
        let Last { is_short, is_long, crosses } = last;
        let most = &surface.max_margin;
        let known = self.since.filter(|_| self.from.len() == path.x.len() && !is_short);
        let mut margin = std::mem::take(&mut self.margin);
        margin.resize(path.x.len(), 0.0);
        if let Some(since) = known {
            let [common, _] = self.common(path);
            let lasts = if crosses { LASTS_CROSSED } else { LASTS };
            let longer = (lasts / (since + 1.0)).max(1.0).powf(1.5);
            path.workers.chunks(&mut margin, VERTICES_OF_PART, |first, margin| {
                for (vertex, margin) in (first..).zip(margin) {
                    let far = (self.strayed_by(path, vertex) - common).length() * longer;
                    *margin = far.max(MARGIN_DECAY * *margin).clamp(least.min(most[vertex]), most[vertex]);
                }
            });
        } else {
            margin.copy_from_slice(most);
        }
        self.margin = margin;
        self.ahead = ahead_after(self.since, self.ahead, is_long);
    }

    /// The next paths have these margins (m), for one substep.
    pub(crate) fn cover(&mut self, margin: &[f32]) {
        self.margin.copy_from_slice(margin);
        self.ahead = 1.0;
    }

    /// Starts new paths. Vertices that are `pressed` against something are about to move into it in every substep, and do not.
    /// Therefore their paths lead on as they have moved on average, and their margins cover the difference, as far as the surface
    /// allows.
    pub(crate) fn begin(&mut self, x: &[Vec4], u: &[Vec4], pressed: &[bool], surface: &Surface) {
        let mut by = std::mem::take(&mut self.by);
        by.clear();
        by.extend(u.iter().zip(&self.margin).map(|(u, &margin)| u.with_w(inverse(margin))));
        let is_known = self.from.len() == x.len();
        for vertex in pressed.iter().enumerate().filter_map(|(vertex, &is)| (is && is_known).then_some(vertex)) {
            let mean = self.mean_motion(vertex, xyz(x[vertex]));
            let (way, margin) = led_on(mean, xyz(u[vertex]), [self.margin[vertex], surface.max_margin[vertex]]);
            (self.margin[vertex], by[vertex]) = (margin, way.extend(inverse(margin)));
        }
        self.by = by;
        self.from.clear();
        self.from.extend_from_slice(x);
        (self.since, self.renewed) = (Some(0.0), 0);
    }

    /// The mean displacement per substep (m) of a vertex since its path began, unless that is just now.
    fn mean_motion(&self, vertex: usize, x: Vec3A) -> Option<Vec3A> {
        self.since.filter(|&since| since > 0.0).map(|since| (x - xyz(self.from[vertex])) / since)
    }
}

/// The displacement per substep (m) of the path of a vertex that is about to move by `u` (m) and moves by `mean`, if that is known, and
/// the margin that covers the difference, as far as a margin may be: of at least and at most so much.
fn led_on(mean: Option<Vec3A>, u: Vec3A, [least, most]: [f32; 2]) -> (Vec3A, f32) {
    let aside = mean.map_or(Vec3A::ZERO, |mean| mean - u);
    let margin = least.max(LONGER * aside.length()).min(most);
    (u + aside.clamp_length_max(ASIDE * margin), margin)
}

/// The mean of a vector of some of the vertices, whose number is given; zero if none is.
fn mean_of(vertices: Option<usize>, vector: impl Fn(usize) -> Vec3A) -> Vec3A {
    let Some(count) = vertices else { return Vec3A::ZERO };
    let samples = (0..count).step_by(count.div_ceil(SAMPLES));
    let share = 1.0 / samples.len() as f32;
    samples.map(vector).sum::<Vec3A>() * share
}

/// The inverse (1/m) of the distance that a vertex may stray. Bodies that stand still may not stray at all, and a snapshot
/// holds finite numbers only.
fn inverse(margin: f32) -> f32 {
    1.0 / margin.max(f32::MIN_POSITIVE)
}

/// The number of substeps that the next detection looks ahead, if the last one looked `ahead` and lasted `since`
/// substeps.
fn ahead_after(since: Option<f32>, ahead: f32, is_long: bool) -> f32 {
    let next = match since {
        None => AHEAD[0],
        Some(since) if since < ahead => FARTHER_AHEAD * since,
        Some(_) if is_long => ahead / FARTHER_AHEAD,
        Some(_) => FARTHER_AHEAD * ahead,
    };
    next.round().clamp(AHEAD[0], AHEAD[1])
}

/// Tests whether vertices are close enough to their paths.
struct OnPath<'a> {
    x: &'a [Vec4],
    u: &'a [Vec4],
    from: &'a [Vec4],
    by: &'a [Vec4],
    substeps: f32,
    common: Vec3A,
    all: &'a AtomicBool,
}

impl Loop for OnPath<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let (steps, common, one) = (L::splat(self.substeps), L::repeat(self.common.extend(0.0)), L::splat(1.0));
        let mut farthest = L::splat(0.0);
        let state = self.x.chunks(L::LANES).zip(self.u.chunks(L::LANES));
        let paths = self.from.chunks(L::LANES).zip(self.by.chunks(L::LANES));
        for ((x, u), (from, by)) in state.zip(paths) {
            let (x, u, from, by) = (load_vectors::<L>(x), load_vectors::<L>(u), load_vectors::<L>(from), load_vectors::<L>(by));
            // The deviations, in units of the allowed distance.
            let mut strayed = x;
            for k in 0..4 {
                let way = x[k] - from[k] - common;
                strayed[k] = (way + by[k].neg_mul_add(steps, u[k])) * by[k].w();
            }
            let strayed = L::transpose(strayed);
            // Written so that NaN counts as too far.
            farthest = L::select(strayed.dot(strayed).lt(one), farthest, L::splat(f32::INFINITY));
        }
        if !L::all(farthest.lt(one)) {
            self.all.store(false, Ordering::Relaxed);
        }
    }
}
