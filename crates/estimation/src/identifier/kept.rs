//! What an identifier keeps over a pause or new settings.

use rivet_dynamics::Fnv;

use super::Identifier;
use crate::memory::Carry;

/// Of what [`Identifier::remember_all`] writes.
const MEMORY_VERSION: u32 = 3;

/// What [`Identifier::reconfigure`] kept beside the parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reconfigured {
    /// Differentiator and filters run on; else they settle anew.
    pub signals: bool,
    /// What the window holds counts on; else it begins anew.
    pub window: bool,
}

impl Identifier {
    /// Numbers that [`remember_all`](Self::remember_all) writes.
    #[must_use]
    pub fn memory_len(&self) -> usize {
        let mut counting = Carry::measure();
        // Counting changes nothing, but goes the way that everything goes.
        self.clone().carry(&mut counting);
        counting.end().unwrap_or(0)
    }

    /// Says what those numbers mean: settings, nominal parameters, scales. An identifier of another one cannot
    /// [`resume`](Self::resume) from them.
    #[must_use]
    pub fn memory_fingerprint(&self) -> u64 {
        let settings = format!("{MEMORY_VERSION} {} {:?}", self.memory_len(), self.settings);
        let mut hash = Fnv::default();
        settings.bytes().map(u64::from).chain(self.estimator.scale_words()).for_each(|word| hash.word(word));
        hash.value()
    }

    /// Writes all that was learnt to `room`, of [`memory_len`](Self::memory_len) numbers: the sums of the window and what was
    /// decided from them, noise, closed loop. What the filters hold and a motion's cycle is not part of it: after a pause both
    /// begin anew. False if the length is another.
    ///
    /// Real-time safe: bounded work, of the order of a copy.
    pub fn remember_all(&mut self, room: &mut [f64]) -> bool {
        let mut carry = Carry::out(room);
        self.carry(&mut carry);
        carry.end().is_some()
    }

    /// Goes on from what [`remember_all`](Self::remember_all) of an identifier with the same
    /// [fingerprint](Self::memory_fingerprint) wrote, as after a hole in the stream: bit for bit what that one would have done.
    /// False, and nothing changed, if the numbers cannot be of such a one. Allocates.
    pub fn resume_from(&mut self, stored: &[f64]) -> bool {
        let mut other = self.clone();
        let mut carry = Carry::back(stored);
        other.carry(&mut carry);
        let sound = carry.end().is_some();
        if sound {
            other.restart_signals();
            other.estimator.take_up();
            *self = other;
        }
        sound
    }

    fn carry(&mut self, carry: &mut Carry<'_>) {
        self.estimator.carry(carry);
        self.reference.carry(carry);
    }

    /// Goes on with the settings of `fresh`, made for the same model: parameters stay what they are, and what the window holds
    /// stays where it means the same (see [`Estimator::reconfigure`]). Filters that are other ones start with the next sample
    /// and settle, as after a gap; filters that are the same run on. What is replaced is left in `fresh`, to be dropped
    /// where that may take time.
    ///
    /// Real-time safe: bounded work; no allocation, lock, system call or panic.
    pub fn reconfigure(&mut self, fresh: &mut Identifier) -> Reconfigured {
        let signals = self.settings.same_rows(&fresh.settings);
        let window = self.estimator.reconfigure(&mut fresh.estimator);
        if signals {
            std::mem::swap(&mut self.jump, &mut fresh.jump);
            std::mem::swap(&mut self.settings, &mut fresh.settings);
        } else {
            // All but the estimator is the signal chain; the estimator goes back to where it was.
            std::mem::swap(self, fresh);
            std::mem::swap(&mut self.estimator, &mut fresh.estimator);
            self.thinning = fresh.thinning;
        }
        Reconfigured { signals, window }
    }
}
