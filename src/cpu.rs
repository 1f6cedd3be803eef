//! The kernels on the processor's threads: a step is rounds of tasks over stripes of the cloth.

use std::ops::Range;

use glam::{Vec3, Vec3A, Vec4};

use crate::cloth::{Cloth, MAX_POSITION, Panels};
use crate::coarse::Coarse;
use crate::crew::{Crew, Shared};
use crate::engine::Failure;
use crate::kernels::{self, BendEntry, BendRow, Substep, xyz};
use crate::lanes::{self, Packed, Rule};
use crate::options::Method;
use crate::plan::Plan;

/// The state of the cloth in memory, one value per vertex in the cloth's order.
#[derive(Debug)]
pub(crate) struct Cpu {
    /// Positions (m), w the inverse mass (1/kg).
    pub x: Vec<Vec4>,
    /// Displacement over the last substep (m).
    pub p: Vec<Vec4>,
    /// Displacement over this substep (m), being made. Its w means nothing.
    pub u: Vec<Vec4>,
    /// Where `x` and `p` go back to if the step fails.
    x_good: Vec<Vec4>,
    p_good: Vec<Vec4>,
    /// What each vertex's bending row does ([`kernels::bend_moment`]); empty without bending, couples without its damping.
    pulls: Vec<Vec3A>,
    couples: Vec<Vec3A>,
    /// The edges of each round, for substeps of `packed_h`.
    first: Packed,
    second: Packed,
    coarse: Coarse,
    packed_h: Option<f32>,
    crew: Crew,
    wide: bool,
}

/// The state as the tasks of a round share it.
#[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only a GPU is elsewhere"))]
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    pub x: Shared<Vec4>,
    pub p: Shared<Vec4>,
    pub u: Shared<Vec4>,
}

/// A loop over some vertices in a substep.
pub(crate) type Loop<'a> = dyn Fn(&[Range<u32>], usize, State) + Sync + 'a;

/// How displacements are predicted elsewhere; substeps are named by their number in the step.
pub(crate) struct Elsewhere<'a> {
    /// Before each substep, while no other task runs.
    pub exchange: &'a (dyn Fn(usize) + Sync),
    /// Predicts `u` of some vertices.
    pub predict: &'a Loop<'a>,
    /// Sees some vertices that were moved.
    pub moved: &'a Loop<'a>,
}

/// What a round does; each kind comes once a turn, a turn is a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Round {
    /// What is predicted elsewhere comes from there.
    Exchange,
    /// Bending moments of every stripe.
    Moments,
    /// With levels: displacements of every stripe, predicted; then the rounds of [`Correction`](crate::coarse::Correction).
    Predict,
    Restrict,
    Coarser,
    CoarseStripes,
    CoarseBorders,
    /// The rest of every stripe, and its own edges.
    Stripes,
    /// The edges between stripes.
    Borders,
}

impl Cpu {
    pub(crate) fn new(cloth: &Cloth) -> Cpu {
        let zero = vec![Vec4::ZERO; cloth.rest.len()];
        Cpu {
            x: cloth.rest.clone(),
            p: zero.clone(),
            u: zero.clone(),
            x_good: zero.clone(),
            p_good: zero,
            pulls: Vec::new(),
            couples: Vec::new(),
            first: Packed::default(),
            second: Packed::default(),
            coarse: Coarse::default(),
            packed_h: None,
            crew: Crew::default(),
            wide: lanes::is_wide(),
        }
    }

