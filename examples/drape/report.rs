//! Figures of a run: a row for each frame, as JSON and as one line.

use std::path::Path;

use cloth_deformer::{Backend, Deformer, Measure, Mesh, Method};
use serde::{Deserialize, Serialize};

use crate::{
    Failure,
    arguments::{BACKENDS, METHODS},
};

/// A run. The order of the fields is the order of the file.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) adapter: Option<String>,
    pub(crate) backend: &'static str,
    method: &'static str,
    vertices: usize,
    edges: usize,
    // A fixed name of the file, whatever the code calls them.
    #[serde(rename = "colours")]
    colors: usize,
    pub(crate) frames: Vec<Frame>,
}

/// One frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Frame {
    #[serde(rename = "frame")]
    number: u32,
    /// Duration of `Deformer::step` alone (ms), on the GPU until it is done there; reading back is not part of it.
    ms: f64,
    pub(crate) substeps: u32,
    pub(crate) mean_strain: f32,
    pub(crate) max_strain: f32,
    /// What 99 % of the area is stretched by at most.
    pub(crate) stretch_share: f32,
    /// Kinetic and potential energy (J).
    pub(crate) energy: f64,
    /// Depth of the deepest vertex in a collider (m).
    pub(crate) penetration: f32,
    /// Pairs of the cloth's features that press on one another.
    pub(crate) contacts: u32,
}

impl Frame {
    /// Of a step that took so many seconds, substeps and contacts. `None` if a figure is not finite: JSON has no such number, and a stable
    /// cloth has none either.
    pub(crate) fn new(number: u32, seconds: f64, [substeps, contacts]: [u32; 2], measure: Measure) -> Option<Frame> {
        let Measure { mean_strain, max_strain, stretch_share, kinetic_energy, potential_energy, penetration, .. } = measure;
        let energy = kinetic_energy + potential_energy;
        let finite = energy.is_finite() && [mean_strain, max_strain, stretch_share, penetration].into_iter().all(f32::is_finite);
        finite.then_some(Frame {
            number,
            ms: 1e3 * seconds,
            substeps,
            mean_strain,
            max_strain,
            stretch_share,
            energy,
            penetration,
            contacts,
        })
    }
}

impl Report {
    pub(crate) fn new(deformer: &Deformer, method: Method, mesh: &Mesh) -> Report {
        Report {
            adapter: deformer.adapter().map(str::to_owned),
            backend: name_of(&BACKENDS, |&backend: &Backend| backend == deformer.backend()),
            method: name_of(&METHODS, |named| std::mem::discriminant(named) == std::mem::discriminant(&method)),
            vertices: mesh.positions.len(),
            edges: mesh.edges().len(),
            colors: deformer.colors(),
            frames: Vec::new(),
        }
    }

    pub(crate) fn json(&self) -> Result<Vec<u8>, Failure> {
        let mut text = serde_json::to_vec_pretty(self).map_err(|error| Failure::input(format_args!("--report: {error}")))?;
        text.push(b'\n');
        Ok(text)
    }

    /// The run in one line.
    pub(crate) fn summary(&self, out: &Path) -> String {
        let mut times: Vec<f64> = self.frames.iter().skip(1).map(|frame| frame.ms).collect();
        times.sort_by(f64::total_cmp);
        let median = times.get(times.len() / 2).copied().unwrap_or(0.0);
        let strain = self.frames.last().map_or(0.0, |frame| frame.mean_strain);
        let deepest = self.frames.iter().map(|frame| frame.penetration).fold(0.0, f32::max);
        format!(
            "{} on {}: {} vertices, {} frames in {}, {median:.2} ms a frame (median), mean strain {:.2} %, penetration {:.2} mm",
            self.backend,
            self.adapter.as_deref().unwrap_or("the CPU"),
            self.vertices,
            self.frames.len(),
            out.display(),
            100.0 * strain,
            1e3 * deepest,
        )
    }
}

/// The name a value has on the command line.
fn name_of<T>(table: &[(&'static str, T)], is_it: impl Fn(&T) -> bool) -> &'static str {
    table.iter().find(|(_, value)| is_it(value)).map_or("unknown", |&(name, _)| name)
}
