//! Draws a chart with two logarithmic axes. Curves differ by markers, line styles and labels, so that they can be told
//! apart without color.

use std::collections::BTreeSet;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Pixel = (f64, f64);
/// An error of the drawing backend.
pub(crate) type Trouble = Box<dyn std::error::Error>;

const SIZE: (u32, u32) = (960, 680);
/// The plot's left, top, right and bottom (px).
const PLOT: [f64; 4] = [92.0, 100.0, 930.0, 556.0];
const INK: RGBColor = RGBColor(30, 30, 30);
const GRAY: RGBColor = RGBColor(100, 100, 100);
const GRID: RGBColor = RGBColor(232, 232, 232);
const DECADE: RGBColor = RGBColor(200, 200, 200);
const FRONT: RGBColor = RGBColor(214, 206, 184);
const BAND: RGBColor = RGBColor(240, 240, 240);
/// Height of most text (px).
const TEXT: f64 = 14.0;
/// Height of the numbers along the curves (px).
const SMALL: f64 = 12.0;

/// A chart.
pub(crate) struct Chart {
    /// The title, which states the finding.
    pub(crate) title: String,
    /// Lines below the title.
    pub(crate) subtitle: Vec<String>,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) curves: Vec<Curve>,
    /// The Pareto front, by increasing x.
    pub(crate) front: Vec<(f64, f64)>,
    /// The y below which values are good enough, and a word about it.
    pub(crate) bound: Option<(f64, String)>,
    /// The y below which values mean nothing, and why.
    pub(crate) floor: Option<(f64, String)>,
    /// Lines below the chart.
    pub(crate) caption: Vec<String>,
}

/// An axis.
pub(crate) struct Axis {
    pub(crate) label: String,
    /// Values with a label; empty: at the decades, and more if there are few.
    pub(crate) ticks: Vec<f64>,
}

/// A curve.
pub(crate) struct Curve {
    pub(crate) name: String,
    pub(crate) look: Look,
    /// x, y and a label, in order; at least one point.
    pub(crate) points: Vec<(f64, f64, String)>,
}

/// The style of a curve.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look {
    pub(crate) marker: Marker,
    pub(crate) line: Line,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum Marker {
    Circle,
    Square,
    Triangle,
    Diamond,
}

/// Solid lines have filled markers, other lines hollow ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Line {
    Solid,
    Dashed,
    Dotted,
}

impl Marker {
    fn color(self) -> RGBColor {
        match self {
            Marker::Circle => RGBColor(20, 80, 150),
            Marker::Square => RGBColor(170, 75, 20),
            Marker::Triangle => RGBColor(35, 115, 50),
            Marker::Diamond => RGBColor(120, 50, 130),
        }
    }
}

/// The mapping from values to pixels.
struct Frame {
    x: Scale,
    y: Scale,
}

/// The mapping of one axis.
struct Scale {
    /// Smallest and largest value.
    range: [f64; 2],
    /// Their pixels.
    pixels: [f64; 2],
}

impl Scale {
    /// Covers the values, extended to the next 1, 2 or 5 and a little more.
    fn covering(values: impl Iterator<Item = f64>, pixels: [f64; 2]) -> Scale {
        let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), v| (low.min(v), high.max(v)));
        let (low, high) = if high > 0.0 { (low, high) } else { (0.1, 10.0) };
        let steps = |value: f64| {
            let decade = 10_f64.powf(value.log10().floor());
            [1.0, 2.0, 5.0, 10.0].map(|step| step * decade)
        };
        let down = steps(low * 0.85).into_iter().rfind(|&step| step <= low * 0.85).unwrap_or(low);
        let up = steps(high * 1.2).into_iter().find(|&step| step >= high * 1.2).unwrap_or(high);
        Scale { range: [down, up], pixels }
    }

    fn at(&self, value: f64) -> f64 {
        let [low, high] = self.range.map(f64::log10);
        let [from, to] = self.pixels;
        from + (to - from) * (value.log10() - low) / (high - low)
    }

    /// Gridlines, and which of them are at a decade.
    fn lines(&self) -> Vec<(f64, bool)> {
        let [low, high] = self.range;
        let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
        let lines = decades.flat_map(|decade| (1..10).map(move |k| (f64::from(k) * 10_f64.powi(decade), k == 1)));
        lines.filter(|(value, _)| (low * 0.999..=high * 1.001).contains(value)).collect()
    }

    /// Values to label on the axis.
    fn ticks(&self, wanted: &[f64]) -> Vec<f64> {
        if !wanted.is_empty() {
            return wanted.to_vec();
        }
        let [low, high] = self.range;
        let few = (high / low).log10() < 3.01;
        let first = |value: f64| (value / 10_f64.powf((value * 1.001).log10().floor())).round() as u32;
        let keep = |value: f64, decade: bool| decade || (few && matches!(first(value), 2 | 5));
        self.lines().into_iter().filter(|&(value, decade)| keep(value, decade)).map(|(value, _)| value).collect()
    }
}

