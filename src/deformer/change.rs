//! Changes of fabric, masses and pins between steps.

use glam::{Vec3, Vec4};

use super::Deformer;
use crate::error::ChangeError;
use crate::model::cloth::{Change, Cloth};
use crate::multigrid::hierarchy::Hierarchy;
use crate::options::Fabric;
use crate::options::Options;
use crate::step::motion::Motion;
use crate::step::watch::Watch;

impl Deformer {
    /// Changes the fabric from the next step on; [`Deformer::reset`] keeps the change.
    ///
    /// Positions and velocities stay, so cloth that is stretched and becomes stiffer contracts from where it is.
    /// Coefficients are recomputed, in less time than building the cloth; coarse levels stay. On a GPU this only writes
    /// buffers, unless the density changes, which changes the masses (see [`Deformer::set_mass`]). Where masses were given for each
    /// vertex, they stay, and the density has no effect.
    ///
    /// # Errors
    /// If a number is out of its range, or the GPU failed.
    pub fn set_fabric(&mut self, fabric: Fabric) -> Result<(), ChangeError> {
        self.change(Options { fabric, ..self.options.clone() })
    }

    /// Changes the mass (kg) of each vertex, in the mesh's order, from the next step on; `None` derives the masses from
    /// the fabric's density. [`Deformer::reset`] keeps the change. Velocities stay, so momentum changes.
    ///
    /// This takes about half as long as building the cloth, because mesh and vertex order are kept. On a GPU it waits
    /// for the submitted steps, reads the state back and uploads new tables; the buffers of `Deformer::surface` and
    /// `position_buffer` stay the same.
    ///
    /// # Errors
    /// If there is not one finite mass above 0 for each vertex, or the GPU failed.
    pub fn set_mass(&mut self, mass: Option<Vec<f32>>) -> Result<(), ChangeError> {
        self.change(Options { mass, ..self.options.clone() })
    }

    /// Changes which vertices are pinned from the next step on, as indices of the mesh; [`Deformer::reset`] keeps the
    /// change and moves the pins to their rest positions. A vertex is pinned where it is. A released vertex keeps the
    /// velocity that its pin had, unless it has no edges and thus stays where it is. From then on
    /// [`Attributes::pin_targets`](crate::Attributes::pin_targets) are in the order of this list.
    ///
    /// This takes as long as [`Deformer::set_mass`]. If an edge between two pins appears or disappears it takes about
    /// as long as building the cloth, because the edges are colored again.
    ///
    /// # Errors
    /// If an index is out of range or appears twice, or the GPU failed.
    pub fn set_pinned(&mut self, pinned: Vec<u32>) -> Result<(), ChangeError> {
        self.change(Options { pinned, ..self.options.clone() })
    }

    /// Continues with other options. Where none differs nothing happens, so that a caller may set them in every frame.
    fn change(&mut self, options: Options) -> Result<(), ChangeError> {
        let Options { fabric, mass, pinned, .. } = &self.options;
        if (fabric, mass, pinned) == (&options.fabric, &options.mass, &options.pinned) {
            return Ok(());
        }
        let bends_alike = fabric.bending == options.fabric.bending;
        let (cloth, change) = self.cloth.changed(&options)?;
        self.check_late_failure()?;
        let [mut x, mut p] = if change == Change::Stiffness { [Vec::new(), Vec::new()] } else { self.read_state()? };
        x.iter_mut().zip(&cloth.rest).for_each(|(x, rest)| x.w = rest.w);
        self.release(&cloth, &mut p);
        cloth.stop_loose(&mut p);
        let changed = self.engine.change(&cloth, &options, change, [&x, &p]);
        changed.map_err(|failure| self.failed(failure))?;
        if change != Change::Stiffness {
            self.repin(&cloth, &x);
            self.hierarchy = Hierarchy::default();
        }
        self.rates = self.rates.changed(&cloth, &options);
        self.state.watch = Watch::new(&cloth, &options).with_past(&self.state.watch);
        self.state.controller = if bends_alike { self.state.controller } else { self.state.controller.afresh() }.changed();
        self.coefficients = None;
        (self.cloth, self.options, self.is_current) = (cloth, options, false);
        self.wake();
        Ok(())
    }

    /// Changes the displacements (m) of pins that are let go into those of free vertices, which are of half a substep ago. Those of pins
    /// that no step has led yet still are.
    fn release(&self, cloth: &Cloth, p: &mut [Vec4]) {
        let motion = &self.state.motion;
        for vertex in self.cloth.pinned.iter().filter(|vertex| motion.new_pins.binary_search(vertex).is_err()) {
            if let Some(p) = p.get_mut(*vertex as usize).filter(|_| cloth.rest[*vertex as usize].w > 0.0) {
                *p = motion.lagging(p.truncate()).extend(p.w);
            }
        }
    }

    /// Updates the pins' positions and velocities; pins that stay keep theirs.
    fn repin(&mut self, cloth: &Cloth, x: &[Vec4]) {
        let Motion { pins, pin_velocities, new_pins, .. } = &self.state.motion;
        let is_new = |vertex: &u32| self.cloth.rest[*vertex as usize].w > 0.0 || new_pins.binary_search(vertex).is_ok();
        let mut new_pins: Vec<u32> = cloth.pinned.iter().copied().filter(is_new).collect();
        new_pins.sort_unstable();
        let mut before = vec![None; x.len()];
        self.cloth.pinned.iter().enumerate().for_each(|(slot, &vertex)| before[vertex as usize] = Some(slot));
        let slots: Vec<Option<usize>> = cloth.pinned.iter().map(|&vertex| before[vertex as usize]).collect();
        let at = |(slot, &vertex): (&Option<usize>, &u32)| slot.map_or(x[vertex as usize].truncate(), |slot| pins[slot]);
        let pins = slots.iter().zip(&cloth.pinned).map(at).collect();
        // The first pins of cloth that moves as a whole stop it.
        let course = self.state.motion.course_of_free(&self.cloth);
        let velocity = |slot: &Option<usize>| slot.map_or(course, |slot| pin_velocities.get(slot).copied().unwrap_or_default());
        let pin_velocities =
            if pin_velocities.is_empty() && course == Vec3::ZERO { Vec::new() } else { slots.iter().map(velocity).collect() };
        let motion = &mut self.state.motion;
        (motion.pins, motion.pin_velocities, motion.new_pins) = (pins, pin_velocities, new_pins);
    }
}
