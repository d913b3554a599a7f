//! Mounting of the base and zeros of joints, tested before anything is fitted: gravity along another direction, or one joint with another
//! zero.
//!
//! Every joint's torque is wrong then, by up to twice the links' weight. Values and effects would share that out among themselves, so it
//! is asked before any of them. Torque is linear in gravity: with the bodies as given, drives free, least squares give its vector. The two
//! may look alike (an arm whose second joint is off by half a turn all but hangs), so both are asked, and the one that leaves less is told.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::effects::Effect;
use crate::effects::columns::AXES;
use crate::effects::{encoder_offset, gravity_direction};
use crate::fit::motion_gap::Sealed;
use crate::fit::stages::{RunColumns, Stages};
use crate::judge::causes::share_left;
use crate::judge::procedure::Procedure;
use crate::model::gap::Gap;
use crate::model::listener::Listener;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::policy::POLICY;
use crate::report::diagnosis::{Cause, Diagnosis, JointGap, Shrink, Verdict, pooled};
use crate::report::regimes;
use crate::screen::joint_zero::{self, Zero};
use crate::screen::prepared::Prepared;
use crate::screen::rigid_torque::{Bodies, FreeDrives, joined};

/// Bodies may be heavier or lighter than the file's: size of the vector found over that of the file's.
const SIZE: [f64; 2] = [0.5, 2.0];
/// Parts of the runs looked at from which the interval of the shrink comes.
const PARTS: usize = 8;

/// What is otherwise.
#[derive(Clone, Copy)]
enum Otherwise {
    /// Gravity as it must have been \[m/s²\].
    Gravity(Vector3<f64>),
    Zero(Zero),
}

impl Otherwise {
    fn effect(&self) -> Effect {
        match self {
            Otherwise::Gravity(_) => gravity_direction::EFFECT,
            Otherwise::Zero(_) => encoder_offset::EFFECT,
        }
    }

    /// What may be missed with it of what is missed as given.
    fn better(&self) -> f64 {
        match self {
            Otherwise::Gravity(_) => POLICY.screening.max_gravity_residual_share,
            Otherwise::Zero(_) => POLICY.screening.max_zero_residual_share,
        }
    }

    /// What it adds to a run's torque as given.
    fn more(&self, run: &Prepared, nominal: &Nominal) -> Column {
        let bodies = Bodies::from_run(run, nominal);
        let sum = |parts: &[(f64, Column)]| -> Column {
            let joint_column = |j: usize| {
                let mut rows = vec![0.0; run.rows()];
                for (factor, column) in parts {
                    let values = column[j].iter().flatten();
                    rows.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
                }
                Some(rows)
            };
            (0..run.tau.len()).map(joint_column).collect()
        };
        match self {
            Otherwise::Gravity(gravity) => {
                let more = gravity - Vector3::from(nominal.model.arm.gravity);
                sum(&AXES
                    .map(|axis| bodies.weight(axis))
                    .into_iter()
                    .zip(&more)
                    .map(|(c, g)| (*g, c))
                    .collect::<Vec<_>>())
            }
            Otherwise::Zero(Zero { joint, angle, .. }) => {
                sum(&[(1.0, bodies.turned(*joint, *angle)), (-1.0, bodies.as_given())])
            }
        }
    }

    /// The model as given, then with it.
    fn stages(&self, run: &Prepared, nominal: &Nominal) -> Stages {
        let model_columns = nominal.x.len();
        let columns = RunColumns { run, extra: vec![self.more(run, nominal)] };
        let mut x = DVector::zeros(model_columns + 1);
        x[model_columns] = 1.0;
        columns.stages(&nominal.x, &vec![vec![model_columns]], &x, &vec![0.0; model_columns + 1])
    }

    fn magnitude(&self, given: &Vector3<f64>) -> Vec<(String, f64)> {
        let named = |list: &[(&str, f64)]| list.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        match self {
            Otherwise::Gravity(g) => named(&[
                ("turned_rad", g.angle(given)),
                ("gravity_x_m_s2", g[0]),
                ("gravity_y_m_s2", g[1]),
                ("gravity_z_m_s2", g[2]),
            ]),
            Otherwise::Zero(Zero { angle, .. }) => named(&[("offset_rad", *angle), ("turned_rad", angle.abs())]),
        }
    }
}

/// The runs looked at with drives free: what is measured, what is left of it as given, and gravity's three columns.
struct Looked<'a> {
    free: FreeDrives<'a>,
    bodies: Vec<Bodies<'a>>,
    measured: Vec<DVector<f64>>,
    left: DVector<f64>,
    weight: DMatrix<f64>,
    given: Vector3<f64>,
}

