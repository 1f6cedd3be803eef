//! An edge of the cloth, with its rest length and stiffness.

/// An edge of the cloth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Link {
    pub ends: [u32; 2],
    /// Rest length (m).
    pub rest: f32,
    /// Stiffness `K (A1 + A2) / l0²` (N/m); infinite if inextensible.
    pub stiffness: f64,
    /// The same for K = 1 N/m.
    pub shape: f64,
    /// Factor on the fabric's stiffness ([`Options::edge_scale`](crate::Options::edge_scale)).
    pub scale: f32,
    /// Whether the edge has at least half of the fabric's stiffness; or, if none has, of the stiffest edge's. The
    /// stretch of softer ones, as for soft shear, is a property of the fabric: they have no strain gauges, and tethers do not
    /// measure distances along them.
    pub is_firm: bool,
}
