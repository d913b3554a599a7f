//! Joint states of topics as columns, whatever the container of the messages is.

use std::collections::BTreeMap;

use crate::columns::{Table, Wanted};
use crate::joint_state::{FIELDS, JointState, TYPES, decode};
use crate::listing::{Column, Conventions, Listing, Topic};
use crate::own_recording::{Kind, OwnRecording};

/// Message encoding that is read.
const ENCODING: &str = "cdr";
/// Channels of the two clocks of a topic.
const STAMP: &str = "header/stamp";
const LOG_TIME: &str = "log_time";
/// Messages of a topic from which its joints are listed: more than one publisher may send on it.
const LISTED_MESSAGES: u64 = 50;
/// Most channels of a recording.
const MAX_CHANNELS: usize = 4096;
/// Values that a byte of a recording may stand for, and that every recording may have: compressed messages that repeat would else fill
/// all memory.
const CELLS_A_BYTE: u64 = 64;
const CELLS_OF_ANY_FILE: u64 = 4 << 20;
/// Nanoseconds of a second.
const NS_PER_S: f64 = 1e9;

/// What takes the messages of a container.
pub(crate) trait Sink {
    /// Announces a topic; its number, where its messages are wanted.
    fn topic(&mut self, name: &str, kind: &str, encoding: &str) -> Option<usize>;

    /// Takes a message of topic `topic`, recorded at `log_time_ns`.
    ///
    /// # Errors
    /// The recording claims more than is read.
    fn message(&mut self, topic: usize, log_time_ns: u64, data: &[u8]) -> Result<(), String>;

    /// Takes the name of the program that wrote the container.
    fn written_by(&mut self, _library: &str) {}

    /// Whether nothing more is needed.
    fn is_done(&self) -> bool;

    /// Marks the place to which [`Sink::drop_since_mark`] returns.
    fn mark(&mut self) {}

    /// Drops the messages since the mark: their bytes are damaged.
    fn drop_since_mark(&mut self) {}
}

/// Whether messages are joint states of ROS 2 that are read.
fn is_joint_state(kind: &str, encoding: &str) -> bool {
    TYPES.contains(&kind) && encoding == ENCODING
}

/// A topic as it is listed.
struct Seen {
    topic: Topic,
    /// Messages so far.
    count: u64,
    /// What it is of rivet's own bus.
    own: Option<Kind>,
    joints: Vec<String>,
    has: [bool; 3],
    is_stamped: bool,
}

/// Lists topics, joints and fields.
#[derive(Default)]
pub(crate) struct Scout {
    seen: Vec<Seen>,
    /// Numbers of messages by topic, as the recording's summary states them.
    expected: Option<BTreeMap<String, u64>>,
    own: OwnRecording,
    conventions: Conventions,
    undecoded: Undecoded,
}

impl Scout {
    /// `counts`: messages of each topic, where the recording has a summary: then its beginning is enough.
    pub(crate) fn new(counts: Option<BTreeMap<String, u64>>) -> Scout {
        Scout { expected: counts, ..Scout::default() }
    }

    pub(crate) fn finish(self, mut warnings: Vec<String>) -> Listing {
        let mut columns = Vec::new();
        let mut topics = Vec::new();
        for Seen { mut topic, count, joints, has, is_stamped, .. } in self.seen {
            let messages = self.expected.as_ref().map_or(count, |e| e.get(&topic.name).copied().unwrap_or(0));
            topic.messages = Some(messages);
            let name = topic.name.clone();
            topics.push(topic);
            if joints.is_empty() {
                continue;
            }
            let column = |channel: &str| Column {
                name: format!("{name}/{channel}"),
                topic: name.clone(),
                unit: Some("s".to_owned()).filter(|_| channel == STAMP || channel == LOG_TIME),
                ..Column::default()
            };
            columns.extend([STAMP, LOG_TIME].into_iter().filter(|c| *c != STAMP || is_stamped).map(column));
            for joint in &joints {
                let fields = FIELDS.iter().zip(has).filter(|(_, has)| *has);
                columns.extend(fields.map(|(field, _)| column(&format!("{joint}/{field}"))));
            }
        }
        warnings.extend(self.undecoded.warning());
        let mut listing = Listing { topics, columns, warnings, conventions: self.conventions, ..Listing::default() };
        if self.own.has_joints() {
            listing.conventions = Conventions::Model;
            self.own.list(&mut listing);
        }
        listing
    }
}

impl Sink for Scout {
    fn written_by(&mut self, library: &str) {
        self.conventions = Conventions::stated(library);
    }

    fn topic(&mut self, name: &str, kind: &str, encoding: &str) -> Option<usize> {
        let known = self.seen.iter().position(|seen| seen.topic.name == name);
        known.or_else(|| {
            if self.seen.len() >= MAX_CHANNELS {
                return None;
            }
            let own = self.own.topic(name, kind, encoding);
            let is_read = own.is_some() || is_joint_state(kind, encoding);
            let topic = Topic { name: name.to_owned(), kind: kind.to_owned(), messages: None, is_read };
            self.seen.push(Seen { topic, count: 0, own, joints: Vec::new(), has: [false; 3], is_stamped: true });
            Some(self.seen.len() - 1)
        })
    }

