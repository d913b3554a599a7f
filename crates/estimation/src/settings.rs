//! What a user may choose. Checked once, when an [`Identifier`](crate::Identifier) is made; never changes while running.

use thiserror::Error;

/// How velocity and acceleration come from positions. All signals are delayed by the same number of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Differentiator {
    /// Differences of three samples; delays by one sample.
    Central,
    /// Least-squares cubic over `2·half_width + 1` samples (Savitzky & Golay 1964); delays by `half_width` samples.
    SavitzkyGolay {
        /// Samples on each side of the centre, 2 to [`MAX_HALF_WIDTH`].
        half_width: usize,
    },
    /// States of a triple low-pass that positions, torques and setpoints all pass (Tustin's rule): causal, and for noisy or
    /// stair-case positions far cheaper than a wide window. Delays by 3/(2π·hz) seconds.
    StateFilter {
        /// Corner of one of its three sections \[Hz\], above 0 and at most 0.2 of the sample rate.
        hz: f64,
    },
}

/// Widest Savitzky-Golay window on each side of its centre \[samples\].
pub const MAX_HALF_WIDTH: usize = 500;
/// Highest order of the model filter.
pub const MAX_FILTER_ORDER: usize = 8;
/// Most rows of delayed instruments that are kept.
pub const MAX_DELAY_ROWS: usize = 4096;
/// Longest cycle that is looked for unless something else is asked for \[s\].
pub const LONGEST_CYCLE_S: f64 = 20.0;

impl Differentiator {
    /// Whole samples that every signal waits in the differentiator. The state filter lets none wait: it delays by filtering
    /// them all alike.
    #[must_use]
    pub fn delay(&self) -> usize {
        match *self {
            Differentiator::Central => 1,
            Differentiator::SavitzkyGolay { half_width } => half_width,
            Differentiator::StateFilter { .. } => 0,
        }
    }
}

/// Which estimator makes the values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EstimatorKind {
    /// Recursive instrumental variables (paper, 3.1.1).
    Riv,
    /// Recursive least squares: biased by noise in the regressor, but the better predictor of the motion at hand.
    /// Unsupervised it is the UD filter; supervised, the conditional solver with the regressor as its own instrument.
    Rls,
    /// [`Riv`](EstimatorKind::Riv) on energy rows instead of torques (3.1.3): no acceleration, but slow disturbances of
    /// torque add up.
    Energy,
    /// [`Rls`](EstimatorKind::Rls) on energy rows: the paper's integral model.
    RlsEnergy,
}

impl EstimatorKind {
    /// Whether the regressor is its own instrument.
    #[must_use]
    pub fn least_squares(self) -> bool {
        matches!(self, EstimatorKind::Rls | EstimatorKind::RlsEnergy)
    }

    /// Whether rows are energies of all joints together instead of torques of each.
    #[must_use]
    pub fn energy(self) -> bool {
        matches!(self, EstimatorKind::Energy | EstimatorKind::RlsEnergy)
    }
}

/// What the low-pass is applied to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filtering {
    /// Every column of the regressor and of the instruments, and the torque: the equation stays what it is (3.1.2).
    Model,
    /// Signals before the model, which changes the equation. For comparison.
    Input(InputSignals),
    /// Nothing.
    None,
}

/// Which signals input filtering is applied to. The desired motion is filtered like the measured one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputSignals {
    /// Positions with their derivatives, and torques.
    All,
    /// Positions with their derivatives; torques stay as they are, and so come earlier.
    Motion,
    /// Accelerations alone.
    Acceleration,
}

/// How old samples lose weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Window {
    /// Weight e^(−age/seconds). Age counts only while rows come in: standing still forgets nothing.
    Exponential {
        /// Time constant \[s\].
        seconds: f64,
    },
    /// As much is forgotten as keeps the trace of the inverse information constant (Sripada & Fisher 1987; paper, 3.2.3), the
    /// average variance of the parameters with it: little excitation makes the window long, none makes it endless.
    ConstantTrace {
        /// The window is never shorter than this \[s\].
        shortest_s: f64,
        /// Rms over the parameters of the standard deviation of their torque on the reference workload that is kept, for
        /// white residuals \[torque-noise sigma\]. Until it is reached nothing is forgotten.
        deviation: f64,
    },
    /// Nothing is forgotten (λ = 1).
    None,
}

