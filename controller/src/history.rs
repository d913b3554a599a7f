//! What the arm did and was commanded in the last samples.

use rivet_dynamics::MAX_JOINTS;

/// Samples kept: more than 20 ms at 2 kHz.
const LENGTH: usize = 64;

/// One sample and its answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Moment {
    /// Positions \[rad\].
    pub(crate) q: [f64; MAX_JOINTS],
    /// Velocities \[rad/s\].
    pub(crate) qd: [f64; MAX_JOINTS],
    /// The command that answered it \[N·m\].
    pub(crate) tau: [f64; MAX_JOINTS],
}

/// A ring of samples that were used. Nothing allocates.
#[derive(Clone, Debug)]
pub(crate) struct History {
    moments: [Moment; LENGTH],
    next: usize,
    filled: usize,
}

impl History {
    pub(crate) fn new() -> History {
        History { moments: [Moment::default(); LENGTH], next: 0, filled: 0 }
    }

    /// Forgets everything.
    pub(crate) fn restart(&mut self) {
        (self.next, self.filled) = (0, 0);
    }

    pub(crate) fn push(&mut self, moment: &Moment) {
        self.moments[self.next] = *moment;
        self.next = (self.next + 1) % LENGTH;
        self.filled = (self.filled + 1).min(LENGTH);
    }

    /// The moment `age` samples before the last one, or the oldest; `None` while there is none.
    pub(crate) fn at(&self, age: usize) -> Option<&Moment> {
        let age = age.min(self.filled.checked_sub(1)?);
        Some(&self.moments[(self.next + LENGTH - 1 - age) % LENGTH])
    }

    /// Samples that are kept.
    pub(crate) fn len(&self) -> usize {
        self.filled
    }
}
