//! Every way to run a step on the GPU agrees with the CPU, and tiles hold all that they depend on.

use std::collections::BTreeSet;

use glam::{Quat, Vec3, Vec4};

use crate::attributes::{Attributes, Collider};
use crate::backend::Engine;
use crate::cpu::Cpu;
use crate::device::Gpu;
use crate::gpu::bend_tiles::BendTiles;
use crate::gpu::bending::Bending;
use crate::gpu::engine::{Besides, EdgeSweep, GpuEngine, Route};
use crate::gpu::multigrid::Multigrid;
use crate::gpu::slices::SLICE;
use crate::gpu::sweep::{OnDemand, with_rings};
use crate::gpu::tiles::{IN_TILE, TileSize, Tiles};
use crate::kernels::bending::BendEntry;
use crate::model::cloth::Cloth;
use crate::model::csr::Csr;
use crate::model::mesh::Mesh;
use crate::model::shells::tests::cushion;
use crate::multigrid::hierarchy::Hierarchy;
use crate::options::{Method, Options};
use crate::step::coefficients::Coefficients;
use crate::step::motion::Motion;
use crate::step::plan::{Plan, PlanBuffers, StepInputs};
use crate::step::substep_count::Length;

/// Duration of a step (s).
const DT: f32 = 1.0 / 60.0;
/// Substeps of a step.
const SUBSTEPS: u32 = 11;

/// A jittered grid with random diagonals and a random vertex order, in two parts, with a vertex that has no triangle.
fn mesh(columns: u32, rows: u32) -> Mesh {
    let mut random = fastrand::Rng::with_seed(5);
    let mut grid = Mesh::grid(columns, rows, 1.0, 1.0);
    grid.triangles.clear();
    for corner in (0..columns * (rows - 1)).filter(|corner| corner % columns + 1 < columns && corner / columns != rows / 3) {
        let [a, b, c, d] = [corner, corner + 1, corner + columns, corner + columns + 1];
        let halves = if random.bool() { [[a, c, b], [b, c, d]] } else { [[a, c, d], [a, d, b]] };
        grid.triangles.extend(halves);
    }
    grid.positions.push(Vec3::splat(0.3));
    let mut names: Vec<u32> = (0..grid.positions.len() as u32).collect();
    random.shuffle(&mut names);
    let mut mesh = Mesh { positions: grid.positions.clone(), triangles: Vec::new() };
    for (x, &name) in grid.positions.iter().zip(&names) {
        mesh.positions[name as usize] = *x + 0.003 * Vec3::from_array([0; 3].map(|_| random.f32() - 0.5));
    }
    mesh.triangles = grid.triangles.iter().map(|triangle| triangle.map(|vertex| names[vertex as usize])).collect();
    mesh
}

/// In one frame the pins are moved, in the other they are held. In two more frames a fold would go one way or the other
/// depending on the last bit, and the difference between two correct routes would exceed the error of a wrong one.
const FRAMES: u8 = 2;

/// Positions and momenta.
type Ends = (Vec<Vec4>, Vec<Vec4>);

/// The state on the CPU after some steps with colliders, moving pins and, if `windy`, bending and wind.
fn play(cloth: &Cloth, options: &Options, windy: bool, levels: usize) -> Ends {
    play_from(1.0, &mut Engine::Cpu(Box::new(Cpu::new(cloth))), cloth, options, windy, levels)
}

/// The same on the GPU, and the engine that did it.
fn play_on(engine: GpuEngine, cloth: &Cloth, options: &Options, windy: bool, levels: usize) -> (Box<GpuEngine>, Ends) {
    let mut engine = Engine::Gpu(Box::new(engine));
    let ends = play_from(1.0, &mut engine, cloth, options, windy, levels);
    let Engine::Gpu(engine) = engine else { unreachable!("made above") };
    (engine, ends)
}

