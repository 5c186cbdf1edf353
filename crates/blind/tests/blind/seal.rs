//! A seal tells nothing but physics, and makes the same again from the same seed.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    time::UNIX_EPOCH,
};

use crate::common::{plan, right_answers, sealed};
use bench_blind::{BlindError, Family, seal};
use bench_recording::{Flight, Info};

/// Everything that a file tells without its messages being read, as numbers.
fn metadata(case: &Path, index: usize, flights: usize) -> Vec<f64> {
    let mut features = vec![index as f64];
    for flight in 1..=flights {
        let path = case.join(format!("flight-{flight}.mcap"));
        let file = fs::metadata(&path).unwrap();
        let info = Info::read(&path).unwrap();
        let age = file.modified().unwrap().duration_since(UNIX_EPOCH).unwrap();
        features.extend([file.len() as f64, age.as_secs_f64(), info.messages as f64]);
        features.extend([info.first_time_s.unwrap_or(0.0), info.last_time_s.unwrap_or(0.0)]);
        features.extend(info.channels.iter().map(|channel| channel.messages as f64));
        features.extend(info.attachments.iter().map(|attachment| attachment.size_bytes as f64));
    }
    features
}

/// Words that a file tells without its messages being read.
fn words(case: &Path) -> Vec<String> {
    let mut entries: Vec<_> = fs::read_dir(case).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    let mut words = Vec::new();
    for path in entries {
        words.push(path.file_name().unwrap().to_string_lossy().into_owned());
        if path.extension().is_some_and(|extension| extension == "toml") {
            words.push(fs::read_to_string(&path).unwrap());
            continue;
        }
        let info = Info::read(&path).unwrap();
        words.push(format!(
            "{} {} {} {:?} {} {} {:?}",
            info.mode, info.rig, info.mission, info.seed, info.bench_version, info.platform, info.extra
        ));
        let flight = Flight::load(&path).unwrap();
        words.extend(flight.rig_toml().map(str::to_owned));
        // Apart from the filling, which the files' equal lengths make up for.
        words.extend(flight.mission_toml().and_then(|text| text.lines().next()).map(str::to_owned));
    }
    words
}

/// Nearest centroid, each case left out in turn: for each case, whether its class comes out right. Classes with one case
/// only have no centroid without it and are not asked for.
fn named<C: Ord + Copy>(features: &[Vec<f64>], classes: &[C]) -> Vec<(C, bool)> {
    let columns = features[0].len();
    let mean = |column: usize, of: &dyn Fn(usize) -> bool| {
        let values: Vec<f64> = (0..features.len()).filter(|i| of(*i)).map(|i| features[i][column]).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    let mut sizes = BTreeMap::new();
    for class in classes {
        *sizes.entry(*class).or_insert(0) += 1;
    }
    let spread: Vec<f64> = (0..columns)
        .map(|column| {
            let middle = mean(column, &|_| true);
            features.iter().map(|row| (row[column] - middle).powi(2)).sum::<f64>().sqrt()
        })
        .collect();
    (0..features.len())
        .filter(|left_out| sizes[&classes[*left_out]] > 1)
        .map(|left_out| {
            let distance = |class: C| -> f64 {
                (0..columns)
                    .filter(|column| spread[*column] > 1e-12)
                    .map(|column| {
                        let centre = mean(column, &|i| i != left_out && classes[i] == class);
                        ((features[left_out][column] - centre) / spread[column]).powi(2)
                    })
                    .sum()
            };
            let asked = sizes.iter().filter(|(_, size)| **size > 1).map(|(class, _)| *class);
            let told = asked.min_by(|a, b| distance(*a).total_cmp(&distance(*b)));
            (classes[left_out], told == Some(classes[left_out]))
        })
        .collect()
}

/// The mean of all classes' shares that come out right.
fn balanced_accuracy<C: Ord + Copy>(named: &[(C, bool)]) -> f64 {
    let mut shares: BTreeMap<C, (f64, f64)> = BTreeMap::new();
    for (class, right) in named {
        let share = shares.entry(*class).or_default();
        share.0 += f64::from(u8::from(*right));
        share.1 += 1.0;
    }
    shares.values().map(|(right, of)| right / of).sum::<f64>() / shares.len() as f64
}

#[test]
fn metadata_alone_tells_nothing() {
    let plan = plan(120, 5);
    let (folder, _, key) = sealed(&plan);
    let cases = folder.path().join("cases");
    let names: Vec<&String> = key.cases.keys().collect();
    let features: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(i, name)| metadata(&cases.join(name), i, plan.missions.len()))
        .collect();

    // Sizes, counts, attachments, time stamps of files: one and the same. What is left are name and the instants of
    // the first and the last message.
    for name in &names[1..] {
        assert_eq!(words(&cases.join(name)), words(&cases.join(names[0])));
    }
    let sizes = |name: &str, flight: usize| {
        fs::metadata(cases.join(name).join(format!("flight-{flight}.mcap"))).unwrap().len()
    };
    for flight in 1..=2 {
        let lengths: BTreeSet<u64> = names.iter().map(|name| sizes(name, flight)).collect();
        assert_eq!(lengths.len(), 1, "{lengths:?}");
    }

    let caused: Vec<bool> = key.cases.values().map(|truth| truth.family != Family::None).collect();
    let accuracy = balanced_accuracy(&named(&features, &caused));
    let [none, some] = [false, true].map(|class| caused.iter().filter(|c| **c == class).count() as f64);
    // A coin's balanced accuracy has this deviation; 2.6 of them are 99 %.
    let deviation = 0.5 * (0.25 / none + 0.25 / some).sqrt();
    assert!((accuracy - 0.5).abs() < 2.6 * deviation, "{accuracy} with deviation {deviation}");

    // Nor does it name the effect, or the form outside of the library.
    let causes: Vec<String> = key
        .cases
        .values()
        .map(|truth| match truth.family {
            Family::Outside => truth.ingredients[0].form.clone(),
            _ => truth.label(),
        })
        .collect();
    let causes: Vec<&str> = causes.iter().map(String::as_str).collect();
    assert!(causes.iter().collect::<BTreeSet<_>>().len() > 30);
    assert!(!names_more_than_chance(&features, &causes));
}

