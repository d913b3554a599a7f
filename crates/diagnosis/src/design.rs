//! Runs as equations: the background's columns, the torque that the nominal model leaves, weights and blocks.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rivet_dynamics::{Parameter, Workspace, friction_sign, mass_matrix};

use crate::background::{Nominal, standard_columns};
use crate::evidence::Background;
use crate::form::Form;
use crate::known;
use crate::log_fault::LogFault;
use crate::physics::{Physics, SMEARED_S, bodies};
use crate::policy::POLICY;
use crate::rows::{Chain, Column, column};
use crate::run::{Motion, Run};
use crate::signals;
use crate::silence;

/// Length of a block \[s\]: some ten times the correlation of residuals ...
const BLOCK_S: f64 = 2.5;
/// ... and shorter on short runs: held-out blocks need this many.
const MIN_FOLD_BLOCKS: f64 = 8.0;
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
        let position_noise: Vec<f64> = run.q.iter().map(|q| signals::position_noise(q, run.period_s)).collect();
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
        let noise = |t: &Vec<f64>| signals::white_noise_without(t, &run.interpolated) * chain.white_gain();
        let white: Vec<f64> = run.tau.iter().map(noise).collect();
        // Torque that the model makes of the position's noise.
        let made = position_noise.iter().zip(&inertias).map(|(sigma, inertia)| sigma * accel_gain * inertia);
        let least = tau.iter().map(|t| {
            POLICY.priors.min_torque_error_share * (t.iter().map(|t| t * t).sum::<f64>() / t.len().max(1) as f64).sqrt()
        });
        let floor = white.iter().zip(made).zip(least).map(|((white, made), least)| white.hypot(made).hypot(least));
        // What rounding to steps takes from a torque that no noise carries over them is no faster than the torque.
        let rounding = |tau: &Vec<f64>| signals::resolution(tau) / 12.0_f64.sqrt();
        let floor = floor.zip(&run.tau).map(|(floor, tau)| floor.max(rounding(tau))).collect();
        let silent = (0..n).map(|j| silence::detect(&tau[j], white[j], &motion, &chain, &nominal.x, j)).collect();
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
        match *form {
            // A body is columns that the model has already.
            Form::Payload => self.standard[10 * (n - 1)..10 * n].to_vec(),
            Form::LinkScale { link } => vec![self.body(link, &physics.nominal.x)],
            _ => self.made(form, physics),
        }
    }

    /// Columns beside the model's own that are nobody's fault: a small shift in time, and how softly friction turns over,
    /// a number that no data sheet has. Their sizes are unknown by [`unknown`].
    pub(crate) fn unnamed(&self, nominal: &Nominal, physics: &Physics) -> Vec<Column> {
        let mut columns = self.columns(&Form::Lag { stands: false }, physics);
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
            columns.extend((0..n).map(|j| joints(&[j], nominal.near[12 * n + j].abs())));
            columns.extend(coupled_motor(nominal).map(|(on, level)| joints(&on, level)));
        }
        columns
    }

    /// Torque of one link's body as `x` has it.
    fn body(&self, link: usize, x: &[f64]) -> Column {
        (0..self.tau.len())
            .map(|j| {
                let mut sum: Option<Vec<f64>> = None;
                for (column, x) in self.standard.iter().zip(x).skip(10 * link).take(10) {
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
            let level = nominal.near[12 * n + j].abs();
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
    nominal.near[10 * n + joint] + sum / picked.len().max(1) as f64
}

/// A stretch of rows of one run.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    pub(crate) run: usize,
    pub(crate) rows: Range<usize>,
}

/// The equations of several runs.
pub(crate) struct Design {
    /// `d[run][joint]`: rows x columns, each row times the root of its weight.
    pub(crate) d: Vec<Vec<DMatrix<f64>>>,
    /// Likewise the torque that the nominal model leaves.
    pub(crate) y: Vec<Vec<DVector<f64>>>,
    /// Root of each row's weight, `[run][joint][row]`.
    pub(crate) root: Vec<Vec<Vec<f64>>>,
    /// Columns that are not nothing, `[run][joint]`: a joint does not feel the links before it, nor others' friction.
    pub(crate) present: Vec<Vec<Vec<usize>>>,
    pub(crate) blocks: Vec<Block>,
    pub(crate) background: Background,
}

impl Design {
    /// `noise`: torque noise of each joint \[N·m\], to weigh doubt by. `extra[run]`: further columns with their prior
    /// standard deviations, such as timing.
    pub(crate) fn new(
        runs: &[&Prepared],
        nominal: &Nominal,
        noise: &[f64],
        extra: &[Vec<Column>],
        extra_std: &[f64],
    ) -> Design {
        let n = noise.len();
        let k = nominal.x.len() + extra_std.len();
        let mut design = Design {
            d: Vec::new(),
            y: Vec::new(),
            root: Vec::new(),
            present: Vec::new(),
            blocks: Vec::new(),
            background: Background {
                cells: Vec::new(),
                folds: Vec::new(),
                local: Vec::new(),
                std: DVector::from_iterator(k, nominal.std.iter().chain(extra_std).copied()),
                scaled: nominal
                    .model
                    .parameters
                    .iter()
                    .zip(&nominal.x)
                    .map(|(p, x)| match p {
                        Parameter::Link { .. } => true,
                        Parameter::Offset(_) => false,
                        // What the file gives as 0 was not measured badly, but not at all.
                        _ => *x != 0.0,
                    })
                    .chain(extra_std.iter().map(|_| false))
                    .collect(),
            },
        };
        let seconds: f64 = runs.iter().map(|r| r.run.seconds()).sum();
        let block_s = BLOCK_S.min(seconds / MIN_FOLD_BLOCKS);
        for (r, run) in runs.iter().enumerate() {
            let rows = run.rows();
            let root: Vec<Vec<f64>> = (0..n).map(|j| run.roots(j, noise[j])).collect();
            let mut d = Vec::with_capacity(n);
            let mut y = Vec::with_capacity(n);
            for j in 0..n {
                let mut matrix = DMatrix::zeros(rows, k);
                let mut torque = DVector::from_column_slice(&run.tau[j]);
                if let Some(known) = run.known_rows.get(j) {
                    torque.iter_mut().zip(known).for_each(|(l, k)| *l -= k);
                }
                for (c, column) in run.standard.iter().chain(&extra[r]).enumerate() {
                    let Some(values) = &column[j] else { continue };
                    for (row, value) in values.iter().enumerate() {
                        matrix[(row, c)] = value * root[j][row];
                    }
                    if let Some(x) = nominal.x.get(c) {
                        torque.iter_mut().zip(values).for_each(|(l, v)| *l -= v * x);
                    }
                }
                torque.iter_mut().zip(&root[j]).for_each(|(l, w)| *l *= w);
                d.push(matrix);
                y.push(torque);
            }
            let length = (block_s / run.chain.row_period_s).round().max(1.0) as usize;
            let count = (rows / length).max(1);
            design.blocks.extend((0..count).map(|b| Block { run: r, rows: b * rows / count..(b + 1) * rows / count }));
            design.d.push(d);
            design.y.push(y);
            design.root.push(root);
        }
        design.multiply();
        design
    }

    /// Weighs rows in doubt anew, against other torque noise of each joint \[N·m\].
    pub(crate) fn weigh_doubt(&mut self, runs: &[&Prepared], noise: &[f64]) {
        for (r, run) in runs.iter().enumerate() {
            for j in (0..noise.len()).filter(|j| run.silent[*j].is_none()) {
                let root = run.roots(j, noise[j]);
                let (d, y) = (&mut self.d[r][j], &mut self.y[r][j]);
                for (row, (new, old)) in root.iter().zip(&self.root[r][j]).enumerate() {
                    let factor = new / old;
                    d.row_mut(row).scale_mut(factor);
                    y[row] *= factor;
                }
                self.root[r][j] = root;
            }
        }
        self.multiply();
    }

    /// Roots of the weights of one joint's rows.
    pub(crate) fn root(&self, run: usize, joint: usize) -> &[f64] {
        &self.root[run][joint]
    }

    /// The left-hand side, to be put back after [`Design::add`].
    pub(crate) fn target(&self) -> Vec<Vec<DVector<f64>>> {
        self.y.clone()
    }

    /// Puts a left-hand side back.
    pub(crate) fn set_target(&mut self, y: Vec<Vec<DVector<f64>>>) {
        self.y = y;
        self.remultiply();
    }

    /// Adds torque \[N·m\], `rows[run][joint][row]`, to the measured one.
    pub(crate) fn add(&mut self, rows: &[Vec<Vec<f64>>]) {
        for ((y, root), rows) in self.y.iter_mut().zip(&self.root).zip(rows) {
            for ((y, root), rows) in y.iter_mut().zip(root).zip(rows) {
                for ((y, w), t) in y.iter_mut().zip(root).zip(rows) {
                    *y += w * t;
                }
            }
        }
        self.remultiply();
    }

    pub(crate) fn joints(&self) -> usize {
        self.root.first().map_or(0, Vec::len)
    }

    /// Torque of the background's stretches \[N·m\] with their coefficients, `[run][joint][row]`.
    pub(crate) fn local_torque(&self, coefficients: &[DVector<f64>]) -> Vec<Vec<Vec<f64>>> {
        let mut torque: Vec<Vec<Vec<f64>>> =
            self.root.iter().map(|run| run.iter().map(|root| vec![0.0; root.len()]).collect()).collect();
        for (stretch, c) in self.background.local.iter().zip(coefficients) {
            for (j, to) in torque[stretch.run].iter_mut().enumerate() {
                to[stretch.rows.clone()].copy_from_slice(&stretch.torque(j, c));
            }
        }
        torque
    }

    /// Makes a candidate part of the background: a mean other than zero moves to the left-hand side.
    pub(crate) fn adopt(&mut self, columns: &[Vec<Column>], mean: &[f64], std: &[f64]) {
        for (r, own) in columns.iter().enumerate() {
            for j in 0..self.joints() {
                let root = &self.root[r][j];
                let rows = root.len();
                let mut matrix = std::mem::replace(&mut self.d[r][j], DMatrix::zeros(0, 0));
                let k = matrix.ncols();
                matrix = matrix.resize_horizontally(k + own.len(), 0.0);
                for (c, column) in own.iter().enumerate() {
                    let Some(values) = &column[j] else { continue };
                    for row in 0..rows {
                        let weighted = values[row] * root[row];
                        matrix[(row, k + c)] = weighted;
                        self.y[r][j][row] -= mean[c] * weighted;
                    }
                }
                self.d[r][j] = matrix;
            }
        }
        let k = self.background.std.len();
        self.background.std = DVector::from_iterator(k + std.len(), self.background.std.iter().chain(std).copied());
        self.background.scaled.extend(std.iter().map(|_| false));
        self.multiply();
    }

    /// Undoes the last [`adopt`](Self::adopt), of as many columns as means.
    pub(crate) fn give_up(&mut self, mean: &[f64]) {
        let k = self.background.std.len() - mean.len();
        for (d, y) in self.d.iter_mut().flatten().zip(self.y.iter_mut().flatten()) {
            for (c, mean) in mean.iter().enumerate() {
                y.axpy(*mean, &d.column(k + c), 1.0);
            }
            *d = std::mem::replace(d, DMatrix::zeros(0, 0)).resize_horizontally(k, 0.0);
        }
        self.background.std = self.background.std.rows(0, k).into_owned();
        self.background.scaled.truncate(k);
        self.multiply();
    }

    /// Undoes an [`adopt`](Self::adopt) before others: the columns from `place` on, as many as means, are nothing from now on.
    pub(crate) fn forget(&mut self, form: &Form, place: usize, mean: &[f64]) {
        if matches!(form, Form::Force { .. }) {
            self.background.local.clear();
        }
        for (d, y) in self.d.iter_mut().flatten().zip(self.y.iter_mut().flatten()) {
            for (c, mean) in mean.iter().enumerate() {
                let column = d.column(place + c).into_owned();
                y.axpy(*mean, &column, 1.0);
                d.column_mut(place + c).fill(0.0);
            }
        }
        self.multiply();
    }

    /// Weighted residual of coefficients and of those of stretches, `[run][joint]`.
    pub(crate) fn residuals(&self, x: &DVector<f64>, stretches: &[DVector<f64>]) -> Vec<Vec<DVector<f64>>> {
        let run_residuals =
            |d: &Vec<DMatrix<f64>>, y: &Vec<DVector<f64>>| d.iter().zip(y).map(|(d, y)| y - d * x).collect();
        let mut all: Vec<Vec<DVector<f64>>> = self.d.iter().zip(&self.y).map(|(d, y)| run_residuals(d, y)).collect();
        for (stretch, c) in self.background.local.iter().zip(stretches) {
            for (j, left) in all[stretch.run].iter_mut().enumerate() {
                let root = &self.root[stretch.run][j];
                for (k, torque) in stretch.rows.clone().zip(stretch.torque(j, c)) {
                    left[k] -= root[k] * torque;
                }
            }
        }
        all
    }
}

/// Roots of rows' weights: one over the standard deviation of noise and doubt together, in units of the noise.
fn doubt_weights(doubt: &[f64], noise: f64) -> Vec<f64> {
    doubt.iter().map(|u| 1.0 / (1.0 + (u / noise).powi(2)).sqrt()).collect()
}

impl Prepared {
    /// Roots of the weights of joint `j`'s rows at a torque noise \[N·m\]; nothing where its torque says nothing.
    fn roots(&self, j: usize, noise: f64) -> Vec<f64> {
        if self.silent[j].is_some() { vec![0.0; self.rows()] } else { doubt_weights(&self.doubt[j], noise) }
    }
}

/// Most rows per independent row: a longer memory is an effect, not noise, and must not hide itself.
const LONGEST_MEMORY: f64 = 6.0;
/// Most lags that are looked at: of a longer log more of them would be a cost of its square.
const LAGS: usize = 500;

/// `1 + 2 Σ ρ_k` while the autocorrelation is positive: rows per independent row, at most [`LONGEST_MEMORY`].
pub(crate) fn correlation(records: &[&DVector<f64>]) -> f64 {
    let product = |lag: usize| -> f64 {
        records.iter().map(|e| e.iter().zip(e.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>()).sum()
    };
    let power = product(0);
    if power <= 0.0 {
        return 1.0;
    }
    let longest = (records.iter().map(|e| e.len()).min().unwrap_or(0) / 8).min(LAGS);
    let mut sum = 1.0;
    for lag in 1..longest {
        let share = product(lag) / power;
        // From the longest memory on nothing changes any more, and the work would grow with the square of the log.
        if share <= 0.0 || sum >= LONGEST_MEMORY {
            break;
        }
        sum += 2.0 * share;
    }
    sum.min(LONGEST_MEMORY)
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
