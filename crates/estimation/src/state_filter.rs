//! Derivatives without a window: the states of a low-pass are the filtered signal's own derivatives.
//!
//! ```text
//! F(s) = 1/(1 + s/ω)³ as three equal sections x₁, x₂, x₃ of input u, each by Tustin's rule s = (2/T)(z − 1)/(z + 1)
//! F·u = x₃,   s·F·u = ω(x₂ − x₃),   s²·F·u = ω²(x₁ − 2x₂ + x₃)                exact, not differences
//! ```
//!
//! Positions, torques and setpoints all pass F, so everything is late by the same 3/ω and the equation of motion stays
//! true: exactly for what is linear in motion (inertia, viscous friction), and up to the curvature of the rest within the
//! filter's reach (about q̇²·1.5/ω² of a term, 1e-5 at 1 rad/s and 60 Hz).

use std::f64::consts::TAU;

/// F has forgotten its start after this many time constants 1/ω: 1e-7 of it is left.
const SETTLED: f64 = 22.0;

/// Sections over many channels. Nothing allocates after `new`.
#[derive(Clone, Debug)]
pub(crate) struct StateFilter {
    /// ω \[rad/s\].
    corner: f64,
    /// Of each section: y ← pole·y + gain·(u + u before).
    pole: f64,
    gain: f64,
    /// Input before and the three sections, of every channel.
    states: Vec<[f64; 4]>,
    started: bool,
}

impl StateFilter {
    /// Corner of one section at `hz`, samples `period` \[s\] apart.
    pub(crate) fn new(channels: usize, hz: f64, period: f64) -> StateFilter {
        let corner = TAU * hz;
        let half = 0.5 * corner * period;
        StateFilter {
            corner,
            pole: (1.0 - half) / (1.0 + half),
            gain: half / (1.0 + half),
            states: vec![[0.0; 4]; channels],
            started: false,
        }
    }

    /// Samples until the start does not matter any more.
    pub(crate) fn settling(&self, period: f64) -> usize {
        (SETTLED / (self.corner * period)).ceil() as usize
    }

    /// The next sample will be taken as what had been for ever.
    pub(crate) fn restart(&mut self) {
        self.started = false;
    }

    /// Takes in one sample of every channel.
    pub(crate) fn step(&mut self, input: impl Iterator<Item = f64>) {
        let StateFilter { pole, gain, started, .. } = *self;
        for (state, u) in self.states.iter_mut().zip(input) {
            if !started {
                *state = [u; 4];
                continue;
            }
            let mut u = u;
            let mut before = std::mem::replace(&mut state[0], u);
            for x in &mut state[1..] {
                let next = pole * *x + gain * (u + before);
                before = std::mem::replace(x, next);
                u = next;
            }
        }
        self.started = true;
    }

    /// Sets a channel to rest at `value`.
    pub(crate) fn hold(&mut self, channel: usize, value: f64) {
        self.states[channel] = [value; 4];
    }

    /// Filtered signal of a channel.
    pub(crate) fn value(&self, channel: usize) -> f64 {
        self.states[channel][3]
    }

    /// Filtered signal of a channel with its first and second derivative.
    pub(crate) fn motion(&self, channel: usize) -> [f64; 3] {
        let [_, a, b, c] = self.states[channel];
        [c, self.corner * (b - c), self.corner * self.corner * ((a - b) - (b - c))]
    }
}
