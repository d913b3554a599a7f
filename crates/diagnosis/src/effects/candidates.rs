//! Candidates: every effect on every joint that it can act on, with a grid of inner values.
//!
//! Effects that depend on more than one run have modules of their own: `warming_candidates` and `base_candidates`.

use crate::effects::base_candidates;
use crate::effects::form::Form;
use crate::effects::physics::Physics;
use crate::effects::two_mass::Gear;
use crate::model::standstill;
use crate::policy::POLICY;

/// Speeds of the Stribeck curve \[rad/s\].
const STRIBECK: [f64; 6] = [0.01, 0.02, 0.04, 0.08, 0.16, 0.32];
/// Lengths of presliding springs \[rad\].
const PRESLIDING: [f64; 6] = [3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.08];
/// Lengths of a hysteresis beside friction \[rad\].
const HYSTERESIS: [f64; 4] = [0.06, 0.15, 0.4, 1.0];
/// Orders of friction over the joint's turn.
const FRICTION_ORDERS: [f64; 3] = [1.0, 2.0, 3.0];
/// Delays \[s\].
const DELAYS: [f64; 8] = [0.001, 0.0015, 0.002, 0.003, 0.004, 0.006, 0.009, 0.014];
/// First resonance with the motor held: lowest, highest \[Hz\] and steps between them.
const RESONANCES: (f64, f64, usize) = (2.5, 45.0, 24);
/// Damping ratio of the gear.
const DAMPINGS: [f64; 3] = [0.02, 0.08, 0.25];
/// Play \[rad\].
const GAPS: [f64; 6] = [3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2];
/// Contact resonance of a gear with play \[Hz\].
const CONTACTS: [f64; 3] = [12.0, 30.0, 75.0];
/// Damping ratio of the contact.
const CONTACT_DAMPING: f64 = 0.25;
/// Limits of torque, as a share of the largest that the model needs.
const LIMITS: [f64; 5] = [0.7, 0.8, 0.9, 0.95, 1.0];
/// Distance ratios of a counterbalance's two hinges.
const LEVERS: [f64; 2] = [0.3, 0.7];
/// Angles between them at zero.
const PHASES: usize = 6;
/// Parts of a joint's range at whose ends something may begin to pull.
const PULLS: usize = 5;
/// Angles over which a spring that softens gives way \[rad\].
const WIDTHS: [f64; 2] = [0.15, 0.4];

