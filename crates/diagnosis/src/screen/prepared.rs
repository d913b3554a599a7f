//! A run prepared for the fit: the torque and the standard columns as filtered rows, noise floors, and the doubt about friction near rest.

use std::ops::Range;

use rivet_dynamics::{Parameter, Places, Workspace, friction_sign, mass_matrix};

use crate::effects::Form;
use crate::effects::current_loop_lag::Lag;
use crate::effects::known;
use crate::effects::link_inertia::LinkScale;
use crate::effects::payload::Payload;
use crate::effects::physics::{Physics, SMEARED_S, bodies};
use crate::model::log_fault::LogFault;
use crate::model::nominal::{Nominal, standard_columns};
use crate::model::rows::{Chain, Column, column};
use crate::model::run::{Motion, Run};
use crate::policy::POLICY;
use crate::screen::signal_faults;
use crate::screen::silent_channel;

/// Friction may turn over this many times more softly than the model says, or at once; ...
const SOFTER: f64 = 3.0;
/// ... as softly as this \[rad/s\] where the model says at once; ...
const SOFT: f64 = 0.02;

/// One run, prepared.
pub(crate) struct Prepared {
    pub(crate) run: Run,
    pub(crate) motion: Motion,
    pub(crate) chain: Chain,
    /// Measured torque \[N·m\], `[joint][row]`.
    pub(crate) tau: Vec<Vec<f64>>,
    /// Torque of the effects that the model as given has \[N·m\], at the rate of the log and as rows; empty without.
    pub(crate) known: Vec<Vec<f64>>,
    pub(crate) known_rows: Vec<Vec<f64>>,
    /// Joints whose torque says nothing, and why: their rows count nowhere.
    pub(crate) silent: Vec<Option<LogFault>>,
    /// Standard columns.
    pub(crate) standard: Vec<Column>,
    /// Noise of the torque signal after the model filter \[N·m\], from what changes too fast to be torque.
    pub(crate) floor: Vec<f64>,
    /// What steps or noise of the position leave unknown of it \[rad\], and of the speed \[rad/s\], twice the deviation.
    pub(crate) position_noise: Vec<f64>,
    pub(crate) blur: Vec<f64>,
    /// Doubt about the friction torque near standstill \[N·m\], `[joint][row]`.
    pub(crate) doubt: Vec<Vec<f64>>,
}

impl Prepared {
    pub(crate) fn new(run: Run, nominal: &Nominal) -> Prepared {
        let chain = Chain::new(run.period_s);
        Prepared::by(chain, run, nominal)
    }

    /// The same run by a slower model filter \[Hz\].
    pub(crate) fn up_to(&self, hz: f64, nominal: &Nominal) -> Prepared {
        let run = Prepared::by(Chain::up_to(hz, self.run.period_s), self.run.clone(), nominal);
        Prepared { silent: self.silent.clone(), ..run }
    }

