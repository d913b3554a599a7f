//! A small generator of random numbers (xorshift64*), the same on every machine.

pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new() -> Random {
        Random(0x9E37_79B9_7F4A_7C15)
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let value = self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33;
        value as usize % n.max(1)
    }

    /// A standard normal number: twelve uniform ones less their mean.
    pub(crate) fn normal(&mut self) -> f64 {
        const STEPS: usize = 1 << 20;
        (0..12).map(|_| self.below(STEPS) as f64 / STEPS as f64).sum::<f64>() - 6.0
    }
}
