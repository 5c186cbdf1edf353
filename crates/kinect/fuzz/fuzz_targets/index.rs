//! Any bytes as the index and the files of a fakenect recording: read or refused, and names never lead out of the folder.

#![no_main]

use std::path::Path;

use bench_kinect::{
    fakenect::{parse_index, read_colour, read_depth},
    frame::PIXELS,
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    if let Ok(entries) = parse_index(Path::new("INDEX.txt"), &String::from_utf8_lossy(input)) {
        for entry in entries {
            assert!(entry.host_s.is_finite() && !entry.name.contains(['/', '\\']) && entry.line > 0);
        }
    }
    // A fuzzer's inputs are short: the header is its part, the pixels are given.
    let file = [input, &vec![7; PIXELS * 3]].concat();
    let (mut bayer, mut depth) = (vec![0; PIXELS], vec![0; PIXELS]);
    let _ = read_colour(&file, &mut bayer);
    let _ = read_depth(&file[..file.len() - PIXELS], &mut depth);
});