/// The same, starting from positions that are `scale` times as far from the origin.
fn play_from(scale: f32, engine: &mut Engine, cloth: &Cloth, options: &Options, windy: bool, levels: usize) -> Ends {
    let wave = |k: usize, f: f32| (k as f32 * f).sin();
    let p: Vec<Vec4> = (0..cloth.rest.len()).map(|k| 0.3 * Vec4::new(wave(k, 0.7), wave(k, 1.1), wave(k, 1.7), 0.0)).collect();
    let p: Vec<Vec4> = p.iter().zip(&cloth.rest).map(|(p, x)| if x.w > 0.0 { *p } else { Vec4::ZERO }).collect();
    let x: Vec<Vec4> = cloth.rest.iter().map(|x| (x.truncate() * scale).extend(x.w)).collect();
    engine.set(&x, &p);
    let mut motion = Motion::after(cloth, &x, 0.0);
    let mut hierarchy = Hierarchy::default();
    hierarchy.build(cloth, levels);
    let coefficients = Coefficients::new(cloth, hierarchy.finest(levels), options, Length::of(DT / SUBSTEPS as f32));
    for frame in 0..FRAMES {
        let mut attributes = Attributes { damping: 0.5, ..Attributes::default() };
        let center = Vec3::new(0.1, -0.31 + 0.02 * f32::from(frame), 0.0);
        attributes.colliders = vec![Collider::sphere(center, 0.3).with_friction(0.3), Collider::plane(Vec3::Y * -0.05, Vec3::Y)];
        if windy {
            (attributes.wind, attributes.air_density) = (Vec3::new(2.0, 4.0, -3.0), 1.2);
        }
        // The pins are moved in even frames and held in odd ones.
        if frame % 2 == 0 {
            attributes.pin_targets = Some(motion.pins.iter().map(|&pin| pin + Vec3::new(0.01, 0.02, 0.0)).collect());
        }
        let mut buffers = PlanBuffers::default();
        let substeps = SUBSTEPS + u32::from(frame % 2);
        let inputs = StepInputs {
            levels: &hierarchy.levels,
            ..StepInputs::of(cloth, options, &coefficients, &motion, substeps, &attributes)
        };
        engine.step(&Plan::new(&inputs, &mut buffers)).unwrap();
        if let Some(targets) = attributes.pin_targets {
            motion.pins = targets;
        }
        motion.h = coefficients.length.h;
        motion.colliders = attributes.colliders;
    }
    let mut state = (Vec::new(), Vec::new());
    engine.read(|x, p| state = (x.to_vec(), p.to_vec())).unwrap();
    state
}

/// Number of roundings by which the CPU, with fused multiply-adds, may differ from a GPU. Coarse edges either pull or
/// do not, so levels amplify a rounding difference; a real error is still larger.
const ROUNDINGS: f64 = 4.0;

/// By how much (m) the final positions differ from `x` if the initial positions change in their last bits: the largest
/// of several changes, since most have little effect and some make a coarse edge pull that did not before.
fn rounding(cloth: &Cloth, options: &Options, windy: bool, levels: usize, x: &[Vec4]) -> f64 {
    let scales = [-2, -1, 1, 2].map(|bits: i8| 1.0 + f32::from(bits) * f32::EPSILON);
    let ends = scales.map(|scale| play_from(scale, &mut Engine::Cpu(Box::new(Cpu::new(cloth))), cloth, options, windy, levels).0);
    ends.iter().map(|end| apart(x, end)).fold(0.0, f64::max)
}

/// Root mean square distance (m) over vertices.
fn apart(a: &[Vec4], b: &[Vec4]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from((*a - *b).truncate().length_squared())).sum();
    (sum / a.len() as f64).sqrt()
}

