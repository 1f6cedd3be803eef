//! Bending as a force: each vertex's row of the curvature energy, and the force of the row on its one-ring.

use bytemuck::{Pod, Zeroable};

use crate::simd::{Lanes, Vector};

/// A vertex's row of the bending energy, `stiffness/2 |sum_j c_vj (x_j - x_v)|²`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BendRow {
    /// `B_v D_v`, with the rigidity B lowered where explicit integration would be unstable.
    pub stiffness: f32,
    /// Retardation time of the damping (s).
    pub tau: f32,
    /// `c_vv = -sum_j c_vj`.
    pub diagonal: f32,
}

/// One neighbor in a vertex's row of the bending energy.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BendEntry {
    pub other: u32,
    /// `c_vj`, the neighbor's coefficient in this vertex's row.
    pub forward: f32,
    /// `c_jv`, this vertex's coefficient in the neighbor's row.
    pub backward: f32,
}

/// One pass of the Chebyshev filter that keeps stiff bending stable at few substeps: see `step/bending.rs`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BendPass {
    /// Share of the last pass's change of the moments that carries over (alpha).
    pub carry: f32,
    /// Weight of the moments of the tentatively displaced rings (beta).
    pub gain: f32,
    /// Tentative displacement of a vertex of unit inverse mass per unit of force (s²). Negative, because the force is
    /// the negative transposed row times the moment.
    pub trial: f32,
    /// 1 for the last pass.
    pub last: u32,
}

/// What a vertex's row needs to know of its one-ring, accumulated neighbor by neighbor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ring<L> {
    /// Mean curvature normal `y = sum_j c_vj d_j`.
    pub y: Vector<L>,
    /// Its rate of change.
    y_rate: Vector<L>,
    /// Sum of `d x rate`.
    spin: Vector<L>,
    /// Diagonal of the sum of `|d|² 1 - d d^T`, the ring's inertia.
    inertia: Vector<L>,
    /// Its elements xy, xz, yz.
    products: Vector<L>,
}

impl<L: Lanes> Ring<L> {
    #[inline(always)]
    pub(crate) fn empty() -> Ring<L> {
        let zero = Vector::zero();
        Ring { y: zero, y_rate: zero, spin: zero, inertia: zero, products: zero }
    }

    /// Adds a neighbor at offset `d` (m), which changes at `rate` (m/s), with coefficient `c_vj`. A coefficient of 0
    /// marks a neighbor that is not part of the ring.
    #[inline(always)]
    pub(crate) fn add_neighbor(&mut self, d: Vector<L>, rate: Vector<L>, coefficient: L) {
        let (zero, outside) = (Vector::zero(), coefficient.eq(L::splat(0.0)));
        let (d, rate) = (Vector::select(outside, zero, d), Vector::select(outside, zero, rate));
        self.y = d.mul_add(coefficient, self.y);
        self.y_rate = rate.mul_add(coefficient, self.y_rate);
        self.spin = self.spin + d.cross(rate);
        let square = Vector::new(d.x * d.x, d.y * d.y, d.z * d.z);
        self.inertia = self.inertia + Vector::new(square.y + square.z, square.x + square.z, square.x + square.y);
        let products = self.products;
        self.products =
            Vector::new(d.x.neg_mul_add(d.y, products.x), d.x.neg_mul_add(d.z, products.y), d.y.neg_mul_add(d.z, products.z));
    }
}

