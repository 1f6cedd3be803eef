//! The polynomials of the distance constraint, compared with square roots in double precision.

use super::{STRETCH_GUARD, excess_length, inverse_length};

/// Largest relative errors of `excess_length` and `inverse_length` over `-reach < r < reach`.
fn errors(reach: f32) -> [f64; 2] {
    let within = |r: f32| {
        let length = (1.0 + f64::from(r)).sqrt();
        let excess = f64::from(r) / (1.0 + length);
        [(f64::from(excess_length(r)) / excess - 1.0).abs(), (f64::from(inverse_length(r)) * length - 1.0).abs()]
    };
    let samples = (1..=2000).map(|k| reach * k as f32 / 2000.0);
    samples.flat_map(|r| [within(r), within(-r)]).fold([0.0; 2], |worst, of| [0, 1].map(|i| worst[i].max(of[i])))
}

#[test]
fn far_from_the_rest_length_the_stiffness_of_an_edge_is_within_a_thousandth() {
    let [excess, inverse] = errors(STRETCH_GUARD);
    assert!(excess < 1.3e-4 && inverse < 8e-4, "{excess:e} {inverse:e}");
}

#[test]
fn near_the_rest_length_the_error_falls_with_the_strain_to_the_rounding() {
    for reach in [0.2, 0.1, 0.05, 0.02, 1e-3] {
        let [excess, inverse] = errors(reach);
        let cube = f64::from(reach).powi(3);
        assert!(excess < 0.01 * cube + 2e-7 && inverse < 0.06 * cube + 2e-7, "{reach}: {excess:e} {inverse:e}");
    }
}
