//! What the arm gets when it is stopped: torque from what can still be trusted.
//!
//! `damp` is a plan of the controller's own, from the state in which the stop began to rest: `q̈ = −q̇ / T`. The model knows its
//! torque. Where the limits of torque and rate hold that back, the plan brakes as much less as the model predicts, and
//! for longer: the arm comes to rest as fast as its drives let it. Joints with a trusted encoder are kept on the plan by slow
//! feedback; the others get the torque alone. Friction is left out of that torque: it then brakes a joint more than
//! planned, and never drives one whose velocity is not known.
//!
//! A joint that is not seen is where the model with friction predicts it. A prediction without friction goes on when friction has
//! brought the joint to rest: its torque then turns the joint round, and balances gravity at a position that the joint never reached.

use crate::allocation::allocate;
use crate::history::{History, Moment};
use crate::inertia::{acceleration_by, acceleration_of, accelerations_by};
use crate::law::ControlLaw;
use crate::watch::Wrong;
use rivet_config::StopReaction;
use rivet_dynamics::MAX_JOINTS;
use rivet_ipc_schema::StopCause;

/// The configured reaction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stop {
    pub(crate) reaction: StopReaction,
    /// How long it takes \[s\].
    pub(crate) time_s: f64,
}

/// `damp` slows down as e^(−t/T) with T this share of the stop time: 2 % of the speed is left at its end.
const DECAY_SHARE: f64 = 0.25;

/// Bandwidth of the feedback on a stop \[rad/s\], critically damped: stable with readings that are 100 ms late (up to 6 rad/s).
pub(crate) const FEEDBACK: f64 = 4.0;

/// Planned speed below which a joint is at rest \[rad/s\].
const RESTING: f64 = 1e-4;

/// Part of the acting model's friction with which joints that are not seen are predicted. Of 200 drawn stops of arms with 0.5 to 1.7 times
/// the file's friction, joints move by more than 0.1 rad afterwards in 4 without friction, in 2 with all of it, and in 1 with this part.
const FRICTION_SHARE: f64 = 0.7;

/// Speed at which the friction is taken that holds a joint at rest \[rad/s\].
const PROBE_SPEED: f64 = 0.05;

/// Longest time over which the arm's motion is reckoned from commands \[s\].
const LONGEST_RECKONED_S: f64 = 0.1;

/// Steps in that.
const RECKONING_STEPS: usize = 5;

/// A stop that has begun.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopping {
    pub(crate) cause: StopCause,
    /// Joints that the cause names, bit 0 the base's.
    pub(crate) joints: u32,
    /// Joints whose readings are not used in this stop: their encoders are in doubt.
    pub(crate) doubted: u32,
    /// Joints whose readings are not used now: those, and all while no sample is seen.
    pub(crate) untrusted: u32,
    /// The plan of the stop now: at first the state in which it began.
    pub(crate) q: [f64; MAX_JOINTS],
    pub(crate) qd: [f64; MAX_JOINTS],
    /// Accelerations that the last command was to make \[rad/s²\], and velocities with it, measured where joints are seen \[rad/s\].
    pub(crate) qdd: [f64; MAX_JOINTS],
    pub(crate) speed: [f64; MAX_JOINTS],
    /// The command before it \[N·m\].
    pub(crate) tau: [f64; MAX_JOINTS],
    /// Periods since then.
    pub(crate) periods: u64,
    /// Valid samples in a row.
    pub(crate) sound: u64,
    /// Only a request ends it.
    pub(crate) until_asked: bool,
}

/// Joints, bit 0 the base's, whose encoders a fault puts in doubt: then no later sample makes them trusted again. `suspects` are not known
/// to be where their encoders say.
pub(crate) fn doubted(wrong: Wrong, suspects: u32, all: u32) -> u32 {
    match wrong.cause {
        // What moves jumps where all positions are late: nothing of this sample is believed.
        StopCause::EncoderJump if wrong.joints.count_ones() > 1 => all,
        StopCause::Frozen | StopCause::EncoderJump | StopCause::NoResponse => wrong.joints,
        // A joint that is too fast, or off its plan, and moves as its torque moves it, is where its encoder says.
        StopCause::TooFast | StopCause::TrackingError => wrong.joints & suspects,
        _ => 0,
    }
}

