//! Recordings: closed, whole to the end, with a rig and a mission that can be read.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use bench_device::Time;
use bench_recording::{Channel, Info, Recording, RecordingError};
use bench_rig::Mission;

use super::{Checked, Told, told, toml};
use crate::words;

/// Checks a recording.
pub fn check(file: &Path) -> Checked {
    let mut checked = Checked { words: "a recording", ..Checked::default() };
    let info = match Info::read(file) {
        Ok(info) => info,
        Err(error) => {
            // An MCAP file from elsewhere is no recording of the bench.
            let foreign = matches!(error, RecordingError::NotBench { .. });
            checked.kind = (!foreign).then_some("recording");
            checked.fail(file, &error);
            return checked;
        }
    };
    checked.kind = Some("recording");
    if info.recovered {
        checked.notes.push("it was recovered; its end may be missing".to_owned());
    }
    if let Some(dropped) = info.dropped.filter(|dropped| *dropped > 0) {
        let what =
            format!("{} found the recorder's queue full and are lost", words::count(dropped, "record"));
        checked.lose(Told::of(file, what));
    }
    match Recording::open(file) {
        Ok(recording) => read(file, &recording, &mut checked),
        Err(error) => checked.fail(file, &error),
    }
    checked
}

impl Checked {
    /// A problem that data was lost by.
    fn lose(&mut self, problem: Told) {
        // A file that has problems of another kind, too, is no sound input in the first place.
        self.data_lost = self.problems.is_empty() || self.data_lost;
        self.problems.push(problem);
    }

    /// A problem of another kind.
    fn add(&mut self, problem: Told) {
        self.data_lost = false;
        self.problems.push(problem);
    }

    fn add_all(&mut self, problems: Vec<Told>) {
        for problem in problems {
            self.add(problem);
        }
    }

    fn fail(&mut self, file: &Path, error: &RecordingError) {
        let words = error.to_string();
        let words = words.strip_prefix(&file.display().to_string()).unwrap_or(&words);
        let words = words.trim_start_matches([':', ' ']);
        let (what, hint) = words.split_once("; ").map_or((words, None), |(what, hint)| (what, Some(hint)));
        let problem = Told { hint: hint.map(str::to_owned), ..Told::of(file, what) };
        match error {
            RecordingError::Unfinished { .. } | RecordingError::Damaged { .. } => self.lose(problem),
            _ => self.add(problem),
        }
    }
}

fn read(file: &Path, recording: &Recording, checked: &mut Checked) {
    let session = recording.session();
    let inside = |name: &str| PathBuf::from(format!("{}/{name}", file.display()));
    match &session.rig_toml {
        Some(text) => checked.add_all(toml::rig(&inside("rig.toml"), text)),
        None => checked.notes.push("no rig is attached".to_owned()),
    }
    if let Some(text) = &session.mission_toml
        && let Err(error) = Mission::read(&inside("mission.toml"), text)
    {
        checked.add_all(told(&error));
    }
    messages(file, recording, checked);
}

/// Every message can be read, none is missing, and time does not go back within a channel.
fn messages(file: &Path, recording: &Recording, checked: &mut Checked) {
    let records = match recording.records() {
        Ok(records) => records,
        Err(error) => return checked.fail(file, &error),
    };
    // How many messages, the latest time, and the first message that goes back behind it.
    let mut seen: BTreeMap<&str, (Channel, u64, Time, Option<Time>)> = BTreeMap::new();
    for record in records {
        let record = match record {
            Ok(record) => record,
            Err(error) => return checked.fail(file, &error),
        };
        let (channel, time) = (record.channel(), record.time());
        let (_, count, latest, back) = seen.entry(channel.topic()).or_insert((channel, 0, time, None));
        *count += 1;
        if time < *latest && back.is_none() {
            *back = Some(time);
        }
        *latest = time.max(*latest);
    }
    for (topic, (channel, count, _, back)) in seen {
        if let Some(time) = back {
            checked
                .add(Told::of(file, format!("time goes back in {topic}, first to {:.6} s", time.seconds())));
        }
        let expected = recording.count(channel);
        if expected != count {
            let what = format!("{topic} holds {count} of {}", words::count(expected, "message"));
            checked
                .lose(Told::of(file, what).hint("`bench recover` makes a whole recording of what is there"));
        }
    }
}
