pub(crate) const MAX_VERTICES: usize = 1 << 24;
