//! The colour order cut into tasks for several threads: the same order edge for edge, and a thread waits for its neighbours twice a
//! sweep instead of for all others once a colour.
//!
//! The vertices are cut into stripes, ranges of the vertex order, in which neighbours are near. Walk the edges in colour
//! order: an edge inside one stripe goes to that stripe's task of the first round, unless an edge that had to wait came to
//! one of its ends before. Any other edge waits for the second round, and so do its ends. So within a round no two tasks
//! share a vertex, and at every vertex the edges come in the order of their colours: the result is the same bit for bit
//! however the cloth is cut, and however many threads take the tasks. What waits spreads by an edge a colour at most; where
//! stripes are wider than that, what waits at one border has nothing to do with the next, and each is a task of its own.
//! Where they are not (many colours, as on coarse levels), what waits is cut again half a stripe farther on, and again, a round each.
//!
//! A task stays in cache: all colours of a stripe pass before the next stripe is touched.

use std::ops::Range;

use crate::model::cloth::Link;

/// Vertices in a stripe, at least: fewer are not worth a task (about 10 us).
const LEAST: usize = 512;
/// Stripes are this many times the mean distance in memory between an edge's ends: eight rows of a grid, and what waits at
/// a border of it is four on each side.
const REACH: f64 = 12.0;
/// Stripes of a coarse level, at most: more are more rounds.
const SHARES: usize = 32;
/// Rounds, at most but one.
const MOST: usize = 16;
/// Parts of a border up to this many vertices together are one task.
const CRUMBS: usize = 128;
/// As many vertices as a loop over them takes at a time.
const TOGETHER: usize = 16;
/// No task yet.
const NONE: u32 = u32::MAX;

/// See the module. Made once for a cloth.
#[derive(Debug, Clone)]
pub(crate) struct Stripes {
    pub ranges: Vec<Range<u32>>,
    /// Each stripe, and those that its edges lead to.
    pub around: Vec<Vec<u32>>,
    /// The tasks of each round. Those of the first are the stripes', those of the last move what the first do not.
    pub rounds: Vec<Vec<Task>>,
}

/// Edges that one thread visits in a round, and the vertices that are then done with.
#[derive(Debug, Clone, Default)]
pub(crate) struct Task {
    /// Places in the colour order, ascending.
    pub edges: Vec<u32>,
    pub vertices: Vec<Range<u32>>,
    /// Stripes of all vertices that it visits, and of all that look at those that it moves.
    pub touches: Vec<u32>,
}

/// Adds a stripe to a short list, in order.
fn insert(list: &mut Vec<u32>, stripe: u32) {
    if let Err(place) = list.binary_search(&stripe) {
        list.insert(place, stripe);
    }
}

impl Stripes {
    /// Cuts `links`, of which the first `swept` are in colour order, between `vertices` vertices.
    pub(crate) fn new(links: &[Link], swept: usize, vertices: usize) -> Stripes {
        Stripes::cut(links, swept, vertices, ((REACH * distance(links)) as usize).max(LEAST))
    }

    /// The same for the many colours of a coarse level, which would make one task of all borders: narrower stripes, more rounds.
    pub(crate) fn coarse(links: &[Link], vertices: usize) -> Stripes {
        let narrow = (0.5 * REACH * distance(links)) as usize;
        Stripes::cut(links, links.len(), vertices, narrow.max(vertices / SHARES).max(LEAST / 4))
    }

    /// One stripe: all colours in turn, for one thread.
    pub(crate) fn one(links: &[Link], vertices: usize) -> Stripes {
        Stripes::cut(links, links.len(), vertices, vertices)
    }

