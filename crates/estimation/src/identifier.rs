//! The whole period: differentiate, regressor and instruments, model filter, decimate, weight, estimate, supervise.

mod kept;

pub use kept::Reconfigured;

use crate::dead_zone::slides;
use crate::differentiate::Aligned;
use crate::dropout::Dropouts;
use crate::energy::Energy;
use crate::estimator::{Correlation, Estimator, EstimatorSettings, Hausman};
use crate::filter::{Butterworth, correlation_factor, neighbour_correlation};
use crate::linear::dot;
use crate::observer::{Observer, Phase, Row};
use crate::reference::Reference;
use crate::report::{Estimate, Instrument, Motion, Refusal, Sample, Setpoint, Skip, Step};
use crate::residuals::CLEAR;
use crate::scales::Scales;
use crate::settings::{Filtering, InputSignals, Settings, SettingsError, Window, per_joint};
use crate::signals::{InputFilter, Past, Regressors, RowFilter, Side};
use rivet_dynamics::{BaseSet, MAX_JOINTS, Model, Workspace};
use std::sync::Arc;

/// No arm's position \[rad\] or speed \[rad/s\] is larger.
pub const LARGEST_MOTION: f64 = 1e4;
/// No arm's acceleration \[rad/s²\] or torque \[N·m\] is larger.
pub const LARGEST_EFFORT: f64 = 1e6;
/// A position that changes at more than this many times the joint's speed limit is a jump of the reading.
const JUMP: f64 = 10.0;
/// Speed limit of a joint that states none \[rad/s\].
pub(crate) const DEFAULT_SPEED_LIMIT_RAD_S: f64 = 10.0;
/// Rows reach the estimator once the filters have run for this many periods of the cut-off: until then the first
/// sample's noise weighs too much. (The equation holds from the first sample on.)
pub(crate) const SETTLING: f64 = 1.0;
/// The torque of a joint that sticks has no friction's direction, and stays in the filter for a while: a row counts by this
/// power of the share of what the filter has let through that came from a moving joint. The first power let enough of it in to
/// bias the wrist of an arm whose controller knows no friction, the second took the KUKA's third joint away from its batch fit.
/// No sharp border either: over a stretch of rows the noise of acceleration sums up to that of the speeds at its ends, and a
/// border behind a filter that rings chooses those by just that noise, against which instruments do not help.
const STEEP: i32 = 4;
/// Less is nothing.
const MIN_MOVING_SHARE: f64 = 0.01;
/// Memory of the running noise estimate, as a share of the window, and its limits \[s\].
const NOISE_MEMORY: (f64, f64, f64) = (0.25, 0.5, 5.0);
/// Rows further off than this many sigmas lose weight: impacts, sticking, glitches. White noise gets there once in two
/// million rows.
const OUTLIER: f64 = 5.0;
/// Span for which the first guess of noise holds when energies are counted from the start \[s\].
const FIRST_SPAN: f64 = 1.0;
/// Memory of reported residuals when nothing is forgotten \[s\].
const RESIDUAL_MEMORY: f64 = 10.0;
/// Length of a block of scores, as a share of the window, and its longest \[s\]; never fewer rows than `LEAST_BLOCK`.
const BLOCK: (f64, f64) = (0.1, 2.5);
const LEAST_BLOCK: f64 = 10.0;

/// Identifies the base parameters of one arm, sample by sample.
#[derive(Clone, Debug)]
pub struct Identifier {
    model: Arc<Model>,
    base: Arc<BaseSet>,
    settings: Settings,
    dof: usize,
    dead_zone: Vec<f64>,
    decimation: usize,
    /// Largest change of a position between two samples \[rad\].
    jump: Vec<f64>,
    previous: Option<[f64; MAX_JOINTS]>,
    interrupted: bool,
    settled: u64,
    aligned: Aligned,
    /// Only with input filtering.
    input: Option<InputFilter>,
    regressors: Regressors,
    /// For the effects of known size.
    workspace: Workspace,
    measured: RowFilter,
    desired: RowFilter,
    /// Only with the energy model; the torque rows then serve reports alone.
    energy: Option<Energy>,
    /// What the instruments of now are made of, and the motion that they are made of.
    reference: Reference,
    chosen: Instrument,
    past: Past,
    phase: usize,
    /// Only every so many of the rows that are due reach the estimator.
    thinning: usize,
    /// Samples since the estimator last had its turn.
    turn: usize,
    dropouts: Dropouts,
    d: Vec<f64>,
    z: Vec<f64>,
    estimator: Estimator,
}

