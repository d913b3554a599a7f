//! From text to values: a tree with the place of every value, read key by key. Nothing stops at the first mistake.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use rivet_dynamics::toml_key;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{ConfigError, MOST_KEPT, Source, nearest};
use crate::keys::{self, Bounds, Fallback, Key, SECTIONS, Shape};
use crate::number_text::number_text;

/// A value as it holds after reading.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// The key is not given and has no default.
    Absent,
    /// A number.
    Number(f64),
    /// A whole number.
    Integer(i64),
    /// A switch.
    Bool(bool),
    /// Text or a word.
    Text(String),
    /// One number per joint, or x, y, z.
    Numbers(Vec<f64>),
    /// Joints of the URDF with their positions.
    JointPositions(Vec<(String, f64)>),
}

/// Where a value came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// This line of the file.
    Line(usize),
    /// The default of the key.
    Default,
    /// Chosen by the program, from data.
    Chosen,
    /// The URDF.
    Urdf,
}

/// A key with the value that holds.
#[derive(Clone, Debug)]
pub struct Resolved {
    /// The key's declaration.
    pub key: &'static Key,
    /// Its value.
    pub value: Value,
    /// Where the value came from.
    pub origin: Origin,
}

/// One base parameter of `[identified]`, with the place of its name.
pub(crate) struct RawParameter {
    pub(crate) name: String,
    pub(crate) value: f64,
    pub(crate) std: f64,
    pub(crate) span: Range<usize>,
}

/// Beginning of the sections of effects.
const EFFECTS: &str = "effects";

type Path2 = (&'static str, &'static str);

pub(crate) struct Reader<'a> {
    source: Source<'a>,
    /// Values by section and name.
    values: HashMap<Path2, &'a Spanned<DeValue<'a>>>,
    /// Where a section begins, of those in the file.
    sections: HashMap<&'static str, Range<usize>>,
    /// Keys with a mistake: rules that join two keys leave them alone.
    bad: HashSet<Path2>,
    /// Joint names of the URDF, once it has been read.
    joints: Vec<String>,
    /// Defaults made from other values.
    derived: HashMap<Path2, f64>,
    /// Defaults of each joint, from the URDF.
    of_urdf: HashMap<Path2, Vec<f64>>,
    errors: Vec<ConfigError>,
    /// Lines that are no TOML: what recovery makes of them is not reported as well.
    broken: HashSet<usize>,
    resolved: Vec<Resolved>,
}

