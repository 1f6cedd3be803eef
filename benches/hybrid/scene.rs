//! The scenes that are timed.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Fabric, Levels, Mesh, Options, Quality};

/// Duration of a frame (s), and its substeps.
pub(crate) const FRAME: f32 = 1.0 / 60.0;
pub(crate) const SUBSTEPS: u32 = 20;

/// A square of 1 m, pinned along one side.
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) name: &'static str,
    pub(crate) mesh: Mesh,
    pub(crate) options: Options,
    pub(crate) attributes: Attributes,
}

impl Scene {
    /// Gravity only; with bending; with wind; a towel in wind.
    pub(crate) fn all(n: u32) -> Vec<Scene> {
        let bare = Fabric { density: 0.2, stretch: 5000.0, bending: 0.0, damping: 0.0 };
        let stiff = Fabric { bending: 1e-4, ..bare };
        let scene = |name, fabric, speed: f32| {
            let options =
                Options { quality: Quality::Substeps(SUBSTEPS), fabric, pinned: (0..n).collect(), ..Options::default() };
            let air_density = if speed > 0.0 { 1.225 } else { 0.0 };
            let attributes = Attributes { wind: Vec3::new(0.2 * speed, 0.0, speed), air_density, ..Attributes::default() };
            Scene { name, mesh: Mesh::grid(n, n, 1.0, 1.0), options, attributes }
        };
        vec![scene("hang", bare, 0.0), scene("bending", stiff, 0.0), scene("wind", bare, 5.0), scene("flag", Fabric::TOWEL, 5.0)]
    }

    /// Whether the scene has forces that differ from vertex to vertex.
    pub(crate) fn has_forces(&self) -> bool {
        self.options.fabric.bending > 0.0 || self.attributes.air_density > 0.0
    }

    /// The same scene without those forces and with this many levels.
    pub(crate) fn bare(&self, levels: u32) -> Scene {
        let fabric = Fabric { bending: 0.0, damping: 0.0, ..self.options.fabric };
        Scene {
            name: self.name,
            mesh: self.mesh.clone(),
            options: Options { fabric, levels: Levels::Count(levels), ..self.options.clone() },
            attributes: Attributes { air_density: 0.0, ..self.attributes.clone() },
        }
    }
}
