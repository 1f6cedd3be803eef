//! Collisions of vertices, compared with the bodies' distance functions.

use glam::{DQuat, DVec3, Quat, Vec3, Vec3A, Vec4};

use super::near::Clear;
use super::*;
use crate::kernels::integrate::xyz;
use crate::oracle::{ball_chain_distance, box_distance};

/// Random frictionless bodies with their distance functions: rotating, growing boxes, and the hulls of two growing
/// balls.
fn bodies(random: &mut fastrand::Rng) -> (Body, impl Fn(DVec3, f64) -> f64 + use<>) {
    let mut vector = |size: f32| Vec3::new(random.f32() - 0.5, random.f32() - 0.5, random.f32() - 0.5) * 2.0 * size;
    let (a, b, half) = (vector(1.0), vector(1.0), vector(0.3).abs() + 0.1);
    let travels = [vector(0.01), vector(0.01), vector(0.01)];
    let axis = vector(1.0).normalize();
    let (is_box, radius, taper) = (random.bool(), 0.02 + 0.2 * random.f32(), 0.3 * random.f32());
    let first = Quat::from_axis_angle(axis, random.f32() * 6.0);
    let to = Quat::from_axis_angle(axis.any_orthonormal_vector(), 0.03) * first;
    let ends = |from: Vec3, travel: Vec3| [from.as_dvec3(), travel.as_dvec3()];
    let body = Body {
        a: a.to_array(),
        radius,
        b: if is_box { half } else { b }.to_array(),
        friction: 0.0,
        a_travel: travels[0].to_array(),
        radius_travel: 0.004,
        b_travel: travels[1].to_array(),
        kind: if is_box { BOX } else { ROUND },
        c: if is_box { first.to_array() } else { [taper, 0.0, 0.0, 0.0] },
        c_travel: if is_box { (to - first).to_array() } else { [0.002, 0.0, 0.0, 0.0] },
        ..Body::default()
    };
    let distance = move |x: DVec3, time: f64| {
        let at = |[from, travel]: [DVec3; 2]| from + travel * time;
        let (center, radius) = (at(ends(a, travels[0])), f64::from(radius) + 0.004 * time);
        if is_box {
            let rotation: DQuat = (first.as_dquat() + (to - first).as_dquat() * time).normalize();
            box_distance(rotation.inverse() * (x - center), at(ends(half, travels[1])), radius)
        } else {
            let taper = f64::from(taper) + 0.002 * time;
            ball_chain_distance(x, [center, at(ends(b, travels[1]))], [radius, radius + taper])
        }
    };
    (body, distance)
}

fn lane(v: Vec3A) -> Vector<f32> {
    Vector::new(v.x, v.y, v.z)
}

/// [`contact_body`] for one vertex.
fn contact_one(x: Vec3A, u: Vec3A, body: &Body, substep: &Substep, params: &Params) -> (Vec3A, Vec3A) {
    let Path { x, u, .. } = contact_body(Path::new(lane(x), lane(u)), body, substep, params);
    (Vec3A::new(x.x, x.y, x.z), Vec3A::new(u.x, u.y, u.z))
}

/// A vertex that would end inside a body ends at the nearest point of its surface; one that would not is not changed.
#[test]
fn what_would_end_inside_ends_on_the_surface() {
    let mut random = fastrand::Rng::with_seed(5);
    let substep = Substep { start: 0.4, ..Substep::default() };
    let params = Params { h: 1.0 / 1200.0, fraction: 0.1, ..Params::default() };
    let mut met = 0;
    for _ in 0..400 {
        let (body, distance) = bodies(&mut random);
        for _ in 0..200 {
            let mut vector = |size: f32| Vec3A::new(random.f32() - 0.5, random.f32() - 0.5, random.f32() - 0.5) * 2.0 * size;
            let (x, u) = (Vec3A::from(body.a) + vector(0.6), vector(0.004));
            let to_f64 = |v: Vec3A| v.as_dvec3();
            let [before, after] = [(x, 0.4), (x + u, 0.5)].map(|(x, time)| distance(to_f64(x), time));
            if before.abs() < 1e-5 || after.abs() < 1e-5 || before < 0.0 {
                continue;
            }
            let (at, by) = contact_one(x, u, &body, &substep, &params);
            if after > 0.0 {
                assert_eq!((at, by), (x, u), "{body:?}: it is {after} m outside");
                continue;
            }
            met += 1;
            let left = distance(to_f64(at + by), 0.5);
            let moved = to_f64(at + by - x - u).length();
            assert!(left.abs() < 3e-6, "{body:?} from {x}, {before} m, by {u}, {after} m: ends at {left} m");
            assert!((moved + after).abs() < 3e-6, "{body:?}: moved {moved} m out of {after} m");
        }
    }
    assert!(met > 60, "{met} of them met a body");
}