    /// Puts the state somewhere else.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        self.x.copy_from_slice(x);
        self.p.copy_from_slice(p);
    }

    /// One step: its substeps one after another. Fails, with the state as it was, if it left the bounds.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        self.begin();
        self.substeps(plan, None);
        self.end()
    }

    /// Remembers the state.
    pub(crate) fn begin(&mut self) {
        self.x_good.copy_from_slice(&self.x);
        self.p_good.copy_from_slice(&self.p);
    }

    /// Keeps the state if it is within bounds, else goes back to what [`Cpu::begin`] remembered.
    pub(crate) fn end(&mut self) -> Result<(), Failure> {
        // NaN is not below the limit either.
        let bounded = |v: &Vec4| v.truncate().abs().cmple(Vec3::splat(MAX_POSITION)).all();
        match self.x.iter().zip(&self.p).position(|(x, p)| !(bounded(x) && bounded(p))) {
            None => Ok(()),
            Some(vertex) => {
                self.revert();
                Err(Failure::Unstable(vertex))
            }
        }
    }

    /// Back to what [`Cpu::begin`] remembered.
    pub(crate) fn revert(&mut self) {
        self.x.copy_from_slice(&self.x_good);
        self.p.copy_from_slice(&self.p_good);
    }

    /// The substeps of a step. `elsewhere`: where displacements are predicted, if not here.
    pub(crate) fn substeps(&mut self, plan: &Plan<'_>, elsewhere: Option<&Elsewhere<'_>>) {
        let stripes = plan.cloth.stripes();
        let coefficients = plan.coefficients;
        if self.packed_h.map(f32::to_bits) != Some(coefficients.h.to_bits()) {
            let inverse_mass = plan.cloth.inverse_mass();
            for (packed, tasks) in [(&mut self.first, &stripes.first), (&mut self.second, &stripes.second)] {
                packed.pack(tasks, &coefficients.edges, &plan.cloth.colors, &inverse_mass);
            }
            self.coarse.pack(plan.cloth, &coefficients.levels);
            self.packed_h = Some(coefficients.h);
        }
        let bending = elsewhere.is_none() && plan.bending;
        if bending {
            self.pulls.resize(self.x.len(), Vec3A::ZERO);
            self.couples.resize(if plan.damped() { self.x.len() } else { 0 }, Vec3A::ZERO);
        }
        let coarse = self.coarse.tasks();
        let [restrict, coarser, coarse_stripes, coarse_borders] = coarse.unwrap_or_default();
        let all = [
            (Round::Exchange, elsewhere.is_some(), 1),
            (Round::Moments, bending, stripes.ranges.len()),
            (Round::Predict, coarse.is_some(), stripes.ranges.len()),
            (Round::Restrict, coarse.is_some(), restrict),
            (Round::Coarser, coarse.is_some(), coarser),
            (Round::CoarseStripes, coarse.is_some(), coarse_stripes),
            (Round::CoarseBorders, coarse_borders > 0, coarse_borders),
            (Round::Stripes, true, stripes.first.len()),
            (Round::Borders, !stripes.second.is_empty(), stripes.second.len()),
        ];
        let present = || all.iter().filter(|round| round.1);
        self.crew.prepare(present().map(|round| round.2));
        let mut kinds = [Round::Stripes; 9];
        kinds.iter_mut().zip(present()).for_each(|(kind, round)| *kind = round.0);

        let sweeps = plan.sweeps.max(1);
        let wide = self.wide;
        let (x, u) = (Shared::new(&mut self.x), Shared::new(&mut self.u));
        let levels = self.coarse.share(plan, x, u, wide);
        let at = Loops {
            plan,
            x,
            p: Shared::new(&mut self.p),
            u,
            pulls: Shared::new(&mut self.pulls),
            couples: Shared::new(&mut self.couples),
        };
        let (first, second) = (&self.first, &self.second);
        let state = State { x, p: at.p, u };
        let begin = |task: usize, index: usize| {
            let (range, substep) = (stripes.ranges[task].clone(), &plan.substeps[index]);
            match elsewhere {
                None => at.predict(range.clone(), substep),
                Some(elsewhere) => (elsewhere.predict)(std::slice::from_ref(&range), index, state),
            }
            at.lead_pins(range, substep);
        };
        let end = |vertices: &[Range<u32>], index: usize| {
            at.advance(vertices, &plan.substeps[index]);
            elsewhere.into_iter().for_each(|elsewhere| (elsewhere.moved)(vertices, index, state));
        };
        let work = |turn: u32, kind: usize, task: usize| {
            let index = (turn / sweeps) as usize;
            let (begins, ends) = (turn.is_multiple_of(sweeps), turn % sweeps + 1 == sweeps);
            match (kinds[kind], &levels) {
                (Round::Exchange, _) if begins => elsewhere.into_iter().for_each(|elsewhere| (elsewhere.exchange)(index)),
                (Round::Stripes, levels) => {
                    match levels {
                        Some(levels) => levels.hand_down(stripes.ranges[task].clone()),
                        None if begins => begin(task, index),
                        None => {}
                    }
                    at.sweep(first, task, wide);
                    if ends {
                        end(&stripes.first[task].vertices, index);
                    }
                }
                (Round::Borders, _) => {
                    at.sweep(second, task, wide);
                    if ends {
                        end(&stripes.second[task].vertices, index);
                    }
                }
                (Round::Moments, _) if begins => at.moments(stripes.ranges[task].clone(), &plan.substeps[index]),
                (Round::Predict, _) => begin(task, index),
                (Round::Restrict, Some(levels)) => levels.restrict(task),
                (Round::Coarser, Some(levels)) => levels.coarser(),
                (Round::CoarseStripes, Some(levels)) => levels.sweep(task, false),
                (Round::CoarseBorders, Some(levels)) => levels.sweep(task, true),
                _ => {}
            }
        };
        let turns = plan.substeps.len() as u32 * sweeps;
        self.crew.run(turns, rayon::current_num_threads(), &work);
    }
}

