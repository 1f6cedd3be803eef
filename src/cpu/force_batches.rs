//! Forces on as many vertices, or of as many triangles, as the processor takes at once. The oracle of each loop is the function of
//! its name in `kernels.rs`, as [`Forces`](crate::cpu::forces::Forces) calls it for a test.

use std::ops::Range;

use glam::Vec4;

use crate::cpu::shared::Shared;
use crate::kernels::{BendEntry, BendRow, Panel, Params, Substep};
use crate::model::bending::Bending;
use crate::model::cloth::Cloth;
use crate::simd::aligned::Lines;
use crate::simd::{self, At, Breadth, Loop, Wide, Wide3};
use crate::step::coefficients::Coefficients;

/// What the loops need, in their order: a lane of vertices or triangles is the one at its [`simd::place`].
#[derive(Debug, Default)]
pub(crate) struct Gathers {
    lanes: usize,
    /// For as many vertices as lanes: stiffness, damping, diagonal, inverse mass, lane by lane.
    rows: Lines,
    /// Where the neighbours of those begin, and the last ones' end.
    starts: Vec<usize>,
    /// One neighbour of each of as many vertices as lanes, an item each. A vertex that has fewer than the others is its own, with no weight.
    places: Vec<Place>,
    /// Coefficients ([`BendEntry`]): forward, backward, lane by lane.
    weights: Lines,
    /// The neighbours that are not one after another, lane by lane.
    apart: Vec<u32>,
    /// For as many triangles as lanes: their masses, and corners. The last repeats itself, with no effect but on what is not used.
    masses: Lines,
    corners: Vec<u32>,
}

/// Where as many vertices as lanes are.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// One after another from here on.
    Row(u32),
    /// As `apart` says from here on.
    Apart(u32),
}

impl Gathers {
    /// Packs what a scene has.
    pub(crate) fn new(cloth: &Cloth, coefficients: &Coefficients, bending: bool, wind: bool, breadth: Breadth) -> Gathers {
        let mut gathers = Gathers { lanes: breadth.lanes(), ..Gathers::default() };
        if bending {
            gathers.pack_rows(cloth, &coefficients.bending, cloth.bending());
        }
        if wind {
            gathers.pack_panels(&cloth.panels().panels);
        }
        [&mut gathers.rows, &mut gathers.weights, &mut gathers.masses].into_iter().for_each(Lines::trim);
        gathers
    }

    fn pack_rows(&mut self, cloth: &Cloth, rows: &[BendRow], bending: &Bending) {
        let lanes = self.lanes;
        let mut entries: Vec<Vec<BendEntry>> = vec![Vec::new(); lanes];
        let (mut numbers, mut weights) = (Lines::default(), Lines::default());
        for first in (0..rows.len()).step_by(lanes) {
            let vertex = |lane: usize| first + simd::place(lane, lanes);
            for (lane, entries) in entries.iter_mut().enumerate() {
                let v = vertex(lane);
                entries.clear();
                entries.extend(if v < rows.len() { bending.entries.of(v as u32) } else { &[] });
                // In one order, those of vertices in a row are in rows themselves.
                entries.sort_unstable_by_key(|entry| entry.other);
            }
            self.starts.push(self.places.len());
            for index in 0..entries.iter().map(Vec::len).max().unwrap_or(0) {
                let entry = |lane: usize| entries[lane].get(index);
                let itself = |lane: usize| vertex(lane).min(rows.len() - 1) as u32;
                let other = |lane: usize| entry(lane).map_or(itself(lane), |entry| entry.other);
                self.places.push(if (0..lanes).all(|lane| other(lane) == other(0) + simd::place(lane, lanes) as u32) {
                    Place::Row(other(0))
                } else {
                    self.apart.extend((0..lanes).map(other));
                    Place::Apart((self.apart.len() - lanes) as u32)
                });
                weights.push(lanes, |lane| entry(lane).map_or(0.0, |entry| entry.forward));
                weights.push(lanes, |lane| entry(lane).map_or(0.0, |entry| entry.backward));
            }
            let row = |lane: usize| rows.get(vertex(lane)).copied().unwrap_or_default();
            numbers.push(lanes, |lane| row(lane).stiffness);
            numbers.push(lanes, |lane| row(lane).stiffness * row(lane).tau);
            numbers.push(lanes, |lane| row(lane).diagonal);
            numbers.push(lanes, |lane| cloth.rest.get(vertex(lane)).map_or(0.0, |x| x.w));
        }
        self.starts.push(self.places.len());
        (self.rows, self.weights) = (numbers, weights);
    }

