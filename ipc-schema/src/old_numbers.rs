//! Whether old sequence numbers are those of a publisher that was started anew.

/// So many old numbers, each newer than the one before.
const RUN: u64 = 100;

/// Counts numbers that are not newer than those already used. A publisher that starts anew counts from the beginning: a long run
/// of old but rising numbers. One that repeats itself has nothing to say.
#[derive(Clone, Copy, Debug, Default)]
pub struct OldNumbers {
    run: u64,
    last: u64,
}

impl OldNumbers {
    /// Takes in an old number; returns whether its publisher was started anew. Real-time safe.
    pub fn take(&mut self, seq: u64) -> bool {
        let rising = self.run > 0 && seq > self.last;
        self.run = if rising { self.run + 1 } else { 1 };
        self.last = seq;
        self.run >= RUN
    }

    /// A number is used; returns how many old ones in a row came before it. Real-time safe.
    pub fn end(&mut self) -> u64 {
        std::mem::take(&mut self.run)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_rises_is_a_new_one_and_a_repetition_is_none() {
        let mut old = OldNumbers::default();
        assert!((0..10 * RUN).all(|_| !old.take(7)), "one number for ever");
        assert!((1..RUN).all(|seq| !old.take(seq)) && old.take(RUN), "a hundred that rise");
        assert_eq!((old.end(), old.end()), (RUN, 0));
        assert!((1..RUN).all(|seq| !old.take(seq)) && !old.take(3), "begun again");
    }
}
