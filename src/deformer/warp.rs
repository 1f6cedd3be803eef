//! Moving the whole cloth at once without accelerating it.

use glam::{Affine3A, Vec4};

use super::Deformer;
use crate::deformer::imperfection::FlatStart;
use crate::error::WarpError;
use crate::kernels::limits::is_bounded;
use crate::kernels::rigid::Rigid;
use crate::step::motion::{Ambient, Whereabouts};

impl Deformer {
    /// Moves the cloth and its pins rigidly, as for a character that is teleported. `motion` maps world positions (m)
    /// to world positions; velocities rotate with it. Nothing is stretched or accelerated, and the next step continues
    /// as it would have if everything else had moved along.
    ///
    /// Colliders are not moved: those of the next step are taken as placed where they are, without a velocity. The
    /// [`Attributes::pin_targets`](crate::Attributes::pin_targets) of the next step must be at or near the new
    /// positions of the pins. The rest shape, to which [`Deformer::reset`] returns, stays where it is, and so does
    /// [`Deformer::origin`]: 10 km from it, positions are rounded to a millimeter, and undamped cloth trembles and gains energy. Build
    /// a cloth that is to stay there from a mesh that is there.
    ///
    /// This takes less time than a step. On a GPU it waits for the submitted steps, reads the state back and writes it.
    ///
    /// # Errors
    /// [`WarpError::NotRigid`] if the motion scales, shears or mirrors by more than rounding, [`WarpError::TooFar`] if
    /// a vertex would be beyond 1e15 m, and those of [`Deformer::positions`]. The cloth is then unchanged.
    pub fn warp(&mut self, motion: Affine3A) -> Result<(), WarpError> {
        let rigid = Rigid::new(motion, self.cloth.origin);
        let rigid = rigid.map_err(|problem| WarpError::NotRigid { problem, motion: Box::new(motion) })?;
        let [mut x, mut p] = self.read_state()?;
        let mut past = self.engine.past().map_err(|failure| self.failed(failure))?;
        rigid.points4(&mut x);
        rigid.vectors4(&mut p);
        let is_out = |x: &Vec4| !is_bounded(x.truncate());
        if let Some(place) = x.iter().position(is_out) {
            return Err(WarpError::TooFar { vertex: self.cloth.order[place] as usize });
        }
        past.pending.iter_mut().for_each(|seen| seen.warp(&rigid));
        past.contact.iter_mut().for_each(|contact| contact.warp(&rigid));
        let resumed = self.engine.resume(&self.cloth, &self.options, [&x, &p], &past);
        resumed.map_err(|failure| self.failed(failure))?;
        self.flat_start = self.flat_start.take().and_then(|_| FlatStart::placed(&x, &p, &self.cloth));
        self.state.motion.pins.iter_mut().for_each(|pin| *pin = rigid.point(*pin));
        self.state.motion.pin_velocities.iter_mut().for_each(|velocity| *velocity = rigid.vector(*velocity));
        let turned = |ambient: Ambient| Ambient { acceleration: rigid.vector(ambient.acceleration), ..ambient };
        self.state.motion.ambient = self.state.motion.ambient.map(turned).filter(Ambient::is_finite);
        self.state.motion.course = rigid.vector(self.state.motion.course);
        let course = self.state.motion.last_drift(&self.cloth);
        self.state.motion.placed = self.state.motion.placed.map(|_| Whereabouts::of(&x, &p, course));
        self.state.motion.colliders.clear();
        self.state.seen.iter_mut().for_each(|seen| seen.warp(&rigid));
        self.wake();
        (self.is_current, self.has_arrived) = (false, false);
        Ok(())
    }
}
