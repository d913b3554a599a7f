//! A message of the bus as JSON.

use rivet_ipc_schema::{
    ControllerHealth, Drift, Health, JointState, LinkState, MAX_JOINTS, MAX_PARAMETERS, Message, Parameters, Service,
    Setpoint, Stamped,
};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::Value;

use crate::bands::ParameterBands;
use crate::counts::{Counts, Origin};
use crate::events::LogLine;
use crate::friction::FrictionCurves;
use crate::residuals::Residual;
use crate::states::States;

/// Encoding of messages, as MCAP's registry and Foxglove's protocol name them.
pub const ENCODING: &str = "json";
/// The same of schemas.
pub const SCHEMA_ENCODING: &str = "jsonschema";

/// A message, and when it was taken from the bus.
#[derive(Clone, Debug)]
pub struct Received {
    /// `CLOCK_MONOTONIC` \[ns\].
    pub at_ns: u64,
    /// Identity of its publisher on the bus; none of what follows from other messages.
    pub publisher: Option<u128>,
    /// The message.
    pub content: Content,
}

impl Received {
    /// What follows from other messages, at `at_ns`: `CLOCK_MONOTONIC` \[ns\].
    pub fn derived(at_ns: u64, content: Content) -> Received {
        Received { at_ns, publisher: None, content }
    }

    /// Its number in the sequence of its publisher; none where its service has no such number.
    pub fn origin(&self) -> Option<Origin> {
        self.content.number().map(|number| Origin { publisher: self.publisher, number })
    }
}

/// A message that is recorded.
#[derive(Clone, Debug)]
pub enum Content {
    /// Measured state of the arm.
    JointState(Box<JointState>),
    /// Planned motion.
    Setpoint(Box<Setpoint>),
    /// Second encoders.
    LinkState(Box<LinkState>),
    /// Estimated parameters.
    Parameters(Box<Parameters>),
    /// The daemon's report.
    Health(Box<Health>),
    /// Whether the arm is still the one that was accepted.
    Drift(Box<Drift>),
    /// The controller's report.
    ControllerHealth(Box<ControllerHealth>),
    /// What was recorded so far, and what was lost.
    Counts(Box<Counts>),
    /// Measured against predicted torque.
    Residual(Box<Residual>),
    /// Friction of each joint over its speed.
    FrictionCurves(Box<FrictionCurves>),
    /// Parameters by name, with bands.
    ParameterBands(Box<ParameterBands>),
    /// States of daemon and controller in words.
    States(Box<States>),
    /// A line of the log, and its stamp, `CLOCK_MONOTONIC` \[ns\].
    LogLine(Box<LogLine>, u64),
}

/// A topic of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Topic {
    /// Last part of its name.
    pub name: &'static str,
    /// Name of its schema: that of the message on the bus.
    pub kind: &'static str,
    /// Schema of its messages.
    pub(crate) schema: fn() -> Value,
}

impl Topic {
    /// Full name of the topic of a robot: `rivet/ur10e/joint-state`.
    pub fn full_name(&self, robot: &str) -> String {
        format!("rivet/{robot}/{}", self.name)
    }

    /// JSON Schema of its messages.
    pub fn schema(&self) -> Value {
        (self.schema)()
    }
}

/// A topic that is no message of the bus.
pub const fn other_topic<T: JsonSchema>(name: &'static str, kind: &'static str) -> Topic {
    Topic { name, kind, schema: schema::<T> }
}

const fn topic<T: Message + JsonSchema>(service: Service) -> Topic {
    Topic { name: service.as_str(), kind: T::TYPE_NAME, schema: schema::<T> }
}

/// All topics, in the order of [`Content::place`]: services of the bus, the recorder's own, and what follows from them.
pub const TOPICS: [Topic; 13] = [
    topic::<JointState>(Service::JointState),
    topic::<Setpoint>(Service::Setpoint),
    topic::<LinkState>(Service::LinkState),
    topic::<Parameters>(Service::Parameters),
    topic::<Health>(Service::Health),
    topic::<Drift>(Service::Drift),
    topic::<ControllerHealth>(Service::ControllerHealth),
    other_topic::<Counts>("recorder", "rivet.Recorder.v1"),
    other_topic::<Residual>("residual", "rivet.Residual.v1"),
    other_topic::<FrictionCurves>("friction-curve", "rivet.FrictionCurves.v1"),
    other_topic::<ParameterBands>("parameter-band", "rivet.ParameterBands.v1"),
    other_topic::<States>("state", "rivet.States.v1"),
    // The panel for logs knows its messages by this name.
    other_topic::<LogLine>("log", "foxglove.Log"),
];

