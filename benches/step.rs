//! A frame of HANG: size x backend x method. Error belongs to every figure: `--example chart` shows both.

use cloth_deformer::{Attributes, Backend, Deformer, Mesh, Method, Options, Quality};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

fn step(criterion: &mut Criterion) {
    let methods = [
        ("small-steps", Method::SmallSteps, 20),
        ("relaxation", Method::Relaxation { iterations: 20 }, 1),
        ("springs", Method::Springs, 200),
    ];
    for (name, method, substeps) in methods {
        let mut group = criterion.benchmark_group(name);
        for n in [32_u32, 64, 128] {
            group.throughput(Throughput::Elements(u64::from(n * n) * u64::from(substeps)));
            for backend in [Backend::Cpu, Backend::Hybrid, Backend::Gpu] {
                let options = Options {
                    backend,
                    method,
                    quality: Quality::Substeps(substeps),
                    pinned: (0..n).collect(),
                    ..Options::default()
                };
                // A machine without a GPU still has a CPU to time.
                let Ok(mut deformer) = Deformer::new(&Mesh::grid(n, n, 1.0, 1.0), options) else { continue };
                let attributes = Attributes::default();
                group.bench_function(BenchmarkId::new(format!("{backend:?}"), n), |bencher| {
                    bencher.iter(|| {
                        deformer.step(1.0 / 60.0, &attributes).expect("the sheet hangs");
                        deformer.wait().expect("the device is there");
                    });
                });
            }
        }
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(std::time::Duration::from_millis(300)).measurement_time(std::time::Duration::from_secs(1));
    targets = step
}
criterion_main!(benches);
