//! Streams from a Kinect through the driver. `kinect-client frames FOLDER COUNT` writes images as files, as `tests/freenect/client.c` does;
//! `kinect-client soak RIG SEED SECONDS` compares each pixel with the reel that the emulated lab shows. What it found is printed as JSON;
//! the exit code is 1 when a pixel was wrong.

use std::{
    fs,
    path::Path,
    process::ExitCode,
    thread,
    time::{Duration, Instant},
};

use bench_device::{DeviceError, Time};
use bench_emulated_lab::Reel;
use bench_kinect::{
    Frame, FrameSource,
    camera::Disparity,
    frame::{Mask, WIDTH},
    usb::{Settings, Streaming, Wanted, open},
};
use bench_rig::Rig;
use serde_json::json;

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match words.as_slice() {
        ["frames", folder, count] => {
            count.parse().map_err(Failure::from).and_then(|count| frames(Path::new(folder), count))
        }
        ["soak", rig, seed, seconds] => soak(rig, seed, seconds),
        _ => Err("kinect-client frames FOLDER COUNT, or kinect-client soak RIG SEED SECONDS".into()),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("kinect-client: {error}");
            ExitCode::from(2)
        }
    }
}

fn start() -> Result<(Streaming, Disparity), Failure> {
    let kinect = open(&Wanted::First)?;
    let law = Disparity::new(&kinect.blocks().applied(&bench_rig::Depth::default()), 1.0, 0.0);
    let began = Instant::now();
    let streaming = kinect
        .stream(Settings { exposure_s: Some(0.010), hold_white_balance: true }, move || {
            Time::from_seconds(began.elapsed().as_secs_f64())
        })?;
    Ok((streaming, law))
}

/// Calls `take` with each frame until it returns false.
fn each(
    streaming: &mut Streaming,
    mut take: impl FnMut(&Frame) -> Result<bool, Failure>,
) -> Result<(), Failure> {
    loop {
        match streaming.poll_frame()? {
            Some(frame) => {
                if !take(frame)? {
                    return Ok(());
                }
            }
            None => thread::sleep(Duration::from_millis(2)),
        }
    }
}

/// Bayer and raw depth of whole frames, and their depth in millimetres.
fn frames(folder: &Path, count: usize) -> Result<bool, Failure> {
    let (mut streaming, law) = start()?;
    let mut written = 0;
    each(&mut streaming, |frame| {
        if frame.colour_valid.is_whole() && frame.depth_valid.is_whole() {
            let words = |values: &mut dyn Iterator<Item = u16>| {
                values.flat_map(u16::to_le_bytes).collect::<Vec<u8>>()
            };
            let millimetres =
                |raw: &u16| law.depth_m(f64::from(*raw)).map_or(0.0, |z_m| z_m * 1000.0).round() as u16;
            fs::write(folder.join(format!("bayer-{}", frame.colour_ticks)), &frame.colour)?;
            fs::write(
                folder.join(format!("raw-{}", frame.depth_ticks)),
                words(&mut frame.depth.iter().copied()),
            )?;
            fs::write(
                folder.join(format!("mm-{}", frame.depth_ticks)),
                words(&mut frame.depth.iter().map(millimetres)),
            )?;
            written += 1;
        }
        Ok(written < count)
    })?;
    println!("{}", json!({ "frames": written }));
    Ok(true)
}

/// Kilobytes of memory that this process has in use.
fn resident_kb() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|rest| rest.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// Pixels that are said to be received and are not what was sent.
fn wrong_pixels<T: PartialEq>(found: &[T], sent: &[T], received: &Mask) -> u64 {
    let rows = found.chunks(WIDTH).zip(sent.chunks(WIDTH)).enumerate();
    // Most rows are right, and compared at once: the machine has other things to do.
    rows.filter(|(_, (found, sent))| found != sent)
        .map(|(y, (found, sent))| {
            let wrong = |x: &usize| found[*x] != sent[*x] && received.received(y * WIDTH + x);
            (0..WIDTH).filter(wrong).count() as u64
        })
        .sum()
}

fn soak(rig: &str, seed: &str, seconds: &str) -> Result<bool, Failure> {
    let reel = Reel::new(&Rig::load(rig)?, seed.parse()?)?;
    let seconds: f64 = seconds.parse()?;
    let (mut streaming, _) = start()?;
    let began = Instant::now();
    let (mut number, mut frames, mut whole, mut wrong, mut lost_pixels) = (0, 0_u64, 0_u64, 0_u64, 0_u64);
    // Memory is looked at once all buffers have been in use, and in the end.
    let mut early_kb = None;
    let mut gone = None;
    let ended = each(&mut streaming, |frame| {
        number = Reel::number(frame.colour_ticks, number);
        let truth = reel.content(number);
        frames += 1;
        whole += u64::from(frame.colour_valid.is_whole() && frame.depth_valid.is_whole());
        lost_pixels += (frame.colour_valid.lost() + frame.depth_valid.lost()) as u64;
        wrong += wrong_pixels(&frame.colour, &truth.colour, &frame.colour_valid)
            + wrong_pixels(&frame.depth, &truth.depth, &frame.depth_valid);
        let elapsed_s = began.elapsed().as_secs_f64();
        if elapsed_s > 0.2 * seconds {
            early_kb.get_or_insert_with(resident_kb);
        }
        Ok(elapsed_s < seconds)
    });
    match ended {
        Ok(()) => {}
        Err(error) => match error.downcast_ref() {
            Some(error @ (DeviceError::Gone { .. } | DeviceError::TimedOut { .. })) => {
                gone = Some(error.to_string());
            }
            _ => return Err(error),
        },
    }
    let statistics = streaming.statistics();
    let streams: Vec<_> = statistics
        .streams
        .iter()
        .map(|counts| {
            json!({
                "images": counts.images, "masked": counts.masked, "refused": counts.refused,
                "packets": counts.packets, "lost": counts.lost, "malformed": counts.malformed,
            })
        })
        .collect();
    println!(
        "{}",
        json!({
            "seconds": began.elapsed().as_secs_f64(), "frames": frames, "whole": whole, "wrong_pixels": wrong,
            "lost_pixels": lost_pixels, "colour": streams[0], "depth": streams[1], "unpaired": statistics.unpaired,
            "overrun": statistics.overrun, "drift": statistics.drift, "ended": gone,
            "resident_kb": { "early": early_kb, "end": resident_kb() },
        })
    );
    Ok(wrong == 0)
}
