//! Failures of a GPU device.

use crate::device::IN_BROWSER;

/// Why the GPU did not do what it was asked.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum GpuFault {
    /// The device is lost, and with it everything stored on it.
    Lost,
    /// The device is out of memory.
    Memory(String),
    /// The work exceeds a limit of the device.
    Limit(Need),
    Other(String),
}

/// What is needed of something that a device limits: in a [`GpuFault`], more than that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Need {
    pub thing: &'static str,
    /// The amount needed: bytes, or a count.
    pub needed: u64,
    /// The field of `wgpu::Limits`, and the device's value of it.
    pub limit: &'static str,
    pub allowed: u64,
}

impl GpuFault {
    pub(crate) fn other(error: impl std::fmt::Display) -> GpuFault {
        GpuFault::Other(error.to_string())
    }

    /// In words.
    pub(crate) fn reason(&self) -> String {
        match self {
            GpuFault::Lost => "it was lost".to_owned(),
            GpuFault::Memory(reason) | GpuFault::Other(reason) => reason.clone(),
            GpuFault::Limit(Need { thing, needed, limit, allowed }) => format!("{thing} need {needed}, {limit} is {allowed}"),
        }
    }
}

impl From<wgpu::Error> for GpuFault {
    fn from(error: wgpu::Error) -> GpuFault {
        let is_memory = matches!(error, wgpu::Error::OutOfMemory { .. });
        let reason = error.to_string().replace('\n', " ");
        if is_memory { GpuFault::Memory(reason) } else { GpuFault::Other(reason) }
    }
}

/// Runs `work`, and returns with its result the error of the device that it caused on this thread, from wgpu's error scopes.
pub(super) fn scoped<T>(device: &wgpu::Device, work: impl FnOnce() -> T) -> (T, Option<GpuFault>) {
    let filters = [wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Internal];
    let scopes = (!IN_BROWSER).then(|| filters.map(|filter| device.push_error_scope(filter)));
    let result = work();
    let errors = scopes.map_or([None, None, None], |[validation, memory, internal]| {
        [pollster::block_on(internal.pop()), pollster::block_on(memory.pop()), pollster::block_on(validation.pop())]
    });
    (result, errors.into_iter().flatten().next().map(GpuFault::from))
}

#[cfg(test)]
#[path = "../../tests/unit/device_fault.rs"]
mod tests;
