//! Stamps of ROS on this machine's monotonic clock.

/// Latency that the stamps of a synchronised clock may show \[ns\]: then the wall clock is the measure.
const SYNCHRONISED_NS: std::ops::Range<i64> = -5_000_000..500_000_000;
/// Least latency of a span that needs no correction \[ns\].
const UNTOUCHED_NS: std::ops::Range<i64> = 0..5_000_000;
/// How far in the future a stamp may be before its clock has been set, and not drifted \[ns\].
const AHEAD_NS: i64 = 100_000_000;
/// Least latency, and spread of the latency in a span, of a clock that stood still, as of a simulation that paused \[ns\]. Messages
/// that waited somewhere come ever later or ever earlier: their stamps are right.
const STOOD_STILL_NS: i64 = 1_000_000_000;
const STEADY_NS: i64 = 50_000_000;
/// Spans in a row in which it has to be so: a machine without time also sends late for a while.
const STEADY_SPANS: u32 = 10;
/// How long the least latency is looked for \[ns\].
const SPAN_NS: u64 = 1_000_000_000;
/// Largest correction of a clock that drifts, in parts of time: rates and derivatives stay as they are.
const SLEW: f64 = 2e-4;
/// How long stamps may be behind before they are a clock that was set back \[ns\].
const BACK_NS: u64 = 500_000_000;
/// Share of a deviation from the period that a message without stamp is corrected by.
const ARRIVAL_SHARE: f64 = 0.02;
/// Periods of deviation from which on a message without stamp is simply new.
const ANEW_PERIODS: f64 = 20.0;

/// What a stamp is on the monotonic clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mapped {
    /// The instant \[ns\], later than the one before.
    At(u64),
    /// There is no stamp (0): the arrival, smoothed by the period \[ns\].
    Arrival(u64),
    /// The sending clock was set: the instant \[ns\] is the arrival, and may be before the last one.
    Stepped(u64),
    /// Not later than the one before: the message is old or a repetition.
    Back,
}

/// Maps stamps to `CLOCK_MONOTONIC`. Differences between stamps are kept, but for a correction of at most 0.02 % where clocks drift.
#[derive(Clone, Debug)]
pub(crate) struct Stamps {
    period_ns: f64,
    /// Monotonic minus stamp \[ns\].
    offset_ns: Option<f64>,
    stamp_ns: i64,
    mapped_ns: u64,
    back_since_ns: Option<u64>,
    /// Least and most latency of this span, and when the span began.
    least_ns: i64,
    most_ns: i64,
    span_ns: u64,
    /// Spans in a row in which messages came steadily late.
    steady: u32,
    slew: f64,
}

impl Stamps {
    /// `period_s`: time between messages \[s\], for those without stamps.
    pub(crate) fn new(period_s: f64) -> Stamps {
        Stamps {
            period_ns: period_s * 1e9,
            offset_ns: None,
            stamp_ns: 0,
            mapped_ns: 0,
            back_since_ns: None,
            least_ns: i64::MAX,
            most_ns: i64::MIN,
            span_ns: 0,
            steady: 0,
            slew: 0.0,
        }
    }

    /// Forgets the clock of a sender: another one follows.
    pub(crate) fn restart(&mut self) {
        let mapped_ns = self.mapped_ns;
        *self = Stamps { mapped_ns, ..Stamps::new(self.period_ns * 1e-9) };
    }

