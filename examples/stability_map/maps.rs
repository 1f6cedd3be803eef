//! The five maps: their axes, their predictions, and their cells.

use cloth_deformer::Method;
use rayon::prelude::*;

use crate::cell::{Cell, Label, Outcome};
use crate::sheet::Sheet;
use crate::theory;
use crate::truth::Truth;

const RELAXATION: Method = Method::Relaxation { iterations: 10 };

/// A map: a panel for each method.
pub(crate) struct Map {
    /// Name for files.
    pub(crate) name: &'static str,
    pub(crate) title: &'static str,
    /// Name of the horizontal axis.
    pub(crate) axis: &'static str,
    pub(crate) panels: Vec<Panel>,
}

/// The cells of one method.
pub(crate) struct Panel {
    pub(crate) title: String,
    /// Name of the horizontal axis, if it differs from that of the map.
    pub(crate) axis: Option<&'static str>,
    pub(crate) columns: Vec<Column>,
    pub(crate) lines: Vec<Line>,
}

/// Cells that differ only in the substep, by increasing number of substeps.
pub(crate) struct Column {
    /// Position on the axis; an infinite value is placed after the others.
    pub(crate) at: f64,
    pub(crate) cells: Vec<Cell>,
    /// The results, once the cells have run.
    pub(crate) outcomes: Vec<Outcome>,
}

/// A prediction: substeps per 1/60 s for each column.
pub(crate) struct Line {
    pub(crate) name: &'static str,
    /// Lengths (px) of dashes and gaps, if the line is dashed.
    pub(crate) dash: Option<(u32, u32)>,
    /// Whether it is the limit below which explicit springs fail.
    pub(crate) is_limit: bool,
    pub(crate) substeps: Vec<f64>,
}

impl Map {
    /// All maps, before they are run.
    pub(crate) fn all() -> Vec<Map> {
        vec![stiffness(), resolution(), bending(), mass_ratio(), step_ratio()]
    }

    /// Number of cells.
    pub(crate) fn count(&self) -> usize {
        self.panels.iter().flat_map(|panel| &panel.columns).map(|column| column.cells.len()).sum()
    }

    /// Runs all cells in parallel.
    pub(crate) fn run(&mut self) {
        let mut sheets: Vec<Sheet> = Vec::new();
        for cell in self.panels.iter().flat_map(|panel| &panel.columns).flat_map(|column| &column.cells) {
            if !sheets.contains(&cell.sheet) {
                sheets.push(cell.sheet);
            }
        }
        let truths: Vec<Truth> = sheets.par_iter().map(Truth::of).collect();
        let truth = |sheet: &Sheet| &truths[sheets.iter().position(|other| other == sheet).expect("listed above")];
        let columns: Vec<&mut Column> = self.panels.iter_mut().flat_map(|panel| &mut panel.columns).collect();
        columns.into_par_iter().for_each(|column| {
            column.outcomes = column.cells.par_iter().map(|cell| cell.run(truth(&cell.sheet))).collect();
        });
    }
}

impl Panel {
    fn new(title: &str, columns: Vec<Column>, predictions: &[Prediction]) -> Panel {
        let line = |&Prediction { name, dash, is_limit, predict }: &Prediction| {
            let substeps = columns.iter().map(|column| predict(&column.cells[0].sheet)).collect();
            Line { name, dash, is_limit, substeps }
        };
        let lines = predictions.iter().map(line).collect();
        Panel { title: title.to_owned(), axis: None, columns, lines }
    }

    /// For each column with a limit, the ratio of the measured limit to the prediction. The measured limit is the
    /// geometric mean of the last cell that fails and the next one, from which on none fails.
    pub(crate) fn measured_over(&self, line: &Line) -> Vec<f64> {
        let boundary = |(column, predicted): (&Column, &f64)| {
            let last = column.outcomes.iter().rposition(|outcome| outcome.label.is_failure())?;
            let above = column.cells.get(last + 1)?;
            Some((column.cells[last].rate() * above.rate()).sqrt() / predicted)
        };
        self.columns.iter().zip(&line.substeps).filter_map(boundary).collect()
    }

