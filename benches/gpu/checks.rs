//! Checks that must pass before anything is timed.

use std::path::Path;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Gpu, Mesh, Options, Quality};

use crate::Failure;
use crate::hang::{FRAME, make, scene, sheet};
#[allow(dead_code, unreachable_pub, reason = "the tests' own")]
#[path = "../../tests/common/reference.rs"]
mod reference;

/// The available backends.
pub(crate) struct Checks<'a> {
    pub(crate) backends: &'a [Backend],
    pub(crate) gpu: Option<&'a Gpu>,
    good: bool,
}

impl<'a> Checks<'a> {
    pub(crate) fn new(backends: &'a [Backend], gpu: Option<&'a Gpu>) -> Checks<'a> {
        Checks { backends, gpu, good: true }
    }

    /// Runs and prints all checks. Returns whether all pass.
    pub(crate) fn run(mut self, mesh: Option<&Path>, quick: bool) -> Result<bool, Failure> {
        println!("| check | backend | figure | bound | |\n|---|---|---|---|---|");
        self.agree("grid 41", &Mesh::grid(41, 41, 1.0, 1.0))?;
        if let Some(path) = mesh {
            self.agree("mesh", &Mesh::load_obj(path)?)?;
        }
        for n in if quick { vec![32] } else { vec![32, 100, 300] } {
            self.falls_alike(n)?;
        }
        for (n, substeps, bound) in [(32, 80, 0.9e-4), (64, 160, 1.5e-4), (128, 320, 2.4e-4)] {
            if !quick || n == 32 {
                self.follows_the_reference(n, substeps, bound)?;
            }
        }
        Ok(self.good)
    }

    fn others(&self) -> Vec<Backend> {
        self.backends.iter().copied().filter(|&backend| backend != Backend::Cpu).collect()
    }

    fn check(&mut self, name: &str, backend: Backend, figure: f64, bound: f64) {
        let holds = figure <= bound;
        self.good &= holds;
        println!("| {name} | {backend:?} | {figure:.2e} | {bound:.1e} | {} |", if holds { "ok" } else { "**FAILS**" });
    }

    /// Wind, bending, damping and pins for 16 frames: the backends agree with one another, and each with itself.
    fn agree(&mut self, name: &str, mesh: &Mesh) -> Result<(), Failure> {
        let (cpu, moved) = self.blown(mesh, Backend::Cpu, 0.0)?;
        // The effect of one rounding on the scene; different machines cannot agree better than that.
        let rounded = rms(&cpu, &self.blown(mesh, Backend::Cpu, 3e-8)?.0) / moved;
        self.check(&format!("{name}: start moved by 3e-8 m, over {moved:.2} m moved"), Backend::Cpu, rounded, 2e-3);
        for backend in self.others() {
            let other = self.blown(mesh, backend, 0.0)?.0;
            self.check(&format!("{name}: apart from the CPU, over {moved:.2} m moved"), backend, rms(&cpu, &other) / moved, 2e-3);
        }
        for &backend in self.backends {
            let again = self.blown(mesh, backend, 0.0)?.0 == self.blown(mesh, backend, 0.0)?.0;
            self.check(&format!("{name}: replays bit for bit"), backend, if again { 0.0 } else { 1.0 }, 0.0);
        }
        Ok(())
    }

    /// The first ten frames of HANG, before the motion becomes chaotic.
    fn falls_alike(&mut self, n: u32) -> Result<(), Failure> {
        let gpu = self.gpu;
        let fall = |backend| -> Result<Vec<Vec3>, Failure> {
            let mut deformer = sheet(n, 20, backend, gpu)?;
            play(&mut deformer, 10)?;
            Ok(deformer.positions()?.to_vec())
        };
        let cpu = fall(Backend::Cpu)?;
        let moved = rms(&cpu, &Mesh::grid(n, n, 1.0, 1.0).positions);
        for backend in self.others() {
            let apart = rms(&cpu, &fall(backend)?) / moved;
            self.check(
                &format!("HANG N = {n}, S = 20, 10 frames: apart from the CPU, over {moved:.2} m moved"),
                backend,
                apart,
                2e-3,
            );
        }
        Ok(())
    }

    /// Position error at 0.5 s relative to the f64 reference, whose step is that of the substeps at N = 32.
    fn follows_the_reference(&mut self, n: u32, substeps: u32, bound: f64) -> Result<(), Failure> {
        let (mesh, options) = scene::hang(n, substeps, Backend::Cpu);
        let masses = scene::grid_masses(n, 0.2);
        let truth = reference::Reference::new(&mesh, &masses, &options.pinned, 5000.0).run(0.5, 60 * substeps).positions();
        for &backend in self.backends.iter().filter(|&&backend| backend != Backend::Hybrid || n < 128) {
            let mut deformer = sheet(n, substeps, backend, self.gpu)?;
            play(&mut deformer, 30)?;
            let error = rms(deformer.positions()?, &truth);
            self.check(&format!("HANG N = {n}, S = {substeps}: position error"), backend, error, bound);
        }
        Ok(())
    }

    /// 16 frames of a towel on three pins in wind, with its start displaced by at most `rounding` (m): its final
    /// positions, and how far it moved (RMS, m).
    fn blown(&self, mesh: &Mesh, backend: Backend, rounding: f32) -> Result<(Vec<Vec3>, f64), Failure> {
        let last = mesh.positions.len() as u32 - 1;
        let pinned = vec![0, last / 2, last];
        let options = Options { backend, fabric: Fabric::TOWEL, quality: Quality::Substeps(20), pinned, ..Options::default() };
        let mut deformer = make(mesh, options, self.gpu)?;
        if rounding > 0.0 {
            let wave = |k: usize| Vec3::new((k as f32).sin(), (1.3 * k as f32).sin(), (1.7 * k as f32).sin());
            let moved: Vec<Vec3> = mesh.positions.iter().enumerate().map(|(k, x)| *x + rounding * wave(k)).collect();
            deformer.set_state(&moved, &vec![Vec3::ZERO; moved.len()])?;
        }
        let attributes = Attributes { wind: Vec3::new(1.0, 0.0, 2.0), air_density: 1.225, ..Attributes::default() };
        for _ in 0..16 {
            deformer.step(FRAME, &attributes)?;
        }
        let positions = deformer.positions()?.to_vec();
        let moved = rms(&positions, &mesh.positions);
        Ok((positions, moved))
    }
}

fn play(deformer: &mut Deformer, frames: u32) -> Result<(), Failure> {
    for _ in 0..frames {
        deformer.step(FRAME, &Attributes::default())?;
    }
    Ok(())
}

/// Root mean square of the distances (m) between the vertices of two results.
fn rms(a: &[Vec3], b: &[Vec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.as_dvec3().distance_squared(b.as_dvec3())).sum();
    (sum / a.len() as f64).sqrt()
}
