//! Red pixels to connected blobs, on quads of the Bayer pattern: 320 x 240 of them.

use crate::frame::{HEIGHT, WIDTH};

/// Quads a row, and rows of quads.
pub const QUADS_WIDE: usize = WIDTH / 2;
pub const QUADS_HIGH: usize = HEIGHT / 2;

/// One row of quads: 1 where red. The test needs no hue: `R >= 70`, `10 R >= 17 G`, `10 R >= 17 B`, with the mean of the
/// two greens.
// Lazy operators would branch; this is a loop over lanes.
#[expect(clippy::needless_bitwise_bool)]
pub fn red_row(even: &[u8; WIDTH], odd: &[u8; WIDTH], red: &mut [u8; QUADS_WIDE]) {
    let pairs = even.as_chunks::<2>().0.iter().zip(odd.as_chunks::<2>().0);
    for (red, ([green0, r], [b, green1])) in red.iter_mut().zip(pairs) {
        let (r, b) = (i16::from(*r), i16::from(*b));
        let greens = i16::from(*green0) + i16::from(*green1);
        *red = u8::from((r >= 70) & (20 * r >= 17 * greens) & (10 * r >= 17 * b));
    }
}

/// A stretch of red quads in a row; the last one excluded.
#[derive(Clone, Copy, Debug)]
struct Run {
    row: u16,
    from: u16,
    to: u16,
    /// Another run of the same blob that came before, or itself.
    parent: u32,
}

/// A connected blob of red quads (neighbours by side or corner) with its moments, in quads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Blob {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// Last column, excluded.
    pub x1: usize,
    /// Last row, excluded.
    pub y1: usize,
    /// Quads.
    pub area: u64,
    sum: [u64; 2],
    squares: [u64; 3],
}

impl Blob {
    /// Its centre in pixels of the image.
    pub fn centre_px(&self) -> [f64; 2] {
        // The middle of quad 0 lies between pixels 0 and 1.
        self.sum.map(|sum| 2.0 * sum as f64 / self.area as f64 + 0.5)
    }

    /// Long and short side in pixels of the rectangle with the same second moments, and the share of it that is red: about
    /// 1 for a rectangle or an ellipse, turned however it may be; less for anything with holes, notches or arms.
    pub fn sides_px(&self) -> ([f64; 2], f64) {
        let n = self.area as f64;
        let [mx, my] = self.sum.map(|sum| sum as f64 / n);
        let [xx, yy, xy] = self.squares.map(|sum| sum as f64 / n);
        // A quad is a square itself, which has a twelfth.
        let (vx, vy, cov) = (xx - mx * mx + 1.0 / 12.0, yy - my * my + 1.0 / 12.0, xy - mx * my);
        let (mean, spread) = (0.5 * (vx + vy), (0.25 * (vx - vy).powi(2) + cov * cov).sqrt());
        let sides = [mean + spread, mean - spread].map(|variance| (12.0 * variance.max(1.0 / 12.0)).sqrt());
        (sides.map(|side| 2.0 * side), n / (sides[0] * sides[1]))
    }

    fn add(&mut self, run: &Run) {
        let (row, from, to) = (u64::from(run.row), u64::from(run.from), u64::from(run.to));
        if self.area == 0 {
            (self.x0, self.y0) = (usize::MAX, usize::MAX);
        }
        self.x0 = self.x0.min(from as usize);
        self.x1 = self.x1.max(to as usize);
        self.y0 = self.y0.min(row as usize);
        self.y1 = self.y1.max(row as usize + 1);
        let n = to - from;
        // Sums of x and x^2 over from..to.
        let sum = n * (from + to - 1) / 2;
        let squares_below = |x: u64| if x == 0 { 0 } else { (x - 1) * x * (2 * x - 1) / 6 };
        self.area += n;
        self.sum[0] += sum;
        self.sum[1] += n * row;
        self.squares[0] += squares_below(to) - squares_below(from);
        self.squares[1] += n * row * row;
        self.squares[2] += sum * row;
    }
}

/// Finds blobs; keeps its memory from frame to frame.
pub struct Finder {
    runs: Vec<Run>,
    blobs: Vec<Blob>,
    /// Which blob the root of a set of runs became.
    index: Vec<u32>,
}

