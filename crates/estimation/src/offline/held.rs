//! Base columns that are taken out of a fit.

use std::sync::Arc;

use super::fit::{Determined, Fit};
use super::rows::{JointRows, Rows};

/// Standard deviation of a value that is not asked for, in its unit: a number above zero for those who divide by it.
const FIXED_VALUE_STD: f64 = 1e-6;

impl Rows {
    /// Takes base columns out, each with the value that it is held at: a fit of these rows leaves those as they are, and has to explain
    /// the torque that is left beside them.
    pub fn take_out(&mut self, held: &[(usize, f64)]) {
        for (j, joint) in self.joints.iter_mut().enumerate() {
            let taken = joint.take_out(held);
            if taken == 0.0 {
                continue;
            }
            let torque = Arc::make_mut(&mut self.torque);
            torque.joints[j].iter_mut().for_each(|tau| *tau -= taken);
        }
    }
}

impl JointRows {
    /// The torque that was constant over the rows taken with them; of what changes from row to row, that between rows stays.
    fn take_out(&mut self, held: &[(usize, f64)]) -> f64 {
        let value = |c: &usize| held.iter().find(|(column, _)| column == c).map(|(_, value)| *value);
        let width = self.columns.len().max(1);
        let mut constant = 0.0;
        for (at, value) in self.columns.iter().enumerate().filter_map(|(at, c)| Some((at, value(c)?))) {
            let column = || self.d.iter().skip(at).step_by(width);
            self.tau.iter_mut().zip(self.d.iter().skip(at).step_by(width)).for_each(|(tau, d)| *tau -= value * d);
            if !self.tau.is_empty() && column().all(|d| (d - 1.0).abs() < 1e-6) {
                constant += value;
            }
        }
        let stays: Vec<bool> = self.columns.iter().map(|c| value(c).is_none()).collect();
        if stays.iter().all(|stays| *stays) {
            return 0.0;
        }
        let rest = |signal: &[f64]| -> Vec<f64> {
            signal.iter().zip(stays.iter().cycle()).filter(|(_, stays)| **stays).map(|(x, _)| *x).collect()
        };
        (self.d, self.z) = (rest(&self.d), rest(&self.z));
        self.columns.retain(|c| value(c).is_none());
        constant
    }
}

impl Fit {
    /// Says of base columns that were taken out what they are held at, and that this is not the data's.
    pub fn hold(&mut self, held: &[(usize, f64)]) {
        let k = self.values.len();
        for &(c, value) in held {
            (self.values[c], self.std[c], self.determined[c]) = (value, FIXED_VALUE_STD, Determined::ByBound);
            for i in 0..k {
                self.covariance[c * k + i] = 0.0;
                self.covariance[i * k + c] = 0.0;
            }
            self.covariance[c * k + c] = FIXED_VALUE_STD * FIXED_VALUE_STD;
        }
    }
}
