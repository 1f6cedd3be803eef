//! What can go wrong on a device, whatever was asked of it.

/// Why the GPU did not do what it was asked.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum GpuFault {
    /// The device is gone, and with it all that was on it.
    Lost,
    /// Its memory is full.
    Memory(String),
    /// It does not take so much.
    Limit(Excess),
    Other(String),
}

/// Something that is more than a device takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Excess {
    /// What.
    pub thing: &'static str,
    /// How much that is, in bytes or in number.
    pub needed: u64,
    /// The device's limit, by its name in `wgpu::Limits`, and what it is.
    pub limit: &'static str,
    pub allowed: u64,
}

impl From<String> for GpuFault {
    fn from(reason: String) -> GpuFault {
        GpuFault::Other(reason)
    }
}

impl From<&str> for GpuFault {
    fn from(reason: &str) -> GpuFault {
        GpuFault::Other(reason.to_owned())
    }
}

impl From<wgpu::Error> for GpuFault {
    fn from(error: wgpu::Error) -> GpuFault {
        let is_memory = matches!(error, wgpu::Error::OutOfMemory { .. });
        let reason = error.to_string().replace('\n', " ");
        if is_memory { GpuFault::Memory(reason) } else { GpuFault::Other(reason) }
    }
}

#[cfg(test)]
#[path = "../tests/unit/gpu_fault.rs"]
mod tests;
