//! From messages of ROS 2 to samples of the bus. No clock, network or bus is in here.

use rivet::{Sample, sample_flags};
use rivet_ipc_schema::{MAX_JOINTS, faults};

use crate::joints::{Joints, JointsError};
use crate::losses::Losses;
use crate::messages::{JointState, JointTrajectoryControllerState, JointTrajectoryPoint};
use crate::pairing::{Pairing, Plan};
use crate::problems::{Problem, Problems};
use crate::source::{Admission, Guid, Source};
use crate::stamps::{Mapped, Stamps};

/// A message as it came.
#[derive(Clone, Debug)]
pub struct Arrived<T> {
    /// Its publisher.
    pub from: Guid,
    /// Its number at its publisher.
    pub number: i64,
    /// When it came, `CLOCK_MONOTONIC` \[ns\].
    pub at_ns: u64,
    /// The same on the wall clock, since the epoch \[ns\].
    pub wall_ns: i64,
    /// The message.
    pub message: T,
}

/// What the bus is to get.
#[derive(Clone, Copy, Debug)]
pub struct Outgoing {
    /// Periods before the sample without a sample of their own.
    pub skip: u64,
    /// The sample.
    pub sample: Sample,
}

/// What came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Joint states of the publisher that is used.
    pub joint_states: u64,
    /// Joint states that their publisher wrote and that did not come.
    pub lost: u64,
    /// Joint states that were refused.
    pub refused: u64,
    /// Joint states that went to the bus.
    pub published: u64,
    /// Of those, how many have fault bits since a value is missing or not finite.
    pub faulty: u64,
    /// Joint states of other publishers of this arm's joints, left out.
    pub foreign: u64,
    /// Joint states of other joints, left out.
    pub other_joints: u64,
    /// Setpoints that came.
    pub setpoints: u64,
    /// Setpoints that went to the bus.
    pub setpoints_published: u64,
}

/// A joint state on its way to the bus.
#[derive(Clone, Copy, Debug)]
struct Kept {
    skip: u64,
    sample: Sample,
}

/// Takes messages in, gives samples out.
#[derive(Debug)]
pub struct Intake {
    joints: Joints,
    plan_joints: Joints,
    topic: String,
    setpoint_topic: String,
    period_s: f64,
    source: Source,
    /// Another publisher of this arm's joints since the last message of the one that is used, and how many messages.
    other: Option<(Guid, u64)>,
    planner: Source,
    stamps: Stamps,
    losses: Losses,
    pairing: Pairing<Kept>,
    /// Stamp of the last joint state: a point without a stamp is of its period.
    stamp_ns: Option<i64>,
    /// Periods without a sample since the last one.
    skip: u64,
    q: [f64; MAX_JOINTS],
    counts: Counts,
    problems: Problems,
    misfit: Option<JointsError>,
}

impl Intake {
    /// For an arm with these joints, base to flange. `topic`, `setpoint_topic`: for messages to people.
    pub fn new(joints: Vec<String>, period_s: f64, patience_s: f64, topic: &str, setpoint_topic: &str) -> Intake {
        Intake {
            joints: Joints::new(joints.clone()),
            plan_joints: Joints::new(joints),
            topic: topic.to_owned(),
            setpoint_topic: setpoint_topic.to_owned(),
            period_s,
            source: Source::default(),
            other: None,
            planner: Source::default(),
            stamps: Stamps::new(period_s),
            losses: Losses::new(period_s),
            pairing: Pairing::new(period_s, patience_s),
            stamp_ns: None,
            skip: 0,
            q: [0.0; MAX_JOINTS],
            counts: Counts::default(),
            problems: Problems::default(),
            misfit: None,
        }
    }

