//! The reference solution: explicit leapfrog springs in double precision. It shares no code with the solver, not even
//! the list of edges.

use cloth_deformer::Mesh;
use cloth_deformer::glam::{DVec3, Vec3};

/// An edge as a spring: its two vertices, rest length (m) and stiffness (N/m).
pub type Spring = (usize, usize, f64, f64);

/// The springs of a mesh. Their stiffness is `K (A1 + A2) / l²` along edges, and K along a thread (an edge without
/// area).
pub fn springs(mesh: &Mesh, stretch: f64) -> Vec<Spring> {
    let x: Vec<DVec3> = mesh.positions.iter().map(|x| x.as_dvec3()).collect();
    let mut areas = std::collections::BTreeMap::new();
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| v as usize);
        let area = (x[b] - x[a]).cross(x[c] - x[a]).length() / 2.0;
        for (i, j) in [(a, b), (b, c), (c, a)].into_iter().filter(|(i, j)| i != j) {
            *areas.entry((i.min(j), i.max(j))).or_insert(0.0) += area;
        }
    }
    let spring = |(&(i, j), &area): (&(usize, usize), &f64)| {
        let rest = x[i].distance(x[j]);
        (i, j, rest, if area > 0.0 { stretch * area / (rest * rest) } else { stretch })
    };
    areas.iter().map(spring).collect()
}

/// A mass-spring cloth in double precision.
pub struct Reference {
    pub x: Vec<DVec3>,
    pub v: Vec<DVec3>,
    inverse_mass: Vec<f64>,
    springs: Vec<Spring>,
    gravity: DVec3,
}

impl Reference {
    /// Springs of stiffness `K (A1 + A2) / l²` (N/m) along the mesh's edges, masses (kg), and pinned vertices, which do
    /// not move.
    pub fn new(mesh: &Mesh, masses: &[f32], pinned: &[u32], stretch: f64) -> Reference {
        let x: Vec<DVec3> = mesh.positions.iter().map(|x| x.as_dvec3()).collect();
        let springs = springs(mesh, stretch);
        let mut inverse_mass: Vec<f64> = masses.iter().map(|&m| 1.0 / f64::from(m)).collect();
        for &v in pinned {
            inverse_mass[v as usize] = 0.0;
        }
        Reference { v: vec![DVec3::ZERO; x.len()], x, inverse_mass, springs, gravity: DVec3::new(0.0, -9.81, 0.0) }
    }

    fn acceleration(&self) -> Vec<DVec3> {
        let mut force = vec![DVec3::ZERO; self.x.len()];
        for &(i, j, rest, stiffness) in &self.springs {
            let d = self.x[j] - self.x[i];
            let length = d.length();
            let pull = d * (stiffness * (length - rest) / length);
            force[i] += pull;
            force[j] -= pull;
        }
        let accelerate = |(f, &w): (&DVec3, &f64)| if w > 0.0 { *f * w + self.gravity } else { DVec3::ZERO };
        force.iter().zip(&self.inverse_mass).map(accelerate).collect()
    }

    /// Integrates over `time` (s) in `steps` steps of kick, drift, kick.
    pub fn run(mut self, time: f64, steps: u32) -> Reference {
        let dt = time / f64::from(steps);
        let mut a = self.acceleration();
        for _ in 0..steps {
            for ((x, v), a) in self.x.iter_mut().zip(&mut self.v).zip(&a) {
                *v += *a * (0.5 * dt);
                *x += *v * dt;
            }
            a = self.acceleration();
            self.v.iter_mut().zip(&a).for_each(|(v, a)| *v += *a * (0.5 * dt));
        }
        self
    }

    /// Positions rounded to single precision.
    pub fn positions(&self) -> Vec<Vec3> {
        self.x.iter().map(|x| x.as_vec3()).collect()
    }
}
