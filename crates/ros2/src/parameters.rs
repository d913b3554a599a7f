//! Identified parameters as a message of ROS 2.

use rivet_ipc_schema::Parameters;

use crate::messages::{Float64MultiArray, MultiArrayDimension, MultiArrayLayout};

/// Columns of [`message`].
pub const COLUMNS: [&str; 4] = ["value", "std", "excitation", "state"];
/// Numbers before the array: epoch, seq, flags.
pub const HEAD: usize = 3;

/// The set as `std_msgs/Float64MultiArray`: a row for each parameter, with the columns [`COLUMNS`], behind epoch, `seq` and flags.
///
/// The labels of the dimensions are the names of the parameters and of the columns, with commas between them. Values and standard
/// deviations are those of the bus, to the bit, in each parameter's unit.
pub fn message(set: &Parameters, names: &[String]) -> Float64MultiArray {
    let count = set.len();
    let mut data = Vec::with_capacity(HEAD + COLUMNS.len() * count);
    data.extend([set.epoch as f64, set.seq as f64, f64::from(set.flags)]);
    for i in 0..count {
        data.extend([set.values[i], set.std[i], set.excitation[i], f64::from(set.state[i])]);
    }
    let dimension = |label: String, size: usize, stride: usize| MultiArrayDimension {
        label,
        size: size as u32,
        stride: stride as u32,
    };
    let width = COLUMNS.len();
    let rows = names.iter().take(count).map(String::as_str).collect::<Vec<_>>().join(",");
    let dim = vec![dimension(rows, count, count * width), dimension(COLUMNS.join(","), width, width)];
    Float64MultiArray { layout: MultiArrayLayout { dim, data_offset: HEAD as u32 }, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_parameters_behind_the_offset() {
        let mut set = Parameters { epoch: 5, seq: 77, flags: 4, count: 2, ..Parameters::default() };
        (set.values[0], set.values[1], set.std[1], set.excitation[1], set.state[1]) = (0.1 + 0.2, -0.0, 1e-9, 0.5, 1);
        let message = message(&set, &["a".to_owned(), "b+".to_owned()]);
        assert_eq!(message.layout.dim[0].label, "a,b+");
        assert_eq!((message.layout.dim[0].size, message.layout.dim[0].stride), (2, 8));
        assert_eq!(
            (message.layout.dim[1].label.as_str(), message.layout.data_offset),
            ("value,std,excitation,state", 3)
        );
        let bits: Vec<u64> = message.data.iter().map(|value| value.to_bits()).collect();
        let expected = [5.0, 77.0, 4.0, 0.1 + 0.2, 0.0, 0.0, 0.0, -0.0, 1e-9, 0.5, 1.0];
        assert_eq!(bits, expected.map(f64::to_bits));
    }
}