    /// The same with stripes of about `length` vertices.
    fn cut(links: &[Link], swept: usize, vertices: usize, length: usize) -> Stripes {
        let count = (vertices / length).max(1);
        let start = |stripe: usize| match stripe {
            _ if stripe == count => vertices as u32,
            _ => (stripe * vertices / count / TOGETHER * TOGETHER) as u32,
        };
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
        let places: Vec<u32> = (0..swept as u32).collect();
        let (mut first, mut late) = round(links, &places, &stripe_of, count, &mut waits);
        // Vertices are moved so many at a time: one that waits holds up those beside it, rather than that they are moved one by one.
        for beside in waits.chunks_mut(TOGETHER).filter(|beside| beside.contains(&true)) {
            beside.fill(true);
        }
        for (stripe, (task, range)) in first.iter_mut().zip(&ranges).enumerate() {
            task.vertices = runs(range.clone().filter(|&vertex| !waits[vertex as usize]));
            task.touches = vec![stripe as u32];
        }
        let most = first.iter().map(|task| task.edges.len()).max().unwrap_or(0);
        let mut rounds = vec![first];
        loop {
            let last = borders(links, &late, &waits, &stripe_of);
            if last.iter().all(|task| 2 * task.edges.len() <= 3 * most) {
                rounds.push(last);
                break;
            }
            // What waits at one border has met what waits at the next. Cut it where the borders were not.
            let length = vertices.div_ceil(count);
            let shift = if rounds.len() % 2 == 1 { length / 2 } else { 0 };
            let again: Vec<u32> = (0..vertices).map(|vertex| ((vertex + shift) / length) as u32).collect();
            let (tasks, later) = round(links, &late, &again, count + 1, &mut vec![false; vertices]);
            if rounds.len() == MOST || later.len() == late.len() {
                // Edges longer than half a stripe: whatever waits is at hand as it is.
                rounds.push(last);
                break;
            }
            let mut tasks: Vec<Task> = tasks.into_iter().filter(|task| !task.edges.is_empty()).collect();
            for Task { edges, touches, .. } in &mut tasks {
                let ends = edges.iter().flat_map(|&place| links[place as usize].ends);
                ends.for_each(|end| insert(touches, stripe_of[end as usize]));
            }
            rounds.push(tasks);
            late = later;
        }
        let mut around: Vec<Vec<u32>> = (0..count as u32).map(|stripe| vec![stripe]).collect();
        for [a, b] in links.iter().map(|link| link.ends.map(|end| stripe_of[end as usize])).filter(|[a, b]| a != b) {
            insert(&mut around[a as usize], b);
            insert(&mut around[b as usize], a);
        }
        Stripes { ranges, around, rounds }
    }
}

/// Mean distance in memory between an edge's ends.
fn distance(links: &[Link]) -> f64 {
    links.iter().map(|link| f64::from(link.ends[0].abs_diff(link.ends[1]))).sum::<f64>() / links.len().max(1) as f64
}

/// The edges at `places` that lie in one stripe and come before any that do not, stripe by stripe, and the others; marks the vertices
/// that wait for those.
fn round(links: &[Link], places: &[u32], stripe_of: &[u32], stripes: usize, waits: &mut [bool]) -> (Vec<Task>, Vec<u32>) {
    let mut tasks = vec![Task::default(); stripes];
    let mut late = Vec::new();
    for &place in places {
        let [a, b] = links[place as usize].ends.map(|end| end as usize);
        if stripe_of[a] != stripe_of[b] || waits[a] || waits[b] {
            (waits[a], waits[b]) = (true, true);
            late.push(place);
        } else {
            tasks[stripe_of[a] as usize].edges.push(place);
        }
    }
    (tasks, late)
}

