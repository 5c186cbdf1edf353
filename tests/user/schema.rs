//! Schemas of files and outputs, and the pages made from them.

use std::{
    collections::BTreeSet,
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use serde_json::Value;

use crate::support::{Scratch, bench, json, refused, root, stdout, violations};

const FILES: [&str; 8] = ["rig", "airframe", "mission", "map", "calibration", "tolerances", "suite", "sweep"];

fn schema(name: &str) -> Value {
    serde_json::from_str(&stdout(&bench(["schema", name]).assert().success())).unwrap()
}

/// The names that `bench schema` lists.
fn names() -> Vec<String> {
    let listed = stdout(&bench(["schema"]).assert().success());
    listed
        .lines()
        .filter(|line| line.starts_with("  "))
        .map(|line| {
            let (name, title) = line.trim().split_once(' ').unwrap();
            assert!(title.trim().len() > 20, "{line}");
            name.to_owned()
        })
        .collect()
}

#[test]
fn every_schema_is_one_and_describes_all_of_its_properties() {
    let names = names();
    assert!(names.len() > 25 && FILES.iter().all(|file| names.contains(&(*file).to_owned())), "{names:?}");
    for name in names {
        let schema = schema(&name);
        jsonschema::meta::validate(&schema).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema", "{name}");
        assert!(schema["title"].as_str().is_some_and(|title| title.len() > 20), "{name}");
        described(&schema, &name);
        if !FILES.contains(&name.as_str()) {
            let told = schema["properties"]["schema"]["const"].as_str().unwrap().to_owned();
            assert_eq!(told.split('/').next().unwrap(), format!("bench.{name}"));
            // What stands in the output finds its schema, too.
            bench(["schema", &told]).assert().success();
        }
    }
}

/// Each property has a sentence, and each object of ours refuses what it does not describe.
fn described(schema: &Value, place: &str) {
    if let Some(properties) = schema["properties"].as_object() {
        for (key, property) in properties {
            let words = property["description"].as_str().unwrap_or_default();
            assert!(words.len() > 3 && words.ends_with(['.', ':']), "{place}.{key}: {words:?}");
        }
        assert_eq!(schema["additionalProperties"], false, "{place}");
        let required = schema["required"].as_array().unwrap_or_else(|| panic!("{place} lacks `required`"));
        assert!(required.iter().all(|key| properties.contains_key(key.as_str().unwrap())), "{place}");
    }
    match schema {
        Value::Object(entries) => {
            entries.iter().for_each(|(key, inner)| described(inner, &format!("{place}/{key}")));
        }
        Value::Array(items) => items.iter().for_each(|inner| described(inner, place)),
        _ => {}
    }
}

#[test]
fn what_is_committed_is_what_is_made() {
    for file in FILES {
        let path = format!("docs/schemas/{file}.json");
        let committed = fs::read_to_string(root().join(&path)).unwrap();
        let made = stdout(&bench(["schema", file]).assert().success());
        assert!(committed == made, "{path} is old; run `bench schema {file} > {path}`");
    }
    for page in ["rig", "mission", "suite", "sweep"] {
        let committed = fs::read_to_string(root().join(format!("docs/{page}.md"))).unwrap();
        let made = stdout(&bench(["schema", page, "--markdown"]).assert().success());
        assert!(
            committed == made,
            "docs/{page}.md is old; run `bench schema {page} --markdown > docs/{page}.md`"
        );
    }
    let import = fs::read_to_string(root().join("docs/import.md")).unwrap();
    let made = stdout(&bench(["schema", "map", "--markdown"]).assert().success());
    assert!(
        import.contains(&made),
        "the keys in docs/import.md are old; put there what `bench schema map --markdown` prints"
    );
    let committed = fs::read_to_string(root().join("docs/diagnosis-json.md")).unwrap();
    let made = page_of_output("diagnosis", JSON_OF_DIAGNOSIS);
    if committed != made {
        let there = Path::new(env!("CARGO_TARGET_TMPDIR")).join("diagnosis-json.md");
        fs::write(&there, made).unwrap();
        panic!("docs/diagnosis-json.md is old; what it should be is in {}", there.display());
    }
    for output in names().iter().filter(|name| !FILES.contains(&name.as_str())) {
        let told = schema(output)["properties"]["schema"]["const"].as_str().unwrap().replace('/', ".");
        let file = fs::read_to_string(root().join(format!("docs/schemas/{told}.json"))).unwrap();
        assert_eq!(stdout(&bench(["schema", output]).assert().success()), file);
    }
}

/// What stands before the tables of `docs/diagnosis-json.md`.
const JSON_OF_DIAGNOSIS: &str = "# The JSON of a diagnosis

```console
bench diagnose flight-*.mcap --json
bench schema diagnosis
```
The first prints what these tables describe, the second its JSON Schema, against which the tests hold real output. How the figures come about
is in [diagnosis.md](diagnosis.md).

All evidence is in nats: natural logarithms of likelihood. Units are those of the key or of the sentence beside it. A key is there unless its
sentence says when it is absent. `null` says that there is nothing to tell. A later version may add keys. Where one is removed or means
something else, the number behind `bench.diagnosis/` rises.

Keys stand in the order of the alphabet. This page is made of the descriptions in the schema, and a test (`tests/user/schema.rs`) holds it to them.
";

/// A page with a table for each object of an output's schema.
fn page_of_output(name: &str, before: &str) -> String {
    let schema = schema(name);
    let own = schema["$defs"].as_object().unwrap();
    let mut page = before.to_owned() + &table("The whole", &schema);
    for (title, object) in own {
        page += &table(title, object);
    }
    page
}

/// A section on a schema: its description, and a row for each property.
fn table(title: &str, schema: &Value) -> String {
    let mut section = format!("\n## {title}\n{}\n", schema["description"].as_str().unwrap());
    let Some(properties) = schema["properties"].as_object() else {
        return section + "\nOne of " + &shape(schema) + ".\n";
    };
    section += "\n| key | shape | what |\n|---|---|---|\n";
    let required = schema["required"].as_array().unwrap();
    for (key, property) in properties {
        let words = property["description"].as_str().unwrap();
        let is_told = required.contains(&Value::from(key.as_str()))
            || words.contains("bsent")
            || words.contains("eft out");
        assert!(is_told, "{title}.{key} may be absent, and its description does not say when");
        let has_null = shape(property).contains("null");
        assert!(
            !has_null || words.to_lowercase().contains("null"),
            "{title}.{key} may be null, and does not say when"
        );
        writeln!(section, "| `{key}` | {} | {words} |", shape(property)).unwrap();
    }
    section
}

/// The values that a schema admits, in words.
fn shape(schema: &Value) -> String {
    let list = |items: &Value| items.as_array().unwrap().iter().map(shape).collect::<Vec<_>>().join(" or ");
    if let Some(reference) = schema["$ref"].as_str() {
        let name = reference.rsplit('/').next().unwrap();
        return format!("[{name}](#{})", name.to_lowercase());
    }
    if let Some(told) = schema["const"].as_str() {
        return format!("`{told}`");
    }
    if let Some(values) = schema["enum"].as_array() {
        return values
            .iter()
            .map(|value| format!("`{}`", value.as_str().unwrap()))
            .collect::<Vec<_>>()
            .join(", ");
    }
    if schema["anyOf"].is_array() {
        return list(&schema["anyOf"]);
    }
    if let Some(several) = schema["type"].as_array() {
        return several
            .iter()
            .map(|of| kind(of.as_str().unwrap()).to_owned())
            .collect::<Vec<_>>()
            .join(" or ");
    }
    if schema["type"] == "array" {
        let of = shape(&schema["items"]);
        return match schema["minItems"].as_u64() {
            Some(exactly) if schema["maxItems"] == exactly => format!("list of {exactly}: {of}"),
            _ => format!("list: {of}"),
        };
    }
    kind(schema["type"].as_str().unwrap()).to_owned()
}

fn kind(of: &str) -> &str {
    match of {
        "integer" => "whole number",
        "string" => "text",
        "boolean" => "true or false",
        other => other,
    }
}

#[test]
fn what_is_no_schema_is_refused() {
    assert!(refused(bench(["schema", "rigg"]), 2).contains("bench schema"));
    assert!(refused(bench(["schema", "sim", "--markdown"]), 2).contains("mission"));
}

#[test]
fn outputs_that_no_other_test_reads_are_as_their_schemas_say() {
    let scratch = Scratch::new();
    json(&bench(["devices", "--json"]).assert().success());
    json(&bench(["effects", "gusts", "--json"]).assert().success());
    let frames = scratch.name("frames");
    let record = ["record-frames", "--mission", "hop", "--from-s", "1", "--seconds", "0.2", "-o", &frames];
    json(&bench(record).arg("--json").assert().success());
    let ground =
        ["identify", "ground-effect", "rigs/balance/hubsan-q4-ground.csv", "--rig", "rigs/virtual.toml"];
    let identified = scratch.name("ground.toml");
    json(&bench(ground).args(["-o", &identified, "--json"]).assert().success());
    let flights: Vec<_> =
        (0..2).map(|seed| scratch.fly(&format!("{seed}.mcap"), &["--seed", &seed.to_string()])).collect();
    json(&bench(["diff", &flights[0], &flights[0], "--json"]).assert().success());
    json(&bench(["diff", "--floor", &flights[0], &flights[1], "--json", &flights[0], &flights[1]]).assert());
    // Nothing to go by but the bookkeeping: some fields are missing on one side.
    json(&bench(["recover", &flights[0], "-o", &scratch.name("back.mcap"), "--json"]).assert().success());
}

/// Every TOML file of the project and which schema is its own.
fn committed() -> Vec<(&'static str, PathBuf)> {
    let rigs = root().join("rigs");
    let mut found = Vec::new();
    for (kind, folder) in [
        ("rig", "."),
        ("airframe", "airframes"),
        ("mission", "missions"),
        ("mission", "missions/blind"),
        ("map", "import"),
        ("suite", "suites"),
        ("sweep", "sweeps"),
    ] {
        for entry in fs::read_dir(rigs.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending == "toml") {
                found.push((kind, path));
            }
        }
    }
    assert!(found.len() > 25);
    found.sort();
    found
}

