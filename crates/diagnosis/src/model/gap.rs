//! The gap between measured and modelled torque, for each joint and for the arm.

/// `||τ − τ_model|| / ||τ||`: 0 is a perfect model, 1 no model at all.
#[derive(Clone, Debug, PartialEq)]
pub struct Gap {
    /// Per joint, base to flange. Not a number for a joint whose torque is zero throughout.
    pub per_joint: Vec<f64>,
    /// Over all joints, each joint's torque divided by its own rms, so that no joint outweighs the others. Joints without
    /// torque do not count; not a number when no joint has any.
    pub all: f64,
}

impl Gap {
    /// Of measured `tau[joint][row]` and `modelled[joint][row]`, both through the same filter, in the same unit.
    ///
    /// # Panics
    /// If the two differ in joints or rows.
    pub fn new<T: AsRef<[f64]>, M: AsRef<[f64]>>(tau: &[T], modelled: &[M]) -> Gap {
        assert_eq!(tau.len(), modelled.len(), "as many joints modelled as measured");
        let per_joint: Vec<f64> =
            tau.iter().zip(modelled).map(|(t, m)| relative_error(t.as_ref(), m.as_ref())).collect();
        let (mut square, mut joints) = (0.0, 0.0);
        for gap in per_joint.iter().filter(|gap| !gap.is_nan()) {
            square += gap * gap;
            joints += 1.0;
        }
        // With every joint scaled to rms 1 the pooled ratio is the mean square of the joints' own ratios.
        let all = f64::sqrt(square / joints);
        Gap { per_joint, all }
    }
}

fn relative_error(tau: &[f64], modelled: &[f64]) -> f64 {
    assert_eq!(tau.len(), modelled.len(), "as many rows modelled as measured");
    let error: f64 = tau.iter().zip(modelled).map(|(t, m)| (t - m).powi(2)).sum();
    let signal: f64 = tau.iter().map(|t| t * t).sum();
    if signal > 0.0 { (error / signal).sqrt() } else { f64::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_perfect_model_leaves_nothing_and_no_model_leaves_all() {
        let tau = [vec![3.0, -4.0], vec![0.1, 0.2]];
        assert_eq!(Gap::new(&tau, &tau), Gap { per_joint: vec![0.0, 0.0], all: 0.0 });
        let none = [vec![0.0, 0.0], vec![0.0, 0.0]];
        assert_eq!(Gap::new(&tau, &none), Gap { per_joint: vec![1.0, 1.0], all: 1.0 });
    }

    /// Joint 1 is off by 3/5, joint 2 by 4/5: pooled sqrt((0.36 + 0.64)/2), whatever the size of their torques.
    #[test]
    fn a_strong_joint_does_not_hide_a_weak_one() {
        for scale in [1.0, 1e6] {
            let tau = [vec![5.0 * scale, 0.0], vec![0.0, 5.0]];
            let model = [vec![2.0 * scale, 0.0], vec![0.0, 1.0]];
            let gap = Gap::new(&tau, &model);
            assert!((gap.all - 0.5_f64.sqrt()).abs() < 1e-15, "{gap:?}");
        }
    }

    #[test]
    fn a_joint_without_torque_has_no_gap_and_does_not_count() {
        let gap = Gap::new(&[vec![0.0, 0.0], vec![2.0, 0.0]], &[vec![1.0, 0.0], vec![1.0, 0.0]]);
        assert!(gap.per_joint[0].is_nan());
        assert_eq!(gap.all, 0.5);
    }
}