impl Identifier {
    /// Allocates everything. `nominal_base`: base parameters to start from.
    ///
    /// # Errors
    /// The first setting that cannot be used with this arm.
    pub fn new(
        model: Arc<Model>,
        base: Arc<BaseSet>,
        nominal_base: &[f64],
        settings: &Settings,
    ) -> Result<Identifier, SettingsError> {
        let (dof, n) = (model.arm.dof(), base.len());
        settings.check(dof)?;
        per_joint("nominal_base", nominal_base, n, |_| true, "base order, finite")?;
        let rate = 1.0 / settings.sample_period_s;
        let filter = Butterworth::low_pass(settings.filter_order, settings.filter_hz, rate);
        // What white torque noise becomes on its way to the rows.
        let response = match settings.filtering {
            Filtering::Model | Filtering::Input(InputSignals::All) => {
                filter.impulse_response((200.0 * rate / settings.filter_hz).ceil() as usize)
            }
            Filtering::Input(_) | Filtering::None => vec![1.0],
        };
        let over_rows = (settings.filtering == Filtering::Model).then_some(&filter);
        let noise = settings.torque_noise.as_deref();
        let mut scales = Scales::of_workload(&model, &base, nominal_base, noise, settings.workload);
        let with_energy = settings.estimator.energy();
        if with_energy {
            let span = if settings.energy_span_s > 0.0 { settings.energy_span_s } else { FIRST_SPAN };
            scales = scales.of_energy(&model, span);
        }
        let row = settings.row_period_s();
        let (share, least, most) = NOISE_MEMORY;
        let (noise_memory, residual_memory) = match settings.window {
            Window::Exponential { seconds } | Window::ConstantTrace { shortest_s: seconds, .. } => {
                ((share * seconds).clamp(least, most), seconds)
            }
            Window::None => (most, RESIDUAL_MEMORY),
        };
        let block_s = match settings.window {
            Window::Exponential { seconds } | Window::ConstantTrace { shortest_s: seconds, .. } => {
                (BLOCK.0 * seconds).min(BLOCK.1)
            }
            Window::None => BLOCK.1,
        };
        let estimator = EstimatorSettings {
            kind: settings.estimator,
            forgetting: settings.forgetting(),
            deviation: match settings.window {
                Window::ConstantTrace { deviation, .. } => Some(deviation),
                Window::Exponential { .. } | Window::None => None,
            },
            supervision: settings.supervision,
            prior: settings.prior,
            // Of torques: what energies are off by depends on the motion.
            noise_known: settings.torque_noise.is_some() && !with_energy,
            noise_memory: noise_memory / row,
            outlier: OUTLIER,
            residual_memory: (residual_memory / row).max(1.0),
            change_row_s: Some(row),
            correlation: Correlation {
                factor: correlation_factor(&response, settings.decimation),
                neighbour: neighbour_correlation(&response, settings.decimation),
            },
            block: (block_s / row).round().max(LEAST_BLOCK) as usize,
        };
        let speed = |joint: &rivet_dynamics::Joint| {
            if joint.velocity.is_finite() && joint.velocity > 0.0 { joint.velocity } else { DEFAULT_SPEED_LIMIT_RAD_S }
        };
        // Torques, and which joints move, go through the same filter as the rows.
        let measured = RowFilter::new(&model, &base, over_rows, 2 * dof);
        let jump = model.arm.joints.iter().map(|j| JUMP * speed(j) * settings.sample_period_s).collect();
        Ok(Identifier {
            dof,
            dead_zone: settings.dead_zone.clone(),
            decimation: settings.decimation,
            jump,
            previous: None,
            interrupted: false,
            settled: match settings.filtering {
                Filtering::Model | Filtering::Input(_) => (SETTLING * rate / settings.filter_hz).ceil() as u64,
                // There must have been a sample at all.
                Filtering::None => 1,
            },
            input: match settings.filtering {
                Filtering::Input(signals) => Some(InputFilter::new(dof, &filter, signals)),
                Filtering::Model | Filtering::None => None,
            },
            aligned: Aligned::new(dof, settings.differentiator, settings.sample_period_s),
            regressors: Regressors::new(&model),
            workspace: Workspace::new(&model.arm),
            desired: measured.another(over_rows),
            measured,
            energy: with_energy.then(|| {
                let (period, span) = (settings.sample_period_s, settings.energy_rows());
                Energy::new(&model, &base, nominal_base, over_rows, period, span, estimator.residual_memory)
            }),
            reference: Reference::new(dof, settings, &filter),
            chosen: Instrument::None,
            past: Past::new(if with_energy { n } else { dof * n }, settings.delay_rows().unwrap_or(0)),
            phase: 0,
            settings: settings.clone(),
            thinning: 1,
            turn: 0,
            dropouts: Dropouts::default(),
            d: vec![0.0; dof * n],
            z: vec![0.0; dof * n],
            estimator: Estimator::new(nominal_base, &scales, &estimator),
            model,
            base,
        })
    }

