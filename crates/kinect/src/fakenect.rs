//! Recorded frames in the folder format of libfreenect's `fakenect-record` and `fakenect`, both ways.
//!
//! A folder holds `INDEX.txt` with a file name a line, and the files: `T-<host seconds>-<device ticks>.ext`, with `r-*.ppm` (P6,
//! the Bayer image demosaiced), `d-*.pgm` (P5 that states 65535 but holds raw 11-bit values, little-endian) and `a-*.dump`
//! (accelerometer). What a recording of this bench holds that the format cannot say: which pixels were lost. Lost depth is
//! written as no reading.

use std::{
    fs::{self, File},
    io::{BufWriter, Write},
    path::{Path, PathBuf},
};

use bench_device::{DeviceError, Time};

use crate::{
    KinectError,
    frame::{
        Frame, FrameSource, HEIGHT, NO_READING, PIXELS, TICKS_PER_S, TickClock, WIDTH, demosaic, mosaic,
    },
};

/// The index's name.
pub const INDEX: &str = "INDEX.txt";
/// Two images whose device times differ by more than half a frame do not belong together, ticks.
const SAME_FRAME_TICKS: i64 = (TICKS_PER_S / 60.0) as i64;

/// The longest latency of the tracking chain that a rig may state, s.
const LEAD_S: f64 = 1.0;

/// What a file of a recording holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Colour, RGB.
    Colour,
    /// Raw depth.
    Depth,
    /// Accelerometer and tilt.
    Tilt,
    /// Something that this bench does not use, such as infra-red.
    Other,
}

/// A line of the index.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Its line, counted from one.
    pub line: usize,
    /// The file's name.
    pub name: String,
    /// What the file holds.
    pub kind: Kind,
    /// Host time of arrival, s.
    pub host_s: f64,
    /// Device time, 60 MHz.
    pub ticks: u32,
}

/// Reads an index; `path` is for the messages. Empty lines are passed over.
pub fn parse_index(path: &Path, text: &str) -> Result<Vec<Entry>, KinectError> {
    let mut entries = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim_end_matches('\r');
        if !line.is_empty() {
            let entry = parse_line(number + 1, line).map_err(|detail| KinectError::Recording {
                path: path.to_owned(),
                line: number + 1,
                detail,
            })?;
            entries.push(entry);
        }
    }
    Ok(entries)
}

fn parse_line(line: usize, name: &str) -> Result<Entry, String> {
    let wrong = |what: &str| {
        let shown: String = name.chars().take(60).collect();
        format!("{shown:?} {what}; expected a name like r-1290000000.123456-2000000.ppm")
    };
    let (stem, ending) = name.rsplit_once('.').ok_or_else(|| wrong("has no ending"))?;
    if ending.is_empty() || !ending.bytes().all(|byte| byte.is_ascii_alphanumeric()) {
        return Err(wrong("has an odd ending"));
    }
    let mut parts = stem.split('-');
    let (Some(letter), Some(host), Some(ticks), None) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(wrong("does not have three parts"));
    };
    if !host.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') {
        return Err(wrong("has no host time"));
    }
    let host_s = host.parse::<f64>().ok().filter(|seconds| seconds.is_finite() && *seconds < 1e11);
    let host_s = host_s.ok_or_else(|| wrong("has no host time"))?;
    let ticks = ticks.parse().map_err(|_| wrong("has no device time of 32 bits"))?;
    let kind = match (letter, ending) {
        ("r", "ppm") => Kind::Colour,
        ("d", "pgm") => Kind::Depth,
        ("a", "dump") => Kind::Tilt,
        (letter, _) if letter.len() == 1 && letter.bytes().all(|byte| byte.is_ascii_alphanumeric()) => {
            Kind::Other
        }
        _ => return Err(wrong("does not begin with a letter")),
    };
    Ok(Entry { line, name: name.to_owned(), kind, host_s, ticks })
}

