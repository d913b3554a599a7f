//! A first fit of friction and rotor inertia, which sets the doubt about friction near rest.
//!
//! Where the file has no friction, or too little, an arm that sticks shows delays, bristles and Stribeck curves that it does not have.

use rivet_dynamics::Parameter;

use crate::fit::search::Search;
use crate::model::nominal::Nominal;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// Rows in doubt count little, so that a fit without doubt is the first of so many.
const FRICTION_FIT_ROUNDS: usize = 2;

/// Puts friction that the runs have more of than the file, and rotors that it gives as 0, into [`Nominal::near`], and prepares the runs anew;
/// `looked_at` of them are asked. None where the equations have no solution.
pub(crate) fn know(nominal: &mut Nominal, looked_at: usize, runs: &mut [&mut Prepared]) -> Option<()> {
    let still = vec![0; nominal.model.arm.dof()];
    for _ in 0..FRICTION_FIT_ROUNDS {
        let (solved, floor) = {
            let search = Search::new(runs[..looked_at].iter().map(|run| &**run).collect(), nominal)?;
            (search.solved(search.scale)?, search.floor.clone())
        };
        let noise = |p: Parameter| match (p.joint(), nominal.model.structure.coupling) {
            (Some(j), _) => floor[j],
            (None, Some(coupling)) => floor[coupling.driven],
            (None, None) => 0.0,
        };
        let near = |c: usize| match nominal.model.parameters[c] {
            Parameter::Coulomb(_) | Parameter::CouplingCoulomb => {
                let (given, fitted) = (nominal.x[c].abs(), nominal.x[c] + solved.x[c]);
                let more = fitted - given > POLICY.held_out.min_gap_in_motion * noise(nominal.model.parameters[c]);
                if more && fitted > POLICY.plausibility.max_friction_ratio_as_given * given { fitted } else { given }
            }
            Parameter::RotorInertia(_) if nominal.x[c] == 0.0 => solved.x[c].max(0.0),
            _ => nominal.x[c],
        };
        let near: Vec<f64> = (0..nominal.x.len()).map(near).collect();
        if near == nominal.near {
            break;
        }
        nominal.near = near;
        for run in runs.iter_mut() {
            **run = run.later(&still, nominal);
        }
    }
    Some(())
}
