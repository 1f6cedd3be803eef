//! Constants of contact that the shaders define under these names.

use naga::Literal;

use super::bodies;
use super::contacts::near::{self, voronoi};
use super::contacts::{carry, pinches, response};
use super::detection::{paths, tree};
use super::surface::{self, normals};
use crate::kernels::{pair, plane};

/// Constants of modules, each by its name and as a literal of this type in shaders.
macro_rules! literals {
    ($($kind:ident $module:ident: $($name:ident),+;)+) => {
        vec![$($((stringify!($name), naga::Literal::$kind($module::$name as _))),+),+]
    };
}
pub(crate) use literals;

pub(crate) fn in_shaders() -> Vec<(&'static str, Literal)> {
    let mut all = literals! {
        F32 bodies: NEAR;
        F32 carry: CLOSER, CLOSEST;
        F32 near: ACTING;
        F32 normals: CONE_COSINE;
        F32 pair: RELAXATION, THIN, NARROW, LONG, SLACK, DEEP, UNWINDING, SQUEEZED, PARALLEL;
        F32 paths: LASTS, LASTS_CROSSED, MARGIN_DECAY, FARTHER_AHEAD;
        U32 paths: SAMPLES;
        F32 pinches: COINCIDENT;
        U32 pinches: BISECTIONS;
        F32 plane: CLEARANCE, SLIDING, SEPARATES, BEFORE_KINEMATIC;
        F32 response: MOST_GROWTH;
        F32 surface: LEAST_HELD;
        F32 tree: MAX_EXCESS;
        F32 voronoi: ABOVE_ANGLE, ALONGSIDE, ON_SIDE;
    };
    all.extend([("MIN_AHEAD", Literal::F32(paths::AHEAD[0])), ("MAX_AHEAD", Literal::F32(paths::AHEAD[1]))]);
    all
}
