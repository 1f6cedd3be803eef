//! Forces on eight vertices, or of eight triangles, at a time. The oracle of each is the function of its name in `kernels.rs`.

use glam::Vec4;

use crate::bending::Bending;
use crate::cloth::Cloth;
use crate::coefficients::Coefficients;
use crate::crew::Shared;
use crate::kernels::{BendEntry, BendRow, Panel, Params, Substep};
use crate::wide::{self, At, Eight, Wide, Wide3};

/// Vertices or triangles together.
pub(crate) const WIDTH: usize = 8;

/// What the loops need, in their order: lane `k` of vertices is the one at [`wide::place`].
#[derive(Debug, Default)]
pub(crate) struct Eights {
    rows: Vec<Rows>,
    /// One neighbour of each of eight vertices, an item each. A vertex that has fewer than the others is its own, with no weight.
    places: Vec<Place>,
    forward: Vec<[f32; WIDTH]>,
    backward: Vec<[f32; WIDTH]>,
    /// The neighbours that are not one after another.
    apart: Vec<[u32; WIDTH]>,
    panels: Vec<Panels>,
}

/// Where eight vertices are.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// One after another from here on.
    Row(u32),
    /// As this item of `apart` says.
    Apart(u32),
}

/// Bending rows, and where their neighbours are.
#[repr(C, align(32))]
#[derive(Debug, Clone)]
struct Rows {
    stiffness: [f32; WIDTH],
    damping: [f32; WIDTH],
    diagonal: [f32; WIDTH],
    inverse_mass: [f32; WIDTH],
    neighbours: std::ops::Range<usize>,
}

/// Triangles; the last repeats itself, with no effect but on what is not used.
#[repr(C, align(32))]
#[derive(Debug, Clone, Copy)]
struct Panels {
    mass: [f32; WIDTH],
    corners: [[u32; WIDTH]; 3],
}

#[expect(unsafe_code, reason = "see below")]
impl Eights {
    /// Packs what a scene has.
    pub(crate) fn new(cloth: &Cloth, coefficients: &Coefficients, bending: bool, wind: bool) -> Eights {
        let mut eights = Eights::default();
        if bending {
            eights.pack_rows(cloth, &coefficients.bending, cloth.bending());
        }
        if wind {
            let panels = &cloth.panels().panels;
            eights.panels = panels.chunks(WIDTH).map(Panels::new).collect();
        }
        eights
    }

    fn pack_rows(&mut self, cloth: &Cloth, rows: &[BendRow], bending: &Bending) {
        let mut entries: [Vec<BendEntry>; WIDTH] = Default::default();
        for first in (0..rows.len()).step_by(WIDTH) {
            let vertex = std::array::from_fn::<_, WIDTH, _>(|lane| first + wide::place(lane, WIDTH));
            for (entries, &v) in entries.iter_mut().zip(&vertex) {
                entries.clear();
                entries.extend(if v < rows.len() { bending.entries.of(v as u32) } else { &[] });
                // In one order, those of vertices in a row are in rows themselves.
                entries.sort_unstable_by_key(|entry| entry.other);
            }
            let start = self.places.len();
            for index in 0..entries.iter().map(Vec::len).max().unwrap_or(0) {
                let entry = |lane: usize| entries[lane].get(index);
                let itself = |lane: usize| vertex[lane].min(rows.len() - 1) as u32;
                let other: [u32; WIDTH] = std::array::from_fn(|lane| entry(lane).map_or(itself(lane), |entry| entry.other));
                self.places.push(if (0..WIDTH).all(|lane| other[lane] == other[0] + wide::place(lane, WIDTH) as u32) {
                    Place::Row(other[0])
                } else {
                    self.apart.push(other);
                    Place::Apart(self.apart.len() as u32 - 1)
                });
                self.forward.push(std::array::from_fn(|lane| entry(lane).map_or(0.0, |entry| entry.forward)));
                self.backward.push(std::array::from_fn(|lane| entry(lane).map_or(0.0, |entry| entry.backward)));
            }
            let row = vertex.map(|v| rows.get(v).copied().unwrap_or_default());
            self.rows.push(Rows {
                stiffness: row.map(|row| row.stiffness),
                damping: row.map(|row| row.stiffness * row.tau),
                diagonal: row.map(|row| row.diagonal),
                inverse_mass: vertex.map(|v| cloth.rest.get(v).map_or(0.0, |x| x.w)),
                neighbours: start..self.places.len(),
            });
        }
    }