fn as_toml(path: &Path) -> toml::Table {
    fs::read_to_string(path).unwrap().parse().unwrap()
}

#[test]
fn every_committed_file_is_as_its_schema_says() {
    for (kind, path) in committed() {
        let wrong = violations(&schema(kind), &serde_json::to_value(as_toml(&path)).unwrap());
        assert!(wrong.is_empty(), "{}: {wrong:?}", path.display());
    }
}

const TOLERANCES: &str = "[[tolerance]]\nfield = \"position_m.*\"\nabsolute = 0.02\ntime_s = 0.1\n\n\
                          [[tolerance]]\nunit = \"V\"\nrelative = 0.05\nignore = false\n";
const EFFECTS: &str = "\n[[effect]]\nname = \"gusts\"\nsigma_m_s = 0.1\ncorrelation_time_s = 0.7\n\n\
                       [[effect]]\nname = \"rotor-lag\"\ntime_constant_s = 0.08\n\n[disturbance]\ntrim_m_s2 = 0.1\n";
const MAP: &str = "name = \"all\"\nactuation = \"volt\"\ndelimiter = \";\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n\
    [[filter]]\ncolumn = \"armed\"\nat_least = 1\n[tick]\nperiod_s = \"rig\"\n\
    [position]\nlatency_s = 0.1\nnewest_of_frames_s = \"rig\"\nx = 0.0\nz = { column = \"z\", unit = \"mm\", scale = 2 }\nempty = \"absent\"\n\
    [motion]\nvertical_acceleration = { columns = [\"a\", \"b\"], unit = \"g\", gravity = \"included\", valid = [-4, 4] }\n\
    [control]\nphase = { column = \"p\", names = { fly = \"hold\", wait = \"idle\" } }\n\
    [command]\nthrottle = { column = \"u\", unit = \"mV\" }\nkeep = \"changes\"\nevery_s = 0.1\n";