impl<'a> Looked<'a> {
    fn at(look: &'a [Prepared], nominal: &'a Nominal) -> Looked<'a> {
        let free = FreeDrives::new(look, nominal);
        let bodies: Vec<Bodies<'_>> = look.iter().map(|run| Bodies::from_run(run, nominal)).collect();
        let measured = free.measured();
        let given = Vector3::from(nominal.model.arm.gravity);
        let mut looked =
            Looked { left: joined(&measured), weight: DMatrix::zeros(0, 0), measured, given, free, bodies };
        looked.left -= looked.without_drives(&|run| run.as_given());
        looked.weight = DMatrix::from_columns(&AXES.map(|axis| looked.without_drives(&|run| run.weight(axis))));
        looked
    }

    fn without_drives(&self, torque: &dyn Fn(&Bodies<'_>) -> Column) -> DVector<f64> {
        joined(&self.free.without_drives(&self.bodies.iter().map(torque).collect::<Vec<_>>()))
    }

    /// Root mean square in units of what is known of the torque.
    fn size(&self, left: DVector<f64>) -> f64 {
        self.free.size(&[left])
    }

    fn as_given(&self) -> f64 {
        self.size(self.left.clone())
    }

    fn with_gravity(&self, gravity: &Vector3<f64>) -> f64 {
        self.size(&self.left - self.change(&Otherwise::Gravity(*gravity)))
    }

    /// What drives cannot make of the torque that it adds.
    fn change(&self, told: &Otherwise) -> DVector<f64> {
        match told {
            Otherwise::Gravity(gravity) => &self.weight * DVector::from_column_slice((gravity - self.given).as_slice()),
            Otherwise::Zero(zero) => {
                self.without_drives(&|run| run.turned(zero.joint, zero.angle))
                    - self.without_drives(&|run| run.as_given())
            }
        }
    }

    /// Gravity as it must have been, where that is far from the file's, and what is missed with it.
    fn gravity(&self) -> Option<(Otherwise, f64)> {
        let more = self.weight.clone().svd_unordered(true, true).solve(&self.left, 1e-9 * self.weight.norm()).ok()?;
        let free = self.given + Vector3::from_column_slice(more.as_slice());
        let size = free.norm() / self.given.norm();
        if !(SIZE[0]..=SIZE[1]).contains(&size) || free.angle(&self.given) < POLICY.screening.min_tilt_rad {
            return None;
        }
        let axes = AXES.map(Vector3::from).into_iter().flat_map(|axis| [axis, -axis]);
        let axis = axes.into_iter().find(|axis| axis.angle(&free) < POLICY.screening.max_axis_error_rad);
        let turned = axis.unwrap_or_else(|| free.normalize()) * self.given.norm();
        Some((Otherwise::Gravity(turned), self.with_gravity(&turned)))
    }

    /// The zero that is another, and what is missed with it.
    fn zero(&self) -> Option<(Otherwise, f64)> {
        let zeros = joint_zero::all(&self.free, &self.bodies, &self.measured);
        let [first, others @ ..] = &zeros[..] else { return None };
        let no_other =
            others.first().is_none_or(|second| first.missed < POLICY.plausibility.max_other_zero_ratio * second.missed);
        // A tool that is mounted turned, or a body that stands elsewhere, is no zero; of the last joint nothing tells the two apart.
        let no_body =
            || self.free.with_body(&self.left, first.joint) > POLICY.screening.max_rival_residual_ratio * first.missed;
        (first.angle.abs() >= POLICY.screening.min_zero_rad && no_other && no_body())
            .then_some((Otherwise::Zero(*first), first.missed))
    }
}

/// What is said of an arm that is mounted or counted otherwise than its file says, before anything else is asked of its logs; none of
/// others.
pub(crate) fn check(procedure: &Procedure<'_>, listener: &mut dyn Listener) -> Option<Diagnosis> {
    let Procedure { nominal, look, .. } = *procedure;
    let looked = Looked::at(look, nominal);
    let as_given = looked.as_given();
    if as_given <= POLICY.screening.max_fitting_residual {
        return None;
    }
    let found = [looked.gravity(), looked.zero()];
    let better = found.into_iter().flatten().filter(|(told, missed)| *missed < told.better() * as_given);
    let mut better: Vec<(Otherwise, f64)> = better.collect();
    if let [(_, gravity), (_, zero)] = better[..]
        && zero * POLICY.screening.max_equal_residual_ratio < gravity
    {
        better.reverse();
    }
    let (told, missed) = *better.first()?;
    let change = looked.change(&told);
    let alike = better[1..]
        .iter()
        .filter(|(_, other)| *other < POLICY.screening.max_rival_residual_ratio * missed)
        .map(|(other, _)| {
            let cosine = change.normalize().dot(&looked.change(other).normalize());
            (other.effect(), cosine.clamp(-1.0, 1.0).acos())
        });
    let alike: Vec<(Effect, f64)> = alike.collect();
    tell(procedure, told, missed / as_given, alike).inspect(|_| {
        listener.line(match told {
            Otherwise::Gravity(_) => "gravity points elsewhere",
            Otherwise::Zero(_) => "a joint's zero is elsewhere",
        });
    })
}

