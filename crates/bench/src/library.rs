//! The rigs, airframes, missions, import maps and balance tables that come with the program. They are embedded, so that an
//! installed program finds them in any folder; a file on the disk always wins over a name of the library.

use std::{
    io,
    path::{Component, Path, PathBuf},
};

use include_dir::{Dir, include_dir};

static FILES: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../rigs");

/// Stands before the path of an embedded file, here and in messages. No shell writes such a folder by chance.
const ROOT: &str = "<built-in>";

/// What a file of the library is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Rig,
    Airframe,
    Mission,
    ImportMap,
    BalanceTable,
    Suite,
    Sweep,
}

/// The maps for logs of topics, in the order in which they are tried: those that take less for granted first.
pub const LOG_MAPS: [&str; 12] = [
    "px4-vision",
    "px4",
    "px4-old",
    "ardupilot-vision",
    "ardupilot",
    "inav",
    "betaflight",
    "crazyflie",
    "ros2-px4",
    "ros2-mavros",
    "ros2-odometry",
    "ros2-pose",
];

impl Kind {
    /// All kinds, in the order in which they are listed.
    pub const ALL: [Self; 7] = [
        Self::Rig,
        Self::Airframe,
        Self::Mission,
        Self::ImportMap,
        Self::BalanceTable,
        Self::Suite,
        Self::Sweep,
    ];

    /// What one is called.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rig => "rig",
            Self::Airframe => "airframe",
            Self::Mission => "mission",
            Self::ImportMap => "import map",
            Self::BalanceTable => "balance table",
            Self::Suite => "suite",
            Self::Sweep => "sweep",
        }
    }

    /// Where they lie in the library; rigs lie at its top.
    pub const fn folder(self) -> &'static str {
        match self {
            Self::Rig => "",
            Self::Airframe => "airframes",
            Self::Mission => "missions",
            Self::ImportMap => "import",
            Self::BalanceTable => "balance",
            Self::Suite => "suites",
            Self::Sweep => "sweeps",
        }
    }

    const fn extension(self) -> &'static str {
        match self {
            Self::BalanceTable => "csv",
            _ => "toml",
        }
    }

    /// The names of this kind, sorted.
    pub fn names(self) -> Vec<String> {
        let mut names = Vec::new();
        let folder = match self.folder() {
            "" => Some(&FILES),
            folder => FILES.get_dir(folder),
        };
        let mut folders: Vec<&Dir<'_>> = folder.into_iter().collect();
        while let Some(folder) = folders.pop() {
            names.extend(
                folder
                    .files()
                    .filter(|file| file.path().extension().is_some_and(|ending| ending == self.extension()))
                    .filter_map(|file| {
                        let path = file.path().strip_prefix(self.folder()).unwrap_or(file.path());
                        Some(path.with_extension("").to_str()?.to_owned())
                    }),
            );
            // Only missions stand in folders of their own; the folders beside the rigs hold the other kinds.
            if self != Self::Rig {
                folders.extend(folder.dirs());
            }
        }
        names.sort();
        names
    }

    /// The path of one, by its name.
    pub fn find(self, name: &str) -> Option<PathBuf> {
        let known = self.names().iter().any(|known| known == name);
        known.then(|| {
            let file = format!("{name}.{}", self.extension());
            [ROOT, self.folder(), &file].iter().filter(|part| !part.is_empty()).collect()
        })
    }

    /// The missions, say, of a folder within this kind's, in the order of their names.
    pub fn within(self, folder: &str) -> Vec<PathBuf> {
        let prefix = format!("{folder}/");
        self.names()
            .iter()
            .filter(|name| name.starts_with(&prefix))
            .filter_map(|name| self.find(name))
            .collect()
    }
}

/// Whether a path is one of the library.
pub fn is_embedded(path: &Path) -> bool {
    path.starts_with(ROOT)
}

/// Where an embedded file lies in the library.
pub fn place(path: &Path) -> Option<PathBuf> {
    let mut place = PathBuf::new();
    for component in path.strip_prefix(ROOT).ok()?.components() {
        match component {
            Component::ParentDir => _ = place.pop(),
            component => place.push(component),
        }
    }
    Some(place)
}

/// Reads a text, embedded or on the disk.
pub fn read(path: &Path) -> io::Result<String> {
    let Some(place) = place(path) else { return std::fs::read_to_string(path) };
    let file = FILES.get_file(&place).and_then(include_dir::File::contents_utf8);
    file.map(str::to_owned).ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "no such file is built in"))
}

#[cfg(test)]
mod tests {
    #[cfg(feature = "exchange")]
    use bench_recording::import::ImportMap;
    use bench_rig::{Mission, Rig};

    use super::*;

    #[test]
    fn every_embedded_rig_mission_and_map_reads() {
        for name in Kind::Rig.names() {
            let path = Kind::Rig.find(&name).unwrap();
            assert_eq!(Rig::read_with(&path, &read(&path).unwrap(), &read).unwrap().name, name);
        }
        for name in Kind::Mission.names() {
            let path = Kind::Mission.find(&name).unwrap();
            Mission::read(&path, &read(&path).unwrap()).unwrap();
        }
        #[cfg(feature = "exchange")]
        for name in Kind::ImportMap.names() {
            let path = Kind::ImportMap.find(&name).unwrap();
            ImportMap::read(&path, &read(&path).unwrap()).unwrap();
        }
        assert!(Kind::ALL.iter().all(|kind| !kind.names().is_empty()));
        assert_eq!(Kind::Mission.within("blind").len(), 9);
    }

    #[test]
    fn paths_between_embedded_files_are_followed() {
        let map = Kind::ImportMap.find("foreign").unwrap();
        let rig = map.parent().unwrap().join("../foreign.toml");
        assert!(read(&rig).unwrap().contains("name = \"foreign\""));
        assert_eq!(read(&map.with_file_name("absent.toml")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
