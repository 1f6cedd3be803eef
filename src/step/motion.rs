//! The end of the last step, from which the next one goes on.

use std::mem::{Discriminant, discriminant};

use glam::{DVec3, Vec3, Vec4};

use crate::attributes::{Attributes, Collider, Shape, invalid};
use crate::error::StepError;
use crate::kernels::limits::is_bounded;
use crate::kernels::statistics::{Statistics, unordered};
use crate::model::cloth::Cloth;
use crate::model::mesh::bounds;
use crate::record::recorded;

/// What the next step must know about the last one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motion {
    /// Its length (s). 0 if there was none, or the GPU returned to an earlier state.
    pub dt: f32,
    /// Its substep (s). 0 if there was none; the first kick then lasts half a substep (leapfrog start).
    pub h: f32,
    /// What acted on all of the cloth in it. `None` if that is not known: it is then taken to be what acts in the next step.
    pub ambient: Option<Ambient>,
    /// Its colliders, from which those of the next step move; empty if the state was set.
    pub colliders: Vec<Collider>,
    /// Positions of the pins at its end (m), in local coordinates.
    pub pins: Vec<Vec3>,
    /// The vertices that were pinned since, as places in [`Cloth::order`], ascending.
    pub new_pins: Vec<u32>,
    /// Velocities (m/s) at which the pins moved, or that they were given with a state; empty if they followed no targets.
    pub pin_velocities: Vec<Vec3>,
    /// Velocity (m/s) at which the cloth moves as a whole, as far as statistics tell: see [`Motion::observe`].
    pub course: Vec3,
    /// Where the cloth is, if its state was set and no step was taken since. After that only statistics tell.
    pub placed: Option<Whereabouts>,
}

recorded!(Motion { dt, h, ambient, colliders, pins, new_pins, pin_velocities, course, placed });

/// What acts on all of the cloth alike: gravity, and linear drag toward the wind.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Ambient {
    /// The acceleration of cloth at rest (m/s²).
    pub acceleration: Vec3,
    /// The rate (1/s) of the drag.
    pub damping: f32,
}

recorded!(Ambient { acceleration, damping });

impl Ambient {
    /// Of a step with these attributes; its acceleration is not finite if their product is not.
    pub(crate) fn of(attributes: &Attributes) -> Ambient {
        let Attributes { gravity, wind, damping, .. } = *attributes;
        Ambient { acceleration: gravity + damping * wind, damping }
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.acceleration.is_finite() && self.damping.is_finite()
    }

    /// The share of a velocity that is left after a time (s), and the velocity gained in it per unit of acceleration (s).
    pub(crate) fn decay_and_gain(&self, time: f64) -> [f64; 2] {
        let damping = f64::from(self.damping);
        let gain = if damping > 0.0 { -(-damping * time).exp_m1() / damping } else { time };
        [(-damping * time).exp(), gain]
    }
}

/// The box around the cloth (m, in local coordinates), and the speed (m/s) of its fastest vertex relative to its course.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Whereabouts {
    pub low: Vec3,
    pub high: Vec3,
    pub fastest: f32,
}

recorded!(Whereabouts { low, high, fastest });

impl Whereabouts {
    /// In a state in the cloth's order: positions (m) and velocities (m/s).
    pub(crate) fn of(x: &[Vec4], v: &[Vec4], course: Vec3) -> Whereabouts {
        let [low, high] = bounds(x.iter().map(|x| x.truncate()));
        Whereabouts { low, high, fastest: v.iter().map(|v| v.truncate().distance(course)).fold(0.0, f32::max) }
    }

    /// The box in the caller's coordinates (m).
    pub(crate) fn bounds(self, cloth: &Cloth) -> [Vec3; 2] {
        [self.low + cloth.origin, self.high + cloth.origin]
    }

    /// The box around the way of a cloth that moves by as much (m) as a whole.
    pub(crate) fn along(self, by: Vec3) -> Whereabouts {
        Whereabouts { low: self.low.min(self.low + by), high: self.high.max(self.high + by), ..self }
    }

    /// As statistics tell.
    fn seen(seen: &Statistics) -> Whereabouts {
        Whereabouts { low: unordered(seen.low), high: unordered(seen.high), fastest: f32::from_bits(seen.fastest) }
    }
}

/// Cloth that moves no faster (m/s) than this as a whole counts as staying where it is.
const LEAST_COURSE: f32 = 1.0;

impl Motion {
    /// After a state in the cloth's order, reached by substeps of `h` (s).
    pub(crate) fn after(cloth: &Cloth, x: &[Vec4], h: f32) -> Motion {
        let pins = cloth.pinned.iter().map(|&vertex| x[vertex as usize].truncate()).collect();
        Motion { h, pins, ..Motion::default() }
    }

