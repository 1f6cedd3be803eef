//! Unit tests of `src/multigrid/hierarchy.rs`.

use std::collections::BTreeSet;

use glam::Vec3;

use super::*;
use crate::{Mesh, Options};

/// Asserts what must hold for the levels of any mesh, and returns them.
fn check(mesh: &Mesh, options: Options) -> Vec<Level> {
    let cloth = Cloth::new(mesh, &options).unwrap();
    let levels = Hierarchy::new(&cloth).levels;
    let mut masses: Vec<f64> = cloth.mass.iter().map(|&mass| f64::from(mass)).collect();
    let mut pinned: Vec<bool> = cloth.rest.iter().map(|x| x.w == 0.0).collect();
    let mut of_vertex: Vec<u32> = (0..masses.len() as u32).collect();
    let count_joined = |links: &mut dyn Iterator<Item = &Link>| links.flat_map(|link| link.ends).collect::<BTreeSet<u32>>().len();
    let mut joined = count_joined(&mut holding(&cloth));
    for level in &levels {
        let count = level.inverse_mass.len();
        assert_eq!(level.label.len(), masses.len(), "every item is in an aggregate");
        let joined_below = std::mem::replace(&mut joined, count_joined(&mut level.links.iter()));
        assert!(3 * joined <= 2 * joined_below, "a level is much smaller than the one below");
        let mut sums = vec![0.0; count];
        for (item, &aggregate) in level.label.iter().enumerate() {
            sums[aggregate as usize] += masses[item];
            assert_eq!(pinned[item], level.inverse_mass[aggregate as usize] == 0.0, "the pinned are apart");
        }
        for (aggregate, sum) in sums.iter().enumerate() {
            let span = level.members.spans[aggregate];
            let range = span.start as usize..span.end as usize;
            let items = &level.members.items[range.clone()];
            assert!(!items.is_empty() && items.iter().all(|&item| level.label[item as usize] == aggregate as u32));
            for (&item, share) in items.iter().zip(&level.share[range]) {
                assert!((f64::from(*share) * sum / masses[item as usize] - 1.0).abs() < 1e-5, "shares are by mass");
            }
            let inverse = f64::from(level.inverse_mass[aggregate]);
            assert!(inverse == 0.0 || (inverse * sum - 1.0).abs() < 1e-5);
        }
        of_vertex.iter_mut().for_each(|item| *item = level.label[*item as usize]);
        (masses, pinned) = (sums, level.inverse_mass.iter().map(|&w| w == 0.0).collect());

        // The free vertices of an aggregate are connected: labels are joined until nothing changes.
        let mut joined: Vec<u32> = (0..of_vertex.len() as u32).collect();
        for _ in 0..of_vertex.len() {
            let mut changed = false;
            for link in holding(&cloth) {
                let [a, b] = link.ends.map(|vertex| vertex as usize);
                if of_vertex[a] == of_vertex[b] && joined[a] != joined[b] {
                    (joined[a], joined[b], changed) = (joined[a].min(joined[b]), joined[a].min(joined[b]), true);
                }
            }
            if !changed {
                break;
            }
        }
        let names: BTreeSet<(u32, u32)> = of_vertex.iter().copied().zip(joined).filter(|(of, _)| !pinned[*of as usize]).collect();
        let free = level.inverse_mass.iter().filter(|&&w| w > 0.0).count();
        assert_eq!(names.len(), free, "an aggregate is in one piece");

        let mut visited = 0;
        for range in &level.colors {
            let mut seen = BTreeSet::new();
            for link in &level.links[range.clone()] {
                let weights = link.ends.map(|end| level.inverse_mass[end as usize]);
                assert!(weights[0] + weights[1] > 0.0, "no edge between pins");
                assert!(link.rest > 0.0 && link.rest.is_finite() && link.shape > 0.0, "{link:?}");
                assert!(link.ends.iter().all(|end| seen.insert(*end)), "edges of a color share no end");
                visited += 1;
            }
        }
        assert_eq!(visited, level.links.len());
    }
    let again = Hierarchy::new(&cloth).levels;
    assert!(levels.iter().zip(&again).all(|(a, b)| a.label == b.label), "the same mesh gives the same levels");
    levels
}

