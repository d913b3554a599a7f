//! What is wrong with a log before anything is compared with a model: faults that would be sold as effects.

use std::f64::consts::TAU;
use std::ops::Range;

use rivet_dynamics::Model;

use crate::background::Nominal;
use crate::computed;
use crate::design::Prepared;
use crate::rows::Chain;
use crate::run::{Motion, Run};
use crate::signals;
use crate::swapped;

/// Correlation of torque with speed below which a joint would make energy: over a motion that comes back, what bodies
/// and gravity take they give again, and friction only takes.
const MAKES_ENERGY: f64 = -0.3;
/// Unless torque and model correlate by more.
const LIKE_THE_MODEL: f64 = 0.5;
/// Correlation with the model's torque below which it is the model's with the other sign, where friction takes nothing either: a
/// model that hangs the wrong way round has the sign of gravity wrong, not that of friction.
const UNLIKE_THE_MODEL: f64 = -0.7;
/// A torque this many times the model's (or one over it) is in another unit ...
const OTHER_UNIT: f64 = 3.0;
/// ... (this many times where the file knows of no friction: 150 kg on a KR300 are 3.2 times the torque of axis 3 without it; ...
const LOADED: f64 = 5.0;
/// ... this many where all but this share of the squares is friction, which may be anything) ...
const ALL_FRICTION: f64 = 10.0;
const FELT: f64 = 0.05;
/// ... if it is the model's torque but for the factor.
const SAME_SHAPE: f64 = 0.9;
/// What heavier bodies leave, squared, as a share of what another unit does, at most, where a load is the better explanation.
const CLEARLY_LESS: f64 = 0.7;
/// From this factor on it is as well where bodies and drive are both off by it, ...
const TWICE: f64 = 1.8;
/// ... by the same but for this share, ...
const SAME_FACTOR: f64 = 0.1;
/// ... each makes this share of the torque, so that neither is what the file has wrong, ...
const BOTH_FELT: f64 = 0.2;
/// ... and the model's torque times that is the measured one, by their correlation.
const WHOLE_SHAPE: f64 = 0.985;
/// Speed below which a joint stands still \[rad/s\].
pub(crate) const STILL: f64 = 0.02;
/// A joint that moves does so for at least so long \[s\].
const IN_MOTION_S: f64 = 0.5;
/// Steps of torque worth a word, as a share of its rms.
const COARSE: f64 = 0.05;
/// Speeds that are not known to this are worth a word \[rad/s\].
const MUCH_BLUR: f64 = 3e-3;
/// Samples in a row at the largest torque that are a limit, and the share of all samples that such stretches make up.
const FLAT: usize = 5;
const FLAT_SHARE: f64 = 0.005;
/// So many times as many as stand a step below: a rounded torque that turns has 2.4 times as many on its last step.
const MORE: f64 = 5.0;

