//! Refinement of inner values: from the grid to the largest log evidence.

use crate::effects::form::Form;
use crate::effects::physics::Physics;
use crate::effects::two_mass::Gear;
use crate::fit::evidence::Solved;
use crate::fit::search::{Candidate, Search, Standing};

/// Steps of each inner value, halved so many times.
const REFINEMENT_HALVINGS: usize = 5;

/// A form whose inner values are multiplied by `factors`.
fn scaled(form: &Form, factors: [f64; 3]) -> Form {
    let [a, b, c] = factors;
    match form.clone() {
        Form::Stribeck { joint, velocity } => Form::Stribeck { joint, velocity: velocity * a },
        Form::Presliding { joint, length } => Form::Presliding { joint, length: length * a },
        Form::Hysteresis { joint, length } => Form::Hysteresis { joint, length: length * a },
        Form::Delay { seconds } => Form::Delay { seconds: seconds * a },
        Form::Ripple { joint, order } => Form::Ripple { joint, order: order * a },
        Form::TransmissionError { joint, order } => Form::TransmissionError { joint, order: order * a },
        Form::Saturation { joint, limit } => Form::Saturation { joint, limit: limit * a },
        // Lengths by factors, angles by steps, also where a pull begins: e to the first makes one radian.
        Form::Counterbalance { joint, arm, phase } => {
            Form::Counterbalance { joint, arm: arm * a, phase: phase + b.ln() }
        }
        Form::Softening { joint, about, width } => Form::Softening { joint, about: about + a.ln(), width: width * b },
        Form::Pull { joint, from, above } => Form::Pull { joint, from: from + a.ln(), above },
        Form::Warming { joint, warmth } => Form::Warming { joint, warmth: warmth.moved(a, b.ln()) },
        Form::TwoMass { joint, gear } => {
            let gear = Gear { stiffness: gear.stiffness * a, damping: gear.damping * b, gap: gear.gap * c };
            Form::TwoMass { joint, gear }
        }
        Form::Base { mode } => Form::Base { mode: mode.moved(a, b, c.ln()) },
        other => other,
    }
}

/// First step of each inner value as a factor; none for forms without.
fn steps(form: &Form) -> Vec<(usize, f64)> {
    match form {
        Form::Stribeck { .. } | Form::Delay { .. } => vec![(0, 1.3)],
        Form::Presliding { .. } | Form::Hysteresis { .. } => vec![(0, 1.6)],
        Form::Ripple { order, .. } | Form::TransmissionError { order, .. } => vec![(0, 1.0 + 0.2 / order)],
        Form::Saturation { .. } => vec![(0, 1.04)],
        Form::Warming { .. } => vec![(0, 1.5), (1, 1.65)],
        Form::Counterbalance { .. } => vec![(1, 1.3), (0, 1.3)],
        Form::Pull { .. } => vec![(0, 1.15)],
        Form::Softening { .. } => vec![(0, 1.15), (1, 1.3)],
        Form::TwoMass { gear, .. } if gear.gap > 0.0 => vec![(2, 1.4), (0, 1.6), (1, 1.6)],
        Form::TwoMass { .. } => vec![(0, 1.13), (1, 1.6)],
        Form::Base { .. } => vec![(0, 1.07), (1, 1.6), (2, 1.5)],
        _ => Vec::new(),
    }
}

impl Search<'_> {
    /// The form with the inner values that the evidence prefers, found by coordinate search from those given.
    pub(crate) fn refine(&self, start: &Form, physics: &[Physics<'_>]) -> Option<(Candidate, Standing)> {
        self.refine_over(start, physics, &self.scales())
    }

    /// The same over a background that is solved already.
    pub(crate) fn refine_over(
        &self,
        start: &Form,
        physics: &[Physics<'_>],
        solved: &[(f64, Solved)],
    ) -> Option<(Candidate, Standing)> {
        let judge = |form: Form| -> Option<(Candidate, Standing)> {
            let candidate = self.candidate(form, physics)?;
            let standing = self.standing(0, &candidate, solved)?;
            let settled = match candidate.form {
                Form::Base { mode } => mode.settled(standing.added.c[0]),
                _ => None,
            };
            let again = settled.and_then(|mode| {
                let candidate = self.candidate(Form::Base { mode }, physics)?;
                let standing = self.standing(0, &candidate, solved)?;
                Some((candidate, standing))
            });
            Some(again.unwrap_or((candidate, standing)))
        };
        let best = judge(start.clone())?;
        Some(climb(best, REFINEMENT_HALVINGS, |(candidate, _)| &candidate.form, |(_, standing)| standing.gain, judge))
    }
}

/// What is best along the inner values of a form, one after another, in steps that are halved so many times; `score` says how good
/// it is, `judge` makes it.
pub(crate) fn climb<T>(
    mut best: T,
    halvings: usize,
    form: impl Fn(&T) -> &Form,
    score: impl Fn(&T) -> f64,
    judge: impl Fn(Form) -> Option<T>,
) -> T {
    let mut sizes = steps(form(&best));
    for _ in 0..halvings {
        for (place, size) in &sizes {
            for direction in [1.0, -1.0] {
                // Along one coordinate as long as it helps, but not without end.
                for _ in 0..4 {
                    let mut factors = [1.0; 3];
                    factors[*place] = size.powf(direction);
                    let Some(next) = judge(scaled(form(&best), factors)) else { break };
                    if score(&next) <= score(&best) + 1e-6 {
                        break;
                    }
                    best = next;
                }
            }
        }
        for (_, size) in &mut sizes {
            *size = size.sqrt();
        }
    }
    best
}
