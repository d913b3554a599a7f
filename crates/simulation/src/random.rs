//! Seeded random numbers: xoshiro256++ (Blackman & Vigna 2019), its state filled by SplitMix64.
//!
//! Written out here because a seed is part of a result: the same seed must mean the same noise in every later version of
//! this crate, which no third-party generator promises.

/// A stream of random numbers that its seed decides completely.
#[derive(Clone, Debug)]
pub struct Random {
    state: [u64; 4],
    /// The second normal number of a pair, until it is asked for.
    spare: Option<f64>,
}

/// One step of SplitMix64 (Steele, Lea & Flood 2014): spreads a small seed over 64 bits.
fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Random {
    /// The stream of `seed`; every seed is a good one, zero included.
    pub fn new(seed: u64) -> Self {
        let mut s = seed;
        let state = core::array::from_fn(|_| split_mix(&mut s));
        Self { state, spare: None }
    }

    /// The stream numbered `purpose` of `seed`. Streams are independent: more noise drawn on one changes nothing on another.
    pub fn stream(seed: u64, purpose: u64) -> Self {
        let mut s = seed ^ purpose.wrapping_mul(0xd134_2543_de82_ef95);
        Self::new(split_mix(&mut s))
    }

    /// The next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        let s = &mut self.state;
        let result = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        result
    }

    /// Uniform in `[0, 1)`, 53 bits.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform in `[low, high)`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Normal with mean 0 and standard deviation 1 (Marsaglia's polar method).
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let (u, v) = (self.uniform(-1.0, 1.0), self.uniform(-1.0, 1.0));
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                let scale = (-2.0 * s.ln() / s).sqrt();
                self.spare = Some(v * scale);
                return u * scale;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first numbers of SplitMix64 from 1234567, as printed by its authors' C program.
    #[test]
    fn split_mix_matches_its_reference() {
        let mut s = 1_234_567;
        let got: [u64; 3] = core::array::from_fn(|_| split_mix(&mut s));
        assert_eq!(got, [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]);
    }

    /// By hand from the published recurrence: s = [1, 2, 3, 4] gives rotl(1 + 4, 23) + 1 first.
    #[test]
    fn xoshiro_follows_its_recurrence() {
        let mut random = Random { state: [1, 2, 3, 4], spare: None };
        assert_eq!(random.bits(), (5_u64 << 23) + 1);
        assert_eq!(random.state, [7, 0, 262_146, 6_u64.rotate_left(45)]);
    }

    #[test]
    fn normal_numbers_have_the_moments_of_the_normal_law() {
        let n = 200_000;
        let mut random = Random::new(7);
        let x: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let moment = |k: i32| x.iter().map(|v| v.powi(k)).sum::<f64>() / f64::from(n);
        // Four standard deviations of each sample moment: sqrt(var(x^k)/n).
        assert!(moment(1).abs() < 4.0 * (1.0 / f64::from(n)).sqrt());
        assert!((moment(2) - 1.0).abs() < 4.0 * (2.0 / f64::from(n)).sqrt());
        assert!((moment(4) - 3.0).abs() < 4.0 * (96.0 / f64::from(n)).sqrt());
    }

    #[test]
    fn streams_of_one_seed_differ_and_repeat() {
        let draw = |purpose| Random::stream(3, purpose).bits();
        assert_eq!(draw(1), draw(1));
        assert_ne!(draw(1), draw(2));
    }
}
