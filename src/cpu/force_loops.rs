//! The SIMD loops of the force stages: bending moments and forces of groups of vertices, air on groups of triangles.

use std::ops::Range;

use crate::cpu::bend_filter::FilterPass;
use crate::cpu::force_batches::{PanelBatches, RingBatches, RingLanes};
use crate::cpu::tasks::shared::View;
use crate::kernels::bending::{Ring, bend_moment, couple_of};
use crate::kernels::params::{Params, Substep};
use crate::kernels::wind::wind_force;
use crate::simd::{Loop, Registers, Vector};

/// [`bend_moment`] without damping: the moment alone.
pub(super) struct BendMoments<'t> {
    pub rings: &'t RingBatches,
    pub groups: Range<usize>,
    pub x: View<'t>,
    pub moments: View<'t>,
    /// The first pass of the filter, if the filter is used.
    pub filter: Option<FilterPass<'t>>,
}

impl Loop for BendMoments<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let BendMoments { rings, x, moments, filter, .. } = self;
        for group in self.groups {
            let center = x.vectors::<L>(group * L::LANES);
            let mut y = Vector::zero();
            for near in rings.neighbors(group) {
                y = (rings.gather(x, near) - center).mul_add(rings.forward(near), y);
            }
            let stiffness = rings.group(group).stiffness;
            match filter {
                None => moments.set_vectors(group * L::LANES, y * stiffness),
                Some(pass) => pass.begin(group * L::LANES, y, stiffness, None),
            }
        }
    }
}

/// [`bend_moment`] with damping, for groups of vertices.
pub(super) struct DampedMoments<'t> {
    pub rings: &'t RingBatches,
    pub groups: Range<usize>,
    pub x: View<'t>,
    pub u: View<'t>,
    pub moments: View<'t>,
    pub couples: View<'t>,
    /// The first pass of the filter, if the filter is used.
    pub filter: Option<FilterPass<'t>>,
    /// Converts displacements to velocities (1/s).
    pub rate: f32,
}

impl Loop for DampedMoments<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let DampedMoments { rings, x, u, moments, couples, filter, .. } = self;
        let (rate, zero) = (L::splat(self.rate), L::splat(0.0));
        for group in self.groups {
            let first = group * L::LANES;
            let RingLanes { stiffness, damping, .. } = rings.group::<L>(group);
            let (center, own) = (x.vectors::<L>(first), u.vectors::<L>(first));
            let mut ring = Ring::empty();
            for near in rings.neighbors(group) {
                let rate = (rings.gather(u, near) - own) * rate;
                ring.add_neighbor(rings.gather(x, near) - center, rate, rings.forward(near));
            }
            let unfiltered = if filter.is_some() { zero } else { stiffness };
            let [moment, couple] = bend_moment(&ring, unfiltered, damping);
            match filter {
                None => moments.set_vectors(first, moment),
                Some(pass) => pass.begin(first, ring.y, stiffness, Some(moment)),
            }
            couples.set_vectors(first, couple);
        }
    }
}

/// Adds the bending forces to the displacements that the ambient acceleration predicts.
pub(super) struct BendForces<'t> {
    pub rings: &'t RingBatches,
    pub groups: Range<usize>,
    pub x: View<'t>,
    pub u: View<'t>,
    pub moments: View<'t>,
    pub couples: Option<View<'t>>,
    pub substep: &'t Substep,
}

impl Loop for BendForces<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let BendForces { rings, x, u, moments, couples, substep, .. } = self;
        let zero = L::splat(0.0);
        let fall = Vector::splat(substep.fall);
        for group in self.groups {
            let first = group * L::LANES;
            let RingLanes { diagonal, inverse_mass, .. } = rings.group::<L>(group);
            let mut force = moments.vectors(first) * (zero - diagonal);
            if let Some(couples) = couples {
                let (center, own) = (x.vectors::<L>(first), couples.vectors::<L>(first));
                for near in rings.neighbors(group) {
                    let (forward, backward) = (rings.forward::<L>(near), rings.backward::<L>(near));
                    force = rings.gather(moments, near).mul_add(zero - backward, force);
                    let couple = couple_of(own, rings.gather(couples, near), forward, backward);
                    force = force - couple.cross(rings.gather(x, near) - center);
                }
            } else {
                for near in rings.neighbors(group) {
                    force = rings.gather(moments, near).mul_add(zero - rings.backward(near), force);
                }
            }
            // First the displacement under the ambient acceleration, then that under the bending force.
            let by = u.vectors(first).mul_add(L::splat(substep.carry), fall);
            let by = force.mul_add(inverse_mass * L::splat(substep.gain), by);
            u.set_vectors(first, Vector::select(zero.lt(inverse_mass), by, Vector::zero()));
        }
    }
}

/// A third of [`wind_force`] for groups of triangles.
pub(super) struct PanelForces<'t> {
    pub panels: &'t PanelBatches,
    pub groups: Range<usize>,
    pub x: View<'t>,
    pub u: View<'t>,
    pub forces: View<'t>,
    pub params: &'t Params,
    pub substep: &'t Substep,
}

impl Loop for PanelForces<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let PanelForces { panels, x, u, forces, params, substep, .. } = self;
        let third = L::splat(1.0 / 3.0);
        for group in self.groups {
            let corners: [Vector<L>; 3] = [panels.corner(x, group, 0), panels.corner(x, group, 1), panels.corner(x, group, 2)];
            let [a, b, c]: [Vector<L>; 3] = [panels.corner(u, group, 0), panels.corner(u, group, 1), panels.corner(u, group, 2)];
            let velocity = (a + b + c) * L::splat(substep.rate / 3.0);
            let force = wind_force(corners, velocity, panels.mass(group), substep, params);
            forces.set_vectors(group * L::LANES, force * third);
        }
    }
}