    /// Eight neighbours.
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    unsafe fn near(&self, values: Shared<Vec4>, item: usize) -> Wide3<Eight> {
        // SAFETY: the caller's promise.
        unsafe {
            match self.places[item] {
                Place::Row(first) => vertices(values, first as usize),
                Place::Apart(item) => gather(values, &self.apart[item as usize]),
            }
        }
    }
}

impl Panels {
    fn new(panels: &[Panel]) -> Panels {
        let panel = |lane: usize| panels[lane.min(panels.len() - 1)];
        Panels {
            mass: std::array::from_fn(|lane| panel(lane).mass),
            corners: [0, 1, 2].map(|corner| std::array::from_fn(|lane| panel(lane).corners[corner])),
        }
    }
}

/// State that the loops read, and what they write, one vector a vertex.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    pub x: Shared<Vec4>,
    pub u: Shared<Vec4>,
    pub pulls: Shared<Vec4>,
    /// Of no length where nothing is damped.
    pub couples: Shared<Vec4>,
}

#[expect(unsafe_code, reason = "tasks are kept apart by Forces; lists hold vertices of the cloth")]
impl Eights {
    /// [`kernels::bend_moment`](crate::kernels::bend_moment) of eight vertices from `8 eight` on.
    ///
    /// # Safety
    /// The processor has AVX2 and FMA. All values have room for whole eights, nobody writes `x` or `u`, or else there the rest.
    #[target_feature(enable = "avx2,fma")]
    pub(crate) unsafe fn moments(&self, eight: usize, state: &State, rate: f32) {
        let first = eight * WIDTH;
        let row = &self.rows[eight];
        let (stiffness, damping) = (of(&row.stiffness), of(&row.damping));
        let damped = state.couples.len() > 0;
        let zero = Eight::splat(0.0);
        // SAFETY: the caller's promise.
        unsafe {
            let center = vertices(state.x, first);
            let mut y = [zero; 3];
            if !damped {
                for near in row.neighbours.clone() {
                    y = wide::plus(wide::sub(self.near(state.x, near), center), of(&self.forward[near]), y);
                }
                return put(state.pulls, first, wide::scaled(y, stiffness));
            }
            let own = vertices(state.u, first);
            let rate = Eight::splat(rate);
            let (mut y_rate, mut spin, mut inertia, mut products) = (y, y, y, y);
            for near in row.neighbours.clone() {
                let forward = of(&self.forward[near]);
                // Who is not in the ring is no way off.
                let outside = forward.is(zero);
                let d = choose3(outside, [zero; 3], wide::sub(self.near(state.x, near), center));
                let rate = choose3(outside, [zero; 3], wide::scaled(wide::sub(self.near(state.u, near), own), rate));
                y = wide::plus(d, forward, y);
                y_rate = wide::plus(rate, forward, y_rate);
                spin = wide::add(spin, wide::cross(d, rate));
                let square = [d[0] * d[0], d[1] * d[1], d[2] * d[2]];
                inertia = wide::add(inertia, [square[1] + square[2], square[0] + square[2], square[0] + square[1]]);
                products =
                    [d[0].times_from(d[1], products[0]), d[0].times_from(d[2], products[1]), d[1].times_from(d[2], products[2])];
            }
            let (omega, flat) = unspin(inertia, products, spin);
            let resisted = wide::scaled(wide::sub(y_rate, wide::cross(omega, y)), damping);
            let (couple, _) = unspin(inertia, products, wide::cross(y, resisted));
            let growth = wide::dot(y, y_rate) / wide::dot(y, y).max(Eight::splat(1e-30));
            let along = wide::scaled(y, damping.times_plus(growth, stiffness));
            let pull = wide::plus(y, stiffness, resisted);
            put(state.pulls, first, choose3(flat, along, pull));
            put(state.couples, first, choose3(flat, [zero; 3], couple));
        }
    }

