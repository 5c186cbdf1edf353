//! Which Kinect, how it exposes, and what became of its frames: what several commands share.

use std::fmt::Write as _;

use bench_kinect::usb::{Settings, Statistics, Stream, Wanted};
use clap::Args;
use serde_json::{Value, json};

use crate::words;

/// Options of a Kinect.
#[derive(Args)]
#[group(skip)]
pub struct Eyes {
    /// Which Kinect: its index or its camera's serial number (`bench devices` lists them) [default: the first]
    #[arg(long, value_name = "INDEX|SERIAL")]
    kinect: Option<Wanted>,
    /// Expose each row of the colour image for so long, 0.055 to 33, and hold the white balance; else the Kinect chooses both
    #[arg(long, value_name = "MS", value_parser = exposure_ms)]
    exposure_ms: Option<f64>,
}

impl Eyes {
    /// Whether a Kinect was named.
    pub fn named(&self) -> bool {
        self.kinect.is_some()
    }

    /// Which Kinect.
    pub fn wanted(&self) -> Wanted {
        self.kinect.clone().unwrap_or_default()
    }

    /// How it exposes.
    pub fn settings(&self) -> Settings {
        let exposure_s = self.exposure_ms.map(|ms| ms / 1000.0);
        Settings { exposure_s, hold_white_balance: exposure_s.is_some() }
    }
}

fn exposure_ms(text: &str) -> Result<f64, String> {
    let longest_ms = Settings::LONGEST_S * 1000.0;
    match text.parse() {
        Ok(ms) if (0.055..=longest_ms).contains(&ms) => Ok(ms),
        _ => Err(format!("expected milliseconds from 0.055 to {longest_ms}")),
    }
}

/// What became of a Kinect's frames, for a person.
pub fn in_words(statistics: &Statistics) -> String {
    let Statistics { streams, frames, unpaired, overrun, drift } = statistics;
    let sum = |value: fn(&bench_kinect::usb::assembly::Counts) -> u64| streams.iter().map(value).sum();
    let mut out = words::count(*frames, "frame");
    for (number, what) in [
        (sum(|counts| counts.lost), "packet lost"),
        (sum(|counts| counts.masked), "image with pixels missing"),
        (sum(|counts| counts.refused), "image given up"),
        (*unpaired, "image without partner"),
        (*overrun, "image that came too fast"),
    ] {
        if number > 0 {
            let (one, rest) = what.split_once(' ').unwrap_or((what, ""));
            // Writing to a String cannot fail.
            let _ = write!(out, ", {} {rest}", words::count(number, one));
        }
    }
    format!("{out}; its clock {:+.0} ppm off the host's", -drift * 1e6)
}

/// The same for a program.
pub fn as_json(statistics: &Statistics) -> Value {
    let Statistics { streams, frames, unpaired, overrun, drift } = statistics;
    let stream = |which: Stream| {
        let counts = streams[which as usize];
        json!({
            "images": counts.images, "masked": counts.masked, "refused": counts.refused,
            "packets": counts.packets, "lost": counts.lost, "malformed": counts.malformed,
        })
    };
    json!({
        "frames": frames, "unpaired": unpaired, "overrun": overrun, "host_clock_drift": drift,
        "colour": stream(Stream::Colour), "depth": stream(Stream::Depth),
    })
}
