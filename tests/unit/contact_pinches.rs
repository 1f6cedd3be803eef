use glam::Vec3A;

use super::{Kind, moves_through};

const THICKNESS: f32 = 0.005;
const TRIANGLE: [Vec3A; 3] = [Vec3A::ZERO, Vec3A::X, Vec3A::Z];

/// Whether a vertex that moves so far down from 1 mm above a place meets a triangle that moves up by 1 mm.
fn falls(place: Vec3A, by: f32) -> Option<bool> {
    let [a, b, c] = TRIANGLE;
    let from = [place + 0.001 * Vec3A::Y, a, b, c];
    let moves = [-by * Vec3A::Y, 0.001 * Vec3A::Y, 0.001 * Vec3A::Y, 0.001 * Vec3A::Y];
    let to = std::array::from_fn(|k| from[k] + moves[k]);
    moves_through(Kind::VertexTriangle, from, to, THICKNESS)
}

#[test]
fn a_vertex_moves_through_a_triangle_but_not_beside_it() {
    assert_eq!(falls(Vec3A::new(0.3, 0.0, 0.3), -0.0005), None);
    assert_eq!(falls(Vec3A::new(0.3, 0.0, 0.3), 0.001), Some(true));
    assert_eq!(falls(Vec3A::new(0.6, 0.0, 0.6), 0.001), Some(false));
    assert_eq!(falls(Vec3A::new(-0.001, 0.0, 0.3), 0.001), Some(false));
}

/// What touches from the beginning has no side.
#[test]
fn what_touches_does_not_move_through() {
    assert_eq!(falls(Vec3A::new(0.3, -0.000_999, 0.3), 0.001), Some(false));
}

/// Whether an edge that moves down by 2 mm, from 1 mm above, meets another one that crosses it at a share of its length.
fn crosses(share: f32) -> Option<bool> {
    let other = [Vec3A::new(share, 0.0, -0.5), Vec3A::new(share, 0.0, 0.5)];
    let from = [0.001 * Vec3A::Y, Vec3A::X + 0.001 * Vec3A::Y, other[0], other[1]];
    let to = [from[0] - 0.002 * Vec3A::Y, from[1] - 0.002 * Vec3A::Y, other[0], other[1]];
    moves_through(Kind::EdgeEdge, from, to, THICKNESS)
}

#[test]
fn edges_move_through_each_other_but_not_beside() {
    assert_eq!(crosses(0.4), Some(true));
    assert_eq!(crosses(1.1), Some(false));
}