const SUITE: &str = "name = \"all\"\ndescription = \"x\"\nport = \"/dev/ttyACM0\"\nbaselines = \"b\"\nask = [\"operator\"]\n\
    [[case]]\nname = \"a\"\nrig = [\"virtual\", \"loopback\"]\nmission = \"hop\"\nmode = \"sim\"\neffects = [\"none\", \"gusts\"]\n\
    seeds = { first = 0, count = 3 }\nrepeats = 2\ntags = \"ci\"\nrequirements = [\"R-1\"]\nmission_criteria = \"ignore\"\n\
    compare = [\"baseline\", \"back-to-back\"]\ntolerances = \"t.toml\"\n[case.limits]\npeak_max_m = 0.5\npeak_spread_max_m = 0.1\n\
    [[case.limit]]\nfield = \"/tracker/position/status\"\nstatistic = \"share\"\nequals = \"found\"\nphase = \"hold\"\nmin = 0.9\n\
    [[case]]\nname = \"b\"\nrig = \"virtual\"\nmission = [\"hop\"]\nseeds = [1, 2]\n";

const SWEEP: &str = "name = \"all\"\ndescription = \"x\"\nkind = \"flights\"\nrigs = [\"virtual\", \"virtual-model\"]\n\
    missions = \"hop\"\nairframes = \"drawn\"\ndiagnosis = \"each\"\nruns_per_part = 7\nseeds = { first = 0, count = 3 }\n\
    [[variant]]\nname = \"a\"\n[variant.effects.rotor-lag]\ntime_constant_s = [0.05, 0.1]\n\
    [[variant]]\nname = \"b\"\n[variant.effects.gusts]\nsigma_m_s = \"prior\"\ncorrelation_time_s = { normal = [1, 0.1] }\n\
    [[variant]]\nname = \"c\"\n[variant.effects.mass-change]\nfraction = { uniform = [-0.1, 0.1] }\n\
    [[variant]]\nname = \"d\"\n[variant.effects.rotor-lag]\ntime_constant_s = { log_uniform = [0.05, 0.1] }\n";
