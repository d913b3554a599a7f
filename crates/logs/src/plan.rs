//! Which columns of a recording are which signals, and how their numbers become SI values.

use std::collections::{BTreeMap, BTreeSet};

use crate::channel_map::{Channel, ChannelMap, TIME};
use crate::columns::{Group, Table, is_known};
use crate::error::LogFault;
use crate::families::{Family, JOINT, NUMBER, families, is_time};
use crate::guess;
use crate::listing::{Column, Conventions, Listing};
use crate::signal::linear;
use crate::time_unit::{unit_of_step, usual_step};
use crate::units::{self, Quantity, Unit, split_unit};

/// Columns that are listed in a message.
const MOST_LISTED: usize = 8;
/// Name of the time of the contract.
const CONTRACT_TIME: &str = "t";

/// How a recording is read.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plan {
    time: Option<Time>,
    signals: Vec<Signal>,
    /// Whether the file has the columns of the contract: then those that are not mapped are taken as they are.
    is_contract: bool,
    /// What was found by names: key and pattern.
    notes: Vec<(&'static str, String)>,
    /// Stated channels that a recording with the columns of the contract does not have.
    unmatched: Vec<String>,
    /// Whose conventions the numbers follow.
    conventions: Conventions,
    /// Whether channels are stated, of a recording in the model's conventions.
    is_overruled: bool,
}

#[derive(Clone, Debug, PartialEq)]
struct Time {
    column: String,
    topic: String,
    /// None: by the step between rows.
    unit: Option<Unit>,
}

/// One signal of one joint.
#[derive(Clone, Debug, PartialEq)]
struct Signal {
    group: Group,
    joint: usize,
    column: String,
    topic: String,
    unit: Unit,
}

/// What a robot file and the command line say of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Naming<'a> {
    /// Names of the joints in the URDF, base to flange; empty where they are unknown.
    pub joints: &'a [String],
    /// Channels that are stated.
    pub map: &'a ChannelMap,
}

impl Plan {
    /// Finds the columns. `joints`: number of joints; `needs_current`: whether torque is to come from current.
    ///
    /// # Errors
    /// A pattern that fits nothing, and names that fit more than one group of columns.
    pub(crate) fn find(
        listing: &Listing,
        naming: &Naming<'_>,
        joints: usize,
        needs_current: bool,
    ) -> Result<Plan, LogFault> {
        let conventions = listing.conventions;
        let nothing = ChannelMap::default();
        let (map, needs_current) = match conventions {
            Conventions::Recorder => (naming.map, needs_current),
            Conventions::Model => (&nothing, false),
        };
        let is_overruled = conventions == Conventions::Model && *naming.map != nothing;
        let naming = &Naming { map, ..*naming };
        let has = |name: &str| listing.columns.iter().any(|column| column.name == name);
        let is_position =
            |column: &Column| Group::parse(&column.name).is_some_and(|(group, _)| group == Group::Position);
        let is_contract = has(CONTRACT_TIME) && listing.columns.iter().any(is_position);
        let families = if is_contract { Vec::new() } else { families(listing, naming.joints, joints) };
        let (signals, notes, unmatched) = (Vec::new(), Vec::new(), Vec::new());
        let mut search = Search { listing, naming, joints, families, is_contract, signals, notes, unmatched };
        for group in Group::ALL {
            search.group(group, needs_current)?;
        }
        let Search { signals, mut notes, mut unmatched, .. } = search;
        if !is_contract && !signals.iter().any(|s| s.group == Group::Position) {
            let names = listing.names();
            if let Some(columns) = guess::positions(&names).filter(|_| !naming.joints.is_empty()) {
                return Err(LogFault::Unmatched { joints: naming.joints.join(", "), columns });
            }
        }
        let topic = signals.iter().find(|s| s.group == Group::Position).map(|s| s.topic.clone()).unwrap_or_default();
        let time = match time(listing, naming.map, &topic) {
            Err(LogFault::Map { .. }) if is_contract => {
                unmatched.push(TIME.to_owned());
                time(listing, &ChannelMap::default(), &topic)?
            }
            found => found?,
        };
        if let Some(time) = &time
            && !is_contract
        {
            notes.insert(0, (TIME, time.column.clone()));
        }
        Ok(Plan { time, signals, is_contract, notes, unmatched, conventions, is_overruled })
    }

