//! The colour order cut into tasks for several threads: the same order edge for edge, two barriers a sweep instead of one a
//! colour.
//!
//! The vertices are cut into stripes, ranges of the vertex order, in which neighbours are near. Walk the edges in colour
//! order: an edge inside one stripe goes to that stripe's task of the first round, unless an edge that had to wait came to
//! one of its ends before. Any other edge waits for the second round, and so do its ends. So within a round no two tasks
//! share a vertex, and at every vertex the edges come in the order of their colours: the result is the same bit for bit
//! however the cloth is cut, and however many threads take the tasks. What waits spreads by an edge a colour at most; where
//! stripes are wider than that, what waits at one border has nothing to do with the next, and each is a task of its own.
//!
//! A task stays in cache: all colours of a stripe pass before the next stripe is touched.

use std::ops::Range;

use crate::cloth::Link;

/// Vertices in a stripe, at least: fewer are not worth a task (about 10 us).
const LEAST: usize = 512;
/// Stripes are this many times the mean distance in memory between an edge's ends: eight rows of a grid, and what waits at
/// a border of it is four on each side.
const REACH: f64 = 12.0;
/// Parts of a border up to this many vertices together are one task.
const CRUMBS: usize = 128;
/// No task yet.
const NONE: u32 = u32::MAX;

/// See the module. Made once for a cloth.
#[derive(Debug, Clone)]
pub(crate) struct Stripes {
    /// Stripes, and for each the vertices that its first task may move and the edges that it visits.
    pub ranges: Vec<Range<u32>>,
    pub first: Vec<Task>,
    /// Borders between stripes.
    pub second: Vec<Task>,
}

/// Edges that one thread visits in a round, and the vertices that are then done with.
#[derive(Debug, Clone, Default)]
pub(crate) struct Task {
    /// Places in the colour order, ascending.
    pub edges: Vec<u32>,
    pub vertices: Vec<Range<u32>>,
}

impl Stripes {
    /// Cuts `links`, of which the first `swept` are in colour order, between `vertices` vertices.
    pub(crate) fn new(links: &[Link], swept: usize, vertices: usize) -> Stripes {
        let distance = links.iter().map(|link| f64::from(link.ends[0].abs_diff(link.ends[1]))).sum::<f64>();
        let length = ((REACH * distance / links.len().max(1) as f64) as usize).max(LEAST);
        Stripes::cut(links, swept, vertices, length)
    }

    /// The same with stripes of about `length` vertices.
    fn cut(links: &[Link], swept: usize, vertices: usize, length: usize) -> Stripes {
        let count = (vertices / length).max(1);
        // Whole eights, which loops over vertices take at a time.
        let start = |stripe: usize| if stripe == count { vertices as u32 } else { (stripe * vertices / count) as u32 & !7 };
        let ranges: Vec<Range<u32>> = (0..count).map(|stripe| start(stripe)..start(stripe + 1)).collect();
        let mut stripe_of = vec![0_u32; vertices];
        for (stripe, range) in ranges.iter().enumerate() {
            stripe_of[range.start as usize..range.end as usize].fill(stripe as u32);
        }
        let crosses = |link: &Link| stripe_of[link.ends[0] as usize] != stripe_of[link.ends[1] as usize];

        let mut waits = vec![false; vertices];
        // Edges between two pins are not swept, but forces look along them, at places that the first round must not move.
        for link in links[swept..].iter().filter(|link| crosses(link)) {
            link.ends.iter().for_each(|&end| waits[end as usize] = true);
        }
        let mut first = vec![Task::default(); count];
        let mut late = Vec::new();
        for (place, link) in links[..swept].iter().enumerate() {
            let [a, b] = link.ends.map(|end| end as usize);
            if crosses(link) || waits[a] || waits[b] {
                (waits[a], waits[b]) = (true, true);
                late.push(place as u32);
            } else {
                first[stripe_of[a] as usize].edges.push(place as u32);
            }
        }
        for (task, range) in first.iter_mut().zip(&ranges) {
            task.vertices = runs(range.clone().filter(|&vertex| !waits[vertex as usize]));
        }
        let second = borders(links, &late, &waits);
        Stripes { ranges, first, second }
    }
}