impl<'a> Reader<'a> {
    /// Sorts the tree into known keys; everything else is a mistake.
    pub(crate) fn new(source: Source<'a>, root: &'a Spanned<DeTable<'a>>, errors: Vec<ConfigError>) -> Reader<'a> {
        let mut reader = Reader {
            source,
            values: HashMap::new(),
            sections: HashMap::new(),
            bad: HashSet::new(),
            joints: Vec::new(),
            derived: HashMap::new(),
            of_urdf: HashMap::new(),
            broken: errors.iter().map(|e| e.line).collect(),
            errors,
            resolved: Vec::new(),
        };
        // `[effects.backlash]` is a table in a table to TOML, and a section here.
        let entries = root.get_ref().iter().flat_map(|(name, value)| match value.get_ref() {
            DeValue::Table(table) if name.get_ref() == EFFECTS => {
                table.iter().map(|(name, value)| (format!("{EFFECTS}.{}", name.get_ref()), name, value)).collect()
            }
            _ => vec![(name.get_ref().to_string(), name, value)],
        });
        for (path, name, value) in entries {
            let section = SECTIONS.iter().map(|(s, _)| *s).find(|s| !s.is_empty() && *s == path);
            match (section, value.get_ref()) {
                (Some(section), DeValue::Table(table)) => {
                    reader.sections.insert(section, value.span());
                    for (name, value) in table {
                        reader.insert(section, name, value);
                    }
                }
                (Some(section), _) => {
                    let written = reader.written(&value.span()).to_owned();
                    let hint = format!("write it as a table: `[{section}]` and its keys below");
                    reader.fail(&value.span(), section, &written, "must be a section", hint);
                }
                (None, _) if path.starts_with(EFFECTS) && reader.full() => {}
                (None, _) if path.starts_with(EFFECTS) => {
                    let effects = SECTIONS.iter().filter_map(|(s, _)| s.strip_prefix("effects."));
                    let hint = match nearest(name.get_ref(), effects) {
                        Some(near) => format!("did you mean `[{EFFECTS}.{near}]`?"),
                        None => "the table of sections in docs/robot-toml.md has the effects that there are".to_owned(),
                    };
                    reader.fail(&name.span(), path, "", "unknown effect", hint);
                }
                (None, _) => reader.insert("", name, value),
            }
        }
        reader
    }

    fn insert(
        &mut self,
        section: &'static str,
        name: &Spanned<std::borrow::Cow<'a, str>>,
        value: &'a Spanned<DeValue<'a>>,
    ) {
        let word = name.get_ref().as_ref();
        if let Some(key) = keys::find(section, word) {
            self.values.insert((section, key.name), value);
            return;
        }
        if self.full() {
            return;
        }
        let hint = unknown_hint(section, word);
        let path = if section.is_empty() { word.to_owned() } else { format!("{section}.{word}") };
        let (rule, written) = if matches!(value.get_ref(), DeValue::Table(_)) && section.is_empty() {
            ("unknown section", String::new())
        } else {
            ("unknown key", self.written(&value.span()).to_owned())
        };
        self.fail(&name.span(), path, &written, rule, hint);
    }

    /// The text of a span, as it stands in the file.
    fn written(&self, span: &Range<usize>) -> &'a str {
        self.source.text.get(span.clone()).unwrap_or("")
    }

    fn fail(
        &mut self,
        span: &Range<usize>,
        key: impl Into<String>,
        value: &str,
        rule: impl Into<String>,
        hint: impl Into<String>,
    ) {
        if self.full() {
            return;
        }
        let error = ConfigError::at(&self.source, span, key, value, rule, hint);
        let last = error.line + self.written(span).matches('\n').count();
        if !(error.line..=last).any(|line| self.broken.contains(&line)) {
            self.errors.push(error);
        }
    }

    /// Whether further mistakes are left out.
    fn full(&self) -> bool {
        self.errors.len() >= MOST_KEPT
    }

    /// A mistake of one key's value, at its place (at the section where the key is missing).
    pub(crate) fn reject(
        &mut self,
        section: &'static str,
        name: &'static str,
        rule: impl Into<String>,
        hint: impl Into<String>,
    ) {
        let key = path(section, name);
        self.bad.insert((section, name));
        if let Some(value) = self.values.get(&(section, name)) {
            let span = value.span();
            self.fail(&span, key, self.written(&span), rule, hint);
            return;
        }
        let default = self.resolved.iter().find(|r| r.key.section == section && r.key.name == name);
        let value = match default.map(|r| &r.value) {
            None | Some(Value::Absent) => "(missing)".to_owned(),
            Some(value) => format!("{} (default)", value_text(value)),
        };
        match self.sections.get(section) {
            Some(span) if !section.is_empty() => self.fail(&span.clone(), key, &value, rule, hint),
            _ => self.errors.push(ConfigError::nowhere(self.source.file, key, &value, rule, hint)),
        }
    }

    /// A mistake in entry `i` (from 0) of an array.
    /// Whether the key is in the file and nothing was found wrong with it so far.
    pub(crate) fn is_sound(&self, section: &'static str, name: &'static str) -> bool {
        self.values.contains_key(&(section, name)) && !self.bad.contains(&(section, name))
    }

