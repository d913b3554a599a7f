//! How the arm is mounted: gravity that points elsewhere than the file says, as of an arm that hangs from a ceiling with the file of one
//! on a table.
//!
//! Every joint's torque is wrong then, by up to twice the links' weight. Values and effects would share that out among themselves, so it
//! is asked before any of them. Torque is linear in gravity: with the bodies as given, drives free, least squares give its vector.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::background::Nominal;
use crate::design::Prepared;
use crate::effect::Effect;
use crate::form::{AXES, weight};
use crate::gap::Gap;
use crate::opened::share_left;
use crate::physics::Physics;
use crate::procedure::Procedure;
use crate::report::{Cause, Diagnosis, JointGap, Shrink, Verdict, pooled};
use crate::rows::Column;
use crate::sealed::Sealed;
use crate::stages::{RunColumns, Stages};

/// Rows that are looked at, spread over each run.
const ROWS: usize = 400;
/// A smaller tilt than this is told with all else that may be wrong \[rad\].
const LEAST: f64 = 0.6;
/// Bodies may be heavier or lighter than the file's: size of the vector found over that of the file's.
const SIZE: [f64; 2] = [0.5, 2.0];
/// Arms are mounted along an axis of their base, or are not: nearer than this it is the axis \[rad\].
const AXIS: f64 = 0.26;
/// What is missed with gravity along it, as a share of what is missed as given, at most.
const BETTER: f64 = 0.6;
/// No arm is known better than to this share of its torque; with the signal's noise it is the unit of what is missed.
const KNOWN: f64 = 0.02;
/// What misses no more than this in that unit is no reason to look.
const FITS: f64 = 1.5;
/// Directions that the motion hardly tells are rounding.
const ROUNDING: f64 = 1e-6;
/// Parts of the runs looked at from which the interval of the shrink comes.
const PARTS: usize = 8;
/// How sure the name is.
const CONFIDENCE: f64 = 0.97;

/// A run's columns of gravity: torque per m/s² along the base's axes.
struct Weighed<'a> {
    run: &'a Prepared,
    columns: Vec<Column>,
}