    fn message(&mut self, topic: usize, _log_time_ns: u64, data: &[u8]) -> Result<(), String> {
        let seen = &mut self.seen[topic];
        seen.count += 1;
        if !seen.topic.is_read || seen.count > LISTED_MESSAGES {
            return Ok(());
        }
        if let Some(kind) = seen.own {
            if let Err(why) = self.own.take(kind, data) {
                self.undecoded.add(why);
            }
            return Ok(());
        }
        match decode(data) {
            Ok(state) => {
                for name in state.names {
                    if !seen.joints.iter().any(|joint| joint == name) && seen.joints.len() < MAX_CHANNELS {
                        seen.joints.push(name.to_owned());
                    }
                }
                for (has, array) in seen.has.iter_mut().zip(&state.arrays) {
                    *has |= !array.is_empty();
                }
                seen.is_stamped &= state.stamp_ns > 0;
            }
            Err(why) => self.undecoded.add(why),
        }
        Ok(())
    }

    fn is_done(&self) -> bool {
        let Some(expected) = &self.expected else { return false };
        let is_listed = |(topic, count): (&String, &u64)| {
            let seen = self.seen.iter().find(|seen| seen.topic.name == *topic);
            seen.is_some_and(|seen| !seen.topic.is_read || seen.count >= LISTED_MESSAGES.min(*count))
        };
        expected.iter().filter(|(_, count)| **count > 0).all(is_listed)
    }
}

/// Messages that could not be decoded, and why the first could not.
#[derive(Default)]
struct Undecoded {
    count: u64,
    why: String,
}

impl Undecoded {
    fn add(&mut self, why: String) {
        self.count += 1;
        if self.count == 1 {
            self.why = why;
        }
    }

    fn warning(&self) -> Option<String> {
        let Undecoded { count, why } = self;
        (*count > 0).then(|| format!("{count} messages cannot be decoded and are left out; the first: {why}"))
    }
}

/// Where a value of a message goes: (slot, field, place in the array).
type Place = (usize, usize, usize);

/// The wanted channels of a topic.
#[derive(Default)]
struct Collected {
    name: String,
    /// What it is of rivet's own bus.
    own: Option<Kind>,
    wants_stamp: bool,
    /// Joints of the last message, and where its values go.
    joints: Vec<String>,
    filled: [bool; 3],
    places: Vec<Place>,
    slots: Vec<String>,
    stamps_ns: Vec<i64>,
    log_ns: Vec<i64>,
    values: Vec<Vec<f64>>,
    /// Values that each row has.
    counts: Vec<u32>,
}

impl Collected {
    fn arrange(&mut self, state: &JointState<'_>, wanted: Wanted<'_>) {
        let filled = [0, 1, 2].map(|k: usize| !state.arrays[k].is_empty());
        if self.filled == filled && self.joints.len() == state.names.len() && self.joints == state.names {
            return;
        }
        self.joints = state.names.iter().map(|name| (*name).to_owned()).collect();
        self.filled = filled;
        self.places.clear();
        for (place, joint) in self.joints.iter().enumerate() {
            for (k, field) in FIELDS.iter().enumerate().filter(|(k, _)| filled[*k]) {
                let column = format!("{}/{joint}/{field}", self.name);
                if !wanted(&column) {
                    continue;
                }
                let known = self.slots.iter().position(|slot| *slot == column);
                let slot = known.unwrap_or_else(|| {
                    self.slots.push(column);
                    self.values.push(vec![f64::NAN; self.log_ns.len()]);
                    self.slots.len() - 1
                });
                if !self.places.iter().any(|(other, ..)| *other == slot) {
                    self.places.push((slot, k, place));
                }
            }
        }
    }

    fn push(&mut self, state: &JointState<'_>, log_time_ns: u64) {
        if self.places.is_empty() {
            return;
        }
        self.stamps_ns.push(state.stamp_ns);
        self.log_ns.push(i64::try_from(log_time_ns).unwrap_or(i64::MAX));
        self.counts.push(self.places.len() as u32);
        for values in &mut self.values {
            values.push(f64::NAN);
        }
        for (slot, field, place) in &self.places {
            if let Some(value) = self.values[*slot].last_mut() {
                *value = state.arrays[*field][*place];
            }
        }
    }

    fn truncate(&mut self, rows: usize) {
        self.stamps_ns.truncate(rows);
        self.log_ns.truncate(rows);
        self.counts.truncate(rows);
        for values in &mut self.values {
            values.truncate(rows);
        }
    }

