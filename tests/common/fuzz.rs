//! Fuzz targets: arbitrary bytes given to the public interface must result in a clear error or in a state of finite
//! numbers. `fuzz/` calls these functions with libFuzzer's inputs, `tests/fuzz.rs` with random ones.

#![allow(dead_code, unreachable_pub, reason = "each target of fuzz/ takes its own door")]

use std::sync::Arc;

use cloth_deformer::glam::{Affine3A, Quat, Vec3};
use cloth_deformer::{
    Attributes, Backend, Binding, Collider, Contact, Deformer, Fabric, Levels, Mesh, Method, ObjError, ObjTemplate, Options,
    Quality, Sleep, Snapshot, StepError, Tethers,
};

/// Decodes bytes into choices; zeros once they are used up.
struct Choices<'a>(&'a [u8]);

impl Choices<'_> {
    fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    fn below(&mut self, count: u32) -> u32 {
        u32::from(self.byte()) % count
    }

    /// True with a probability of about 5 %.
    fn seldom(&mut self) -> bool {
        self.byte() >= 0xf4
    }

    /// A number that would hardly be given on purpose.
    fn hostile(&mut self) -> f32 {
        const HOSTILE: [f32; 16] = [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            0.0,
            -0.0,
            f32::MIN_POSITIVE,
            1e-45,
            4.4e-23,
            1e-12,
            -1.0,
            1e5,
            1e10,
            1e15,
            1e30,
            f32::MAX,
            f32::MIN,
        ];
        HOSTILE[self.below(16) as usize]
    }

    /// A number from 0.5 to 1.5 times `usual`, or occasionally a hostile one.
    fn number(&mut self, usual: f32) -> f32 {
        if self.seldom() { self.hostile() } else { usual * (0.5 + f32::from(self.byte()) / 256.0) }
    }

    fn vector(&mut self, usual: f32) -> Vec3 {
        Vec3::from_array([0; 3].map(|_: i32| self.number(usual) - usual))
    }
}

/// An OBJ file: the bytes themselves, or OBJ tokens selected by them.
pub fn obj(data: &[u8]) {
    const WORDS: [&str; 24] = [
        "v ", "f ", "vt ", "vn ", "o a\n", "g b\n", "\n", " ", "\\\n", "#", "/", "//", "-1", "1", "2", "3", "4", "0", ".5",
        "1e39", "nan", "-", "99999999999", "\r\n",
    ];
    let text = match data.split_first() {
        Some((first, rest)) if first % 4 > 0 => rest.iter().map(|&byte| WORDS[byte as usize % WORDS.len()]).collect(),
        _ => String::from_utf8_lossy(data).into_owned(),
    };
    let mesh = match Mesh::parse_obj(&text) {
        Err(error) => return assert!(!error.to_string().is_empty()),
        Ok(mesh) => mesh,
    };
    match ObjTemplate::parse(text.as_bytes()) {
        Ok(template) => {
            assert_eq!(template.mesh(), &mesh);
            let written = template.write(&mesh.positions).expect("its own positions are written");
            let again = Mesh::parse_obj(&String::from_utf8_lossy(&written)).expect("what was written is read");
            assert_eq!(again, mesh, "written as it came and read again");
        }
        Err(error) => assert!(matches!(error, ObjError::Parser { .. }), "{error}"),
    }
    let Ok(written) = mesh.write_obj() else { return };
    let again = Mesh::parse_obj(&written).expect("what was written is read");
    assert_eq!((&again.positions, &again.triangles), (&mesh.positions, &mesh.triangles), "written and read again");
    if mesh.positions.len() < 64
        && let Ok(mut deformer) = Deformer::new(&mesh, Options { backend: Backend::Cpu, ..Options::default() })
    {
        let stepped = deformer.step(1.0 / 60.0, &Attributes::default());
        finite(&mut deformer, &stepped.map(|_| ()));
    }
}

/// A random mesh with options, then some steps under random attributes.
pub fn scene(data: &[u8]) {
    let choices = &mut Choices(data);
    let (mesh, options) = mesh_and_options(choices);
    let pins = options.pinned.len();
    let mut deformer = match Deformer::new(&mesh, options) {
        Ok(deformer) => deformer,
        Err(error) => return assert!(error.to_string().len() > 20, "{error}"),
    };
    if choices.below(4) == 0 {
        let untangled = deformer.untangle(&attributes(choices, pins)).map(|_| ());
        finite(&mut deformer, &untangled);
    }
    for _ in 0..3 {
        let (dt, attributes) = (choices.number(1.0 / 60.0).min(0.2), attributes(choices, pins));
        let before = deformer.positions().unwrap().to_vec();
        let stepped = deformer.step(dt, &attributes).map(|_| ());
        if stepped.is_err() {
            assert_eq!(deformer.positions().unwrap(), before, "a step that failed leaves the state");
        }
        finite(&mut deformer, &stepped);
    }
    assert!(deformer.crossings().unwrap().iter().all(|found| found.edge.iter().all(|&v| (v as usize) < mesh.positions.len())));
    let render = Mesh { positions: (0..3).map(|_| choices.vector(1.0)).collect(), triangles: vec![[0, 1, 2]] };
    match Binding::new(&render, &mesh) {
        Err(error) => assert!(error.to_string().len() > 20, "{error}"),
        Ok(binding) => {
            let mut moved = render.positions;
            binding.apply(deformer.positions().unwrap(), &mut moved).expect("as many vertices as it was made for");
            assert!(moved.iter().all(|x| x.is_finite()), "{moved:?}");
        }
    }
}

