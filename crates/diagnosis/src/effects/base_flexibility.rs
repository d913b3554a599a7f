//! Base flexibility: what the arm stands on gives way. Its form, and candidates that the model filter passes and the motion excites.

use std::f64::consts::{PI, TAU};

use rivet_dynamics::{EffectKind, KnownEffect};

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::Full;
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::physics::base_mode::{LOWEST_MODE_HZ, Mode, Mounting};
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::model::rows::Chain;
use crate::model::run::derivative;
use crate::numerics::parallel;
use crate::policy::POLICY;

pub(super) const ABOUT: About = About {
    variable: [Variable::OwnTorque; 2],
    motion: "short moves that start and stop hard, with joint 1 at several angles, and rests after them",
    is_inexact: true,
    ..About::new("base_flexibility", Kind::Structure)
};

/// The base turns about a horizontal axis, per share that the arm has of what turns
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Base {
    pub(crate) mode: Mode,
}

impl Base {
    /// The form of an effect of a robot file, and the factor of its column.
    pub(super) fn from_file(effect: &KnownEffect) -> (Base, f64) {
        let mode = Mode::given(effect.values);
        (Base { mode }, mode.share)
    }
}

impl EffectForm for Base {
    fn effect(&self) -> Effect {
        Effect::BaseFlexibility
    }

    fn joints(&self) -> Vec<usize> {
        Vec::new()
    }

    fn inner_values(&self) -> usize {
        3
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![self.mode.column(p)]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::BaseFlexibility, 0, &self.mode.handed_on(c[0]))
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[
            ("frequency_hz", self.mode.hz),
            ("damping_ratio", self.mode.damping),
            ("compliance_rad_Nm", self.mode.compliance(c[0])),
            ("axis_heading_rad", self.mode.heading),
        ])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        Mode::plausible(c[0])
    }

    fn scaled(&self, [a, b, c]: [f64; 3]) -> Base {
        Base { mode: self.mode.moved(a, b, c.ln()) }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.07), (1, 1.6), (2, 1.5)]
    }

    fn settled(&self, c: f64) -> Option<Base> {
        self.mode.settled(c).map(|mode| Base { mode })
    }

    fn is_simulated(&self) -> bool {
        true
    }
}

/// Ratio of neighbouring frequencies.
const MODE_FREQUENCY_RATIO: f64 = 1.15;
/// Damping ratio of a candidate, and that at which motion must show a mode.
const MODE_DAMPING: f64 = 0.05;
const SHOWN_DAMPING: f64 = 0.1;
/// Directions of the axis over half a turn.
const AXIS_HEADINGS: usize = 4;
/// Time constants after which an oscillation has decayed.
const DECAY_TIME_CONSTANTS: f64 = 5.0;
/// Periods of the model filter's cut-off, beyond those that rows leave out, in which the end of a record is seen in the second
/// derivative of what a second derivative is in.
const END_PERIODS: f64 = 3.0;
/// The arm's share of the inertia that moves, where nothing is known.
const PRIOR_ARM_SHARE: f64 = 0.5;

/// Headings that are looked for.
fn headings() -> impl Iterator<Item = f64> {
    (0..AXIS_HEADINGS).map(|step| PI * step as f64 / AXIS_HEADINGS as f64)
}

/// One run, and which modes its motion shows.
struct Shown<'a> {
    mounting: &'a Mounting,
    chain: Chain,
    samples: usize,
    /// Acceleration of a base that merely follows the moment about x and y, as rows.
    follows: [Vec<f64>; 2],
}

impl<'a> Shown<'a> {
    fn new(p: &'a Physics<'_>) -> Option<Shown<'a>> {
        let (mounting, chain, samples) = (p.mounting()?, Chain::new(p.period_s()), p.samples());
        let twice = |m: &Vec<f64>| derivative(&derivative(m, mounting.period_s), mounting.period_s);
        let follows = [0, 1].map(|i: usize| chain.apply(&mounting.full(&twice(&mounting.moment[i]), samples)));
        Some(Shown { mounting, chain, samples, follows })
    }

    /// Whether motion shows the frequency, heading by heading: the base does more than follow the moment.
    fn headings(&self, hz: f64) -> Vec<bool> {
        // What rings since the beginning is not of the motion, and the inertia's change does not matter here: both axes at once.
        let axis = |heading: f64| {
            let inertia = self.mounting.means();
            let mode = Mode { hz, damping: SHOWN_DAMPING, heading, share: 0.0, inertia, highest_hz: hz };
            let [_, _, accel] = self.mounting.sway(&mode);
            self.chain.apply(&self.mounting.full(&accel, self.samples))
        };
        let accel = [axis(0.0), axis(0.5 * PI)];
        let row_s = self.chain.row_period_s;
        let over = (DECAY_TIME_CONSTANTS / (SHOWN_DAMPING * TAU * hz * row_s)) as usize;
        let end = (END_PERIODS / (self.chain.cutoff_hz() * row_s)).ceil() as usize;
        let rows = over..accel[0].len().saturating_sub(end).max(over);
        let is_shown = |heading: f64| {
            let (sin, cos) = heading.sin_cos();
            let turned = |of: &[Vec<f64>; 2], k: usize| cos * of[0][k] + sin * of[1][k];
            let (own, all) = rows.clone().fold((0.0, 0.0), |(own, all), k| {
                let whole = turned(&accel, k);
                (own + (whole + turned(&self.follows, k)).powi(2), all + whole.powi(2))
            });
            own > POLICY.plausibility.min_mode_share * POLICY.plausibility.min_mode_share * all
        };
        headings().map(is_shown).collect()
    }
}

