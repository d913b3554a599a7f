//! CSV: a header line with the column names, then one line a sample; `#` starts a comment line.

use std::path::Path;

use crate::columns::Table;
use crate::error::{LogError, LogFault};

/// Reads the columns that `wanted` picks by name from a CSV file.
pub(crate) fn read(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<Table, LogError> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_path(path)
        .map_err(|e| fault(e).at(path))?;
    let names: Vec<String> = reader.headers().map_err(|e| fault(e).at(path))?.iter().map(str::to_owned).collect();
    if let [one] = &names[..]
        && let Some(other) = [';', '\t'].into_iter().find(|other| one.contains(*other))
    {
        let why = format!("its columns are separated by {other:?}; a log's are by commas, with points in its numbers");
        return Err(LogFault::Format { format: "CSV", why }.at(path));
    }
    let mut known: Vec<(usize, Vec<f64>)> = Vec::new();
    let mut table = Table::default();
    for (k, name) in names.iter().enumerate() {
        if !wanted(name) {
            table.unused.push(name.clone());
        } else if names[..k].contains(name) {
            return Err(LogFault::TwiceColumn { column: name.clone() }.at(path));
        } else {
            known.push((k, Vec::new()));
        }
    }
    let mut record = csv::StringRecord::new();
    let mut row = 0;
    while reader.read_record(&mut record).map_err(|e| fault(e).at(path))? {
        row += 1;
        for (k, values) in &mut known {
            // The reader has checked that every line has as many fields as the header.
            let cell = record.get(*k).unwrap_or("");
            let value = if cell.is_empty() { Ok(f64::NAN) } else { cell.parse() };
            values.push(value.map_err(|_| {
                let value = format!("'{cell}' is not a number");
                LogFault::Value { column: names[*k].clone(), row, value }.at(path)
            })?);
        }
    }
    table.columns = known.into_iter().map(|(k, values)| (names[k].clone(), values)).collect();
    Ok(table)
}

fn fault(error: csv::Error) -> LogFault {
    let why = error.to_string();
    match error.into_kind() {
        csv::ErrorKind::Io(io) => LogFault::Io(io),
        _ => LogFault::Format { format: "CSV", why },
    }
}