    pub(crate) fn reject_entry(
        &mut self,
        section: &'static str,
        name: &'static str,
        i: usize,
        rule: String,
        hint: String,
    ) {
        let entry = self.values.get(&(section, name)).and_then(|v| v.get_ref().as_array()).and_then(|a| a.get(i));
        match entry.map(Spanned::span) {
            Some(span) => {
                self.bad.insert((section, name));
                self.fail(&span, format!("{}[{}]", path(section, name), i + 1), self.written(&span), rule, hint);
            }
            None => self.reject(section, name, rule, hint),
        }
    }

    /// A mistake at a given place of a key's value.
    pub(crate) fn reject_at(
        &mut self,
        section: &'static str,
        name: &'static str,
        span: &Range<usize>,
        rule: impl Into<String>,
        hint: impl Into<String>,
    ) {
        self.bad.insert((section, name));
        self.fail(span, path(section, name), self.written(span), rule, hint);
    }

    /// Joint names that per-joint arrays and joint references are checked against.
    pub(crate) fn set_joints(&mut self, joints: Vec<String>) {
        self.joints = joints;
    }

    /// Whether the file has the section.
    pub(crate) fn has_section(&self, section: &'static str) -> bool {
        self.sections.contains_key(section)
    }

    /// Whether the file gives the key.
    pub(crate) fn has(&self, section: &'static str, name: &'static str) -> bool {
        self.values.contains_key(&(section, name))
    }

    /// Whether no mistake was found in any of the keys so far.
    pub(crate) fn good(&self, keys: &[Path2]) -> bool {
        keys.iter().all(|k| !self.bad.contains(k))
    }

    /// Whether no mistake was found at all so far.
    pub(crate) fn clean(&self) -> bool {
        self.errors.is_empty()
    }

    /// Sets a default that depends on other values.
    pub(crate) fn derive(&mut self, section: &'static str, name: &'static str, default: f64) {
        self.derived.insert((section, name), default);
    }

    /// Sets a default of each joint that the URDF has.
    pub(crate) fn derive_from_urdf(&mut self, section: &'static str, name: &'static str, defaults: Vec<f64>) {
        self.of_urdf.insert((section, name), defaults);
    }

    /// Whether the file has keys, and none of them is one of a robot file: it is of another program.
    pub(crate) fn is_foreign(&self) -> bool {
        self.values.is_empty() && self.sections.is_empty() && !self.errors.is_empty()
    }

    /// Everything read, or every mistake.
    pub(crate) fn finish(self) -> (Vec<Resolved>, Vec<ConfigError>) {
        (self.resolved, self.errors)
    }

    /// The declaration and the value; a missing key that must be there is a mistake.
    fn take(&mut self, section: &'static str, name: &'static str) -> (&'static Key, Option<&'a Spanned<DeValue<'a>>>) {
        let key = keys::find(section, name).expect("keys that are read are declared: a test reads them all");
        let value = self.values.get(&(section, name)).copied();
        if value.is_none() && key.fallback == Fallback::Required {
            let place =
                if section.is_empty() { "at the top of the file".into() } else { format!("below `[{section}]`") };
            let rule = format!("must be given ({}{})", shape_text(key.shape), key.unit_text());
            self.reject(section, name, rule, format!("write `{name} = ...` {place}"));
        }
        (key, value)
    }

    fn resolve(&mut self, key: &'static Key, value: Value) {
        let origin = match self.values.get(&(key.section, key.name)) {
            Some(v) => Origin::Line(self.source.line(v.span().start)),
            None if self.of_urdf.contains_key(&(key.section, key.name)) => Origin::Urdf,
            None => Origin::Default,
        };
        self.resolved.push(Resolved { key, value, origin });
    }

