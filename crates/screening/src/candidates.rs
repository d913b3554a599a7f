//! All faults that are compared, each with its prior probability.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::fault::{Columns, Fault, Of};
use crate::priors as p;

/// What the list depends on.
pub(crate) struct Scope<'a> {
    pub(crate) joints: usize,
    /// Joints that turn.
    pub(crate) revolute: &'a [bool],
    /// Whether the scale of the torque is not yet explained by a fault.
    pub(crate) has_scale: bool,
    /// Whether gravity is in the torque as read so far.
    pub(crate) has_gravity: bool,
    /// Gravity of the file.
    pub(crate) gravity: [f64; 3],
    /// Torques that have one sign in all rows.
    pub(crate) one_signed: &'a [bool],
    /// How often each of them touches zero: without that it has the sign that it shows.
    pub(crate) touches: &'a [usize],
    /// Factor of each joint's torque that comes nearest to the model's; none where the two are not alike.
    pub(crate) factors: &'a [Option<f64>],
    /// Factors of all torques that are found together with the values of the arm.
    pub(crate) each_factor: &'a EachFactor,
    /// Torque limits \[N m\], finite.
    pub(crate) limit: &'a [f64],
    /// Limit of each torque that exceeds it in some rows \[N m\].
    pub(crate) exceeded: &'a [Option<f64>],
}

/// Factors of all torques that are found together with the values of the arm.
pub(crate) struct EachFactor {
    /// None where the torque shows nothing.
    pub(crate) factors: Vec<Option<f64>>,
    /// Log likelihood ratio over a torque that has nothing of the arm.
    pub(crate) gains: Vec<f64>,
}

impl EachFactor {
    /// The factor of one torque; none where it explains no more than its freedom costs.
    fn shown(&self, j: usize, freedom: f64) -> Option<f64> {
        self.factors[j].filter(|_| self.gains[j] + freedom.ln() > 0.0)
    }
}

/// A factor nearer to 1 than this is a wrong value of the file (a torque constant), not a unit.
const MIN_FACTOR: f64 = 1.6;