/// The connected parts of the edges that wait, one task each, or several small ones together.
fn borders(links: &[Link], late: &[u32], waits: &[bool], stripe_of: &[u32]) -> Vec<Task> {
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
    // So are vertices that are moved together.
    for first in (0..waits.len()).step_by(TOGETHER).filter(|&first| waits[first]) {
        for vertex in first + 1..waits.len().min(first + TOGETHER) {
            let [a, b] = [first, vertex].map(|vertex| root(&mut parent, vertex as u32));
            parent[a.max(b) as usize] = a.min(b);
        }
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
        lists.into_iter().map(|vertices| Task { vertices: runs(vertices.into_iter()), ..Task::default() }).collect();
    // Of a vertex without an edge too: what waits with it is of its stripe.
    for link in links {
        for [moved, by] in [link.ends, [link.ends[1], link.ends[0]]].map(|ends| ends.map(|end| end as usize)) {
            if task_of[moved] != NONE {
                [moved, by].iter().for_each(|&end| insert(&mut tasks[task_of[moved] as usize].touches, stripe_of[end]));
            }
        }
    }
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
        // Vertices without an edge.
        let mut loose = grid.clone();
        loose.triangles.retain(|corners| !corners.iter().any(|vertex| vertex % 50 > 45));
        vec![
            ("grid", build(&grid, vec![0, 39])),
            ("loose", build(&loose, vec![0, 39])),
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
                let last = stripes.rounds.len() - 1;
                let mut owner = vec![(0, 0); cloth.rest.len()];
                let mut moved = vec![0; cloth.rest.len()];
                for (round, tasks) in stripes.rounds.iter().enumerate() {
                    for (index, task) in tasks.iter().enumerate() {
                        for vertex in task.vertices.iter().cloned().flatten() {
                            moved[vertex as usize] += 1;
                            owner[vertex as usize] = (round, index);
                        }
                    }
                }
                let mut visited = vec![0; swept.len()];
                let mut latest = vec![None; cloth.rest.len()];
                for (round, tasks) in stripes.rounds.iter().enumerate() {
                    let mut visitor = vec![None; cloth.rest.len()];
                    for (index, task) in tasks.iter().enumerate() {
                        for &place in &task.edges {
                            visited[place as usize] += 1;
                            for end in swept[place as usize].ends.map(|end| end as usize) {
                                assert!(visitor[end].is_none_or(|by| by == index), "{name} {length}: two tasks of a round meet");
                                visitor[end] = Some(index);
                                assert!(latest[end] < Some(place), "{name} {length}: {end} sees {place} after {:?}", latest[end]);
                                latest[end] = Some(place);
                                match round {
                                    0 => {
                                        assert!(stripes.ranges[index].contains(&(end as u32)), "{name} {length}: not its stripe");
                                    }
                                    _ => assert_eq!(owner[end].0, last, "{name} {length}: moved before its last edge"),
                                }
                                assert!(round < last || owner[end] == (round, index), "{name} {length}: not its border");
                            }
                        }
                    }
                }
                assert!(visited.iter().all(|&count| count == 1) && moved.iter().all(|&count| count == 1), "{name} {length}");
                let of = |vertex: u32| stripes.ranges.iter().position(|range| range.contains(&vertex));
                // A task waits for all who meet it.
                for (round, tasks) in stripes.rounds.iter().enumerate() {
                    for (index, task) in tasks.iter().enumerate() {
                        let touches = |vertex: u32| task.touches.binary_search(&(of(vertex).unwrap() as u32)).is_ok();
                        let ends = task.edges.iter().flat_map(|&place| swept[place as usize].ends);
                        assert!(ends.chain(task.vertices.iter().cloned().flatten()).all(touches), "{name} {length}");
                        let moves = |end: u32| owner[end as usize] == (round, index);
                        let looks = cloth.links.iter().map(|link| link.ends).filter(|ends| ends.iter().any(|&end| moves(end)));
                        assert!(looks.flatten().all(touches), "{name} {length}: somebody looks at what {round}.{index} moves");
                    }
                }
                for [a, b] in cloth.links.iter().map(|link| link.ends) {
                    let [a, b] = [a, b].map(|end| of(end).unwrap());
                    assert!(
                        stripes.around[a].contains(&(b as u32)) && stripes.around[b].contains(&(a as u32)),
                        "{name} {length}"
                    );
                }
                // What lies across from a stripe's border is not moved in the first round: forces look there.
                for link in &cloth.links {
                    let [a, b] = link.ends;
                    assert!(of(a) == of(b) || [a, b].iter().all(|&end| owner[end as usize].0 == last), "{name} {length}");
                }
            }
        }
    }

    #[test]
    fn borders_of_a_grid_are_apart() {
        let cloth = Cloth::new(&Mesh::grid(64, 128, 1.0, 2.0), &Options::default()).unwrap();
        let stripes = Stripes::new(&cloth.links, cloth.swept().len(), cloth.rest.len());
        assert!(stripes.ranges.len() > 8, "{} stripes", stripes.ranges.len());
        assert_eq!(stripes.rounds.len(), 2);
        assert_eq!(stripes.rounds[1].len(), stripes.ranges.len() - 1);
        let late: usize = stripes.rounds[1].iter().map(|task| task.edges.len()).sum();
        assert!(late < cloth.swept().len() / 2, "{late} of {} edges wait", cloth.swept().len());
    }

    /// Where colours are many for the stripes' width, more rounds keep the tasks small.
    #[test]
    fn coarse_levels_share_their_work() {
        let cloth = Cloth::new(&Mesh::grid(256, 256, 1.0, 1.0), &Options::default()).unwrap();
        let level = &Hierarchy::new(&cloth).levels[0];
        let stripes = Stripes::coarse(&level.links, level.inverse_mass.len());
        let edges = |task: &Task| task.edges.len();
        let longest: usize = stripes.rounds.iter().filter_map(|tasks| tasks.iter().map(edges).max()).sum();
        let most: Vec<(usize, usize)> =
            stripes.rounds.iter().map(|tasks| (tasks.len(), tasks.iter().map(edges).max().unwrap_or(0))).collect();
        println!("{} edges, {} colours: {most:?}", level.links.len(), level.colors.len());
        assert!(5 * longest < level.links.len(), "one after another {longest} of {} edges: {most:?}", level.links.len());
    }
}
