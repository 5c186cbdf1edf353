//! Sweeps as folders: shared, interrupted, damaged, and still the same results.

use std::{
    fs,
    ops::ControlFlow,
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

use bench_campaign::{
    CampaignError, Executed, Keep, Library, Outcome, Plan, RESULTS, Shard, Step, Store, Table, Unfound,
    execute, perform, perform_together, record,
};
use bench_recording::{Options, Recorder, Session};
use bench_rig::{Mission, Rig};
use bench_run::simulate;

/// The rigs of the repository, and missions that last a second.
struct Names;

fn rigs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs")
}

const SHORT: &str = "name = \"short\"\ndescription = \"d\"\n[criteria]\npeak_max_m = 0.65\n[[phase]]\nkind = \"idle\"\nduration_s = 0.3\n\
    [[phase]]\nkind = \"launch\"\nthrust_to_weight = 1.2\nduration_s = 0.7\n";

impl Library for Names {
    fn rig(&self, name: &str) -> Result<Rig, Unfound> {
        Rig::load(rigs().join(format!("{name}.toml"))).map_err(|error| Unfound::Words(error.to_string()))
    }

    fn missions(&self, name: &str, _rig: &str) -> Result<Vec<(String, Mission)>, Unfound> {
        let text = if name == "short" {
            SHORT.to_owned()
        } else if name == "low" {
            SHORT.replace("0.65", "0.4")
        } else {
            fs::read_to_string(rigs().join(format!("missions/{name}.toml"))).unwrap()
        };
        Mission::read(Path::new(name), &text)
            .map(|mission| vec![(name.to_owned(), mission)])
            .map_err(|error| Unfound::Words(error.to_string()))
    }

    fn recordings(&self, name: &str) -> Result<Vec<PathBuf>, Unfound> {
        Ok(vec![PathBuf::from(name)])
    }
}

const PLAN: &str = "name = \"short\"\ndescription = \"d\"\nrigs = [\"virtual\", \"virtual-model\"]\nmissions = \"short\"\n\
    airframes = \"drawn\"\nseeds = { first = 3, count = 12 }\nruns_per_part = 5\n\
    [[variant]]\nname = \"as it is\"\n[[variant]]\nname = \"slow\"\neffects.rotor-lag.time_constant_s = { log_uniform = [0.01, 0.3] }\n";
const RUNS: u64 = 48;
const PARTS: u64 = 10;

fn plan(text: &str) -> Plan {
    Plan::read(Path::new("plan.toml"), text, &Names).unwrap()
}

fn begin(folder: &Path) -> Store {
    Store::begin(folder, plan(PLAN)).unwrap()
}

fn run(store: &Store, shard: Shard) -> Executed {
    execute(store, shard, Keep::Nothing, &|_| ControlFlow::Continue(())).unwrap()
}

fn part(folder: &Path, part: u64) -> PathBuf {
    folder.join(format!("parts/part-{part:08}.parquet"))
}

/// The bytes of a sweep that one machine ran at once.
fn whole(folder: &Path) -> Vec<u8> {
    let store = begin(folder);
    let executed = run(&store, Shard::WHOLE);
    assert_eq!((executed.runs, executed.before, store.plan().parts()), (RUNS, 0, PARTS));
    fs::read(store.merge().unwrap()).unwrap()
}

#[test]
fn shards_of_any_number_run_by_anybody_give_the_bytes_of_one_machine() {
    let scratch = tempfile::tempdir().unwrap();
    let expected = whole(&scratch.path().join("whole"));
    let shared = scratch.path().join("shared");
    // Two machines have opened the folder before either begins; what they do overlaps.
    let (one, other) = (begin(&shared), Store::open(&shared).map(|_| begin(&shared)).unwrap());
    run(&one, Shard { number: 1, of: 2 });
    assert!(matches!(one.merge(), Err(CampaignError::Unfinished { missing: 23, all: RUNS, .. })));
    std::thread::scope(|scope| {
        scope.spawn(|| run(&one, Shard { number: 2, of: 3 }));
        scope.spawn(|| run(&other, Shard { number: 2, of: 2 }));
        scope.spawn(|| run(&other, Shard { number: 4, of: 4 }));
    });
    let again = run(&other, Shard::WHOLE);
    assert_eq!((again.before, again.outcomes.iter().sum::<u64>()), (RUNS, 0), "nothing is done twice");
    assert_eq!(fs::read(other.merge().unwrap()).unwrap(), expected);
}

