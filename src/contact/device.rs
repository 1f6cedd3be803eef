//! The part of contact on a GPU that the CPU keeps: the surface and its tree as one table for the shaders, the search
//! for intersections, and the ignored pairs.

use glam::Vec4;

use super::Past;
use super::crossings::LetGo;
use super::pairs::Kind;
use super::past::ListedRows;
use super::paths::Paths;
use super::surface::{LEAF, Surface};
use super::tree::Tree;
use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::options::{Contact, Crossing};
use crate::step::plan::Plan;

// `detection.wgsl` numbers the features that a leaf compares in 7 bits, and tells its at most three turns over another
// leaf's features of a kind, 12 at a time, in 2 bits. A leaf has at most twice its fewest triangles.
const _: () = assert!(2 * LEAF * 3 <= 3 * 12 && 2 * LEAF * (3 + 1 + 3) < 128);

/// The surface and its tree as words, and the positions of the lists in them, as in `About` of
/// `shaders/stages/self_contact/shared.wgsl`.
#[derive(Debug, Default)]
pub(crate) struct Table {
    pub words: Vec<u32>,
    pub depth: u32,
    /// The rows are those of the vertices, followed by those of the edges.
    pub rows: u32,
    pub triangles: u32,
    pub edges: u32,
    pub order: u32,
    pub leaf_triangles: u32,
    pub leaf_edges: u32,
    pub leaf_vertices: u32,
    /// Number of triangles, whose boxes precede those of the edges.
    pub boxes: u32,
    pub excess: u32,
    pub beside: u32,
    pub of_vertices: u32,
}

impl Table {
    fn new(surface: &Surface, tree: &Tree, vertices: usize) -> Table {
        let leaves = &tree.leaves;
        let (excess, beside) = tree.culls();
        let mut table = Table { depth: leaves.depth, ..Table::default() };
        table.rows = (vertices + surface.edges.len()) as u32;
        table.boxes = surface.triangles.len() as u32;
        table.triangles = table.add(surface.triangles.as_flattened());
        table.edges = table.add(surface.edges.as_flattened());
        table.order = table.add(&surface.order);
        table.leaf_triangles = table.add(&leaves.triangles);
        table.leaf_edges = table.add(&leaves.edges);
        table.leaf_vertices = table.add(&leaves.vertices);
        table.excess = table.add(&excess.iter().map(|excess| excess.to_bits()).collect::<Vec<u32>>());
        // For each node, the position of the list of nodes that share a vertex with it, then these lists.
        let nodes = 2_usize << leaves.depth;
        let (mut starts, mut items) = (Vec::new(), Vec::new());
        for node in 0..nodes as u32 {
            starts.push((table.words.len() + nodes + 1 + items.len()) as u32);
            if node > 0 {
                let (level, first) = (node.ilog2(), 1 << node.ilog2());
                items.extend(beside[level as usize].of(node - first).iter().map(|other| other + first));
            }
        }
        starts.push((table.words.len() + nodes + 1 + items.len()) as u32);
        table.beside = table.add(&starts);
        table.add(&items);
        let of_vertex = |vertex: usize| {
            let [x, y, z] = xyz(surface.rest[vertex]).to_array();
            let [reach, roam] = [surface.reach[vertex], surface.roam[vertex]];
            [surface.piece[vertex], reach.to_bits(), roam.to_bits(), x.to_bits(), y.to_bits(), z.to_bits()]
        };
        table.of_vertices = table.add((0..vertices).map(of_vertex).collect::<Vec<_>>().as_flattened());
        table
    }

    fn add(&mut self, words: &[u32]) -> u32 {
        let first = self.words.len() as u32;
        self.words.extend_from_slice(words);
        first
    }
}

/// What the CPU keeps of a cloth whose contact runs on a GPU.
#[derive(Debug)]
pub(crate) struct OnDevice {
    surface: Surface,
    vertices: usize,
    let_go: LetGo,
    may_cross: bool,
}

/// The lists in the GPU's layout: the rows of the vertices, followed by those of the edges.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct DeviceLists {
    pub starts: Vec<u32>,
    pub pairs: Vec<DevicePair>,
    /// The paths: start, with the distance (m) that the vertex may stray in w; displacement per substep, with its
    /// inverse in w; the number of substeps that they cover, and how many are over.
    pub from: Vec<Vec4>,
    pub by: Vec<Vec4>,
    pub ahead: f32,
    pub since: Option<f32>,
    /// The duration (s) of the substep that the multipliers belong to.
    pub h: f32,
}

/// A listed pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DevicePair {
    pub corners: [u32; 4],
    pub other: u32,
    pub thickness: f32,
    pub lambda: Vec4,
}

impl OnDevice {
    /// Returns `None` if the cloth has no triangles.
    pub(crate) fn new(cloth: &Cloth, contact: Contact) -> Option<(OnDevice, Table)> {
        let (surface, leaves) = Surface::new(cloth, contact.thickness)?;
        let tree = Tree::of_cloth(&surface, leaves);
        let table = Table::new(&surface, &tree, cloth.rest.len());
        let vertices = cloth.rest.len();
        Some((OnDevice { surface, vertices, let_go: LetGo::default(), may_cross: true }, table))
    }

