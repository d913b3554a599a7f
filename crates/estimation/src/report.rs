//! What the estimator tells about itself: plain values, borrowed, made without allocating.

/// Desired or measured motion of all joints at one time.
pub use rivet_dynamics::State as Motion;

/// The desired motion that belongs to a sample.
pub type Setpoint<'a> = Motion<'a>;

/// What is measured at one instant, and what was wanted of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<'a> {
    /// Joint positions \[rad\]: the encoders that regressors are made of.
    pub q: &'a [f64],
    /// Positions of the same joints by second encoders \[rad\], if there are some.
    pub second: Option<&'a [f64]>,
    /// Joint torques \[N·m\].
    pub tau: &'a [f64],
    /// The setpoint of the same period, if there is one.
    pub setpoint: Option<Setpoint<'a>>,
}

/// How a parameter stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterState {
    /// The window identifies it: it moves.
    Active,
    /// It was identified before; now it keeps its value.
    Held,
    /// Never identified by itself so far (without supervision: not by the window of now). It has its nominal value, or what was loaded, but
    /// for what identified combinations have carried it away by; its standard deviation is no less than that.
    Unidentified,
}

/// Which instruments the last accepted row had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instrument {
    /// None yet, or none at hand.
    None,
    /// The regressor of the desired motion.
    Setpoint,
    /// The regressor of the desired motion as the arm follows it, by the identified closed loop.
    SetpointThroughLoop,
    /// The regressor of the motion that the second encoders see.
    SecondEncoder,
    /// The regressor of the same phase of the previous cycle.
    PreviousCycle,
    /// The measured regressor of some time ago.
    Delayed,
    /// The regressor itself: least squares.
    Regressor,
}

/// Why a sample was refused. Nothing that was learnt changes; the signals start anew, since the samples around it are
/// no longer evenly spaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// A value is NaN or infinite, or a slice has not one entry a joint.
    NotFinite,
    /// A value is beyond anything an arm does (positions 10⁴ rad, speeds 10⁴ rad/s, accelerations and torques 10⁶), or
    /// a position jumped at more than ten times the joint's speed limit.
    Implausible,
}

/// Why filtered rows were not learnt from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skip {
    /// Every joint is in its dead zone.
    Standstill,
    /// No instruments: no setpoints, or too few rows since the start for delayed ones.
    NoInstrument,
    /// Frozen on request.
    Frozen,
    /// A row is not finite or too large to square.
    NotFinite,
    /// The observer did not admit them.
    NotAdmitted,
    /// The load has changed: it is taken out of the window, and the filters, which still hold the one before, begin anew.
    Changed,
}

/// What one sample did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The differentiator or the filters are filling.
    WarmingUp,
    /// The filters took it in; rows reach the estimator only every `decimation`-th sample.
    Between,
    /// Rows reached the estimator.
    Updated {
        /// How many joints' rows were used.
        rows: usize,
    },
    /// Rows were at hand but not used.
    Skipped(Skip),
    /// The sample was not used at all.
    Refused(Refusal),
}

/// What the supervision saw in the information of the instruments, in scaled torque units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// How many coordinates or directions move.
    pub active: usize,
    /// Of how many.
    pub of: usize,
    /// Everything is held because the trace or the condition number of the reduced information is out of bounds
    /// (columns), or because the decomposition or the solution failed.
    pub suspended: bool,
    /// Sum of the eigenvalues of the (reduced) information.
    pub trace: f64,
    /// Natural logarithm of its determinant.
    pub log_determinant: f64,
    /// Its condition number: infinity norm (columns), or largest over smallest active eigenvalue (eigen). NaN when
    /// nothing was judged.
    pub condition: f64,
}

impl Verdict {
    pub(crate) const NONE: Verdict =
        Verdict { active: 0, of: 0, suspended: false, trace: 0.0, log_determinant: 0.0, condition: f64::NAN };
}

/// The state of the estimation, borrowed from the estimator. Parameters are in base order and SI units, joints base to
/// flange.
#[derive(Clone, Copy, Debug)]
pub struct Estimate<'a> {
    /// Parameter values.
    pub values: &'a [f64],
    /// Their standard deviations: of the window while active, of the last identification while held, of the prior
    /// before. They hold for white torque noise; the correlation that the model filter adds is accounted for.
    pub std: &'a [f64],
    /// How each parameter stands.
    pub state: &'a [ParameterState],
    /// Windowed information of each column over the threshold at which it would move if it stood alone; below 1 there
    /// is nothing to be learnt about the parameter.
    pub excitation: &'a [f64],
    /// Values of the unsupervised recursive least squares (UD filter) beside the estimator.
    pub rls_values: &'a [f64],
    /// Standard deviation of each joint's torque residual that the rows are weighted by \[N·m\].
    pub torque_noise: &'a [f64],
    /// Windowed rms of the torque residual with the values of the time \[N·m\], after the model filter.
    pub residual_rms: &'a [f64],
    /// The same with the nominal parameters \[N·m\].
    pub nominal_residual_rms: &'a [f64],
    /// Windowed rms of the filtered torque in the same rows \[N·m\].
    pub torque_rms: &'a [f64],
    /// Rows used, each joint.
    pub rows_used: &'a [u64],
    /// Rows left out because the joint stood still or the row was not finite, each joint.
    pub rows_left_out: &'a [u64],
    /// Instruments of the last used row.
    pub instrument: Instrument,
    /// Delay of each joint behind its setpoint in slow motion \[s\], NaN until the closed loop is identified; empty where
    /// that is not asked for.
    pub loop_lag_s: &'a [f64],
    /// Length of the cycle that the motion repeats \[s\]; `None` while it repeats none, or none is looked for.
    pub cycle_s: Option<f64>,
    /// Length of the window \[rows\]: those after which a row weighs 1/e; infinite while nothing is forgotten.
    pub window_rows: f64,
    /// What the supervision saw last.
    pub verdict: Verdict,
    /// How often the arm was seen to change (a payload grasped or let go of), which empties the window.
    pub changes: u64,
    /// Updates of the estimator since construction or reset.
    pub updates: u64,
    /// Learning is switched off.
    pub frozen: bool,
}
