//! Columns of an external force and moment at the flange: base axes times hat functions of time, one stretch for each burst.
//!
//! What touches the last link elsewhere than at the origin of its frame has a moment about that: 40 N at the end of a link of 0.4 m were told
//! as 413 N there without one.

use std::ops::Range;

use nalgebra::{Cholesky, DMatrix, DVector, Vector3};
use rivet_dynamics::{Arm, Joint, JointKind, Places, Workspace, flange_pose, inverse_dynamics};

use crate::effects::external_force::{Force, force_components};
use crate::effects::physics::Physics;
use crate::fit::evidence::{Belief, CandidateSums};
use crate::fit::search::{Bursts, Candidate, Search};
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::numerics::elimination::Stretch;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// Distance between the tops of two hats \[s\].
const HAT_S: f64 = 0.25;
/// Longer bursts are cut into parts \[s\]: the columns of one are solved for together.
const MAX_BURST_S: f64 = 10.0;
const LONGEST_M: f64 = 0.5;

impl Search<'_> {
    /// The candidate for contact in bursts. Its one column is nothing in the design: it stands for the torque of all
    /// stretches as they are solved for.
    pub(crate) fn contact(&self, windows: &Bursts, moment: bool, physics: &[Physics<'_>]) -> Option<Candidate> {
        let mut local = Vec::new();
        for (at, ((run, physics), own)) in self.runs.iter().zip(physics).zip(windows).enumerate() {
            local.extend(stretches(at, run, physics, own, moment));
        }
        let joints = self.noise.len();
        let torque: Vec<f64> =
            (0..joints).map(|j| self.trusted_runs(j).flat_map(|r| &r.tau[j]).map(|t| t * t).sum()).collect();
        let reach = reach(self.nominal);
        for stretch in &mut local {
            let mut std: Vec<f64> = Vec::with_capacity(stretch.columns.len());
            for hat in stretch.columns.chunks(force_components(moment)) {
                let force = hat[..3].iter().map(|column| free(column, &torque)).collect::<Option<Vec<f64>>>()?;
                std.extend(&force);
                // A moment is what a force has within reach.
                std.extend(hat[3..].iter().zip(&force).map(|(_, force)| force * reach));
            }
            stretch.std = DVector::from_vec(std);
            stretch.cells = self.design.stretch(stretch);
        }
        let nothing: Vec<Vec<Column>> = self.runs.iter().map(|_| vec![vec![None; joints]]).collect();
        (!local.is_empty()).then(|| Candidate {
            form: Force { windows: windows.clone(), moment }.into(),
            columns: nothing,
            cells: Vec::new(),
            belief: Belief { mean: DVector::repeat(1, 1.0), std: DVector::repeat(1, 1.0) },
            local,
            scores: None,
        })
    }

    /// Torque of a candidate's stretches with coefficients `c`, one behind the other, as one column's products.
    pub(crate) fn contact_sums(&self, candidate: &Candidate, c: &DVector<f64>) -> CandidateSums {
        let mut cd = nalgebra::DMatrix::zeros(1, self.design.background.len());
        let mut from = 0;
        for stretch in &candidate.local {
            let coefficients = c.rows(from, stretch.std.len());
            from += stretch.std.len();
            for cell in &stretch.cells {
                cd.gemm_tr(self.weights[cell.joint], &coefficients, &cell.cd, 1.0);
            }
        }
        cd.into()
    }

    /// Of each burst the force along the base's axes that is nearest to what was found, were it the same throughout \[N\]: instants at which
    /// joints tell little of it count little. (The largest of instants is as large as noise makes it there.)
    pub(crate) fn steady_force<'b>(
        &'b self,
        found: &'b [DVector<f64>],
        moment: bool,
    ) -> impl Iterator<Item = Vector3<f64>> + 'b {
        let each = force_components(moment);
        self.design.background.local.iter().zip(found).filter_map(move |(stretch, c)| {
            let mut information = DMatrix::zeros(each, each);
            let mut sum = DVector::zeros(each);
            for cell in &stretch.cells {
                let weighed = &cell.cc * c;
                for (a, weighed) in weighed.iter().enumerate() {
                    sum[a % each] += self.weights[cell.joint] * weighed;
                    for b in 0..c.len() {
                        information[(a % each, b % each)] += self.weights[cell.joint] * cell.cc[(a, b)];
                    }
                }
            }
            let force = Cholesky::new(information)?.solve(&sum);
            Some(Vector3::new(force[0], force[1], force[2]))
        })
    }
}

