//! A motion in closed form.

use std::f64::consts::TAU;

/// Sines on every joint: harmonics of one frequency, each of a size that falls with its number.
pub struct Sines {
    /// \[Hz\]
    pub hz: f64,
    /// How many.
    pub harmonics: u32,
    /// Of the first \[rad\].
    pub size: f64,
    /// Tells one motion from another: of the phases.
    pub shift: f64,
}

impl Sines {
    /// Position \[rad\], velocity \[rad/s\] and acceleration \[rad/s²\] of `joints` joints at `t` \[s\].
    pub fn at(&self, t: f64, joints: usize) -> [Vec<f64>; 3] {
        let mut state = [vec![0.0; joints], vec![0.0; joints], vec![0.0; joints]];
        for j in 0..joints {
            for harmonic in (1..=self.harmonics).map(f64::from) {
                let rate = TAU * self.hz * harmonic;
                let phase = rate * t + (2.0 + j as f64 + self.shift) * harmonic * 1.7;
                let size = self.size / harmonic;
                state[0][j] += size * phase.sin();
                state[1][j] += size * rate * phase.cos();
                state[2][j] -= size * rate * rate * phase.sin();
            }
        }
        state
    }
}