    fn wrong_type(&mut self, key: &'static Key, found: &DeValue<'_>) {
        let rule = format!("must be {}, not {}", shape_text(key.shape), found_text(found));
        let hint = match key.shape {
            Shape::Number | Shape::Integer if found.is_str() => "write the number without quotes".into(),
            Shape::Integer if found.is_float() => "leave the fraction out".into(),
            Shape::Bool if found.is_str() => "write true or false without quotes".into(),
            Shape::Text | Shape::Choice(_) => "write it in double quotes".into(),
            Shape::PerJoint | Shape::PerJointOrOne => format!("write it in brackets: {}", self.joints.join(", ")),
            _ => format!("see the table of `[{}]` in docs/robot-toml.md", key.section),
        };
        self.reject(key.section, key.name, rule, hint);
    }

    /// A finite number inside the key's bounds; otherwise a mistake, at entry `i` of an array if there is one.
    fn checked(&mut self, key: &'static Key, value: &DeValue<'_>, entry: Option<usize>) -> Option<f64> {
        let x = match value {
            DeValue::Float(x) => x.as_str().parse::<f64>().ok(),
            DeValue::Integer(x) => i64::from_str_radix(x.as_str(), x.radix()).ok().map(|x| x as f64),
            _ => None,
        };
        let unit = key.unit_text();
        let (rule, hint) = match x {
            None => (format!("must be a number{unit}, not {}", found_text(value)), "write a plain number".to_owned()),
            Some(x) if !x.is_finite() => {
                (format!("must be finite{unit}"), "give a number that was measured or published".into())
            }
            Some(x) if !key.bounds.allow(x) => (format!("must keep {}{unit}", key.bounds.text()), bounds_hint(key, x)),
            Some(x) => return Some(x),
        };
        match entry {
            Some(i) => {
                let joint = match (key.shape, self.joints.get(i)) {
                    (Shape::PerJoint | Shape::PerJointOrOne, Some(name)) => {
                        format!("{hint} (joint {} is {name})", i + 1)
                    }
                    _ => hint,
                };
                self.reject_entry(key.section, key.name, i, rule, joint);
            }
            None => self.reject(key.section, key.name, rule, hint),
        }
        None
    }

    /// A number, or `None` where the key is absent, has no default, or is wrong.
    pub(crate) fn optional_number(&mut self, section: &'static str, name: &'static str) -> Option<f64> {
        let (key, value) = self.take(section, name);
        let number = match (value, key.fallback) {
            (Some(v), _) if v.get_ref().is_float() || v.get_ref().is_integer() => self.checked(key, v.get_ref(), None),
            (Some(v), _) => {
                self.wrong_type(key, v.get_ref());
                None
            }
            (None, Fallback::Number(x)) => Some(x),
            (None, _) => self.derived.get(&(section, name)).copied(),
        };
        self.resolve(key, number.map_or(Value::Absent, Value::Number));
        number
    }

    /// A number; NaN after a mistake (the file is refused anyway).
    pub(crate) fn number(&mut self, section: &'static str, name: &'static str) -> f64 {
        self.optional_number(section, name).unwrap_or(f64::NAN)
    }

    /// A whole number, or `None` as for [`Reader::optional_number`].
    pub(crate) fn optional_integer(&mut self, section: &'static str, name: &'static str) -> Option<i64> {
        let (key, value) = self.take(section, name);
        let number = match (value, key.fallback) {
            (Some(v), _) if v.get_ref().is_integer() => self.checked(key, v.get_ref(), None).map(|x| x as i64),
            (Some(v), _) => {
                self.wrong_type(key, v.get_ref());
                None
            }
            (None, Fallback::Integer(x)) => Some(x),
            (None, _) => self.derived.get(&(section, name)).map(|x| *x as i64),
        };
        self.resolve(key, number.map_or(Value::Absent, Value::Integer));
        number
    }

    /// A whole number that is not negative; 0 after a mistake.
    pub(crate) fn count(&mut self, section: &'static str, name: &'static str) -> usize {
        self.optional_integer(section, name).and_then(|x| usize::try_from(x).ok()).unwrap_or(0)
    }

