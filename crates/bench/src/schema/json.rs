//! Keys of a file as JSON Schema, draft 2020-12.

use bench_plant::effects::{EffectSpec, LIBRARY, Parameter};
use bench_rig::{
    keys::{Form, Key, Kind, Presence},
    visit::Range,
};
use serde_json::{Map, Value, json};

/// The largest tolerance that a file may state.
const SIGMA_MAX: f64 = 1e12;
/// The latest time of a profile's point, s.
const POINT_TIME_MAX_S: f64 = 86_400.0;

/// A schema that stands alone.
pub fn document(name: &str, title: &str, forms: &[Form]) -> Value {
    let mut schema = table(forms);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    schema["$id"] = json!(format!("urn:bench:schema:{name}"));
    schema["title"] = json!(title);
    schema
}

fn table(forms: &[Form]) -> Value {
    match forms {
        [form] => object(form),
        // Forms that a choice tells apart never hold both.
        forms => json!({ "oneOf": forms.iter().map(object).collect::<Vec<_>>() }),
    }
}

fn object(form: &Form) -> Value {
    let (mut properties, mut required) = (Map::new(), Vec::new());
    let mut dependent: Map<String, Value> = Map::new();
    let mut depends = |on: &str, needed: &str| {
        let list = dependent.entry(on).or_insert_with(|| json!([]));
        if let Value::Array(list) = list {
            list.push(json!(needed));
        }
    };
    for key in &form.keys {
        let mut schema = kind(&key.kind);
        let mut is_required = key.presence == Presence::Required;
        if let Some((decides, choice)) = &form.when
            && *decides == key.name
        {
            schema = json!({ "const": choice });
            // In a form of another choice than the default one the key cannot be left out.
            is_required |= key.presence != Presence::Text(choice.clone());
        }
        schema["description"] = json!(description(key));
        match &key.presence {
            Presence::Number(number) => schema["default"] = json!(number),
            Presence::Text(text) => schema["default"] = json!(text),
            Presence::Along(other) => {
                depends(other, &key.name);
                depends(&key.name, other);
            }
            Presence::Beside(others) => others.iter().for_each(|other| depends(other, &key.name)),
            Presence::Required | Presence::Optional => {}
        }
        if is_required {
            required.push(json!(key.name));
        }
        properties.insert(key.name.clone(), schema);
    }
    let mut object = json!({
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    });
    if !dependent.is_empty() {
        object["dependentRequired"] = Value::Object(dependent);
    }
    object
}

fn description(key: &Key) -> String {
    match key.unit() {
        Some(unit) if unit != "1" => format!("{} Unit: {unit}.", key.meaning),
        _ => key.meaning.clone(),
    }
}

fn kind(kind: &Kind) -> Value {
    match kind {
        Kind::Number(range) => number(*range),
        Kind::Uncertain(range) => json!({ "oneOf": [number(*range), {
            "type": "object",
            "properties": {
                "value": described(number(*range), "The nominal value."),
                "sigma": described(
                    number(Range::closed(0.0, SIGMA_MAX)),
                    "One standard deviation, in the value's unit.",
                ),
            },
            "required": ["value", "sigma"],
            "additionalProperties": false,
        }] }),
        Kind::Integer(low, high) => json!({ "type": "integer", "minimum": low, "maximum": high }),
        Kind::Text | Kind::File => json!({ "type": "string", "minLength": 1 }),
        Kind::Flag => json!({ "type": "boolean" }),
        Kind::Choice(names) => json!({ "enum": names }),
        Kind::List(of, least, most) => {
            let mut list = json!({ "type": "array", "items": self::kind(of), "minItems": least });
            if let Some(most) = most {
                list["maxItems"] = json!(most);
            }
            list
        }
        Kind::Pair(first, second) => pair(&self::kind(first), &self::kind(second)),
        Kind::Points(range) => {
            let point = pair(&number(Range::closed(0.0, POINT_TIME_MAX_S)), &number(*range));
            json!({ "oneOf": [number(*range), { "type": "array", "minItems": 1, "items": point }] })
        }
        Kind::Table(forms) => table(forms),
        Kind::Tables(forms, least) => {
            json!({ "type": "array", "minItems": least, "items": table(forms) })
        }
        Kind::Names(of) => json!({ "type": "object", "additionalProperties": self::kind(of) }),
        Kind::Effects => {
            json!({ "type": "array", "items": { "oneOf": LIBRARY.iter().map(|spec| effect(spec)).collect::<Vec<_>>() } })
        }
        Kind::AnyOf(kinds) => json!({ "anyOf": kinds.iter().map(self::kind).collect::<Vec<_>>() }),
    }
}