/// How far from the origin of the last link something may touch it \[m\]: twice as far as its centre of mass, and a hand more.
fn reach(nominal: &Nominal) -> f64 {
    let last = &nominal.x[Places::link(nominal.model.arm.dof() - 1)];
    let arm = last[1..4].iter().map(|h| h * h).sum::<f64>().sqrt() / last[0].max(f64::MIN_POSITIVE);
    POLICY.priors.min_contact_distance_m + 2.0 * arm.min(LONGEST_M)
}

/// The same as of any free column, over the rows that there are.
fn free(column: &[Vec<f64>], torque: &[f64]) -> Option<f64> {
    let ratio = |(values, torque): (&Vec<f64>, &f64)| {
        let square: f64 = values.iter().map(|v| v * v).sum();
        if square > 0.0 { (torque / square).sqrt() } else { f64::INFINITY }
    };
    let least = column.iter().zip(torque).map(ratio).fold(f64::INFINITY, f64::min);
    least.is_finite().then_some(POLICY.priors.force_torque_share * least)
}

/// Stretches of one run without beliefs and products. They share no row: where filters reach from one into the next they
/// end amid the two.
fn stretches(at: usize, run: &Prepared, physics: &Physics<'_>, windows: &[(f64, f64)], moment: bool) -> Vec<Stretch> {
    let parts: Vec<(f64, f64)> = windows
        .iter()
        .flat_map(|(from, to)| {
            let count = ((to - from) / MAX_BURST_S).ceil().max(1.0);
            let end = move |k: usize| from + (to - from) * k as f64 / count;
            (0..count as usize).map(move |k| (end(k), end(k + 1)))
        })
        .collect();
    let sample = |t: f64| (t / physics.period_s()).round().max(0.0) as usize;
    let amid = |a: usize, b: usize| sample(0.5 * (parts[a].1 + parts[b].0));
    (0..parts.len())
        .filter_map(|k| {
            let first = if k > 0 { amid(k - 1, k) } else { 0 };
            let last = if k + 1 < parts.len() { amid(k, k + 1) } else { physics.samples() };
            let rows = run.chain.rows_of(first..last, physics.samples());
            stretch(at, run, physics, parts[k], &rows, moment)
        })
        .collect()
}

/// The stretch of one part of a burst, as far as its torque reaches within `bounds` \[rows\].
fn stretch(
    at: usize,
    run: &Prepared,
    physics: &Physics<'_>,
    (from, to): (f64, f64),
    bounds: &Range<usize>,
    moment: bool,
) -> Option<Stretch> {
    let (n, samples, period) = (physics.joints(), physics.samples(), physics.period_s());
    let hats = ((to - from) / HAT_S).ceil().max(1.0);
    let width = (to - from) / hats;
    let sample = |t: f64| ((t / period).max(0.0) as usize).min(samples);
    let (within, felt) = run.chain.around(sample(from - width)..sample(to + width) + 1, samples);
    let rows = felt.start.max(bounds.start)..felt.end.min(bounds.end);
    if rows.is_empty() {
        return None;
    }
    let mut columns = Vec::new();
    let force = (0..3).map(|axis| flange(physics, axis, &within));
    let unit: Vec<Vec<Vec<f64>>> = force.chain(if moment { moments(physics, &within) } else { Vec::new() }).collect();
    for hat in 0..=hats as usize {
        let top = from + width * hat as f64;
        let near = |k: usize| (1.0 - (k as f64 * period - top).abs() / width).max(0.0);
        for unit in &unit {
            let column = |j: usize| {
                let full: Vec<f64> = within.clone().zip(&unit[j]).map(|(k, tau)| near(k) * tau).collect();
                run.chain.part(&full, within.start, &rows)
            };
            columns.push((0..n).map(column).collect());
        }
    }
    Some(Stretch { run: at, rows, columns, std: DVector::zeros(0), cells: Vec::new() })
}

/// 1 N at the flange along a base axis: a unit mass there, standing still, under a unit acceleration is what the joints must hold. Their torques
/// are a row of the flange's Jacobian.
pub(crate) struct Pull {
    arm: Arm,
    links: Vec<[f64; 10]>,
    still: Vec<f64>,
    ws: Workspace,
}

impl Pull {
    pub(crate) fn new(arm: &Arm) -> Pull {
        let n = arm.dof();
        let mut links = vec![[0.0; 10]; n];
        links[n - 1][0] = 1.0;
        Pull { arm: arm.clone(), links, still: vec![0.0; n], ws: Workspace::new(arm) }
    }

    /// Torque of each joint \[N·m\] at positions `q`.
    pub(crate) fn torque(&mut self, axis: usize, q: &[f64], tau: &mut [f64]) {
        self.arm.gravity = [0.0; 3];
        self.arm.gravity[axis] = -1.0;
        inverse_dynamics(&self.arm, &self.links, &mut self.ws, q, &self.still, &self.still, tau);
    }
}