/// Reads a colour file into Bayer.
pub fn read_colour(file: &[u8], bayer: &mut [u8]) -> Result<(), String> {
    let data = image_data(file, *b"P6", &[255])?;
    let expected = PIXELS * 3;
    if data.len() != expected {
        return Err(format!("holds {} bytes of colour, expected {expected}; was it cut?", data.len()));
    }
    mosaic(data, bayer).map_err(|error| error.to_string())
}

/// Reads a depth file.
pub fn read_depth(file: &[u8], depth: &mut [u16]) -> Result<(), String> {
    let data = image_data(file, *b"P5", &[65535, 2047])?;
    let expected = PIXELS * 2;
    if data.len() != expected || depth.len() != PIXELS {
        return Err(format!("holds {} bytes of depth, expected {expected}; was it cut?", data.len()));
    }
    for (out, bytes) in depth.iter_mut().zip(data.as_chunks::<2>().0) {
        *out = u16::from_le_bytes(*bytes);
        if *out > NO_READING {
            return Err(format!(
                "holds the depth {out}, more than 11 bits; record raw depth (11 bit), not millimetres"
            ));
        }
    }
    Ok(())
}

/// What comes after the header of a binary portable image of the right size.
fn image_data<'a>(file: &'a [u8], magic: [u8; 2], depths: &[usize]) -> Result<&'a [u8], String> {
    let rest = file.strip_prefix(&magic).ok_or_else(|| {
        format!("is not a portable image that begins with {}", String::from_utf8_lossy(&magic))
    })?;
    let mut numbers = [0; 3];
    let mut at = 0;
    for number in &mut numbers {
        // White space and comments before each number.
        loop {
            match rest.get(at) {
                Some(byte) if byte.is_ascii_whitespace() => at += 1,
                Some(b'#') => {
                    at += rest[at..].iter().position(|byte| *byte == b'\n').unwrap_or(rest.len() - at);
                }
                _ => break,
            }
        }
        let digits = rest[at..].iter().take(6).take_while(|byte| byte.is_ascii_digit()).count();
        *number = rest[at..at + digits].iter().fold(0, |sum, digit| 10 * sum + usize::from(digit - b'0'));
        if digits == 0 {
            return Err("has a header that does not give width, height and depth".to_owned());
        }
        at += digits;
    }
    let [width, height, depth] = numbers;
    if (width, height) != (WIDTH, HEIGHT) || !depths.contains(&depth) {
        return Err(format!(
            "is {width} x {height} with values to {depth}, expected {WIDTH} x {HEIGHT} to {}",
            depths[0]
        ));
    }
    match rest.get(at) {
        Some(byte) if byte.is_ascii_whitespace() => Ok(&rest[at + 1..]),
        _ => Err("ends within its header".to_owned()),
    }
}

/// A folder of recorded frames, as a source of them: each colour image with the depth image nearest in device time.
///
/// Frames come as fast as they are asked for. Their arrival is the host time since a second before the first frame, so that
/// exposures, which come before arrivals, have a time as well.
pub struct Replay {
    folder: PathBuf,
    pairs: Vec<(Entry, Entry)>,
    unpaired: usize,
    next: usize,
    frame: Frame,
}

