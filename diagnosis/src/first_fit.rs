//! Friction and rotors that the file does not know: how long an arm may have stood, and what it holds then, is told by their real
//! size. With no friction to doubt, an arm that sticks shows delays, bristles and Stribeck curves that it does not have.

use rivet_dynamics::Parameter;

use crate::background::Nominal;
use crate::design::Prepared;
use crate::search::Search;

/// Puts drives' values that the file gives as 0 into [`Nominal::near`] as the runs have them, and prepares the runs anew; `looked_at` of
/// them are asked. None where the equations have no solution.
pub(crate) fn know(nominal: &mut Nominal, looked_at: usize, runs: &mut [&mut Prepared]) -> Option<()> {
    let parameters = nominal.model.parameters.iter().enumerate();
    let drive =
        |p: &Parameter| matches!(p, Parameter::Coulomb(_) | Parameter::RotorInertia(_) | Parameter::CouplingCoulomb);
    let missing: Vec<usize> = parameters.filter(|(c, p)| drive(p) && nominal.x[*c] == 0.0).map(|(c, _)| c).collect();
    if missing.is_empty() {
        return Some(());
    }
    let solved = {
        let search = Search::new(runs[..looked_at].iter().map(|run| &**run).collect(), nominal)?;
        search.solved(search.scale)?
    };
    for c in missing {
        nominal.near[c] = solved.x[c].max(0.0);
    }
    let still = vec![0; nominal.model.arm.dof()];
    for run in runs {
        **run = run.later(&still, nominal);
    }
    Some(())
}
