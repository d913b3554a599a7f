//! From aligned motion to filtered rows: regressor, instruments and torque through one model filter.

use crate::differentiate::Aligned;
use crate::filter::{Bank, Butterworth};
use crate::report::Motion;
use crate::settings::InputSignals;
use rivet_dynamics::{BaseSet, Model, Parameter, Slip, Workspace};
use std::sync::Arc;

/// Standard regressors of the measured motion and of a second one, side by side: together they cost what one does.
#[derive(Clone, Debug)]
pub(crate) struct Regressors {
    pair: Vec<[f64; 2]>,
    ws: Workspace,
    /// Friction along each motion.
    slips: [Slip; 2],
}

/// Which of the two motions of [`Regressors`].
#[derive(Clone, Copy, Debug)]
pub(crate) enum Side {
    Measured,
    Second,
}

impl Regressors {
    pub(crate) fn new(model: &Model) -> Regressors {
        Regressors {
            pair: vec![[0.0; 2]; model.arm.dof() * model.len()],
            ws: Workspace::new(&model.arm),
            slips: [Slip::new(model), Slip::new(model)],
        }
    }

    /// Both motions begin anew.
    pub(crate) fn restart(&mut self) {
        self.slips.iter_mut().for_each(Slip::restart);
    }

    /// Evaluates both; without a second motion its side means nothing.
    pub(crate) fn evaluate(&mut self, model: &Model, measured: Motion<'_>, second: Option<Motion<'_>>) {
        // The lanes do not touch each other: an idle one may hold anything.
        let states = [measured, second.unwrap_or(measured)];
        model.regressor_pair_sliding(&mut self.ws, &mut self.slips, states, &mut self.pair);
        if second.is_none() {
            self.slips[Side::Second as usize].restart();
        }
    }
}

/// Filtered rows of one quantity.
#[derive(Clone, Debug)]
pub(crate) struct RowFilter {
    /// Place in the standard regressor and in the base rows of every entry that is not zero by structure.
    entries: Arc<[(u16, u16)]>,
    extra: usize,
    bank: Option<Bank>,
    channels: Vec<f64>,
    /// Samples since the filter was started.
    age: u64,
}

impl RowFilter {
    /// `filter`: the model filter, or none; `extra`: further channels through the same.
    pub(crate) fn new(model: &Model, base: &BaseSet, filter: Option<&Butterworth>, extra: usize) -> RowFilter {
        let n = base.len();
        // At most eight rows of a hundred columns.
        let places = |e: Entry| (e.standard as u16, (e.joint * n + e.column) as u16);
        RowFilter::over(structural_entries(model, base).into_iter().map(places).collect(), filter, extra)
    }

    /// One more of the same rows, without further channels.
    pub(crate) fn another(&self, filter: Option<&Butterworth>) -> RowFilter {
        RowFilter::over(Arc::clone(&self.entries), filter, 0)
    }

    fn over(entries: Arc<[(u16, u16)]>, filter: Option<&Butterworth>, extra: usize) -> RowFilter {
        let count = entries.len() + extra;
        let bank = filter.map(|filter| Bank::new(filter.clone(), count));
        RowFilter { entries, extra, bank, channels: vec![0.0; count], age: 0 }
    }

    pub(crate) fn restart(&mut self) {
        self.age = 0;
        if let Some(bank) = &mut self.bank {
            bank.restart();
        }
    }

    pub(crate) fn age(&self) -> u64 {
        self.age
    }

    /// Takes in one side of the regressors and the further channels.
    pub(crate) fn step(&mut self, regressors: &Regressors, side: Side, extra: impl Iterator<Item = f64>) {
        let (columns, further) = self.channels.split_at_mut(self.entries.len());
        let lane = side as usize;
        for (out, &(standard, _)) in columns.iter_mut().zip(&*self.entries) {
            *out = regressors.pair[standard as usize][lane];
        }
        for (out, value) in further.iter_mut().zip(extra) {
            *out = value;
        }
        if let Some(bank) = &mut self.bank {
            bank.step(&mut self.channels);
        }
        self.age += 1;
    }

    /// Writes the filtered rows; entries that are zero by structure are not touched.
    pub(crate) fn rows(&self, out: &mut [f64]) {
        for (value, &(_, base)) in self.channels.iter().zip(&*self.entries) {
            out[base as usize] = *value;
        }
    }

    /// The further channels, filtered.
    pub(crate) fn extra(&self) -> &[f64] {
        &self.channels[self.channels.len() - self.extra..]
    }
}

/// An entry of the base regressor that is not zero by structure.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub(crate) joint: usize,
    /// Base column.
    pub(crate) column: usize,
    /// Place in the standard regressor.
    pub(crate) standard: usize,
}

