//! The surface and its trees as one table for the shaders.

use super::surface::{LEAF, Leaves, Surface};
use super::tree::Tree;
use crate::kernels::integrate::xyz;

// `candidates.wgsl` has 256 invocations for the features of pairs of leaves, and 64 bits for those of a kind that one is compared
// with. A leaf has at most twice its fewest triangles.
const _: () = assert!(2 * LEAF * 3 <= 64 && 2 * LEAF * (3 + 1 + 3) <= 256);

/// The surface and its trees as words, and the positions of the lists in them, as in `ContactParams` of
/// `shaders/stages/self_contact/shared.wgsl`.
#[derive(Debug, Default)]
pub(crate) struct Table {
    pub words: Vec<u32>,
    /// Number of all vertices: the cloth's and, from `mesh_first` on, those of mesh colliders.
    pub vertices: u32,
    pub mesh_first: u32,
    pub depth: u32,
    pub mesh_depth: u32,
    pub mesh_leaves: u32,
    /// The rows are those of the vertices, followed by those of the edges.
    pub rows: u32,
    pub triangles: u32,
    pub edges: u32,
    pub order: u32,
    pub leaf_triangles: u32,
    pub leaf_edges: u32,
    pub leaf_vertices: u32,
    /// Number of triangles, whose boxes precede those of the edges.
    pub box_edges: u32,
    /// The most features of a leaf.
    pub features: u32,
    pub excess: u32,
    pub around: u32,
    pub beside: u32,
    pub of_vertices: u32,
    /// Where each vertex's list of triangles begins, then these lists.
    pub triangles_at: u32,
}

impl Table {
    /// `of_meshes` are the leaves of the tree over mesh colliders, if there are any.
    pub(super) fn new(surface: &Surface, tree: &Tree, of_meshes: Option<&Leaves>, [mesh_first, vertices]: [usize; 2]) -> Table {
        let of_cloth = &tree.leaves;
        let (excess, around, beside) = tree.culls();
        let mut table = Table { depth: of_cloth.depth, ..Table::default() };
        (table.mesh_first, table.vertices) = (mesh_first as u32, vertices as u32);
        if let Some(of_meshes) = of_meshes {
            (table.mesh_depth, table.mesh_leaves) = (of_meshes.depth, 1 << of_meshes.depth);
        }
        table.rows = (vertices + surface.edges.len()) as u32;
        table.box_edges = surface.triangles.len() as u32;
        table.triangles = table.add(surface.triangles.as_flattened());
        table.edges = table.add(surface.edges.as_flattened());
        table.order = table.add(&surface.order);
        // The features of mesh colliders begin where those of the cloth end.
        let both = |of: fn(&Leaves) -> &Vec<u32>| {
            let of_meshes = of_meshes.into_iter().flat_map(|leaves| of(leaves).iter().skip(1));
            of(of_cloth).iter().chain(of_meshes).copied().collect::<Vec<u32>>()
        };
        table.leaf_triangles = table.add(&both(|leaves| &leaves.triangles));
        table.leaf_edges = table.add(&both(|leaves| &leaves.edges));
        table.leaf_vertices = table.add(&both(|leaves| &leaves.vertices));
        let lists = [of_cloth].into_iter().chain(of_meshes).flat_map(|leaves| {
            let spans = |starts: &Vec<u32>, leaf: usize| starts[leaf + 1] - starts[leaf];
            let of = move |leaf| spans(&leaves.triangles, leaf) + spans(&leaves.edges, leaf) + spans(&leaves.vertices, leaf);
            (0..1 << leaves.depth).map(of)
        });
        table.features = lists.max().unwrap_or_default();
        table.excess = table.add(&excess.iter().map(|excess| excess.to_bits()).collect::<Vec<u32>>());
        // The position of each leaf's list of triangles, then these lists.
        let first = (table.words.len() + around.spans.len() + 1) as u32;
        let starts: Vec<u32> = std::iter::once(first).chain(around.spans.iter().map(|span| first + span.end)).collect();
        table.around = table.add(&starts);
        table.add(&around.items);
        // For each node, the position of the list of nodes that share a vertex with it, then these lists.
        let nodes = 2_usize << of_cloth.depth;
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
            let [x, y, z] = xyz(surface.rest[vertex]).to_array().map(f32::to_bits);
            let [half_gap, max_margin] = [surface.half_gap[vertex], surface.max_margin[vertex]].map(f32::to_bits);
            [surface.piece[vertex], half_gap, max_margin, x, y, z]
        };
        table.of_vertices = table.add((0..vertices).map(of_vertex).collect::<Vec<_>>().as_flattened());
        let first = (table.words.len() + surface.at.spans.len() + 1) as u32;
        let starts: Vec<u32> = std::iter::once(first).chain(surface.at.spans.iter().map(|span| first + span.end)).collect();
        table.triangles_at = table.add(&starts);
        table.add(&surface.at.items);
        table
    }

    fn add(&mut self, words: &[u32]) -> u32 {
        let first = self.words.len() as u32;
        self.words.extend_from_slice(words);
        first
    }

    /// Number of vertices of mesh colliders.
    pub(crate) fn mesh_vertices(&self) -> usize {
        (self.vertices - self.mesh_first) as usize
    }

    /// Number of nodes of both trees.
    pub(crate) fn nodes(&self) -> usize {
        (2 << self.depth) + 2 * self.mesh_leaves as usize
    }

    /// Number of boxes: those of all triangles, edges, and vertices of triangles.
    pub(crate) fn boxes(&self) -> usize {
        (self.box_edges + self.rows - self.vertices + self.leaf_triangles - self.order) as usize
    }
}
