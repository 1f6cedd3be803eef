//! Bending, a force: each vertex's row of the curvature energy, and what it does to its ring.

use bytemuck::{Pod, Zeroable};

use crate::simd::{Lanes, Vector};

/// A vertex's row of the bending energy: `stiffness/2 |sum_j c_vj (x_j - x_v)|²`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BendRow {
    /// `B_v D_v`; B limited where explicit integration needs it.
    pub stiffness: f32,
    /// Retardation time (s).
    pub tau: f32,
    /// `c_vv = -sum_j c_vj`.
    pub diagonal: f32,
}

/// A neighbor in a vertex's row of the bending energy.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BendEntry {
    pub other: u32,
    /// `c_vj`: the neighbor in this vertex's row.
    pub forward: f32,
    /// `c_jv`: this vertex in the neighbor's row.
    pub backward: f32,
}

/// A pass of the filter that takes bending in few substeps: see `step/bending.rs`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BendPass {
    /// Share of the last pass's change of the moments that carries over.
    pub carry: f32,
    /// What this pass adds of the moments of the rings as they have given way.
    pub gain: f32,
    /// What a vertex of unit inverse mass gives way by to a unit of force (s²). Below 0: the force of a moment is against it.
    pub way: f32,
    /// 1 if it is the last.
    pub last: u32,
}

/// What a vertex's ring does around it, gathered neighbor by neighbor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ring<L> {
    /// Mean curvature normal `y = sum_j c_vj d_j`, and its rate.
    pub y: Vector<L>,
    y_rate: Vector<L>,
    /// Sum of `d x rate`, and of `|d|² 1 - d d^T`: its diagonal, and its xy, xz, yz.
    spin: Vector<L>,
    inertia: Vector<L>,
    products: Vector<L>,
}

impl<L: Lanes> Ring<L> {
    #[inline(always)]
    pub(crate) fn empty() -> Ring<L> {
        let zero = Vector::zero();
        Ring { y: zero, y_rate: zero, spin: zero, inertia: zero, products: zero }
    }

    /// Adds the neighbor at `d` (m), which moves by `rate` (m/s) away, with coefficient `c_vj`; one of no coefficient is not in the
    /// ring.
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
/// The moment is `stiffness (y + tau dy/dt)`; neighbor `j` feels `-c_vj` times it. Taken as it is, the rate `dy/dt` would
/// also brake the rotation of cloth that is bent but rigid, by the torque `-tau B D y x dy/dt`. So the rate is measured
/// against the ring's own rotation, `omega = I^-1 sum d x dd/dt`, and what that adds to the dissipation's gradient is the
/// couple: neighbor `j` also feels `couple x d_j`. Together they exert no torque, and never give energy.
/// A ring in one line (a free edge) has no rotation about itself; there the part of the rate along `y` alone is damped.
///
/// `damping` is the stiffness times the retardation time `tau` (s). Without damping the pull is `stiffness y`, and there is no couple.
#[inline(always)]
pub(crate) fn bend_moment<L: Lanes>(ring: &Ring<L>, stiffness: L, damping: L) -> [Vector<L>; 2] {
    let Ring { y, y_rate, spin, inertia, products } = *ring;
    let (omega, in_line) = unspin(inertia, products, spin);
    let resisted = (y_rate - omega.cross(y)) * damping;
    let (couple, _) = unspin(inertia, products, y.cross(resisted));
    // Below 1e-15 a curvature has no direction left, and the damping fades out.
    let growth = y.dot(y_rate) / y.dot(y).max(L::splat(1e-30));
    let along = y * damping.mul_add(growth, stiffness);
    [Vector::select(in_line, along, y.mul_add(stiffness, resisted)), Vector::select(in_line, Vector::zero(), couple)]
}

/// What is added to a moment's change and taken off again (N): less than a ten-millionth of it is lost.
///
/// Passes carry a wave into flat cloth ahead of itself, ever fainter: down to numbers below 1e-38, over which processors, unlike GPUs, take a
/// hundred times as long.
const FAINT: f32 = 1e-24;

/// A moment after a pass, and its change in it; `bent` is the curvature of the ring as it has given way.
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

/// The couples that act between a vertex and a neighbor: of the rows whose ring has the other in it.
#[inline(always)]
pub(crate) fn couple_of<L: Lanes>(own: Vector<L>, other: Vector<L>, forward: L, backward: L) -> Vector<L> {
    let (none, zero) = (L::splat(0.0), Vector::zero());
    Vector::select(forward.eq(none), zero, own) + Vector::select(backward.eq(none), zero, other)
}

/// Solves `I omega = spin` for a symmetric inertia; the mask says where the ring is (nearly) in one line: nothing there.
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