/// Combines two meshes, the second one shifted.
fn both(mut a: Mesh, b: &Mesh, by: Vec3) -> Mesh {
    let first = a.positions.len() as u32;
    a.positions.extend(b.positions.iter().map(|x| *x + by));
    a.triangles.extend(b.triangles.iter().map(|corners| corners.map(|vertex| vertex + first)));
    a
}

#[test]
fn a_grids_aggregates_are_blocks() {
    let mass = Some(vec![1e-3; 64 * 64]);
    let levels = check(&Mesh::grid(64, 64, 1.0, 1.0), Options { mass, ..Options::default() });
    assert_eq!(levels.iter().map(|level| level.inverse_mass.len()).collect::<Vec<_>>(), [256, 64, 16, 4]);
    for vertex in 0..64 * 64 {
        let corner = (vertex / 64) / 4 * 4 * 64 + (vertex % 64) / 4 * 4;
        assert_eq!(levels[0].label[vertex], levels[0].label[corner]);
    }
    // The centers of 4 x 4 blocks are 4 edges apart along rows and columns.
    let least = levels[0].links.iter().map(|link| link.rest).fold(f32::INFINITY, f32::min);
    assert!((least * 63.0 - 4.0).abs() < 1e-4);
    for (columns, rows) in [(129, 129), (100, 37), (400, 2), (7, 7), (2, 2)] {
        check(&Mesh::grid(columns, rows, 1.0, 1.0), Options { pinned: vec![0, columns - 1], ..Options::default() });
    }
}

#[test]
fn pins_are_apart() {
    let mesh = Mesh::grid(32, 32, 1.0, 1.0);
    // A line of pins separates the vertices on its two sides.
    check(&mesh, Options { pinned: (0..32).map(|row| 32 * row + 13).collect(), ..Options::default() });
    check(&mesh, Options { pinned: vec![32 * 14 + 13], ..Options::default() });
    let levels = check(&mesh, Options { pinned: (0..32 * 32).collect(), ..Options::default() });
    assert!(levels.iter().all(|level| level.links.is_empty()), "nothing is free");
    let mass = Some((0..32 * 32).map(|v| 1e-4 * (1.0 + (v % 7) as f32 * 100.0)).collect());
    check(&mesh, Options { mass, ..Options::default() });
}

#[test]
fn pieces_are_apart() {
    let grid = Mesh::grid(16, 16, 1.0, 1.0);
    // Two sheets that are closer to each other than neighboring vertices are.
    let levels = check(&both(grid.clone(), &grid, Vec3::Y * 1e-3), Options::default());
    let of = |vertex: usize| levels[0].label[vertex];
    assert!((0..256).all(|vertex| of(vertex) != of(256 + vertex)));
    let lone = Mesh { positions: vec![Vec3::ZERO; 50], triangles: Vec::new() };
    check(&both(grid.clone(), &lone, Vec3::ONE), Options::default());
    assert!(check(&lone, Options::default()).is_empty());
    // However many small pieces there are, the large one has all of its levels.
    let pieces =
        (0..300).fold(Mesh::grid(64, 64, 1.0, 1.0), |all, k| both(all, &Mesh::grid(2, 2, 0.01, 0.01), Vec3::Y * k as f32));
    assert_eq!(check(&pieces, Options::default()).len(), 4);
    // Three sheets that share an edge.
    let upright = Mesh { positions: grid.positions.iter().map(|x| Vec3::new(x.x, x.z + 0.5, 0.0)).collect(), ..grid.clone() };
    let mut fin = both(grid, &upright, Vec3::ZERO);
    fin.triangles.push([7 * 16, 7 * 16 + 1, 256]);
    check(&fin, Options::default());
}