/// A fault of one joint's signals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LogFault {
    /// The joint's torque runs against its motion: friction would give energy. Correlation of torque and speed.
    Sign(f64),
    /// The torque is the model's with the other sign, and not one that friction takes. Correlation of the two.
    Opposite(f64),
    /// With the position's sign turned, a rigid arm with friction explains the torque of all joints far better.
    PositionSign {
        /// What it misses as logged, root mean square of all joints over what can be known of them (noise and 2 % of the torque) ...
        as_logged: f64,
        /// ... and with the sign turned.
        turned: f64,
    },
    /// The torque is the model's times this.
    Scale(f64),
    /// The joint moves and its torque is next to nothing.
    Silent {
        /// Root mean square of the torque in motion \[N·m\].
        carries: f64,
        /// What friction and rotor take in that motion by the file \[N·m\].
        due: f64,
    },
    /// The torque stands at its largest value \[N·m\] for stretches of time.
    Limit(f64),
    /// Torque is known in steps of this size only \[N·m\].
    Coarse(f64),
    /// By the model the torque is that of another joint, from 0, whose torque is this one's.
    Swapped(usize),
    /// Of the gravity that the bodies as given have on the joint the torque carries this share: it was taken out.
    Weightless(f64),
    /// Positions and torques are those of another joint, from 0, whose are this one's.
    Exchanged(usize),
    /// Torque comes more slowly than the log's rows and is held in between: the run is looked at as often as it comes.
    TorqueHeld {
        /// Rows for which a torque is held.
        samples: usize,
        /// \[s\]
        seconds: f64,
    },
    /// Bodies alone along the desired motion miss this share of the torque: it was computed, not measured.
    Computed(f64),
    /// The joint moves no faster than this \[rad/s\].
    Still(f64),
    /// The torque comes so much after the motion that it makes \[s\]: it is taken so much later.
    Late(f64),
    /// The torque went through a low-pass of about this time constant \[s\], slower than the model filter.
    Filtered(f64),
    /// Single samples of torque far beyond what is around them, replaced by that.
    Spikes {
        /// How many.
        samples: usize,
        /// The largest \[N·m\].
        torque: f64,
    },
    /// The position leaves its path for a few samples so many times; a line is put there.
    Glitches(usize),
    /// The angle wraps so many times; unwrapped.
    Wrapped(usize),
    /// The position jumps and stays: the run is cut there.
    Jump {
        /// When \[s\].
        at: f64,
        /// By how much \[rad\].
        by: f64,
    },
    /// All channels repeat though the joint moved before: the run is cut there.
    Frozen {
        /// Since when \[s\].
        from: f64,
        /// How long \[s\].
        seconds: f64,
    },
    /// Positions come more slowly than the log's rows and are held in between: the run is looked at as often as they come.
    Held {
        /// Rows for which a position is held.
        samples: usize,
        /// \[s\]
        seconds: f64,
    },
    /// Positions are known to this standard deviation \[rad\], which hides the direction of slow motion.
    Steps {
        /// \[rad\]
        position: f64,
        /// Speed below which the direction is not sure \[rad/s\].
        speed: f64,
    },
}

