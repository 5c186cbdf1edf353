//! Output files that appear whole or not at all.

use std::{
    ffi::OsString,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    process,
};

use crate::RecordingError;

/// A file under a temporary name beside its destination; removed unless it is completed.
#[derive(Debug)]
pub(crate) struct PartialFile {
    destination: PathBuf,
    temporary: PathBuf,
    completed: bool,
}

impl PartialFile {
    /// Creates the temporary file. An ordinary file at the destination will be replaced; anything else is refused.
    pub fn create(destination: &Path) -> Result<(Self, File), RecordingError> {
        if fs::metadata(destination).is_ok_and(|metadata| !metadata.is_file()) {
            return Err(RecordingError::OutputNotAFile { path: destination.to_owned() });
        }
        let mut name = OsString::from(".");
        name.push(destination.file_name().unwrap_or_default());
        name.push(format!(".{}.partial", process::id()));
        let temporary = destination.with_file_name(name);
        let file = File::create(&temporary).map_err(|source| RecordingError::Io {
            action: "create",
            path: destination.to_owned(),
            source,
        })?;
        Ok((Self { destination: destination.to_owned(), temporary, completed: false }, file))
    }

    /// Where it is until it is completed.
    pub fn temporary(&self) -> &Path {
        &self.temporary
    }

    /// Puts the file on disk and in its place.
    pub fn complete(mut self, file: &File) -> Result<(), RecordingError> {
        file.sync_all().and_then(|()| fs::rename(&self.temporary, &self.destination)).map_err(|source| {
            RecordingError::Io { action: "write", path: self.destination.clone(), source }
        })?;
        self.completed = true;
        Ok(())
    }

    /// The error for a failed write.
    pub fn error(&self, source: io::Error) -> RecordingError {
        RecordingError::Io { action: "write", path: self.destination.clone(), source }
    }
}

impl Drop for PartialFile {
    fn drop(&mut self) {
        if !self.completed {
            // Nothing depends on it; a file that cannot be removed is only untidy.
            let _ = fs::remove_file(&self.temporary);
        }
    }
}
