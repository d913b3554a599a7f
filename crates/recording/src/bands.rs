//! Estimated parameters by name, with a band of two standard deviations.

use rivet_config::Robot;
use rivet_ipc_schema::{ParameterState, Parameters, words};
use schemars::JsonSchema;
use serde::Serialize;

use crate::friction::BAND_SIGMAS;

/// Estimated parameters by name, with a band of two standard deviations.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct ParameterBands {
    /// Epoch of the parameters.
    pub epoch: u64,
    /// Sequence number of the last joint state that went in.
    pub seq: u64,
    /// Stamp of the parameters, `CLOCK_MONOTONIC` [ns].
    pub stamp_ns: u64,
    /// One entry a base parameter.
    pub parameters: Vec<ParameterBand>,
}

/// One base parameter. Values are in its unit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct ParameterBand {
    /// Name, such as j2.coulomb.
    pub name: String,
    /// Unit, such as N m.
    pub unit: String,
    /// Estimated value.
    pub value: f64,
    /// Standard deviation.
    pub std: f64,
    /// Value minus two standard deviations.
    pub lower: f64,
    /// Value plus two standard deviations.
    pub upper: f64,
    /// Value of the robot file.
    pub nominal: f64,
    /// What the data of the window say about it, as published.
    pub excitation: f64,
    /// State of the supervision: active, held or unidentified.
    pub state: String,
}

/// Makes bands of the parameters of one robot.
#[derive(Clone, Debug)]
pub(crate) struct Bands {
    /// Name and unit of each base parameter.
    names: Vec<(String, &'static str)>,
    nominal: Vec<f64>,
}

impl Bands {
    pub(crate) fn new(robot: &Robot) -> Bands {
        Bands { names: names(robot), nominal: robot.nominal_base.clone() }
    }

    /// Number of base parameters.
    pub(crate) fn len(&self) -> usize {
        self.names.len()
    }

    pub(crate) fn bands(&self, set: &Parameters) -> ParameterBands {
        let band = |(i, (name, unit)): (usize, &(String, &str))| {
            let (value, std) = (set.values[i], set.std[i]);
            let state = set.state[i];
            ParameterBand {
                name: name.clone(),
                unit: (*unit).to_owned(),
                value,
                std,
                lower: value - BAND_SIGMAS * std,
                upper: value + BAND_SIGMAS * std,
                nominal: self.nominal[i],
                excitation: set.excitation[i],
                state: ParameterState::try_from(state).map_or_else(|_| format!("state {state}"), words),
            }
        };
        let parameters = self.names.iter().enumerate().take(set.len()).map(band).collect();
        ParameterBands { epoch: set.epoch, seq: set.seq, stamp_ns: set.stamp_ns, parameters }
    }
}

/// Name and unit of each base parameter of a robot, in the order of the messages.
pub fn names(robot: &Robot) -> Vec<(String, &'static str)> {
    let (model, base) = (&robot.model, &robot.base);
    (0..base.len()).map(|i| (base.name(model, i), base.parameter(model, i).unit(&model.arm))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_is_two_standard_deviations_to_each_side() {
        let names = vec![("j1.coulomb".to_owned(), "N m"), ("l1.Izz".to_owned(), "kg m^2")];
        let bands = Bands { names, nominal: vec![2.0, 1.0] };
        let mut set = Parameters { epoch: 3, count: 2, ..Parameters::default() };
        set.values[..2].copy_from_slice(&[1.5, 0.75]);
        set.std[..2].copy_from_slice(&[0.25, 0.125]);
        set.state[..2].copy_from_slice(&[1, 9]);
        let found = bands.bands(&set);
        let [first, second] = &found.parameters[..] else { panic!("{found:?}") };
        assert_eq!((first.lower, first.upper, first.nominal, first.state.as_str()), (1.0, 2.0, 2.0, "active"));
        assert_eq!((second.lower, second.upper, second.unit.as_str()), (0.5, 1.0, "kg m^2"));
        assert_eq!(second.state, "state 9", "a number that is no state is shown as that number");
    }
}