    /// Takes in one sample: positions \[rad\], torques \[N·m\], and the setpoint of the same period if there is one.
    ///
    /// Real-time safe: bounded work; no allocation, lock, system call or panic.
    pub fn push(&mut self, q: &[f64], tau: &[f64], setpoint: Option<Setpoint<'_>>) -> Step {
        self.push_sample(Sample { q, second: None, tau, setpoint })
    }

    /// Like [`push`](Self::push), with second encoders where the arm has them. A joint without one (NaN) leaves all out.
    pub fn push_sample(&mut self, sample: Sample<'_>) -> Step {
        self.push_observed(sample, &mut ())
    }

    /// Like [`push_sample`](Self::push_sample), while `observer` looks on.
    pub fn push_observed<O: Observer>(&mut self, sample: Sample<'_>, observer: &mut O) -> Step {
        let Sample { q, second, tau, setpoint } = sample;
        if let Err(why) = self.check(Motion { q, qd: &[], qdd: &[] }, tau, setpoint) {
            return self.refuse(why);
        }
        if self.interrupted {
            self.restart_signals();
        }
        self.remember(q);
        let tau = self.dropouts.bridge(tau);
        let whole = |second: &&[f64]| second.len() == self.dof && second.iter().all(|v| v.abs() <= LARGEST_MOTION);
        self.reference.read_second(q, second.filter(whole), &tau[..self.dof]);
        let whole = self.aligned.push(q, &tau[..self.dof], setpoint);
        observer.done(Phase::Differentiate);
        if !whole {
            self.work(false, observer);
            return Step::WarmingUp;
        }
        self.process(observer)
    }

    /// Like [`push`](Self::push) for an arm that measures velocity and acceleration itself: nothing is differentiated,
    /// and nothing delayed.
    pub fn push_motion(&mut self, motion: Motion<'_>, tau: &[f64], setpoint: Option<Setpoint<'_>>) -> Step {
        let whole = motion.qd.len() == self.dof && motion.qdd.len() == self.dof;
        let checked = if whole { self.check(motion, tau, setpoint) } else { Err(Refusal::NotFinite) };
        if let Err(why) = checked {
            return self.refuse(why);
        }
        if self.interrupted {
            self.restart_signals();
        }
        self.remember(motion.q);
        self.aligned.set(motion, tau, setpoint);
        self.process(&mut ())
    }

    /// Differentiator and filters start anew, after lost samples; what was learnt stays.
    pub fn restart_signals(&mut self) {
        self.interrupted = false;
        self.previous = None;
        self.dropouts = Dropouts::default();
        self.aligned.restart();
        self.regressors.restart();
        self.measured.restart();
        self.desired.restart();
        if let Some(input) = &mut self.input {
            input.restart();
        }
        if let Some(energy) = &mut self.energy {
            energy.restart_signals();
        }
        self.reference.restart();
        self.past.restart();
        self.phase = 0;
    }

    /// Lets only every `factor`-th row that is due reach the estimator, which has its turn at every `factor`-th sample: less
    /// work, later values. The window keeps its length in rows. 1 leaves nothing out.
    pub fn thin(&mut self, factor: usize) {
        self.thinning = factor.max(1);
    }

    /// Stops learning; residuals are still reported.
    pub fn freeze(&mut self) {
        self.estimator.freeze();
    }

    /// Learns again.
    pub fn resume(&mut self) {
        self.estimator.resume();
    }

    /// Forgets everything; the nominal parameters stand again.
    pub fn reset(&mut self) {
        self.estimator.reset();
        if let Some(energy) = &mut self.energy {
            energy.reset();
        }
    }

    /// Goes on from stored base parameters, with nothing in the window; false, and nothing changed, if they are not
    /// as many as there are base parameters or not finite.
    pub fn load(&mut self, values: &[f64]) -> bool {
        let fits = values.len() == self.base.len() && values.iter().all(|v| v.is_finite());
        if fits {
            self.estimator.load(values);
        }
        fits
    }

