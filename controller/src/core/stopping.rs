//! When the stop reaction begins and ends, and its commands.

use super::Core;
use crate::stop::{Stopping, doubted, reckon};
use crate::watch::Wrong;
use rivet_dynamics::MAX_JOINTS;
use rivet_ipc_schema::{Command, JointState, StopCause};

/// Time before a fault is found for which readings are not used \[s\].
const DOUBTED_S: f64 = 0.02;

/// A stop within this time after the last one ended by itself is not over by itself \[s\].
const RELAPSE_S: f64 = 5.0;

impl Core {
    /// Nothing that was commanded so far was right where samples have never come at their rate: brakes are to stay closed.
    pub(super) fn may_stop(&self) -> bool {
        self.clock.fits() || self.confirmed
    }

    /// Begins the stop reaction, `unseen` periods after the last sample that was used.
    pub(super) fn begin_stop(&mut self, wrong: Wrong, unseen: u64) {
        let n = self.dof;
        let all = (1_u32 << n) - 1;
        let mut stopping = Stopping {
            cause: wrong.cause,
            joints: wrong.joints,
            doubted: doubted(wrong, self.watch.suspects(), all),
            untrusted: 0,
            q: [0.0; MAX_JOINTS],
            qd: [0.0; MAX_JOINTS],
            qdd: [0.0; MAX_JOINTS],
            speed: [0.0; MAX_JOINTS],
            tau: *self.output.last(),
            periods: 0,
            sound: 0,
            until_asked: self.resume_after == 0 || self.relapses() || wrong.stays(all),
        };
        // The encoder of a joint that is too fast, and does not move as its torque moves it, looks sound again once the joint stands.
        let is_measured = matches!(wrong.cause, StopCause::TooFast | StopCause::TrackingError);
        stopping.until_asked |= is_measured && stopping.doubted != 0;
        // Without a sample nothing of the arm is seen.
        stopping.untrusted = if stopping.doubted == 0 { all } else { stopping.doubted };
        let unused = if stopping.doubted == 0 { 0 } else { (DOUBTED_S / self.period_s).ceil() as usize };
        let since = [unused, usize::try_from(unseen).unwrap_or(usize::MAX)];
        let (law, x) = (&mut self.law, &self.acting[..self.count]);
        let reckoned = reckon(law, x, &mut self.mass, &self.history, stopping.untrusted, since, self.period_s);
        if let Some(now) = reckoned {
            (stopping.q, stopping.qd) = (now.q, now.qd);
        }
        if stopping.cause == StopCause::TrackingError {
            self.counts.strayed += 1;
        }
        self.counts.stops += 1;
        if let Some(count) = self.stop_causes.get_mut(u32::from(wrong.cause) as usize) {
            *count += 1;
        }
        self.last_stop = (wrong.cause, wrong.joints);
        (self.asked, self.following, self.held) = (false, false, None);
        self.stopping = Some(stopping);
    }

    /// Whether the last stop ended by itself a moment ago: then what caused it has not gone.
    fn relapses(&self) -> bool {
        let (Some(resumed), Some(now)) = (self.resumed_seq, self.last_seq) else { return false };
        now.saturating_sub(resumed) as f64 * self.period_s < RELAPSE_S
    }

    /// Whether a stop ends with this sample, with which nothing is wrong but `found`.
    pub(super) fn resumes(&mut self, sample: &JointState, found: Option<Wrong>) -> bool {
        let plan = self.plan.filter(|(seq, _)| seq.abs_diff(sample.seq) <= self.stale_periods);
        let reached = plan.is_none_or(|(_, plan)| self.distance(&plan, sample) <= super::REJOIN);
        let (resume_after, asked, dof) = (self.resume_after, self.asked, self.dof);
        let suspects = self.watch.suspects();
        let Some(stopping) = &mut self.stopping else { return true };
        stopping.sound = if found.is_none() { stopping.sound.saturating_add(1) } else { 0 };
        let new = found.map_or(0, |wrong| doubted(wrong, suspects, (1 << dof) - 1)) & !stopping.doubted;
        stopping.doubted |= new;
        stopping.untrusted |= new;
        // A joint that is too fast is seen to be.
        let is_seen = found.is_none_or(|wrong| wrong.cause == StopCause::TooFast);
        if is_seen && stopping.untrusted != stopping.doubted && self.velocity.is_known() {
            // What was reckoned while nothing was seen gives way to what is seen.
            for j in (0..dof).filter(|j| (stopping.untrusted & !stopping.doubted) >> j & 1 == 1) {
                (stopping.q[j], stopping.qd[j]) = (sample.q[j], self.velocity.value()[j]);
            }
            stopping.untrusted = stopping.doubted;
        }
        let by_itself = !stopping.until_asked && stopping.sound >= resume_after;
        if stopping.sound == 0 || !reached || !(asked || by_itself) {
            return false;
        }
        self.resumed_seq = (!asked).then_some(sample.seq);
        (self.stopping, self.asked) = (None, false);
        self.counts.resumed += 1;
        self.watch.restart_motion();
        self.output.restart();
        self.history.restart();
        self.plan_refused = None;
        self.law.restart();
        true
    }

    /// Asks a stopped arm to follow its plan again with the next valid sample, once the plan is within reach. Without a stop this
    /// changes nothing.
    pub fn ask_to_follow(&mut self) {
        self.asked = self.stopping.is_some();
    }

    /// A command of the stop reaction, `elapsed` periods after the last one.
    pub(super) fn stopped(
        &mut self,
        seq: u64,
        stamp_ns: u64,
        elapsed: u64,
        seen: Option<[&[f64; MAX_JOINTS]; 2]>,
    ) -> Command {
        let n = self.dof;
        let mut tau = [0.0; MAX_JOINTS];
        let x = &self.acting[..self.count];
        if let Some(stopping) = &mut self.stopping {
            stopping.periods = stopping.periods.saturating_add(elapsed);
            let stopping_s = stopping.periods as f64 * self.period_s;
            self.stop.torque(&mut self.law, x, stopping, seen, stopping_s, &mut tau[..n]);
        }
        let mut shared = tau;
        if let Some(stopping) = &self.stopping {
            let (reach, speed) = (self.output.reach(), self.limits.speeds());
            self.stop.share_out(&mut self.law, x, stopping, &reach, speed, &mut self.mass, &mut shared[..n]);
        }
        let command = self.give(seq, stamp_ns, shared, None);
        if let Some(stopping) = &mut self.stopping {
            let mut lacking = [0.0; MAX_JOINTS];
            for j in 0..n {
                // What is not a number lacks nothing that is known.
                let lack = command.tau[j] - tau[j];
                lacking[j] = if lack.is_finite() { lack } else { 0.0 };
            }
            let x = &self.acting[..self.count];
            let elapsed_s = elapsed as f64 * self.period_s;
            self.stop.advance(&mut self.law, x, stopping, &lacking, elapsed_s, &mut self.mass);
        }
        command
    }
}
