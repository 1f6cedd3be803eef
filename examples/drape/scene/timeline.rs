//! The frames of a run in time, including those of the preroll.

use std::fmt;

use toml::Spanned;

use super::file::{File, Source};
use crate::Failure;
use crate::arguments::{Arguments, check_rate};

/// Default number of frames, and frames per second.
const FRAMES: u32 = 120;
const RATE: f32 = 60.0;

/// Most frames of a preroll.
const MAX_PREROLL: f64 = 1e6;

/// What is wrong with a `start` in a scene without a preroll.
pub(super) const NO_PREROLL: &str = "`start` needs a preroll; give `preroll` in seconds, or leave out `start`";

/// The number of frames, and their times.
///
/// Frames are numbered from 1. Those of the preroll come before, 0, -1 and so on; they are simulated but not written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Timeline {
    /// Number of frames that are written.
    pub(crate) frames: u32,
    /// Number of frames of the preroll.
    pub(crate) preroll: u32,
    /// Frames per second.
    pub(crate) fps: f32,
}

/// A moment of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    /// Seconds from frame 1; 0 during the preroll.
    pub(super) time: f64,
    /// How far animated values have come from their starts to their values at frame 1, from 0 to 1.
    pub(super) share: f32,
}

/// `at 0.5 s`, or for messages about moments before frame 1, `before frame 1`.
impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.share < 1.0 { f.write_str("before frame 1") } else { write!(f, "at {} s", self.time) }
    }
}

impl Timeline {
    /// Reads the timeline of a scene.
    pub(super) fn of(arguments: &Arguments, scene: Option<(&Source, &File)>) -> Result<Timeline, Failure> {
        let frames = arguments.frames.or(scene.and_then(|(_, file)| file.frames).map(|frames| frames.0)).unwrap_or(FRAMES);
        let fps = rate(arguments, scene)?;
        let given = scene.and_then(|(source, file)| file.preroll.as_ref().map(|preroll| (source, preroll)));
        let seconds = arguments.preroll.or(given.map(|(_, preroll)| preroll.get_ref().0)).unwrap_or(0.0);
        let count = f64::from(seconds) * f64::from(fps);
        if count > MAX_PREROLL {
            let message = format!("preroll = {seconds} s has more than {MAX_PREROLL} frames; give fewer seconds");
            return Err(match given {
                Some((source, preroll)) if arguments.preroll.is_none() => source.wrong_in(preroll, message),
                _ => Failure::input(message).of("--preroll"),
            });
        }
        let preroll = if seconds > 0.0 { count.round().max(1.0) as u32 } else { 0 };
        Ok(Timeline { frames, preroll, fps })
    }

    /// The frame in which the cloth has the shape of its mesh.
    pub(crate) fn first(self) -> i64 {
        1 - i64::from(self.preroll)
    }

    /// The time (s) of each frame from frame 1 on.
    pub(super) fn times(self) -> impl Iterator<Item = f64> {
        self.moments().map(|moment| moment.time)
    }

    /// The moment of each frame from frame 1 on.
    pub(super) fn moments(self) -> impl Iterator<Item = Moment> {
        (1..=i64::from(self.frames)).map(move |frame| self.moment(frame))
    }

    /// The moment of each frame of the preroll.
    pub(super) fn preroll_moments(self) -> impl Iterator<Item = Moment> {
        (self.first()..1).map(move |frame| self.moment(frame))
    }

    /// The moment halfway between a frame and the one before. What acts for a whole step has its mean value there, if it changes
    /// linearly.
    pub(super) fn before(self, frame: i64) -> Moment {
        let [last, now] = [frame.saturating_sub(1), frame].map(|frame| self.moment(frame));
        Moment { time: 0.5 * (last.time + now.time), share: 0.5 * (last.share + now.share) }
    }

    /// The moment of a frame. In the first half of the preroll the share goes from 0 to 1, in the other half it is 1.
    pub(super) fn moment(self, frame: i64) -> Moment {
        let passed = |half: f64| (frame.saturating_sub(self.first()) as f64 / half).clamp(0.0, 1.0);
        let share = if frame < 1 { ease(passed(0.5 * f64::from(self.preroll))) as f32 } else { 1.0 };
        Moment { time: frame.saturating_sub(1).max(0) as f64 / f64::from(self.fps), share }
    }
}

/// The number of frames per second.
fn rate(arguments: &Arguments, scene: Option<(&Source, &File)>) -> Result<f32, Failure> {
    let given = scene.and_then(|(source, file)| file.fps.as_ref().map(|fps: &Spanned<_>| (source, fps)));
    match (arguments.fps, given) {
        (Some(rate), _) => Ok(rate),
        (None, Some((source, fps))) => check_rate(fps.get_ref().0).map_err(|why| source.wrong_in(fps, why)),
        (None, None) => Ok(RATE),
    }
}

/// The way of least jerk from 0 to 1, whose speed and acceleration are 0 at both ends (Flash and Hogan 1985).
fn ease(s: f64) -> f64 {
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}
