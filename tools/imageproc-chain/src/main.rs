//! Times imageproc's way from a Bayer frame to the largest red object: `imageproc-chain FOLDER` prints seconds a frame.
//!
//! Demosaicing is not part of imageproc; a mean of neighbours stands for it and is not timed, in imageproc's favour.

use std::{collections::HashMap, fs, time::Instant};

use image::{GrayImage, Luma, RgbImage};
use imageproc::region_labelling::{Connectivity, connected_components};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: imageproc-chain FOLDER")?;
    let mut paths: Vec<_> = fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "bayer"));
    paths.sort();
    for path in paths {
        let rgb = demosaiced(&fs::read(path)?)?;
        let began = Instant::now();
        let largest = largest_red(&rgb);
        println!("{:.9} {:.2} {:.2}", began.elapsed().as_secs_f64(), largest[0], largest[1]);
    }
    Ok(())
}

fn demosaiced(bayer: &[u8]) -> Result<RgbImage, Box<dyn std::error::Error>> {
    if bayer.len() != WIDTH * HEIGHT {
        return Err("a frame does not have 640 x 480 bytes".into());
    }
    Ok(RgbImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
        // The quad's own colours: green, red above blue, green.
        let at = (y as usize & !1) * WIDTH + (x as usize & !1);
        let green = (u16::from(bayer[at]) + u16::from(bayer[at + WIDTH + 1])) / 2;
        image::Rgb([bayer[at + 1], green as u8, bayer[at + WIDTH]])
    }))
}

/// Centre of the largest red component.
fn largest_red(rgb: &RgbImage) -> [f64; 2] {
    let mask = GrayImage::from_fn(rgb.width(), rgb.height(), |x, y| {
        let [r, g, b] = rgb.get_pixel(x, y).0.map(u16::from);
        Luma([if r >= 70 && 10 * r >= 17 * g && 10 * r >= 17 * b { 255 } else { 0 }])
    });
    let labels = connected_components(&mask, Connectivity::Eight, Luma([0]));
    let mut found: HashMap<u32, [f64; 3]> = HashMap::new();
    for (x, y, label) in labels.enumerate_pixels().filter(|(_, _, label)| label[0] > 0) {
        let sums = found.entry(label[0]).or_default();
        *sums = [sums[0] + 1.0, sums[1] + f64::from(x), sums[2] + f64::from(y)];
    }
    let largest = found.values().max_by(|a, b| a[0].total_cmp(&b[0])).copied().unwrap_or([1.0, -1.0, -1.0]);
    [largest[1] / largest[0], largest[2] / largest[0]]
}
