//! Where a period's time goes: phases, histograms, the worst periods and why they were long.

use rivet_estimation::Phase;
use rivet_ipc_schema::{
    HISTOGRAM_BINS, Health, LoopPhase, PHASES, PeriodCause, Timing as TimingMessage, WORST_PERIODS,
};
use rivet_realtime::{LogHistogram, ThreadUsage, now_ns};

/// One of the worst periods.
#[derive(Clone, Copy, Debug, Default)]
struct Bad {
    total_ns: u64,
    due_ns: u64,
    phases: [u64; PHASES],
    cause: u32,
}

/// For how long a period is one of the worst \[ns\]: what happened once must not hide for months what happens now. The largest
/// of each phase ever is in its histogram's message.
const WORST_AGE_NS: u64 = 3_600_000_000_000;

/// What the loop measures about itself. Nothing allocates; the clock is the vDSO's.
#[derive(Debug)]
pub(crate) struct Timing {
    pub(crate) periods: u64,
    pub(crate) overruns: u64,
    pub(crate) catch_up_limited: u64,
    pub(crate) dropped: u64,
    pub(crate) late_sets: u64,
    period_ns: u64,
    wake: LogHistogram,
    work: LogHistogram,
    phases: [LogHistogram; PHASES],
    /// Of the period that runs.
    now: [u64; PHASES],
    due_ns: u64,
    mark_ns: u64,
    worst: [Bad; WORST_PERIODS],
    kept: usize,
    /// The kernel's counters when they were last read: a system call, made only when a period was one of the worst and with
    /// every message.
    usage: ThreadUsage,
}

impl Timing {
    pub(crate) fn new(period_ns: u64) -> Timing {
        Timing {
            periods: 0,
            overruns: 0,
            catch_up_limited: 0,
            dropped: 0,
            late_sets: 0,
            period_ns,
            wake: LogHistogram::new(),
            work: LogHistogram::new(),
            phases: [const { LogHistogram::new() }; PHASES],
            now: [0; PHASES],
            due_ns: 0,
            mark_ns: 0,
            worst: [Bad::default(); WORST_PERIODS],
            kept: 0,
            usage: ThreadUsage::now(),
        }
    }

    /// The thread woke `lateness_ns` after the period was due; returns the time.
    pub(crate) fn begin(&mut self, lateness_ns: u64) -> u64 {
        let now = now_ns();
        self.now = [0; PHASES];
        self.now[LoopPhase::Wait as usize] = lateness_ns;
        self.due_ns = now.saturating_sub(lateness_ns);
        self.mark_ns = now;
        now
    }

    /// A phase is done: what has passed since the last was its.
    pub(crate) fn done(&mut self, phase: LoopPhase) {
        let now = now_ns();
        self.now[phase as usize] += now.saturating_sub(self.mark_ns);
        self.mark_ns = now;
    }

    pub(crate) fn estimator_done(&mut self, phase: Phase) {
        self.done(match phase {
            Phase::Differentiate => LoopPhase::Differentiate,
            Phase::Model => LoopPhase::Model,
            Phase::Estimate => LoopPhase::Estimate,
            Phase::Supervise => LoopPhase::Supervise,
        });
    }

    /// Work of the period until the last phase that is done \[ns\].
    pub(crate) fn so_far(&self) -> u64 {
        self.now.iter().sum::<u64>() - self.now[LoopPhase::Wait as usize]
    }

    /// The period is over; returns its work \[ns\].
    pub(crate) fn end(&mut self) -> u64 {
        self.periods += 1;
        let wait = self.now[LoopPhase::Wait as usize];
        let total: u64 = self.now.iter().sum();
        let work = total - wait;
        self.wake.record(wait);
        self.work.record(work);
        for (histogram, ns) in self.phases.iter_mut().zip(self.now) {
            if ns > 0 {
                histogram.record(ns);
            }
        }
        let full = self.kept == WORST_PERIODS;
        if !full || total > self.worst[WORST_PERIODS - 1].total_ns {
            let usage = ThreadUsage::now();
            let bad = Bad {
                total_ns: total,
                due_ns: self.due_ns,
                phases: self.now,
                cause: cause(&self.now, &self.usage, &usage).into(),
            };
            self.usage = usage;
            // Sorted, the worst first: at most 32 moves.
            let mut at = if full { WORST_PERIODS - 1 } else { self.kept };
            self.kept = (self.kept + 1).min(WORST_PERIODS);
            while at > 0 && self.worst[at - 1].total_ns < total {
                self.worst[at] = self.worst[at - 1];
                at -= 1;
            }
            self.worst[at] = bad;
        }
        work
    }

    /// Leaves out what is too long ago; the order stays.
    fn forget_old(&mut self, now_ns: u64) {
        let mut kept = 0;
        for k in 0..self.kept {
            if now_ns.saturating_sub(self.worst[k].due_ns) <= WORST_AGE_NS {
                self.worst[kept] = self.worst[k];
                kept += 1;
            }
        }
        self.worst[kept..].fill(Bad::default());
        self.kept = kept;
    }

    pub(crate) fn write_health(&self, health: &mut Health) {
        health.periods = self.periods;
        health.overruns = self.overruns;
        health.catch_up_limited = self.catch_up_limited;
        health.dropped_messages = self.dropped;
        health.late_sets = self.late_sets;
        health.wake_histogram = *self.wake.counts();
        health.work_histogram = *self.work.counts();
        health.worst_wake_ns = self.wake.max();
        health.worst_work_ns = self.work.max();
    }