    fn pack_panels(&mut self, panels: &[Panel]) {
        let lanes = self.lanes;
        let mut masses = Lines::default();
        for panels in panels.chunks(lanes) {
            let panel = |lane: usize| panels[simd::place(lane, lanes).min(panels.len() - 1)];
            masses.push(lanes, |lane| panel(lane).mass);
            (0..3).for_each(|corner| self.corners.extend((0..lanes).map(|lane| panel(lane).corners[corner])));
        }
        self.masses = masses;
    }

    /// The groups of a range that begins with a whole one.
    fn groups(&self, items: &Range<usize>) -> Range<usize> {
        items.start / self.lanes..items.end.div_ceil(self.lanes)
    }

    /// The numbers of kind `kind` of group `group` in a list of so many kinds.
    #[inline(always)]
    fn numbers<W: Wide>(list: &Lines, kinds: usize, group: usize, kind: usize) -> W {
        let first = (kinds * group + kind) * W::LANES;
        W::from_slice(&bytemuck::cast_slice(list)[first..first + W::LANES])
    }

    /// Neighbours of as many vertices as lanes.
    ///
    /// # Safety
    /// Nobody writes the values meanwhile.
    #[expect(unsafe_code, reason = "see the safety section; places are vertices of the cloth")]
    #[inline(always)]
    unsafe fn near<W: Wide>(&self, values: Shared<Vec4>, item: usize) -> Wide3<W> {
        // SAFETY: the caller's promise.
        unsafe {
            match self.places[item] {
                Place::Row(first) => simd::vertices(values, first as usize),
                Place::Apart(first) => gather(values, &self.apart[first as usize..first as usize + W::LANES]),
            }
        }
    }
}

/// State that the loops read, and what they write, one vector a vertex. All have room for whole groups.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    pub x: Shared<Vec4>,
    pub u: Shared<Vec4>,
    pub pulls: Shared<Vec4>,
    /// Of no length where nothing is damped.
    pub couples: Shared<Vec4>,
}

/// [`kernels::bend_moment`](crate::kernels::bend_moment) of a range of vertices that begins with a whole group: their pulls and
/// couples. Nobody writes `x` or `u` meanwhile.
#[derive(Debug, Clone)]
pub(crate) struct Moments<'a> {
    pub gathers: &'a Gathers,
    pub state: State,
    pub vertices: Range<usize>,
    /// Turns displacements into velocities (1/s).
    pub rate: f32,
}

#[expect(unsafe_code, reason = "tasks are kept apart by Forces; lists hold vertices of the cloth")]
impl Loop for Moments<'_> {
    #[inline(always)]
    unsafe fn run<W: Wide>(self) {
        for group in self.gathers.groups(&self.vertices) {
            // SAFETY: the caller's promise.
            unsafe {
                if self.state.couples.len() > 0 {
                    self.damped::<W>(group);
                } else {
                    self.undamped::<W>(group);
                }
            }
        }
    }
}

