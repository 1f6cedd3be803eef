//! Unit tests of `src/cpu/partition.rs`.

use super::*;
use crate::model::cloth::Cloth;
use crate::multigrid::hierarchy::Hierarchy;
use crate::{Mesh, Options};

fn cloths() -> Vec<(&'static str, Cloth)> {
    let build = |mesh: &Mesh, pinned| Cloth::new(mesh, &Options { pinned, ..Options::default() }).unwrap();
    let grid = Mesh::grid(40, 60, 1.0, 1.5);
    let mut shuffled = grid.clone();
    let mut names: Vec<u32> = (0..2400).collect();
    fastrand::Rng::with_seed(5).shuffle(&mut names);
    names.iter().zip(&grid.positions).for_each(|(&name, &x)| shuffled.positions[name as usize] = x);
    shuffled.triangles.iter_mut().flatten().for_each(|vertex| *vertex = names[*vertex as usize]);
    let mut fan = Mesh::grid(30, 30, 1.0, 1.0);
    fan.triangles.extend((1..899).map(|k| [0, k, k + 1]));
    let mut two = grid.clone();
    two.positions.extend(grid.positions.iter().map(|x| *x + glam::Vec3::Y));
    two.triangles.extend(grid.triangles.iter().map(|t| t.map(|v| v + 2400)));
    // With vertices that have no edge.
    let mut loose = grid.clone();
    loose.triangles.retain(|corners| !corners.iter().any(|vertex| vertex % 50 > 45));
    // With teeth on the left, whose tips come last: no edge leads from a tip across the base of its tooth.
    let mut teeth = Mesh::grid(61, 100, 1.0, 1.64);
    let corners = (0..99).flat_map(|row| (0..60).map(move |column| 61 * row + column));
    teeth.triangles = corners.flat_map(|i| [[i, i + 62, i + 1], [i, i + 61, i + 62]]).collect();
    for row in (2..98).step_by(4) {
        teeth.triangles.push([61 * row, 61 * (row + 1), teeth.positions.len() as u32]);
        teeth.positions.push(2.0 * teeth.positions[61 * row as usize] - teeth.positions[61 * row as usize + 1]);
    }
    vec![
        ("grid", build(&grid, vec![0, 39])),
        ("loose", build(&loose, vec![0, 39])),
        ("pinned rows", build(&grid, (0..1300).collect())),
        ("shuffled", build(&shuffled, vec![])),
        ("fan", build(&fan, vec![])),
        ("teeth", build(&teeth, vec![])),
        ("two", build(&two, vec![7])),
        ("one triangle", build(&Mesh { triangles: vec![[0, 1, 2]], ..Mesh::grid(2, 2, 1.0, 1.0) }, vec![])),
    ]
}

