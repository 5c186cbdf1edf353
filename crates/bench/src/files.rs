//! Where rigs, missions and maps are found, and the one rule for outputs: all of them are checked before the work, and
//! nothing is replaced without `--force`.

use std::{
    fs::{self, OpenOptions},
    path::{Path, PathBuf},
};

use anyhow::{Context, anyhow, bail};
use bench_recording::FileKind;
use bench_rig::{EffectEntry, Mission, Rig};

use crate::{
    library::{self, Kind},
    progress,
};

/// The rig when none is named.
pub const DEFAULT_RIG: &str = "virtual";

/// The rig of the loopback bench when none is named.
pub const LOOPBACK_RIG: &str = "loopback";

/// Finds a file that may be named by its path or, where there is no such file, by its name in the library.
fn find(kind: Kind, named: &Path) -> anyhow::Result<PathBuf> {
    if named.is_file() || library::is_embedded(named) {
        return Ok(named.to_owned());
    }
    let what = kind.name();
    if named.is_dir() {
        bail!("{} is a folder; name the file of one {what} in it", named.display());
    }
    if let Some(found) = named.to_str().and_then(|name| kind.find(name)) {
        return Ok(found);
    }
    let stem = named.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    if kind.find(&stem).is_some() {
        bail!("there is no file {}; is the built-in {what} meant? Its name is {stem}", named.display());
    }
    let names = kind.names();
    let closest = names
        .iter()
        .map(|name| (strsim::jaro_winkler(&stem, name), name))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(similarity, _)| *similarity > 0.85);
    let hint = match closest {
        Some((_, name)) => format!("did you mean {name}? "),
        None => String::new(),
    };
    bail!(
        "there is no file {}, and no built-in {what} of that name; {hint}built in are {} (`bench rigs` lists all)",
        named.display(),
        names.join(", ")
    )
}

/// The path of a rig that is named by path or by name.
pub fn rig_path(named: &Path) -> anyhow::Result<PathBuf> {
    find(Kind::Rig, named)
}

/// Reads a rig: a file, or one of the library by its name.
pub fn rig(named: &Path) -> anyhow::Result<Rig> {
    let path = rig_path(named)?;
    is_of(Kind::Rig, &path)?;
    Ok(Rig::read_with(&path, &read(&path)?, &library::read)?)
}

/// A file of the disk that is plainly of another kind is told as such, before its keys are found wrong one by one.
fn is_of(wanted: Kind, path: &Path) -> anyhow::Result<()> {
    if library::is_embedded(path) {
        return Ok(());
    }
    let kind = FileKind::of(path).with_context(|| format!("cannot read {}", path.display()))?;
    let advice = match &kind {
        FileKind::Rig => "name it with --rig",
        FileKind::Airframe => "a rig names it with its key `airframe`",
        FileKind::Mission => "name it with --mission",
        FileKind::ImportMap => "`bench import --map` reads it",
        FileKind::Suite => "`bench test` flies it",
        FileKind::Sweep => "`bench sweep run` runs it",
        FileKind::Mcap => "it is flown data: name it where recordings are wanted",
        // These may be a file of the wanted kind with faults in it, which are told by line and key.
        FileKind::Toml | FileKind::Text | FileKind::Csv | FileKind::Json => return Ok(()),
        FileKind::Empty | FileKind::Folder { .. } => "name a TOML file",
        _ => "name a TOML file; `bench rigs copy` writes one to start from",
    };
    let is_wanted = match wanted {
        Kind::Rig => kind == FileKind::Rig,
        Kind::Airframe => kind == FileKind::Airframe,
        Kind::Mission => kind == FileKind::Mission,
        Kind::ImportMap => kind == FileKind::ImportMap,
        Kind::Suite => kind == FileKind::Suite,
        Kind::Sweep => kind == FileKind::Sweep,
        Kind::BalanceTable => true,
    };
    if is_wanted {
        return Ok(());
    }
    let article = if wanted == Kind::ImportMap { "an" } else { "a" };
    bail!("{} is {}, and {article} {} is wanted here; {advice}", path.display(), kind.name(), wanted.name())
}

/// Reads the text of a suite, say: a file, or one of the library by its name. Gives its path as well.
pub fn text_of(kind: Kind, named: &Path) -> anyhow::Result<(PathBuf, String)> {
    let path = find(kind, named)?;
    is_of(kind, &path)?;
    let text = read(&path)?;
    Ok((path, text))
}

