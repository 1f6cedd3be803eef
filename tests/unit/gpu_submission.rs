//! What is submitted together.

use super::*;

/// A submission waits for the one before, so that cloths of a second one would wait for all of the first.
#[test]
fn a_crowd_is_one_submission() {
    let gpu = Gpu::shared(true).unwrap();
    let submitted_before = |mut submission: Submission<'_>| {
        (0..1000).for_each(|_| submission.group().dispatches += 1);
        submission.earlier
    };
    assert_eq!(submitted_before(Submission::of_crowd(&gpu)), 0);
    assert!(submitted_before(Submission::new(&gpu)) > 0, "the device begins while a single cloth is being encoded");
}
