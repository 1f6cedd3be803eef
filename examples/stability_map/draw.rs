//! Draws a map: a panel for each method, cells in the colors of their labels, and predictions as lines over them.

use std::error::Error;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::cell::{Cell, Label};
use crate::maps::{Column, Line, Map, Panel};

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Pixel = (f64, f64);
type Trouble = Box<dyn Error>;

const SIZE: (u32, u32) = (1200, 680);
/// Left side of the first panel, width of a panel, and distance between panels (px).
const LEFT: f64 = 76.0;
const WIDTH: f64 = 330.0;
const PITCH: f64 = 385.0;
/// Top and bottom of the panels (px).
const TOP: f64 = 100.0;
const BOTTOM: f64 = 470.0;
const INK: RGBColor = RGBColor(30, 30, 30);
const GRAY: RGBColor = RGBColor(100, 100, 100);
const NOT_RUN: RGBColor = RGBColor(238, 238, 238);
const TEXT: f64 = 14.0;
const SMALL: f64 = 12.0;
const SCENE: &str = "A sheet of 1 m and 0.2 kg/m², pinned along its top edge, swings down from horizontal; then it hangs, jolted, with damping 1/s.";
const CAPTION: [&str; 3] = [
    "gaining energy: by more than 1 % of m g L/2, or so much that a step refuses it; inaccurate: after 0.5 s more than 2 cm or 1 % of \
     strain from a resolved reference;",
    "never resting: faster than a damped mode after 1.5 s (0.05 m/s), and than twice the reference; frozen: fallen less than a tenth \
     of it. The first that holds, from the right.",
    "cargo run --release --example stability_map",
];

/// Colors that differ in lightness too, and can be told apart with any kind of color vision.
fn color(label: Label) -> RGBColor {
    match label {
        Label::Stable => RGBColor(205, 228, 240),
        Label::Inaccurate => RGBColor(240, 228, 66),
        Label::NeverResting => RGBColor(86, 160, 220),
        Label::Frozen => RGBColor(150, 150, 150),
        Label::GainingEnergy => RGBColor(213, 94, 0),
        Label::NotFinite => RGBColor(70, 20, 80),
    }
}

/// The mapping from values to pixels in a panel.
struct Frame<'a> {
    columns: &'a [Column],
    left: f64,
    /// Smallest and largest number of substeps.
    range: [f64; 2],
}

impl Frame<'_> {
    fn new(panel: &Panel, left: f64) -> Frame<'_> {
        let rates = || panel.columns.iter().flat_map(|column| column.cells.iter().map(Cell::rate));
        let range = [rates().fold(f64::INFINITY, f64::min) / 1.1, rates().fold(0.0, f64::max) * 1.1];
        Frame { columns: &panel.columns, left, range }
    }

    /// Left side of a column, which may be a fraction.
    fn x(&self, column: f64) -> f64 {
        self.left + WIDTH * column / self.columns.len() as f64
    }

    fn y(&self, substeps: f64) -> f64 {
        let [low, high] = self.range.map(f64::ln);
        BOTTOM - (BOTTOM - TOP) * ((substeps.ln() - low) / (high - low)).clamp(0.0, 1.0)
    }

    /// The middle of the column for a value of the axis.
    fn at(&self, value: f64) -> Option<f64> {
        let after = self.columns.iter().position(|column| column.at >= value * 0.999)?;
        let [low, high] = [after.checked_sub(1).unwrap_or(after), after].map(|index| self.columns[index].at.ln());
        let share = if high.is_finite() && high > low { (value.ln() - low) / (high - low) } else { 1.0 };
        (value >= self.columns[0].at * 0.999).then(|| self.x(after as f64 - 0.5 + share.clamp(0.0, 1.0)))
    }
}