#[expect(unsafe_code, reason = "tasks are kept apart by Forces; lists hold vertices of the cloth")]
impl Moments<'_> {
    #[inline(always)]
    unsafe fn undamped<W: Wide>(&self, group: usize) {
        let (gathers, state, first) = (self.gathers, &self.state, group * W::LANES);
        // SAFETY: the caller's promise.
        unsafe {
            let center = simd::vertices::<W>(state.x, first);
            let mut y = [W::splat(0.0); 3];
            for near in gathers.starts[group]..gathers.starts[group + 1] {
                let forward = Gathers::numbers(&gathers.weights, 2, near, 0);
                y = simd::plus(simd::sub(gathers.near(state.x, near), center), forward, y);
            }
            put(state.pulls, first, simd::scaled(y, Gathers::numbers(&gathers.rows, 4, group, 0)));
        }
    }

    #[inline(always)]
    unsafe fn damped<W: Wide>(&self, group: usize) {
        let (gathers, state, first) = (self.gathers, &self.state, group * W::LANES);
        let [stiffness, damping] =
            [Gathers::numbers::<W>(&gathers.rows, 4, group, 0), Gathers::numbers(&gathers.rows, 4, group, 1)];
        let zero = W::splat(0.0);
        // SAFETY: the caller's promise.
        unsafe {
            let (center, own) = (simd::vertices::<W>(state.x, first), simd::vertices::<W>(state.u, first));
            let rate = W::splat(self.rate);
            let mut y = [zero; 3];
            let (mut y_rate, mut spin, mut inertia, mut products) = (y, y, y, y);
            for near in gathers.starts[group]..gathers.starts[group + 1] {
                let forward = Gathers::numbers::<W>(&gathers.weights, 2, near, 0);
                // Who is not in the ring is no way off.
                let outside = forward.is(zero);
                let d = choose3(outside, [zero; 3], simd::sub(gathers.near(state.x, near), center));
                let rate = choose3(outside, [zero; 3], simd::scaled(simd::sub(gathers.near(state.u, near), own), rate));
                y = simd::plus(d, forward, y);
                y_rate = simd::plus(rate, forward, y_rate);
                spin = simd::add(spin, simd::cross(d, rate));
                let square = [d[0] * d[0], d[1] * d[1], d[2] * d[2]];
                inertia = simd::add(inertia, [square[1] + square[2], square[0] + square[2], square[0] + square[1]]);
                products =
                    [d[0].times_from(d[1], products[0]), d[0].times_from(d[2], products[1]), d[1].times_from(d[2], products[2])];
            }
            let (omega, flat) = unspin(inertia, products, spin);
            let resisted = simd::scaled(simd::sub(y_rate, simd::cross(omega, y)), damping);
            let (couple, _) = unspin(inertia, products, simd::cross(y, resisted));
            let growth = simd::dot(y, y_rate) / simd::dot(y, y).max(W::splat(1e-30));
            let along = simd::scaled(y, damping.times_plus(growth, stiffness));
            let pull = simd::plus(y, stiffness, resisted);
            put(state.pulls, first, choose3(flat, along, pull));
            put(state.couples, first, choose3(flat, [zero; 3], couple));
        }
    }
}

/// Displacements of a range of vertices that begins with a whole group, as the ambient acceleration and the bending rows predict
/// them. Nobody else reads or writes `u` of these meanwhile, or writes what of others is read.
#[derive(Debug, Clone)]
pub(crate) struct Predict<'a> {
    pub gathers: &'a Gathers,
    pub state: State,
    pub vertices: Range<usize>,
    pub params: &'a Params,
    pub substep: &'a Substep,
}

