//! Faults of a log's channels: their names, figures and texts.

use std::f64::consts::TAU;

use crate::policy::POLICY;

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
    /// Share of the nominal bodies' gravity torque that the torque contains: gravity was removed from it.
    Weightless(f64),
    /// Positions and torques are those of another joint, from 0, whose are this one's.
    Exchanged(usize),
    /// Torque is sampled more slowly than the log's rows and held in between: the run is evaluated at its rate.
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
    /// Positions are sampled more slowly than the log's rows and held in between: the run is evaluated at their rate.
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
        if dissipates < POLICY.screening.max_energy_correlation && alike < POLICY.screening.min_model_correlation {
            Some(LogFault::Sign(dissipates))
        } else if alike < POLICY.screening.max_opposite_correlation && dissipates < 0.0 {
            Some(LogFault::Opposite(alike))
        } else if alike > POLICY.screening.min_shape_correlation
            && !(1.0 / POLICY.screening.min_unit_ratio..POLICY.screening.min_unit_ratio).contains(&scale)
        {
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
    pub(crate) fn is_of_the_whole(&self) -> bool {
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
        self.text_of_motion().or_else(|| self.text_of_torque()).unwrap_or_default()
    }

    /// Of the positions, and of all channels; none of a fault of the torque.
    fn text_of_motion(self) -> Option<String> {
        Some(match self {
            LogFault::PositionSign { as_logged, turned } => format!(
                "the sign of this position is wrong: the residual of a rigid arm with friction is {} times the noise \
                 over all joints as logged, and {} times with the other sign; not evaluated",
                digits(as_logged),
                digits(turned)
            ),
            LogFault::Exchanged(other) => format!(
                "by the model these are position and torque of joint {}, and that joint has those of this one: are \
                 two joints exchanged?",
                other + 1
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
            _ => return None,
        })
    }

    /// Of the torque; none of a fault of the positions.
    fn text_of_torque(self) -> Option<String> {
        Some(match self {
            LogFault::Sign(v) => format!(
                "torque runs against motion (correlation {v:.2}): its friction would generate energy, so the sign of \
                 this torque or position, or the scale, is wrong"
            ),
            LogFault::Opposite(v) => format!(
                "torque opposes the model's (correlation {v:.2}) and friction explains none of it: the sign of this \
                 torque, or of this position, is wrong"
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
            LogFault::PositionSign { .. }
            | LogFault::Exchanged(..)
            | LogFault::Glitches(..)
            | LogFault::Wrapped(..)
            | LogFault::Jump { .. }
            | LogFault::Frozen { .. }
            | LogFault::Held { .. }
            | LogFault::Steps { .. }
            | LogFault::Still(..) => return None,
        })
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