/// The occupied boxes (left, top, right, bottom), which labels avoid.
struct Room {
    taken: Vec<[f64; 4]>,
}

impl Room {
    fn take_line(&mut self, from: Pixel, to: Pixel) {
        let count = ((to.0 - from.0).hypot(to.1 - from.1) / 4.0).ceil().max(1.0);
        for k in 0..=count as u32 {
            let t = f64::from(k) / count;
            let (x, y) = (from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1));
            self.taken.push([x - 1.5, y - 1.5, x + 1.5, y + 1.5]);
        }
    }

    /// The area of the box that is occupied (px²).
    fn overlap(&self, [l, t, r, b]: [f64; 4]) -> f64 {
        let area = |o: &[f64; 4]| (r.min(o[2]) - l.max(o[0])).max(0.0) * (b.min(o[3]) - t.max(o[1])).max(0.0);
        self.taken.iter().map(area).sum()
    }

    /// The least occupied box of `size` around `anchor` at one of the distances, nearest first, and the area of it that
    /// is occupied.
    fn find(&self, anchor: Pixel, size: Pixel, distances: &[f64]) -> ([f64; 4], f64) {
        let mut best = ([0.0; 4], f64::INFINITY);
        for &distance in distances {
            // To the right first, then around.
            for turn in [0, 1, 15, 2, 14, 12, 4, 3, 13, 8, 7, 9, 6, 10, 5, 11] {
                let angle = f64::from(turn) * std::f64::consts::TAU / 16.0;
                let (dx, dy) = (angle.cos(), -angle.sin());
                let x = anchor.0 + dx * (distance + size.0 / 2.0);
                let y = anchor.1 + dy * (distance + size.1 / 2.0);
                let place = [x - size.0 / 2.0, y - size.1 / 2.0, x + size.0 / 2.0, y + size.1 / 2.0];
                let inside = place[0] > PLOT[0] + 2.0 && place[1] > PLOT[1] + 2.0 && place[2] < PLOT[2] && place[3] < PLOT[3];
                let overlap = self.overlap(place) + 0.01 * distance;
                if inside && overlap < best.1 {
                    best = (place, overlap);
                }
            }
        }
        best
    }
}

impl Chart {
    /// The chart as an SVG file's text.
    pub(crate) fn svg(&self) -> Result<String, Trouble> {
        let mut text = String::new();
        {
            let canvas = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            canvas.fill(&WHITE)?;
            let points = || self.curves.iter().flat_map(|curve| &curve.points);
            let lowest = points().map(|p| p.1).fold(f64::INFINITY, f64::min);
            // A short label inside the band, if the band's edge is near.
            let floor = self.floor.as_ref().map(|(floor, _)| *floor).filter(|floor| *floor > 0.3 * lowest);
            let frame = Frame {
                x: Scale::covering(points().map(|p| p.0).chain(self.x.ticks.iter().copied()), [PLOT[0], PLOT[2]]),
                y: Scale::covering(
                    points().map(|p| p.1).chain(floor.map(|floor| 0.4 * floor)).chain(self.bound.iter().map(|bound| bound.0)),
                    [PLOT[3], PLOT[1]],
                ),
            };
            self.axes(&canvas, &frame)?;
            self.front(&canvas, &frame)?;
            self.curves(&canvas, &frame)?;
            canvas.present()?;
        }
        Ok(text)
    }

