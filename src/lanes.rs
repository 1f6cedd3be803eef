//! Edges in lanes of eight that share no vertex, and the loop over them: plain, and with AVX2 where the machine has it.
//!
//! The intricate part of the CPU backend, kept inside this wall: [`kernels::project`] is what it computes, and its oracle.

use std::ops::Range;

use glam::{Vec3A, Vec4};

use crate::crew::Shared;
use crate::kernels::{self, Edge, xyz};
use crate::stripes::Task;

pub(crate) const WIDTH: usize = 8;

/// Eight edges of one colour. A lane without an edge repeats another with no weight.
#[repr(C, align(32))]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lanes {
    a: [u32; WIDTH],
    b: [u32; WIDTH],
    inverse_rest: [f32; WIDTH],
    /// The edge's `inverse_weight` times its end's inverse mass: the share of the correction that the end takes.
    share_a: [f32; WIDTH],
    share_b: [f32; WIDTH],
}

/// The lanes of a list of tasks.
#[derive(Debug, Default)]
pub(crate) struct Packed {
    lanes: Vec<Lanes>,
    of: Vec<Range<usize>>,
    vertices: usize,
}

impl Packed {
    /// Packs the edges of `tasks`, which are places in `edges`, colour by colour, given the vertices' inverse masses.
    ///
    /// # Panics
    /// If an edge's vertex has no inverse mass, or a colour names a vertex twice.
    pub(crate) fn pack(&mut self, tasks: &[Task], edges: &[Edge], colors: &[Range<usize>], inverse_mass: &[f32]) {
        self.lanes.clear();
        self.of.clear();
        self.vertices = inverse_mass.len();
        for task in tasks {
            let start = self.lanes.len();
            // Springs are forces: no edge is swept.
            let mut rest = if edges.is_empty() { &[] } else { task.edges.as_slice() };
            for color in colors {
                let (now, later) = rest.split_at(rest.partition_point(|&place| (place as usize) < color.end));
                self.lanes.extend(now.chunks(WIDTH).map(|places| Lanes::new(places, edges, inverse_mass)));
                rest = later;
            }
            self.of.push(start..self.lanes.len());
        }
    }

    /// Visits the edges of one task in order. `wide` says that the processor has AVX2 and FMA.
    ///
    /// # Safety
    /// No other thread may write `u` at the task's vertices meanwhile, nor `x`, nor read `u` there; both have as many
    /// items as the inverse masses that the edges were packed with.
    #[expect(unsafe_code, reason = "see the safety section; tasks are kept apart by Stripes and Crew")]
    pub(crate) unsafe fn sweep(&self, task: usize, x: Shared<Vec4>, u: Shared<Vec4>, rule: Rule, wide: bool) {
        debug_assert!(x.len() == self.vertices && u.len() == self.vertices, "one item per vertex");
        let lanes = &self.lanes[self.of[task].clone()];
        // SAFETY: the caller's promise; `wide` is the detected feature.
        unsafe {
            match rule {
                #[cfg(target_arch = "x86_64")]
                Rule::Project if wide => avx2::project::<false>(lanes, x, u),
                #[cfg(target_arch = "x86_64")]
                Rule::Pull if wide => avx2::project::<true>(lanes, x, u),
                Rule::Project => lanes.iter().for_each(|lanes| each(lanes, x, u, kernels::project)),
                Rule::Pull => lanes.iter().for_each(|lanes| each(lanes, x, u, kernels::project_coarse)),
                Rule::Relax => lanes.iter().for_each(|lanes| each(lanes, x, u, kernels::relax)),
            }
        }
    }
}

/// Which of the edge kernels a sweep is of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Rule {
    /// [`kernels::project`].
    Project,
    /// [`kernels::project_coarse`].
    Pull,
    /// [`kernels::relax`].
    Relax,
}

