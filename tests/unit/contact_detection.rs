//! Detection around vertices with new paths.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Vec3, Vec3A, Vec4};

use super::paths::Paths;
use super::rows::Rows;
use super::tree::{DetectionScope, Tree};
use super::{Detection, DetectionInput, max_listed};
use crate::contact::input::Path;
use crate::contact::surface::Surface;
use crate::contact::workers::Workers;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::{Contact, Options};
use crate::simd::Width;

const THICKNESS: f32 = 0.005;

/// A sheet folded over twice and above a mesh, with the paths of all vertices.
struct Folded {
    surface: Surface,
    trees: [Tree; 2],
    paths: Paths,
    detection: Detection,
    lists: [Rows; 2],
}

fn trees(cloth: &Cloth, body: &Arc<Mesh>) -> (Surface, [Tree; 2]) {
    let (mut surface, leaves) = Surface::new(cloth, Some(Contact { thickness: THICKNESS, ..Contact::default() })).unwrap();
    let of_cloth = Tree::of_cloth(&surface, leaves);
    let of_bodies = surface.add_bodies(std::slice::from_ref(body));
    (surface, [of_cloth, Tree::of_bodies(of_bodies)])
}

impl Folded {
    fn new(cloth: &Cloth, body: &Arc<Mesh>) -> Folded {
        let (surface, trees) = trees(cloth, body);
        let fold = |at: &Vec4| {
            if at.x.abs() > 0.05 {
                Vec4::new((0.1 - at.x.abs()) * at.x.signum(), at.x * 0.15 + 0.02, at.z, 1.0)
            } else {
                Vec4::new(at.x, at.x.abs() * 0.1, at.z, 1.0)
            }
        };
        let x: Vec<Vec4> =
            surface.rest.iter().zip(&surface.owner).map(|(at, owner)| if *owner == 0 { fold(at) } else { *at }).collect();
        // It is compressed, so that neighbors in flat cloth are in reach of each other too, which only normals rule out.
        let u: Vec<Vec4> = x.iter().map(|x| Vec4::new(0.0, -1e-4, -0.016 * x.z, 0.0)).collect();
        let mut paths = Paths { margin: surface.max_margin.clone(), ahead: 12.0, ..Paths::default() };
        paths.begin(&x, &u, &[], &surface);
        let (detection, lists) = Default::default();
        let mut folded = Folded { surface, trees, paths, detection, lists };
        folded.detect(None);
        folded
    }

    /// Detects all pairs, or those around some vertices.
    fn detect(&mut self, around: Option<&[u32]>) {
        let Folded { surface, trees: [of_cloth, of_bodies], paths, detection, lists } = self;
        let path = Path { x: &paths.from, u: &paths.by, margin: &paths.margin, floats: false, workers: Workers::ALONE };
        let scope = DetectionScope { substeps: paths.ahead, thickness: THICKNESS };
        let input = DetectionInput { surface, bodies_rest: false, path, scope, width: Width::detected() };
        match around {
            None => detection.run(input, [of_cloth, of_bodies], lists, &|_, _, _| false).unwrap(),
            Some(vertices) => {
                detection.run_around(input, vertices, [of_cloth, of_bodies], lists).unwrap();
            }
        }
    }

    /// The listed pairs of each kind, by first and second feature, with their thickness.
    fn listed(&self) -> [BTreeMap<(u32, u32), f32>; 2] {
        self.lists.each_ref().map(|rows| {
            let firsts = (0..).zip(rows.starts.windows(2)).flat_map(|(row, span)| (span[0]..span[1]).map(move |_| row));
            let pairs = firsts.chain(rows.later.iter().copied()).zip(&rows.pairs);
            let listed: BTreeMap<_, _> = pairs.map(|(first, pair)| ((first, pair.other), pair.thickness)).collect();
            assert_eq!(listed.len(), rows.pairs.len(), "a pair is listed twice");
            assert_eq!(rows.lambda.len(), rows.pairs.len());
            listed
        })
    }
}

/// A few vertices leave their paths, again and again: some move to another layer, some turn triangles over. All pairs that a
/// detection of everything along the same paths lists are listed, and some of these were not before.
#[test]
fn around_vertices_with_new_paths_all_pairs_are_listed() {
    let cloth = Cloth::new(&Mesh::grid(24, 24, 0.2, 0.2), &Options::default()).unwrap();
    let mut body = Mesh::grid(12, 12, 0.2, 0.2);
    body.positions.iter_mut().for_each(|at| *at += Vec3::new(0.003, -0.012, 0.002));
    let body = Arc::new(body);
    let mut folded = Folded::new(&cloth, &body);
    let (vertices, first_of_body) = (cloth.rest.len() as u32, folded.surface.cloth_vertices() as u32);
    let (mut seed, mut added) = (7_u32, [0; 2]);
    let mut random = |below: u32| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) % below
    };
    for round in 0..40 {
        folded.paths.since = Some((round % 12) as f32);
        let mut around: Vec<u32> = (0..3).map(|_| random(vertices)).collect();
        if round % 4 == 0 {
            around.push(first_of_body + random(144));
        }
        around.sort_unstable();
        around.dedup();
        let since = folded.paths.since.unwrap_or_default();
        let (mut x, mut u) = (folded.paths.from.clone(), folded.paths.by.clone());
        (0..x.len()).for_each(|v| x[v] += folded.paths.by[v].truncate().extend(0.0) * since);
        for &vertex in &around {
            let mut shift = || (random(2001) as f32 - 1000.0) * 2e-5;
            x[vertex as usize] += Vec3A::new(shift(), shift(), shift()).extend(0.0);
            u[vertex as usize] += Vec3A::new(shift(), shift(), shift()).extend(0.0) * 0.05;
        }
        let path = Path { x: &x, u: &u, margin: &[], floats: false, workers: Workers::ALONE };
        let unpressed = vec![false; x.len()];
        folded.paths.restart(&around, path, &unpressed, &folded.surface, 0.1 * THICKNESS);
        let before = folded.listed();
        folded.detect(Some(&around));
        let (surface, trees) = trees(&cloth, &body);
        let (detection, lists) = Default::default();
        let mut anew = Folded { surface, trees, paths: folded.paths.clone(), detection, lists };
        anew.detect(None);
        for (kind, (all, listed)) in anew.listed().iter().zip(folded.listed()).enumerate() {
            assert!(all.len() > 100);
            for (pair, thickness) in all {
                assert_eq!(listed.get(pair), Some(thickness), "round {round}, kind {kind}, pair {pair:?}");
            }
            added[kind] += listed.len() - before[kind].len();
        }
    }
    assert!(added[0] > 100 && added[1] > 100, "{added:?}");
    #[cfg(feature = "gpu")]
    {
        let listed = folded.listed();
        folded.lists = folded.lists.map(Rows::in_rows);
        assert!(folded.lists.iter().all(|rows| rows.later.is_empty() && rows.starts.last() == Some(&(rows.pairs.len() as u32))));
        assert_eq!(folded.listed(), listed);
    }
}

/// The longest lists that a scene is known to need: a sheet of 100 x 100 vertices that is twisted (`cargo bench --bench contact
/// -- gpu twist`) has 9.5 million pairs, and one of 50 x 50 vertices, twisted for ten seconds, 2.6 million.
#[test]
fn twisted_sheets_are_not_too_many_pairs() {
    assert!(max_listed(10_000) > 11_500_000 && max_listed(2_500) > 2_700_000);
}
