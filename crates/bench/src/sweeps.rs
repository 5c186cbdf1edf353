//! Where the plans of sweeps find what they name: beside the plan first, then in the library.

use std::path::{Path, PathBuf};

use bench_campaign::{Library, Unfound};
use bench_rig::{Mission, Rig, RigError};

use crate::{files, library, words};

/// The names of one plan.
pub struct Names<'a> {
    /// The plan's file.
    pub file: &'a Path,
}

impl Names<'_> {
    /// A file that a plan names stands beside it; beside an embedded plan nothing stands but the library.
    fn place(&self, name: &str) -> PathBuf {
        let folder = if library::is_embedded(self.file) { None } else { self.file.parent() };
        let beside = folder.map(|folder| folder.join(name)).filter(|place| place.exists());
        beside.unwrap_or_else(|| PathBuf::from(name))
    }
}

fn unfound(error: &anyhow::Error) -> Unfound {
    match error.downcast_ref::<RigError>() {
        Some(RigError::Invalid(own)) => Unfound::Problems(own.clone()),
        _ => Unfound::Words(words::causes(error)),
    }
}

impl Library for Names<'_> {
    fn rig(&self, name: &str) -> Result<Rig, Unfound> {
        files::rig(&self.place(name)).map_err(|error| unfound(&error))
    }

    fn missions(&self, name: &str, rig: &str) -> Result<Vec<(String, Mission)>, Unfound> {
        let place = self.place(name);
        let found = || {
            let single = files::mission_path(&place.to_string_lossy(), &self.place(rig));
            // A folder of missions stands for all of them.
            let paths = match single {
                Ok(path) => return Ok(vec![(name.to_owned(), files::read_mission(&path)?)]),
                Err(error) => match files::missions_at(&place) {
                    Ok(paths) if paths.len() > 1 || place.is_dir() => paths,
                    _ => return Err(error),
                },
            };
            let named = |path: &PathBuf| {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                Ok((stem, files::read_mission(path)?))
            };
            paths.iter().map(named).collect::<anyhow::Result<Vec<_>>>()
        };
        found().map_err(|error| unfound(&error))
    }

    fn recordings(&self, name: &str) -> Result<Vec<PathBuf>, Unfound> {
        let place = self.place(name);
        let failed =
            |error: std::io::Error| Unfound::Words(format!("{} cannot be read: {error}", place.display()));
        // Another machine of a cluster is in another folder.
        let place = place.canonicalize().map_err(failed)?;
        if !place.is_dir() {
            return Ok(vec![place]);
        }
        let mut found = Vec::new();
        for entry in place.read_dir().map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_some_and(|ending| ending == "mcap") {
                found.push(path);
            }
        }
        if found.is_empty() {
            return Err(Unfound::Words(format!("{} holds no file that ends in .mcap", place.display())));
        }
        found.sort();
        Ok(found)
    }
}
