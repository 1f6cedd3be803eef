//! The kernels run by rayon: over vertices, and over the edges of one colour at a time.

use glam::{Vec3, Vec3A, Vec4};
use rayon::prelude::*;

use crate::cloth::{Cloth, MAX_POSITION};
use crate::coarse::Coarse;
use crate::engine::Failure;
use crate::kernels::{self, Substep, xyz};
use crate::options::Method;
use crate::plan::Plan;

/// Vertices a rayon task takes at a time: fewer are not worth waking a thread for.
const GRAIN: usize = 1024;
/// From this many vertices on, loops are parallel.
pub(crate) const PARALLEL: usize = 2 * GRAIN;

/// The state of the cloth in memory, one value per vertex in the cloth's order.
#[derive(Debug, Clone)]
pub(crate) struct Cpu {
    /// Positions (m), w the inverse mass (1/kg).
    pub x: Vec<Vec4>,
    /// Displacement over the last substep (m).
    pub p: Vec<Vec4>,
    /// Displacement over this substep (m), being made.
    pub u: Vec<Vec4>,
    /// What each vertex's bending row does; empty without bending.
    moments: Vec<Moment>,
    coarse: Coarse,
}

/// See [`kernels::bend_moment`].
#[derive(Debug, Clone, Copy, Default)]
struct Moment {
    pull: Vec3A,
    couple: Vec3A,
}

impl Cpu {
    pub(crate) fn new(cloth: &Cloth) -> Cpu {
        let zero = vec![Vec4::ZERO; cloth.rest.len()];
        Cpu { x: cloth.rest.clone(), p: zero.clone(), u: zero, moments: Vec::new(), coarse: Coarse::default() }
    }

