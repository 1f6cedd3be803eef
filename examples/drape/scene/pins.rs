//! Pins of a scene file: the vertices of a cloth that they hold, and how they move.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Mesh, ObjTemplate, UpAxis};
use toml::Spanned;

use super::colliders::turn;
use super::file::{self, Bounds, Rule, Source};
use super::keys::Animated;
use super::timeline::{Moment, NO_PREROLL, Timeline};
use super::values::Extent;
use crate::Failure;
use crate::pins::{Pin, bounds};

/// Largest difference per channel between colors that count as equal.
const SAME_COLOR: f32 = 0.02;

impl file::Pin {
    /// Its name in messages, if it is the pin of its cloth with this number from 1.
    pub(super) fn called(&self, number: usize) -> String {
        self.name.clone().unwrap_or_else(|| format!("pin {number}"))
    }
}

/// Pinned vertices that move together.
#[derive(Debug)]
pub(super) struct Group {
    /// Indices in the combined mesh.
    pub(super) vertices: Vec<u32>,
    /// Positions in the mesh (m).
    rest: Vec<Vec3>,
    about: Vec3,
    by: Option<Animated<Vec3>>,
    rotate: Option<Animated<Vec3>>,
    scale: Option<Animated<Extent>>,
}

impl Group {
    /// Vertices of the combined mesh that do not move.
    pub(super) fn still(pin: &Pin, mesh: &Mesh, up: UpAxis) -> Group {
        let vertices = pin.vertices(mesh, up);
        // The deformer reports an index that is out of range.
        let rest = vertices.iter().map(|&vertex| mesh.positions.get(vertex as usize).copied().unwrap_or_default()).collect();
        Group { vertices, rest, about: Vec3::ZERO, by: None, rotate: None, scale: None }
    }

    /// Reads a pin of a cloth. `piece` is the cloth's own mesh, already placed; its first vertex has the index `first`
    /// in the combined mesh; `obj` is what it was read from.
    pub(super) fn read(
        source: &Source,
        number: usize,
        given: &Spanned<file::Pin>,
        (piece, first): (&Mesh, u32),
        obj: Option<&ObjTemplate>,
        timeline: Timeline,
        up: UpAxis,
    ) -> Result<Group, Failure> {
        let file::Pin { name: _, rule, vertices, color, within, by, rotate, scale, about } = given.get_ref();
        let name = given.get_ref().called(number);
        let wrong = |what: String| source.wrong_in(given, format_args!("{name}: {what}"));
        let chosen: Vec<u32> = match (rule, vertices, color, within) {
            (Some(Rule::Top), None, None, None) => Pin::Top.vertices(piece, up),
            (Some(Rule::Corners), None, None, None) => Pin::Corners.vertices(piece, up),
            (None, Some(list), None, None) => list.iter().map(|number| number.0).collect(),
            (None, None, Some(color), None) => {
                let obj =
                    obj.ok_or_else(|| wrong("a grid has no colors; choose its vertices by rule, vertices or box".to_owned()))?;
                colored(obj, *color)?
            }
            (None, None, None, Some(Bounds { low, high })) => {
                let is_inside = |x: &Vec3| x.cmpge(*low).all() && x.cmple(*high).all();
                (0..).zip(&piece.positions).filter(|(_, x)| is_inside(x)).map(|(vertex, _)| vertex).collect()
            }
            _ => return Err(wrong("give one of rule, vertices, color and box, which choose its vertices".to_owned())),
        };
        let has_start =
            [by, rotate].into_iter().flatten().any(Animated::has_start) || scale.as_ref().is_some_and(Animated::has_start);
        if has_start && timeline.preroll == 0 {
            return Err(wrong(NO_PREROLL.to_owned()));
        }
        let count = piece.positions.len();
        if let Some(vertex) = chosen.iter().find(|&&vertex| vertex as usize >= count) {
            return Err(wrong(format!("vertex {vertex} does not exist; the cloth has {count} vertices, numbered from 0")));
        }
        if chosen.is_empty() {
            let file = obj.map_or("the grid", |_| "the mesh");
            return Err(wrong(match color {
                Some(color) => format!("it chooses no vertex; {file} has none of color {color}, in numbers from 0 to 1"),
                None => format!("it chooses no vertex; {file} reaches {} m to {} m", bounds(piece).0, bounds(piece).1),
            }));
        }
        let rest: Vec<Vec3> = chosen.iter().map(|&vertex| piece.positions[vertex as usize]).collect();
        let (low, high) = bounds(&Mesh { positions: rest.clone(), triangles: Vec::new() });
        let group = Group {
            vertices: chosen.iter().map(|vertex| vertex + first).collect(),
            about: about.unwrap_or(0.5 * (low + high)),
            rest,
            by: by.clone().map(|by| by.starting_at(Vec3::ZERO)),
            rotate: rotate.clone().map(|rotate| rotate.starting_at(Vec3::ZERO)),
            scale: scale.clone().map(|scale| scale.starting_at(Extent(Vec3::ONE))),
        };
        let begin = timeline.moment(timeline.first());
        let begins_at_rest =
            group.at(begin).zip(&group.rest).all(|(at, rest)| at.distance(*rest) <= 1e-5 * (1.0 + rest.length()));
        if !begins_at_rest {
            let message = match timeline.preroll {
                0 => {
                    "at 0 s it would not be where the cloth is; its first keys must be move = [0, 0, 0], rotate = [0, 0, 0], scale = [1, 1, 1], or give a preroll, in which it goes there"
                }
                _ => "at its start it would not be where the cloth is; leave out `start`",
            };
            return Err(wrong(message.to_owned()));
        }
        Ok(group)
    }

