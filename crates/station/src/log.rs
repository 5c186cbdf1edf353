//! The log itself.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use rusqlite::{
    Connection, OpenFlags, OptionalExtension as _, Row, TransactionBehavior, params, params_from_iter,
    types::Value,
};

use crate::{
    StationError,
    schema::{APPLICATION_ID, FORM, TABLES},
};

/// Name of the log in the station's folder.
const FILE: &str = "runs.sqlite";
/// Folder of the recordings in the station's.
const RECORDINGS: &str = "recordings";
/// How long a writer waits for others. A transaction takes milliseconds.
const BUSY: Duration = Duration::from_secs(20);
/// What stands as outcome of a run that has begun and not ended.
const BEGUN: &str = "begun";

/// What is flown: what is known of a run when it begins.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Entry {
    /// When it begins, seconds since 1970 (UTC).
    pub started_unix_s: f64,
    /// The suite's name.
    pub suite: String,
    /// The test's name within the suite.
    pub test: String,
    /// The rig's name.
    pub rig: String,
    /// The mission's name.
    pub mission: String,
    /// How it is flown.
    pub mode: String,
    /// Effects that were added; empty where there are none.
    pub effects: String,
    /// Seed of its noise.
    pub seed: u64,
    /// Which repeat it is, from zero.
    pub repeat: u32,
    /// Version of the bench.
    pub bench_version: String,
}

/// A run that was entered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Begun {
    /// Its number in the log.
    pub id: i64,
    /// Where its recording goes; nothing is there yet.
    pub recording: PathBuf,
}

/// What a run came to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Finished {
    /// `passed`, `failed` or `error`.
    pub outcome: String,
    /// Why it did not pass.
    pub reason: Option<String>,
    /// How long it took, s.
    pub took_s: f64,
    /// SHA-256 of the recording, where there is one.
    pub sha256: Option<String>,
    /// Figures by name.
    pub figures: BTreeMap<String, f64>,
}

/// A run as the log holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Its number.
    pub id: i64,
    /// What was flown.
    pub entry: Entry,
    /// When it began, as ISO 8601 writes it, in UTC, to the second.
    pub started_utc: String,
    /// How long it took, s; `None` where it did not end.
    pub took_s: Option<f64>,
    /// `passed`, `failed`, `error`, or `begun` where it did not end.
    pub outcome: String,
    /// Why it did not pass.
    pub reason: Option<String>,
    /// The recording, from the station's folder.
    pub recording: String,
    /// SHA-256 of the recording.
    pub sha256: Option<String>,
}

/// Which runs are wanted; what is absent does not restrict.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// Of this suite.
    pub suite: Option<String>,
    /// Whose test's name holds this text.
    pub test: Option<String>,
    /// On this rig.
    pub rig: Option<String>,
    /// Of this mission.
    pub mission: Option<String>,
    /// In this mode.
    pub mode: Option<String>,
    /// That came to this.
    pub outcome: Option<String>,
    /// Begun at this instant or later, seconds since 1970.
    pub since_unix_s: Option<f64>,
    /// Begun before this instant.
    pub before_unix_s: Option<f64>,
    /// With this of the station.
    pub meta: Vec<(String, String)>,
}

/// A station's log, open.
#[derive(Debug)]
pub struct Log {
    folder: PathBuf,
    path: PathBuf,
    pub(crate) connection: Connection,
}

impl Log {
    /// Opens the log of a station's folder; both are made where they are not there.
    pub fn open(folder: &Path) -> Result<Self, StationError> {
        fs::create_dir_all(folder)
            .map_err(|source| StationError::Folder { path: folder.to_owned(), source })?;
        let path = folder.join(FILE);
        let failed = |source| StationError::Database { path: path.clone(), source };
        let mut connection = Connection::open(&path).map_err(failed)?;
        connection.busy_timeout(BUSY).map_err(failed)?;
        // In the write-ahead log a killed process leaves the last whole transaction, and readers do not wait for writers.
        connection.pragma_update(None, "journal_mode", "wal").map_err(failed)?;
        connection.pragma_update(None, "synchronous", "normal").map_err(failed)?;
        connection.pragma_update(None, "foreign_keys", true).map_err(failed)?;
        let transaction =
            connection.transaction_with_behavior(TransactionBehavior::Immediate).map_err(failed)?;
        let tables: i64 = transaction
            .query_row("SELECT count(*) FROM sqlite_schema WHERE type = 'table'", [], |row| row.get(0))
            .map_err(failed)?;
        if tables == 0 {
            transaction.execute_batch(TABLES).map_err(failed)?;
            transaction.pragma_update(None, "application_id", APPLICATION_ID).map_err(failed)?;
            transaction.pragma_update(None, "user_version", FORM).map_err(failed)?;
        }
        transaction.commit().map_err(failed)?;
        Self::checked(folder, path, connection)
    }