    /// After a state that was set, in the cloth's order: positions (m) and velocities (m/s).
    pub(crate) fn placed(cloth: &Cloth, x: &[Vec4], v: &[Vec4]) -> Motion {
        let mut motion = Motion::after(cloth, x, 0.0);
        let free = v.iter().zip(&cloth.rest).take(cloth.used).filter(|(_, rest)| rest.w > 0.0);
        let (sum, count) = free.fold((DVec3::ZERO, 0), |(sum, count), (v, _)| (sum + v.truncate().as_dvec3(), count + 1));
        motion.set_course((sum / f64::from(count.max(1))).as_vec3());
        motion.pin_velocities = cloth.pinned.iter().filter_map(|&pin| v.get(pin as usize)).map(|v| v.truncate()).collect();
        Motion { placed: Some(Whereabouts::of(x, v, motion.last_drift(cloth))), ..motion }
    }

    /// The displacement (m) of a vertex half a substep ago that has become this one by now, as that of a pin is. Those of free vertices
    /// lag by that time. It stays as it is where nothing is known of the last step, or the result would be out of bounds.
    pub(crate) fn lagging(&self, displacement: Vec3) -> Vec3 {
        let Some(ambient) = self.ambient else { return displacement };
        let [decay, gain] = ambient.decay_and_gain(0.5 * f64::from(self.h));
        let before = (displacement - ambient.acceleration * (gain as f32 * self.h)) / decay as f32;
        if is_bounded(before) { before } else { displacement }
    }

    /// The course (m/s) of cloth that no pins hold, otherwise 0.
    pub(crate) fn course_of_free(&self, cloth: &Cloth) -> Vec3 {
        if cloth.has_pins() { Vec3::ZERO } else { self.course }
    }

    /// Where the cloth is, as far as it is known, given the latest statistics.
    pub(crate) fn whereabouts(&self, seen: Option<&Statistics>) -> Option<Whereabouts> {
        seen.map(Whereabouts::seen).or(self.placed)
    }

    /// Pairs each collider with the one it moves from: itself if it is new, was teleported or cannot have been that
    /// ([`Collider::is_followed_by`]). Colliders are matched by id; those without one by their order, if their kinds are the same in both lists and
    /// nothing looks like another order.
    pub(crate) fn followed<'a>(&'a self, colliders: &'a [Collider]) -> impl Iterator<Item = (&'a Collider, &'a Collider)> {
        let unnamed = |list: &'a [Collider]| list.iter().filter(|collider| collider.id.is_none());
        let mut last_unnamed = are_in_order(unnamed(&self.colliders), unnamed(colliders)).then(|| unnamed(&self.colliders));
        colliders.iter().enumerate().map(move |(index, now)| {
            let last = match now.id {
                Some(id) => self.named(index, id),
                None => last_unnamed.as_mut().and_then(Iterator::next),
            };
            (now, last.filter(|last| !now.teleported && last.is_followed_by(now)).unwrap_or(now))
        })
    }

    /// The last step's collider with this id, sought from the place on where one with this id is now: most are still there.
    fn named(&self, index: usize, id: u64) -> Option<&Collider> {
        let (before, after) = self.colliders.split_at(index.min(self.colliders.len()));
        after.iter().chain(before).find(|last| last.id == Some(id))
    }

    /// Checks that a mesh collider known from the last step still has the same triangles.
    pub(crate) fn check(&self, colliders: &[Collider]) -> Result<(), StepError> {
        let has_others = |(index, now): (usize, &Collider)| {
            let last = self.named(index, now.id?)?;
            let are_meshes = [now, last].iter().all(|collider| collider.shape.mesh().is_some());
            (are_meshes && !now.teleported && !last.is_followed_by(now)).then(|| {
                let remedy = "are not those that it had in the last step; give it another id, or say that it was teleported";
                invalid(format_args!("colliders[{index}].mesh"), "its triangles", remedy)
            })
        };
        colliders.iter().enumerate().find_map(has_others).map_or(Ok(()), Err)
    }

    /// The displacement (m) that the cloth follows in a step of `dt` (s) that leads its pins to `targets`: the mean of those
    /// with edges, and that of its course if it has none.
    pub(crate) fn drift(&self, cloth: &Cloth, targets: Option<&[Vec3]>, dt: f32) -> Vec3 {
        let moves = targets.unwrap_or_default().iter().zip(&self.pins).map(|(&to, &from)| to - cloth.origin - from);
        mean_of_pins(cloth, moves).unwrap_or(self.course * dt)
    }

    /// The same in the last step, as a velocity (m/s).
    pub(crate) fn last_drift(&self, cloth: &Cloth) -> Vec3 {
        mean_of_pins(cloth, self.pin_velocities.iter().copied()).unwrap_or(self.course)
    }

    /// Derives the course from the statistics after a step of `dt` (s) and after the one before. What all sides of the
    /// bounding box have in common is the motion of the whole: one corner that is flung moves only one side of it. It is sought in
    /// their motion relative to the last course, so that a cloth that is hit is seen alike on the ground and on a ship.
    pub(crate) fn observe(&mut self, [before, after]: [&Statistics; 2], dt: f32) {
        let [low, high] = [(before.low, after.low), (before.high, after.high)]
            .map(|(from, to)| (unordered(to) - unordered(from)) / dt - self.course);
        let slower = Vec3::select(low.abs().cmplt(high.abs()), low, high);
        self.set_course(self.course + Vec3::select((low * high).cmpgt(Vec3::ZERO), slower, Vec3::ZERO));
    }

    /// Sets the course (m/s), unless it is slow.
    pub(crate) fn set_course(&mut self, course: Vec3) {
        self.course = if course.is_finite() && course.length() > LEAST_COURSE { course } else { Vec3::ZERO };
    }

    /// Records the targets that the pins followed in a step of `dt` (s).
    pub(crate) fn record_pins(&mut self, cloth: &Cloth, targets: Option<&[Vec3]>, dt: f32) {
        self.pin_velocities.clear();
        for (pin, target) in self.pins.iter_mut().zip(targets.unwrap_or_default()) {
            let to = *target - cloth.origin;
            self.pin_velocities.push((to - *pin) / dt);
            *pin = to;
        }
    }

    /// The time (s) that displacements are divided by to give velocities: the substep, or 1 for a state whose
    /// velocities were set.
    pub(crate) fn unit(&self) -> f32 {
        if self.h > 0.0 { self.h } else { 1.0 }
    }
}

