//! The cloth: everything about a mesh and its fabric that does not change while it moves.
//!
//! On the CPU a vertex of a grid takes 350 bytes in all, 420 with levels, 500 with bending, 550 with bending in several
//! passes (`tests/memory.rs`). Of the 350 bytes, 96 are the three edges stored here, 48 their coefficients for one
//! length of substep, and 64 the state and the copy of it for undoing a step.

use std::ops::Range;
use std::sync::OnceLock;

use glam::{DVec3, Vec3, Vec4};

use crate::error::BuildError;
use crate::kernels::spring::Spring;
use crate::kernels::statistics::{StrainGauge, WHOLE};
use crate::kernels::wind::Panel;
use crate::model::bending::Bending;
use crate::model::checks::{check_mesh, check_options, check_thickness};
use crate::model::csr::{Csr, distinct};
use crate::model::extents::{Extents, extents};
use crate::model::link::{Link, Visits, in_order, least_firm};
use crate::model::links::{Links, Slivers, shortest, sort_by_color};
use crate::model::masses::Weights;
use crate::model::mesh::{EdgeIndex, Mesh, area_of, bounds, is_proper, sides, vertex_areas};
use crate::model::shells::visits;
use crate::model::tethers::{Hung, Tethers};
use crate::model::vertex_order;
use crate::model::winding::wind_alike;
use crate::options::{self, Method, Options};

/// A cloth in its own vertex order and local coordinates.
pub(crate) struct Cloth {
    /// The index in the mesh of each vertex.
    pub order: Vec<u32>,
    /// Number of vertices with edges, which come first. Files often have others next to a cloth, which belong to nothing and
    /// stay where they are unless they are pinned. If there are no edges at all, all vertices are points that move.
    pub used: usize,
    /// The origin of the local coordinates (m). Subtracting it from the mesh's positions of vertices with edges is exact.
    pub origin: Vec3,
    /// Rest positions (m); w is the inverse mass (1/kg), 0 where pinned.
    pub rest: Vec<Vec4>,
    /// Masses (kg), of pinned vertices too.
    pub mass: Vec<f32>,
    /// Triangles, without those that name a vertex twice.
    pub triangles: Vec<[u32; 3]>,
    /// Edges in color order. Edges between two pins come last and have no color.
    pub links: Vec<Link>,
    /// The range of edges of each color. Those that are visited twice come first in each.
    pub colors: Vec<Range<usize>>,
    /// Whether the sweep visits edges twice: see [`Link::visits`].
    pub sweeps_back: bool,
    /// Whether most of the cloth is a closed shell.
    pub is_shell: bool,
    /// Pinned vertices, in the order of [`Options::pinned`].
    pub pinned: Vec<u32>,
    /// Mean areal density (kg/m²).
    pub density: f64,
    /// Sides of the rest shape's bounding box (m).
    pub sides: DVec3,
    /// How far it spans between what holds it.
    pub extents: Extents,
    /// Length of the longest edge (m), and the mean of all.
    pub longest_edge: f32,
    pub mean_edge: f32,
    /// Membrane stiffness K (N/m) of the fabric times the factor of its firm edges ([`firm`]), which is 1 for most cloth.
    pub membrane_stiffness: f64,
    firm: f64,
    pub slivers: Slivers,
    /// Whether any triangle has an area.
    pub is_sheet: bool,
    /// Tethers; none if no pin is alone or they are switched off.
    pub tethers: Option<Tethers>,
    /// Factor on the bending rigidity for each vertex ([`Options::bending_scale`]); empty if it is 1 everywhere.
    bending_scale: Vec<f32>,
    panels: OnceLock<Panels>,
    springs: OnceLock<Csr<Spring>>,
    bending: OnceLock<Bending>,
    gauges: OnceLock<Vec<StrainGauge>>,
}

/// The triangles with their masses for aerodynamic forces, and the triangles at each vertex.
pub(crate) struct Panels {
    pub panels: Vec<Panel>,
    pub around: Csr<u32>,
}