    /// Takes a joint state in.
    pub fn joint_state(&mut self, arrived: &Arrived<JointState>) {
        if !self.admit(arrived) {
            return;
        }
        self.counts.joint_states += 1;
        let Some(at_ns) = self.instant(arrived) else {
            self.counts.refused += 1;
            return;
        };
        self.skip += self.hole(arrived, at_ns);
        let Some(mut sample) = self.sample(&arrived.message, arrived.at_ns) else {
            self.counts.refused += 1;
            // Its period is one without a sample.
            self.skip += 1;
            return;
        };
        sample.stamp_ns = at_ns;
        self.counts.faulty += u64::from(sample.faults != 0);
        let stamp_ns = match arrived.message.header.stamp.as_ns() {
            0 => arrived.wall_ns,
            stamp_ns => stamp_ns,
        };
        self.stamp_ns = Some(stamp_ns);
        let skip = std::mem::take(&mut self.skip);
        self.pairing.state(stamp_ns, arrived.at_ns, Kept { skip, sample });
    }

    /// Whether a joint state is of this arm and of the publisher that is used.
    fn admit(&mut self, arrived: &Arrived<JointState>) -> bool {
        let now = arrived.at_ns;
        if let Err(why) = self.joints.places(&arrived.message.name) {
            // A gripper on the same topic is nothing wrong.
            if self.source.current().is_some_and(|current| current != arrived.from) {
                self.counts.other_joints += 1;
                return false;
            }
            self.counts.refused += 1;
            let topic = &self.topic;
            self.problems.count(Problem::Joints, 1, now, || {
                format!(
                    "{topic}: {why}; name the joints in the robot's URDF as its driver does, or give --joint-states another topic"
                )
            });
            self.misfit = Some(why);
            return false;
        }
        match self.source.admit(arrived.from, now) {
            Admission::Used => self.report_second_publisher(now),
            Admission::Succession => {
                self.other = None;
                self.stamps.restart();
                self.losses.expect_number(arrived.number);
            }
            Admission::Foreign => {
                self.counts.foreign += 1;
                let before = self.other.map_or(0, |(_, count)| count);
                self.other = Some((arrived.from, before + 1));
                return false;
            }
        }
        true
    }

    /// When a joint state was measured, `CLOCK_MONOTONIC` \[ns\]; `None` where it is not newer than the one before.
    fn instant(&mut self, arrived: &Arrived<JointState>) -> Option<u64> {
        let (topic, now, number) = (&self.topic, arrived.at_ns, arrived.number);
        let stamp_ns = arrived.message.header.stamp.as_ns();
        match self.stamps.map(stamp_ns, now, arrived.wall_ns) {
            Mapped::At(at) => Some(at),
            Mapped::Arrival(at) => {
                self.problems.count(Problem::NoStamp, 1, now, || {
                    format!(
                        "{topic}: stamps are 0, so the time of arrival counts; the publisher has to set header.stamp"
                    )
                });
                Some(at)
            }
            Mapped::Stepped(at) => {
                self.problems.count(Problem::ClockStep, 1, now, || {
                    format!("{topic}: the clock of the stamps was set; rivet begins anew there. Synchronise the clocks of both hosts")
                });
                self.losses.restart();
                self.pairing.restart();
                Some(at)
            }
            Mapped::Back => {
                self.problems.count(Problem::StampBack, 1, now, || {
                    format!("{topic}: message {number} is stamped {stamp_ns} ns, not later than the one before; it is left out")
                });
                // Its number counts: the next one is no loss.
                self.losses.expect_number(number.saturating_add(1));
                None
            }
        }
    }

    /// Periods before a joint state for which none came.
    fn hole(&mut self, arrived: &Arrived<JointState>, at_ns: u64) -> u64 {
        let (topic, now, number) = (&self.topic, arrived.at_ns, arrived.number);
        let hole = self.losses.next(number, at_ns);
        if hole.lost > 0 {
            self.counts.lost += hole.lost;
            self.problems.count(Problem::Lost, hole.lost, now, || {
                let lost = hole.lost;
                format!(
                    "{topic}: {lost} messages were lost before message {number}; use a cable or a reliable publisher, and raise \
                     net.core.rmem_max"
                )
            });
        }
        if !self.losses.rate_fits() {
            let (usual, period) = (self.losses.usual_s() * 1e3, self.period_s * 1e3);
            self.problems.count(Problem::Rate, 1, now, || {
                format!(
                    "{topic}: joint states come every {usual:.3} ms, sample_period_s of the robot file is {period:.3} ms; make both equal"
                )
            });
        }
        hole.periods
    }

