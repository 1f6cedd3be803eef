//! Builds the page into `dist`, a static folder: `cargo run --release --manifest-path examples/web/build/Cargo.toml`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use wasm_bindgen_cli_support::Bindgen;

const TARGET: &str = "wasm32-unknown-unknown";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).parent().ok_or("this package has a folder above it")?;
    let compiled = web.join("target");
    let flags = flags(web)?;
    let built = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["build", "--profile", "page", "--lib", "--locked", "--target", TARGET, "--manifest-path"])
        .arg(web.join("Cargo.toml"))
        .arg("--target-dir")
        .arg(&compiled)
        .env("CARGO_ENCODED_RUSTFLAGS", flags)
        .status()?;
    if !built.success() {
        return Err(format!("the page's code could not be built; is the target installed? rustup target add {TARGET}").into());
    }
    let dist = web.join("dist");
    fs::create_dir_all(&dist)?;
    let module = compiled.join(TARGET).join("page/cloth_deformer_page.wasm");
    Bindgen::new()
        .input_path(module)
        .web(true)?
        .omit_default_module_path(false)
        .typescript(false)
        .remove_name_section(true)
        .remove_producers_section(true)
        .out_name("cloth")
        .generate(&dist)?;
    for file in fs::read_dir(web.join("page"))? {
        let file = file?;
        fs::copy(file.path(), dist.join(file.file_name()))?;
    }
    println!("{}: serve this folder, for example with python3 -m http.server -d {0}", dist.display());
    Ok(())
}

/// The compiler's flags. Messages of panics name source files, so without the folders of this machine the module is smaller, and the
/// same wherever it is built.
fn flags(web: &Path) -> Result<String, Box<dyn std::error::Error>> {
    let crates = match env::var_os("CARGO_HOME") {
        Some(home) => PathBuf::from(home),
        None => env::home_dir().ok_or("this user has no home folder")?.join(".cargo"),
    };
    let repository = web.canonicalize()?.join("../..").canonicalize()?;
    let mut flags: Vec<String> = env::var("RUSTFLAGS").unwrap_or_default().split_whitespace().map(String::from).collect();
    flags.extend(["-C".into(), "target-feature=+simd128".into()]);
    flags.extend(
        [(crates, "crates"), (repository, "cloth")].map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display())),
    );
    Ok(flags.join("\x1f"))
}
