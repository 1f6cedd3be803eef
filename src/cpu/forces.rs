//! What each vertex is predicted to do: forces gathered from what is around it, on the processor.

use std::ops::Range;

use glam::{Vec3A, Vec4};

use crate::cpu::force_batches::{Gathers, Gusts, Moments, Predict, State};
use crate::cpu::integrate::fallen;
use crate::cpu::shared::Shared;
use crate::kernels::{self, Substep, xyz};
use crate::options::Method;
use crate::simd::aligned::Lines;
use crate::simd::{self, Breadth};
use crate::step::plan::Plan;

/// Triangles that a task computes the air's force on.
const GRAIN: usize = 1024;

/// What forces are made of, kept from step to step; lists are empty where a scene has nothing for them.
#[derive(Debug, Default)]
pub(crate) struct Parts {
    /// What each vertex's bending row does ([`kernels::bend_moment`]); couples are of its damping.
    pulls: Lines,
    couples: Lines,
    /// A third of the air's force (N) on each triangle: what each of its corners feels.
    gusts: Lines,
    /// The lists of a scene that the wide loops take, and for what they were packed: substep (its bits), bending, wind.
    gathers: Gathers,
    packed_for: Option<(u32, bool, bool)>,
    /// Stripes of each task of [`Forces::gusts`].
    winded: Vec<Vec<u32>>,
}

/// The loops, over state that the tasks of a round share.
///
/// Why no two tasks meet: tasks that make parts touch the stripes of all vertices that they look at. One that predicts vertices
/// writes `u` at its own, and reads there, and parts and `x` of neighbours, whose tasks touch its stripe
/// ([`Task::touches`](crate::cpu::partition::Task)).
#[derive(Debug)]
pub(crate) struct Forces<'a> {
    plan: &'a Plan<'a>,
    x: Shared<Vec4>,
    /// Displacements: of the last substep, and once predicted, of this.
    u: Shared<Vec4>,
    pulls: Shared<Vec4>,
    couples: Shared<Vec4>,
    gusts: Shared<Vec4>,
    pub winded: &'a [Vec<u32>],
    gathers: &'a Gathers,
    breadth: Breadth,
}

impl Parts {
    /// The loops of a step; without `forces` nothing but the ambient acceleration.
    pub(crate) fn share<'a>(
        &'a mut self,
        plan: &'a Plan<'a>,
        stripes: &[Range<u32>],
        x: Shared<Vec4>,
        u: Shared<Vec4>,
        forces: bool,
        breadth: Breadth,
    ) -> Forces<'a> {
        let (bending, wind) = (forces && plan.bending, forces && plan.wind);
        let fit = |list: &mut Lines, length: usize| {
            if list.len() != length {
                *list = Lines::new(length);
            }
        };
        fit(&mut self.pulls, if bending { x.len() } else { 0 });
        fit(&mut self.couples, if bending && plan.damped() { x.len() } else { 0 });
        fit(&mut self.gusts, if wind { plan.cloth.panels().panels.len() } else { 0 });
        let scene = (plan.coefficients.h.to_bits(), bending, wind);
        if self.packed_for != Some(scene) {
            // The old one first, or memory would hold both.
            self.gathers = Gathers::default();
            self.gathers = Gathers::new(plan.cloth, plan.coefficients, bending, wind, breadth);
            self.packed_for = Some(scene);
            let stripe = |vertex: u32| stripes.partition_point(|range| range.end <= vertex) as u32;
            let panels = if wind { plan.cloth.panels().panels.as_slice() } else { &[] };
            self.winded = Vec::new();
            for panels in panels.chunks(GRAIN) {
                let mut touches: Vec<u32> = panels.iter().flat_map(|panel| panel.corners).map(stripe).collect();
                touches.sort_unstable();
                touches.dedup();
                self.winded.push(touches);
            }
        }
        Forces {
            plan,
            x,
            u,
            pulls: self.pulls.share(),
            couples: self.couples.share(),
            gusts: self.gusts.share(),
            winded: &self.winded,
            gathers: &self.gathers,
            breadth,
        }
    }
}