#[test]
fn every_path_agrees_with_the_cpu() {
    let gpu = Gpu::shared(true).unwrap();
    let room = gpu.workgroup_memory() / IN_TILE;
    let relaxation = Method::Relaxation { iterations: 3 };
    for (name, mesh) in [("grid", Mesh::grid(31, 23, 1.0, 0.8)), ("any", mesh(27, 31)), ("shell", cushion(20))] {
        let small = Method::SmallSteps;
        for (method, windy, levels) in
            [(small, false, 0), (small, true, 0), (small, true, 1), (small, false, 2), (small, true, 2), (relaxation, false, 0)]
        {
            let mut options = Options { method, pinned: vec![3, 100, 200], ..Options::default() };
            options.fabric.bending = if windy { 1e-4 } else { 0.0 };
            let cloth = Cloth::new(&mesh, &options).unwrap();
            let (x, p) = play(&cloth, &options, windy, levels);
            let (moved, speed) = (apart(&x, &cloth.rest), apart(&p, &vec![Vec4::ZERO; p.len()]));
            assert!(moved > 0.01, "{name}: moved by {moved} m");
            let rounding = rounding(&cloth, &options, windy, levels, &x) / moved;
            // The smallest room holds only the second level, so the first level is cut into tiles.
            let sizes = [(40, room), (30, 320), (200, room)].map(|(own, room)| TileSize { own, room, bytes: usize::MAX });
            let routes =
                [(Route::PerColor, sizes[0]), (Route::Tiled, sizes[0]), (Route::Tiled, sizes[1]), (Route::Tiled, sizes[2])];
            for (route, size) in routes.into_iter().chain([(Route::SingleWorkgroup, sizes[0])]) {
                let engine = GpuEngine::with_route(gpu.clone(), &cloth, method, route, size).unwrap();
                let tiled = matches!(engine.sweep, EdgeSweep::Tiled(_));
                let may_be = route != Route::PerColor && method == Method::SmallSteps;
                assert_eq!(tiled, may_be, "{name}: {route:?} {method:?}");
                let (engine, (x_gpu, p_gpu)) = play_on(engine, &cloth, &options, windy, levels);
                let once = engine.dispatches == 1;
                assert_eq!(once, route == Route::SingleWorkgroup, "{name}: {route:?} {method:?}");
                let (dx, dp) = (apart(&x, &x_gpu) / moved, apart(&p, &p_gpu) / speed);
                let what =
                    format!("{name}, {method:?}, windy {windy}, {levels} levels: {route:?}, {size:?}: {dx:e}, {dp:e} apart");
                println!("{what}");
                // Only rounding is allowed; an edge that is omitted or visited out of turn makes a difference of 1e-3
                // and more.
                let slack = 1.0 + ROUNDINGS * rounding / 2e-5;
                assert!(dx <= 2e-5 * slack && dp <= 2e-4 * slack, "{what}, one rounding {rounding:e}");
            }
        }
    }
}

/// Bending agrees with the CPU in one pass and in several, damped and undamped, in tiles, with a dispatch per stage, and
/// in one workgroup.
#[test]
fn bending_agrees_with_the_cpu_on_every_path() {
    let gpu = Gpu::shared(true).unwrap();
    for (name, mesh) in [("grid", Mesh::grid(31, 23, 1.0, 0.8)), ("any", mesh(27, 31))] {
        for (bending, damping, passes) in [(1e-4, 0.0, 0..1), (1e-4, 0.05, 0..1), (6e-3, 0.0, 2..6), (2e-2, 0.05, 3..8)] {
            let mut options = Options { pinned: vec![3, 100, 200], ..Options::default() };
            (options.fabric.bending, options.fabric.damping) = (bending, damping);
            let cloth = Cloth::new(&mesh, &options).unwrap();
            let count = Coefficients::new(&cloth, &[], &options, Length::of(DT / SUBSTEPS as f32)).bending.passes.len();
            assert!(passes.contains(&count), "{name}, B = {bending}: {count} passes");
            let (x, _) = play(&cloth, &options, false, 0);
            let moved = apart(&x, &cloth.rest);
            let size = TileSize { own: 40, room: gpu.workgroup_memory() / IN_TILE, bytes: usize::MAX };
            // With the sweep, which does a single pass only; in tiles of its own; with a dispatch per stage.
            let ends = [(true, true), (false, true), (false, false)].map(|(with_sweep, in_tiles)| {
                let mut engine = GpuEngine::with_route(gpu.clone(), &cloth, Method::SmallSteps, Route::Tiled, size).unwrap();
                engine.forces.bend_in_tiles = in_tiles;
                engine.more[Besides::Bending as usize] = if with_sweep { OnDemand::new() } else { OnDemand::from(None) };
                let (engine, (end, _)) = play_on(engine, &cloth, &options, false, 0);
                let fused = with_sweep && count <= 1;
                assert_eq!(
                    engine.more[Besides::Bending as usize].get().is_some_and(Option::is_some),
                    fused,
                    "{name}, {count} passes"
                );
                assert_eq!(engine.forces.bending.as_ref().map(Bending::in_tiles), (!fused).then_some(in_tiles));
                end
            });
            let alone = GpuEngine::with_route(gpu.clone(), &cloth, Method::SmallSteps, Route::SingleWorkgroup, size).unwrap();
            let (alone, (end, _)) = play_on(alone, &cloth, &options, false, 0);
            assert_eq!(alone.dispatches, 1);
            let distances = [(&x, &ends[0]), (&ends[0], &ends[1]), (&ends[0], &ends[2]), (&ends[0], &end)];
            let [dx, between, parts, single] = distances.map(|(a, b)| apart(a, b) / moved);
            let what = format!("{name}, B = {bending}, tau = {damping}, {count} passes");
            println!("{what}: {dx:e} apart, {between:e} and {parts:e} without the sweep, {single:e} in one workgroup");
            // Rounding, which damping amplifies where the direction of a ring's curvature is nearly undefined.
            let close = [between, parts, single].into_iter().all(|apart| apart <= 1e-5);
            assert!(dx <= 1e-4 && close, "{what}: {dx:e}, {between:e}, {parts:e} and {single:e} apart");
        }
    }
}

