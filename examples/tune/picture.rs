//! What a search tried, drawn: error against time per frame.

use cloth_deformer::{Levels, Method, Terms, Tolerance, Trial, Tuned};

use crate::draw::{Axis, Chart, Curve, Line, Look, Marker};

/// The chart of a search in a scene. Runs that failed are not in it.
pub(crate) fn chart(name: &str, tuned: &Tuned, tolerance: Tolerance) -> Chart {
    let (unit, scale) = if matches!(tolerance, Tolerance::Strain(_)) { ("%", 100.0) } else { ("mm", 1.0) };
    let allowed = scale * f64::from(tuned.allowed);
    let at = |trial: &Trial| (f64::from(trial.milliseconds), scale * f64::from(trial.error.max(trial.checked)));
    let mut trials: Vec<&Trial> = tuned.trials.iter().filter(|trial| trial.error.is_finite() && trial.error > 0.0).collect();
    trials.sort_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
    let mut curves: Vec<Curve> = Vec::new();
    for trial in &trials {
        let ((x, y), kind) = (at(trial), kind(trial));
        let point = (x, y, format!("{:.0}", trial.substeps));
        match curves.iter_mut().find(|curve| curve.name == kind) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { name: kind, look: look(trial), points: vec![point] }),
        }
    }
    let mut front: Vec<(f64, f64)> = Vec::new();
    for (x, y) in trials.iter().map(|trial| at(trial)) {
        if front.last().is_none_or(|last| y < last.1) {
            front.push((x, y));
        }
    }
    let (ms, error) = at(&tuned.best);
    let resolved = tuned.resolved.filter(|resolved| resolved.error > 0.0);
    let times = resolved
        .map_or(String::new(), |resolved| format!("The resolved run takes {} ms. ", rounded(resolved.milliseconds.into())));
    let compared = if tuned.chaotic {
        "A chaotic motion: where there is cloth is compared, and its speed."
    } else {
        "Errors are those of the worst frame."
    };
    let dropped: Vec<&str> = tuned.terms.iter().filter(|term| term.dropped).map(|term| term.name).collect();
    let terms = tuned.terms.iter().map(|term| format!("{} {:.2} mm, {:.2} ms", term.name, term.error, term.milliseconds));
    let terms: Vec<String> = terms.collect();
    Chart {
        title: format!(
            "{name}: {} {unit} in {} ms a frame ({}, {:.0} substeps)",
            rounded(error),
            rounded(ms),
            kind(&tuned.best),
            tuned.best.substeps
        ),
        subtitle: vec![
            format!("{compared} Figures along the curves: substeps a frame."),
            times + &if dropped.is_empty() { String::new() } else { format!("Left out without harm: {}.", dropped.join(", ")) },
        ],
        x: Axis { label: "milliseconds a frame".to_owned(), ticks: Vec::new() },
        y: Axis { label: format!("error ({unit})"), ticks: Vec::new() },
        curves,
        front,
        bound: Some((allowed, format!("{} {unit} allowed", rounded(allowed)))),
        floor: resolved.map(|resolved| {
            (f64::from(resolved.error), format!("two resolved runs differ by {} {unit}", rounded(resolved.error.into())))
        }),
        caption: if terms.is_empty() { Vec::new() } else { vec![format!("What each term is worth: {}", terms.join("; "))] },
    }
}

/// The kind of solver of a run, and what it leaves out.
fn kind(trial: &Trial) -> String {
    let method = match trial.setting.method {
        Method::SmallSteps if trial.setting.levels == Levels::Off => "small steps, no levels".to_owned(),
        Method::SmallSteps => "small steps".to_owned(),
        Method::Relaxation { iterations } => format!("relaxation x {iterations}"),
        _ => "springs".to_owned(),
    };
    let terms: Vec<&str> = trial.setting.terms.left_out().collect();
    if terms.is_empty() { method } else { format!("{method} without {}", terms.join(" and ")) }
}

/// As `chart` draws them; dashed if a term is left out.
fn look(trial: &Trial) -> Look {
    let marker = match trial.setting.method {
        Method::SmallSteps if trial.setting.levels == Levels::Off => Marker::Diamond,
        Method::Relaxation { .. } => Marker::Square,
        Method::SmallSteps => Marker::Circle,
        _ => Marker::Triangle,
    };
    let line = if trial.setting.terms == Terms::ALL { Line::Solid } else { Line::Dashed };
    Look { marker, line }
}

/// Two digits.
fn rounded(value: f64) -> String {
    let digits = (1.0 - value.abs().max(1e-9).log10().floor()).clamp(0.0, 6.0);
    format!("{value:.*}", digits as usize)
}