#[test]
fn what_flies_together_comes_to_what_it_comes_to_alone() {
    // Some with effects that have lanes, one with an effect on the air, which has none, and flights of two lengths.
    let text = "name = \"mixed\"\ndescription = \"d\"\nrigs = [\"virtual\", \"virtual-model\"]\nmissions = [\"short\", \"hop\"]\n\
        airframes = \"drawn\"\nseeds = { first = 7, count = 4 }\n[[variant]]\nname = \"as it is\"\n\
        [[variant]]\nname = \"slow\"\neffects.rotor-lag.time_constant_s = { log_uniform = [0.01, 0.3] }\n\
        [[variant]]\nname = \"late\"\neffects.loop-overrun.probability = 0.3\neffects.loop-overrun.mean_s = 0.05\n\
        [[variant]]\nname = \"heavy\"\neffects.mass-change.fraction = 0.05\n";
    let plan = plan(text);
    let runs = plan.runs();
    assert_eq!(runs, 64);
    let together = perform_together(&plan, 0..runs);
    assert_eq!(together.len() as u64, runs);
    for (index, done) in (0..runs).zip(together) {
        let alone = perform(&plan, index);
        assert_eq!((done.row, done.outcome), (alone.row, alone.outcome));
    }
    // Any of them, in any order.
    let rows = |indices: &[u64]| -> Vec<_> {
        perform_together(&plan, indices.iter().copied()).into_iter().map(|done| done.row).collect()
    };
    let (some, reversed) = (rows(&[3, 40, 11]), rows(&[11, 40, 3]));
    assert!(some.iter().eq(reversed.iter().rev()));
    assert!(rows(&[]).is_empty());
}

#[test]
fn every_run_is_a_row_once() {
    let scratch = tempfile::tempdir().unwrap();
    whole(scratch.path());
    let table = Table::open(&scratch.path().join(RESULTS)).unwrap();
    let (mut ids, mut outcomes) = (Vec::new(), Vec::new());
    let place = |name: &str| table.columns().iter().position(|column| column.name == name).unwrap();
    table
        .for_each_group(|cells| {
            ids.extend(cells[place("id")].texts().into_iter().flatten());
            outcomes.extend(cells[place("outcome")].texts().into_iter().flatten());
            Ok(())
        })
        .unwrap();
    let plan = plan(PLAN);
    let planned: Vec<String> = (0..plan.runs()).map(|index| plan.run(index).id).collect();
    assert_eq!(ids, planned);
    // Some lift off and so fly too high for the mission, some do not.
    for outcome in [Outcome::Passed, Outcome::Missed] {
        assert!(outcomes.iter().any(|name| name == outcome.name()), "{outcomes:?}");
    }
}

#[test]
fn what_is_not_whole_or_not_of_the_plan_is_made_anew() {
    let scratch = tempfile::tempdir().unwrap();
    let expected = whole(scratch.path());
    let (first, second) = (part(scratch.path(), 0), part(scratch.path(), 1));
    let bytes = fs::read(&first).unwrap();
    // Cut, another part under this name, not of this format, gone; and what a killed writer leaves behind.
    let foreign = fs::read(&second).unwrap();
    for damaged in [&bytes[..bytes.len() / 2], &bytes[..bytes.len() - 1], &foreign, b"nonsense", b""] {
        fs::write(&first, damaged).unwrap();
        fs::write(scratch.path().join("parts/.part-00000000.parquet.x.partial"), damaged).unwrap();
        let store = Store::open(scratch.path()).unwrap();
        let executed = run(&store, Shard::WHOLE);
        assert_eq!((executed.before, executed.outcomes.iter().sum::<u64>()), (RUNS - 5, 5));
        assert_eq!(fs::read(store.merge().unwrap()).unwrap(), expected);
    }
    fs::remove_file(&first).unwrap();
    assert_eq!(run(&begin(scratch.path()), Shard::WHOLE).before, RUNS - 5);
}

