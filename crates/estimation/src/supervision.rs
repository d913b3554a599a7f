//! Which coordinates or directions the window identifies, decided from the information of the instruments.
//!
//! The threshold is the paper's eq. 23 in torque units, `λ > κσₑ²/tol²`. `tol` is the larger of the configured tolerance
//! and of what is known about the direction already: a direction moves while the window says more about it than is
//! known, and never later than at the tolerance. κ is the correlation that the model filter gives to the residuals.

mod columns;
mod directions;
mod rotations;
mod tracked;

pub(crate) use columns::Columns;
pub(crate) use directions::Directions;
pub(crate) use tracked::Tracked;

use crate::linear::Budget;
use crate::memory::Carry;
use crate::report::Verdict;
use crate::scales::Whitening;

/// What a scheme needs to know beside the information.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known<'a> {
    /// κ·σₑ²: variance of one equation, counting its correlation.
    pub(crate) variance: f64,
    /// Standard deviation of what is known of each scaled parameter, as thresholds count it \[torque-noise sigma\].
    pub(crate) belief: &'a [f64],
    /// The same without caution: how far a held parameter may be off.
    pub(crate) width: &'a [f64],
    /// Coordinates of the information, if they are not the scaled parameters themselves.
    pub(crate) whitening: Option<&'a Whitening>,
}

/// Directions as covectors on parameters, four at a time.
#[derive(Clone, Debug)]
struct Covectors(Vec<[f64; 4]>);

impl Covectors {
    /// For n parameters.
    fn new(n: usize) -> Covectors {
        Covectors(vec![[0.0; 4]; n])
    }

    /// Variances along at most four directions (n entries each) where parameters have standard deviations `stds`: one entry a direction
    /// for each of them. Where there are fewer than four the first stands for the others.
    fn variances<const STDS: usize>(
        &mut self,
        directions: &[&[f64]],
        whitening: Option<&Whitening>,
        stds: [&[f64]; STDS],
    ) -> [[f64; 4]; STDS] {
        let Covectors(covectors) = self;
        for lane in 0..4 {
            let direction = directions.get(lane).or(directions.first()).copied().unwrap_or_default();
            covectors.iter_mut().zip(direction).for_each(|(covector, v)| covector[lane] = *v);
        }
        if let Some(whitening) = whitening {
            whitening.covectors(covectors);
        }
        stds.map(|stds| {
            let mut variances = [0.0; 4];
            for (covector, std) in covectors.iter().zip(stds) {
                for lane in 0..4 {
                    variances[lane] += (covector[lane] * std).powi(2);
                }
            }
            variances
        })
    }
}

/// The scheme in use.
#[derive(Clone, Debug)]
pub(crate) enum Judge {
    /// Everything moves.
    Off,
    Columns(Columns),
    Directions(Directions),
    /// Judges and solves by itself, every period: see [`Tracked::solve`].
    Tracked(Box<Tracked>),
}

impl Judge {
    /// Goes on with the thresholds of `fresh`; false, and nothing changed, if that is another scheme.
    pub(crate) fn reconfigure(&mut self, fresh: &Judge) -> bool {
        match (self, fresh) {
            (Judge::Off, Judge::Off) => {}
            (Judge::Columns(mine), Judge::Columns(fresh)) => mine.reconfigure(fresh),
            (Judge::Directions(mine), Judge::Directions(fresh)) => mine.reconfigure(fresh),
            (Judge::Tracked(mine), Judge::Tracked(fresh)) => mine.reconfigure(fresh),
            _ => return false,
        }
        true
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        match self {
            // Everything is judged anew with every cycle.
            Judge::Off | Judge::Columns(_) => {}
            Judge::Directions(scheme) => scheme.carry(carry),
            Judge::Tracked(scheme) => scheme.carry(carry),
        }
    }

    /// Acceptable standard deviation \[torque-noise sigma\]; 1 where nothing is judged.
    pub(crate) fn tolerance(&self) -> f64 {
        match self {
            Judge::Off => 1.0,
            Judge::Columns(scheme) => scheme.tolerance(),
            Judge::Directions(scheme) => scheme.settings().tolerance,
            Judge::Tracked(scheme) => scheme.settings().tolerance,
        }
    }

    /// Begins to judge S, given as its lower triangle ([`packed`](crate::linear::packed)).
    pub(crate) fn start(&mut self, s: &[f64]) {
        match self {
            Judge::Off | Judge::Tracked(_) => {}
            Judge::Columns(scheme) => scheme.start(),
            Judge::Directions(scheme) => scheme.start(s),
        }
    }

    /// Goes on while `budget` lasts; true when `active` and the verdict are complete.
    pub(crate) fn advance(
        &mut self,
        s: &[f64],
        known: Known<'_>,
        active: &mut [bool],
        verdict: &mut Verdict,
        budget: &mut Budget,
    ) -> bool {
        match self {
            Judge::Off => {
                let n = active.len();
                active.fill(true);
                let trace = (0..n).map(|i| s[i * n + i]).sum();
                *verdict = Verdict { active: n, of: n, trace, ..Verdict::NONE };
                true
            }
            Judge::Columns(scheme) => {
                // Its stages are a step each.
                budget.end();
                scheme.advance(s, known, active, verdict)
            }
            Judge::Directions(scheme) => scheme.advance(known, active, verdict, budget),
            Judge::Tracked(_) => true,
        }
    }
}