/// The text of the SVG file.
pub(crate) fn svg(map: &Map) -> Result<String, Trouble> {
    let mut text = String::new();
    {
        let canvas = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        canvas.fill(&WHITE)?;
        write(&canvas, map.title, (24.0, 14.0), 20.0, INK, (HPos::Left, VPos::Top))?;
        write(&canvas, SCENE, (24.0, 44.0), TEXT, GRAY, (HPos::Left, VPos::Top))?;
        for (index, panel) in map.panels.iter().enumerate() {
            let frame = Frame::new(panel, LEFT + PITCH * index as f64);
            cells(&canvas, &frame)?;
            axes(&canvas, &frame, panel.axis.unwrap_or(map.axis))?;
            let middle = frame.left + 0.5 * WIDTH;
            write(&canvas, &panel.title, (middle, TOP - 8.0), 16.0, INK, (HPos::Center, VPos::Bottom))?;
            for line in &panel.lines {
                let at = |(column, substeps): (usize, &f64)| {
                    let inside = (frame.range[0]..=frame.range[1]).contains(substeps);
                    inside.then(|| (frame.x(column as f64 + 0.5), frame.y(*substeps)))
                };
                let path: Vec<Pixel> = line.substeps.iter().enumerate().filter_map(at).collect();
                stroke(&canvas, &path, line)?;
            }
        }
        let upright = style(15.0, INK, (HPos::Center, VPos::Top)).transform(FontTransform::Rotate270);
        canvas.draw(&Text::new("substeps per 1/60 s", pixel((12.0, 0.5 * (TOP + BOTTOM))), upright))?;
        legend(&canvas, map)?;
        canvas.present()?;
    }
    Ok(text)
}

fn cells(canvas: &Canvas<'_>, frame: &Frame<'_>) -> Result<(), Trouble> {
    let all = [(frame.x(0.0), TOP), (frame.x(frame.columns.len() as f64), BOTTOM)];
    canvas.draw(&Rectangle::new(all.map(pixel), NOT_RUN.filled()))?;
    for (index, column) in frame.columns.iter().enumerate() {
        let rates: Vec<f64> = column.cells.iter().map(Cell::rate).collect();
        // The border lies halfway between neighboring cells; at the ends it is as far outside.
        let side = |row: usize| match row {
            0 => rates[0] * (rates[0] / rates[1]).sqrt(),
            row if row == rates.len() => rates[row - 1] * (rates[row - 1] / rates[row - 2]).sqrt(),
            row => (rates[row - 1] * rates[row]).sqrt(),
        };
        let mut row = 0;
        for run in column.outcomes.chunk_by(|a, b| a.label == b.label) {
            let ends = [row, row + run.len()].map(|row| frame.y(side(row)));
            row += run.len();
            let corners = [(frame.x(index as f64), ends[1]), (frame.x(index as f64 + 1.0), ends[0])];
            canvas.draw(&Rectangle::new(corners.map(pixel), color(run[0].label).filled()))?;
        }
    }
    Ok(())
}

fn axes(canvas: &Canvas<'_>, frame: &Frame<'_>, label: &str) -> Result<(), Trouble> {
    let (left, right) = (frame.x(0.0), frame.x(frame.columns.len() as f64));
    stroke_thin(canvas, &[(left, TOP), (left, BOTTOM), (right, BOTTOM)])?;
    let endless = frame.columns.last().filter(|column| column.at.is_infinite());
    let last = frame.columns.iter().map(|column| column.at).filter(|at| at.is_finite()).fold(0.0, f64::max);
    for value in ticks([frame.columns[0].at, last]) {
        let Some(x) = frame.at(value) else { continue };
        // Leaves room for the infinity sign.
        if endless.is_some() && x > right - 24.0 {
            continue;
        }
        stroke_thin(canvas, &[(x, BOTTOM), (x, BOTTOM + 5.0)])?;
        write(canvas, &figure(value), (x, BOTTOM + 8.0), TEXT, INK, (HPos::Center, VPos::Top))?;
    }
    if endless.is_some() {
        let x = frame.x(frame.columns.len() as f64 - 0.5);
        stroke_thin(canvas, &[(x, BOTTOM), (x, BOTTOM + 5.0)])?;
        write(canvas, "∞", (x, BOTTOM + 8.0), TEXT, INK, (HPos::Center, VPos::Top))?;
    }
    for value in ticks(frame.range) {
        let y = frame.y(value);
        stroke_thin(canvas, &[(left - 5.0, y), (left, y)])?;
        write(canvas, &figure(value), (left - 8.0, y), TEXT, INK, (HPos::Right, VPos::Center))?;
    }
    write(canvas, label, (0.5 * (left + right), BOTTOM + 30.0), TEXT, INK, (HPos::Center, VPos::Top))
}