/// A single level moves the cloth to the same bits whether the tiles correct by it or a dispatch of its own does.
#[test]
fn tiles_correct_by_a_level_as_a_dispatch_of_its_own_does() {
    let gpu = Gpu::shared(true).unwrap();
    for (name, mesh) in [("grid", Mesh::grid(61, 43, 1.0, 0.8)), ("any", mesh(47, 51))] {
        for windy in [false, true] {
            let options = Options { pinned: vec![3, 100, 200], ..Options::default() };
            let cloth = Cloth::new(&mesh, &options).unwrap();
            let size = TileSize { own: 40, room: gpu.workgroup_memory() / IN_TILE, bytes: usize::MAX };
            let ends = [OnDemand::new(), OnDemand::from(None)].map(|corrected| {
                let fused = corrected.get().is_none();
                let mut engine = GpuEngine::with_route(gpu.clone(), &cloth, Method::SmallSteps, Route::Tiled, size).unwrap();
                engine.more[Besides::Correcting as usize] = corrected;
                let (engine, end) = play_on(engine, &cloth, &options, windy, 1);
                assert_eq!(engine.more[Besides::Correcting as usize].get().is_some_and(Option::is_some), fused, "{name}");
                end
            });
            assert!(apart(&ends[0].0, &cloth.rest) > 0.01, "{name}: moved");
            assert!(ends[0] == ends[1], "{name}, windy {windy}: {:e} m apart", apart(&ends[0].0, &ends[1].0));
        }
    }
}

/// The tiles that bend the cloth average it for the levels as a dispatch of its own does, up to rounding, also after
/// steps in which they do not, because pins are moved.
#[test]
fn tiles_that_bend_average_for_the_levels() {
    let gpu = Gpu::shared(true).unwrap();
    for (name, mesh) in [("grid", Mesh::grid(31, 23, 1.0, 0.8)), ("any", mesh(27, 31))] {
        for (bending, levels) in [(1e-4, 1), (6e-3, 2)] {
            let mut options = Options { pinned: vec![3, 100, 200], ..Options::default() };
            options.fabric.bending = bending;
            let cloth = Cloth::new(&mesh, &options).unwrap();
            let size = TileSize { own: 40, room: gpu.workgroup_memory() / IN_TILE, bytes: usize::MAX };
            let ends = [true, false].map(|in_tiles| {
                let mut engine = GpuEngine::with_route(gpu.clone(), &cloth, Method::SmallSteps, Route::Tiled, size).unwrap();
                engine.forces.bend_in_tiles = in_tiles;
                let (engine, (end, _)) = play_on(engine, &cloth, &options, false, levels);
                assert_eq!(engine.forces.bending.as_ref().map(Bending::averages), Some(in_tiles), "{name}");
                end
            });
            let (dx, moved) = (apart(&ends[0], &ends[1]), apart(&ends[0], &cloth.rest));
            println!("{name}, B = {bending}, {levels} levels: {:e} apart", dx / moved);
            assert!(moved > 0.01 && dx <= 1e-5 * moved, "{name}, B = {bending}, {levels} levels: {dx:e} m apart of {moved}");
        }
    }
}

