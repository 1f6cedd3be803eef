//! The kernels on the processor's threads: a step is rounds of tasks over stripes of the cloth.

pub(crate) mod coarse;
pub(crate) mod edge_batches;
pub(crate) mod force_batches;
pub(crate) mod forces;
pub(crate) mod integrate;
pub(crate) mod partition;
pub(crate) mod scheduler;
pub(crate) mod shared;
pub(crate) mod sweep;

use std::ops::Range;
use std::sync::atomic::AtomicUsize;

use glam::Vec4;

use crate::backend::Failure;
use crate::cpu::coarse::{Coarse, Correction, Tasks};
use crate::cpu::edge_batches::Packed;
use crate::cpu::forces::{Forces, Parts};
use crate::cpu::integrate::{Moves, Then};
use crate::cpu::partition::{Stripes, Task};
use crate::cpu::scheduler::{Crew, Meets, Turns};
use crate::cpu::shared::Shared;
use crate::cpu::sweep::Rule;
use crate::model::cloth::Cloth;
use crate::options::Method;
use crate::simd::Breadth;
use crate::simd::aligned::Lines;
use crate::step::plan::Plan;

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
    /// The edges of each round, for what they are `packed_for`.
    edges: Vec<Packed>,
    coarse: Coarse,
    /// The sweep's tasks, once they are needed.
    stripes: Option<Stripes>,
    /// Bits of the substep (s), and levels.
    packed_for: Option<(u32, usize)>,
    crew: Crew,
    rounds: Vec<Round>,
    breadth: Breadth,
}

/// The state as the tasks of a round share it: positions and displacements, as in [`Cpu`].
#[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only a GPU is elsewhere"))]
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    pub x: Shared<Vec4>,
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

/// What a round does; a turn is a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Round {
    /// What is predicted elsewhere comes from there.
    Exchange,
    /// What forces are made of, of bending and of air; nothing but in a substep's first turn.
    Moments,
    Gusts,
    /// With levels: displacements of every stripe, predicted; then the rounds of [`Correction`](crate::cpu::coarse::Correction).
    Predict,
    Coarse(Tasks),
    /// The rest of every stripe, and its own edges.
    Stripes,
    /// Edges between stripes, those of this round of [`Stripes`](crate::cpu::partition::Stripes).
    Borders(usize),
}

impl Round {
    /// The rounds of a turn in order, when they come, and of how many tasks.
    fn each(
        plan: &Plan<'_>,
        stripes: &Stripes,
        elsewhere: bool,
        forces: &Forces<'_>,
        coarse: Option<&Correction<'_>>,
        mut add: impl FnMut(Round, Turns, usize),
    ) {
        if elsewhere {
            add(Round::Exchange, Turns::All, 1);
        } else {
            add(Round::Moments, Turns::All, if plan.bending { stripes.ranges.len() } else { 0 });
            add(Round::Gusts, Turns::All, forces.winded.len());
        }
        if let Some(coarse) = coarse {
            let falls = !elsewhere && !forces.any() && plan.pins.is_empty();
            add(Round::Predict, if falls { Turns::First } else { Turns::All }, stripes.ranges.len());
            coarse.rounds(|tasks, count| add(Round::Coarse(tasks), Turns::All, count));
        }
        for (round, tasks) in stripes.rounds.iter().enumerate() {
            add(if round == 0 { Round::Stripes } else { Round::Borders(round) }, Turns::All, tasks.len());
        }
    }

    /// The stripes that a task touches, given those of the air's.
    fn touches<'a>(self, task: usize, stripes: &'a Stripes, winded: &'a [Vec<u32>]) -> &'a [u32] {
        match self {
            Round::Exchange | Round::Coarse(_) => &[],
            Round::Moments => &stripes.around[task],
            Round::Gusts => &winded[task],
            Round::Predict | Round::Stripes => &stripes.rounds[0][task].touches,
            Round::Borders(round) => &stripes.rounds[round][task].touches,
        }
    }

