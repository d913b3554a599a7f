//! Torque whose unit changes from run to run.
//!
//! Within one run a missing load or spring hides a factor, as its torque has another shape. Between runs none of them makes a joint's
//! torque twenty times what it was.

use crate::model::log_fault::LogFault;
use crate::model::nominal::Nominal;
use crate::model::standstill::is_moved;
use crate::policy::POLICY;
use crate::screen::log_check::of_file;
use crate::screen::prepared::Prepared;

/// Root mean squares of a joint's rows in motion.
#[derive(Clone, Copy, Debug)]
struct Size {
    /// \[N·m\]
    torque: f64,
    /// By the file \[N·m\].
    file: f64,
    /// \[rad/s\]
    speed: f64,
}

impl Size {
    fn from_run(run: &Prepared, nominal: &Nominal, j: usize) -> Option<Size> {
        if run.silent[j].is_some() || !is_moved(&run.motion, &run.chain, j) {
            return None;
        }
        let speed = run.chain.sample(&run.motion.qd[j]);
        let moving: Vec<usize> =
            (0..run.rows()).filter(|k| speed[*k].abs() > POLICY.signal_faults.max_still_speed_rad_s).collect();
        let rms = |rows: &[f64]| (moving.iter().map(|k| rows[*k].powi(2)).sum::<f64>() / moving.len() as f64).sqrt();
        Some(Size { torque: rms(&run.tau[j]), file: rms(&of_file(run, nominal, j)), speed: rms(&speed) })
    }

    fn is_of_another_unit(self, other: Size) -> bool {
        let times = |a: f64, b: f64| (a / b).max(b / a);
        let alike = |a: f64, b: f64| times(a, b) < POLICY.screening.max_use_ratio;
        times(self.torque, other.torque) > POLICY.screening.min_ratio_between_runs
            && alike(self.speed, other.speed)
            && alike(self.file, other.file)
    }

    /// Torque over that by the file.
    fn scale(self) -> f64 {
        self.torque / self.file
    }
}

/// Torque in another unit than in another run counts nowhere, in the run in which it is further from the file's.
pub(crate) fn distrust(runs: &mut [&mut Prepared], nominal: &Nominal) {
    for j in 0..nominal.model.arm.dof() {
        let sizes: Vec<Option<Size>> = runs.iter().map(|run| Size::from_run(run, nominal, j)).collect();
        for (run, scale) in runs.iter_mut().zip(strange(&sizes)) {
            run.silent[j] = run.silent[j].or(scale.map(LogFault::Scale));
        }
    }
}

/// Scale of each size that is of another unit than some other one, and further from the file.
fn strange(sizes: &[Option<Size>]) -> Vec<Option<f64>> {
    let foreign_scale = |size: &Option<Size>| {
        let size = (*size)?;
        let off = |s: Size| s.scale().ln().abs();
        let others = sizes.iter().flatten();
        let further = others.filter(|other| size.is_of_another_unit(**other)).any(|other| off(size) > off(*other));
        further.then(|| size.scale())
    };
    sizes.iter().map(foreign_scale).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Torque in mN m in one of three runs; of a joint that stands in one; of one that is gravity's in one run and friction's alone in the
    /// other, by the file as well; of one that moves ten times as fast.
    #[test]
    fn a_factor_between_runs_that_motion_does_not_make_is_a_unit() {
        let size = |torque: f64, file: f64, speed: f64| Some(Size { torque, file, speed });
        let found = |sizes: &[Option<Size>]| strange(sizes).iter().map(Option::is_some).collect::<Vec<bool>>();
        let sound = [size(30.0, 20.0, 0.5), size(22.0, 25.0, 0.7)];
        assert_eq!(found(&[sound[0], sound[1], size(24e3, 18.0, 0.4)]), [false, false, true]);
        assert_eq!(found(&[size(24e-3, 18.0, 0.4), sound[0], None]), [true, false, false]);
        assert_eq!(found(&[size(100.0, 90.0, 0.5), size(4.0, 5.0, 0.5)]), [false, false]);
        assert_eq!(found(&[size(100.0, 9.0, 5.0), size(4.0, 5.0, 0.5)]), [false, false]);
    }
}
