//! JSON messages: their fields are those of the first one.

use serde_json::Value;

use crate::Field;

/// Of a list, as many elements are fields.
const LISTED: usize = 8;
/// More than any message in use.
const MOST: usize = 1000;

/// The numbers and texts in a message, by their paths.
pub(crate) fn fields(message: &Value) -> Vec<(Field, String)> {
    let mut found = Vec::new();
    list(message, String::new(), String::new(), &mut found);
    found
}

/// `name` is how a map calls it, `pointer` is RFC 6901's.
fn list(value: &Value, name: String, pointer: String, found: &mut Vec<(Field, String)>) {
    if found.len() >= MOST {
        return;
    }
    match value {
        Value::Object(members) => {
            for (key, value) in members {
                let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                let key = key.replace('~', "~0").replace('/', "~1");
                list(value, name, format!("{pointer}/{key}"), found);
            }
        }
        Value::Array(elements) => {
            for (place, value) in elements.iter().take(LISTED).enumerate() {
                list(value, format!("{name}[{place}]"), format!("{pointer}/{place}"), found);
            }
        }
        _ => found.push((Field::new(name), pointer)),
    }
}