impl Cloth {
    /// Validates the mesh and the options, and builds what every scene needs.
    pub(crate) fn new(mesh: &Mesh, options: &Options) -> Result<Cloth, BuildError> {
        check_mesh(mesh)?;
        let mesh_edges = mesh.edges();
        let vertices = mesh.positions.len();
        check_options(vertices, mesh_edges.len(), options)?;
        let order = vertex_order::vertex_order(&mesh_edges, vertices);
        let rank = vertex_order::inverse(&order);
        // Those with edges come first.
        let count = mesh_edges.iter().flatten().map(|&vertex| 1 + rank[vertex as usize] as usize).max().unwrap_or(0);
        let used = if count > 0 { count } else { vertices };
        let origin = local_origin(order[..used].iter().map(|&vertex| &mesh.positions[vertex as usize]));
        let rest: Vec<Vec3> = order.iter().map(|&vertex| mesh.positions[vertex as usize] - origin).collect();
        let moved = |triangle: &[u32; 3]| triangle.map(|vertex| rank[vertex as usize]);
        let mut proper = mesh.triangles.clone();
        proper.retain(is_proper);
        wind_alike(&mut proper, &mesh_edges, vertices);
        let triangles: Vec<[u32; 3]> = proper.iter().map(moved).collect();

        let mut area = vec![0.0; vertices];
        let mut side_area = vec![0.0; mesh_edges.len()];
        let index_of = EdgeIndex::new(&mesh_edges, vertices);
        let visits = match options.method {
            Method::SmallSteps => visits(&mesh.positions, &proper, &mesh_edges, &index_of),
            _ => Vec::new(),
        };
        for (named, &triangle) in proper.into_iter().zip(&triangles) {
            let triangle_area = area_of(triangle, &rest);
            triangle.iter().for_each(|&vertex| area[vertex as usize] += triangle_area / 3.0);
            sides(named).for_each(|side| side_area[index_of.of(side)] += triangle_area);
        }
        let Weights { mass, density, pinned, inverse_mass } = Weights::new(options, &order, &area, used)?;

        let [low, high] = bounds(&rest[..count]);
        let sides = (high.as_dvec3() - low.as_dvec3()).max(DVec3::ZERO);
        if let Some(contact) = options.contact.filter(|_| !triangles.is_empty()) {
            check_thickness(&rest[..used], sides.max_element(), contact.thickness)?;
        }
        let Links { list: mut links, longest_edge, mean_edge, firm, membrane_stiffness, slivers } =
            Links::new(&mesh_edges, &visits, &rank, &rest, &side_area, options);
        let extents = extents(&rest[..used], &links, |vertex| inverse_mass[vertex as usize] == 0.0);
        let colors = sort_by_color(&mut links, &rest, &inverse_mass);
        let bending_scale =
            options.bending_scale.iter().flat_map(|scale| order.iter().map(|&vertex| scale[vertex as usize])).collect();
        let rest = rest.iter().zip(&inverse_mass).map(|(x, &w)| x.extend(w)).collect();
        let cloth = Cloth {
            order,
            used,
            origin,
            rest,
            mass,
            triangles,
            links,
            colors,
            sweeps_back: visits.iter().any(|&visits| visits != Visits::Once),
            is_shell: 2 * visits.iter().filter(|&&visits| visits == Visits::ThereAndBack).count() > mesh_edges.len(),
            pinned,
            density,
            sides,
            extents,
            longest_edge: longest_edge as f32,
            mean_edge: mean_edge as f32,
            membrane_stiffness,
            firm,
            slivers,
            is_sheet: area.iter().any(|&area| area > 0.0),
            bending_scale,
            panels: OnceLock::new(),
            springs: OnceLock::new(),
            bending: OnceLock::new(),
            gauges: OnceLock::new(),
            tethers: None,
        };
        Ok(cloth.tethered(options))
    }

    /// The cloth as it would be built with other options: fabric, masses and pins. What depends on the mesh alone is
    /// copied. Also tells what has changed.
    pub(crate) fn changed(&self, options: &Options) -> Result<(Cloth, Change), BuildError> {
        check_options(self.rest.len(), self.links.len(), options)?;
        let positions: Vec<Vec3> = self.rest.iter().map(|x| x.truncate()).collect();
        let area = vertex_areas(&self.triangles, &positions);
        let Weights { mass, density, pinned, inverse_mass } = Weights::new(options, &self.order, &area, self.used)?;

        let membrane_stiffness = f64::from(options.fabric.stretch) * self.firm;
        let mut links = self.links.clone();
        let is_pinned = |vertex: u32| [self.rest[vertex as usize].w, inverse_mass[vertex as usize]].map(|w| w == 0.0);
        let changes = |link: &Link| {
            let [a, b] = link.ends.map(is_pinned);
            (a[0] && b[0]) != (a[1] && b[1])
        };
        let change = if links.iter().any(changes) {
            Change::Edges
        } else if mass != self.mass || pinned != self.pinned {
            Change::Masses
        } else {
            Change::Stiffness
        };
        let colors = match change {
            Change::Edges => sort_by_color(&mut links, &positions, &inverse_mass),
            _ => self.colors.clone(),
        };
        let extents = match change {
            Change::Stiffness => self.extents,
            _ => extents(&positions[..self.used], &links, |vertex| inverse_mass[vertex as usize] == 0.0),
        };
        let rest = positions.iter().zip(&inverse_mass).map(|(x, &w)| x.extend(w)).collect();
        let cloth = Cloth {
            order: self.order.clone(),
            rest,
            mass,
            triangles: self.triangles.clone(),
            links,
            colors,
            pinned,
            density,
            extents,
            membrane_stiffness,
            bending_scale: self.bending_scale.clone(),
            panels: OnceLock::new(),
            springs: OnceLock::new(),
            bending: self.bending.clone(),
            gauges: OnceLock::new(),
            tethers: None,
            ..*self
        };
        Ok((cloth.tethered(options), change))
    }

