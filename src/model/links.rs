//! The edges of a cloth: lengths and stiffnesses from a mesh, and their order by color.

use std::ops::Range;

use glam::Vec3;

use crate::model::coloring;
use crate::model::link::{Link, Visits, firm, in_order};
use crate::options::Options;

/// The edges of a mesh, in its order, between renumbered vertices.
pub(super) struct Links {
    pub list: Vec<Link>,
    /// Length of the longest edge (m), and the mean of all; 0 without edges.
    pub longest_edge: f64,
    pub mean_edge: f64,
    /// The factor of firm edges ([`firm`]), and K (N/m) of the fabric times that.
    pub firm: f64,
    pub membrane_stiffness: f64,
    pub slivers: Slivers,
}

impl Links {
    /// `rank` is the number of each of the mesh's vertices, `rest` their positions (m) by number, and `side_area` the area (m²)
    /// of the triangles at each edge. `visits` are those of each edge, or empty.
    pub(super) fn new(
        mesh_edges: &[[u32; 2]],
        visits: &[Visits],
        rank: &[u32],
        rest: &[Vec3],
        side_area: &[f64],
        options: &Options,
    ) -> Links {
        let numbered = |named: [u32; 2]| named.map(|vertex| rank[vertex as usize]);
        let length = |[a, b]: [u32; 2]| rest[a as usize].as_dvec3().distance(rest[b as usize].as_dvec3());
        let lengths = mesh_edges.iter().map(|&named| length(numbered(named)));
        let (longest, sum) = lengths.fold((0.0_f64, 0.0), |(longest, sum), length| (longest.max(length), sum + length));
        let least = shortest(longest);
        let scales = options.edge_scale.as_deref();
        let firm = scales.map_or(1.0, |scales| firm(scales.iter().copied()));
        // Cloth without stiffness has no firm edges.
        let firm = if firm > 0.0 { f64::from(firm) } else { 1.0 };
        let membrane_stiffness = f64::from(options.fabric.stretch) * firm;
        let mut links: Vec<Link> = Vec::with_capacity(mesh_edges.len());
        let (mut slivers, mut worst_aspect) = (Slivers::default(), 0.0);
        for (index, &named) in mesh_edges.iter().enumerate() {
            let [a, b] = numbered(named);
            let ends = [a.min(b), a.max(b)];
            let length = length(ends);
            // Coincident vertices have no direction. A tiny length in place of 0 keeps the arithmetic finite.
            let is_too_short = length < least;
            let length = length.max(least);
            // An edge without area (a thread, a degenerate triangle) gets that of a square of its length.
            let area = if side_area[index] > 0.0 { side_area[index] } else { length * length };
            let aspect = area / (length * length);
            let sliver = if is_too_short { f64::INFINITY } else { aspect };
            if sliver > SLIVER {
                slivers.edges += 1;
                if sliver > worst_aspect {
                    (slivers.worst, worst_aspect) = (named, sliver);
                }
            }
            let scale = scales.map_or(1.0, |scales| scales[index]);
            let shape = f64::from(scale) / firm * aspect;
            let visits = visits.get(index).copied().unwrap_or_default();
            links.push(Link { ends, rest: length as f32, shape, scale, visits });
        }
        let mean_edge = sum / mesh_edges.len().max(1) as f64;
        Links { list: links, longest_edge: longest, mean_edge, firm, membrane_stiffness, slivers }
    }
}

/// Counts edges whose triangles are over 100 times as high as the edge is long, `(A1 + A2)/l0²` above [`SLIVER`], and edges without
/// length.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Slivers {
    pub edges: usize,
    /// The edge with the highest triangles relative to its length, by the mesh's indices.
    pub worst: [u32; 2],
}

const SLIVER: f64 = 100.0;

/// The least length (m) of an edge, given that of the longest one.
pub(super) fn shortest(longest: f64) -> f64 {
    (1e-7 * longest).max(1e-12)
}

/// Colors the edges with a free vertex and sorts them by color, those that are visited twice first, with the others after them.
/// Returns the range of each color.
pub(super) fn sort_by_color(links: &mut [Link], rest: &[Vec3], inverse_mass: &[f32]) -> Vec<Range<usize>> {
    let is_free = |link: &Link| link.ends.iter().any(|&vertex| inverse_mass[vertex as usize] > 0.0);
    let (free, held): (Vec<Link>, Vec<Link>) = in_order(links).partition(|link| is_free(link));
    let ends: Vec<[u32; 2]> = free.iter().map(|link| link.ends).collect();
    let is_first: Vec<bool> = free.iter().map(|link| link.visits == Visits::FirstAndLast).collect();
    let colors = coloring::color_in_turn(&ends, rest, &is_first).batches();
    let of_color = |places: &[u32]| {
        let links = places.iter().map(|&place| free[place as usize]);
        let (first, others): (Vec<Link>, Vec<Link>) = links.partition(Link::is_visited_twice);
        first.into_iter().chain(others)
    };
    let sorted = colors.lists().flat_map(of_color).chain(held);
    links.iter_mut().zip(sorted).for_each(|(link, sorted)| *link = sorted);
    colors.spans.iter().map(|span| span.range()).collect()
}
