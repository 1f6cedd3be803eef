//! The main binary, where `cargo test` puts it.

use std::{env, path::PathBuf};

/// `cargo test` builds the examples, but gives their path to no one: they are in `examples`, beside `deps`, where tests are.
pub fn drape() -> PathBuf {
    let test = env::current_exe().unwrap();
    let profile = test.ancestors().nth(2).unwrap();
    let path = profile.join("examples").join(format!("drape{}", env::consts::EXE_SUFFIX));
    assert!(path.is_file(), "{} is missing: `cargo test` builds it, `cargo build --example drape` too", path.display());
    path
}