/// The loops of the rounds, over state that the tasks of a round share.
///
/// Why no two tasks meet: in a round of stripes a task writes `u` in its own stripe, and `x` and `p` at those vertices of it that
/// do not wait for a border. It reads `x`, `p` and moments there and at neighbours; a neighbour in another stripe waits for its
/// border ([`Stripes`](crate::stripes::Stripes)), so that nobody writes its `x` and `p` in this round. In a round of borders a
/// task reads and writes at vertices of its own alone. In a round of moments nobody writes `x`, `p` or `u`.
struct Loops<'a> {
    plan: &'a Plan<'a>,
    x: Shared<Vec4>,
    p: Shared<Vec4>,
    u: Shared<Vec4>,
    pulls: Shared<Vec3A>,
    couples: Shared<Vec3A>,
}

#[expect(unsafe_code, reason = "see Loops; indices are vertices of the cloth, checked when its lists are built")]
impl Loops<'_> {
    fn x(&self, vertex: u32) -> Vec3A {
        // SAFETY: see Loops.
        xyz(unsafe { self.x.get(vertex as usize) })
    }

    fn p(&self, vertex: u32) -> Vec3A {
        // SAFETY: see Loops.
        xyz(unsafe { self.p.get(vertex as usize) })
    }

    /// The bending rows of these vertices, from their rings.
    fn moments(&self, vertices: Range<u32>, substep: &Substep) {
        let (rows, entries) = (&self.plan.coefficients.bending, &self.plan.cloth.bending().entries);
        if !self.plan.damped() {
            for v in vertices {
                let center = self.x(v);
                let y = entries.of(v).iter().fold(Vec3A::ZERO, |y, entry| y + (self.x(entry.other) - center) * entry.forward);
                // SAFETY: see Loops.
                unsafe { self.pulls.set(v as usize, y * rows[v as usize].stiffness) };
            }
            return;
        }
        for v in vertices {
            let mut ring = kernels::Ring::default();
            for entry in entries.of(v).iter().filter(|entry| entry.forward != 0.0) {
                let rate = (self.p(entry.other) - self.p(v)) * substep.rate;
                ring.add(self.x(entry.other) - self.x(v), rate, entry.forward);
            }
            let (pull, couple) = kernels::bend_moment(&ring, &rows[v as usize]);
            // SAFETY: see Loops.
            unsafe {
                self.pulls.set(v as usize, pull);
                self.couples.set(v as usize, couple);
            }
        }
    }

    /// Forces, and the displacement that they predict.
    fn predict(&self, vertices: Range<u32>, substep: &Substep) {
        let Plan { cloth, coefficients, params, .. } = self.plan;
        let bending = self.plan.bending.then(|| (&coefficients.bending, &cloth.bending().entries));
        let panels = self.plan.wind.then(|| cloth.panels());
        let springs = (self.plan.method == Method::Springs).then(|| cloth.springs());
        let ambient = Vec3A::from(params.acceleration);
        if bending.is_none() && panels.is_none() && springs.is_none() {
            return self.fall(vertices, ambient, substep);
        }
        for i in vertices {
            // SAFETY: see Loops.
            let w = unsafe { self.x.get(i as usize) }.w;
            // Each term is added as its own stage does it on the GPU, in the same order: fewer roundings part the two.
            let mut by = kernels::predict(self.p(i), ambient, substep);
            let gain = w * substep.gain;
            if w == 0.0 {
                by = Vec3A::ZERO;
            } else {
                if let Some((rows, entries)) = bending {
                    by += self.bending(i, &rows[i as usize], entries.of(i)) * gain;
                }
                if let Some(panels) = panels {
                    by += self.wind(i, panels, substep) * gain;
                }
                if let Some(springs) = springs {
                    let force = springs.of(i).iter().map(|s| kernels::spring_force(self.x(s.other) - self.x(i), s));
                    by += force.sum::<Vec3A>() * gain;
                }
            }
            // SAFETY: see Loops.
            unsafe { self.u.set(i as usize, by.extend(0.0)) };
        }
    }

    /// [`Loops::predict`] where nothing but the ambient acceleration acts.
    fn fall(&self, vertices: Range<u32>, ambient: Vec3A, substep: &Substep) {
        for i in vertices.start as usize..vertices.end as usize {
            // SAFETY: see Loops.
            unsafe {
                let by = kernels::predict(xyz(self.p.get(i)), ambient, substep).extend(0.0);
                self.u.set(i, if self.x.get(i).w == 0.0 { Vec4::ZERO } else { by });
            }
        }
    }

    /// Force (N) of the bending rows that a vertex is in.
    fn bending(&self, i: u32, row: &BendRow, entries: &[BendEntry]) -> Vec3A {
        // SAFETY: see Loops.
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

    /// Force (N) of the air on a vertex: a third of that on each triangle around.
    fn wind(&self, i: u32, panels: &Panels, substep: &Substep) -> Vec3A {
        let mut force = Vec3A::ZERO;
        for &triangle in panels.around.of(i) {
            let panel = panels.panels[triangle as usize];
            let [a, b, c] = panel.corners;
            let velocity = (self.p(a) + self.p(b) + self.p(c)) * (substep.rate / 3.0);
            force += kernels::wind_force([a, b, c].map(|v| self.x(v)), velocity, panel.mass, substep, &self.plan.params) / 3.0;
        }
        force
    }

    /// Displacements of the pins among these vertices.
    fn lead_pins(&self, vertices: Range<u32>, substep: &Substep) {
        let pins = self.plan.pins;
        let first = pins.partition_point(|pin| pin.vertex < vertices.start);
        for pin in pins[first..].iter().take_while(|pin| pin.vertex < vertices.end) {
            let (origin, goal) = (Vec3A::from(pin.origin), Vec3A::from(pin.goal));
            let by = origin + (goal - origin) * substep.end - self.x(pin.vertex);
            // SAFETY: see Loops.
            unsafe { self.u.set(pin.vertex as usize, by.extend(0.0)) };
        }
    }

    fn sweep(&self, edges: &Packed, task: usize, wide: bool) {
        let rule = match self.plan.method {
            Method::SmallSteps => Rule::Project,
            Method::Relaxation { .. } => Rule::Relax,
            Method::Springs => return,
        };
        // SAFETY: see Loops.
        unsafe { edges.sweep(task, self.x, self.u, rule, wide) };
    }

    /// Contact, and the move.
    fn advance(&self, ranges: &[Range<u32>], substep: &Substep) {
        let free = self.plan.bodies.is_empty();
        for i in ranges.iter().flat_map(|range| range.start as usize..range.end as usize) {
            // SAFETY: see Loops.
            let (x, u) = unsafe { (self.x.get(i), self.u.get(i)) };
            let (mut at, mut by) = (xyz(x), xyz(u));
            if !free && x.w > 0.0 {
                for body in self.plan.bodies {
                    (at, by) = kernels::contact(at, by, body, substep, &self.plan.params);
                }
            }
            // SAFETY: see Loops.
            unsafe {
                self.x.set(i, (at + by).extend(x.w));
                self.p.set(i, by.extend(0.0));
            }
        }
    }
}
