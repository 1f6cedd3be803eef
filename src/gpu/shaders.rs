//! The source of each shader: the functions that it uses, from `shaders/`, then its entry points, from `shaders/stages/`.

use crate::device::Shader;

/// A file of `shaders/`. A web page downloads it, so there it has neither comments nor indentation, nor in the unit tests,
/// which parse it.
macro_rules! wgsl {
    ($($path:literal),+) => {{
        const TEXT: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $($path),+));
        #[cfg(not(any(test, target_arch = "wasm32")))]
        const SOURCE: &str = TEXT;
        #[cfg(any(test, target_arch = "wasm32"))]
        const SOURCE: &str = {
            const CODE: [u8; compressed(TEXT, &mut [])] = {
                let mut code = [0; _];
                compressed(TEXT, &mut code);
                code
            };
            match str::from_utf8(&CODE) {
                Ok(code) => code,
                Err(_) => panic!("comments begin and end between characters"),
            }
        };
        SOURCE
    }};
}

/// Writes a text without its comments and indentation, as far as there is room, and returns its length. Lines keep their
/// numbers.
#[cfg(any(test, target_arch = "wasm32"))]
const fn compressed(text: &str, code: &mut [u8]) -> usize {
    let text = text.as_bytes();
    let (mut from, mut to, mut comment, mut indentation) = (0, 0, false, true);
    while from < text.len() {
        let slashes = text[from] == b'/' && from + 1 < text.len() && text[from + 1] == b'/';
        comment = (comment || slashes) && text[from] != b'\n';
        indentation = text[from] == b'\n' || (indentation && text[from] == b' ');
        if !comment && (!indentation || text[from] == b'\n') {
            if to < code.len() {
                code[to] = text[from];
            }
            to += 1;
        }
        from += 1;
    }
    to
}

/// Shaders by groups: the folder of their files, and the files that all of the group begin with.
macro_rules! shaders {
    ($($folder:literal after $shared:tt { $($name:ident: $($file:literal)+;)+ })+) => {
        $($(pub(crate) const $name: Shader = shader!($name, $shared, $($folder, $file;)+);)+)+

        /// All shaders.
        #[cfg(test)]
        pub(crate) const ALL: &[Shader] = &[$($($name),+),+];
    };
}

macro_rules! shader {
    ($name:ident, ($($shared:literal)*), $($folder:literal, $file:literal;)+) => {
        Shader {
            name: stringify!($name),
            source: &[
                wgsl!("params.wgsl"),
                wgsl!("stages/dispatch.wgsl"),
                $(wgsl!($shared, ".wgsl"),)*
                $(wgsl!($folder, $file, ".wgsl")),+
            ],
        }
    };
}

shaders! {
    "" after () {
        PREDICT: "integrate" "stages/predict";
        BEND: "integrate" "bending" "stages/predict" "stages/bend_ring" "stages/bend_in_workgroup" "stages/bend";
        BEND_TILE: "average" "integrate" "bending" "stages/predict" "stages/bend_ring" "stages/bend_in_workgroup"
            "stages/bend_vectors" "stages/bend_tile";
        WIND: "wind" "stages/wind";
        SPRINGS: "distance" "spring" "stages/springs";
        PROJECT: "distance" "stages/project";
        CONTACT: "distance" "tether" "contact" "stages/move" "stages/contact";
        SINGLE_WORKGROUP: "integrate" "bending" "wind" "distance" "tether" "contact" "limits" "watch"
            "stages/watch" "stages/sweep" "stages/tiles" "stages/watch_edges" "stages/levels" "stages/tethers" "stages/move"
            "stages/bend_ring" "stages/bend_in_workgroup" "stages/forces_in_workgroup" "stages/single_workgroup";
        COMMIT: "limits" "watch" "stages/watch" "stages/commit";
        RESTRICT: "average" "integrate" "stages/restrict";
        LEVEL_TILE: "average" "distance" "stages/sweep" "stages/tiles" "stages/tile_sweep" "stages/level_tile";
        LEVELS_IN_WORKGROUP: "average" "distance" "stages/sweep" "stages/levels" "stages/levels_in_workgroup";
        LEVELS_PER_COLOR: "average" "distance" "stages/levels_per_color";
        STATISTICS: "limits" "statistics" "stages/statistics";
        NORMALS: "normal" "stages/normals";
        FOLLOW: "normal" "follow" "stages/follow";
        EXCHANGE: "stages/exchange";
    }
    "" after ("integrate" "distance" "tether" "contact" "limits" "watch" "stages/watch" "stages/sweep" "stages/tiles"
        "stages/watch_edges" "stages/tile_sweep" "stages/tethers" "stages/move" "stages/tile") {
        PLAIN_TILE: "stages/plain_tile";
        BENT_TILE: "bending" "stages/bend_ring" "stages/bend_vectors" "stages/bent_tile";
        CORRECTED_TILE: "average" "stages/corrected_tile";
    }
    "stages/self_contact/" after ("limits" "distance" "contact" "pair" "plane" "stages/self_contact/shared") {
        BEGIN_CONTACT: "mean" "begin_contact";
        BODIES: "mean" "bodies";
        TREE: "boxes" "normals" "tree";
        DESCENT: "boxes" "normals" "detection" "descent";
        BROAD_PHASE: "boxes" "detection" "broad_phase";
        NARROW_PHASE: "boxes" "normals" "detection" "narrow_phase";
        NEAR: "mean" "pairs" "voronoi" "near";
        RESPONSE: "pairs" "sums" "response";
        TRUNCATION: "pairs" "sums" "truncation";
        FINISH: "mean" "sums" "finish";
        CARRY: "pinches" "carry";
    }
}
