//! Reading and setting the state, in the mesh's vertex order.

use glam::{DVec3, Vec3, Vec4};

use super::Deformer;
use crate::attributes::{Attributes, Collider};
#[cfg(feature = "gpu")]
use crate::backend::Engine;
#[cfg(feature = "gpu")]
use crate::binding::{BindError, Binding};
use crate::contact::crossings::Features;
use crate::deformer::imperfection::FlatStart;
use crate::deformer::measure::Measure;
use crate::error::StepError;
use crate::error::failure::Failure;
#[cfg(feature = "gpu")]
use crate::gpu::{BoundMesh, Surface};
use crate::kernels::limits::is_bounded;
use crate::model::mesh::edges;
use crate::options::Crossing;
use crate::step::motion::Motion;

impl Deformer {
    /// Positions (m), one per vertex, in the mesh's order. Reads them back from the GPU if they changed.
    ///
    /// # Errors
    /// If the GPU was lost, or a step since the last read became unstable.
    pub fn positions(&mut self) -> Result<&[Vec3], StepError> {
        self.refresh_positions()?;
        Ok(&self.positions)
    }

    /// Requests the positions after the steps so far, without waiting for them. More steps may be queued meanwhile;
    /// [`Deformer::requested_positions`] returns the positions once they have arrived. A previous request that was not
    /// taken is dropped, and so is one when the state is set, reset, restored or warped.
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn request_positions(&mut self) -> Result<(), StepError> {
        let under_way = self.engine.request();
        let under_way = under_way.map_err(|failure| self.failed(failure))?;
        self.has_arrived = !under_way;
        if !under_way {
            self.refresh_positions()?;
            self.requested.clone_from(&self.positions);
        }
        Ok(())
    }

    /// The positions (m) last requested, one per vertex, in the mesh's order. Each request is returned once; `None`
    /// before it has arrived, or if there was none. Never waits, unless a step has failed.
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn requested_positions(&mut self) -> Result<Option<&[Vec3]>, StepError> {
        let (cloth, requested) = (&self.cloth, &mut self.requested);
        let arrived = self.engine.arrived(|x| {
            requested.resize(x.len(), Vec3::ZERO);
            cloth.order.iter().zip(x).for_each(|(&vertex, x)| requested[vertex as usize] = x.truncate() + cloth.origin);
        });
        match arrived {
            Ok(arrived) => self.has_arrived |= arrived,
            Err(failure) => {
                // Reading the state finds the same failure, and resets where the next step starts from.
                let error = self.failed(failure);
                return Err(self
                    .refresh_positions()
                    .err()
                    .filter(|error| matches!(error, StepError::Unstable { .. }))
                    .unwrap_or(error));
            }
        }
        Ok(std::mem::take(&mut self.has_arrived).then_some(&*self.requested))
    }

    /// Velocities (m/s), one per vertex, in the mesh's order, as of half a substep ago (leapfrog).
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn velocities(&mut self) -> Result<&[Vec3], StepError> {
        self.refresh_positions()?;
        Ok(&self.velocities)
    }

    /// Sets the state: positions (m) and velocities (m/s), one per vertex, in the mesh's order. Pins are held where
    /// this puts them; the velocities of pins only say how fast targets led them here. The rest shape does not change.
    /// The velocities are taken as of the time of the positions. Those of [`Deformer::velocities`] are half a substep older, so
    /// that setting them again loses what accelerates the cloth in that time: to continue a motion, use [`Deformer::snapshot`].
    /// Colliders are forgotten: those of the next step have no velocity unless [`Deformer::place_colliders`] is called again.
    ///
    /// # Errors
    /// If a list has the wrong length, or a value is not finite or beyond 1e15, as it is or relative to
    /// [`Deformer::origin`]; the state is then unchanged.
    pub fn set_state(&mut self, positions: &[Vec3], velocities: &[Vec3]) -> Result<(), StepError> {
        let vertices = self.cloth.rest.len();
        for (name, list, origin) in [("positions", positions, self.cloth.origin), ("velocities", velocities, Vec3::ZERO)] {
            let problem = if list.len() == vertices {
                let index = list.iter().position(|value| !(is_bounded(*value) && is_bounded(*value - origin)));
                index.map(|index| format!("[{index}] is {}", list[index]))
            } else {
                Some(format!("{} values", list.len()))
            };
            if let Some(problem) = problem {
                return Err(StepError::State { name, problem, vertices });
            }
        }
        let cloth = &self.cloth;
        let local = |vertex: u32| positions[vertex as usize] - cloth.origin;
        let x: Vec<Vec4> = cloth.order.iter().zip(&cloth.rest).map(|(&vertex, rest)| local(vertex).extend(rest.w)).collect();
        self.set_local(&x, velocities, 0.0);
        Ok(())
    }

