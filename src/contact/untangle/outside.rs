//! Keeping cloth out of analytic colliders while it is untangled.

use glam::{Vec3A, Vec4};

use crate::kernels::contact::{Body, Path, contact_body};
use crate::kernels::integrate::xyz;
use crate::kernels::params::{Params, Substep};
use crate::simd::Vector;

/// An analytic collider at rest, and the vertices that are not to enter it.
pub(crate) struct Obstacle<'a> {
    body: &'a Body,
    vertices: Vec<u32>,
}

impl<'a> Obstacle<'a> {
    /// Not to be entered by the free ones of these vertices, unless they are inside by more than the thickness (m) already:
    /// to push these out might add crossings.
    pub(crate) fn new(body: &'a Body, x: &[Vec4], thickness: f32) -> Obstacle<'a> {
        let is_kept = |x: &Vec4| x.w > 0.0 && outside(body, xyz(*x)).distance(xyz(*x)) <= thickness;
        let vertices = (0..).zip(x).filter_map(|(vertex, x)| is_kept(x).then_some(vertex)).collect();
        Obstacle { body, vertices }
    }

    /// Moves what has entered it to its surface.
    pub(crate) fn keep_out(&self, x: &mut [Vec4]) {
        for &vertex in &self.vertices {
            let x = &mut x[vertex as usize];
            *x = outside(self.body, xyz(*x)).extend(x.w);
        }
    }
}

/// The point outside of a body that is nearest to another point.
fn outside(body: &Body, point: Vec3A) -> Vec3A {
    // In a substep of any length a vertex is pushed out at once, however deep it is.
    let params = Params { h: f32::INFINITY, ..Params::default() };
    let at = Vector::<f32>::splat(point.to_array());
    let out = contact_body(Path::new(at, Vector::zero()), body, &Substep::default(), &params).x;
    Vec3A::new(out.x, out.y, out.z)
}
