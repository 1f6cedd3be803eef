//! How many coarse levels a step uses, and how they correct.

use crate::kernels::params::{HOLD_COARSE, PROJECT_COARSE, PULL_COARSE};
use crate::model::cloth::Cloth;
use crate::multigrid::hierarchy::MAX_LEVELS;
use crate::options::{Levels, Method, Options};
use crate::step::substep_count::{Length, Rates, STANDARD_GRAVITY};

/// Ratio of the substeps that resolve the stiffness to those taken, from which levels pay.
const PAYS_FROM: f64 = 1.15;
/// The number of levels changes where substeps are so many times as long, or as short, as those for which it is chosen.
const KEPT: f64 = 1.25;
/// Cloth of at most so many vertices uses all levels if they keep it flat: 21 x 21 vertices do not hang flat without, 25 x 25 do.
const SMALL: usize = 512;
/// The strain under its own weight from which cloth counts as soft.
const SOFT: f64 = 2e-3;
/// Ratio of wind pressure to the cloth's weight above which levels are off, because stretch would show as small wrinkles:
/// see [`hierarchy`](crate::multigrid::hierarchy).
const GALE: f64 = 10.0;
/// The number of levels changes where the pressure is so many times that, or as small a share of it.
const GUSTY: f64 = 1.5;

impl Rates {
    /// The number of coarse levels to use in wind of this dynamic pressure (Pa).
    ///
    /// From 7/8 of `S*` on levels do not pay. Before, they pay in small cloths, too, where they take a fifth of a substep: a sheet of
    /// 31 x 31 that has swung down for half a second is 9.7 mm off with levels at 10 substeps and 56 mm without, 1.3 and 3.2 mm at 40.
    ///
    /// Small sheets that coarse edges keep flat ([`PROJECT_COARSE`]) use all levels, with which fewer folds are left in them. Larger ones
    /// hang flat with as many as carry the load, and would take 3 to 15 % longer on an H200 with more (64 x 64 and 128 x 128 vertices, 20
    /// substeps). Soft cloth, which more levels would hold up, and cloth without pins or bending stiffness take as many as carry the load,
    /// too.
    ///
    /// Cloth at rest hangs a little differently with another number of levels, and a change kicks it. So the number `before` is kept
    /// within [`KEPT`], unless there were none.
    pub(crate) fn levels(&self, cloth: &Cloth, options: &Options, length: Length, pressure: f64, before: Option<usize>) -> usize {
        if options.method != Method::SmallSteps {
            return 0;
        }
        match options.levels {
            Levels::Off => 0,
            Levels::Count(count) => count as usize,
            Levels::Auto => {
                let shortfall = self.shortfall(cloth, length);
                if shortfall < PAYS_FROM || is_gale(cloth, pressure, before) {
                    return 0;
                }
                if cloth.used <= SMALL && coarse_rule(cloth, options) == PROJECT_COARSE && !is_soft(cloth, 1.0) {
                    return MAX_LEVELS;
                }
                let range = [shortfall / KEPT, shortfall * KEPT].map(carrying);
                before.filter(|&before| before > 0).unwrap_or(carrying(shortfall)).clamp(range[0], range[1])
            }
        }
    }

    /// The fewest levels that carry the load in substeps of this length.
    pub(crate) fn fewest_levels(&self, cloth: &Cloth, length: Length) -> usize {
        carrying(self.shortfall(cloth, length) / KEPT)
    }

    /// How many times as many substeps would resolve what shows of the stiffness.
    fn shortfall(&self, cloth: &Cloth, length: Length) -> f64 {
        self.resolving_what_shows(cloth) * f64::from(length.longest_h)
    }
}

/// The number of levels that carry the load if so many times as many substeps would resolve the stiffness.
///
/// Level l, whose aggregates are about `4 2^l` edges wide, is resolved by `S* / (4 2^l)` substeps. The first level that the substeps
/// resolve carries the whole load of an evenly loaded cloth. One more helps at corners and on unstructured meshes (two pins, 2000
/// vertices: mean strain 2.0e-3 with it, 3.2e-3 without).
fn carrying(shortfall: f64) -> usize {
    (shortfall / 4.0).log2().ceil().clamp(0.0, 31.0) as usize + 2
}

/// Whether wind of this dynamic pressure (Pa) is too strong for levels: see [`hierarchy`](crate::multigrid::hierarchy). A change
/// kicks the cloth, so in gusts the step goes on with the levels of `before`, or without.
pub(crate) fn is_gale(cloth: &Cloth, pressure: f64, before: Option<usize>) -> bool {
    let kept = before.map_or(1.0, |levels| if levels > 0 { GUSTY } else { 1.0 / GUSTY });
    pressure > kept * GALE * cloth.density * STANDARD_GRAVITY
}

/// Whether its own weight stretches the cloth visibly in a direction that is so many times as stiff as its fabric.
///
/// Levels act side by side, each at least as stiff as the fabric, so together they are several times as stiff. Where the weight
/// stretches cloth by less than this, that does not show, and stiff levels converge sooner. Elsewhere they share the load, and the
/// edges of each, of which there are some in many directions, are softened to the sum of the fine edges' stiffness (the trace of
/// its tensor). `benches/results/quality.md` has the figures.
pub(crate) fn is_soft(cloth: &Cloth, firmness: f64) -> bool {
    cloth.density * STANDARD_GRAVITY * cloth.extents.extent > SOFT * cloth.membrane_stiffness * firmness
}

/// Whether levels would roll up the cloth where it hangs, because it is soft: see [`hierarchy`](crate::multigrid::hierarchy). What hangs
/// from nothing but lone pins, which are those with tethers, folds anyway, and is stretched most by its pins.
pub(crate) fn rolls_up(cloth: &Cloth) -> bool {
    let lone = cloth.tethers.as_ref().map_or(0, |tethers| tethers.anchors.len());
    let has_rows = cloth.pinned.iter().filter(|&&pin| cloth.is_used(pin)).count() > lone;
    has_rows && is_soft(cloth, 1.0)
}

/// How coarse edges are corrected, a [`Params::coarse_rule`](crate::kernels::params::Params::coarse_rule). A chain has no width across
/// which they could pull it together, and cloth without pins does not hang.
pub(crate) fn coarse_rule(cloth: &Cloth, options: &Options) -> u32 {
    match (options.fabric.bending > 0.0, cloth.is_sheet) {
        (false, true) => HOLD_COARSE,
        (true, true) if cloth.has_pins() => PROJECT_COARSE,
        _ => PULL_COARSE,
    }
}
