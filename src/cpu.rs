//! The kernels on the processor's threads: a step is rounds of tasks over stripes of the cloth.

use std::ops::Range;
use std::sync::atomic::AtomicUsize;

use glam::{Vec3, Vec4};

use crate::cloth::{Cloth, MAX_POSITION};
use crate::coarse::{Coarse, Tasks};
use crate::crew::{Crew, Shared, Turns};
use crate::engine::Failure;
use crate::forces::Parts;
use crate::kernels::Substep;
use crate::lanes::{Breadth, Packed, Rule};
use crate::lines::Lines;
use crate::moves::{Moves, Then};
use crate::options::Method;
use crate::plan::Plan;

/// The state of the cloth in memory, one value per vertex in the cloth's order.
#[derive(Debug)]
pub(crate) struct Cpu {
    /// Positions (m), w the inverse mass (1/kg).
    pub x: Lines,
    /// Displacement over the last substep (m), and while a substep is made, over that. Its w means nothing.
    pub p: Lines,
    /// Where `x` and `p` go back to if the step fails.
    x_good: Lines,
    p_good: Lines,
    parts: Parts,
    /// The edges of each round, for substeps of `packed_h`.
    edges: Vec<Packed>,
    coarse: Coarse,
    packed_h: Option<f32>,
    crew: Crew,
    rounds: Vec<Round>,
    breadth: Breadth,
}

/// What a round does; a turn is a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Round {
    /// What forces are made of; nothing but in a substep's first turn.
    Parts,
    /// With levels: displacements of every stripe, predicted; then the rounds of [`Correction`](crate::coarse::Correction).
    Predict,
    Coarse(Tasks),
    /// The rest of every stripe, and its own edges.
    Stripes,
    /// Edges between stripes, those of this round of [`Stripes`](crate::stripes::Stripes).
    Borders(usize),
}

impl Cpu {
    pub(crate) fn new(cloth: &Cloth) -> Cpu {
        let zero = Lines::new(cloth.rest.len());
        let mut x = zero.clone();
        x.copy_from_slice(&cloth.rest);
        Cpu {
            x,
            p: zero.clone(),
            x_good: zero.clone(),
            p_good: zero,
            parts: Parts::default(),
            edges: Vec::new(),
            coarse: Coarse::default(),
            packed_h: None,
            crew: Crew::default(),
            rounds: Vec::new(),
            breadth: Breadth::detected(),
        }
    }

