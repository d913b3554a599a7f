//! Whether the robot file describes another arm: values of most joints off by far more than a data sheet is.
//!
//! Bodies and rotors of a CAD model or a data sheet are off by a tenth or so. Where most joints want several times their values, a list of
//! causes means nothing, however well it fits.

use nalgebra::DVector;
use rivet_dynamics::Parameter;

use crate::effects::payload::Payload;
use crate::model::nominal::Nominal;
use crate::policy::POLICY;
use crate::select::adopted::{self, Adopted};

/// Joints whose body or rotor is far off or came out as none that can be (`impossible`; on two joints at most of a measured or sound arm, on
/// all six with another arm's file), where that is most of them. `heard`: joints whose torque is believed. Friction and torque
/// constants are in no CAD model, and a body at the flange is none of the arm's.
pub(crate) fn joints(
    nominal: &Nominal,
    x: &DVector<f64>,
    adopted: &[Adopted],
    impossible: &[usize],
    heard: &[usize],
) -> Option<Vec<usize>> {
    let without_payload = adopted.iter().filter(|a| a.form.get::<Payload>().is_none());
    let values = adopted::standard(nominal, x, without_payload);
    let off = |at: usize| ((values[at] - nominal.x[at]) / nominal.std[at]).powi(2);
    let distance = |is: &dyn Fn(Parameter) -> bool| -> f64 {
        let all = nominal.model.parameters.iter().enumerate().filter(|(_, p)| is(**p));
        all.map(|(at, _)| off(at)).sum::<f64>().sqrt()
    };
    let rotor = |j: usize| nominal.model.parameters.iter().position(|p| *p == Parameter::RotorInertia(j));
    let is_none = |j: &usize| {
        rotor(*j)
            .is_some_and(|at| nominal.x[at] > 0.0 && values[at].abs() < POLICY.held_out.min_rotor_share * nominal.x[at])
    };
    // Torque behind the gears has no rotors, whosever the arm: then bodies alone say whose it is.
    let behind_gears = heard.len() > 1 && heard.iter().all(is_none);
    let far = |j: &usize| {
        let body = distance(&|p| matches!(p, Parameter::Link { link, .. } if link == *j));
        if behind_gears {
            return body > POLICY.held_out.max_usual_errors;
        }
        impossible.contains(j)
            || body.max(distance(&|p| p == Parameter::RotorInertia(*j))) > POLICY.held_out.max_usual_errors
    };
    let joints: Vec<usize> = heard.iter().copied().filter(far).collect();
    (joints.len() >= POLICY.plausibility.min_strange_joints && 3 * joints.len() >= 2 * heard.len()).then_some(joints)
}

/// Joints of which the model as given misses several times the torque that they have, where that is most of them: friction and loads that no
/// file has leave all of it at most, some more where they have the other sign (1.05 on measured arms whose friction was left out).
/// Of several that are heard, and where no values of drives bring all of them down to `fitted`: friction of a file may be far too large.
pub(crate) fn far_too_strong(as_given: &[f64], fitted: &[bool], heard: &[usize]) -> Option<Vec<usize>> {
    let joints: Vec<usize> =
        heard.iter().copied().filter(|j| as_given[*j] > POLICY.held_out.max_torque_ratio).collect();
    let open = heard.iter().any(|j| !fitted[*j]);
    (open && heard.len() > 1 && 2 * joints.len() > heard.len()).then_some(joints)
}

#[cfg(test)]
mod tests {
    use rivet_dynamics::{Arm, Model, Structure};

    use super::*;
    use rivet_dynamics::Places;

    /// Rotors that are twice what the file says, a payload's worth on the last link, and friction that is nothing like the file's.
    #[test]
    fn values_far_off_on_most_joints_are_another_arms() {
        let text = include_str!("../../../../robots/manutec-r3/robot.urdf");
        let arm = Arm::from_urdf(text, [0.0, 0.0, -9.81]).expect("a sound arm");
        let n = arm.dof();
        let model = Model::new(arm, Structure { offset: true, ..Structure::default() });
        let mut given = model.arm.links.concat();
        given.extend(vec![2.0; model.len() - given.len()]);
        let std = given.iter().map(|v| 0.1 * v.abs().max(1e-3)).collect();
        let nominal = Nominal { near: given.clone(), x: given, std, model };
        let heard: Vec<usize> = (0..n).collect();
        let with = |changes: &[(usize, f64)]| {
            let mut x = DVector::zeros(nominal.x.len());
            for (at, change) in changes {
                x[*at] += change;
            }
            joints(&nominal, &x, &[], &[], &heard)
        };
        let rotors = |count: usize| -> Vec<(usize, f64)> {
            (0..count).map(|j| (Places::new(n).rotor_inertia(j), 2.0)).collect()
        };
        assert_eq!(with(&rotors(4)), Some(vec![0, 1, 2, 3]));
        assert_eq!(with(&rotors(3)), None, "three of six may be placeholders");
        assert_eq!(
            with(&(0..n).map(|j| (Places::new(n).rotor_inertia(j), 0.5)).collect::<Vec<_>>()),
            None,
            "a quarter is a poor data sheet"
        );
        assert_eq!(
            with(&(0..n).map(|j| (Places::new(n).coulomb(j), 50.0)).collect::<Vec<_>>()),
            None,
            "friction is in no data sheet"
        );
        assert_eq!(with(&[(Places::link(n - 1).start, 50.0)]), None, "one body");
        // Values that cannot be are put back as given.
        let put_back =
            |impossible: &[usize]| joints(&nominal, &DVector::zeros(nominal.x.len()), &[], impossible, &heard);
        assert_eq!((put_back(&[1, 2, 3, 5]), put_back(&[1, 5])), (Some(vec![1, 2, 3, 5]), None));
    }

    #[test]
    fn a_model_of_a_much_stronger_arm_is_another_arms() {
        let heard = [0, 2, 3];
        let open = [true, false, false, true];
        assert_eq!(far_too_strong(&[5.2, f64::NAN, 10.1, 1.0], &open, &heard), Some(vec![0, 2]));
        assert_eq!(far_too_strong(&[5.2, f64::NAN, 10.1, 1.0], &[true; 4], &heard), None, "friction alone, say");
        assert_eq!(
            far_too_strong(&[1.0, 9.0, 1.05, 7.0], &open, &heard),
            None,
            "one of three; the second says nothing"
        );
        assert_eq!(far_too_strong(&[5.2; 4], &open, &[2]), None, "one joint says nothing of an arm");
    }
}