    /// Whether the group moves at all.
    pub(super) fn moves(&self) -> bool {
        self.by.is_some() || self.rotate.is_some() || self.scale.is_some()
    }

    /// The positions of its vertices at a moment.
    pub(super) fn at(&self, moment: Moment) -> impl Iterator<Item = Vec3> {
        let scale = self.scale.as_ref().map_or(Vec3::ONE, |scale| scale.at(moment).0);
        let rotation = turn(self.rotate.as_ref().map_or(Vec3::ZERO, |rotate| rotate.at(moment)));
        let to = self.about + self.by.as_ref().map_or(Vec3::ZERO, |by| by.at(moment));
        let is_led = self.moves();
        self.rest.iter().map(move |&rest| if is_led { to + rotation * (scale * (rest - self.about)) } else { rest })
    }
}

/// Vertices of an OBJ that have a color: `v x y z r g b`, or with one more number, an opacity after it. Its text comes from the template, since a pipe can be read only once.
fn colored(obj: &ObjTemplate, color: Vec3) -> Result<Vec<u32>, Failure> {
    let text = obj.write(&obj.mesh().positions).map_err(Failure::input)?;
    let text = String::from_utf8_lossy(&text);
    let mut lines = text.trim_start_matches('\u{feff}').lines().map(|line| line.split('#').next().unwrap_or_default().trim());
    let vertices = std::iter::from_fn(|| {
        let of_vertex = |line: &&str| line.trim_end_matches('\\').split_whitespace().next() == Some("v");
        let mut vertex = lines.find(of_vertex)?.to_owned();
        // Only statements are continued after a backslash; a comment or a path may end in one.
        while let Some(continued) = vertex.strip_suffix('\\') {
            vertex = format!("{continued} {}", lines.next().unwrap_or_default());
        }
        Some(vertex)
    });
    let has_color = |vertex: &str| {
        let numbers: Vec<f32> = vertex.split_whitespace().skip(1).map_while(|word| word.parse().ok()).collect();
        let rgb = numbers.get(3..6).filter(|_| numbers.len() < 8);
        rgb.is_some_and(|rgb| (Vec3::from_slice(rgb) - color).abs().max_element() <= SAME_COLOR)
    };
    Ok((0..).zip(vertices).filter(|(_, vertex)| has_color(vertex)).map(|(index, _)| index).collect())
}