/// In a crowd, each cloth that is too large for the route of a single workgroup when it is alone takes one dispatch,
/// whatever forces it and the other cloths have.
#[test]
fn each_of_a_crowd_is_one_dispatch() {
    let gpu = Gpu::shared(true).unwrap();
    let mesh = Mesh::grid(40, 40, 1.0, 1.0);
    let terms = [(0.0, 0.0), (1e-4, 0.0), (0.0, 1.2), (6e-3, 1.2)];
    let scenes = terms.map(|(bending, air_density)| {
        let mut options = Options { pinned: vec![0, 39], ..Options::default() };
        options.fabric.bending = bending;
        let cloth = Cloth::new(&mesh, &options).unwrap();
        let coefficients = Coefficients::new(&cloth, &[], &options, Length::of(DT / SUBSTEPS as f32));
        let attributes = Attributes { air_density, wind: Vec3::new(2.0, 4.0, -3.0), ..Attributes::default() };
        (cloth, options, coefficients, attributes)
    });
    let mut engines = scenes.each_ref().map(|(cloth, options, ..)| GpuEngine::new(gpu.clone(), cloth, options.method).unwrap());
    // As on hardware.
    engines.iter_mut().for_each(|engine| engine.joins_forces = true);
    let mut buffers = [(); 4].map(|()| PlanBuffers::default());
    let motions = scenes.each_ref().map(|(cloth, ..)| Motion::after(cloth, &cloth.rest, 0.0));
    let plans =
        scenes.iter().zip(&motions).zip(&mut buffers).map(|(((cloth, options, coefficients, attributes), motion), buffers)| {
            let inputs = StepInputs::of(cloth, options, coefficients, motion, SUBSTEPS, attributes);
            Plan::new(&inputs, buffers)
        });
    let mut jobs: Vec<_> = engines.iter_mut().zip(plans).enumerate().map(|(k, (engine, plan))| (k, engine, plan)).collect();
    assert!(GpuEngine::step_all(&mut jobs).is_empty());
    for (_, engine, plan) in jobs {
        assert_eq!(engine.dispatches, 1, "bending {}, wind {}", plan.bending, plan.air);
        let mut cpu = Cpu::new(plan.cloth);
        cpu.step(&plan, None).unwrap();
        let mut seen = Vec::new();
        engine.read(|x, _| seen = x.to_vec()).unwrap();
        let (dx, moved) = (apart(&cpu.x, &seen), apart(&cpu.x, &plan.cloth.rest));
        assert!(moved > 1e-3 && dx <= 1e-4 * moved, "bending {}, wind {}: {dx:e} m apart of {moved}", plan.bending, plan.air);
    }
}

/// Each vertex is owned by exactly one tile. A tile holds the rings that its own vertices depend on, and its lists say
/// where each neighbor is.
#[test]
fn bend_tiles_hold_their_rings() {
    for (mesh, rings) in [(Mesh::grid(40, 37, 1.0, 1.0), 1), (mesh(33, 29), 3), (Mesh::grid(40, 37, 1.0, 1.0), 7)] {
        let cloth = Cloth::new(&mesh, &Options { pinned: vec![0], ..Options::default() }).unwrap();
        let entries = &cloth.bending().entries;
        let tiles =
            BendTiles::new(&cloth.rest, entries, rings, TileSize { own: 64, room: 600, bytes: usize::MAX }, None).unwrap();
        let mut kept = vec![0; cloth.rest.len()];
        for header in tiles.table[..4 * tiles.count].chunks(4) {
            let [ends, list, slices] = [0, 1, 2].map(|k| header[k] as usize);
            let (ends, vertices) = (&tiles.table[ends..list], &tiles.table[list..slices]);
            assert_eq!(ends[0] as usize, rings);
            let ends: Vec<usize> = ends[1..].iter().map(|&end| end as usize).collect();
            assert!(ends.is_sorted() && ends[rings] <= tiles.largest && tiles.largest <= 600);
            vertices[..ends[0]].iter().for_each(|&vertex| kept[vertex as usize] += 1);
            for (k, &vertex) in vertices[..ends[rings]].iter().enumerate() {
                let (slice, lane) = (slices + k / SLICE, k % SLICE);
                let [first, end] = [tiles.table[slice], tiles.table[slice + 1]].map(|word| word as usize);
                let items = (first..end).step_by(3 * SLICE).map(|at| [0, 1, 2].map(|word| tiles.table[at + word * SLICE + lane]));
                let items: Vec<[u32; 3]> = items.collect();
                let (listed, filled) = items.split_at(entries.of(vertex).len());
                for (entry, &[place, forward, backward]) in entries.of(vertex).iter().zip(listed) {
                    assert_eq!(vertices[place as usize], entry.other);
                    assert_eq!([forward, backward], [entry.forward, entry.backward].map(f32::to_bits));
                    // A vertex reads at most the next ring, which is computed one stage earlier.
                    let ring = ends.iter().position(|&end| k < end).unwrap();
                    assert!(ring == rings || (place as usize) < ends[ring + 1]);
                }
                assert!(filled.iter().all(|item| *item == [k as u32, 0, 0]));
            }
        }
        assert!(tiles.count > 3 && kept.iter().all(|&count| count == 1));
    }
}