    /// Eight displacements as the ambient acceleration and the bending rows predict them.
    ///
    /// # Safety
    /// As for [`Eights::moments`], but that it is `u` of these vertices that nobody else reads or writes.
    #[target_feature(enable = "avx2,fma")]
    pub(crate) unsafe fn predict(&self, eight: usize, state: &State, params: &Params, substep: &Substep) {
        let first = eight * WIDTH;
        let row = &self.rows[eight];
        let zero = Eight::splat(0.0);
        let damped = state.couples.len() > 0;
        // SAFETY: the caller's promise.
        unsafe {
            let diagonal = zero - of(&row.diagonal);
            let mut force = wide::scaled(vertices(state.pulls, first), diagonal);
            if damped {
                let (center, own) = (vertices(state.x, first), vertices(state.couples, first));
                for near in row.neighbours.clone() {
                    let (forward, backward) = (of(&self.forward[near]), of(&self.backward[near]));
                    force = wide::plus(self.near(state.pulls, near), zero - backward, force);
                    let other = self.near(state.couples, near);
                    let of_own = choose3(forward.is(zero), [zero; 3], own);
                    let couple = wide::add(of_own, choose3(backward.is(zero), [zero; 3], other));
                    let d = wide::sub(self.near(state.x, near), center);
                    force = wide::sub(force, wide::cross(couple, d));
                }
            } else {
                for near in row.neighbours.clone() {
                    force = wide::plus(self.near(state.pulls, near), zero - of(&self.backward[near]), force);
                }
            }
            let w = of(&row.inverse_mass);
            let (carry, gain) = (Eight::splat(substep.carry), w * Eight::splat(substep.gain));
            let ambient = wide::scaled(all(params.acceleration), Eight::splat(substep.gain));
            let by = wide::plus(force, gain, wide::plus(vertices(state.u, first), carry, ambient));
            let free = zero.below(w);
            put(state.u, first, choose3(free, by, [zero; 3]));
        }
    }

    /// A third of [`kernels::wind_force`](crate::kernels::wind_force) of eight triangles from `8 eight` on.
    ///
    /// # Safety
    /// As for [`Eights::moments`], of `gusts`.
    #[target_feature(enable = "avx2,fma")]
    pub(crate) unsafe fn gusts(&self, eight: usize, state: &State, gusts: Shared<Vec4>, params: &Params, substep: &Substep) {
        let panels = &self.panels[eight];
        let (zero, one) = (Eight::splat(0.0), Eight::splat(1.0));
        // SAFETY: the caller's promise.
        let force = unsafe {
            let [i, j, k] = &panels.corners;
            let (a, b, c) = (gather(state.x, i), gather(state.x, j), gather(state.x, k));
            let (u, v, w) = (gather(state.u, i), gather(state.u, j), gather(state.u, k));
            let velocity = wide::scaled(wide::add(wide::add(u, v), w), Eight::splat(substep.rate / 3.0));
            let cross = wide::cross(wide::sub(b, a), wide::sub(c, a));
            let double_area = wide::dot(cross, cross).sqrt();
            let n = wide::scaled(cross, one / double_area);
            let area = double_area * Eight::splat(0.5);
            let relative = wide::sub(velocity, all(params.wind));
            let along = wide::dot(n, relative);
            let normal = wide::scaled(n, along);
            let tangential = wide::sub(relative, normal);
            let speed = wide::dot(relative, relative).sqrt().max(Eight::splat(1e-10));
            let (along, half_density) = (along.abs(), Eight::splat(params.half_density));
            let sine = along / speed;
            let (drag, lift) = (Eight::splat(params.drag), Eight::splat(params.lift));
            let kick = Eight::splat(substep.gain / params.h) * area / of(&panels.mass);
            let limited = |k: Eight| k * area / k.times_plus(kick, one);
            let k_n = limited(half_density * drag.times_plus(along, lift * speed * sine.times_from(sine, one)));
            let k_t = limited(half_density * along * lift.times_from(sine, drag));
            let force = wide::plus(normal, k_n, wide::scaled(tangential, k_t));
            let flat = double_area.below(Eight::splat(1e-20));
            choose3(flat, [zero; 3], wide::scaled(force, Eight::splat(-1.0 / 3.0)))
        };
        let first = eight * WIDTH;
        for (k, pair) in Eight::vectors(force).into_iter().enumerate() {
            // SAFETY: the caller's promise.
            unsafe { pair.store(gusts, At::Apart([first + k, first + k + 4, 0, 0])) };
        }
    }
}

