//! Errors of the device, which wgpu reports to scopes and callbacks, as results.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::device::fault::{GpuFault, Need, scoped};
use crate::device::pipelines::{PENDING, Pipeline};
use crate::device::{Gpu, IN_BROWSER};

thread_local! {
    /// What [`Gpu::make`] refused since [`Gpu::checked`] began. It is thread-local, as wgpu's error scopes are.
    static REFUSED: Cell<Option<Need>> = const { Cell::new(None) };
}

impl Gpu {
    /// Runs `work` and returns as an error what would otherwise be an uncaptured error of the device (validation,
    /// memory), what [`Gpu::make`] refused, and failures due to a lost device, which wgpu does not report itself. In a
    /// browser, device errors appear in its console instead.
    pub(crate) fn checked<T>(&self, work: impl FnOnce() -> Result<T, GpuFault>) -> Result<T, GpuFault> {
        // A thread that waits for others in the work of one cloth may meanwhile be given that of another. A refusal stays
        // known within, because what was refused must not be used.
        let outer = (REFUSED.get(), PENDING.take());
        let (result, fault) = scoped(self.device(), work);
        let cause = self.cause(fault, result.as_ref().err());
        REFUSED.set(outer.0);
        PENDING.set(outer.1);
        match cause {
            None => result,
            Some(cause) => Err(cause),
        }
    }

    /// Why work failed that the device and the work itself say this about. Waits for the pipelines that it asked for.
    fn cause(&self, fault: Option<GpuFault>, told: Option<&GpuFault>) -> Option<GpuFault> {
        let not_compiled = Pipeline::finish_all();
        // The first cause matters: whatever was refused or did not fit causes the errors after it.
        let refused = REFUSED.take().map(GpuFault::Limit);
        let cause = refused.or(not_compiled).or(fault).or_else(|| told.cloned())?;
        let is_sure = matches!(cause, GpuFault::Limit(_) | GpuFault::Memory(_));
        Some(if !is_sure && self.is_lost() { GpuFault::Lost } else { cause })
    }

    /// Makes [`Gpu::checked`] fail for this need, unless for an earlier one.
    pub(super) fn refuse(need: Need) {
        REFUSED.set(Some(REFUSED.get().unwrap_or(need)));
    }

    /// Fails if [`Gpu::make`] refused a buffer since [`Gpu::checked`] began, because work that uses it must not run.
    pub(crate) fn refused() -> Result<(), GpuFault> {
        REFUSED.get().map_or(Ok(()), |need| Err(GpuFault::Limit(need)))
    }

    /// Whether the device is lost. wgpu reports this to a callback, but a device has only one, which belongs to its
    /// owner. A lost device also fails to map a buffer, and does so at once, so this maps a small one.
    pub(crate) fn is_lost(&self) -> bool {
        if IN_BROWSER {
            return false;
        }
        let scope = self.device().push_error_scope(wgpu::ErrorFilter::Validation);
        let refused = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&refused);
        let probe = self.staging("probe", 4);
        probe.map_async(wgpu::MapMode::Read, .., move |mapped| told.store(mapped.is_err(), Ordering::Relaxed));
        let is_lost = refused.load(Ordering::Relaxed);
        drop(pollster::block_on(scope.pop()));
        is_lost
    }

    /// The error for something that could not be mapped.
    pub(crate) fn unmapped(&self, thing: &str) -> GpuFault {
        if self.is_lost() || IN_BROWSER { GpuFault::Lost } else { GpuFault::Other(format!("{thing} could not be mapped")) }
    }
}
