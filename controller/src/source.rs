//! Whose parameters act: live, last good, nominal, and back.
//!
//! ```text
//! live ──silent, or refused, for parameter_timeout_s──▶ last good ──worse than nominal for 2 s──▶ nominal
//!   ▲                                                     │  ▲                                     │ │
//!   └──return_after acceptable sets in a row──────────────┘  └──better than nominal for 2 s────────┘ │
//!   └────────────────────────────────────────────────────────────────────────────────────────────────┘
//! ```
//!
//! One step down at once, or two, where the inertia matrix fails at the pose that the arm has come to.

use rivet_ipc_schema::{MAX_PARAMETERS, ParameterSource, SourceReason};

/// Base parameters; entries beyond the model's count are zero.
pub(crate) type Values = [f64; MAX_PARAMETERS];

/// Time for which one set must predict worse than another before that counts \[s\].
const PATIENCE_S: f64 = 2.0;

/// The chain of sources.
pub(crate) struct Sources {
    nominal: Values,
    last_good: Option<Values>,
    live: Values,
    source: ParameterSource,
    reason: SourceReason,
    timeout: u64,
    return_after: u32,
    /// Periods between two sets that count towards the row: sets that come closer are judged by the same torques.
    apart: u64,
    patience: u64,
    /// Periods since a set was accepted, and since one came at all.
    accepted_for: u64,
    heard_for: u64,
    streak: u32,
    /// Periods since a set last counted.
    counted_for: u64,
    /// Periods for which the comparison with nominal has spoken for a change.
    for_change: u64,
    switches: u64,
}

impl Sources {
    /// Starts on `nominal` parameters. `timeout` and `apart` in periods, `return_after` in sets.
    pub(crate) fn new(nominal: &Values, timeout: u64, return_after: u32, apart: u64, period_s: f64) -> Sources {
        Sources {
            nominal: *nominal,
            last_good: None,
            live: *nominal,
            source: ParameterSource::Nominal,
            reason: SourceReason::Start,
            timeout,
            return_after,
            apart,
            patience: (PATIENCE_S / period_s).ceil() as u64,
            accepted_for: u64::MAX,
            heard_for: u64::MAX,
            streak: 0,
            counted_for: u64::MAX,
            for_change: 0,
            switches: 0,
        }
    }

    /// Parameters of an earlier run have passed the gate: they act instead of the nominal ones.
    pub(crate) fn recall(&mut self, stored: &Values) {
        self.last_good = Some(*stored);
        self.switch(ParameterSource::LastGood, SourceReason::Stored);
    }

    /// The parameters that should act.
    pub(crate) fn target(&self) -> &Values {
        match (self.source, &self.last_good) {
            (ParameterSource::Live, _) => &self.live,
            (ParameterSource::LastGood, Some(values)) => values,
            _ => &self.nominal,
        }
    }

    pub(crate) fn nominal(&self) -> &Values {
        &self.nominal
    }

    pub(crate) fn last_good(&self) -> Option<&Values> {
        self.last_good.as_ref()
    }

    /// The set accepted last, while it waits for its row to be long enough.
    pub(crate) fn waiting(&self) -> Option<&Values> {
        (self.source != ParameterSource::Live && self.alive()).then_some(&self.live)
    }

    pub(crate) fn source(&self) -> ParameterSource {
        self.source
    }

    pub(crate) fn reason(&self) -> SourceReason {
        self.reason
    }

    pub(crate) fn switches(&self) -> u64 {
        self.switches
    }

    /// Whether sets have been passing the gate until now.
    pub(crate) fn alive(&self) -> bool {
        self.accepted_for < self.timeout
    }

    fn switch(&mut self, source: ParameterSource, reason: SourceReason) {
        // A live set that is as good as the last good one has taken its place already ([`keep`](Self::keep)).
        if source == ParameterSource::LastGood && self.last_good.is_none() {
            self.last_good = Some(self.live);
        }
        self.source = source;
        self.reason = reason;
        self.switches += 1;
        self.for_change = 0;
        self.streak = 0;
    }

    /// A set passed the gate.
    pub(crate) fn accept(&mut self, values: &Values) {
        self.accepted_for = 0;
        self.heard_for = 0;
        self.live = *values;
        if self.source != ParameterSource::Live && (self.streak == 0 || self.counted_for >= self.apart) {
            self.streak += 1;
            self.counted_for = 0;
            if self.streak >= self.return_after {
                self.switch(ParameterSource::Live, SourceReason::Adopted);
            }
        }
    }

    /// A set came and did not pass.
    pub(crate) fn refuse(&mut self) {
        self.heard_for = 0;
        self.streak = 0;
    }

    /// The live set has proven itself on recent torques: it is what a silent daemon leaves behind.
    pub(crate) fn keep(&mut self) {
        if self.source == ParameterSource::Live {
            self.last_good = Some(self.live);
        }
    }

    /// The acting set is no arm's where the arm is now; `kept_is_sound`: the last good one is. Else that has not proven itself
    /// after all, and is kept no longer.
    pub(crate) fn distrust(&mut self, kept_is_sound: bool) {
        match self.source {
            ParameterSource::Nominal => {}
            ParameterSource::Live if kept_is_sound => {
                self.switch(ParameterSource::LastGood, SourceReason::InertiaNotPositive);
            }
            _ => {
                self.last_good = None;
                self.switch(ParameterSource::Nominal, SourceReason::InertiaNotPositive);
            }
        }
    }

