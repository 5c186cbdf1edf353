//! The log as its users rely on it: names that are never given twice, several writers, a killed run, a full file system.

use std::{collections::BTreeMap, path::Path};

use bench_station::{Begun, Entry, Filter, Finished, Log, StationError};

fn entry(test: &str, started_unix_s: f64) -> Entry {
    Entry {
        started_unix_s,
        suite: "lab".to_owned(),
        test: test.to_owned(),
        rig: "loopback".to_owned(),
        mission: "climb-040".to_owned(),
        mode: "loopback".to_owned(),
        seed: u64::MAX,
        ..Entry::default()
    }
}

fn begin(log: &mut Log, test: &str, started_unix_s: f64) -> Begun {
    let meta = BTreeMap::from([("operator".to_owned(), test.to_owned())]);
    log.begin(&entry(test, started_unix_s), &meta, "same").unwrap()
}

fn passed(value: f64) -> Finished {
    Finished {
        outcome: "passed".to_owned(),
        took_s: 1.5,
        sha256: Some("00ff".to_owned()),
        figures: BTreeMap::from([("peak".to_owned(), value)]),
        ..Finished::default()
    }
}

/// 25 November 2026, 15:00 UTC.
const NOW: f64 = 1_795_618_800.0;

#[test]
fn a_run_is_entered_finished_found_and_its_recording_has_a_name_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let mut log = Log::open(folder.path()).unwrap();
    let first = begin(&mut log, "a", NOW);
    let second = begin(&mut log, "b", NOW + 60.0);
    assert_ne!(first.recording, second.recording);
    assert!(first.recording.ends_with(Path::new("recordings/2026-11/000001_same.mcap")), "{first:?}");
    assert!(first.recording.parent().unwrap().is_dir());
    log.finish(second.id, &passed(0.4)).unwrap();
    drop(log);

    let log = Log::read(folder.path()).unwrap();
    let runs = log.runs(&Filter::default(), None).unwrap();
    assert_eq!(
        runs.iter().map(|run| run.entry.test.as_str()).collect::<Vec<_>>(),
        ["b", "a"],
        "the latest first"
    );
    // The first was killed.
    assert_eq!((runs[1].outcome.as_str(), runs[1].took_s), ("begun", None));
    assert_eq!(
        (runs[0].outcome.as_str(), runs[0].took_s, runs[0].entry.seed),
        ("passed", Some(1.5), u64::MAX)
    );
    assert_eq!(runs[0].started_utc, "2026-11-25T15:01:00Z");
    assert_eq!(log.figures(second.id).unwrap()["peak"], 0.4);
    assert_eq!(log.meta(first.id).unwrap()["operator"], "a");

    let found = |filter: &Filter| log.count(filter).unwrap();
    assert_eq!(found(&Filter { test: Some("a".to_owned()), ..Filter::default() }), 1);
    assert_eq!(found(&Filter { outcome: Some("passed".to_owned()), ..Filter::default() }), 1);
    assert_eq!(found(&Filter { since_unix_s: Some(NOW + 1.0), ..Filter::default() }), 1);
    assert_eq!(found(&Filter { before_unix_s: Some(NOW), ..Filter::default() }), 0);
    let meta = vec![("operator".to_owned(), "b".to_owned())];
    assert_eq!(found(&Filter { meta, ..Filter::default() }), 1);
    // What looks like SQL is a text.
    assert_eq!(found(&Filter { suite: Some("' OR 1 --".to_owned()), ..Filter::default() }), 0);
    assert_eq!(log.instant("2026-11-25").unwrap(), Some(NOW - 15.0 * 3600.0));
    assert_eq!(log.instant("yesterday").unwrap(), None);
    assert_eq!(log.instant("now").unwrap(), None);
}

#[test]
fn several_writers_at_a_time_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    std::thread::scope(|scope| {
        for writer in 0..4 {
            let folder = folder.path();
            scope.spawn(move || {
                let mut log = Log::open(folder).unwrap();
                for run in 0..25 {
                    let begun = begin(&mut log, &format!("{writer}-{run}"), NOW);
                    log.finish(begun.id, &passed(1.0)).unwrap();
                }
            });
        }
    });
    let log = Log::read(folder.path()).unwrap();
    let mut recordings: Vec<_> =
        log.runs(&Filter::default(), None).unwrap().into_iter().map(|run| run.recording).collect();
    recordings.sort();
    recordings.dedup();
    assert_eq!(recordings.len(), 100);
}

#[test]
fn a_trend_is_told_week_by_week() {
    let folder = tempfile::tempdir().unwrap();
    let mut log = Log::open(folder.path()).unwrap();
    for week in 0..5_u32 {
        for run in 0..3 {
            let begun = begin(&mut log, "a", NOW + f64::from(week) * 604_800.0 + f64::from(run));
            log.finish(begun.id, &passed(f64::from(week) + f64::from(run) * 0.01)).unwrap();
        }
    }
    let trend = log.trend("peak", &Filter::default()).unwrap();
    assert_eq!(trend.weeks.len(), 5);
    let first = &trend.weeks[0];
    assert_eq!(
        (first.week.as_str(), first.runs, first.min, first.median, first.max),
        ("2026-W48", 3, 0.0, 0.01, 0.02)
    );
    // Weeks of ISO 8601: the last days of the year are in week 53.
    assert_eq!(trend.weeks[4].week, "2026-W52");
    let drift = trend.drift.unwrap();
    assert!((drift.per_week - 1.0).abs() < 1e-6 && drift.is_sure(), "{drift:?}");
    assert!(log.trend("no-figure", &Filter::default()).unwrap().weeks.is_empty());
    assert_eq!(log.figure_names().unwrap(), ["peak"]);
}

#[test]
fn what_is_no_log_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(Log::read(folder.path()), Err(StationError::Absent { .. })));
    std::fs::write(folder.path().join("runs.sqlite"), "a text that is no database at all").unwrap();
    assert!(matches!(Log::open(folder.path()), Err(StationError::Database { .. })));
    assert!(std::fs::read_to_string(folder.path().join("runs.sqlite")).unwrap().starts_with("a text"));
}
