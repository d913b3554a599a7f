//! CSV: a header line with the column names, then one line a sample; `#` starts a comment line.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use crate::columns::Table;
use crate::error::{LogError, LogFault};

/// Reads the columns that `wanted` picks by name from a CSV file.
pub(crate) fn read(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<Table, LogError> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(Lines::new(File::open(path).map_err(|e| LogFault::Io(e).at(path))?));
    let names: Vec<String> = reader.headers().map_err(|e| fault(e).at(path))?.iter().map(str::to_owned).collect();
    if let [one] = &names[..]
        && let Some(other) = [';', '\t'].into_iter().find(|other| one.contains(*other))
    {
        let why = format!("its columns are separated by {other:?}; a log's are by commas, with points in its numbers");
        return Err(LogFault::Format { format: "CSV", why }.at(path));
    }
    let mut known: Vec<(usize, Vec<f64>)> = Vec::new();
    let mut table = Table::default();
    let mut taken = HashSet::new();
    for (k, name) in names.iter().enumerate() {
        if !wanted(name) {
            table.unused.push(name.clone());
        } else if !taken.insert(name) {
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
        csv::ErrorKind::Io(io) if io.kind() != io::ErrorKind::InvalidData => LogFault::Io(io),
        csv::ErrorKind::Io(io) => LogFault::Format { format: "CSV", why: io.to_string() },
        _ => LogFault::Format { format: "CSV", why },
    }
}

/// Longest line \[bytes\]: the CSV reader holds a line in memory, however long it is. 8 joints with every signal take 2 kB.
const MAX_LINE_BYTES: usize = 1 << 20;

/// Bytes of a file, as long as its lines are of bounded length and close their quotes.
struct Lines<R> {
    inner: R,
    line: usize,
    bytes: usize,
    quoted: bool,
    comment: bool,
}

impl<R: Read> Lines<R> {
    fn new(inner: R) -> Lines<R> {
        Lines { inner, line: 1, bytes: 0, quoted: false, comment: false }
    }

    fn pass(&mut self, byte: u8) -> io::Result<()> {
        let refuse = |why| Err(io::Error::new(io::ErrorKind::InvalidData, why));
        match byte {
            b'\n' | b'\r' => {
                if self.quoted {
                    return refuse(format!("line {} opens a quote that it does not close", self.line));
                }
                self.line += usize::from(byte == b'\n');
                (self.bytes, self.comment) = (0, false);
                return Ok(());
            }
            b'#' if self.bytes == 0 => self.comment = true,
            b'"' if !self.comment => self.quoted = !self.quoted,
            _ => {}
        }
        self.bytes += 1;
        if self.bytes > MAX_LINE_BYTES {
            return refuse(format!("line {} has more than {MAX_LINE_BYTES} bytes", self.line));
        }
        Ok(())
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(to)?;
        for byte in &to[..count] {
            self.pass(*byte)?;
        }
        Ok(count)
    }
}