    /// Maps `stamp_ns` of a message that came at `arrival_ns` of the monotonic and `wall_ns` of the wall clock \[ns\].
    pub(crate) fn map(&mut self, stamp_ns: i64, arrival_ns: u64, wall_ns: i64) -> Mapped {
        if stamp_ns == 0 {
            return Mapped::Arrival(self.without_stamp(arrival_ns));
        }
        let arrival = arrival_ns.cast_signed();
        let Some(offset) = self.offset_ns else {
            let latency = wall_ns.saturating_sub(stamp_ns);
            let offset = if SYNCHRONISED_NS.contains(&latency) { arrival - wall_ns } else { arrival - stamp_ns };
            self.anchor(stamp_ns, offset, arrival_ns);
            return Mapped::At(self.later(stamp_ns.saturating_add(offset)));
        };
        let step = stamp_ns - self.stamp_ns;
        if step <= 0 {
            let since = *self.back_since_ns.get_or_insert(arrival_ns);
            if arrival_ns.saturating_sub(since) < BACK_NS {
                return Mapped::Back;
            }
            return self.step(stamp_ns, arrival_ns);
        }
        self.back_since_ns = None;
        let offset = offset + self.slew * step as f64;
        self.offset_ns = Some(offset);
        self.stamp_ns = stamp_ns;
        let mapped = stamp_ns.saturating_add(offset.round() as i64);
        let latency = arrival - mapped;
        if latency < -AHEAD_NS {
            return self.step(stamp_ns, arrival_ns);
        }
        self.least_ns = self.least_ns.min(latency);
        self.most_ns = self.most_ns.max(latency);
        if arrival_ns.saturating_sub(self.span_ns) >= SPAN_NS {
            let (least, most) = (self.least_ns, self.most_ns);
            (self.least_ns, self.most_ns, self.span_ns, self.slew) = (i64::MAX, i64::MIN, arrival_ns, 0.0);
            let is_steady = least > STOOD_STILL_NS && most - least < STEADY_NS;
            self.steady = if is_steady { self.steady + 1 } else { 0 };
            if self.steady == STEADY_SPANS {
                return self.step(stamp_ns, arrival_ns);
            }
            if !UNTOUCHED_NS.contains(&least) {
                self.slew = (least as f64 * 1e-10).clamp(-SLEW, SLEW);
            }
        }
        Mapped::At(self.later(mapped))
    }

    fn anchor(&mut self, stamp_ns: i64, offset_ns: i64, arrival_ns: u64) {
        self.offset_ns = Some(offset_ns as f64);
        self.stamp_ns = stamp_ns;
        self.back_since_ns = None;
        (self.least_ns, self.most_ns, self.span_ns) = (i64::MAX, i64::MIN, arrival_ns);
        (self.steady, self.slew) = (0, 0.0);
    }

    /// Begins anew at the arrival, also where that is before what was mapped last: instants that stand still would be worse.
    fn step(&mut self, stamp_ns: i64, arrival_ns: u64) -> Mapped {
        self.anchor(stamp_ns, arrival_ns.cast_signed() - stamp_ns, arrival_ns);
        self.mapped_ns = arrival_ns.max(1);
        Mapped::Stepped(self.mapped_ns)
    }

    fn without_stamp(&mut self, arrival_ns: u64) -> u64 {
        let due = self.mapped_ns as f64 + self.period_ns;
        let off = arrival_ns as f64 - due;
        let instant = if self.mapped_ns == 0 || off.abs() > ANEW_PERIODS * self.period_ns {
            arrival_ns.cast_signed()
        } else {
            self.mapped_ns.cast_signed() + (self.period_ns + ARRIVAL_SHARE * off).round() as i64
        };
        self.later(instant)
    }