    /// Puts the state somewhere else.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        self.x.copy_from_slice(x);
        self.p.copy_from_slice(p);
    }

    /// One step: its substeps one after another. Fails, with the state as it was, if it left the bounds.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        match self.run(plan, 0..plan.substeps.len(), true) {
            None => Ok(()),
            Some(vertex) => {
                self.revert();
                Err(Failure::Unstable(vertex))
            }
        }
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
        match self.x.iter().zip(self.p.iter()).position(|(x, p)| !(bounded(x) && bounded(p))) {
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

    /// Some substeps of a step, whose displacements `p` are predicted already if there is one alone.
    pub(crate) fn substeps(&mut self, plan: &Plan<'_>, substeps: Range<usize>) {
        self.run(plan, substeps, false);
    }

    /// Some substeps of a step; `whole`: predicted here, the state remembered before, and the vertex named that leaves the bounds.
    fn run(&mut self, plan: &Plan<'_>, substeps: Range<usize>, whole: bool) -> Option<usize> {
        let stripes = plan.cloth.stripes();
        self.pack(plan);
        let lost = AtomicUsize::new(usize::MAX);
        let breadth = self.breadth;
        let (x, u) = (Shared::new(&mut self.x), Shared::new(&mut self.p));
        let good = [Shared::new(&mut self.x_good), Shared::new(&mut self.p_good)];
        let moves = Moves { plan, x, u, good, lost: &lost, breadth };
        let forces = self.parts.share(plan, x, u, whole, breadth);
        // Without forces a vertex is predicted where it was moved.
        let falls = whole && !forces.any();
        let leads = !plan.pins.is_empty();

        let rounds = &mut self.rounds;
        let coarse = self.coarse.share(plan, x, u, breadth);
        rounds.clear();
        self.crew.clear();
        let mut add = |round: Round, turns: Turns, tasks: usize| {
            if tasks > 0 {
                rounds.push(round);
                self.crew.add(turns, tasks);
            }
        };
        if whole && forces.any() {
            add(Round::Parts, Turns::All, forces.parts(stripes.ranges.len()));
        }
        if let Some(coarse) = &coarse {
            if whole || leads {
                add(Round::Predict, if falls && !leads { Turns::First } else { Turns::All }, stripes.ranges.len());
            }
            coarse.rounds(|tasks, count| add(Round::Coarse(tasks), Turns::All, count));
        }
        for (round, tasks) in stripes.rounds.iter().enumerate() {
            add(if round == 0 { Round::Stripes } else { Round::Borders(round) }, Turns::All, tasks.len());
        }

        let sweeps = plan.sweeps.max(1);
        let rule = match plan.method {
            Method::SmallSteps => Some(Rule::Project),
            Method::Relaxation { .. } => Some(Rule::Relax),
            Method::Springs => None,
        };
        let sweep = |edges: &Packed, task: usize| {
            let Some(rule) = rule else { return };
            #[expect(unsafe_code, reason = "tasks are kept apart by Stripes and Crew")]
            // SAFETY: in a round of stripes or borders a task visits vertices of its own alone.
            unsafe {
                edges.sweep(task, x, u, rule, breadth);
            }
        };
        let begin = |task: usize, turn: u32, substep: &Substep| {
            let range = stripes.ranges[task].clone();
            if whole && turn == 0 {
                moves.remember(range.clone());
            }
            if whole && forces.any() {
                forces.predict(range.clone(), substep);
            } else if falls && turn == 0 {
                moves.fall(range.clone(), substep);
            }
            forces.lead_pins(range, substep);
        };
        let turns = substeps.len() as u32 * sweeps;
        let edges = &self.edges;
        let end = |vertices: &[Range<u32>], turn: u32, substep: &Substep| {
            let then = match plan.substeps.get(substeps.start + (turn / sweeps) as usize + 1) {
                _ if whole && turn + 1 == turns => Then::Check,
                Some(next) if falls => Then::Fall(next),
                _ => Then::Wait,
            };
            moves.advance(vertices, substep, then);
        };
        let rounds = &self.rounds;
        let work = |turn: u32, kind: usize, task: usize| {
            let substep = &plan.substeps[substeps.start + (turn / sweeps) as usize];
            let (begins, ends) = (turn.is_multiple_of(sweeps), turn % sweeps + 1 == sweeps);
            match (rounds[kind], &coarse) {
                (Round::Stripes, coarse) => {
                    match coarse {
                        Some(coarse) => coarse.hand_down(stripes.ranges[task].clone()),
                        None if begins => begin(task, turn, substep),
                        None => {}
                    }
                    sweep(&edges[0], task);
                    if ends {
                        end(&stripes.rounds[0][task].vertices, turn, substep);
                    }
                }
                (Round::Borders(round), _) => {
                    sweep(&edges[round], task);
                    if ends {
                        end(&stripes.rounds[round][task].vertices, turn, substep);
                    }
                }
                (Round::Parts, _) if begins => forces.part(task, &stripes.ranges, substep),
                (Round::Predict, _) if begins => begin(task, turn, substep),
                (Round::Coarse(tasks), Some(coarse)) => coarse.work(tasks, task),
                _ => {}
            }
        };
        self.crew.run(turns, rayon::current_num_threads(), &work);
        let lost = lost.into_inner();
        (lost < usize::MAX).then_some(lost)
    }

    /// Makes the edges ready for substeps of the plan's length.
    fn pack(&mut self, plan: &Plan<'_>) {
        let coefficients = plan.coefficients;
        if self.packed_h.map(f32::to_bits) == Some(coefficients.h.to_bits()) {
            return;
        }
        let (stripes, inverse_mass) = (plan.cloth.stripes(), plan.cloth.inverse_mass());
        self.edges.resize_with(stripes.rounds.len(), Packed::default);
        for (packed, tasks) in self.edges.iter_mut().zip(&stripes.rounds) {
            packed.pack(tasks, &coefficients.edges, &plan.cloth.colors, &inverse_mass);
        }
        self.coarse.pack(plan.cloth, &coefficients.levels);
        self.packed_h = Some(coefficients.h);
    }
}