    /// Whose conventions the numbers follow.
    pub(crate) fn conventions(&self) -> Conventions {
        self.conventions
    }

    /// What was found by names: key and pattern.
    pub(crate) fn named(self) -> Vec<(&'static str, String)> {
        self.notes
    }

    /// Whether a column of the recording is needed.
    pub(crate) fn wants(&self, name: &str) -> bool {
        let is_time = |time: &Time| {
            time.column == name || self.other_topics().any(|topic| other_time(&time.column, &time.topic, topic) == name)
        };
        self.signals.iter().any(|signal| signal.column == name)
            || self.time.as_ref().is_some_and(is_time)
            || (self.is_contract && is_known(name))
    }

    /// Topics other than that of the time.
    fn other_topics(&self) -> impl Iterator<Item = &str> {
        let main = self.time.as_ref().map_or("", |time| time.topic.as_str());
        self.signals.iter().map(|signal| signal.topic.as_str()).filter(move |topic| *topic != main)
    }

    /// The columns under the names of the contract, in SI units; and notes on how they were found.
    pub(crate) fn apply(self, mut table: Table) -> Result<(Table, Vec<String>), LogFault> {
        let mut out = Table { unused: std::mem::take(&mut table.unused), ..Table::default() };
        let mut notes = Vec::new();
        if !self.unmatched.is_empty() {
            notes.push(format!(
                "the stated channels of {} are not in this recording; its own columns (t, q1..N, tau1..N) are used as they are",
                self.unmatched.join(", ")
            ));
        }
        if self.is_overruled {
            notes.push(
                "rivet wrote it in the model's conventions: what [log] or --map state of channels is not applied"
                    .to_owned(),
            );
        }
        let Some(time) = &self.time else {
            // What is missing is reported by who needs it.
            out.columns = table.columns;
            return Ok((out, notes));
        };
        let mut t = table.columns.get(&time.column).cloned().unwrap_or_default();
        let unit = time.unit.unwrap_or_else(|| step_unit(&t));
        scale(&mut t, unit);
        let mut clocks: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for topic in self.other_topics().collect::<BTreeSet<_>>() {
            let mut clock =
                table.columns.get(&other_time(&time.column, &time.topic, topic)).cloned().unwrap_or_default();
            scale(&mut clock, unit);
            clocks.insert(topic, clock);
        }
        let keep = common_rows(&t, clocks.values());
        let kept: Vec<f64> = t[keep.clone()].to_vec();
        let mut used = BTreeSet::new();
        for signal in &self.signals {
            let Some(values) = table.columns.get(&signal.column) else { continue };
            used.insert(signal.column.clone());
            let mut values = match clocks.get(signal.topic.as_str()) {
                Some(clock) if clock.len() == values.len() && clock.len() > 1 => linear(clock, values, &kept),
                Some(_) => {
                    return Err(LogFault::Map {
                        key: signal.group.prefix().to_owned(),
                        why: format!("topic {} has too few messages, or no time of its own", signal.topic),
                    });
                }
                None => values.get(keep.clone()).unwrap_or(values).to_vec(),
            };
            scale(&mut values, signal.unit);
            out.columns.insert(signal.group.column(signal.joint), values);
        }
        if !clocks.is_empty() {
            let topics: Vec<&str> = clocks.keys().copied().collect();
            notes.push(format!("{} is interpolated linearly to the times of {}", topics.join(", "), time.topic));
        }
        used.insert(time.column.clone());
        out.columns.insert(CONTRACT_TIME.to_owned(), kept);
        if self.is_contract {
            for (name, values) in table.columns {
                if is_known(&name) && !used.contains(&name) {
                    out.columns.entry(name).or_insert(values);
                }
            }
        } else {
            let named: Vec<String> = self.notes.iter().map(|(key, pattern)| format!("{key} = \"{pattern}\"")).collect();
            notes.push(format!("read as {}", named.join(", ")));
            let dropped = drop_empty_rows(&mut out);
            if dropped > 0 {
                notes.push(format!("{dropped} rows without a position are left out"));
            }
        }
        Ok((out, notes))
    }
}

