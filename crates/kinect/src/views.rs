//! The paper's three views of a frame, as PNG files: full spectrum, red-filtered, depth in colours; with what the tracker
//! looked at. Green: taken for the marker. Yellow: may be the marker, but was not taken. Blue: rejected for its size or place.
//! White: rejected for its shape.

use std::{
    fs::File,
    io::BufWriter,
    path::{Path, PathBuf},
};

use bench_device::TrackStatus;
use nalgebra::Vector2;

use crate::{
    KinectError,
    camera::Camera,
    frame::{Frame, HEIGHT, PIXELS, WIDTH, demosaic},
    track::{Candidate, Rejection, Sighting, Tracker, red_row},
};

const GREEN: Rgb = [40, 255, 60];
const YELLOW: Rgb = [255, 220, 0];
const BLUE: Rgb = [90, 150, 255];
const WHITE: Rgb = [235, 235, 235];
/// On either side of a frame in the depth view, whose own colours are those of frames.
const BLACK: Rgb = [0, 0, 0];
/// Pixels that were lost.
const LOST: Rgb = [255, 0, 255];
/// The depths between which colours run from red over green to blue, m.
const DEPTHS_M: [f64; 2] = [0.6, 4.2];

type Rgb = [u8; 3];

/// An image of a frame's size.
pub struct Image(Vec<u8>);

/// The three views of a frame.
pub struct Views {
    /// All colours.
    pub full: Image,
    /// What passes the red test in its own colours, the rest dark grey.
    pub red: Image,
    /// Depth in colours; black without a reading.
    pub depth: Image,
}

impl Views {
    /// Draws a frame that the tracker has just looked at.
    pub fn new(frame: &Frame, tracker: &Tracker, sighting: &Sighting) -> Result<Self, KinectError> {
        Self::draw([const { Vec::new() }; 3], frame, tracker.camera(), tracker.candidates(), sighting)
    }

    /// The same into the memory of views that are no longer wanted, and where the tracker is elsewhere: by its camera, and by the
    /// candidates that it had for this frame.
    pub fn draw(
        buffers: [Vec<u8>; 3],
        frame: &Frame,
        camera: &Camera,
        candidates: &[Candidate],
        sighting: &Sighting,
    ) -> Result<Self, KinectError> {
        let [mut full, mut red, mut depth] = buffers.map(|mut buffer| {
            buffer.clear();
            buffer.resize(PIXELS * 3, 0);
            Image(buffer)
        });
        demosaic(&frame.colour, &mut full.0)?;
        for pixel in (0..PIXELS).filter(|pixel| !frame.colour_valid.received(*pixel)) {
            full.set(pixel % WIDTH, pixel / WIDTH, LOST);
        }
        red.0.copy_from_slice(&full.0);
        red.keep_red(frame);
        depth.paint_depth(frame, camera);
        for candidate in candidates {
            let (colour, blob) = (colour_of(candidate), &candidate.blob);
            let low = Vector2::new(2 * blob.x0, 2 * blob.y0).cast::<f64>();
            let high = Vector2::new(2 * blob.x1, 2 * blob.y1).cast::<f64>();
            full.frame(low, high, colour);
            red.frame(low, high, colour);
            // What was rejected by its shape was never asked for its depth.
            let middle = (low + high) / 2.0;
            if let Some(z_m) = candidate.z_m.or_else(|| depth_seen(frame, camera, middle)) {
                let place = |pixel| camera.depth_pixel(&camera.from_colour(pixel, z_m));
                if let (Some(low), Some(high)) = (place(low), place(high)) {
                    for (out, colour) in [(-1.0, BLACK), (1.0, BLACK), (0.0, colour)] {
                        depth.frame(low.add_scalar(-out), high.add_scalar(out), colour);
                    }
                }
            }
        }
        if sighting.status != TrackStatus::Lost {
            full.cross(sighting.pixel);
            red.cross(sighting.pixel);
        }
        Ok(Self { full, red, depth })
    }

    /// Writes `NAME-full.png`, `NAME-red.png` and `NAME-depth.png` into a folder; returns their paths.
    pub fn save(&self, folder: &Path, name: &str) -> Result<[PathBuf; 3], KinectError> {
        let path = |view: &str| folder.join(format!("{name}-{view}.png"));
        let paths = [path("full"), path("red"), path("depth")];
        for (image, path) in [&self.full, &self.red, &self.depth].into_iter().zip(&paths) {
            image.save(path)?;
        }
        Ok(paths)
    }
}

