//! The tolerance of a search for the cheapest setting, as text, and the table of its result.

use cloth_deformer::{Tolerance, Trial, Tuned};

use crate::command::say;

/// A tolerance such as `10mm` or `3%`.
pub(crate) fn tolerance(text: &str) -> Result<Tolerance, String> {
    let number = |text: &str| match text.trim().parse::<f32>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        Ok(_) => Err("it must be finite and above 0; give a distance such as 10mm, or a strain such as 3%".to_owned()),
        Err(_) => Err("give a distance such as 10mm, or a strain such as 3%".to_owned()),
    };
    match (text.strip_suffix("mm"), text.strip_suffix('%')) {
        (Some(text), _) => number(text).map(Tolerance::Position),
        (None, Some(text)) => number(text).map(|percent| Tolerance::Strain(percent / 100.0)),
        (None, None) => Err("give a distance such as 10mm, or a strain such as 3%".to_owned()),
    }
}

/// Prints what the search tried, and the setting that it found.
pub(crate) fn show(tuned: &Tuned, tolerance: Tolerance) {
    let (unit, scale) = if matches!(tolerance, Tolerance::Strain(_)) { ("%", 100.0) } else { ("mm", 1.0) };
    if tuned.chaotic {
        say(
            "This motion is chaotic, so no two runs agree: where there is cloth and how fast it moves is compared, not each vertex.\n",
        );
    }
    if !tuned.terms.is_empty() {
        say("| without | error (mm) | ms saved | |\n|---|---|---|---|");
    }
    for term in &tuned.terms {
        let word = if term.dropped { "dropped" } else { "needed" };
        say(&format!("| {} | {:.2} | {:.2} | {word} |", term.name, term.error, term.milliseconds));
    }
    say(&format!("\n| setting | substeps | levels | error ({unit}) | in other frames | ms |\n|---|---|---|---|---|---|"));
    let row = |trial: &Trial| {
        let &Trial { setting, substeps, levels, error, checked, milliseconds, .. } = trial;
        let [error, checked] = [error, checked].map(|error| scale * error);
        let air = if setting.terms.air { "" } else { ", without air" };
        say(&format!("| {setting}{air} | {substeps:.0} | {levels} | {error:.2} | {checked:.2} | {milliseconds:.2} |"));
    };
    tuned.trials.iter().for_each(row);
    let Trial { setting, milliseconds, error, checked, .. } = tuned.best;
    let times = tuned.resolved.map_or(String::new(), |resolved| {
        format!(", {:.1} times as fast as the resolved run", resolved.milliseconds / milliseconds)
    });
    if !tuned.kept {
        let [allowed, least] = [tuned.allowed, error.max(checked)].map(|error| scale * error);
        say(&format!(
            "\nNo setting kept the error within {allowed} {unit}; the least was {least} {unit}. Allow more. The setting of the least:"
        ));
    }
    say(&format!(
        "\nError {:.2} {unit} in {milliseconds:.2} ms per frame{times}:\n\n    Options {{ {setting}, ..options }}",
        scale * error
    ));
    if !setting.terms.air {
        say("    Attributes { air_density: 0.0, ..attributes }");
    }
}
