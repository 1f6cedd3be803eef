//! Unit tests of `src/cpu/forces.rs`.

use glam::{DVec3, Vec3A, Vec4};

use super::*;
use crate::cpu::integrate::Integrator;
use crate::model::cloth::Cloth;
use crate::step::coefficients::Coefficients;
use crate::step::motion::Motion;
use crate::step::plan::{PlanBuffers, StepInputs};
use crate::step::substep_count::Length;
use crate::{Attributes, Fabric, Mesh, Options};

use crate::kernels::bending::BendRow;
use crate::kernels::integrate::xyz;
use crate::kernels::params::Substep;
use crate::oracle;

/// A crumpled, moving cloth: positions and displacements.
fn crumpled(cloth: &Cloth) -> [Vec<Vec4>; 2] {
    let mut random = fastrand::Rng::with_seed(3);
    let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
    let both: Vec<[Vec4; 2]> =
        cloth.rest.iter().map(|rest| [*rest + vector(0.01).extend(0.0), vector(0.002).extend(0.0)]).collect();
    [0, 1].map(|k| both.iter().map(|both| both[k]).collect())
}

/// The displacement that unfiltered bending causes in a substep of `h` (s): `h² w L^T S L x`.
fn kick(plan: &Plan<'_>, h: f64, x: &[DVec3]) -> Vec<DVec3> {
    let (entries, rows) = (&plan.cloth.bending().entries, &plan.coefficients.bending.rows);
    let mut force = vec![DVec3::ZERO; x.len()];
    for (v, row) in rows.iter().enumerate() {
        let ring = entries.of(v as u32);
        let y: DVec3 = ring.iter().map(|e| f64::from(e.forward) * (x[e.other as usize] - x[v])).sum();
        for entry in ring {
            let by = f64::from(row.stiffness) * f64::from(entry.forward) * y;
            force[entry.other as usize] += by;
            force[v] -= by;
        }
    }
    force.iter().zip(&plan.cloth.rest).map(|(force, rest)| h * h * f64::from(rest.w) * force).collect()
}

/// The displacements of one substep as predicted by the oracle.
fn predicted_plainly(plan: &Plan<'_>) -> Vec<Vec4> {
    let (cloth, params, substep) = (plan.cloth, &plan.params, &plan.substeps[0]);
    let [x, u] = crumpled(cloth).map(|list| list.into_iter().map(xyz).collect::<Vec<Vec3A>>());
    let mut force = vec![Vec3A::ZERO; x.len()];
    if plan.bending {
        let entries = &cloth.bending().entries;
        let filtered = plan.coefficients.bending.passes.len();
        let moment = |v: usize| {
            let near = |e: &crate::kernels::bending::BendEntry| e.other as usize;
            let ring: Vec<_> =
                entries.of(v as u32).iter().map(|e| (x[near(e)] - x[v], (u[near(e)] - u[v]) * substep.rate, e.forward)).collect();
            let BendRow { stiffness, tau, .. } = plan.coefficients.bending.rows[v];
            let [moment, couple] = oracle::bend_moment(&ring, stiffness, tau);
            if filtered == 0 {
                return [moment, couple];
            }
            // With a filter, this is only the damping part; the filtered part is added below.
            [moment - oracle::bend_moment(&ring, stiffness, 0.0)[0], couple]
        };
        let moments: Vec<[Vec3A; 2]> = (0..x.len()).map(moment).collect();
        for v in 0..x.len() {
            // Row v acts on the members of its ring by its moment and its couple; the reaction acts on v itself.
            for entry in entries.of(v as u32).iter().filter(|entry| entry.forward != 0.0) {
                let other = entry.other as usize;
                let by = moments[v][1].cross(x[other] - x[v]) - moments[v][0] * entry.forward;
                force[other] += by;
                force[v] -= by;
            }
        }
        if filtered > 0 {
            let h = f64::from(plan.coefficients.length.longest_h);
            let wide: Vec<DVec3> = x.iter().map(|x| x.as_dvec3()).collect();
            let kicks = oracle::filtered_kick(&wide, filtered, |x| kick(plan, h, x));
            let to_force = |(kick, rest): (&DVec3, &Vec4)| (kick / (h * h * f64::from(rest.w))).as_vec3a();
            let free = force.iter_mut().zip(kicks.iter().zip(&cloth.rest)).filter(|(_, (_, rest))| rest.w > 0.0);
            free.for_each(|(force, kick)| *force -= to_force(kick));
        }
    }
    if plan.air {
        for panel in &cloth.panels().panels {
            let [a, b, c] = panel.corners.map(|v| v as usize);
            let v = (u[a] + u[b] + u[c]) * (substep.rate / 3.0) - Vec3A::from(params.wind);
            let kick = substep.gain / params.h;
            let half = params.half_density;
            let air = oracle::wind_force([x[a], x[b], x[c]], v, panel.mass, kick, half, params.drag, params.lift);
            [a, b, c].into_iter().for_each(|v| force[v] += air / 3.0);
        }
    }
    let by = |v: usize| {
        let kick = force[v] * (cloth.rest[v].w * substep.gain);
        if cloth.rest[v].w > 0.0 { u[v] * substep.carry + Vec3A::from(substep.fall) + kick } else { Vec3A::ZERO }
    };
    (0..x.len()).map(|v| by(v).extend(0.0)).collect()
}

