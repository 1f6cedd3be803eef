//! Statistics of a run: a row for each frame, as JSON, and a summary in one line.

use std::path::Path;

use cloth_deformer::{Backend, Deformer, Measure, Mesh, Method};
use serde::{Deserialize, Serialize};

use crate::{
    Failure,
    arguments::{BACKENDS, METHODS},
};

/// The statistics of a run. The fields appear in the file in this order.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) adapter: Option<String>,
    pub(crate) backend: &'static str,
    method: &'static str,
    vertices: usize,
    edges: usize,
    // The name in the file is fixed, although the code uses the American spelling.
    #[serde(rename = "colours")]
    colors: usize,
    pub(crate) frames: Vec<Frame>,
}

/// The statistics of one frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Frame {
    #[serde(rename = "frame")]
    number: u32,
    /// Duration of `Deformer::step` alone (ms), on a GPU until the work there is done; without reading back.
    ms: f64,
    pub(crate) substeps: u32,
    pub(crate) mean_strain: f32,
    pub(crate) max_strain: f32,
    /// Stretch that 99 % of the area does not exceed.
    pub(crate) stretch_share: f32,
    /// Kinetic plus potential energy (J).
    pub(crate) energy: f64,
    /// Depth of the deepest vertex inside a collider (m).
    pub(crate) penetration: f32,
    /// Pairs of features of the cloth that press on each other.
    pub(crate) contacts: u32,
    /// The texts of all warnings of the step; those of the preroll are in the first frame, after the names of their own.
    #[serde(default)]
    pub(crate) warnings: Vec<String>,
}

impl Frame {
    /// The row of a step that took this many seconds, substeps and contacts, with its warnings. `None` if a value is not finite: JSON
    /// cannot represent it, and it means that the cloth is unstable.
    pub(crate) fn new(
        number: u32,
        seconds: f64,
        [substeps, contacts]: [u32; 2],
        measure: Measure,
        warnings: Vec<String>,
    ) -> Option<Frame> {
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
            warnings,
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

    /// A summary in one line.
    pub(crate) fn summary(&self, out: &Path) -> String {
        let mut times: Vec<f64> = self.frames.iter().skip(1).map(|frame| frame.ms).collect();
        times.sort_by(f64::total_cmp);
        let median = times.get(times.len() / 2).copied().unwrap_or(0.0);
        let strain = self.frames.last().map_or(0.0, |frame| frame.mean_strain);
        let stretch = self.frames.iter().map(|frame| frame.stretch_share).fold(0.0, f32::max);
        let deepest = self.frames.iter().map(|frame| frame.penetration).fold(0.0, f32::max);
        format!(
            "{} on {}: {} vertices, {} frames in {}, {median:.2} ms a frame (median), mean strain {:.2} %, stretched by at most {:.1} %, penetration {:.2} mm",
            self.backend,
            self.adapter.as_deref().unwrap_or("the CPU"),
            self.vertices,
            self.frames.len(),
            out.display(),
            100.0 * strain,
            100.0 * stretch,
            1e3 * deepest,
        )
    }
}

/// The name of a value on the command line.
fn name_of<T>(table: &[(&'static str, T)], is_it: impl Fn(&T) -> bool) -> &'static str {
    table.iter().find(|(_, value)| is_it(value)).map_or("unknown", |&(name, _)| name)
}
