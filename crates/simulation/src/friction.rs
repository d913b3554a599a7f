//! Dry friction that really sticks.
//!
//! Coulomb friction is set-valued at standstill: whatever holds the joint, up to the Coulomb level. Each friction element is
//! therefore stuck (its velocity is exactly zero and its torque a constraint force) or slides one way (its torque is the
//! level, against the motion). `settle` decides between the two for all elements at rest at once; the integrator finds the
//! instants at which sliding ends. Nothing creeps, and nothing depends on a regularisation velocity.

use crate::mechanics::{Mechanics, Vector};
use rivet_dynamics::MAX_JOINTS;

/// How dry friction depends on velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrictionLaw {
    /// Coulomb's law with exact sticking.
    Stick,
    /// `tanh(v / velocity)` \[rad/s\]: no sticking; a joint held by less than the level creeps at `velocity * atanh(load / level)`.
    Smooth {
        /// Velocity at which friction has 76 % of its level \[rad/s\].
        velocity: f64,
    },
}

/// What an element does at the moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Phase {
    /// Velocity zero.
    Stuck,
    /// Moves (or is about to) in the direction of this sign.
    Slides(f64),
    /// No hard friction here.
    Free,
}

/// Friction on the velocity of joint `a`, or of `a` and `b` together (a motor that turns with both).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Element {
    pub(crate) a: usize,
    pub(crate) b: Option<usize>,
    /// Coulomb level \[N·m\].
    pub(crate) coulomb: f64,
    /// Level that acts as hard friction now: the Coulomb level under `FrictionLaw::Stick`, and the brake \[N·m\].
    pub(crate) hard: f64,
    pub(crate) phase: Phase,
    /// Whether effects add to it ([`Mechanics::dry`]).
    pub(crate) varies: bool,
    /// Torque of the last `settle` on this element, the start of the next.
    lambda: f64,
}

/// Most elements: one a joint and one for a coupled motor.
pub(crate) const MAX_ELEMENTS: usize = MAX_JOINTS + 1;

impl Element {
    pub(crate) fn new(a: usize, b: Option<usize>, coulomb: f64) -> Self {
        Self { a, b, coulomb, hard: 0.0, phase: Phase::Free, varies: false, lambda: 0.0 }
    }

    /// The element's velocity when the joints' are `v`; of any joint vector, its projection.
    pub(crate) fn of(&self, v: &Vector) -> f64 {
        v[self.a] + self.b.map_or(0.0, |b| v[b])
    }

    /// What effects add to its level in the direction `sign`.
    fn more(&self, mechanics: &Mechanics, sign: f64) -> f64 {
        if self.varies { mechanics.dry(self.a, sign) } else { 0.0 }
    }

    /// Its hard level in the direction `sign`; none under a smooth law, but for a brake's.
    fn level(&self, mechanics: &Mechanics, law: FrictionLaw, sign: f64) -> f64 {
        let more = if law == FrictionLaw::Stick { self.more(mechanics, sign) } else { 0.0 };
        (self.hard + more).max(0.0)
    }

    /// Adds `torque` on the element to the joint torques `f`.
    fn apply(&self, torque: f64, f: &mut Vector) {
        f[self.a] += torque;
        if let Some(b) = self.b {
            f[b] += torque;
        }
    }

    /// Acceleration of the element for a unit torque on it \[1/(kg·m²)\].
    pub(crate) fn mobility(&self, mechanics: &Mechanics) -> f64 {
        self.of(&self.response(mechanics))
    }

    /// `M⁻¹` times the element's direction.
    fn response(&self, mechanics: &Mechanics) -> Vector {
        let mut x = [0.0; MAX_JOINTS];
        self.apply(1.0, &mut x);
        mechanics.solve(&mut x);
        x
    }
}

/// All dry friction of the arm.
#[derive(Clone, Debug)]
pub(crate) struct Friction {
    pub(crate) elements: Vec<Element>,
    law: FrictionLaw,
}

impl Friction {
    pub(crate) fn new(elements: Vec<Element>, law: FrictionLaw) -> Self {
        debug_assert!(elements.len() <= MAX_ELEMENTS);
        Self { elements, law }
    }

    /// Sets the hard levels with `brake` \[N·m\] added to each joint, and the phases from the velocities.
    pub(crate) fn set_brake(&mut self, brake: &Vector, qd: &Vector) {
        for element in &mut self.elements {
            let own = if self.law == FrictionLaw::Stick { element.coulomb } else { 0.0 };
            element.hard = own + if element.b.is_none() { brake[element.a] } else { 0.0 };
            let v = element.of(qd);
            element.phase = match () {
                () if element.hard <= 0.0 && !(element.varies && self.law == FrictionLaw::Stick) => Phase::Free,
                () if v == 0.0 => Phase::Stuck,
                () => Phase::Slides(v.signum()),
            };
        }
    }

    /// Acceleration \[rad/s²\] in the present phases for the free force `f`; `mechanics` holds the factor of the state.
    pub(crate) fn acceleration(&self, mechanics: &Mechanics, mut f: Vector, qd: &Vector) -> Vector {
        for element in &self.elements {
            if let FrictionLaw::Smooth { velocity } = self.law {
                let v = element.of(qd);
                let level = (element.coulomb + element.more(mechanics, v.signum())).max(0.0);
                element.apply(-level * (v / velocity).tanh(), &mut f);
            }
            if let Phase::Slides(sign) = element.phase {
                element.apply(-element.level(mechanics, self.law, sign) * sign, &mut f);
            }
        }
        let mut a = f;
        mechanics.solve(&mut a);
        self.constrain(mechanics, &mut a);
        a
    }