impl LogFault {
    /// Of a joint in motion.
    ///
    /// * `dissipates`: cosine of torque and speed
    /// * `alike`: cosine of torque and the model's
    /// * `scale`: torque over the model's, least squares
    pub fn of_torque(dissipates: f64, alike: f64, scale: f64) -> Option<LogFault> {
        // A motion that does not come back may give more energy to gravity than friction takes; the model knows of that.
        if dissipates < MAKES_ENERGY && alike < LIKE_THE_MODEL {
            Some(LogFault::Sign(dissipates))
        } else if alike < UNLIKE_THE_MODEL && dissipates < 0.0 {
            Some(LogFault::Opposite(alike))
        } else if alike > SAME_SHAPE && !(1.0 / OTHER_UNIT..OTHER_UNIT).contains(&scale) {
            Some(LogFault::Scale(scale))
        } else {
            None
        }
    }

    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            LogFault::Sign(_) | LogFault::Opposite(_) => "torque_sign",
            LogFault::PositionSign { .. } => "position_sign",
            LogFault::Scale(_) => "torque_scale",
            LogFault::Silent { .. } => "torque_silent",
            LogFault::Limit(_) => "torque_limit",
            LogFault::Coarse(_) => "torque_coarse",
            LogFault::Swapped(_) => "torque_swapped",
            LogFault::Weightless(_) => "torque_without_gravity",
            LogFault::Exchanged(_) => "joints_exchanged",
            LogFault::TorqueHeld { .. } => "torque_held",
            LogFault::Computed(_) => "torque_computed",
            LogFault::Still(_) => "too_little_motion",
            LogFault::Late(_) => "torque_late",
            LogFault::Filtered(_) => "torque_filtered",
            LogFault::Spikes { .. } => "torque_spikes",
            LogFault::Glitches(_) => "position_glitches",
            LogFault::Wrapped(_) => "position_wrapped",
            LogFault::Jump { .. } => "position_jump",
            LogFault::Frozen { .. } => "frozen",
            LogFault::Held { .. } => "position_held",
            LogFault::Steps { .. } => "position_steps",
        }
    }

    /// Its figure: see the variants; what a silent channel carries.
    pub fn value(self) -> f64 {
        match self {
            LogFault::Silent { carries, .. } => carries,
            LogFault::Glitches(count) | LogFault::Wrapped(count) => count as f64,
            LogFault::Swapped(other) | LogFault::Exchanged(other) => (other + 1) as f64,
            LogFault::Spikes { torque: v, .. }
            | LogFault::Jump { by: v, .. }
            | LogFault::Frozen { seconds: v, .. }
            | LogFault::Held { seconds: v, .. }
            | LogFault::TorqueHeld { seconds: v, .. }
            | LogFault::Weightless(v)
            | LogFault::Steps { position: v, .. }
            | LogFault::PositionSign { as_logged: v, .. }
            | LogFault::Sign(v)
            | LogFault::Opposite(v)
            | LogFault::Scale(v)
            | LogFault::Limit(v)
            | LogFault::Coarse(v)
            | LogFault::Computed(v)
            | LogFault::Late(v)
            | LogFault::Filtered(v)
            | LogFault::Still(v) => v,
        }
    }

    /// Whether it was found by what all joints say, so that nothing that the joint alone seems to have stands in its place.
    fn is_of_the_whole(&self) -> bool {
        matches!(
            self,
            LogFault::PositionSign { .. } | LogFault::Swapped(_) | LogFault::Exchanged(_) | LogFault::Weightless(_)
        )
    }

    /// Whether the torque of the joint cannot be believed.
    pub fn spoils(self) -> bool {
        matches!(
            self,
            LogFault::Sign(_)
                | LogFault::Opposite(_)
                | LogFault::PositionSign { .. }
                | LogFault::Scale(_)
                | LogFault::Silent { .. }
                | LogFault::Filtered(_)
                | LogFault::Swapped(_)
                | LogFault::Exchanged(_)
                | LogFault::Weightless(_)
        )
    }

    /// What a person would say.
    pub fn text(self) -> String {
        match self {
            LogFault::Sign(v) => format!(
                "torque runs against motion (correlation {v:.2}): its friction would generate energy, so the sign of \
                 this torque or position, or the scale, is wrong"
            ),
            LogFault::Opposite(v) => format!(
                "torque opposes the model's (correlation {v:.2}) and friction explains none of it: the sign of this \
                 torque, or of this position, is wrong"
            ),
            LogFault::PositionSign { as_logged, turned } => format!(
                "the sign of this position is wrong: the residual of a rigid arm with friction is {} times the noise \
                 over all joints as logged, and {} times with the other sign; not evaluated",
                digits(as_logged),
                digits(turned)
            ),
            LogFault::Scale(v) => format!("torque is {} times the model's: another unit or gear ratio?", digits(v)),
            LogFault::Silent { carries: 0.0, .. } => {
                "torque is 0 while the joint moves: the channel is dead or was not recorded".to_owned()
            }
            LogFault::Silent { carries, due } => format!(
                "torque in motion is {carries:.2e} N m where friction and rotor of the file alone take {due:.3} N m: the \
                 channel is dead, or it is a sensor or a computation without the drive"
            ),
            LogFault::Limit(v) => format!("torque stays at its limit of {v:.3} N m for periods of time"),
            LogFault::Coarse(v) => format!("torque is quantised in steps of {v:.3} N m: smaller changes are unknown"),
            LogFault::Swapped(other) => format!(
                "by the model this is the torque of joint {}, and that column has the torque of this joint: are two \
                 columns exchanged?",
                other + 1
            ),
            LogFault::Exchanged(other) => format!(
                "by the model these are position and torque of joint {}, and that joint has those of this one: are \
                 two joints exchanged?",
                other + 1
            ),
            LogFault::Weightless(v) => format!(
                "torque carries {:.0} % of the gravity that the bodies have here: it seems to be compensated for gravity (an \
                 effort without it, a command before the compensation is added); log the whole torque",
                100.0 * v
            ),
            LogFault::TorqueHeld { samples, seconds } => {
                format!("torque is held for {samples} rows, {:.1} ms: the log is used at that rate", 1e3 * seconds)
            }
            LogFault::Computed(v) => format!(
                "torque was computed along the desired motion, not measured: bodies alone leave {:.2} % of it there; \
                 is there a motor current (torque_from in robot.toml)?",
                100.0 * v
            ),
            LogFault::Late(v) => format!(
                "torque comes {:.1} ms after its motion, which no drive does (another clock, a filter?): shifted by \
                 that time, in whole samples",
                1e3 * v
            ),
            LogFault::Filtered(v) => format!(
                "torque went through a low-pass of about {:.0} Hz and position did not: not evaluated; log it unfiltered, or both \
                 through the same filter",
                1.0 / (TAU * v)
            ),
            LogFault::Spikes { samples, torque } => format!(
                "{samples} sample{} of torque far from those around, {torque:.1} N m at most: replaced by the \
                 neighbouring values",
                if samples == 1 { "" } else { "s" }
            ),
            LogFault::Glitches(count) => {
                format!(
                    "position leaves its path {count} time{} for a few samples: interpolated",
                    if count == 1 { "" } else { "s" }
                )
            }
            LogFault::Wrapped(count) => {
                format!("angle wraps {count} time{}: unwrapped", if count == 1 { "" } else { "s" })
            }
            LogFault::Jump { at, by } => {
                format!(
                    "position jumps by {by:.3} rad at {at:.2} s and stays: the log is cut \
                     there, its longest part is used"
                )
            }
            LogFault::Frozen { from, seconds } => format!(
                "all channels are constant for {seconds:.2} s from {from:.2} s on although the joint moved: the log \
                 is cut there, its longest part is used"
            ),
            LogFault::Held { samples, seconds } => {
                format!("positions are held for {samples} rows, {:.1} ms: the log is used at that rate", 1e3 * seconds)
            }
            LogFault::Steps { position, speed } => format!(
                "position is known to {position:.1e} rad only (steps or noise): below {speed:.3} rad/s the direction \
                 of motion, and of friction, is unknown"
            ),
            LogFault::Still(v) => format!("moves no faster than {v:.4} rad/s: its friction is not identifiable"),
        }
    }
}

