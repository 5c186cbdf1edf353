//! The tables of the log.

/// Marks the file as a log of a station: `BNCH` in ASCII.
pub const APPLICATION_ID: i64 = 0x424e_4348;
/// The form of the tables.
pub const FORM: i64 = 1;

/// Makes the tables.
pub const TABLES: &str = "
CREATE TABLE runs (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    started_unix_s REAL NOT NULL,
    took_s REAL,
    suite TEXT NOT NULL,
    test TEXT NOT NULL,
    rig TEXT NOT NULL,
    mission TEXT NOT NULL,
    mode TEXT NOT NULL,
    effects TEXT NOT NULL,
    seed INTEGER NOT NULL,
    repeat INTEGER NOT NULL,
    outcome TEXT NOT NULL,
    reason TEXT,
    recording TEXT NOT NULL,
    sha256 TEXT,
    bench_version TEXT NOT NULL
) STRICT;
CREATE INDEX runs_by_time ON runs (started_unix_s);
CREATE TABLE meta (
    run INTEGER NOT NULL REFERENCES runs (id),
    key TEXT NOT NULL,
    value TEXT NOT NULL,
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;
CREATE TABLE figures (
    name TEXT NOT NULL,
    run INTEGER NOT NULL REFERENCES runs (id),
    value REAL NOT NULL,
    PRIMARY KEY (name, run)
) STRICT, WITHOUT ROWID;
CREATE INDEX figures_by_run ON figures (run);
";