    /// With rows made by `chain`.
    pub(crate) fn by(chain: Chain, run: Run, nominal: &Nominal) -> Prepared {
        let motion = Motion::from_run(&run);
        let tau: Vec<Vec<f64>> = run.tau.iter().map(|t| chain.apply(t)).collect();
        let standard = standard_columns(&nominal.model, &motion, &chain);
        let n = run.joints();
        let v0 = nominal.model.structure.sign_velocity;
        let position_noise: Vec<f64> = run.q.iter().map(|q| signal_faults::position_noise(q, run.period_s)).collect();
        let [speed_gain, accel_gain] = noise_gains(&chain, run.period_s);
        let blur: Vec<f64> = position_noise.iter().map(|sigma| 2.0 * sigma * speed_gain).collect();
        let inertias: Vec<f64> = (0..n).map(|j| inertia(nominal, &motion, j)).collect();
        let surfaces = Surface::all(nominal, &motion, &blur, &inertias);
        let doubt = (0..n)
            .map(|j| {
                let filtered = |surface: &Surface| chain.apply(&surface.doubt(&motion, run.period_s, v0));
                let rows: Vec<Vec<f64>> = surfaces.iter().filter(|s| s.joints.contains(&j)).map(filtered).collect();
                (0..tau[j].len()).map(|k| rows.iter().map(|rows| rows[k].abs()).sum()).collect()
            })
            .collect();
        let effects = nominal.model.effects().list();
        let known = if effects.is_empty() { Vec::new() } else { known::torque(nominal, effects, &run, &motion) };
        let known_rows = known.iter().map(|t| chain.apply(t)).collect();
        let noise = |t: &Vec<f64>| signal_faults::white_noise_without(t, &run.interpolated) * chain.white_gain();
        let white: Vec<f64> = run.tau.iter().map(noise).collect();
        // Torque that the model makes of the position's noise.
        let made = position_noise.iter().zip(&inertias).map(|(sigma, inertia)| sigma * accel_gain * inertia);
        let least = tau.iter().map(|t| {
            POLICY.priors.min_torque_error_share * (t.iter().map(|t| t * t).sum::<f64>() / t.len().max(1) as f64).sqrt()
        });
        let floor = white.iter().zip(made).zip(least).map(|((white, made), least)| white.hypot(made).hypot(least));
        // What rounding to steps takes from a torque that no noise carries over them is no faster than the torque.
        let rounding = |tau: &Vec<f64>| signal_faults::resolution(tau) / 12.0_f64.sqrt();
        let floor = floor.zip(&run.tau).map(|(floor, tau)| floor.max(rounding(tau))).collect();
        let silent =
            (0..n).map(|j| silent_channel::detect(&tau[j], white[j], &motion, &chain, &nominal.x, j)).collect();
        Prepared { run, motion, chain, tau, known, known_rows, silent, standard, floor, position_noise, blur, doubt }
    }

    /// The torque's rows as they are where it comes `samples` later than position; what is beyond the ends repeats them.
    pub(crate) fn shift_torque(&mut self, samples: isize) {
        let last = self.run.len().saturating_sub(1);
        let at = |k: usize| k.saturating_add_signed(samples).min(last);
        let shifted = |t: &Vec<f64>| (0..t.len()).map(|k| t[at(k)]).collect::<Vec<f64>>();
        self.tau = self.run.tau.iter().map(|t| self.chain.apply(&shifted(t))).collect();
    }

    /// Prepared anew with each joint's torque taken so many samples later; the end repeats what was last.
    pub(crate) fn later(&self, samples: &[isize], nominal: &Nominal) -> Prepared {
        let last = self.run.len().saturating_sub(1);
        let moved = |tau: &Vec<f64>, by: isize| -> Vec<f64> {
            (0..tau.len()).map(|k| tau[k.saturating_add_signed(by).min(last)]).collect()
        };
        let tau = self.run.tau.iter().zip(samples).map(|(tau, by)| moved(tau, *by)).collect();
        let run = Run { tau, ..self.run.clone() };
        Prepared { silent: self.silent.clone(), ..Prepared::by(self.chain.clone(), run, nominal) }
    }

    pub(crate) fn rows(&self) -> usize {
        self.tau.first().map_or(0, Vec::len)
    }

    /// What the form adds to this run's torque, filtered: `[column][joint]`.
    pub(crate) fn columns(&self, form: &Form, physics: &Physics<'_>) -> Vec<Column> {
        let n = self.tau.len();
        // A body is columns that the model has already.
        if form.get::<Payload>().is_some() {
            return self.standard[Places::link(n - 1)].to_vec();
        }
        form.get()
            .map_or_else(|| self.made(form, physics), |LinkScale { link }| vec![self.body(*link, &physics.nominal.x)])
    }

    /// Columns beside the model's own that are nobody's fault: a small shift in time, and how softly friction turns over,
    /// a number that no data sheet has. Their sizes are unknown by [`unknown`].
    pub(crate) fn unnamed(&self, nominal: &Nominal, physics: &Physics) -> Vec<Column> {
        let mut columns = self.columns(&Lag { stands: false }.into(), physics);
        let v0 = nominal.model.structure.sign_velocity;
        let n = self.run.joints();
        for [narrow, wide] in turns(v0) {
            let joints = |on: &[usize], level: f64| -> Column {
                let turn = |v: f64| level * (friction_sign(v, wide) - friction_sign(v, narrow));
                let speed = |k: usize| on.iter().map(|j| self.motion.qd[*j][k]).sum::<f64>();
                let full: Vec<f64> = (0..self.motion.len()).map(|k| turn(speed(k))).collect();
                let rows = self.chain.apply(&full);
                (0..n).map(|j| on.contains(&j).then(|| rows.clone())).collect()
            };
            columns.extend((0..n).map(|j| joints(&[j], nominal.near[Places::new(n).coulomb(j)].abs())));
            columns.extend(coupled_motor(nominal).map(|(on, level)| joints(&on, level)));
        }
        columns
    }

