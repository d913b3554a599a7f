//! Base columns that are taken out of a fit.

use super::fit::{Determined, Fit};
use super::rows::{JointRows, Rows};

/// Standard deviation of a value that is not asked for, in its unit: a number above zero for those who divide by it.
const HELD: f64 = 1e-6;

impl Rows {
    /// Takes base columns out: a fit of these rows leaves their values as they were before, and torque with it.
    pub fn take_out(&mut self, columns: &[usize]) {
        self.joints.iter_mut().for_each(|joint| joint.take_out(columns));
    }
}

impl JointRows {
    fn take_out(&mut self, columns: &[usize]) {
        let stays: Vec<bool> = self.columns.iter().map(|c| !columns.contains(c)).collect();
        if stays.iter().all(|stays| *stays) {
            return;
        }
        let rest = |signal: &[f64]| -> Vec<f64> {
            signal.iter().zip(stays.iter().cycle()).filter(|(_, stays)| **stays).map(|(x, _)| *x).collect()
        };
        (self.d, self.z) = (rest(&self.d), rest(&self.z));
        self.columns.retain(|c| !columns.contains(c));
    }
}

impl Fit {
    /// Says of base columns that were taken out that their values are 0 and not the data's.
    pub fn hold(&mut self, columns: &[usize]) {
        let k = self.values.len();
        for &c in columns {
            (self.values[c], self.std[c], self.determined[c]) = (0.0, HELD, Determined::ByBound);
            for i in 0..k {
                self.covariance[c * k + i] = 0.0;
                self.covariance[i * k + c] = 0.0;
            }
            self.covariance[c * k + c] = HELD * HELD;
        }
    }
}