/// A strip cut along its middle except at its end: no coarse edge spans the cut, except near the end.
#[test]
fn a_slit_is_not_bridged() {
    let mut mesh = Mesh::grid(64, 32, 2.0, 1.0);
    let across = |[a, b, c]: &[u32; 3]| {
        let rows = [a, b, c].map(|vertex| vertex / 64);
        rows.contains(&15) && rows.contains(&16) && [a, b, c].iter().all(|vertex| *vertex % 64 < 48)
    };
    mesh.triangles.retain(|corners| !across(corners));
    let levels = check(&mesh, Options::default());
    let cloth = Cloth::new(&mesh, &Options::default()).unwrap();
    let mut rows = vec![BTreeSet::new(); levels[0].inverse_mass.len()];
    for (x, &aggregate) in cloth.rest.iter().zip(&levels[0].label) {
        if x.x < 0.25 {
            rows[aggregate as usize].insert(x.z < 0.0);
        }
    }
    for link in &levels[0].links {
        let [a, b] = link.ends.map(|end| &rows[end as usize]);
        assert!(a.is_empty() || b.is_empty() || a == b, "{link:?}");
    }
}

/// An open tube around the y-axis, of square cells.
fn tube(around: u32, along: u32, radius: f32) -> Mesh {
    let side = std::f32::consts::TAU * radius / around as f32;
    let at = |i: u32| {
        let turn = (i % around) as f32 / around as f32 * std::f32::consts::TAU;
        Vec3::new(radius * turn.cos(), (i / around) as f32 * side, radius * turn.sin())
    };
    let quads = (0..around * (along - 1)).flat_map(|i| {
        let next = i / around * around + (i + 1) % around;
        [[i, next, i + around], [next, next + around, i + around]]
    });
    Mesh { positions: (0..around * along).map(at).collect(), triangles: quads.collect() }
}

/// The centers of aggregates, given that of each vertex, and how much of the circle around the y-axis each covers: 0 if it goes around.
fn centers(cloth: &Cloth, of_vertex: &[u32], count: usize) -> Vec<(DVec3, f64)> {
    let mut sums = vec![(DVec3::ZERO, DVec3::ZERO, 0.0); count];
    for (v, &aggregate) in of_vertex.iter().enumerate() {
        let (x, m) = (cloth.rest[v].truncate().as_dvec3(), f64::from(cloth.mass[v]));
        let (sum, out, mass) = &mut sums[aggregate as usize];
        (*sum, *out, *mass) = (*sum + x * m, *out + x.with_y(0.0).normalize() * m, *mass + m);
    }
    sums.into_iter().map(|(sum, out, mass)| (sum / mass, out.length() / mass)).collect()
}

/// On a tube, the aggregates' centers lie inside it, and the cloth between two of them is longer than their distance.
#[test]
fn a_tube_is_not_held_round() {
    let radius = 1.0 / std::f32::consts::TAU;
    let mesh = tube(64, 32, radius);
    let levels = check(&mesh, Options::default());
    let cloth = Cloth::new(&mesh, &Options::default()).unwrap();
    let center = centers(&cloth, &levels[0].label, levels[0].inverse_mass.len());
    for link in &levels[0].links {
        let [(a, _), (b, _)] = link.ends.map(|end| center[end as usize]);
        // The distance on the flattened tube, from the arc at the tube's radius and the distance along it.
        let angle = (a.with_y(0.0)).angle_between(b.with_y(0.0));
        let flat = (angle * f64::from(radius)).hypot(a.y - b.y);
        assert!(f64::from(link.rest) > 0.98 * flat, "{link:?}: flat, they are {flat} apart");
        assert!(f64::from(link.rest) < 1.1 * flat, "{link:?}: flat, they are {flat} apart");
    }
}

