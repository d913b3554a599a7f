//! Torque offsets larger than files usually omit, reported as hints: in motion they are friction that differs between the directions.

use rivet_dynamics::Parameter;

use crate::effects::friction_asymmetry;
use crate::model::nominal::Nominal;
use crate::policy::POLICY;
use crate::report::details::{ParameterLine, ParameterState};
use crate::report::diagnosis::{Cause, JointGap};

/// What is told of joints that an offset brought down to their noise. It is a value that is free in every fit, so that no effect that has the
/// same torque is missed there.
pub(crate) fn causes(nominal: &Nominal, parameters: &[ParameterLine], joints: &[JointGap]) -> Vec<Cause> {
    let offset_cause = |((parameter, usual), line): ((&Parameter, &f64), &ParameterLine)| {
        let Parameter::Offset(j) = *parameter else { return None };
        let more = line.found - line.given;
        let [given, found] = joints[j].in_motion?;
        let fitted = given > POLICY.held_out.max_sound_gap && found <= POLICY.held_out.max_sound_gap;
        let is_large = more.abs() > POLICY.held_out.min_offset_over_usual * usual
            && line.state == ParameterState::Pinned
            && fitted;
        is_large.then(|| {
            let friction = nominal.x[nominal.model.places().coulomb(j)];
            let share = if friction > 0.0 {
                format!(", {:.0} % of its friction", 100.0 * more.abs() / friction)
            } else {
                String::new()
            };
            let tilt = if j == 0 && nominal.model.arm.is_upright() {
                ", or a base that is tilted, where it turns little"
            } else {
                ""
            };
            let text = format!(
                "{} has {more:.3} N m more in both directions{share}: friction asymmetry, or a zero offset of the \
                 torque signal{tilt}; its torque at rest with the drive off separates them",
                joints[j].joint
            );
            Cause {
                magnitude: vec![("offset_Nm".to_owned(), more)],
                impossible: Some(text),
                ..Cause::unmeasured(friction_asymmetry::EFFECT, vec![joints[j].joint.clone()])
            }
        })
    };
    nominal.model.parameters.iter().zip(&nominal.std).zip(parameters).filter_map(offset_cause).collect()
}

#[cfg(test)]
mod tests {
    use rivet_dynamics::{Arm, Model, Structure};

    use super::*;

    /// Friction of 10 N m, so that 0.3 is a usual offset: what is told of one of so much that brings the joint from so many times its noise to
    /// so many.
    fn text(more: f64, in_motion: [f64; 2], state: ParameterState) -> Option<String> {
        text_of(1, more, in_motion, state)
    }

    fn text_of(joint: usize, more: f64, in_motion: [f64; 2], state: ParameterState) -> Option<String> {
        let urdf = include_str!("../../../../robots/manutec-r3/robot.urdf");
        let arm = Arm::from_urdf(urdf, [0.0, 0.0, -9.81]).expect("a sound arm");
        let n = arm.dof();
        let model = Model::new(arm, Structure { offset: true, ..Structure::default() });
        let x: Vec<f64> = (0..model.len()).map(|at| if at / n == 12 { 10.0 } else { 0.0 }).collect();
        let line = |(at, parameter): (usize, &Parameter)| ParameterLine {
            name: parameter.name(&model.arm),
            unit: "N m",
            joint: parameter.joint(),
            given: x[at],
            found: x[at] + if *parameter == Parameter::Offset(joint) { more } else { 0.0 },
            low: 0.0,
            high: 0.0,
            state,
            wrong: false,
        };
        let lines: Vec<ParameterLine> = model.parameters.iter().enumerate().map(line).collect();
        let gap = |j: usize| JointGap {
            joint: format!("joint {}", j + 1),
            before: 0.1,
            after: 0.1,
            noise_floor: 0.1,
            repeats: None,
            in_motion: Some(in_motion),
        };
        let joints: Vec<JointGap> = (0..n).map(gap).collect();
        let nominal = Nominal { near: x.clone(), std: vec![0.3; x.len()], x, model };
        let told = causes(&nominal, &lines, &joints);
        assert!(told.len() <= 1);
        told.into_iter().next().and_then(|hint| hint.impossible)
    }

    #[test]
    fn an_offset_beyond_what_files_leave_out_is_told() {
        let pinned = ParameterState::Pinned;
        let said = text(-1.2, [9.0, 0.9], pinned).expect("four times a usual one");
        assert!(said.starts_with("joint 2 has -1.200 N m more") && said.contains("12 % of its friction"), "{said}");
        assert!(!said.contains("tilted"), "its axis lies: {said}");
        let upright = text_of(0, -1.2, [9.0, 0.9], pinned).expect("of an axis along gravity");
        assert!(upright.contains("or a base that is tilted"), "{upright}");
        assert_eq!(text(0.9, [9.0, 0.9], pinned), None, "three times");
        assert_eq!(text(1.2, [1.5, 0.9], pinned), None, "the joint was sound");
        assert_eq!(text(1.2, [90.0, 20.0], pinned), None, "something else is missing");
        assert_eq!(text(1.2, [9.0, 0.9], ParameterState::NotPinned), None);
    }
}