    /// Number of cells with a label.
    pub(crate) fn count(&self, label: Label) -> usize {
        self.columns.iter().flat_map(|column| &column.outcomes).filter(|outcome| outcome.label == label).count()
    }
}

/// A prediction that any panel may show.
#[derive(Clone, Copy)]
struct Prediction {
    name: &'static str,
    dash: Option<(u32, u32)>,
    is_limit: bool,
    predict: fn(&Sheet) -> f64,
}

const RESOLVED: Prediction = Prediction {
    name: "resolved stiffness: S* = √(k (w₁ + w₂) / 2) / 60",
    dash: Some((5, 3)),
    is_limit: false,
    predict: theory::resolved,
};
const FLAT: Prediction = Prediction {
    name: "explicit limit h = 2/ω, ω of the flat sheet",
    dash: None,
    is_limit: true,
    predict: theory::explicit_flat,
};
const GRAPH: Prediction = Prediction {
    name: "the same for any shape: ω² ≤ λ + min(λ, g), λ of the graph's Laplacian",
    dash: Some((3, 3)),
    is_limit: true,
    predict: theory::explicit,
};
const LIMITER: Prediction =
    Prediction { name: "bending is softened below: h² g = 2", dash: Some((16, 6)), is_limit: false, predict: theory::limiter };

const FILTERED: Prediction =
    Prediction {
        name: "bending is softened below: h² g = 411, what sixteen passes carry", predict: theory::filtered, ..LIMITER
    };

/// `count` values in a geometric progression.
fn ratios(from: f64, to: f64, count: u32) -> Vec<f64> {
    (0..count).map(|k| from * (to / from).powf(f64::from(k) / f64::from(count - 1))).collect()
}

/// The distinct integers nearest to the values of a geometric progression.
fn whole_ratios(from: f64, to: f64, count: u32) -> Vec<f64> {
    let mut values: Vec<f64> = ratios(from, to, count).into_iter().map(f64::round).collect();
    values.dedup();
    values
}

fn column(at: f64, sheet: Sheet, method: Method, substeps: &[f64]) -> Column {
    let mut cells: Vec<Cell> = substeps.iter().map(|&wanted| Cell::new(sheet, method, wanted)).collect();
    cells.sort_by(|a, b| a.rate().total_cmp(&b.rate()));
    cells.dedup();
    Column { at, cells, outcomes: Vec::new() }
}

/// A column for springs: from a quarter of the predicted limit to twice the limit, dense around it.
fn springs(at: f64, sheet: Sheet) -> Column {
    let limit = theory::explicit(&sheet);
    let all = ratios(0.25, 2.0, 13).into_iter().chain(ratios(0.7, 1.4, 29));
    let substeps: Vec<f64> = all.map(|ratio| (limit * ratio).max(1.0)).collect();
    column(at, sheet, Method::Springs, &substeps)
}

fn stiffness() -> Map {
    let sheet = |stretch: f64| Sheet { stretch, ..Sheet::cotton(13) };
    let all = whole_ratios(1.0, 1000.0, 40);
    let stiffnesses = ratios(1e2, 1e9, 43).into_iter().chain([f64::INFINITY]);
    let small = stiffnesses.map(|k| column(k, sheet(k), Method::SmallSteps, &all)).collect();
    let explicit = ratios(1e2, 1e6, 33).into_iter().map(|k| springs(k, sheet(k))).collect();
    let iterations = whole_ratios(1.0, 100.0, 24).into_iter();
    let relaxed = iterations.map(|k| {
        let method = Method::Relaxation { iterations: k as u32 };
        column(k, sheet(f64::INFINITY), method, &whole_ratios(1.0, 100.0, 24))
    });
    let mut relaxation = Panel::new("Relaxation (knows no K)", relaxed.collect(), &[]);
    relaxation.axis = Some("iterations");
    Map {
        name: "stiffness",
        title: "Substep and membrane stiffness: 13 x 13 vertices",
        axis: "membrane stiffness K (N/m)",
        panels: vec![Panel::new("SmallSteps", small, &[RESOLVED]), Panel::new("Springs", explicit, &[FLAT, GRAPH]), relaxation],
    }
}