impl Stop {
    /// Time constant with which `damp` slows down, and an arm that has no plan any more \[s\].
    pub(crate) fn decay_s(self) -> f64 {
        DECAY_SHARE * self.time_s
    }

    /// Moves the plan of `damp` on by `elapsed_s`. `lacking` is the torque that the limits held back \[N·m\]: given less wanted.
    /// Joints that are not seen are where the model with friction predicts them. `mass` is scratch of dof² numbers. Real-time safe.
    pub(crate) fn advance(
        self,
        law: &mut ControlLaw,
        x: &[f64],
        stopping: &mut Stopping,
        lacking: &[f64; MAX_JOINTS],
        elapsed_s: f64,
        mass: &mut [f64],
    ) {
        if self.reaction != StopReaction::Damp {
            return;
        }
        let n = law.dof();
        let dry = friction_torque(law, x, &stopping.q, &stopping.speed);
        let mut net = *lacking;
        for j in 0..n {
            net[j] -= dry[j];
        }
        let [dragged, moved] = accelerations_by(law, &stopping.q[..n], [lacking, &net], x, mass);
        let holding = friction_torque(law, x, &stopping.q, &[PROBE_SPEED; MAX_JOINTS]);
        let rest = (-elapsed_s / self.decay_s()).exp();
        for j in 0..n {
            let before = stopping.qd[j];
            if stopping.untrusted >> j & 1 == 1 {
                let mut a = stopping.qdd[j] + moved[j];
                if before == 0.0 {
                    let sticking = holding[j].abs() / law.nominal_inertia(j).max(f64::MIN_POSITIVE);
                    a -= a.clamp(-sticking, sticking);
                }
                stopping.qd[j] = before + a * elapsed_s;
            } else {
                stopping.qd[j] = before * rest + dragged[j] * elapsed_s;
            }
            if stopping.qd[j] * before < 0.0 || stopping.qd[j].abs() < RESTING {
                // A stop does not turn a joint round. One at rest may be dragged along by others for want of torque.
                stopping.qd[j] = 0.0;
            }
            stopping.q[j] += 0.5 * (before + stopping.qd[j]) * elapsed_s;
        }
    }

    /// Torque \[N·m\] of a stop that has lasted for `stopping_s`. `seen` are positions and velocities of a sample, if there is
    /// one. `x` are base parameters; friction is left out of the torque, since it helps to stop.
    ///
    /// * hold: what holds the first pose against gravity;
    /// * ramp: the last torque, reduced to zero in a straight line;
    /// * damp: see the module; it ends as `hold` does.
    pub(crate) fn torque(
        self,
        law: &mut ControlLaw,
        x: &[f64],
        stopping: &mut Stopping,
        seen: Option<[&[f64; MAX_JOINTS]; 2]>,
        stopping_s: f64,
        tau: &mut [f64],
    ) {
        let n = tau.len();
        let zero = [0.0; MAX_JOINTS];
        match self.reaction {
            StopReaction::Hold => law.model_torque(&stopping.q[..n], &zero[..n], &zero[..n], x, tau),
            StopReaction::Ramp => {
                let share = (1.0 - stopping_s / self.time_s).max(0.0);
                for (tau, last) in tau.iter_mut().zip(&stopping.tau) {
                    *tau = share * last;
                }
            }
            StopReaction::Damp => {
                let time = self.decay_s();
                let (mut q, qd, mut qdd) = (stopping.q, stopping.qd, zero);
                for j in 0..n {
                    qdd[j] = -qd[j] / time;
                    if let Some([measured, speed]) = seen
                        && stopping.untrusted & 1 << j == 0
                    {
                        qdd[j] += FEEDBACK * FEEDBACK * (q[j] - measured[j]) + 2.0 * FEEDBACK * (qd[j] - speed[j]);
                        q[j] = measured[j];
                    }
                }
                let [_, rest] = law.model_torque_apart(&q[..n], &qd[..n], &qdd[..n], x);
                tau.copy_from_slice(&rest[..n]);
                stopping.qdd = qdd;
                stopping.speed = stopping.qd;
                if let Some([_, speed]) = seen {
                    for j in (0..n).filter(|j| stopping.untrusted >> j & 1 == 0) {
                        stopping.speed[j] = speed[j];
                    }
                }
            }
        }
    }