    /// With the tethers that the options ask for.
    fn tethered(mut self, options: &Options) -> Cloth {
        if options.tethers == options::Tethers::Auto && options.method == Method::SmallSteps {
            let Cloth { rest, links, triangles, pinned, mass, extents, sides, density, .. } = &self;
            let (extent, size) = (extents.extent, sides.max_element());
            let hung = Hung { rest, links, triangles, pinned, mass, extent, size, density: *density };
            self.tethers = Tethers::new(hung);
        }
        self
    }

    /// The edges that the sweep visits: all except those between two pins.
    pub(crate) fn swept(&self) -> &[Link] {
        &self.links[..self.colors.last().map_or(0, |range| range.end)]
    }

    /// Whether the sweep visits an edge of [`swept`](Self::swept) again on its way back. Those of the last color, with which it turns,
    /// have just been solved.
    pub(crate) fn is_visited_again(&self, edge: usize) -> bool {
        self.links[edge].is_visited_twice() && self.colors.last().is_some_and(|last| edge < last.start)
    }

    /// The ranges of edges that a sweep visits one after another: each color, and then those with a second visit in reverse order.
    #[cfg(any(test, feature = "gpu"))]
    pub(crate) fn visits(&self) -> Vec<Range<usize>> {
        let again = |color: &Range<usize>| {
            color.start..color.start + color.clone().take_while(|&edge| self.is_visited_again(edge)).count()
        };
        let back = self.colors.iter().rev().map(again).filter(|range| !range.is_empty());
        self.colors.iter().cloned().chain(back).collect()
    }

    /// Inverse mass (1/kg) of each vertex, 0 where pinned.
    pub(crate) fn inverse_mass(&self) -> Vec<f32> {
        self.rest.iter().map(|x| x.w).collect()
    }

    /// How much of the cloth can hang on an edge: how far it extends (m) along the edge's direction, over how far it
    /// extends at most. For example, edges across a strip can hold no more than its width.
    pub(crate) fn load_share(&self, link: &Link) -> f64 {
        let [a, b] = link.ends.map(|vertex| self.rest[vertex as usize].truncate().as_dvec3());
        let along = (b - a).normalize_or_zero().abs().dot(self.extents.sides);
        if self.extents.extent > 0.0 { (along / self.extents.extent).min(1.0) } else { 1.0 }
    }

    /// Stiffness `K (A1 + A2) / l0²` (N/m) of an edge, also of one between aggregates; infinite if inextensible.
    pub(crate) fn stiffness(&self, link: &Link) -> f64 {
        if link.shape == 0.0 { 0.0 } else { self.membrane_stiffness * link.shape }
    }

    /// The stiffness of an edge as a multiple of that of firm edges.
    pub(crate) fn softness(&self, link: &Link) -> f64 {
        f64::from(link.scale) / self.firm
    }

    /// Sum of the inverse masses (1/kg) of an edge's ends.
    pub(crate) fn weight(&self, link: &Link) -> f64 {
        link.ends.iter().map(|&vertex| f64::from(self.rest[vertex as usize].w)).sum()
    }

    /// The triangles for aerodynamic forces; built on first use.
    pub(crate) fn panels(&self) -> &Panels {
        self.panels.get_or_init(|| {
            let rest: Vec<Vec3> = self.rest.iter().map(|x| x.truncate()).collect();
            let area = vertex_areas(&self.triangles, &rest);
            let density = |vertex: u32| f64::from(self.mass[vertex as usize]) / area[vertex as usize];
            let panel = |&corners: &[u32; 3]| {
                let least = corners.iter().map(|&vertex| density(vertex)).fold(f64::INFINITY, f64::min);
                let mass = (area_of(corners, &rest) * least) as f32;
                Panel { corners, mass: if mass.is_finite() { mass.max(f32::MIN_POSITIVE) } else { f32::MIN_POSITIVE } }
            };
            // Sorted so that triangles close to each other are close in memory: the mesh's order of triangles may
            // differ from the order of vertices here.
            let by_first = self.triangles.iter().map(|&[a, b, c]| (a.min(b).min(c), [a, b, c]));
            let triangles = Csr::new(rest.len(), by_first).items;
            let panels = triangles.iter().map(panel).collect();
            let corners = triangles.iter().enumerate();
            let around = corners.flat_map(|(index, triangle)| triangle.map(|vertex| (vertex, index as u32)));
            Panels { panels, around: Csr::new(rest.len(), around) }
        })
    }

