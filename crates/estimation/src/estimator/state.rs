//! What an estimator begins with, forgets, hands over and takes up again.

use super::Estimator;
use crate::memory::{Carry, MANY};
use crate::report::{Instrument, ParameterState, Verdict};

impl Estimator {
    /// Forgets everything; the nominal values stand again.
    pub fn reset(&mut self) {
        let nominal = std::mem::take(&mut self.nominal);
        self.load(&nominal);
        self.nominal = nominal;
        self.noise.reset();
        self.residuals.reset();
        self.updates = 0;
    }

    /// The values that it began with.
    pub(crate) fn nominal(&self) -> &[f64] {
        &self.nominal
    }

    /// Goes on from `values` (n, e.g. stored ones), as known as the nominal ones are; what the window had is forgotten.
    pub fn load(&mut self, values: &[f64]) {
        self.values.copy_from_slice(values);
        if let Some(change) = &mut self.change {
            change.restart();
        }
        self.reload(values);
    }

    /// What is known of the values just loaded: standard deviations of those that had been identified.
    pub(crate) fn recall(&mut self, std: &[f64], identified: impl Fn(usize) -> bool) {
        for i in (0..self.n).filter(|&i| identified(i)) {
            let scaled = (std[i] * self.column[i]).min(self.prior[i]);
            self.std[i] = scaled / self.column[i];
            self.state[i] = ParameterState::Held;
            self.cycle.recall(i, scaled);
        }
    }

    /// All that the past has left.
    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        self.noise.carry(carry);
        self.ud.carry(carry);
        for sums in [&mut self.m, &mut self.s, &mut self.y, &mut self.values, &mut self.rls_values] {
            carry.numbers(sums);
        }
        carry.sizes(&mut self.excited);
        carry.sizes(&mut self.count);
        self.long_run.carry(carry);
        self.comparison.carry(carry);
        self.witnesses.carry(carry);
        self.cycle.carry(carry);
        carry.sizes(&mut self.std);
        for state in &mut self.state {
            let mut number = *state as u64;
            carry.whole(&mut number, 3);
            *state = [ParameterState::Active, ParameterState::Held, ParameterState::Unidentified][number as usize % 3];
        }
        for share in &mut self.excitation {
            carry.any(share);
        }
        self.residuals.carry(carry);
        if let Some(change) = &mut self.change {
            change.carry(carry);
        }
        if let Some(payload) = &mut self.payload {
            payload.carry(carry);
        }
        carry.number(&mut self.lambda);
        carry.whole(&mut self.updates, MANY);
    }

    /// Goes on from what was carried in.
    pub(crate) fn take_up(&mut self) {
        self.lambda = self.lambda.clamp(self.settings.forgetting, 1.0);
        self.cycle.resume();
    }

    /// What numbers that are carried in must belong to.
    pub(crate) fn scale_words(&self) -> impl Iterator<Item = u64> + '_ {
        self.nominal.iter().chain(&self.column).chain(&self.prior).map(|x| x.to_bits())
    }

    pub(super) fn reload(&mut self, values: &[f64]) {
        for ((scaled, x), c) in self.rows.scaled.iter_mut().zip(values).zip(&self.column) {
            *scaled = x * c;
        }
        self.ud.reset(&self.rows.scaled);
        self.rls_values.copy_from_slice(values);
        self.cycle.restart(&self.rows.scaled, &self.prior, self.whitening.as_ref());
        for sums in [&mut self.m, &mut self.s, &mut self.y, &mut self.excited, &mut self.excitation] {
            sums.fill(0.0);
        }
        for ((std, prior), c) in self.std.iter_mut().zip(&self.prior).zip(&self.column) {
            *std = prior / c;
        }
        self.state.fill(ParameterState::Unidentified);
        if let Some(payload) = &mut self.payload {
            payload.finish();
        }
        self.verdict = Verdict { of: self.n, ..Verdict::NONE };
        self.count = [0.0; 2];
        self.long_run.restart();
        self.comparison.restart();
        self.witnesses.restart();
        self.instrument = Instrument::None;
    }

    /// Goes on with the settings of `fresh`, an estimator for the same model that has learnt nothing. The values stay what they
    /// are. So does what the window holds, unless the information means something else from now on: another estimator,
    /// scheme, prior scale or noise. Then the window begins anew and `updates` with it; what had been identified is held and
    /// known as well as before. Returns whether the window stayed. What is replaced is left in `fresh`, to be dropped where
    /// that may take time. Real-time safe.
    pub fn reconfigure(&mut self, fresh: &mut Estimator) -> bool {
        let alike = self.n == fresh.n
            && self.settings.kind == fresh.settings.kind
            && self.settings.noise_known == fresh.settings.noise_known
            && self.column == fresh.column
            && self.noise.same_guess(&fresh.noise);
        if !(alike && self.cycle.reconfigure(&fresh.cycle)) {
            if self.n == fresh.n {
                fresh.load(&self.values);
                fresh.recall(&self.std, |i| self.state[i] != ParameterState::Unidentified);
                fresh.frozen = self.frozen;
            }
            std::mem::swap(self, fresh);
            return false;
        }
        match (&mut self.change, &mut fresh.change) {
            (Some(mine), Some(fresh)) => mine.reconfigure(fresh),
            (mine, fresh) => std::mem::swap(mine, fresh),
        }
        match (&self.payload, &fresh.payload) {
            (Some(_), Some(_)) => {}
            _ => std::mem::swap(&mut self.payload, &mut fresh.payload),
        }
        std::mem::swap(&mut self.settings, &mut fresh.settings);
        std::mem::swap(&mut self.nominal, &mut fresh.nominal);
        std::mem::swap(&mut self.prior, &mut fresh.prior);
        self.ud.reconfigure(&mut fresh.ud);
        self.noise.reconfigure(&fresh.noise);
        self.witnesses.reconfigure(&fresh.witnesses);
        self.residuals.reconfigure(&fresh.residuals);
        self.long_run.reconfigure(&fresh.long_run);
        true
    }

    /// Stops learning; residuals are still reported.
    pub fn freeze(&mut self) {
        self.frozen = true;
    }

    /// Learns again.
    pub fn resume(&mut self) {
        self.frozen = false;
    }
}
