//! The marker's centre at full resolution.

use nalgebra::Vector2;

use crate::frame::{HEIGHT, WIDTH, filter};

use super::Blob;

/// Pixels around the blob in which the marker's blurred edge lies.
const EDGE_PX: usize = 4;
/// Share of the strongest redness below which a pixel is background.
const FLOOR: f32 = 0.2;

/// A blob at full resolution.
#[derive(Clone, Copy, Debug)]
pub(super) struct Refined {
    /// Its centre in the image.
    pub centre: Vector2<f64>,
    /// Side of the square that is as large, pixels. Blur leaves it as it is: what an edge loses, its surroundings gain.
    pub side_px: f64,
}

/// Centre and size of a blob, weighted by redness: a pixel at the edge counts for the part that the marker covers. `None`
/// when there is nothing red in the blob after all.
pub(super) fn refine(bayer: &[u8], blob: &Blob) -> Option<Refined> {
    let columns = (2 * blob.x0).saturating_sub(EDGE_PX).max(1)..(2 * blob.x1 + EDGE_PX).min(WIDTH - 1);
    let rows = (2 * blob.y0).saturating_sub(EDGE_PX).max(1)..(2 * blob.y1 + EDGE_PX).min(HEIGHT - 1);
    // The middle of the blob stands for the marker's own redness; a single bright pixel must not.
    let [x, y] = blob.centre_px();
    let (x, y) = ((x.round() as usize).clamp(2, WIDTH - 3), (y.round() as usize).clamp(2, HEIGHT - 3));
    let full: f32 = (y - 1..=y + 1).map(|y| (x - 1..=x + 1).map(|x| redness(bayer, x, y)).sum::<f32>()).sum();
    let full = full / 9.0;
    let floor = FLOOR * full;
    let (mut sum, mut sum_x, mut sum_y, mut area) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for y in rows {
        let (mut row, mut row_x, mut red) = (0.0_f32, 0.0_f32, 0.0_f32);
        for x in columns.clone() {
            let redness = redness(bayer, x, y);
            let weight = (redness - floor).max(0.0);
            row += weight;
            row_x += weight * (x - columns.start) as f32;
            red += if redness > floor { redness } else { 0.0 };
        }
        area += f64::from(red);
        sum += f64::from(row);
        sum_x += f64::from(row_x) + f64::from(row) * columns.start as f64;
        sum_y += f64::from(row) * y as f64;
    }
    (full > 0.0 && sum > 0.0).then(|| Refined {
        centre: Vector2::new(sum_x / sum, sum_y / sum),
        side_px: (area / f64::from(full)).sqrt(),
    })
}

/// Red less the mean of green and blue, each from a pixel's nearest neighbours. Not at the image's border.
fn redness(bayer: &[u8], x: usize, y: usize) -> f32 {
    let at = y * WIDTH + x;
    let value = |i: usize| f32::from(bayer[i]);
    let across = value(at - 1) + value(at + 1);
    let along = value(at - WIDTH) + value(at + WIDTH);
    let corners =
        || value(at - WIDTH - 1) + value(at - WIDTH + 1) + value(at + WIDTH - 1) + value(at + WIDTH + 1);
    match filter(x, y) {
        0 => value(at) - 0.125 * (across + along) - 0.125 * corners(),
        2 => 0.25 * corners() - 0.125 * (across + along) - 0.5 * value(at),
        _ if y.is_multiple_of(2) => 0.5 * across - 0.5 * value(at) - 0.25 * along,
        _ => 0.5 * along - 0.5 * value(at) - 0.25 * across,
    }
}
