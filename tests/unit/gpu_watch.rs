//! On every route of a step, the verdict on its result against energies added up in double precision, and against the
//! length of one edge. The result of a step that fails is not kept.

use glam::{Vec3, Vec4};

use crate::attributes::Attributes;
use crate::device::Gpu;
use crate::error::failure::{Defect, Failure};
use crate::gpu::engine::{GpuEngine, Route};
use crate::gpu::tiles::TileSize;
use crate::kernels::params::Params;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::Options;
use crate::step::coefficients::Coefficients;
use crate::step::motion::Motion;
use crate::step::plan::{Plan, PlanBuffers, StepInputs};
use crate::step::substep_count::Length;
use crate::step::watch::TURNS;

const DT: f32 = 1.0 / 60.0;
const SUBSTEPS: u32 = 4;
/// Columns of the sheet.
const N: u32 = 24;

struct Scene {
    cloth: Cloth,
    options: Options,
    coefficients: Coefficients,
    gpu: Gpu,
    attributes: Attributes,
}

impl Scene {
    /// A sheet whose last vertex hangs by edges that are nearly without stiffness.
    fn new() -> Scene {
        let mesh = Mesh::grid(N, N, 1.0, 1.0);
        let soft = |ends: &[u32; 2]| if ends.contains(&(N * N - 1)) { 1e-15 } else { 1.0 };
        let edge_scale = Some(mesh.edges().iter().map(soft).collect());
        let options = Options { pinned: vec![3], edge_scale, ..Options::default() };
        let cloth = Cloth::new(&mesh, &options).unwrap();
        let coefficients = Coefficients::new(&cloth, &[], &options, Length::of(DT / SUBSTEPS as f32));
        Scene { cloth, options, coefficients, gpu: Gpu::shared(true).unwrap(), attributes: Attributes::default() }
    }

    fn engine(&self, route: Route) -> GpuEngine {
        let size = TileSize { own: 60, room: 500, bytes: usize::MAX };
        GpuEngine::with_route(self.gpu.clone(), &self.cloth, self.options.method, route, size).unwrap()
    }

    /// Takes a step with these bounds; returns the state after it and the verdict.
    fn step(&self, engine: &mut GpuEngine, bounds: impl Fn(&mut Params)) -> (Vec<Vec4>, Vec<Vec4>, Result<(), Failure>) {
        let motion = Motion::after(&self.cloth, &self.cloth.rest, 0.0);
        let mut buffers = PlanBuffers::default();
        let Scene { cloth, options, coefficients, attributes, .. } = self;
        let inputs = StepInputs::of(cloth, options, coefficients, &motion, SUBSTEPS, attributes);
        let plan = Plan::new(&inputs, &mut buffers);
        let mut params = plan.params;
        bounds(&mut params);
        engine.step(&Plan { params, ..plan }).unwrap();
        let (mut at, mut by) = (Vec::new(), Vec::new());
        let verdict = engine.read(|x, p| (at, by) = (x.to_vec(), p.to_vec()));
        (at, by, verdict)
    }
}

const ROUTES: [Route; 3] = [Route::PerColor, Route::Tiled, Route::SingleWorkgroup];