/// Two significant digits.
fn digits(v: f64) -> String {
    if v.abs() < 0.095 { format!("{v:.1e}") } else { format!("{v:.2}") }
}

/// A fault and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct LogFinding {
    /// The run's name.
    pub run: String,
    /// The joint's name.
    pub joint: String,
    /// What is wrong.
    pub fault: LogFault,
}

/// Joints of a run whose torque was computed, not measured; none of a sound run.
pub(crate) fn computed(model: &Model, run: &Run) -> Vec<LogFinding> {
    let finding = |misses: &computed::Misses| LogFinding {
        run: run.name.clone(),
        joint: model.arm.joints[misses.joint].name.clone(),
        fault: LogFault::Computed(misses.desired),
    };
    computed::joints(&model.arm, run).iter().map(finding).collect()
}

/// Torque that cannot be believed counts nowhere.
pub(crate) fn distrust(run: &mut Prepared, nominal: &Nominal) {
    for (a, b) in swapped::pairs(run, nominal) {
        run.silent[a] = Some(LogFault::Swapped(b));
        run.silent[b] = Some(LogFault::Swapped(a));
    }
    for finding in check(run, nominal).into_iter().filter(|f| f.fault.spoils()) {
        if let Some(j) = nominal.model.arm.joints.iter().position(|joint| joint.name == finding.joint) {
            run.silent[j] = Some(finding.fault);
        }
    }
}

