//! What the controller learns from a step.

use super::{Caution, Controller};

/// A factor that was learned fades with time, but counts no more as soon as something holds the cloth that substeps cannot move.
#[test]
fn what_holds_the_cloth_ends_what_was_learned_at_once() {
    let (caution, dt) = (Caution::PROMPT, 1.0 / 60.0);
    let mut learned = Controller::default();
    learned.learn(0.01, 0.1, caution, dt, false);
    assert!((learned.factor - 10.0).abs() < 1e-9, "{}", learned.factor);
    let mut free = learned;
    free.learn(0.01, 0.0, caution, dt, false);
    assert!((free.factor / learned.factor).ln() > -0.06, "{} fades slowly", free.factor);
    for excess in [0.0, 0.1] {
        let mut held = learned;
        held.learn(0.01, excess, caution, dt, true);
        assert!((held.factor - caution.first_factor).abs() < 1e-9, "{}", held.factor);
    }
}

/// Stretch that was measured with the stiffness resolved is the fabric's own, for as long as it is not measured to be less, and
/// not for ever.
#[test]
fn stretch_that_resolved_substeps_leave_is_the_fabrics_own() {
    let dt = 1.0 / 60.0;
    let mut controller = Controller::default();
    assert_eq!(controller.own_of(0.05, 0.9, dt), 0.0, "without resolved substeps nothing is known");
    assert_eq!(controller.own_of(0.05, 1.0, dt), 0.05);
    let kept = controller.own_of(0.08, 0.1, dt);
    assert!(kept < 0.05 && kept > 0.0499, "{kept}");
    assert_eq!(controller.own_of(0.02, 0.1, dt), 0.02, "less is measured");
    (0..60 * 60).for_each(|_| _ = controller.own_of(0.08, 0.1, dt));
    assert!(controller.own < 0.0011, "{} after a minute", controller.own);
}