    /// Puts the state somewhere else.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        self.x.copy_from_slice(x);
        self.p.copy_from_slice(p);
    }

    /// Keeps the state if it is within bounds, else goes back to `before`.
    pub(crate) fn keep_or_restore(&mut self, before: (Vec<Vec4>, Vec<Vec4>)) -> Result<(), Failure> {
        // NaN is not below the limit either.
        let bounded = |v: &Vec4| v.truncate().abs().cmple(Vec3::splat(MAX_POSITION)).all();
        match self.x.iter().zip(&self.p).position(|(x, p)| !(bounded(x) && bounded(p))) {
            None => Ok(()),
            Some(vertex) => {
                (self.x, self.p) = before;
                Err(Failure::Unstable(vertex))
            }
        }
    }

    /// One step: its substeps one after another.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) {
        for substep in &plan.substeps {
            self.forces(plan, substep);
            self.finish(plan, substep);
        }
    }

    /// Stage 1: forces, and the displacement they predict.
    fn forces(&mut self, plan: &Plan<'_>, substep: &Substep) {
        let (x, p) = (&self.x, &self.p);
        let Plan { cloth, coefficients, params, .. } = plan;
        let bending = plan.bending.then(|| (&coefficients.bending, &cloth.bending().entries));
        if let Some((rows, entries)) = bending {
            self.moments.resize(x.len(), Moment::default());
            for_each(&mut self.moments, |v, moment| {
                let mut ring = kernels::Ring::default();
                for entry in entries.of(v as u32) {
                    let j = entry.other as usize;
                    let d = xyz(x[j] - x[v]);
                    if params.damped == 0 {
                        ring.y += d * entry.forward;
                    } else if entry.forward != 0.0 {
                        ring.add(d, xyz(p[j] - p[v]) * substep.rate, entry.forward);
                    }
                }
                let (pull, couple) = kernels::bend_moment(&ring, &rows[v]);
                *moment = Moment { pull, couple };
            });
        }
        let moments = &self.moments;
        let panels = plan.wind.then(|| cloth.panels());
        let springs = (plan.method == Method::Springs).then(|| cloth.springs());
        let ambient = Vec3A::from(params.acceleration);
        for_each(&mut self.u, |i, u| {
            let w = x[i].w;
            if w == 0.0 {
                *u = Vec4::ZERO;
                return;
            }
            // Each term is added as its own stage does it on the GPU, in the same order: fewer roundings part the two.
            let mut by = kernels::predict(xyz(p[i]), ambient, substep);
            let gain = w * substep.gain;
            if let Some((rows, entries)) = bending {
                let own = moments[i];
                let mut force = -own.pull * rows[i].diagonal;
                for entry in entries.of(i as u32) {
                    let other = moments[entry.other as usize];
                    force -= other.pull * entry.backward;
                    if params.damped != 0 {
                        let d = xyz(x[entry.other as usize] - x[i]);
                        force -= kernels::couple(own.couple, other.couple, entry).cross(d);
                    }
                }
                by += force * gain;
            }
            if let Some(panels) = panels {
                let mut force = Vec3A::ZERO;
                for &triangle in panels.around.of(i as u32) {
                    let panel = panels.panels[triangle as usize];
                    let [a, b, c] = panel.corners.map(|corner| corner as usize);
                    let velocity = (xyz(p[a]) + xyz(p[b]) + xyz(p[c])) * (substep.rate / 3.0);
                    force += kernels::wind_force([xyz(x[a]), xyz(x[b]), xyz(x[c])], velocity, panel.mass, substep, params) / 3.0;
                }
                by += force * gain;
            }
            if let Some(springs) = springs {
                let mut force = Vec3A::ZERO;
                for spring in springs.of(i as u32) {
                    force += kernels::spring_force(xyz(x[spring.other as usize] - x[i]), spring);
                }
                by += force * gain;
            }
            *u = by.extend(0.0);
        });
    }

    /// Stages 2 and 3: pins, the sweep over the edges, contact, and the move.
    pub(crate) fn finish(&mut self, plan: &Plan<'_>, substep: &Substep) {
        for pin in &plan.pins {
            let (origin, goal) = (Vec3A::from(pin.origin), Vec3A::from(pin.goal));
            let i = pin.vertex as usize;
            self.u[i] = (origin + (goal - origin) * substep.end - xyz(self.x[i])).extend(0.0);
        }
        self.coarse.correct(plan, &self.x, &mut self.u);
        for _ in 0..plan.sweeps {
            self.sweep(plan);
        }
        self.contact(plan, substep);
    }

    fn sweep(&mut self, plan: &Plan<'_>) {
        let x = &self.x;
        let correct =
            |edge: &kernels::Edge, u_a: &mut Vec4, u_b: &mut Vec4, kernel: fn(Vec3A, Vec3A, &kernels::Edge) -> Vec3A| {
                let (x_a, x_b) = (x[edge.a as usize], x[edge.b as usize]);
                let impulse = kernel(xyz(x_a - x_b), xyz(*u_a - *u_b), edge).extend(0.0);
                *u_a += impulse * x_a.w;
                *u_b -= impulse * x_b.w;
            };
        let edges = &plan.coefficients.edges;
        if matches!(plan.method, Method::Relaxation { .. }) {
            edges.for_each(&mut self.u, |edge, u_a, u_b| correct(edge, u_a, u_b, kernels::relax));
        } else {
            edges.for_each(&mut self.u, |edge, u_a, u_b| correct(edge, u_a, u_b, kernels::project));
        }
    }

    fn contact(&mut self, plan: &Plan<'_>, substep: &Substep) {
        let u = &self.u;
        let touch = |i: usize, x: &mut Vec4, p: &mut Vec4| {
            let (mut at, mut by) = (xyz(*x), xyz(u[i]));
            if x.w > 0.0 {
                for body in &plan.bodies {
                    (at, by) = kernels::contact(at, by, body, substep, &plan.params);
                }
            }
            *x = (at + by).extend(x.w);
            *p = by.extend(0.0);
        };
        if u.len() < PARALLEL {
            self.x.iter_mut().zip(&mut self.p).enumerate().for_each(|(i, (x, p))| touch(i, x, p));
        } else {
            let both = self.x.par_iter_mut().zip(&mut self.p);
            both.with_min_len(GRAIN).enumerate().for_each(|(i, (x, p))| touch(i, x, p));
        }
    }
}

/// Calls `f(index, item)` for every item, in parallel when there are enough.
fn for_each<T: Send>(items: &mut [T], f: impl Fn(usize, &mut T) + Sync + Send) {
    if items.len() < PARALLEL {
        items.iter_mut().enumerate().for_each(|(index, item)| f(index, item));
    } else {
        items.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(index, item)| f(index, item));
    }
}
