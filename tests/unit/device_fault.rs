//! Unit tests of `src/device/fault.rs`, for faults that no software driver can be made to report.

use super::*;
use crate::device::Gpu;

/// Running out of memory is told from a refusal by the error's kind, not by its text.
#[test]
fn a_full_memory_is_named() {
    let full = wgpu::Error::OutOfMemory { source: "not enough\nroom".into() };
    let GpuFault::Memory(reason) = GpuFault::from(full) else { panic!("it is full") };
    assert!(!reason.contains('\n'), "one line: {reason}");
    let source = "out of memory".into();
    let refused = wgpu::Error::Validation { source, description: "out of memory".to_owned() };
    assert!(matches!(GpuFault::from(refused), GpuFault::Other(_)));
}

/// If the device reports an error as a consequence of a refusal, the refusal is returned, but not one of another
/// thread, nor one that was returned before.
#[test]
fn a_refusal_is_told_once_where_it_was_met() {
    let gpu = Gpu::shared(true).unwrap();
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
    let too_much = gpu.most_table_bytes() as u64 + 4;
    let met = gpu.checked(|| {
        let elsewhere = std::thread::scope(|scope| scope.spawn(|| gpu.checked(|| Ok(()))).join().unwrap());
        assert_eq!(elsewhere, Ok(()));
        let buffer = gpu.make("a table", too_much, usage);
        gpu.write(&buffer, 0, &[0_u32; 64]);
        let elsewhere = std::thread::scope(|scope| scope.spawn(|| gpu.checked(Gpu::refused)).join().unwrap());
        assert_eq!(elsewhere, Ok(()));
        Ok(())
    });
    let Err(GpuFault::Limit(Need { thing: "a table", needed, allowed, .. })) = met else { panic!("{met:?}") };
    assert_eq!((needed, allowed), (too_much.next_multiple_of(4), too_much - 4));
    assert_eq!(gpu.checked(|| Ok(())), Ok(()));
    // Nothing reads from the substitute, and what is checked within something else that is checked forgets no refusal.
    let most = gpu.device().limits().max_buffer_size;
    let met = gpu.checked(|| {
        let staging = gpu.staging("too much", most + 4);
        gpu.mapped(&staging, |_| panic!("it does not have the bytes"))
    });
    let met: Result<(), GpuFault> = met;
    assert!(matches!(met, Err(GpuFault::Limit(Need { thing: "too much", .. }))), "{met:?}");
    assert_eq!(gpu.checked(|| Ok(())), Ok(()));
}
