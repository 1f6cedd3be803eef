//! What each vertex is predicted to do: forces gathered from what is around it, on the processor.

use std::ops::Range;

use glam::{Vec3A, Vec4};

use crate::crew::Shared;
use crate::kernels::{self, BendEntry, BendRow, Substep, xyz};
use crate::options::Method;
use crate::plan::Plan;

/// Triangles that a task computes the air's force on.
const GRAIN: usize = 1024;

/// What forces are made of, kept from step to step; lists are empty where a scene has nothing for them.
#[derive(Debug, Default)]
pub(crate) struct Parts {
    /// What each vertex's bending row does ([`kernels::bend_moment`]); couples are of its damping.
    pulls: Vec<Vec3A>,
    couples: Vec<Vec3A>,
    /// A third of the air's force (N) on each triangle: what each of its corners feels.
    gusts: Vec<Vec3A>,
}

/// The loops, over state that the tasks of a round share.
///
/// Why no two tasks meet: while parts are made nobody writes `x` or `u`. While vertices are predicted, a task writes `u` at its own
/// vertices, and reads there and `x` of neighbours, which nobody writes in that round ([`Stripes`](crate::stripes::Stripes)).
#[derive(Debug)]
pub(crate) struct Forces<'a> {
    plan: &'a Plan<'a>,
    x: Shared<Vec4>,
    /// Displacements: of the last substep, and once predicted, of this.
    u: Shared<Vec4>,
    pulls: Shared<Vec3A>,
    couples: Shared<Vec3A>,
    gusts: Shared<Vec3A>,
}

impl Parts {
    /// The loops of a step; without `forces` nothing but the ambient acceleration.
    pub(crate) fn share<'a>(&'a mut self, plan: &'a Plan<'a>, x: Shared<Vec4>, u: Shared<Vec4>, forces: bool) -> Forces<'a> {
        let fit = |list: &mut Vec<Vec3A>, wanted: bool, length: usize| list.resize(if wanted { length } else { 0 }, Vec3A::ZERO);
        let (bending, wind) = (forces && plan.bending, forces && plan.wind);
        fit(&mut self.pulls, bending, x.len());
        fit(&mut self.couples, bending && plan.damped(), x.len());
        fit(&mut self.gusts, wind, if wind { plan.cloth.panels().panels.len() } else { 0 });
        let [pulls, couples, gusts] = [&mut self.pulls, &mut self.couples, &mut self.gusts].map(|list| Shared::new(list));
        Forces { plan, x, u, pulls, couples, gusts }
    }
}

#[expect(unsafe_code, reason = "see Forces; indices are vertices of the cloth, checked when its lists are built")]
impl Forces<'_> {
    /// Whether anything but the ambient acceleration acts.
    pub(crate) fn any(&self) -> bool {
        self.plan.bending || self.plan.wind || self.plan.method == Method::Springs
    }

    /// Tasks of [`Forces::part`].
    pub(crate) fn parts(&self, stripes: usize) -> usize {
        let moments = if self.plan.bending { stripes } else { 0 };
        moments + self.gusts.len().div_ceil(GRAIN)
    }

    /// One of the parts that forces are made of, of the state as the last substep left it.
    pub(crate) fn part(&self, task: usize, stripes: &[Range<u32>], substep: &Substep) {
        let gust = match self.plan.bending {
            true if task < stripes.len() => return self.moments(stripes[task].clone(), substep),
            true => task - stripes.len(),
            false => task,
        };
        self.gusts(gust * GRAIN..((gust + 1) * GRAIN).min(self.gusts.len()), substep);
    }

    fn x(&self, vertex: u32) -> Vec3A {
        // SAFETY: see Forces.
        xyz(unsafe { self.x.get(vertex as usize) })
    }

    fn u(&self, vertex: u32) -> Vec3A {
        // SAFETY: see Forces.
        xyz(unsafe { self.u.get(vertex as usize) })
    }

    /// The bending rows of these vertices, from their rings.
    fn moments(&self, vertices: Range<u32>, substep: &Substep) {
        let (rows, entries) = (&self.plan.coefficients.bending, &self.plan.cloth.bending().entries);
        if !self.plan.damped() {
            for v in vertices {
                let center = self.x(v);
                let y = entries.of(v).iter().fold(Vec3A::ZERO, |y, entry| y + (self.x(entry.other) - center) * entry.forward);
                // SAFETY: see Forces.
                unsafe { self.pulls.set(v as usize, y * rows[v as usize].stiffness) };
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
                self.pulls.set(v as usize, pull);
                self.couples.set(v as usize, couple);
            }
        }
    }

    /// The air on these triangles.
    fn gusts(&self, triangles: Range<usize>, substep: &Substep) {
        let panels = &self.plan.cloth.panels().panels;
        for triangle in triangles {
            let panel = panels[triangle];
            let [a, b, c] = panel.corners;
            let velocity = (self.u(a) + self.u(b) + self.u(c)) * (substep.rate / 3.0);
            let force = kernels::wind_force([a, b, c].map(|v| self.x(v)), velocity, panel.mass, substep, &self.plan.params);
            // SAFETY: see Forces.
            unsafe { self.gusts.set(triangle, force / 3.0) };
        }
    }

    /// The displacements that the forces predict.
    pub(crate) fn predict(&self, vertices: Range<u32>, substep: &Substep) {
        let Plan { cloth, coefficients, params, .. } = self.plan;
        let ambient = Vec3A::from(params.acceleration);
        let bending = self.plan.bending.then(|| (&coefficients.bending, &cloth.bending().entries));
        let around = self.plan.wind.then(|| &cloth.panels().around);
        let springs = (self.plan.method == Method::Springs).then(|| cloth.springs());
        for i in vertices {
            // SAFETY: see Forces.
            let w = unsafe { self.x.get(i as usize) }.w;
            // Each term is added as its own stage does it on the GPU, in the same order: fewer roundings part the two.
            let mut by = kernels::predict(self.u(i), ambient, substep);
            let gain = w * substep.gain;
            if w == 0.0 {
                by = Vec3A::ZERO;
            } else {
                if let Some((rows, entries)) = bending {
                    by += self.bending(i, &rows[i as usize], entries.of(i)) * gain;
                }
                if let Some(around) = around {
                    // SAFETY: see Forces.
                    let force = around.of(i).iter().map(|&triangle| unsafe { self.gusts.get(triangle as usize) });
                    by += force.sum::<Vec3A>() * gain;
                }
                if let Some(springs) = springs {
                    let force = springs.of(i).iter().map(|s| kernels::spring_force(self.x(s.other) - self.x(i), s));
                    by += force.sum::<Vec3A>() * gain;
                }
            }
            // SAFETY: see Forces.
            unsafe { self.u.set(i as usize, by.extend(0.0)) };
        }
    }

    /// Force (N) of the bending rows that a vertex is in.
    fn bending(&self, i: u32, row: &BendRow, entries: &[BendEntry]) -> Vec3A {
        // SAFETY: see Forces.
        let of = |values: Shared<Vec3A>, vertex: u32| unsafe { values.get(vertex as usize) };
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
