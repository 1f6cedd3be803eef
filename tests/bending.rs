//! Bending at rest: the energy of cylinders, its gradient, and beams with closed forms.

mod common;

use cloth_deformer::glam::{DVec3, Vec3};
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Levels, Mesh, Options, Quality};
use common::{FRAME, meshes};

const DENSITY: f64 = 0.2;

/// A fabric that only bends: it is inextensible, so its potential energy without gravity is that of bending.
fn bending_only(bending: f64) -> Fabric {
    Fabric { density: DENSITY as f32, stretch: f32::INFINITY, bending: bending as f32, damping: 0.0 }
}

/// The mesh rolled onto a cylinder of curvature `kappa` (1/m), curved along the direction `degrees` from x toward z.
fn rolled(mesh: &Mesh, kappa: f64, degrees: f64) -> Vec<Vec3> {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let (along, across) = (DVec3::new(cos, 0.0, sin), DVec3::new(-sin, 0.0, cos));
    let place = |x: &Vec3| {
        let angle = kappa * x.as_dvec3().dot(along);
        let straight = across * x.as_dvec3().dot(across);
        (straight + (along * angle.sin() + DVec3::Y * (1.0 - angle.cos())) / kappa).as_vec3()
    };
    mesh.positions.iter().map(place).collect()
}

fn area(mesh: &Mesh) -> f64 {
    let up = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize].as_dvec3());
        0.5 * (b - a).cross(c - a).y
    };
    mesh.triangles.iter().map(up).inspect(|&area| assert!(area > 0.0, "every triangle's front is up")).sum()
}

