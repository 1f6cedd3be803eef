//! Unit tests of `src/cpu/tethers.rs`.

use glam::{Vec3, Vec3A, Vec4};

use super::*;
use crate::cpu::partition::Partition;
use crate::cpu::tasks::shared::{SharedArray, Task};
use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::oracle;
use crate::simd::{self, Width};
use crate::step::coefficients::Coefficients;
use crate::step::motion::Motion;
use crate::step::plan::{PlanBuffers, StepInputs};
use crate::step::substep_count::Length;
use crate::{Attributes, Mesh, Options};

/// At every SIMD width, each tethered vertex is moved as the oracle says and no other vertex is moved, in gentle and
/// wild motion, with moving pins.
#[test]
fn every_width_holds_as_the_oracle_does() {
    let options = Options { pinned: vec![0, 36, 500], ..Options::default() };
    let cloth = Cloth::new(&Mesh::grid(37, 61, 1.0, 1.6), &options).unwrap();
    let h = 1.0 / 1200.0;
    let coefficients = Coefficients::new(&cloth, &[], &options, Length::of(h));
    assert!(coefficients.tethers.len() > 500 && coefficients.tethers.len() < cloth.rest.len() - 100);
    let motion = Motion::after(&cloth, &cloth.rest, h);
    let targets = motion.pins.iter().map(|pin| *pin + cloth.origin + Vec3::new(0.03, 0.02, -0.01)).collect();
    let attributes = Attributes { pin_targets: Some(targets), ..Attributes::default() };
    let mut buffers = PlanBuffers::default();
    let inputs = StepInputs::of(&cloth, &options, &coefficients, &motion, 4, &attributes);
    let plan = Plan::new(&inputs, &mut buffers);
    let substep = &plan.substeps[2];
    let mut random = fastrand::Rng::with_seed(6);
    let mut vector = |size: f32| Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
    for size in [0.01, 0.2, 5.0] {
        let x: Vec<Vec4> = cloth.rest.iter().map(|x| *x + vector(size).extend(0.0)).collect();
        let start: Vec<Vec4> = cloth.rest.iter().map(|_| vector(size).extend(0.0)).collect();
        let mut plain = start.clone();
        for &(vertex, tether) in &coefficients.tethers {
            let v = vertex as usize;
            let pin = motion.pins[cloth.tethers.as_ref().unwrap().anchors[tether.anchor as usize] as usize];
            let led = |at: f32| Vec3A::from(pin + at * Vec3::new(0.03, 0.02, -0.01));
            let reach = tether.length + 9.81 * tether.slack;
            let (d0, d) = (xyz(x[v]) - led(0.5), xyz(x[v] + start[v]) - led(0.75));
            plain[v] += oracle::tethered(d0, d - d0, reach, tether.share).extend(0.0);
        }
        let moved = plain.iter().zip(&start).map(|(a, b)| (a - b).truncate().length()).fold(0.0, f32::max);
        assert!(moved > 0.1 * size, "{size}: something is held");
        let partition = Partition::new(&cloth.links, cloth.swept().len(), &[], x.len());
        for width in Width::all() {
            let [mut x_now, mut u] = [(); 2].map(|()| AlignedVec::new(start.len()));
            x_now.copy_from_slice(&x);
            u.copy_from_slice(&start);
            let task = Task::alone();
            for pieces in &partition.rounds {
                let batches = TetherBatches::new(pieces, &coefficients.tethers, x.len(), width.lanes());
                let (x, u) = (SharedArray::new(x_now.room()), SharedArray::new(u.room()));
                for piece in 0..pieces.len() {
                    let (x, u) = (x.within(&task), u.within(&task));
                    simd::run(width, Hold { batches: &batches, piece, x, u, plan: &plan, substep });
                }
            }
            let apart = plain.iter().zip(u.iter()).map(|(a, b)| (a - b).truncate().length()).fold(0.0, f32::max);
            assert!(apart <= 3e-6 * (1.0 + size), "{size} {width:?}: {apart} of {moved}");
        }
    }
}