    /// Sets the state: local positions (m) in the cloth's order, and velocities (m/s) in the mesh's, as of the middle of a substep of `h`
    /// (s) that ends now; of this time, if that is 0.
    pub(super) fn set_local(&mut self, x: &[Vec4], velocities: &[Vec3], h: f32) {
        let cloth = &self.cloth;
        let mut p: Vec<Vec4> = cloth.order.iter().map(|&vertex| velocities[vertex as usize].extend(0.0)).collect();
        cloth.stop_loose(&mut p);
        self.state.motion = Motion::placed(cloth, x, &p);
        self.state.watch = self.state.watch.placed(cloth, x, &p);
        self.state.motion.h = h;
        let unit = self.state.motion.unit();
        p.iter_mut().for_each(|p| *p = (p.truncate() * unit).extend(h));
        self.engine.set(x, &p);
        self.flat_start = FlatStart::placed(x, &p, &self.cloth);
        self.forget();
        self.is_current = false;
    }

    /// Sets where the colliders are now, so that the next step moves them from there. Without this, those of the first step
    /// arrive without a velocity. For a scene that begins in motion, call it once before the first step with the colliders
    /// at time 0; the first step is then given those at its end.
    ///
    /// # Errors
    /// If a value is out of its range, as in [`Deformer::step`]; nothing then changes.
    pub fn place_colliders(&mut self, colliders: &[Collider]) -> Result<(), StepError> {
        let attributes = Attributes { colliders: colliders.to_vec(), ..Attributes::default() };
        attributes.validate(0)?;
        self.state.motion.colliders = attributes.colliders;
        self.wake();
        Ok(())
    }

    /// Strain, energy and penetration of the current state.
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn measure(&mut self) -> Result<Measure, StepError> {
        self.refresh_positions()?;
        let cloth = &self.cloth;
        let x: Vec<DVec3> = self.local.iter().map(|x| x.truncate().as_dvec3()).collect();
        let v: Vec<DVec3> = cloth.order.iter().map(|&v| self.velocities[v as usize].as_dvec3()).collect();
        // A mesh collider has no inside.
        let solid = self.state.motion.colliders.iter().filter(|collider| collider.shape.mesh().is_none());
        let colliders: Vec<Collider> = solid.map(|collider| collider.relative_to(cloth.origin)).collect();
        Ok(Measure::new(cloth, f64::from(self.options.fabric.bending), &x, &v, self.state.gravity, &colliders))
    }

    /// The edges of the cloth that pass through its triangles, computed in double precision, whether
    /// [`Options::contact`](crate::Options::contact) is set or not. Crossings that would disappear if the cloth moved by a
    /// ten-thousandth of the contact thickness count as touching and are left out. The time grows as the power 1.5 of the
    /// number of vertices, and as the square of the number of triangles that meet at a vertex.
    ///
    /// # Errors
    /// Those of [`Deformer::positions`], and [`StepError::Crowded`].
    pub fn crossings(&mut self) -> Result<Vec<Crossing>, StepError> {
        self.refresh_positions()?;
        let triangles = &self.cloth.triangles;
        let edges = edges(triangles);
        let (x, thickness) = (&self.local, self.options.contact.unwrap_or_default().thickness);
        let features =
            Features { edges: &edges, triangles, x, cloth_vertices: x.len(), thickness, has_self_contact: true, is_shared: true };
        let found = features.crossings().map_err(|pairs| StepError::Crowded { pairs })?;
        let crossing = |&[edge, triangle]: &[u32; 2]| {
            let crossing = Crossing { edge: edges[edge as usize], triangle: triangles[triangle as usize] };
            crossing.named(&self.cloth.order)
        };
        Ok(found.iter().map(crossing).collect())
    }

    /// Waits until all submitted steps are done, without reading anything back: for timing, and for renderers that use
    /// `Deformer::position_buffer` on another queue. On the CPU it returns at once.
    ///
    /// # Errors
    /// If the GPU was lost.
    pub fn wait(&self) -> Result<(), StepError> {
        match &self.engine {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.wait().map_err(|failure| self.failed(failure)),
            _ => Ok(()),
        }
    }

    /// The positions on the GPU, for a renderer on the same device (usages `VERTEX`, `STORAGE`, `COPY_SRC`): one
    /// `vec4<f32>` per vertex, whose xyz is the position (m) minus [`Deformer::origin`], in the order of
    /// [`Deformer::vertex_order`]. `None` unless the backend is [`Backend::Gpu`](crate::Backend::Gpu).
    /// [`Deformer::surface`] has normals and indices as well.
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn position_buffer(&self) -> Option<&wgpu::Buffer> {
        match &self.engine {
            Engine::Gpu(gpu) => Some(&gpu.forces.states[0].x),
            _ => None,
        }
    }