/// Panels for the three methods over the same axis of sheets.
fn three(axis: &[f64], sheet: impl Fn(f64) -> Sheet, substeps: &[f64], predictions: &[Prediction]) -> Vec<Panel> {
    let columns = |method| axis.iter().map(|&at| column(at, sheet(at), method, substeps)).collect();
    vec![
        Panel::new("SmallSteps", columns(Method::SmallSteps), &[&[RESOLVED], predictions].concat()),
        Panel::new("Springs", axis.iter().map(|&at| springs(at, sheet(at))).collect(), &[&[FLAT, GRAPH], predictions].concat()),
        Panel::new("Relaxation x 10", columns(RELAXATION), predictions),
    ]
}

fn resolution() -> Map {
    let sizes = [3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 17, 19, 21, 23, 25, 29, 33].map(f64::from);
    Map {
        name: "resolution",
        title: "Substep and resolution: K = 5000 N/m, coarse levels from N = 32 on",
        axis: "vertices along a side N",
        panels: three(&sizes, |n| Sheet::cotton(n as u32), &whole_ratios(1.0, 250.0, 32), &[]),
    }
}

fn bending() -> Map {
    let sheet = |bending: f64| Sheet { bending, ..Sheet::cotton(13) };
    let mut panels = three(&ratios(1e-6, 1e2, 33), sheet, &whole_ratios(1.0, 400.0, 34), &[LIMITER]);
    panels[0] = Panel::new("SmallSteps", std::mem::take(&mut panels[0].columns), &[RESOLVED, FILTERED]);
    Map {
        name: "bending",
        title: "Substep and bending rigidity: 13 x 13 vertices, K = 5000 N/m",
        axis: "bending rigidity B (N m)",
        panels,
    }
}

fn mass_ratio() -> Map {
    let sheet = |mass_ratio: f64| Sheet { stretch: 1e5, mass_ratio, ..Sheet::cotton(9) };
    Map {
        name: "mass",
        title: "Substep and mass ratio: the bottom row heavier, 9 x 9 vertices, K = 1e5 N/m",
        axis: "mass of the bottom row's vertices / the others'",
        panels: three(&ratios(1.0, 1e4, 29), sheet, &whole_ratios(1.0, 400.0, 34), &[]),
    }
}

fn step_ratio() -> Map {
    let sheet = Sheet::cotton(13);
    let all = ratios(1.0, 10.0, 28);
    let alternate = |mut column: Column, ratio: f64| {
        column.cells.iter_mut().for_each(|cell| cell.step_ratio = ratio);
        column
    };
    let panel = |title: &str, method, substeps: &[f64], predictions: &[Prediction]| {
        let columns = all.iter().map(|&ratio| alternate(column(ratio, sheet, method, substeps), ratio));
        let mut panel = Panel::new(title, columns.collect(), predictions);
        // The limits apply to constant steps. With alternating steps, sequences of substeps resonate with the springs
        // above them.
        panel.lines.iter_mut().for_each(|line| line.is_limit = false);
        panel
    };
    let substeps = whole_ratios(1.0, 250.0, 32);
    let explicit: Vec<f64> = whole_ratios(10.0, 400.0, 40);
    Map {
        name: "steps",
        title: "Substep and ratio of one step to the next: 13 x 13 vertices, K = 5000 N/m",
        axis: "dt / next dt, their mean 1/60 s",
        panels: vec![
            panel("SmallSteps", Method::SmallSteps, &substeps, &[RESOLVED]),
            panel("Springs", Method::Springs, &explicit, &[FLAT, GRAPH]),
            panel("Relaxation x 10", RELAXATION, &substeps, &[]),
        ],
    }
}
