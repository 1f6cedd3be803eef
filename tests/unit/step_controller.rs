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

/// Stretch that was measured with as many substeps as help is the fabric's own, for as long as not much less is measured, and not for
/// ever while the cloth moves.
#[test]
fn stretch_that_no_substeps_change_is_the_fabrics_own() {
    let (aim, dt) = (0.02, 1.0 / 60.0);
    let mut controller = Controller::default();
    assert_eq!(controller.own_of(0.05, false, aim, dt, false), 0.0, "with fewer substeps");
    assert_eq!(controller.own_of(0.05, true, aim, dt, false), 0.05);
    for measured in [0.08, 0.041] {
        assert_eq!(controller.own_of(measured, false, aim, dt, false), 0.05);
    }
    let (mut slack, mut changed) = (controller, controller);
    assert_eq!(slack.own_of(0.039, false, aim, dt, false), 0.0, "it may be slack");
    assert_eq!(changed.own_of(0.041, true, aim, dt, false), 0.041, "measured anew");
    assert_eq!(changed.own_of(0.019, true, aim, dt, false), 0.0, "nothing asks for more substeps");
    let mut fallen = Controller { fallen_for: 0.1, ..controller };
    assert!((fallen.own_of(0.03, false, aim, dt, false) - 0.035).abs() < 1e-9, "fewer substeps leave less");
    let mut calm = controller;
    assert!((0..60 * 60).all(|_| calm.own_of(0.08, false, aim, dt, true) == 0.05), "nothing has changed");
    let known = (0..60 * 60).take_while(|_| controller.own_of(0.08, false, aim, dt, false) == 0.05).count();
    assert!((500..700).contains(&known), "known for {known} frames");
}

/// A number of substeps was too small because the cloth was held stretched. Once it is slack, that number is no longer avoided: a sleeve
/// that had been tight took 256 for ever.
#[test]
fn cloth_that_is_slack_may_take_what_was_too_few() {
    let (aim, dt) = (0.02, 1.0 / 60.0);
    for (measured, left) in [(0.02, 229.0), (0.006, 229.0), (0.004, 0.0)] {
        let mut controller = Controller { count: 256.0, too_few: 229.0, ..Controller::default() };
        controller.own_of(measured, true, aim, dt, true);
        assert_eq!(controller.too_few, left, "stretched by {measured}");
    }
}

/// The number to which a rejected step had fallen is too small under its load; one from which it had risen is not said to be.
#[test]
fn what_was_fallen_to_and_rejected_is_too_few() {
    let before = Controller { count: 36.0, fallen_for: 5.0, ..Controller::default() };
    let fallen = before.rejected(&Controller { count: 29.0, factor: 2.0, stress: 7.0, ..before });
    assert_eq!([fallen.factor, fallen.count, fallen.too_few, fallen.failed_under], [2.0, 36.0, 29.0, 7.0]);
    assert_eq!(fallen.fallen_for, 0.0);
    let risen = before.rejected(&Controller { count: 41.0, factor: 2.0, stress: 7.0, ..before });
    assert_eq!([risen.factor, risen.count, risen.too_few, f64::from(risen.fallen_for)], [2.0, 36.0, 0.0, 5.0]);
}
