//! What the Python package `bench` (beside this crate's sources) has of Rust: commands, and recordings as columns. Python's global
//! lock is released while either works.

use std::{
    ffi::OsString,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{RecvTimeoutError, channel},
    },
    thread,
    time::Duration,
};

use bench_recording::{Channel, Field, Kind, Recording, Value};
use pyo3::{
    create_exception,
    exceptions::PyException,
    prelude::*,
    types::{PyByteArray, PyDict, PyList},
};

create_exception!(bench, BenchError, PyException, "What went wrong, in the words of the command line.");

/// Between two looks whether the user wants the call to end.
const LOOK: Duration = Duration::from_millis(50);

/// Does what the words of a command say, and gives its result as JSON. Signals are heeded meanwhile.
#[pyfunction]
fn call(py: Python<'_>, words: Vec<OsString>) -> PyResult<String> {
    let stop = Arc::new(AtomicBool::new(false));
    let (tell, mut told) = channel();
    let heeds = Arc::clone(&stop);
    thread::spawn(move || {
        // Nobody hears it where the interpreter ended.
        let _ = tell.send(bench_cli::call(&words, heeds));
    });
    let mut interrupted = None;
    loop {
        let (back, result) = py.detach(move || {
            let result = told.recv_timeout(LOOK);
            (told, result)
        });
        told = back;
        match (result, interrupted.take()) {
            (Err(RecvTimeoutError::Timeout), None) => interrupted = py.check_signals().err(),
            (Err(RecvTimeoutError::Timeout), before) => interrupted = before,
            (_, Some(before)) => return Err(before),
            (Ok(result), None) => return result.map_err(BenchError::new_err),
            (Err(RecvTimeoutError::Disconnected), None) => {
                return Err(BenchError::new_err(
                    "the program failed, as it says on standard error; please report it",
                ));
            }
        }
        stop.fetch_or(interrupted.is_some(), Ordering::Relaxed);
    }
}

/// The values of one field in all records of its channel.
enum Column {
    Floats(Vec<f64>),
    Integers(Vec<u64>),
    Flags(Vec<bool>),
    Texts(Vec<String>),
}

impl Column {
    fn of(kind: Kind) -> Self {
        match kind {
            Kind::Float | Kind::Time => Self::Floats(Vec::new()),
            Kind::Integer => Self::Integers(Vec::new()),
            Kind::Bool => Self::Flags(Vec::new()),
            Kind::Text => Self::Texts(Vec::new()),
        }
    }

    /// What was not measured is NaN, in a column that was one of whole numbers or flags, too.
    fn push(&mut self, value: Value<'_>) {
        match (&mut *self, value) {
            (Self::Integers(column), Value::Integer(n)) => return column.push(n),
            (Self::Flags(column), Value::Bool(yes)) => return column.push(yes),
            (Self::Texts(column), Value::Text(text)) => return column.push(text.to_owned()),
            (Self::Texts(column), _) => return column.push(String::new()),
            (Self::Integers(column), _) => *self = Self::Floats(column.iter().map(|n| *n as f64).collect()),
            (Self::Flags(column), _) => {
                *self = Self::Floats(column.iter().map(|yes| f64::from(*yes)).collect());
            }
            (Self::Floats(_), _) => {}
        }
        let Self::Floats(column) = self else { return };
        column.push(match value {
            Value::Float(x) => x,
            Value::Time(time) => time.seconds(),
            Value::Integer(n) => n as f64,
            Value::Bool(yes) => f64::from(yes),
            Value::Missing | Value::Text(_) => f64::NAN,
        });
    }

    /// `NumPy`'s name of its type, and its bytes; texts as a list, without a type.
    fn into_python(self, py: Python<'_>) -> PyResult<(Option<&'static str>, Bound<'_, PyAny>)> {
        let bytes = |bytes: Vec<u8>| PyByteArray::new(py, &bytes).into_any();
        Ok(match self {
            Self::Floats(column) => {
                (Some("<f8"), bytes(column.iter().flat_map(|x| x.to_le_bytes()).collect()))
            }
            Self::Integers(column) => {
                (Some("<u8"), bytes(column.iter().flat_map(|n| n.to_le_bytes()).collect()))
            }
            Self::Flags(column) => (Some("?"), bytes(column.into_iter().map(u8::from).collect())),
            Self::Texts(column) => (None, PyList::new(py, column)?.into_any()),
        })
    }
}

/// The channels of a recording that have messages, each as its fields by name: a type of `NumPy` with bytes, or a list of texts.
#[pyfunction]
fn columns(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let read =
        py.detach(move || read(&path)).map_err(|error| BenchError::new_err(bench_cli::in_words(&error)))?;
    let channels = PyDict::new(py);
    for (channel, columns) in read {
        let fields = PyDict::new(py);
        for (field, column) in columns {
            fields.set_item(field.name, column.into_python(py)?)?;
        }
        channels.set_item(channel.topic(), fields)?;
    }
    Ok(channels)
}

type Columns = Vec<(&'static Field, Column)>;

fn read(path: &Path) -> anyhow::Result<Vec<(Channel, Columns)>> {
    let recording = Recording::open(path)?;
    let mut channels: Vec<(Channel, Columns)> = Channel::ALL
        .into_iter()
        .filter(|channel| recording.count(*channel) > 0)
        .map(|channel| {
            (channel, channel.fields().iter().map(|field| (field, Column::of(field.kind))).collect())
        })
        .collect();
    for record in recording.records()? {
        let record = record?;
        let of_channel = channels.iter_mut().find(|(channel, _)| *channel == record.channel());
        let Some((_, columns)) = of_channel else { continue };
        for ((_, column), value) in columns.iter_mut().zip(record.values()) {
            column.push(value);
        }
    }
    Ok(channels)
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("BenchError", module.py().get_type::<BenchError>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(call, module)?)?;
    module.add_function(wrap_pyfunction!(columns, module)?)
}