    /// The publisher that is used sends on: another one that was heard meanwhile is no successor.
    fn report_second_publisher(&mut self, now: u64) {
        let Some((other, count)) = self.other.take() else { return };
        let (topic, used) = (&self.topic, self.source.current());
        self.problems.count(Problem::OtherPublisher, count, now, || {
            format!(
                "{topic}: publisher {} also sends joint states of this arm and is left out, {} is used; end one of them",
                guid_text(other),
                used.map(guid_text).unwrap_or_default()
            )
        });
    }

    /// Values of a message whose joints are known.
    fn sample(&mut self, message: &JointState, now: u64) -> Option<Sample> {
        let Ok(places) = self.joints.places(&message.name) else { return None };
        let (count, topic) = (message.name.len(), &self.topic);
        if message.position.len() != count {
            let found = message.position.len();
            self.problems.count(Problem::Lengths, 1, now, || {
                format!("{topic}: {count} names and {found} positions; the state interface \"position\" of each joint has to be broadcast")
            });
            return None;
        }
        let mut sample = Sample::default();
        let has_effort = message.effort.len() == count;
        if !has_effort {
            sample.faults |= faults::TORQUE;
            let found = message.effort.len();
            self.problems.count(Problem::NoEffort, 1, now, || {
                format!(
                    "{topic}: {count} names and {found} efforts; rivet needs each joint's torque: add the state interface \"effort\" to \
                     the joint_state_broadcaster and to the hardware description"
                )
            });
        }
        for (j, &place) in places.iter().enumerate().take(MAX_JOINTS) {
            let q = message.position[place];
            if q.is_finite() {
                self.q[j] = q;
            } else {
                sample.faults |= faults::ENCODER;
                let name = &message.name[place];
                self.problems.count(Problem::PositionNotFinite, 1, now, || {
                    format!("{topic}: position of joint {name} is {q}; the driver does not know it, the sample is marked as a fault")
                });
            }
            sample.q[j] = self.q[j];
            if has_effort {
                let tau = message.effort[place];
                if tau.is_finite() {
                    sample.tau[j] = tau;
                } else {
                    sample.faults |= faults::TORQUE;
                    let name = &message.name[place];
                    self.problems.count(Problem::EffortNotFinite, 1, now, || {
                        format!(
                            "{topic}: effort of joint {name} is {tau}; the driver does not measure it, the sample is marked as a fault. \
                             Export the state interface \"effort\" of each joint"
                        )
                    });
                }
            }
        }
        Some(sample)
    }

    /// Takes a setpoint in: the first point of a controller's state.
    pub fn controller_state(&mut self, arrived: &Arrived<JointTrajectoryControllerState>) {
        let message = &arrived.message;
        self.counts.setpoints += 1;
        let places = match self.plan_joints.places(&message.joint_names) {
            Ok(places) => places.to_vec(),
            Err(why) => {
                let topic = &self.setpoint_topic;
                self.problems.count(Problem::PlanJoints, 1, arrived.at_ns, || {
                    format!("{topic}: {why}; give --setpoint the controller of this arm")
                });
                return;
            }
        };
        let stamp_ns = message.header.stamp.as_ns();
        let stamp_ns = if stamp_ns == 0 { self.stamp_ns.unwrap_or_default() } else { stamp_ns };
        self.plan(arrived.from, arrived.at_ns, stamp_ns, &message.reference, &places);
    }

    /// Takes a setpoint in: a point of the period of the last joint state, with the joints of the robot file in their order.
    pub fn point(&mut self, arrived: &Arrived<JointTrajectoryPoint>) {
        self.counts.setpoints += 1;
        let places: Vec<usize> = (0..self.joints.count()).collect();
        self.plan(arrived.from, arrived.at_ns, self.stamp_ns.unwrap_or_default(), &arrived.message, &places);
    }