impl Replay {
    /// Opens a folder and reads its index.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self, KinectError> {
        let folder = folder.as_ref().to_owned();
        let path = folder.join(INDEX);
        let text = fs::read(&path).map_err(|reason| KinectError::File {
            action: "read",
            path: path.clone(),
            reason,
        })?;
        let entries = parse_index(&path, &String::from_utf8_lossy(&text))?;
        let (pairs, unpaired) = pair(&entries);
        if pairs.is_empty() {
            let detail = format!(
                "no colour image has a depth image of the same time among {} files; record both streams",
                entries.len()
            );
            return Err(KinectError::Recording { path, line: 1, detail });
        }
        Ok(Self { folder, pairs, unpaired, next: 0, frame: Frame::default() })
    }

    /// How many frames there are.
    pub fn frames(&self) -> usize {
        self.pairs.len()
    }

    /// How many images have no partner and are left out.
    pub fn unpaired(&self) -> usize {
        self.unpaired
    }

    /// Host time from which arrivals count, s.
    pub fn origin_s(&self) -> f64 {
        let (colour, depth) = &self.pairs[0];
        colour.host_s.max(depth.host_s) - LEAD_S
    }

    /// The next frame; `None` after the last.
    pub fn next_frame(&mut self) -> Result<Option<&Frame>, KinectError> {
        let Some((colour, depth)) = self.pairs.get(self.next) else { return Ok(None) };
        self.next += 1;
        let wrong = |entry: &Entry, detail: String| KinectError::Recording {
            path: self.folder.join(INDEX),
            line: entry.line,
            detail: format!("{} {detail}", entry.name),
        };
        let read = |entry: &Entry| {
            let path = self.folder.join(&entry.name);
            fs::read(&path).map_err(|reason| wrong(entry, format!("cannot be read: {reason}")))
        };
        let frame = &mut self.frame;
        read_colour(&read(colour)?, &mut frame.colour).map_err(|detail| wrong(colour, detail))?;
        read_depth(&read(depth)?, &mut frame.depth).map_err(|detail| wrong(depth, detail))?;
        frame.colour_ticks = colour.ticks;
        frame.depth_ticks = depth.ticks;
        let (first_colour, first_depth) = &self.pairs[0];
        let origin_s = first_colour.host_s.max(first_depth.host_s) - LEAD_S;
        frame.arrived_at = Time::from_seconds(colour.host_s.max(depth.host_s) - origin_s);
        Ok(Some(&self.frame))
    }
}

impl FrameSource for Replay {
    fn poll_frame(&mut self) -> Result<Option<&Frame>, DeviceError> {
        self.next_frame()
            .map_err(|error| DeviceError::Gone { device: "recording of frames", detail: error.to_string() })
    }
}

/// Each colour image with the nearest depth image; and how many images are left.
fn pair(entries: &[Entry]) -> (Vec<(Entry, Entry)>, usize) {
    let mut clock = TickClock::default();
    let mut depths: Vec<(i64, &Entry)> = Vec::new();
    let mut colours: Vec<(i64, &Entry)> = Vec::new();
    for entry in entries.iter().filter(|entry| matches!(entry.kind, Kind::Colour | Kind::Depth)) {
        let ticks = (clock.seconds(entry.ticks) * TICKS_PER_S).round() as i64;
        if entry.kind == Kind::Colour { colours.push((ticks, entry)) } else { depths.push((ticks, entry)) }
    }
    depths.sort_by_key(|(ticks, _)| *ticks);
    let mut pairs: Vec<(Entry, Entry)> = Vec::new();
    let mut taken = vec![false; depths.len()];
    for (ticks, colour) in &colours {
        let after = depths.partition_point(|(other, _)| other < ticks);
        let nearest = [after.wrapping_sub(1), after]
            .into_iter()
            .filter(|i| *i < depths.len() && !taken[*i])
            .min_by_key(|i| (depths[*i].0 - ticks).abs());
        if let Some(i) = nearest.filter(|i| (depths[*i].0 - ticks).abs() <= SAME_FRAME_TICKS) {
            taken[i] = true;
            pairs.push(((*colour).clone(), depths[i].1.clone()));
        }
    }
    let unpaired = colours.len() + depths.len() - 2 * pairs.len();
    (pairs, unpaired)
}

/// Writes frames into a new folder.
pub struct Recorder {
    folder: PathBuf,
    index: BufWriter<File>,
    host_s: f64,
    rgb: Vec<u8>,
    bytes: Vec<u8>,
    frames: usize,
}

