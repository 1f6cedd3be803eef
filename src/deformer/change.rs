//! What may be changed while the cloth moves, besides the quality: its fabric, its masses, its pins.

use glam::{Vec3, Vec4};

use super::Deformer;
use crate::error::ChangeError;
use crate::fabric::Fabric;
use crate::model::cloth::{Change, Cloth};
use crate::multigrid::hierarchy::Hierarchy;
use crate::options::Options;
use crate::step::motion::Motion;
use crate::step::watch::{Led, Watch};

impl Deformer {
    /// Changes the fabric from the next step on; [`Deformer::reset`] keeps it.
    ///
    /// Positions and velocities stay: cloth that is stretched and made stiffer is let go from there. Coefficients and levels are computed
    /// anew, in less time than it took to make the cloth; on a GPU only buffers are written, unless the density changes, which changes
    /// masses ([`Deformer::set_mass`]).
    ///
    /// # Errors
    /// If a number is out of its range, or the GPU failed.
    pub fn set_fabric(&mut self, fabric: Fabric) -> Result<(), ChangeError> {
        self.change(Options { fabric, ..self.options.clone() })
    }

    /// Changes the mass (kg) of each vertex, in the mesh's order, from the next step on; `None`: by the fabric's density.
    /// [`Deformer::reset`] keeps it. Velocities stay, not momenta.
    ///
    /// Takes about half as long as it took to make the cloth, mesh and order being there. On a GPU it waits for the steps so far, reads them back and
    /// makes new tables; the buffers of `Deformer::surface` and `position_buffer` stay the same.
    ///
    /// # Errors
    /// If there is not a finite mass above 0 for each vertex, or the GPU failed.
    pub fn set_mass(&mut self, mass: Option<Vec<f32>>) -> Result<(), ChangeError> {
        self.change(Options { mass, ..self.options.clone() })
    }

    /// Changes which vertices are pinned from the next step on, by the mesh's indices; [`Deformer::reset`] keeps it, and brings them back to
    /// where they are at rest. A vertex is pinned where it is; one that is let go has the velocity that it was led by, and falls from there.
    /// From then on [`Attributes::pin_targets`](crate::Attributes::pin_targets) are in the order of this list.
    ///
    /// Costs as much as [`Deformer::set_mass`], and where an edge comes to lie between two pins, or no longer does, about as much as making the
    /// cloth: the order of its edges is another.
    ///
    /// # Errors
    /// If a vertex is not there, or named twice, or the GPU failed.
    pub fn set_pinned(&mut self, pinned: Vec<u32>) -> Result<(), ChangeError> {
        self.change(Options { pinned, ..self.options.clone() })
    }

    fn change(&mut self, options: Options) -> Result<(), ChangeError> {
        let (cloth, change) = self.cloth.changed(&options)?;
        self.look_back()?;
        let (mut x, mut p) = (Vec::new(), Vec::new());
        if change != Change::Stiffness {
            // What steps have failed so far on a GPU is told here.
            self.positions()?;
            let read = self.engine.read(|from_x, from_p| {
                x.extend(from_x.iter().zip(&cloth.rest).map(|(x, rest)| x.truncate().extend(rest.w)));
                p.extend_from_slice(from_p);
            });
            read.map_err(|failure| self.failed(failure))?;
        }
        let changed = self.engine.change(&cloth, &options, change, [&x, &p]);
        changed.map_err(|failure| self.failed(failure))?;
        if change != Change::Stiffness {
            self.repin(&cloth, &x);
        }
        self.rates = self.rates.changed(&cloth, &options);
        self.watch = Watch::new(&cloth, &options).with_past(&self.watch);
        self.meeting = (self.watch, Led::default());
        (self.hierarchy, self.coefficients) = (Hierarchy::default(), None);
        (self.cloth, self.options, self.shown) = (cloth, options, false);
        self.wake();
        Ok(())
    }

    /// Notes where the pins are, and how they were led, of which those that stay know.
    fn repin(&mut self, cloth: &Cloth, x: &[Vec4]) {
        let Motion { pins, pin_velocities, .. } = &self.motion;
        let before = |vertex: &u32| self.cloth.pinned.iter().position(|pin| pin == vertex);
        let place: Vec<Option<usize>> = cloth.pinned.iter().map(before).collect();
        let at = |(place, &vertex): (&Option<usize>, &u32)| place.map_or(x[vertex as usize].truncate(), |place| pins[place]);
        let pins = place.iter().zip(&cloth.pinned).map(at).collect();
        let velocity = |place: &Option<usize>| place.map_or(Vec3::ZERO, |place| pin_velocities[place]);
        let pin_velocities = match pin_velocities.is_empty() {
            true => Vec::new(),
            false => place.iter().map(velocity).collect(),
        };
        (self.motion.pins, self.motion.pin_velocities) = (pins, pin_velocities);
    }
}
