//! Constants of contact that the shaders define under these names.

use naga::Literal;

use super::bodies;
use super::contacts::near::{self, voronoi};
use super::contacts::{carry, pinches, response};
use super::detection::{paths, tree};
use super::surface::{LEAST_HELD, normals};
use crate::kernels::{pair, plane};

pub(crate) fn in_shaders() -> Vec<(&'static str, Literal)> {
    vec![
        ("RELAXATION", Literal::F32(pair::RELAXATION)),
        ("CLEARANCE", Literal::F32(plane::CLEARANCE)),
        ("THIN", Literal::F32(pair::THIN)),
        ("NARROW", Literal::F32(pair::NARROW)),
        ("LONG", Literal::F32(pair::LONG)),
        ("SLACK", Literal::F32(pair::SLACK)),
        ("DEEP", Literal::F32(pair::DEEP)),
        ("UNWINDING", Literal::F32(pair::UNWINDING)),
        ("SQUEEZED", Literal::F32(pair::SQUEEZED)),
        ("SLIDING", Literal::F32(plane::SLIDING)),
        ("SEPARATES", Literal::F32(plane::SEPARATES)),
        ("PARALLEL", Literal::F32(pair::PARALLEL)),
        ("LASTS", Literal::F32(paths::LASTS)),
        ("LASTS_CROSSED", Literal::F32(paths::LASTS_CROSSED)),
        ("MARGIN_DECAY", Literal::F32(paths::MARGIN_DECAY)),
        ("MIN_AHEAD", Literal::F32(paths::AHEAD[0])),
        ("MAX_AHEAD", Literal::F32(paths::AHEAD[1])),
        ("FARTHER_AHEAD", Literal::F32(paths::FARTHER_AHEAD)),
        ("CONE_COSINE", Literal::F32(normals::CONE_COSINE)),
        ("MAX_EXCESS", Literal::F32(tree::MAX_EXCESS)),
        ("LEAST_HELD", Literal::F32(LEAST_HELD)),
        ("ACTING", Literal::F32(near::ACTING)),
        ("ABOVE_ANGLE", Literal::F32(voronoi::ABOVE_ANGLE)),
        ("ALONGSIDE", Literal::F32(voronoi::ALONGSIDE)),
        ("ON_SIDE", Literal::F32(voronoi::ON_SIDE)),
        ("COINCIDENT", Literal::F32(pinches::COINCIDENT)),
        ("CLOSER", Literal::F32(carry::CLOSER)),
        ("CLOSEST", Literal::F32(carry::CLOSEST)),
        ("MOST_GROWTH", Literal::F32(response::MOST_GROWTH)),
        ("NEAR", Literal::F32(bodies::NEAR)),
        ("SAMPLES", Literal::U32(paths::SAMPLES as u32)),
        ("BISECTIONS", Literal::U32(pinches::BISECTIONS)),
    ]
}