/// Random sequences of calls, compared with a twin that gets only the calls that succeeded.
pub fn calls(data: &[u8]) {
    let choices = &mut Choices(data);
    let mesh = Mesh::grid(2 + choices.below(3), 2 + choices.below(3), 1.0, 1.0);
    let method = [Method::SmallSteps, Method::Relaxation { iterations: 2 }, Method::Springs][choices.below(3) as usize];
    let fabric = Fabric { stretch: 50.0, bending: [0.0, 1e-4][choices.below(2) as usize], ..Fabric::default() };
    let quality = Quality::Substeps(1 + choices.below(8));
    let contact = (choices.below(4) == 0).then(Contact::default);
    let options = Options { backend: Backend::Cpu, method, fabric, quality, pinned: vec![0], contact, ..Options::default() };
    let [mut one, mut twin] = [(); 2].map(|()| Deformer::new(&mesh, options.clone()).expect("a plain scene is built"));
    let (vertices, mut pins) = (mesh.positions.len() as u32, 1);
    for _ in 0..6 {
        match choices.below(14) {
            0 => [&mut one, &mut twin].into_iter().for_each(Deformer::reset),
            1 => {
                let [x, v] = [1.0, 0.5].map(|size| mesh.positions.iter().map(|_| choices.vector(size)).collect::<Vec<_>>());
                if one.set_state(&x, &v).is_ok() {
                    twin.set_state(&x, &v).unwrap();
                }
            }
            2 => {
                let _ = one.forecast(choices.number(1.0 / 60.0).min(0.2), &attributes(choices, pins));
                let _ = one.measure().unwrap();
                one.request_positions().unwrap();
            }
            3 => {
                let fabric = Fabric { density: choices.number(0.2), stretch: choices.number(50.0), ..fabric };
                if one.set_fabric(fabric).is_ok() {
                    twin.set_fabric(fabric).unwrap();
                }
            }
            4 => {
                let mass = choices.seldom().then(|| (0..vertices).map(|_| choices.number(0.1)).collect::<Vec<_>>());
                if one.set_mass(mass.clone()).is_ok() {
                    twin.set_mass(mass).unwrap();
                }
            }
            5 => {
                let pinned: Vec<u32> = (0..choices.below(4)).map(|_| choices.below(vertices + 1)).collect();
                if one.set_pinned(pinned.clone()).is_ok() {
                    pins = pinned.len();
                    twin.set_pinned(pinned).unwrap();
                }
            }
            6 => {
                let turn = Quat::from_vec4(choices.vector(1.0).extend(1.0)).normalize();
                let motion = Affine3A::from_rotation_translation(turn, choices.vector(1.0));
                if one.warp(motion).is_ok() {
                    twin.warp(motion).unwrap();
                }
            }
            7 => {
                // Restoring one's own snapshot must not change anything.
                let bytes = one.snapshot().unwrap().to_bytes();
                one.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
            }
            8 => {
                let quality = [Quality::Substeps(choices.below(9)), Quality::Strain(choices.number(0.1))];
                let quality = quality[choices.below(2) as usize];
                if one.set_quality(quality).is_ok() {
                    twin.set_quality(quality).unwrap();
                }
            }
            9 => {
                let attributes = attributes(choices, pins);
                if let Ok(untangled) = one.untangle(&attributes) {
                    assert_eq!(twin.untangle(&attributes), Ok(untangled));
                }
            }
            _ => {
                let (dt, attributes) = (choices.number(1.0 / 60.0).min(0.2), attributes(choices, pins));
                match one.step(dt, &attributes) {
                    Ok(report) => assert_eq!(twin.step(dt, &attributes), Ok(report)),
                    Err(error) => assert!(error.to_string().len() > 20, "{error}"),
                }
            }
        }
        assert_eq!(one.positions().unwrap(), twin.positions().unwrap(), "what failed left no trace");
        assert_eq!(one.velocities().unwrap(), twin.velocities().unwrap(), "what failed left no trace");
    }
}

