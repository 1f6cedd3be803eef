//! Scenes of cloth in contact with itself.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Collider, Contact, Deformer, Fabric, Mesh, Options, Quality};

use super::shapes::{bent, jittered};

/// A fabric that neither crumples at once nor is as stiff as paper.
pub const CLOTH: Fabric = Fabric { density: 0.2, stretch: 5000.0, bending: 1e-4, damping: 0.03 };
/// Thickness (m).
pub const R: f32 = 0.005;

/// A scene of falling cloth.
pub struct Scene {
    pub mesh: Mesh,
    pub options: Options,
    pub attributes: Attributes,
    /// Initial positions (m), if they are not those of the rest shape.
    pub start: Option<Vec<Vec3>>,
}

impl Scene {
    /// On the CPU.
    pub fn new(mesh: Mesh, substeps: u32, colliders: Vec<Collider>) -> Scene {
        let contact = Some(Contact { thickness: R, friction: 0.3 });
        let quality = Quality::Substeps(substeps);
        let options = Options { backend: Backend::Cpu, quality, fabric: CLOTH, contact, ..Options::default() };
        Scene { mesh, options, attributes: Attributes { colliders, ..Attributes::default() }, start: None }
    }

    pub fn deformer(&self) -> Deformer {
        self.on(self.options.backend)
    }

    pub fn on(&self, backend: Backend) -> Deformer {
        let mut deformer = Deformer::new(&self.mesh, Options { backend, ..self.options.clone() }).unwrap();
        if let Some(start) = &self.start {
            deformer.set_state(start, &vec![Vec3::ZERO; start.len()]).unwrap();
        }
        deformer
    }
}

pub fn floor() -> Collider {
    Collider::plane(Vec3::ZERO, Vec3::Y)
}

/// A sheet above a floor, folded over so that one half lies above the other; it falls shut.
pub fn fold(n: u32) -> Scene {
    let mut scene = Scene::new(jittered(Mesh::grid(n, n, 1.0, 1.0), 1), 20, vec![floor()]);
    scene.start = Some(scene.mesh.positions.iter().map(bent).collect());
    scene
}
