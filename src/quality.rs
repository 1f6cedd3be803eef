pub(crate) const MAX_SUBSTEPS: u32 = 1 << 16;