/// The connected parts of the edges that wait, one task each, or several small ones together.
fn borders(links: &[Link], late: &[u32], waits: &[bool]) -> Vec<Task> {
    let mut parent: Vec<u32> = (0..waits.len() as u32).collect();
    let root = |parent: &mut [u32], mut vertex: u32| {
        while parent[vertex as usize] != vertex {
            parent[vertex as usize] = parent[parent[vertex as usize] as usize];
            vertex = parent[vertex as usize];
        }
        vertex
    };
    for &place in late {
        let [a, b] = links[place as usize].ends.map(|end| root(&mut parent, end));
        // The lower one leads, so that parts come in the order of their first vertex.
        parent[a.max(b) as usize] = a.min(b);
    }
    let mut task_of = vec![NONE; waits.len()];
    let mut lists: Vec<Vec<u32>> = Vec::new();
    let mut sizes = vec![0_usize; waits.len()];
    let waiting: Vec<u32> = (0..waits.len() as u32).filter(|&vertex| waits[vertex as usize]).collect();
    waiting.iter().for_each(|&vertex| sizes[root(&mut parent, vertex) as usize] += 1);
    for &vertex in &waiting {
        // Leads come before the vertices that they lead.
        let lead = root(&mut parent, vertex) as usize;
        if task_of[lead] == NONE {
            if lists.last().is_none_or(|last| last.len() + sizes[lead] > CRUMBS) {
                lists.push(Vec::new());
            }
            task_of[lead] = lists.len() as u32 - 1;
        }
        task_of[vertex as usize] = task_of[lead];
        lists[task_of[lead] as usize].push(vertex);
    }
    let mut tasks: Vec<Task> =
        lists.into_iter().map(|vertices| Task { edges: Vec::new(), vertices: runs(vertices.into_iter()) }).collect();
    for &place in late {
        tasks[task_of[links[place as usize].ends[0] as usize] as usize].edges.push(place);
    }
    tasks
}

/// Ascending numbers as ranges.
fn runs(numbers: impl Iterator<Item = u32>) -> Vec<Range<u32>> {
    let mut ranges: Vec<Range<u32>> = Vec::new();
    for number in numbers {
        match ranges.last_mut() {
            Some(last) if last.end == number => last.end += 1,
            _ => ranges.push(number..number + 1),
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloth::Cloth;
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
        vec![
            ("grid", build(&grid, vec![0, 39])),
            ("pinned rows", build(&grid, (0..1300).collect())),
            ("shuffled", build(&shuffled, vec![])),
            ("fan", build(&fan, vec![])),
            ("two", build(&two, vec![7])),
            ("one triangle", build(&Mesh { triangles: vec![[0, 1, 2]], ..Mesh::grid(2, 2, 1.0, 1.0) }, vec![])),
        ]
    }

    /// Every edge and every vertex once; no task writes where another of its round writes or, outside, reads what it moves;
    /// and at every vertex the edges come in the order of their colours.
    #[test]
    fn stripes_keep_the_colour_order() {
        for (name, cloth) in cloths() {
            for length in [1, 7, 100, 330, 5000] {
                let swept = cloth.swept();
                let stripes = Stripes::cut(&cloth.links, swept.len(), cloth.rest.len(), length);
                let mut owner = vec![(0, 0); cloth.rest.len()];
                let mut visited = vec![0; swept.len()];
                let mut moved = vec![0; cloth.rest.len()];
                for (round, tasks) in [(1, &stripes.first), (2, &stripes.second)] {
                    for (index, task) in tasks.iter().enumerate() {
                        for vertex in task.vertices.iter().cloned().flatten() {
                            moved[vertex as usize] += 1;
                            owner[vertex as usize] = (round, index);
                        }
                    }
                    for (index, task) in tasks.iter().enumerate() {
                        for &place in &task.edges {
                            visited[place as usize] += 1;
                            for end in swept[place as usize].ends.map(|end| end as usize) {
                                match round {
                                    1 => {
                                        assert!(stripes.ranges[index].contains(&(end as u32)), "{name} {length}: not its stripe");
                                    }
                                    _ => assert_eq!(owner[end], (2, index), "{name} {length}: not its border"),
                                }
                            }
                        }
                    }
                }
                let mut last = vec![None; cloth.rest.len()];
                for &place in stripes.first.iter().chain(&stripes.second).flat_map(|task| &task.edges) {
                    for end in swept[place as usize].ends.map(|end| end as usize) {
                        assert!(last[end] < Some(place), "{name} {length}: vertex {end} sees {place} after {:?}", last[end]);
                        last[end] = Some(place);
                    }
                }
                assert!(visited.iter().all(|&count| count == 1) && moved.iter().all(|&count| count == 1), "{name} {length}");
                // What lies across from a stripe's border is not moved in the first round: forces look there.
                let of = |vertex: u32| stripes.ranges.iter().position(|range| range.contains(&vertex));
                for link in &cloth.links {
                    let [a, b] = link.ends;
                    assert!(of(a) == of(b) || [a, b].iter().all(|&end| owner[end as usize].0 == 2), "{name} {length}");
                }
            }
        }
    }

    #[test]
    fn borders_of_a_grid_are_apart() {
        let cloth = Cloth::new(&Mesh::grid(64, 128, 1.0, 2.0), &Options::default()).unwrap();
        let stripes = Stripes::new(&cloth.links, cloth.swept().len(), cloth.rest.len());
        assert!(stripes.ranges.len() > 8, "{} stripes", stripes.ranges.len());
        assert_eq!(stripes.second.len(), stripes.ranges.len() - 1);
        let late: usize = stripes.second.iter().map(|task| task.edges.len()).sum();
        assert!(late < cloth.swept().len() / 2, "{late} of {} edges wait", cloth.swept().len());
    }
}
