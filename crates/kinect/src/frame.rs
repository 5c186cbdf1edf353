//! Frames and the forms in which they travel.
//!
//! Colour is 640 x 480 pixels of 8 bits behind a Bayer filter in the order GRBG: even rows hold G R G R ..., odd rows
//! B G B G .... Depth is 640 x 480 raw disparities of 11 bits, on the wire packed most significant bit first, eight in eleven
//! bytes. Facts: `OpenKinect`'s protocol documentation.

use bench_device::{DeviceError, Time};

use crate::KinectError;

/// Columns of either image.
pub const WIDTH: usize = 640;
/// Rows of either image.
pub const HEIGHT: usize = 480;
/// Pixels of either image.
pub const PIXELS: usize = WIDTH * HEIGHT;
/// Bytes of a packed depth frame.
pub const PACKED_DEPTH_BYTES: usize = PIXELS * 11 / 8;
/// The raw disparity that stands for "no reading".
pub const NO_READING: u16 = 2047;
/// Ticks a second of the device's clock.
pub const TICKS_PER_S: f64 = 60e6;

/// One colour and one depth image that belong together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Bayer GRBG, row by row, [`PIXELS`] bytes.
    pub colour: Box<[u8]>,
    /// Which colour pixels were received.
    pub colour_valid: Mask,
    /// Device time of the colour image, 60 MHz, wraps every 71.58 s.
    pub colour_ticks: u32,
    /// Raw disparity, row by row, [`PIXELS`] values of 0 to 2047; [`NO_READING`] where the sensor saw none.
    pub depth: Box<[u16]>,
    /// Which depth pixels were received. A pixel can be received and hold [`NO_READING`].
    pub depth_valid: Mask,
    /// Device time of the depth image.
    pub depth_ticks: u32,
    /// When the later of the two images was complete on the host; from a Kinect, when it would have been without what the host delayed.
    pub arrived_at: Time,
}

impl Default for Frame {
    fn default() -> Self {
        Self {
            colour: vec![0; PIXELS].into_boxed_slice(),
            colour_valid: Mask::whole(),
            colour_ticks: 0,
            depth: vec![NO_READING; PIXELS].into_boxed_slice(),
            depth_valid: Mask::whole(),
            depth_ticks: 0,
            arrived_at: Time::ZERO,
        }
    }
}

impl Frame {
    /// Becomes what another frame is, without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        let Self { colour, colour_valid, colour_ticks, depth, depth_valid, depth_ticks, arrived_at } = self;
        colour.copy_from_slice(&other.colour);
        depth.copy_from_slice(&other.depth);
        colour_valid.copy_from(&other.colour_valid);
        depth_valid.copy_from(&other.depth_valid);
        (*colour_ticks, *depth_ticks, *arrived_at) =
            (other.colour_ticks, other.depth_ticks, other.arrived_at);
    }
}

/// A stream of frames: a Kinect, a renderer, a recording.
pub trait FrameSource {
    /// The next frame that has arrived and was not yet returned, oldest first; `None` when there is none now. Never
    /// blocks. The frame is the source's own until the next call, so that nobody copies it.
    fn poll_frame(&mut self) -> Result<Option<&Frame>, DeviceError>;
}

/// Which pixels of an image were received: one bit each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    words: Box<[u64]>,
    lost: usize,
}

impl Mask {
    /// Everything received.
    pub fn whole() -> Self {
        Self { words: vec![u64::MAX; PIXELS / 64].into_boxed_slice(), lost: 0 }
    }

    /// Everything received again, without allocating.
    pub fn reset(&mut self) {
        if self.lost > 0 {
            self.words.fill(u64::MAX);
            self.lost = 0;
        }
    }

    fn copy_from(&mut self, other: &Self) {
        self.words.copy_from_slice(&other.words);
        self.lost = other.lost;
    }

    /// Marks pixels as lost; those past the image are ignored.
    pub fn lose(&mut self, pixels: std::ops::Range<usize>) {
        for pixel in pixels.start..pixels.end.min(PIXELS) {
            let (word, bit) = (pixel / 64, 1_u64 << (pixel % 64));
            self.lost += usize::from(self.words[word] & bit != 0);
            self.words[word] &= !bit;
        }
    }

    /// Whether a pixel, counted row by row, was received; one outside the image never is.
    pub fn received(&self, pixel: usize) -> bool {
        self.words.get(pixel / 64).is_some_and(|word| word >> (pixel % 64) & 1 == 1)
    }

    /// Whether nothing was lost.
    pub fn is_whole(&self) -> bool {
        self.lost == 0
    }

    /// How many pixels were lost.
    pub fn lost(&self) -> usize {
        self.lost
    }
}

