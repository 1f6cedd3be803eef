//! Compares the cloth of `rapier3d` 0.36.1 with cloth-deformer in contact with itself: a folded sheet of 40 x 40 vertices that comes
//! to rest on a floor, and one of 32 x 32 that falls on its edge into a heap.
//!
//! The peer has springs of 60 Hz and particles of 2.5 mm, so that both hold cloth 5 mm apart; four substeps of one iteration are
//! its default. Times are means over the frames of the bench `contact`, processor time of the thread where the system provides it.
//! Strain is `max(0, l/l0 - 1)` of the edges of triangles: its mean and its 99th percentile, averaged over the frames, and its largest
//! value in any frame. Crossings are edges through triangles, the most in any frame; `closest` is the least distance in any frame
//! between a vertex and a triangle that it does not belong to.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Contact, Deformer, Fabric, Mesh, Options, Quality};
use rapier3d::prelude as rapier;
use rapier3d::prelude::{ColliderBuilder, SoftBodyBuilder, SpringCoefficients};

use crate::{FRAME, Failure, Sheet, seconds};

#[path = "../../tests/common/crossings.rs"]
#[allow(dead_code, reason = "the tests use the rest")]
mod crossings;
#[path = "../../benches/contact/scenes.rs"]
#[allow(dead_code, reason = "the bench uses the rest")]
mod scenes;

use scenes::{Scene, scenes};

/// Substeps and iterations of the peer, and substeps of cloth-deformer; its default quality comes last.
const SETTINGS: [(usize, usize); 3] = [(4, 1), (8, 1), (20, 1)];
const SUBSTEPS: [u32; 7] = [3, 4, 5, 6, 8, 12, 20];
/// Density (kg/m2) and friction of both cloths.
const DENSITY: f32 = 0.2;
const FRICTION: f32 = 0.3;

/// A sheet with the triangles that its crossings are counted with, and its results.
struct Run {
    name: String,
    sheet: Box<dyn Sheet>,
    mesh: Mesh,
    /// Milliseconds per frame.
    frame: f64,
    strain: [f64; 3],
    crossings: usize,
    /// (m)
    closest: f64,
}

impl Run {
    fn new(name: String, sheet: impl Sheet + 'static, mesh: Mesh) -> Run {
        let closest = f64::INFINITY;
        Run { name, sheet: Box::new(sheet), mesh, frame: 0.0, strain: [0.0; 3], crossings: 0, closest }
    }

    /// Takes a step; notes its results with the given weight if it is timed.
    fn step(&mut self, weight: Option<f64>) -> Result<(), Failure> {
        let begin = seconds();
        self.sheet.step()?;
        let Some(weight) = weight else { return Ok(()) };
        self.frame += 1e3 * (seconds() - begin) * weight;
        let x = self.sheet.positions()?;
        let [mean, most, worst] = strain(&self.mesh, &x);
        self.strain = [self.strain[0] + mean * weight, self.strain[1] + most * weight, self.strain[2].max(worst)];
        self.crossings = self.crossings.max(crossings::crossings(&self.mesh, &x).len());
        self.closest = self.closest.min(crossings::closest(&self.mesh, &x));
        Ok(())
    }
}

pub(crate) fn run() -> Result<(), Failure> {
    for scene in scenes().iter().filter(|scene| ["fold, 40", "heap, 32"].contains(&scene.name)) {
        let mut runs = Vec::new();
        for (substeps, iterations) in SETTINGS {
            let (peer, triangles) = Peer::new(scene, substeps, iterations);
            let mesh = Mesh { positions: scene.mesh.positions.clone(), triangles };
            runs.push(Run::new(format!("rapier3d {substeps} x {iterations}"), peer, mesh));
        }
        let settings = SUBSTEPS.map(|substeps| (format!("cloth-deformer {substeps}"), Quality::Substeps(substeps)));
        for (name, quality) in settings.into_iter().chain([("cloth-deformer, default".to_owned(), Quality::default())]) {
            runs.push(Run::new(name, Ours::new(scene, quality)?, scene.mesh.clone()));
        }
        let [before, timed] = scene.frames;
        for frame in 0..before + timed {
            runs.iter_mut().try_for_each(|run| run.step((frame >= before).then(|| 1.0 / f64::from(timed))))?;
        }
        println!("| {} | ms | times faster | strain, mean | 99 % | worst | crossings | closest, mm |", scene.name);
        println!("|---|---|---|---|---|---|---|---|");
        for Run { name, frame, strain: [mean, most, worst], crossings, closest, .. } in &runs {
            let (faster, closest) = (runs[0].frame / frame, 1e3 * closest);
            println!("| {name} | {frame:.1} | {faster:.1} | {mean:.1e} | {most:.4} | {worst:.3} | {crossings} | {closest:.2} |");
        }
    }
    Ok(())
}

