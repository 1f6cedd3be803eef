//! A cape on a body that walks: stepped on Bevy's device, drawn by Bevy, with no copy through the CPU.
//!
//! ```text
//! cargo run                                              # a window: space pauses, T teleports
//! cargo run --no-default-features -- --check FOLDER      # tries it without a window, and leaves pictures
//! ```

use std::path::PathBuf;
use std::process::ExitCode;

use bevy::prelude::*;

mod body;
mod cape;
mod check;
mod cloth;
mod scene;
mod walk;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    match (arguments.next(), arguments.next()) {
        (None, _) if cfg!(feature = "window") => {
            let mut app = App::new();
            app.add_plugins((DefaultPlugins, cloth::ClothPlugin, walk::WalkPlugin, scene::ScenePlugin));
            match app.run() {
                AppExit::Success => ExitCode::SUCCESS,
                AppExit::Error(code) => ExitCode::from(code.get()),
            }
        }
        (Some(flag), Some(folder)) if flag == "--check" => check::check(&PathBuf::from(folder)),
        _ => {
            eprintln!("usage: cloth-deformer-bevy [--check FOLDER]; without a window there is only --check");
            ExitCode::from(2)
        }
    }
}