/// All forms for runs, orders of ripple from `orders[joint]`; none for no run.
pub(crate) fn forms(runs: &[Physics<'_>], orders: &[Vec<f64>]) -> Vec<Form> {
    let Some(first) = runs.first() else { return Vec::new() };
    let n = first.joints();
    let mut forms = vec![Form::Gravity, Form::Payload, Form::Lag { stands: false }, Form::Lag { stands: true }];
    forms.extend(DELAYS.map(|seconds| Form::Delay { seconds }));
    for joint in 0..n {
        forms.extend([
            Form::Asymmetry { joint },
            Form::OneSided { joint, forwards: true },
            Form::OneSided { joint, forwards: false },
            Form::ViscousNonlinearity { joint },
            Form::Load { joint },
            Form::Gain { joint },
            Form::TorqueLaw { joint },
            Form::EncoderOffset { joint },
            Form::PositionScale { joint },
            Form::Constant { joint },
            Form::Eccentricity { joint },
            Form::LinkScale { link: joint },
            Form::RotorInertia { joint },
            Form::Coulomb { joint },
            Form::Viscous { joint },
        ]);
        if runs.iter().any(|p| p.run.temperature.is_some()) {
            forms.push(Form::Temperature { joint });
        }
        forms.extend(STRIBECK.map(|velocity| Form::Stribeck { joint, velocity }));
        forms.extend(PRESLIDING.map(|length| Form::Presliding { joint, length }));
        forms.extend(HYSTERESIS.map(|length| Form::Hysteresis { joint, length }));
        forms.extend(FRICTION_ORDERS.map(|order| Form::PositionFriction { joint, order }));
        forms.extend(limits(runs, joint).into_iter().map(|limit| Form::Saturation { joint, limit }));
        forms.extend(orders[joint].iter().flat_map(|order| periodic(joint, *order)));
        forms.extend(gears(inertia(runs, joint)).into_iter().map(|gear| Form::TwoMass { joint, gear }));
        // What one joint holds while its neighbour stands no motor brings it.
        let moves = |p: &Physics<'_>, j: usize| !standstill::is_still(p.motion, j);
        let together = joint > 0 && runs.iter().any(|p| moves(p, joint - 1) && moves(p, joint));
        if together && first.nominal.model.structure.coupling.is_none() {
            forms.extend([false, true].map(|whole| Form::Coupling { driving: joint - 1, driven: joint, whole }));
        }
        let (low, high) = span(runs.iter().flat_map(|p| &p.motion.q[joint]));
        // Within a small angle any torque is a straight line, and as large as one likes.
        if high - low < POLICY.plausibility.min_angle_law_range_rad {
            continue;
        }
        let about = 0.5 * (low + high);
        forms.extend([Form::Spring { joint }, Form::AngleLaw { joint, about }]);
        if let Some((before, beside)) = joint.checked_sub(1).and_then(|j| Some((j, middle(runs, j)?))) {
            forms.push(Form::SpringBetween { joints: [before, joint], about: [beside, about] });
        }
        // Where gravity does not pull nobody holds against it.
        if joint > 0 || !first.nominal.model.arm.is_upright() {
            forms.push(Form::Counterweight { joint });
            for arm in LEVERS {
                for step in 0..PHASES {
                    let phase = std::f64::consts::TAU * step as f64 / PHASES as f64;
                    forms.push(Form::Counterbalance { joint, arm, phase });
                }
            }
        }
        for step in 1..PULLS {
            let from = low + (high - low) * step as f64 / PULLS as f64;
            forms.extend(WIDTHS.map(|width| Form::Softening { joint, about: from, width }));
            forms.extend([true, false].map(|above| Form::Pull { joint, from, above }));
        }
    }
    forms
}

/// Elastic gears, then gears with play, before a link side of that inertia \[kg·m²\].
fn gears(link: f64) -> Vec<Gear> {
    let stiffness = |hz: f64| link * (std::f64::consts::TAU * hz).powi(2);
    let (low, high, steps) = RESONANCES;
    let mut gears = Vec::new();
    for step in 0..=steps {
        let hz = low * (high / low).powf(step as f64 / steps as f64);
        gears.extend(DAMPINGS.map(|damping| Gear { stiffness: stiffness(hz), damping, gap: 0.0 }));
    }
    for hz in CONTACTS {
        gears.extend(GAPS.map(|gap| Gear { stiffness: stiffness(hz), damping: CONTACT_DAMPING, gap }));
    }
    gears
}

/// Whether the runs go far enough beyond `from` to tell what pulls from there on.
pub(crate) fn is_reached(runs: &[Physics<'_>], joint: usize, from: f64, above: bool) -> bool {
    let (low, high) = span(runs.iter().flat_map(|p| &p.motion.q[joint]));
    let beyond = if above { high - from } else { from - low };
    beyond >= POLICY.plausibility.min_pull_reach_share * (high - low)
}

/// The form itself, then all forms of the same effect on the same joints.
pub(crate) fn alike(form: &Form, physics: &Physics<'_>) -> Vec<Form> {
    let orders = vec![form.order().into_iter().collect(); physics.joints()];
    let same = |other: &Form| {
        other.effect() == form.effect() && other.joints() == form.joints() && other != form && !other.is_nameless()
    };
    let run = std::slice::from_ref(physics);
    let modes = if let Form::Base { .. } = form { base_candidates::forms(run) } else { Vec::new() };
    std::iter::once(form.clone()).chain(forms(run, &orders).into_iter().chain(modes).filter(same)).collect()
}

/// What repeats with an order of the joint's angle.
pub(crate) fn periodic(joint: usize, order: f64) -> [Form; 3] {
    [Form::Ripple { joint, order }, Form::TransmissionError { joint, order }, Form::PositionFriction { joint, order }]
}

/// Limits at which a joint's torque may be cut, given what the model needs at most. A command that is beyond a limit nearly all the
/// time moves no arm: torque that the model does not know is no cut.
fn limits(runs: &[Physics<'_>], joint: usize) -> Vec<f64> {
    let top =
        |signals: &dyn Fn(&Physics<'_>) -> Vec<f64>| runs.iter().flat_map(signals).fold(0.0_f64, |m, t| m.max(t.abs()));
    let (asked, needed) = (top(&|p| p.run.tau[joint].clone()), top(&|p| p.torque[joint].clone()));
    LIMITS
        .map(|share| share * needed)
        .into_iter()
        .filter(|limit| asked > POLICY.plausibility.min_command_over_limit * limit && is_cut(runs, joint, *limit))
        .collect()
}

/// Whether a limit cuts the command of a joint now and then while it moves, not for most of the time nor in single samples.
pub(crate) fn is_cut(runs: &[Physics<'_>], joint: usize, limit: f64) -> bool {
    let signals = runs.iter().flat_map(|p| p.run.tau[joint].iter().zip(&p.motion.qd[joint]));
    let moving: Vec<f64> = signals
        .filter(|(_, qd)| qd.abs() > POLICY.signal_faults.max_still_speed_rad_s)
        .map(|(tau, _)| tau.abs())
        .collect();
    let beyond = |limit: f64| moving.iter().filter(|tau| **tau > limit).count() as f64 / moving.len().max(1) as f64;
    beyond(limit) < POLICY.plausibility.max_cut_time_share
        && beyond(POLICY.plausibility.min_command_over_limit * limit) > POLICY.plausibility.min_cut_time_share
}

fn span<'a>(x: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    x.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)))
}

/// Middle of a joint's angles; none where it hardly turns.
fn middle(runs: &[Physics<'_>], joint: usize) -> Option<f64> {
    let (low, high) = span(runs.iter().flat_map(|p| &p.motion.q[joint]));
    (high - low >= POLICY.plausibility.min_angle_law_range_rad).then_some(0.5 * (low + high))
}

/// Mean inertia of the link side at a joint.
fn inertia(runs: &[Physics<'_>], joint: usize) -> f64 {
    let samples: usize = runs.iter().map(Physics::samples).sum();
    let sum: f64 = runs.iter().flat_map(|p| &p.mass()[joint][joint]).sum();
    sum / samples.max(1) as f64
}
