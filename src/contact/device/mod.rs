//! The part of contact on a GPU that the CPU keeps: the motion of mesh colliders, the search for intersections, and the
//! ignored pairs.

pub(crate) mod table;

use std::sync::Arc;

use glam::{Vec3, Vec3A, Vec4};

use super::ContactPast;
use super::bodies::{Bodies, is_near, kinematic_pins, motions, motions_of};
use super::common_motion::CommonMotion;
use super::contacts::pinches::Pinched;
use super::crossings::known::{KnownCrossings, Posed};
use super::detection::paths::Paths;
use super::detection::rows::Rows;
use super::detection::tree::Tree;
use super::device::table::{ContactParams, Table};
use super::surface::Surface;
use crate::kernels::pair::Kind;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::Contact;
use crate::step::plan::Plan;

/// `MARK` of `shared.wgsl`.
pub(crate) const MARK: u32 = 1 << 31;

/// Values of `has_kinematic` of `shared.wgsl`: there is nothing kinematic, there is something, or there are only mesh colliders that
/// cannot meet the cloth in this step.
const NOTHING: u32 = 0;
const SOMETHING: u32 = 1;
const ELSEWHERE: u32 = 2;

/// What the CPU keeps of a cloth whose contact runs on a GPU.
pub(crate) struct HostContact {
    pub surface: Surface,
    pub bodies: Bodies,
    /// Number of all vertices.
    vertices: usize,
    pub crossings: KnownCrossings,
    /// The vertices of pairs that were pinched in the last step, around which there may be others.
    pinched: Vec<u32>,
    /// What a step that fails leaves as it was: where mesh colliders were at the end of the last step, and what was known to intersect.
    before: ContactPast,
    /// What was last uploaded of the motions of mesh colliders; it keeps its memory.
    motions: Vec<[Vec4; 2]>,
}

impl HostContact {
    /// Returns `None` if the cloth has no triangles with an area. Without `contact`, the cloth meets the mesh colliders only.
    pub(crate) fn new(
        cloth: &Cloth,
        contact: Option<Contact>,
        meshes: Vec<Arc<Mesh>>,
    ) -> Option<(HostContact, ContactParams, Table)> {
        let (mut surface, leaves) = Surface::new(cloth, contact)?;
        let tree = Tree::of_cloth(&surface, leaves);
        let own = cloth.rest.len();
        let (mut range, mut of_meshes) = ([own; 2], None);
        if !meshes.is_empty() {
            let first = surface.rest.len();
            range = [first, first + meshes.iter().map(|mesh| mesh.positions.len()).sum::<usize>()];
            of_meshes = Some(surface.add_bodies(&meshes));
        }
        let (params, table) = Table::new(&surface, &tree, of_meshes.as_ref(), range);
        let bodies = Bodies::new(range[0], meshes);
        let contact = HostContact {
            surface,
            bodies,
            vertices: range[1],
            crossings: KnownCrossings::default(),
            pinched: Vec::new(),
            before: ContactPast::default(),
            motions: Vec::new(),
        };
        Some((contact, params, table))
    }

    /// Begins a step; `friction` is that of the cloth with itself. Returns whether a mesh collider starts elsewhere than
    /// where the last step left it.
    pub(crate) fn begin(&mut self, plan: &Plan<'_>, friction: f32) -> bool {
        self.before.keep(&self.bodies, &self.crossings);
        let jumped = self.bodies.begin(plan, friction, self.surface.thickness);
        self.crossings.are_all &= !jumped;
        jumped
    }

    /// Goes back to where the last step began.
    pub(crate) fn roll_back(&mut self) {
        self.before.put_back(&mut self.bodies, &mut self.crossings, &self.surface);
    }

    /// The motions of the vertices of mesh colliders in this step, with their coefficients of friction; `None` if the
    /// device knows them already.
    pub(crate) fn motions(&mut self, plan: &Plan<'_>) -> Option<&[[Vec4; 2]]> {
        if std::mem::replace(&mut self.bodies.are_known, self.bodies.are_still) {
            return None;
        }
        self.motions.clear();
        for body in plan.meshes {
            let motions = motions_of(body, plan.cloth.origin);
            self.motions.extend(motions.map(|[from, by]| [from.extend(body.friction), by.extend(0.0)]));
        }
        Some(&self.motions)
    }

    /// What is kinematic: `has_kinematic` of `shared.wgsl`.
    pub(crate) fn kinematic(&self, plan: &Plan<'_>) -> u32 {
        if plan.cloth.has_pins() || self.bodies.may_meet {
            SOMETHING
        } else if plan.meshes.is_empty() {
            NOTHING
        } else {
            ELSEWHERE
        }
    }

    /// The rotation in the first substep of pins and of mesh colliders near the cloth, if they turn as one: see
    /// [`CommonMotion::columns`]. The center's displacement is that in the whole step.
    pub(crate) fn turn(&self, plan: &Plan<'_>) -> [Vec4; 5] {
        let fraction = plan.params.fraction;
        let near = |motion: &[Vec3; 2]| {
            self.bodies.may_meet && plan.whereabouts.is_none_or(|cloth| is_near(*motion, [cloth.low, cloth.high]))
        };
        let of_meshes = motions(plan).filter(near).map(|[from, by]| (Vec3A::from(from), Vec3A::from(by * fraction)));
        let turning =
            CommonMotion::of_kinematic(kinematic_pins(plan).chain(of_meshes), self.surface.thickness).unwrap_or_default();
        let [x, y, z, center, by] = turning.columns();
        [x, y, z, center, by / fraction]
    }

    /// Discards what depends on the state, because it was replaced.
    pub(crate) fn forget(&mut self) {
        self.crossings.are_all = false;
        self.bodies.forget();
        self.pinched.clear();
    }