    /// `true` or `false`; `false` after a mistake.
    pub(crate) fn switch(&mut self, section: &'static str, name: &'static str) -> bool {
        let (key, value) = self.take(section, name);
        let on = match (value.map(Spanned::get_ref), key.fallback) {
            (Some(DeValue::Boolean(b)), _) => *b,
            (Some(v), _) => {
                self.wrong_type(key, v);
                false
            }
            (None, Fallback::Bool(b)) => b,
            (None, _) => self.derived.get(&(section, name)).is_some_and(|x| *x != 0.0),
        };
        self.resolve(key, Value::Bool(on));
        on
    }

    /// Text, checked against the words of a choice; empty after a mistake.
    pub(crate) fn text(&mut self, section: &'static str, name: &'static str) -> String {
        let (key, value) = self.take(section, name);
        let text = match (value.map(Spanned::get_ref), key.fallback) {
            (Some(DeValue::String(s)), _) => s.to_string(),
            (Some(v), _) => {
                self.wrong_type(key, v);
                String::new()
            }
            (None, Fallback::Text(s)) => s.into(),
            (None, _) => String::new(),
        };
        if let Shape::Choice(words) = key.shape
            && !text.is_empty()
            && !words.contains(&text.as_str())
        {
            let rule = format!("must be one of {}", words.join(", "));
            let hint = nearest(&text, words.iter().copied()).unwrap_or(words[0]);
            self.reject(section, name, rule, format!("did you mean \"{hint}\"?"));
        }
        self.resolve(key, if text.is_empty() { Value::Absent } else { Value::Text(text.clone()) });
        text
    }

    /// Numbers of an array (or one number for all joints), or `None` where absent or wrong.
    pub(crate) fn optional_numbers(&mut self, section: &'static str, name: &'static str) -> Option<Vec<f64>> {
        let (key, value) = self.take(section, name);
        let wanted = if key.shape == Shape::Vector { 3 } else { self.joints.len() };
        let numbers = match (value.map(Spanned::get_ref), key.fallback) {
            (Some(DeValue::Array(array)), _) => {
                let mut numbers = Vec::with_capacity(array.len());
                for (i, entry) in array.iter().enumerate() {
                    numbers.extend(self.checked(key, entry.get_ref(), Some(i)));
                }
                let complete = numbers.len() == array.len();
                if wanted != 0 && array.len() != wanted {
                    let (rule, hint) = length_text(key.shape, array.len(), wanted, &self.joints);
                    self.reject(section, name, rule, hint);
                    None
                } else {
                    complete.then_some(numbers)
                }
            }
            (Some(v), _) if key.shape == Shape::PerJointOrOne && (v.is_float() || v.is_integer()) => {
                self.checked(key, v, None).map(|x| vec![x; wanted])
            }
            (Some(v), _) => {
                self.wrong_type(key, v);
                None
            }
            (None, Fallback::Number(x)) => Some(vec![x; wanted]),
            (None, _) if self.of_urdf.contains_key(&(section, name)) => self.of_urdf.get(&(section, name)).cloned(),
            (None, _) => self.derived.get(&(section, name)).map(|x| vec![*x; wanted]),
        };
        self.resolve(key, numbers.clone().map_or(Value::Absent, Value::Numbers));
        numbers
    }

    /// Numbers; empty after a mistake.
    pub(crate) fn numbers(&mut self, section: &'static str, name: &'static str) -> Vec<f64> {
        self.optional_numbers(section, name).unwrap_or_default()
    }

