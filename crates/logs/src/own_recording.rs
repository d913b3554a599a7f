//! Recordings of rivet's own bus (`rivet record`): joint states, setpoints and second encoders as JSON.
//!
//! Rows are the joint states. Setpoints and second encoders belong to the row of their sequence number.

use serde::Deserialize;

use crate::columns::{Group, Table};
use crate::listing::{Column, Listing};

/// Message encoding of these topics.
const ENCODING: &str = "json";
/// Most joints of a message.
const MAX_JOINTS: usize = 64;
/// Share of rows without a setpoint, or a second encoder, from which on its columns are left out: each would leave a measured row out.
const MOST_ROWS_WITHOUT: f64 = 0.01;
/// Nanoseconds of a second.
const NS_PER_S: f64 = 1e9;
/// Furthest stamps of a setpoint and the joint state of its number \[ns\]: a robot that began anew counts from 1 again.
const FURTHEST_NS: u64 = 1_000_000_000;

/// A topic of the bus that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    JointState,
    Setpoint,
    LinkState,
}

impl Kind {
    /// The topic of messages with this schema and encoding.
    pub(crate) fn of(schema: &str, encoding: &str) -> Option<Kind> {
        if encoding != ENCODING {
            return None;
        }
        match schema {
            "rivet.JointState.v1" => Some(Kind::JointState),
            "rivet.Setpoint.v1" => Some(Kind::Setpoint),
            "rivet.LinkState.v1" => Some(Kind::LinkState),
            _ => None,
        }
    }
}

/// A value that may be no number, which JSON has as null.
type Values = Vec<Option<f64>>;

#[derive(Debug, Default, Deserialize)]
struct JointState {
    seq: u64,
    stamp_ns: u64,
    q: Values,
    tau: Values,
    #[serde(default)]
    temperature: Values,
    #[serde(default)]
    faults: u32,
}

#[derive(Debug, Default, Deserialize)]
struct Setpoint {
    seq: u64,
    stamp_ns: u64,
    q: Values,
    qd: Values,
    qdd: Values,
}

#[derive(Debug, Default, Deserialize)]
struct LinkState {
    seq: u64,
    stamp_ns: u64,
    q: Values,
}

/// Signals of the joint states' rows, one after the other: one value a joint each.
#[derive(Debug, Default)]
struct Block {
    groups: &'static [Group],
    seq: Vec<u64>,
    stamps_ns: Vec<u64>,
    values: Vec<f64>,
}

const STATE: &[Group] = &[Group::Position, Group::Torque, Group::Temperature];
const PLAN: &[Group] = &[Group::DesiredPosition, Group::DesiredVelocity, Group::DesiredAcceleration];
const LINK: &[Group] = &[Group::LinkPosition];

impl Block {
    fn push(
        &mut self,
        groups: &'static [Group],
        joints: usize,
        (seq, stamp_ns): (u64, u64),
        signals: &[&Values],
    ) -> Result<(), String> {
        self.groups = groups;
        for signal in signals {
            // Temperatures may be missing.
            if signal.len() != joints && !signal.is_empty() {
                return Err(format!("a message has {} joints, those before it {joints}", signal.len()));
            }
        }
        for signal in signals {
            let value = |joint: usize| signal.get(joint).copied().flatten().unwrap_or(f64::NAN);
            self.values.extend((0..joints).map(value));
        }
        self.seq.push(seq);
        self.stamps_ns.push(stamp_ns);
        Ok(())
    }

