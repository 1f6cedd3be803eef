//! The resolved reference of a sheet: leapfrog in double precision with springs and bending. It shares no code with the
//! solver.

use cloth_deformer::glam::{DVec3, Vec3};

use crate::common::reference::Spring;
use crate::sheet::{G, Sheet};
use crate::theory;

/// A sheet stiffer than this (N/m) moves like one of this stiffness, because it stretches by less than 1e-4 of its
/// length.
const STIFFEST: f64 = 1e5;
/// Number of steps of the reference, relative to its explicit limit.
const MARGIN: f64 = 1.5;
/// Time at which a cell is compared with the reference (s).
pub(crate) const COMPARED: f64 = 0.5;
/// Duration of the damped phase (s), the time at its end over which the speed is averaged (s), and its damping (1/s).
pub(crate) const DAMPED: f64 = 1.5;
pub(crate) const AVERAGED: f64 = 0.25;
pub(crate) const DAMPING: f64 = 1.0;

/// The reference values of a sheet.
#[derive(Debug, Clone)]
pub(crate) struct Truth {
    /// Positions (m) after `COMPARED` from the level start.
    pub(crate) positions: Vec<DVec3>,
    /// Mean strain, and mean distance that the vertices fell (m).
    pub(crate) strain: f64,
    pub(crate) fallen: f64,
    /// Root mean square speed (m/s) at the end of the damped phase.
    pub(crate) speed: f64,
}

/// `y = sum_j c_j (x_j - x_center)`, of energy `rigidity |y|²/2`.
pub(crate) struct Row {
    pub(crate) center: usize,
    pub(crate) entries: Vec<(usize, f64)>,
    pub(crate) rigidity: f64,
}

struct Model {
    springs: Vec<Spring>,
    rows: Vec<Row>,
    weight: Vec<f64>,
    /// Step (s).
    dt: f64,
}

impl Truth {
    pub(crate) fn of(sheet: &Sheet) -> Truth {
        let sheet = Sheet { stretch: sheet.stretch.min(STIFFEST), ..*sheet };
        let model = Model::new(&sheet);
        let (start, rest) = sheet.level();
        let (x, _) = model.run(&start, &rest, COMPARED, 0.0);
        let (hung, jolt) = sheet.jolted();
        let (_, speed) = model.run(&hung, &jolt, DAMPED, DAMPING);
        assert!(speed.is_finite() && x.iter().all(|x| x.is_finite()), "the reference of {sheet:?} is not resolved");
        Truth { strain: mean_strain(&model.springs, &x), fallen: -mean_height(&x), speed, positions: x }
    }
}

impl Model {
    fn new(sheet: &Sheet) -> Model {
        let rate = MARGIN * (theory::laplacian(sheet) + theory::bending(sheet)).sqrt() / 2.0;
        Model { springs: sheet.springs(), rows: rows(sheet), weight: sheet.inverse_masses(), dt: 1.0 / rate.max(3000.0) }
    }

    fn acceleration(&self, x: &[DVec3]) -> Vec<DVec3> {
        let mut force = vec![DVec3::ZERO; x.len()];
        for &(i, j, rest, stiffness) in &self.springs {
            let d = x[j] - x[i];
            let length = d.length();
            let pull = d * (stiffness * (length - rest) / length);
            force[i] += pull;
            force[j] -= pull;
        }
        for Row { center, entries, rigidity } in &self.rows {
            let y: DVec3 = entries.iter().map(|&(j, c)| (x[j] - x[*center]) * c).sum();
            for &(j, c) in entries {
                force[j] -= y * (rigidity * c);
                force[*center] += y * (rigidity * c);
            }
        }
        let accelerate = |(f, &w): (&DVec3, &f64)| if w > 0.0 { *f * w - G * DVec3::Y } else { DVec3::ZERO };
        force.iter().zip(&self.weight).map(accelerate).collect()
    }

    /// Positions (m) after `time` (s), and the root mean square speed (m/s) over the last `AVERAGED` seconds.
    fn run(&self, x: &[Vec3], v: &[Vec3], time: f64, damping: f64) -> (Vec<DVec3>, f64) {
        let [mut x, mut v] = [x, v].map(|list| list.iter().map(|a| a.as_dvec3()).collect::<Vec<_>>());
        let steps = (time / self.dt).ceil();
        let dt = time / steps;
        let (keep, last) = ((-damping * dt).exp(), (AVERAGED / dt).round() as u32);
        let mut square = 0.0;
        for step in 0..steps as u32 {
            // The first kick is half a kick (leapfrog).
            let kick = if step == 0 { 0.5 * dt } else { dt };
            let a = self.acceleration(&x);
            for ((x, v), a) in x.iter_mut().zip(&mut v).zip(a) {
                *v = (*v + a * kick) * keep;
                *x += *v * dt;
            }
            if step + last >= steps as u32 {
                square += v.iter().map(|v| v.length_squared()).sum::<f64>() / v.len() as f64;
            }
        }
        (x, (square / f64::from(last)).sqrt())
    }
}

/// The bending rows of a grid: five points in the interior, three along a free edge, none at a corner.
pub(crate) fn rows(sheet: &Sheet) -> Vec<Row> {
    let (n, spacing) = (sheet.n as usize, sheet.spacing());
    if sheet.bending == 0.0 {
        return Vec::new();
    }
    let row = |center: usize| {
        let inside = |k: usize| k > 0 && k < n - 1;
        let (across, along) = ([center.wrapping_sub(1), center + 1], [center.wrapping_sub(n), center + n]);
        let edge = |ends: [usize; 2]| {
            let entries = ends.map(|j| (j, 1.0 / spacing)).to_vec();
            Some(Row { center, entries, rigidity: 0.5 * sheet.bending })
        };
        match (inside(center % n), inside(center / n)) {
            (true, true) => {
                let entries = across.into_iter().chain(along).map(|j| (j, 1.0)).collect();
                Some(Row { center, entries, rigidity: sheet.bending / spacing.powi(2) })
            }
            (true, false) => edge(across),
            (false, true) => edge(along),
            (false, false) => None,
        }
    };
    (0..n * n).filter_map(row).collect()
}

/// Mean over the springs of `max(0, l/l0 - 1)`.
pub(crate) fn mean_strain(springs: &[Spring], x: &[DVec3]) -> f64 {
    let strain = |&(i, j, rest, _): &Spring| (x[i].distance(x[j]) / rest - 1.0).max(0.0);
    springs.iter().map(strain).sum::<f64>() / springs.len() as f64
}

/// Mean height (m).
pub(crate) fn mean_height(x: &[DVec3]) -> f64 {
    x.iter().map(|x| x.y).sum::<f64>() / x.len() as f64
}