/// The most runs a frame can have: every other quad.
const MAX_RUNS: usize = QUADS_HIGH * QUADS_WIDE / 2;

impl Finder {
    pub fn new() -> Self {
        Self {
            runs: Vec::with_capacity(MAX_RUNS),
            blobs: Vec::with_capacity(MAX_RUNS),
            index: Vec::with_capacity(MAX_RUNS),
        }
    }

    /// All blobs of a Bayer image of whole size, in the order in which their first rows come.
    pub fn find(&mut self, bayer: &[u8]) -> &[Blob] {
        self.runs.clear();
        let mut red = [0; QUADS_WIDE];
        let (mut above, mut above_end) = (0, 0);
        for (row, lines) in bayer.as_chunks::<{ 2 * WIDTH }>().0.iter().enumerate() {
            let (even, odd) = lines.split_at(WIDTH);
            // Both have the length of a row by the split.
            let (Some(even), Some(odd)) = (even.first_chunk(), odd.first_chunk()) else { continue };
            red_row(even, odd, &mut red);
            let begin = self.runs.len();
            self.collect_runs(row as u16, &red);
            self.join(above, above_end, begin);
            (above, above_end) = (begin, self.runs.len());
        }
        self.gather();
        &self.blobs
    }

    fn collect_runs(&mut self, row: u16, red: &[u8; QUADS_WIDE]) {
        let mut from = None;
        for (word, eight) in red.as_chunks::<8>().0.iter().enumerate() {
            let bits = u64::from_ne_bytes(*eight);
            // Most of an image is not red, and what is red goes on.
            if (bits == 0 && from.is_none()) || (bits == 0x0101_0101_0101_0101 && from.is_some()) {
                continue;
            }
            for (i, red) in eight.iter().enumerate() {
                let column = (8 * word + i) as u16;
                match (from, red) {
                    (None, 1) => from = Some(column),
                    (Some(begin), 0) => {
                        self.push(row, begin, column);
                        from = None;
                    }
                    _ => {}
                }
            }
        }
        if let Some(begin) = from {
            self.push(row, begin, QUADS_WIDE as u16);
        }
    }

    fn push(&mut self, row: u16, from: u16, to: u16) {
        let parent = self.runs.len() as u32;
        self.runs.push(Run { row, from, to, parent });
    }

    /// Joins each run from `begin` on with those of the row above that touch it.
    fn join(&mut self, mut above: usize, above_end: usize, begin: usize) {
        for here in begin..self.runs.len() {
            let Run { row, from, to, .. } = self.runs[here];
            if above < above_end && self.runs[above].row + 1 != row {
                return;
            }
            while above < above_end && self.runs[above].to < from {
                above += 1;
            }
            let mut touching = above;
            while touching < above_end && self.runs[touching].from <= to {
                let (a, b) = (self.root(touching), self.root(here));
                let (first, last) = (a.min(b), a.max(b));
                self.runs[last].parent = first as u32;
                touching += 1;
            }
        }
    }

    fn root(&mut self, mut run: usize) -> usize {
        while self.runs[run].parent as usize != run {
            // Halves the path for the next one who comes by.
            let parent = self.runs[run].parent as usize;
            self.runs[run].parent = self.runs[parent].parent;
            run = self.runs[run].parent as usize;
        }
        run
    }