    fn axes(&self, canvas: &Canvas<'_>, frame: &Frame) -> Result<(), Trouble> {
        let [left, top, right, bottom] = PLOT;
        if let Some((floor, _)) = self.floor.as_ref().filter(|(floor, _)| *floor > frame.y.range[0]) {
            let y = frame.y.at(*floor);
            canvas.draw(&Rectangle::new([(left, y), (right, bottom)].map(pixel), BAND.filled()))?;
            stroke(canvas, &[(left, y), (right, y)], GRAY, 1, Line::Dashed)?;
        }
        for (value, decade) in frame.x.lines() {
            let x = frame.x.at(value);
            stroke(canvas, &[(x, top), (x, bottom)], if decade { DECADE } else { GRID }, 1, Line::Solid)?;
        }
        for (value, decade) in frame.y.lines() {
            let y = frame.y.at(value);
            stroke(canvas, &[(left, y), (right, y)], if decade { DECADE } else { GRID }, 1, Line::Solid)?;
        }
        if let Some((bound, what)) = &self.bound {
            let y = frame.y.at(*bound);
            stroke(canvas, &[(left, y), (right, y)], INK, 1, Line::Dashed)?;
            write(canvas, what, (right - 6.0, y - 4.0), SMALL, INK, (HPos::Right, VPos::Bottom))?;
        }
        stroke(canvas, &[(left, top), (left, bottom), (right, bottom)], INK, 1, Line::Solid)?;
        if let Some((floor, why)) = &self.floor {
            let (paper, top) = (if *floor > frame.y.range[0] { BAND } else { WHITE }, bottom - 20.0);
            let place = [(left + 4.0, top), (left + 8.0 + width(why, SMALL), bottom - 4.0)];
            canvas.draw(&Rectangle::new(place.map(pixel), paper.filled()))?;
            write(canvas, why, (left + 8.0, top + 2.0), SMALL, GRAY, (HPos::Left, VPos::Top))?;
        }
        for value in frame.x.ticks(&self.x.ticks) {
            let x = frame.x.at(value);
            stroke(canvas, &[(x, bottom), (x, bottom + 5.0)], INK, 1, Line::Solid)?;
            write(canvas, &format!("{value}"), (x, bottom + 8.0), TEXT, INK, (HPos::Center, VPos::Top))?;
        }
        for value in frame.y.ticks(&self.y.ticks) {
            let y = frame.y.at(value);
            stroke(canvas, &[(left - 5.0, y), (left, y)], INK, 1, Line::Solid)?;
            write(canvas, &format!("{value:e}"), (left - 9.0, y), TEXT, INK, (HPos::Right, VPos::Center))?;
        }
        write(canvas, &self.title, (24.0, 14.0), 20.0, INK, (HPos::Left, VPos::Top))?;
        for (line, text) in (0_u8..).zip(&self.subtitle) {
            write(canvas, text, (24.0, 46.0 + 20.0 * f64::from(line)), TEXT, GRAY, (HPos::Left, VPos::Top))?;
        }
        write(canvas, &self.x.label, (0.5 * (left + right), bottom + 30.0), 15.0, INK, (HPos::Center, VPos::Top))?;
        let upright = style(15.0, INK, (HPos::Center, VPos::Top)).transform(FontTransform::Rotate270);
        canvas.draw(&Text::new(self.y.label.clone(), pixel((16.0, 0.5 * (top + bottom))), upright))?;
        for (line, text) in (0_u8..).zip(&self.caption) {
            write(canvas, text, (24.0, bottom + 66.0 + 17.0 * f64::from(line)), SMALL, GRAY, (HPos::Left, VPos::Top))?;
        }
        Ok(())
    }

    /// The front as a staircase: the smallest error for a given time.
    fn front(&self, canvas: &Canvas<'_>, frame: &Frame) -> Result<(), Trouble> {
        let mut steps: Vec<Pixel> = Vec::new();
        for &(x, y) in &self.front {
            let next = (frame.x.at(x), frame.y.at(y));
            steps.push((next.0, steps.last().map_or(PLOT[1], |last| last.1)));
            steps.push(next);
        }
        if let Some(&(_, y)) = steps.last() {
            steps.push((PLOT[2], y));
        }
        stroke(canvas, &steps, FRONT, 7, Line::Solid)
    }

