//! The verdict on a state against energies and lengths in double precision.

use glam::{Vec3, Vec4};

use super::VertexWatch;
use crate::error::failure::Defect;
use crate::kernels::integrate::xyz;
use crate::kernels::limits::MAX_POSITION;
use crate::kernels::params::Params;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::Options;

/// What is found wrong after each vertex was checked.
fn verdict(cloth: &Cloth, params: &Params, step: u32, x: &[Vec4], u: &[Vec4]) -> Option<Defect> {
    let found = VertexWatch::nothing(params, &cloth.rest);
    (0..).zip(x.iter().zip(u)).for_each(|(vertex, (&x, &u))| found.check(vertex, xyz(x), xyz(u)));
    found.verdict(cloth, params, step, x, u)
}

fn cloth() -> (Cloth, Params) {
    let cloth = Cloth::new(&Mesh::grid(9, 9, 1.0, 1.0), &Options { pinned: vec![0], ..Options::default() }).expect("a sheet");
    let free = cloth.rest.iter().zip(&cloth.mass).filter(|(x, _)| x.w > 0.0);
    let mass: f64 = free.map(|(_, &mass)| f64::from(mass)).sum();
    let params = Params { per_length: 1.0 / 0.01, per_mass: (1.0 / mass) as f32, longest_edge: 8.0, ..Params::default() };
    (cloth, params)
}

#[test]
fn only_more_energy_than_is_explained_is_a_defect_even_where_nothing_is_far() {
    let (cloth, params) = cloth();
    let mut random = fastrand::Rng::with_seed(4);
    let pin = cloth.pinned[0] as usize;
    // The share of the allowed energy in vertices faster than is allowed on average.
    let share = |u: &[Vec4], factor: f64| -> f64 {
        let of = |(u, &mass): (&Vec4, &f32)| {
            let square = (u.as_dvec4().truncate() * factor * f64::from(params.per_length)).length_squared();
            if square > 1.0 { f64::from(mass) * f64::from(params.per_mass) * square } else { 0.0 }
        };
        u.iter().zip(&cloth.mass).map(of).sum()
    };
    for scale in [0.3, 0.9, 0.99, 1.01, 1.1, 3.0] {
        let mut u: Vec<Vec4> = cloth.rest.iter().map(|_| Vec3::from([0; 3].map(|_| random.f32() - 0.5)).extend(0.0)).collect();
        u[pin] = Vec4::ZERO;
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *(if share(&u, middle) < 1.0 { &mut low } else { &mut high }) = middle;
        }
        assert_eq!(share(&u, low * scale) > 1.0, scale > 1.0);
        u.iter_mut().for_each(|u| *u *= (low * scale) as f32);
        // The pin moves farther than all others: that is no energy of the cloth.
        u[pin] = Vec4::X;
        let cause = verdict(&cloth, &params, 0, &cloth.rest, &u);
        assert_eq!(matches!(cause, Some(Defect::Energy(_))), scale > 1.0, "{scale}: {cause:?}");
        assert!(cause.is_none() || scale > 1.0, "{scale}: {cause:?}");
    }
}

#[test]
fn an_edge_that_is_too_long_is_found_in_one_round_of_steps() {
    let (cloth, params) = cloth();
    let still = vec![Vec4::ZERO; cloth.rest.len()];
    for (far, is_long) in [(7.5, false), (12.0, true)] {
        let mut x = cloth.rest.clone();
        let vertex = cloth.rest.len() - 1;
        x[vertex] += Vec4::Y * far;
        let causes = (0..crate::step::watch::TURNS as u32).filter_map(|step| verdict(&cloth, &params, step, &x, &still));
        let mut count = 0;
        for cause in causes {
            count += 1;
            let Defect::Edge(place) = cause else { panic!("{cause:?}") };
            assert!(cloth.links[place].ends.contains(&(vertex as u32)), "edge {place}");
        }
        assert_eq!(count > 0, is_long, "{far} m");
    }
}

#[test]
fn a_vertex_out_of_bounds_is_named_before_all_else() {
    let (cloth, params) = cloth();
    for wrong in [f32::NAN, f32::INFINITY, 2.0 * MAX_POSITION] {
        for in_u in [false, true] {
            let (mut x, mut u) = (cloth.rest.clone(), vec![Vec4::ZERO; cloth.rest.len()]);
            (if in_u { &mut u } else { &mut x })[5].y = wrong;
            let cause = verdict(&cloth, &params, 0, &x, &u);
            assert!(matches!(cause, Some(Defect::Lost(5))), "{wrong}, {in_u}: {cause:?}");
        }
    }
}