/// The mean, the 99th percentile and the largest strain of edges.
fn strain(mesh: &Mesh, x: &[Vec3]) -> [f64; 3] {
    let length = |x: &[Vec3], [a, b]: [u32; 2]| x[a as usize].as_dvec3().distance(x[b as usize].as_dvec3());
    let stretch = |&edge: &[u32; 2]| (length(x, edge) / length(&mesh.positions, edge) - 1.0).max(0.0);
    let mut all: Vec<f64> = mesh.edges().iter().map(stretch).collect();
    all.sort_by(f64::total_cmp);
    let last = all.len() - 1;
    [all.iter().sum::<f64>() / all.len() as f64, all[last * 99 / 100], all[last]]
}

struct Ours(Deformer, Attributes);

impl Ours {
    fn new(scene: &Scene, quality: Quality) -> Result<Ours, Failure> {
        let options = Options {
            backend: Backend::Cpu,
            quality,
            fabric: Fabric { density: DENSITY, stretch: 5000.0, bending: 1e-4, damping: 0.03 },
            contact: Some(Contact { friction: FRICTION, ..Contact::default() }),
            ..Options::default()
        };
        let mut cloth = Deformer::new(&scene.mesh, options)?;
        if let Some(start) = &scene.start {
            cloth.set_state(start, &vec![Vec3::ZERO; start.len()])?;
        }
        Ok(Ours(cloth, Attributes { colliders: scene.colliders.clone(), ..Attributes::default() }))
    }
}

impl Sheet for Ours {
    fn step(&mut self) -> Result<(), Failure> {
        self.0.step(FRAME, &self.1)?;
        Ok(())
    }

    fn positions(&mut self) -> Result<Vec<Vec3>, Failure> {
        Ok(self.0.positions()?.to_vec())
    }
}

#[derive(Default)]
struct World {
    parameters: rapier::IntegrationParameters,
    islands: rapier::IslandManager,
    broad: rapier::BroadPhaseBvh,
    narrow: rapier::NarrowPhase,
    bodies: rapier::RigidBodySet,
    colliders: rapier::ColliderSet,
    joints: rapier::ImpulseJointSet,
    multibodies: rapier::MultibodyJointSet,
    cloths: rapier::SoftBodySet,
    ccd: rapier::CCDSolver,
}

struct Peer {
    world: World,
    pipeline: rapier::PhysicsPipeline,
    cloth: rapier::SoftBodyHandle,
}

impl Peer {
    /// Also returns its triangles.
    fn new(scene: &Scene, substeps: usize, iterations: usize) -> (Peer, Vec<[u32; 3]>) {
        let mut world = World::default();
        world.parameters.dt = FRAME;
        world.parameters.num_solver_iterations = substeps;
        world.parameters.num_internal_pgs_iterations = iterations;
        let floor = ColliderBuilder::cuboid(5.0, 0.5, 5.0).translation(rapier::Vector::new(0.0, -0.5, 0.0));
        world.colliders.insert(floor.friction(FRICTION));
        let n = scene.mesh.positions.len().isqrt();
        let side = 1.0 / (n - 1) as f32;
        let builder = SoftBodyBuilder::cloth(rapier::Vector::ZERO, side * rapier::Vector::Z, side * rapier::Vector::X, n, n)
            .mass(DENSITY)
            .softness(SpringCoefficients { natural_frequency: 60.0, damping_ratio: 1.0 })
            .self_contacts(true)
            .particle_radius(0.0025)
            .surface_collider(ColliderBuilder::ball(0.05).friction(FRICTION));
        let triangles = builder.surface.clone();
        let cloth = world.cloths.insert(builder, &mut world.bodies, &mut world.colliders);
        let start = scene.start.as_ref().unwrap_or(&scene.mesh.positions);
        let body = world.cloths.get_mut(cloth).expect("it was inserted");
        for (particle, x) in start.iter().enumerate() {
            body.set_particle_position(particle, rapier::Vector::from_array(x.to_array()));
        }
        (Peer { world, pipeline: rapier::PhysicsPipeline::new(), cloth }, triangles)
    }
}

impl Sheet for Peer {
    fn step(&mut self) -> Result<(), Failure> {
        let World { parameters, islands, broad, narrow, bodies, colliders, joints, multibodies, cloths, ccd } = &mut self.world;
        let down = rapier::Vector::new(0.0, -9.81, 0.0);
        self.pipeline.step(
            down,
            parameters,
            islands,
            broad,
            narrow,
            bodies,
            colliders,
            joints,
            multibodies,
            cloths,
            ccd,
            &(),
            &(),
        );
        Ok(())
    }

    fn positions(&mut self) -> Result<Vec<Vec3>, Failure> {
        let cloth = self.world.cloths.get(self.cloth).ok_or("the cloth is gone")?;
        Ok(cloth.particle_positions().map(|x| Vec3::from_array(x.to_array())).collect())
    }
}