/// Joints that stand throughout the sealed run count nowhere on it where friction alone may hold all of their torque: whatever is missed
/// there tells of no model. (Of a motion of one joint, which a diagnosis had asked for, the arm was told to miss 352 % of its torque with the
/// right spring, and that joint 3 %.)
pub(crate) fn leave_out_held(run: &mut Prepared, nominal: &Nominal) {
    let joints = run.tau.len();
    for j in (0..joints).filter(|j| is_still(&run.motion, *j)) {
        let rms = (dot(&run.tau[j], &run.tau[j]) / run.rows().max(1) as f64).sqrt();
        if run.silent[j].is_none() && rms < nominal.x[12 * joints + j].abs() {
            run.silent[j] = Some(LogFault::Still(top_speed(&run.motion, j)));
        }
    }
}

/// Whether no joint that moves is left of which the torque can be believed.
pub(crate) fn is_unheard(runs: &[Prepared]) -> bool {
    !runs.iter().any(|run| (0..run.silent.len()).any(|j| run.silent[j].is_none() && !is_still(&run.motion, j)))
}

/// Faults of one run, joint by joint.
pub(crate) fn check(run: &Prepared, nominal: &Nominal) -> Vec<LogFinding> {
    let mut found = Vec::new();
    for (j, joint) in nominal.model.arm.joints.iter().enumerate() {
        let mut say = |fault| found.push(LogFinding { run: run.run.name.clone(), joint: joint.name.clone(), fault });
        if is_still(&run.motion, j) {
            say(LogFault::Still(top_speed(&run.motion, j)));
            continue;
        }
        let links = 10 * run.silent.len();
        let (bodies, drive) = (of_values(run, nominal, j, 0..links), of_drive(run, nominal, j));
        // Torque of 1 kg at the flange.
        let at_flange = run.standard[links - 10][j].as_deref();
        let modelled: Vec<f64> = bodies.iter().zip(&drive).map(|(b, d)| b + d).collect();
        let (tau, speed) = (&run.tau[j], run.chain.sample(&run.motion.qd[j]));
        let cosine = |a: &[f64], b: &[f64]| dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(f64::MIN_POSITIVE);
        let dissipates = cosine(tau, &speed);
        let whole = dot(tau, &modelled) / dot(&modelled, &modelled).max(f64::MIN_POSITIVE);
        // Friction that is another than the file's is no other unit: what is beside it says so too, where it is felt.
        let beside = [speed.clone(), speed.iter().map(|v| v.signum()).collect()];
        let (own, due) = (apart(tau, &beside), apart(&modelled, &beside));
        let rest = dot(&own, &due) / dot(&due, &due).max(f64::MIN_POSITIVE);
        let felt = dot(&due, &due) > FELT * dot(&modelled, &modelled);
        let n = run.silent.len();
        let unknown = [11, 12].iter().all(|at| nominal.x[at * n + j] == 0.0);
        let least = if !felt {
            ALL_FRICTION
        } else if unknown {
            LOADED
        } else {
            OTHER_UNIT
        };
        let off = |scale: f64| !(1.0 / least..least).contains(&scale);
        let scale = if felt && unknown { rest } else { whole };
        let unit = off(scale) && (!felt || off(rest)) && !is_load(tau, &bodies, at_flange, &drive);
        let scale = if unit { scale } else { 1.0 };
        let turned = run.silent[j].filter(LogFault::is_of_the_whole);
        let told = turned.or_else(|| LogFault::of_torque(dissipates, cosine(tau, &modelled), scale));
        let told = told.or_else(|| factor(tau, &bodies, &drive).map(LogFault::Scale));
        if let Some(fault) = told.or(run.silent[j]) {
            say(fault);
        }
        if run.blur[j] > MUCH_BLUR {
            say(LogFault::Steps { position: run.position_noise[j], speed: run.blur[j] });
        }
        let step = signals::resolution(&run.run.tau[j]);
        let rms = (dot(tau, tau) / tau.len().max(1) as f64).sqrt();
        if step > COARSE * rms {
            say(LogFault::Coarse(step));
        }
        // In coarse steps every turn stands for a while.
        if let Some(limit) = limit(&run.run.tau[j], step).filter(|limit| step < COARSE * limit) {
            say(LogFault::Limit(limit));
        }
    }
    found
}