impl Scope<'_> {
    /// Faults and their prior probabilities.
    pub(crate) fn faults(&self) -> Vec<(Fault, f64)> {
        let n = self.joints as f64;
        let joints = || 0..self.joints;
        let mut list = Vec::new();
        for j in joints() {
            let share = p::ONE_SIGN / (3.0 * n);
            list.push((Fault::TorqueSign(Of::Joint(j)), share));
            list.push((Fault::PositionSign(Of::Joint(j)), share));
            list.push((Fault::Reversed(j), share));
        }
        if self.joints > 1 {
            list.push((Fault::TorqueSign(Of::All), p::ALL_SIGNS));
            list.push((Fault::PositionSign(Of::All), p::ALL_SIGNS / 2.0));
        }
        let units = p::POSITION_UNITS.len();
        for unit in 0..units {
            if self.joints > 1 {
                list.push((Fault::PositionUnit(Of::All, unit), p::POSITION_UNIT));
            }
            let one = |j: usize| (Fault::PositionUnit(Of::Joint(j), unit), p::ONE_POSITION_UNIT / (n * units as f64));
            list.extend(joints().filter(|j| self.revolute[*j]).map(one));
        }
        if self.has_scale {
            list.extend((0..p::TORQUE_UNITS.len()).map(|unit| (Fault::TorqueUnit(unit), p::TORQUE_UNIT)));
            list.extend(self.scales());
        }
        list.extend(self.orders());
        if self.has_gravity {
            list.push((Fault::WithoutGravity, p::WITHOUT_GRAVITY));
            list.push((Fault::External, p::EXTERNAL));
            list.extend(self.mountings());
        }
        for j in joints().filter(|j| self.revolute[*j]) {
            list.extend(
                [FRAC_PI_2, -FRAC_PI_2, PI].map(|angle| (Fault::JointZero(j, angle), p::JOINT_ZERO / (3.0 * n))),
            );
        }
        let delays = p::DELAYS_S.len() as f64;
        list.extend(p::DELAYS_S.map(|seconds| (Fault::Late(Of::All, seconds), p::LATE / delays)));
        for seconds in p::DELAYS_S.into_iter().skip(1).step_by(p::ONE_DELAY_OF) {
            let share = p::ONE_LATE * p::ONE_DELAY_OF as f64 / (n * delays);
            list.extend(joints().map(|j| (Fault::Late(Of::Joint(j), seconds), share)));
        }
        list.extend(
            joints().filter(|j| self.touches[*j] > 0).map(|j| (Fault::Unsigned(Of::Joint(j)), p::ONE_UNSIGNED / n)),
        );
        for (j, limit) in self.exceeded.iter().enumerate().filter_map(|(j, limit)| Some((j, (*limit)?))) {
            let share = p::BEYOND_LIMIT / (n * p::LIMITS_OVER_FILE.len() as f64);
            list.extend(p::LIMITS_OVER_FILE.map(|of_file| (Fault::BeyondLimit(j, of_file * limit), share)));
        }
        if self.one_signed.iter().all(|one| *one) {
            list.push((Fault::Unsigned(Of::All), p::UNSIGNED));
        }
        list
    }

    fn scales(&self) -> Vec<(Fault, f64)> {
        let freedom = p::FACTOR_WIDTH / p::FACTOR_SPAN;
        let far = |factor: &f64| !(1.0 / MIN_FACTOR..MIN_FACTOR).contains(factor);
        let one =
            |j: usize| self.factors[j].or(self.each_factor.shown(j, freedom)).filter(far).map(|factor| (j, factor));
        let mut list: Vec<(Fault, f64)> = (0..self.joints)
            .filter_map(one)
            .map(|(j, factor)| (Fault::TorqueScale(j, factor), p::ONE_TORQUE_SCALE * freedom / self.joints as f64))
            .collect();
        let known = || self.each_factor.factors.iter().flatten();
        if let Some(share) = self.each_share().filter(|_| known().filter(|f| far(f)).count() * 2 > known().count()) {
            let factors = self.each_factor.factors.iter().map(|f| f.unwrap_or(1.0)).collect();
            list.push((Fault::TorqueScales(factors), p::EACH_TORQUE_SCALE * freedom * share));
        }
        list
    }

    /// Probability of the factors of all torques beside the one that they share; none of less than two.
    fn each_share(&self) -> Option<f64> {
        let full_scales =
            self.each_factor.factors.iter().zip(self.limit).filter_map(|(f, limit)| Some(((*f)? / limit).ln()));
        let full_scales: Vec<f64> = full_scales.collect();
        let mean = full_scales.iter().sum::<f64>() / full_scales.len().max(1) as f64;
        let density = |x: &f64| {
            let off = (x - mean) / p::FULL_SCALE_SPREAD;
            p::FACTOR_WIDTH * (-0.5 * off * off).exp() / (p::FULL_SCALE_SPREAD * TAU.sqrt())
        };
        (full_scales.len() > 1).then(|| full_scales.iter().map(density).product())
    }

    fn orders(&self) -> Vec<(Fault, f64)> {
        let pairs: Vec<(usize, usize)> =
            (0..self.joints).flat_map(|a| (a + 1..self.joints).map(move |b| (a, b))).collect();
        let share = p::EXCHANGED / (3.0 * pairs.len().max(1) as f64);
        let of = |(a, b): &(usize, usize)| {
            [Columns::Torques, Columns::Positions, Columns::Both].map(|c| (Fault::Exchanged(*a, *b, c), share))
        };
        let mut list: Vec<(Fault, f64)> = pairs.iter().flat_map(of).collect();
        if self.joints > 2 {
            list.push((Fault::BackToFront, p::BACK_TO_FRONT));
        }
        list
    }

    fn mountings(&self) -> Vec<(Fault, f64)> {
        let size = self.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
        let axes = (0..3).flat_map(|axis| {
            [1.0, -1.0].map(|sign| {
                let mut gravity = [0.0; 3];
                gravity[axis] = sign * size;
                gravity
            })
        });
        let along = |g: &[f64; 3]| g.iter().zip(&self.gravity).map(|(a, b)| a * b).sum::<f64>() > 0.99 * size * size;
        axes.filter(|g| size > 0.0 && !along(g)).map(|g| (Fault::Mounting(g), p::MOUNTING / 5.0)).collect()
    }
}
