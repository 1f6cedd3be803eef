//! A coarse map of where the methods are stable; `--example stability_map` makes the fine ones.

mod common;

#[allow(dead_code, reason = "the example uses the rest")]
#[path = "../examples/stability_map/cell.rs"]
mod cell;
#[path = "../examples/stability_map/sheet.rs"]
mod sheet;
#[allow(dead_code, reason = "the example uses the rest")]
#[path = "../examples/stability_map/theory.rs"]
mod theory;
#[path = "../examples/stability_map/truth.rs"]
mod truth;

use cell::{Cell, Label};
use cloth_deformer::{Backend, Method};
use sheet::Sheet;
use truth::Truth;

on_every_backend!(a_coarse_map_is_the_same);

/// The labels of the methods on either side of their limits, which the CPU and the GPU have in common.
fn a_coarse_map_is_the_same(backend: Backend) {
    let methods = [Method::SmallSteps, Method::Relaxation { iterations: 5 }, Method::Springs];
    for stretch in [1e2, 5e3, 1e6] {
        let sheet = Sheet { stretch, ..Sheet::cotton(5) };
        let truth = Truth::of(&sheet);
        for method in methods {
            let limit = theory::explicit_flat(&sheet);
            let all = if method == Method::Springs { [limit / 1.2, limit / 0.9].to_vec() } else { vec![1.0, 6.0, 40.0] };
            for cell in all.into_iter().map(|substeps| Cell::new(sheet, method, substeps)) {
                let [label, expected] = [backend, Backend::Cpu].map(|backend| Cell { backend, ..cell }.run(&truth).label);
                println!("{method:?}, K = {stretch} N/m, {:.1} substeps: {}", cell.rate(), label.name());
                assert_eq!(label, expected, "{cell:?}");
                assert!(method != Method::SmallSteps || !label.is_failure(), "{cell:?}: {label:?}");
            }
        }
    }
}

/// Runs the cells of one sheet and returns their labels.
fn labels<const COUNT: usize>(sheet: Sheet, cells: [Cell; COUNT]) -> [Label; COUNT] {
    let truth = Truth::of(&sheet);
    cells.map(|cell| cell.run(&truth).label)
}

/// Asserts that small steps neither gain energy nor become infinite.
fn holds(sheet: Sheet, substeps: &[u32], step_ratio: f64) {
    let truth = Truth::of(&sheet);
    for &substeps in substeps {
        let cell = Cell { step_ratio, ..Cell::new(sheet, Method::SmallSteps, f64::from(substeps)) };
        let outcome = cell.run(&truth);
        assert!(!outcome.label.is_failure(), "{cell:?}: {outcome:?}");
    }
}

#[test]
fn small_steps_neither_gain_energy_nor_explode() {
    for stretch in [1e2, 5e3, 1e5, f64::INFINITY] {
        holds(Sheet { stretch, ..Sheet::cotton(9) }, &[1, 2, 5, 12, 30, 70], 1.0);
    }
    for n in [3, 6, 17] {
        holds(Sheet::cotton(n), &[1, 4, 20, 80], 1.0);
    }
    for bending in [1e-4, 1e-2, 1.0] {
        holds(Sheet { bending, ..Sheet::cotton(9) }, &[2, 10, 50], 1.0);
    }
    for mass_ratio in [10.0, 100.0, 1e3, 1e4] {
        holds(Sheet { mass_ratio, stretch: 1e5, ..Sheet::cotton(9) }, &[1, 5, 20, 31, 80], 1.0);
    }
}

/// Where many substeps do not resolve the stiffness by little, slow modes would amplify each other.
#[test]
fn small_steps_stiff_or_unevenly_stepped_gain_no_energy() {
    for stretch in [1e7, 1e9, f64::INFINITY] {
        holds(Sheet { stretch, ..Sheet::cotton(9) }, &[150, 400], 1.0);
    }
    for (stretch, substeps) in [(1.5e6, 412), (3e6, 702), (1e7, 1000)] {
        holds(Sheet { stretch, ..Sheet::cotton(13) }, &[substeps], 1.0);
    }
    for step_ratio in [1.5, 3.0, 10.0] {
        holds(Sheet::cotton(9), &[3, 8, 20, 60], step_ratio);
    }
}

#[test]
fn springs_are_stable_inside_their_limit_alone() {
    let sheets = [
        Sheet::cotton(5),
        Sheet::cotton(9),
        Sheet::cotton(13),
        Sheet { stretch: 1e3, ..Sheet::cotton(13) },
        Sheet { stretch: 1e5, ..Sheet::cotton(9) },
        Sheet { bending: 1e-4, ..Sheet::cotton(9) },
        Sheet { stretch: 1e5, mass_ratio: 100.0, ..Sheet::cotton(9) },
    ];
    for sheet in sheets {
        let limit = theory::explicit_flat(&sheet);
        let at = |share: f64| Cell::new(sheet, Method::Springs, limit / share);
        let [inside, outside] = labels(sheet, [at(0.9), at(1.2)]);
        assert!(inside == Label::Stable && outside.is_failure(), "{sheet:?}: {inside:?} at 0.9, {outside:?} at 1.2 of the limit");
        assert!(limit <= theory::explicit(&sheet), "{sheet:?}: the bound is no bound");
    }
}