/// The mean of one value for each pin, over the pins with edges: 0 if there are no values, `None` if there are no such pins.
fn mean_of_pins(cloth: &Cloth, values: impl Iterator<Item = Vec3>) -> Option<Vec3> {
    let used = cloth.pinned.iter().zip(values).filter(|(pin, _)| cloth.is_used(**pin));
    let (count, sum) = used.fold((0, Vec3::ZERO), |(count, sum), (_, value)| (count + 1, sum + value));
    (count > 0 || cloth.has_pins()).then(|| sum / count.max(1) as f32)
}

/// A collider's way in a step, by its landmarks (m).
struct Way {
    kind: Discriminant<Shape>,
    from: [Vec3; 2],
    to: [Vec3; 2],
    length: f32,
}

impl Way {
    fn new(last: &Collider, now: &Collider) -> Way {
        let (from, to) = (last.landmarks(), now.landmarks());
        Way { kind: discriminant(&now.shape), from, to, length: distance(from, to) }
    }

    /// Whether this collider and another of its kind would have moved less if each were the other.
    fn is_longer_than_exchanged(&self, other: &Way) -> bool {
        let exchanged = distance(self.from, other.to) + distance(other.from, self.to);
        // A row of colliders that move by more than their distance ties, but for rounding.
        self.kind == other.kind && exchanged < 0.999 * (self.length + other.length)
    }
}

/// The distance (m) between landmarks, summed.
fn distance(from: [Vec3; 2], to: [Vec3; 2]) -> f32 {
    from[0].distance(to[0]) + from[1].distance(to[1])
}

/// Up to so many colliders that moved, each is compared with each, which needs no memory.
const FEW: usize = 16;

/// Whether colliders can be matched by their order: their kinds agree, and no two of a kind that moved, and were not teleported,
/// would have moved less if each were the other.
fn are_in_order<'a>(last: impl Iterator<Item = &'a Collider> + Clone, now: impl Iterator<Item = &'a Collider> + Clone) -> bool {
    let kind = |collider: &Collider| discriminant(&collider.shape);
    if !last.clone().map(kind).eq(now.clone().map(kind)) {
        return false;
    }
    let moving = last.zip(now).filter(|(_, now)| !now.teleported);
    let ways = moving.map(|(last, now)| Way::new(last, now)).filter(|way| way.length > 0.0);
    if ways.clone().nth(FEW).is_none() {
        let others = |index: usize| ways.clone().skip(index + 1);
        return ways.clone().enumerate().all(|(index, way)| others(index).all(|other| !way.is_longer_than_exchanged(&other)));
    }
    let moved: Vec<Way> = ways.collect();
    let [low, high] = bounds(moved.iter().map(|way| way.to[0]));
    let axis = (high - low).max_position();
    let sorted = |end: fn(&Way) -> [Vec3; 2]| {
        let mut places: Vec<(f32, &Way)> = moved.iter().map(|way| (end(way)[0][axis], way)).collect();
        places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        places
    };
    let (starts, ends) = (sorted(|way| way.from), sorted(|way| way.to));
    // If an exchange makes two ways shorter, then at least one of the new ways is shorter than the longer of the old: the
    // other collider begins or ends within that length.
    let is_best = |way: &Way, places: &[(f32, &Way)], place: f32| {
        let near = &places[places.partition_point(|&(other, _)| other < place - way.length)..];
        near.iter().take_while(|(other, _)| *other <= place + way.length).all(|(_, other)| !way.is_longer_than_exchanged(other))
    };
    moved.iter().all(|way| is_best(way, &ends, way.from[0][axis]) && is_best(way, &starts, way.to[0][axis]))
}

#[cfg(test)]
#[path = "../../tests/unit/step_motion.rs"]
mod tests;