    /// Discards the known intersections, because the state was replaced.
    pub(crate) fn forget(&mut self) {
        self.may_cross = true;
    }

    /// Whether a step must search for intersections first: after the state was replaced, while there are intersections,
    /// and while moving pins intersect.
    pub(crate) fn must_look(&self, plan: &Plan<'_>) -> bool {
        self.may_cross || !plan.pins.is_empty() && self.pins_cross(plan)
    }

    fn pins_cross(&self, plan: &Plan<'_>) -> bool {
        let mut x: Vec<Vec4> = plan.cloth.rest.iter().map(|x| x.with_w(1.0)).collect();
        plan.pins.iter().for_each(|pin| x[pin.vertex as usize] = glam::Vec3::from(pin.origin).extend(0.0));
        LetGo::led_cross(&self.surface, &x, true)
    }

    /// Searches for intersections at the positions `x` (m).
    pub(crate) fn look(&mut self, x: &[Vec4]) {
        self.let_go.find(&self.surface, x, true, 0.0);
        self.may_cross = !self.let_go.crossings.is_empty();
    }

    /// Ignored pairs of a vertex and a triangle, and of two edges.
    pub(crate) fn let_go(&self) -> &[Vec<[u32; 2]>; 2] {
        self.let_go.pairs()
    }

    /// Intersections found by the last search, given by vertices.
    pub(crate) fn crossings(&self) -> impl Iterator<Item = Crossing> {
        let Surface { edges, triangles, .. } = &self.surface;
        let named =
            |&[edge, triangle]: &[u32; 2]| Crossing { edge: edges[edge as usize], triangle: triangles[triangle as usize] };
        self.let_go.crossings.iter().map(named)
    }

    /// Converts the state to the form that both backends save.
    pub(crate) fn past(&self, lists: &DeviceLists) -> Past {
        let rows = |kind: Kind| {
            let rows = self.rows_of(kind, lists.starts.len());
            let starts = lists.starts.get(rows).unwrap_or_default();
            let first = starts.first().copied().unwrap_or_default();
            let pairs = &lists.pairs[first as usize..starts.last().copied().unwrap_or_default() as usize];
            ListedRows {
                starts: starts.iter().map(|start| start - first).collect(),
                others: pairs.iter().map(|pair| pair.other).collect(),
                thickness: pairs.iter().map(|pair| pair.thickness).collect(),
                lambda: pairs.iter().map(|pair| pair.lambda).collect(),
            }
        };
        let DeviceLists { from, by, ahead, since, h, .. } = lists;
        let stray = from.iter().map(|from| from.w).collect();
        Past {
            bodies: Vec::new(),
            lists: Kind::ALL.map(rows),
            paths: Paths { from: from.clone(), by: by.clone(), stray, ahead: *ahead, since: *since },
            crossings: self.let_go.crossings.clone(),
            may_cross: self.may_cross,
            h: *h,
        }
    }

    fn rows_of(&self, kind: Kind, starts: usize) -> std::ops::Range<usize> {
        match (kind, starts) {
            (_, 0) => 0..0,
            (Kind::VertexTriangle, _) => 0..self.vertices + 1,
            (Kind::EdgeEdge, _) => self.vertices..starts,
        }
    }

    /// Converts a saved state to the GPU's layout. Returns `None`, and changes nothing, if the state cannot belong to
    /// this cloth.
    pub(crate) fn resume(&mut self, past: &Past) -> Option<DeviceLists> {
        let Past { bodies, lists: [of_vertices, of_edges], paths, crossings, may_cross, h } = past;
        let Paths { from, by, stray, ahead, since } = paths;
        let surface = &self.surface;
        let crosses =
            |&[edge, triangle]: &[u32; 2]| (edge as usize) < surface.edges.len() && (triangle as usize) < surface.triangles.len();
        if !bodies.is_empty() || !paths.are_of(self.vertices) || !crossings.iter().all(crosses) {
            return None;
        }
        let first = of_vertices.others.len() as u32;
        let pairs = |kind, rows: &ListedRows, count, others| super::past::rows(surface, kind, rows, [count, others]);
        let one = pairs(Kind::VertexTriangle, of_vertices, self.vertices, surface.triangles.len())?;
        let other = pairs(Kind::EdgeEdge, of_edges, surface.edges.len(), surface.edges.len())?;
        let mut starts = one.starts;
        starts.pop();
        starts.extend(other.starts.iter().map(|start| first + start));
        let all = one.pairs.into_iter().zip(one.lambda).chain(other.pairs.into_iter().zip(other.lambda));
        let pair = |(pair, lambda): (super::pairs::Listed, Vec4)| DevicePair {
            corners: pair.corners,
            other: pair.other,
            thickness: pair.thickness,
            lambda,
        };
        let pairs: Vec<DevicePair> = all.map(pair).collect();
        self.let_go.take(crossings.clone(), &self.surface);
        self.may_cross = *may_cross;
        let from = from.iter().zip(stray).map(|(from, &stray)| from.with_w(stray)).collect();
        Some(DeviceLists { starts, pairs, from, by: by.clone(), ahead: *ahead, since: *since, h: *h })
    }
}