#[expect(unsafe_code, reason = "tasks are kept apart by Forces; lists hold vertices of the cloth")]
impl Loop for Predict<'_> {
    #[inline(always)]
    unsafe fn run<W: Wide>(self) {
        let Predict { gathers, state, substep, .. } = self;
        let zero = W::splat(0.0);
        let ambient = simd::scaled(all(self.params.acceleration), W::splat(substep.gain));
        for group in gathers.groups(&self.vertices) {
            let first = group * W::LANES;
            let entries = gathers.starts[group]..gathers.starts[group + 1];
            // SAFETY: the caller's promise.
            unsafe {
                let diagonal = zero - Gathers::numbers::<W>(&gathers.rows, 4, group, 2);
                let mut force = simd::scaled(simd::vertices(state.pulls, first), diagonal);
                if state.couples.len() > 0 {
                    let (center, own) = (simd::vertices::<W>(state.x, first), simd::vertices::<W>(state.couples, first));
                    for near in entries {
                        let forward = Gathers::numbers::<W>(&gathers.weights, 2, near, 0);
                        let backward = Gathers::numbers::<W>(&gathers.weights, 2, near, 1);
                        force = simd::plus(gathers.near(state.pulls, near), zero - backward, force);
                        let other = gathers.near(state.couples, near);
                        let of_own = choose3(forward.is(zero), [zero; 3], own);
                        let couple = simd::add(of_own, choose3(backward.is(zero), [zero; 3], other));
                        let d = simd::sub(gathers.near(state.x, near), center);
                        force = simd::sub(force, simd::cross(couple, d));
                    }
                } else {
                    for near in entries {
                        let backward = Gathers::numbers::<W>(&gathers.weights, 2, near, 1);
                        force = simd::plus(gathers.near(state.pulls, near), zero - backward, force);
                    }
                }
                let w = Gathers::numbers::<W>(&gathers.rows, 4, group, 3);
                let (carry, gain) = (W::splat(substep.carry), w * W::splat(substep.gain));
                let by = simd::plus(force, gain, simd::plus(simd::vertices(state.u, first), carry, ambient));
                put(state.u, first, choose3(zero.below(w), by, [zero; 3]));
            }
        }
    }
}

/// A third of [`kernels::wind_force`](crate::kernels::wind_force) of a range of triangles that begins with a whole group. Nobody
/// writes `x` or `u` meanwhile, or reads or writes what they are written to.
#[derive(Debug, Clone)]
pub(crate) struct Gusts<'a> {
    pub gathers: &'a Gathers,
    pub state: State,
    pub to: Shared<Vec4>,
    pub triangles: Range<usize>,
    pub params: &'a Params,
    pub substep: &'a Substep,
}

#[expect(unsafe_code, reason = "tasks are kept apart by Forces; lists hold vertices of the cloth")]
impl Loop for Gusts<'_> {
    #[inline(always)]
    unsafe fn run<W: Wide>(self) {
        let Gusts { gathers, state, params, substep, .. } = self;
        let (zero, one) = (W::splat(0.0), W::splat(1.0));
        for group in gathers.groups(&self.triangles) {
            let corners = &gathers.corners[3 * W::LANES * group..3 * W::LANES * (group + 1)];
            let (i, j, k) = (&corners[..W::LANES], &corners[W::LANES..2 * W::LANES], &corners[2 * W::LANES..]);
            // SAFETY: the caller's promise.
            unsafe {
                let (a, b, c) = (gather::<W>(state.x, i), gather::<W>(state.x, j), gather::<W>(state.x, k));
                let (u, v, w) = (gather::<W>(state.u, i), gather::<W>(state.u, j), gather::<W>(state.u, k));
                let velocity = simd::scaled(simd::add(simd::add(u, v), w), W::splat(substep.rate / 3.0));
                let cross = simd::cross(simd::sub(b, a), simd::sub(c, a));
                let double_area = simd::dot(cross, cross).sqrt();
                let n = simd::scaled(cross, one / double_area);
                let area = double_area * W::splat(0.5);
                let relative = simd::sub(velocity, all(params.wind));
                let along = simd::dot(n, relative);
                let normal = simd::scaled(n, along);
                let tangential = simd::sub(relative, normal);
                let speed = simd::dot(relative, relative).sqrt().max(W::splat(1e-10));
                let (along, half_density) = (along.abs(), W::splat(params.half_density));
                let sine = along / speed;
                let (drag, lift) = (W::splat(params.drag), W::splat(params.lift));
                let kick = W::splat(substep.gain / params.h) * area / Gathers::numbers(&gathers.masses, 1, group, 0);
                let k_n = half_density * drag.times_plus(along, lift * speed * sine.times_from(sine, one));
                let k_t = half_density * along * lift.times_from(sine, drag);
                let (k_n, k_t) = (k_n * area / k_n.times_plus(kick, one), k_t * area / k_t.times_plus(kick, one));
                let force = simd::plus(normal, k_n, simd::scaled(tangential, k_t));
                let flat = double_area.below(W::splat(1e-20));
                put(self.to, group * W::LANES, choose3(flat, [zero; 3], simd::scaled(force, W::splat(-1.0 / 3.0))));
            }
        }
    }
}