    fn curves(&self, canvas: &Canvas<'_>, frame: &Frame) -> Result<(), Trouble> {
        let at = |point: &(f64, f64, String)| (frame.x.at(point.0), frame.y.at(point.1));
        let mut room = Room { taken: Vec::new() };
        for curve in &self.curves {
            let path: Vec<Pixel> = curve.points.iter().map(at).collect();
            path.windows(2).for_each(|pair| room.take_line(pair[0], pair[1]));
            for &(x, y) in &path {
                room.taken.push([x - 6.0, y - 6.0, x + 6.0, y + 6.0]);
            }
            stroke(canvas, &path, curve.look.marker.color(), 2, curve.look.line)?;
        }
        for curve in &self.curves {
            for point in &curve.points {
                let meaningful = self.floor.as_ref().is_none_or(|(floor, _)| point.1 > *floor);
                mark(canvas, at(point), curve.look, meaningful)?;
            }
        }
        // The numbers at the ends of the curves and the curves' names are placed first, then as many other numbers as
        // fit.
        let ends = |curve: &Curve| BTreeSet::from([0, curve.points.len() - 1]);
        for curve in &self.curves {
            for index in ends(curve) {
                figure(canvas, &mut room, curve, index, at(&curve.points[index]))?;
            }
        }
        for curve in &self.curves {
            let Some(end) = curve.points.last().map(at) else { continue };
            let (place, _) = room.find(end, (width(&curve.name, TEXT), TEXT + 2.0), &[9.0, 16.0, 26.0, 40.0, 60.0]);
            room.taken.push(place);
            write(canvas, &curve.name, (place[0], place[1] + 1.0), TEXT, curve.look.marker.color(), (HPos::Left, VPos::Top))?;
        }
        for curve in &self.curves {
            for index in (0..curve.points.len()).filter(|index| !ends(curve).contains(index)) {
                figure(canvas, &mut room, curve, index, at(&curve.points[index]))?;
            }
        }
        Ok(())
    }
}

/// Places a point's label, if there is room.
fn figure(canvas: &Canvas<'_>, room: &mut Room, curve: &Curve, index: usize, at: Pixel) -> Result<(), Trouble> {
    let text = &curve.points[index].2;
    let (place, overlap) = room.find(at, (width(text, SMALL), SMALL), &[8.0, 11.0]);
    if overlap < 1.0 {
        room.taken.push(place);
        write(canvas, text, (place[0], place[1]), SMALL, curve.look.marker.color(), (HPos::Left, VPos::Top))?;
    }
    Ok(())
}

fn pixel((x, y): Pixel) -> (i32, i32) {
    (x.round() as i32, y.round() as i32)
}

/// Approximate width of a text (px).
fn width(text: &str, size: f64) -> f64 {
    0.56 * size * text.chars().count() as f64
}

fn style(size: f64, color: RGBColor, (h, v): (HPos, VPos)) -> TextStyle<'static> {
    // The backend writes a font of size / 1.24.
    ("sans-serif", size * 1.24).into_font().color(&color).pos(Pos::new(h, v))
}

fn write(canvas: &Canvas<'_>, text: &str, at: Pixel, size: f64, color: RGBColor, anchor: (HPos, VPos)) -> Result<(), Trouble> {
    Ok(canvas.draw(&Text::new(text.to_owned(), pixel(at), style(size, color, anchor)))?)
}

fn stroke(canvas: &Canvas<'_>, path: &[Pixel], color: RGBColor, width: u32, line: Line) -> Result<(), Trouble> {
    let path = path.iter().copied().map(pixel);
    let style = color.stroke_width(width);
    match line {
        Line::Solid => canvas.draw(&PathElement::new(path.collect::<Vec<_>>(), style))?,
        Line::Dashed => canvas.draw(&DashedPathElement::new(path, 9, 5, style))?,
        Line::Dotted => canvas.draw(&DashedPathElement::new(path, 2, 5, style))?,
    }
    Ok(())
}

/// Draws a marker; a hollow gray one if its value means nothing.
fn mark(canvas: &Canvas<'_>, at: Pixel, look: Look, meaningful: bool) -> Result<(), Trouble> {
    let color = if meaningful { look.marker.color() } else { GRAY };
    let inside = if meaningful && look.line == Line::Solid { color } else { WHITE };
    let (x, y) = pixel(at);
    let corners = match look.marker {
        Marker::Circle => {
            canvas.draw(&Circle::new((x, y), 5, inside.filled()))?;
            canvas.draw(&Circle::new((x, y), 5, color.stroke_width(2)))?;
            return Ok(());
        }
        Marker::Square => vec![(x - 5, y - 5), (x + 5, y - 5), (x + 5, y + 5), (x - 5, y + 5), (x - 5, y - 5)],
        Marker::Triangle => vec![(x, y - 6), (x + 6, y + 5), (x - 6, y + 5), (x, y - 6)],
        Marker::Diamond => vec![(x, y - 7), (x + 7, y), (x, y + 7), (x - 7, y), (x, y - 7)],
    };
    canvas.draw(&Polygon::new(corners.clone(), inside.filled()))?;
    canvas.draw(&PathElement::new(corners, color.stroke_width(2)))?;
    Ok(())
}
