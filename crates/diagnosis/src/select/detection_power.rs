//! Detection power: which effects of which size a diagnosis of these very runs would find.
//!
//! Torque of an effect is added to that of the runs and the first choice of the search is made again. Only the torque changes, so thousands
//! of candidates cost little.
//!
//! Inner values stay on the grid, weights of rows in doubt as they were, and the sealed run is looked at with the others: what is found
//! here the whole procedure finds as a rule, not always.

use rivet_dynamics::Model;

use crate::effects::Effect;
use crate::effects::physics::Physics;
use crate::fit::initial_friction;
use crate::fit::search::{Candidate, Search};
use crate::model::listener::{Listener, Silent};
use crate::model::nominal::{Nominal, Typical};
use crate::model::run::Run;
use crate::screen::input::{DiagnosisError, check};
use crate::screen::prepared::Prepared;
use crate::screen::torque_timing;
use crate::select::adopted::Adopted;
use crate::select::angle_orders;
use crate::select::contact_bursts;
use crate::select::forward::{Round, Selected};
use crate::select::residual::Residue;

/// An effect that was named, with what cannot be told from it and its joints (none: the whole arm).
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// Its name.
    pub effect: Effect,
    /// Others that explain the same.
    pub or: Vec<Effect>,
    /// Joints, from 0.
    pub joints: Vec<usize>,
}

/// Runs that effects are added to.
pub struct Probe<'a> {
    search: Search<'a>,
    physics: Vec<Physics<'a>>,
    candidates: Vec<Candidate>,
    adopted: Vec<Adopted>,
    scale: f64,
}