/// The time of another topic that is the same clock as `column` of topic `topic`.
fn other_time(column: &str, topic: &str, other: &str) -> String {
    format!("{other}{}", column.strip_prefix(topic).unwrap_or(column))
}

fn scale(values: &mut [f64], unit: Unit) {
    if unit != Unit::SI {
        for value in values {
            *value = unit.factor * *value + unit.offset;
        }
    }
}

/// Rows of `t` that lie within every other clock.
fn common_rows<'a>(t: &[f64], clocks: impl Iterator<Item = &'a Vec<f64>>) -> std::ops::Range<usize> {
    let (mut from, mut to) = (0, t.len());
    for clock in clocks {
        if let (Some(first), Some(last)) = (clock.first(), clock.last()) {
            from = from.max(t.partition_point(|t| t < first));
            to = to.min(t.partition_point(|t| t <= last));
        }
    }
    from.min(to)..to
}

/// Leaves out rows in which no position is filled: programs that put several topics in one table leave cells empty.
fn drop_empty_rows(table: &mut Table) -> usize {
    let positions: Vec<&Vec<f64>> = table
        .columns
        .iter()
        .filter(|(name, _)| Group::parse(name).is_some_and(|(group, _)| group == Group::Position))
        .map(|(_, values)| values)
        .collect();
    let rows = positions.iter().map(|q| q.len()).min().unwrap_or(0);
    let keep: Vec<bool> = (0..rows).map(|row| positions.iter().any(|q| !q[row].is_nan())).collect();
    let dropped = keep.iter().filter(|keep| !**keep).count();
    if dropped > 0 {
        for values in table.columns.values_mut() {
            let mut row = 0;
            values.retain(|_| {
                row += 1;
                keep.get(row - 1).copied().unwrap_or(true)
            });
        }
    }
    dropped
}

/// The unit of a time whose usual step is that of a log in one unit alone; else s.
fn step_unit(t: &[f64]) -> Unit {
    let unit = usual_step(t).and_then(unit_of_step);
    unit.and_then(|unit| units::unit(Quantity::Time, unit)).unwrap_or(Unit::SI)
}

fn time(listing: &Listing, map: &ChannelMap, topic: &str) -> Result<Option<Time>, LogFault> {
    let stated = map.get(TIME).cloned().unwrap_or_default();
    let fault = |why: String| LogFault::Map { key: TIME.to_owned(), why };
    let column = match &stated.pattern {
        Some(name) => Some(column(listing, name).ok_or_else(|| fault(missing(listing, name)))?),
        None => find_time(listing, topic)?,
    };
    let Some(column) = column else { return Ok(None) };
    let unit = match (&stated.unit, &column.unit) {
        (Some(unit), _) => Some(known_unit(Quantity::Time, unit).map_err(fault)?),
        (None, Some(unit)) => units::unit(Quantity::Time, unit),
        (None, None) if column.name == CONTRACT_TIME && !column.is_integer => Some(Unit::SI),
        (None, None) => column.name.rsplit_once('_').and_then(|(_, unit)| units::unit(Quantity::Time, unit)),
    };
    Ok(Some(Time { column: column.name.clone(), topic: column.topic.clone(), unit }))
}