    pub(crate) fn write(&mut self, out: &mut TimingMessage) {
        self.forget_old(now_ns());
        // So that what comes next is not blamed on what was before.
        self.usage = ThreadUsage::now();
        out.periods = self.periods;
        out.period_ns = self.period_ns;
        out.count = self.kept as u32;
        for (p, histogram) in self.phases.iter().enumerate() {
            out.phase_max_ns[p] = histogram.max();
            out.phase_histogram[p * HISTOGRAM_BINS..(p + 1) * HISTOGRAM_BINS].copy_from_slice(histogram.counts());
        }
        for (k, bad) in self.worst.iter().enumerate() {
            out.worst_stamp_ns[k] = bad.due_ns;
            out.worst_cause[k] = bad.cause;
            for (phase, ns) in out.worst_phase_ns[k * PHASES..(k + 1) * PHASES].iter_mut().zip(bad.phases) {
                *phase = u32::try_from(ns).unwrap_or(u32::MAX);
            }
        }
    }
}

/// Why a period was long. What the kernel's counters say was between `before` and `after`, up to one message's time ago.
fn cause(phases: &[u64; PHASES], before: &ThreadUsage, after: &ThreadUsage) -> PeriodCause {
    let wait = phases[LoopPhase::Wait as usize];
    let work: u64 = phases.iter().sum::<u64>() - wait;
    if wait >= work {
        PeriodCause::LateWakeUp
    } else if after.faults > before.faults {
        PeriodCause::PageFault
    } else if after.cpu != before.cpu {
        PeriodCause::Migration
    } else if after.involuntary > before.involuntary {
        PeriodCause::InvoluntarySwitch
    } else if phases[LoopPhase::Read as usize] >= work / 2 {
        PeriodCause::LongRead
    } else {
        PeriodCause::OwnWork
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(wait: u64, read: u64, model: u64) -> [u64; PHASES] {
        let mut phases = [0; PHASES];
        phases[LoopPhase::Wait as usize] = wait;
        phases[LoopPhase::Read as usize] = read;
        phases[LoopPhase::Model as usize] = model;
        phases
    }

    #[test]
    fn every_cause_has_its_sign() {
        let quiet = ThreadUsage { faults: 5, involuntary: 7, cpu: 1 };
        let said = |phases, after: ThreadUsage| cause(&phases, &quiet, &after);
        assert_eq!(said(of(900, 10, 100), quiet), PeriodCause::LateWakeUp);
        assert_eq!(said(of(10, 800, 100), quiet), PeriodCause::LongRead);
        assert_eq!(said(of(10, 100, 800), quiet), PeriodCause::OwnWork);
        assert_eq!(said(of(10, 100, 800), ThreadUsage { faults: 6, ..quiet }), PeriodCause::PageFault);
        assert_eq!(said(of(10, 100, 800), ThreadUsage { cpu: 0, ..quiet }), PeriodCause::Migration);
        assert_eq!(said(of(10, 800, 80), ThreadUsage { involuntary: 8, ..quiet }), PeriodCause::InvoluntarySwitch);
        assert_eq!(said(of(u64::from(u32::MAX), 0, 0), quiet), PeriodCause::LateWakeUp);
    }

    /// A thousand periods of known length: the 32 longest are kept, sorted, each with its phases.
    #[test]
    fn the_worst_periods_are_kept_in_order() {
        let mut timing = Timing::new(1_000_000);
        for k in 0..1000_u64 {
            timing.begin(0);
            timing.now = of(0, k * 7919 % 1000 + 1, 0);
            timing.end();
        }
        let mut message = TimingMessage::default();
        timing.write(&mut message);
        let read: Vec<u32> = message.worst_phase_ns.chunks(PHASES).map(|phases| phases[1]).collect();
        assert_eq!(read, (969..=1000).rev().collect::<Vec<u32>>());
        assert_eq!((message.count, message.periods), (32, 1000));
        let counted: u32 = message.phase_histogram[HISTOGRAM_BINS..2 * HISTOGRAM_BINS].iter().sum();
        assert_eq!((counted, message.phase_max_ns[1]), (1000, 1000));
    }

    /// An hour later the worst of before are gone, and what came since stands in order.
    #[test]
    fn the_worst_periods_age() {
        let mut timing = Timing::new(1_000_000);
        for k in 0..40_u64 {
            timing.begin(0);
            timing.now = of(0, 1000 * (k + 1), 0);
            timing.end();
        }
        let now = now_ns();
        for (k, bad) in timing.worst.iter_mut().enumerate() {
            bad.due_ns = now + if k % 2 == 0 { 0 } else { WORST_AGE_NS };
        }
        timing.forget_old(now + WORST_AGE_NS + 1);
        assert_eq!(timing.kept, 16);
        let total: Vec<u64> = timing.worst[..17].iter().map(|bad| bad.total_ns / 1000).collect();
        assert_eq!(total, (0..16).map(|k| 39 - 2 * k).chain([0]).collect::<Vec<u64>>());
        timing.begin(0);
        timing.now = of(0, 500, 0);
        timing.end();
        assert_eq!((timing.kept, timing.worst[16].total_ns), (17, 500));
    }
}
