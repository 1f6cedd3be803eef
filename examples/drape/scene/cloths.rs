//! The cloths of a run, combined into one mesh, and their pins.

use std::path::{Path, PathBuf};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Fabric, Mesh, ObjTemplate, UpAxis};
use toml::Spanned;

use super::colliders::turn;
use super::fabrics::{Material, soft_diagonals};
use super::file::{Cloth, File, Grid, Source};
use super::pins::Group;
use super::timeline::Timeline;
use super::values::Whole;
use crate::Failure;
use crate::arguments::Arguments;
use crate::command::warn;
use crate::pins::{Pin, bounds};
use crate::preview::{Look, Piece, linear};

/// Most vertices of a mesh.
const MOST: u64 = 1 << 24;
/// Largest coordinate of a vertex (m).
const FARTHEST: f32 = 1e15;
/// A cloth of this size (m) is probably given in centimeters: as a garment is of 70, while few sails are as large.
const LARGE: f32 = 20.0;
/// At this many of its sizes from the origin, the positions of a cloth are rounded to a thousandth of that size.
const FAR: f32 = 1e4;

/// All cloths of a run.
pub(super) struct Cloths {
    /// Name of the mesh in error messages.
    pub(super) name: String,
    pub(super) mesh: Mesh,
    /// The file that the mesh was read from, if it is a single file.
    pub(super) template: Option<ObjTemplate>,
    /// Whether any cloth has texture coordinates.
    pub(super) is_textured: bool,
    /// The material of each cloth.
    pub(super) materials: Vec<Material>,
    pub(super) pins: Vec<Group>,
    /// Where each pin of a scene file was given.
    pub(super) pin_places: Vec<String>,
    /// The colors of each cloth.
    pub(super) pieces: Vec<Piece>,
    /// Files that were read. Outputs must not overwrite them, and the receipt names them.
    pub(super) files: Vec<PathBuf>,
}

impl Cloths {
    /// The towel, or the mesh given on the command line.
    pub(super) fn of_arguments(arguments: &Arguments, up: UpAxis) -> Result<Cloths, Failure> {
        let template = arguments.mesh.as_deref().map(load).transpose()?;
        let name = arguments.mesh.as_ref().map_or("the towel".to_owned(), |path| path.display().to_string());
        let mut mesh = template.as_ref().map_or_else(|| towel(up), |template| template.mesh().clone());
        place(&mut mesh, arguments.scale, None, None);
        let pins = vec![Group::still(arguments.pin.as_ref().unwrap_or(&Pin::None), &mesh, up)];
        let fabric = arguments.fabric.unwrap_or(Fabric::TOWEL);
        let materials = vec![Material { fabric, vertices: mesh.positions.len(), diagonals: Vec::new() }];
        doubt(&name, &mesh);
        let is_textured = template.as_ref().is_some_and(ObjTemplate::is_textured);
        let files = arguments.mesh.iter().cloned().collect();
        let (pin_places, pieces) = (Vec::new(), Vec::new());
        Ok(Cloths { name, mesh, template, is_textured, materials, pins, pin_places, pieces, files })
    }

    /// The cloths of a scene file. The command line may replace the mesh if there is only one cloth, all scales, all
    /// fabrics and all pins.
    pub(super) fn of_scene(
        arguments: &Arguments,
        source: &Source,
        file: &File,
        timeline: Timeline,
        up: UpAxis,
    ) -> Result<Cloths, Failure> {
        if file.cloth.is_empty() {
            return Err(source.wrong(0, "there is no cloth; give at least one [[cloth]] with a mesh or a grid"));
        }
        if file.cloth.len() > 1 && arguments.mesh.is_some() {
            let message = "the scene has several cloths; MESH.obj can take the place of an only one";
            return Err(source.wrong_in(&file.cloth[1], message));
        }
        let mut all = Cloths {
            name: source.name(),
            mesh: Mesh::default(),
            template: None,
            is_textured: false,
            materials: Vec::new(),
            pins: Vec::new(),
            pin_places: Vec::new(),
            pieces: Vec::new(),
            files: Vec::new(),
        };
        for (number, given) in file.cloth.iter().enumerate() {
            all.add(arguments, source, number + 1, given, timeline, up)?;
        }
        if let Some(pin) = &arguments.pin {
            all.pins = vec![Group::still(pin, &all.mesh, up)];
        }
        Ok(all)
    }

