mod common;
use cloth_deformer::*;
use common::*;
#[test]
fn gates() {
    for (n, s) in [(32u32, 80u32), (64, 160), (128, 320)] {
        let (mesh, options) = hang(n, s, Backend::Cpu);
        let masses = options.mass.clone().unwrap();
        let run = |steps| reference::Reference::new(&mesh, &masses, &options.pinned, 5000.0).run(0.5, steps).positions();
        let a = run(30 * s * 2);
        let b = if n < 128 { run(30 * s * 4) } else { a.clone() };
        println!("n {n} reference halving {:e}", rms(&a, &b));
        for s in [s / 4, s / 2, s, 2 * s] {
            let options = Options { quality: Quality::Substeps(s), ..options.clone() };
            let mut d = Deformer::new(&mesh, options).unwrap();
            let t = std::time::Instant::now();
            play(&mut d, 30, &Attributes::default());
            let ms = t.elapsed().as_secs_f64() * 1e3 / 30.0;
            println!(
                "n {n} S {s} colours {} err {:e} ms/frame {ms:.3} {:?}",
                d.colours(),
                rms(d.positions().unwrap(), &b),
                d.measure().unwrap()
            );
        }
    }
    for f in ["square2K", "skirt4K", "tableCloth", "ribbon1.6K"] {
        let text = std::fs::read_to_string(format!("../shared/meshes/{f}.obj")).unwrap();
        let mut m = Mesh::default();
        for l in text.lines() {
            let w: Vec<&str> = l.split_whitespace().collect();
            if w.first() == Some(&"v") {
                m.positions.push(glam::Vec3::new(w[1].parse().unwrap(), w[2].parse().unwrap(), w[3].parse().unwrap()));
            }
            if w.first() == Some(&"f") {
                m.triangles.push([1, 2, 3].map(|k| w[k].split('/').next().unwrap().parse::<u32>().unwrap() - 1));
            }
        }
        let mut deg = vec![0; m.positions.len()];
        for e in m.edges() {
            deg[e[0] as usize] += 1;
            deg[e[1] as usize] += 1;
        }
        let mut d = Deformer::new(&m, Options { backend: Backend::Cpu, pinned: vec![0, 10, 20], ..Default::default() }).unwrap();
        let t = std::time::Instant::now();
        let r = d.step(FRAME, &Attributes::default()).unwrap();
        println!(
            "{f} max degree {} colours {} substeps {} ms {:?}",
            deg.iter().max().unwrap(),
            d.colours(),
            r.substeps,
            t.elapsed()
        );
        play(&mut d, 40, &Attributes::default());
        println!("{:?}", d.measure());
    }
}
