//! Unit tests of `src/deformer/snapshot.rs`, for content that only a forged snapshot has.

use super::*;
use crate::{Attributes, Backend, Mesh, Options, Quality};

/// A state has a velocity for each pin, or for none.
#[test]
fn velocities_of_some_pins_are_refused() {
    let options = Options { backend: Backend::Cpu, quality: Quality::Substeps(2), pinned: vec![0, 3], ..Options::default() };
    let mesh = Mesh::grid(4, 4, 1.0, 1.0);
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    for frame in 1..3_u8 {
        let pin_targets = [0, 3].map(|vertex: usize| mesh.positions[vertex] + 0.01 * f32::from(frame) * Vec3::X).to_vec();
        cloth.step(0.02, &Attributes { pin_targets: Some(pin_targets), ..Attributes::default() }).unwrap();
    }
    let taken = cloth.snapshot().unwrap();
    for (kept, is_valid) in [(0, true), (1, false), (2, true)] {
        let mut content = decode(&taken.bytes).unwrap();
        assert_eq!(content.state.motion.pin_velocities.len(), 2);
        content.state.motion.pin_velocities.truncate(kept);
        let restored = cloth.restore(&Snapshot::encode(content));
        assert_eq!(restored.is_ok(), is_valid, "{kept} of 2");
        cloth.set_pinned(vec![0, 3, 5]).unwrap();
        cloth.set_pinned(vec![0, 3]).unwrap();
    }
}