    fn meets(self) -> Meets {
        match self {
            Round::Exchange | Round::Coarse(_) => Meets::All,
            _ => Meets::Neighbours,
        }
    }
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
            stripes: None,
            packed_for: None,
            crew: Crew::default(),
            rounds: Vec::new(),
            breadth: Breadth::detected(),
        }
    }

    /// Forgets that the processor can do more at once than this.
    pub(crate) fn narrow(&mut self, breadth: Breadth) {
        (self.breadth, self.packed_for) = (breadth, None);
        (self.parts, self.coarse) = Default::default();
    }

    /// Puts the state somewhere else.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        self.x.copy_from_slice(x);
        self.p.copy_from_slice(p);
    }

    /// One step: its substeps one after another. Fails, with the state as it was, if it left the bounds.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        self.step_with(plan, None)
    }

    /// [`Cpu::step`], its displacements predicted elsewhere if anywhere.
    pub(crate) fn step_with(&mut self, plan: &Plan<'_>, elsewhere: Option<&Elsewhere<'_>>) -> Result<(), Failure> {
        match self.run(plan, elsewhere) {
            None => Ok(()),
            Some(vertex) => {
                self.revert();
                Err(Failure::Unstable(vertex))
            }
        }
    }

    /// Back to where the last step began.
    pub(crate) fn revert(&mut self) {
        self.x.copy_from_slice(&self.x_good);
        self.p.copy_from_slice(&self.p_good);
    }

    /// The substeps of a step; names a vertex that leaves the bounds.
    fn run(&mut self, plan: &Plan<'_>, elsewhere: Option<&Elsewhere<'_>>) -> Option<usize> {
        self.pack(plan);
        let stripes = self.stripes.as_ref().expect("packed");
        let lost = AtomicUsize::new(usize::MAX);
        let (breadth, x, u) = (self.breadth, self.x.share(), self.p.share());
        let good = [self.x_good.share(), self.p_good.share()];
        let moves = Moves { plan, x, u, good, lost: &lost, breadth };
        let forces = self.parts.share(plan, &stripes.ranges, x, u, elsewhere.is_none(), breadth);
        // Without forces a vertex is predicted where it was moved.
        let falls = elsewhere.is_none() && !forces.any();

        let rounds = &mut self.rounds;
        let coarse = self.coarse.share(plan, x, u, breadth);
        rounds.clear();
        self.crew.clear();
        Round::each(plan, stripes, elsewhere.is_some(), &forces, coarse.as_ref(), |round, turns, tasks| {
            if tasks > 0 {
                rounds.push(round);
                self.crew.add(turns, round.meets(), tasks);
            }
        });

        let sweeps = plan.sweeps.max(1);
        let rule = rule(plan.method);
        let sweep = |edges: &Packed, task: usize| {
            let Some(rule) = rule else { return };
            #[expect(unsafe_code, reason = "tasks are kept apart by Stripes and Crew")]
            // SAFETY: a task visits vertices of stripes that it touches, and beside it none of its round does.
            unsafe {
                edges.sweep(task, x, u, rule);
            }
        };
        let state = State { x, u };
        let begin = |task: usize, turn: u32, index: usize| {
            let (range, substep) = (stripes.ranges[task].clone(), &plan.substeps[index]);
            if turn == 0 {
                moves.remember(range.clone());
            }
            if let Some(elsewhere) = elsewhere {
                (elsewhere.predict)(std::slice::from_ref(&range), index, state);
            } else if turn == 0 || !falls {
                forces.predict(range.clone(), substep);
            }
            forces.lead_pins(range, substep);
        };
        let turns = plan.substeps.len() as u32 * sweeps;
        let edges = &self.edges;
        let end = |vertices: &[Range<u32>], index: usize| {
            let then = match plan.substeps.get(index + 1) {
                None => Then::Check,
                Some(next) if falls => Then::Fall(next),
                Some(_) => Then::Wait,
            };
            moves.advance(vertices, &plan.substeps[index], then);
            elsewhere.into_iter().for_each(|elsewhere| (elsewhere.moved)(vertices, index, state));
        };
        let rounds = &self.rounds;
        let threads = rayon::current_num_threads();
        let member = |&stripe: &u32| stripe as usize * threads / stripes.ranges.len();
        let work = |turn: u32, kind: usize, task: usize| {
            let index = (turn / sweeps) as usize;
            let (begins, ends) = (turn.is_multiple_of(sweeps), turn % sweeps + 1 == sweeps);
            match (rounds[kind], &coarse) {
                (Round::Exchange, _) if begins => elsewhere.into_iter().for_each(|elsewhere| (elsewhere.exchange)(index)),
                (Round::Stripes, coarse) => {
                    match coarse {
                        Some(coarse) => coarse.hand_down(stripes.ranges[task].clone()),
                        None if begins => begin(task, turn, index),
                        None => {}
                    }
                    sweep(&edges[0], task);
                    if ends {
                        end(&stripes.rounds[0][task].vertices, index);
                    }
                }
                (Round::Borders(round), _) => {
                    let Task { vertices, touches, .. } = &stripes.rounds[round][task];
                    // Between two threads' stripes half of them are in the other's cache.
                    if touches.first().map(member) != touches.last().map(member) {
                        vertices.iter().for_each(|range| [x, u].iter().for_each(|values| values.claim(range.clone())));
                    }
                    sweep(&edges[round], task);
                    if ends {
                        end(vertices, index);
                    }
                }
                (Round::Moments, _) if begins => forces.moments(stripes.ranges[task].clone(), &plan.substeps[index]),
                (Round::Gusts, _) if begins => forces.gusts(task, &plan.substeps[index]),
                (Round::Predict, _) if begins => begin(task, turn, index),
                (Round::Coarse(tasks), Some(coarse)) => coarse.work(tasks, task),
                _ => {}
            }
        };
        let touches = |kind: usize, task: usize| rounds[kind].touches(task, stripes, forces.winded);
        self.crew.run(turns, threads, &touches, &work);
        let lost = lost.into_inner();
        (lost < usize::MAX).then_some(lost)
    }

    /// Makes the edges ready for substeps of the plan's length.
    fn pack(&mut self, plan: &Plan<'_>) {
        let coefficients = plan.coefficients;
        let wanted = Some((coefficients.h.to_bits(), coefficients.levels.len()));
        if self.packed_for == wanted {
            return;
        }
        self.packed_for = wanted;
        let cloth = plan.cloth;
        let stripes = self.stripes.get_or_insert_with(|| Stripes::new(&cloth.links, cloth.swept().len(), cloth.rest.len()));
        let inverse_mass = cloth.inverse_mass();
        // The old ones first, or memory would hold both.
        self.edges = Vec::new();
        let pack = |tasks: &Vec<Task>| Packed::new(tasks, &coefficients.edges, &plan.cloth.colors, &inverse_mass, self.breadth);
        self.edges = stripes.rounds.iter().map(pack).collect();
        self.coarse.pack(plan.levels, &coefficients.levels, self.breadth);
    }
}

/// How a method's edges are swept, if they are.
fn rule(method: Method) -> Option<Rule> {
    match method {
        Method::SmallSteps => Some(Rule::Project),
        Method::Relaxation { .. } => Some(Rule::Relax),
        Method::Springs => None,
    }
}