impl Recorder {
    /// Makes the folder. `host_s` is the host time at which frames' arrival counts from, s since 1970.
    pub fn create(folder: impl AsRef<Path>, host_s: f64) -> Result<Self, KinectError> {
        let folder = folder.as_ref().to_owned();
        fs::create_dir_all(&folder).map_err(|reason| KinectError::File {
            action: "make the folder",
            path: folder.clone(),
            reason,
        })?;
        let path = folder.join(INDEX);
        let index = File::create_new(&path).map_err(|reason| {
            if reason.kind() == std::io::ErrorKind::AlreadyExists {
                KinectError::Exists { path: folder.clone() }
            } else {
                KinectError::File { action: "write", path: path.clone(), reason }
            }
        })?;
        let rgb = vec![0; PIXELS * 3];
        Ok(Self { folder, index: BufWriter::new(index), host_s, rgb, bytes: Vec::new(), frames: 0 })
    }

    /// Adds a frame: a colour and a depth file, then their lines of the index, so that the index never names what is not there.
    pub fn write(&mut self, frame: &Frame) -> Result<(), KinectError> {
        let host_s = self.host_s + frame.arrived_at.seconds();
        demosaic(&frame.colour, &mut self.rgb)?;
        self.bytes.clear();
        self.bytes.extend_from_slice(format!("P6 {WIDTH} {HEIGHT} 255\n").as_bytes());
        self.bytes.extend_from_slice(&self.rgb);
        self.file(&format!("r-{host_s:.6}-{}.ppm", frame.colour_ticks))?;
        self.bytes.clear();
        self.bytes.extend_from_slice(format!("P5 {WIDTH} {HEIGHT} 65535\n").as_bytes());
        for (pixel, raw) in frame.depth.iter().enumerate() {
            let raw = if frame.depth_valid.received(pixel) { *raw } else { NO_READING };
            self.bytes.extend_from_slice(&raw.to_le_bytes());
        }
        self.file(&format!("d-{host_s:.6}-{}.pgm", frame.depth_ticks))?;
        self.frames += 1;
        // Who is killed while recording loses nothing.
        self.index.flush().map_err(|reason| self.index_error(reason))
    }

    fn file(&mut self, name: &str) -> Result<(), KinectError> {
        let path = self.folder.join(name);
        fs::write(&path, &self.bytes).map_err(|reason| KinectError::File {
            action: "write",
            path,
            reason,
        })?;
        writeln!(self.index, "{name}").map_err(|reason| self.index_error(reason))
    }

    /// Completes the index; returns how many frames were written.
    pub fn finish(mut self) -> Result<usize, KinectError> {
        self.index.flush().map_err(|reason| self.index_error(reason))?;
        Ok(self.frames)
    }