/// Modes that one of the runs shows: the equations pass them, and the motion makes more of them than a base that only follows.
pub(crate) fn candidates(physics: &[Physics<'_>]) -> Vec<Base> {
    let Some(runs) = physics.iter().map(Shown::new).collect::<Option<Vec<Shown<'_>>>>() else { return Vec::new() };
    let highest_hz = POLICY.plausibility.max_mode_cutoff_share
        * runs.iter().map(|r| r.chain.cutoff_hz()).fold(f64::INFINITY, f64::min);
    let Some(first) = runs.first().filter(|_| highest_hz > LOWEST_MODE_HZ) else { return Vec::new() };
    let inertia = first.mounting.means();
    let next = |hz: &f64| Some(hz * MODE_FREQUENCY_RATIO).filter(|hz| *hz < highest_hz);
    let frequencies: Vec<f64> =
        std::iter::successors(Some(LOWEST_MODE_HZ * MODE_FREQUENCY_RATIO.sqrt()), next).collect();
    let shown = parallel::map(&frequencies, |hz| {
        let by_run: Vec<Vec<bool>> = runs.iter().map(|run| run.headings(*hz)).collect();
        (0..AXIS_HEADINGS).map(|at| by_run.iter().any(|run| run[at])).collect::<Vec<bool>>()
    });
    let mode = |hz: f64, heading: f64| Mode {
        hz,
        damping: MODE_DAMPING,
        heading,
        share: PRIOR_ARM_SHARE,
        inertia,
        highest_hz,
    };
    let modes_at = |(hz, shown): (&f64, Vec<bool>)| {
        let hz = *hz;
        headings().zip(shown).filter(|(_, s)| *s).map(move |(heading, _)| Base { mode: mode(hz, heading) })
    };
    frequencies.iter().zip(shown).flat_map(modes_at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Form;
    use crate::effects::joint_spring::Spring;
    use crate::effects::physics::base_mode::tests::{swinging, swinging_under};

    /// Ī of the arm is found, so that the arm's share is: with a compliance of half of 1/(Ī ω²) the base has as much itself.
    #[test]
    fn a_compliance_means_an_inertia_of_the_base() {
        swinging(5.0, 1e-3, |p| {
            let forms = candidates(std::slice::from_ref(p));
            let Some(Base { mode }) = forms.first() else { panic!("{forms:?}") };
            assert!(mode.inertia.iter().zip([2.0, 0.0, 2.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{mode:?}");
            let compliance = 0.5 / (2.0 * (TAU * mode.hz).powi(2));
            assert!((mode.compliance(0.5) / compliance - 1.0).abs() < 1e-12);
            assert!((mode.handed_on(0.5)[1] - 2.0).abs() < 1e-12);
            assert!(Mode::plausible(0.5) && !Mode::plausible(2.0) && !Mode::plausible(-0.5));
        });
    }

    /// Where gravity does not pull nobody holds against it; a spring may be there all the same.
    #[test]
    fn a_counterbalance_is_looked_for_where_gravity_pulls() {
        let found = |gravity: [f64; 3]| {
            swinging_under(gravity, 1.0, 1e-3, |p| {
                let forms = crate::effects::candidates::forms(std::slice::from_ref(p), &[Vec::new()]);
                let has = |wanted: fn(&Form) -> bool| forms.iter().any(wanted);
                [
                    has(|f| f.effect() == Effect::Counterbalance && !f.is_nameless()),
                    has(|f| f.get::<Spring>().is_some()),
                ]
            })
        };
        assert_eq!(found([0.0, 0.0, -9.81]), [true, true], "across");
        assert_eq!(found([0.0, -9.81, 0.0]), [false, true], "along");
        assert_eq!(found([0.0, -9.4, -2.8]), [true, true], "17 degrees off");
    }

    /// A swing of 5 Hz shows modes at that frequency and some way above, one of 0.3 Hz none; 10 samples a second pass none.
    #[test]
    fn only_what_filter_and_motion_show_is_looked_for() {
        let hz = |forms: Vec<Base>| -> Vec<f64> { forms.iter().map(|f| f.mode.hz).collect() };
        let fast = swinging(5.0, 1e-3, |p| hz(candidates(std::slice::from_ref(p))));
        assert!(fast.iter().any(|f| (4.0..6.0).contains(f)), "{fast:?}");
        assert!(fast.iter().all(|f| *f < 27.0), "{fast:?}");
        assert!(swinging(0.3, 1e-3, |p| candidates(std::slice::from_ref(p)).is_empty()));
        assert!(swinging(2.0, 0.1, |p| candidates(std::slice::from_ref(p)).is_empty()));
    }
}
