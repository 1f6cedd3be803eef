//! A resolved run beside the visible one, which measures its error after half a second.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Levels, Mesh, Method, Options, Quality};

use crate::FRAME;

/// Frames after which the two are compared and restarted from the same state; later most motions are chaotic.
const FRAMES: u32 = 30;
/// Most substeps of the resolved run, because a page has only 1/60 s for everything.
const MOST: f32 = 200.0;

/// The resolved run.
pub(crate) struct Twin {
    cloth: Deformer,
    frames: u32,
    /// Root mean square distance (m) when the two were last compared.
    pub(crate) error: Option<f32>,
}

impl Twin {
    /// `None` if the cloth cannot be created, which the visible one has then reported.
    pub(crate) fn new(mesh: &Mesh, options: &Options, attributes: &Attributes) -> Option<Twin> {
        let options =
            Options { backend: Backend::Cpu, gpu: None, method: Method::SmallSteps, levels: Levels::Off, ..options.clone() };
        let mut cloth = Deformer::new(mesh, options).ok()?;
        let resolving = cloth.forecast(FRAME, attributes).ok()?.resolving;
        cloth.set_quality(Quality::Substeps(resolving.min(MOST).ceil() as u32)).ok()?;
        Some(Twin { cloth, frames: FRAMES, error: None })
    }

    pub(crate) fn set_pinned(&mut self, pinned: &[u32]) {
        // The resolved run accepts everything that the visible one accepts.
        let _ = self.cloth.set_pinned(pinned.to_vec());
        self.begin_anew();
    }

    /// Compares nothing until both have started from the same state again.
    pub(crate) fn begin_anew(&mut self) {
        (self.frames, self.error) = (FRAMES, None);
    }

    /// Follows a frame in which the visible run went from one state to another, in substeps of `h` (s).
    pub(crate) fn step(&mut self, attributes: &Attributes, before: (&[Vec3], &[Vec3]), after: &[Vec3], h: f32) {
        if self.frames == FRAMES {
            self.frames = 0;
            // Velocities are those of half a substep ago.
            let velocities: Vec<Vec3> = before.1.iter().map(|v| *v + 0.5 * h * attributes.gravity).collect();
            if self.cloth.set_state(before.0, &velocities).is_err() {
                return self.begin_anew();
            }
        }
        if self.cloth.step(FRAME, attributes).is_err() {
            return self.begin_anew();
        }
        self.frames += 1;
        if self.frames == FRAMES
            && let Ok(resolved) = self.cloth.positions()
        {
            let sum: f32 = resolved.iter().zip(after).map(|(a, b)| a.distance_squared(*b)).sum();
            self.error = Some((sum / after.len() as f32).sqrt());
        }
    }
}
