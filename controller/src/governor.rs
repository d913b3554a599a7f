//! Reference governor: keeps the plan within what the rate limit of the torque lets the arm do.
//!
//! A plan may need torque that changes faster than the drives take it. The arm falls behind it by that much whatever the feedback
//! does, and feedback that answers with torque that comes too late swings the arm. So the reference falls behind as well, by what the
//! model predicts, and comes back slowly. What the rate limit takes from feedback moves the reference in the same way
//! (pseudo-control hedging, E. N. Johnson and A. J. Calise, 2001): the error then does not grow by torque that was never given.
//!
//! ```text
//! r = plan + o                        ö = δ + η − J²·o − 2·J·ȯ        o: offset of the reference from the plan, per joint
//! u ← u + clamp(τ(r) − u, ±rate)      δ = M⁻¹·(u − τ(r))              u: torque of the reference behind the limits
//!                                     η = M⁻¹·l                       l: what the rate limit took from the last command
//! ```
//!
//! `τ(r)` is without friction, that of known effects included: friction turns round with the arm, not with the reference.

use crate::inertia::accelerations_by;
use crate::law::{ControlLaw, Desired};
use crate::output::Limits;
use rivet_dynamics::MAX_JOINTS;

/// Bandwidth with which the reference comes back to the plan \[rad/s\], critically damped.
const RETURN: f64 = 5.0;
/// Part of the rate limit that the reference uses: the rest is left to feedback. On dd2, of 70 plans at the edge of the drives, 8 swing
/// the arm beyond its bounds with 1, 4 with 0.75, none with 0.5.
const RATE_SHARE: f64 = 0.5;

/// Longest gap between two references that is one step \[periods\]: the return stays stable.
const MAX_PERIODS: u64 = 10;

/// The reference's offset from the plan, and the torque that leads it.
#[derive(Clone, Debug)]
pub(crate) struct Governor {
    dof: usize,
    period_s: f64,
    torque: [f64; MAX_JOINTS],
    step: [f64; MAX_JOINTS],
    bounds: [[f64; 2]; MAX_JOINTS],
    /// Torque of the reference; `None` before the first one.
    given: Option<[f64; MAX_JOINTS]>,
    /// What the rate limit took from the last command \[N·m\].
    held_back: [f64; MAX_JOINTS],
    /// Offset \[rad\] and its rate \[rad/s\].
    offset: [f64; MAX_JOINTS],
    speed: [f64; MAX_JOINTS],
    /// What of both the torque made that was taken from feedback.
    hedged: [[f64; MAX_JOINTS]; 2],
}

impl Governor {
    /// `output`: the drives' limits. `bounds`: largest offset \[rad\] and its rate \[rad/s\], joint by joint.
    pub(crate) fn new(output: &Limits, bounds: &[[f64; 2]], period_s: f64) -> Governor {
        let (dof, zero) = (bounds.len(), [0.0; MAX_JOINTS]);
        let mut governor = Governor {
            dof,
            period_s,
            torque: zero,
            step: zero,
            bounds: [[0.0; 2]; MAX_JOINTS],
            given: None,
            held_back: zero,
            offset: zero,
            speed: zero,
            hedged: [zero; 2],
        };
        governor.torque[..dof].copy_from_slice(&output.torque);
        governor.step[..dof].copy_from_slice(&output.step);
        governor.bounds[..dof].copy_from_slice(bounds);
        governor
    }

