//! The Gauss-Seidel sweep over the edges: as many edges at once as there are SIMD lanes.

use crate::cpu::edge_batches::{EdgeBatch, Ends};
use crate::cpu::tasks::shared::View;
use crate::cpu::tasks::shared::vectors::Four;
use crate::kernels::distance::{self, EdgeCorrection};
use crate::kernels::params;
use crate::options::Method;
use crate::simd::{Loop, Registers, Vector};
use crate::step::plan::Plan;

/// Which kernel corrects the edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Rule {
    /// [`distance::project_edge`].
    Project,
    /// [`distance::pull_coarse`].
    PullCoarse,
    /// [`distance::project_coarse`].
    ProjectCoarse { per_slack: f32 },
    /// [`distance::hold_coarse`].
    HoldCoarse,
    /// [`distance::relax_edge`].
    Relax,
}

impl Rule {
    /// How a method corrects edges; none for springs, which are forces.
    pub(crate) fn of(method: Method) -> Option<Rule> {
        match method {
            Method::SmallSteps => Some(Rule::Project),
            Method::Relaxation { .. } => Some(Rule::Relax),
            Method::Springs => None,
        }
    }

    /// How coarse edges are corrected.
    pub(crate) fn of_levels(plan: &Plan<'_>) -> Rule {
        match plan.params.coarse_rule {
            params::PULL_COARSE => Rule::PullCoarse,
            params::HOLD_COARSE => Rule::HoldCoarse,
            _ => Rule::ProjectCoarse { per_slack: plan.params.per_slack },
        }
    }
}

/// Values of the parameter `RULE` of [`SweepRows::rows`], one for each rule.
const PROJECT: u8 = 0;
const PULL_COARSE: u8 = 1;
const PROJECT_COARSE: u8 = 2;
const HOLD_COARSE: u8 = 3;
const RELAX: u8 = 4;

/// Corrects a batch of rows in order. A row is as many edges as there are lanes, no two of which share a vertex. Coarse edges that
/// undo what others shorten them by also read what was `predicted` for `u`.
pub(crate) struct SweepRows<'t> {
    pub rule: Rule,
    pub batch: EdgeBatch<'t>,
    pub x: View<'t>,
    pub u: View<'t>,
    pub predicted: View<'t>,
}

impl Loop for SweepRows<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        match self.rule {
            Rule::Project => self.rows::<L, PROJECT>(),
            Rule::PullCoarse => self.rows::<L, PULL_COARSE>(),
            Rule::ProjectCoarse { .. } => self.rows::<L, PROJECT_COARSE>(),
            Rule::HoldCoarse => self.rows::<L, HOLD_COARSE>(),
            Rule::Relax => self.rows::<L, RELAX>(),
        }
    }
}

impl SweepRows<'_> {
    #[inline(always)]
    fn rows<L: Registers, const RULE: u8>(self) {
        let per_slack = if let Rule::ProjectCoarse { per_slack } = self.rule { per_slack } else { 0.0 };
        let SweepRows { batch: EdgeBatch { ends, factors, at, mut first }, x, u, predicted, .. } = self;
        // These are plain loops because a closure passed to an iterator is compiled without the instruction set that is
        // enabled for this function.
        match ends {
            Ends::Rows => {
                let (x, u, predicted) = (x.rows::<L, 1>(&at.rows), u.rows::<L, 1>(&at.rows), predicted.rows::<L, 1>(&at.rows));
                for factors in factors.chunks_exact(3 * L::LANES) {
                    let (a, b) = (first, first + 1);
                    correct::<L, RULE, false>(
                        (factors, per_slack),
                        (x.row(a), x.row(b)),
                        (u.row(a), u.row(b)),
                        (predicted.row(a), predicted.row(b)),
                    );
                    first += 2;
                }
            }
            Ends::Pairs => {
                let (x, u, predicted) = (x.rows::<L, 2>(&at.pairs), u.rows::<L, 2>(&at.pairs), predicted.rows::<L, 2>(&at.pairs));
                for factors in factors.chunks_exact(3 * L::LANES) {
                    correct::<L, RULE, false>((factors, per_slack), x.row(first), u.row(first), predicted.row(first));
                    first += 1;
                }
            }
            Ends::Listed => {
                let (x, u, predicted) = (x.at(&at.listed), u.at(&at.listed), predicted.at(&at.listed));
                for factors in factors.chunks_exact(3 * L::LANES) {
                    let (a, b) = (first, first + L::LANES);
                    correct::<L, RULE, true>(
                        (factors, per_slack),
                        (x.row::<L>(a), x.row::<L>(b)),
                        (u.row::<L>(a), u.row::<L>(b)),
                        (predicted.row::<L>(a), predicted.row::<L>(b)),
                    );
                    first += 2 * L::LANES;
                }
            }
        }
    }
}