    /// Later than all before, and never 0, which stands for no stamp.
    fn later(&mut self, instant_ns: i64) -> u64 {
        self.mapped_ns = u64::try_from(instant_ns).unwrap_or(0).max(self.mapped_ns + 1);
        self.mapped_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    /// The wall clock minus the monotonic one \[ns\].
    const WALL: i64 = 1_764_000_000_000_000_000;

    fn wall(monotonic_ns: u64) -> i64 {
        WALL + monotonic_ns.cast_signed()
    }

    #[test]
    fn synchronised_stamps_are_the_instants_whatever_the_latency() {
        let mut stamps = Stamps::new(0.002);
        for k in 1..5000 {
            let measured = 1_000_000_000 + 2 * MS * k;
            let arrival = measured + 300_000 + (k % 7) * 100_000;
            assert_eq!(stamps.map(wall(measured), arrival, wall(arrival)), Mapped::At(measured), "{k}");
        }
    }

    #[test]
    fn stamps_of_a_simulation_keep_their_differences() {
        let mut stamps = Stamps::new(0.002);
        let mut before: Option<u64> = None;
        for k in 1..2000_u64 {
            let arrival = 77_000_000_000 + 2 * MS * k + (k % 5) * 50_000;
            let Mapped::At(at) = stamps.map((2 * MS * k).cast_signed(), arrival, wall(arrival)) else { panic!("{k}") };
            if let Some(before) = before {
                assert!((at - before).abs_diff(2 * MS) <= 400, "0.02 % at most: {}", at - before);
            }
            before = Some(at);
            assert!(arrival.abs_diff(at) < MS, "{k}");
        }
    }

    #[test]
    fn a_clock_that_drifts_is_followed() {
        let mut stamps = Stamps::new(0.002);
        let mut worst = 0;
        // 100 millionths fast, for ten minutes.
        for k in 1..300_000_u64 {
            let arrival = 5_000_000_000 + 2 * MS * k;
            let stamp = 1_000_000_000 + (2.0 * MS as f64 * k as f64 * 1.0001) as i64;
            let Mapped::At(at) = stamps.map(stamp, arrival, wall(arrival)) else { panic!("{k}") };
            worst = worst.max(arrival.abs_diff(at));
        }
        assert!(worst < 10 * MS, "{worst} ns away");
    }

    #[test]
    fn a_stamp_that_goes_back_is_refused_and_a_clock_that_was_set_is_followed() {
        let mut stamps = Stamps::new(0.002);
        let stamp = |k: u64| (9_000_000_000 + 2 * MS * k).cast_signed();
        let arrival = |k: u64| 1_000_000_000 + 2 * MS * k;
        assert_eq!(stamps.map(stamp(1), arrival(1), 0), Mapped::At(arrival(1)));
        assert_eq!(stamps.map(stamp(1), arrival(2), 0), Mapped::Back, "a repetition");
        assert_eq!(stamps.map(stamp(3), arrival(3), 0), Mapped::At(arrival(3)));
        // A simulation begins anew.
        let mut found = Vec::new();
        for k in 4..400 {
            found.push(stamps.map((2 * MS * k).cast_signed(), arrival(k), 0));
        }
        let refused = found.iter().take_while(|found| **found == Mapped::Back).count();
        assert_eq!(refused, 250, "half a second");
        assert!(matches!(found[refused], Mapped::Stepped(_)));
        assert!(found[refused + 1..].iter().all(|found| matches!(found, Mapped::At(_))));
    }

    #[test]
    fn a_clock_that_was_set_forward_or_stood_still_is_followed() {
        let mut stamps = Stamps::new(0.002);
        let (mut last, mut steps) = (0, Vec::new());
        for k in 1..9000_u64 {
            // Set forward by an hour at 500, paused for a minute at 2000.
            let arrival = 5_000_000_000 + 2 * MS * k + if k > 2000 { 60_000 * MS } else { 0 };
            let jump = if k > 500 { 3_600_000_000_000 } else { 0 };
            let mapped = stamps.map((1_000_000_000 + 2 * MS * k).cast_signed() + jump, arrival, 0);
            let (Mapped::At(at) | Mapped::Stepped(at)) = mapped else { panic!("{mapped:?}") };
            assert!(at > last && at <= arrival + 2 * MS, "{k}");
            if matches!(mapped, Mapped::Stepped(_)) {
                steps.push(k);
            }
            last = at;
        }
        // After ten seconds: a machine without time also sends late.
        assert_eq!(steps[0], 501, "at once: nothing is measured in the future");
        assert!(steps.len() == 2 && (7000..7600).contains(&steps[1]), "{steps:?}");
    }

    #[test]
    fn messages_that_waited_keep_their_stamps() {
        let mut stamps = Stamps::new(0.002);
        for k in 1..6000_u64 {
            let measured = 5_000_000_000 + 2 * MS * k;
            // Nothing comes for four seconds; then what waited comes five times as fast.
            let arrival =
                if k < 1000 { measured } else { measured.max(5_000_000_000 + 6000 * MS + 2 * MS * (k - 1000) / 5) };
            let Mapped::At(at) = stamps.map(wall(measured), arrival, wall(arrival)) else { panic!("{k}") };
            assert!(at.abs_diff(measured) < 2 * MS, "{k}");
        }
    }

    #[test]
    fn without_stamps_the_arrival_counts_smoothed() {
        let mut stamps = Stamps::new(0.002);
        let mut before = 0;
        for k in 1..1000_u64 {
            let arrival = 1_000_000_000 + 2 * MS * k + (k % 3) * MS;
            let Mapped::Arrival(at) = stamps.map(0, arrival, 0) else { panic!("{k}") };
            assert!(before == 0 || (at - before).abs_diff(2 * MS) < 100_000, "{}", at - before);
            before = at;
        }
        let Mapped::Arrival(at) = stamps.map(0, 60_000_000_000, 0) else { panic!("no stamp") };
        assert_eq!(at, 60_000_000_000, "after a pause");
    }
}
