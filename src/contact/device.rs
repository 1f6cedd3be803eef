//! What a device needs to know of a cloth that meets itself, in one table; and what the processor keeps beside it: which pairs are let go.

use glam::Vec4;

use super::Past;
use super::crossings::LetGo;
use super::detection::Kind;
use super::past::ListedRows;
use super::paths::Paths;
use super::surface::Surface;
use super::tree::Tree;
use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::options::{Contact, Crossing};
use crate::step::plan::Plan;

/// Rows of vertices end with a whole number of so many.
const GROUP: usize = 64;
/// The leaf of a row that has no triangles.
const NONE: u32 = u32::MAX;

/// The surface and its tree in words, and where each list begins: `About` of `shaders/stages/self_contact/shared.wgsl`.
#[derive(Debug, Default)]
pub(crate) struct Table {
    pub words: Vec<u32>,
    pub depth: u32,
    /// Rows of the lists: the vertices, up to a whole number of workgroups, then the edges.
    pub first_edge: u32,
    pub rows: u32,
    pub triangles: u32,
    pub edges: u32,
    pub leaves: u32,
    pub of_leaves: u32,
    pub excess: u32,
    pub beside: u32,
    pub of_vertices: u32,
}

impl Table {
    fn new(surface: &Surface, tree: &Tree, vertices: usize) -> Table {
        let (leaves, first_edge) = (&tree.leaves, vertices.next_multiple_of(GROUP));
        let (excess, beside) = tree.culls();
        let mut table = Table { depth: leaves.depth, first_edge: first_edge as u32, ..Table::default() };
        table.rows = (first_edge + surface.edges.len()) as u32;
        table.triangles = table.add(surface.triangles.as_flattened());
        table.edges = table.add(surface.edges.as_flattened());
        table.leaves = table.add(&leaves.triangles);
        table.add(&leaves.edges);
        let mut leaf_of = vec![NONE; table.rows as usize];
        for leaf in 0..1_usize << leaves.depth {
            leaves.vertices_of(leaf).for_each(|place| leaf_of[surface.order[place] as usize] = leaf as u32);
            leaves.edges_of(leaf).for_each(|edge| leaf_of[first_edge + edge] = leaf as u32);
        }
        table.of_leaves = table.add(&leaf_of);
        table.excess = table.add(&excess.iter().map(|excess| excess.to_bits()).collect::<Vec<u32>>());
        // Of each node where those beside it begin, and then these.
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

/// What the processor keeps of a cloth whose contact is a device's.
#[derive(Debug)]
pub(crate) struct OnDevice {
    surface: Surface,
    vertices: usize,
    first_edge: usize,
    let_go: LetGo,
    may_cross: bool,
}

/// The lists as a device has them: rows of the vertices, padded, and of the edges behind them.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct DeviceLists {
    pub starts: Vec<u32>,
    pub pairs: Vec<DevicePair>,
    /// From where and by how much (m) each vertex goes, and how far it may stray; how many substeps were looked ahead, how many are over.
    pub from: Vec<Vec4>,
    pub by: Vec<Vec4>,
    pub ahead: f32,
    pub since: Option<f32>,
    /// The substep (s) that multipliers are of.
    pub h: f32,
}

/// A pair in a list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DevicePair {
    pub corners: [u32; 4],
    pub other: u32,
    pub thickness: f32,
    pub lambda: Vec4,
}

impl OnDevice {
    /// None if the cloth has no triangles.
    pub(crate) fn new(cloth: &Cloth, contact: Contact) -> Option<(OnDevice, Table)> {
        let (surface, leaves) = Surface::new(cloth, contact.thickness)?;
        let tree = Tree::of_cloth(&surface, leaves);
        let table = Table::new(&surface, &tree, cloth.rest.len());
        let (vertices, first_edge) = (cloth.rest.len(), table.first_edge as usize);
        Some((OnDevice { surface, vertices, first_edge, let_go: LetGo::default(), may_cross: true }, table))
    }

    /// Forgets the state, which was put elsewhere.
    pub(crate) fn forget(&mut self) {
        self.may_cross = true;
    }

    /// Whether a step must look for crossings first: where the state was set, where something crosses, or where pins that are led do.
    pub(crate) fn must_look(&self, plan: &Plan<'_>) -> bool {
        self.may_cross || !plan.pins.is_empty() && self.pins_cross(plan)
    }

    fn pins_cross(&self, plan: &Plan<'_>) -> bool {
        let mut x: Vec<Vec4> = plan.cloth.rest.iter().map(|x| x.with_w(1.0)).collect();
        plan.pins.iter().for_each(|pin| x[pin.vertex as usize] = glam::Vec3::from(pin.origin).extend(0.0));
        LetGo::led_cross(&self.surface, &x, true)
    }

    /// Looks what crosses where the vertices are at `x` (m).
    pub(crate) fn look(&mut self, x: &[Vec4]) {
        self.let_go.find(&self.surface, x, true, 0.0);
        self.may_cross = !self.let_go.crossings.is_empty();
    }

    /// Pairs of a vertex and a triangle, and of two edges, that are let go.
    pub(crate) fn let_go(&self) -> &[Vec<[u32; 2]>; 2] {
        self.let_go.pairs()
    }

    /// What crossed where it was looked last, by the cloth's vertices.
    pub(crate) fn crossings(&self) -> impl Iterator<Item = Crossing> {
        let Surface { edges, triangles, .. } = &self.surface;
        let named =
            |&[edge, triangle]: &[u32; 2]| Crossing { edge: edges[edge as usize], triangle: triangles[triangle as usize] };
        self.let_go.crossings.iter().map(named)
    }

    /// What is kept of the motion, in the processor's own form.
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
            (Kind::VertexTriangle, _) => 0..self.first_edge + 1,
            (Kind::EdgeEdge, _) => self.first_edge..starts,
        }
    }

    /// The lists to go on from; none, and nothing is changed, if that is the past of no such cloth.
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
        let one = pairs(Kind::VertexTriangle, of_vertices, self.first_edge, surface.triangles.len())?;
        let other = pairs(Kind::EdgeEdge, of_edges, surface.edges.len(), surface.edges.len())?;
        let mut starts = one.starts;
        starts.pop();
        starts.extend(other.starts.iter().map(|start| first + start));
        let all = one.pairs.into_iter().zip(one.lambda).chain(other.pairs.into_iter().zip(other.lambda));
        let pair = |(pair, lambda): (super::detection::Listed, Vec4)| DevicePair {
            corners: pair.corners,
            other: pair.other,
            thickness: pair.thickness,
            lambda,
        };
        let pairs = all.map(pair).collect();
        self.let_go.take(crossings.clone(), &self.surface);
        self.may_cross = *may_cross;
        let from = from.iter().zip(stray).map(|(from, &stray)| from.with_w(stray)).collect();
        Some(DeviceLists { starts, pairs, from, by: by.clone(), ahead: *ahead, since: *since, h: *h })
    }
}
