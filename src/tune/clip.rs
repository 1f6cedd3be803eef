//! A scene played to be compared: where the cloth is at some times, and what a frame takes.

use glam::Vec3;
use web_time::Instant;

use super::Setting;
use crate::attributes::Attributes;
use crate::deformer::Deformer;
use crate::error::{BuildError, StepError};
use crate::model::mesh::Mesh;
use crate::options::Options;

/// A frame (s).
const FRAME: f32 = 1.0 / 60.0;
/// Frames that a search looks at, and as many others between them that it is checked on.
pub(super) const LOOKS: usize = 12;

/// The scene: the cloth, what acts on it by the frame, and for how long.
pub(super) struct Scene<'a> {
    pub mesh: &'a Mesh,
    pub options: &'a Options,
    pub attributes: &'a dyn Fn(u32) -> Attributes,
    pub frames: u32,
}

/// The state at some time.
#[derive(Debug, Clone)]
pub(super) struct Look {
    pub positions: Vec<Vec3>,
    /// Root mean square speed (m/s).
    pub speed: f64,
}

/// A run of the scene.
#[derive(Debug, Clone)]
pub(super) struct Clip {
    /// Those that a search goes by and those that it is checked on, in turn.
    pub looks: Vec<Look>,
    /// What 99 per cent of the area did not exceed of stretch, in each frame.
    pub stretch: Vec<f32>,
    /// Time of a frame (ms): its substeps, the mean, by what one takes when nothing else is in its way, the lower quartile.
    pub milliseconds: f64,
    /// Substeps of a frame, the mean.
    pub substeps: f64,
    /// Most coarse levels in use.
    pub levels: u32,
}

impl Scene<'_> {
    /// Whether it has a term of [`Setting::terms`].
    pub(super) fn has(&self, term: usize) -> bool {
        let fabric = self.options.fabric;
        match term {
            0 => fabric.bending > 0.0,
            1 => fabric.bending > 0.0 && fabric.damping > 0.0,
            _ => (1..=self.frames).any(|frame| (self.attributes)(frame).air_density > 0.0),
        }
    }

    /// Frames whose states are compared, of which there are twice [`LOOKS`] if the scene has so many.
    fn looks(&self) -> Vec<u32> {
        let count = 2 * LOOKS as u32;
        let mut looks: Vec<u32> = (1..=count).map(|k| (self.frames * k).div_ceil(count)).collect();
        looks.dedup();
        looks
    }

    /// Plays the scene with a setting. Each free vertex starts up to `nudge` (m) off where it should.
    pub(super) fn play(&self, setting: &Setting, nudge: f32) -> Result<Clip, BuildError> {
        let failed = |frame| move |error| BuildError::Step { frame, error };
        let mut cloth = Deformer::new(self.mesh, setting.options(self.options))?;
        if nudge > 0.0 {
            self.nudge(&mut cloth, nudge).map_err(failed(0))?;
        }
        let looks = self.looks();
        let mut clip = Clip { looks: Vec::new(), stretch: Vec::new(), milliseconds: 0.0, substeps: 0.0, levels: 0 };
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
            if looks.contains(&frame) {
                let speed = speed(cloth.velocities().map_err(failed(frame))?);
                clip.looks.push(Look { positions: cloth.positions().map_err(failed(frame))?.to_vec(), speed });
            }
        }
        times.sort_by(f64::total_cmp);
        clip.milliseconds = clip.substeps * times[times.len() / 4];
        Ok(clip)
    }

    fn nudge(&self, cloth: &mut Deformer, nudge: f32) -> Result<(), StepError> {
        let mut positions = cloth.positions()?.to_vec();
        let still = vec![Vec3::ZERO; positions.len()];
        for (k, x) in positions.iter_mut().enumerate().filter(|(k, _)| !self.options.pinned.contains(&(*k as u32))) {
            // Some number or other, the same in every search.
            let wave = |f: f32| (f * k as f32).sin();
            *x += nudge * Vec3::new(wave(1.3), wave(2.1), wave(3.7));
        }
        cloth.set_state(&positions, &still)
    }
}

/// Root mean square speed (m/s).
fn speed(velocities: &[Vec3]) -> f64 {
    let sum: f64 = velocities.iter().map(|v| v.as_dvec3().length_squared()).sum();
    (sum / velocities.len().max(1) as f64).sqrt()
}

impl Clip {
    /// Those of its looks that a search goes by, or those that it is checked on.
    pub(super) fn part(&self, checked: bool) -> impl Iterator<Item = &Look> {
        // The last frame is one of those that are gone by.
        let odd = usize::from(checked) ^ 1;
        self.looks.iter().enumerate().filter(move |(index, _)| index % 2 == odd).map(|(_, look)| look)
    }

    /// The stretch that one frame in a hundred exceeds, at most.
    pub(super) fn stretch(&self) -> f64 {
        let mut sorted = self.stretch.clone();
        sorted.sort_by(|a, b| b.total_cmp(a));
        sorted.get(sorted.len() / 100).copied().map_or(0.0, f64::from)
    }
}
