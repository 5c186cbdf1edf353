//! `docs/effects.md` is made from the library.

use std::{fmt::Write, fs, path::Path};

use bench_plant::effects::{EffectSpec, LIBRARY, Parameter, Prior};

const BEGIN: &str =
    "<!-- The library begins: made by `UPDATE_DOCS=1 cargo test -p bench-plant --test effects`. -->\n";
const END: &str = "<!-- The library ends. -->\n";

#[test]
fn the_page_shows_the_library() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/effects.md");
    let page = fs::read_to_string(&path).unwrap();
    let (before, rest) = page.split_once(BEGIN).expect("the page has the line that begins the library");
    let (_, after) = rest.split_once(END).expect("the page has the line that ends the library");
    let expected = format!("{before}{BEGIN}{}{END}{after}", library());
    if std::env::var_os("UPDATE_DOCS").is_some() {
        fs::write(&path, expected).unwrap();
    } else {
        assert!(page == expected, "docs/effects.md is behind the library; make it anew with UPDATE_DOCS=1");
    }
}

fn library() -> String {
    let mut out = String::from("\n| effect | stage | what the nominal model lacks |\n| --- | --- | --- |\n");
    for spec in LIBRARY.iter().copied() {
        let EffectSpec { name, summary, .. } = spec;
        writeln!(out, "| [{name}](#{name}) | {} | {summary} |", spec.stage.name()).unwrap();
    }
    let mut stage = None;
    for spec in LIBRARY.iter().copied() {
        if stage != Some(spec.stage) {
            stage = Some(spec.stage);
            let name = spec.stage.name();
            writeln!(out, "\n## {}{}", name[..1].to_uppercase(), &name[1..]).unwrap();
        }
        out += &section(spec);
    }
    out.push('\n');
    out
}

fn section(spec: &EffectSpec) -> String {
    let EffectSpec { name, summary, law, source, signature, .. } = spec;
    let mut out = format!("\n### {name}\n\n{}{}.\n\n", summary[..1].to_uppercase(), &summary[1..]);
    write!(out, "```text\n{law}\n```\n\n").unwrap();
    out += "| parameter | unit | range | prior | none at | left out | meaning |\n| --- | --- | --- | --- | --- | --- | --- |\n";
    for parameter in spec.parameters {
        out += &row(parameter);
    }
    write!(out, "\nShows in {}.", signature.shows.words()).unwrap();
    if !signature.confounded_with.is_empty() {
        let alike: Vec<_> =
            signature.confounded_with.iter().map(|name| format!("[{name}](#{name})")).collect();
        write!(out, " Ordinary flights hardly tell it from {}.", alike.join(" and ")).unwrap();
    }
    writeln!(out, " Source: {source}.").unwrap();
    out
}

fn row(parameter: &Parameter) -> String {
    let Parameter { key, unit, meaning, min, max, neutral, default, .. } = parameter;
    let [neutral, default] =
        [neutral, default].map(|value| value.map_or(String::new(), |value| value.to_string()));
    let prior = match parameter.prior {
        Prior::Normal { mean, sigma } => format!("{mean} ± {sigma}"),
        Prior::LogNormal { median, sigma_ln } => format!("{median} ×÷ {:.1}", sigma_ln.exp()),
    };
    format!("| `{key}` | {unit} | {min} to {max} | {prior} | {neutral} | {default} | {meaning} |\n")
}