/// Corrects a row of edges, given the vectors at both ends.
///
/// Differences are formed between vectors as they lie in memory, several to a register, and transposed only for the
/// rule. The correction is then applied by one instruction to the vectors of several edges.
#[inline(always)]
fn correct<L: Registers, const RULE: u8, const KEEP: bool>(
    (factors, per_slack): (&[f32], f32),
    x: impl Four<[L; 2]>,
    u: impl Four<[L; 2]>,
    predicted: impl Four<[L; 2]>,
) {
    let inverse_rest = L::from_slice(&factors[..L::LANES]);
    let mut d0 = [L::splat(0.0); 4];
    let (mut du, mut dp, mut ends) = (d0, d0, [[d0[0]; 2]; 4]);
    for k in 0..4 {
        let [x_a, x_b] = x.get(k);
        ends[k] = u.get(k);
        (d0[k], du[k]) = (x_a - x_b, ends[k][0] - ends[k][1]);
        if RULE == PROJECT_COARSE {
            let [p_a, p_b] = predicted.get(k);
            dp[k] = p_a - p_b;
        }
    }
    let [part_a, part_b] = [1, 2].map(|end| L::from_slice(&factors[end * L::LANES..(end + 1) * L::LANES]));
    let apart =
        Apart { d0: L::transpose(d0), du: L::transpose(du), predicted: L::transpose(dp), part: part_a + part_b, per_slack };
    let EdgeCorrection { scale, at_start } = rule::<L, RULE>(apart, inverse_rest);
    if RULE == RELAX || !L::all(at_start) {
        let at_start = L::spread_mask(at_start);
        for k in 0..4 {
            d0[k] = L::select(at_start[k], d0[k], d0[k] + du[k]);
        }
    }
    let (by_a, by_b) = ((scale * part_a).spread(), (scale * part_b).spread());
    for k in 0..4 {
        // Both ends are loaded before either is stored: where grid rows are 4096 bytes long, a load would stall on the
        // store to the same offset in another page (4K aliasing). The ends are loaded a second time where that is
        // cheaper than keeping them in registers.
        let [a, b] = if KEEP { ends[k] } else { u.get(k) };
        u.set(k, [d0[k].neg_mul_add(by_a[k], a), d0[k].mul_add(by_b[k], b)]);
    }
}

/// The ends of edges: by what they are apart (m) at the substep's start, by what they move apart, and by what they were predicted to.
struct Apart<L> {
    d0: Vector<L>,
    du: Vector<L>,
    predicted: Vector<L>,
    /// The share of an excess that a correction takes away, `(w_a + w_b) inverse_weight`.
    part: L,
    per_slack: f32,
}

#[inline(always)]
fn rule<L: Registers, const RULE: u8>(
    Apart { d0, du, predicted, part, per_slack }: Apart<L>,
    inverse_rest: L,
) -> EdgeCorrection<L> {
    match RULE {
        PROJECT => distance::project_edge(d0, du, inverse_rest),
        PULL_COARSE => distance::pull_coarse(d0, du, inverse_rest),
        PROJECT_COARSE => distance::project_coarse(d0, du, predicted, inverse_rest, part, per_slack),
        HOLD_COARSE => distance::hold_coarse(d0, du, inverse_rest),
        _ => distance::relax_edge(d0, du, inverse_rest),
    }
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_sweep.rs"]
mod tests;