/// The report, where the sealed run bears out what the others promise.
fn tell(procedure: &Procedure<'_>, told: Otherwise, share: f64, alike: Vec<(Effect, f64)>) -> Option<Diagnosis> {
    let Procedure { nominal, look, sealed, data, ref mute } = *procedure;
    let seen: Vec<Stages> = look.iter().map(|run| told.stages(run, nominal)).collect();
    let stages = told.stages(sealed, nominal);
    let [before, after] = [0, 1].map(|stage| Gap::new(&stages.tau, &stages.models[stage]));
    let (predicted, low, high) = promised(&seen);
    let names = procedure.names();
    let on = Sealed { run: sealed, stages: &stages, noise: &sealed.floor };
    let floors = on.floor();
    let joint = |j: usize| JointGap {
        joint: names[j].clone(),
        before: before.per_joint[j],
        after: after.per_joint[j],
        noise_floor: floors[j],
        repeats: None,
        in_motion: on.in_motion(j),
    };
    let per_joint: Vec<JointGap> = (0..names.len()).map(joint).collect();
    // In units of the joint's torque; one that stands holds what its friction lets it.
    let grows = |gap: &JointGap| gap.in_motion.map_or(0.0, |[a, b]| (b - a) * gap.noise_floor);
    let measured = 1.0 - after.all / before.all;
    let unseen = Looked::at(std::slice::from_ref(sealed), nominal);
    let gap_share = unseen.size(&unseen.left - unseen.change(&told)) / unseen.as_given().max(f64::MIN_POSITIVE);
    if low <= 0.0
        || measured <= 0.0
        || gap_share > told.better()
        || per_joint.iter().any(|gap| grows(gap) > POLICY.screening.max_gap_growth)
    {
        return None;
    }
    let sure = alike.is_empty() && share.max(gap_share) < POLICY.screening.max_zero_residual_share;
    let joints = match told {
        Otherwise::Gravity(_) => Vec::new(),
        Otherwise::Zero(zero) => vec![names[zero.joint].clone()],
    };
    let cause = Cause {
        effect: told.effect(),
        joints,
        magnitude: told.magnitude(&Vector3::from(nominal.model.arm.gravity)),
        intervals: Vec::new(),
        shrink: Shrink { predicted, low, high, measured },
        share: Some(1.0),
        p_value: None,
        confidence: if sure { POLICY.confidence.mounting } else { POLICY.confidence.mounting_unsure },
        angles: alike.iter().map(|(_, angle)| *angle).collect(),
        indistinguishable_from: alike.into_iter().map(|(effect, _)| effect).collect(),
        separating_motion: None,
        curves: Vec::new(),
        impossible: None,
    };
    let floor = pooled(&floors);
    Some(Diagnosis {
        verdict: Verdict::Parameter,
        before: before.all,
        after: after.all,
        noise_floor: floor,
        per_joint,
        place: regimes::cells(sealed, &stages, &names),
        causes: vec![cause],
        creeping_share: f64::NAN,
        unexplained_share: share_left(&before, &after, floor),
        log: mute.clone(),
        remark: None,
        ..Diagnosis::not_evaluated(data, "")
    })
}

/// Shrink of the gap over the runs looked at, and the least and the most of their parts.
fn promised(seen: &[Stages]) -> (f64, f64, f64) {
    let shrink = |of: &dyn Fn(&[f64]) -> Vec<f64>| {
        let joined = |signals: &dyn Fn(&Stages) -> &Vec<Vec<f64>>| -> Vec<Vec<f64>> {
            let joints = seen.first().map_or(0, |s| s.tau.len());
            (0..joints).map(|j| seen.iter().flat_map(|s| of(&signals(s)[j])).collect()).collect()
        };
        let tau = joined(&|s| &s.tau);
        let [before, after] = [0, 1].map(|stage| Gap::new(&tau, &joined(&|s| &s.models[stage])).all);
        1.0 - after / before
    };
    let all = shrink(&<[f64]>::to_vec);
    let part = |p: usize| shrink(&|rows| rows[p * rows.len() / PARTS..(p + 1) * rows.len() / PARTS].to_vec());
    let parts: Vec<f64> = (0..PARTS).map(part).filter(|s| s.is_finite()).collect();
    let [low, high] = [f64::min, f64::max].map(|of| parts.iter().copied().fold(all, of));
    (all, low, high)
}
