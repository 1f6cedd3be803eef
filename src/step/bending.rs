//! Bending coefficients for substeps of one length: as much of the fabric's rigidity as stays stable, in as many filter
//! passes as that takes.
//!
//! # Theory
//! Let `L` be the matrix of rows of the bending energy, `S` the diagonal matrix of their stiffnesses `S_v = B_v D_v`,
//! and `w` the inverse masses. An explicit bending kick `-h² w L^T S L x` is stable up to `z = h² lambda = 2` for every
//! eigenvalue lambda of `w L^T S L`. With few substeps a fine mesh exceeds that by far, at short wavelengths that
//! hardly matter. Lowering `B` there would soften all other wavelengths too. Instead the moments `S y`, `y = L x`, are
//! filtered by `s` passes of a recursion. Before each pass but the first, the vertices are displaced tentatively, by
//! `b_k`, under the moments so far:
//!
//! ```text
//! m_1 = 3/2 (w_1/w_0) S y
//! b_k = -2/3 h² w L^T m_k
//! m_{k+1} = m_k + alpha_k (m_k - m_{k-1}) + beta_k S (y + L b_k)
//! ```
//!
//! The filtered moments are `m_s = Q y`, with which a mode is kicked by `P(z) = 3/2 (1 - T_s(w_0 - w_1 z)/3)` in place
//! of `z`. This is Chebyshev's iteration (Golub and Varga 1961), damped as Verwer, Hundsdorfer and Sommeijer (1990) do
//! for explicit methods. Here `theta = acosh(3)/s`, `w_0 = cosh theta`, `w_1 = sinh theta/(sqrt(2) s)`,
//! `T_k = cosh(k theta)`, `alpha_k = T_{k-1}/T_{k+1}` and `beta_k = 3 w_1 T_k/T_{k+1}`. `P = z` for long waves, and
//! `1 <= P <= 2` for the shortest ones, up to `z = sqrt(2) s coth(asinh(1)/s)`, which is about `1.6 s²`. One pass is
//! the plain kick.
//!
//! Leapfrog alone would bear `P < 4`. But a short fold that is kicked by a good part of an edge's length makes its edges push back
//! just as far, along directions that are those of the substep's start, and folds and edges drive each other for ever. What decides is
//! how far a substep kicks: at 20 substeps in 1/60 s cloth on the floor lay still with `P <= 2`, at 5 and 10 it trembled at .1 to 1 m/s
//! (`crumpled_cloth_comes_to_rest_at_few_substeps`). So with fewer than 20 the largest kick of what can crumple is less, `p`
//! ([`most_kicked`]): the polynomial is `p/2 P(2 z/p)`, for which `b_k` is larger by the factor `2/p`. It reaches `p/2` times as far.
//!
//! `Q` is a constant symmetric matrix acting on rows, so the filtered moments conserve linear and angular momentum and
//! have an energy, `y.Q y/2`.
//!
//! Damping is not filtered ([`bend_moment`](crate::kernels::bending::bend_moment)). In one pass it takes at most half
//! of a mode's velocity. Filtered it would be up to `z/2` times as strong and cost as much again, but a towel dropped
//! in a test came to rest no sooner.

use glam::Vec4;

use crate::kernels::bending::{BendPass, BendRow};
use crate::model::bending::Bending;
use crate::model::cloth::Cloth;
use crate::step::substep_count::{SIXTIETHS, STANDARD_GRAVITY};

/// Maximum number of passes.
pub(crate) const MAX_PASSES: usize = 16;

/// Mean share of the rigidity that may be lost to the stability limit before [`BendRows::limited`] reports it.
const LOST: f64 = 0.05;

/// Bending coefficients for substeps of one length.
#[derive(Debug, Clone, Default)]
pub(crate) struct BendRows {
    /// One row per vertex; empty without bending.
    pub rows: Vec<BendRow>,
    /// The coefficients of the filter's passes; empty if one pass suffices and the moments are used unfiltered.
    pub passes: Vec<BendPass>,
    /// Number of vertices whose rigidity had to be lowered for stability; 0 if the cloth loses at most 5 % on average.
    pub limited: usize,
}

