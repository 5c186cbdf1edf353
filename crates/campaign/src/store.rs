//! The folder of a sweep, which several machines may share:
//!
//! ```text
//! plan.json                    the plan with its rigs and missions
//! parts/part-00000000.parquet  results of so many runs, written whole or not at all
//! timing/...                   how long each of them took and where: the only thing that differs from machine to machine
//! recordings/ID.mcap           where they are kept
//! locks/                       who runs which shard
//! results.parquet, timing.parquet  all parts in the order of the plan
//! ```
//!
//! A part's name and content follow from the plan alone. Whoever makes it makes the same bytes, so that nothing is counted twice.

use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io::{self, BufWriter, Read as _, Write as _},
    path::{Path, PathBuf},
    process,
};

use bench_recording::CellKind;

use crate::{
    CampaignError, Done, Plan, Shard, VERSION, columns,
    plan::{STORED, StoredPlan},
    table::{Cell, Column, Table, TableWriter, label},
};

/// Name of the kept plan.
pub(crate) const PLAN: &str = "plan.json";
const PARTS: &str = "parts";
const TIMING: &str = "timing";
const LOCKS: &str = "locks";
const RECORDINGS: &str = "recordings";
/// Name of the merged results.
pub const RESULTS: &str = "results.parquet";
/// Name of the merged timing.
pub const TIMES: &str = "timing.parquet";
const PARTIAL: &str = ".partial";

/// A sweep's folder and its plan.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    plan: Plan,
}

/// Keeps other processes off a shard for as long as it lives; the system lets go of it with the process, however that ends.
#[derive(Debug)]
pub struct ShardLock {
    _file: File,
}