    /// Torque of one link's body as `x` has it.
    fn body(&self, link: usize, x: &[f64]) -> Column {
        (0..self.tau.len())
            .map(|j| {
                let mut sum: Option<Vec<f64>> = None;
                for (column, x) in self.standard[Places::link(link)].iter().zip(&x[Places::link(link)]) {
                    let Some(values) = &column[j] else { continue };
                    let sum = sum.get_or_insert_with(|| vec![0.0; values.len()]);
                    sum.iter_mut().zip(values).for_each(|(s, v)| *s += x * v);
                }
                sum.filter(|sum| sum.iter().any(|v| *v != 0.0))
            })
            .collect()
    }

    fn made(&self, form: &Form, physics: &Physics<'_>) -> Vec<Column> {
        form.columns(physics).into_iter().map(|full| column(&self.chain, full)).collect()
    }
}

/// What rubs: a joint, or a motor that turns with the sum of two.
struct Surface {
    joints: Vec<usize>,
    /// Friction torque \[N·m\].
    level: f64,
    /// Inertia that it stops \[kg·m²\].
    inertia: f64,
    /// What is unknown of its speed \[rad/s\].
    blur: f64,
}

impl Surface {
    fn all(nominal: &Nominal, motion: &Motion, blur: &[f64], inertias: &[f64]) -> Vec<Surface> {
        let n = motion.joints();
        let joint = |j: usize| {
            let level = nominal.near[Places::new(n).coulomb(j)].abs();
            Surface { joints: vec![j], level, inertia: inertias[j], blur: blur[j] }
        };
        let mut all: Vec<Surface> = (0..n).map(joint).collect();
        if let Some((joints, level)) = coupled_motor(nominal) {
            let inertia = inertias[joints[0]].min(inertias[joints[1]]);
            let blur = blur[joints[0]].hypot(blur[joints[1]]);
            all.push(Surface { joints: joints.to_vec(), level, inertia, blur });
        }
        all
    }

    fn sum(&self, of: &[Vec<f64>], k: usize) -> f64 {
        self.joints.iter().map(|j| of[*j][k]).sum()
    }

    /// Doubt about its torque, sample by sample \[N·m\].
    fn doubt(&self, motion: &Motion, period_s: f64, v0: f64) -> Vec<f64> {
        // Friction alone slows it down by so much in a second.
        let slows = self.level / self.inertia.max(1e-9);
        // What it stops from within a sample the log does not show, but for what the model's own turn shows of it.
        let stopped = (slows * period_s - v0).max(0.0);
        // None where it may stand, and carry any torque up to its friction.
        let at = |k: usize| {
            let unsure =
                self.blur.max(POLICY.priors.min_sure_speed_rad_s) + 0.5 * period_s * self.sum(&motion.qdd, k).abs();
            let v = self.sum(&motion.qd, k);
            let half = unsure + stopped;
            (v.abs() > unsure + slows * SMEARED_S)
                .then(|| 0.5 * self.level * (friction_sign(v + half, v0) - friction_sign(v - half, v0)).abs())
        };
        let each: Vec<Option<f64>> = (0..motion.len()).map(at).collect();
        // Its torque is one unknown value for as long as it stands: longer says no more of anything.
        let rows = |stretch: &[Option<f64>]| {
            let more = (stretch.len() as f64 * period_s / POLICY.priors.max_held_torque_s).max(1.0).sqrt();
            let value = move |doubt: &Option<f64>| doubt.unwrap_or(more * self.level);
            stretch.iter().map(value).collect::<Vec<f64>>()
        };
        each.chunk_by(|a, b| a.is_some() == b.is_some()).flat_map(rows).collect()
    }
}

/// The two joints whose sum a motor turns with, driving one first, and its friction torque \[N·m\].
fn coupled_motor(nominal: &Nominal) -> Option<([usize; 2], f64)> {
    let coupling = nominal.model.structure.coupling?;
    let at = nominal.model.parameters.iter().position(|p| *p == Parameter::CouplingCoulomb)?;
    Some(([coupling.driving, coupling.driven], nominal.near[at].abs()))
}

