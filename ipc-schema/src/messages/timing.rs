//! `rivet.Timing.v1`

use iceoryx2::prelude::ZeroCopySend;

use super::{HISTOGRAM_BINS, Stamped, message, wire_enum};

/// Phases of a period ([`LoopPhase`]).
pub const PHASES: usize = 7;

/// Worst periods that are kept.
pub const WORST_PERIODS: usize = 32;

/// Where the daemon's real-time thread spends its time, with every health message, on service `rivet/<robot>/timing`.
///
/// Counts run since the daemon's start.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[type_name("rivet.Timing.v1")]
#[repr(C)]
pub struct Timing {
    /// When this was written, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Periods of the real-time thread.
    pub periods: u64,
    /// The time between periods that it is to keep \[ns\].
    pub period_ns: u64,
    /// How many entries of the arrays of worst periods are in use.
    pub count: u32,
    /// Zero. Padding is spelt out, so the layout can be read off the source.
    pub reserved: u32,
    /// Longest time of each phase \[ns\].
    pub phase_max_ns: [u64; PHASES],
    /// Time of each phase: 32 bins of the first phase, then of the next; bins as of [`Health`](super::Health).
    pub phase_histogram: [u32; PHASES * HISTOGRAM_BINS],
    /// When each of the worst periods of the last hour was due, `CLOCK_MONOTONIC` \[ns\], the worst first.
    pub worst_stamp_ns: [u64; WORST_PERIODS],
    /// Time of each phase of it \[ns\], seven numbers a period; the wait is the lateness of the wake-up.
    pub worst_phase_ns: [u32; WORST_PERIODS * PHASES],
    /// A [`PeriodCause`] each.
    pub worst_cause: [u32; WORST_PERIODS],
}

wire_enum!(
    /// A part of a period.
    LoopPhase {
        /// From when the period was due to the wake-up.
        Wait = 0,
        /// Samples and requests out of shared memory.
        Read = 1,
        /// Checks of the samples, velocities and accelerations.
        Differentiate = 2,
        /// Regressors, instruments and the model filter.
        Model = 3,
        /// Sums of the window, least squares, residuals.
        Estimate = 4,
        /// What may move, the solution, standard deviations.
        Supervise = 5,
        /// Messages for the publishing thread.
        Publish = 6,
    }
);

wire_enum!(
    /// Why a period was long ([`Timing::worst_cause`]).
    PeriodCause {
        /// The thread woke late.
        LateWakeUp = 0,
        /// Reading took the most time.
        LongRead = 1,
        /// The work itself took it.
        OwnWork = 2,
        /// The thread met pages that were not in memory.
        PageFault = 3,
        /// The thread was moved to another processor.
        Migration = 4,
        /// The processor was taken from the thread.
        InvoluntarySwitch = 5,
    }
);

message!(Timing v 1, size 2264 align 8, empty Timing {
    stamp_ns: 0, periods: 0, period_ns: 0, count: 0, reserved: 0, phase_max_ns: [0; PHASES],
    phase_histogram: [0; PHASES * HISTOGRAM_BINS], worst_stamp_ns: [0; WORST_PERIODS],
    worst_phase_ns: [0; WORST_PERIODS * PHASES], worst_cause: [0; WORST_PERIODS],
}, {
    stamp_ns @ 0, periods @ 8, period_ns @ 16, count @ 24, reserved @ 28, phase_max_ns @ 32, phase_histogram @ 88,
    worst_stamp_ns @ 984, worst_phase_ns @ 1240, worst_cause @ 2136,
});

impl Stamped for Timing {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