/// Where instruments come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Instruments {
    /// The best at hand, sample by sample: the setpoint through the closed loop, the second encoders, the previous cycle,
    /// delayed rows.
    Auto {
        /// Age of delayed rows \[s\].
        delay_s: f64,
        /// Longest cycle that is looked for \[s\].
        longest_cycle_s: f64,
    },
    /// The regressor of the desired motion. Without setpoints the estimator holds.
    Setpoint,
    /// The regressor of the desired motion as the arm will follow it, by a model of each joint's position loop that is
    /// identified while running; the desired motion itself until then. Without setpoints the estimator holds.
    SetpointThroughLoop,
    /// The regressor of the motion that second encoders see, on the link or on the motor. Without them the estimator holds.
    SecondEncoder,
    /// The regressor at the same phase of the previous cycle of a motion that repeats; delayed rows while none does.
    PreviousCycle {
        /// Age of delayed rows \[s\].
        delay_s: f64,
        /// Longest cycle that is looked for \[s\]; memory grows with it.
        longest_cycle_s: f64,
    },
    /// The measured, filtered regressor of some time ago.
    Delayed {
        /// How long ago \[s\]; rounded up to whole rows.
        delay_s: f64,
    },
}

impl Instruments {
    /// Age of delayed rows \[s\], where they may serve.
    #[must_use]
    pub fn delay_s(&self) -> Option<f64> {
        match *self {
            Instruments::Auto { delay_s, .. }
            | Instruments::PreviousCycle { delay_s, .. }
            | Instruments::Delayed { delay_s } => Some(delay_s),
            Instruments::Setpoint | Instruments::SetpointThroughLoop | Instruments::SecondEncoder => None,
        }
    }

    /// Longest cycle that is looked for \[s\], where one is.
    #[must_use]
    pub fn longest_cycle_s(&self) -> Option<f64> {
        match *self {
            Instruments::Auto { longest_cycle_s, .. } | Instruments::PreviousCycle { longest_cycle_s, .. } => {
                Some(longest_cycle_s)
            }
            _ => None,
        }
    }
}

/// The paper's scheme of section 3.2.3, on the windowed information of the instruments in torque units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColumnsSettings {
    /// Largest acceptable standard deviation of a parameter's torque on the reference workload \[torque-noise sigma\].
    /// A parameter that is known less well than that moves as soon as the window knows it better.
    pub tolerance: f64,
    /// Two columns of the information that enclose less than this exclude one of their parameters \[rad\].
    pub min_angle: f64,
    /// Infinity-norm condition number of the reduced information above which everything is held.
    pub max_condition: f64,
}

impl Default for ColumnsSettings {
    fn default() -> Self {
        ColumnsSettings { tolerance: 0.5, min_angle: 5.0_f64.to_radians(), max_condition: 1e8 }
    }
}

/// The scheme of section 3.2.2: a full eigen-decomposition; only identifiable directions move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EigenSettings {
    /// Largest acceptable standard deviation of a direction's torque on the reference workload \[torque-noise sigma\].
    /// A direction that is known less well than that moves as soon as the window knows it better.
    pub tolerance: f64,
    /// An active direction is held again below this share of the eigenvalue that activates it, 0 to 1.
    pub hysteresis: f64,
    /// A direction moves only while `vᵀMv / vᵀSv` lies between `relevance` and `1/relevance`: else the instruments do
    /// not describe the motion (brake, emergency stop, saturation). 0 to 1; 0 switches the guard off.
    pub relevance: f64,
}

impl Default for EigenSettings {
    fn default() -> Self {
        EigenSettings { tolerance: 0.5, hysteresis: 0.7, relevance: 0.3 }
    }
}

/// Every direction judged at recursive cost (3.2.4): a basis that follows the information by Jacobi rotations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedSettings {
    /// As [`EigenSettings::tolerance`].
    pub tolerance: f64,
    /// As [`EigenSettings::hysteresis`].
    pub hysteresis: f64,
    /// As [`EigenSettings::relevance`].
    pub relevance: f64,
    /// A direction that has come to be held stays so for at least this many rows; 0 to 100 000.
    pub dwell: u32,
    /// Rounds of rotations from one decision to the next, 1 to 64; one round turns every direction once. A decision is made
    /// every thousandth of the window, with every row at the most and every fifth at the least.
    pub rounds: usize,
    /// Whether information that a direction may owe to a stronger one, because the basis lags, is taken off.
    pub deflation: bool,
}

