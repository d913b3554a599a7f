//! Which motion the instruments are made of: the one place that knows the order of preference.
//!
//! ```text
//! setpoint -> through the closed loop | second encoder | same phase of the previous cycle | (delayed rows)
//! ```

use crate::closed_loop::ClosedLoop;
use crate::differentiate::Aligned;
use crate::filter::Butterworth;
use crate::memory::Carry;
use crate::repetition::Repetition;
use crate::report::{Instrument, Motion};
use crate::second_encoder::SecondEncoder;
use crate::settings::{Instruments, Settings};

/// Sources of motion that share nothing with the noise of the regressor.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    wanted: Instruments,
    closed_loop: Option<ClosedLoop>,
    second: Option<SecondEncoder>,
    repetition: Option<Repetition>,
}

impl Reference {
    pub(crate) fn new(dof: usize, settings: &Settings, filter: &Butterworth) -> Reference {
        let (period, row) = (settings.sample_period_s, settings.row_period_s());
        let (mut through_loop, mut second, mut cycle) = (false, false, None);
        match settings.instruments {
            Instruments::Auto { longest_cycle_s, .. } => {
                (through_loop, second, cycle) = (true, true, Some(longest_cycle_s));
            }
            Instruments::SetpointThroughLoop => through_loop = true,
            Instruments::SecondEncoder => second = true,
            Instruments::PreviousCycle { longest_cycle_s, .. } => cycle = Some(longest_cycle_s),
            Instruments::Setpoint | Instruments::Delayed { .. } => {}
        }
        Reference {
            wanted: settings.instruments,
            closed_loop: through_loop.then(|| ClosedLoop::new(dof, filter, settings.filter_hz, period, row)),
            second: second.then(|| SecondEncoder::new(dof, settings)),
            repetition: cycle.map(|longest| Repetition::new(dof, longest, period, settings.decimation)),
        }
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        if let Some(closed_loop) = &mut self.closed_loop {
            closed_loop.carry(carry);
        }
    }

    /// After a hole in the stream.
    pub(crate) fn restart(&mut self) {
        if let Some(second) = &mut self.second {
            second.restart();
        }
        if let Some(closed_loop) = &mut self.closed_loop {
            closed_loop.restart();
        }
        if let Some(repetition) = &mut self.repetition {
            repetition.restart();
        }
    }

    /// Takes in both encoders of a sample, one value a joint, before [`choose`](Self::choose).
    pub(crate) fn read_second(&mut self, own: &[f64], second: Option<&[f64]>, tau: &[f64]) {
        match (&mut self.second, second) {
            (Some(encoders), Some(second)) => encoders.push(own, second, tau),
            (Some(encoders), None) => encoders.restart(),
            (None, _) => {}
        }
    }

    /// Takes in the motion of now and decides what the instruments of now are made of.
    pub(crate) fn choose(&mut self, aligned: &Aligned, moves: bool) -> Option<Instrument> {
        let setpoint = aligned.setpoint();
        if let Some(closed_loop) = &mut self.closed_loop {
            match setpoint {
                Some(plan) => closed_loop.step(plan, &aligned.qd),
                None => closed_loop.restart(),
            }
        }
        let takes_setpoint =
            matches!(self.wanted, Instruments::Auto { .. } | Instruments::Setpoint | Instruments::SetpointThroughLoop);
        let planned = setpoint.is_some() && takes_setpoint;
        let second = self.second.as_ref().is_some_and(|second| second.motion().is_some());
        let repeats = match &mut self.repetition {
            // Not needed beside something better.
            Some(repetition) if !planned && !second => {
                repetition.step(Motion { q: &aligned.q, qd: &aligned.qd, qdd: &aligned.qdd }, moves)
            }
            Some(repetition) => {
                repetition.restart();
                false
            }
            None => false,
        };
        if planned {
            let known = self.closed_loop.as_ref().is_some_and(ClosedLoop::identified);
            return Some(if known { Instrument::SetpointThroughLoop } else { Instrument::Setpoint });
        }
        if second {
            return Some(Instrument::SecondEncoder);
        }
        repeats.then_some(Instrument::PreviousCycle)
    }

    /// The motion that was chosen.
    pub(crate) fn motion<'a>(&'a self, chosen: Instrument, aligned: &'a Aligned) -> Option<Motion<'a>> {
        match chosen {
            Instrument::Setpoint => aligned.setpoint(),
            Instrument::SetpointThroughLoop => self.closed_loop.as_ref().map(ClosedLoop::motion),
            Instrument::SecondEncoder => self.second.as_ref().and_then(SecondEncoder::motion),
            Instrument::PreviousCycle => self.repetition.as_ref().map(Repetition::motion),
            Instrument::None | Instrument::Delayed | Instrument::Regressor => None,
        }
    }

    /// At the rate of rows: what the joints that move tell about their loops.
    pub(crate) fn learn(&mut self, used: &[bool], aligned: &Aligned) {
        if let Some(closed_loop) = self.closed_loop.as_mut().filter(|_| aligned.setpoint().is_some()) {
            closed_loop.learn(used);
        }
    }

    /// Delay of each joint behind its setpoint \[s\], NaN while unknown; empty where it is not asked for.
    pub(crate) fn lag_s(&self) -> &[f64] {
        self.closed_loop.as_ref().map_or(&[], ClosedLoop::lag_s)
    }

    /// Length of the cycle that the motion repeats \[s\].
    pub(crate) fn cycle_s(&self) -> Option<f64> {
        self.repetition.as_ref().and_then(Repetition::cycle_s)
    }
}