    fn plan(&mut self, from: Guid, now: u64, stamp_ns: i64, point: &JointTrajectoryPoint, places: &[usize]) {
        let topic = &self.setpoint_topic;
        if self.planner.admit(from, now) == Admission::Foreign {
            self.problems.count(Problem::OtherPlanner, 1, now, || {
                format!("{topic}: publisher {} also sends setpoints and is left out; end one of them", guid_text(from))
            });
            return;
        }
        let values = |values: &[f64]| {
            let mut out = [0.0; MAX_JOINTS];
            for (out, &place) in out.iter_mut().zip(places) {
                *out = values.get(place).copied().filter(|value| value.is_finite())?;
            }
            Some(out)
        };
        let (q, qd, qdd) = (values(&point.positions), values(&point.velocities), values(&point.accelerations));
        if let (Some(q), Some(qd), Some(qdd)) = (q, qd, qdd) {
            self.pairing.plan(Plan { stamp_ns, q, qd, qdd }, now);
            return;
        }
        self.problems.count(Problem::Plan, 1, now, || {
            let lengths = [&point.positions, &point.velocities, &point.accelerations].map(Vec::len);
            format!(
                "{topic}: {} positions, {} velocities, {} accelerations, or one that is not finite; a setpoint needs all three of each \
                 joint: plan trajectories with accelerations, or leave --setpoint out",
                lengths[0], lengths[1], lengths[2]
            )
        });
    }

    /// The next sample for the bus, if one is ready at `now_ns`.
    pub fn next(&mut self, now_ns: u64) -> Option<Outgoing> {
        let (kept, plan) = self.pairing.next(now_ns)?;
        let mut sample = kept.sample;
        if let Some(plan) = plan {
            sample.flags |= sample_flags::SETPOINT;
            (sample.q_des, sample.qd_des, sample.qdd_des) = (plan.q, plan.qd, plan.qdd);
            self.counts.setpoints_published += 1;
        }
        let (topic, unmatched) = (&self.setpoint_topic, self.pairing.unmatched());
        let more = unmatched - self.problems.times(Problem::PlanUnmatched);
        if more > 0 {
            self.problems.count(Problem::PlanUnmatched, more, now_ns, || {
                format!("{topic}: setpoints without a joint state of their stamp; let both publish at the same rate")
            });
        }
        self.counts.published += 1;
        Some(Outgoing { skip: kept.skip, sample })
    }

    /// Whether joint states wait for their setpoints.
    pub fn waits(&self) -> bool {
        self.pairing.waits()
    }

    /// A publisher has left.
    pub fn publisher_left(&mut self, guid: Guid) {
        self.source.publisher_left(guid);
        self.planner.publisher_left(guid);
    }

    /// The publisher of joint states that is used.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// Why the only joint states that came have not been used; `None` once some have.
    pub fn misfit(&self) -> Option<&JointsError> {
        self.misfit.as_ref().filter(|_| self.counts.joint_states == 0)
    }

    /// Positions of the last joint state \[rad, or m\].
    pub fn positions(&self) -> [f64; MAX_JOINTS] {
        self.q
    }

    /// What came.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// What is wrong.
    pub fn problems(&mut self) -> &mut Problems {
        &mut self.problems
    }
}