    /// A joint by number from 1 or by name; its index from 0.
    pub(crate) fn joint(&mut self, section: &'static str, name: &'static str) -> Option<usize> {
        let (key, value) = self.take(section, name);
        let n = self.joints.len();
        let index = match value.map(Spanned::get_ref) {
            Some(DeValue::Integer(i)) => {
                let number = i64::from_str_radix(i.as_str(), i.radix()).unwrap_or(0);
                usize::try_from(number - 1).ok().filter(|i| n == 0 || *i < n)
            }
            Some(DeValue::String(s)) => self.joints.iter().position(|j| j == s),
            _ => None,
        };
        if let (Some(value), None) = (value, index)
            && n != 0
        {
            let word = value.get_ref().as_str().unwrap_or("");
            let hint = match nearest(word, self.joints.iter().map(String::as_str)) {
                Some(joint) => format!("did you mean \"{joint}\"?"),
                None => format!("the joints are {}", self.joints.join(", ")),
            };
            self.reject(section, name, format!("must be a joint: 1 to {n}, or its name"), hint);
        }
        let joint = index.and_then(|i| self.joints.get(i)).cloned();
        self.resolve(key, joint.map_or(Value::Absent, Value::Text));
        index
    }

    /// Joints with their positions; those that are wrong are left out.
    pub(crate) fn joint_positions(&mut self, section: &'static str, name: &'static str) -> Vec<(String, f64)> {
        let (key, value) = self.take(section, name);
        let mut positions = Vec::new();
        match value.map(Spanned::get_ref) {
            Some(DeValue::Table(table)) => {
                for (joint, position) in table {
                    let joint = joint.get_ref().to_string();
                    if let Some(at) = self.joint_position(key, &joint, position) {
                        positions.push((joint, at));
                    }
                }
            }
            Some(other) => self.wrong_type(key, other),
            None => {}
        }
        let resolved = if value.is_some() { Value::JointPositions(positions.clone()) } else { Value::Absent };
        self.resolve(key, resolved);
        positions
    }

    fn joint_position(&mut self, key: &'static Key, joint: &str, position: &Spanned<DeValue<'_>>) -> Option<f64> {
        let number = match position.get_ref() {
            DeValue::Float(x) => x.as_str().parse::<f64>().ok(),
            DeValue::Integer(x) => i64::from_str_radix(x.as_str(), x.radix()).ok().map(|x| x as f64),
            _ => None,
        };
        if let Some(at) = number.filter(|x| x.is_finite() && key.bounds.allow(*x)) {
            return Some(at);
        }
        let rule = format!("position of \"{joint}\" must be a number that keeps {} [rad or m]", key.bounds.text());
        self.reject_at(key.section, key.name, &position.span(), rule, format!("write `{joint} = 0.0` for its zero"));
        None
    }

    /// The entries of `identified.parameters` that are well formed.
    pub(crate) fn parameters(&mut self, section: &'static str, name: &'static str) -> Vec<RawParameter> {
        let (key, value) = self.take(section, name);
        let mut parameters = Vec::new();
        let Some(value) = value else { return parameters };
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(key, value.get_ref());
            return parameters;
        };
        for (i, entry) in array.iter().enumerate() {
            let fields = entry.get_ref().as_table();
            let number = |field: &str| match fields.and_then(|t| t.get(field)).map(Spanned::get_ref) {
                Some(DeValue::Float(x)) => x.as_str().parse::<f64>().ok().filter(|x| x.is_finite()),
                Some(DeValue::Integer(x)) => x.as_str().parse::<f64>().ok(),
                _ => None,
            };
            let word = fields.and_then(|t| t.get("name")).and_then(|n| n.get_ref().as_str());
            let known = fields.is_some_and(|t| t.len() == 3);
            match (word, number("value"), number("std").filter(|s| *s >= 0.0), known) {
                (Some(word), Some(value), Some(std), true) => {
                    parameters.push(RawParameter { name: word.to_owned(), value, std, span: entry.span() });
                }
                _ => self.reject_entry(
                    section,
                    name,
                    i,
                    "must be { name = \"...\", value = finite number, std = number >= 0 }".into(),
                    "let `rivet identify --export` write this section".into(),
                ),
            }
        }
        parameters
    }
}