    /// `periods` have gone by.
    pub(crate) fn advance(&mut self, periods: u64) {
        self.accepted_for = self.accepted_for.saturating_add(periods);
        self.heard_for = self.heard_for.saturating_add(periods);
        self.counted_for = self.counted_for.saturating_add(periods);
        if self.source == ParameterSource::Live && self.accepted_for >= self.timeout {
            let silent = self.heard_for >= self.timeout;
            let reason = if silent { SourceReason::Silent } else { SourceReason::Refused };
            self.switch(ParameterSource::LastGood, reason);
        }
    }

    /// What recent torques say, `periods` after they last said something: whether the acting set is worse than the nominal
    /// one, or, while that acts, whether the last good one is better.
    pub(crate) fn compare(&mut self, speaks_for_change: bool, periods: u64) {
        self.for_change = if speaks_for_change { self.for_change.saturating_add(periods) } else { 0 };
        if self.for_change < self.patience {
            return;
        }
        match self.source {
            ParameterSource::Nominal => self.switch(ParameterSource::LastGood, SourceReason::BetterThanNominal),
            _ => self.switch(ParameterSource::Nominal, SourceReason::WorseThanNominal),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(x: f64) -> Values {
        [x; MAX_PARAMETERS]
    }

    fn sources() -> Sources {
        Sources::new(&values(0.0), 100, 3, 10, 0.001)
    }

    /// Sets that come with enough time between them to be judged by other torques.
    fn accept_apart(s: &mut Sources, sets: &[f64]) {
        for x in sets {
            s.advance(10);
            s.accept(&values(*x));
        }
    }

    #[test]
    fn live_needs_a_row_of_acceptable_sets_and_a_silent_daemon_leaves_the_last_good_ones() {
        let mut s = sources();
        assert_eq!((s.source(), s.reason()), (ParameterSource::Nominal, SourceReason::Start));
        accept_apart(&mut s, &[1.0, 1.0]);
        s.refuse();
        accept_apart(&mut s, &[1.0, 1.0]);
        assert_eq!(s.source(), ParameterSource::Nominal, "the row was broken");
        accept_apart(&mut s, &[2.0]);
        assert_eq!((s.source(), s.target()[0]), (ParameterSource::Live, 2.0));
        s.advance(99);
        assert_eq!(s.source(), ParameterSource::Live);
        s.advance(1);
        assert_eq!((s.source(), s.reason(), s.target()[0]), (ParameterSource::LastGood, SourceReason::Silent, 2.0));
        accept_apart(&mut s, &[3.0, 4.0, 5.0]);
        assert_eq!((s.source(), s.target()[0]), (ParameterSource::Live, 5.0));
        for _ in 0..100 {
            s.refuse();
            s.advance(1);
        }
        assert_eq!((s.source(), s.reason()), (ParameterSource::LastGood, SourceReason::Refused));
    }

    #[test]
    fn sets_that_the_same_torques_judge_count_once_and_the_last_waits() {
        let mut s = sources();
        assert_eq!(s.waiting(), None);
        for x in 1..=9 {
            s.accept(&values(f64::from(x)));
            s.advance(1);
        }
        assert_eq!((s.source(), s.waiting().map(|x| x[0])), (ParameterSource::Nominal, Some(9.0)));
        accept_apart(&mut s, &[2.0]);
        assert_eq!(s.source(), ParameterSource::Nominal, "two have counted");
        s.advance(9);
        s.accept(&values(3.0));
        assert_eq!(s.source(), ParameterSource::Nominal, "not yet apart");
        s.advance(1);
        s.accept(&values(4.0));
        assert_eq!((s.source(), s.waiting()), (ParameterSource::Live, None));
        s.advance(100);
        assert_eq!(
            (s.source(), s.waiting()),
            (ParameterSource::LastGood, None),
            "what was accepted long ago does not wait"
        );
    }

    #[test]
    fn what_is_no_arm_here_gives_way_at_once_and_is_not_kept() {
        let mut s = sources();
        accept_apart(&mut s, &[1.0, 1.0, 1.0]);
        s.keep();
        s.accept(&values(2.0));
        s.distrust(true);
        assert_eq!((s.source(), s.reason()), (ParameterSource::LastGood, SourceReason::InertiaNotPositive));
        assert_eq!(s.target()[0], 1.0);
        s.distrust(true);
        assert_eq!((s.source(), s.reason()), (ParameterSource::Nominal, SourceReason::InertiaNotPositive));
        assert_eq!((s.target()[0], s.last_good()), (0.0, None));
        s.distrust(false);
        assert_eq!(s.switches(), 3, "nominal stays");
        accept_apart(&mut s, &[3.0, 3.0, 3.0]);
        s.distrust(false);
        assert_eq!((s.source(), s.last_good()), (ParameterSource::Nominal, None), "live, with nothing sound behind it");
    }

    #[test]
    fn what_predicts_worse_than_nominal_for_long_gives_way_and_may_come_back() {
        let mut s = sources();
        s.recall(&values(1.0));
        assert_eq!((s.source(), s.reason()), (ParameterSource::LastGood, SourceReason::Stored));
        s.compare(true, 1999);
        s.compare(false, 1);
        s.compare(true, 1999);
        assert_eq!(s.source(), ParameterSource::LastGood);
        s.compare(true, 1);
        assert_eq!((s.source(), s.target()[0]), (ParameterSource::Nominal, 0.0));
        s.compare(true, 2000);
        assert_eq!((s.source(), s.reason()), (ParameterSource::LastGood, SourceReason::BetterThanNominal));
        assert_eq!(s.target()[0], 1.0);
    }
}