impl Lanes {
    fn new(places: &[u32], edges: &[Edge], inverse_mass: &[f32]) -> Lanes {
        let edge = |lane: usize| edges[places[lane.min(places.len() - 1)] as usize];
        let share = |lane: usize, end: u32| {
            if lane < places.len() { edge(lane).inverse_weight * inverse_mass[end as usize] } else { 0.0 }
        };
        let lanes = Lanes {
            a: std::array::from_fn(|lane| edge(lane).a),
            b: std::array::from_fn(|lane| edge(lane).b),
            inverse_rest: std::array::from_fn(|lane| edge(lane).inverse_rest),
            share_a: std::array::from_fn(|lane| share(lane, edge(lane).a)),
            share_b: std::array::from_fn(|lane| share(lane, edge(lane).b)),
        };
        for lane in 0..places.len() {
            let clash = |end: u32| lanes.a[..lane].contains(&end) || lanes.b[..lane].contains(&end);
            let (a, b) = (lanes.a[lane], lanes.b[lane]);
            assert!((a as usize) < inverse_mass.len() && (b as usize) < inverse_mass.len() && a != b, "an edge from {a} to {b}");
            assert!(!clash(a) && !clash(b), "vertex {a} or {b} is in one batch twice");
        }
        lanes
    }
}

/// The eight edges one after another, by the plain kernel.
#[expect(unsafe_code, reason = "see Packed::sweep")]
#[inline]
unsafe fn each(lanes: &Lanes, x: Shared<Vec4>, u: Shared<Vec4>, kernel: impl Fn(Vec3A, Vec3A, &Edge) -> Vec3A) {
    for lane in 0..WIDTH {
        let (a, b) = (lanes.a[lane] as usize, lanes.b[lane] as usize);
        let edge = Edge { a: lanes.a[lane], b: lanes.b[lane], inverse_rest: lanes.inverse_rest[lane], inverse_weight: 1.0 };
        // SAFETY: `Lanes::new` checked the indices; the caller of `sweep` keeps others away.
        unsafe {
            let impulse = kernel(xyz(x.get(a) - x.get(b)), xyz(u.get(a) - u.get(b)), &edge).extend(0.0);
            u.set(a, u.get(a) + impulse * lanes.share_a[lane]);
            u.set(b, u.get(b) - impulse * lanes.share_b[lane]);
        }
    }
}