#[test]
fn what_a_dead_process_left_half_written_goes_and_what_a_living_one_writes_stays() {
    let scratch = tempfile::tempdir().unwrap();
    whole(scratch.path());
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    // No system gives a process a number as large as this.
    let [dead, living] = [u32::MAX, std::process::id()].map(|id| {
        let name = format!(".part-00000000.parquet.{}-{id}.abc.partial", host.trim());
        let path = scratch.path().join("parts").join(name);
        fs::write(&path, "half").unwrap();
        path
    });
    run(&Store::open(scratch.path()).unwrap(), Shard::WHOLE);
    assert!(!dead.exists() && living.exists());
}

#[test]
fn a_sweep_that_is_stopped_goes_on_with_what_is_left() {
    let scratch = tempfile::tempdir().unwrap();
    let expected = whole(&scratch.path().join("whole"));
    let store = begin(&scratch.path().join("stopped"));
    let done = AtomicU64::new(0);
    let stop_at_the_third = |step| match step {
        Step::Done(_) if done.fetch_add(1, Ordering::Relaxed) >= 2 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let stopped = execute(&store, Shard::WHOLE, Keep::Nothing, &stop_at_the_third).unwrap_err();
    assert!(matches!(stopped, CampaignError::Stopped), "{stopped}");
    run(&store, Shard::WHOLE);
    store.merge().unwrap();
    assert_eq!(fs::read(scratch.path().join("stopped").join(RESULTS)).unwrap(), expected);
}

#[test]
fn a_merge_that_fails_leaves_the_one_before() {
    let scratch = tempfile::tempdir().unwrap();
    let expected = whole(scratch.path());
    let store = Store::open(scratch.path()).unwrap();
    // The end of the file is right, so that it passes for whole, and its first page is not.
    let (first, mut bytes) = (part(scratch.path(), 0), fs::read(part(scratch.path(), 0)).unwrap());
    bytes[4..40].fill(0xff);
    fs::write(&first, bytes).unwrap();
    let error = store.merge().unwrap_err();
    assert!(matches!(&error, CampaignError::Damaged { path, .. } if *path == first), "{error}");
    assert!(error.to_string().contains("delete it"), "{error}");
    assert_eq!(fs::read(scratch.path().join(RESULTS)).unwrap(), expected);
    let left: Vec<_> =
        fs::read_dir(scratch.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().contains("partial")), "{left:?}");
}

#[test]
fn a_shard_that_is_being_run_is_not_run_again() {
    let scratch = tempfile::tempdir().unwrap();
    let store = begin(scratch.path());
    let shard = Shard { number: 2, of: 4 };
    let lock = store.lock(shard).unwrap();
    let refused = execute(&store, shard, Keep::Nothing, &|_| ControlFlow::Continue(())).unwrap_err();
    assert!(refused.to_string().contains("shard 2/4"), "{refused}");
    run(&store, Shard { number: 1, of: 4 });
    drop(lock);
    run(&store, shard);
}

#[test]
fn a_folder_of_something_else_is_refused_and_left_alone() {
    let scratch = tempfile::tempdir().unwrap();
    fs::write(scratch.path().join("mine.txt"), "kept").unwrap();
    let error = Store::begin(scratch.path(), plan(PLAN)).unwrap_err();
    assert!(error.to_string().contains("not empty"), "{error}");
    assert_eq!(fs::read_dir(scratch.path()).unwrap().count(), 1);

    let other = scratch.path().join("other");
    begin(&other);
    let error = Store::begin(&other, plan(&PLAN.replace("count = 12", "count = 13"))).unwrap_err();
    assert!(matches!(error, CampaignError::OtherPlan { .. }), "{error}");
    // A comment changes no run.
    Store::begin(&other, plan(&format!("# a comment\n{PLAN}"))).unwrap();

    let kept = fs::read_to_string(other.join("plan.json")).unwrap();
    let by = format!("\"bench_version\": \"{}\"", env!("CARGO_PKG_VERSION"));
    fs::write(other.join("plan.json"), kept.replace(&by, "\"bench_version\": \"0.0.1\"")).unwrap();
    let error = Store::open(&other).unwrap_err();
    assert!(matches!(error, CampaignError::OtherVersion { .. }), "{error}");
    fs::write(other.join("plan.json"), &kept[..100]).unwrap();
    assert!(matches!(Store::open(&other).unwrap_err(), CampaignError::Damaged { .. }));
    assert!(matches!(Store::open(scratch.path()).unwrap_err(), CampaignError::NoSweep { .. }));
}

