//! Registers at every width, compared with plain numbers.

use glam::Vec4;

use super::{Loop, MAX_LANES, Registers, Width, run};

/// Gathers the corners of pairs, and notes the first pair and corner that are wrong.
struct Gather<'a> {
    from: &'a [Vec4],
    places: &'a [[u32; 4]; MAX_LANES],
    wrong: &'a mut Option<[usize; 2]>,
}

impl Loop for Gather<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let all = L::gather(self.from, &self.places[..L::LANES]);
        for lane in 0..L::LANES {
            for (corner, registers) in all.iter().enumerate() {
                let found = registers[lane % 4].to_vectors()[lane / 4];
                if found != self.from[self.places[lane][corner] as usize] {
                    self.wrong.get_or_insert([lane, corner]);
                }
            }
        }
    }
}

#[test]
fn every_lane_gathers_its_vectors() {
    let mut random = fastrand::Rng::with_seed(3);
    for count in [1, 2, 7, 100] {
        let from: Vec<Vec4> = (0..count).map(|_| Vec4::from_array([0; 4].map(|_: i32| random.f32()))).collect();
        let places = [0; MAX_LANES].map(|_: i32| [0; 4].map(|_: i32| random.u32(0..count)));
        for width in Width::all() {
            let mut wrong = None;
            run(width, Gather { from: &from, places: &places, wrong: &mut wrong });
            assert_eq!(wrong, None, "{width:?}");
        }
    }
}

/// A place outside is refused in every lane and corner, however far outside it is.
#[test]
fn nothing_outside_is_gathered() {
    let from = [Vec4::ONE; 5];
    for width in Width::all() {
        for (lane, corner) in (0..width.lanes()).flat_map(|lane| [0, 1, 2, 3].map(|corner| (lane, corner))) {
            for (count, outside) in [(5, 5), (5, 1 << 31), (5, u32::MAX), (0, 0), (0, u32::MAX)] {
                let mut places = [[0; 4]; MAX_LANES];
                places[lane][corner] = outside;
                let gather = || run(width, Gather { from: &from[..count], places: &places, wrong: &mut None });
                assert!(
                    std::panic::catch_unwind(gather).is_err(),
                    "{width:?}, lane {lane}, corner {corner}: {outside} of {count}"
                );
            }
        }
    }
}