/// Solves `I omega = spin`; the mask says where the ring is (nearly) in one line: nothing there.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn unspin(inertia: Wide3<Eight>, products: Wide3<Eight>, spin: Wide3<Eight>) -> (Wide3<Eight>, Eight) {
    let (zero, one) = (Eight::splat(0.0), Eight::splat(1.0));
    let scale = one / (inertia[0] + inertia[1] + inertia[2]).max(Eight::splat(1e-30));
    let (i, q) = (wide::scaled(inertia, scale), wide::scaled(products, scale));
    let diagonal = [q[2].times_from(q[2], i[1] * i[2]), q[1].times_from(q[1], i[0] * i[2]), q[0].times_from(q[0], i[0] * i[1])];
    let corners = [q[0].times_from(i[2], q[1] * q[2]), q[1].times_from(i[1], q[0] * q[2]), q[2].times_from(i[0], q[0] * q[1])];
    let determinant = q[1].times_plus(corners[1], q[0].times_plus(corners[0], i[0] * diagonal[0]));
    let omega = [
        wide::dot([diagonal[0], corners[0], corners[1]], spin),
        wide::dot([corners[0], diagonal[1], corners[2]], spin),
        wide::dot([corners[1], corners[2], diagonal[2]], spin),
    ];
    let flat = determinant.below(Eight::splat(1e-4));
    let omega = wide::scaled(omega, scale / determinant);
    (choose3(flat, [zero; 3], omega), flat)
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn choose3(mask: Eight, yes: Wide3<Eight>, no: Wide3<Eight>) -> Wide3<Eight> {
    [Eight::choose(mask, yes[0], no[0]), Eight::choose(mask, yes[1], no[1]), Eight::choose(mask, yes[2], no[2])]
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn all([x, y, z]: [f32; 3]) -> Wide3<Eight> {
    [Eight::splat(x), Eight::splat(y), Eight::splat(z)]
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn of(values: &[f32; WIDTH]) -> Eight {
    Eight::from_slice(values)
}

/// Eight vertices from `first` on, in the order of [`IN_ROW`].
#[expect(unsafe_code, reason = "see Eights")]
#[inline]
#[target_feature(enable = "avx2,fma")]
unsafe fn vertices(values: Shared<Vec4>, first: usize) -> Wide3<Eight> {
    let mut pairs = [Eight::splat(0.0); 4];
    for (k, pair) in pairs.iter_mut().enumerate() {
        // SAFETY: the caller's promise.
        *pair = unsafe { Eight::load(values, At::Beside(first + 2 * k)) };
    }
    Eight::transpose(pairs)
}

/// Eight vertices anywhere.
#[expect(unsafe_code, reason = "see Eights")]
#[inline]
#[target_feature(enable = "avx2,fma")]
unsafe fn gather(values: Shared<Vec4>, at: &[u32; WIDTH]) -> Wide3<Eight> {
    let mut pairs = [Eight::splat(0.0); 4];
    for (k, pair) in pairs.iter_mut().enumerate() {
        // SAFETY: the caller's promise.
        *pair = unsafe { Eight::load(values, At::Apart([at[k] as usize, at[k + 4] as usize, 0, 0])) };
    }
    Eight::transpose(pairs)
}

/// The inverse of [`vertices`].
#[expect(unsafe_code, reason = "see Eights")]
#[inline]
#[target_feature(enable = "avx2,fma")]
unsafe fn put(values: Shared<Vec4>, first: usize, vectors: Wide3<Eight>) {
    for (k, pair) in Eight::vectors(vectors).into_iter().enumerate() {
        // SAFETY: the caller's promise.
        unsafe { pair.store(values, At::Beside(first + 2 * k)) };
    }
}
