//! Pictures of a cloth in motion, drawn without a GPU: a contact sheet, and an animation.
//!
//! Every frame is drawn in two passes. Visibility: the colliders are traced by ray, the triangles rasterized, both into one
//! depth buffer. Shading: each sample finds its point again from its ray and its depth, asks shadow maps how much of the
//! sun and of the sky reaches it, and the samples of a pixel are averaged in linear light. All frames share one camera, which
//! holds the whole motion.

mod animation;
mod mesh;
mod moment;
mod shade;
mod shapes;
mod sheet;
mod view;

use cloth_deformer::Collider;
use cloth_deformer::glam::Vec3;

pub(crate) use animation::animation;
pub(crate) use sheet::contact_sheet;

/// A frame to be drawn.
#[derive(Debug)]
pub(crate) struct Cell {
    pub(crate) frame: u32,
    /// Where the cloth was (m).
    pub(crate) positions: Vec<Vec3>,
    /// The colliders that were there.
    pub(crate) colliders: Vec<Collider>,
}

/// How a run is drawn.
#[derive(Debug, Clone)]
pub(crate) struct Look {
    /// The direction from the scene toward the camera; any length but 0.
    pub(crate) from: Vec3,
    /// The time (s) from which on a frame is in an animation.
    pub(crate) begin: f32,
    /// The pieces of the cloth, in the order of its vertices.
    pub(crate) pieces: Vec<Piece>,
}

/// What a piece of the cloth looks like.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    /// The vertex after its last one.
    pub(crate) end: u32,
    /// Linear colors of the side from which its triangles are counter-clockwise, and of the other.
    pub(crate) sides: [Vec3; 2],
}

impl Look {
    /// The camera looks down from the right.
    pub(crate) const FROM: Vec3 = Vec3::new(0.52, 0.50, 1.0);
    /// Red, with a tan lining.
    pub(crate) const SIDES: [Vec3; 2] = [Vec3::new(0.62, 0.085, 0.055), Vec3::new(0.80, 0.48, 0.20)];
}

/// From an sRGB color, 0 to 1, to linear light (IEC 61966-2-1).
pub(crate) fn linear(encoded: Vec3) -> Vec3 {
    let decode = |x: f32| if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    Vec3::from_array(encoded.to_array().map(decode))
}