/// Depth of what the colour camera sees at a pixel: the median of those readings whose own depth puts them there. `None` without any.
fn depth_seen(frame: &Frame, camera: &Camera, pixel: Vector2<f64>) -> Option<f64> {
    const ROWS: usize = 5;
    let ray = camera.colour_ray(pixel);
    let [near, far] = DEPTHS_M.map(|z_m| camera.depth_pixel(&(ray * z_m)));
    let (near, far) = (near?, far?);
    let index = |at: f64, size: usize| at.round().clamp(0.0, size as f64 - 1.0) as usize;
    let columns = index(near.x.min(far.x), WIDTH)..=index(near.x.max(far.x), WIDTH);
    let row = index(far.y, HEIGHT).saturating_sub(ROWS / 2);
    // In a loop in real time this is drawn on its thread, which does not allocate.
    let (mut found_m, mut count) = ([0.0; 64], 0);
    for (x, y) in (row..(row + ROWS).min(HEIGHT)).flat_map(|y| columns.clone().map(move |x| (x, y))) {
        let at = y * WIDTH + x;
        let z_m = camera.disparity().depth_m(f64::from(frame.depth[at]));
        let Some(z_m) = z_m.filter(|_| frame.depth_valid.received(at)) else { continue };
        let is_there =
            camera.depth_pixel(&(ray * z_m)).is_some_and(|place| (place.x - x as f64).abs() <= 1.0);
        if is_there && count < found_m.len() {
            found_m[count] = z_m;
            count += 1;
        }
    }
    let found_m = &mut found_m[..count];
    found_m.sort_unstable_by(f64::total_cmp);
    found_m.get(count / 2).copied()
}

fn colour_of(candidate: &Candidate) -> Rgb {
    match candidate.rejection {
        _ if candidate.chosen => GREEN,
        None | Some(Rejection::Doubtful) => YELLOW,
        Some(Rejection::Size | Rejection::Elsewhere | Rejection::Cut) => BLUE,
        Some(Rejection::Aspect | Rejection::Fill) => WHITE,
    }
}

impl Image {
    /// Red, green, blue of all pixels, row by row.
    pub fn rgb(&self) -> &[u8] {
        &self.0
    }

    /// Red, green, blue of a pixel.
    pub fn pixel(&self, x: usize, y: usize) -> [u8; 3] {
        let at = (y * WIDTH + x) * 3;
        [self.0[at], self.0[at + 1], self.0[at + 2]]
    }

    /// Red, green, blue of each pixel, row by row.
    pub fn into_rgb(self) -> Vec<u8> {
        self.0
    }

    fn set(&mut self, x: usize, y: usize, colour: Rgb) {
        if x < WIDTH && y < HEIGHT {
            self.0[(y * WIDTH + x) * 3..][..3].copy_from_slice(&colour);
        }
    }

    fn keep_red(&mut self, frame: &Frame) {
        for (row, lines) in frame.colour.as_chunks::<{ 2 * WIDTH }>().0.iter().enumerate() {
            let (even, odd) = lines.split_at(WIDTH);
            let (Some(even), Some(odd)) = (even.first_chunk(), odd.first_chunk()) else { continue };
            let mut red = [0; WIDTH / 2];
            red_row(even, odd, &mut red);
            for (x, y) in (0..WIDTH).flat_map(|x| [(x, 2 * row), (x, 2 * row + 1)]) {
                if red[x / 2] == 0 {
                    let grey = self.pixel(x, y).map(u16::from).iter().sum::<u16>() / 12;
                    self.set(x, y, [grey as u8; 3]);
                }
            }
        }
    }

    fn paint_depth(&mut self, frame: &Frame, camera: &Camera) {
        for (pixel, raw) in frame.depth.iter().enumerate() {
            let (x, y) = (pixel % WIDTH, pixel / WIDTH);
            if !frame.depth_valid.received(pixel) {
                self.set(x, y, LOST);
            } else if let Some(z_m) = camera.disparity().depth_m(f64::from(*raw)) {
                self.set(x, y, depth_colour(z_m));
            }
        }
    }

    fn frame(&mut self, low: Vector2<f64>, high: Vector2<f64>, colour: Rgb) {
        let place = |x: f64| (x + 0.5).max(0.0) as usize;
        // Two pixels outside, so that nothing of the thing itself is hidden.
        let (x0, y0) = (place(low.x - 3.0), place(low.y - 3.0));
        let (x1, y1) = (place(high.x + 2.0), place(high.y + 2.0));
        for x in x0..=x1.min(WIDTH) {
            self.set(x, y0, colour);
            self.set(x, y1, colour);
        }
        for y in y0..=y1.min(HEIGHT) {
            self.set(x0, y, colour);
            self.set(x1, y, colour);
        }
    }

