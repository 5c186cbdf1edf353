//! Gains into a rig's file, the rest of which stays as its author wrote it.

use std::path::Path;

use toml_edit::{DocumentMut, Formatted, Item, Value};

use crate::{error::TuneError, tune::Tuning};

/// First words of the line that says where gains come from; a rig that is tuned again has one.
const MARK: &str = "# Gains tuned by `bench tune`";

/// A rig's text with the gains found under another name, its comments, order and spaces kept. `how` is told in the first
/// line. Files that the rig names beside it are named as `files` says, by their key.
pub fn with_gains(
    text: &str,
    tuning: &Tuning,
    name: &str,
    how: &str,
    files: &[(&str, &Path)],
) -> Result<String, TuneError> {
    let bad = |detail: String| TuneError::Text { detail };
    let mut document: DocumentMut = text.parse().map_err(|error| bad(format!("{error}")))?;
    let mut rename = |key: &str, text: &str| {
        replace(document.get_mut(key), Value::from(text)).ok_or_else(|| bad(format!("there is no `{key}`")))
    };
    rename("name", name)?;
    for (key, path) in files {
        rename(key, path.to_str().ok_or_else(|| bad(format!("{} is not UTF-8", path.display())))?)?;
    }
    let control = document
        .get_mut("control")
        .and_then(Item::as_table_like_mut)
        .ok_or_else(|| bad("there is no table [control]".to_owned()))?;
    for tuned in &tuning.loops {
        for (key, value) in tuned.keys.iter().zip(&tuned.after.gains) {
            replace(control.get_mut(key), Value::Float(Formatted::new(*value)))
                .ok_or_else(|| bad(format!("there is no `{key}` in [control]")))?;
        }
    }
    let out = document.to_string();
    // Where they came from before is told no more.
    let rest: String = out.split_inclusive('\n').filter(|line| !line.starts_with(MARK)).collect();
    Ok(format!("{MARK}: {how}\n{rest}"))
}

/// Another value where one stands, with the spaces and the comment about it.
fn replace(item: Option<&mut Item>, mut value: Value) -> Option<()> {
    let old = item?.as_value_mut()?;
    *value.decor_mut() = old.decor().clone();
    *old = value;
    Some(())
}
