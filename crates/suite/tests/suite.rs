//! Suite files, the tests that they lay out, and what flights come to.

use std::{collections::BTreeSet, path::Path};

use bench_device::{PositionSample, Time, TrackStatus};
use bench_recording::{ControlState, Flight, Mode, Record, Session};
use bench_rig::{
    Criteria, Phase, Problem, RigError,
    keys::{Form, Kind},
};
use bench_suite::{
    Counts, Journal, JournalError, Kept, MissionCriteria, Outcome, Run, Suite, Tested, judge, suite_keys,
};

fn suite(cases: &str) -> Result<Suite, RigError> {
    Suite::read(Path::new("s.toml"), &format!("name = \"s\"\ndescription = \"x\"\n{cases}"))
}

const CASE: &str = "[[case]]\nname = \"a\"\nrig = \"virtual\"\nmission = \"hop\"\n";

fn problems(cases: &str) -> Vec<Problem> {
    match suite(cases) {
        Err(RigError::Invalid(problems)) => problems,
        other => panic!("{other:?}"),
    }
}

/// The keys that the reader knows of a table: it lists them where a key is like none of them.
fn known(problems: &[Problem], table: &str) -> BTreeSet<String> {
    let of = |problem: &Problem| match problem {
        Problem::UnknownKey { key, hint, .. } if *key == format!("{table}zzzzzz") => {
            let list = hint.strip_prefix("expected one of ").unwrap();
            Some(list.split(", ").map(str::to_owned).collect())
        }
        _ => None,
    };
    problems.iter().find_map(of).unwrap_or_else(|| panic!("{table}: {problems:?}"))
}

fn names(form: &Form) -> BTreeSet<String> {
    form.keys.iter().map(|key| key.name.clone()).collect()
}