#[expect(unsafe_code, reason = "see Forces; indices are vertices of the cloth, checked when its lists are built")]
impl Forces<'_> {
    /// Whether anything but the ambient acceleration acts.
    pub(crate) fn any(&self) -> bool {
        self.plan.bending || self.plan.wind || self.plan.method == Method::Springs
    }

    fn x(&self, vertex: u32) -> Vec3A {
        // SAFETY: see Forces.
        xyz(unsafe { self.x.get(vertex as usize) })
    }

    fn u(&self, vertex: u32) -> Vec3A {
        // SAFETY: see Forces.
        xyz(unsafe { self.u.get(vertex as usize) })
    }

    fn state(&self) -> State {
        State { x: self.x, u: self.u, pulls: self.pulls, couples: self.couples }
    }

    /// The bending rows of these vertices, from their rings; a stripe's, which begins with a whole group.
    pub(crate) fn moments(&self, vertices: Range<u32>, substep: &Substep) {
        #[cfg(test)]
        if self.breadth == Breadth::One {
            return self.plain_moments(vertices, substep);
        }
        let vertices = vertices.start as usize..vertices.end as usize;
        let moments = Moments { gathers: self.gathers, state: self.state(), vertices, rate: substep.rate };
        // SAFETY: see Forces; the breadth was detected.
        unsafe { simd::run(self.breadth, moments) };
    }

    /// The air on some triangles.
    pub(crate) fn gusts(&self, task: usize, substep: &Substep) {
        let triangles = task * GRAIN..((task + 1) * GRAIN).min(self.gusts.len());
        #[cfg(test)]
        if self.breadth == Breadth::One {
            return self.plain_gusts(triangles, substep);
        }
        let (gathers, state, params) = (self.gathers, self.state(), &self.plan.params);
        // SAFETY: see Forces; the breadth was detected.
        unsafe { simd::run(self.breadth, Gusts { gathers, state, to: self.gusts, triangles, params, substep }) };
    }

    /// The displacements that the forces predict, of a stripe's vertices.
    pub(crate) fn predict(&self, vertices: Range<u32>, substep: &Substep) {
        // Each term is added as its own stage does it on the GPU, in the same order: fewer roundings part the two.
        self.bend(vertices.clone(), substep);
        let around = self.plan.wind.then(|| &self.plan.cloth.panels().around);
        let springs = (self.plan.method == Method::Springs).then(|| self.plan.cloth.springs());
        if around.is_none() && springs.is_none() {
            return;
        }
        for i in vertices {
            // SAFETY: see Forces.
            let w = unsafe { self.x.get(i as usize) }.w;
            if w == 0.0 {
                continue;
            }
            let (mut by, gain) = (self.u(i), w * substep.gain);
            if let Some(around) = around {
                // SAFETY: see Forces.
                let force = around.of(i).iter().map(|&triangle| xyz(unsafe { self.gusts.get(triangle as usize) }));
                by += force.sum::<Vec3A>() * gain;
            }
            if let Some(springs) = springs {
                let force = springs.of(i).iter().map(|s| kernels::spring_force(self.x(s.other) - self.x(i), s));
                by += force.sum::<Vec3A>() * gain;
            }
            // SAFETY: see Forces.
            unsafe { self.u.set(i as usize, by.extend(0.0)) };
        }
    }

    /// What the ambient acceleration and the bending rows predict.
    fn bend(&self, vertices: Range<u32>, substep: &Substep) {
        #[cfg(test)]
        if self.plan.bending && self.breadth == Breadth::One {
            return self.plain_bend(vertices, substep);
        }
        if self.plan.bending {
            let vertices = vertices.start as usize..vertices.end as usize;
            let (gathers, state, params) = (self.gathers, self.state(), &self.plan.params);
            // SAFETY: see Forces; the breadth was detected.
            unsafe { simd::run(self.breadth, Predict { gathers, state, vertices, params, substep }) };
            return;
        }
        let ambient = Vec3A::from(self.plan.params.acceleration);
        for i in vertices {
            // SAFETY: see Forces.
            unsafe { self.u.set(i as usize, fallen(self.x.get(i as usize).w, self.u(i), ambient, substep)) };
        }
    }

    /// Displacements of the pins among these vertices.
    pub(crate) fn lead_pins(&self, vertices: Range<u32>, substep: &Substep) {
        let pins = self.plan.pins;
        let first = pins.partition_point(|pin| pin.vertex < vertices.start);
        for pin in pins[first..].iter().take_while(|pin| pin.vertex < vertices.end) {
            let (origin, goal) = (Vec3A::from(pin.origin), Vec3A::from(pin.goal));
            let by = origin + (goal - origin) * substep.end - self.x(pin.vertex);
            // SAFETY: see Forces.
            unsafe { self.u.set(pin.vertex as usize, by.extend(0.0)) };
        }
    }
}

