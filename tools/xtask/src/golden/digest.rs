//! Hashes of a verdict and of exported files, and where two of them differ.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::{Map, Value};
use sha2::Digest as _;

/// Bytes of SHA-256 that are stored: 48 bits tell some thousand values apart.
const HASH_BYTES: usize = 6;
/// The part of the passport that names the program: its version and its own hash.
const TOOL: &str = "tool";

/// Hashes of one case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Digest {
    /// Of the robot file, its URDF and the logs.
    pub(crate) inputs: String,
    /// Of every top-level field of the JSON, without sentences.
    fields: BTreeMap<String, String>,
    /// Of every exported file.
    export: BTreeMap<String, String>,
}

impl Digest {
    /// Hashes of a normalised document and of exported files by name.
    pub(crate) fn new(inputs: String, json: &Value, export: &BTreeMap<String, Vec<u8>>) -> Result<Digest> {
        let export = export.iter().map(|(name, bytes)| (name.clone(), short_hash(bytes))).collect();
        Ok(Digest { inputs, fields: field_hashes(json)?, export })
    }

    /// Whether a normalised document is the one behind these hashes.
    pub(crate) fn is_of(&self, json: &Value) -> bool {
        field_hashes(json).is_ok_and(|fields| fields == self.fields)
    }

    /// One line for every field and exported file whose hash is another one.
    pub(crate) fn differences(&self, other: &Digest) -> Vec<String> {
        let compare = |kind: &str, ours: &BTreeMap<String, String>, theirs: &BTreeMap<String, String>| {
            let names: BTreeSet<&String> = ours.keys().chain(theirs.keys()).collect();
            let line = |name: &String| match (ours.get(name), theirs.get(name)) {
                (Some(a), Some(b)) if a == b => None,
                (Some(_), Some(_)) => Some(format!("{kind} {name} differs")),
                (Some(_), None) => Some(format!("{kind} {name} is missing")),
                (None, _) => Some(format!("{kind} {name} is new")),
            };
            names.into_iter().filter_map(line).collect::<Vec<_>>()
        };
        let mut lines = compare("field", &self.fields, &other.fields);
        lines.extend(compare("export", &self.export, &other.export));
        lines
    }

    /// One line of JSON.
    pub(crate) fn json(&self) -> Result<String> {
        let value = serde_json::json!({ "inputs": self.inputs, "fields": self.fields, "export": self.export });
        Ok(serde_json::to_string(&value)?)
    }

    /// What [`Digest::json`] wrote.
    pub(crate) fn read(value: &Value) -> Result<Digest> {
        let hashes = |key: &str| -> Result<BTreeMap<String, String>> {
            let all = value[key].as_object().with_context(|| format!("no `{key}`"))?;
            let hash = |(name, hash): (&String, &Value)| Some((name.clone(), hash.as_str()?.to_owned()));
            Ok(all.iter().filter_map(hash).collect())
        };
        let inputs = value["inputs"].as_str().context("no `inputs`")?.to_owned();
        Ok(Digest { inputs, fields: hashes("fields")?, export: hashes("export")? })
    }
}

fn field_hashes(json: &Value) -> Result<BTreeMap<String, String>> {
    let fields = json.as_object().context("a verdict is a JSON object")?;
    fields.iter().map(|(name, value)| Ok((name.clone(), short_hash(&serde_json::to_vec(value)?)))).collect()
}

/// The first bytes of SHA-256, in hexadecimal digits.
pub(crate) fn short_hash(bytes: &[u8]) -> String {
    let mut digits = String::new();
    for byte in &sha2::Sha256::digest(bytes)[..HASH_BYTES] {
        // Writing to a string cannot fail.
        let _ = write!(digits, "{byte:02x}");
    }
    digits
}

/// Hash of several files, in order.
///
/// # Errors
/// A file that cannot be read.
pub(crate) fn of_files<'a>(paths: impl Iterator<Item = &'a Path>) -> Result<String> {
    let mut all = Vec::new();
    for path in paths {
        let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
        all.extend_from_slice(short_hash(&bytes).as_bytes());
    }
    Ok(short_hash(&all))
}

/// A document without the version of the program and without sentences. A sentence is a text of several words: names of
/// effects, joints, parameters, units and runs have one.
pub(crate) fn without_prose(value: Value) -> Value {
    match value {
        Value::Object(fields) => {
            let kept = fields.into_iter().filter(|(key, value)| key != TOOL && !is_sentence(value));
            Value::Object(kept.map(|(key, value)| (key, without_prose(value))).collect::<Map<_, _>>())
        }
        Value::Array(items) => {
            Value::Array(items.into_iter().filter(|item| !is_sentence(item)).map(without_prose).collect())
        }
        other => other,
    }
}

fn is_sentence(value: &Value) -> bool {
    value.as_str().is_some_and(|text| text.trim().contains(char::is_whitespace))
}

/// A line for every value that two documents do not share: its path, and both values.
pub(crate) fn differing_leaves(a: &Value, b: &Value) -> Vec<String> {
    let mut lines = Vec::new();
    compare(a, b, "", &mut lines);
    lines
}

fn compare(a: &Value, b: &Value, path: &str, lines: &mut Vec<String>) {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) => {
            let keys: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for key in keys {
                let of = |fields: &Map<String, Value>| fields.get(key).cloned().unwrap_or(Value::Null);
                compare(&of(a), &of(b), &format!("{path}.{key}"), lines);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (k, (a, b)) in a.iter().zip(b).enumerate() {
                compare(a, b, &format!("{path}[{k}]"), lines);
            }
        }
        _ if a == b => {}
        (Value::Array(a), Value::Array(b)) => lines.push(format!("{path}: {} entries -> {}", a.len(), b.len())),
        _ => lines.push(format!("{path}: {a} -> {b}")),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn digest(document: Value, file: &str) -> Digest {
        let export = BTreeMap::from([("model.toml".to_owned(), file.as_bytes().to_vec())]);
        Digest::new("inputs".to_owned(), &without_prose(document), &export).expect("a digest")
    }

    #[test]
    fn sentences_and_version_are_not_hashed() {
        let document = |text: &str, version: &str| {
            json!({
                "verdict": "effect",
                "log": [{"joint": "joint_1", "text": text}],
                "passport": {"tool": {"version": version}, "inputs": [{"name": "a.parquet"}]},
            })
        };
        assert_eq!(digest(document("It is late.", "1"), "a"), digest(document("It comes late.", "2"), "a"));
    }

    #[test]
    fn last_digit_of_a_value_changes_the_hash_of_its_field() {
        let before = digest(json!({"gap": {"before": 0.1}, "verdict": "effect"}), "a = 1");
        let after = digest(json!({"gap": {"before": 0.100_000_000_000_000_02}, "verdict": "effect"}), "a = 1");
        assert_eq!(before.differences(&after), ["field gap differs"]);
        let exported = digest(json!({"gap": {"before": 0.1}, "verdict": "effect"}), "a = 2");
        assert_eq!(before.differences(&exported), ["export model.toml differs"]);
    }

    #[test]
    fn differing_leaves_are_shown_by_path() {
        let a = json!({"causes": [{"effect": "payload", "share": 0.5}], "verdict": "parameter"});
        let b = json!({"causes": [{"effect": "payload", "share": 0.6}], "verdict": "parameter"});
        assert_eq!(differing_leaves(&a, &b), [".causes[0].share: 0.5 -> 0.6"]);
        let none = json!({"causes": [], "verdict": "parameter"});
        assert_eq!(differing_leaves(&a, &none), [".causes: 1 entries -> 0"]);
    }
}