/// Torque of 1 N at the flange along a base axis, `[joint][sample within]`.
fn flange(p: &Physics<'_>, axis: usize, within: &Range<usize>) -> Vec<Vec<f64>> {
    let n = p.joints();
    let mut pull = Pull::new(&p.nominal.model.arm);
    let (mut q, mut tau) = (vec![0.0; n], vec![0.0; n]);
    let mut signals = vec![Vec::with_capacity(within.len()); n];
    for k in within.clone() {
        q.iter_mut().zip(&p.motion.q).for_each(|(to, from)| *to = from[k]);
        pull.torque(axis, &q, &mut tau);
        signals.iter_mut().zip(&tau).for_each(|(signal, tau)| signal.push(*tau));
    }
    signals
}

/// Torque of 1 N·m about each base axis on the last link, `[axis][joint][sample within]`.
fn moments(p: &Physics<'_>, within: &Range<usize>) -> Vec<Vec<Vec<f64>>> {
    let arm = &p.nominal.model.arm;
    let mut torque = vec![vec![Vec::with_capacity(within.len()); p.joints()]; 3];
    let mut q = vec![0.0; p.joints()];
    for k in within.clone() {
        q.iter_mut().zip(&p.motion.q).for_each(|(to, from)| *to = from[k]);
        let axes = axes(arm, &q);
        for (axis, torque) in torque.iter_mut().enumerate() {
            torque.iter_mut().zip(&axes).for_each(|(torque, along)| torque.push(along[axis]));
        }
    }
    torque
}

/// Axis of each joint in base axes; nothing for one that slides, which no moment moves.
fn axes(arm: &Arm, q: &[f64]) -> Vec<[f64; 3]> {
    let mut before = Arm { joints: Vec::with_capacity(q.len()), links: Vec::new(), ..arm.clone() };
    let axis = |(j, joint): (usize, &Joint)| {
        before.joints.push(joint.clone());
        let (turn, _) = flange_pose(&before, &q[..=j]);
        let along = |axis: usize| turn[axis].iter().zip(joint.axis).map(|(turn, own)| turn * own).sum();
        if joint.kind == JointKind::Revolute { std::array::from_fn(along) } else { [0.0; 3] }
    };
    arm.joints.iter().enumerate().map(axis).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ARM: &str = r#"<robot name="arm"><link name="base"/>
        <link name="l1"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="l2"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="l3"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.3" rpy="0.2 0 0"/>
            <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
        <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.1 0 0.1" rpy="0 0.5 0"/>
            <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
        <joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.4 0 0" rpy="0 0 0.7"/>
            <axis xyz="0.6 0.8 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>"#;

    /// Torque that the joints must bring where a unit mass at `place` of the last link is pushed up along a base axis.
    fn held(arm: &Arm, q: &[f64], axis: usize, place: [f64; 3]) -> [f64; 3] {
        let mut arm = arm.clone();
        arm.gravity = [0.0; 3];
        arm.gravity[axis] = -1.0;
        let mut links = [[0.0; 10]; 3];
        links[2][..4].copy_from_slice(&[1.0, place[0], place[1], place[2]]);
        let mut tau = [0.0; 3];
        inverse_dynamics(&arm, &links, &mut Workspace::new(&arm), q, &[0.0; 3], &[0.0; 3], &mut tau);
        tau
    }

    #[test]
    fn a_force_beside_the_origin_is_one_in_it_and_a_moment() {
        let arm = Arm::from_urdf(ARM, [0.0, 0.0, -9.81]).expect("an arm");
        let (q, place) = ([0.4, -0.9, 1.3], [0.1, -0.2, 0.3]);
        let (turn, _) = flange_pose(&arm, &q);
        let r: [f64; 3] = std::array::from_fn(|a| (0..3).map(|b| turn[a][b] * place[b]).sum());
        let axes = axes(&arm, &q);
        for axis in 0..3 {
            let mut force = [0.0; 3];
            force[axis] = 1.0;
            let moment: [f64; 3] =
                std::array::from_fn(|a| r[(a + 1) % 3] * force[(a + 2) % 3] - r[(a + 2) % 3] * force[(a + 1) % 3]);
            let (there, origin) = (held(&arm, &q, axis, place), held(&arm, &q, axis, [0.0; 3]));
            for j in 0..3 {
                let beside: f64 = axes[j].iter().zip(moment).map(|(axis, moment)| axis * moment).sum();
                assert!((there[j] - origin[j] - beside).abs() < 1e-12, "{axis} {j}: {there:?} {origin:?} {beside}");
            }
        }
    }
}
