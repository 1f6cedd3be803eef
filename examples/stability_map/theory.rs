//! Predictions made before anything is run. All numbers are substeps per 1/60 s.

use crate::common::reference::Spring;
use crate::sheet::{DENSITY, Sheet};
use crate::truth::{Row, rows};

/// Iterations of the power iteration.
const TURNS: u32 = 1000;

/// The largest eigenvalue (1/s²) of the graph Laplacian weighted by the springs, `M^-1/2 L M^-1/2`. It bounds the
/// squared frequencies of the springs, whatever their directions.
pub(crate) fn laplacian(sheet: &Sheet) -> f64 {
    let root: Vec<f64> = sheet.inverse_masses().iter().map(|w| w.sqrt()).collect();
    let springs = sheet.springs();
    // The start vector contains all wavelengths.
    let start = (0..root.len()).map(|v| if v % 2 == 0 { 1.0 } else { -1.0 } + (v as f64 * 0.7).sin());
    largest(start.collect(), |q| {
        let mut next = vec![0.0; q.len()];
        for &(i, j, _, stiffness) in &springs {
            let force = stiffness * (root[i] * q[i] - root[j] * q[j]);
            next[i] += root[i] * force;
            next[j] -= root[j] * force;
        }
        next
    })
}

/// The largest squared frequency (1/s²) of the flat sheet for motion in its plane, where a spring acts only along its
/// own direction. The bending energy is one of vectors, so it acts in the plane too.
fn flat(sheet: &Sheet) -> f64 {
    let root: Vec<f64> = sheet.inverse_masses().iter().map(|w| w.sqrt()).collect();
    let n = sheet.n as usize;
    // Components of each spring's direction along x and z.
    let direction = |&(i, j, ..): &Spring| {
        let d = [(j % n) as f64 - (i % n) as f64, (j / n) as f64 - (i / n) as f64];
        d.map(|along| along / d[0].hypot(d[1]))
    };
    let springs: Vec<(Spring, [f64; 2])> = sheet.springs().iter().map(|spring| (*spring, direction(spring))).collect();
    let rows = rows(sheet);
    let start = (0..2 * root.len()).map(|k| if k / 2 % 2 == 0 { 1.0 } else { -1.3 } + (k as f64 * 0.7).sin());
    largest(start.collect(), |q| {
        let mut next = vec![0.0; q.len()];
        for &((i, j, _, stiffness), d) in &springs {
            let along = |v: usize| root[v] * (d[0] * q[2 * v] + d[1] * q[2 * v + 1]);
            let force = stiffness * (along(i) - along(j));
            for axis in 0..2 {
                next[2 * i + axis] += root[i] * force * d[axis];
                next[2 * j + axis] -= root[j] * force * d[axis];
            }
        }
        for Row { center, entries, rigidity } in &rows {
            for axis in 0..2 {
                let at = |v: usize| root[v] * q[2 * v + axis];
                let y: f64 = entries.iter().map(|&(j, c)| c * (at(j) - at(*center))).sum();
                for &(j, c) in entries {
                    next[2 * j + axis] += root[j] * rigidity * c * y;
                    next[2 * center + axis] -= root[*center] * rigidity * c * y;
                }
            }
        }
        next
    })
}

/// The largest eigenvalue of a symmetric positive semidefinite matrix, by power iteration.
fn largest(mut q: Vec<f64>, multiply: impl Fn(&[f64]) -> Vec<f64>) -> f64 {
    let mut eigenvalue = 0.0;
    for _ in 0..TURNS {
        let norm = q.iter().map(|q| q * q).sum::<f64>().sqrt();
        q.iter_mut().for_each(|q| *q /= norm);
        q = multiply(&q);
        eigenvalue = q.iter().map(|q| q * q).sum::<f64>().sqrt();
    }
    eigenvalue
}

/// Gershgorin's bound (1/s²) for the bending rows of a grid with spacing l: 64 B / (rho l⁴), at an inner vertex, whose
/// row is the five-point Laplacian.
pub(crate) fn bending(sheet: &Sheet) -> f64 {
    64.0 * sheet.bending / (DENSITY * sheet.spacing().powi(4))
}

/// The explicit limit `h = 2/omega_max` of springs with bending, which is limited to `h² g <= 2`.
pub(crate) fn explicit(sheet: &Sheet) -> f64 {
    let eigenvalue = laplacian(sheet);
    (eigenvalue + eigenvalue.min(bending(sheet))).sqrt() / 120.0
}

/// The same limit from the frequencies of the flat sheet. It is found by bisection, because bending is limited
/// depending on the substep, which lowers its frequencies.
pub(crate) fn explicit_flat(sheet: &Sheet) -> f64 {
    let needed = |substeps: f64| {
        let softened = (limiter(sheet) / substeps).powi(-2).min(1.0);
        flat(&Sheet { bending: sheet.bending * softened, ..*sheet }).sqrt() / 120.0
    };
    if sheet.bending == 0.0 {
        return needed(1.0);
    }
    let (mut low, mut high) = (0.0, 1.01 * explicit(sheet));
    while high > 1.003 * low {
        let middle = 0.5 * (low + high);
        if needed(middle) > middle { low = middle } else { high = middle }
    }
    high
}

/// The number of substeps that resolves the stiffness of an inner edge: `S* = sqrt(k (w_i + w_j) / 2) / 60`.
pub(crate) fn resolved(sheet: &Sheet) -> f64 {
    (sheet.stretch / DENSITY).sqrt() / sheet.spacing() / 60.0
}

/// The number of substeps below which bending is limited with one pass: `h² g = 2`.
pub(crate) fn limiter(sheet: &Sheet) -> f64 {
    (bending(sheet) / 2.0).sqrt() / 60.0
}

/// The number of substeps below which small steps limit it: `h² g = 411`, the limit of sixteen passes.
pub(crate) fn filtered(sheet: &Sheet) -> f64 {
    (bending(sheet) / 411.0).sqrt() / 60.0
}