    /// Rows with every wanted value, in the order of their time, each time once; and what was left out.
    fn rows(&self, warnings: &mut Vec<String>) -> Vec<usize> {
        let all = self.slots.len() as u32;
        let mut rows: Vec<usize> = (0..self.counts.len()).filter(|row| self.counts[*row] == all).collect();
        let incomplete = self.counts.len() - rows.len();
        let time = if self.wants_stamp { &self.stamps_ns } else { &self.log_ns };
        rows.sort_by_key(|row| time[*row]);
        let complete = rows.len();
        rows.dedup_by_key(|row| time[*row]);
        let mut say = |count: usize, why: &str| {
            if count > 0 {
                warnings.push(format!("{}: {count} messages {why}; they are left out", self.name));
            }
        };
        say(incomplete, "lack a joint or a field that others have");
        say(complete - rows.len(), "have the time of another");
        rows
    }
}

/// Collects the channels that are wanted.
pub(crate) struct Collector<'a> {
    wanted: Wanted<'a>,
    /// Bytes of the recording.
    bytes: u64,
    topics: Vec<Collected>,
    own: OwnRecording,
    marks: Vec<usize>,
    undecoded: Undecoded,
    cells: u64,
}

impl<'a> Collector<'a> {
    /// `bytes`: size of the recording.
    pub(crate) fn new(wanted: Wanted<'a>, bytes: u64) -> Collector<'a> {
        let (topics, marks, own, undecoded) = Default::default();
        Collector { wanted, bytes, topics, own, marks, undecoded, cells: 0 }
    }

    /// That the values so far are no more than the recording's bytes may stand for.
    fn ensure_plausible(&self) -> Result<(), String> {
        if self.cells > self.bytes.saturating_mul(CELLS_A_BYTE).saturating_add(CELLS_OF_ANY_FILE) {
            return Err(format!("its {} bytes claim more than {} values", self.bytes, self.cells));
        }
        Ok(())
    }

    /// The columns. Times count from the first message of the recording \[s\].
    pub(crate) fn finish(self, mut warnings: Vec<String>) -> Table {
        let first = |times: fn(&Collected) -> &Vec<i64>| {
            self.topics.iter().flat_map(|topic| times(topic).iter().copied()).min().unwrap_or(0)
        };
        let (first_stamp, first_log) = (first(|t| &t.stamps_ns), first(|t| &t.log_ns));
        let mut table = self.own.columns(&mut warnings);
        table.columns.retain(|name, _| (self.wanted)(name));
        for topic in self.topics {
            let rows = topic.rows(&mut warnings);
            let seconds = |times: &[i64], first: i64| -> Vec<f64> {
                rows.iter().map(|row| times[*row].saturating_sub(first) as f64 / NS_PER_S).collect()
            };
            for (clock, times, first) in [(STAMP, &topic.stamps_ns, first_stamp), (LOG_TIME, &topic.log_ns, first_log)]
            {
                let name = format!("{}/{clock}", topic.name);
                if (self.wanted)(&name) && !topic.slots.is_empty() {
                    table.columns.insert(name, seconds(times, first));
                }
            }
            for (name, values) in topic.slots.into_iter().zip(topic.values) {
                table.columns.insert(name, rows.iter().map(|row| values[*row]).collect());
            }
        }
        warnings.extend(self.undecoded.warning());
        table.warnings = warnings;
        table
    }
}

impl Sink for Collector<'_> {
    fn topic(&mut self, name: &str, kind: &str, encoding: &str) -> Option<usize> {
        let own = self.own.topic(name, kind, encoding);
        if own.is_none() && !is_joint_state(kind, encoding) {
            return None;
        }
        let known = self.topics.iter().position(|topic| topic.name == name);
        known.or_else(|| {
            if self.topics.len() >= MAX_CHANNELS {
                return None;
            }
            let wants_stamp = (self.wanted)(&format!("{name}/{STAMP}"));
            self.topics.push(Collected { name: name.to_owned(), own, wants_stamp, ..Collected::default() });
            Some(self.topics.len() - 1)
        })
    }

    fn message(&mut self, topic: usize, log_time_ns: u64, data: &[u8]) -> Result<(), String> {
        if let Some(kind) = self.topics[topic].own {
            match self.own.take(kind, data) {
                Ok(values) => self.cells += values as u64,
                Err(why) => self.undecoded.add(why),
            }
            return self.ensure_plausible();
        }
        let state = match decode(data) {
            Ok(state) => state,
            Err(why) => {
                self.undecoded.add(why);
                return Ok(());
            }
        };
        let topic = &mut self.topics[topic];
        topic.arrange(&state, self.wanted);
        topic.push(&state, log_time_ns);
        self.cells += topic.slots.len() as u64;
        if topic.slots.len() > MAX_CHANNELS {
            return Err(format!("it has more than {MAX_CHANNELS} channels"));
        }
        self.ensure_plausible()
    }

    fn is_done(&self) -> bool {
        false
    }

    fn mark(&mut self) {
        self.own.mark();
        self.marks = self.topics.iter().map(|topic| topic.log_ns.len()).collect();
    }

    fn drop_since_mark(&mut self) {
        self.own.drop_since_mark();
        for (k, topic) in self.topics.iter_mut().enumerate() {
            topic.truncate(self.marks.get(k).copied().unwrap_or(0));
        }
    }
}
