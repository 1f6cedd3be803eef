//! The scene the arguments describe: the cloth, what it is made of, and what it falls on.

use std::path::Path;

use cloth_deformer::{Attributes, Collider, Contact, Mesh, ObjTemplate, Options, Quality, glam::Vec3};

use crate::{
    Failure,
    arguments::{Arguments, Ball},
    pins::bounds,
};

/// Density of the air at sea level and 15 °C (kg/m³) (ISO 2533).
const AIR: f32 = 1.225;

/// All that a run needs.
pub(crate) struct Scene {
    /// What to call the mesh when something is wrong with it.
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    /// The file that the mesh came in, if it came in one.
    pub(crate) template: Option<ObjTemplate>,
    pub(crate) options: Options,
    pub(crate) attributes: Attributes,
}

impl Scene {
    pub(crate) fn new(arguments: &Arguments) -> Result<Scene, Failure> {
        let template = arguments.mesh.as_deref().map(load).transpose()?;
        let name = arguments.mesh.as_ref().map_or("the towel".to_owned(), |path| path.display().to_string());
        let mesh = template.as_ref().map_or_else(towel, |template| template.mesh().clone());
        let quality = match (arguments.substeps, arguments.strain) {
            (Some(substeps), _) => Quality::Substeps(substeps),
            (None, Some(strain)) => Quality::Strain(strain),
            (None, None) => Quality::default(),
        };
        let options = Options {
            backend: arguments.backend,
            method: arguments.method(),
            quality,
            levels: arguments.levels,
            fabric: arguments.fabric,
            pinned: arguments.pin.vertices(&mesh),
            contact: arguments.self_contact.map(|thickness| {
                let usual = Contact::default();
                Contact { thickness, friction: arguments.friction.unwrap_or(usual.friction) }
            }),
            ..Options::default()
        };
        let mut attributes =
            Attributes { gravity: arguments.gravity, colliders: colliders(arguments, &mesh), ..Attributes::default() };
        if let Some(wind) = arguments.wind {
            attributes.wind = wind;
            attributes.air_density = AIR;
        }
        Ok(Scene { name, mesh, template, options, attributes })
    }
}

/// A mesh from a file. Points without a face are no cloth: each would fall by itself.
fn load(path: &Path) -> Result<ObjTemplate, Failure> {
    let template = ObjTemplate::load(path).map_err(Failure::input)?;
    if template.mesh().triangles.is_empty() {
        return Err(Failure::input(format_args!("{}: no faces; give at least one line `f a b c`", path.display())));
    }
    Ok(template)
}

/// The cloth of the 2013 plug-in's scene, spread out above the sphere: wide enough for its corners to reach the floor.
fn towel() -> Mesh {
    let mut mesh = Mesh::grid(64, 64, 1.2, 1.2);
    for position in &mut mesh.positions {
        position.y = 0.7;
    }
    mesh
}

/// The sphere and the floor, where the arguments have them, else to the mesh's size: for one whose largest extent is 1 m
/// (or the towel), a sphere of radius 0.3 m whose top is 0.1 m below the mesh, and a floor that it rests on.
fn colliders(arguments: &Arguments, mesh: &Mesh) -> Vec<Collider> {
    let (low, high) = bounds(mesh);
    let extent = (high - low).max_element();
    // A mesh of one point has no size to go by.
    let size = if extent > 0.0 && arguments.mesh.is_some() { extent } else { 1.0 };
    let ground = low.y - 0.7 * size;
    let resting = Ball { center: (0.5 * (low + high)).with_y(ground + 0.3 * size), radius: 0.3 * size };
    let sphere = arguments.sphere.unwrap_or(resting);
    let floor = arguments.floor.unwrap_or(ground);
    let sphere = (!arguments.no_sphere).then(|| Collider::sphere(sphere.center, sphere.radius));
    let floor = (!arguments.no_floor).then(|| Collider::plane(Vec3::new(0.0, floor, 0.0), Vec3::Y));
    let rub = |collider: Collider| collider.with_friction(arguments.friction.unwrap_or(collider.friction));
    sphere.into_iter().chain(floor).map(rub).collect()
}
