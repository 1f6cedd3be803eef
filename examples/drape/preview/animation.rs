//! An animated PNG (APNG), which browsers play.
//!
//! All frames share a palette of 255 colors. Each frame contains only the rectangle that differs from the last one, and
//! within it pixels that do not change are transparent. The file is a tenth of the size of one in full color.

use std::sync::atomic::{AtomicBool, Ordering};

use color_quant::NeuQuant;
use rayon::prelude::*;

use super::moment::Stage;
use super::{Cell, Look, each};

/// Size of the picture (pixels).
const SIZE: [usize; 2] = [480, 360];
/// The transparent index of the palette: the pixel keeps its last color.
const STAYS: u8 = 0;
/// One in this many pixels is a sample for the choice of the palette.
const SAMPLED: usize = 37;
/// A pixel keeps its last color if its squared distance in sRGB (0 to 255 per channel) to the new one is at most this.
const NEAR: i32 = 40;

/// Draws the frames. Returns an APNG file that repeats forever and shows each frame for `delay` seconds, or `None` if it was
/// interrupted.
///
/// # Errors
/// If the PNG encoder fails, as it does without frames.
pub(crate) fn animation(
    frames: &[Cell],
    triangles: &[[u32; 3]],
    look: &Look,
    delay: f32,
    interrupted: &AtomicBool,
) -> Result<Option<Vec<u8>>, png::EncodingError> {
    let [width, height] = SIZE;
    let stage = Stage::new(frames, triangles, look, SIZE);
    let Some(drawn) = each(frames, |cell| stage.draw(cell), interrupted) else { return Ok(None) };
    let palette = Palette::new(&drawn);

    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_palette(palette.colors.as_flattened().to_vec());
    encoder.set_trns(vec![0]);
    encoder.set_deflate_compression(png::DeflateCompression::Level(9));
    encoder.set_filter(png::Filter::NoFilter);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_animated(frames.len() as u32, 0)?;
    encoder.set_frame_delay((1000.0 * delay).round().clamp(1.0, f32::from(u16::MAX)) as u16, 1000)?;
    encoder.set_dispose_op(png::DisposeOp::None)?;
    encoder.set_blend_op(png::BlendOp::Over)?;
    let mut writer = encoder.write_header()?;
    let mut shown: Vec<u8> = vec![STAYS; width * height];
    for pixels in &drawn {
        if interrupted.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let changed = palette.change(&mut shown, pixels);
        let [columns, rows] = [0, 1].map(|axis| {
            let place = |index: usize| if axis == 0 { index % width } else { index / width };
            let places = changed.iter().enumerate().filter(|&(_, &color)| color != STAYS).map(|(index, _)| place(index));
            let (low, high) = places.fold((usize::MAX, 0), |(low, high), place| (low.min(place), high.max(place)));
            // A frame must have at least one pixel.
            if low > high { 0..1 } else { low..high + 1 }
        });
        writer.set_frame_position(0, 0)?;
        writer.set_frame_dimension(columns.len() as u32, rows.len() as u32)?;
        writer.set_frame_position(columns.start as u32, rows.start as u32)?;
        let part: Vec<u8> = rows.flat_map(|row| &changed[row * width..][columns.clone()]).copied().collect();
        writer.write_image_data(&part)?;
    }
    writer.finish()?;
    Ok(Some(file))
}

/// 255 colors after the transparent one.
struct Palette {
    colors: Vec<[u8; 3]>,
}

impl Palette {
    fn new(pictures: &[Vec<[u8; 3]>]) -> Palette {
        let some = pictures.iter().flatten().step_by(SAMPLED);
        let rgba: Vec<u8> = some.flat_map(|&[r, g, b]| [r, g, b, u8::MAX]).collect();
        let chosen = NeuQuant::new(1, 255, &rgba).color_map_rgb();
        let mut colors = vec![[0; 3]];
        colors.extend(chosen.chunks_exact(3).map(|color| [color[0], color[1], color[2]]));
        Palette { colors }
    }

    /// Converts a picture to indices: new colors where it changes `shown`, otherwise [`STAYS`]. Updates `shown`.
    fn change(&self, shown: &mut [u8], picture: &[[u8; 3]]) -> Vec<u8> {
        let change = |(shown, &wanted): (&mut u8, &[u8; 3])| {
            if *shown != STAYS && distance(self.colors[usize::from(*shown)], wanted) <= NEAR {
                return STAYS;
            }
            let nearest = (1..self.colors.len()).min_by_key(|&color| distance(self.colors[color], wanted));
            let nearest = nearest.map_or(STAYS, |color| color as u8);
            let stays = *shown == nearest;
            *shown = nearest;
            if stays { STAYS } else { nearest }
        };
        shown.par_iter_mut().zip(picture).map(change).collect()
    }
}

fn distance(a: [u8; 3], b: [u8; 3]) -> i32 {
    a.into_iter().zip(b).map(|(a, b)| (i32::from(a) - i32::from(b)).pow(2)).sum()
}