/// Each edge and each vertex belongs to exactly one piece. No piece writes where another one of its round writes, or
/// reads what one outside it moves. At every vertex the edges come in the order of their colors.
#[test]
fn tiles_keep_the_color_order() {
    for (name, cloth) in cloths() {
        let bending = cloth.bending();
        let rows = (0..cloth.rest.len() as u32).flat_map(|v| bending.entries.of(v).iter().map(move |entry| [v, entry.other]));
        let read: Vec<[u32; 2]> = cloth.links.iter().map(|link| link.ends).chain(rows).collect();
        for length in [1, 7, 100, 330, 512, 5000] {
            let swept = cloth.swept();
            let partition = Partition::cut(&cloth.links, swept.len(), &bending.across_bases, cloth.rest.len(), length);
            let mut owner = vec![(0, 0); cloth.rest.len()];
            let mut moved = vec![0; cloth.rest.len()];
            for (round, pieces) in partition.rounds.iter().enumerate() {
                for (index, piece) in pieces.iter().enumerate() {
                    for vertex in piece.vertices.iter().cloned().flatten() {
                        moved[vertex as usize] += 1;
                        owner[vertex as usize] = (round, index);
                    }
                }
            }
            let mut visited = vec![0; swept.len()];
            let mut latest = vec![None; cloth.rest.len()];
            for (round, pieces) in partition.rounds.iter().enumerate() {
                let mut visitor = vec![None; cloth.rest.len()];
                for (index, piece) in pieces.iter().enumerate() {
                    for &place in &piece.edges {
                        visited[place as usize] += 1;
                        for end in swept[place as usize].ends.map(|end| end as usize) {
                            assert!(visitor[end].is_none_or(|by| by == index), "{name} {length}: two pieces of a round meet");
                            visitor[end] = Some(index);
                            assert!(latest[end] < Some(place), "{name} {length}: {end} sees {place} after {:?}", latest[end]);
                            latest[end] = Some(place);
                            if round == 0 {
                                assert!(partition.tiles[index].contains(&(end as u32)), "{name} {length}: not its tile");
                            }
                            let by = owner[end];
                            assert!(by.0 > round || by == (round, index), "{name} {length}: moved before its last edge");
                        }
                    }
                }
            }
            assert!(visited.iter().all(|&count| count == 1) && moved.iter().all(|&count| count == 1), "{name} {length}");
            let of = |vertex: u32| partition.tiles.iter().position(|range| range.contains(&vertex));
            // A piece lists the tiles of all pieces that it may conflict with.
            for (round, pieces) in partition.rounds.iter().enumerate() {
                for (index, piece) in pieces.iter().enumerate() {
                    let touches = |vertex: u32| piece.touches.binary_search(&(of(vertex).unwrap() as u32)).is_ok();
                    let ends = piece.edges.iter().flat_map(|&place| swept[place as usize].ends);
                    assert!(ends.chain(piece.vertices.iter().cloned().flatten()).all(touches), "{name} {length}");
                    let moves = |end: u32| owner[end as usize] == (round, index);
                    let looks = read.iter().filter(|ends| ends.iter().any(|&end| moves(end)));
                    assert!(
                        looks.flatten().copied().all(touches),
                        "{name} {length}: somebody looks at what {round}.{index} moves"
                    );
                }
            }
            for ends in &read {
                let [a, b] = ends.map(|end| of(end).unwrap());
                assert!(
                    partition.around[a].contains(&(b as u32)) && partition.around[b].contains(&(a as u32)),
                    "{name} {length}"
                );
            }
            // Forces read across the borders of tiles, so the first round must not move vertices there.
            for &[a, b] in &read {
                assert!(of(a) == of(b) || [a, b].iter().all(|&end| owner[end as usize].0 > 0), "{name} {length}");
            }
        }
    }
}

#[test]
fn borders_of_a_grid_are_apart() {
    let cloth = Cloth::new(&Mesh::grid(64, 128, 1.0, 2.0), &Options::default()).unwrap();
    let partition = Partition::new(&cloth.links, cloth.swept().len(), &[], cloth.rest.len());
    assert!(partition.tiles.len() > 8, "{} tiles", partition.tiles.len());
    assert_eq!(partition.rounds.len(), 2);
    assert_eq!(partition.rounds[1].len(), partition.tiles.len() - 1);
    let late: usize = partition.rounds[1].iter().map(|piece| piece.edges.len()).sum();
    assert!(late < cloth.swept().len() / 2, "{late} of {} edges wait", cloth.swept().len());
}

/// Where the colors are many relative to the width of the tiles, more rounds keep the pieces small.
#[test]
fn coarse_levels_share_their_work() {
    let cloth = Cloth::new(&Mesh::grid(256, 256, 1.0, 1.0), &Options::default()).unwrap();
    let level = &Hierarchy::new(&cloth).levels[0];
    let partition = Partition::coarse(&level.links, level.inverse_mass.len(), 16);
    let edges = |piece: &Piece| piece.edges.len();
    let longest: usize = partition.rounds.iter().filter_map(|pieces| pieces.iter().map(edges).max()).sum();
    let most: Vec<(usize, usize)> =
        partition.rounds.iter().map(|pieces| (pieces.len(), pieces.iter().map(edges).max().unwrap_or(0))).collect();
    println!("{} edges, {} colors: {most:?}", level.links.len(), level.colors.len());
    assert!(5 * longest < level.links.len(), "one after another {longest} of {} edges: {most:?}", level.links.len());
}