/// Pairs of speeds \[rad/s\] between which friction may turn over, for a model in which it does at `v0`.
fn turns(v0: f64) -> Vec<[f64; 2]> {
    if v0 > 0.0 { vec![[0.0, v0 * SOFTER], [0.0, v0]] } else { vec![[0.0, SOFT]] }
}

/// Standard deviations of the sizes of [`Prepared::unnamed`].
pub(crate) fn unknown(nominal: &Nominal, period_s: f64) -> Vec<f64> {
    let surfaces = nominal.model.arm.dof() + usize::from(coupled_motor(nominal).is_some());
    let turns = turns(nominal.model.structure.sign_velocity).len() * surfaces;
    std::iter::once(POLICY.priors.timing_samples * period_s)
        .chain(std::iter::repeat_n(POLICY.priors.friction_turn, turns))
        .collect()
}

/// Where the columns of how softly friction turns over stand: behind the model's own and that of time.
pub(crate) fn turn_columns(nominal: &Nominal) -> Range<usize> {
    let model_columns = nominal.x.len();
    model_columns + 1..model_columns + unknown(nominal, 1.0).len()
}

/// Standard deviations of speed at the rate of the log and of rows of acceleration, for white noise of 1 on positions.
fn noise_gains(chain: &Chain, period_s: f64) -> [f64; 2] {
    let samples = (4.0 / period_s) as usize;
    let mut q = vec![0.0; samples];
    q[samples / 2] = 1.0;
    let pulse = Run { name: String::new(), period_s, q: vec![q], tau: Vec::new(), ..Run::default() };
    let motion = Motion::from_run(&pulse);
    let size = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Rows come every second mean: a sample in between leaves as much, spread over others.
    let rows = (2.0 * chain.average() as f64).sqrt() * size(&chain.apply(&motion.qdd[0]));
    [size(&motion.qd[0]), rows]
}

/// Mean inertia at a joint, drive included.
fn inertia(nominal: &Nominal, motion: &Motion, joint: usize) -> f64 {
    let (arm, n) = (&nominal.model.arm, motion.joints());
    let links = bodies(&nominal.x, n);
    let mut ws = Workspace::new(arm);
    let mut m = vec![0.0; n * n];
    let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let picked: Vec<usize> = (0..motion.len()).step_by((motion.len() / 50).max(1)).collect();
    let sum: f64 = picked
        .iter()
        .map(|k| {
            motion.state(*k, &mut q, &mut qd, &mut qdd);
            mass_matrix(arm, &links, &mut ws, &q, &mut m);
            m[joint * n + joint]
        })
        .sum();
    nominal.near[Places::new(n).rotor_inertia(joint)] + sum / picked.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dwell of ten seconds weighs as one of a second does, and less than a moment of motion.
    #[test]
    fn a_joint_that_stands_holds_one_torque_for_as_long() {
        const PERIOD_S: f64 = 0.005;
        let moves = [(true, 200), (false, 2000), (true, 200), (false, 20), (true, 200)];
        let qd: Vec<f64> = moves.iter().flat_map(|(on, rows)| vec![if *on { 0.5 } else { 0.0 }; *rows]).collect();
        let still = vec![vec![0.0; qd.len()]];
        let motion = Motion { period_s: PERIOD_S, q: still.clone(), qd: vec![qd], qdd: still };
        let surface = Surface { joints: vec![0], level: 7.0, inertia: 5.0, blur: 0.0 };
        let doubt = surface.doubt(&motion, PERIOD_S, 0.0);
        assert!(doubt[..200].iter().chain(&doubt[2200..2400]).all(|d| *d == 0.0), "its direction is known");
        assert!(doubt[2400..2420].iter().all(|d| *d == 7.0), "a short stop is as much in doubt as its friction");
        // Information of the dwell: of rows at 1/doubt² each.
        let information: f64 = doubt[200..2200].iter().map(|d| 1.0 / (d * d)).sum();
        let least = POLICY.priors.max_held_torque_s / PERIOD_S / 49.0;
        assert!((information / least - 1.0).abs() < 1e-9, "{information} of {least}");
    }
}