/// Whether all columns together, or one of them alone, name more causes than chance does.
fn names_more_than_chance<C: Ord + Copy>(features: &[Vec<f64>], classes: &[C]) -> bool {
    let columns = 0..features[0].len();
    let alone = columns.map(|column| features.iter().map(|row| vec![row[column]]).collect::<Vec<_>>());
    // A column that is the same in all cases makes the classifier name the same class always, which is chance, too.
    alone.chain([features.to_vec()]).any(|features| {
        let told = named(&features, classes);
        let asked = told.iter().map(|(class, _)| class).collect::<BTreeSet<_>>().len() as f64;
        let right = told.iter().filter(|(_, right)| *right).count() as f64;
        let largest = classes.iter().map(|class| told.iter().filter(|(c, _)| c == class).count()).max();
        // By chance one in as many as there are classes, or all of one class if that is always named. Some twenty
        // columns are tried: 3.5 deviations of a Poisson count leave one in two hundred to all of them.
        let expected = (told.len() as f64 / asked).max(largest.unwrap_or(0) as f64);
        right > expected + 3.5 * expected.sqrt()
    })
}

#[test]
fn the_classifier_names_what_one_column_gives_away() {
    // A check that cannot fail is none. Twenty classes of five cases, a column of noise, one that tells.
    let classes: Vec<u32> = (0..100).map(|i| i % 20).collect();
    let noise = |i: usize| (i * 37 % 101) as f64;
    let rows = |tells: f64| -> Vec<_> {
        classes.iter().enumerate().map(|(i, c)| vec![noise(i), tells * f64::from(*c)]).collect()
    };
    assert!(names_more_than_chance(&rows(1.0), &classes));
    assert!(!names_more_than_chance(&rows(0.0), &classes));
}

#[test]
fn the_same_seed_makes_the_same_seal_and_another_seed_another() {
    let [(_first, a, key), (_second, b, again), (_third, c, _)] =
        [7, 7, 8].map(|seed| sealed(&plan(4, seed)));
    assert_eq!((&a, &key), (&b, &again));
    assert_ne!(a.key_sha256, c.key_sha256);
    assert_ne!(a.files, c.files);
}

#[test]
fn families_have_their_shares_and_flights_can_be_read() {
    let plan = plan(30, 3);
    let (folder, seal, key) = sealed(&plan);
    let count = |family| key.cases.values().filter(|truth| truth.family == family).count();
    assert_eq!(Family::ALL.map(count), [6, 14, 4, 6]);
    assert_eq!(seal.cases().len(), 30);
    assert_eq!(right_answers(&key).len(), 30);
    for truth in key.cases.values() {
        assert!(truth.detectability.is_finite());
        assert_eq!(truth.family == Family::None, truth.ingredients.is_empty());
        let farthest = truth.nuisances_sigma.values().fold(0.0_f64, |far, sigma| far.max(sigma.abs()));
        assert!(farthest <= 1.5);
    }
    for file in seal.files.keys().filter(|file| file.contains("flight-")) {
        let flight = Flight::load(folder.path().join("cases").join(file)).unwrap();
        assert!(flight.truth.is_empty(), "the truth is not for the eyes of whoever answers");
        assert!(flight.positions.len() > 80 && flight.commands.len() > 30);
        assert!(flight.positions.iter().all(|sample| sample.position_m[2].abs() < 20.0));
    }
}

#[test]
fn a_seal_is_made_once_and_its_key_lies_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let inside = seal(&plan(1, 0), &place("cases"), &place("cases/key.json"), |_| {});
    assert!(matches!(inside, Err(BlindError::KeyInside { .. })), "{inside:?}");
    fs::create_dir(place("old")).unwrap();
    let again = seal(&plan(1, 0), &place("old"), &place("key.json"), |_| {});
    assert!(matches!(again, Err(BlindError::Exists { .. })), "{again:?}");
    assert!(!place("key.json").exists());
}