/// The time of a topic by names: `t`; else the one that there is; else the stamp of the measurement, which is before that of its arrival.
fn find_time<'a>(listing: &'a Listing, topic: &str) -> Result<Option<&'a Column>, LogFault> {
    let columns = || listing.columns.iter().filter(|column| column.topic == topic);
    if let Some(contract) = columns().find(|column| column.name == CONTRACT_TIME) {
        return Ok(Some(contract));
    }
    let candidates: Vec<&Column> = columns().filter(|column| is_time(column)).collect();
    let is_stamp = |column: &&&Column| column.name.ends_with("header/stamp") || column.name.ends_with("header.stamp");
    match (candidates.as_slice(), candidates.iter().find(is_stamp)) {
        ([], _) => Ok(None),
        ([one], _) => Ok(Some(one)),
        (_, Some(stamp)) => Ok(Some(stamp)),
        (several, None) => Err(LogFault::Ambiguous {
            what: "time",
            key: TIME,
            candidates: listed(several.iter().map(|column| column.name.as_str())),
        }),
    }
}

/// A column by its name, with or without the unit behind it.
fn column<'a>(listing: &'a Listing, name: &str) -> Option<&'a Column> {
    let exact = listing.columns.iter().find(|column| column.name == name);
    exact.or_else(|| listing.columns.iter().find(|column| split_unit(&column.name).0 == name))
}

fn missing(listing: &Listing, name: &str) -> String {
    format!("there is no column {name}; the columns are {}", listed(listing.columns.iter().map(|c| c.name.as_str())))
}

fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    let more = if names.len() > MOST_LISTED { ", ..." } else { "" };
    format!("{}{more}", names[..names.len().min(MOST_LISTED)].join(", "))
}

fn known_unit(quantity: Quantity, name: &str) -> Result<Unit, String> {
    units::unit(quantity, name)
        .ok_or_else(|| format!("unit \"{name}\" is unknown; it must be one of {}", units::names(quantity)))
}

/// The search for the signals of a recording.
struct Search<'a> {
    listing: &'a Listing,
    naming: &'a Naming<'a>,
    joints: usize,
    families: Vec<Family>,
    is_contract: bool,
    signals: Vec<Signal>,
    notes: Vec<(&'static str, String)>,
    unmatched: Vec<String>,
}