    /// As [`load`](Self::load), knowing also how well those are known that had been `identified`: they count as held, and the
    /// window has to know them better before they move. False, and nothing changed, if a length or a number is wrong.
    pub fn recall(&mut self, values: &[f64], std: &[f64], identified: &[bool]) -> bool {
        let n = self.base.len();
        let fits = std.len() == n && identified.len() == n && std.iter().all(|s| s.is_finite() && *s >= 0.0);
        fits && self.load(values) && {
            self.estimator.recall(std, |i| identified[i]);
            true
        }
    }

    /// What is known now.
    #[must_use]
    pub fn estimate(&self) -> Estimate<'_> {
        let estimate = self.estimator.estimate();
        let estimate = self.energy.as_ref().map_or(estimate, |energy| energy.report(&estimate));
        Estimate { loop_lag_s: self.reference.lag_s(), cycle_s: self.reference.cycle_s(), ..estimate }
    }

    /// Whether least squares is biased, going by the window: see [`Estimator::hausman`].
    #[must_use]
    pub fn hausman(&self) -> Option<Hausman> {
        self.estimator.hausman()
    }

    /// How much less the noise of joint `j` matters with instruments: see [`Estimator::instrument_ratio`]. NaN with the
    /// energy model, whose rows belong to no joint.
    #[must_use]
    pub fn instrument_ratio(&self, j: usize) -> f64 {
        if self.energy.is_some() { f64::NAN } else { self.estimator.instrument_ratio(j) }
    }

    fn refuse(&mut self, why: Refusal) -> Step {
        self.interrupted = true;
        self.estimator.work();
        Step::Refused(why)
    }

    fn remember(&mut self, q: &[f64]) {
        let mut previous = [0.0; MAX_JOINTS];
        previous[..self.dof].copy_from_slice(q);
        self.previous = Some(previous);
    }

    fn check(&self, motion: Motion<'_>, tau: &[f64], setpoint: Option<Setpoint<'_>>) -> Result<(), Refusal> {
        let n = self.dof;
        let lengths = motion.q.len() == n
            && tau.len() == n
            && setpoint.is_none_or(|s| s.q.len() == n && s.qd.len() == n && s.qdd.len() == n);
        if !lengths {
            return Err(Refusal::NotFinite);
        }
        let desired = setpoint.unwrap_or(Motion { q: &[], qd: &[], qdd: &[] });
        for (values, limit) in [
            (motion.q, LARGEST_MOTION),
            (motion.qd, LARGEST_MOTION),
            (motion.qdd, LARGEST_EFFORT),
            (tau, LARGEST_EFFORT),
            (desired.q, LARGEST_MOTION),
            (desired.qd, LARGEST_MOTION),
            (desired.qdd, LARGEST_EFFORT),
        ] {
            if values.iter().any(|v| !v.is_finite()) {
                return Err(Refusal::NotFinite);
            }
            if values.iter().any(|v| v.abs() > limit) {
                return Err(Refusal::Implausible);
            }
        }
        // After a refusal the signals start anew: a reading that has jumped for good is then as good as any.
        if let Some(previous) = self.previous.filter(|_| !self.interrupted) {
            let jumped = motion.q.iter().zip(&previous).zip(&self.jump).any(|((q, p), most)| (q - p).abs() > *most);
            if jumped {
                return Err(Refusal::Implausible);
            }
        }
        Ok(())
    }

    /// The slow part of the estimator has its turn. Periods that have `learnt` leave it to those between rows, if there are any:
    /// no period takes the time of both, or touches the memory of both.
    fn work<O: Observer>(&mut self, learnt: bool, observer: &mut O) {
        self.turn += 1;
        if self.turn >= self.thinning && !(learnt && self.decimation > 1) {
            self.turn = 0;
            self.estimator.work();
        }
        observer.done(Phase::Supervise);
    }

    fn process<O: Observer>(&mut self, observer: &mut O) -> Step {
        let Identifier {
            aligned,
            input,
            measured,
            desired,
            energy,
            model,
            base,
            regressors,
            dead_zone,
            reference,
            chosen,
            workspace,
            ..
        } = self;
        if let Some(input) = input {
            input.step(aligned);
        }
        // What is known beside the model is no business of its parameters.
        model.take_effects(workspace, &aligned.q, &aligned.qd, &aligned.qdd, &mut aligned.tau);
        let motion = Motion { q: &aligned.q, qd: &aligned.qd, qdd: &aligned.qdd };
        let structure = &model.structure;
        let moving =
            (0..dead_zone.len()).map(|j| f64::from(u8::from(slides(structure, dead_zone, |j| aligned.qd[j], j))));
        let moves = (0..dead_zone.len()).any(|j| aligned.qd[j].abs() >= dead_zone[j]);
        let found = reference.choose(aligned, moves).unwrap_or(Instrument::None);
        if !same_motion(found, *chosen) {
            desired.restart();
        }
        *chosen = found;
        let second = reference.motion(found, aligned);
        if let Some(energy) = energy {
            energy.step(model, base, motion, &aligned.tau, second);
        }
        regressors.evaluate(model, motion, second);
        measured.step(regressors, Side::Measured, aligned.tau.iter().copied().chain(moving));
        if second.is_some() {
            desired.step(regressors, Side::Second, std::iter::empty());
        }
        self.phase += 1;
        let due = self.phase >= self.decimation * self.thinning;
        if due {
            self.phase = 0;
        }
        observer.done(Phase::Model);
        let settled = self.measured.age() >= self.settled;
        let step = match (settled, due) {
            (false, _) => Step::WarmingUp,
            (true, true) => self.learn(observer),
            (true, false) => Step::Between,
        };
        observer.done(Phase::Estimate);
        self.work(settled && due, observer);
        step
    }

    fn learn<O: Observer>(&mut self, observer: &mut O) -> Step {
        self.measured.rows(&mut self.d);
        let (tau, moving) = self.measured.extra().split_at(self.dof);
        let (mut share, mut used) = ([0.0; MAX_JOINTS], [false; MAX_JOINTS]);
        for ((share, used), moving) in share.iter_mut().zip(&mut used).zip(moving) {
            *share = counts(*moving);
            *used = *share >= CLEAR;
        }
        let none = [0.0; MAX_JOINTS];
        let mut row = Row { tau: none, predicted: none, accepted: none, speed: none, accel: none, moving: used };
        row.tau[..self.dof].copy_from_slice(tau);
        row.speed[..self.dof].copy_from_slice(&self.aligned.qd);
        row.accel[..self.dof].copy_from_slice(&self.aligned.qdd);
        let values = self.estimator.estimate().values;
        let nominal = self.estimator.nominal();
        for (j, d) in self.d.chunks_exact(values.len()).enumerate().take(self.dof) {
            row.predicted[j] = dot(d, values);
            row.accepted[j] = dot(d, nominal);
        }
        if !observer.admits(&row) {
            return Step::Skipped(Skip::NotAdmitted);
        }
        self.reference.learn(&used[..self.dof], &self.aligned);
        if let Some(energy) = &mut self.energy {
            energy.watch(&self.d, tau, &share[..self.dof], self.estimator.estimate().values);
            let (row, work, planned) = energy.take(self.settled);
            let instruments = match planned {
                Some(row) => Some((row, self.chosen)),
                None => self.past.oldest().map(|row| (row, Instrument::Delayed)),
            };
            let moving = used.iter().any(|used| *used);
            let result = self.estimator.update(row, instruments, &[work], &[f64::from(u8::from(moving))]);
            self.past.store(row);
            return self.learnt(result);
        }
        let instruments = if self.desired.age() >= self.settled {
            self.desired.rows(&mut self.z);
            Some((&self.z[..], self.chosen))
        } else {
            self.past.oldest().map(|rows| (rows, Instrument::Delayed))
        };
        let result = self.estimator.update(&self.d, instruments, tau, &share[..self.dof]);
        self.past.store(&self.d);
        self.learnt(result)
    }

    /// Rows in which the filters mix two loads would weigh on weak directions for as long as the window remembers: what stays
    /// of it is to meet samples of the new load alone.
    fn learnt(&mut self, result: Result<usize, Skip>) -> Step {
        self.interrupted |= result == Err(Skip::Changed);
        result.map_or_else(Step::Skipped, |rows| Step::Updated { rows })
    }
}

/// How much a row counts of which the filter let through `moving` from a moving joint.
fn counts(moving: f64) -> f64 {
    let share = moving.clamp(0.0, 1.0).powi(STEEP);
    if share < MIN_MOVING_SHARE { 0.0 } else { share }
}

/// Whether the filters of one go on with the other: the closed loop's model, once identified, moves the setpoint by no more
/// than the arm's lag.
fn same_motion(a: Instrument, b: Instrument) -> bool {
    let setpoint = |i| matches!(i, Instrument::Setpoint | Instrument::SetpointThroughLoop);
    a == b || (setpoint(a) && setpoint(b))
}
