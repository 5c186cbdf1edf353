use std::{io, path::PathBuf};

use bench_plant::effects::EffectError;
use bench_recording::RecordingError;
use bench_rig::{Problem, RigError};
use thiserror::Error;

use crate::Shard;

/// Why a sweep could not be planned, run or merged.
#[derive(Debug, Error)]
pub enum CampaignError {
    /// The plan cannot be read.
    #[error(transparent)]
    File(#[from] RigError),
    /// The plan can be read, and is wrong.
    #[error("{} in {}; nothing was run\n{}", count(.problems), file.display(), lines(.problems))]
    Plan {
        /// The plan.
        file: PathBuf,
        /// All that is wrong, one at least.
        problems: Vec<Problem>,
    },
    /// A file or folder cannot be used.
    #[error("cannot {action} {}: {source}{}", path.display(), advice(source))]
    Io {
        /// `read`, `write` and the like.
        action: &'static str,
        /// What.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Whoever is told of its progress wanted it to end.
    #[error("the sweep was stopped; the same call goes on with what is left")]
    Stopped,
    /// A table cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// Why.
        source: parquet::errors::ParquetError,
    },
    /// A table that was written cannot be read.
    #[error("{} is damaged: {detail}; delete it and run the sweep again, which makes it anew", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the reader says.
        detail: String,
    },
    /// The folder holds no sweep.
    #[error("{} holds no sweep: there is no {} in it; name the folder that `bench sweep run --output` was given", folder.display(), crate::store::PLAN)]
    NoSweep {
        /// The folder.
        folder: PathBuf,
    },
    /// The folder holds another sweep.
    #[error("{} holds another sweep ({is}), or the same before its plan, a rig, a mission or a recording was changed; name another folder", folder.display())]
    OtherPlan {
        /// The folder.
        folder: PathBuf,
        /// Its name and the start of its id.
        is: String,
    },
    /// The folder's results are of another version.
    #[error("{} was begun by bench {by}, and this is {}: results of two versions are not mixed; go on with that version, or name another folder", folder.display(), crate::VERSION)]
    OtherVersion {
        /// The folder.
        folder: PathBuf,
        /// The version.
        by: String,
    },
    /// Another process runs the same shard.
    #[error("shard {shard} of {} is being run by another process; wait for it, or run another shard", folder.display())]
    InUse {
        /// The folder.
        folder: PathBuf,
        /// The shard.
        shard: Shard,
    },
    /// A shard is no part of a whole.
    #[error("{text:?} is no shard; write I/N with I from 1 to N, such as 3/8")]
    NoShard {
        /// What was given.
        text: String,
    },
    /// Not all runs are done.
    #[error("{missing} of {all} runs of {} are not done yet; run the sweep again, which goes on where it stopped, then merge", folder.display())]
    Unfinished {
        /// The folder.
        folder: PathBuf,
        /// Runs without a result.
        missing: u64,
        /// All of them.
        all: u64,
    },
    /// No run has this id.
    #[error("no run of {} has the id {id}; ids stand in the column `id` of its results, and a beginning of 8 digits or more is enough", folder.display())]
    NoRun {
        /// The folder.
        folder: PathBuf,
        /// What was given.
        id: String,
    },
    /// A flight cannot be recorded.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// An effect cannot be switched on.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// Too few sets to learn from.
    #[error("{sets} sets: at least {} are needed to see a tail of false alarms", crate::LEAST_SETS)]
    TooFewSets {
        /// How many were asked for.
        sets: usize,
    },
    /// No flight can be used.
    #[error("none of the missions' simulated flights can be diagnosed on this rig")]
    NothingToDiagnose,
}

fn count(problems: &[Problem]) -> String {
    if let [_] = problems { "1 problem".to_owned() } else { format!("{} problems", problems.len()) }
}

fn lines(problems: &[Problem]) -> String {
    problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

/// What helps against what a disk does.
fn advice(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "; what was finished is kept: free some room and run the same command again"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "; name a folder that can be written to"
        }
        _ => "",
    }
}