    /// Rows in the order of their numbers, and of their stamps where a robot began anew.
    fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.seq.len()).collect();
        order.sort_by_key(|row| (self.seq[*row], self.stamps_ns[*row]));
        order
    }

    /// The row of a number whose stamp is next to `stamp_ns`; `order` as [`Self::order`].
    fn row(&self, order: &[usize], seq: u64, stamp_ns: u64) -> Option<usize> {
        let key = |row: usize| (self.seq[row], self.stamps_ns[row]);
        let behind = order.partition_point(|row| key(*row) < (seq, stamp_ns));
        let around = [behind.checked_sub(1), Some(behind)].into_iter().flatten();
        let known = around.filter_map(|at| order.get(at).copied()).filter(|row| self.seq[*row] == seq);
        let nearest = known.min_by_key(|row| self.stamps_ns[*row].abs_diff(stamp_ns))?;
        (self.stamps_ns[nearest].abs_diff(stamp_ns) <= FURTHEST_NS).then_some(nearest)
    }

    /// Columns of some rows; a missing row has no value.
    fn columns(&self, joints: usize, rows: &[Option<usize>], table: &mut Table) {
        let width = self.groups.len() * joints;
        for (g, group) in self.groups.iter().enumerate() {
            for joint in 0..joints {
                let at =
                    |row: &Option<usize>| row.map_or(f64::NAN, |row| self.values[row * width + g * joints + joint]);
                let column: Vec<f64> = rows.iter().map(at).collect();
                if column.iter().any(|value| !value.is_nan()) || matches!(group, Group::Position | Group::Torque) {
                    table.columns.insert(group.column(joint), column);
                }
            }
        }
    }

    fn truncate(&mut self, rows: usize, joints: usize) {
        self.seq.truncate(rows);
        self.stamps_ns.truncate(rows);
        self.values.truncate(rows * self.groups.len() * joints);
    }
}

/// Messages of the bus, as they come.
#[derive(Debug, Default)]
pub(crate) struct OwnRecording {
    joints: usize,
    states: Block,
    plan: Block,
    link: Block,
    /// Joint states with a fault bit, which are left out.
    faulty: u64,
    /// The robot whose topics are read: what their names have before the last slash.
    robot: Option<String>,
    marks: [usize; 3],
}

impl OwnRecording {
    /// What a topic is; none where it is not read. Of several robots the first one is read.
    pub(crate) fn topic(&mut self, name: &str, schema: &str, encoding: &str) -> Option<Kind> {
        let kind = Kind::of(schema, encoding)?;
        let robot = name.rsplit_once('/').map_or("", |(robot, _)| robot);
        (self.robot.get_or_insert_with(|| robot.to_owned()) == robot).then_some(kind)
    }

    /// Takes a message; returns how many values it has.
    ///
    /// # Errors
    /// It is no such message.
    pub(crate) fn take(&mut self, kind: Kind, data: &[u8]) -> Result<usize, String> {
        let why = |why: serde_json::Error| why.to_string();
        match kind {
            Kind::JointState => {
                let state: JointState = serde_json::from_slice(data).map_err(why)?;
                self.expect(state.q.len())?;
                if state.faults != 0 {
                    self.faulty += 1;
                    return Ok(0);
                }
                let JointState { seq, stamp_ns, q, tau, temperature, .. } = &state;
                self.states.push(STATE, self.joints, (*seq, *stamp_ns), &[q, tau, temperature])?;
            }
            Kind::Setpoint => {
                let Setpoint { seq, stamp_ns, q, qd, qdd } = serde_json::from_slice(data).map_err(why)?;
                self.expect(q.len())?;
                self.plan.push(PLAN, self.joints, (seq, stamp_ns), &[&q, &qd, &qdd])?;
            }
            Kind::LinkState => {
                let LinkState { seq, stamp_ns, q } = serde_json::from_slice(data).map_err(why)?;
                self.expect(q.len())?;
                self.link.push(LINK, self.joints, (seq, stamp_ns), &[&q])?;
            }
        }
        Ok(3 * self.joints)
    }

    fn expect(&mut self, joints: usize) -> Result<(), String> {
        if self.joints == 0 && (1..=MAX_JOINTS).contains(&joints) {
            self.joints = joints;
        }
        if joints == self.joints {
            Ok(())
        } else {
            Err(format!("a message has {joints} joints, those before it {}", self.joints))
        }
    }