    /// The springs at each vertex; built only for [`Method::Springs`].
    pub(crate) fn springs(&self) -> &Csr<Spring> {
        self.springs.get_or_init(|| {
            let ends = self.swept().iter().flat_map(|link| {
                let [a, b] = link.ends;
                let spring = |other| Spring { other, rest: link.rest, stiffness: self.stiffness(link) as f32 };
                [(a, spring(b)), (b, spring(a))]
            });
            Csr::new(self.rest.len(), ends)
        })
    }

    /// The rows of the bending energy; built only for a fabric with bending stiffness.
    pub(crate) fn bending(&self) -> &Bending {
        self.bending.get_or_init(|| {
            let mut bending = Bending::new(&self.rest, &self.triangles);
            bending.weight.iter_mut().zip(&self.bending_scale).for_each(|(weight, &scale)| *weight *= f64::from(scale));
            bending
        })
    }

    /// The strain gauges, built when strain is measured: one on each swept edge that is firm and has a length, weighted by the area of
    /// its triangles so that slivers count little. A thread has no area; its edges count with the area of a square, as they do for their
    /// stiffness.
    pub(crate) fn gauges(&self) -> &[StrainGauge] {
        self.gauges.get_or_init(|| {
            let area = |link: &Link| link.shape / f64::from(link.scale) * f64::from(link.rest).powi(2);
            let least = least_firm(self.swept());
            // In the order of the vertices, so that measuring reads memory sequentially.
            let held = in_order(self.swept()).filter(|link| link.is_firm(least) && self.has_length(link));
            let held: Vec<_> = held.map(|link| (link, area(link))).collect();
            let total: f64 = held.iter().map(|(_, area)| area).sum();
            let weight = |area: f64| (area / total * f64::from(WHOLE)).round() as u32;
            let gauge = |&(link, area): &(&Link, f64)| StrainGauge {
                ends: link.ends,
                inverse_rest: 1.0 / link.rest,
                weight: weight(area),
            };
            held.iter().map(gauge).collect()
        })
    }

    /// Whether an edge has a length at rest, of which its strain is a share.
    pub(crate) fn has_length(&self, link: &Link) -> bool {
        f64::from(link.rest) > 1.5 * shortest(f64::from(self.longest_edge))
    }

    /// Whether a vertex has edges. Others are in nobody's way.
    pub(crate) fn is_used(&self, vertex: u32) -> bool {
        (vertex as usize) < self.used
    }

    /// Ends the motion `p` of vertices that are not pinned and have no edges: they stay where they are.
    pub(crate) fn stop_loose(&self, p: &mut [Vec4]) {
        let pinned = distinct(self.pinned.clone());
        let loose = (0..).zip(p).skip(self.used).filter(|(vertex, _)| pinned.binary_search(vertex).is_err());
        loose.for_each(|(_, p)| *p = Vec4::ZERO.with_w(p.w));
    }

    /// Whether any pin can hold anything.
    pub(crate) fn has_pins(&self) -> bool {
        self.pinned.iter().any(|&pin| self.is_used(pin))
    }
}

/// What a change of options affects besides the stiffness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// Only the stiffness.
    Stiffness,
    /// Masses, or which vertices are pinned.
    Masses,
    /// Also which edges are swept, and thus their order.
    Edges,
}

/// The origin of the local coordinates. It is 0 unless the mesh is far from 0, and such that subtracting it is exact.
///
/// Along an axis whose coordinates are all within a factor of two, the difference of any two is exact (Sterbenz 1974),
/// and so is adding it back.
fn local_origin<'a>(positions: impl IntoIterator<Item = &'a Vec3>) -> Vec3 {
    let [low, high] = bounds(positions);
    let along = |low: f32, high: f32| {
        if low > 0.0 && high <= 2.0 * low || high < 0.0 && low >= 2.0 * high { low + 0.5 * (high - low) } else { 0.0 }
    };
    Vec3::new(along(low.x, high.x), along(low.y, high.y), along(low.z, high.z))
}