/// The energy per area of a cylinder is `B kappa²/2`, for any direction of the curvature on any mesh.
#[test]
fn a_cylinders_energy_depends_on_neither_mesh_nor_direction() {
    let n = 65;
    let (bending, kappa) = (1e-4, 1.0);
    let meshes = [
        ("same diagonal", Mesh::grid(n, n, 1.0, 1.0)),
        ("alternating", meshes::alternating(n)),
        ("equilateral", meshes::equilateral(n)),
        ("delaunay", meshes::delaunay(n, 1)),
    ];
    for (name, mesh) in meshes {
        let exact = 0.5 * bending * kappa * kappa * area(&mesh);
        assert!((area(&mesh) - 1.0).abs() < 0.01, "{name}: a unit square");
        let options = Options { backend: Backend::Cpu, fabric: bending_only(bending), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let still = vec![Vec3::ZERO; mesh.positions.len()];
        for degrees in [0.0, 45.0, 90.0, 135.0] {
            cloth.set_state(&rolled(&mesh, kappa, degrees), &still).unwrap();
            let ratio = cloth.measure().unwrap().potential_energy / exact;
            println!("{name}, {degrees} degrees: E/E_exact = {ratio:.4}");
            assert!((ratio - 1.0).abs() < 0.03, "{name}, {degrees} degrees: E/E_exact = {ratio}");
        }
    }
}

/// A double-sided mesh has each triangle twice, so it is two sheets in one and bends twice as hard.
#[test]
fn two_sheets_in_one_bend_twice_as_hard() {
    let one = Mesh::grid(17, 17, 1.0, 1.0);
    let back = one.triangles.iter().map(|&[a, b, c]| [a, c, b]);
    let two = Mesh { positions: one.positions.clone(), triangles: one.triangles.iter().copied().chain(back).collect() };
    let energies = [one, two].map(|mesh| {
        let options = Options { backend: Backend::Cpu, fabric: bending_only(1e-4), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        cloth.set_state(&rolled(&mesh, 1.0, 30.0), &[Vec3::ZERO; 17 * 17]).unwrap();
        cloth.measure().unwrap().potential_energy
    });
    assert!((energies[1] / energies[0] - 2.0).abs() < 1e-3, "{energies:?}");
}

/// A vertex of two triangles, each of which holds the other by one edge only, and their areas (m²): the tip of a tooth.
fn tooth() -> (Mesh, [f64; 2]) {
    let positions = [[0.0, 0.0], [0.1, 0.0], [0.03, 0.08], [0.06, -0.07]].map(|[x, z]| Vec3::new(x, 0.0, z)).to_vec();
    (Mesh { positions, triangles: vec![[0, 2, 1], [0, 1, 3]] }, [0.004, 0.0035])
}

/// The energy of two triangles that are folded by the angle `a` at their edge of length `l` is `3/2 B l² (2 sin(a/2))² / (A1 + A2)`.
#[test]
fn the_tip_of_a_tooth_bends_about_its_base() {
    let (mesh, areas) = tooth();
    let bending = 1e-4;
    let options = Options { backend: Backend::Cpu, fabric: bending_only(bending), ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    for angle in [0.0_f32, 0.2, 1.0, 2.0] {
        let mut x = mesh.positions.clone();
        x[3] = Vec3::new(0.06, 0.07 * angle.sin(), -0.07 * angle.cos());
        cloth.set_state(&x, &[Vec3::ZERO; 4]).unwrap();
        let energy = cloth.measure().unwrap().potential_energy;
        let bent = 2.0 * (0.5 * f64::from(angle)).sin();
        let exact = 1.5 * bending * 0.01 * bent * bent / areas.iter().sum::<f64>();
        assert!((energy - exact).abs() < 1e-5 * exact.max(1e-6), "{energy} J at {angle}, not {exact} J");
    }
}

/// The force is the gradient of the energy, also of a tooth. The stretch of all edges is scaled to 0, so bending is the only force.
fn the_force_is_the_energys_gradient(backend: Backend) {
    let (mut mesh, tooth) = (meshes::delaunay(6, 3), tooth().0);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(tooth.positions);
    mesh.triangles.extend(tooth.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    let vertices = mesh.positions.len();
    let (bending, h) = (1e-3, 1e-3);
    let fabric = Fabric { stretch: 1.0, ..bending_only(bending) };
    let edge_scale = Some(vec![0.0; mesh.edges().len()]);
    let masses: Vec<f32> = (0..vertices).map(|v| 0.01 + 0.001 * v as f32).collect();
    let options =
        Options { backend, fabric, edge_scale, mass: Some(masses.clone()), quality: Quality::Substeps(1), ..Options::default() };
    let still = vec![Vec3::ZERO; vertices];
    let bent: Vec<Vec3> = rolled(&mesh, 2.0, 30.0).iter().zip(&mesh.positions).map(|(x, at)| *x + 0.1 * at.z * at.z).collect();
    let mut host = Deformer::new(&mesh, Options { backend: Backend::Cpu, ..options.clone() }).unwrap();
    let mut energy = |x: &[Vec3]| {
        host.set_state(x, &still).unwrap();
        host.measure().unwrap().potential_energy
    };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    cloth.set_state(&bent, &still).unwrap();
    let report = cloth.step(h, &Attributes { gravity: Vec3::ZERO, ..Attributes::default() }).unwrap();
    assert_eq!(report.warnings, [], "the whole rigidity acts");
    // From rest, the first kick lasts half a substep.
    let forces: Vec<DVec3> =
        cloth.velocities().unwrap().iter().zip(masses).map(|(v, m)| v.as_dvec3() * f64::from(2.0 * m / h)).collect();
    let largest = forces.iter().map(|f| f.length()).fold(0.0, f64::max);
    for vertex in 0..vertices {
        for axis in 0..3 {
            // The energy is quadratic, so a central difference is exact for any step.
            let mut moved = |by: f32| {
                let mut x = bent.clone();
                x[vertex][axis] += by;
                (energy(&x), f64::from(x[vertex][axis]))
            };
            let ((e1, x1), (e0, x0)) = (moved(0.25), moved(-0.25));
            let expected = -(e1 - e0) / (x1 - x0);
            let error = (forces[vertex][axis] - expected).abs() / largest;
            assert!(error < 1e-4, "vertex {vertex}, axis {axis}: {} N, not {expected} N", forces[vertex][axis]);
        }
    }
}

/// A strip along x whose first two columns are clamped, with the parameters of the closed forms.
struct Strip {
    columns: u32,
    rows: u32,
    mesh: Mesh,
    weights: Vec<f32>,
    options: Options,
    /// Length (m) beyond the clamp. Two clamped columns clamp the beam half a cell before the second one.
    length: f64,
    bending: f64,
}

impl Strip {
    /// Square cells, 1 m long, with B (N m) such that `rho g L³/B = heaviness` at g = 9.81 m/s².
    fn new(columns: u32, rows: u32, heaviness: f64, substeps: u32) -> Strip {
        let cell = 1.0 / (columns - 1) as f32;
        let mesh = Mesh::grid(columns, rows, 1.0, cell * (rows - 1) as f32);
        let length = 1.0 - 0.5 * f64::from(cell);
        let bending = DENSITY * 9.81 * length.powi(3) / heaviness;
        // Vertices at a border weigh half a cell: the load of a beam, independent of the triangulation.
        let half = |k: u32, count: u32| if k == 0 || k == count - 1 { 0.5 } else { 1.0 };
        let weights: Vec<f32> = (0..rows * columns).map(|v| half(v % columns, columns) * half(v / columns, rows)).collect();
        let options = Options {
            backend: Backend::Cpu,
            quality: Quality::Substeps(substeps),
            fabric: bending_only(bending),
            pinned: (0..rows).flat_map(|row| [row * columns, row * columns + 1]).collect(),
            mass: Some(weights.iter().map(|weight| weight * DENSITY as f32 * cell * cell).collect()),
            ..Options::default()
        };
        Strip { columns, rows, mesh, weights, options, length, bending }
    }

    /// Estimate of the angular frequency (1/s) of the slowest motion under `gravity` (m/s²), from that of a beam and of
    /// a hanging chain.
    fn slowest(&self, gravity: f64) -> f64 {
        (12.36 * self.bending / (DENSITY * self.length.powi(4)) + 1.45 * gravity / self.length).sqrt()
    }

    /// Lets the strip fall and settle, critically damped, for `periods / omega`. Returns sag and reach (m) of the tip.
    fn settle(&self, gravity: f64, periods: f64) -> (f64, f64) {
        let omega = self.slowest(gravity);
        let attributes =
            Attributes { gravity: Vec3::NEG_Y * gravity as f32, damping: 2.0 * omega as f32, ..Attributes::default() };
        let mut cloth = Deformer::new(&self.mesh, self.options.clone()).unwrap();
        for _ in 0..(60.0 * periods / omega) as u32 {
            let report = cloth.step(FRAME, &attributes).unwrap();
            assert_eq!(report.warnings, [], "the whole rigidity acts");
        }
        self.tip(cloth.positions().unwrap())
    }

    /// The same, constrained to a cylinder: after each substep, all vertices of a column are moved and slowed as one.
    ///
    /// Without this a narrow strip bends the opposite way across its width (anticlastic) and gives way: the energy
    /// depends on the mean curvature, and what keeps fabric from it is that it does not stretch, over widths `b` with
    /// `b² kappa >> sqrt(B/K)`.
    fn settle_as_cylinder(&self, gravity: f64, periods: f64) -> (f64, f64) {
        let omega = self.slowest(gravity);
        let Quality::Substeps(substeps) = self.options.quality else { unreachable!() };
        let attributes =
            Attributes { gravity: Vec3::NEG_Y * gravity as f32, damping: 2.0 * omega as f32, ..Attributes::default() };
        let mut cloth = Deformer::new(&self.mesh, self.options.clone()).unwrap();
        for _ in 0..(60.0 * periods / omega * f64::from(substeps)) as u32 {
            let report = cloth.step(FRAME / substeps as f32, &attributes).unwrap();
            assert_eq!(report.warnings, [], "the whole rigidity acts");
            let mut positions = self.average(cloth.positions().unwrap());
            let velocities = self.average(cloth.velocities().unwrap());
            positions.iter_mut().zip(&self.mesh.positions).for_each(|(x, rest)| x.z = rest.z);
            cloth.set_state(&positions, &velocities).unwrap();
        }
        self.tip(cloth.positions().unwrap())
    }

    /// Replaces each value by the mass-weighted mean of its column, as a rigid link across would do.
    fn average(&self, values: &[Vec3]) -> Vec<Vec3> {
        let (columns, rows) = (self.columns as usize, self.rows as usize);
        let mean = |column: usize| {
            let of = (0..rows).map(|row| row * columns + column);
            let weight: f32 = of.clone().map(|v| self.weights[v]).sum();
            of.map(|v| values[v] * self.weights[v]).sum::<Vec3>() / weight
        };
        let means: Vec<Vec3> = (0..columns).map(mean).collect();
        (0..rows * columns).map(|v| means[v % columns]).collect()
    }

    /// Sag and reach (m) of the tip relative to the clamp, averaged over the rows.
    fn tip(&self, positions: &[Vec3]) -> (f64, f64) {
        let tips = positions.iter().skip(self.columns as usize - 1).step_by(self.columns as usize);
        let tip = tips.map(|x| x.as_dvec3()).sum::<DVec3>() / f64::from(self.rows);
        (-tip.y, tip.x - (0.5 - self.length))
    }
}

/// The tip of a cantilever sags by `rho g L⁴/8B`, where L includes half a cell more than the free length as the clamp's
/// correction.
#[test]
fn a_stiff_cantilever_sags_as_beam_theory_says() {
    // At 5 substeps, a single pass would leave only a hundredth of the rigidity.
    for (columns, rows, substeps, constrained) in
        [(17, 5, 40, true), (33, 2, 60, false), (17, 5, 20, true), (17, 5, 10, true), (17, 5, 5, true)]
    {
        let heaviness = 200.0;
        let strip = Strip::new(columns, rows, heaviness, substeps);
        // A hundredth of its length, so that the error of beam theory itself is 1e-4.
        let gravity = 0.08 * strip.bending / (DENSITY * strip.length.powi(3));
        let free = strip.length - 0.5 / f64::from(columns - 1);
        let exact = DENSITY * gravity * free.powi(4) / (8.0 * strip.bending) * (strip.length / free).powi(4);
        let (sag, _) = if constrained { strip.settle_as_cylinder(gravity, 24.0) } else { strip.settle(gravity, 14.0) };
        println!("{columns} x {rows}: sag {sag:.6} m, expected {exact:.6} m ({:+.3} %)", 100.0 * (sag / exact - 1.0));
        assert!((sag / exact - 1.0).abs() < 0.005, "{columns} x {rows}: sag {sag} m, expected {exact} m");
    }
}

/// Constrained to a cylinder: sag over reach of the heavy elastica, for B over four decades.
#[test]
fn a_heavy_elastica_as_a_cylinder() {
    let table = [
        (0.1, 0.0125, 17, 250, 18.0),
        (1.0, 0.124_562, 17, 100, 18.0),
        (10.0, 1.066_802, 33, 120, 20.0),
        (100.0, 5.888_105, 33, 80, 24.0),
        (100.0, 5.888_105, 33, 20, 24.0),
        (1000.0, 21.3354, 65, 80, 24.0),
    ];
    for (heaviness, expected, columns, substeps, periods) in table {
        let (sag, reach) = Strip::new(columns, 5, heaviness, substeps).settle_as_cylinder(9.81, periods);
        let ratio = sag / reach;
        println!("G = {heaviness}: H/W = {ratio:.5}, expected {expected} ({:+.2} %)", 100.0 * (ratio / expected - 1.0));
        assert!((ratio / expected - 1.0).abs() < 0.02, "G = {heaviness}: H/W = {ratio}, expected {expected}");
    }
}

/// Free strips, wide enough and curved enough that their inextensibility keeps them cylindrical.
#[test]
fn a_heavy_elastica_as_a_free_strip() {
    for (heaviness, expected, columns, substeps) in
        [(10.0, 1.066_802, 17, 150), (100.0, 5.888_105, 33, 120), (1000.0, 21.3354, 49, 100)]
    {
        let (sag, reach) = Strip::new(columns, 17, heaviness, substeps).settle(9.81, 16.0);
        let ratio = sag / reach;
        println!("G = {heaviness}: H/W = {ratio:.5}, expected {expected} ({:+.2} %)", 100.0 * (ratio / expected - 1.0));
        assert!((ratio / expected - 1.0).abs() < 0.05, "G = {heaviness}: H/W = {ratio}, expected {expected}");
    }
}

/// Levels that are asked for do not change cloth that only bends, at both ends of the four decades; each of these
/// strips has levels.
#[test]
fn an_elastica_with_levels() {
    for (heaviness, expected, columns, substeps) in [(100.0, 5.888_105, 33, 120), (1000.0, 21.3354, 49, 100)] {
        let mut strip = Strip::new(columns, 17, heaviness, substeps);
        let mut ratio = |levels| {
            strip.options.levels = levels;
            let (sag, reach) = strip.settle(9.81, 16.0);
            sag / reach
        };
        let (plain, levels) = (ratio(Levels::Off), ratio(Levels::Count(9)));
        println!("G = {heaviness}: H/W = {levels:.5} with levels, {plain:.5} without, expected {expected}");
        assert!((levels / expected - 1.0).abs() < 0.05, "G = {heaviness}: H/W = {levels}, expected {expected}");
        assert!((levels / plain - 1.0).abs() < 0.02, "G = {heaviness}: H/W = {levels} with levels, {plain} without");
    }
    let mut strip = Strip::new(33, 5, 200.0, 60);
    let gravity = 0.08 * strip.bending / (DENSITY * strip.length.powi(3));
    let mut sag = |levels| {
        strip.options.levels = levels;
        strip.settle_as_cylinder(gravity, 14.0).0
    };
    let (plain, levels) = (sag(Levels::Off), sag(Levels::Count(9)));
    println!("cantilever: sag {levels:.6} m with levels, {plain:.6} m without");
    assert!((levels / plain - 1.0).abs() < 1e-3, "cantilever: sag {levels} m with levels, {plain} m without");
}

/// A cantilever released in its first mode vibrates at `1.8751² sqrt(B/(rho L⁴))`.
#[test]
fn a_cantilever_vibrates_in_its_first_mode() {
    let strip = Strip::new(33, 2, 200.0, 60);
    let exact = 3.5160 / std::f64::consts::TAU * (strip.bending / (DENSITY * strip.length.powi(4))).sqrt();
    let shape = |x: f64| {
        let beta = 1.875_104 * x;
        beta.cosh() - beta.cos() - 0.734_096 * (beta.sinh() - beta.sin())
    };
    let mut positions = strip.mesh.positions.clone();
    for x in &mut positions {
        let along = (f64::from(x.x) - (0.5 - strip.length)) / strip.length;
        x.y = if along < 0.02 { 0.0 } else { 0.005 * shape(along) as f32 };
    }
    let mut cloth = Deformer::new(&strip.mesh, strip.options.clone()).unwrap();
    cloth.set_state(&positions, &vec![Vec3::ZERO; positions.len()]).unwrap();
    let attributes = Attributes { gravity: Vec3::ZERO, ..Attributes::default() };
    let (mut last, mut upward) = (1.0, Vec::new());
    for frame in 0..(60.0 * 4.0 / exact) as u32 {
        cloth.step(FRAME, &attributes).unwrap();
        let y = -strip.tip(cloth.positions().unwrap()).0;
        if last <= 0.0 && y > 0.0 {
            upward.push(f64::from(frame) + last / (last - y));
        }
        last = y;
    }
    let frequency = 60.0 * (upward.len() - 1) as f64 / (upward[upward.len() - 1] - upward[0]);
    println!("f1 = {frequency:.5} Hz, expected {exact:.5} Hz ({:+.2} %)", 100.0 * (frequency / exact - 1.0));
    assert!((frequency / exact - 1.0).abs() < 0.02, "f1 = {frequency} Hz, expected {exact} Hz");
}

/// Without rigidity there is no bending term: for any damping the motion is bit for bit that of the edges alone.
fn without_rigidity_nothing_is_added(backend: Backend) {
    let mut states = [0.0, 0.03].map(|damping| {
        let (mesh, mut options) = common::hang(9, 20, backend);
        options.fabric.damping = damping;
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        common::play(&mut cloth, 10, &Attributes::default());
        cloth
    });
    let [a, b] = &mut states;
    assert_eq!(a.positions().unwrap(), b.positions().unwrap());
    assert_eq!(a.velocities().unwrap(), b.velocities().unwrap());
}

on_every_backend!(the_force_is_the_energys_gradient, without_rigidity_nothing_is_added);

/// A factor on the rigidity of each vertex is the same as a fabric of that rigidity, to the last bit if all are alike. Two strips in one mesh,
/// one of them four times as stiff, bend as each does alone, but for the order of their edges.
#[test]
fn a_scale_on_bending_is_a_fabric_of_its_own() {
    let strip = Mesh::grid(21, 4, 0.2, 0.03);
    let clamped = |first: u32| (0..84).filter(|v| v % 21 < 2).map(move |v| v + first).collect::<Vec<u32>>();
    let played = |mesh: &Mesh, bending: f64, scale: Option<Vec<f32>>| {
        let fabric = Fabric { damping: 0.05, stretch: 5000.0, ..bending_only(bending) };
        let pinned = (0..mesh.positions.len() as u32 / 84).flat_map(|strip| clamped(84 * strip)).collect();
        let quality = Quality::Substeps(40);
        let options = Options {
            backend: Backend::Cpu,
            levels: Levels::Off,
            fabric,
            pinned,
            quality,
            bending_scale: scale,
            ..Options::default()
        };
        let mut cloth = Deformer::new(mesh, options).unwrap();
        (0..30).for_each(|_| drop(cloth.step(FRAME, &Attributes { damping: 2.0, ..Attributes::default() }).unwrap()));
        (cloth.positions().unwrap().to_vec(), cloth.measure().unwrap().potential_energy)
    };
    let (soft, stiff) = (played(&strip, 1e-3, None), played(&strip, 4e-3, None));
    assert_eq!(played(&strip, 1e-3, Some(vec![4.0; 84])), stiff, "a factor of 4 everywhere");
    let sag = |x: &[Vec3]| -x[20].y;
    assert!(sag(&soft.0) > 1.5 * sag(&stiff.0), "the softer sags more: {} m, {} m", sag(&soft.0), sag(&stiff.0));

    let mut both = strip.clone();
    both.positions.extend(strip.positions.iter().map(|&x| x + Vec3::Z * 0.5));
    both.triangles.extend(strip.triangles.iter().map(|t| t.map(|v| v + 84)));
    let scale: Vec<f32> = (0..168).map(|v| if v < 84 { 0.25 } else { 1.0 }).collect();
    let (x, _) = played(&both, 4e-3, Some(scale));
    for (name, x, alone, offset) in [("soft", &x[..84], &soft.0, 0.0), ("stiff", &x[84..], &stiff.0, 0.5)] {
        let off = x.iter().zip(alone).map(|(a, b)| (*a - offset * Vec3::Z).distance(*b)).fold(0.0, f32::max);
        assert!(off < 1e-3, "the {name} strip is {off} m from where it is alone, and sags {} m", sag(alone));
    }
}

/// Stiff cards swing down from a clamp. More substeps at one moment than at another must not stiffen them while they are bent: they
/// got higher than they had been, by 2.6 and 4.8 J/kg, and were given 363 and 1623 substeps.
#[test]
fn cards_gain_no_energy_from_the_choice_of_substeps() {
    let cards = [([61, 61], [0.3, 0.3], 0.25, 0.03), ([81, 41], [0.3, 0.15], 0.3, 0.05)];
    for ([columns, rows], [width, depth], density, bending) in cards {
        let mesh = Mesh::grid(columns, rows, width, depth);
        let fabric = Fabric { density, stretch: 20_000.0, bending, damping: 0.05 };
        let clamp = (1.02 / (columns - 1) as f32 - 0.5) * width;
        let pinned = (0..columns * rows).filter(|&vertex| mesh.positions[vertex as usize].x < clamp).collect();
        let mut card = Deformer::new(&mesh, Options { backend: Backend::Cpu, fabric, pinned, ..Options::default() }).unwrap();
        let attributes = Attributes { air_density: 0.0, ..Attributes::default() };
        let (mut highest, mut substeps) = (f32::MIN, Vec::new());
        for _ in 0..60 {
            substeps.push(card.step(FRAME, &attributes).unwrap().substeps);
            let (x, v) = (card.positions().unwrap().to_vec(), card.velocities().unwrap().to_vec());
            let energy = x.iter().zip(&v).map(|(x, v)| 0.5 * v.length_squared() + 9.81 * x.y).sum::<f32>() / x.len() as f32;
            highest = highest.max(energy);
        }
        let most = substeps.iter().max().unwrap();
        println!("{columns} x {rows}: {highest:.3} J/kg above the start, {} to {most} substeps", substeps[0]);
        assert!(highest < 0.03 && *most < 250, "{highest} J/kg above the start, {substeps:?}");
        assert!(*most > 2 * substeps[0], "the number of substeps hardly varies: {substeps:?}");
    }
}