const SWEEP_OF_SETS: &str = "name = \"all\"\ndescription = \"x\"\nkind = \"mix\"\nrigs = \"virtual\"\n\
    missions = [\"hop\", \"steps\"]\nsets = 3\n";

/// A file of each kind that uses much of what there is.
fn samples() -> Vec<(&'static str, toml::Table)> {
    let rigs = root().join("rigs");
    let mut rig = as_toml(&rigs.join("virtual-model.toml"));
    rig.extend(EFFECTS.parse::<toml::Table>().unwrap());
    rig.insert("airframe".to_owned(), as_toml(&rigs.join("airframes/hubsan-q4.toml")).into());
    let calibration = as_toml(&rigs.join("virtual.toml"))["calibration"].as_table().unwrap().clone();
    rig.insert("calibration".to_owned(), calibration.clone().into());
    let mut chirp = as_toml(&rigs.join("missions/blind/7-chirp.toml"));
    let hold = as_toml(&rigs.join("missions/hold-3d.toml"));
    chirp["phase"].as_array_mut().unwrap().extend(hold["phase"].as_array().unwrap().iter().cloned());
    chirp.insert("criteria".to_owned(), hold["criteria"].clone());
    vec![
        ("rig", rig),
        ("airframe", as_toml(&rigs.join("airframes/crazyflie-2.toml"))),
        ("mission", chirp),
        ("map", MAP.parse().unwrap()),
        ("calibration", calibration),
        ("tolerances", TOLERANCES.parse().unwrap()),
        ("suite", SUITE.parse().unwrap()),
        ("sweep", SWEEP.parse().unwrap()),
        ("sweep", SWEEP_OF_SETS.parse().unwrap()),
    ]
}

/// Where a value stands: keys and places in lists.
type Steps = Vec<Step>;

#[derive(Clone, Debug, PartialEq)]
enum Step {
    Key(String),
    Place(usize),
}