/// Rows of joint `j`'s torque by the file's bodies, drive and known effects.
pub(crate) fn of_file(run: &Prepared, nominal: &Nominal, j: usize) -> Vec<f64> {
    let bodies = of_values(run, nominal, j, 0..10 * run.silent.len());
    bodies.iter().zip(of_drive(run, nominal, j)).map(|(body, drive)| body + drive).collect()
}

fn of_drive(run: &Prepared, nominal: &Nominal, j: usize) -> Vec<f64> {
    let mut torque = of_values(run, nominal, j, 10 * run.silent.len()..nominal.x.len());
    if let Some(known) = run.known_rows.get(j) {
        torque.iter_mut().zip(known).for_each(|(t, k)| *t += k);
    }
    torque
}

fn of_values(run: &Prepared, nominal: &Nominal, j: usize, parameters: Range<usize>) -> Vec<f64> {
    let mut torque = vec![0.0; run.rows()];
    for (x, column) in nominal.x[parameters.clone()].iter().zip(&run.standard[parameters]) {
        if let Some(values) = &column[j] {
            torque.iter_mut().zip(values).for_each(|(t, v)| *t += v * x);
        }
    }
    torque
}

/// What is left of a signal where multiples of others are taken from it, one after the other.
fn apart(signal: &[f64], others: &[Vec<f64>]) -> Vec<f64> {
    let mut left = signal.to_vec();
    let mut straight: Vec<Vec<f64>> = Vec::new();
    for other in others {
        let mut other = other.clone();
        for before in &straight {
            take(&mut other, before);
        }
        take(&mut left, &other);
        straight.push(other);
    }
    left
}