/// With unlimited friction a vertex on a box moves as the box does at that point.
#[test]
fn a_vertex_that_sticks_goes_with_the_box() {
    let (first, center) = (Quat::from_rotation_x(0.4), Vec3::new(0.3, -0.2, 0.1));
    let (to, by) = (Quat::from_rotation_z(0.2) * first, Vec3::new(0.01, 0.0, -0.02));
    let body = Body {
        a: center.to_array(),
        b: [0.5, 0.1, 0.4],
        friction: 1e3,
        a_travel: by.to_array(),
        kind: BOX,
        c: first.to_array(),
        c_travel: (to - first).to_array(),
        ..Body::default()
    };
    let substep = Substep::default();
    let params = Params { h: 1.0 / 60.0, fraction: 1.0, ..Params::default() };
    for place in [Vec3::new(0.4, 0.1, 0.3), Vec3::new(-0.5, 0.02, 0.1), Vec3::new(0.2, -0.1, 0.0)] {
        let x = Vec3A::from(center + first * place);
        let goal = Vec3A::from(center + by + to * place);
        // The displacement would take it slightly into the box.
        let inward = Vec3A::from(to * (-0.001 * place.normalize()));
        let (at, moved) = contact_one(x, goal - x + inward, &body, &substep, &params);
        let off = (at + moved - goal).length();
        assert!(off < 2e-6, "{place}: {off} m from where the box goes");
    }
}

/// A vertex on a plane that turns about a point some meters away stays on it; with unlimited friction it moves as the plane does there.
#[test]
fn a_vertex_that_sticks_goes_with_the_plane() {
    let (point, by) = (Vec3::new(0.3, -0.2, 0.1), Vec3::new(0.01, 0.002, -0.02));
    let (n_0, angle) = (Vec3::new(0.2, 1.0, -0.3).normalize(), 0.02);
    let turn = Quat::from_axis_angle(n_0.any_orthonormal_vector(), angle);
    let (substep, params) =
        (Substep { start: 0.5, ..Substep::default() }, Params { h: 1e-3, fraction: 0.25, ..Params::default() });
    for friction in [0.0, 1e3] {
        let b_travel = (turn * n_0 - n_0).to_array();
        let body =
            Body { a: point.to_array(), b: n_0.to_array(), a_travel: by.to_array(), b_travel, friction, ..Body::default() };
        let posed = |place: Vec3, time: f32| point + by * time + Quat::IDENTITY.slerp(turn, time) * place;
        for place in [Vec3::new(3.0, 0.0, 1.0), Vec3::new(-2.0, 0.0, 0.5), Vec3::new(0.1, 0.0, -4.0)] {
            let place = place - n_0 * n_0.dot(place);
            let (x, goal) = (posed(place, 0.5), posed(place, 0.75));
            let n = Quat::IDENTITY.slerp(turn, 0.75) * n_0;
            // The displacement would take it into the solid.
            let (at, moved) = contact_one(x.into(), (goal - x - 0.002 * n).into(), &body, &substep, &params);
            let off = Vec3::from(at + moved) - goal;
            assert!(off.dot(n).abs() < 3e-6, "{place}: {} m above the plane", off.dot(n));
            // What moves along an arc gets aside of the straight way by the square of the angle.
            let aside = 0.5 * (0.25 * angle).powi(2) * place.length();
            assert!(friction == 0.0 || off.length() < aside + 3e-6, "{place}: {} m from where the plane goes", off.length());
        }
    }
}

/// Vertices of which [`Clear`] says that they do not touch a body are not changed by it, slow and fast, near and far, and some of
/// them are near.
#[test]
fn what_is_told_to_be_clear_is_clear() {
    let mut random = fastrand::Rng::with_seed(8);
    let substep = Substep { start: 0.3, ..Substep::default() };
    let params = Params { h: 1.0 / 600.0, fraction: 0.5, ..Params::default() };
    let (mut clear, mut near) = (0, 0);
    for _ in 0..400 {
        let (mut body, distance) = bodies(&mut random);
        let is_plane = random.u8(0..4) == 0;
        if is_plane {
            (body.kind, body.b, body.b_travel) = (PLANE, Vec3::from(body.b).normalize().to_array(), [0.0; 3]);
        }
        for size in [1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.5, 5.0] {
            let mut vector = |size: f32| Vec3A::new(random.f32() - 0.5, random.f32() - 0.5, random.f32() - 0.5) * 2.0 * size;
            let (x, u) = (Vec3A::from(body.a) + vector(1.2), vector(size));
            if !Clear::of(&body, &substep, params.fraction).of_vertices(lane(x), lane(u)) {
                continue;
            }
            clear += 1;
            near += usize::from(!is_plane && distance(x.as_dvec3(), 0.3) < 0.5);
            assert_eq!(contact_one(x, u, &body, &substep, &params), (x, u), "{body:?}");
        }
    }
    assert!(clear > 500 && near > 50, "{clear} of 2800 are clear, {near} of them near");
}