/// A single pass, without a filter.
#[cfg(feature = "gpu")]
const ONCE: BendPass = BendPass { carry: 0.0, gain: 0.0, trial: 0.0, last: 1 };

impl BendRows {
    /// The passes, of which an unfiltered one counts, too.
    #[cfg(feature = "gpu")]
    pub(crate) fn passes_or_one(&self) -> &[BendPass] {
        if self.passes.is_empty() { &[ONCE] } else { &self.passes }
    }

    /// For rigidity `rigidity` (N m), retardation time `tau` (s) and substep `h` (s). `rest` holds the inverse masses
    /// (1/kg) in its w components.
    ///
    /// As much of the rigidity is left as is stable at the `softest` substep (s), the longest one so far. Otherwise bent cloth
    /// would stiffen, and gain energy, whenever substeps become shorter (`benches/results/quality.md`).
    ///
    /// With a largest `kick` takes as many passes as keep 95 % of the vertices stable at full rigidity, at most 16; otherwise
    /// one. Where that is not enough the rigidity is lowered, in the energy of rows rather than in the response of
    /// vertices, so that momentum is conserved.
    pub(crate) fn new(
        bending: &Bending,
        rest: &[Vec4],
        [rigidity, tau]: [f64; 2],
        [h, softest]: [f64; 2],
        kick: Option<f64>,
    ) -> BendRows {
        let full: Vec<f64> = bending.weight.iter().map(|weight| rigidity * weight).collect();
        let bound = Bound { kick: kick.unwrap_or(2.0), damped: tau > 0.0 };
        // The bound `h² g` on each vertex's eigenvalue (Gershgorin).
        let reached =
            |stiffness: &[f64], h: f64| bending.bounds(rest, stiffness).into_iter().map(|g| h * h * g).collect::<Vec<f64>>();
        let count = |needed: &[f64]| if kick.is_some() { bound.passes(needed) } else { 1 };
        let needed = reached(&full, softest);
        let most_passes = count(&needed);
        let most = bound.limit(most_passes);
        let share: Vec<f64> = needed.iter().map(|z| (most / z).min(1.0)).collect();
        let row_share: Vec<f64> = (0..rest.len()).map(|v| bending.least_of_row(&share, v)).collect();
        let stiffness: Vec<f64> = full.iter().zip(&row_share).map(|(full, share)| full * share).collect();
        // In a shorter substep fewer passes may do, for 95 % at full rigidity and for all at what is left of it.
        let count = if softest > h {
            let worst = reached(&stiffness, h).into_iter().fold(0.0, f64::max);
            (count(&reached(&full, h))..most_passes).find(|&count| bound.limit(count) >= worst).unwrap_or(most_passes)
        } else {
            most_passes
        };
        // With one pass, a mode's spring and its damping share the stability limit of leapfrog; with the filter,
        // damping has half of it to itself.
        let damped = |z: &f64| tau.min(if count == 1 { 0.5 * h * (2.0 / z - 1.0) } else { 0.5 * h / z }).max(0.0);
        let damped: Vec<f64> = reached(&stiffness, h).iter().map(damped).collect();
        let rows = (0..rest.len()).map(|v| BendRow {
            stiffness: stiffness[v] as f32,
            tau: bending.least_of_row(&damped, v) as f32,
            diagonal: -bending.diagonal[v] as f32,
        });
        let bent = || row_share.iter().zip(&bending.weight).filter(|(_, weight)| **weight > 0.0).map(|(share, _)| share);
        let lost = bent().map(|share| 1.0 - share).sum::<f64>() / bent().count().max(1) as f64;
        let limited = if lost > LOST { bent().filter(|share| **share < 1.0).count() } else { 0 };
        BendRows { rows: rows.collect(), passes: if count > 1 { filter(count, h, bound.kick) } else { Vec::new() }, limited }
    }

