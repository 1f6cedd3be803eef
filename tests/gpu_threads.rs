//! Cloths on one GPU that threads of the caller step at the same time.
#![cfg(feature = "gpu")]

mod common;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Contact, Deformer, Gpu, Mesh, Options, wgpu};
use common::{FRAME, device};

/// The cloth number `k`, stepped with the default quality, which reads statistics of every step. Returns where it is then.
fn played(k: u32, frames: u32) -> Vec<Vec3> {
    let contact = (k % 2 == 1).then(|| Contact { thickness: 0.01, ..Contact::default() });
    let options = Options { backend: Backend::Gpu, pinned: vec![0], contact, ..Options::default() };
    let mut cloth = Deformer::new(&Mesh::grid(5 + k / 2, 5, 1.0, 1.0), options).unwrap();
    for frame in 0..frames {
        cloth.step(FRAME, &Attributes::default()).unwrap_or_else(|error| panic!("cloth {k}, frame {frame}: {error}"));
    }
    cloth.positions().unwrap().to_vec()
}

/// A thread that waits for the device receives what others asked for, too. None takes that for a failure, and each cloth moves as it
/// does alone.
#[test]
fn threads_share_a_device() {
    let alone: Vec<_> = (0..6).map(|k| played(k, 150)).collect();
    let together: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..6).map(|k| scope.spawn(move || played(k, 150))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert!(together == alone);
}

/// Maps a buffer again and again, and takes its time in the callback. What the device has completed by then is told to others only
/// after that.
fn dawdle(gpu: &Gpu, is_over: &AtomicBool) {
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let descriptor = wgpu::BufferDescriptor { label: None, size: 4, usage, mapped_at_creation: false };
    while !is_over.load(Ordering::Relaxed) {
        let buffer = gpu.device().create_buffer(&descriptor);
        buffer.map_async(wgpu::MapMode::Read, .., |_| std::thread::sleep(Duration::from_millis(5)));
        gpu.device().poll(wgpu::PollType::Poll).unwrap();
    }
}

/// A slow callback of the caller delays a step, but does not make it fail.
#[test]
fn callbacks_of_the_caller_may_be_slow() {
    let gpu = device("the test's", |_| ());
    let over = AtomicBool::new(false);
    let step = |backend| {
        let contact = Some(Contact { thickness: 0.01, ..Contact::default() });
        let options = Options { backend, gpu: Some(gpu.clone()), pinned: vec![0], contact, ..Options::default() };
        let mut cloth = Deformer::new(&Mesh::grid(5, 5, 1.0, 1.0), options).unwrap();
        (0..200).find_map(|_| cloth.step(FRAME, &Attributes::default()).err())
    };
    std::thread::scope(|scope| {
        (0..2).for_each(|_| _ = scope.spawn(|| dawdle(&gpu, &over)));
        let stepped = scope.spawn(|| [Backend::Gpu, Backend::Hybrid].map(step)).join();
        over.store(true, Ordering::Relaxed);
        assert_eq!(stepped.unwrap(), [None, None]);
    });
}
