//! What an estimator has learnt, as numbers: taken out to be stored, and put back into one that was made alike.
//!
//! Every part goes through its numbers in one order, whichever way they go: what is taken out and what is put back cannot
//! differ. Only what the past has left is carried; what is made anew with every row is not.

/// Goes through the numbers of an estimator.
#[derive(Debug)]
pub(crate) struct Carry<'a> {
    way: Way<'a>,
    at: usize,
    sound: bool,
}

#[derive(Debug)]
enum Way<'a> {
    Measure,
    Out(&'a mut [f64]),
    In(&'a [f64]),
}

impl<'a> Carry<'a> {
    /// Only counts.
    pub(crate) fn measure() -> Carry<'a> {
        Carry { way: Way::Measure, at: 0, sound: true }
    }

    /// Into `room`.
    pub(crate) fn out(room: &'a mut [f64]) -> Carry<'a> {
        Carry { way: Way::Out(room), at: 0, sound: true }
    }

    /// From `stored`.
    pub(crate) fn back(stored: &'a [f64]) -> Carry<'a> {
        Carry { way: Way::In(stored), at: 0, sound: true }
    }

    /// How many numbers there were, if all was well: as many as room, and none that cannot be.
    pub(crate) fn end(self) -> Option<usize> {
        let whole = match &self.way {
            Way::Measure => true,
            Way::Out(room) => room.len() == self.at,
            Way::In(stored) => stored.len() == self.at,
        };
        (self.sound && whole).then_some(self.at)
    }

    /// A number, as it is; true when it came from outside.
    pub(crate) fn any(&mut self, x: &mut f64) -> bool {
        let at = self.at;
        self.at += 1;
        match &mut self.way {
            Way::Measure => false,
            Way::Out(room) => {
                match room.get_mut(at) {
                    Some(slot) => *slot = *x,
                    None => self.sound = false,
                }
                false
            }
            Way::In(stored) => {
                match stored.get(at) {
                    Some(value) => *x = *value,
                    None => self.sound = false,
                }
                true
            }
        }
    }

    /// A finite number.
    pub(crate) fn number(&mut self, x: &mut f64) {
        if self.any(x) {
            self.sound &= x.is_finite();
        }
    }

    /// Finite numbers.
    pub(crate) fn numbers(&mut self, xs: &mut [f64]) {
        for x in xs {
            self.number(x);
        }
    }

    /// Numbers that are not negative.
    pub(crate) fn sizes(&mut self, xs: &mut [f64]) {
        for x in xs {
            self.number(x);
            self.sound &= *x >= 0.0;
        }
    }

    /// A whole number below `limit`, which is at most 2⁵³.
    pub(crate) fn whole(&mut self, x: &mut u64, limit: u64) {
        let mut value = *x as f64;
        if self.any(&mut value) {
            let fits = value >= 0.0 && value < limit as f64 && value.fract() == 0.0;
            self.sound &= fits;
            *x = if fits { value as u64 } else { 0 };
        }
    }

    /// A place in an array of `length` entries.
    pub(crate) fn place(&mut self, x: &mut usize, length: usize) {
        let mut value = *x as u64;
        self.whole(&mut value, length.max(1) as u64);
        *x = value as usize;
    }

    /// A small count.
    pub(crate) fn small(&mut self, x: &mut u32, limit: u32) {
        let mut value = u64::from(*x);
        self.whole(&mut value, u64::from(limit));
        *x = value as u32;
    }

    /// Yes or no.
    pub(crate) fn flag(&mut self, x: &mut bool) {
        let mut value = u64::from(*x);
        self.whole(&mut value, 2);
        *x = value == 1;
    }
}

/// More than any count reaches.
pub(crate) const MANY: u64 = 1 << 53;

#[cfg(test)]
mod tests {
    use super::*;

    fn all(carry: &mut Carry<'_>, x: &mut [f64; 2], k: &mut usize, yes: &mut bool) {
        carry.numbers(x);
        carry.place(k, 7);
        carry.flag(yes);
    }

    #[test]
    fn what_goes_out_comes_back_and_nothing_else() {
        let (mut x, mut k, mut yes) = ([1.5, -2.0], 6, true);
        let mut measure = Carry::measure();
        all(&mut measure, &mut x, &mut k, &mut yes);
        let length = measure.end().expect("counting cannot fail");
        let mut stored = vec![0.0; length];
        let mut out = Carry::out(&mut stored);
        all(&mut out, &mut x, &mut k, &mut yes);
        assert_eq!(out.end(), Some(4));
        assert_eq!(stored, [1.5, -2.0, 6.0, 1.0]);
        let back = |stored: &[f64]| {
            let (mut x, mut k, mut yes) = ([0.0; 2], 0, false);
            let mut carry = Carry::back(stored);
            all(&mut carry, &mut x, &mut k, &mut yes);
            carry.end().map(|_| (x, k, yes))
        };
        assert_eq!(back(&stored), Some((x, k, yes)));
        for (at, wrong) in [(0, f64::NAN), (1, f64::INFINITY), (2, 7.0), (2, -1.0), (2, 0.5), (2, f64::NAN), (3, 2.0)] {
            let mut spoilt = stored.clone();
            spoilt[at] = wrong;
            assert_eq!(back(&spoilt), None, "{at}: {wrong}");
        }
        assert_eq!((back(&stored[..3]), back(&[0.0; 5])), (None, None), "too few, too many");
    }
}
