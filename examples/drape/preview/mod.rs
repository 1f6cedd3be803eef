//! Pictures of a run, drawn on the CPU: a contact sheet, and an animation.
//!
//! Every frame is drawn in two passes. The visibility pass ray-traces the colliders and rasterizes the triangles into
//! one depth buffer. The shading pass reconstructs the point of each sample from its ray and its depth, and looks up in
//! shadow maps how much of the light of the sun and the sky reaches it. The samples of a pixel are averaged in linear
//! light. All frames share one camera, which sees the whole motion.

mod animation;
mod mesh;
mod moment;
mod shade;
mod shapes;
mod sheet;
mod view;

use std::sync::atomic::{AtomicBool, Ordering};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Collider, UpAxis};
use rayon::prelude::*;

pub(crate) use animation::animation;
pub(crate) use sheet::contact_sheet;

/// A frame to draw.
#[derive(Debug)]
pub(crate) struct Cell {
    pub(crate) frame: u32,
    /// Positions of the cloth (m).
    pub(crate) positions: Vec<Vec3>,
    /// Colliders in this frame.
    pub(crate) colliders: Vec<Collider>,
}

/// Settings of the pictures.
#[derive(Debug, Clone)]
pub(crate) struct Look {
    /// The direction from the scene toward the camera; any length but 0.
    pub(crate) from: Vec3,
    pub(crate) up: UpAxis,
    /// The time (s) of the first frame in an animation.
    pub(crate) begin: f32,
    /// The pieces of the cloth, in the order of their vertices.
    pub(crate) pieces: Vec<Piece>,
}

/// The colors of a piece of the cloth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    /// The end of its range of vertices.
    pub(crate) end: u32,
    /// Linear colors of the side from which its triangles are counterclockwise, and of the other.
    pub(crate) sides: [Vec3; 2],
}

impl Look {
    /// The default colors: red, with a tan lining.
    pub(crate) const SIDES: [Vec3; 2] = [Vec3::new(0.62, 0.085, 0.055), Vec3::new(0.80, 0.48, 0.20)];
}

/// Draws each frame; `None` if it was interrupted.
fn each<T: Send>(frames: &[Cell], draw: impl Fn(&Cell) -> T + Sync, interrupted: &AtomicBool) -> Option<Vec<T>> {
    frames.par_iter().map(|cell| (!interrupted.load(Ordering::Relaxed)).then(|| draw(cell))).collect()
}

/// The default camera looks down from the right.
pub(crate) fn default_view(up: UpAxis) -> Vec3 {
    up.turn(Vec3::new(0.52, 0.50, 1.0))
}

/// Converts sRGB (0 to 1) to linear light (IEC 61966-2-1).
pub(crate) fn linear(encoded: Vec3) -> Vec3 {
    let decode = |x: f32| if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    Vec3::from_array(encoded.to_array().map(decode))
}