    /// The buffers that a renderer on the same device draws the cloth from: positions, normals and indices, without a
    /// copy through the CPU. `None` unless the backend is [`Backend::Gpu`](crate::Backend::Gpu).
    ///
    /// Call it in each frame: it submits the computation of the normals after the steps so far. Submit the draw to the
    /// same queue, after this call and before the next one that changes the cloth: a step, `reset`, `restore`, `warp` and so
    /// on. The first call builds what it needs, so a cloth that is never drawn pays nothing.
    ///
    /// # Errors
    /// If the GPU was lost, or has no memory left.
    #[cfg(feature = "gpu")]
    pub fn surface(&mut self) -> Result<Option<Surface>, StepError> {
        match &mut self.engine {
            Engine::Gpu(gpu) => {
                let surface = gpu.surface(&self.cloth);
                surface.map(Some).map_err(|failure| self.failed(failure))
            }
            _ => Ok(None),
        }
    }

    /// Binds a render mesh to the cloth on its GPU. `binding` must have been made for the mesh of this deformer.
    /// [`BoundMesh::apply`] then computes the positions that [`Binding::apply`] would, without a copy through the CPU.
    /// Returns `None` unless the backend is [`Backend::Gpu`](crate::Backend::Gpu).
    ///
    /// # Errors
    /// If the binding was made for a mesh with another number of vertices, or the GPU was lost or has no room.
    #[cfg(feature = "gpu")]
    pub fn bind(&self, binding: &Binding) -> Result<Option<BoundMesh>, BindError> {
        let vertices = binding.vertices_on_gpu(&self.cloth.order)?;
        match &self.engine {
            Engine::Gpu(gpu) => {
                let bound = gpu.bind(&self.cloth, &vertices, binding.has_normals());
                bound.map(Some).map_err(|fault| BindError::Gpu { reason: fault.reason() })
            }
            _ => Ok(None),
        }
    }

    /// Fails if the GPU has reported by now that a previous step failed, and reads the state it returned to.
    pub(super) fn check_late_failure(&mut self) -> Result<(), StepError> {
        let has_failed = self.engine.has_failed_late();
        if has_failed.map_err(|failure| self.failed(failure))? {
            self.is_current = false;
            self.refresh_positions()?;
        }
        Ok(())
    }

    /// The positions and displacements (m) in the cloth's order. Reports a step that failed on the GPU, if any, and returns to the
    /// state before it.
    pub(super) fn read_state(&mut self) -> Result<[Vec<Vec4>; 2], StepError> {
        self.check_late_failure()?;
        self.refresh_positions()?;
        let mut state = [Vec::new(), Vec::new()];
        let read = self.engine.read(|x, p| state = [x.to_vec(), p.to_vec()]);
        read.map_err(|failure| self.failed(failure))?;
        Ok(state)
    }

    /// Updates `positions`, `velocities` and `local`.
    pub(super) fn refresh_positions(&mut self) -> Result<(), StepError> {
        if self.is_current {
            return Ok(());
        }
        let (last_h, read) = self.read_engine();
        if let Err(failure) = read {
            // The GPU has returned to its last good state, and the next step starts from there.
            self.state.motion = last_h.map_or_else(|| self.state.motion.clone(), |h| Motion::after(&self.cloth, &self.local, h));
            return Err(self.failed(failure));
        }
        self.is_current = true;
        Ok(())
    }

    /// After a step that has found out that an earlier one failed: the GPU has returned to the state before that.
    pub(super) fn start_from_engine_state(&mut self) {
        if let (Some(h), _) = self.read_engine() {
            self.state.motion = Motion::after(&self.cloth, &self.local, h);
        }
    }

    /// Reads the state, and the duration (s) of the substep that led to it, if it can be read.
    fn read_engine(&mut self) -> (Option<f32>, Result<(), Failure>) {
        let cloth = &self.cloth;
        let unit = self.state.motion.unit();
        let (positions, velocities, local) = (&mut self.positions, &mut self.velocities, &mut self.local);
        let mut last_h = None;
        let read = self.engine.read(|x, p| {
            local.clear();
            local.extend_from_slice(x);
            last_h = Some(p[0].w);
            for (&vertex, (x, p)) in cloth.order.iter().zip(x.iter().zip(p)) {
                positions[vertex as usize] = x.truncate() + cloth.origin;
                velocities[vertex as usize] = p.truncate() / unit;
            }
        });
        (last_h, read)
    }
}
