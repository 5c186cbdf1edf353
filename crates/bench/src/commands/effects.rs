use std::fmt::Write as _;

use bench_plant::effects::{EffectSpec, LIBRARY, Prior};
use clap::Args;
use serde_json::{Value, json};

use crate::{arguments::Json, exit::Exit, words};

/// List the effects that the nominal model lacks, with their laws and parameters
#[derive(Args)]
#[command(after_help = "Examples:
  bench effects
  bench effects rotor-lag
  bench effects --json | jq '.effects[].name'")]
pub struct Arguments {
    /// Only these effects, in full
    names: Vec<String>,
    #[command(flatten)]
    json: Json,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<Exit> {
    for name in &arguments.names {
        if LIBRARY.iter().all(|spec| spec.name != name) {
            anyhow::bail!("no effect is called {name:?}; `bench effects` lists them");
        }
    }
    let chosen: Vec<_> = LIBRARY
        .iter()
        .copied()
        .filter(|spec| arguments.names.is_empty() || arguments.names.iter().any(|name| name == spec.name))
        .collect();
    if arguments.json.json {
        let effects: Vec<_> = chosen.iter().map(|spec| as_json(spec)).collect();
        words::print_json(&json!({ "schema": "bench.effects/1", "effects": effects }))?;
    } else if arguments.names.is_empty() {
        words::print(&overview(&chosen))?;
    } else {
        words::print(&chosen.iter().map(|spec| in_full(spec)).collect::<Vec<_>>().join("\n"))?;
    }
    Ok(Exit::Done)
}

fn overview(specs: &[&EffectSpec]) -> String {
    let mut out = String::new();
    let mut stage = None;
    for spec in specs {
        if stage != Some(spec.stage) {
            stage = Some(spec.stage);
            let _ = writeln!(out, "{}", spec.stage.name());
        }
        let _ = writeln!(out, "  {:<22} {}", spec.name, spec.summary);
    }
    out + "\n`bench effects NAME` shows law, parameters and source; `bench sim --effect NAME:param=value` flies it.\n"
}

fn in_full(spec: &EffectSpec) -> String {
    let mut out = format!(
        "{} ({})\n  {}\n  law      {}\n  source   {}\n",
        spec.name,
        spec.stage.name(),
        spec.summary,
        spec.law,
        spec.source
    );
    for p in spec.parameters {
        let _ = writeln!(
            out,
            "  {:<24} {}; {} to {}{}; {}",
            p.key,
            p.meaning,
            p.min,
            p.max,
            if p.unit == "1" { String::new() } else { format!(" {}", p.unit) },
            p.default
                .map_or_else(|| format!("typically {}", p.prior.typical()), |x| format!("{x} if left out"))
        );
    }
    let _ = writeln!(out, "  shows in {}", spec.signature.shows.words());
    if !spec.signature.confounded_with.is_empty() {
        let _ = writeln!(out, "  alike    {}", spec.signature.confounded_with.join(", "));
    }
    out + &format!("  example  bench sim --effect {}\n", spec.example())
}

fn as_json(spec: &EffectSpec) -> Value {
    let parameters: Vec<_> = spec
        .parameters
        .iter()
        .map(|p| {
            let prior = match p.prior {
                Prior::Normal { mean, sigma } => json!({ "kind": "normal", "mean": mean, "sigma": sigma }),
                Prior::LogNormal { median, sigma_ln } => {
                    json!({ "kind": "log-normal", "median": median, "sigma_ln": sigma_ln })
                }
            };
            json!({
                "key": p.key, "unit": p.unit, "meaning": p.meaning, "min": p.min, "max": p.max, "neutral": p.neutral,
                "default": p.default,
                "prior": prior
            })
        })
        .collect();
    json!({
        "name": spec.name,
        "stage": spec.stage.name(),
        "summary": spec.summary,
        "law": spec.law,
        "source": spec.source,
        "shows_in": spec.signature.shows.words(),
        "confounded_with": spec.signature.confounded_with,
        "parameters": parameters,
        "example": spec.example(),
    })
}