    /// Adds a cloth.
    fn add(
        &mut self,
        arguments: &Arguments,
        source: &Source,
        number: usize,
        given: &Spanned<Cloth>,
        timeline: Timeline,
        up: UpAxis,
    ) -> Result<(), Failure> {
        let cloth = given.get_ref();
        let name = cloth.name.clone().unwrap_or_else(|| format!("cloth {number}"));
        let wrong = |what: &str| source.wrong_in(given, format_args!("{name}: {what}"));
        let obj = match (&arguments.mesh, &cloth.mesh) {
            (Some(path), _) => Some(path.clone()),
            (None, Some(path)) => Some(source.beside(path.get_ref())),
            (None, None) => None,
        };
        let template = match (&obj, &cloth.mesh) {
            (Some(path), Some(mesh)) if arguments.mesh.is_none() => {
                Some(load(path).map_err(|failure| source.wrong_in(mesh, &failure.message))?)
            }
            (Some(path), _) => Some(load(path)?),
            (None, _) => None,
        };
        let mut piece = match (&template, &cloth.grid) {
            (Some(_), Some(_)) if cloth.mesh.is_some() => return Err(wrong("it has a mesh and a grid; give one of them")),
            (Some(template), _) => template.mesh().clone(),
            (None, Some(given)) => {
                let Grid { columns: Whole(columns), rows: Whole(rows), width, height } = given.get_ref();
                if *columns < 2 || *rows < 2 || u64::from(*columns) * u64::from(*rows) > MOST {
                    let message = format!(
                        "{name}: a grid of {columns} x {rows} vertices; give 2 or more a side, and {MOST} in all at most"
                    );
                    return Err(source.wrong_in(given, message));
                }
                level(Mesh::grid(*columns, *rows, width.0, height.0), up)
            }
            (None, None) => return Err(wrong("it has no mesh; give `mesh = \"FILE.obj\"` or a grid")),
        };
        place(&mut piece, arguments.scale.or(cloth.scale.map(|scale| scale.0)), cloth.rotate, cloth.at);
        if piece.positions.iter().any(|x| !x.is_finite() || x.abs().max_element() > FARTHEST) {
            return Err(wrong("it is farther away than 1e15 m; give it another scale or place"));
        }
        doubt(&name, &piece);
        let first = self.mesh.positions.len() as u32;
        if arguments.pin.is_none() {
            let mut is_held = vec![false; piece.positions.len()];
            for (number, pin) in cloth.pin.iter().enumerate() {
                let group = Group::read(source, number + 1, pin, (&piece, first), template.as_ref(), timeline, up)?;
                for vertex in group.vertices.iter().map(|vertex| vertex - first) {
                    if std::mem::replace(&mut is_held[vertex as usize], true) {
                        return Err(source.wrong_in(pin, format_args!("{name}: vertex {vertex} is pinned twice; name it once")));
                    }
                }
                self.pins.push(group);
                self.pin_places.push(format!("{}: {}", source.place(pin.span().start), pin.get_ref().called(number + 1)));
            }
        }
        let fabric = arguments.fabric.or(cloth.fabric).unwrap_or(Fabric::TOWEL);
        let diagonals = match cloth.shear {
            None => Vec::new(),
            Some(shear) => {
                let quads = piece.triangles.len() / 2;
                let corners: Vec<usize> = match &template {
                    Some(template) => template.polygons().iter().map(Vec::len).collect(),
                    None => vec![4; quads],
                };
                soft_diagonals(&piece, corners.into_iter(), fabric.stretch, shear.0).map_err(|most| match most {
                    None => wrong("shear needs polygons of four corners; leave it out"),
                    Some(most) => wrong(&format!("shear = {} N/m; this fabric and mesh have {most:.0} N/m at most", shear.0)),
                })?
            }
        };
        self.materials.push(Material { fabric, vertices: piece.positions.len(), diagonals });
        self.mesh.positions.append(&mut piece.positions);
        let [color, lining] = Look::SIDES;
        let sides = [cloth.color.map_or(color, |color| linear(color.0)), cloth.lining.map_or(lining, |color| linear(color.0))];
        self.pieces.push(Piece { end: self.mesh.positions.len() as u32, sides });
        self.mesh.triangles.extend(piece.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
        self.files.extend(obj);
        self.is_textured |= template.as_ref().is_some_and(ObjTemplate::is_textured);
        self.template = template.filter(|_| number == 1);
        Ok(())
    }
}

/// Reads a mesh from a file. A mesh without faces is rejected, because its points would fall independently.
fn load(path: &Path) -> Result<ObjTemplate, Failure> {
    let template = ObjTemplate::load(path).map_err(Failure::input)?;
    if template.mesh().triangles.is_empty() {
        return Err(Failure::input(format_args!("{}: no faces; give at least one line `f a b c`", path.display())));
    }
    Ok(template)
}

/// The cloth of the 2013 plug-in's scene, spread out above the sphere and wide enough for its corners to reach the
/// floor.
fn towel(up: UpAxis) -> Mesh {
    let mut mesh = level(Mesh::grid(64, 64, 1.2, 1.2), up);
    place(&mut mesh, None, None, Some(up.turn(Vec3::new(0.0, 0.7, 0.0))));
    mesh
}

/// Turns a grid, which faces y, so that it faces up.
fn level(mut grid: Mesh, up: UpAxis) -> Mesh {
    grid.positions.iter_mut().for_each(|x| *x = up.turn(*x));
    grid
}

/// Scales, rotates (degrees) and moves (m) a mesh, as far as requested.
fn place(mesh: &mut Mesh, scale: Option<f32>, rotate: Option<Vec3>, at: Option<Vec3>) {
    let rotation = rotate.map(turn);
    for x in &mut mesh.positions {
        *x = scale.map_or(*x, |scale| scale * *x);
        *x = rotation.map_or(*x, |rotation| rotation * *x);
        *x = at.map_or(*x, |at| at + *x);
    }
}

/// Warns if a mesh is probably in other units, too far away for its positions to tell its edges, or in parts that were meant to be
/// one.
fn doubt(name: &str, mesh: &Mesh) {
    let (low, high) = bounds(mesh);
    let extent = (high - low).max_element();
    if extent >= LARGE {
        let message =
            format!("{name} is {extent} m across; if those are centimeters, scale it by 0.01 (`--scale`, or `scale` in a scene)");
        warn("warning", &message);
    }
    let far = low.abs().max(high.abs()).max_element();
    if extent > 0.0 && far > FAR * extent {
        let message = format!(
            "{name} is {extent} m across and up to {far} m from the origin, where positions are rounded to {:.1} mm; export and place it nearer to the origin",
            1e3 * far * f32::EPSILON
        );
        warn("warning", &message);
        return;
    }
    let (doubles, first) = doubles(mesh);
    if let Some([a, b]) = first {
        let message = format!(
            "{name}: {doubles} vertices lie exactly where others do, the first of them {a} and {b}, and the cloth is not joined there; if it is one piece, as a mesh whose vertices were split for texture coordinates or normals, merge them by distance"
        );
        warn("warning", &message);
    }
}

/// How many corners of triangles lie exactly where another one does, and the first two that do.
fn doubles(mesh: &Mesh) -> (usize, Option<[u32; 2]>) {
    let mut vertices: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    // Adding 0 makes -0 equal to 0.
    let place = |vertex: &u32| mesh.positions[*vertex as usize].to_array().map(|x| (x + 0.0).to_bits());
    vertices.sort_by_key(place);
    let groups = || vertices.chunk_by(|a, b| place(a) == place(b)).filter(|group| group.len() > 1);
    (groups().map(<[u32]>::len).sum(), groups().map(|group| [group[0], group[1]]).min())
}