impl Default for TrackedSettings {
    fn default() -> Self {
        TrackedSettings { tolerance: 0.5, hysteresis: 0.7, relevance: 0.3, dwell: 20, rounds: 10, deflation: true }
    }
}

/// Which parameters, or directions of the parameter space, may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Supervision {
    /// Everything moves whenever the equations can be solved. RIV without supervision bursts under poor excitation.
    Off,
    /// Column norms, angles, trace and condition number (3.2.3).
    Columns(ColumnsSettings),
    /// Eigenvalues and eigenvectors (3.2.2), spread over the periods.
    Eigen(EigenSettings),
    /// Tracked directions (3.2.4): the same decisions from a basis that follows the information.
    Tracked(TrackedSettings),
}

/// What is known before the first sample. It acts through parameters that are held, through the threshold at which
/// they start to move and as the start of the UD filter; it never pulls on a parameter that the instruments identify.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Standard deviation of the nominal parameters, relative to their values.
    pub relative_std: f64,
}

/// Everything about the estimation of one arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Time between samples \[s\].
    pub sample_period_s: f64,
    /// How velocity and acceleration come from positions.
    pub differentiator: Differentiator,
    /// What the low-pass is applied to.
    pub filtering: Filtering,
    /// Cut-off (−3 dB) of that low-pass \[Hz\].
    pub filter_hz: f64,
    /// Its order: 2, 4, 6 or 8.
    pub filter_order: usize,
    /// Every how manieth filtered row reaches the estimator.
    pub decimation: usize,
    /// A joint's row is left out while the joint is slower than this \[rad/s\], one value a joint; 0 uses all rows.
    pub dead_zone: Vec<f64>,
    /// Standard deviation of the torque residual after the model filter \[N·m\], one value a joint; `None` estimates
    /// it while running.
    pub torque_noise: Option<Vec<f64>>,
    /// Which estimator makes the values.
    pub estimator: EstimatorKind,
    /// Time that an energy row covers \[s\]; 0 counts from the start, as the paper does. Read by the energy estimators.
    pub energy_span_s: f64,
    /// How old rows lose weight.
    pub window: Window,
    /// Where instruments come from.
    pub instruments: Instruments,
    /// Which parameters or directions may move.
    pub supervision: Supervision,
    /// What is known before the first sample.
    pub prior: Prior,
    /// Motion that says what a parameter's torque is: the yardstick of `supervision`.
    pub workload: ReferenceWorkload,
}

/// Random states of the arm within its limits, at moderate speed, that parameters are measured by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReferenceWorkload {
    /// 300 states.
    #[default]
    OneWay,
    /// The same, each passed both ways: friction, odd in the speed, and bodies, even in it, have nothing in common by chance, so that
    /// what is held stays itself and not only its torque together with another's.
    BothWays,
}

/// Which setting cannot be used, and why.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{setting} is {value}; {rule}")]
pub struct SettingsError {
    /// Name of the field of [`Settings`], or of another argument.
    pub setting: &'static str,
    /// Its value, as text.
    pub value: String,
    /// What it must be.
    pub rule: String,
}

impl Settings {
    /// Whether both make the same rows of the same samples: what differs then is how the rows are weighed and judged.
    #[must_use]
    pub fn same_rows(&self, other: &Settings) -> bool {
        self.sample_period_s == other.sample_period_s
            && self.differentiator == other.differentiator
            && self.filtering == other.filtering
            && self.filter_hz == other.filter_hz
            && self.filter_order == other.filter_order
            && self.decimation == other.decimation
            && self.dead_zone == other.dead_zone
            && self.instruments == other.instruments
            && self.estimator.energy() == other.estimator.energy()
            && (!self.estimator.energy() || self.energy_span_s == other.energy_span_s)
    }