/// The same vertex by vertex, as the mathematics is written: the oracle of the wide loops.
#[cfg(test)]
#[expect(unsafe_code, reason = "see Forces")]
impl Forces<'_> {
    fn plain_moments(&self, vertices: Range<u32>, substep: &Substep) {
        let (rows, entries) = (&self.plan.coefficients.bending, &self.plan.cloth.bending().entries);
        if !self.plan.damped() {
            for v in vertices {
                let center = self.x(v);
                let y = entries.of(v).iter().fold(Vec3A::ZERO, |y, entry| y + (self.x(entry.other) - center) * entry.forward);
                // SAFETY: see Forces.
                unsafe { self.pulls.set(v as usize, (y * rows[v as usize].stiffness).extend(0.0)) };
            }
            return;
        }
        for v in vertices {
            let mut ring = kernels::Ring::default();
            for entry in entries.of(v).iter().filter(|entry| entry.forward != 0.0) {
                let rate = (self.u(entry.other) - self.u(v)) * substep.rate;
                ring.add(self.x(entry.other) - self.x(v), rate, entry.forward);
            }
            let (pull, couple) = kernels::bend_moment(&ring, &rows[v as usize]);
            // SAFETY: see Forces.
            unsafe {
                self.pulls.set(v as usize, pull.extend(0.0));
                self.couples.set(v as usize, couple.extend(0.0));
            }
        }
    }

    fn plain_gusts(&self, triangles: Range<usize>, substep: &Substep) {
        let panels = &self.plan.cloth.panels().panels;
        for triangle in triangles {
            let panel = panels[triangle];
            let [a, b, c] = panel.corners;
            let velocity = (self.u(a) + self.u(b) + self.u(c)) * (substep.rate / 3.0);
            let force = kernels::wind_force([a, b, c].map(|v| self.x(v)), velocity, panel.mass, substep, &self.plan.params);
            // SAFETY: see Forces.
            unsafe { self.gusts.set(triangle, (force / 3.0).extend(0.0)) };
        }
    }

    fn plain_bend(&self, vertices: Range<u32>, substep: &Substep) {
        let ambient = Vec3A::from(self.plan.params.acceleration);
        let (rows, entries) = (&self.plan.coefficients.bending, &self.plan.cloth.bending().entries);
        for i in vertices {
            // SAFETY: see Forces.
            let w = unsafe { self.x.get(i as usize) }.w;
            let mut by = if w == 0.0 { Vec3A::ZERO } else { kernels::predict(self.u(i), ambient, substep) };
            if w != 0.0 {
                by += self.bending(i, &rows[i as usize], entries.of(i)) * (w * substep.gain);
            }
            // SAFETY: see Forces.
            unsafe { self.u.set(i as usize, by.extend(0.0)) };
        }
    }

    /// Force (N) of the bending rows that a vertex is in.
    fn bending(&self, i: u32, row: &kernels::BendRow, entries: &[kernels::BendEntry]) -> Vec3A {
        // SAFETY: see Forces.
        let of = |values: Shared<Vec4>, vertex: u32| xyz(unsafe { values.get(vertex as usize) });
        let mut force = -of(self.pulls, i) * row.diagonal;
        if !self.plan.damped() {
            entries.iter().for_each(|entry| force -= of(self.pulls, entry.other) * entry.backward);
            return force;
        }
        let own = of(self.couples, i);
        for entry in entries {
            force -= of(self.pulls, entry.other) * entry.backward;
            let couple = kernels::couple(own, of(self.couples, entry.other), entry);
            force -= couple.cross(self.x(entry.other) - self.x(i));
        }
        force
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::cloth::Cloth;
    use crate::step::coefficients::Coefficients;
    use crate::step::plan::{Lists, Motion};
    use crate::{Attributes, Fabric, Mesh, Options};

    /// What one substep predicts in a crumpled cloth that moves, or without `forces`, what it would then fall.
    fn predicted(cloth: &Cloth, options: &Options, breadth: Breadth, attributes: &Attributes) -> Vec<Vec4> {
        let h = 1.0 / 1200.0;
        let coefficients = Coefficients::new(cloth, &[], options, h);
        let (mut lists, motion) = (Lists::default(), Motion { h, ..Motion::default() });
        let plan = Plan::new(cloth, &[], options, &coefficients, &motion, 1, attributes, &mut lists);
        let mut random = fastrand::Rng::with_seed(3);
        let (mut x, mut u) = (Lines::new(cloth.rest.len()), Lines::new(cloth.rest.len()));
        for (v, rest) in cloth.rest.iter().enumerate() {
            let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
            x[v] = *rest + vector(0.01).extend(0.0);
            u[v] = vector(0.002).extend(0.0);
        }
        let mut parts = Parts::default();
        let forces = parts.share(&plan, &[0..cloth.rest.len() as u32], x.share(), u.share(), true, breadth);
        let vertices = cloth.rest.len() as u32;
        // Two stripes, as they are cut.
        let stripes = [0..400, 400..vertices];
        stripes.iter().filter(|_| plan.bending).for_each(|stripe| forces.moments(stripe.clone(), &plan.substeps[0]));
        (0..forces.winded.len()).for_each(|task| forces.gusts(task, &plan.substeps[0]));
        stripes.iter().for_each(|stripe| forces.predict(stripe.clone(), &plan.substeps[0]));
        u.to_vec()
    }

    /// Many at a time or one, on meshes with rows and without, with borders, pins and a remainder: the same to rounding.
    #[test]
    fn wide_forces_are_the_plain_ones() {
        let grid = Mesh::grid(32, 27, 1.0, 0.9);
        let mut shuffled = Mesh::grid(29, 31, 1.0, 1.1);
        let mut names: Vec<u32> = (0..899).collect();
        fastrand::Rng::with_seed(5).shuffle(&mut names);
        names.iter().zip(shuffled.positions.clone()).for_each(|(&name, x)| shuffled.positions[name as usize] = x);
        shuffled.triangles.iter_mut().flatten().for_each(|vertex| *vertex = names[*vertex as usize]);
        let air = Attributes { air_density: 1.2, wind: glam::Vec3::new(3.0, 1.0, -7.0), ..Attributes::default() };
        for (name, mesh) in [("grid", &grid), ("shuffled", &shuffled)] {
            for (scene, bending, damping, attributes) in [
                ("bending", 1e-4, 0.0, &Attributes::default()),
                ("damped", 1e-4, 0.03, &Attributes::default()),
                ("air", 0.0, 0.0, &air),
                ("all", 1e-4, 0.03, &air),
            ] {
                let fabric = Fabric { bending, damping, ..Fabric::default() };
                let options = Options { fabric, pinned: vec![0, 7, 500], ..Options::default() };
                let cloth = Cloth::new(mesh, &options).unwrap();
                let plain = predicted(&cloth, &options, Breadth::One, attributes);
                let still = Options { fabric: Fabric { bending: 0.0, ..fabric }, ..options.clone() };
                let fallen = predicted(&cloth, &still, Breadth::One, &Attributes::default());
                let most = |a: &[Vec4], b: &[Vec4]| {
                    a.iter()
                        .zip(b)
                        .map(|(a, b)| (a - b).truncate().length())
                        .fold(0.0, |most: f32, d| if d > most || d.is_nan() { d } else { most })
                };
                let moved = most(&plain, &fallen);
                assert!(moved > 1e-7, "{name} {scene}: forces move by {moved}");
                for breadth in Breadth::all() {
                    let apart = most(&plain, &predicted(&cloth, &options, breadth, attributes));
                    assert!(apart <= 1e-5 * moved + 1e-9, "{name} {scene} {breadth:?}: {apart} apart of {moved}");
                }
            }
        }
    }
}