/// All of them, joint by joint.
pub(crate) fn structural_entries(model: &Model, base: &BaseSet) -> Vec<Entry> {
    let mut entries = Vec::new();
    for joint in 0..model.arm.dof() {
        for (column, &standard) in base.independent.iter().enumerate() {
            if touches(model, model.parameters[standard], joint) {
                entries.push(Entry { joint, column, standard: joint * model.len() + standard });
            }
        }
    }
    entries
}

/// Whether a parameter can make torque at a joint: a link loads the joints before it, a drive its own joint.
fn touches(model: &Model, parameter: Parameter, joint: usize) -> bool {
    match parameter {
        Parameter::Link { link, .. } => link >= joint,
        Parameter::RotorInertia(j)
        | Parameter::Viscous(j)
        | Parameter::Coulomb(j)
        | Parameter::Offset(j)
        | Parameter::LoadFriction(j)
        | Parameter::ViscousQuadratic(j) => j == joint,
        Parameter::CouplingInertia | Parameter::CouplingViscous | Parameter::CouplingCoulomb => {
            model.structure.coupling.is_some_and(|c| c.driving == joint || c.driven == joint)
        }
    }
}

/// Input filtering: the low-pass over the signals before the model, for comparison. It changes the model equation
/// (paper, 3.1.2).
#[derive(Clone, Debug)]
pub(crate) struct InputFilter {
    signals: InputSignals,
    measured: Bank,
    desired: Bank,
    channels: Vec<f64>,
}

impl InputFilter {
    pub(crate) fn new(dof: usize, filter: &Butterworth, signals: InputSignals) -> InputFilter {
        InputFilter {
            signals,
            measured: Bank::new(filter.clone(), 4 * dof),
            desired: Bank::new(filter.clone(), 3 * dof),
            channels: vec![0.0; 4 * dof],
        }
    }

    pub(crate) fn restart(&mut self) {
        self.measured.restart();
        self.desired.restart();
    }

    /// Filters in place. Differentiation and filter commute: filtered positions have filtered derivatives.
    pub(crate) fn step(&mut self, aligned: &mut Aligned) {
        let dof = aligned.q.len();
        // Positions, velocities, accelerations, torques.
        let filtered = match self.signals {
            InputSignals::All => [true; 4],
            InputSignals::Motion => [true, true, true, false],
            InputSignals::Acceleration => [false, false, true, false],
        };
        {
            let parts = [&aligned.q, &aligned.qd, &aligned.qdd, &aligned.tau];
            for (channels, part) in self.channels.chunks_exact_mut(dof).zip(parts) {
                channels.copy_from_slice(part);
            }
        }
        self.measured.step(&mut self.channels);
        let parts = [&mut aligned.q, &mut aligned.qd, &mut aligned.qdd, &mut aligned.tau];
        for ((channels, part), filtered) in self.channels.chunks_exact(dof).zip(parts).zip(filtered) {
            if filtered {
                part.copy_from_slice(channels);
            }
        }
        let Some(desired) = aligned.desired_mut() else {
            self.desired.restart();
            return;
        };
        let channels = &mut self.channels[..3 * dof];
        channels.copy_from_slice(desired);
        self.desired.step(channels);
        for ((channels, part), filtered) in channels.chunks_exact(dof).zip(desired.chunks_exact_mut(dof)).zip(filtered)
        {
            if filtered {
                part.copy_from_slice(channels);
            }
        }
    }
}

/// Rows of the past, newest first by age.
#[derive(Clone, Debug)]
pub(crate) struct Past {
    size: usize,
    depth: usize,
    data: Vec<f64>,
    head: usize,
    filled: usize,
}

impl Past {
    /// Keeps `depth` sets of rows of `size` numbers.
    pub(crate) fn new(size: usize, depth: usize) -> Past {
        Past { size, depth, data: vec![0.0; size * depth], head: 0, filled: 0 }
    }

    pub(crate) fn restart(&mut self) {
        self.filled = 0;
    }

    /// The rows `depth` instants before those that are stored next.
    pub(crate) fn oldest(&self) -> Option<&[f64]> {
        (self.depth > 0 && self.filled == self.depth)
            .then(|| &self.data[self.head * self.size..(self.head + 1) * self.size])
    }

    pub(crate) fn store(&mut self, rows: &[f64]) {
        if self.depth == 0 {
            return;
        }
        self.data[self.head * self.size..(self.head + 1) * self.size].copy_from_slice(rows);
        self.head = if self.head + 1 == self.depth { 0 } else { self.head + 1 };
        self.filled = (self.filled + 1).min(self.depth);
    }
}