    fn gather(&mut self) {
        self.blobs.clear();
        self.index.clear();
        for i in 0..self.runs.len() {
            // A root comes before all others of its set.
            let root = self.root(i);
            let blob = if root == i { self.blobs.len() as u32 } else { self.index[root] };
            self.index.push(blob);
            if root == i {
                self.blobs.push(Blob::default());
            }
            let run = self.runs[i];
            self.blobs[blob as usize].add(&run);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A Bayer image that is red in the given quads.
    fn image(red: impl Fn(usize, usize) -> bool) -> Vec<u8> {
        let mut bayer = vec![20; WIDTH * HEIGHT];
        for y in 0..QUADS_HIGH {
            for x in 0..QUADS_WIDE {
                if red(x, y) {
                    bayer[2 * y * WIDTH + 2 * x + 1] = 200;
                }
            }
        }
        bayer
    }

    #[test]
    fn red_is_what_the_integer_test_says() {
        // Green, red, blue, and whether it passes: at each limit and one below.
        for (g, r, b, expected) in [
            (41, 70, 41, true),
            (40, 69, 40, false),
            (42, 70, 40, false),
            (40, 70, 42, false),
            (100, 170, 100, true),
            (0, 255, 0, true),
            (255, 255, 255, false),
        ] {
            let even = [[g, r]; QUADS_WIDE];
            let odd = [[b, g]; QUADS_WIDE];
            let mut red = [7; QUADS_WIDE];
            let flat = |rows: [[u8; 2]; QUADS_WIDE]| <[u8; WIDTH]>::try_from(rows.concat()).unwrap();
            red_row(&flat(even), &flat(odd), &mut red);
            assert!(red.iter().all(|x| *x == u8::from(expected)), "R {r} G {g} B {b}");
        }
    }

    #[test]
    fn a_u_is_one_blob_and_its_arms_join_late() {
        // Two arms that meet in their last row, and a corner that touches: all neighbours by side or corner.
        let shape = |x: usize, y: usize| {
            let arms = (10..20).contains(&y) && ((5..8).contains(&x) || (15..18).contains(&x));
            arms || (y == 20 && (5..18).contains(&x)) || (x == 18 && y == 21)
        };
        let mut finder = Finder::new();
        let blobs = finder.find(&image(shape));
        assert_eq!(blobs.len(), 1);
        let blob = blobs[0];
        assert_eq!((blob.x0, blob.y0, blob.x1, blob.y1, blob.area), (5, 10, 19, 22, 60 + 13 + 1));
        assert!(blob.sides_px().1 < 0.7, "{:?}", blob.sides_px());
    }

    #[test]
    fn moments_tell_sides_and_fill_of_a_rectangle_however_it_is_turned() {
        for turn in [0.0_f64, 0.3, 0.8] {
            let (sin, cos) = turn.sin_cos();
            let shape = |x: usize, y: usize| {
                let (dx, dy) = (x as f64 - 150.0, y as f64 - 100.0);
                (dx * cos + dy * sin).abs() <= 30.0 && (dy * cos - dx * sin).abs() <= 15.0
            };
            let mut finder = Finder::new();
            let blob = finder.find(&image(shape))[0];
            let ([long, short], fill) = blob.sides_px();
            // Whole quads: an edge is known to half a quad, a side to one.
            assert!((long - 122.0).abs() < 4.0 && (short - 62.0).abs() < 4.0, "{long} {short}");
            assert!((fill - 1.0).abs() < 0.02, "{fill}");
            let [x, y] = blob.centre_px();
            assert!((x - 300.5).abs() < 0.1 && (y - 200.5).abs() < 0.1, "{x} {y}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn blobs_are_those_of_a_flood_fill(seed in any::<u64>(), share in 0.02_f64..0.6) {
            let red: Vec<bool> = (0..QUADS_WIDE * QUADS_HIGH)
                .map(|i| {
                    // SplitMix64.
                    let mut x = seed.wrapping_add((i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
                    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
                    ((x ^ (x >> 31)) as f64 / u64::MAX as f64) < share
                })
                .collect();
            let mut expected = Vec::new();
            let mut seen = red.iter().map(|red| !red).collect::<Vec<_>>();
            for start in 0..red.len() {
                if seen[start] {
                    continue;
                }
                seen[start] = true;
                let (mut ahead, mut area) = (vec![start], 0_u64);
                while let Some(at) = ahead.pop() {
                    area += 1;
                    let (x, y) = (at % QUADS_WIDE, at / QUADS_WIDE);
                    for ny in y.saturating_sub(1)..=(y + 1).min(QUADS_HIGH - 1) {
                        for nx in x.saturating_sub(1)..=(x + 1).min(QUADS_WIDE - 1) {
                            let next = ny * QUADS_WIDE + nx;
                            if !seen[next] {
                                seen[next] = true;
                                ahead.push(next);
                            }
                        }
                    }
                }
                expected.push(area);
            }
            let mut finder = Finder::new();
            let found: Vec<u64> = finder
                .find(&image(|x, y| red[y * QUADS_WIDE + x]))
                .iter()
                .map(|blob| blob.area)
                .collect();
            prop_assert_eq!(found, expected);
        }
    }
}
