//! The surface and its trees as one table for the shaders.

use bytemuck::{Pod, Zeroable};
use glam::Vec4;

use crate::contact::detection::tree::Tree;
use crate::contact::surface::{LEAF, Leaves, Surface};
use crate::kernels::integrate::xyz;
use crate::model::csr::Csr;

// `broad_phase.wgsl` has 256 invocations for the features of pairs of leaves, and 64 bits for those of a kind that one is compared
// with. A leaf has at most twice its fewest triangles.
const _: () = assert!(2 * LEAF * 3 <= 64 && 2 * LEAF * (3 + 1 + 3) <= 256);

/// What a step of contact is given: `ContactParams` of `shaders/stages/self_contact/shared.wgsl`, which documents the fields.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct ContactParams {
    pub thickness: f32,
    pub friction: f32,
    pub vertices: u32,
    pub mesh_first: u32,
    pub all_vertices: u32,
    pub rows: u32,
    pub depth: u32,
    pub mesh_depth: u32,
    pub mesh_leaves: u32,
    pub triangles: u32,
    pub edges: u32,
    pub order: u32,
    pub leaf_triangles: u32,
    pub leaf_edges: u32,
    pub leaf_vertices: u32,
    pub excess: u32,
    pub around: u32,
    pub beside: u32,
    pub of_vertices: u32,
    pub room: u32,
    pub bodies: u32,
    pub has_kinematic: u32,
    pub meshes_rest: u32,
    pub has_self_contact: u32,
    pub ignored: u32,
    pub ignored_edges: u32,
    pub groups: u32,
    pub mesh_groups: u32,
    pub per_mass: f32,
    pub box_edges: u32,
    pub features: u32,
    pub spacing: u32,
    pub max_carry: f32,
    pub entangled: u32,
    pub triangles_at: u32,
    pub covers_stops: u32,
    pub turn_x: Vec4,
    pub turn_y: Vec4,
    pub turn_z: Vec4,
    pub center: Vec4,
    pub travel: Vec4,
}

impl ContactParams {
    /// Number of vertices of mesh colliders.
    pub(crate) fn mesh_vertices(&self) -> usize {
        (self.all_vertices - self.mesh_first) as usize
    }

    /// Number of nodes of both trees.
    pub(crate) fn nodes(&self) -> usize {
        (2 << self.depth) + 2 * self.mesh_leaves as usize
    }

    /// Number of boxes: those of all triangles, edges, and vertices of triangles.
    pub(crate) fn boxes(&self) -> usize {
        (self.box_edges + self.rows - self.all_vertices + self.leaf_triangles - self.order) as usize
    }
}

/// The surface and its trees as words.
#[derive(Debug, Default)]
pub(crate) struct Table(pub Vec<u32>);

impl Table {
    /// Returns the parameters with what they say of the table, which is the same in every step. `of_meshes` are the leaves of the
    /// tree over mesh colliders, if there are any.
    pub(crate) fn new(
        surface: &Surface,
        tree: &Tree,
        of_meshes: Option<&Leaves>,
        [mesh_first, vertices]: [usize; 2],
    ) -> (ContactParams, Table) {
        let Tree { leaves: of_cloth, excess, around, beside, .. } = tree;
        // The features of mesh colliders begin where those of the cloth end.
        let both = |of: fn(&Leaves) -> &Vec<u32>| {
            let of_meshes = of_meshes.into_iter().flat_map(|leaves| of(leaves).iter().skip(1));
            of(of_cloth).iter().chain(of_meshes).copied().collect::<Vec<u32>>()
        };
        let features = [of_cloth].into_iter().chain(of_meshes).flat_map(|leaves| {
            let spans = |starts: &Vec<u32>, leaf: usize| starts[leaf + 1] - starts[leaf];
            let of = move |leaf| spans(&leaves.triangles, leaf) + spans(&leaves.edges, leaf) + spans(&leaves.vertices, leaf);
            (0..1 << leaves.depth).map(of)
        });
        let of_vertex = |vertex: usize| {
            let [x, y, z] = xyz(surface.rest[vertex]).to_array().map(f32::to_bits);
            let [allowance, max_margin] = [surface.allowance[vertex], surface.max_margin[vertex]].map(f32::to_bits);
            [surface.piece[vertex], allowance, max_margin, x, y, z]
        };
        // Other nodes of the same level that share a vertex with a node.
        let beside = (0..2_u32 << of_cloth.depth).flat_map(|node| {
            let (level, first) = (node.max(1).ilog2(), 1 << node.max(1).ilog2());
            let others = if node > 0 { beside[level as usize].of(node - first) } else { &[] };
            others.iter().map(move |other| (node, other + first))
        });
        let mut table = Table::default();
        let params = ContactParams {
            mesh_first: mesh_first as u32,
            all_vertices: vertices as u32,
            rows: (vertices + surface.edges.len()) as u32,
            depth: of_cloth.depth,
            mesh_depth: of_meshes.map_or(0, |leaves| leaves.depth),
            mesh_leaves: of_meshes.map_or(0, |leaves| 1 << leaves.depth),
            box_edges: surface.triangles.len() as u32,
            features: features.max().unwrap_or_default(),
            triangles: table.add(surface.triangles.as_flattened()),
            edges: table.add(surface.edges.as_flattened()),
            order: table.add(&surface.order),
            leaf_triangles: table.add(&both(|leaves| &leaves.triangles)),
            leaf_edges: table.add(&both(|leaves| &leaves.edges)),
            leaf_vertices: table.add(&both(|leaves| &leaves.vertices)),
            excess: table.add(&excess.iter().map(|excess| excess.to_bits()).collect::<Vec<u32>>()),
            around: table.add_lists(around),
            beside: table.add_lists(&Csr::new(2 << of_cloth.depth, beside)),
            of_vertices: table.add((0..vertices).map(of_vertex).collect::<Vec<_>>().as_flattened()),
            triangles_at: table.add_lists(&surface.at),
            ..ContactParams::default()
        };
        (params, table)
    }

    /// Appends words. Returns their place.
    fn add(&mut self, words: &[u32]) -> u32 {
        let first = self.0.len() as u32;
        self.0.extend_from_slice(words);
        first
    }

    /// Appends where each list begins, and where the last one ends, followed by the lists. Returns their place.
    fn add_lists(&mut self, lists: &Csr<u32>) -> u32 {
        let first = (self.0.len() + lists.spans.len() + 1) as u32;
        let starts: Vec<u32> = lists.starts().iter().map(|start| first + start).collect();
        let place = self.add(&starts);
        self.add(&lists.items);
        place
    }
}