/// Vertices that move together are tested against the bodies near them only, and end where all bodies, one after the other, let
/// them, in every substep, also among more bodies than are kept in mind.
#[test]
fn far_bodies_are_left_out_and_near_ones_are_not() {
    let mut random = fastrand::Rng::with_seed(11);
    let (mut met, mut left_out, mut overflows) = (0, 0, 0);
    for round in 0..300 {
        let mut all: Vec<Body> = (0..random.usize(0..40)).map(|_| bodies(&mut random).0).collect();
        for body in all.iter_mut().filter(|body| Vec3::from(body.a).x > 0.9) {
            (body.kind, body.b, body.b_travel) = (PLANE, Vec3::from(body.b).normalize().to_array(), [0.0; 3]);
        }
        let in_step: Vec<Clear> = all.iter().map(Clear::in_step).collect();
        let start = random.f32() * 0.9;
        let substep = Substep { start, ..Substep::default() };
        let params = Params { h: 1.0 / 600.0, fraction: 0.1, ..Params::default() };
        let mut vector = |size: f32| Vec3A::new(random.f32() - 0.5, random.f32() - 0.5, random.f32() - 0.5) * 2.0 * size;
        let (center, course) = (vector(1.5), vector(0.02));
        let extent = if round % 10 == 0 { 2.0 } else { 0.1 };
        let state: Vec<[Vec4; 2]> =
            (0..20).map(|_| [(center + vector(extent)).extend(1.0), (course + vector(0.005)).extend(0.0)]).collect();
        let near = NearBodies::of(&all, &in_step, &substep, &params, state.iter().copied());
        let kept = near.visit(&substep, &params).count();
        left_out += all.len() - kept;
        overflows += usize::from(kept > 16);
        for [x, u] in state.iter().map(|state| state.map(xyz)) {
            let one_by_one = all.iter().fold((x, u), |(x, u), body| contact_one(x, u, body, &substep, &params));
            let (at, by) = contact_bodies(lane(x), lane(u), true, &near, &substep, &params).unwrap_or((lane(x), lane(u)));
            assert_eq!(([at.x, at.y, at.z], [by.x, by.y, by.z]), (one_by_one.0.to_array(), one_by_one.1.to_array()));
            met += usize::from(one_by_one != (x, u));
        }
    }
    assert!(met > 500 && left_out > 1000 && overflows > 5, "{met} vertices met bodies, {left_out} were left out, {overflows}");
}

/// A body throws a vertex at another one that was out of its reach. That stops it, whichever vertices are tested together.
#[test]
fn what_is_thrown_at_a_far_body_is_stopped_by_it() {
    let ball = |at: [f32; 3], by: f32| Body {
        a: at,
        b: at,
        radius: 0.02,
        a_travel: [by, 0.0, 0.0],
        b_travel: [by, 0.0, 0.0],
        kind: ROUND,
        ..Body::default()
    };
    let elsewhere = (0..6).map(|k| ball([0.0, 5.0 + k as f32, 0.0], 0.0));
    let all: Vec<Body> =
        [ball([-0.03, 0.0, 0.0], 0.1)].into_iter().chain(elsewhere).chain([ball([0.07, 0.0, 0.0], 0.0)]).collect();
    let in_step: Vec<Clear> = all.iter().map(Clear::in_step).collect();
    let (substep, params) = (Substep::default(), Params { h: 1.0 / 600.0, fraction: 1.0, ..Params::default() });
    let alone = vec![[Vec4::W, Vec4::ZERO]];
    let together = vec![alone[0], [Vec4::new(0.07, 0.0, 0.0, 1.0), Vec4::ZERO]];
    let ends = [alone, together].map(|state| {
        let near = NearBodies::of(&all, &in_step, &substep, &params, state.iter().copied());
        let [x, u] = state[0].map(xyz);
        let (at, by) = contact_bodies(lane(x), lane(u), true, &near, &substep, &params).expect("it is hit");
        [at.x + by.x, at.y + by.y, at.z + by.z]
    });
    let (x, u) = all.iter().fold((Vec3A::ZERO, Vec3A::ZERO), |(x, u), body| contact_one(x, u, body, &substep, &params));
    assert_eq!(ends, [(x + u).to_array(); 2]);
    assert!((x + u).x < 0.0501, "it ends at {}", x + u);
}
