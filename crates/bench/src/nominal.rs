//! The nominal model that flights make: identified from them, and held against those of them that were left out.

use std::path::PathBuf;

use anyhow::Context;
use bench_diagnosis::{Calibration, Fold, held_out};
use bench_filter::Track;
use bench_identification::{
    Block, FlightIdentification, LEAST_FLIGHTS, NominalLaw, identify_flights, identify_nominal,
};
use bench_inference::Problem;
use bench_rig::Rig;
use serde::Serialize;

use crate::{commands::tracks::Selection, diagnosis::told, progress::Progress, words};

/// A nominal model and how it does on nominal flights. As JSON it is `bench.identification/1` (docs/identify.md).
#[derive(Serialize)]
pub struct NominalModel {
    #[serde(flatten)]
    pub found: FlightIdentification,
    /// Time between measurements that count, s: before and after.
    pub frame_period_s: [f64; 2],
    /// Nominal flights held against the model of the others; empty where there are too few.
    pub control: Vec<Fold>,
}

/// What is told of the model beside a diagnosis.
#[derive(Debug, Serialize)]
pub struct ModelTold {
    /// The nominal flights.
    pub flights: Vec<String>,
    /// Laws of the library that belong to the model.
    pub laws: Vec<NominalLaw>,
    /// Nominal flights held against the model of the others.
    pub control: Vec<Fold>,
}

impl NominalModel {
    /// Identifies the model from flights as a prior rig sees them, holds flights that are left out against the model of the others, and
    /// keeps in its rig what hypotheses gain there. What could not be used is among the warnings.
    pub fn of(
        flights: &[PathBuf],
        selection: &Selection,
        prior: &Rig,
        progress: &Progress,
    ) -> anyhow::Result<Self> {
        let mut prior = prior.clone();
        let frame_period_s = prior.tracker.frame_period_s;
        let (mut tracks, unused) = selection.tracks(flights, &prior, |_, _| ())?;
        if let Some(white) = with_white_period(flights, &tracks, selection, &prior, progress)? {
            (prior, tracks) = white;
        }
        let count = words::count(tracks.len() as u64, "flight");
        progress.begin_untold(&format!("fitting the rig and its laws to {count}"));
        let mut found = identify_nominal(&tracks, &prior).with_context(|| match unused.as_slice() {
            [] => "no model of the nominal flights".to_owned(),
            unused => format!("no model of the nominal flights; not used:\n{}", unused.join("\n")),
        })?;
        found.warnings.splice(0..0, unused);
        let mut control = Vec::new();
        for (index, Block { flights: own, rig }) in found.blocks.iter().enumerate() {
            progress.begin_untold(&format!(
                "nominal against nominal, block {} of {}",
                index + 1,
                found.blocks.len()
            ));
            // When they were exposed is reckoned by the latency of the model that they are held against.
            let is_left_out = |path: &&PathBuf| {
                tracks[own.clone()].iter().any(|own| own.name == path.display().to_string())
            };
            let left_out: Vec<PathBuf> = flights.iter().filter(is_left_out).cloned().collect();
            let (left_out, _) = selection.tracks(&left_out, rig, |_, _| ())?;
            if !left_out.is_empty() {
                control.push(Fold::of(&Problem::new(&left_out, rig), &Calibration::built_in()));
            }
        }
        found.rig.held_out = held_out(&control);
        let frame_period_s = [frame_period_s, prior.tracker.frame_period_s];
        Ok(Self { found, frame_period_s, control })
    }

    /// Whether most nominal flights that were left out show nothing, as they should; also where none could be left out.
    pub fn holds(&self) -> bool {
        self.control.is_empty()
            || 2 * self.control.iter().filter(|fold| fold.is_none()).count() > self.control.len()
    }

    /// What is told of it beside a diagnosis.
    pub fn told(self) -> ModelTold {
        let flights = self.found.flights.into_iter().map(|(name, _)| name).collect();
        ModelTold { flights, laws: self.found.laws, control: self.control }
    }
}

/// Errors of measurements that are further apart are no matter of the tracker, s.
const LONGEST_PERIOD_S: f64 = 1.0;

/// The rig with the time that rows of a log must be apart for their errors not to follow one another, and the flights as it sees them: twice
/// as far again until the innovations are white. `None` where the rows are the tracker's own frames, and where they are never white.
fn with_white_period(
    flights: &[PathBuf],
    tracks: &[Track],
    selection: &Selection,
    prior: &Rig,
    progress: &Progress,
) -> anyhow::Result<Option<(Rig, Vec<Track>)>> {
    // Rows of one time tell nothing.
    let rows_s = tracks.iter().filter_map(|track| track.dense_s).fold(0.0, f64::max);
    if rows_s <= 0.0 {
        return Ok(None);
    }
    let mut rig = prior.clone();
    let periods_s =
        (0..).map(|k| rows_s * f64::from(1 << k)).take_while(|period_s| *period_s <= LONGEST_PERIOD_S);
    for period_s in periods_s {
        progress.begin_untold(&format!(
            "measurements {} s apart: are their errors their own?",
            words::short(period_s)
        ));
        rig.tracker.frame_period_s = period_s;
        let (tracks, _) = selection.tracks(flights, &rig, |_, _| ())?;
        // What is wrong with the flights is told by the identification that follows.
        if identify_flights(&tracks, &rig).is_ok_and(|found| found.is_white()) {
            return Ok(Some((rig, tracks)));
        }
    }
    Ok(None)
}

/// File names without folders.
fn named<'a>(flights: impl Iterator<Item = &'a str>) -> String {
    flights.map(words::file_name).collect::<Vec<_>>().join(", ")
}

/// What belongs to a model and how it does on nominal flights, in lines.
pub fn in_words(laws: &[NominalLaw], control: &[Fold]) -> Vec<String> {
    [laws_in_words(laws), control_in_words(control)].concat()
}

/// Laws in words, such as `tilt-loss: fraction = 0.65`.
pub fn laws_in_words(laws: &[NominalLaw]) -> Vec<String> {
    laws.iter()
        .map(|law| {
            let parameters: Vec<String> = law
                .parameters
                .iter()
                .map(|(key, value)| format!("{key} = {}", words::short(*value)))
                .collect();
            format!(
                "{} belongs to the model: {} ({:.0} nats on flights left out of the fit)",
                law.name,
                parameters.join(", "),
                law.held_out_gain
            )
        })
        .collect()
}

/// The control in words, a line a block, the wrong ones first.
pub fn control_in_words(control: &[Fold]) -> Vec<String> {
    if control.is_empty() {
        return vec![format!(
            "nominal against nominal: not checked, for that takes {LEAST_FLIGHTS} flights or more"
        )];
    }
    let right = control.iter().filter(|fold| fold.is_none()).count();
    let mut lines = vec![format!(
        "nominal against nominal: `none` in {right} of {}; what the others gain there is taken off what they gain elsewhere",
        control.len()
    )];
    let (wrong, right): (Vec<_>, Vec<_>) = control.iter().partition(|fold| !fold.is_none());
    lines.extend(wrong.into_iter().chain(right).map(|fold| {
        let gain = fold.gains.iter().map(|gain| gain.nats).fold(0.0, f64::max);
        format!(
            "  {}: {} {} (at most {gain:.0} nats)",
            named(fold.flights.iter().map(String::as_str)),
            fold.leading,
            told::percent(fold.probability)
        )
    }));
    lines
}