    /// Opens a log that is there, to read it.
    pub fn read(folder: &Path) -> Result<Self, StationError> {
        let path = folder.join(FILE);
        if !path.is_file() {
            return Err(StationError::Absent { path: folder.to_owned() });
        }
        let failed = |source| StationError::Database { path: path.clone(), source };
        // A reader of a write-ahead log shares memory with its writers, and so may have to make a file.
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(&path, flags).map_err(failed)?;
        connection.busy_timeout(BUSY).map_err(failed)?;
        Self::checked(folder, path, connection)
    }

    fn checked(folder: &Path, path: PathBuf, connection: Connection) -> Result<Self, StationError> {
        let number = |name: &str| {
            connection
                .pragma_query_value(None, name, |row| row.get::<_, i64>(0))
                .map_err(|source| StationError::Database { path: path.clone(), source })
        };
        if number("application_id")? != APPLICATION_ID {
            return Err(StationError::Foreign { path });
        }
        let found = number("user_version")?;
        if found > FORM {
            return Err(StationError::Newer { path, found, known: FORM });
        }
        Ok(Self { folder: folder.to_owned(), path, connection })
    }

    fn failed(&self, source: rusqlite::Error) -> StationError {
        StationError::Database { path: self.path.clone(), source }
    }

    /// Enters a run with what is known of station and airframe, and gives its recording a name that no other has. It ends in `stem`:
    /// letters, digits and `._-=`.
    pub fn begin(
        &mut self,
        entry: &Entry,
        meta: &BTreeMap<String, String>,
        stem: &str,
    ) -> Result<Begun, StationError> {
        let path = self.path.clone();
        let failed = |source| StationError::Database { path: path.clone(), source };
        let transaction =
            self.connection.transaction_with_behavior(TransactionBehavior::Immediate).map_err(failed)?;
        transaction
            .prepare_cached(
                "INSERT INTO runs (started_unix_s, suite, test, rig, mission, mode, effects, seed, repeat, bench_version, outcome, \
                 recording) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, '')",
            )
            .and_then(|mut insert| {
                insert.execute(params![
                    entry.started_unix_s,
                    entry.suite,
                    entry.test,
                    entry.rig,
                    entry.mission,
                    entry.mode,
                    entry.effects,
                    entry.seed.cast_signed(),
                    entry.repeat,
                    entry.bench_version,
                    BEGUN,
                ])
            })
            .map_err(failed)?;
        let id = transaction.last_insert_rowid();
        let month: String = transaction
            .query_row("SELECT strftime('%Y-%m', ?1, 'unixepoch')", [entry.started_unix_s], |row| row.get(0))
            .map_err(failed)?;
        let recording = format!("{RECORDINGS}/{month}/{id:06}_{stem}.mcap");
        transaction
            .execute("UPDATE runs SET recording = ?2 WHERE id = ?1", params![id, recording])
            .map_err(failed)?;
        for (key, value) in meta {
            transaction
                .execute("INSERT INTO meta (run, key, value) VALUES (?1, ?2, ?3)", params![id, key, value])
                .map_err(failed)?;
        }
        transaction.commit().map_err(failed)?;
        let recording = self.folder.join(recording);
        if let Some(folder) = recording.parent() {
            fs::create_dir_all(folder)
                .map_err(|source| StationError::Folder { path: folder.to_owned(), source })?;
        }
        Ok(Begun { id, recording })
    }

