//! What a step reports: what it did, how the cloth was stretched, and what the caller should know of.

/// What a step did. A step on a GPU does not wait for it, except with contact of triangles.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct StepReport {
    /// Number of substeps taken, without those of attempts that were undone ([`Quality::Hold`](crate::Quality::Hold)).
    pub substeps: u32,
    /// Number of substeps that a step of 1/60 s would have taken, in the unit of [`Quality::Substeps`](crate::Quality::Substeps); 0 if
    /// the cloth slept or the step had no duration.
    pub in_a_sixtieth: u32,
    /// Coarse levels used in each substep.
    pub levels: u32,
    /// How the cloth was stretched, measured if the quality bounds the strain, the cloth may sleep, there are mesh colliders, or
    /// the cloth has contact and no pins and there are any colliders; otherwise `None`.
    /// On the GPU the measurement is three steps old, and `None` in the first steps, unless there is contact of triangles.
    pub stretch: Option<Stretch>,
    /// The cloth slept through the step and did not change: see [`Options::sleep`](crate::Options::sleep).
    pub asleep: bool,
    /// Pairs of features of the cloth (vertex and triangle, or two edges) that press on each other at the end of the
    /// step.
    pub contacts: u32,
    /// Conditions that the caller should know of.
    pub warnings: Vec<Warning>,
}

/// Statistics of the stretch `max(0, l/l0 - 1)` of the edges, each edge weighted by the area of its triangles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct Stretch {
    /// Mean stretch over the area.
    pub mean: f32,
    /// Stretch that the promised share of the area does not exceed (99 percent if none is promised), to within an
    /// eighth of its value.
    pub share: f32,
    /// Stretch of the worst edge.
    pub worst: f32,
}

/// What caused [`Warning::StrainMissed`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// The weight and motion of the cloth itself; also where pins are farther apart than it reaches, or inside a collider.
    Motion,
    /// Pins that accelerated.
    Pins,
    /// A fast collider near the cloth.
    Collider,
    /// The wind.
    Wind,
    /// Too much of the area belongs to slivers: edges that are a hundred times shorter than their triangles.
    Slivers,
    /// Cloth that crosses itself or a mesh collider and hooks on it ([`Warning::Crossings`], [`Warning::BodyCrossings`]). The number
    /// of substeps is not raised for it.
    Crossings,
    /// Pins or mesh colliders leave the cloth between them less room than its thickness, hold it, and pull at it. The number of
    /// substeps is not raised for it, because ten times as many only halve the stretch.
    Squeezed,
}

/// An edge that passes through a triangle with which it shares no vertex. Indices are those of the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Crossing {
    /// The two ends of the edge.
    pub edge: [u32; 2],
    /// The three corners of the triangle.
    pub triangle: [u32; 3],
}

impl Crossing {
    /// The same crossing with every vertex index replaced by `names[index]`.
    pub(crate) fn named(self, names: &[u32]) -> Crossing {
        let name = |vertex: u32| names[vertex as usize];
        Crossing { edge: self.edge.map(name), triangle: self.triangle.map(name) }
    }
}