    /// Begins without an offset.
    pub(crate) fn restart(&mut self) {
        (self.given, self.offset, self.speed) = (None, [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        (self.held_back, self.hedged) = ([0.0; MAX_JOINTS], [[0.0; MAX_JOINTS]; 2]);
    }

    /// Takes in what the rate limit took from the command that answered the last reference \[N·m\], feedback and all.
    pub(crate) fn hedge(&mut self, lacking: &[f64; MAX_JOINTS]) {
        self.held_back = *lacking;
    }

    /// Joints, bit 0 the base's, whose reference is further from the plan than an arm may be, or leaves it faster than a plan may jump, or
    /// does a part of both, and whether that is the plan's own doing: it is too hard for the rate limit. Else feedback is, which answers
    /// something that is wrong with the arm or its readings.
    pub(crate) fn beyond(&self) -> (u32, bool) {
        let share =
            |j: usize, offset: f64, speed: f64| offset.abs() / self.bounds[j][0] + speed.abs() / self.bounds[j][1];
        let is_beyond = |j: &usize| share(*j, self.offset[*j], self.speed[*j]) > 1.0;
        let joints = (0..self.dof).filter(is_beyond).fold(0, |bits, j| bits | 1 << j);
        let is_planned = |j: usize| {
            let [offset, speed] = [self.hedged[0][j], self.hedged[1][j]];
            share(j, self.offset[j] - offset, self.speed[j] - speed) >= share(j, offset, speed)
        };
        (joints, (0..self.dof).any(|j| joints >> j & 1 == 1 && is_planned(j)))
    }

    /// Turns a plan into the reference, `periods` after the last one. `x` are base parameters, `mass` is scratch of
    /// dof² numbers. Real-time safe.
    pub(crate) fn apply(
        &mut self,
        desired: &mut Desired,
        law: &mut ControlLaw,
        x: &[f64],
        mass: &mut [f64],
        periods: u64,
    ) {
        let (n, periods) = (self.dof, periods.clamp(1, MAX_PERIODS) as f64);
        let mut accelerations = [0.0; MAX_JOINTS];
        for (j, a) in accelerations.iter_mut().enumerate().take(n) {
            *a = -RETURN * (RETURN * self.offset[j] + 2.0 * self.speed[j]);
            desired.q[j] += self.offset[j];
            desired.qd[j] += self.speed[j];
            desired.qdd[j] += *a;
        }
        let [_, needed] = law.model_torque_apart(&desired.q[..n], &desired.qd[..n], &desired.qdd[..n], x);
        let mut given = self.given.unwrap_or(needed);
        let mut lacking = [0.0; MAX_JOINTS];
        for j in 0..n {
            let step = RATE_SHARE * self.step[j] * periods;
            given[j] += (needed[j] - given[j]).clamp(-step, step);
            given[j] = given[j].clamp(-self.torque[j], self.torque[j]);
            lacking[j] = given[j] - needed[j];
        }
        self.given = Some(given);
        let [delta, hedge] = accelerations_by(law, &desired.q[..n], [&lacking, &self.held_back], x, mass);
        for j in 0..n {
            desired.qdd[j] += delta[j];
            self.speed[j] += (accelerations[j] + delta[j] + hedge[j]) * periods * self.period_s;
            self.offset[j] += self.speed[j] * periods * self.period_s;
            let [offset, speed] = &mut self.hedged;
            speed[j] += (hedge[j] - RETURN * (RETURN * offset[j] + 2.0 * speed[j])) * periods * self.period_s;
            offset[j] += speed[j] * periods * self.period_s;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law::Gains;
    use std::path::Path;

    const PERIOD_S: f64 = 0.001;
    /// Largest change of torque in a period \[N·m\].
    const STEP: f64 = 1.0;

    fn law() -> (ControlLaw, Vec<f64>, usize) {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/dd2/robot.toml");
        let robot = rivet_config::load(&file).expect("a valid robot file");
        let settings = &robot.config.controller;
        let gains = Gains::from_bandwidth(&settings.bandwidth_hz, settings.damping, settings.integral_hz);
        let (x, dof) = (robot.base_parameters().to_vec(), robot.dof());
        (ControlLaw::new(settings.law, robot.model, robot.base, &x, gains, PERIOD_S), x, dof)
    }

    /// Reference of a plan of accelerations of joint 1, which stands at the other one: `[q - plan, τ without friction]` in each period.
    fn references(accelerations: impl Iterator<Item = f64>) -> Vec<[f64; 2]> {
        let (mut law, x, dof) = law();
        let limits = Limits { torque: vec![150.0, 15.0], step: vec![STEP; dof] };
        let mut governor = Governor::new(&limits, &vec![[0.25, 1.0]; dof], PERIOD_S);
        let (mut plan, mut mass) = (Desired::default(), vec![0.0; dof * dof]);
        let mut reference = |a: f64| {
            plan.qdd[0] = a;
            let mut desired = plan;
            governor.apply(&mut desired, &mut law, &x, &mut mass, 1);
            let away = desired.q[0] - plan.q[0];
            let [_, tau] = law.model_torque_apart(&desired.q[..dof], &desired.qd[..dof], &desired.qdd[..dof], &x);
            plan.q[0] += plan.qd[0] * PERIOD_S + 0.5 * a * PERIOD_S * PERIOD_S;
            plan.qd[0] += a * PERIOD_S;
            [away, tau[0]]
        };
        accelerations.map(&mut reference).collect()
    }

    #[test]
    fn a_plan_within_the_rate_limit_is_the_reference() {
        let slow = references((0..1000).map(|k| (f64::from(k) * PERIOD_S).sin()));
        assert!(slow.iter().all(|[away, _]| *away == 0.0));
    }

    /// Acceleration in steps, as trapezoidal plans have it: the torque of the reference rises at half of the limit, the reference falls
    /// behind and comes back.
    #[test]
    fn a_step_of_the_torque_is_spread_and_the_reference_comes_back() {
        let steps = |k: u32| if (100..300).contains(&k) { 3.0 } else { 0.0 };
        let found = references((0..3000).map(steps));
        let fastest = found.windows(2).map(|w| (w[1][1] - w[0][1]).abs()).fold(0.0, f64::max);
        assert!(fastest <= 1.01 * RATE_SHARE * STEP, "{fastest} N m");
        let furthest = found.iter().map(|[away, _]| away.abs()).fold(0.0, f64::max);
        let last = found.last().map_or(f64::NAN, |[away, _]| away.abs());
        assert!(furthest > 1e-4 && furthest < 0.1 && last < 1e-6, "{furthest} and {last} rad");
    }

    /// Torque that was taken from feedback moves the reference of an arm at rest as it moves the arm, and the reference comes back.
    #[test]
    fn torque_that_was_taken_moves_the_reference() {
        let (mut law, x, dof) = law();
        let limits = Limits { torque: vec![150.0, 15.0], step: vec![STEP; dof] };
        let mut governor = Governor::new(&limits, &vec![[0.25, 1.0]; dof], PERIOD_S);
        let (mut mass, mut offsets) = (vec![0.0; dof * dof], Vec::new());
        for k in 0..3000 {
            let taken = [if k < 50 { -2.0 } else { 0.0 }, 0.0];
            let mut lacking = [0.0; MAX_JOINTS];
            lacking[..dof].copy_from_slice(&taken);
            governor.hedge(&lacking);
            let mut desired = Desired::default();
            governor.apply(&mut desired, &mut law, &x, &mut mass, 1);
            offsets.push(desired.q[0]);
        }
        let furthest = offsets.iter().copied().fold(0.0, f64::min);
        assert!(
            offsets[50] < 0.0 && furthest > -0.1 && offsets[2999].abs() < 1e-5,
            "{furthest} and {} rad",
            offsets[2999]
        );
    }

    /// Torque that is taken from feedback for long leads the reference away: feedback is to blame, and a plan that asks for it is.
    #[test]
    fn the_cause_of_a_reference_that_runs_away_is_named() {
        let (mut law, x, dof) = law();
        let limits = Limits { torque: vec![150.0, 15.0], step: vec![STEP; dof] };
        let mut mass = vec![0.0; dof * dof];
        for by_plan in [false, true] {
            let mut governor = Governor::new(&limits, &vec![[0.25, 1.0]; dof], PERIOD_S);
            let found = (0..3000).find_map(|k| {
                let (mut taken, mut desired) = ([0.0; MAX_JOINTS], Desired::default());
                if by_plan {
                    desired.qdd[0] = 60.0 * (0.03 * f64::from(k)).sin();
                } else {
                    taken[0] = 20.0;
                }
                governor.hedge(&taken);
                governor.apply(&mut desired, &mut law, &x, &mut mass, 1);
                let (joints, is_planned) = governor.beyond();
                (joints != 0).then_some(is_planned)
            });
            assert_eq!(found, Some(by_plan));
        }
    }
}
