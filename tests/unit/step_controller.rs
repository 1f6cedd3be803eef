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