impl<'a> Weighed<'a> {
    fn of(run: &'a Prepared, nominal: &Nominal) -> Weighed<'a> {
        let physics = Physics::new(&run.run, &run.motion, nominal, &nominal.x);
        let rows = |full: Vec<Option<Vec<f64>>>| full.iter().map(|s| s.as_ref().map(|s| run.chain.apply(s))).collect();
        Weighed { run, columns: weight(&physics, &AXES).into_iter().map(rows).collect() }
    }

    /// The model as given, then with `more` of gravity.
    fn stages(self, nominal: &Nominal, more: Vector3<f64>) -> Stages {
        let own = nominal.x.len();
        let x = DVector::from_iterator(own + 3, std::iter::repeat_n(0.0, own).chain(more.iter().copied()));
        let columns = RunColumns { run: self.run, extra: self.columns };
        columns.stages(&nominal.x, &vec![(own..own + 3).collect()], &x, &vec![0.0; own + 3])
    }
}

/// Gravity as it must have been \[m/s²\], where that is far from the file's, of which is missed `as_given`; none where the runs do not say
/// so.
fn found(look: &[Weighed<'_>], nominal: &Nominal, as_given: f64) -> Option<Vector3<f64>> {
    let given = Vector3::from(nominal.model.arm.gravity);
    let free = missed(look, nominal, None).0;
    let size = free.norm() / given.norm();
    if !(SIZE[0]..=SIZE[1]).contains(&size) || free.angle(&given) < LEAST {
        return None;
    }
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().flat_map(|axis| [axis, -axis]);
    let axis = axes.into_iter().find(|axis| axis.angle(&free) < AXIS);
    let turned = axis.unwrap_or_else(|| free.normalize()) * given.norm();
    (missed(look, nominal, Some(turned)).1 < BETTER * as_given).then_some(turned)
}

/// Gravity by least squares beside the drives, or as `fixed`, and what is missed with it in units of what is known of the torque.
fn missed(look: &[Weighed<'_>], nominal: &Nominal, fixed: Option<Vector3<f64>>) -> (Vector3<f64>, f64) {
    let links = 10 * nominal.model.arm.dof();
    let given = Vector3::from(nominal.model.arm.gravity);
    let free = if fixed.is_some() { 0 } else { 3 };
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let mut left: Vec<f64> = Vec::new();
    for Weighed { run, columns: gravity } in look {
        let count = run.rows();
        for j in (0..run.tau.len()).filter(|j| run.silent[*j].is_none()) {
            let rms = (run.tau[j].iter().map(|t| t * t).sum::<f64>() / count.max(1) as f64).sqrt();
            let known = run.floor[j].hypot(KNOWN * rms);
            let value = |column: &Column, k: usize| column[j].as_ref().map_or(0.0, |rows| rows[k]);
            for k in (0..count).step_by((count / ROWS).max(1)) {
                let weight = 1.0 / known.hypot(run.doubt[j][k]).max(f64::MIN_POSITIVE);
                let bodies: f64 = run.standard[..links].iter().zip(&nominal.x).map(|(c, x)| x * value(c, k)).sum();
                let along =
                    |g: Vector3<f64>| gravity.iter().zip(g.iter()).map(|(column, g)| g * value(column, k)).sum::<f64>();
                let effects = run.known_rows.get(j).map_or(0.0, |rows| rows[k]);
                let known = bodies + effects + along(fixed.unwrap_or_else(Vector3::zeros) - given);
                left.push(weight * (run.tau[j][k] - known));
                let drives = run.standard[links..].iter().map(|c| weight * value(c, k));
                rows.push(drives.chain(gravity[..free].iter().map(|column| weight * value(column, k))).collect());
            }
        }
    }
    let width = rows.first().map_or(0, Vec::len);
    if width == 0 {
        return (given, 0.0);
    }
    let mut d = DMatrix::from_fn(rows.len(), width, |r, c| rows[r][c]);
    let sizes: Vec<f64> = d.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    d.column_iter_mut().zip(&sizes).for_each(|(mut column, size)| column /= *size);
    let y = DVector::from_vec(left);
    let svd = d.clone().svd(true, true);
    let Ok(x) = svd.solve(&y, ROUNDING * svd.singular_values.max()) else { return (given, 0.0) };
    let over = ((y - d * &x).norm_squared() / rows.len() as f64).sqrt();
    let vector = fixed.unwrap_or_else(|| Vector3::from_fn(|axis, _| x[width - 3 + axis] / sizes[width - 3 + axis]));
    (vector, over)
}

/// What is said of an arm that is mounted otherwise than its file says, before anything else is asked of its logs; none of others.
pub(crate) fn check(procedure: &Procedure<'_>, say: &mut dyn FnMut(&str)) -> Option<Diagnosis> {
    let Procedure { nominal, look, sealed, data, ref mute } = *procedure;
    let given = Vector3::from(nominal.model.arm.gravity);
    // With gravity as given no column of it is asked for.
    let bare: Vec<Weighed<'_>> = look.iter().map(|run| Weighed { run, columns: Vec::new() }).collect();
    let as_given = missed(&bare, nominal, Some(given)).1;
    if as_given <= FITS {
        return None;
    }
    let looked_at: Vec<Weighed<'_>> = look.iter().map(|run| Weighed::of(run, nominal)).collect();
    let gravity = found(&looked_at, nominal, as_given)?;
    say("gravity points elsewhere");
    let more = gravity - given;
    let seen: Vec<Stages> = looked_at.into_iter().map(|run| run.stages(nominal, more)).collect();
    let stages = Weighed::of(sealed, nominal).stages(nominal, more);
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
    let cause = Cause {
        effect: Effect::GravityDirection,
        joints: Vec::new(),
        magnitude: [
            ("turned_rad", gravity.angle(&given)),
            ("gravity_x_m_s2", gravity[0]),
            ("gravity_y_m_s2", gravity[1]),
            ("gravity_z_m_s2", gravity[2]),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into(),
        shrink: Shrink { predicted, low, high, measured: 1.0 - after.all / before.all },
        share: Some(1.0),
        p_value: None,
        confidence: CONFIDENCE,
        indistinguishable_from: Vec::new(),
        angles: Vec::new(),
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
        per_joint: (0..names.len()).map(joint).collect(),
        place: procedure.place(&stages, &names),
        causes: vec![cause],
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