/// A condition found in a step that the caller should know of. As text it is a sentence without a full stop.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The bending stiffness had to be reduced to stay stable with these substeps, by more than 5 percent on average over
    /// the cloth. [`Method::SmallSteps`](crate::Method::SmallSteps) filters bending in up to sixteen passes per substep
    /// and warns only if those are not enough. The stiffness stays as low as the fewest substeps so far demand, so that bent
    /// cloth gains no energy when their number rises. From the start, or after [`Deformer::reset`](crate::Deformer::reset),
    /// [`Quality::Substeps`](crate::Quality::Substeps) with more of them keeps more of it.
    BendingLimited {
        /// Number of vertices with reduced stiffness.
        vertices: usize,
    },
    /// Explicit springs take fewer substeps than their stability limit: cloth that moves may become unstable.
    ExplicitLimit {
        /// Number of substeps taken.
        substeps: u32,
        /// Number of substeps that is stable however the cloth moves.
        needed: u32,
    },
    /// A larger share of the area than promised was stretched by more than promised. Not reported is what the cloth is known to be
    /// stretched by whatever the substeps, as where a garment is narrower than what it is on: up to 10 % beyond what gravity and wind
    /// explain, and as long as its motion adds little to these.
    StrainMissed {
        /// Stretch that the promised share of the area did not exceed, beyond the fabric's own stretch.
        stretch: f32,
        /// The largest stretch that was promised.
        promised: f32,
        /// What loaded the cloth most in that step.
        cause: Cause,
    },
    /// Some edges have no length, or are a hundred times shorter than their triangles, which makes them so stiff that with few
    /// substeps they stretch to many times their length. The strain that [`Quality::Strain`](crate::Quality::Strain) promises leaves
    /// them out. Merge their ends, or remesh with rounder triangles.
    Slivers {
        /// Number of such edges.
        edges: usize,
        /// The worst of them, as indices of the mesh.
        worst: [u32; 2],
    },
    /// A pin moves farther in a sweep than an edge is long, which is as far as a sweep carries its motion. While it
    /// does so, the edges at it stretch to more than twice their length. Move it more slowly or take more substeps; for
    /// a jump use [`Deformer::warp`](crate::Deformer::warp) or [`Deformer::set_state`](crate::Deformer::set_state).
    PinOutruns {
        /// Its position in the list [`Options::pinned`](crate::Options::pinned).
        pin: usize,
        /// Its speed (m/s), relative to the mean of the pins in the last step if the cloth goes along with that, as it is taken to do where
        /// strain is not measured.
        speed: f32,
        /// The highest speed (m/s) that the substeps can carry: one edge length per sweep, of which
        /// [`Method::Relaxation`](crate::Method::Relaxation) makes several in a substep.
        carried: f32,
    },
    /// A collider near the cloth moves farther in a sweep than an edge is long. It does not tunnel, but cloth that it hits is
    /// stretched. Or, if it is no mesh, it moves farther than the thickness of [`Options::contact`](crate::Options::contact):
    /// what it hits can then not follow without coming too close to itself, and lets it sink in, by several times the thickness
    /// and more. Where the cloth is is known where strain is measured, as for [`Quality::Strain`](crate::Quality::Strain);
    /// otherwise far colliders are reported, too. Move it more slowly, take more substeps, or mark it as
    /// [`teleported`](crate::Collider::teleported).
    ColliderOutruns {
        /// Its position in the list [`Attributes::colliders`](crate::Attributes::colliders).
        collider: usize,
        /// Its speed (m/s), relative to the mean of the pins where that is slower, and to the course of cloth without any.
        speed: f32,
        /// The highest speed (m/s) that the substeps can carry: one edge length per sweep, or one thickness per substep.
        carried: f32,
    },
    /// Pins and mesh colliders near the cloth move relative to each other by more than two thirds of the contact
    /// thickness per substep, so that they may pass through cloth that is caught between them. Cloth that only one of them hits is carried along
    /// and does not let it through. Take more substeps ([`Quality::Strain`](crate::Quality::Strain) takes up to 256 per
    /// 1/60 s for this), increase [`Contact::thickness`](crate::Contact::thickness), or move them more slowly.
    ContactOutruns {
        /// The largest speed (m/s) of any of them relative to the midpoint of the range of their velocities. A velocity
        /// that all have in common does not count.
        speed: f32,
        /// The largest such speed (m/s) that the substeps resolve.
        resolved: f32,
    },
    /// The cloth and a mesh collider cross each other: they did when one of them was put in place, or the cloth was
    /// pinched, because mesh colliders and pins left it no room. Contact ignores the crossing parts until they have
    /// separated, and holds them from then on. Cloth that hooks on a collider does not separate by itself: once there is
    /// room again, call [`Deformer::untangle`](crate::Deformer::untangle).
    BodyCrossings {
        /// Number of crossing pairs of an edge and a triangle, over all mesh colliders.
        pairs: usize,
        /// The first such collider, as its position in [`Attributes::colliders`](crate::Attributes::colliders).
        collider: usize,
    },
    /// Edges pass through triangles of the cloth ([`Options::contact`](crate::Options::contact)): they did when the state
    /// was set, or the cloth was pinched, because pins and mesh colliders left it no room. Contact ignores the crossing
    /// parts until they have separated, and holds them from then on. [`Deformer::untangle`](crate::Deformer::untangle)
    /// separates what does not do so by itself.
    Crossings {
        /// Number of crossing pairs of an edge and a triangle.
        pairs: usize,
        /// The first of them.
        first: Crossing,
    },
}
