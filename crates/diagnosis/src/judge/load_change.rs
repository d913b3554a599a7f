//! Whether contact is a load change: a force that begins or ends during a run and stays.

use rivet_dynamics::Places;
use std::fmt;

use nalgebra::{DMatrix, DVector};

use crate::policy::POLICY;
use crate::screen::prepared::Prepared;
use crate::screen::rigid_torque::range;

/// How near to the ends of a run bursts are looked for \[s\].
const END_S: f64 = 1.5;
/// Directions that the motion hardly tells are rounding.
const FORCE_DIRECTION_ROUNDING: f64 = 1e-6;

/// A body that hangs at the flange for a part of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HeldLoad {
    /// Since when, or until when, in seconds of the run.
    pub(crate) at: f64,
    /// Whether it was there at first.
    pub(crate) first: bool,
    /// Share of the force's squares that it explains.
    pub(crate) explained: f64,
}

impl fmt::Display for HeldLoad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = if self.first { "until" } else { "from" };
        write!(
            f,
            "{side} {:.1} s on a body at the flange explains {:.0} % of it: a load that was picked up or put down, \
             not a contact",
            self.at,
            100.0 * self.explained
        )
    }
}

/// The load, present or missing in one of the bursts `windows` (from, to, in seconds), by which `force(joint, row)` is explained.
pub(crate) fn held_load(
    run: &Prepared,
    windows: &[(f64, f64)],
    force: impl Fn(usize, usize) -> f64,
) -> Option<HeldLoad> {
    let seconds = run.run.seconds();
    let stays = windows.iter().filter(|(from, to)| to - from > POLICY.held_out.min_load_time_s);
    let mut found = stays.filter(|(from, to)| *from < END_S || to + END_S > seconds).filter_map(|(from, to)| {
        let time = |row: usize| run.chain.sample_of(row) as f64 * run.run.period_s;
        let rows: Vec<usize> = (0..run.rows()).filter(|row| (*from..*to).contains(&time(*row))).collect();
        let first = *from < END_S;
        let explained = explained(run, &rows, &force);
        (explained > POLICY.held_out.min_load_share).then_some(HeldLoad {
            at: if first { *to } else { *from },
            first,
            explained,
        })
    });
    found.next()
}

/// Share of the squares of `force` over `rows` that the last link's body explains, each joint in units of its noise.
fn explained(run: &Prepared, rows: &[usize], force: &impl Fn(usize, usize) -> f64) -> f64 {
    let joints = run.tau.len();
    let last = Places::link(joints - 1).start;
    let cells: Vec<(usize, usize)> = (0..joints).flat_map(|j| rows.iter().map(move |row| (j, *row))).collect();
    let weight = |j: usize| 1.0 / run.floor[j].max(f64::MIN_POSITIVE);
    let y = DVector::from_iterator(cells.len(), cells.iter().map(|(j, row)| weight(*j) * force(*j, *row)));
    let d = DMatrix::from_fn(cells.len(), 10, |at, c| {
        let (j, row) = cells[at];
        run.standard[last + c][j].as_ref().map_or(0.0, |rows| weight(j) * rows[row])
    });
    let whole = y.norm_squared();
    match range(&d, FORCE_DIRECTION_ROUNDING) {
        Some(range) if whole > 0.0 => range.tr_mul(&y).norm_squared() / whole,
        _ => 0.0,
    }
}