/// The tiles with bending hold, for each vertex that they sweep, all rows that act on it, and for each of these rows all
/// vertices that it depends on.
#[test]
fn bent_tiles_hold_their_rings() {
    let gpu = Gpu::shared(true).unwrap();
    for mesh in [Mesh::grid(40, 37, 1.0, 1.0), mesh(33, 29)] {
        let cloth = Cloth::new(&mesh, &Options { pinned: vec![0], ..Options::default() }).unwrap();
        let entries = &cloth.bending().entries;
        let size = TileSize { own: 50, room: 400, bytes: usize::MAX };
        let plain = Tiles::new(&cloth.rest, cloth.swept(), &cloth.colors, size).unwrap();
        let (tiles, rings) = with_rings(&gpu, &plain, entries).unwrap();
        assert_eq!((tiles.count, tiles.widest), (plain.count, plain.widest));
        assert_eq!(tiles.table[tiles.table.len() - 5..], plain.table[plain.table.len() - 5..], "the edges stay");
        let words = |tile: usize, index: usize, k: usize| {
            [0, 1, 2].map(|word| rings.table[((tile * rings.ring + index) * 3 + word) * rings.bent + k])
        };
        for (tile, (list, swept)) in tiles.lists().zip(plain.lists()).enumerate() {
            assert_eq!(&list[..swept.len()], swept, "tile {tile}");
            assert!(swept.len() <= rings.swept && list.len() <= tiles.largest);
            let listed = |k: usize| {
                (0..rings.ring)
                    .map(move |index| words(tile, index, k))
                    .filter(|[_, forward, backward]| (forward | backward) << 1 != 0)
            };
            let there = |k: usize| {
                let of = entries.of(list[k]).iter().filter(|entry| entry.forward != 0.0 || entry.backward != 0.0);
                let of = of.map(|entry| (entry.other, entry.forward.to_bits(), entry.backward.to_bits()));
                let found = listed(k).map(|[place, forward, backward]| (list[place as usize], forward, backward));
                assert!(of.eq(found), "tile {tile}, place {k}");
            };
            (0..swept.len()).for_each(there);
            // Whatever acts on a swept vertex has all its entries, too.
            let acting = (0..swept.len()).flat_map(|k| listed(k).map(|[place, ..]| place as usize));
            for k in acting {
                assert!(k < rings.bent, "tile {tile}, place {k}");
                there(k);
            }
        }
    }
}

