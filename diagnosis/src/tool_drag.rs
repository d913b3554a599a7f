//! Drag at the tool looks like contact: a force in bursts, whenever the arm is fast. But it takes power whichever way the arm goes.

use std::fmt;

use crate::design::Prepared;

/// Of the power that goes through a force so much is taken from the arm where it is drag (simulated: 0.91 to 0.96; pushes: -0.8 to 0.26) ...
const TAKEN: f64 = 0.8;
/// ... and so much at the least in the lesser direction of its joints: what an arm runs into takes power as well, on one way.
const BACK: f64 = 0.2;

/// A force that holds the arm back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Drag {
    /// Power that it takes less power that it gives, in parts of both.
    taken: f64,
}

impl fmt::Display for Drag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let share = 50.0 * (1.0 + self.taken);
        write!(
            f,
            "{share:.0} % of its power is taken from the arm, whichever way that goes: something that it moves through or drags along, and no touch"
        )
    }
}

/// The drag that the force of some bursts `windows` (from, to, in seconds) is, which needs `force(joint, row)` of the joints \[N·m\].
pub(crate) fn drag(run: &Prepared, windows: &[(f64, f64)], force: impl Fn(usize, usize) -> f64) -> Option<Drag> {
    let time = |row: usize| run.chain.sample_of(row) as f64 * run.run.period_s;
    let within = |row: &usize| windows.iter().any(|(from, to)| (*from..*to).contains(&time(*row)));
    let rows: Vec<usize> = (0..run.rows()).filter(within).collect();
    let (mut taken, mut whole, mut back) = (0.0, 0.0, 0.0);
    for j in 0..run.tau.len() {
        let speed = run.chain.sample(&run.motion.qd[j]);
        let mut ways = [0.0; 2];
        for &row in &rows {
            let power = force(j, row) * speed[row];
            taken += power;
            ways[usize::from(speed[row] > 0.0)] += power.abs();
        }
        whole += ways[0] + ways[1];
        back += ways[0].min(ways[1]);
    }
    (whole > 0.0 && taken > TAKEN * whole && back > BACK * whole).then(|| Drag { taken: taken / whole })
}