    /// Whether a step must search for intersections first: after the state was replaced or a mesh collider has jumped, and
    /// while there are intersections.
    pub(crate) fn must_search(&self) -> bool {
        !self.crossings.are_all || !self.crossings.pairs.is_empty()
    }

    /// Whether pins or mesh colliders are moved through each other in this step, so that intersections must be searched for.
    pub(crate) fn kinematics_cross(&self, plan: &Plan<'_>) -> bool {
        if plan.pins.is_empty() && (self.bodies.are_still || !plan.cloth.has_pins()) {
            return false;
        }
        let mut x: Vec<Vec4> = plan.cloth.rest.iter().map(|x| x.with_w(1.0)).collect();
        plan.cloth.pinned.iter().zip(plan.pins_from).for_each(|(&pin, at)| x[pin as usize] = at.extend(0.0));
        let x = self.with_meshes(x, motions(plan).map(|[from, _]| from));
        KnownCrossings::kinematics_cross(self.posed(&x))
    }

    fn posed<'a>(&'a self, x: &'a [Vec4]) -> Posed<'a> {
        Posed { surface: &self.surface, x, is_shared: true }
    }

    /// Searches for intersections at the start of a step, with the cloth at the positions `x` (m). If the state is new to
    /// contact, moves apart what touches exactly. Returns the positions if that changed any.
    pub(crate) fn find_crossings(&mut self, plan: &Plan<'_>, x: Vec<Vec4>, is_new: bool) -> Option<Vec<Vec4>> {
        let mut x = self.with_meshes(x, motions(plan).map(|[from, _]| from));
        self.crossings.are_all = self.crossings.are_all && !self.kinematics_cross(plan);
        let moved = if !self.crossings.are_all && is_new { KnownCrossings::part_touches(self.posed(&x)) } else { Vec::new() };
        moved.iter().for_each(|&(vertex, at)| x[vertex as usize] = at);
        self.search(&x);
        x.truncate(plan.cloth.rest.len());
        (!moved.is_empty()).then_some(x)
    }

    /// Searches for intersections with all vertices at the positions `x` (m), where there may be any. Returns whether those that
    /// are known have changed.
    fn search(&mut self, x: &[Vec4]) -> bool {
        let pinched = std::mem::take(&mut self.pinched);
        self.crossings.search(Posed { surface: &self.surface, x, is_shared: true }, &pinched)
    }

    /// Notes the pairs that were pinched in a step, as `find_pinched` lists them (those that have moved through each other, and others),
    /// the vertices that drifted, and whether these `are_all`.
    pub(crate) fn note_pinched(&mut self, listed: [&[[u32; 4]]; 2], drifted: &[u32], are_all: bool) {
        let pinched = listed.into_iter().zip([true, false]).flat_map(|(listed, is_through)| {
            listed.iter().map(move |marked| {
                let kind = if marked[0] & MARK != 0 { Kind::EdgeEdge } else { Kind::VertexTriangle };
                Pinched { kind, corners: marked.map(|corner| corner & !MARK), is_through }
            })
        });
        let pinched: Vec<Pinched> = pinched.collect();
        self.crossings.begin();
        self.crossings.note(&pinched, &self.surface);
        self.crossings.drifted.extend(drifted);
        self.crossings.are_all &= are_all;
        self.pinched = pinched.iter().flat_map(|pair| pair.corners).collect();
    }

    /// Whether anything crosses with the cloth at the positions `x` (m) at the end of a step, given the vertices that drifted in it, or
    /// `None` if these are many. Nothing crossed before.
    pub(crate) fn have_arisen(&self, plan: &Plan<'_>, x: Vec<Vec4>, drifted: Option<&[u32]>) -> bool {
        let x = self.with_meshes(x, motions(plan).map(|[from, by]| from + by));
        x.iter().all(|x| x.is_finite()) && KnownCrossings::cross(self.posed(&x), drifted)
    }

    /// Whether cloth may have been pinched in the last step.
    pub(crate) fn is_pinched(&self) -> bool {
        !(self.crossings.are_all && self.pinched.is_empty() && self.crossings.drifted.is_empty())
    }

    /// Searches for what crosses at the end of a step because it is pinched, with the cloth at the positions `x` (m). Returns
    /// whether the intersections have changed.
    pub(crate) fn ignore_pinched(&mut self, plan: &Plan<'_>, x: Vec<Vec4>) -> bool {
        let x = self.with_meshes(x, motions(plan).map(|[from, by]| from + by));
        self.search(&x)
    }

    /// The positions of all vertices, given those of the cloth and of mesh colliders.
    fn with_meshes(&self, mut x: Vec<Vec4>, of_meshes: impl Iterator<Item = Vec3>) -> Vec<Vec4> {
        x.resize(self.bodies.first, Vec4::ZERO);
        x.extend(of_meshes.map(|x| x.extend(0.0)));
        x
    }

    /// The state in the form that both backends save.
    pub(crate) fn past(&self, lists: [Rows; 2], paths: Paths, h: f32) -> ContactPast {
        let mut past = ContactPast { lists, paths, h, ..ContactPast::default() };
        past.keep(&self.bodies, &self.crossings);
        past
    }

    /// Continues from a saved state. Returns its lists with all pairs in rows; `None`, and changes nothing, if the state cannot
    /// belong to this cloth.
    pub(crate) fn resume(&mut self, past: &ContactPast) -> Option<[Rows; 2]> {
        let HostContact { surface, bodies, crossings, vertices, .. } = self;
        let lists = past.lists_on(surface, *vertices).filter(|_| past.put_back(bodies, crossings, surface));
        lists.map(|lists| lists.map(Rows::in_rows))
    }
}