fn inner<'f>(form: &'f Form, key: &str) -> &'f Form {
    match &form.keys.iter().find(|known| known.name == key).unwrap().kind {
        Kind::Table(forms) | Kind::Tables(forms, _) => &forms[0],
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_reader_knows_the_keys_that_the_page_lists_and_no_others() {
    let text = "zzzzzz = 1\n[[case]]\nzzzzzz = 1\n[case.limits]\nzzzzzz = 1\n[[case.limit]]\nzzzzzz = 1\n";
    let problems = problems(text);
    let forms = suite_keys();
    let (top, case) = (&forms[0], inner(&forms[0], "case"));
    assert_eq!(known(&problems, ""), names(top));
    assert_eq!(known(&problems, "case."), names(case));
    assert_eq!(known(&problems, "case.limits."), names(inner(case, "limits")));
    assert_eq!(known(&problems, "case.limit."), names(inner(case, "limit")));
}

#[test]
fn a_case_has_a_test_for_each_combination_with_a_name_and_a_file_of_its_own() {
    let suite = suite(
        "[[case]]\nname = \"a b\"\nrig = \"virtual\"\nmission = [\"hop\", \"steps\"]\nmode = [\"sim\", \"frames\"]\n\
         effects = [\"none\", \"gusts + rotor-lag:time_constant_s=0.1\"]\nseeds = { first = 5, count = 2 }\n\
         [[case]]\nname = \"a_b\"\nrig = \"virtual\"\nmission = \"hop\"\n[[case]]\nname = \"a/b\"\nrig = \"virtual\"\nmission = \"hop\"\n",
    )
    .unwrap();
    let tests = suite.tests();
    assert_eq!(tests.len(), 18);
    assert_eq!(tests[0].id, "a b/hop/sim/none/seed5");
    assert_eq!(tests[15].id, "a b/steps/frames/gusts+rotor-lag:time_constant_s=0.1/seed6");
    assert_eq!(tests[15].effects, ["gusts", "rotor-lag:time_constant_s=0.1"]);
    assert_eq!(tests[15].file_stem, "a_b_steps_frames_gusts_rotor-lag_time_constant_s=0.1_seed6");
    // Names that differ where a file's name cannot.
    assert_eq!([&*tests[16].file_stem, &*tests[17].file_stem], ["a_b", "a_b-2"]);
    assert_eq!((tests[0].seed_of(0), tests[0].seed_of(2)), (5, 2005));
    let ids: BTreeSet<_> = tests.iter().map(|test| &test.id).collect();
    assert_eq!(ids.len(), 18);
}

#[test]
fn two_rigs_and_two_modes_that_are_compared_belong_together() {
    let text = "[[case]]\nname = \"a\"\nrig = [\"loopback\", \"transmitter\"]\nmission = \"hop\"\n\
                mode = [\"loopback\", \"transmitter\"]\n";
    assert_eq!(suite(text).unwrap().tests().len(), 4);
    let tests = suite(&format!("{text}compare = \"back-to-back\"\n")).unwrap().tests();
    let told: Vec<_> = tests.iter().map(|test| (&*test.id, &*test.rig)).collect();
    assert_eq!(told, [("a/loopback", "loopback"), ("a/transmitter", "transmitter")]);
}

#[test]
fn what_does_not_fit_together_is_told_where_it_stands() {
    let cases = [
        ("seeds = [1, 1]", 7, "case.seeds", "listed twice"),
        ("seeds = [1.5]", 7, "case.seeds", "whole"),
        ("repeats = 1.5", 7, "case.repeats", "whole"),
        ("mode = \"sym\"", 7, "case.mode", "none of"),
        ("compare = \"back-to-back\"", 7, "case.compare", "list two"),
        ("tolerances = \"t.toml\"", 7, "case.tolerances", "nothing is compared"),
        ("[case.limits]\npeak_spread_max_m = 1", 7, "case.limits", "repeats"),
        ("[case.limits]\npeak_min_m = 2\npeak_max_m = 1", 8, "case.limits.peak_min_m", "above"),
    ];
    for (more, line, key, what) in cases {
        let problems = problems(&format!("{CASE}{more}\n"));
        let [problem] = problems.as_slice() else { panic!("{more}: {problems:?}") };
        assert_eq!((problem.at().line, problem.key()), (line, key), "{more}: {problem}");
        assert!(problem.what().contains(what), "{more}: {problem}");
    }
    let limits = [
        ("field = \"/tracker/position/status\"\nstatistic = \"max\"\nmax = 1", "names"),
        ("field = \"/tracker/position/status\"\nstatistic = \"share\"\nmin = 1", "with this value"),
        ("field = \"/loop/tick/overrun\"\nstatistic = \"count\"\nunit = \"s\"\nmax = 1", "no unit"),
        (
            "field = \"/control/command/sticks.throttle\"\nstatistic = \"max\"\nunit = \"m\"\nmax = 1",
            "say which",
        ),
        ("field = \"/plant/truth/position_m.z\"\nstatistic = \"max\"\nunit = \"cm\"\nmax = 1", "not in cm"),
        ("field = \"/plant/truth/position_m.z\"\nstatistic = \"max\"\nunit = \"m\"", "no limit"),
        (
            "field = \"/plant/truth/height\"\nstatistic = \"max\"\nunit = \"m\"\nmax = 1",
            "/plant/truth/position_m.z",
        ),
    ];
    for (limit, what) in limits {
        let problems = problems(&format!("{CASE}[[case.limit]]\n{limit}\n"));
        assert!(problems.iter().any(|problem| problem.to_string().contains(what)), "{limit}: {problems:?}");
    }
}

/// A flight at 0, 1, ..., 9 m, a second each, of which the last five are a hold.
fn flight() -> Flight {
    let mut records = Vec::new();
    for second in 0..10 {
        let time = Time::from_seconds(f64::from(second));
        records.push(Record::Position(PositionSample {
            exposed_at: time,
            arrived_at: time,
            position_m: [0.0, 0.0, f64::from(second)],
            heading_rad: None,
            pixel: [0.0; 2],
            size_px: 0.0,
            status: if second == 3 { TrackStatus::Ambiguous } else { TrackStatus::Found },
        }));
        let phase = if second < 5 { Phase::Launch } else { Phase::Hold };
        records.push(Record::ControlState(ControlState { time, phase, ..ControlState::default() }));
    }
    Flight::from_records(Session::new(Mode::Sim), records)
}

#[test]
fn statistics_are_those_of_the_samples_of_the_phase() {
    let z = "field = \"/tracker/position/position_m.z\"\nunit = \"m\"\nmax = 100\n";
    // The hold's last state ends it, so its samples are 5, 6, 7 and 8.
    let expected = [
        ("min", 5.0),
        ("max", 8.0),
        ("range", 3.0),
        ("mean", 6.5),
        ("rms", (174.0_f64 / 4.0).sqrt()),
        ("deviation", 1.25_f64.sqrt()),
        ("median", 6.5),
        ("p95", 8.0),
        ("p99", 8.0),
        ("first", 5.0),
        ("last", 8.0),
    ];
    for (statistic, value) in expected {
        let text = format!("{CASE}[[case.limit]]\n{z}statistic = \"{statistic}\"\nphase = \"hold\"\n");
        let suite = suite(&text).unwrap();
        let judged = judge(&flight(), &suite.cases[0].limits, MissionCriteria::Count, &Criteria::default());
        let found = judged.checks[0].value.unwrap();
        assert!((found - value).abs() < 1e-12, "{statistic}: {found} instead of {value}");
    }
    let status = "field = \"/tracker/position/status\"\n";
    for (more, value) in [
        ("statistic = \"count\"\nmin = 1\n", Some(10.0)),
        ("statistic = \"share\"\nequals = \"found\"\nmin = 1\n", Some(0.9)),
        ("statistic = \"count\"\nphase = \"land\"\nmin = 1\n", Some(0.0)),
        ("statistic = \"share\"\nphase = \"land\"\nequals = \"found\"\nmin = 0\n", None),
    ] {
        let suite = suite(&format!("{CASE}[[case.limit]]\n{status}{more}")).unwrap();
        let judged = judge(&flight(), &suite.cases[0].limits, MissionCriteria::Count, &Criteria::default());
        assert_eq!(judged.checks[0].value, value, "{more}");
        // What a flight does not define is no pass, even with a limit that any number keeps.
        assert_eq!(judged.checks[0].passed, value.is_some_and(|value| value >= 1.0), "{more}");
    }
}

#[test]
fn criteria_of_the_mission_count_unless_the_case_says_otherwise() {
    let criteria = Criteria { peak_max_m: Some(5.0), peak_min_m: Some(1.0), ..Criteria::default() };
    let suite = suite(&format!("{CASE}[case.limits]\npeak_max_m = 10\n")).unwrap();
    let limits = &suite.cases[0].limits;
    let told = |own| {
        let judged = judge(&flight(), limits, own, &criteria);
        judged.checks.iter().map(|check| (check.about.clone(), check.limit, check.passed)).collect::<Vec<_>>()
    };
    let own = ("peak_max_m".to_owned(), 10.0, true);
    assert_eq!(told(MissionCriteria::Count), [("peak_min_m".to_owned(), 1.0, true), own.clone()]);
    assert_eq!(told(MissionCriteria::Ignore), [own]);
}

fn run(repeat: u32, peak_m: f64, reason: Option<&str>) -> Run {
    let mut run = Run::error(repeat, 0, String::new());
    run.reason = reason.map(str::to_owned);
    run.spread = vec![Some(peak_m)];
    run.settle();
    run
}

#[test]
fn a_test_is_what_its_flights_are_and_flaky_where_they_disagree() {
    let text = format!("{CASE}repeats = 2\n[case.limits]\npeak_spread_max_m = 0.1\n");
    let suite = suite(&text).unwrap();
    let settled = |runs: Vec<Run>| {
        let mut tested = Tested::new(&suite, &suite.tests()[0], "virtual", "hop");
        tested.runs = runs;
        tested.settle(&suite, 2);
        tested
    };
    let both = |a, b| settled(vec![a, b]).outcome;
    assert_eq!(both(run(0, 1.0, None), run(1, 1.05, None)), Outcome::Passed);
    assert_eq!(both(run(0, 1.0, None), run(1, 1.2, None)), Outcome::Failed, "the spread is too wide");
    assert_eq!(both(run(0, 1.0, None), run(1, 1.0, Some("no board"))), Outcome::Flaky);
    assert_eq!(both(run(0, 1.0, Some("no board")), run(1, 1.0, Some("no board"))), Outcome::Error);
    let stopped = settled(vec![run(0, 1.0, None)]);
    assert_eq!((stopped.outcome, stopped.counts.not_run), (Outcome::NotRun, 1));
    let flaky = settled(vec![run(0, 1.0, None), run(1, 1.0, Some("no board"))]);
    assert_eq!(flaky.counts, Counts { passed: 1, errors: 1, ..Counts::default() });
    assert_eq!(flaky.faults()[0], "repeat 2 (seed 0): no board");
}

#[test]
fn a_journal_gives_back_what_it_was_given_and_refuses_another_suite() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("journal.jsonl");
    let kept = Kept { test: "a".to_owned(), run: run(0, 1.0 / 3.0, None) };
    let mut journal = Journal::begin(&path, "digest").unwrap();
    journal.keep(&kept).unwrap();
    drop(journal);
    std::fs::write(&path, std::fs::read_to_string(&path).unwrap() + "{\"test\":\"b\",\"ru").unwrap();
    let (mut journal, found) = Journal::resume(&path, "digest").unwrap();
    assert_eq!(found, std::slice::from_ref(&kept));
    journal.keep(&kept).unwrap();
    // Another process, which has the file open by itself, neither goes on with it nor begins it anew.
    assert!(matches!(Journal::resume(&path, "digest"), Err(JournalError::InUse { .. })));
    assert!(matches!(Journal::begin(&path, "digest"), Err(JournalError::InUse { .. })));
    drop(journal);
    assert_eq!(Journal::resume(&path, "digest").unwrap().1.len(), 2);
    assert!(matches!(Journal::resume(&path, "another"), Err(JournalError::Other { .. })));
    std::fs::write(&path, "no journal").unwrap();
    assert!(matches!(Journal::resume(&path, "digest"), Err(JournalError::Other { .. })));
}
