//! Where pins count as lone.

use super::{LONE, concentration};
use crate::model::cloth::Cloth;
use crate::{Mesh, Options};

/// Corners are lone, and an edge is not, however many vertices it has.
#[test]
fn an_edge_is_no_lone_pin() {
    for n in [20, 31, 99, 100, 101, 120, 201] {
        let of = |pinned: Vec<u32>| {
            let options = Options { pinned, ..Options::default() };
            concentration(&Cloth::new(&Mesh::grid(n, n, 1.0, 1.0), &options).unwrap(), 0.99)
        };
        let [edge, corners] = [of((0..n).collect()), of(vec![0, n - 1, n * (n - 1), n * n - 1])];
        assert!(edge < 0.6 * LONE && LONE < corners, "{n}: {edge} and {corners}");
    }
}