    /// The median of the retardation times (s) of the rows that bend; 0 if there are none.
    pub(crate) fn median_tau(&self) -> f32 {
        let mut tau: Vec<f32> = self.rows.iter().filter(|row| row.stiffness > 0.0).map(|row| row.tau).collect();
        let middle = tau.len() / 2;
        if tau.is_empty() { 0.0 } else { *tau.select_nth_unstable_by(middle, f32::total_cmp).1 }
    }
}

/// The most that a mode of a cloth may be kicked by in place of `z`, in substeps of `h` (s).
///
/// Crumpled cloth of skirts, ribbons and squares with edges of 4 to 25 mm trembled at 5 and 10 substeps in 1/60 s with the bounds 2 and 1,
/// at up to a tenth of that with 0.5, and lay still but for some mm/s with 0.25; at 20 it lay still with 2. What is too stiff to crumple
/// keeps the bound of 2, because a smaller one softens waves of medium length, too: with 0.2 a stiff cantilever of 17 vertices sags by 1 %
/// too much at 10 substeps, and by 5 % at 5.
pub(crate) fn most_kicked(cloth: &Cloth, rigidity: f64, h: f64) -> f64 {
    let weight = cloth.density * STANDARD_GRAVITY * cloth.extents.extent.powi(3);
    let substeps = if weight > CRUMPLES * rigidity { 1.0 / (SIXTIETHS * h) } else { STILL };
    (2.0 * (substeps / STILL).powi(4)).clamp(0.2, 2.0)
}

/// Substeps in 1/60 s from which no kick that leapfrog tolerates makes cloth tremble.
const STILL: f64 = 20.0;
/// Cloth crumples under its weight if its bending length, `(B/(rho g))^(1/3)`, is less than a tenth of its size.
const CRUMPLES: f64 = 1e3;

/// What bounds the eigenvalues `h² lambda`.
#[derive(Debug, Clone, Copy)]
struct Bound {
    /// The most that a mode may be kicked by.
    kick: f64,
    /// Whether bending is damped.
    damped: bool,
}

impl Bound {
    /// The fewest passes with which 95 % of the vertices that bend are stable.
    fn passes(self, needed: &[f64]) -> usize {
        let mut bent: Vec<f64> = needed.iter().copied().filter(|&z| z > 0.0).collect();
        if bent.is_empty() {
            return 1;
        }
        let nearest = (bent.len() - 1) * 95 / 100;
        let z = *bent.select_nth_unstable_by(nearest, f64::total_cmp).1;
        (1..MAX_PASSES).find(|&count| self.limit(count) >= z).unwrap_or(MAX_PASSES)
    }

    /// The largest `h² g` that is stable with so many passes. With a single pass, damping takes half of leapfrog's limit.
    fn limit(self, passes: usize) -> f64 {
        match passes {
            1 => self.kick.min(if self.damped { 1.0 } else { 2.0 }),
            _ => 0.5 * self.kick * std::f64::consts::SQRT_2 * passes as f64 / (1.0_f64.asinh() / passes as f64).tanh(),
        }
    }
}

/// The coefficients of the recursion with `count` passes at substep `h` (s), which kicks a mode by at most `kick`.
fn filter(count: usize, h: f64, kick: f64) -> Vec<BendPass> {
    let theta = 3.0_f64.acosh() / count as f64;
    let chebyshev = |k: usize| (k as f64 * theta).cosh();
    let step = theta.sinh() / (std::f64::consts::SQRT_2 * count as f64);
    let pass = |k: usize| {
        let (carry, gain) = match k {
            0 => (0.0, 1.5 * step / theta.cosh()),
            _ => (chebyshev(k - 1) / chebyshev(k + 1), 3.0 * step * chebyshev(k) / chebyshev(k + 1)),
        };
        BendPass {
            carry: carry as f32,
            gain: gain as f32,
            trial: (-4.0 / (3.0 * kick) * h * h) as f32,
            last: u32::from(k + 1 == count),
        }
    };
    (0..count).map(pass).collect()
}

#[cfg(test)]
#[path = "../../tests/unit/step_bending.rs"]
mod tests;
