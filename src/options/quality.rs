//! How many substeps a step takes.

/// How many substeps a step is divided into.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Quality {
    /// A fixed number of substeps per 1/60 s. A step of length `dt` takes `ceil(60 dt n)`, so that its substeps are
    /// never longer than those of a step of 1/60 s. Cloth that is too stiff for its substeps stretches as much as the
    /// substep's length lets it; keeping that length makes it stretch equally whatever `dt` is. Positions have 24 bits, so of a motion
    /// by less than 1e-6 of the distance from the cloth's first center in a substep, several percent may be rounded away: 0.02 m/s
    /// at a distance of 0.6 m with 500.
    Substeps(u32),
    /// In every step, 99 percent of the cloth's area is stretched by at most this much beyond what the fabric itself
    /// yields under its load. Short for [`Quality::Hold`] with a share of 0.99.
    ///
    /// What the bound allows may stretch in place of bending. In a drape test, a disc of cotton of 30 cm over one of 18 cm, the hem is
    /// stretched by 1.2 % at the default of 0.03, and the drape coefficient is 47 to 56 % on various meshes; with 0.003 it is 65 to
    /// 66 %, as with hundreds of substeps. So give less where bending shapes the cloth.
    Strain(f32),
    /// As few substeps as keep the stretch of most of the cloth's area below a bound, chosen anew for every step.
    ///
    /// Before the step the number is predicted from what acts on the cloth (gravity, wind, its speed, how pins and
    /// colliders move) by the law `S = S* sqrt(2 sigma f / (K stretch))`, where `S*` is the number that resolves the
    /// stiffness K (N/m) and sigma (N/m) is the membrane stress. After the step the factor f is corrected from the measured
    /// stretch. The number is at least 5 per 1/60 s and at most 1.4 `S*`, more only where contact needs it, also to come
    /// to rest ([`Sleep`](crate::Sleep)). Stretch that remains with 1.4 `S*` is the fabric's own, measured anew after ten
    /// seconds of motion: fewer substeps then do, as long as they leave so much of its tension that friction still holds what is
    /// pulled over a body.
    ///
    /// A step that exceeds the bound, for which at least a quarter more substeps would now be chosen, is undone and taken again with
    /// these, up to three times: what stretched it, as cloth that hits itself, could not be told before. It takes as long as all of
    /// them together. If it still exceeds the bound, [`Warning::StrainMissed`](crate::Warning::StrainMissed) says by how much, and
    /// why.
    ///
    /// The choice is the same on any number of threads. To repeat a step bit for bit, pass
    /// [`StepReport::in_a_sixtieth`](crate::StepReport::in_a_sixtieth) to [`Quality::Substeps`], and
    /// [`StepReport::levels`](crate::StepReport::levels) to [`Levels::Count`](crate::Levels::Count), because a bound may take
    /// fewer levels.
    ///
    /// On the GPU the measurements are three steps old, because a step never waits for one that was submitted shortly
    /// before, and no step is taken again; with contact of triangles it waits anyway. Methods other than the default do not use
    /// the bound: see [`Method`](crate::Method).
    Hold {
        /// Largest stretch, `l/l0 - 1`, beyond the fabric's own stretch under the same load; 0.03 is three percent.
        stretch: f32,
        /// Share of the area that keeps the bound, 0.5 to 1. Each edge counts with the area of its triangles, and all pieces of
        /// the mesh count together: beside a rug that lies still, a handkerchief in the wind is the one percent that
        /// [`Quality::Strain`] leaves out. A share of 1 counts every edge.
        share: f32,
    },
    /// As many substeps as fit into this time (ms) per step, estimated from the time that previous steps took.
    ///
    /// At least one, with contact of triangles as many as keep the cloth from being stretched by about 5 % under its weight, and
    /// at least 5 per 1/60 s: with fewer it is stretched so far that contact takes longer. At most 1.4 `S*` (see
    /// [`Quality::Hold`]). Nothing warns of a time that is too short even for these.
    ///
    /// Timings differ between runs, so a run cannot be repeated exactly; a single step of 1/60 s can, by its
    /// [`StepReport::in_a_sixtieth`](crate::StepReport::in_a_sixtieth). Not available on the GPU, where a step returns
    /// before the work is done. [`Deformer::step_all`](crate::Deformer::step_all) does not time individual cloths: one that
    /// was never stepped by itself takes these, or 5 substeps per 1/60 s. Methods other than the default do not use the time.
    Budget(f32),
}

impl Quality {
    /// Share of the area that [`Quality::Strain`] applies to.
    pub(crate) const MOST_OF_THE_AREA: f32 = 0.99;
}

impl Default for Quality {
    fn default() -> Quality {
        Quality::Strain(0.03)
    }
}