/// Solves `I omega = spin`; the mask says where the ring is (nearly) in one line: nothing there.
#[inline(always)]
fn unspin<W: Wide>(inertia: Wide3<W>, products: Wide3<W>, spin: Wide3<W>) -> (Wide3<W>, W::Mask) {
    let (zero, one) = (W::splat(0.0), W::splat(1.0));
    let scale = one / (inertia[0] + inertia[1] + inertia[2]).max(W::splat(1e-30));
    let (i, q) = (simd::scaled(inertia, scale), simd::scaled(products, scale));
    let diagonal = [q[2].times_from(q[2], i[1] * i[2]), q[1].times_from(q[1], i[0] * i[2]), q[0].times_from(q[0], i[0] * i[1])];
    let corners = [q[0].times_from(i[2], q[1] * q[2]), q[1].times_from(i[1], q[0] * q[2]), q[2].times_from(i[0], q[0] * q[1])];
    let determinant = q[1].times_plus(corners[1], q[0].times_plus(corners[0], i[0] * diagonal[0]));
    let omega = [
        simd::dot([diagonal[0], corners[0], corners[1]], spin),
        simd::dot([corners[0], diagonal[1], corners[2]], spin),
        simd::dot([corners[1], corners[2], diagonal[2]], spin),
    ];
    let flat = determinant.below(W::splat(1e-4));
    let omega = simd::scaled(omega, scale / determinant);
    (choose3(flat, [zero; 3], omega), flat)
}

#[inline(always)]
fn choose3<W: Wide>(mask: W::Mask, yes: Wide3<W>, no: Wide3<W>) -> Wide3<W> {
    [W::choose(mask, yes[0], no[0]), W::choose(mask, yes[1], no[1]), W::choose(mask, yes[2], no[2])]
}

#[inline(always)]
fn all<W: Wide>([x, y, z]: [f32; 3]) -> Wide3<W> {
    [W::splat(x), W::splat(y), W::splat(z)]
}

/// Vertices anywhere.
#[expect(unsafe_code, reason = "the loops' callers promise")]
#[inline(always)]
unsafe fn gather<W: Wide>(values: Shared<Vec4>, places: &[u32]) -> Wide3<W> {
    let at = |k: usize| simd::apart::<W>(places, k);
    // SAFETY: the caller's promise.
    W::transpose(unsafe { [W::load(values, at(0)), W::load(values, at(1)), W::load(values, at(2)), W::load(values, at(3))] })
}

/// The inverse of [`simd::vertices`], with 0 as fourth.
#[expect(unsafe_code, reason = "the loops' callers promise")]
#[inline(always)]
unsafe fn put<W: Wide>(values: Shared<Vec4>, first: usize, vectors: Wide3<W>) {
    let [a, b, c, d] = W::vectors(vectors);
    let at = |k: usize| At::Beside(first + W::LANES / 4 * k);
    // SAFETY: the caller's promise.
    unsafe {
        a.store(values, at(0));
        b.store(values, at(1));
        c.store(values, at(2));
        d.store(values, at(3));
    }
}
