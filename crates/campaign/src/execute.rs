//! Runs, done on all cores: part by part, each written by a thread of its own while the next one is computed.

use std::{
    fmt, fs,
    ops::{ControlFlow, Range},
    str::FromStr,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
        mpsc::sync_channel,
    },
    thread,
    time::Duration,
};

use rayon::prelude::*;

use crate::{CampaignError, Done, Outcome, Store, Work, perform_together, record, runs_together};

/// One of so many equal shares of a sweep: every so-many-th part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1.
    pub number: u64,
    /// How many shares there are, from 1.
    pub of: u64,
}

impl Shard {
    /// All of it.
    pub const WHOLE: Self = Self { number: 1, of: 1 };

    /// The parts of this share, of so many.
    pub fn parts(self, all: u64) -> impl Iterator<Item = u64> {
        (self.number - 1..all).step_by(usize::try_from(self.of).unwrap_or(usize::MAX))
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Shard {
    type Err = CampaignError;

    fn from_str(text: &str) -> Result<Self, CampaignError> {
        let parsed =
            text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        match parsed {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Self { number, of }),
            _ => Err(CampaignError::NoShard { text: text.to_owned() }),
        }
    }
}

/// Which flights are kept as recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// None.
    Nothing,
    /// Those that did not pass.
    Failed,
    /// All.
    All,
}

/// How far a sweep is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// So many runs are in this share, of which so many are done from before.
    Begun {
        /// Runs of the share.
        runs: u64,
        /// Done before.
        done: u64,
    },
    /// One more run is done.
    Done(Outcome),
}

/// What a share of a sweep came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Executed {
    /// Runs of the share.
    pub runs: u64,
    /// Those that were done before.
    pub before: u64,
    /// Runs done now by what they came to, in the order of [`Outcome::ALL`].
    pub outcomes: [u64; 5],
    /// Time that the runs done now took, of all cores together.
    pub busy: Duration,
}

/// Runs and groups of runs for each core that are computed before the next wave begins, so that a long one among them holds
/// nobody up for long.
const RUNS_PER_CORE: u64 = 16;
const GROUPS_PER_CORE: u64 = 4;

/// Does the runs of a share that are not done yet. Another process is kept off the same share while this one runs. Where `tell` breaks,
/// it ends with [`CampaignError::Stopped`], and parts that are written stay.
pub fn execute(
    store: &Store,
    shard: Shard,
    keep: Keep,
    tell: &(dyn Fn(Step) -> ControlFlow<()> + Sync),
) -> Result<Executed, CampaignError> {
    let _lock = store.lock(shard)?;
    store.remove_left_over();
    let plan = store.plan();
    let (missing, before) = store.unfinished(shard);
    let runs = before + missing.iter().map(|part| length(plan.runs_of_part(*part))).sum::<u64>();
    let go_on = |step| if tell(step).is_break() { Err(CampaignError::Stopped) } else { Ok(()) };
    go_on(Step::Begun { runs, done: before })?;
    if keep != Keep::Nothing {
        let folder = store.folder().join("recordings");
        fs::create_dir_all(&folder).map_err(|source| CampaignError::Io {
            action: "make the folder",
            path: folder,
            source,
        })?;
    }
    let counts = [const { AtomicU64::new(0) }; 5];
    let busy_ns = AtomicU64::new(0);
    let together = runs_together(plan);
    let runs_per_core = RUNS_PER_CORE.max(GROUPS_PER_CORE * together);
    let wave = (runs_per_core * rayon::current_num_threads() as u64).div_ceil(plan.runs_per_part()).max(1);
    let failure: Mutex<Option<CampaignError>> = Mutex::new(None);
    let (sender, receiver) = sync_channel::<(u64, Vec<Done>)>(1);
    thread::scope(|scope| {
        scope.spawn(|| {
            // Hanging up is how this thread tells that it failed.
            let receiver = receiver;
            for (part, done) in &receiver {
                if let Err(error) = store.write_part(part, &done) {
                    *failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    return;
                }
            }
        });
        'waves: for parts in missing.chunks(wave as usize) {
            let computed = parts
                .par_iter()
                .map(|part| {
                    let runs = plan.runs_of_part(*part);
                    let groups: Vec<Range<u64>> = runs
                        .clone()
                        .step_by(together as usize)
                        .map(|first| first..runs.end.min(first + together))
                        .collect();
                    groups
                        .into_par_iter()
                        .flat_map_iter(|group| group.clone().zip(perform_together(plan, group)))
                        .map(|(index, done)| {
                            let done = kept(store, done, index, keep)?;
                            if let Some(count) =
                                Outcome::ALL.iter().position(|outcome| *outcome == done.outcome)
                            {
                                counts[count].fetch_add(1, Ordering::Relaxed);
                            }
                            busy_ns.fetch_add(done.took.as_nanos() as u64, Ordering::Relaxed);
                            go_on(Step::Done(done.outcome))?;
                            Ok(done)
                        })
                        .collect::<Result<Vec<Done>, CampaignError>>()
                        .map(|done| (*part, done))
                })
                .collect::<Result<Vec<_>, CampaignError>>();
            let computed = match computed {
                Ok(computed) => computed,
                Err(error) => {
                    failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                    break 'waves;
                }
            };
            for part in computed {
                if sender.send(part).is_err() {
                    break 'waves;
                }
            }
        }
        drop(sender);
    });
    match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(Executed {
            runs,
            before,
            outcomes: counts.map(AtomicU64::into_inner),
            busy: Duration::from_nanos(busy_ns.into_inner()),
        }),
    }
}

fn length(range: Range<u64>) -> u64 {
    range.end - range.start
}

/// Records the flight if it is to be kept: it is flown again, which gives the same flight.
fn kept(store: &Store, done: Done, index: u64, keep: Keep) -> Result<Done, CampaignError> {
    let is_kept = match keep {
        Keep::Nothing => false,
        Keep::Failed => matches!(done.outcome, Outcome::Missed | Outcome::Stopped),
        Keep::All => done.outcome != Outcome::Error,
    };
    if is_kept {
        let run = store.plan().run(index);
        if let Work::Flight(flight) = &run.work {
            record(flight, &store.recording(&run.id))?;
        }
    }
    Ok(done)
}