/// Packed 11-bit depth to one value a pixel.
pub fn unpack_depth(packed: &[u8], depth: &mut [u16]) -> Result<(), KinectError> {
    expect_length("packed depth", packed.len(), PACKED_DEPTH_BYTES)?;
    expect_length("unpacked depth", depth.len() * 2, PIXELS * 2)?;
    for (bytes, pixels) in packed.as_chunks::<11>().0.iter().zip(depth.as_chunks_mut::<8>().0) {
        // Pixels 0 to 3 lie in the first eight bytes, 4 to 7 in the last eight. Eleven bytes hold both.
        let (Some(head), Some(tail)) = (bytes.first_chunk(), bytes.last_chunk()) else { continue };
        let (head, tail) = (four(u64::from_be_bytes(*head) >> 20), four(u64::from_be_bytes(*tail)));
        let lane = |word: u64, i: u32| (word >> (16 * i)) as u16;
        *pixels = [
            lane(head, 0),
            lane(head, 1),
            lane(head, 2),
            lane(head, 3),
            lane(tail, 0),
            lane(tail, 1),
            lane(tail, 2),
            lane(tail, 3),
        ];
    }
    Ok(())
}

/// The lowest 44 bits, which hold four pixels with the first on top, to four lanes of 16 bits with the first at the bottom:
/// first in halves, then in quarters.
fn four(bits: u64) -> u64 {
    const ELEVEN: u64 = 0x07ff_0000_07ff;
    let halves = (bits >> 22 & 0x3f_ffff) | (bits & 0x3f_ffff) << 32;
    (halves >> 11 & ELEVEN) | (halves & ELEVEN) << 16
}

/// One value a pixel to packed 11-bit depth; bits above the eleventh are dropped.
pub fn pack_depth(depth: &[u16], packed: &mut [u8]) -> Result<(), KinectError> {
    expect_length("unpacked depth", depth.len() * 2, PIXELS * 2)?;
    expect_length("packed depth", packed.len(), PACKED_DEPTH_BYTES)?;
    for (pixels, bytes) in depth.as_chunks::<8>().0.iter().zip(packed.as_chunks_mut::<11>().0) {
        let bits = pixels.iter().fold(0_u128, |bits, pixel| bits << 11 | u128::from(pixel & 2047));
        bytes.copy_from_slice(&bits.to_be_bytes()[5..]);
    }
    Ok(())
}

/// Bayer to RGB, by the mean of the nearest neighbours of each colour. A pixel's own colour stays as it is, so [`mosaic`]
/// gives the Bayer image back to the last bit.
pub fn demosaic(bayer: &[u8], rgb: &mut [u8]) -> Result<(), KinectError> {
    expect_length("Bayer image", bayer.len(), PIXELS)?;
    expect_length("RGB image", rgb.len(), PIXELS * 3)?;
    for y in 0..HEIGHT {
        // Mirrored at the border, which keeps the filter's order.
        let (up, down) = (if y == 0 { 1 } else { y - 1 }, if y == HEIGHT - 1 { y - 1 } else { y + 1 });
        let row = |y: usize| &bayer[y * WIDTH..][..WIDTH];
        let (above, here, below) = (row(up), row(y), row(down));
        for (x, pixel) in rgb[y * WIDTH * 3..][..WIDTH * 3].as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let (left, right) = (if x == 0 { 1 } else { x - 1 }, if x == WIDTH - 1 { x - 1 } else { x + 1 });
            let mean = |values: &[u8]| {
                let sum: usize = values.iter().map(|value| usize::from(*value)).sum();
                ((sum + values.len() / 2) / values.len()) as u8
            };
            let own = here[x];
            let across = || mean(&[here[left], here[right]]);
            let along = || mean(&[above[x], below[x]]);
            let beside = || mean(&[here[left], here[right], above[x], below[x]]);
            let corners = || mean(&[above[left], above[right], below[left], below[right]]);
            *pixel = match (y % 2, x % 2) {
                (0, 0) => [across(), own, along()],
                (0, _) => [own, beside(), corners()],
                (_, 0) => [corners(), beside(), own],
                (_, _) => [along(), own, across()],
            };
        }
    }
    Ok(())
}

/// RGB to Bayer: each pixel keeps the colour that its filter passes.
pub fn mosaic(rgb: &[u8], bayer: &mut [u8]) -> Result<(), KinectError> {
    expect_length("RGB image", rgb.len(), PIXELS * 3)?;
    expect_length("Bayer image", bayer.len(), PIXELS)?;
    for (i, (pixel, out)) in rgb.as_chunks::<3>().0.iter().zip(bayer).enumerate() {
        *out = pixel[filter(i % WIDTH, i / WIDTH)];
    }
    Ok(())
}