    pub(crate) fn mark(&mut self) {
        self.marks = [self.states.seq.len(), self.plan.seq.len(), self.link.seq.len()];
    }

    pub(crate) fn drop_since_mark(&mut self) {
        let [states, plan, link] = self.marks;
        self.states.truncate(states, self.joints);
        self.plan.truncate(plan, self.joints);
        self.link.truncate(link, self.joints);
    }

    /// Whether there was a joint state, even one that is left out.
    pub(crate) fn has_joints(&self) -> bool {
        self.faulty > 0 || !self.states.seq.is_empty()
    }

    /// The columns; none without a joint state. Time counts from the first one \[s\].
    pub(crate) fn columns(&self, warnings: &mut Vec<String>) -> Table {
        let mut table = Table::default();
        let stamps_ns = &self.states.stamps_ns;
        let Some(first) = stamps_ns.iter().min() else { return table };
        let mut rows: Vec<usize> = (0..stamps_ns.len()).collect();
        rows.sort_by_key(|row| stamps_ns[*row]);
        rows.dedup_by_key(|row| stamps_ns[*row]);
        let mut warn = |count: u64, what: &str| {
            if count > 0 {
                warnings.push(format!("{count} joint states {what}; they are left out"));
            }
        };
        warn(self.faulty, "have a fault bit");
        warn((stamps_ns.len() - rows.len()) as u64, "have the stamp of another");
        let t = rows.iter().map(|row| (stamps_ns[*row] - first) as f64 / NS_PER_S).collect();
        table.columns.insert("t".to_owned(), t);
        let own: Vec<Option<usize>> = rows.iter().copied().map(Some).collect();
        self.states.columns(self.joints, &own, &mut table);
        for (block, what) in [(&self.plan, "setpoint"), (&self.link, "second encoder")] {
            if block.seq.is_empty() {
                continue;
            }
            let order = block.order();
            let find = |row: &usize| block.row(&order, self.states.seq[*row], stamps_ns[*row]);
            let found: Vec<Option<usize>> = rows.iter().map(find).collect();
            let without = found.iter().filter(|row| row.is_none()).count();
            if without as f64 <= MOST_ROWS_WITHOUT * found.len() as f64 {
                block.columns(self.joints, &found, &mut table);
            } else {
                let all = found.len();
                warnings.push(format!("{without} of {all} joint states have no {what}; its columns are left out"));
            }
        }
        table
    }

