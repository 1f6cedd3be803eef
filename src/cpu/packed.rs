//! What the stages of a step read, in the form in which they read it: the coefficients packed for SIMD, and the
//! schedules of the stages.

use crate::cpu::coarse::Coarse;
use crate::cpu::edge_batches::EdgeBatches;
use crate::cpu::forces::ForceArrays;
use crate::cpu::partition::{Partition, Piece};
use crate::cpu::schedule::Schedule;
use crate::cpu::stages::Terms;
use crate::cpu::tethers::TetherBatches;
use crate::model::cloth::Change;
use crate::options::Method;
use crate::simd::Width;
use crate::step::plan::Plan;
use crate::step::substep_count::Length;

/// What the stages of a step read besides the state.
pub(super) struct Packed {
    pub forces: ForceArrays,
    pub coarse: Coarse,
    pub partition: Option<Partition>,
    /// Whether it keeps apart what bending reads without an edge.
    bends: bool,
    /// The edges of each round of the partition.
    pub edges: Vec<EdgeBatches>,
    /// The edges of each round on the way back; empty if none are in shells.
    pub edges_back: Vec<EdgeBatches>,
    /// The tethers of each round of the partition; empty if none are in use.
    pub tethers: Vec<TetherBatches>,
    /// One schedule, or three with contact of triangles ([`Schedule::all`]).
    pub schedules: Vec<Schedule>,
    /// What the schedules were made for.
    pub terms: Option<Terms>,
    /// What the coefficients were packed for: length of the substep, number of levels, threads of the pool.
    coefficients_for: Option<(Length, usize, usize)>,
    pub width: Width,
}

impl Packed {
    pub(super) fn new(width: Width) -> Packed {
        Packed {
            forces: ForceArrays::default(),
            coarse: Coarse::default(),
            partition: None,
            bends: false,
            edges: Vec::new(),
            edges_back: Vec::new(),
            tethers: Vec::new(),
            schedules: Vec::new(),
            terms: None,
            coefficients_for: None,
            width,
        }
    }

    /// Discards what a change of masses or edges makes invalid.
    pub(super) fn forget(&mut self, change: Change) {
        self.coarse = Coarse::default();
        (self.coefficients_for, self.terms) = (None, None);
        if change == Change::Edges {
            (self.partition, self.edges, self.edges_back) = (None, Vec::new(), Vec::new());
        }
    }

    /// Packs what a plan needs for a pool of `threads`. With `exchanged`, another engine computes the forces. Returns
    /// true if the schedules are new.
    pub(super) fn pack(&mut self, plan: &Plan<'_>, exchanged: bool, contact: bool, threads: usize) -> bool {
        let coefficients = plan.coefficients;
        if plan.bending
            && !exchanged
            && !std::mem::replace(&mut self.bends, true)
            && !plan.cloth.bending().across_bases.is_empty()
        {
            self.forget(Change::Edges);
        }
        let levels = coefficients.levels.len();
        let packed = Some((coefficients.length, levels, threads));
        if self.coefficients_for != packed {
            if self.coefficients_for.is_none_or(|(_, _, before)| before != threads) {
                self.coarse = Coarse::default();
                self.terms = None;
            }
            self.coefficients_for = packed;
            self.pack_coefficients(plan, threads);
        }
        let partition = self.partition.as_ref().expect("made with the coefficients");
        let terms = Terms {
            exchanged,
            falls: !(exchanged || plan.has_forces()),
            bending: plan.bending && !exchanged,
            passes: if exchanged { 0 } else { coefficients.bending.passes.len() },
            air: plan.air && !exchanged,
            springs: plan.method == Method::Springs && !exchanged,
            pins: !plan.pins.is_empty(),
            levels,
            shells: !self.edges_back.is_empty(),
            tethers: !self.tethers.is_empty(),
            threads,
            contact,
        };
        self.forces.pack(plan, terms.bending, terms.air, &partition.tiles, self.width);
        let is_new = self.terms != Some(terms);
        if is_new {
            self.schedules = Schedule::all(terms, partition, &self.coarse, &self.forces.panel_tiles);
            self.terms = Some(terms);
        }
        is_new
    }

    /// Packs the coefficients of edges, tethers and levels.
    fn pack_coefficients(&mut self, plan: &Plan<'_>, threads: usize) {
        let (coefficients, cloth, lanes) = (plan.coefficients, plan.cloth, self.width.lanes());
        let (edges, held, inverse_mass) = (&coefficients.edges, &coefficients.tethers, cloth.inverse_mass());
        let apart = if self.bends { cloth.bending().across_bases.as_slice() } else { &[] };
        let cut = || Partition::new(&cloth.links, cloth.swept().len(), apart, cloth.rest.len());
        let partition = self.partition.get_or_insert_with(cut);
        if self.edges.is_empty() {
            let pack = |pieces: &Vec<Piece>| EdgeBatches::new(pieces, edges, &cloth.colors, &inverse_mass, lanes);
            self.edges = partition.rounds.iter().map(pack).collect();
            self.edges_back = partition.rounds_back(cloth).iter().map(pack).collect();
        } else {
            let rounds = self.edges.iter_mut().chain(&mut self.edges_back);
            rounds.for_each(|round| round.update_shares(edges, &inverse_mass));
        }
        let pack = |pieces: &Vec<Piece>| TetherBatches::new(pieces, held, cloth.rest.len(), lanes);
        self.tethers = if held.is_empty() { Vec::new() } else { partition.rounds.iter().map(pack).collect() };
        self.coarse.pack(plan.levels, &coefficients.levels, self.width, threads);
    }
}
