//! Rows with a cell that is empty, not a number or beyond every quantity of an arm.

use crate::columns::{Group, Table};

/// Share of rows that may be damaged. A log with more is refused with the first such cell.
const MAX_DAMAGED: f64 = 0.1;

/// Rows that were taken out of a table.
#[derive(Debug, Default)]
pub(crate) struct Damaged {
    /// Their times \[s\], where these are sound.
    pub(crate) t: Vec<f64>,
    /// One line for people; none where no row was taken out.
    pub(crate) note: Option<String>,
}

/// Takes rows out of which some value is not finite or beyond `largest`. A column without any value is no damage.
///
/// Nothing is taken out where columns differ in length, where more than `MAX_DAMAGED` of the rows are damaged, or where fewer than
/// `least_rows` would be left.
pub(crate) fn take_out(table: &mut Table, largest: f64, least_rows: usize) -> Damaged {
    let rows = table.columns.get("t").map_or(0, Vec::len);
    let is_signal = |name: &str| name == "t" || Group::parse(name).is_some();
    let damaged = |value: &f64| value.is_nan() || value.abs() > largest;
    let signals =
        || table.columns.iter().filter(|(name, values)| is_signal(name) && !values.iter().all(|v| v.is_nan()));
    if signals().any(|(_, values)| values.len() != rows) {
        return Damaged::default();
    }
    let cell_of =
        |row: &usize| signals().find(|(_, values)| damaged(&values[*row])).map(|(name, _)| (*row, name.clone()));
    let cells: Vec<(usize, String)> = (0..rows).filter_map(|row| cell_of(&row)).collect();
    let Some((first, column)) = cells.first() else { return Damaged::default() };
    if cells.len() as f64 > MAX_DAMAGED * rows as f64 || rows - cells.len() < least_rows {
        return Damaged::default();
    }
    let note = format!(
        "{} of {rows} rows have a cell that is empty or not a finite number (first: column {column}, row {}); they are left out like a gap",
        cells.len(),
        first + 1
    );
    let mut is_kept = vec![true; rows];
    for (row, _) in &cells {
        is_kept[*row] = false;
    }
    let times = table.columns.get("t").into_iter().flatten().zip(&is_kept);
    let t = times.filter(|(t, kept)| !**kept && !damaged(t)).map(|(t, _)| *t).collect();
    for values in table.columns.values_mut().filter(|values| values.len() == rows) {
        let mut kept = is_kept.iter();
        values.retain(|_| kept.next().is_none_or(|kept| *kept));
    }
    Damaged { t, note: Some(note) }
}
