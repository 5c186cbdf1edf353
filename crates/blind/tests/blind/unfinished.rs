//! Answers that are being collected survive whatever ends the run.

use std::{fs, io::Write};

use bench_blind::{Answer, Answers, BlindError, Unfinished, Verdict};

fn noted(note: &str) -> Answer {
    Answer { note: Some(note.to_owned()), ..Answer::bare(Verdict::None) }
}

#[test]
fn a_cut_line_is_answered_again_and_whole_ones_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/answers.json");
    let begin = || Unfinished::begin_or_resume(&path, "tool 1", "program", "seal").unwrap();
    let mut unfinished = begin();
    unfinished.keep("case-001", noted("first")).unwrap();
    unfinished.keep("case-002", noted("second")).unwrap();
    drop(unfinished);
    let beside = folder.path().join("new/answers.json.unfinished");
    let text = fs::read_to_string(&beside).unwrap();
    fs::write(&beside, &text[..text.len() - 9]).unwrap();

    let mut unfinished = begin();
    assert!(unfinished.has("case-001") && !unfinished.has("case-002") && unfinished.count() == 1);
    unfinished.keep("case-002", noted("again")).unwrap();
    drop(unfinished);
    let unfinished = begin();
    let (answers, hash) = unfinished.finish(&path).unwrap();
    assert_eq!(answers.cases["case-002"].note.as_deref(), Some("again"));
    let loaded = Answers::load(&path).unwrap();
    assert_eq!((loaded.sha256, loaded.cases), (hash, answers.cases));
    assert!(!beside.exists());
}

#[test]
fn other_tools_programs_seals_and_runs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("answers.json");
    let own = Unfinished::begin_or_resume(&path, "tool 1", "program", "seal").unwrap();
    let busy = Unfinished::begin_or_resume(&path, "tool 1", "program", "seal");
    assert!(matches!(busy, Err(BlindError::Busy { .. })), "{busy:?}");
    drop(own);
    for (tool, program, seal) in
        [("tool 2", "program", "seal"), ("tool 1", "changed", "seal"), ("tool 1", "program", "other")]
    {
        let other = Unfinished::begin_or_resume(&path, tool, program, seal);
        assert!(matches!(other, Err(BlindError::OtherUnfinished { .. })), "{other:?}");
    }
    let mut file =
        fs::OpenOptions::new().append(true).open(folder.path().join("answers.json.unfinished")).unwrap();
    file.write_all(b"{\"case\": 1}\n").unwrap();
    let words = Unfinished::begin_or_resume(&path, "tool 1", "program", "seal").unwrap_err().to_string();
    assert!(words.contains("line 2") && words.contains("remove the file"), "{words}");
}

#[test]
fn an_answer_that_makes_no_sense_becomes_failed_and_spoils_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("answers.json");
    let mut unfinished = Unfinished::begin_or_resume(&path, "tool 1", "program", "seal").unwrap();
    let mut answer = noted("odd");
    answer.probabilities.insert("gusts".to_owned(), f64::NAN);
    unfinished.keep("case-001", answer).unwrap();
    unfinished.keep("case-002", noted("sound")).unwrap();
    unfinished.finish(&path).unwrap();
    let cases = Answers::load(&path).unwrap().cases;
    assert_eq!(cases["case-001"].verdict, Verdict::Failed);
    assert!(cases["case-001"].note.as_ref().unwrap().contains("gusts"));
    assert_eq!(cases["case-002"].verdict, Verdict::None);
}