#[test]
fn levels_too_large_for_a_workgroup_agree_with_the_cpu() {
    let gpu = Gpu::shared(true).unwrap();
    let options = Options { pinned: vec![3, 100, 200], ..Options::default() };
    let cloth = Cloth::new(&mesh(110, 90), &options).unwrap();
    let (x, _) = play(&cloth, &options, false, 3);
    let (plain, _) = play(&cloth, &options, false, 0);
    let rounding = rounding(&cloth, &options, false, 3, &x) / apart(&x, &cloth.rest);
    assert!(apart(&x, &plain) > 1e-4 * apart(&x, &cloth.rest), "levels matter here");
    let of_level: Vec<usize> = Hierarchy::new(&cloth).levels.iter().map(|level| level.inverse_mass.len()).collect();
    for (room, in_tiles) in [(of_level[0] - 1, Some(1)), (10, None)] {
        let size = TileSize { own: 100, room: 700, bytes: usize::MAX };
        let mut engine = GpuEngine::with_route(gpu.clone(), &cloth, Method::SmallSteps, Route::Tiled, size).unwrap();
        engine.max_aggregates = room;
        let (engine, (x_gpu, _)) = play_on(engine, &cloth, &options, false, 3);
        assert_eq!(engine.multigrid.as_ref().and_then(Multigrid::in_tiles), in_tiles, "room {room}");
        let dx = apart(&x, &x_gpu) / apart(&x, &cloth.rest);
        println!("room for {room} of {of_level:?}: {dx:e} apart");
        assert!(dx <= 2e-5 + ROUNDINGS * rounding, "room for {room} of {of_level:?}: {dx:e} apart, one rounding {rounding:e}");
    }
}

/// On every route, a step with a result that is not finite is undone on the GPU, as are the steps after it until the
/// failure is read.
#[test]
fn a_failed_step_is_undone_on_every_path() {
    let gpu = Gpu::shared(true).unwrap();
    let options = Options { pinned: vec![3], ..Options::default() };
    let cloth = Cloth::new(&Mesh::grid(20, 20, 1.0, 1.0), &options).unwrap();
    let coefficients = Coefficients::new(&cloth, &[], &options, Length::of(DT / SUBSTEPS as f32));
    let motion = Motion::after(&cloth, &cloth.rest, 0.0);
    for route in [Route::PerColor, Route::Tiled, Route::SingleWorkgroup] {
        let mut engine = GpuEngine::with_route(
            gpu.clone(),
            &cloth,
            Method::SmallSteps,
            route,
            TileSize { own: 60, room: 500, bytes: usize::MAX },
        )
        .unwrap();
        let mut step = |gravity: Vec3, read: bool| {
            let attributes = Attributes { gravity, ..Attributes::default() };
            let mut buffers = PlanBuffers::default();
            let inputs = StepInputs::of(&cloth, &options, &coefficients, &motion, SUBSTEPS, &attributes);
            engine.step(&Plan::new(&inputs, &mut buffers)).unwrap();
            let mut seen = Vec::new();
            let failed = read && engine.read(|x, _| seen = x.to_vec()).is_err();
            (seen, failed)
        };
        let (good, failed) = step(Vec3::X, true);
        assert!(!failed && good != cloth.rest);
        let _ = step(Vec3::splat(3e38), false);
        let (after, failed) = step(Vec3::X, true);
        assert!(failed && after == good, "{route:?}");
        assert!(!step(Vec3::X, true).1, "{route:?}: once told, it goes on");
    }
}