/// The same displacements as predicted by the CPU's stages.
fn predicted(plan: &Plan<'_>, width: Width) -> Vec<Vec4> {
    let count = plan.cloth.rest.len();
    let [mut x, mut u] = crumpled(plan.cloth).map(|list| {
        let mut aligned = AlignedVec::new(count);
        aligned.copy_from_slice(&list);
        aligned
    });
    let mut arrays = ForceArrays::default();
    let tiles = [0..400, 400..count as u32];
    arrays.pack(plan, plan.bending, plan.air, &tiles, width);
    let (shared_x, shared_u) = (SharedArray::new(x.room()), SharedArray::new(u.room()));
    let forces = arrays.share(plan, &shared_x, &shared_u, width);
    let (task, substep): (Task, &Substep) = (Task::alone(), &plan.substeps[0]);
    let each_tile = |work: &dyn Fn(Range<u32>)| tiles.iter().for_each(|tile| work(tile.clone()));
    if plan.bending {
        each_tile(&|tile| forces.bend_moments(&task, tile, substep));
        for pass in 1..plan.coefficients.bending.passes.len() {
            each_tile(&|tile| forces.trial_displacements(&task, tile, pass));
            each_tile(&|tile| forces.filter_moments(&task, tile, pass));
        }
    }
    (0..arrays_of(plan)).for_each(|chunk| forces.panel_forces(&task, chunk, substep));
    if plan.bending {
        each_tile(&|tile| forces.bend(&task, tile, substep));
    } else {
        let none: [&mut [Vec4]; 2] = [&mut [], &mut []];
        let (good, found) = (none.map(SharedArray::new), crate::cpu::watch::VertexWatch::nothing(&plan.params, &[]));
        let integrator = Integrator { plan, x: &shared_x, u: &shared_u, good, found, width };
        each_tile(&|tile| integrator.fall(&task, tile, substep));
    }
    if plan.air {
        each_tile(&|tile| forces.add_air_and_springs(&task, tile, substep));
    }
    u.to_vec()
}

/// The number of chunks of triangles.
fn arrays_of(plan: &Plan<'_>) -> usize {
    if plan.air { plan.cloth.panels().panels.len().div_ceil(GRAIN) } else { 0 }
}

/// At every SIMD width the stages agree with the oracle to rounding, on meshes with and without contiguous rows, with
/// borders, pins, and vertices left over.
#[test]
fn every_width_predicts_as_the_oracle_does() {
    let grid = Mesh::grid(32, 27, 1.0, 0.9);
    let mut shuffled = Mesh::grid(29, 31, 1.0, 1.1);
    let mut names: Vec<u32> = (0..899).collect();
    fastrand::Rng::with_seed(5).shuffle(&mut names);
    names.iter().zip(shuffled.positions.clone()).for_each(|(&name, x)| shuffled.positions[name as usize] = x);
    shuffled.triangles.iter_mut().flatten().for_each(|vertex| *vertex = names[*vertex as usize]);
    let air = Attributes { air_density: 1.2, wind: glam::Vec3::new(3.0, 1.0, -7.0), ..Attributes::default() };
    for (name, mesh) in [("grid", &grid), ("shuffled", &shuffled)] {
        for (scene, bending, damping, attributes) in [
            ("bending", 1e-4, 0.0, &Attributes::default()),
            ("damped", 1e-4, 0.03, &Attributes::default()),
            ("two passes", 2e-2, 0.0, &Attributes::default()),
            ("damped in passes", 0.3, 0.03, &Attributes::default()),
            ("air", 0.0, 0.0, &air),
            ("all", 1e-4, 0.03, &air),
        ] {
            let fabric = Fabric { bending, damping, ..Fabric::default() };
            let options = Options { fabric, pinned: vec![0, 7, 500], ..Options::default() };
            let cloth = Cloth::new(mesh, &options).unwrap();
            let h = 1.0 / 1200.0;
            let plan_of = |options: &Options, attributes: &Attributes, check: &dyn Fn(&Plan<'_>)| {
                let coefficients = Coefficients::new(&cloth, &[], options, Length::of(h));
                let (mut lists, motion) = (PlanBuffers::default(), Motion::after(&cloth, &cloth.rest, h));
                let inputs = StepInputs::of(&cloth, options, &coefficients, &motion, 1, attributes);
                check(&Plan::new(&inputs, &mut lists));
            };
            let most = |a: &[Vec4], b: &[Vec4]| {
                a.iter()
                    .zip(b)
                    .map(|(a, b)| (a - b).truncate().length())
                    .fold(0.0, |most: f32, d| if d > most || d.is_nan() { d } else { most })
            };
            plan_of(&options, attributes, &|plan| {
                let plain = predicted_plainly(plan);
                let still = Options { fabric: Fabric { bending: 0.0, ..fabric }, ..options.clone() };
                plan_of(&still, &Attributes::default(), &|falls| {
                    let moved = most(&plain, &predicted_plainly(falls));
                    assert!(moved > 1e-7, "{name} {scene}: forces move by {moved}");
                    for width in Width::all() {
                        let apart = most(&plain, &predicted(plan, width));
                        assert!(apart <= 1e-5 * moved + 1e-9, "{name} {scene} {width:?}: {apart} apart of {moved}");
                    }
                });
            });
        }
    }
}
