//! The scene the arguments describe: the cloth, what it is made of, and what it falls on.

use cloth_deformer::{
    Attributes, Collider, Mesh, Options, Quality,
    glam::{Vec2, Vec3},
};

use crate::{
    Failure,
    arguments::{Arguments, Ball, Pin},
};

/// Density of the air at sea level and 15 °C [kg/m³] (ISO 2533).
const AIR: f32 = 1.225;

/// All that a run needs.
pub(crate) struct Scene {
    /// What to call the mesh when something is wrong with it.
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    pub(crate) options: Options,
    pub(crate) attributes: Attributes,
}

impl Scene {
    pub(crate) fn new(arguments: &Arguments) -> Result<Scene, Failure> {
        let (name, mesh) = match &arguments.mesh {
            Some(path) => (path.display().to_string(), Mesh::load_obj(path).map_err(Failure::input)?),
            None => ("the towel".to_owned(), towel()),
        };
        let quality = match (arguments.substeps, arguments.strain) {
            (Some(substeps), _) => Quality::Substeps(substeps),
            (None, Some(strain)) => Quality::Strain(strain),
            (None, None) => Quality::default(),
        };
        let options = Options {
            backend: arguments.backend,
            method: arguments.method(),
            quality,
            fabric: arguments.fabric,
            pinned: pinned(&arguments.pin, &mesh),
            ..Options::default()
        };
        let mut attributes =
            Attributes { gravity: arguments.gravity, colliders: colliders(arguments, &mesh), ..Attributes::default() };
        if let Some(wind) = arguments.wind {
            attributes.wind = wind;
            attributes.air_density = AIR;
        }
        Ok(Scene { name, mesh, options, attributes })
    }
}

/// The cloth of the 2013 plug-in's scene, spread out above the sphere.
fn towel() -> Mesh {
    let mut mesh = Mesh::grid(64, 64, 1.0, 1.0);
    for position in &mut mesh.positions {
        position.y = 0.7;
    }
    mesh
}

/// The sphere and the floor, where the arguments have them, else in the plug-in's proportions: for a mesh whose largest
/// extent is 1, a sphere of radius 0.3 whose top is 0.1 below the mesh, and a floor that it rests on.
fn colliders(arguments: &Arguments, mesh: &Mesh) -> Vec<Collider> {
    let (low, high) = bounds(mesh);
    let extent = (high - low).max_element();
    // A mesh of one point has no size to go by.
    let size = if extent > 0.0 { extent } else { 1.0 };
    let ground = low.y - 0.7 * size;
    let resting = Ball { center: (0.5 * (low + high)).with_y(ground + 0.3 * size), radius: 0.3 * size };
    let sphere = arguments.sphere.unwrap_or(resting);
    let floor = arguments.floor.unwrap_or(ground);
    let sphere = (!arguments.no_sphere).then(|| Collider::sphere(sphere.center, sphere.radius));
    let floor = (!arguments.no_floor).then(|| Collider::plane(Vec3::new(0.0, floor, 0.0), Vec3::Y));
    let rub = |collider: Collider| collider.with_friction(arguments.friction.unwrap_or(collider.friction));
    sphere.into_iter().chain(floor).map(rub).collect()
}

/// Numbers of the pinned vertices, each once unless the user's own list repeats itself.
fn pinned(pin: &Pin, mesh: &Mesh) -> Vec<u32> {
    match pin {
        Pin::None => Vec::new(),
        Pin::Top => top(mesh),
        Pin::Corners => corners(mesh),
        Pin::Vertices(list) => list.clone(),
    }
}

/// The highest vertices; of a mesh that lies flat, the side of lowest z.
fn top(mesh: &Mesh) -> Vec<u32> {
    // Part of the extent that rounding in a modeller may spread what is level.
    const LEVEL: f32 = 1e-4;
    let (low, high) = bounds(mesh);
    let extent = high - low;
    let is_top = |position: &Vec3| {
        if extent.y > LEVEL * extent.max_element() {
            position.y >= high.y - LEVEL * extent.y
        } else {
            position.z <= low.z + LEVEL * extent.z
        }
    };
    (0..).zip(&mesh.positions).filter(|(_, position)| is_top(position)).map(|(vertex, _)| vertex).collect()
}

/// The vertices nearest the corners of the mesh's bounding rectangle, along its two largest extents.
fn corners(mesh: &Mesh) -> Vec<u32> {
    let (low, high) = bounds(mesh);
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| f32::total_cmp(&(high - low)[b], &(high - low)[a]));
    let across = |point: Vec3| Vec2::new(point[axes[0]], point[axes[1]]);
    let (low, high) = (across(low), across(high));
    let nearest = |corner: Vec2| {
        let distance = |position: &Vec3| across(*position).distance_squared(corner);
        (0..).zip(&mesh.positions).min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b))).map(|(vertex, _)| vertex)
    };
    let rectangle = [low, Vec2::new(high.x, low.y), Vec2::new(low.x, high.y), high];
    let mut vertices: Vec<u32> = rectangle.into_iter().filter_map(nearest).collect();
    // A small mesh has one vertex nearest to several corners.
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

fn bounds(mesh: &Mesh) -> (Vec3, Vec3) {
    let first = mesh.positions.first().copied().unwrap_or_default();
    mesh.positions.iter().fold((first, first), |(low, high), &position| (low.min(position), high.max(position)))
}
