//! Opens a seal: checks that key, recordings and answers are what they were, then scores.

use std::{collections::BTreeSet, fs, path::Path};

use serde::de::DeserializeOwned;

use crate::{
    BlindError,
    answers::Answers,
    hash,
    score::{Score, score},
    seal::{KEY_SCHEMA, Key, SEAL_FILE, SEAL_SCHEMA, Seal, key_hash},
};

impl Seal {
    /// Reads the seal of a folder.
    pub fn load(folder: &Path) -> Result<Self, BlindError> {
        let path = folder.join(SEAL_FILE);
        let seal: Self = read(&path)?;
        expect_schema(&path, &seal.schema, SEAL_SCHEMA)?;
        Ok(seal)
    }

    /// Refuses a folder in which a sealed file is gone or changed.
    pub fn check_files(&self, folder: &Path) -> Result<(), BlindError> {
        let mut changed = Vec::new();
        for (file, sealed) in &self.files {
            let path = folder.join(file);
            if !path.exists() {
                changed.push(format!("{file} is gone"));
            } else if hash::of_file(&path)? != *sealed {
                changed.push(format!("{file} is not what it was"));
            }
        }
        if changed.is_empty() { Ok(()) } else { Err(BlindError::Changed { files: changed }) }
    }

    /// Reads the key and refuses one that is not this seal's.
    pub fn open_key(&self, path: &Path) -> Result<Key, BlindError> {
        let bytes = fs::read(path).map_err(BlindError::io("read", path))?;
        let malformed = |detail: String| BlindError::Malformed { path: path.to_owned(), detail };
        let key: Key = serde_json::from_slice(&bytes).map_err(|error| malformed(error.to_string()))?;
        let found = key_hash(&bytes, &key.salt);
        if found != self.key_sha256 {
            let sealed = self.key_sha256.clone();
            return Err(BlindError::WrongKey { path: path.to_owned(), found, sealed });
        }
        expect_schema(path, &key.schema, KEY_SCHEMA)?;
        let cases: BTreeSet<&str> = key.cases.keys().map(String::as_str).collect();
        if cases != self.cases() {
            return Err(malformed("its cases are not those of the seal".to_owned()));
        }
        Ok(key)
    }
}

/// Checks everything and scores the answers.
pub fn open(folder: &Path, key: &Path, answers: &Path) -> Result<Score, BlindError> {
    let seal = Seal::load(folder)?;
    let key = seal.open_key(key)?;
    seal.check_files(folder)?;
    let path = answers;
    let answers = Answers::load(path)?;
    if answers.seal != seal.key_sha256 {
        return Err(BlindError::OtherSeal {
            path: path.to_owned(),
            told: answers.seal,
            sealed: seal.key_sha256,
        });
    }
    if let Some(stranger) = answers.cases.keys().find(|case| !key.cases.contains_key(*case)) {
        let detail = format!("{stranger} is no case of this seal");
        return Err(BlindError::Malformed { path: path.to_owned(), detail });
    }
    Ok(score(&seal, &key, &answers))
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T, BlindError> {
    let bytes = fs::read(path).map_err(BlindError::io("read", path))?;
    serde_json::from_slice(&bytes)
        .map_err(|error| BlindError::Malformed { path: path.to_owned(), detail: error.to_string() })
}

fn expect_schema(path: &Path, found: &str, expected: &str) -> Result<(), BlindError> {
    if found == expected {
        return Ok(());
    }
    let detail = format!("schema is {found:?}, expected {expected}");
    Err(BlindError::Malformed { path: path.to_owned(), detail })
}