fn failed(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> CampaignError {
    let path = path.to_owned();
    move |source| CampaignError::Io { action, path, source }
}

impl Store {
    /// Begins a sweep in a new or empty folder, or goes on with the same one.
    pub fn begin(folder: &Path, plan: Plan) -> Result<Self, CampaignError> {
        if folder.exists() && !folder.is_dir() {
            let source = io::Error::other("it is no folder; name another");
            return Err(CampaignError::Io { action: "use", path: folder.to_owned(), source });
        }
        fs::create_dir_all(folder).map_err(failed("make the folder", folder))?;
        let kept = folder.join(PLAN);
        if !kept.exists() {
            let strange = fs::read_dir(folder).map_err(failed("read", folder))?.next().is_some();
            if strange && !folder.join(LOCKS).exists() {
                let source = io::Error::other("it is not empty and holds no sweep; name another folder");
                return Err(CampaignError::Io { action: "use", path: folder.to_owned(), source });
            }
            for within in [LOCKS, PARTS, TIMING] {
                let path = folder.join(within);
                fs::create_dir_all(&path).map_err(failed("make the folder", &path))?;
            }
            let text = serde_json::to_vec_pretty(&plan.to_store())
                .map_err(|error| failed("write", &kept)(error.into()))?;
            whole(&kept, |file| file.write_all(&text).map_err(failed("write", &kept)), false)?;
        }
        let store = Self { folder: folder.to_owned(), plan };
        let stored = store.stored()?;
        if stored.id != store.plan.id() {
            let start = stored.id.get(..8).unwrap_or_default();
            return Err(CampaignError::OtherPlan {
                folder: folder.to_owned(),
                is: format!("{}, {start}", stored.name),
            });
        }
        if stored.bench_version != VERSION {
            return Err(CampaignError::OtherVersion { folder: folder.to_owned(), by: stored.bench_version });
        }
        Ok(store)
    }

    /// Opens a sweep that was begun.
    pub fn open(folder: &Path) -> Result<Self, CampaignError> {
        let stored = read_stored(folder)?;
        if stored.bench_version != VERSION {
            return Err(CampaignError::OtherVersion { folder: folder.to_owned(), by: stored.bench_version });
        }
        let plan = Plan::restore(&stored)?;
        if plan.id() != stored.id {
            return Err(CampaignError::Damaged {
                path: folder.join(PLAN),
                detail: "its content is not what its id says".to_owned(),
            });
        }
        Ok(Self { folder: folder.to_owned(), plan })
    }

    fn stored(&self) -> Result<StoredPlan, CampaignError> {
        read_stored(&self.folder)
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Where a run's recording is kept.
    pub fn recording(&self, id: &str) -> PathBuf {
        self.folder.join(RECORDINGS).join(format!("{id}.mcap"))
    }

    fn part(&self, of: &str, part: u64) -> PathBuf {
        self.folder.join(of).join(format!("part-{part:08}.parquet"))
    }

    fn label(&self, part: u64) -> String {
        format!("{} {part}", self.plan.id())
    }

    /// Whether a part is there and whole. What was cut, or is of another plan, is not trusted.
    pub fn is_done(&self, part: u64) -> bool {
        let range = self.plan.runs_of_part(part);
        label(&self.part(PARTS, part)) == Some((self.label(part), (range.end - range.start) as usize))
    }

    /// Parts of a shard that are not done yet, and runs of the shard that are.
    pub fn unfinished(&self, shard: Shard) -> (Vec<u64>, u64) {
        let mut done = 0;
        let mut missing = Vec::new();
        for part in shard.parts(self.plan.parts()) {
            if self.is_done(part) {
                let range = self.plan.runs_of_part(part);
                done += range.end - range.start;
            } else {
                missing.push(part);
            }
        }
        (missing, done)
    }

    /// Keeps other processes off a shard. Where a file system knows no locks nothing is kept off, which wastes work and spoils nothing.
    pub fn lock(&self, shard: Shard) -> Result<ShardLock, CampaignError> {
        let Shard { number, of } = shard;
        let path = self.folder.join(LOCKS).join(format!("shard-{number}-of-{of}.lock"));
        let options = OpenOptions::new().write(true).create(true).truncate(false).open(&path);
        let file = options.map_err(failed("write", &path))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(CampaignError::InUse { folder: self.folder.clone(), shard });
            }
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {}
            Err(TryLockError::Error(source)) => return Err(failed("lock", &path)(source)),
        }
        Ok(ShardLock { _file: file })
    }

    /// Removes what processes of this machine that are no more have left half written.
    pub(crate) fn remove_left_over(&self) {
        let host = host();
        for within in [PARTS, TIMING] {
            for entry in fs::read_dir(self.folder.join(within)).into_iter().flatten().flatten() {
                let name = entry.file_name().to_string_lossy().into_owned();
                let writer = name.strip_suffix(PARTIAL).and_then(|name| {
                    let (_, rest) = name.split_once(&format!(".{host}-"))?;
                    rest.split('.').next()?.parse::<u32>().ok()
                });
                if writer.is_some_and(|id| !Path::new(&format!("/proc/{id}")).exists()) {
                    // Nothing depends on it; a file that cannot be removed is only untidy.
                    let _ = fs::remove_file(entry.path());
                }
            }
        }
    }

    /// Writes a part, whole or not at all. `done` are its runs in the order of the plan.
    pub fn write_part(&self, part: u64, done: &[Done]) -> Result<(), CampaignError> {
        let host = host();
        let times = self.part(TIMING, part);
        let by = format!("{host} {}", process::id());
        write_table(&times, &timing_columns(), &self.label(part), |writer| {
            for done in done {
                let id = done.row.first().cloned().unwrap_or(Cell::Absent);
                writer.row(&[id, Cell::Number(done.took.as_secs_f64()), Cell::text(by.as_str())])?;
            }
            Ok(())
        })?;
        write_table(&self.part(PARTS, part), &columns(&self.plan), &self.label(part), |writer| {
            done.iter().try_for_each(|done| writer.row(&done.row))
        })
    }

    /// Puts all parts into one table, in the order of the plan. Only when all are there and whole; killed, nothing of it is left or lost.
    pub fn merge(&self) -> Result<PathBuf, CampaignError> {
        let (missing, done) = self.unfinished(Shard::WHOLE);
        if !missing.is_empty() {
            let all = self.plan.runs();
            return Err(CampaignError::Unfinished { folder: self.folder.clone(), missing: all - done, all });
        }
        let results = self.folder.join(RESULTS);
        self.gather(PARTS, &results, &columns(&self.plan))?;
        self.gather(TIMING, &self.folder.join(TIMES), &timing_columns())?;
        Ok(results)
    }

    fn gather(&self, of: &str, to: &Path, columns: &[Column]) -> Result<(), CampaignError> {
        let mut failure = None;
        let written = write_table(to, columns, self.plan.id(), |writer| {
            for part in 0..self.plan.parts() {
                let path = self.part(of, part);
                // How long a run took is good to know, and no result: a part without it is still a part.
                if of == TIMING && !path.exists() {
                    continue;
                }
                let copied = Table::open(&path).and_then(|table| {
                    if table.columns() != columns {
                        return Err(CampaignError::Damaged {
                            path: path.clone(),
                            detail: "it has other columns".to_owned(),
                        });
                    }
                    table.for_each_group(|cells| {
                        writer
                            .rows(cells)
                            .map_err(|source| CampaignError::Table { path: to.to_owned(), source })
                    })
                });
                if let Err(error) = copied {
                    failure = Some(error);
                    return Err(parquet::errors::ParquetError::General("a part cannot be read".to_owned()));
                }
            }
            Ok(())
        });
        failure.map_or(written, Err)
    }

    /// The merged results, if they are there and of this plan.
    pub fn results(&self) -> Option<PathBuf> {
        let path = self.folder.join(RESULTS);
        (label(&path) == Some((self.plan.id().to_owned(), self.plan.runs() as usize))).then_some(path)
    }

    /// The run with an id, or with one that begins so.
    pub fn find(&self, id: &str) -> Result<u64, CampaignError> {
        const LEAST: usize = 8;
        let begins = |index: &u64| self.plan.run(*index).id.starts_with(id);
        let known = id.len() >= LEAST && id.bytes().all(|byte| byte.is_ascii_hexdigit());
        let found = known.then(|| (0..self.plan.runs()).find(begins)).flatten();
        found.ok_or_else(|| CampaignError::NoRun { folder: self.folder.clone(), id: id.to_owned() })
    }
}