/// Topics that are services of the bus: the first so many.
const SERVICES: usize = 7;

/// Services whose messages are recorded, in the order of [`Content::place`].
pub fn services() -> impl Iterator<Item = &'static str> {
    TOPICS[..SERVICES].iter().map(|topic| topic.name)
}

impl From<Counts> for Content {
    fn from(counts: Counts) -> Content {
        Content::Counts(Box::new(counts))
    }
}

impl Content {
    /// Its topic, as a place in [`TOPICS`].
    pub fn place(&self) -> usize {
        match self {
            Content::JointState(_) => 0,
            Content::Setpoint(_) => 1,
            Content::LinkState(_) => 2,
            Content::Parameters(_) => 3,
            Content::Health(_) => 4,
            Content::Drift(_) => 5,
            Content::ControllerHealth(_) => 6,
            Content::Counts(_) => 7,
            Content::Residual(_) => 8,
            Content::FrictionCurves(_) => 9,
            Content::ParameterBands(_) => 10,
            Content::States(_) => 11,
            Content::LogLine(..) => 12,
        }
    }

    /// Its stamp, `CLOCK_MONOTONIC` \[ns\].
    pub fn stamp_ns(&self) -> u64 {
        match self {
            Content::JointState(message) => message.stamp_ns(),
            Content::Setpoint(message) => message.stamp_ns(),
            Content::LinkState(message) => message.stamp_ns(),
            Content::Parameters(message) => message.stamp_ns(),
            Content::Health(message) => message.stamp_ns(),
            Content::Drift(message) => message.stamp_ns,
            Content::ControllerHealth(message) => message.stamp_ns(),
            Content::Counts(counts) => counts.stamp_ns,
            Content::Residual(message) => message.stamp_ns,
            Content::FrictionCurves(message) => message.stamp_ns,
            Content::ParameterBands(message) => message.stamp_ns,
            Content::States(message) => message.stamp_ns,
            Content::LogLine(_, stamp_ns) => *stamp_ns,
        }
    }

    /// Its number in its service, which grows by one from message to message; none where the service has no such number.
    pub fn number(&self) -> Option<u64> {
        match self {
            Content::JointState(message) => Some(message.seq),
            Content::Setpoint(message) => Some(message.seq),
            Content::LinkState(message) => Some(message.seq),
            Content::Parameters(message) => Some(message.epoch),
            _ => None,
        }
    }

    /// The message as JSON. Arrays end with the last joint of `joints`, or the last parameter. NaN and infinity are null.
    ///
    /// # Errors
    /// The library's.
    pub fn to_json(&self, joints: usize) -> serde_json::Result<Vec<u8>> {
        let usual = |value: Value| cut(value, joints, MAX_PARAMETERS);
        let value = match self {
            Content::JointState(message) => cut(serde_json::to_value(message)?, message.count(), MAX_PARAMETERS),
            Content::Setpoint(message) => cut(serde_json::to_value(message)?, message.count(), MAX_PARAMETERS),
            Content::LinkState(message) => cut(serde_json::to_value(message)?, message.count(), MAX_PARAMETERS),
            Content::Parameters(message) => cut(serde_json::to_value(message)?, joints, message.len()),
            Content::Health(message) => usual(serde_json::to_value(message)?),
            Content::Drift(message) => usual(serde_json::to_value(message)?),
            Content::ControllerHealth(message) => usual(serde_json::to_value(message)?),
            Content::Counts(counts) => serde_json::to_value(counts)?,
            Content::Residual(message) => return serde_json::to_vec(message),
            Content::FrictionCurves(message) => return serde_json::to_vec(message),
            Content::ParameterBands(message) => return serde_json::to_vec(message),
            Content::States(message) => return serde_json::to_vec(message),
            Content::LogLine(message, _) => return serde_json::to_vec(message),
        };
        serde_json::to_vec(&value)
    }
}

/// Cuts arrays of joints and of parameters to what is in use. No other array of a message has their length.
fn cut(mut message: Value, joints: usize, parameters: usize) -> Value {
    for field in message.as_object_mut().into_iter().flat_map(serde_json::Map::values_mut) {
        if let Value::Array(entries) = field {
            match entries.len() {
                MAX_JOINTS => entries.truncate(joints),
                MAX_PARAMETERS => entries.truncate(parameters),
                _ => {}
            }
        }
    }
    message
}

