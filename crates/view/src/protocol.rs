//! Messages of the protocol, as its public specification (foxglove/ws-protocol, `docs/spec.md`, version 1) has them.
//!
//! | direction | messages |
//! |---|---|
//! | to the client | `serverInfo`, `advertise`, `status`; binary message data |
//! | from the client | `subscribe`, `unsubscribe`; all others are answered with a `status` |

use rivet_recording::{ENCODING, SCHEMA_ENCODING};
use serde::Deserialize;
use serde_json::json;

use crate::channel::Channel;

/// Names of the protocol, the preferred one first. For what this server does both are the same.
pub const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];

/// First byte of message data.
const MESSAGE_DATA: u8 = 1;

/// The preferred name of the protocol among those that a client offers, as in the header `Sec-WebSocket-Protocol`.
pub fn negotiate(offers: &[&str]) -> Option<&'static str> {
    let offered = |name: &str| offers.iter().flat_map(|offer| offer.split(',')).any(|word| word.trim() == name);
    SUBPROTOCOLS.into_iter().find(|name| offered(name))
}

/// The first message. Without capabilities a client cannot publish, set parameters or call services.
pub fn server_info(name: &str, session: &str) -> String {
    json!({"op": "serverInfo", "name": name, "capabilities": [], "supportedEncodings": [], "metadata": {},
           "sessionId": session})
    .to_string()
}

/// The channels; their ids are their places in the list.
pub fn advertise(channels: &[Channel]) -> String {
    let each = |(id, channel): (usize, &Channel)| {
        json!({"id": id, "topic": channel.topic, "encoding": ENCODING, "schemaName": channel.schema_name,
               "schemaEncoding": SCHEMA_ENCODING, "schema": channel.schema})
    };
    json!({"op": "advertise", "channels": channels.iter().enumerate().map(each).collect::<Vec<_>>()}).to_string()
}

/// A warning to the client.
pub fn warning(text: &str) -> String {
    json!({"op": "status", "level": 1, "message": text}).to_string()
}

/// A message of a subscription: opcode, subscription and time of the log (ns since 1970), little-endian, then the payload.
pub fn message_data(subscription: u32, log_time_ns: u64, payload: &[u8]) -> Vec<u8> {
    let mut data = Vec::with_capacity(13 + payload.len());
    data.push(MESSAGE_DATA);
    data.extend(subscription.to_le_bytes());
    data.extend(log_time_ns.to_le_bytes());
    data.extend(payload);
    data
}

/// A subscription of a client: its own id, and the channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub struct Subscription {
    /// Id that the client chose.
    pub id: u32,
    /// Channel.
    #[serde(rename = "channelId")]
    pub channel: u64,
}

/// What a client asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Messages of channels.
    Subscribe(Vec<Subscription>),
    /// No more messages of these subscriptions.
    Unsubscribe(Vec<u32>),
}

#[derive(Deserialize)]
struct Any {
    op: String,
    #[serde(default)]
    subscriptions: Vec<Subscription>,
    #[serde(default, rename = "subscriptionIds")]
    ids: Vec<u32>,
}

impl Request {
    /// Reads a text message of a client.
    ///
    /// # Errors
    /// What to answer: it is no JSON, or asks for what this server does not do.
    pub fn parse(text: &str) -> Result<Request, String> {
        let any: Any =
            serde_json::from_str(text).map_err(|why| format!("the message is not of this protocol: {why}"))?;
        match any.op.as_str() {
            "subscribe" => Ok(Request::Subscribe(any.subscriptions)),
            "unsubscribe" => Ok(Request::Unsubscribe(any.ids)),
            other => Err(format!("{other}: refused; rivet view only sends, and never writes to the bus")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes of the specification's example: subscription 30, time 1234, payload `{"key": "value"}`.
    #[test]
    fn message_data_is_laid_out_as_specified() {
        let data = message_data(30, 1234, br#"{"key": "value"}"#);
        assert_eq!(data[..13], [1, 30, 0, 0, 0, 0xd2, 4, 0, 0, 0, 0, 0, 0]);
        assert_eq!(&data[13..], br#"{"key": "value"}"#);
    }

    #[test]
    fn the_preferred_name_is_taken_and_others_are_refused() {
        let take = |offers: &[&str]| negotiate(offers);
        assert_eq!(take(&["foxglove.websocket.v1, foxglove.sdk.v1"]), Some("foxglove.sdk.v1"));
        assert_eq!(take(&["x", "foxglove.websocket.v1"]), Some("foxglove.websocket.v1"));
        assert_eq!(take(&["foxglove.sdk.v1.1"]), None, "a name that only begins alike");
        assert_eq!(take(&[]), None);
    }

    #[test]
    fn requests_are_read_and_all_that_write_are_refused() {
        let subscribe = r#"{"op":"subscribe","subscriptions":[{"id":4,"channelId":2}]}"#;
        assert_eq!(Request::parse(subscribe), Ok(Request::Subscribe(vec![Subscription { id: 4, channel: 2 }])));
        let unsubscribe = r#"{"op":"unsubscribe","subscriptionIds":[4]}"#;
        assert_eq!(Request::parse(unsubscribe), Ok(Request::Unsubscribe(vec![4])));
        for op in ["advertise", "setParameters", "getParameters", "subscribeConnectionGraph"] {
            let why = Request::parse(&format!(r#"{{"op":"{op}"}}"#)).expect_err("refused");
            assert!(why.starts_with(op) && why.contains("never writes"), "{why}");
        }
        for text in ["", "[]", "{}", r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":2}]}"#] {
            assert!(Request::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn channels_are_advertised_with_their_schemas() {
        let channel = Channel {
            topic: "rivet/a/b".to_owned(),
            schema_name: "B".to_owned(),
            schema: "{}".to_owned(),
            is_kept: false,
        };
        let text: serde_json::Value = serde_json::from_str(&advertise(&[channel])).expect("JSON");
        let expected = json!({"id": 0, "topic": "rivet/a/b", "encoding": "json", "schemaName": "B",
                              "schemaEncoding": "jsonschema", "schema": "{}"});
        assert_eq!(text, json!({"op": "advertise", "channels": [expected]}));
    }
}