    /// Defaults for an arm of `dof` joints sampled every `sample_period_s` \[s\]: Savitzky-Golay over ±10 ms, 4th order
    /// at 20 Hz (at most a fifth of the sample rate), five rows a period of the cut-off, RIV with a 10 s window.
    #[must_use]
    pub fn new(dof: usize, sample_period_s: f64) -> Settings {
        let filter_hz = (0.2 / sample_period_s).min(20.0);
        Settings {
            sample_period_s,
            differentiator: Differentiator::SavitzkyGolay {
                half_width: (0.01 / sample_period_s).round().clamp(2.0, MAX_HALF_WIDTH as f64) as usize,
            },
            filtering: Filtering::Model,
            filter_hz,
            filter_order: 4,
            decimation: (0.2 / (sample_period_s * filter_hz)).round().max(1.0) as usize,
            dead_zone: vec![0.01; dof],
            torque_noise: None,
            estimator: EstimatorKind::Riv,
            energy_span_s: 1.0,
            window: Window::Exponential { seconds: 10.0 },
            instruments: Instruments::Auto {
                delay_s: (2.0 * sample_period_s).max(0.02),
                longest_cycle_s: LONGEST_CYCLE_S,
            },
            supervision: Supervision::Eigen(EigenSettings::default()),
            workload: ReferenceWorkload::default(),
            prior: Prior { relative_std: 1.0 },
        }
    }

    /// Time between rows that reach the estimator \[s\].
    #[must_use]
    pub fn row_period_s(&self) -> f64 {
        self.sample_period_s * self.decimation as f64
    }

    /// Weight of the past at each row: λ in (0, 1]; the least there is where it varies.
    #[must_use]
    pub fn forgetting(&self) -> f64 {
        match self.window {
            Window::Exponential { seconds } | Window::ConstantTrace { shortest_s: seconds, .. } => {
                (-self.row_period_s() / seconds).exp()
            }
            Window::None => 1.0,
        }
    }

    /// Rows that an energy row covers; 0 for all since the start.
    #[must_use]
    pub fn energy_rows(&self) -> usize {
        (self.energy_span_s / self.row_period_s() - 1e-9).ceil().clamp(0.0, 1e9) as usize
    }

    /// Age of delayed instruments in rows; `None` where they do not serve.
    #[must_use]
    pub fn delay_rows(&self) -> Option<usize> {
        // A hair less than the quotient: 0.02 s of 0.01 s rows is 2 rows, whatever the rounding.
        let rows = |delay_s: f64| ((delay_s / self.row_period_s() - 1e-9).ceil()).clamp(1.0, 1e9) as usize;
        self.instruments.delay_s().map(rows)
    }

