//! From aligned motion to filtered rows: regressor, instruments and torque through one model filter.

use crate::filter::{Bank, Butterworth};
use crate::report::Motion;
use rivet_dynamics::{BaseSet, Model, Parameter, Workspace};

/// Standard regressors of the measured motion and of a second one, side by side: together they cost what one does.
#[derive(Clone, Debug)]
pub(crate) struct Regressors {
    pair: Vec<[f64; 2]>,
    ws: Workspace,
}

/// Which of the two motions of [`Regressors`].
#[derive(Clone, Copy, Debug)]
pub(crate) enum Side {
    Measured,
    Second,
}

impl Regressors {
    pub(crate) fn new(model: &Model) -> Regressors {
        Regressors { pair: vec![[0.0; 2]; model.arm.dof() * model.len()], ws: Workspace::new(&model.arm) }
    }

    /// Evaluates both; without a second motion its side means nothing.
    pub(crate) fn evaluate(&mut self, model: &Model, measured: Motion<'_>, second: Option<Motion<'_>>) {
        // The lanes do not touch each other: an idle one may hold anything.
        let states = [measured, second.unwrap_or(measured)];
        model.regressor_pair(&mut self.ws, states, &mut self.pair);
    }
}

/// Filtered rows of one quantity.
#[derive(Clone, Debug)]
pub(crate) struct RowFilter {
    /// Place in the standard regressor and in the base rows of every entry that is not zero by structure.
    entries: Vec<(u32, u32)>,
    extra: usize,
    bank: Bank,
    channels: Vec<f64>,
    /// Samples since the filter was started.
    age: u64,
}

impl RowFilter {
    /// `extra`: further channels through the same filter.
    pub(crate) fn new(model: &Model, base: &BaseSet, filter: &Butterworth, extra: usize) -> RowFilter {
        let n = base.len();
        // At most eight rows of a hundred columns.
        let places = |e: Entry| (e.standard as u32, (e.joint * n + e.column) as u32);
        let entries: Vec<(u32, u32)> = structural_entries(model, base).into_iter().map(places).collect();
        let count = entries.len() + extra;
        RowFilter { entries, extra, bank: Bank::new(filter.clone(), count), channels: vec![0.0; count], age: 0 }
    }

    pub(crate) fn restart(&mut self) {
        self.age = 0;
        self.bank.restart();
    }

    pub(crate) fn age(&self) -> u64 {
        self.age
    }

    /// Takes in one side of the regressors and the further channels.
    pub(crate) fn step(&mut self, regressors: &Regressors, side: Side, extra: impl Iterator<Item = f64>) {
        let (columns, further) = self.channels.split_at_mut(self.entries.len());
        let lane = side as usize;
        for (out, &(standard, _)) in columns.iter_mut().zip(&self.entries) {
            *out = regressors.pair[standard as usize][lane];
        }
        for (out, value) in further.iter_mut().zip(extra) {
            *out = value;
        }
        self.bank.step(&mut self.channels);
        self.age += 1;
    }

    /// Writes the filtered rows; entries that are zero by structure are not touched.
    pub(crate) fn rows(&self, out: &mut [f64]) {
        for (value, &(_, base)) in self.channels.iter().zip(&self.entries) {
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
        Parameter::RotorInertia(j) | Parameter::Viscous(j) | Parameter::Coulomb(j) | Parameter::Offset(j) => j == joint,
        Parameter::CouplingInertia | Parameter::CouplingViscous | Parameter::CouplingCoulomb => {
            model.structure.coupling.is_some_and(|c| c.driving == joint || c.driven == joint)
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