    fn index_error(&self, reason: std::io::Error) -> KinectError {
        KinectError::File { action: "write", path: self.folder.join(INDEX), reason }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn entries(text: &str) -> Vec<Entry> {
        parse_index(Path::new("INDEX.txt"), text).unwrap()
    }

    #[test]
    fn names_as_libfreenect_writes_them_are_read() {
        let read = entries(
            "d-1290000000.123456-4294967295.pgm\nr-1290000000.150000-7.ppm\r\na-1.5-0.dump\n\ni-2.0-1.pgm",
        );
        let kinds: Vec<_> = read.iter().map(|entry| entry.kind).collect();
        assert_eq!(kinds, [Kind::Depth, Kind::Colour, Kind::Tilt, Kind::Other]);
        assert_eq!((read[0].host_s, read[0].ticks, read[3].line), (1_290_000_000.123_456, u32::MAX, 5));
    }

    #[test]
    fn wrong_lines_are_named() {
        for line in [
            "r-1.0-4294967296.ppm",
            "r-x-1.ppm",
            "../r-1-1.ppm",
            "r-1-1",
            "r-1.ppm",
            "r-1e400-1.ppm",
            "-1-1.ppm",
        ] {
            let text = format!("d-1.0-1.pgm\n{line}");
            let error = parse_index(Path::new("f/INDEX.txt"), &text).unwrap_err().to_string();
            assert!(error.starts_with("f/INDEX.txt:2: "), "{line}: {error}");
        }
    }

    #[test]
    fn images_find_their_partner_across_the_wrap_of_the_device_clock() {
        let read = entries(
            "d-1.0-4294900000.pgm\nr-1.0-4294960000.ppm\nr-1.03-1940000.ppm\nd-1.03-1950000.pgm\nr-1.06-3940000.ppm",
        );
        let (pairs, unpaired) = pair(&read);
        let lines: Vec<_> = pairs.iter().map(|(colour, depth)| (colour.line, depth.line)).collect();
        assert_eq!(lines, [(2, 1), (3, 4)]);
        assert_eq!(unpaired, 1);
    }

    #[test]
    fn frames_survive_being_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut frame = Frame::default();
        for (i, (colour, depth)) in frame.colour.iter_mut().zip(&mut frame.depth).enumerate() {
            *colour = (i * 31 % 251) as u8;
            *depth = (i * 7 % 2048) as u16;
        }
        frame.colour_ticks = 5;
        frame.depth_ticks = 60_005;
        let mut recorder = Recorder::create(folder.path(), 1e9).unwrap();
        recorder.write(&frame).unwrap();
        let first = frame.clone();
        frame.depth_valid.lose(1000..1010);
        (frame.colour_ticks, frame.depth_ticks) = (2_000_005, 2_060_005);
        frame.arrived_at = Time::from_seconds(1.0 / 30.0);
        recorder.write(&frame).unwrap();
        assert_eq!(recorder.finish().unwrap(), 2);

        let mut replay = Replay::open(folder.path()).unwrap();
        assert_eq!((replay.frames(), replay.unpaired(), replay.origin_s()), (2, 0, 1e9 - 1.0));
        let first = Frame { arrived_at: Time::from_seconds(1.0), ..first };
        assert!(replay.next_frame().unwrap() == Some(&first));
        let second = replay.next_frame().unwrap().unwrap();
        assert!(second.colour == frame.colour && second.depth[1000..1010] == [NO_READING; 10]);
        // Names hold microseconds.
        assert!((second.arrived_at.since_s(frame.arrived_at) - 1.0).abs() < 1e-6);
        assert!(replay.next_frame().unwrap().is_none());
        assert!(matches!(Recorder::create(folder.path(), 0.0), Err(KinectError::Exists { .. })));
    }

    #[test]
    fn files_that_are_cut_or_in_other_units_are_refused_with_what_to_do() {
        let mut depth = vec![0; PIXELS];
        let whole =
            |value: u16| [b"P5 640 480 65535\n".as_slice(), &value.to_le_bytes().repeat(PIXELS)].concat();
        assert_eq!(read_depth(&whole(2047), &mut depth), Ok(()));
        assert!(read_depth(&whole(2048), &mut depth).unwrap_err().contains("millimetres"));
        assert!(read_depth(&whole(7)[..1000], &mut depth).unwrap_err().contains("was it cut"));
        assert!(read_depth(b"P5 320 240 65535\n", &mut depth).unwrap_err().contains("320 x 240"));
        assert!(read_depth(b"P6 640", &mut depth).is_err());
        let commented = [b"P5\n# by hand\n640 480\n65535\n".as_slice(), &vec![0; PIXELS * 2]].concat();
        assert_eq!(read_depth(&commented, &mut depth), Ok(()));
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "[rda\\-0-9.pgmxe\n/\u{e9}]{0,80}") {
            if let Ok(read) = parse_index(Path::new("x"), &text) {
                for entry in read {
                    prop_assert!(entry.host_s.is_finite() && !entry.name.contains('/'));
                }
            }
        }

        #[test]
        fn any_bytes_are_an_image_or_refused(header in "P[56][ #\n0-9]{0,30}", data in prop::collection::vec(any::<u8>(), 0..64)) {
            let file = [header.as_bytes(), &data].concat();
            // Too short for an image whatever the header says.
            prop_assert!(read_depth(&file, &mut vec![0; PIXELS]).is_err());
            prop_assert!(read_colour(&file, &mut vec![0; PIXELS]).is_err());
        }
    }
}