/// Eight edges at a time: ends gathered by two 4 x 4 transposes each, one load and one store an end to apply the result.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    #[allow(clippy::wildcard_imports, reason = "the instruction set is the vocabulary here")]
    use std::arch::x86_64::*;

    use super::{Lanes, Shared, Vec4, WIDTH, kernels};

    /// [`kernels::project`] for each lane; `PULL`: [`kernels::project_coarse`].
    #[expect(unsafe_code, reason = "see Packed::sweep")]
    #[target_feature(enable = "avx2,fma")]
    pub(super) unsafe fn project<const PULL: bool>(all: &[Lanes], x: Shared<Vec4>, u: Shared<Vec4>) {
        #[repr(align(32))]
        struct Scales([f32; WIDTH]);
        let (mut scale_a, mut scale_b) = (Scales([0.0; WIDTH]), Scales([0.0; WIDTH]));
        // SAFETY: `Lanes::new` checked the indices, `Vec4` is aligned for `_mm_load_ps`, `Lanes` and `Scales` for
        // `_mm256_load_ps`; the caller of `sweep` keeps other threads away.
        unsafe {
            let at = |values: Shared<Vec4>, vertex: u32| values.pointer().add(vertex as usize).cast::<f32>();
            let one = _mm256_set1_ps(1.0);
            for lanes in all {
                let mut d0 = [_mm256_setzero_ps(); 4];
                let mut du = [_mm256_setzero_ps(); 4];
                for k in 0..4 {
                    // Lanes k and k + 4 side by side.
                    let pair = |values, ends: &[u32; WIDTH]| {
                        let low = _mm256_castps128_ps256(_mm_load_ps(at(values, ends[k])));
                        _mm256_insertf128_ps::<1>(low, _mm_load_ps(at(values, ends[k + 4])))
                    };
                    d0[k] = _mm256_sub_ps(pair(x, &lanes.a), pair(x, &lanes.b));
                    du[k] = _mm256_sub_ps(pair(u, &lanes.a), pair(u, &lanes.b));
                }
                let (s, su) = (transpose(d0), transpose(du));
                let d = [_mm256_add_ps(s[0], su[0]), _mm256_add_ps(s[1], su[1]), _mm256_add_ps(s[2], su[2])];
                let inverse_rest = _mm256_load_ps(lanes.inverse_rest.as_ptr());
                let inverse_square = _mm256_mul_ps(inverse_rest, inverse_rest);
                let r = _mm256_fmsub_ps(dot(d, d), inverse_square, one);
                let r0 = _mm256_fmsub_ps(dot(s, s), inverse_square, one);
                let c = _mm256_mul_ps(dot(s, d), inverse_square);

                let magnitude = |v| _mm256_andnot_ps(_mm256_set1_ps(-0.0), v);
                let turned = _mm256_cmp_ps::<_CMP_GT_OQ>(c, _mm256_set1_ps(kernels::TURN_GUARD));
                let guard = _mm256_set1_ps(kernels::STRETCH_GUARD);
                // Each compared by itself: a maximum would let a NaN pass.
                let now = _mm256_cmp_ps::<_CMP_LT_OQ>(magnitude(r), guard);
                let before = _mm256_cmp_ps::<_CMP_LT_OQ>(magnitude(r0), guard);
                let rigid = _mm256_and_ps(turned, _mm256_and_ps(now, before));

                let unit = series(r0, [1.0, 0.5, 0.375]);
                let mut scale = _mm256_mul_ps(_mm256_mul_ps(unit, r), series(r, [0.5, 0.125, 0.0625]));
                if _mm256_movemask_ps(rigid) != 0xff {
                    // `relax` where SHAKE's guard is passed: another scale, and along d in place of d0.
                    let length = _mm256_max_ps(_mm256_sqrt_ps(dot(d, d)), _mm256_set1_ps(kernels::LEAST_LENGTH));
                    let stretch = _mm256_sub_ps(one, _mm256_div_ps(one, _mm256_mul_ps(inverse_rest, length)));
                    scale = _mm256_blendv_ps(stretch, scale, rigid);
                    _mm256_store_ps(scale_a.0.as_mut_ptr(), rigid);
                    for k in 0..4 {
                        let low = _mm256_castps128_ps256(_mm_broadcast_ss(&scale_a.0[k]));
                        let both = _mm256_insertf128_ps::<1>(low, _mm_broadcast_ss(&scale_a.0[k + 4]));
                        d0[k] = _mm256_add_ps(d0[k], _mm256_andnot_ps(both, du[k]));
                    }
                }
                if PULL {
                    scale = _mm256_and_ps(scale, _mm256_cmp_ps::<_CMP_NLE_UQ>(r, _mm256_setzero_ps()));
                }
                _mm256_store_ps(scale_a.0.as_mut_ptr(), _mm256_mul_ps(scale, _mm256_load_ps(lanes.share_a.as_ptr())));
                _mm256_store_ps(scale_b.0.as_mut_ptr(), _mm256_mul_ps(scale, _mm256_load_ps(lanes.share_b.as_ptr())));
                for lane in 0..WIDTH {
                    let along =
                        if lane < 4 { _mm256_castps256_ps128(d0[lane]) } else { _mm256_extractf128_ps::<1>(d0[lane - 4]) };
                    let (a, b) = (at(u, lanes.a[lane]), at(u, lanes.b[lane]));
                    _mm_store_ps(a, _mm_fnmadd_ps(along, _mm_broadcast_ss(&scale_a.0[lane]), _mm_load_ps(a)));
                    _mm_store_ps(b, _mm_fmadd_ps(along, _mm_broadcast_ss(&scale_b.0[lane]), _mm_load_ps(b)));
                }
            }
        }
    }

    /// Rows x, y, z of eight columns.
    #[target_feature(enable = "avx2,fma")]
    fn transpose(v: [__m256; 4]) -> [__m256; 3] {
        let (xy01, zw01) = (_mm256_unpacklo_ps(v[0], v[1]), _mm256_unpackhi_ps(v[0], v[1]));
        let (xy23, zw23) = (_mm256_unpacklo_ps(v[2], v[3]), _mm256_unpackhi_ps(v[2], v[3]));
        [_mm256_shuffle_ps::<0x44>(xy01, xy23), _mm256_shuffle_ps::<0xee>(xy01, xy23), _mm256_shuffle_ps::<0x44>(zw01, zw23)]
    }

    #[target_feature(enable = "avx2,fma")]
    fn dot(v: [__m256; 3], w: [__m256; 3]) -> __m256 {
        _mm256_fmadd_ps(v[2], w[2], _mm256_fmadd_ps(v[1], w[1], _mm256_mul_ps(v[0], w[0])))
    }

    /// `a - r (b - c r)`.
    #[target_feature(enable = "avx2,fma")]
    fn series(r: __m256, [a, b, c]: [f32; 3]) -> __m256 {
        let inner = _mm256_fnmadd_ps(r, _mm256_set1_ps(c), _mm256_set1_ps(b));
        _mm256_fnmadd_ps(r, inner, _mm256_set1_ps(a))
    }
}

