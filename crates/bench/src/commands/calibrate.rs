use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use anyhow::bail;
use bench_kinect::calibrate::{self, Band, GOAL_M, Report, read_places, read_reference};
use bench_rig::Uncertain;
use clap::Args;
use serde_json::json;

use crate::{
    arguments::{Force, Json, RigArgument},
    exit::Exit,
    files::{self, Form, Outputs},
    seen, words,
};

/// Find out where the camera stands and how it measures, from frames of the marker at measured places
#[derive(Args)]
#[command(after_help = "Examples:
  bench calibrate places.csv -o kinect.toml
  bench calibrate places.csv --moving flight/ --reference flight/reference.csv -o kinect-moving.toml
  bench calibrate places.csv --latency-s 0.213 -o kinect-timed.toml --json

The table has a row a place: folder (of recorded frames, beside the table), x_m, y_m, z_m of the
marker's centre. Name the result in the rig: `calibration = \"kinect.toml\"`. The rig given here
lends lenses, marker and a first guess of nothing else. Exit code 1 says that 5 mm is not met
(RMS of each axis, each place foretold by the others, over all places and in each half metre of
depth).")]
pub struct Arguments {
    /// Table of places (CSV)
    places: PathBuf,
    #[command(flatten)]
    rig: RigArgument,
    /// Calibration file to write
    #[arg(short, long)]
    output: PathBuf,
    /// Frames of a moving marker, for the latency
    #[arg(long, value_name = "FOLDER", requires = "reference")]
    moving: Option<PathBuf>,
    /// The marker's motion as something else measured it: CSV with a column `time_s` and the place
    #[arg(long, value_name = "CSV", requires = "moving")]
    reference: Option<PathBuf>,
    /// Latency as known otherwise, such as from `bench diagnose`
    #[arg(long, conflicts_with = "moving")]
    latency_s: Option<f64>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    let rig = arguments.rig.load()?;
    let start = seen::calibration(&rig, arguments.rig.path())?;
    Outputs::new(arguments.force.force)
        .and(arguments.output.as_path(), Form::Toml)
        .from([arguments.places.as_path()])
        .check()?;
    if arguments.latency_s.is_some_and(|latency_s| !(0.0..=1.0).contains(&latency_s)) {
        bail!("--latency-s must be from 0 to 1");
    }
    let mut looked = Vec::new();
    for place in read_places(&arguments.places)? {
        let seen = calibrate::look(&place, start)?;
        looked.push((place, seen));
    }
    let mut report = calibrate::calibrate(start, looked)?;
    let latency_s = match (&arguments.moving, &arguments.reference) {
        (Some(folder), Some(reference)) => {
            Some(calibrate::latency(&report.calibration, folder, &read_reference(reference)?)?)
        }
        _ => arguments.latency_s.map(Uncertain::exact),
    };
    // A rig states it to the microsecond.
    report.calibration.latency_s = latency_s.map(|latency_s| (latency_s.value * 1e6).round() / 1e6);
    let text = format!(
        "# Made by `bench calibrate` from {} places of {}.\n{}",
        report.places.len(),
        arguments.places.display(),
        report.calibration.to_toml()
    );
    files::write(&arguments.output, &text)?;
    if arguments.json.json {
        words::print_json(&as_json(&report, latency_s, &arguments.output))?;
    } else {
        words::print(&in_words(&report, latency_s, &arguments.output))?;
    }
    Ok(if report.met() { Exit::Done } else { Exit::CheckFailed })
}

fn in_words(report: &Report, latency_s: Option<Uncertain>, output: &Path) -> String {
    let c = &report.calibration;
    let mut out = String::new();
    let [x, y, z] = c.camera_position_m;
    let [heading, elevation, roll] = c.camera_attitude_rad.map(f64::to_degrees);
    // Writing to a String cannot fail.
    let _ = writeln!(out, "camera at ({x:.4}, {y:.4}, {z:.4}) m");
    let _ = writeln!(out, "  heading {heading:.2} deg, elevation {elevation:.2} deg, roll {roll:.2} deg");
    let _ = writeln!(
        out,
        "depth = {:.4} x {:+.4} m  (one sigma {:.4}, {:.4} m)",
        c.depth_scale.value, c.depth_bias_m.value, c.depth_scale.sigma, c.depth_bias_m.sigma
    );
    match latency_s {
        Some(latency) => {
            let _ = writeln!(
                out,
                "latency {:.4} s (one sigma {:.4} s); write latency_s = {} under [tracker] of the rig",
                latency.value,
                latency.sigma,
                c.latency_s.unwrap_or(latency.value)
            );
        }
        None => out += "latency not measured: --moving and --reference, or --latency-s\n",
    }
    let _ = writeln!(out, "\n{:<24} {:>7} {:>8}   tracked less measured, mm", "place", "found", "depth");
    for place in &report.places {
        let [x, y, z] = place.residual_m.map(|x| x * 1e3);
        let name = place.place.folder.file_name().map(|name| name.to_string_lossy().into_owned());
        let _ = writeln!(
            out,
            "{:<24} {:>7} {:>6.2} m {x:>8.2} {y:>8.2} {z:>8.2}",
            name.unwrap_or_default(),
            format!("{}/{}", place.seen.found, place.seen.frames),
            place.distance_m
        );
    }
    let _ = writeln!(out, "\n{:<24} {:>7}   RMS, mm (mean)", "depth", "places");
    for band in report.bands.iter().chain([&report.all]) {
        let figures: Vec<_> = (0..3)
            .map(|axis| format!("{:>6.2} ({:+.2})", band.rms_m[axis] * 1e3, band.bias_m[axis] * 1e3))
            .collect();
        let name = format!("{:.2} to {:.2} m", band.from_m, band.to_m);
        let _ = writeln!(out, "{name:<24} {:>7}   {}", band.places, figures.join("  "));
    }
    let verdict = if report.met() { "met" } else { "NOT MET" };
    let _ = writeln!(out, "{:.0} mm on each axis over the range: {verdict}", GOAL_M * 1e3);
    let _ = writeln!(out, "wrote {}", output.display());
    out
}

fn as_json(report: &Report, latency_s: Option<Uncertain>, output: &Path) -> serde_json::Value {
    let c = &report.calibration;
    let uncertain = |x: &Uncertain| json!({ "value": x.value, "sigma": x.sigma });
    let band = |band: &Band| {
        json!({
            "from_m": band.from_m, "to_m": band.to_m, "places": band.places,
            "bias_m": band.bias_m, "rms_m": band.rms_m,
        })
    };
    let places: Vec<_> = report
        .places
        .iter()
        .map(|place| {
            json!({
                "folder": place.place.folder, "measured_m": place.place.measured_m,
                "frames": place.seen.frames, "found": place.seen.found, "depth_m": place.distance_m,
                "depth_sigma_m": place.seen.z_sigma_m, "residual_m": place.residual_m,
            })
        })
        .collect();
    json!({
        "schema": "bench.calibrate/1",
        "output": output,
        "camera_position_m": c.camera_position_m,
        "camera_attitude_rad": c.camera_attitude_rad,
        "depth_scale": uncertain(&c.depth_scale),
        "depth_bias_m": uncertain(&c.depth_bias_m),
        "latency_s": latency_s.as_ref().map(uncertain),
        "goal_m": GOAL_M,
        "met": report.met(),
        "all": band(&report.all),
        "bands": report.bands.iter().map(band).collect::<Vec<_>>(),
        "places": places,
    })
}
