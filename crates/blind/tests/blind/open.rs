//! What was tampered with is refused, what is missing is counted.

use std::fs;

use crate::common::{answered, plan, right_answers, sealed};
use bench_blind::{Answer, BlindError, Family, Verdict, open, page, stamp};

#[test]
fn right_answers_score_full_marks_and_the_page_needs_nothing_else() {
    let (folder, seal, key) = sealed(&plan(15, 1));
    let answers = answered(&folder, &seal, right_answers(&key));
    let score = open(&folder.path().join("cases"), &folder.path().join("key.json"), &answers).unwrap();
    assert_eq!((score.top_1.all.count, score.top_1.all.of), (15, 15));
    assert_eq!(score.brier.value, Some(0.0));
    assert_eq!(score.log_score.value, Some(0.0));
    assert_eq!(score.ece.value, Some(0.0));
    assert_eq!(score.unknown.auroc.value, Some(1.0));
    assert_eq!(score.false_alarms.count, 0);
    let html = page(&score, "bench blind open <cases>");
    assert!(html.contains("15 of 15 sealed cases named rightly") && html.contains("default-src 'none'"));
    assert!(html.contains("bench blind open &lt;cases&gt;") && html.matches("data-plot").count() >= 2);
}

#[test]
fn a_missing_and_a_failed_case_count_as_wrong_and_are_told() {
    let (folder, seal, key) = sealed(&plan(15, 1));
    let mut answers = right_answers(&key);
    let of = |family| key.cases.iter().find(|(_, truth)| truth.family == family).unwrap().0.clone();
    answers.remove(&of(Family::None));
    answers.insert(of(Family::Outside), Answer::bare(Verdict::Failed));
    let answers = answered(&folder, &seal, answers);
    let score = open(&folder.path().join("cases"), &folder.path().join("key.json"), &answers).unwrap();
    assert_eq!((&score.missing, &score.failed), (&vec![of(Family::None)], &vec![of(Family::Outside)]));
    assert_eq!((score.top_1.all.count, score.top_1.all.of), (13, 15));
    assert_eq!(score.false_alarms.count, 1);
    // Two of fifteen at the worst Brier score, two.
    assert!((score.brier.value.unwrap() - 4.0 / 15.0).abs() < 1e-12);
    assert!(score.unknown.auroc.value < Some(1.0));
    let words = score.in_words();
    assert!(words.contains(&of(Family::None)) && words.contains("without an answer"), "{words}");
    assert!(page(&score, "").contains("without an answer"));
}

#[test]
fn a_changed_key_is_refused() {
    let (folder, seal, key) = sealed(&plan(4, 2));
    let answers = answered(&folder, &seal, right_answers(&key));
    let path = folder.path().join("key.json");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replacen("\"drain_per_min\": 0.0", "\"drain_per_min\": 0.1", 1)).unwrap();
    let refused = open(&folder.path().join("cases"), &path, &answers);
    assert!(matches!(refused, Err(BlindError::WrongKey { .. })), "{refused:?}");
}

#[test]
fn another_seals_key_and_answers_are_refused() {
    let (folder, seal, key) = sealed(&plan(4, 2));
    let (other, other_seal, other_key) = sealed(&plan(4, 3));
    let cases = folder.path().join("cases");
    let own = answered(&folder, &seal, right_answers(&key));
    let refused = open(&cases, &other.path().join("key.json"), &own);
    assert!(matches!(refused, Err(BlindError::WrongKey { .. })), "{refused:?}");
    let foreign = answered(&other, &other_seal, right_answers(&other_key));
    let refused = open(&cases, &folder.path().join("key.json"), &foreign);
    assert!(matches!(refused, Err(BlindError::OtherSeal { .. })), "{refused:?}");
}

#[test]
fn a_changed_or_absent_recording_is_refused_by_name() {
    let (folder, seal, key) = sealed(&plan(4, 2));
    let cases = folder.path().join("cases");
    let answers = answered(&folder, &seal, right_answers(&key));
    fs::copy(cases.join("case-002/flight-1.mcap"), cases.join("case-001/flight-1.mcap")).unwrap();
    fs::remove_file(cases.join("case-003/flight-2.mcap")).unwrap();
    match open(&cases, &folder.path().join("key.json"), &answers) {
        Err(BlindError::Changed { files }) => {
            assert_eq!(
                files,
                ["case-001/flight-1.mcap is not what it was", "case-003/flight-2.mcap is gone"]
            );
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn answers_edited_after_hashing_are_refused_and_foreign_ones_can_be_stamped() {
    let (folder, seal, key) = sealed(&plan(4, 2));
    let cases = folder.path().join("cases");
    let key_file = folder.path().join("key.json");
    let answers = answered(&folder, &seal, right_answers(&key));
    let text = fs::read_to_string(&answers).unwrap();
    fs::write(&answers, text.replace("\"test 1\"", "\"test 2\"")).unwrap();
    let refused = open(&cases, &key_file, &answers);
    assert!(matches!(refused, Err(BlindError::ChangedAnswers { .. })), "{refused:?}");
    // What another tool writes: a hash of zeros, keys in its own order, no spaces.
    let zeros = "0".repeat(64);
    let seal_hash = &seal.key_sha256;
    fs::write(
        &answers,
        format!(
            "{{\"sha256\":\"{zeros}\",\"tool\":\"other\",\"schema\":\"bench.answers/1\",\"seal\":\"{seal_hash}\",\
             \"cases\":{{\"case-001\":{{\"verdict\":\"effect\",\"effects\":[\"rotor-lag\",\"gusts\"]}}}}}}"
        ),
    )
    .unwrap();
    let hash = stamp(&answers).unwrap();
    let score = open(&cases, &key_file, &answers).unwrap();
    assert_eq!(score.answers_sha256, hash);
    assert_eq!(score.case[0].told, "gusts+rotor-lag");
    assert_eq!(score.missing.len(), 3);
}

#[test]
fn answers_that_make_no_sense_are_refused_with_the_case() {
    let (folder, seal, key) = sealed(&plan(4, 2));
    let mut answers = right_answers(&key);
    let name = answers.keys().next().unwrap().clone();
    answers.get_mut(&name).unwrap().probabilities.insert("gusts".to_owned(), 1.5);
    let path = answered(&folder, &seal, answers);
    let refused = open(&folder.path().join("cases"), &folder.path().join("key.json"), &path);
    let words = refused.unwrap_err().to_string();
    assert!(words.contains(&name) && words.contains("gusts"), "{words}");
}
