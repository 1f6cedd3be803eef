//! A contact sheet: several frames in one picture.

use std::sync::atomic::AtomicBool;

use super::moment::Stage;
use super::{Cell, Look, each};

/// Size of a cell (pixels).
const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// Cells per row.
const COLUMNS: usize = 4;
/// Width of the white lines between cells (pixels).
const GAP: usize = 2;
/// Color of the frame numbers (sRGB).
const INK: [u8; 3] = [63, 69, 79];

/// Draws each frame into a cell, row by row, four to a row. Returns a PNG file, or `None` if it was interrupted.
///
/// # Errors
/// If the PNG encoder fails, as it does without frames.
pub(crate) fn contact_sheet(
    frames: &[Cell],
    triangles: &[[u32; 3]],
    look: &Look,
    interrupted: &AtomicBool,
) -> Result<Option<Vec<u8>>, png::EncodingError> {
    let stage = Stage::new(frames, triangles, look, [WIDTH, HEIGHT]);
    let draw = |cell: &Cell| {
        let mut pixels = stage.draw(cell);
        label(&mut pixels, cell.frame);
        pixels
    };
    let Some(cells) = each(frames, draw, interrupted) else { return Ok(None) };

    let columns = cells.len().min(COLUMNS);
    let rows = cells.len().div_ceil(COLUMNS);
    let width = (columns * (WIDTH + GAP)).saturating_sub(GAP);
    let height = (rows * (HEIGHT + GAP)).saturating_sub(GAP);
    let mut pixels = vec![[u8::MAX; 3]; width * height];
    for (cell, drawn) in cells.iter().enumerate() {
        let corner = cell / COLUMNS * (HEIGHT + GAP) * width + cell % COLUMNS * (WIDTH + GAP);
        for (row, line) in drawn.chunks_exact(WIDTH).enumerate() {
            pixels[corner + row * width..][..WIDTH].copy_from_slice(line);
        }
    }

    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels.as_flattened())?;
    writer.finish()?;
    Ok(Some(file))
}

/// Draws a number into the upper left corner of a cell.
fn label(pixels: &mut [[u8; 3]], number: u32) {
    /// The rows of each digit from the top, three bits per row.
    const DIGITS: [[u8; 5]; 10] = [
        [7, 5, 5, 5, 7],
        [2, 6, 2, 2, 7],
        [7, 1, 7, 4, 7],
        [7, 1, 7, 1, 7],
        [5, 5, 7, 1, 1],
        [7, 4, 7, 1, 7],
        [7, 4, 7, 5, 7],
        [7, 1, 1, 1, 1],
        [7, 5, 7, 5, 7],
        [7, 5, 7, 1, 7],
    ];
    const DOT: usize = 2;
    const MARGIN: usize = 10;
    for (place, digit) in number.to_string().bytes().enumerate() {
        for (row, bits) in DIGITS[usize::from(digit - b'0')].into_iter().enumerate() {
            for column in (0..3).filter(|column| bits >> (2 - column) & 1 == 1) {
                for dot in 0..DOT * DOT {
                    let x = MARGIN + (place * 4 + column) * DOT + dot % DOT;
                    let y = MARGIN + row * DOT + dot / DOT;
                    pixels[y * WIDTH + x] = INK;
                }
            }
        }
    }
}