/// Whether [`Packed::sweep`] may be wide here.
pub(crate) fn is_wide() -> bool {
    #[cfg(target_arch = "x86_64")]
    return is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloth::Cloth;
    use crate::coefficients::Coefficients;
    use crate::stripes::Stripes;
    use crate::{Fabric, Mesh, Options};

    /// `u` after one sweep, in tasks, or edge by edge in the plain colour order.
    fn swept(cloth: &Cloth, edges: &[Edge], start: &[Vec4], rule: Rule, wide: Option<bool>) -> Vec<Vec4> {
        let kernel = match rule {
            Rule::Project => kernels::project,
            Rule::Pull => kernels::project_coarse,
            Rule::Relax => kernels::relax,
        };
        let (mut x, mut u) = (cloth.rest.clone(), start.to_vec());
        let Some(wide) = wide else {
            for edge in edges {
                let (a, b) = (edge.a as usize, edge.b as usize);
                let impulse = kernel(xyz(x[a] - x[b]), xyz(u[a] - u[b]), edge).extend(0.0);
                u[a] += impulse * x[a].w;
                u[b] -= impulse * x[b].w;
            }
            return u;
        };
        let stripes = Stripes::new(&cloth.links, cloth.swept().len(), x.len());
        let weights: Vec<f32> = x.iter().map(|x| x.w).collect();
        for tasks in [&stripes.first, &stripes.second] {
            let mut packed = Packed::default();
            packed.pack(tasks, edges, &cloth.colors, &weights);
            for task in 0..tasks.len() {
                #[expect(unsafe_code, reason = "one thread, both slices alive")]
                // SAFETY: nobody else is here.
                unsafe {
                    packed.sweep(task, Shared::new(&mut x), Shared::new(&mut u), rule, wide);
                }
            }
        }
        u
    }

    /// The same work in the same order: to rounding with every processor, gentle or wild, soft or stiff, pinned or not.
    #[test]
    fn lanes_do_what_the_plain_kernel_does() {
        let mut mesh = Mesh::grid(37, 61, 1.0, 1.6);
        let mut random = fastrand::Rng::with_seed(9);
        let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
        mesh.positions.iter_mut().for_each(|x| *x += vector(0.004));
        for (size, stretch) in [(0.001, 50.0), (0.001, 1e6), (0.05, 5000.0), (2.0, 5000.0)] {
            let fabric = Fabric { stretch, ..Fabric::default() };
            let options = Options { fabric, pinned: vec![0, 36, 500], ..Options::default() };
            let cloth = Cloth::new(&mesh, &options).unwrap();
            let edges = Coefficients::new(&cloth, &options, 1.0 / 1200.0, 0).edges;
            let start: Vec<Vec4> = cloth.rest.iter().map(|x| vector(if x.w > 0.0 { size } else { 0.0 }).extend(0.0)).collect();
            for rule in [Rule::Project, Rule::Pull, Rule::Relax] {
                let plain = swept(&cloth, &edges, &start, rule, None);
                let moved = plain.iter().zip(&start).map(|(u, start)| (u - start).truncate().length()).fold(0.0, f32::max);
                assert!(moved > 0.01 * size, "{size}: something is corrected");
                for wide in [false, is_wide()] {
                    let lanes = swept(&cloth, &edges, &start, rule, Some(wide));
                    let apart = plain.iter().zip(&lanes).map(|(a, b)| (a - b).truncate().length()).fold(0.0, f32::max);
                    assert!(apart <= 3e-6 * (moved + size), "{rule:?} {size} {stretch} wide {wide}: {apart} of {moved}");
                }
            }
        }
    }
}
