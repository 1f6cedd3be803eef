//! The number of substeps that fit into a time, learned from the time of earlier ones.

use super::Pace;

#[test]
fn as_many_fit_as_the_time_allows() {
    let mut pace = Pace::default();
    assert_eq!(pace.fitting(2e-3, 5.0), None, "nothing is known yet");
    // 50 us each, then one step that was delayed by something else.
    (0..20).for_each(|_| pace.note(5e-4, 10));
    assert_eq!(pace.fitting(2e-3, 5.0), Some(36.0), "nine tenths of 2 ms");
    assert_eq!(pace.fitting(2e-3, 34.0), Some(34.0), "about as many fit");
    assert_eq!(pace.fitting(2e-3, 60.0), Some(36.0), "too many do not");
    pace.note(1.0, 10);
    assert!(pace.fitting(2e-3, 5.0) >= Some(20.0), "one step is not believed");
    (0..40).for_each(|_| pace.note(1e-3, 10));
    assert_eq!(pace.fitting(2e-3, 5.0), Some(18.0), "twice as slow for good");
}