    /// Columns of the topics that were seen.
    pub(crate) fn list(&self, listing: &mut Listing) {
        let has_temperature = self.faulty > 0 || self.columns(&mut Vec::new()).columns.contains_key("temperature1");
        let groups = STATE.iter().filter(|group| has_temperature || **group != Group::Temperature);
        let plan = PLAN.iter().filter(|_| !self.plan.seq.is_empty());
        let link = LINK.iter().filter(|_| !self.link.seq.is_empty());
        let joints = 0..self.joints;
        let names = groups.chain(plan).chain(link).flat_map(|group| joints.clone().map(|joint| group.column(joint)));
        let column = |name: String| Column { name, ..Column::default() };
        listing.columns.extend(std::iter::once("t".to_owned()).chain(names).map(column));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(seq: u64, stamp_ns: u64, faults: u32) -> String {
        format!(
            r#"{{"seq":{seq},"stamp_ns":{stamp_ns},"q":[{seq},0.5],"tau":[1,null],"temperature":[null,null],"joints":2,"faults":{faults}}}"#
        )
    }

    fn plan(seq: u64, stamp_ns: u64) -> String {
        format!(r#"{{"seq":{seq},"stamp_ns":{stamp_ns},"q":[{seq}.25,0],"qd":[1,2],"qdd":[3,4],"joints":2,"flags":0}}"#)
    }

    #[test]
    fn a_setpoint_belongs_to_the_joint_state_of_its_number() {
        let mut recording = OwnRecording::default();
        for seq in 1..140 {
            if seq != 7 {
                recording.take(Kind::Setpoint, plan(seq, 1_000_000 * seq).as_bytes()).expect("a setpoint");
            }
            recording
                .take(Kind::JointState, state(seq, 1_000_000 * seq, u32::from(seq == 9)).as_bytes())
                .expect("a state");
        }
        let mut warnings = Vec::new();
        let table = recording.columns(&mut warnings);
        assert_eq!(warnings, ["1 joint states have a fault bit; they are left out"]);
        let (t, q, plan) = (&table.columns["t"], &table.columns["q1"], &table.columns["q_des1"]);
        assert_eq!((t.len(), t[0], t[1]), (138, 0.0, 0.001));
        for (q, plan) in q.iter().zip(plan) {
            assert!(if *q == 7.0 { plan.is_nan() } else { *plan == q + 0.25 }, "{q} {plan}");
        }
        assert!(table.columns["tau2"].iter().all(|tau| tau.is_nan()) && !table.columns.contains_key("temperature1"));
        assert_eq!(table.columns["qdd_des2"][3], 4.0);
    }

    #[test]
    fn a_robot_that_began_anew_keeps_its_setpoints() {
        let mut recording = OwnRecording::default();
        // The second time number 3 has no setpoint, and that of the first time does not count.
        for (k, seq) in (1..=150).chain(1..=50).enumerate() {
            let stamp_ns = 40_000_000 * k as u64;
            if k != 152 {
                recording.take(Kind::Setpoint, plan(seq, stamp_ns + 2_000_000).as_bytes()).expect("a setpoint");
            }
            recording.take(Kind::JointState, state(seq, stamp_ns, 0).as_bytes()).expect("a state");
        }
        let table = recording.columns(&mut Vec::new());
        for (k, (q, plan)) in table.columns["q1"].iter().zip(&table.columns["q_des1"]).enumerate() {
            assert!(if k == 152 { plan.is_nan() } else { *plan == q + 0.25 }, "{k}: {q} {plan}");
        }
    }

    #[test]
    fn brakes_that_are_closed_at_first_hide_no_columns_and_another_robot_is_not_mixed_in() {
        let mut recording = OwnRecording::default();
        let mut topic = |name: &str| recording.topic(name, "rivet.JointState.v1", "json");
        assert_eq!(topic("rivet/a/joint-state"), Some(Kind::JointState));
        assert_eq!(topic("rivet/b/joint-state"), None);
        recording.take(Kind::JointState, state(1, 1, 4).as_bytes()).expect("a state");
        recording.take(Kind::Setpoint, plan(1, 1).as_bytes()).expect("a setpoint");
        assert!(recording.has_joints());
        let mut listing = Listing::default();
        recording.list(&mut listing);
        let names: Vec<&str> = listing.columns.iter().map(|column| column.name.as_str()).collect();
        for name in ["t", "q1", "q2", "tau2", "q_des1", "qdd_des2"] {
            assert!(names.contains(&name), "{name}: {names:?}");
        }
    }

    #[test]
    fn few_setpoints_are_left_out_with_a_word_and_odd_messages_are_refused() {
        let mut recording = OwnRecording::default();
        recording.take(Kind::Setpoint, plan(3, 3_000_000).as_bytes()).expect("a setpoint");
        for seq in 1..40 {
            recording.take(Kind::JointState, state(seq, 1_000_000 * seq, 0).as_bytes()).expect("a state");
        }
        let mut warnings = Vec::new();
        assert!(!recording.columns(&mut warnings).columns.contains_key("q_des1"));
        assert_eq!(warnings, ["38 of 39 joint states have no setpoint; its columns are left out"]);
        let three = r#"{"seq":1,"stamp_ns":1,"q":[1,2,3],"tau":[1,2,3]}"#;
        assert!(recording.take(Kind::JointState, three.as_bytes()).expect_err("refused").contains("3 joints"));
        assert!(recording.take(Kind::JointState, b"{}").is_err());
    }
}