/// Of aggregates that go around a sleeve the normals cancel, but for rounding. They are as far apart as their centers.
#[test]
fn a_sleeve_is_held_along_its_length() {
    let mesh = tube(16, 160, 0.05);
    let levels = check(&mesh, Options::default());
    let cloth = Cloth::new(&mesh, &Options::default()).unwrap();
    let mut of_vertex: Vec<u32> = (0..cloth.rest.len() as u32).collect();
    let mut around = 0;
    for level in &levels {
        of_vertex.iter_mut().for_each(|item| *item = level.label[*item as usize]);
        let center = centers(&cloth, &of_vertex, level.inverse_mass.len());
        let rings = center.iter().filter(|(_, out)| *out < 0.05).count();
        let mut joined = BTreeSet::new();
        for link in &level.links {
            let [(a, of_a), (b, of_b)] = link.ends.map(|end| center[end as usize]);
            if of_a.max(of_b) < 0.05 {
                let share = f64::from(link.rest) / a.distance(b);
                assert!((share - 1.0).abs() < 0.01, "{link:?}: {share} times as long as they are apart");
                joined.extend(link.ends);
            }
        }
        assert!(
            rings == level.inverse_mass.len() && joined.len() == rings || rings == 0,
            "{rings} rings, {} joined",
            joined.len()
        );
        around += rings;
    }
    assert!(around > 10, "{around}");
}

/// A sheet in knife pleats, of three layers each, and where its vertices are when it is unfolded (m).
fn pleats(pleats: usize, rows: u32) -> (Mesh, Vec<DVec3>) {
    // The steps of a pleat: six forth, three back in the layer above, three forth in the one above that.
    let forth = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0];
    let layer = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.2, 0.2, 0.4, 0.4, 0.4];
    let mut outline = vec![Vec3::ZERO];
    for step in 0..12 * pleats {
        let x = outline[step].x + forth[step % 12];
        outline.push(Vec3::new(x, 0.0, layer[step % 12]));
    }
    let mut unfolded = vec![0.0];
    outline.windows(2).for_each(|pair| unfolded.push(unfolded[unfolded.len() - 1] + f64::from(pair[0].distance(pair[1]))));
    let columns = outline.len() as u32;
    let mut mesh = Mesh::grid(columns, rows, 1.0, 1.0);
    let mut flat = Vec::new();
    for (v, x) in mesh.positions.iter_mut().enumerate() {
        let (column, row) = (v % columns as usize, v / columns as usize);
        *x = 0.02 * (outline[column] - row as f32 * Vec3::Y);
        flat.push(0.02 * DVec3::new(unfolded[column], -(row as f64), 0.0));
    }
    (mesh, flat)
}

/// In pleats the cloth between two aggregates is several times as long as they are apart, and coarse edges are as long as that.
#[test]
fn pleats_may_be_unfolded() {
    let (mesh, flat) = pleats(8, 49);
    let levels = check(&mesh, Options::default());
    let cloth = Cloth::new(&mesh, &Options::default()).unwrap();
    let mut of_vertex: Vec<u32> = (0..cloth.rest.len() as u32).collect();
    let (mut folded, mut far, mut links) = (0, 0, 0);
    for (index, level) in levels.iter().enumerate() {
        links += level.links.len();
        of_vertex.iter_mut().for_each(|item| *item = level.label[*item as usize]);
        let center = |of: &dyn Fn(usize) -> DVec3| {
            let mut sums = vec![(DVec3::ZERO, 0.0); level.inverse_mass.len()];
            for (v, &aggregate) in of_vertex.iter().enumerate() {
                let (sum, mass) = &mut sums[aggregate as usize];
                (*sum, *mass) = (*sum + of(v) * f64::from(cloth.mass[v]), *mass + f64::from(cloth.mass[v]));
            }
            sums.into_iter().map(|(sum, mass)| sum / mass).collect::<Vec<_>>()
        };
        let at_rest = center(&|v| cloth.rest[v].truncate().as_dvec3());
        let unfolded = center(&|v| flat[cloth.order[v] as usize]);
        for link in &level.links {
            let [at_rest, unfolded] =
                [&at_rest, &unfolded].map(|at| at[link.ends[0] as usize].distance(at[link.ends[1] as usize]));
            folded += usize::from(unfolded > 1.5 * at_rest);
            let share = f64::from(link.rest) / unfolded;
            far += usize::from(share > 1.1);
            assert!(share > 0.95, "level {index}, {link:?}: {share} of the distance in unfolded cloth");
        }
    }
    assert!(folded > 100 && far < links / 30, "of {links} edges {folded} are folded, {far} are longer than unfolded cloth");
}