/// Reads a text, on the disk or embedded.
pub fn read(path: &Path) -> anyhow::Result<String> {
    library::read(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Reads a mission: a file, the name of one in the folder `missions` beside the rig, or one of the library.
pub fn mission(named: &str, rig: &Path) -> anyhow::Result<Mission> {
    read_mission(&mission_path(named, rig)?)
}

/// The path of a mission that is named by path or by name.
pub fn mission_path(named: &str, rig: &Path) -> anyhow::Result<PathBuf> {
    let rig = rig_path(rig)?;
    let beside = rig.parent().unwrap_or(Path::new("")).join("missions").join(format!("{named}.toml"));
    let as_path = Path::new(named);
    if !as_path.is_file() && beside.is_file() { Ok(beside) } else { find(Kind::Mission, as_path) }
}

/// Reads a mission by its path.
pub fn read_mission(path: &Path) -> anyhow::Result<Mission> {
    is_of(Kind::Mission, path)?;
    Ok(Mission::read(path, &read(path)?)?)
}

/// The folder of the library whose missions stand for flights that carry none, and that the blind check flies.
pub const BLIND_MISSIONS: &str = "blind";

/// Reads missions: files, names of the library, or folders (of either) in the order of their names.
pub fn missions(places: &[PathBuf]) -> anyhow::Result<Vec<Mission>> {
    let mut missions = Vec::new();
    for place in places {
        for path in missions_at(place)? {
            missions.push(read_mission(&path)?);
        }
    }
    Ok(missions)
}

/// The files of missions that a place stands for.
pub fn missions_at(place: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if place.is_dir() {
        let mut found = Vec::new();
        for entry in fs::read_dir(place).with_context(|| format!("cannot read {}", place.display()))? {
            let path = entry?.path();
            if path.extension().is_some_and(|extension| extension == "toml") {
                found.push(path);
            }
        }
        if found.is_empty() {
            bail!("no missions in {}; expected .toml files", place.display());
        }
        found.sort();
        return Ok(found);
    }
    let within = place.to_str().map(|folder| Kind::Mission.within(folder)).unwrap_or_default();
    if place.exists() || within.is_empty() { Ok(vec![find(Kind::Mission, place)?]) } else { Ok(within) }
}

/// What an output is, and so how its name may end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    Recording,
    /// A spreadsheet or data table.
    Table,
    Csv,
    Html,
    Toml,
    Markdown,
    /// Any file.
    Any,
    /// A folder: a new one, an empty one or, with `--force`, any.
    Folder,
}

impl Form {
    const fn endings(self) -> &'static [&'static str] {
        match self {
            Self::Recording => &["mcap"],
            Self::Table => &["csv", "xlsx", "parquet"],
            Self::Csv => &["csv"],
            Self::Html => &["html", "htm"],
            Self::Toml => &["toml"],
            Self::Markdown => &["md"],
            Self::Any | Self::Folder => &[],
        }
    }
}

/// What a command is going to write. [`Outputs::check`] comes before the work, so that no work is lost for a name.
#[derive(Debug)]
pub struct Outputs<'a> {
    force: bool,
    files: Vec<(&'a Path, Form)>,
    inputs: Vec<&'a Path>,
}

impl<'a> Outputs<'a> {
    /// No output yet; with `force` those that exist are replaced.
    pub fn new(force: bool) -> Self {
        Self { force, files: Vec::new(), inputs: Vec::new() }
    }

    /// An output.
    pub fn and(mut self, path: impl Into<Option<&'a Path>>, form: Form) -> Self {
        self.files.extend(path.into().map(|path| (path, form)));
        self
    }

    /// Files that are read, and so never written.
    pub fn from(mut self, inputs: impl IntoIterator<Item = &'a Path>) -> Self {
        self.inputs.extend(inputs);
        self
    }

    /// Says whether each of them can be written. Nothing is made or changed.
    pub fn check(&self) -> anyhow::Result<()> {
        for (index, (path, form)) in self.files.iter().enumerate() {
            self.check_one(path, *form)?;
            if self.files[..index].iter().any(|(other, _)| other == path) && !is_special(path) {
                bail!("{} is named for two outputs; name another file for one of them", path.display());
            }
        }
        Ok(())
    }

