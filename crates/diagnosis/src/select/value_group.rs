//! Groups of values of the model that are free or held together.

use crate::effects::Effect;
use crate::effects::Form;
use crate::effects::physical_bounds::{Impossible, of_value};
use crate::model::nominal::Nominal;
use crate::select::adopted::Adopted;

/// Parameters that stand or fall together.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) effect: Effect,
    pub(crate) joint: usize,
    pub(crate) columns: Vec<usize>,
}

impl Group {
    /// The form that has the same torque, as far as one has.
    pub(crate) fn form(&self) -> Option<Form> {
        self.effect.value_form(self.joint)
    }
}

/// The value of a group that no arm has, if one is. Values of which an adopted effect has a column of its own are judged by nobody:
/// only their sum with it means anything.
pub(crate) fn of_group(group: &Group, nominal: &Nominal, standard: &[f64], adopted: &[Adopted]) -> Option<Impossible> {
    let (parameter, joints) = (nominal.model.parameters[group.columns[0]], nominal.model.arm.dof());
    let shared = |a: &Adopted| a.form.shares(parameter, joints);
    let judged = !adopted.iter().any(shared);
    group.columns.iter().filter(|_| judged).find_map(|c| of_value(*c, nominal, standard))
}

#[cfg(test)]
mod tests {
    use rivet_dynamics::{Arm, Model, Structure};

    use super::*;
    use crate::effects::physical_bounds::{of_payload, text};
    use crate::effects::stribeck_friction::Stribeck;
    use crate::effects::{link_inertia, rotor_inertia};
    use rivet_dynamics::Places;

    #[test]
    fn what_no_arm_has_is_told_from_next_to_nothing() {
        let urdf = include_str!("../../../../robots/manutec-r3/robot.urdf");
        let arm = Arm::from_urdf(urdf, [0.0, 0.0, -9.81]).expect("a sound arm");
        let n = arm.dof();
        let model = Model::new(arm, Structure { offset: true, ..Structure::default() });
        let mut x = model.arm.links.concat();
        x.extend(vec![2.0; model.len() - x.len()]);
        let nominal = Nominal::exact(&model, &x);
        let rotor = Group { effect: rotor_inertia::EFFECT, joint: 1, columns: vec![Places::new(n).rotor_inertia(1)] };
        let link = Group { effect: link_inertia::EFFECT, joint: 2, columns: (20..30).collect() };
        let with = |group: &Group, at: usize, value: f64| {
            let mut standard = x.clone();
            standard[at] = value;
            of_group(group, &nominal, &standard, &[])
        };
        assert_eq!(with(&rotor, Places::new(n).rotor_inertia(1), 0.1), None);
        assert_eq!(with(&rotor, Places::new(n).rotor_inertia(1), -0.1), None, "a twentieth of what is given");
        let found = with(&rotor, Places::new(n).rotor_inertia(1), -0.5).expect("no rotor has that");
        assert_eq!(
            text(&[found]),
            "j2.rotor_inertia -0.500 kg m^2 is outside of physical bounds: it is the effect of something else"
        );
        assert_eq!(with(&link, 20, -0.2).map(|what| what.name), Some("l3.m".to_owned()));
        assert_eq!(with(&link, 21, -0.2), None, "a centre may be anywhere");
        let stribeck = Form::from(Stribeck { joint: 0, velocity: 0.1 });
        assert_eq!(stribeck.impossible(&[1.0], &nominal, &x), None);
        assert!(stribeck.impossible(&[-1.0], &nominal, &x).is_some_and(|what| what.value == -1.0));
        // A third of a kilogram a hand's breadth off the flange, then further off than the arm is long.
        let body = |x: f64| [0.3, 0.3 * x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(of_payload(&body(0.1), &nominal.model.arm), None);
        assert!(of_payload(&body(2.0), &nominal.model.arm).is_some_and(|what| what.unit == "m"));
        assert!(of_payload(&body(0.1).map(|v| -v), &nominal.model.arm).is_some_and(|what| what.unit == "kg"));
    }
}
