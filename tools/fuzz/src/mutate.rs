//! Changes of inputs.

/// Bytes that often stand at a limit.
const EDGES: [u8; 8] = [0, 1, 0x7f, 0x80, 0xff, b'-', b'"', b'\n'];

/// Eight bytes that often do.
const WORDS: [u64; 10] = [
    0,
    1,
    u64::MAX,
    u64::MAX / 2,
    1 << 63,
    0x7ff0_0000_0000_0000, // infinity
    0x7ff8_0000_0000_0000, // NaN
    0x7fef_ffff_ffff_ffff, // the largest number
    0x0000_0000_0000_0001, // the smallest
    0x3ff0_0000_0000_0000, // one
];

/// Inputs do not grow beyond this \[bytes\].
const LONGEST: usize = 64 * 1024;

/// Makes inputs out of inputs; the same seed makes the same.
#[derive(Clone, Debug)]
pub struct Mutator {
    state: u64,
    words: &'static [&'static str],
}

impl Mutator {
    /// `words` are put in now and then.
    pub fn new(seed: u64, words: &'static [&'static str]) -> Self {
        Self { state: seed | 1, words }
    }

    fn random(&mut self) -> u64 {
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        self.state.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// A number below `n`; 0 for none.
    fn below(&mut self, n: usize) -> usize {
        if n == 0 { 0 } else { (self.random() >> 16) as usize % n }
    }

    /// One of `corpus`, changed in one to eight places.
    pub fn change(&mut self, corpus: &[Vec<u8>]) -> Vec<u8> {
        let at = self.below(corpus.len());
        let mut out = corpus.get(at).cloned().unwrap_or_default();
        for _ in 0..=self.below(8) {
            self.once(&mut out, corpus);
        }
        out.truncate(LONGEST);
        out
    }

    fn once(&mut self, out: &mut Vec<u8>, corpus: &[Vec<u8>]) {
        let at = self.below(out.len() + 1);
        let length = 1 + self.below(32);
        match self.below(9) {
            0 if at < out.len() => out[at] ^= 1 << self.below(8),
            1 if at < out.len() => out[at] = EDGES[self.below(EDGES.len())],
            2 if at < out.len() => out[at] = self.random() as u8,
            3 => {
                let word = WORDS[self.below(WORDS.len())].to_le_bytes();
                // Numbers of messages lie at multiples of four.
                let at = at / 4 * 4;
                let end = (at + 8).min(out.len());
                out[at..end].copy_from_slice(&word[..end - at]);
            }
            4 => out.truncate(at),
            5 => {
                let end = (at + length).min(out.len());
                out.drain(at..end);
            }
            6 => {
                let end = (at + length).min(out.len());
                let again = out[at..end].to_vec();
                out.splice(at..at, again);
            }
            7 if !self.words.is_empty() => {
                let word = self.words[self.below(self.words.len())].bytes();
                out.splice(at..at, word);
            }
            _ => {
                let other = self.below(corpus.len());
                let from = corpus.get(other).map_or(0, |other| self.below(other.len()));
                if let Some(other) = corpus.get(other) {
                    let end = (from + 8 * length).min(other.len());
                    out.splice(at..at, other[from..end].iter().copied());
                }
            }
        }
    }
}