/// Which of red, green, blue (0, 1, 2) the filter passes at a pixel.
pub(crate) fn filter(x: usize, y: usize) -> usize {
    [[1, 0], [2, 1]][y % 2][x % 2]
}

fn expect_length(what: &'static str, found: usize, expected: usize) -> Result<(), KinectError> {
    if found == expected { Ok(()) } else { Err(KinectError::Length { what, found, expected }) }
}

/// A simulated device's clock at an instant.
pub fn ticks_at(time: Time) -> u32 {
    // 60 ticks a microsecond: 3 in 50 ns. Wrapping is what the counter does.
    (u128::from(time.nanos()) * 3 / 50) as u32
}

/// Makes a growing count of a device's time stamps, which wrap every 71.58 s.
#[derive(Clone, Copy, Debug, Default)]
pub struct TickClock {
    last: Option<(u32, i64)>,
}

impl TickClock {
    /// Seconds since the first stamp. A stamp up to half a wrap before the last one counts as earlier, not as a wrap:
    /// the two streams' stamps interleave.
    pub fn seconds(&mut self, ticks: u32) -> f64 {
        let total = match self.last {
            None => 0,
            Some((last, total)) => total + i64::from(ticks.wrapping_sub(last).cast_signed()),
        };
        self.last = Some((ticks, total));
        total as f64 / TICKS_PER_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Something of every value, without pattern in eights.
    fn depth() -> Vec<u16> {
        (0..PIXELS).map(|i| (i * 7919 / 13 % 2048) as u16).collect()
    }

    #[test]
    fn depth_survives_packing_and_is_a_bit_stream_with_the_highest_bit_first() {
        let depth = depth();
        let mut packed = vec![0; PACKED_DEPTH_BYTES];
        pack_depth(&depth, &mut packed).unwrap();
        for i in [0, 1, 5, 7, 8, 12_345, PIXELS - 1] {
            // Bit by bit, as the protocol says it.
            let value = (0..11).fold(0, |value, bit| {
                let at = i * 11 + bit;
                value << 1 | u16::from(packed[at / 8] >> (7 - at % 8) & 1)
            });
            assert_eq!(value, depth[i], "pixel {i}");
        }
        let mut back = vec![0; PIXELS];
        unpack_depth(&packed, &mut back).unwrap();
        assert!(back == depth);
    }

    #[test]
    fn a_short_buffer_is_refused_by_name() {
        let error = unpack_depth(&[0; 11], &mut vec![0; PIXELS]).unwrap_err().to_string();
        assert!(error.contains("packed depth has 11 bytes, expected 422400"), "{error}");
        assert!(demosaic(&[0; 3], &mut []).is_err());
    }

    #[test]
    fn a_bayer_image_survives_demosaicing_and_a_plain_colour_becomes_that_colour() {
        let bayer: Vec<u8> = (0..PIXELS).map(|i| (i * 31 % 251) as u8).collect();
        let (mut rgb, mut back) = (vec![0; PIXELS * 3], vec![0; PIXELS]);
        demosaic(&bayer, &mut rgb).unwrap();
        mosaic(&rgb, &mut back).unwrap();
        assert!(back == bayer);

        let plain = [200, 90, 10].repeat(PIXELS);
        mosaic(&plain, &mut back).unwrap();
        assert_eq!([back[0], back[1], back[WIDTH], back[WIDTH + 1]], [90, 200, 10, 90]);
        demosaic(&back, &mut rgb).unwrap();
        assert!(rgb == plain);
    }

    #[test]
    fn lost_pixels_are_counted_once() {
        let mut mask = Mask::whole();
        mask.lose(60..70);
        mask.lose(65..75);
        mask.lose(PIXELS - 1..PIXELS + 100);
        assert_eq!(mask.lost(), 16);
        assert!(mask.received(59) && !mask.received(60) && !mask.received(74) && mask.received(75));
        assert!(!mask.received(PIXELS + 5));
        mask.reset();
        assert_eq!(mask, Mask::whole());
    }

    #[test]
    fn ticks_wrap_without_a_jump_and_may_step_back() {
        let mut clock = TickClock::default();
        assert_eq!(clock.seconds(u32::MAX - 59_999_999), 0.0);
        assert_eq!(clock.seconds(0), 1.0);
        assert_eq!(clock.seconds(u32::MAX - 29_999_999), 0.5);
        assert_eq!(clock.seconds(60_000_000), 2.0);
        assert_eq!(ticks_at(Time::from_seconds(1.0)), 60_000_000);
        assert_eq!(ticks_at(Time::from_seconds(100.0)), (6_000_000_000_u64 % (1 << 32)) as u32);
    }
}
