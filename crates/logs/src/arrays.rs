//! Arrays of numbers by name, and the columns that they become: rows are the samples, one column a value of a sample.

use std::collections::BTreeMap;

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

/// Samples of a file: the length of the array that is named as time; else the length that most arrays have as their longest
/// dimension, the largest of those. `arrays`: name and lengths.
pub(crate) fn samples<'a>(arrays: impl Iterator<Item = (&'a str, &'a [usize])> + Clone) -> usize {
    let longest = |lengths: &[usize]| lengths.iter().copied().max().unwrap_or(0);
    let is_line = |lengths: &[usize]| lengths.iter().filter(|length| **length > 1).count() == 1;
    let is_time = |name: &str| guess::word(name) == Some("time");
    let lines = arrays.clone().filter(|(name, lengths)| is_line(lengths) && is_time(name));
    let times: Vec<usize> = lines.map(|(_, lengths)| longest(lengths)).collect();
    if let [first, others @ ..] = times.as_slice()
        && others.iter().all(|length| length == first)
    {
        return *first;
    }
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for (_, lengths) in arrays {
        *counts.entry(longest(lengths)).or_default() += 1;
    }
    counts.into_iter().max_by_key(|(length, count)| (*count, *length)).map_or(0, |(length, _)| length)
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