    /// Checks every value for an arm of `dof` joints.
    ///
    /// # Errors
    /// The first value that cannot be used.
    pub fn check(&self, dof: usize) -> Result<(), SettingsError> {
        let period = self.sample_period_s;
        require("sample_period_s", period, period > 0.0 && period <= 1.0, "it must lie in (0, 1] s")?;
        if let Differentiator::SavitzkyGolay { half_width } = self.differentiator {
            let fits = (2..=MAX_HALF_WIDTH).contains(&half_width);
            require("half_width", half_width, fits, "it must lie in 2..=500 samples: a cubic needs four")?;
        }
        if let Differentiator::StateFilter { hz } = self.differentiator {
            let fits = hz > 0.0 && hz <= 0.2 / period * (1.0 + 1e-9);
            require("state_filter_hz", hz, fits, "it must be positive and at most 0.2 of the sample rate")?;
        }
        let order = self.filter_order;
        let even = (2..=MAX_FILTER_ORDER).contains(&order) && order.is_multiple_of(2);
        require("filter_order", order, even, "it must be 2, 4, 6 or 8")?;
        require("decimation", self.decimation, (1..=100_000).contains(&self.decimation), "it must lie in 1..=100000")?;
        let highest = 0.45 / self.row_period_s();
        require(
            "filter_hz",
            self.filter_hz,
            self.filtering == Filtering::None || self.filter_hz > 0.0 && self.filter_hz <= highest * (1.0 + 1e-9),
            &format!("it must be positive and at most 0.45 of the rate after decimation, {highest:.4} Hz"),
        )?;
        if self.estimator.energy() {
            let longest = MAX_DELAY_ROWS as f64 * self.row_period_s();
            let fits = self.energy_span_s >= 0.0 && self.energy_rows() <= MAX_DELAY_ROWS;
            let rule = format!("it must be 0 (since the start) or positive and at most {longest:.3} s");
            require("energy_span_s", self.energy_span_s, fits, &rule)?;
        }
        per_joint("dead_zone", &self.dead_zone, dof, |v| v >= 0.0, "rad/s, not negative")?;
        if let Some(noise) = &self.torque_noise {
            per_joint("torque_noise", noise, dof, |v| v > 0.0, "N·m, positive")?;
        }
        if let Window::Exponential { seconds } | Window::ConstantTrace { shortest_s: seconds, .. } = self.window {
            let least = 20.0 * self.row_period_s();
            let fits = seconds >= least * (1.0 - 1e-9) && seconds.is_finite();
            require("window", seconds, fits, &format!("it must be at least 20 rows long, {least:.4} s"))?;
        }
        if let Window::ConstantTrace { deviation, .. } = self.window {
            require("window_deviation", deviation, deviation > 0.0 && deviation.is_finite(), "it must be positive")?;
        }
        if let (Some(rows), Some(delay_s)) = (self.delay_rows(), self.instruments.delay_s()) {
            let longest = MAX_DELAY_ROWS as f64 * self.row_period_s();
            let fits = delay_s > 0.0 && rows <= MAX_DELAY_ROWS;
            require("delay_s", delay_s, fits, &format!("it must be positive and at most {longest:.3} s"))?;
        }
        if let Some(longest) = self.instruments.longest_cycle_s() {
            require("longest_cycle_s", longest, (1.0..=120.0).contains(&longest), "it must lie in 1..=120 s")?;
        }
        let prior = self.prior.relative_std;
        require("prior", prior, prior > 0.0 && prior.is_finite(), "it must be positive")?;
        match self.supervision {
            Supervision::Off => Ok(()),
            Supervision::Columns(ColumnsSettings { tolerance, min_angle, max_condition }) => {
                require("tolerance", tolerance, tolerance > 0.0 && tolerance.is_finite(), "it must be positive")?;
                let right = std::f64::consts::FRAC_PI_2;
                require("min_angle", min_angle, (0.0..right).contains(&min_angle), "it must lie in [0, pi/2) rad")?;
                require("max_condition", max_condition, max_condition >= 1.0, "it must be at least 1")
            }
            Supervision::Eigen(EigenSettings { tolerance, hysteresis, relevance }) => {
                require("tolerance", tolerance, tolerance > 0.0 && tolerance.is_finite(), "it must be positive")?;
                let fits = hysteresis > 0.0 && hysteresis <= 1.0;
                require("hysteresis", hysteresis, fits, "it must lie in (0, 1]")?;
                require("relevance", relevance, (0.0..1.0).contains(&relevance), "it must lie in [0, 1)")
            }
            Supervision::Tracked(TrackedSettings { tolerance, hysteresis, relevance, dwell, rounds, .. }) => {
                require("tolerance", tolerance, tolerance > 0.0 && tolerance.is_finite(), "it must be positive")?;
                let fits = hysteresis > 0.0 && hysteresis <= 1.0;
                require("hysteresis", hysteresis, fits, "it must lie in (0, 1]")?;
                require("relevance", relevance, (0.0..1.0).contains(&relevance), "it must lie in [0, 1)")?;
                require("dwell", dwell, dwell <= 100_000, "it must be at most 100000 rows")?;
                require("rounds", rounds, (1..=64).contains(&rounds), "it must lie in 1..=64")
            }
        }
    }
}

fn require(setting: &'static str, value: impl std::fmt::Display, holds: bool, rule: &str) -> Result<(), SettingsError> {
    if holds { Ok(()) } else { Err(SettingsError { setting, value: value.to_string(), rule: rule.to_owned() }) }
}

/// One finite value a joint that passes `test`.
pub(crate) fn per_joint(
    setting: &'static str,
    values: &[f64],
    dof: usize,
    test: impl Fn(f64) -> bool,
    unit: &str,
) -> Result<(), SettingsError> {
    let fits = values.len() == dof && values.iter().all(|&v| v.is_finite() && test(v));
    if fits {
        return Ok(());
    }
    Err(SettingsError { setting, value: format!("{values:?}"), rule: format!("it needs {dof} values in {unit}") })
}