fn places(value: &toml::Value, at: &Steps, into: &mut Vec<Steps>) {
    let inner: Vec<(Step, &toml::Value)> = match value {
        toml::Value::Table(table) => {
            table.iter().map(|(key, value)| (Step::Key(key.clone()), value)).collect()
        }
        toml::Value::Array(items) => {
            items.iter().enumerate().map(|(i, value)| (Step::Place(i), value)).collect()
        }
        _ => Vec::new(),
    };
    for (step, value) in inner {
        let here = [at.as_slice(), &[step]].concat();
        into.push(here.clone());
        places(value, &here, into);
    }
}

/// The value that holds what stands at a path.
fn holder<'v>(value: &'v mut toml::Value, path: &[Step]) -> &'v mut toml::Value {
    path.iter().fold(value, |value, step| match step {
        Step::Key(key) => &mut value[key.as_str()],
        Step::Place(place) => &mut value[*place],
    })
}

/// A file with one thing about it changed, in words and as a whole.
fn broken(file: &toml::Table) -> Vec<(String, toml::Value)> {
    let whole = toml::Value::Table(file.clone());
    let (mut paths, mut found) = (Vec::new(), Vec::new());
    places(&whole, &Vec::new(), &mut paths);
    let others: [toml::Value; 7] = [
        (-1e9).into(),
        0.0.into(),
        1e15.into(),
        0.5.into(),
        "nonsense".into(),
        true.into(),
        toml::Value::Array(Vec::new()),
    ];
    for path in paths {
        let (last, before) = path.split_last().unwrap();
        for other in &others {
            let mut changed = whole.clone();
            *holder(&mut changed, &path) = other.clone();
            found.push((format!("{path:?} = {other}"), changed));
        }
        if let Step::Key(key) = last {
            let mut changed = whole.clone();
            let table = holder(&mut changed, before).as_table_mut().unwrap();
            let value = table.remove(key).unwrap();
            found.push((format!("no {path:?}"), changed.clone()));
            holder(&mut changed, before).as_table_mut().unwrap().insert(format!("{key}_mm"), value);
            found.push((format!("{path:?} under another name"), changed));
        }
    }
    found
}

/// What the reader and the schema say of files that are broken in one place: neither lets pass what is not there for the
/// other, but for what contradicts another key.
#[test]
fn reader_and_schema_refuse_the_same() {
    for (kind, file) in samples() {
        let scratch = Scratch::new();
        let validator = jsonschema::draft202012::new(&schema(kind)).unwrap();
        let sound = serde_json::to_value(&file).unwrap();
        assert!(validator.is_valid(&sound), "{kind}: {:?}", violations(&schema(kind), &sound));
        let cases = broken(&file);
        let mut command = bench(["check", "--as", kind, "--json"]);
        for (number, (_, changed)) in cases.iter().enumerate() {
            let path = scratch.path(&format!("{number}.toml"));
            fs::write(&path, toml::to_string(changed).unwrap()).unwrap();
            command.arg(path);
        }
        let report = json(&command.assert().code(2));
        let (mut both, mut reader_alone) = (0, BTreeSet::new());
        for ((words, changed), told) in cases.iter().zip(report["files"].as_array().unwrap()) {
            let by_schema = !validator.is_valid(&serde_json::to_value(changed).unwrap());
            let problems = told["problems"].as_array().unwrap();
            assert!(
                !(by_schema && problems.is_empty()),
                "{kind}: the schema alone refuses {words}: {:?}",
                violations(&schema(kind), &serde_json::to_value(changed).unwrap())
            );
            both += usize::from(by_schema);
            if !by_schema {
                reader_alone.extend(problems.iter().map(|problem| {
                    format!("{}: {} ({words})", problem["key"], problem["what"].as_str().unwrap())
                }));
            }
        }
        assert!(both > cases.len() / 3, "{kind}: {both} of {}", cases.len());
        let kinds = ["unknown key", "missing", "is out of range", ": is "];
        let missed: Vec<_> =
            reader_alone.iter().filter(|told| kinds.iter().any(|kind| told.contains(kind))).collect();
        assert!(missed.is_empty(), "{kind}: the reader alone refuses {missed:#?}");
    }
}
