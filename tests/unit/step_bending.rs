//! Unit tests of `src/step/bending.rs`.

use super::*;
use crate::model::cloth::Cloth;
use crate::{Fabric, Mesh, Options};

fn sheet() -> (Cloth, Vec<Vec4>) {
    let cloth = Cloth::new(&Mesh::grid(24, 17, 1.0, 0.7), &Options { pinned: vec![0, 5], ..Options::default() }).unwrap();
    let rest = cloth.rest.clone();
    (cloth, rest)
}

/// With a retardation time of `tau` (s).
fn bound(tau: f64) -> Bound {
    Bound { kick: 2.0, damped: tau > 0.0 }
}

/// A single pass leaves the moments unchanged and has the stability limit of leapfrog; two passes have more than three
/// times that limit.
#[test]
fn the_first_pass_of_one_is_the_moment_itself() {
    let [plain, damped] = [false, true].map(|damped| Bound { kick: 2.0, damped });
    assert_eq!(filter(1, 1e-3, 2.0)[0].gain, 1.0);
    assert_eq!([plain.limit(1), damped.limit(1)], [2.0, 1.0]);
    for (count, table) in [(2, 6.83), (3, 14.9), (4, 26.1), (6, 58.0), (8, 103.0), (12, 231.0), (16, 411.0)] {
        assert!((damped.limit(count) / table - 1.0).abs() < 5e-3, "{count}: {}", damped.limit(count));
    }
}

/// The number of passes is the least that 95 % of the vertices need, and at any rigidity the rows stay within its
/// limit.
#[test]
fn the_fewest_passes_carry_the_rows() {
    let (cloth, rest) = sheet();
    let h = 1.0 / 1200.0;
    let mut counts = Vec::new();
    for bending in [1e-6, 1e-4, 1e-3, 4e-3, 1e-2, 1e-1, 1.0, 1e3] {
        for tau in [0.0, 0.06] {
            let BendRows { rows, passes, limited } = BendRows::new(cloth.bending(), &rest, [bending, tau], [h, h], Some(2.0));
            let count = passes.len().max(1);
            counts.push(count);
            let stiffness: Vec<f64> = rows.iter().map(|row| f64::from(row.stiffness)).collect();
            let full: Vec<f64> = cloth.bending().weight.iter().map(|weight| bending * weight).collect();
            let worst =
                |stiffness: &[f64]| cloth.bending().bounds(&rest, stiffness).into_iter().map(|g| h * h * g).fold(0.0, f64::max);
            assert!(worst(&stiffness) <= bound(tau).limit(count) * (1.0 + 1e-6), "B = {bending}: {}", worst(&stiffness));
            let plain = BendRows::new(cloth.bending(), &rest, [bending, tau], [h, h], None);
            assert!(plain.passes.is_empty() && plain.limited >= limited);
            if count == 1 {
                assert_eq!(plain.rows, rows);
            } else {
                assert!(worst(&full) > bound(tau).limit(count - 1), "B = {bending}: {count} passes are too many");
            }
            // Softening is reported only if it takes more than a twentieth.
            let share = stiffness.iter().sum::<f64>() / full.iter().sum::<f64>();
            assert_eq!(limited > 0, share < 0.9, "B = {bending}: {limited} limited, {share} left");
            // Damping takes at most half of a mode's velocity.
            let damped: Vec<f64> = rows.iter().map(|row| f64::from(row.stiffness) * f64::from(row.tau)).collect();
            let taken = worst(&damped) / h;
            assert!(taken <= if count == 1 { 1.0 } else { 0.5 } * (1.0 + 1e-6), "B = {bending}: {taken}");
            assert_eq!(taken > 0.0, tau > 0.0);
        }
    }
    assert!(counts.contains(&1) && counts.contains(&2) && counts.contains(&16), "{counts:?}");
}

/// In substeps that are shorter than the one for which the rigidity was limited, it stays what it was, and the passes still carry
/// each row, those of a few vertices that need more than the others, too.
#[test]
fn shorter_substeps_keep_the_rigidity_and_carry_it() {
    let mut mesh = Mesh::grid(12, 12, 1.0, 1.0);
    mesh.positions[67] = mesh.positions[66].lerp(mesh.positions[67], 0.3);
    let cloth = Cloth::new(&mesh, &Options::default()).unwrap();
    let softest = 1.0 / 1200.0;
    for bending in [1e-3, 4e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1.0, 1e3] {
        for tau in [0.0, 0.06] {
            let rows = |h: f64| BendRows::new(cloth.bending(), &cloth.rest, [bending, tau], [h, softest], Some(2.0));
            let of_all = rows(softest);
            for shorter in [1.01, 1.02, 1.05, 1.1, 1.3, 2.0, 5.0] {
                let h = softest / shorter;
                let BendRows { rows, passes, .. } = rows(h);
                let count = passes.len().max(1);
                assert!(rows.iter().zip(&of_all.rows).all(|(row, other)| row.stiffness == other.stiffness));
                let stiffness: Vec<f64> = rows.iter().map(|row| f64::from(row.stiffness)).collect();
                let worst = cloth.bending().bounds(&cloth.rest, &stiffness).into_iter().map(|g| h * h * g).fold(0.0, f64::max);
                let most = bound(tau).limit(count);
                assert!(
                    worst <= most * (1.0 + 1e-6),
                    "B = {bending}, {shorter}: {worst} with {count} passes, which carry {most}"
                );
                assert!(count <= of_all.passes.len().max(1));
            }
        }
    }
}

/// The filter is not used with relaxation and springs.
#[test]
fn small_steps_alone_are_filtered() {
    use crate::Method;
    use crate::step::coefficients::Coefficients;
    use crate::step::substep_count::Length;
    let (cloth, _) = sheet();
    let fabric = Fabric { bending: 0.1, ..Fabric::default() };
    for method in [Method::SmallSteps, Method::Springs, Method::Relaxation { iterations: 4 }] {
        let options = Options { method, fabric, ..Options::default() };
        let rows = Coefficients::new(&cloth, &[], &options, Length::of(1.0 / 1200.0)).bending;
        assert_eq!([rows.passes.is_empty(), rows.limited > 0], [method != Method::SmallSteps; 2], "{method:?}");
    }
}