fn finite(deformer: &mut Deformer, stepped: &Result<(), StepError>) {
    if let Err(error) = stepped {
        assert!(error.to_string().len() > 20, "{error}");
    }
    assert!(deformer.positions().unwrap().iter().all(|x| x.is_finite()), "positions are numbers");
    assert!(deformer.velocities().unwrap().iter().all(|v| v.is_finite()), "velocities are numbers");
    let measure = deformer.measure().unwrap();
    assert!(measure.mean_strain >= 0.0 && !measure.potential_energy.is_nan(), "{measure:?}");
}

fn mesh_and_options(choices: &mut Choices<'_>) -> (Mesh, Options) {
    let vertices = 1 + choices.below(8);
    let positions: Vec<Vec3> = (0..vertices).map(|_| choices.vector(1.0)).collect();
    let corner = |choices: &mut Choices<'_>| if choices.seldom() { vertices } else { choices.below(vertices) };
    let triangles = (0..choices.below(9)).map(|_| [0; 3].map(|_: i32| corner(choices))).collect();
    let mesh = Mesh { positions, triangles };
    let fabric = Fabric {
        density: choices.number(0.2),
        stretch: choices.number(1000.0),
        bending: choices.number(1e-4),
        damping: choices.number(0.03),
    };
    let method =
        [Method::SmallSteps, Method::Relaxation { iterations: choices.below(4) }, Method::Springs][choices.below(3) as usize];
    let quality = match choices.below(4) {
        0 | 1 => Quality::Substeps(choices.below(9)),
        2 => Quality::Strain(choices.number(0.1)),
        _ => Quality::Hold { stretch: choices.number(0.1), share: choices.number(0.8) },
    };
    let levels = [Levels::Auto, Levels::Off, Levels::Count(3)][choices.below(3) as usize];
    let pinned = (0..choices.below(3)).map(|_| corner(choices)).collect();
    let mass = choices.seldom().then(|| (0..vertices).map(|_| choices.number(0.1)).collect());
    let edge_scale = choices.seldom().then(|| mesh.edges().iter().map(|_| choices.number(1.0)).collect());
    let bending_scale = choices.seldom().then(|| (0..vertices).map(|_| choices.number(1.0)).collect());
    let contact = (choices.below(3) == 0).then(|| Contact { thickness: choices.number(0.02), friction: choices.number(0.3) });
    let [mean_speed, speed, after] = [0.005, 0.1, 0.03].map(|usual| choices.number(usual));
    let sleep = (choices.below(4) == 0).then_some(Sleep { mean_speed, speed, after });
    let tethers = [Tethers::Auto, Tethers::Off][choices.below(2) as usize];
    let options = Options {
        backend: Backend::Cpu,
        method,
        quality,
        levels,
        fabric,
        pinned,
        mass,
        edge_scale,
        bending_scale,
        contact,
        sleep,
        tethers,
        ..Options::default()
    };
    (mesh, options)
}

fn attributes(choices: &mut Choices<'_>, pins: usize) -> Attributes {
    let collider = |choices: &mut Choices<'_>| {
        let collider = match choices.below(6) {
            0 => Collider::sphere(choices.vector(1.0), choices.number(0.5)),
            1 => Collider::plane(choices.vector(1.0), choices.vector(1.0)),
            2 => Collider::tapered_capsule(choices.vector(1.0), choices.number(0.3), choices.vector(1.0), choices.number(0.1)),
            3 => {
                let (half, turn) = (choices.vector(0.5).abs(), choices.vector(1.0).extend(choices.number(0.5)));
                Collider::rounded_box(choices.vector(1.0), half, Quat::from_vec4(turn), choices.number(0.01))
            }
            4 => {
                let positions = (0..4).map(|_| choices.vector(1.0)).collect();
                Collider::mesh(Arc::new(Mesh { positions, triangles: vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]] }))
            }
            _ => Collider::capsule(choices.vector(1.0), choices.vector(1.0), choices.number(0.3)),
        };
        let collider = collider.with_friction(choices.number(0.3));
        match choices.below(4) {
            0 => collider.teleported(),
            1 => collider.with_id(u64::from(choices.byte() % 4)),
            _ => collider,
        }
    };
    let colliders = (0..choices.below(3)).map(|_| collider(choices)).collect();
    let led = choices.below(3) == 0;
    Attributes {
        gravity: choices.vector(9.81),
        wind: choices.vector(3.0),
        air_density: choices.number(1.2),
        damping: choices.number(0.1),
        colliders,
        pin_targets: led.then(|| (0..pins).map(|_| choices.vector(1.0)).collect()),
        ..Attributes::default()
    }
}