/// The schema of a message, in the part of JSON Schema that Foxglove reads: every field has one type, and no schema refers to another.
///
/// Arrays may be shorter than on the bus. A number may be null where it is not finite, which one type cannot state: the
/// description does.
fn schema<T: JsonSchema>() -> Value {
    let settings = SchemaSettings::draft2020_12().with(|settings| settings.inline_subschemas = true);
    let mut schema = settings.into_generator().into_root_schema_for::<T>().to_value();
    relax(&mut schema);
    if let Some(Value::String(text)) = schema.get_mut("description") {
        text.push_str("\n\nA number that is not finite is null.");
    }
    schema
}

fn relax(schema: &mut Value) {
    match schema {
        Value::Object(map) => {
            map.remove("minItems");
            map.values_mut().for_each(relax);
        }
        Value::Array(entries) => entries.iter_mut().for_each(relax),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_is_in_the_schema_with_its_meaning_and_unit() {
        let set = Parameters { count: 2, joints: 2, ..Parameters::EMPTY };
        let contents = [
            Content::JointState(Box::new(JointState { joints: 2, ..JointState::EMPTY })),
            Content::Setpoint(Box::new(Setpoint::EMPTY)),
            Content::LinkState(Box::new(LinkState::EMPTY)),
            Content::Parameters(Box::new(set)),
            Content::Health(Box::new(Health::EMPTY)),
            Content::Drift(Box::new(Drift::EMPTY)),
            Content::ControllerHealth(Box::new(ControllerHealth::EMPTY)),
            Content::Counts(Box::default()),
            Content::Residual(Box::default()),
            Content::FrictionCurves(Box::default()),
            Content::ParameterBands(Box::default()),
            Content::States(Box::default()),
            Content::LogLine(Box::default(), 0),
        ];
        assert_eq!(contents.iter().map(Content::place).collect::<Vec<_>>(), (0..TOPICS.len()).collect::<Vec<_>>());
        for (content, topic) in contents.iter().zip(&TOPICS) {
            let message: Value = serde_json::from_slice(&content.to_json(2).expect("JSON")).expect("JSON");
            let schema = (topic.schema)();
            assert_eq!(schema["type"], "object", "{}", topic.kind);
            let fields = message.as_object().expect("an object");
            assert!(fields.len() > 2, "{}", topic.kind);
            for field in fields.keys() {
                let text = schema["properties"][field]["description"].as_str();
                assert!(text.is_some_and(|text| !text.is_empty()), "{} {field}: {schema}", topic.kind);
            }
        }
    }

    /// What the parser of Foxglove's open-source relatives accepts: it refuses a topic whose schema has anything else.
    fn assert_is_read_by_foxglove(schema: &Value, place: &str) {
        let kind = schema["type"].as_str().unwrap_or_else(|| panic!("{place}: {schema}"));
        match kind {
            "object" => {
                for (name, field) in schema["properties"].as_object().expect("properties") {
                    assert_is_read_by_foxglove(field, &format!("{place}.{name}"));
                }
            }
            "array" => assert_is_read_by_foxglove(&schema["items"], &format!("{place}[]")),
            "boolean" | "string" | "number" | "integer" => {}
            other => panic!("{place} is {other}"),
        }
    }

    #[test]
    fn every_schema_is_one_that_foxglove_reads() {
        for topic in &TOPICS {
            assert_is_read_by_foxglove(&topic.schema(), topic.kind);
            assert!(
                topic.schema()["description"].as_str().is_some_and(|text| text.ends_with("is null.")),
                "{}",
                topic.kind
            );
        }
    }

    #[test]
    fn arrays_end_with_the_arm_and_what_is_no_number_is_null() {
        let state = JointState { joints: 3, q: [0.1; MAX_JOINTS], ..JointState::EMPTY };
        let text = Content::JointState(Box::new(state)).to_json(2).expect("JSON");
        let value: Value = serde_json::from_slice(&text).expect("JSON");
        assert_eq!(value["q"], serde_json::json!([0.1, 0.1, 0.1]));
        assert_eq!(value["temperature"], serde_json::json!([null, null, null]));
        let set = Parameters { count: 5, ..Parameters::EMPTY };
        let text = Content::Parameters(Box::new(set)).to_json(2).expect("JSON");
        let value: Value = serde_json::from_slice(&text).expect("JSON");
        assert_eq!(value["std"].as_array().map(Vec::len), Some(5));
        assert_eq!(value["residual_rms"].as_array().map(Vec::len), Some(2));
    }
}
