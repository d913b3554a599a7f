//! Arrays of numbers by name, and the columns that they become: rows are the samples, one column a value of a sample.

use std::collections::{BTreeMap, BTreeSet};

use crate::columns::Wanted;
use crate::guess;
use crate::listing::Conventions;

/// Most values of a sample.
const MAX_WIDTH: usize = 1024;
/// Values that a byte of the file may stand for, and that every file may have.
const CELLS_A_BYTE: u64 = 64;
const CELLS_OF_ANY_FILE: u64 = 4 << 20;

/// Samples of an array, and values of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    pub(crate) rows: usize,
    pub(crate) width: usize,
    /// Whether samples are the second dimension.
    is_turned: bool,
    /// Whether it has two dimensions.
    is_table: bool,
}

impl Shape {
    /// The shape of an array with these lengths, where `rows` are the samples; none where no dimension is the samples.
    pub(crate) fn with_rows(lengths: &[usize], rows: usize) -> Option<Shape> {
        let shape = match lengths[..] {
            [length] if length == rows => Shape { rows, width: 1, is_turned: false, is_table: false },
            [length, width] if length == rows => Shape { rows, width, is_turned: false, is_table: true },
            [width, length] if length == rows => Shape { rows, width, is_turned: true, is_table: true },
            _ => return None,
        };
        (1..=MAX_WIDTH).contains(&shape.width).then_some(shape)
    }

    /// Numbers of the array.
    pub(crate) fn cells(self) -> u64 {
        (self.rows as u64).saturating_mul(self.width as u64)
    }

    /// The column of number `k`, in the order in which they are stored.
    pub(crate) fn column(self, k: usize, is_fortran: bool) -> usize {
        // C order runs through the last dimension first; a turned or a Fortran array has its samples there.
        if is_fortran == self.is_turned { k % self.width } else { k / self.rows }
    }

    /// Names of the columns: those of the contract, `q1`, where rivet wrote the array, else `q[0]`.
    pub(crate) fn names(self, array: &str, conventions: Conventions) -> Vec<String> {
        match (self.is_table, conventions) {
            (false, _) => vec![array.to_owned()],
            (true, Conventions::Recorder) => (0..self.width).map(|k| format!("{array}[{k}]")).collect(),
            (true, Conventions::Model) => (1..=self.width).map(|k| format!("{array}{k}")).collect(),
        }
    }
}

/// Kinds of arrays that only an arm has.
const KINDS_OF_JOINTS: [&str; 3] = ["positions", "torques", "currents"];

/// Samples of a file: the length that positions, torques and currents have, where other sensors have other rates; of several such
/// lengths that of time, else that which most arrays have as their longest dimension, the largest of those.
/// `arrays`: name and lengths.
pub(crate) fn samples<'a>(arrays: impl Iterator<Item = (&'a str, &'a [usize])> + Clone) -> usize {
    #[derive(Default)]
    struct Length<'a> {
        kinds_of_joints: BTreeSet<&'a str>,
        is_of_time: bool,
        arrays: usize,
    }
    let mut found: BTreeMap<usize, Length> = BTreeMap::new();
    for (name, lengths) in arrays {
        let word = guess::word(name);
        let longest = lengths.iter().copied().max().unwrap_or(0);
        let is_line = lengths.iter().filter(|length| **length > 1).count() <= 1;
        for length in lengths {
            // The samples may be fewer than the joints.
            found
                .entry(*length)
                .or_default()
                .kinds_of_joints
                .extend(word.filter(|word| KINDS_OF_JOINTS.contains(word)));
        }
        let of_longest = found.entry(longest).or_default();
        of_longest.is_of_time |= is_line && word == Some("time");
        of_longest.arrays += 1;
    }
    let rank =
        |(length, found): &(usize, Length)| (found.kinds_of_joints.len(), found.is_of_time, found.arrays, *length);
    found.into_iter().max_by_key(rank).map_or(0, |(length, _)| length)
}

/// Places of the wanted columns among the wanted ones.
pub(crate) fn places(names: &[String], wanted: Wanted<'_>) -> Vec<Option<usize>> {
    let mut count = 0;
    let place = |name: &String| {
        wanted(name).then(|| {
            count += 1;
            count - 1
        })
    };
    names.iter().map(place).collect()
}

/// Values that all wanted arrays of a file may have together: those that its bytes may stand for.
pub(crate) struct Budget {
    bytes: u64,
    cells: u64,
}

impl Budget {
    /// The budget of a file of this size.
    pub(crate) fn new(bytes: u64) -> Budget {
        Budget { bytes, cells: 0 }
    }

    /// Most values.
    pub(crate) fn most(&self) -> u64 {
        self.bytes.saturating_mul(CELLS_A_BYTE).saturating_add(CELLS_OF_ANY_FILE)
    }

    /// Takes `cells` values.
    ///
    /// # Errors
    /// There are more than the file's bytes may stand for.
    pub(crate) fn take(&mut self, cells: u64) -> Result<(), String> {
        self.cells = self.cells.saturating_add(cells);
        if self.cells > self.most() {
            return Err(format!(
                "with it the arrays claim more than the {} values that {} bytes may stand for",
                self.most(),
                self.bytes
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples_of(arrays: &[(&str, &[usize])]) -> usize {
        samples(arrays.iter().copied())
    }

    #[test]
    fn the_arm_decides_where_other_sensors_have_more_arrays_or_rows() {
        let arm: [(&str, &[usize]); 2] = [("arm/position", &[500, 6]), ("arm/torque", &[500, 6])];
        let sensor: [(&str, &[usize]); 4] =
            [("imu/time", &[4000]), ("imu/gyro", &[4000, 3]), ("imu/acc", &[4000, 3]), ("imu/mag", &[4000, 3])];
        assert_eq!(samples_of(&[&arm[..], &sensor[..]].concat()), 500);
        assert_eq!(samples_of(&[&arm[..], &[("arm/time", &[500])], &sensor[..]].concat()), 500);
    }

    #[test]
    fn time_decides_where_samples_are_fewer_than_joints() {
        assert_eq!(samples_of(&[("time", &[5]), ("q", &[5, 7]), ("tau", &[5, 7])]), 5);
        assert_eq!(samples_of(&[("time", &[5]), ("q", &[7, 5]), ("tau", &[7, 5])]), 5);
        assert_eq!(samples_of(&[("q", &[7, 300]), ("tau", &[7, 300])]), 300);
        assert_eq!(samples_of(&[("time", &[1, 300]), ("a", &[300, 300]), ("b", &[300, 2])]), 300);
        assert_eq!(samples_of(&[]), 0);
    }
}