/// Prepares runs and hands them to `ask`.
///
/// # Errors
/// As [`crate::diagnose`].
pub fn probe<T>(
    model: &Model,
    nominal: &[f64],
    runs: Vec<Run>,
    listener: &mut dyn Listener,
    ask: impl FnOnce(&mut Probe<'_>) -> T,
) -> Result<T, DiagnosisError> {
    let joints = model.arm.dof();
    for run in &runs {
        check(run, joints)?;
    }
    if runs.is_empty() {
        return Err(DiagnosisError::NoRun);
    }
    let mut nominal = Nominal::new(model, nominal, &Typical::from_runs(&runs, joints));
    let mut runs: Vec<Prepared> = runs.into_iter().map(|run| Prepared::new(run, &nominal)).collect();
    torque_timing::alignment::align(&mut runs.iter_mut().collect::<Vec<_>>(), &nominal, listener);
    let looked_at = runs.len();
    let known = initial_friction::know(&mut nominal, looked_at, &mut runs.iter_mut().collect::<Vec<_>>());
    known.ok_or(DiagnosisError::Singular)?;
    let mut probe = Probe::new(&runs, &nominal, listener).ok_or(DiagnosisError::Singular)?;
    Ok(ask(&mut probe))
}

impl<'a> Probe<'a> {
    fn new(runs: &'a [Prepared], nominal: &'a Nominal, listener: &mut dyn Listener) -> Option<Probe<'a>> {
        let mut search = Search::new(runs.iter().collect(), nominal)?;
        search.keeps_columns = true;
        let mut selected = Selected::new(&search)?;
        selected.select(&mut search, listener)?;
        let Selected { adopted, physics, mut candidates } = selected;
        if candidates.is_empty() {
            let (orders, bursts) = (angle_orders::find(&physics), contact_bursts::find(&search)?);
            candidates = search.candidates(&physics, &orders, &bursts, None, listener);
        }
        let scale = search.scale;
        Some(Probe { search, physics, candidates, adopted, scale })
    }

    /// What was found in the runs as they are.
    pub fn found(&self) -> Vec<Named> {
        self.adopted.iter().map(|a| Named { effect: a.form.effect(), or: others(a), joints: a.form.joints() }).collect()
    }

    /// Root mean square of the torque that one joint's runs are left with \[N·m\].
    pub fn residual_rms(&self) -> &[f64] {
        &self.search.noise
    }

    /// What is named first with `added[run][joint][sample]` \[N·m\] added to the torque; nothing when nothing is.
    ///
    /// `ordered`: a joint whose angle the torque repeats with, so that orders are looked for anew.
    pub fn named_with(&mut self, added: &[Vec<Vec<f64>>], ordered: Option<usize>) -> Option<Named> {
        let rows = self.rows(added);
        let ordered_candidates: Vec<Candidate> = ordered.map_or_else(Vec::new, |j| {
            let orders = angle_orders::on(&self.physics, j, Some(added));
            let forms = orders.into_iter().flat_map(|order| crate::effects::candidates::periodic(j, order));
            forms.filter_map(|form| self.search.candidate(form, &self.physics)).collect()
        });
        self.asked(&rows, ordered_candidates)
    }

    /// What is named when the residual of the runs changes sign, block by block: nothing has been added, so a name is a
    /// false alarm. `flipped` says which blocks.
    pub fn false_alarm(&mut self, mut flipped: impl FnMut(usize) -> bool) -> Option<Named> {
        let solved = self.search.best()?.1;
        let residuals = self.search.design.residuals(&solved.x, &solved.stretches);
        let mut rows: Vec<Vec<Vec<f64>>> =
            residuals.iter().map(|run| run.iter().map(|r| vec![0.0; r.len()]).collect()).collect();
        for (b, block) in self.search.design.blocks.iter().enumerate() {
            if !flipped(b) {
                continue;
            }
            for (j, to) in rows[block.run].iter_mut().enumerate() {
                for k in block.rows.clone() {
                    to[k] = -2.0 * residuals[block.run][j][k] / self.search.design.root(block.run, j)[k];
                }
            }
        }
        self.asked(&rows, Vec::new())
    }

    fn rows(&self, added: &[Vec<Vec<f64>>]) -> Vec<Vec<Vec<f64>>> {
        let runs = self.search.runs.iter().zip(added);
        runs.map(|(run, added)| added.iter().map(|t| run.chain.apply(t)).collect()).collect()
    }

    /// The search's first choice with rows added to the torque; the search is as before afterwards.
    fn asked(&mut self, rows: &[Vec<Vec<f64>>], mut own: Vec<Candidate>) -> Option<Named> {
        let (noise, correlations, weights) =
            (self.search.noise.clone(), self.search.correlations.clone(), self.search.weights.clone());
        let target = self.search.design.target();
        self.search.design.add(rows);
        let named = self.first(&mut own);
        self.search.design.set_target(target);
        self.search.noise = noise;
        self.search.correlations = correlations;
        self.search.weights = weights;
        self.search.scale = self.scale;
        named
    }

    fn first(&mut self, own: &mut Vec<Candidate>) -> Option<Named> {
        self.search.weigh()?;
        let kept = self.candidates.len();
        self.candidates.append(own);
        for candidate in &mut self.candidates {
            self.search.design.retarget(candidate);
        }
        let round = Round {
            search: &self.search,
            candidates: &self.candidates,
            physics: &self.physics,
            adopted: &self.adopted,
            flips: None,
            refined: false,
        };
        let found = round.best(&mut Silent);
        self.candidates.truncate(kept);
        let (_, adopted) = found??;
        // As the report decides: what is left where the effect is said to act must be explained.
        let residual_rms: Vec<f64> = (0..self.search.noise.len())
            .map(|j| {
                let share = adopted.shares.get(j).copied().unwrap_or(0.0).clamp(0.0, 1.0);
                self.search.noise[j] * (1.0 - share).sqrt()
            })
            .collect();
        let residue = Residue { first: &self.search.noise, left: &residual_rms, floor: &self.search.floor };
        if !residue.upholds(&adopted) {
            return None;
        }
        Some(Named { effect: adopted.form.effect(), or: others(&adopted), joints: adopted.form.joints() })
    }
}

fn others(adopted: &Adopted) -> Vec<Effect> {
    adopted.class().into_iter().map(|(effect, _)| effect).collect()
}