#[test]
fn what_cannot_be_diagnosed_is_a_row_with_its_reason() {
    let scratch = tempfile::tempdir().unwrap();
    let [sound, cut, changed] =
        ["sound.mcap", "cut.mcap", "changed.mcap"].map(|name| scratch.path().join(name));
    let Ok(rig) = Names.rig("virtual") else { panic!("the rig is there") };
    let mission = Mission::load(rigs().join("missions/hop.toml")).unwrap();
    for (path, seed) in [(&sound, 1), (&changed, 2)] {
        let session = Session::simulated(&rig, &[], &mission, seed);
        let mut recorder = Recorder::create(path, &session, Options::SIMULATION).unwrap();
        simulate(&rig, &mission, seed, &mut recorder, |_| true).unwrap();
        recorder.finish().unwrap();
    }
    fs::write(&cut, &fs::read(&sound).unwrap()[..1000]).unwrap();
    let text = format!(
        "name = \"logs\"\ndescription = \"d\"\nkind = \"recordings\"\nrecordings = [{sound:?}, {cut:?}, {changed:?}]\n"
    );
    let store = Store::begin(&scratch.path().join("swept"), plan(&text)).unwrap();
    fs::write(&changed, "something else").unwrap();
    let executed = run(&store, Shard::WHOLE);
    assert_eq!(executed.outcomes, [0, 0, 0, 1, 2]);
    let table = Table::open(&store.merge().unwrap()).unwrap();
    let place = |name: &str| table.columns().iter().position(|column| column.name == name).unwrap();
    table
        .for_each_group(|cells| {
            let (reasons, verdicts) = (cells[place("reason")].texts(), cells[place("verdict")].texts());
            assert_eq!((&reasons[0], &verdicts[0]), (&None, &Some("none".to_owned())));
            assert!(reasons[1].as_ref().is_some_and(|reason| reason.contains("cut.mcap")), "{reasons:?}");
            assert!(reasons[2].as_ref().is_some_and(|reason| reason.contains("was changed")), "{reasons:?}");
            Ok(())
        })
        .unwrap();
}

#[test]
fn a_replayed_run_is_the_recording_that_the_mission_gives() {
    let scratch = tempfile::tempdir().unwrap();
    // The nominal airframe flies higher than this, and so is kept.
    let nominal =
        PLAN.replace("airframes = \"drawn\"\n", "").replace("missions = \"short\"", "missions = \"low\"");
    let store = Store::begin(&scratch.path().join("swept"), plan(&nominal)).unwrap();
    let failed = execute(&store, Shard::WHOLE, Keep::Failed, &|_| ControlFlow::Continue(())).unwrap();
    let kept = fs::read_dir(scratch.path().join("swept/recordings")).unwrap().count() as u64;
    let missed = Outcome::ALL.iter().position(|outcome| *outcome == Outcome::Missed).unwrap();
    assert!(kept > 0 && kept == failed.outcomes[missed], "{kept} of {:?}", failed.outcomes);

    let id = store.plan().run(17).id;
    assert_eq!(store.find(&id[..8]).unwrap(), 17);
    assert!(matches!(store.find("00"), Err(CampaignError::NoRun { .. })));
    let run = store.plan().run(17);
    let bench_campaign::Work::Flight(flight) = &run.work else { panic!("a flight is planned") };
    let (replayed, flown) = (scratch.path().join("replayed.mcap"), scratch.path().join("flown.mcap"));
    record(flight, &replayed).unwrap();
    let effect = &flight.effects[0];
    let added = format!("{}:{}={}", effect.name, effect.parameters[0].0, effect.parameters[0].1);
    let session = Session::simulated(flight.nominal, &[added], flight.mission, flight.seed);
    let mut recorder = Recorder::create(&flown, &session, Options::SIMULATION).unwrap();
    simulate(&flight.plant, flight.mission, flight.seed, &mut recorder, |_| true).unwrap();
    recorder.finish().unwrap();
    assert!(fs::read(replayed).unwrap() == fs::read(flown).unwrap(), "the recordings are not the same bytes");
}