impl<'a> Search<'a> {
    fn group(&mut self, group: Group, needs_current: bool) -> Result<(), LogFault> {
        let mut stated = self.naming.map.of_group(group);
        let mut by_pattern = stated.pattern.as_ref().map(|pattern| self.by_pattern(pattern));
        if self.is_contract && matches!(by_pattern, Some(Err(_))) {
            // Recordings of rivet itself have the columns of the contract, whatever those of the driver are called.
            self.unmatched.push(group.prefix().to_owned());
            (stated, by_pattern) = (Channel::default(), None);
        }
        let found: Option<Vec<&'a Column>> = if let Some(columns) = by_pattern {
            Some(columns.map_err(|why| LogFault::Map { key: group.prefix().to_owned(), why })?)
        } else if self.is_contract {
            let columns = (0..self.joints).map(|joint| column(self.listing, &group.column(joint)));
            columns.collect::<Option<Vec<_>>>()
        } else {
            let family = self.by_name(group, needs_current)?;
            if let Some(family) = &family {
                self.notes.push((group.prefix(), family.pattern.clone()));
            }
            family.map(|family| family.columns.iter().map(|k| &self.listing.columns[*k]).collect())
        };
        for (joint, column) in found.into_iter().flatten().enumerate() {
            let unit = self.unit(group, &stated, joint, column)?;
            let (column, topic) = (column.name.clone(), column.topic.clone());
            self.signals.push(Signal { group, joint, column, topic, unit });
        }
        Ok(())
    }

    /// The columns of a pattern, base to flange.
    fn by_pattern(&self, pattern: &str) -> Result<Vec<&'a Column>, String> {
        let (listing, joints) = (self.listing, self.joints);
        let find = |name: &str| column(listing, name).ok_or_else(|| missing(listing, name));
        if pattern.contains(JOINT) {
            if self.naming.joints.is_empty() {
                return Err(format!("{JOINT} needs the names of a URDF"));
            }
            return self.naming.joints.iter().map(|joint| find(&pattern.replace(JOINT, joint))).collect();
        }
        if pattern.contains(NUMBER) {
            if let Some(family) = self.families.iter().find(|family| family.pattern == pattern) {
                return Ok(family.columns.iter().map(|k| &listing.columns[*k]).collect());
            }
            let at = |number: usize| column(listing, &pattern.replace(NUMBER, &number.to_string()));
            let (zero, last) = (at(0).is_some(), at(joints).is_some());
            if zero && last {
                return Err(format!(
                    "columns of {pattern} count from 0 to {joints} and the robot has {joints} joints: name them one by one, \
                     separated by commas"
                ));
            }
            let from = usize::from(!zero);
            return (from..from + joints).map(|number| find(&pattern.replace(NUMBER, &number.to_string()))).collect();
        }
        if joints == 1 {
            return Ok(vec![find(pattern)?]);
        }
        let names: Vec<&str> = pattern.split(',').map(str::trim).collect();
        if names.len() != joints {
            return Err(format!(
                "\"{pattern}\" names {} columns, the robot has {joints} joints: use {JOINT}, {NUMBER}, or one name a joint, separated by \
                 commas",
                names.len()
            ));
        }
        names.into_iter().map(find).collect()
    }

    /// The group of columns whose names say what they are.
    fn by_name(&self, group: Group, needs_current: bool) -> Result<Option<Family>, LogFault> {
        let mut candidates: Vec<&Family> = self.families.iter().filter(|family| family.group == Some(group)).collect();
        let topic = self.signals.first().map(|signal| signal.topic.clone());
        let on_topic = |family: &&Family| {
            topic.as_ref().is_none_or(|topic| family.columns.iter().all(|k| self.listing.columns[*k].topic == *topic))
        };
        // Signals of the topic of the positions come before those of others.
        if group != Group::Position && candidates.iter().any(on_topic) {
            candidates.retain(on_topic);
        }
        let has_torque = self.signals.iter().any(|signal| signal.group == Group::Torque);
        let (what, is_needed) = match group {
            Group::Position => ("positions", true),
            Group::Torque => ("torques", !needs_current),
            Group::Current => ("currents", needs_current || !has_torque),
            _ => ("", false),
        };
        match candidates.as_slice() {
            [] => Ok(None),
            [one] => Ok(Some((*one).clone())),
            _ if !is_needed => Ok(None),
            several => Err(LogFault::Ambiguous {
                what,
                key: group.prefix(),
                candidates: listed(several.iter().map(|family| family.pattern.as_str())),
            }),
        }
    }

    /// What turns a number of a column into an SI value.
    fn unit(&self, group: Group, stated: &Channel, joint: usize, column: &Column) -> Result<Unit, LogFault> {
        let fault = |why| LogFault::Map { key: group.prefix().to_owned(), why };
        let quantity = group.quantity();
        let unit = match (&stated.unit, &column.unit) {
            (Some(unit), _) => known_unit(quantity, unit).map_err(fault)?,
            (None, Some(unit)) => {
                known_unit(quantity, unit).map_err(|why| fault(format!("column {}: {why}", column.name)))?
            }
            (None, None) => Unit::SI,
        };
        let joints = self.joints;
        let entry = |name: &str, list: &Option<Vec<f64>>, usual: f64| match list {
            None => Ok(usual),
            Some(list) if list.len() == joints => Ok(list[joint]),
            Some(list) => Err(fault(format!("{name} has {} values, the robot has {joints} joints", list.len()))),
        };
        let factor = entry("sign", &stated.sign, 1.0)? * entry("scale", &stated.scale, 1.0)?;
        let zero = entry("zero", &stated.zero, 0.0)?;
        Ok(Unit { factor: factor * unit.factor, offset: factor * unit.offset + zero })
    }
}
