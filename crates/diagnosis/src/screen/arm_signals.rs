//! Faults of the signals of the whole arm: torque without its gravity part, and exchanged joints.
//!
//! Values and effects would explain them as a counterbalance or as lighter links.
//!
//! Bodies are as given and drives free, as for what is otherwise of the whole arm (`judge/mounting.rs`).

use nalgebra::DVector;

use crate::effects::columns::AXES;
use crate::model::log_fault::LogFault;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::model::standstill::is_still;
use crate::numerics::parallel;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;
use crate::screen::rigid_torque::{Bodies, FreeDrives, joined};

/// Marks joints of runs whose signals are wrong together, and says why nothing is evaluated; none where nothing is.
pub(crate) fn spoilt(look: &mut [Prepared], sealed: &mut Prepared, nominal: &Nominal) -> Option<String> {
    let (faults, why) = found(look, nominal)?;
    for run in look.iter_mut().chain([sealed]) {
        for (j, fault) in &faults {
            run.silent[*j] = Some(*fault);
        }
    }
    Some(why.to_owned())
}

fn found(look: &[Prepared], nominal: &Nominal) -> Option<(Vec<(usize, LogFault)>, &'static str)> {
    let free = FreeDrives::new(look, nominal);
    let bodies: Vec<Bodies<'_>> = look.iter().map(|run| Bodies::from_run(run, nominal)).collect();
    let without_drives = |torque: &dyn Fn(&Bodies<'_>) -> Column| -> Vec<DVector<f64>> {
        free.without_drives(&bodies.iter().map(torque).collect::<Vec<_>>())
    };
    let measured = free.measured();
    let less =
        |torque: &[DVector<f64>]| -> Vec<DVector<f64>> { measured.iter().zip(torque).map(|(m, t)| m - t).collect() };
    let given = without_drives(&|run| run.as_given());
    let residual = less(&given);
    let as_given = free.size(&residual);
    if as_given <= POLICY.screening.max_fitting_residual {
        return None;
    }
    // Gravity of the file, and what is left without it.
    let axes = AXES.map(|axis| without_drives(&|run| run.weight(axis)));
    let vector = nominal.model.arm.gravity;
    let gravity = |j: usize| -> DVector<f64> { axes.iter().zip(vector).map(|(axis, g)| g * &axis[j]).sum() };
    let gravity: Vec<DVector<f64>> = (0..residual.len()).map(gravity).collect();
    let without: Vec<DVector<f64>> =
        residual.iter().zip(&gravity).map(|(residual, gravity)| residual + gravity).collect();
    let size = |j: usize| gravity[j].norm() / (gravity[j].len().max(1) as f64).sqrt();
    let share = |j: usize| gravity[j].dot(&without[j]) / gravity[j].norm_squared();
    let shares: Vec<(usize, f64)> =
        (0..residual.len()).filter(|j| size(*j) > POLICY.screening.min_gravity).map(|j| (j, share(j))).collect();
    let none = shares.len() >= POLICY.screening.min_gravity_joints
        && shares.iter().all(|(j, share)| {
            share.abs() < POLICY.screening.max_gravity_share.max(POLICY.screening.max_fitting_residual / size(*j))
        });
    // What was taken out leaves each joint as much; a force from outside pulls at one this way, at another that way.
    let doubt = shares
        .iter()
        .map(|(j, _)| 2.0 * POLICY.screening.max_fitting_residual / size(*j))
        .fold(POLICY.screening.max_gravity_share, f64::max);
    let spread = |fold: fn(f64, f64) -> f64| shares.iter().map(|(_, share)| *share).reduce(fold).unwrap_or_default();
    let alike = spread(f64::max) - spread(f64::min) < doubt;
    // Bodies that are all far lighter than the file's have as little gravity, and as little inertia.
    let beyond = |torque: &[DVector<f64>], share_of: &[DVector<f64>]| {
        let (torque, without_drives) = (joined(torque), joined(share_of));
        let share = without_drives.dot(&torque) / without_drives.norm_squared().max(f64::MIN_POSITIVE);
        free.size(&[torque - share * without_drives])
    };
    let lighter = beyond(&measured, &given) < beyond(&without, &gravity);
    if none && alike && !lighter && free.size(&without) < POLICY.screening.max_weightless_residual_share * as_given {
        let faults = shares.into_iter().map(|(j, share)| (j, LogFault::Weightless(share))).collect();
        return Some((
            faults,
            "gravity seems to have been removed from the torque: the rest carries no information on an arm that \
             carries its own weight",
        ));
    }
    let moves = |j: &usize| look.iter().any(|run| !is_still(&run.motion, *j));
    let moving: Vec<usize> = (0..residual.len()).filter(moves).collect();
    let pairs_with = |a: &usize| moving.iter().filter(|b| **b > *a).map(|b| (*a, *b)).collect::<Vec<_>>();
    let pairs: Vec<(usize, usize)> = moving.iter().flat_map(pairs_with).collect();
    let sizes = parallel::map(&pairs, |(a, b)| free.size(&less(&without_drives(&|run| run.exchanged(*a, *b)))));
    let mut sized: Vec<(f64, (usize, usize))> = sizes.into_iter().zip(pairs).collect();
    sized.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (least, (a, b)) = *sized.first()?;
    let no_other = sized.get(1).is_none_or(|second| least < POLICY.plausibility.max_other_pair_ratio * second.0);
    (least < POLICY.screening.max_exchanged_residual_share * as_given && no_other).then(|| {
        (
            vec![(a, LogFault::Exchanged(b)), (b, LogFault::Exchanged(a))],
            "two joints are exchanged: the torque of the other joints fits another motion",
        )
    })
}