fn described(mut schema: Value, words: &str) -> Value {
    schema["description"] = json!(words);
    schema
}

fn number(range: Range) -> Value {
    let mut schema = json!({ "type": "number" });
    if let Some(low) = range.low() {
        schema[if range.is_low_open() { "exclusiveMinimum" } else { "minimum" }] = json!(low);
    }
    if let Some(high) = range.high() {
        schema["maximum"] = json!(high);
    }
    schema
}

/// `items: false` would say the same as `maxItems`, but to taplo, which reads schemas as an older draft, it refuses all.
fn pair(first: &Value, second: &Value) -> Value {
    json!({ "type": "array", "prefixItems": [first, second], "minItems": 2, "maxItems": 2 })
}

/// One effect of the library: its name and its parameters.
fn effect(spec: &EffectSpec) -> Value {
    let mut properties = Map::new();
    properties.insert(
        "name".to_owned(),
        json!({ "const": spec.name, "description": format!("{}.", sentence(spec.summary)) }),
    );
    let mut required = vec!["name"];
    for parameter in spec.parameters {
        let unit = if parameter.unit == "1" { String::new() } else { format!(" Unit: {}.", parameter.unit) };
        let mut schema = number(Range::closed(parameter.min, parameter.max));
        schema["description"] = json!(format!("{}.{unit}", sentence(parameter.meaning)));
        match parameter.default {
            Some(default) => schema["default"] = json!(default),
            None => required.push(parameter.key),
        }
        properties.insert(parameter.key.to_owned(), schema);
    }
    json!({
        "type": "object",
        "title": spec.name,
        "description": format!("{}. Law: {}.", sentence(spec.summary), spec.law),
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}

/// Puts the library's effects, with their parameters and ranges, where a sweep's plan takes effects of any name.
pub fn name_swept_effects(schema: &mut Value) {
    match schema {
        Value::Object(entries) => {
            if let Some(effects) =
                entries.get_mut("effects").filter(|effects| effects["additionalProperties"].is_object())
            {
                let description = effects["description"].take();
                *effects = swept_effects();
                effects["description"] = description;
            }
            entries.values_mut().for_each(name_swept_effects);
        }
        Value::Array(items) => items.iter_mut().for_each(name_swept_effects),
        _ => {}
    }
}

fn swept_effects() -> Value {
    let effects = LIBRARY.iter().map(|spec| {
        let parameters: Map<String, Value> =
            spec.parameters.iter().map(|parameter| (parameter.key.to_owned(), swept(parameter))).collect();
        let required: Vec<&str> = spec
            .parameters
            .iter()
            .filter(|parameter| parameter.default.is_none())
            .map(|parameter| parameter.key)
            .collect();
        let effect = json!({
            "type": "object",
            "description": format!("{}. Law: {}.", sentence(spec.summary), spec.law),
            "properties": parameters,
            "required": required,
            "additionalProperties": false,
        });
        (spec.name.to_owned(), effect)
    });
    let effects: Map<String, Value> = effects.collect();
    json!({ "type": "object", "properties": effects, "required": [], "additionalProperties": false })
}

/// A parameter as a plan gives it: a number, several, or where it is drawn from.
fn swept(parameter: &Parameter) -> Value {
    let within = number(Range::closed(parameter.min, parameter.max));
    let mut positive = within.clone();
    if parameter.min <= 0.0 {
        positive = number(Range::above(0.0, parameter.max));
    }
    let drawn = |name: &str, words: &str, ends: Value| {
        let mut properties = Map::new();
        properties.insert(name.to_owned(), described(ends, words));
        json!({ "type": "object", "properties": properties, "required": [name], "additionalProperties": false })
    };
    let unit = if parameter.unit == "1" { String::new() } else { format!(" Unit: {}.", parameter.unit) };
    json!({
        "description": format!("{}.{unit}", sentence(parameter.meaning)),
        "anyOf": [
            within,
            { "type": "array", "items": within, "minItems": 1 },
            { "const": "prior" },
            drawn("uniform", "Drawn evenly from the first to the second number.", pair(&within, &within)),
            drawn("log_uniform", "Drawn evenly in the logarithm from the first to the second number.", pair(&positive, &positive)),
            drawn(
                "normal",
                "Drawn from the normal distribution with this mean and this standard deviation.",
                pair(&within, &number(Range::closed(0.0, f64::MAX))),
            ),
        ],
    })
}

/// A phrase with a capital and without its point.
fn sentence(phrase: &str) -> String {
    let phrase = phrase.trim_end_matches('.');
    let mut letters = phrase.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