/// A GUID as ROS 2 shows it: `01.0f.45.…`.
pub fn guid_text(guid: Guid) -> String {
    guid.map(|byte| format!("{byte:02x}")).join(".")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, Time};

    const MS: u64 = 1_000_000;
    const WALL: i64 = 1_764_000_000_000_000_000;

    fn intake() -> Intake {
        Intake::new(vec!["a".to_owned(), "b".to_owned()], 0.002, 0.01, "/joint_states", "/setpoint")
    }

    fn header(k: u64) -> Header {
        Header { stamp: Time::from_ns(WALL + (2 * MS * k).cast_signed()), frame_id: String::new() }
    }

    fn arrived<T>(from: u8, k: u64, message: T) -> Arrived<T> {
        let at_ns = 1_000_000_000 + 2 * MS * k + MS / 2;
        Arrived {
            from: [from; 16],
            number: k.cast_signed(),
            at_ns,
            wall_ns: WALL + (2 * MS * k + MS / 2).cast_signed(),
            message,
        }
    }

    fn state(k: u64) -> JointState {
        JointState {
            header: header(k),
            name: ["b", "finger", "a"].map(str::to_owned).to_vec(),
            position: vec![2.0, 9.0, 1.0 + k as f64],
            velocity: Vec::new(),
            effort: vec![20.0, 90.0, 10.0],
        }
    }

    fn take(intake: &mut Intake) -> Vec<Outgoing> {
        std::iter::from_fn(|| intake.next(u64::MAX / 2)).collect()
    }

    #[test]
    fn joints_come_out_in_the_order_of_the_arm_without_the_others() {
        let mut intake = intake();
        intake.joint_state(&arrived(1, 7, state(7)));
        let [out] = take(&mut intake)[..] else { panic!("one sample") };
        assert_eq!(
            (out.sample.q[..3].to_vec(), out.sample.tau[..3].to_vec()),
            (vec![8.0, 2.0, 0.0], vec![10.0, 20.0, 0.0])
        );
        assert_eq!((out.skip, out.sample.faults, out.sample.flags), (0, 0, 0));
        assert_eq!(out.sample.stamp_ns, 1_000_000_000 + 14 * MS, "the stamp on the monotonic clock");
        assert_eq!(intake.problems().news(), [""; 0], "velocities are not needed");
    }

    #[test]
    fn values_that_are_missing_mark_the_sample_and_say_what_to_do() {
        let mut intake = intake();
        intake.joint_state(&arrived(1, 1, JointState { effort: Vec::new(), ..state(1) }));
        intake.joint_state(&arrived(1, 2, JointState { effort: vec![f64::NAN, 0.0, 1.0], ..state(2) }));
        intake.joint_state(&arrived(1, 3, JointState { position: vec![f64::INFINITY, 0.0, 1.0], ..state(3) }));
        intake.joint_state(&arrived(1, 4, JointState { position: vec![1.0], ..state(4) }));
        intake.joint_state(&arrived(1, 5, state(5)));
        let out = take(&mut intake);
        let marks: Vec<u32> = out.iter().map(|out| out.sample.faults).collect();
        assert_eq!(marks, [faults::TORQUE, faults::TORQUE, faults::ENCODER, 0]);
        assert_eq!(out[2].sample.q[1], 2.0, "the last position that was known");
        let news = intake.problems().news();
        assert!(news.iter().any(|text| text.contains("\"effort\" to the joint_state_broadcaster")), "{news:?}");
        assert!(news.iter().any(|text| text.contains("effort of joint b is NaN")), "{news:?}");
        assert!(news.iter().any(|text| text.contains("3 names and 1 positions")), "{news:?}");
        assert_eq!((intake.counts().faulty, intake.counts().refused), (3, 1));
        assert_eq!(out.iter().map(|out| out.skip).collect::<Vec<_>>(), [0, 0, 0, 1], "the refused one is a hole");
    }

    #[test]
    fn a_hole_is_a_hole_on_the_bus() {
        let mut intake = intake();
        for k in [1, 2, 5, 6] {
            intake.joint_state(&arrived(1, k, state(k)));
        }
        let skips: Vec<u64> = take(&mut intake).iter().map(|out| out.skip).collect();
        assert_eq!(skips, [0, 0, 2, 0]);
        assert_eq!((intake.counts().lost, intake.problems().times(Problem::Lost)), (2, 2));
    }

    #[test]
    fn missing_names_are_refused_and_listed_until_the_arm_is_found() {
        let mut intake = intake();
        let gripper =
            || JointState { name: vec!["finger".to_owned()], position: vec![1.0], effort: vec![0.0], ..state(1) };
        intake.joint_state(&arrived(9, 1, gripper()));
        assert!(
            intake
                .misfit()
                .is_some_and(|why| why.to_string().contains("joints a, b missing; the message has joint finger"))
        );
        intake.joint_state(&arrived(1, 2, state(2)));
        assert_eq!(intake.misfit(), None);
        intake.joint_state(&arrived(9, 3, gripper()));
        assert_eq!((intake.counts().other_joints, intake.counts().refused), (1, 1));
        assert_eq!(take(&mut intake).len(), 1);
    }

    #[test]
    fn a_second_publisher_is_named_and_left_out() {
        let mut intake = intake();
        for k in 1..10 {
            intake.joint_state(&arrived(1, k, state(k)));
            intake.joint_state(&arrived(2, k + 100, state(k)));
        }
        assert_eq!(take(&mut intake).len(), 9);
        assert_eq!(intake.counts().foreign, 9);
        let news = intake.problems().news();
        assert!(matches!(&news[..], [text] if text.contains(&guid_text([2; 16]))), "{news:?}");
    }

    #[test]
    fn a_publisher_that_comes_back_continues_with_a_hole() {
        let mut intake = intake();
        intake.joint_state(&arrived(1, 1, state(1)));
        // Too early to be sure that the first one is gone.
        intake.joint_state(&arrived(2, 100, state(100)));
        let mut again = arrived(2, 501, state(501));
        again.number = 401;
        intake.joint_state(&again);
        let out = take(&mut intake);
        assert_eq!(out.iter().map(|out| out.skip).collect::<Vec<_>>(), [0, 499]);
        assert_eq!((intake.counts().lost, intake.counts().foreign), (0, 1));
        assert_eq!(intake.problems().news(), [""; 0], "one after the other is no conflict");
    }

    #[test]
    fn old_and_repeated_stamps_are_left_out_without_a_loss() {
        let mut intake = intake();
        intake.joint_state(&arrived(1, 1, state(1)));
        intake.joint_state(&arrived(1, 2, state(1)));
        intake.joint_state(&arrived(1, 3, state(3)));
        let skips: Vec<u64> = take(&mut intake).iter().map(|out| out.skip).collect();
        assert_eq!(skips, [0, 1], "the period of the message that was left out");
        assert_eq!((intake.counts().lost, intake.counts().refused), (0, 1));
    }

    #[test]
    fn setpoints_join_the_joint_states_of_their_stamps() {
        let mut intake = intake();
        let point = JointTrajectoryPoint {
            positions: vec![0.2, 0.1],
            velocities: vec![2.0, 1.0],
            accelerations: vec![20.0, 10.0],
            ..JointTrajectoryPoint::default()
        };
        let plan = |k, reference: &JointTrajectoryPoint| JointTrajectoryControllerState {
            header: header(k),
            joint_names: vec!["b".to_owned(), "a".to_owned()],
            reference: reference.clone(),
        };
        intake.controller_state(&arrived(3, 1, plan(1, &point)));
        intake.joint_state(&arrived(1, 1, state(1)));
        let incomplete = JointTrajectoryPoint { accelerations: Vec::new(), ..point.clone() };
        intake.controller_state(&arrived(3, 2, plan(2, &incomplete)));
        intake.joint_state(&arrived(1, 2, state(2)));
        intake.joint_state(&arrived(1, 3, state(3)));
        intake.point(&arrived(3, 3, point));
        let out = take(&mut intake);
        let planned: Vec<u32> = out.iter().map(|out| out.sample.flags).collect();
        assert_eq!(planned, [sample_flags::SETPOINT, 0, sample_flags::SETPOINT]);
        assert_eq!((out[0].sample.q_des[0], out[0].sample.qdd_des[1]), (0.1, 20.0), "by name");
        assert_eq!((out[2].sample.q_des[0], out[2].sample.qd_des[1]), (0.2, 1.0), "in the order of the arm");
        let news = intake.problems().news();
        assert!(news.iter().any(|text| text.contains("2 positions, 2 velocities, 0 accelerations")), "{news:?}");
    }

    #[test]
    fn a_flood_and_another_rate_end_in_counts() {
        let mut intake = intake();
        let mut out = 0;
        for k in 1..100_000_u64 {
            let mut flood = arrived(1, k, state(0));
            flood.at_ns = 1_000_000_000 + k * 10_000;
            flood.message.header.stamp = Time::from_ns(WALL + (k * 10_000).cast_signed());
            intake.joint_state(&flood);
            out += take(&mut intake).len();
        }
        assert_eq!(out, 99_999);
        assert!(intake.problems().times(Problem::Rate) > 90_000);
        assert_eq!(intake.problems().news().len(), 1, "said once");
    }
}