/// Moment and couple of a vertex's bending row.
///
/// The moment is `stiffness (y + tau dy/dt)`, and its force on neighbor `j` is `-c_vj` times it. Used as it is, the
/// rate `dy/dt` would also brake rigid rotation of bent cloth, by the torque `-tau B D y x dy/dt`. So the rate is taken
/// relative to the ring's own rotation, `omega = I^-1 sum d x dd/dt`. The gradient of the dissipation then has another
/// term, the couple: neighbor `j` also receives the force `couple x d_j`. Together they exert no torque and never add
/// energy. A ring in one line (at a free edge) has no defined rotation about itself; there only the component of the
/// rate along `y` is damped.
///
/// `damping` is the stiffness times the retardation time `tau` (s). Without damping the moment is `stiffness y` and
/// there is no couple.
#[inline(always)]
pub(crate) fn bend_moment<L: Lanes>(ring: &Ring<L>, stiffness: L, damping: L) -> [Vector<L>; 2] {
    let Ring { y, y_rate, spin, inertia, products } = *ring;
    let (omega, in_line) = unspin(inertia, products, spin);
    let resisted = (y_rate - omega.cross(y)) * damping;
    let (couple, _) = unspin(inertia, products, y.cross(resisted));
    // Below 1e-15 the direction of the curvature is lost in rounding, and the damping fades out.
    let growth = y.dot(y_rate) / y.dot(y).max(L::splat(1e-30));
    let along = y * damping.mul_add(growth, stiffness);
    [Vector::select(in_line, along, y.mul_add(stiffness, resisted)), Vector::select(in_line, Vector::zero(), couple)]
}

/// Added to a moment's change and subtracted again, which flushes changes far below it to zero (N); larger ones lose
/// less than 1e-7 of this.
///
/// The passes carry a bent region's moments ahead into flat cloth, smaller at each vertex, down to denormal numbers
/// below 1e-38. Processors, unlike GPUs, take about a hundred times as long to compute with those.
const FAINT: f32 = 1e-24;

/// The moment after a pass, and its change in the pass. `bent` is the curvature normal of the tentatively displaced
/// ring.
#[inline(always)]
pub(crate) fn next_moment<L: Lanes>(
    moment: Vector<L>,
    change: Vector<L>,
    bent: Vector<L>,
    stiffness: L,
    pass: &BendPass,
) -> [Vector<L>; 2] {
    let faint = Vector::splat([FAINT; 3]);
    let change = bent.mul_add(stiffness * L::splat(pass.gain), change.mul_add(L::splat(pass.carry), faint)) - faint;
    [moment + change, change]
}

/// The sum of the couples acting between a vertex and a neighbor: each row's couple acts only on the members of its
/// ring.
#[inline(always)]
pub(crate) fn couple_of<L: Lanes>(own: Vector<L>, other: Vector<L>, forward: L, backward: L) -> Vector<L> {
    let (none, zero) = (L::splat(0.0), Vector::zero());
    Vector::select(forward.eq(none), zero, own) + Vector::select(backward.eq(none), zero, other)
}

/// Solves `I omega = spin` for a symmetric inertia. The mask marks rings that are nearly in one line, for which the
/// result is 0.
#[inline(always)]
fn unspin<L: Lanes>(inertia: Vector<L>, products: Vector<L>, spin: Vector<L>) -> (Vector<L>, L::Mask) {
    let scale = L::splat(1.0) / (inertia.x + inertia.y + inertia.z).max(L::splat(1e-30));
    let (i, q) = (inertia * scale, products * scale);
    let diagonal = Vector::new(q.z.neg_mul_add(q.z, i.y * i.z), q.y.neg_mul_add(q.y, i.x * i.z), q.x.neg_mul_add(q.x, i.x * i.y));
    let corners = Vector::new(q.x.neg_mul_add(i.z, q.y * q.z), q.y.neg_mul_add(i.y, q.x * q.z), q.z.neg_mul_add(i.x, q.x * q.y));
    let determinant = q.y.mul_add(corners.y, q.x.mul_add(corners.x, i.x * diagonal.x));
    let omega = Vector::new(
        Vector::new(diagonal.x, corners.x, corners.y).dot(spin),
        Vector::new(corners.x, diagonal.y, corners.z).dot(spin),
        Vector::new(corners.y, corners.z, diagonal.z).dot(spin),
    );
    let in_line = determinant.lt(L::splat(1e-4));
    (Vector::select(in_line, Vector::zero(), omega * (scale / determinant)), in_line)
}