    /// Says what a run came to.
    pub fn finish(&mut self, id: i64, finished: &Finished) -> Result<(), StationError> {
        let path = self.path.clone();
        let failed = |source| StationError::Database { path: path.clone(), source };
        let transaction =
            self.connection.transaction_with_behavior(TransactionBehavior::Immediate).map_err(failed)?;
        transaction
            .execute(
                "UPDATE runs SET outcome = ?2, reason = ?3, took_s = ?4, sha256 = ?5 WHERE id = ?1",
                params![id, finished.outcome, finished.reason, finished.took_s, finished.sha256],
            )
            .map_err(failed)?;
        for (name, value) in finished.figures.iter().filter(|(_, value)| value.is_finite()) {
            transaction
                .prepare_cached("INSERT OR REPLACE INTO figures (name, run, value) VALUES (?1, ?2, ?3)")
                .and_then(|mut insert| insert.execute(params![name, id, value]))
                .map_err(failed)?;
        }
        transaction.commit().map_err(failed)
    }

    /// Runs, the latest first, `limit` of them at most.
    pub fn runs(&self, filter: &Filter, limit: Option<u64>) -> Result<Vec<Run>, StationError> {
        let (condition, mut values) = filter.sql();
        values.push(Value::Integer(limit.map_or(-1, |limit| i64::try_from(limit).unwrap_or(i64::MAX))));
        let sql = format!(
            "SELECT id, started_unix_s, suite, test, rig, mission, mode, effects, seed, repeat, bench_version, \
             strftime('%Y-%m-%dT%H:%M:%SZ', started_unix_s, 'unixepoch'), took_s, outcome, reason, recording, sha256 \
             FROM runs WHERE {condition} ORDER BY started_unix_s DESC, id DESC LIMIT ?"
        );
        let mut select = self.connection.prepare(&sql).map_err(|error| self.failed(error))?;
        let rows = select.query_map(params_from_iter(values), run).map_err(|error| self.failed(error))?;
        rows.collect::<Result<_, _>>().map_err(|error| self.failed(error))
    }

    /// How many runs there are.
    pub fn count(&self, filter: &Filter) -> Result<u64, StationError> {
        let (condition, values) = filter.sql();
        let sql = format!("SELECT count(*) FROM runs WHERE {condition}");
        let count: i64 = self
            .connection
            .query_row(&sql, params_from_iter(values), |row| row.get(0))
            .map_err(|error| self.failed(error))?;
        Ok(count.unsigned_abs())
    }

    /// What is known of the station for a run.
    pub fn meta(&self, run: i64) -> Result<BTreeMap<String, String>, StationError> {
        let mut select = self
            .connection
            .prepare_cached("SELECT key, value FROM meta WHERE run = ?1")
            .map_err(|error| self.failed(error))?;
        let rows = select
            .query_map([run], |row| Ok((row.get(0)?, row.get(1)?)))
            .map_err(|error| self.failed(error))?;
        rows.collect::<Result<_, _>>().map_err(|error| self.failed(error))
    }

    /// The figures of a run.
    pub fn figures(&self, run: i64) -> Result<BTreeMap<String, f64>, StationError> {
        let mut select = self
            .connection
            .prepare_cached("SELECT name, value FROM figures WHERE run = ?1")
            .map_err(|error| self.failed(error))?;
        let rows = select
            .query_map([run], |row| Ok((row.get(0)?, row.get(1)?)))
            .map_err(|error| self.failed(error))?;
        rows.collect::<Result<_, _>>().map_err(|error| self.failed(error))
    }

    /// The names of all figures that the log holds.
    pub fn figure_names(&self) -> Result<Vec<String>, StationError> {
        let mut select = self
            .connection
            .prepare("SELECT DISTINCT name FROM figures ORDER BY name")
            .map_err(|error| self.failed(error))?;
        let rows = select.query_map([], |row| row.get(0)).map_err(|error| self.failed(error))?;
        rows.collect::<Result<_, _>>().map_err(|error| self.failed(error))
    }

