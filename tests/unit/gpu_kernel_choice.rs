//! The kernels with which a step is attempted.

use super::*;

/// A step of 20 substeps after one with so many detections: in every how many substeps detection may be due.
fn spacing_after(choice: &mut KernelChoice, detections: u32) -> u32 {
    choice.begin(&Status { detections, ..Status::nothing() }, 20);
    choice.spacing
}

#[test]
fn detection_is_due_less_often_in_calm_cloth() {
    let mut choice = KernelChoice::default();
    let first: Vec<u32> = (0..8).map(|_| spacing_after(&mut choice, 1)).collect();
    assert_eq!(first, [5, 5, 5, 5, 5, 20, 20, 20]);
    assert_eq!(spacing_after(&mut choice, 2), 5, "two detections in a step are not calm");
    let again: Vec<u32> = (0..6).map(|_| spacing_after(&mut choice, 0)).collect();
    assert_eq!(again, [5, 5, 5, 5, 5, 20]);
    assert_eq!(spacing_after(&mut choice, 3), 1, "three are so many that it is nearly always due");
}

#[test]
fn cloth_that_strayed_in_between_is_watched() {
    let mut choice = KernelChoice::default();
    (0..6).for_each(|_| assert!(spacing_after(&mut choice, 0) > 1));
    choice.change(EARLY, false);
    assert_eq!(choice.spacing, 1, "the step is repeated with detection in each substep");
    let next: Vec<u32> = (0..40).map(|_| spacing_after(&mut choice, 1)).collect();
    let count = |spacing| next.iter().filter(|&&one| one == spacing).count();
    assert_eq!((next[..2].to_vec(), count(1), count(5), count(20)), (vec![1, 1], 2, 33, 5));
}

#[test]
fn it_is_due_within_a_step_of_few_substeps() {
    let mut choice = KernelChoice::default();
    for _ in 0..9 {
        choice.begin(&Status::nothing(), 8);
    }
    assert_eq!(choice.spacing, 8);
}
