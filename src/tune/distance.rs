//! The distance between two runs of a scene.

use glam::Vec3;

use super::clip::{Clip, ClipFrame};

/// Time (s) by which a difference in speed is multiplied to count as a distance, where motions are compared by their
/// statistics.
const COUNTED: f64 = 0.1;

/// What is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Distance {
    /// The positions of each vertex.
    Vertices,
    /// Where there is cloth and how fast it moves, whichever part of the cloth it is. For chaotic motion nothing else
    /// is comparable.
    Spread,
}

impl Distance {
    /// The distance (mm) over the frames that the search compares, or those that verify the result. For positions it is
    /// the largest of any frame; for statistics, of which a single frame says little, the root mean square over the
    /// frames.
    pub(super) fn between(self, a: &Clip, b: &Clip, checked: bool) -> f64 {
        let pairs = || a.part(checked).zip(b.part(checked));
        1e3 * match self {
            Distance::Vertices => pairs().map(|(a, b)| rms(&a.positions, &b.positions)).fold(0.0, f64::max),
            Distance::Spread => {
                let squares: f64 = pairs().map(|(a, b)| spread(a, b).powi(2)).sum();
                (squares / pairs().count().max(1) as f64).sqrt()
            }
        }
    }
}

/// Root mean square distance (m) over the vertices.
fn rms(a: &[Vec3], b: &[Vec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.as_dvec3().distance_squared(b.as_dvec3())).sum();
    (sum / a.len().max(1) as f64).sqrt()
}

/// Distance (m) of two states as distributions: the coordinates along each axis are sorted before they are compared,
/// and the difference in speed counts for [`COUNTED`] seconds.
fn spread(a: &ClipFrame, b: &ClipFrame) -> f64 {
    let sorted = |frame: &ClipFrame, axis: usize| {
        let mut values: Vec<f32> = frame.positions.iter().map(|x| x[axis]).collect();
        values.sort_by(f32::total_cmp);
        values
    };
    let mut sum = (COUNTED * (a.speed - b.speed)).powi(2);
    for axis in 0..3 {
        let pairs = sorted(a, axis).into_iter().zip(sorted(b, axis));
        let squares: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        sum += squares / a.positions.len().max(1) as f64;
    }
    sum.sqrt()
}

#[cfg(test)]
#[path = "../../tests/unit/tune_distance.rs"]
mod tests;