    /// Removes the acceleration of stuck elements by constraint forces: `a -= M⁻¹Aᵀ (A M⁻¹ Aᵀ)⁻¹ A a`, row by row with
    /// each row's response made orthogonal to those before (a row that these already hold is skipped).
    fn constrain(&self, mechanics: &Mechanics, a: &mut Vector) {
        let mut held: [(Vector, f64, usize); MAX_ELEMENTS] = [([0.0; MAX_JOINTS], 0.0, 0); MAX_ELEMENTS];
        let mut count = 0;
        for (k, element) in self.elements.iter().enumerate() {
            if element.phase != Phase::Stuck {
                continue;
            }
            let mut x = element.response(mechanics);
            let scale = element.of(&x);
            for (before, weight, row) in &held[..count] {
                let part = self.elements[*row].of(&x) / weight;
                for j in 0..MAX_JOINTS {
                    x[j] -= part * before[j];
                }
            }
            let weight = element.of(&x);
            if weight > 1e-9 * scale {
                // x leaves the rows before at rest, so their accelerations stay zero.
                let part = element.of(a) / weight;
                for j in 0..MAX_JOINTS {
                    a[j] -= part * x[j];
                }
                held[count] = (x, weight, k);
                count += 1;
            }
        }
        for element in &self.elements {
            // Rounding must not move a stuck joint.
            if element.phase == Phase::Stuck && element.b.is_none() {
                a[element.a] = 0.0;
            }
        }
    }

    /// Decides for every element at rest whether the free force `f` breaks it away: the box-constrained complementarity
    /// problem of the torques within their levels that leave no acceleration, by projected Gauss-Seidel.
    pub(crate) fn settle(&mut self, mechanics: &Mechanics, f: &Vector, qd: &Vector) {
        if !self.elements.iter().any(|element| element.phase == Phase::Stuck) {
            return;
        }
        // Acceleration with the known torques and the last torques of those at rest.
        let mut a = *f;
        for element in &self.elements {
            if let FrictionLaw::Smooth { velocity } = self.law {
                let v = element.of(qd);
                let level = (element.coulomb + element.more(mechanics, v.signum())).max(0.0);
                element.apply(-level * (v / velocity).tanh(), &mut a);
            }
            match element.phase {
                Phase::Slides(sign) => element.apply(-element.level(mechanics, self.law, sign) * sign, &mut a),
                Phase::Stuck => element.apply(element.lambda, &mut a),
                Phase::Free => {}
            }
        }
        mechanics.solve(&mut a);
        let mut response = [[0.0; MAX_JOINTS]; MAX_ELEMENTS];
        for (element, x) in self.elements.iter().zip(&mut response) {
            if element.phase == Phase::Stuck {
                *x = element.response(mechanics);
            }
        }
        for _ in 0..400 {
            let mut change = 0.0_f64;
            for (element, x) in self.elements.iter_mut().zip(&response) {
                if element.phase != Phase::Stuck {
                    continue;
                }
                // Against motion forward it pulls back, by the level of that direction.
                let (back, on) = (element.level(mechanics, self.law, 1.0), element.level(mechanics, self.law, -1.0));
                let torque = (element.lambda - element.of(&a) / element.of(x)).clamp(-back, on);
                let step = torque - element.lambda;
                element.lambda = torque;
                for j in 0..MAX_JOINTS {
                    a[j] += step * x[j];
                }
                change = change.max((step * element.of(x)).abs());
            }
            if change < 1e-11 {
                break;
            }
        }
        for element in &mut self.elements {
            if element.phase == Phase::Stuck {
                let left = element.of(&a);
                let hard = element.level(mechanics, self.law, -element.lambda.signum());
                // At its level and still accelerating: it breaks away. The threshold is far under any real acceleration.
                if element.lambda.abs() >= hard && left * element.lambda < 0.0 && left.abs() > 1e-9 {
                    element.phase = Phase::Slides(left.signum());
                }
            } else {
                element.lambda = 0.0;
            }
        }
    }

    /// Sticks every element that has come to rest, or that `ended` says has.
    pub(crate) fn stick(&mut self, qd: &mut Vector, ended: impl Fn(&Element) -> bool) {
        for k in 0..self.elements.len() {
            let element = self.elements[k];
            if matches!(element.phase, Phase::Slides(_)) && ended(&element) {
                // What is left of the velocity is the rounding of the instant; it goes to the joint that is not held already.
                let a_held = element.b.is_some_and(|_| self.holds(element.a));
                match element.b {
                    Some(b) if a_held => qd[b] = -qd[element.a],
                    Some(b) => qd[element.a] = -qd[b],
                    None => qd[element.a] = 0.0,
                }
                self.elements[k].phase = Phase::Stuck;
            }
        }
        for element in &mut self.elements {
            if matches!(element.phase, Phase::Slides(_)) && element.of(qd) == 0.0 {
                element.phase = Phase::Stuck;
            }
        }
    }

    fn holds(&self, joint: usize) -> bool {
        self.elements.iter().any(|e| e.b.is_none() && e.a == joint && e.phase == Phase::Stuck)
    }
}