/// Simulates the tiles on the CPU: each tile, from its own vertices and halo only, computes for its own vertices the
/// same bits as sweeping all colors of the whole cloth.
#[test]
fn tiles_hold_all_that_their_own_vertices_depend_on() {
    for (mesh, own) in [(Mesh::grid(40, 37, 1.0, 1.0), 64), (mesh(33, 29), 50), (mesh(5, 4), 7)] {
        let cloth = Cloth::new(&mesh, &Options { pinned: vec![0], ..Options::default() }).unwrap();
        let ends: Vec<[u32; 2]> = cloth.swept().iter().map(|link| link.ends).collect();
        let tiles =
            Tiles::new(&cloth.rest, cloth.swept(), &cloth.colors, TileSize { own, room: 400, bytes: usize::MAX }).unwrap();
        // Any rule whose result depends on the order will do: here each edge mixes the values at its ends.
        let mix = |a: u64, b: u64| (a.rotate_left(7) ^ b.wrapping_mul(0x9e37_79b9_7f4a_7c15), b.rotate_left(11) ^ a);
        let start = |v: u32| u64::from(v) + 1;
        let mut all: Vec<u64> = (0..cloth.rest.len() as u32).map(start).collect();
        for &[a, b] in &ends {
            let (a, b) = (a as usize, b as usize);
            (all[a], all[b]) = mix(all[a], all[b]);
        }
        let mut kept = 0;
        let (lists, edges) = tiles.table.split_at(tiles.count * (1 + 2 * tiles.largest));
        let (counts, lists) = lists.split_at(tiles.count);
        let blocks = edges.chunks(cloth.colors.len() * 3 * tiles.widest);
        for ((&own, names), block) in counts.iter().zip(lists.chunks(tiles.largest)).zip(blocks) {
            assert!(own as usize <= names.len() && names.len() <= 400);
            let mut local: Vec<u64> = names.iter().map(|&v| start(v)).collect();
            for color in block.chunks(3 * tiles.widest) {
                for &pair in color[..tiles.widest].iter().filter(|&&pair| pair != u32::MAX) {
                    let (a, b) = ((pair & 0xffff) as usize, (pair >> 16) as usize);
                    (local[a], local[b]) = mix(local[a], local[b]);
                }
            }
            for (&v, value) in names.iter().zip(&local).take(own as usize) {
                assert_eq!(*value, all[v as usize], "vertex {v}");
                kept += 1;
            }
        }
        assert_eq!(kept, cloth.rest.len(), "every vertex has one tile");
        assert!(tiles.count > 3);
    }
}

/// Sheets that lie on each other are cut like the same sheets apart: no tile has vertices of two.
#[test]
fn layers_do_not_share_tiles() {
    let (sheets, n) = (10, 64);
    let mut mesh = Mesh::default();
    for sheet in 0..sheets {
        let one = Mesh::grid(n, n, 1.0, 1.0);
        let turn = Quat::from_rotation_y(0.1 * sheet as f32);
        mesh.positions.extend(one.positions.iter().map(|&x| turn * x + 0.008 * sheet as f32 * Vec3::Y));
        mesh.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + sheet * n * n)));
    }
    let size = TileSize { own: 256, room: 1536, bytes: usize::MAX };
    let tiles = |mesh: &Mesh| {
        let cloth = Cloth::new(mesh, &Options::default()).unwrap();
        Tiles::new(&cloth.rest, cloth.swept(), &cloth.colors, size).unwrap()
    };
    let (all, one) = (tiles(&mesh), tiles(&Mesh::grid(n, n, 1.0, 1.0)));
    let layers = |list: &[u32]| list.iter().map(|vertex| vertex / (n * n)).collect::<BTreeSet<u32>>();
    assert!(all.lists().all(|list| layers(list).len() == 1));
    assert_eq!(all.count, sheets as usize * one.count);
    // Parts that are small share a tile.
    let few = Mesh { triangles: mesh.triangles[..2].to_vec(), positions: mesh.positions[..1000].to_vec() };
    assert!(tiles(&few).count <= 5);
}

#[test]
fn a_fan_that_no_tile_holds_is_refused() {
    let mut mesh = Mesh { positions: vec![Vec3::ZERO], triangles: Vec::new() };
    for k in 0..300_u32 {
        let angle = k as f32 * 0.02;
        mesh.positions.push(Vec3::new(angle.cos(), 0.0, angle.sin()));
        mesh.triangles.extend((k > 0).then_some([0, k, k + 1]));
    }
    let cloth = Cloth::new(&mesh, &Options::default()).unwrap();
    assert!(Tiles::new(&cloth.rest, cloth.swept(), &cloth.colors, TileSize { own: 64, room: 200, bytes: usize::MAX }).is_none());
    assert!(Tiles::new(&cloth.rest, cloth.swept(), &cloth.colors, TileSize { own: 64, room: 400, bytes: usize::MAX }).is_some());
    // A hub whose ring contains all other vertices.
    let spoke = |k: u32| [(0, k), (k, 0)].map(|(v, other)| (v, BendEntry { other, forward: 1.0, backward: 1.0 }));
    let spokes = Csr::new(301, (1..301).flat_map(spoke));
    for (room, fits) in [(200, false), (400, true)] {
        assert_eq!(BendTiles::new(&cloth.rest, &spokes, 1, TileSize { own: 64, room, bytes: usize::MAX }, None).is_some(), fits);
    }
}