/// Takes the part along `direction` from `signal`.
fn take(signal: &mut [f64], direction: &[f64]) {
    let along = dot(signal, direction) / dot(direction, direction).max(f64::MIN_POSITIVE);
    signal.iter_mut().zip(direction).for_each(|(s, d)| *s -= along * d);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The factor by which a torque is off if it is by about two: a load makes bodies heavier, wear or cold makes friction larger, neither
/// both of them by the same.
fn factor(tau: &[f64], bodies: &[f64], drive: &[f64]) -> Option<f64> {
    let [bb, bd, dd] = [dot(bodies, bodies), dot(bodies, drive), dot(drive, drive)];
    let (bt, dt, tt) = (dot(bodies, tau), dot(drive, tau), dot(tau, tau));
    let determinant = bb * dd - bd * bd;
    let [body, own] = [(dd * bt - bd * dt) / determinant, (bb * dt - bd * bt) / determinant];
    let factor = (bt + dt) / (bb + 2.0 * bd + dd);
    let felt = |part: f64, square: f64| part.powi(2) * square > BOTH_FELT.powi(2) * tt;
    let shape = (bt + dt) / ((bb + 2.0 * bd + dd) * tt).sqrt();
    let same = |part: f64| (part / factor - 1.0).abs() < SAME_FACTOR;
    let off = !(1.0 / TWICE..TWICE).contains(&factor);
    (off && shape > WHOLE_SHAPE && same(body) && same(own) && felt(body, bb) && felt(own, dd)).then_some(factor)
}

/// Whether heavier bodies, those of the file and one at the flange, explain a torque better beside the drive as it is than another unit of
/// both.
fn is_load(tau: &[f64], bodies: &[f64], at_flange: Option<&[f64]>, drive: &[f64]) -> bool {
    let whole: Vec<f64> = bodies.iter().zip(drive).map(|(body, drive)| body + drive).collect();
    let less: Vec<f64> = tau.iter().zip(drive).map(|(tau, drive)| tau - drive).collect();
    let heavier: Vec<Vec<f64>> = [Some(bodies), at_flange].into_iter().flatten().map(<[f64]>::to_vec).collect();
    let load = apart(&less, &heavier);
    let unit = apart(tau, &[whole]);
    dot(&load, &load) < CLEARLY_LESS * dot(&unit, &unit)
}

/// Whether joint `j` stands still throughout.
pub(crate) fn is_still(motion: &Motion, j: usize) -> bool {
    top_speed(motion, j) < STILL
}

/// Whether joint `j` moves for a while.
pub(crate) fn is_moved(motion: &Motion, chain: &Chain, j: usize) -> bool {
    let rows = chain.sample(&motion.qd[j]).iter().filter(|v| v.abs() > STILL).count();
    rows as f64 * chain.row_period_s >= IN_MOTION_S
}

/// \[rad/s\]
fn top_speed(motion: &Motion, j: usize) -> f64 {
    motion.qd[j].iter().fold(0.0_f64, |m, v| m.max(v.abs()))
}

/// The largest torque of a signal in steps of `step` (0 without), if it is held for stretches.
fn limit(signal: &[f64], step: f64) -> Option<f64> {
    let top = signal.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
    let held = signal.chunk_by(|a, b| a == b).filter(|c| c.len() >= FLAT && c[0].abs() >= top * (1.0 - 1e-9));
    let flat: usize = held.map(<[f64]>::len).sum();
    // A quiet torque stands on the step below where it turns as well.
    let below = (top - 1.5 * step)..(top - 0.5 * step);
    let passing = signal.iter().filter(|t| below.contains(&t.abs())).count();
    let enough = (FLAT_SHARE * signal.len() as f64).max(MORE * passing as f64);
    (top > 0.0 && flat as f64 > enough).then_some(top)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gravity and friction of a joint that swings; noise of a twentieth.
    #[test]
    fn a_gain_of_two_is_one_where_bodies_and_drive_have_it() {
        let at = |f: &dyn Fn(f64) -> f64| (0..4000).map(|k| f(0.01 * f64::from(k))).collect::<Vec<f64>>();
        let (bodies, drive) = (at(&|t| 8.0 * t.sin()), at(&|t| 4.0 * t.cos() + 2.0 * t.cos().signum()));
        let torque = |b: f64, d: f64| -> Vec<f64> {
            let noise = at(&|t| 0.4 * (57.0 * t).sin());
            bodies.iter().zip(&drive).zip(&noise).map(|((x, y), n)| b * x + d * y + n).collect()
        };
        let told = |b: f64, d: f64| factor(&torque(b, d), &bodies, &drive);
        assert!(told(2.0, 2.0).is_some_and(|f| (f - 2.0).abs() < 0.02) && told(0.5, 0.5).is_some());
        assert_eq!(told(1.0, 1.0), None);
        assert_eq!(told(1.5, 1.5), None, "a torque constant may be as wrong");
        assert_eq!(told(2.0, 1.0), None, "a load");
        assert_eq!(told(1.0, 2.5), None, "friction of a cold joint");
        assert_eq!(told(2.2, 1.8), None, "wrong values");
    }

    #[test]
    fn a_torque_that_is_held_at_its_top_is_a_limit_and_a_standstill_is_not() {
        let wave: Vec<f64> = (0..1000).map(|k| (0.02 * f64::from(k)).sin()).collect();
        assert_eq!(limit(&wave, 0.0), None);
        let cut: Vec<f64> = wave.iter().map(|t| t.clamp(-0.8, 0.8)).collect();
        assert_eq!(limit(&cut, 0.0), Some(0.8));
        let rest: Vec<f64> = wave.iter().map(|t| t.clamp(-0.1, 0.1) + if *t > 0.999 { 0.5 } else { 0.0 }).collect();
        assert_eq!(limit(&rest, 0.0), None, "a stretch below the top is no limit");
        let rounded = |signal: &[f64]| -> Vec<f64> { signal.iter().map(|t| (t / 0.03).round() * 0.03).collect() };
        assert!(limit(&rounded(&wave), 0.0).is_some(), "without its steps it would be one");
        assert_eq!(limit(&rounded(&wave), 0.03), None, "it turns on its last step");
        let cut = rounded(&cut);
        assert!(limit(&cut, 0.03).is_some_and(|t| (t - 0.81).abs() < 1e-9), "{:?}", limit(&cut, 0.03));
    }
}