    fn cross(&mut self, [x, y]: [f64; 2]) {
        let (x, y) = (x.round() as usize, y.round() as usize);
        for away in 0..3 {
            for (x, y) in
                [(x + away, y), (x.saturating_sub(away), y), (x, y + away), (x, y.saturating_sub(away))]
            {
                self.set(x, y, GREEN);
            }
        }
    }

    fn save(&self, path: &Path) -> Result<(), KinectError> {
        let file = File::create(path).map_err(|reason| KinectError::File {
            action: "write",
            path: path.to_owned(),
            reason,
        })?;
        let mut encoder = png::Encoder::new(BufWriter::new(file), WIDTH as u32, HEIGHT as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder
            .write_header()
            .and_then(|mut writer| {
                writer.write_image_data(&self.0)?;
                writer.finish()
            })
            .map_err(|reason| KinectError::Image { path: path.to_owned(), reason })
    }
}

/// Near is red, far is blue, and the steps between are even in hue.
fn depth_colour(z_m: f64) -> Rgb {
    let share = ((z_m - DEPTHS_M[0]) / (DEPTHS_M[1] - DEPTHS_M[0])).clamp(0.0, 1.0);
    // A hue from 0 (red) to 4 (blue) sixths of the circle.
    let hue = 4.0 * share;
    let channel = |centre: f64| (255.0 * (2.0 - (hue - centre).abs()).clamp(0.0, 1.0)) as u8;
    [channel(0.0), channel(2.0), channel(4.0)]
}

#[cfg(test)]
mod tests {
    use bench_device::Time;
    use nalgebra::Vector3;

    use super::*;
    use crate::{
        render::{Pose, Renderer, Settings, scene::Scene},
        testing::calibration,
    };

    #[test]
    fn what_was_chosen_and_what_was_rejected_is_framed_in_all_views_and_the_marker_survives_the_red_filter() {
        let calibration = calibration();
        let mut renderer = Renderer::new(&calibration, &Scene::with_distractors(), Settings::default(), 3);
        let (mut tracker, mut frame) = (Tracker::new(&calibration), Frame::default());
        let mut sighting = Sighting::default();
        for i in 0..2 {
            let time = Time::from_seconds(1.0 + f64::from(i) / 30.0);
            renderer.render(time, Some(&Pose::at_rest(time, Vector3::new(0.0, 0.0, 0.6))), &mut frame);
            sighting = tracker.track(&frame, time);
        }
        let views = Views::new(&frame, &tracker, &sighting).unwrap();
        for image in [&views.full, &views.red, &views.depth] {
            let framed = (0..PIXELS).filter(|i| image.pixel(i % WIDTH, i / WIDTH) == GREEN).count();
            // Four sides of about 20 pixels.
            assert!(framed > 60, "{framed}");
            // What was rejected is shown in all three as well: for its size or place, and for its shape.
            for colour in [BLUE, WHITE] {
                let framed = (0..PIXELS).filter(|i| image.pixel(i % WIDTH, i / WIDTH) == colour).count();
                assert!(framed > 60, "{colour:?}: {framed}");
            }
        }
        let [x, y] = sighting.pixel.map(|at| at as usize);
        let [r, g, b] = views.red.pixel(x + 4, y + 4);
        assert!(r > 2 * g && r > 2 * b, "{r} {g} {b}");
        let [r, g, b] = views.red.pixel(320, 470);
        assert!(r == g && g == b && r < 64, "the floor stays: {r} {g} {b}");

        let folder = tempfile::tempdir().unwrap();
        for path in views.save(folder.path(), "0001").unwrap() {
            let decoder = png::Decoder::new(std::io::BufReader::new(File::open(path).unwrap()));
            let info = decoder.read_info().unwrap();
            assert_eq!((info.info().width, info.info().height), (640, 480));
        }
        assert!(views.save(&folder.path().join("none"), "1").is_err());
    }

    #[test]
    fn depth_runs_from_red_over_green_to_blue() {
        assert_eq!([0.6, 2.4, 4.2].map(depth_colour), [[255, 0, 0], [0, 255, 0], [0, 0, 255]]);
    }
}
