//! One run of a scene, recorded for comparison: the state at some frames, and the time per frame.

use glam::Vec3;
use web_time::Instant;

use super::{Setting, Terms};
use crate::attributes::Attributes;
use crate::deformer::Deformer;
use crate::error::{BuildError, StepError};
use crate::model::mesh::Mesh;
use crate::options::{Fabric, Options};

/// Length of a frame (s).
const FRAME: f32 = 1.0 / 60.0;
/// Number of frames that the search compares; as many others, in between, verify the result.
pub(super) const COMPARED: usize = 12;

/// The scene: the cloth, what acts on it in each frame, and the number of frames.
pub(super) struct Scene<'a> {
    pub mesh: &'a Mesh,
    pub options: &'a Options,
    pub attributes: &'a dyn Fn(u32) -> Attributes,
    pub frames: u32,
    /// The vertices that are compared: those that triangles use, in order.
    pub compared: Vec<u32>,
}

/// The state at one frame: positions (m) of the vertices that are compared, and their speed.
pub(super) struct ClipFrame {
    pub positions: Vec<Vec3>,
    /// Root mean square speed (m/s).
    pub speed: f64,
}

/// A run of the scene.
pub(super) struct Clip {
    /// Frames for verification and frames for the search, alternately.
    pub frames: Vec<ClipFrame>,
    /// For each frame, the stretch that 99 percent of the area did not exceed.
    pub stretch: Vec<f32>,
    /// Time per frame (ms): the mean number of substeps times the lower quartile of the time per substep, which leaves
    /// out what else the machine was doing.
    pub milliseconds: f64,
    /// Mean number of substeps per frame.
    pub substeps: f64,
    /// Largest number of coarse levels used.
    pub levels: u32,
}

impl Scene<'_> {
    /// The terms that the scene has.
    pub(super) fn terms(&self) -> Terms {
        let Fabric { bending, damping, .. } = self.options.fabric;
        let air = (1..=self.frames).any(|frame| (self.attributes)(frame).air_density > 0.0);
        Terms { bending: bending > 0.0, damping: bending > 0.0 && damping > 0.0, air }
    }

    /// The frames whose states are compared: twice [`COMPARED`], or all if the scene has fewer.
    fn compared_frames(&self) -> Vec<u32> {
        let count = 2 * COMPARED as u64;
        let mut frames: Vec<u32> = (1..=count).map(|k| (u64::from(self.frames) * k).div_ceil(count) as u32).collect();
        frames.dedup();
        frames
    }

    /// Runs the scene with a setting. Each free vertex starts up to `nudge` (m) off in each coordinate.
    pub(super) fn play(&self, setting: &Setting, nudge: f32) -> Result<Clip, BuildError> {
        let failed = |frame| move |error| BuildError::Step { frame, error };
        // A cloth that sleeps takes no time, with whatever setting.
        let mut cloth = Deformer::new(self.mesh, Options { sleep: None, ..setting.options(self.options) })?;
        if nudge > 0.0 {
            self.nudge(&mut cloth, nudge).map_err(failed(0))?;
        }
        // As in a run that begins in motion, the first step moves the colliders from where they are before it.
        cloth.place_colliders(&(self.attributes)(0).colliders).map_err(failed(0))?;
        let compared = self.compared_frames();
        let mut clip = Clip { frames: Vec::new(), stretch: Vec::new(), milliseconds: 0.0, substeps: 0.0, levels: 0 };
        let mut times = Vec::new();
        for frame in 1..=self.frames {
            let attributes = setting.attributes((self.attributes)(frame));
            let start = Instant::now();
            let report = cloth.step(FRAME, &attributes).map_err(failed(frame))?;
            cloth.wait().map_err(failed(frame))?;
            times.push(1e3 * start.elapsed().as_secs_f64() / f64::from(report.substeps.max(1)));
            clip.stretch.push(cloth.measure().map_err(failed(frame))?.stretch_share);
            clip.substeps += f64::from(report.substeps) / f64::from(self.frames);
            clip.levels = clip.levels.max(report.levels);
            if compared.contains(&frame) {
                let velocities = cloth.velocities().map_err(failed(frame))?;
                let speed = speed(self.compared.iter().map(|&vertex| velocities[vertex as usize]));
                let positions = cloth.positions().map_err(failed(frame))?;
                clip.frames.push(ClipFrame {
                    positions: self.compared.iter().map(|&vertex| positions[vertex as usize]).collect(),
                    speed,
                });
            }
        }
        times.sort_by(f64::total_cmp);
        clip.milliseconds = clip.substeps * times[times.len() / 4];
        Ok(clip)
    }

    fn nudge(&self, cloth: &mut Deformer, nudge: f32) -> Result<(), StepError> {
        let mut positions = cloth.positions()?.to_vec();
        let still = vec![Vec3::ZERO; positions.len()];
        for &vertex in self.compared.iter().filter(|vertex| !self.options.pinned.contains(vertex)) {
            // An arbitrary displacement that is the same in every search.
            let wave = |f: f32| (f * vertex as f32).sin();
            positions[vertex as usize] += nudge * Vec3::new(wave(1.3), wave(2.1), wave(3.7));
        }
        cloth.set_state(&positions, &still)
    }
}

/// Root mean square speed (m/s).
fn speed(velocities: impl ExactSizeIterator<Item = Vec3>) -> f64 {
    let count = velocities.len().max(1) as f64;
    (velocities.map(|v| v.as_dvec3().length_squared()).sum::<f64>() / count).sqrt()
}

impl Clip {
    /// The frames that the search compares, or those that verify the result.
    pub(super) fn part(&self, checked: bool) -> impl Iterator<Item = &ClipFrame> {
        // The search compares the second frame, the fourth and so on: of an even number of frames, the last one, too.
        let odd = usize::from(checked) ^ 1;
        self.frames.iter().enumerate().filter(move |(index, _)| index % 2 == odd).map(|(_, frame)| frame)
    }

    /// The stretch that at most one frame in a hundred exceeds.
    pub(super) fn stretch(&self) -> f64 {
        let mut sorted = self.stretch.clone();
        sorted.sort_by(|a, b| b.total_cmp(a));
        sorted.get(sorted.len() / 100).copied().map_or(0.0, f64::from)
    }
}
