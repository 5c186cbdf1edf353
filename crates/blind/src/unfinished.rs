//! Answers on their way: one line a case in a file beside the answers, so that a run that was interrupted goes on.

use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions, TryLockError},
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use crate::{
    BlindError, Verdict,
    answers::{Answer, Answers},
};

/// Schema of unfinished answers.
pub const UNFINISHED_SCHEMA: &str = "bench.unfinished-answers/1";

/// The first line: whose answers to which seal these are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    schema: String,
    tool: String,
    /// SHA-256 of the program: of one version there may be many builds, and their answers must not be mixed.
    program_sha256: String,
    seal: String,
}

/// A line for each case after it.
#[derive(Serialize, Deserialize)]
struct Line {
    case: String,
    answer: Answer,
}

/// Answers that are being collected. Lies beside the answers as `ANSWERS.unfinished` until they are whole.
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
    file: File,
    header: Header,
    answers: BTreeMap<String, Answer>,
}

impl Unfinished {
    /// Begins, or goes on with what an interrupted run of the same program left for the same seal. Refuses what another
    /// program, another seal or a run that still goes on has left there.
    pub fn begin_or_resume(
        answers: &Path,
        tool: &str,
        program_sha256: &str,
        seal: &str,
    ) -> Result<Self, BlindError> {
        let mut name = answers.as_os_str().to_owned();
        name.push(".unfinished");
        let path = PathBuf::from(name);
        let header = Header {
            schema: UNFINISHED_SCHEMA.to_owned(),
            tool: tool.to_owned(),
            program_sha256: program_sha256.to_owned(),
            seal: seal.to_owned(),
        };
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            fs::create_dir_all(folder).map_err(BlindError::io("create", folder))?;
        }
        let file = OpenOptions::new().read(true).append(true).create(true).open(&path);
        let file = file.map_err(BlindError::io("write", &path))?;
        match file.try_lock() {
            Ok(()) => {}
            // A file system without locks cannot tell of another run.
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => {}
            Err(TryLockError::WouldBlock) => return Err(BlindError::Busy { path }),
            Err(TryLockError::Error(error)) => return Err(BlindError::io("lock", &path)(error)),
        }
        let bytes = fs::read(&path).map_err(BlindError::io("read", &path))?;
        // What stands after the last line's end was cut off while it was written.
        let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        let mut this = Self { path, file, header, answers: BTreeMap::new() };
        this.file.set_len(whole as u64).map_err(BlindError::io("write", &this.path))?;
        match String::from_utf8_lossy(&bytes[..whole]).split_once('\n') {
            Some((first, lines)) => this.resume(first, lines)?,
            None => this.append(&serde_json::to_string(&this.header).unwrap_or_default())?,
        }
        Ok(this)
    }

    fn resume(&mut self, first: &str, lines: &str) -> Result<(), BlindError> {
        let malformed = |line: usize, error: serde_json::Error| BlindError::Malformed {
            path: self.path.clone(),
            detail: format!("line {line}: {error}; remove the file to answer from the beginning"),
        };
        let found: Header = serde_json::from_str(first).map_err(|error| malformed(1, error))?;
        if found != self.header {
            let whose = format!("{}, program {}, seal {}", found.tool, found.program_sha256, found.seal);
            return Err(BlindError::OtherUnfinished { path: self.path.clone(), whose });
        }
        for (i, line) in lines.lines().enumerate() {
            let Line { case, answer } =
                serde_json::from_str(line).map_err(|error| malformed(i + 2, error))?;
            self.answers.insert(case, answer);
        }
        Ok(())
    }

    /// Whether a case has its answer.
    pub fn has(&self, case: &str) -> bool {
        self.answers.contains_key(case)
    }

    /// How many cases have.
    pub fn count(&self) -> usize {
        self.answers.len()
    }

    /// Keeps an answer. One that no scorer would take becomes `failed` with the reason.
    pub fn keep(&mut self, case: &str, answer: Answer) -> Result<(), BlindError> {
        let answer = match answer.check() {
            Ok(()) => answer,
            Err(detail) => Answer {
                note: Some(format!("the answer makes no sense: {detail}")),
                ..Answer::bare(Verdict::Failed)
            },
        };
        let line = Line { case: case.to_owned(), answer };
        self.append(&serde_json::to_string(&line).unwrap_or_default())?;
        self.answers.insert(line.case, line.answer);
        Ok(())
    }

    /// Writes the answers with their hash and removes the unfinished ones. Returns the answers and the hash.
    pub fn finish(self, answers: &Path) -> Result<(Answers, String), BlindError> {
        let whole = Answers::new(self.header.tool, self.header.seal, self.answers);
        let hash = whole.write(answers)?;
        drop(self.file);
        fs::remove_file(&self.path).map_err(BlindError::io("remove", &self.path))?;
        Ok((whole, hash))
    }

    fn append(&mut self, line: &str) -> Result<(), BlindError> {
        let written = self.file.write_all(format!("{line}\n").as_bytes());
        written.map_err(BlindError::io("write", &self.path))
    }
}
