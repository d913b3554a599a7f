//! One step of simulated time: fourth-order Runge-Kutta between the instants at which a sliding joint comes to rest.

use crate::friction::{Friction, Phase};
use crate::mechanics::{Mechanics, Vector};
use rivet_dynamics::MAX_JOINTS;

/// Position and velocity of all joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct State {
    pub(crate) q: Vector,
    pub(crate) qd: Vector,
}

/// Most stops taken exactly in one step; a joint that chatters more than that is stopped at the step's end.
const MOST_STOPS: usize = 12;

/// Acceleration of the state under `tau`, phases of the friction as they are.
pub(crate) fn acceleration(mechanics: &mut Mechanics, friction: &Friction, state: &State, tau: &Vector) -> Vector {
    mechanics.factor(&state.q, &state.qd);
    let qdd = friction.acceleration(mechanics, mechanics.free_force(tau, &state.qd), &state.qd);
    mechanics.accelerated(&qdd);
    qdd
}

fn along(state: &State, qd: &Vector, qdd: &Vector, h: f64) -> State {
    let mut next = *state;
    for j in 0..MAX_JOINTS {
        next.q[j] += h * qd[j];
        next.qd[j] += h * qdd[j];
    }
    next
}

fn runge_kutta(mechanics: &mut Mechanics, friction: &Friction, s1: &State, tau: &Vector, h: f64) -> State {
    let a1 = acceleration(mechanics, friction, s1, tau);
    let s2 = along(s1, &s1.qd, &a1, 0.5 * h);
    let a2 = acceleration(mechanics, friction, &s2, tau);
    let s3 = along(s1, &s2.qd, &a2, 0.5 * h);
    let a3 = acceleration(mechanics, friction, &s3, tau);
    let s4 = along(s1, &s3.qd, &a3, h);
    let a4 = acceleration(mechanics, friction, &s4, tau);
    let mut end = *s1;
    for j in 0..MAX_JOINTS {
        end.q[j] += h / 6.0 * (s1.qd[j] + 2.0 * (s2.qd[j] + s3.qd[j]) + s4.qd[j]);
        end.qd[j] += h / 6.0 * (a1[j] + 2.0 * (a2[j] + a3[j]) + a4[j]);
    }
    end
}

/// The least of the sliding elements' velocities along their direction; negative once one has turned round.
fn margin(friction: &Friction, state: &State) -> f64 {
    friction
        .elements
        .iter()
        .map(|e| if let Phase::Slides(sign) = e.phase { sign * e.of(&state.qd) } else { f64::INFINITY })
        .fold(f64::INFINITY, f64::min)
}

/// Advances `state` by `h` seconds under constant joint torques `tau`.
pub(crate) fn advance(mechanics: &mut Mechanics, friction: &mut Friction, state: &mut State, tau: &Vector, h: f64) {
    let mut left = h;
    for stop in 0..=MOST_STOPS {
        mechanics.factor(&state.q, &state.qd);
        let free = mechanics.free_force(tau, &state.qd);
        friction.settle(mechanics, &free, &state.qd);
        let mut end = runge_kutta(mechanics, friction, state, tau, left);
        if margin(friction, &end) >= 0.0 {
            *state = end;
            return;
        }
        let mut taken = left;
        if stop < MOST_STOPS {
            (taken, end) = first_stop(mechanics, friction, state, tau, left, end);
        }
        let turned = end.qd;
        friction.stick(&mut end.qd, |e| matches!(e.phase, Phase::Slides(sign) if sign * e.of(&turned) < 0.0));
        *state = end;
        left -= taken;
        if left <= 0.0 {
            return;
        }
    }
}

/// Time and state just after the first element has turned round, known to lie within `(0, h]` with `end` the state at `h`.
fn first_stop(m: &mut Mechanics, f: &Friction, start: &State, tau: &Vector, h: f64, end: State) -> (f64, State) {
    let (mut low, mut g_low) = (0.0, margin(f, start));
    let (mut high, mut g_high, mut turned) = (h, margin(f, &end), end);
    for round in 0..40 {
        // Good enough: the velocity taken away is far below what an encoder or the energy balance can see.
        if g_high > -1e-12 || high - low < 1e-9 * h {
            break;
        }
        // The secant, and every third time the middle: an element that has just broken away has no slope to follow.
        let secant = low + (high - low) * g_low / (g_low - g_high);
        let t = if g_low > 0.0 && round % 3 != 2 { secant } else { 0.5 * (low + high) };
        let state = runge_kutta(m, f, start, tau, t);
        let g = margin(f, &state);
        if g < 0.0 {
            (high, g_high, turned) = (t, g, state);
        } else {
            (low, g_low) = (t, g);
        }
    }
    (high, turned)
}