    fn check_one(&self, path: &Path, form: Form) -> anyhow::Result<()> {
        let shown = path.display();
        if path.as_os_str().is_empty() {
            bail!("an output has an empty name; name a file");
        }
        if form == Form::Folder {
            if path.exists() && !path.is_dir() {
                bail!("{shown} is not a folder; name one for the output");
            }
            let filled = fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some());
            if filled && !self.force {
                bail!("the folder {shown} is not empty; name another, or write into it with --force");
            }
            return can_make_files_in(if path.exists() { path } else { existing_ancestor(path) }, path);
        }
        if is_special(path) {
            // A device or a pipe is written to, not replaced.
            return Ok(());
        }
        if path.is_dir() {
            bail!("{shown} is a folder; name a file for the output");
        }
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        let endings = form.endings();
        if !endings.is_empty() && !ending.is_some_and(|ending| endings.contains(&ending.as_str())) {
            let known: Vec<String> = endings.iter().map(|ending| format!(".{ending}")).collect();
            bail!("{shown}: the name of this output ends in {}", known.join(", "));
        }
        #[cfg(not(feature = "exchange"))]
        if form == Form::Table && !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv")) {
            return Err(crate::left_out::left_out(
                &format!("the format of {shown} (.csv can be written)"),
                "exchange",
            ));
        }
        if !path.exists() {
            return can_make_files_in(existing_ancestor(path), path);
        }
        if self.inputs.iter().any(|input| is_same_file(input, path)) {
            bail!("{shown} is an input; name another file for the output");
        }
        if !self.force {
            bail!("{shown} exists; name another output, or replace it with --force");
        }
        OpenOptions::new().append(true).open(path).with_context(|| format!("cannot write {shown}"))?;
        Ok(())
    }
}

fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Whether two paths lead to one file that is there.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// The nearest folder above that is there; the others are made when the file is written.
fn existing_ancestor(path: &Path) -> &Path {
    let above = path.ancestors().skip(1).find(|above| above.as_os_str().is_empty() || above.exists());
    above.filter(|above| !above.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Only making a file tells: permissions, full and read-only disks and kernel file systems all have their own ways.
fn can_make_files_in(folder: &Path, output: &Path) -> anyhow::Result<()> {
    if !folder.is_dir() {
        bail!("cannot write {}: {} is not a folder", output.display(), folder.display());
    }
    tempfile::Builder::new()
        .prefix(".bench-")
        .tempfile_in(folder)
        .map(drop)
        .map_err(|error| anyhow!("cannot write {}: in {}: {error}", output.display(), folder.display()))
}

/// Makes the folder of an output.
pub fn make_folder(output: &Path) -> anyhow::Result<()> {
    if let Some(folder) = output.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    Ok(())
}

/// Writes a rig under the name of its file, below lines that say how it was made. What is written must read back.
pub fn write_rig(output: &Path, head: &str, rig: &Rig) -> anyhow::Result<()> {
    let mut rig = rig.clone();
    if let Some(name) = output.file_stem() {
        rig.name = name.to_string_lossy().into_owned();
    }
    let text = format!("# {}: {head}\n{}", rig.name, rig.to_toml());
    Rig::read(output, &text).context("what was found makes no rig; nothing written")?;
    write(output, &text)
}

/// Writes a text; its folder is made.
pub fn write(output: &Path, text: &str) -> anyhow::Result<()> {
    make_folder(output)?;
    fs::write(output, text).with_context(|| format!("cannot write {}", output.display()))
}

/// Writes a text and says so.
pub fn write_and_say(output: &Path, text: &str) -> anyhow::Result<()> {
    write(output, text)?;
    progress::note(&format!("wrote {}", output.display()));
    Ok(())
}

/// An effect as `--effect` takes it.
pub fn effect_in_words(effect: &EffectEntry) -> String {
    let values: Vec<_> = effect.parameters.iter().map(|(key, x, _)| format!("{key}={x}")).collect();
    format!("{}:{}", effect.name, values.join(","))
}

/// Where a flight is recorded when no output is named: rig, mission, what was added, and what tells it from another flight
/// of the same.
pub fn default_recording(rig: &str, mission: &str, added: &[String], which: &str) -> PathBuf {
    /// Longest name of a file that all usual file systems take, less the ending and some room.
    const LONGEST: usize = 200;
    let mut name = [rig, mission].join("_");
    for what in added {
        name.push('_');
        // A colon parts paths in some places, a slash in all.
        name.extend(what.chars().map(|c| if matches!(c, ':' | '/') { '-' } else { c }));
    }
    if name.len() > LONGEST {
        use sha2::{Digest, Sha256};
        let hash = Sha256::digest(name.as_bytes())
            .iter()
            .take(6)
            .fold(String::new(), |hash, byte| format!("{hash}{byte:02x}"));
        let kept: String = name.chars().take(LONGEST / 2).collect();
        name = format!("{kept}_{hash}");
    }
    Path::new("recordings").join(format!("{name}_{which}.mcap"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(outputs: &Outputs<'_>) -> String {
        format!("{:#}", outputs.check().unwrap_err())
    }

    #[test]
    fn outputs_are_checked_without_touching_anything() {
        let folder = tempfile::tempdir().unwrap();
        let new = folder.path().join("a/b/new.html");
        Outputs::new(false).and(new.as_path(), Form::Html).check().unwrap();
        assert!(fs::read_dir(folder.path()).unwrap().next().is_none(), "nothing is made");

        let there = folder.path().join("there.toml");
        fs::write(&there, "kept").unwrap();
        assert!(refused(&Outputs::new(false).and(there.as_path(), Form::Toml)).contains("--force"));
        let forced = Outputs::new(true).and(there.as_path(), Form::Toml);
        forced.check().unwrap();
        assert!(refused(&forced.from([there.as_path()])).contains("is an input"));
        assert_eq!(fs::read_to_string(&there).unwrap(), "kept");

        assert!(refused(&Outputs::new(true).and(folder.path(), Form::Any)).contains("is a folder"));
        let below = there.join("page.html");
        assert!(refused(&Outputs::new(true).and(below.as_path(), Form::Html)).contains("is not a folder"));
        let ending = folder.path().join("page.pdf");
        assert!(refused(&Outputs::new(true).and(ending.as_path(), Form::Html)).contains(".html"));
        let twice = Outputs::new(true).and(new.as_path(), Form::Any).and(new.as_path(), Form::Html);
        assert!(refused(&twice).contains("two outputs"));
        let kernel = Path::new("/proc/page.html");
        assert!(
            refused(&Outputs::new(true).and(kernel, Form::Html)).contains("cannot write /proc/page.html")
        );
        Outputs::new(false).and(Path::new("/dev/null"), Form::Html).check().unwrap();
    }

    #[test]
    fn a_recording_is_named_after_all_that_tells_it_from_others() {
        let named = |effects: &[&str]| {
            let effects: Vec<String> = effects.iter().map(|&effect| effect.to_owned()).collect();
            default_recording("virtual", "hop", &effects, "seed3")
        };
        assert_eq!(named(&[]), Path::new("recordings/virtual_hop_seed3.mcap"));
        assert_eq!(
            named(&["rotor-lag:time_constant_s=0.08"]),
            Path::new("recordings/virtual_hop_rotor-lag-time_constant_s=0.08_seed3.mcap")
        );
        let many = vec!["thrust-curve:quadratic=0.123456789,cubic=0.123456789"; 9];
        let (a, b) = (named(&many), named(&many[..8]));
        assert_ne!(a, b);
        assert!(a.as_os_str().len() < 255);
    }

    #[test]
    fn a_wrong_name_is_answered_with_what_there_is() {
        let said = |name: &str| format!("{:#}", rig(Path::new(name)).unwrap_err());
        assert!(said("rigs/absent/virtual.toml").contains("Its name is virtual"));
        assert!(said("vitual").contains("did you mean virtual?"));
        assert!(said("xyz").contains("built in are"));
        let said = format!("{:#}", mission("hopp", Path::new("virtual")).unwrap_err());
        assert!(said.contains("no built-in mission") && said.contains("did you mean hop?"), "{said}");
    }

    #[test]
    fn missions_are_found_beside_the_rig_before_those_built_in() {
        let folder = tempfile::tempdir().unwrap();
        let rig = folder.path().join("mine.toml");
        fs::write(&rig, "").unwrap();
        fs::create_dir(folder.path().join("missions")).unwrap();
        let text = "name = \"hop\"\ndescription = \"mine\"\n[[phase]]\nkind = \"idle\"\nduration_s = 1\n";
        fs::write(folder.path().join("missions/hop.toml"), text).unwrap();
        assert_eq!(mission("hop", &rig).unwrap().description, "mine");
        assert_ne!(mission("climb-040", &rig).unwrap().description, "mine");
        assert_eq!(missions(&[PathBuf::from(BLIND_MISSIONS)]).unwrap().len(), 9);
    }
}