fn path(section: &str, name: &str) -> String {
    if section.is_empty() { name.to_owned() } else { format!("{section}.{name}") }
}

fn shape_text(shape: Shape) -> &'static str {
    match shape {
        Shape::Number => "a number",
        Shape::Integer => "a whole number",
        Shape::Bool => "true or false",
        Shape::Text | Shape::Choice(_) => "text",
        Shape::Vector => "three numbers [x, y, z]",
        Shape::PerJoint => "an array with one number per joint",
        Shape::PerJointOrOne => "a number, or an array with one number per joint",
        Shape::Joint => "a joint number from 1, or a joint name",
        Shape::JointPositions => "a table { joint = position }",
        Shape::Parameters => "an array of { name, value, std }",
    }
}

fn found_text(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "text",
        DeValue::Integer(_) => "an integer",
        DeValue::Float(_) => "a number with a fraction",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "an array",
        DeValue::Table(_) => "a table",
    }
}

fn length_text(shape: Shape, found: usize, wanted: usize, joints: &[String]) -> (String, String) {
    if shape == Shape::Vector {
        return (format!("has {found} values, must have 3"), "give x, y and z in base axes".into());
    }
    (
        format!("has {found} values, the URDF has {wanted} joints"),
        format!("give one value per joint, base to flange: {}", joints.join(", ")),
    )
}

fn bounds_hint(key: &Key, x: f64) -> String {
    match (key.bounds, key.fallback) {
        (Bounds::NonZero(_), _) if x == 0.0 && key.name == "gear_ratio" => "a direct drive has ratio 1".into(),
        (bounds, _) if x < 0.0 && bounds.allow(-x) && !key.unit_text().is_empty() => {
            "give its size without a sign".into()
        }
        (Bounds::Above(..), Fallback::Absent) if x == 0.0 => {
            "without the key the default of docs/robot-toml.md acts".into()
        }
        _ if key.unit == "rad" => "the unit is rad; one degree is 0.01745 rad".into(),
        (_, Fallback::Required | Fallback::Absent) if key.unit_text().is_empty() => "see docs/robot-toml.md".into(),
        (_, Fallback::Required | Fallback::Absent) => format!("the unit is {}", key.unit),
        (_, fallback) => format!("without the key it is {}", fallback.text()),
    }
}

/// What an unknown key may have been meant to be.
fn unknown_hint(section: &str, word: &str) -> String {
    let sections = || SECTIONS.iter().map(|(s, _)| *s).filter(|s| !s.is_empty() && !s.starts_with(EFFECTS));
    if let Some(name) = nearest(word, keys::names(section).chain(sections().filter(|_| section.is_empty()))) {
        return format!("did you mean `{name}`?");
    }
    if let Some(other) = SECTIONS.iter().map(|(s, _)| *s).find(|s| keys::find(s, word).is_some()) {
        let place = if other.is_empty() { "to the top of the file".into() } else { format!("below `[{other}]`") };
        return format!("it belongs {place}");
    }
    let effects = section.is_empty().then_some("effects.<name>");
    let known: Vec<_> = keys::names(section).chain(sections().filter(|_| section.is_empty())).chain(effects).collect();
    format!("known here: {}", known.join(", "))
}

/// A value as it would stand in the file.
pub(crate) fn value_text(value: &Value) -> String {
    match value {
        Value::Absent => "none".into(),
        Value::Number(x) => number_text(*x),
        Value::Integer(x) => format!("{x}"),
        Value::Bool(x) => format!("{x}"),
        Value::Text(x) => format!("{x:?}"),
        Value::Numbers(x) => format!("[{}]", x.iter().map(|x| number_text(*x)).collect::<Vec<_>>().join(", ")),
        Value::JointPositions(x) => {
            let entries: Vec<String> =
                x.iter().map(|(joint, at)| format!("{} = {}", toml_key(joint), number_text(*at))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
    }
}