/// The decades of a range, or 1, 2 and 5 of each decade if there are few.
fn ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let few = (high / low).log10() < 3.6;
    let steps: &[f64] = if few { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10_f64.powi(decade)));
    all.filter(|value| (low * 0.999..=high * 1.001).contains(value)).collect()
}

fn figure(value: f64) -> String {
    if (1.0..1e4).contains(&(value * 1.001)) { format!("{value:.0}") } else { format!("{value:.0e}") }
}

fn legend(canvas: &Canvas<'_>, map: &Map) -> Result<(), Trouble> {
    let mut x = LEFT;
    let y = BOTTOM + 72.0;
    let mut swatch = |color: RGBColor, name: &str, canvas: &Canvas<'_>| -> Result<(), Trouble> {
        let corners = [(x, y - 8.0), (x + 16.0, y + 8.0)].map(pixel);
        canvas.draw(&Rectangle::new(corners, color.filled()))?;
        canvas.draw(&Rectangle::new(corners, GRAY.stroke_width(1)))?;
        write(canvas, name, (x + 22.0, y), TEXT, INK, (HPos::Left, VPos::Center))?;
        x += 60.0 + 7.4 * name.len() as f64;
        Ok(())
    };
    for label in Label::ALL {
        swatch(color(label), label.name(), canvas)?;
    }
    swatch(NOT_RUN, "not run", canvas)?;
    let mut lines: Vec<&Line> = Vec::new();
    for line in map.panels.iter().flat_map(|panel| &panel.lines) {
        if lines.iter().all(|other| other.name != line.name) {
            lines.push(line);
        }
    }
    for (index, line) in lines.into_iter().enumerate() {
        let (x, y) = (LEFT + 560.0 * (index % 2) as f64, y + 28.0 + 24.0 * (index / 2) as f64);
        stroke(canvas, &[(x, y), (x + 40.0, y)], line)?;
        write(canvas, line.name, (x + 50.0, y), TEXT, INK, (HPos::Left, VPos::Center))?;
    }
    for (index, text) in CAPTION.iter().enumerate() {
        write(canvas, text, (24.0, y + 84.0 + 17.0 * index as f64), SMALL, GRAY, (HPos::Left, VPos::Top))?;
    }
    Ok(())
}

fn pixel((x, y): Pixel) -> (i32, i32) {
    (x.round() as i32, y.round() as i32)
}

fn style(size: f64, color: RGBColor, (h, v): (HPos, VPos)) -> TextStyle<'static> {
    // The backend writes a font of size / 1.24.
    ("sans-serif", size * 1.24).into_font().color(&color).pos(Pos::new(h, v))
}

fn write(canvas: &Canvas<'_>, text: &str, at: Pixel, size: f64, color: RGBColor, anchor: (HPos, VPos)) -> Result<(), Trouble> {
    Ok(canvas.draw(&Text::new(text.to_owned(), pixel(at), style(size, color, anchor)))?)
}

fn stroke_thin(canvas: &Canvas<'_>, path: &[Pixel]) -> Result<(), Trouble> {
    Ok(canvas.draw(&PathElement::new(path.iter().copied().map(pixel).collect::<Vec<_>>(), INK.stroke_width(1)))?)
}

/// Draws a prediction as a line with an outline, which is visible on any color.
fn stroke(canvas: &Canvas<'_>, path: &[Pixel], line: &Line) -> Result<(), Trouble> {
    let path: Vec<(i32, i32)> = path.iter().copied().map(pixel).collect();
    canvas.draw(&PathElement::new(path.clone(), WHITE.stroke_width(4)))?;
    let style = BLACK.stroke_width(2);
    match line.dash {
        None => canvas.draw(&PathElement::new(path, style))?,
        Some((on, off)) => canvas.draw(&DashedPathElement::new(path, on, off, style))?,
    }
    Ok(())
}