fn read_stored(folder: &Path) -> Result<StoredPlan, CampaignError> {
    let path = folder.join(PLAN);
    let mut text = String::new();
    match File::open(&path).and_then(|mut file| file.read_to_string(&mut text)) {
        Ok(_) => {}
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(CampaignError::NoSweep { folder: folder.to_owned() });
        }
        Err(source) => return Err(failed("read", &path)(source)),
    }
    let damaged = |detail: String| CampaignError::Damaged { path: path.clone(), detail };
    let stored: StoredPlan = serde_json::from_str(&text).map_err(|error| damaged(error.to_string()))?;
    if stored.schema != STORED {
        return Err(damaged(format!("it is {}, not {STORED}", stored.schema)));
    }
    Ok(stored)
}

fn timing_columns() -> Vec<Column> {
    vec![
        Column::new("id", CellKind::Text),
        Column::new("took_s", CellKind::Number),
        Column::new("by", CellKind::Text),
    ]
}

/// Rows as a part holds them.
pub fn encoded(plan: &Plan, done: &[Done]) -> Result<Vec<u8>, CampaignError> {
    let write = || {
        let mut writer = TableWriter::new(Vec::new(), &columns(plan), plan.id())?;
        done.iter().try_for_each(|done| writer.row(&done.row))?;
        writer.finish()
    };
    write().map_err(|source| CampaignError::Table { path: PathBuf::from(RESULTS), source })
}

/// In the name of a file that is not whole yet: who writes it.
fn own_mark() -> String {
    format!("{}-{}.", host(), process::id())
}

/// This machine's name, for who looks for a slow one.
fn host() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    if name.trim().is_empty() { "unknown".to_owned() } else { name.trim().to_owned() }
}

type Rows<'a> = TableWriter<BufWriter<&'a mut File>>;

fn write_table(
    path: &Path,
    columns: &[Column],
    label: &str,
    fill: impl FnOnce(&mut Rows<'_>) -> Result<(), parquet::errors::ParquetError>,
) -> Result<(), CampaignError> {
    let table = |source| match source {
        // What the disk said is told as such.
        parquet::errors::ParquetError::External(error) => match error.downcast::<io::Error>() {
            Ok(source) => CampaignError::Io { action: "write", path: path.to_owned(), source: *source },
            Err(error) => CampaignError::Table {
                path: path.to_owned(),
                source: parquet::errors::ParquetError::External(error),
            },
        },
        source => CampaignError::Table { path: path.to_owned(), source },
    };
    let fill = |file: &mut File| {
        let mut writer = TableWriter::new(BufWriter::new(file), columns, label).map_err(table)?;
        fill(&mut writer).map_err(table)?;
        let mut buffered = writer.finish().map_err(table)?;
        buffered.flush().map_err(failed("write", path))
    };
    whole(path, fill, true)
}

/// Writes a file under another name, puts it on the disk, and only then gives it its own. Where the name must be new and is taken, what
/// has it stays.
fn whole(
    path: &Path,
    fill: impl FnOnce(&mut File) -> Result<(), CampaignError>,
    replace: bool,
) -> Result<(), CampaignError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut temporary = tempfile::Builder::new()
        .prefix(&format!(".{name}.{}", own_mark()))
        .suffix(PARTIAL)
        .tempfile_in(folder)
        .map_err(failed("write", path))?;
    fill(temporary.as_file_mut())?;
    temporary.as_file().sync_all().map_err(failed("write", path))?;
    // Others of the group read the folder as they read any file of it.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let permissions = fs::Permissions::from_mode(0o644);
        temporary.as_file().set_permissions(permissions).map_err(failed("write", path))?;
    }
    if replace {
        temporary.persist(path).map_err(|error| failed("write", path)(error.error))?;
    } else if let Err(error) = temporary.persist_noclobber(path)
        && error.error.kind() != io::ErrorKind::AlreadyExists
    {
        return Err(failed("write", path)(error.error));
    }
    // The name, too, is on the disk before it counts.
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(failed("write", folder))
}