    /// Brings a wanted torque of `damp` into what the drives can give next, `reach` \[N·m\]: joints whose drives can give more give way to
    /// those that would be dragged along. `speed` are speed limits \[rad/s\], `mass` is scratch of dof² numbers. Real-time safe.
    pub(crate) fn share_out(
        self,
        law: &mut ControlLaw,
        x: &[f64],
        stopping: &Stopping,
        [low, high]: &[[f64; MAX_JOINTS]; 2],
        speed: &[f64; MAX_JOINTS],
        mass: &mut [f64],
        tau: &mut [f64],
    ) {
        let n = tau.len();
        let mut lacking = [0.0; MAX_JOINTS];
        for j in 0..n {
            lacking[j] = tau[j].clamp(low[j], high[j]) - tau[j];
        }
        if self.reaction != StopReaction::Damp || lacking[..n].iter().all(|lacking| *lacking == 0.0) {
            return;
        }
        let dragged = acceleration_by(law, &stopping.q[..n], &lacking, x, mass);
        // A joint that brakes less than planned goes on for longer, and may be dragged along up to its speed limit.
        let is_dragged = |j: usize| {
            let (a, now) = (stopping.qdd[j] + dragged[j], stopping.speed[j]);
            a * now > 0.0 && (now + a * self.decay_s()).abs() > speed[j]
        };
        if (0..n).any(is_dragged) {
            law.inertia(&stopping.q[..n], x, mass);
            allocate(tau, low, high, mass, speed);
        }
    }
}

/// Torque of friction at velocities `qd`, as far as a stop relies on it \[N·m\]. Real-time safe.
fn friction_torque(
    law: &mut ControlLaw,
    x: &[f64],
    q: &[f64; MAX_JOINTS],
    qd: &[f64; MAX_JOINTS],
) -> [f64; MAX_JOINTS] {
    let n = law.dof();
    let [friction, _] = law.model_torque_apart(&q[..n], &qd[..n], &[0.0; MAX_JOINTS][..n], x);
    friction.map(|friction| FRICTION_SHARE * friction)
}

/// Positions and velocities now, of which those of `untrusted` joints are reckoned from the commands since `doubted` samples
/// before the last one of `history`; `unseen` periods have gone by after that. Joints that are trusted are where the last sample
/// saw them, unless there is none since. `x` are base parameters with friction.
///
/// Real-time safe: bounded work.
pub(crate) fn reckon(
    law: &mut ControlLaw,
    x: &[f64],
    mass: &mut [f64],
    history: &History,
    untrusted: u32,
    [doubted, unseen]: [usize; 2],
    period_s: f64,
) -> Option<Moment> {
    let n = law.dof();
    let doubted = doubted.min(history.len().saturating_sub(1));
    let (mut now, newest) = (*history.at(doubted)?, *history.at(0)?);
    let all = doubted + unseen;
    let most = (LONGEST_RECKONED_S / period_s) as usize;
    let (begin, count) = (all.saturating_sub(most), all.min(most));
    for part in 0..RECKONING_STEPS {
        // Periods of this step, from the oldest on.
        let (from, to) = (begin + part * count / RECKONING_STEPS, begin + (part + 1) * count / RECKONING_STEPS);
        if from == to {
            continue;
        }
        let mut tau = [0.0; MAX_JOINTS];
        for k in from..to {
            let moment = history.at(doubted.saturating_sub(k)).unwrap_or(&newest);
            for (sum, tau) in tau.iter_mut().zip(&moment.tau) {
                *sum += tau / (to - from) as f64;
            }
        }
        let span_s = (to - from) as f64 * period_s;
        let a = acceleration_of(law, [&now.q[..n], &now.qd[..n]], &tau[..n], x, mass);
        let seen = history.at(doubted.saturating_sub(to)).unwrap_or(&newest);
        for j in 0..n {
            if untrusted & 1 << j == 0 && to <= doubted {
                (now.q[j], now.qd[j]) = (seen.q[j], seen.qd[j]);
                continue;
            }
            let before = now.qd[j];
            now.qd[j] += a[j] * span_s;
            if now.qd[j] * before < 0.0 {
                // Friction brings a joint to rest; it does not turn it round.
                now.qd[j] = 0.0;
            }
            now.q[j] += 0.5 * (before + now.qd[j]) * span_s;
        }
    }
    now.tau = newest.tau;
    Some(now)
}