#[test]
fn only_more_energy_than_is_explained_is_a_defect() {
    let scene = Scene::new();
    let cloth = &scene.cloth;
    let mut random = fastrand::Rng::with_seed(9);
    let mut any = || Vec4::new(random.f32() - 0.5, random.f32() - 0.5, random.f32() - 0.5, 0.0) * 0.01 * random.f32();
    let p: Vec<Vec4> = cloth.rest.iter().map(|x| if x.w > 0.0 { any() } else { Vec4::ZERO }).collect();
    let mass: f64 = cloth.rest.iter().zip(&cloth.mass).filter(|(x, _)| x.w > 0.0).map(|(_, &mass)| f64::from(mass)).sum();
    for route in ROUTES {
        let mut engine = scene.engine(route);
        engine.set(&cloth.rest, &p);
        let (x, u, verdict) = scene.step(&mut engine, |_| {});
        assert!(verdict.is_ok() && x != cloth.rest);
        // The share of the allowed energy in vertices faster than a bound, and the first of them.
        let fast = |per_length: f64| {
            let free = (0..u.len()).filter(|&k| cloth.rest[k].w > 0.0);
            let fast: Vec<usize> = free.filter(|&k| u[k].truncate().as_dvec3().length() * per_length > 1.0).collect();
            let of = |&k: &usize| f64::from(cloth.mass[k]) * (u[k].truncate().as_dvec3() * per_length).length_squared();
            (fast.iter().map(of).sum::<f64>() / mass, fast.first().copied())
        };
        let (mut low, mut high) = (0.0, 1e6);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *(if fast(middle).0 < 1.0 { &mut low } else { &mut high }) = middle;
        }
        for (factor, is_hot) in [(0.5, false), (0.99, false), (1.01, true), (2.0, true)] {
            let per_length = low * factor;
            let (share, first) = fast(per_length);
            assert_eq!(share > 1.0, is_hot, "{share}");
            engine.set(&cloth.rest, &p);
            let (per_length, per_mass) = (per_length as f32, (1.0 / mass) as f32);
            let (at, by, verdict) =
                scene.step(&mut engine, |params| (params.per_length, params.per_mass) = (per_length, per_mass));
            let what = format!("{route:?}, {share:.3} of the allowed energy");
            match verdict {
                Ok(()) => assert!(!is_hot && at == x && by == u, "{what}"),
                Err(Failure::Unstable { cause: Defect::Energy(vertex), step: 1 }) => {
                    assert!(is_hot && Some(vertex) == first, "{what}: vertex {vertex}");
                    assert!(at == cloth.rest && by == p, "{what}: the state of before");
                }
                Err(other) => panic!("{what}: {other:?}"),
            }
        }
    }
}

/// A corner without weight hangs by edges that are nearly without stiffness, and stays where it is put.
#[test]
fn an_edge_that_is_too_long_is_found_in_one_round_of_steps() {
    let scene = Scene { attributes: Attributes { gravity: Vec3::ZERO, ..Attributes::default() }, ..Scene::new() };
    let cloth = &scene.cloth;
    let corner = (0..cloth.rest.len())
        .max_by(|&a, &b| (cloth.rest[a].x + cloth.rest[a].z).total_cmp(&(cloth.rest[b].x + cloth.rest[b].z)))
        .unwrap();
    let mut start = cloth.rest.clone();
    start[corner] += Vec4::new(1.5, 0.0, 1.0, 0.0);
    let length = |x: &[Vec4], ends: [u32; 2]| {
        let [a, b] = ends.map(|end| x[end as usize].truncate().as_dvec3());
        a.distance(b)
    };
    let longest = cloth.swept().iter().map(|edge| length(&start, edge.ends)).fold(0.0, f64::max);
    for route in ROUTES {
        let mut engine = scene.engine(route);
        engine.set(&start, &vec![Vec4::ZERO; start.len()]);
        let mut at = start.clone();
        for (factor, is_long) in [(1.001, false), (0.999, true)] {
            let limit = factor * longest;
            let failed = (0..TURNS).find_map(|_| {
                let before = at.clone();
                let (now, _, verdict) = scene.step(&mut engine, |params| params.longest_edge = limit as f32);
                at = now;
                verdict.err().map(|failure| (failure, before))
            });
            assert_eq!(failed.is_some(), is_long, "{route:?}, at most {limit} m: {failed:?}");
            let Some((failure, before)) = failed else { continue };
            let Failure::Unstable { cause: Defect::Edge(place), .. } = failure else { panic!("{route:?}: {failure:?}") };
            let found = length(&at, cloth.swept()[place].ends);
            assert!(found > limit, "{route:?}, at most {limit} m: {found} m");
            assert_eq!(at, before, "{route:?}: the last good step's");
        }
    }
}