    /// A figure over time, the earliest first: week of ISO 8601 (`2026-W48`), instant in seconds since 1970, value.
    pub(crate) fn series(
        &self,
        figure: &str,
        filter: &Filter,
    ) -> Result<Vec<(String, f64, f64)>, StationError> {
        let (condition, values) = filter.sql();
        let sql = format!(
            "SELECT strftime('%G-W%V', started_unix_s, 'unixepoch'), started_unix_s, figures.value FROM figures \
             JOIN runs ON runs.id = figures.run WHERE figures.name = ? AND {condition} ORDER BY started_unix_s, runs.id"
        );
        let values = std::iter::once(Value::Text(figure.to_owned())).chain(values);
        let mut select = self.connection.prepare(&sql).map_err(|error| self.failed(error))?;
        let rows = select
            .query_map(params_from_iter(values), |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))
            .map_err(|error| self.failed(error))?;
        rows.collect::<Result<_, _>>().map_err(|error| self.failed(error))
    }

    /// The instant at which a day begins, `2026-11-25` or with a time behind it (UTC), in seconds since 1970; `None` where the text is
    /// no date.
    pub fn instant(&self, text: &str) -> Result<Option<f64>, StationError> {
        let is_date = text.len() >= 10 && text.as_bytes()[4] == b'-';
        let seconds: Option<Option<i64>> = self
            .connection
            .query_row("SELECT unixepoch(?1)", [text], |row| row.get(0))
            .optional()
            .map_err(|error| self.failed(error))?;
        Ok(seconds.flatten().filter(|_| is_date).map(|seconds| seconds as f64))
    }
}

impl Filter {
    /// The condition, with a question mark for each of the values.
    fn sql(&self) -> (String, Vec<Value>) {
        let mut conditions = vec!["1".to_owned()];
        let mut values = Vec::new();
        let equal = [
            ("suite", &self.suite),
            ("rig", &self.rig),
            ("mission", &self.mission),
            ("mode", &self.mode),
            ("outcome", &self.outcome),
        ];
        for (column, wanted) in equal {
            if let Some(wanted) = wanted {
                conditions.push(format!("{column} = ?"));
                values.push(Value::Text(wanted.clone()));
            }
        }
        if let Some(part) = &self.test {
            conditions.push("instr(test, ?) > 0".to_owned());
            values.push(Value::Text(part.clone()));
        }
        if let Some(since) = self.since_unix_s {
            conditions.push("started_unix_s >= ?".to_owned());
            values.push(Value::Real(since));
        }
        if let Some(before) = self.before_unix_s {
            conditions.push("started_unix_s < ?".to_owned());
            values.push(Value::Real(before));
        }
        for (key, value) in &self.meta {
            conditions.push(
                "EXISTS (SELECT 1 FROM meta WHERE meta.run = runs.id AND meta.key = ? AND meta.value = ?)"
                    .to_owned(),
            );
            values.push(Value::Text(key.clone()));
            values.push(Value::Text(value.clone()));
        }
        (conditions.join(" AND "), values)
    }
}

fn run(row: &Row<'_>) -> rusqlite::Result<Run> {
    Ok(Run {
        id: row.get(0)?,
        entry: Entry {
            started_unix_s: row.get(1)?,
            suite: row.get(2)?,
            test: row.get(3)?,
            rig: row.get(4)?,
            mission: row.get(5)?,
            mode: row.get(6)?,
            effects: row.get(7)?,
            seed: row.get::<_, i64>(8)?.cast_unsigned(),
            repeat: row.get(9)?,
            bench_version: row.get(10)?,
        },
        started_utc: row.get(11)?,
        took_s: row.get(12)?,
        outcome: row.get(13)?,
        reason: row.get(14)?,
        recording: row.get(15)?,
        sha256: row.get(16)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_file_system_is_an_error_and_costs_nothing_that_was_entered() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::open(folder.path()).unwrap();
        let entry = Entry { suite: "x".repeat(2000), ..Entry::default() };
        let begin = |log: &mut Log| log.begin(&entry, &BTreeMap::new(), "x");
        begin(&mut log).unwrap();
        // SQLite answers a full file system and a full quota of pages alike.
        let pages: i64 = log.connection.pragma_query_value(None, "page_count", |row| row.get(0)).unwrap();
        log.connection.pragma_update(None, "max_page_count", pages).unwrap();
        let mut entered = 1;
        let error = loop {
            match begin(&mut log) {
                Ok(_) => entered += 1,
                Err(error) => break error,
            }
            assert!(entered < 1000, "it never was full");
        };
        assert!(error.to_string().contains("full"), "{error}");
        assert_eq!(log.count(&Filter::default()).unwrap(), entered);
        // With room again it goes on.
        log.connection.pragma_update(None, "max_page_count", 1_000_000).unwrap();
        let begun = begin(&mut log).unwrap();
        log.finish(begun.id, &Finished::default()).unwrap();
        assert_eq!(log.count(&Filter::default()).unwrap(), entered + 1);
    }
}
