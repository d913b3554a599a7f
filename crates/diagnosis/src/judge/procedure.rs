//! What a diagnosis works on: sound training runs, the held-out run, and the steps of the selection.

use rivet_dynamics::Parameter;

use crate::effects::Effect;
use crate::model::log_fault::LogFinding;
use crate::model::nominal::Nominal;
use crate::report::diagnosis::DataUse;
use crate::screen::prepared::Prepared;
use crate::select::adopted::Adopted;

/// Runs that are sound, and what was said of the others.
pub(crate) struct Procedure<'a> {
    pub(crate) nominal: &'a Nominal,
    pub(crate) look: &'a [Prepared],
    pub(crate) sealed: &'a Prepared,
    pub(crate) data: DataUse,
    /// Of runs that say nothing and were left out.
    pub(crate) mute: Vec<LogFinding>,
}

/// A cause before it is reported.
#[derive(Clone)]
pub(crate) struct Step {
    pub(crate) effect: Effect,
    pub(crate) joints: Vec<usize>,
    pub(crate) columns: Vec<usize>,
    /// Empty for values that the background has.
    pub(crate) adopted: Vec<Adopted>,
    /// Values of joints on which something without a name is left, which they may only imitate.
    pub(crate) doubtful: bool,
}

impl Step {
    /// The step without values of drives on joints that are not `told`.
    pub(crate) fn on_drives(&self, parameters: &[Parameter], told: impl Fn(usize) -> bool) -> Step {
        let stays = |j: usize| !is_drive(self.effect) || told(j);
        let joint = |c: usize| parameters.get(c).and_then(Parameter::joint);
        Step {
            joints: self.joints.iter().copied().filter(|j| stays(*j)).collect(),
            columns: self.columns.iter().copied().filter(|c| joint(*c).is_none_or(stays)).collect(),
            ..self.clone()
        }
    }
}

/// Values of drives, of which few others take the place.
pub(crate) fn is_drive(effect: Effect) -> bool {
    effect.about().is_drive
}

impl Procedure<'_> {
    /// Names of the joints.
    pub(crate) fn names(&self) -> Vec<String> {
        self.nominal.model.arm.joints.iter().map(|j| j.name.clone()).collect()
    }
}
