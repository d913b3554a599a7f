//! CSV: a header line with the column names, then one line a sample; `#` starts a comment line.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use crate::columns::Table;
use crate::error::{LogError, LogFault};
use crate::guess;

/// Reads the columns that `wanted` picks by name from a CSV file.
pub(crate) fn read(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<Table, LogError> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(Lines::new(File::open(path).map_err(|e| LogFault::Io(e).at(path))?));
    let names: Vec<String> = reader.headers().map_err(|e| fault(e).at(path))?.iter().map(str::to_owned).collect();
    if let [one] = &names[..]
        && let Some(why) = not_commas(one)
    {
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
                let value = format!("'{}' is not a number", shortened(cell));
                LogFault::Value { column: names[*k].clone(), row, value }.at(path)
            })?);
        }
    }
    table.columns = known.into_iter().map(|(k, values)| (names[k].clone(), values)).collect();
    Ok(table)
}

/// Most characters of a cell in a message.
const MAX_CELL_CHARS: usize = 60;

fn shortened(cell: &str) -> String {
    let mut text: String = cell.chars().take(MAX_CELL_CHARS).collect();
    if text.len() < cell.len() {
        text.push_str("...");
    }
    text
}

/// Why a header line of one column is none.
fn not_commas(header: &str) -> Option<String> {
    if header.starts_with('%') {
        return Some(
            "its first line begins with %; a comment line begins with #: put # there, or remove the line".to_owned(),
        );
    }
    let (separator, names) = guess::separator(header)?;
    let columns = guess::sentence(&names);
    Some(format!(
        "its columns are separated by {separator}; a log's are by commas, with points in its numbers. {columns}"
    ))
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
/// Line breaks inside quotes do not end it.
const MAX_LINE_BYTES: usize = 1 << 20;

/// Where a byte stands in its line.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    /// Here a quote opens a quoted field.
    FieldStart,
    Field,
    Quoted,
    /// Behind a quote in a quoted field: a second one is a quote of its text, anything else ends the quotes.
    Closing,
    Comment,
}

/// Bytes of a file, as long as its lines are of bounded length.
struct Lines<R> {
    inner: R,
    /// From 1.
    line: usize,
    /// Line of the last quote that opened a field.
    opened: usize,
    bytes: usize,
    place: Place,
}

impl<R: Read> Lines<R> {
    fn new(inner: R) -> Lines<R> {
        Lines { inner, line: 1, opened: 1, bytes: 0, place: Place::FieldStart }
    }

    fn pass(&mut self, byte: u8) -> io::Result<()> {
        self.line += usize::from(byte == b'\n');
        self.bytes += 1;
        self.place = match (self.place, byte) {
            (Place::Quoted, b'"') => Place::Closing,
            (Place::Quoted, _) | (Place::Closing, b'"') => Place::Quoted,
            (_, b'\n' | b'\r') => {
                self.bytes = 0;
                Place::FieldStart
            }
            (Place::Comment, _) => Place::Comment,
            (Place::FieldStart, b'#') if self.bytes == 1 => Place::Comment,
            (Place::FieldStart, b'"') => {
                self.opened = self.line;
                Place::Quoted
            }
            (_, b',') => Place::FieldStart,
            _ => Place::Field,
        };
        if self.bytes <= MAX_LINE_BYTES {
            return Ok(());
        }
        let why = if self.place == Place::Quoted {
            format!(
                "the quote that opens in line {} does not close within {MAX_LINE_BYTES} bytes; close it",
                self.opened
            )
        } else {
            format!("line {} has more than {MAX_LINE_BYTES} bytes; write one sample a line", self.line)
        };
        Err(io::Error::new(io::ErrorKind::InvalidData, why))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn passed(text: &str) -> Result<String, String> {
        let mut out = String::new();
        Lines::new(text.as_bytes()).read_to_string(&mut out).map(|_| out).map_err(|why| why.to_string())
    }

    fn table(text: &str) -> Result<Table, String> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        read(file.path(), |name| name.len() == 1).map_err(|why| why.to_string())
    }

    #[test]
    fn line_break_inside_quotes_belongs_to_its_field() {
        let log =
            table("a,\"b\nof the \"\"first\"\" arm, measured\",c\r\n1,2,3\n\"4\",\"\n5\n\",6\n").expect("a table");
        assert_eq!((&log.columns["a"], &log.columns["c"]), (&vec![1.0, 4.0], &vec![3.0, 6.0]));
        assert_eq!(log.unused, ["b\nof the \"first\" arm, measured"]);
        let log = table("# the \"arm\na,b\"\n1,2\n3,4\n").expect("a quote in the middle of a field opens nothing");
        assert_eq!(log.columns["a"], [1.0, 3.0]);
    }

    #[test]
    fn quote_that_never_closes_and_endless_lines_are_refused_with_their_line() {
        let long = "x\n".repeat(MAX_LINE_BYTES);
        let why = passed(&format!("a,b\n1,\"{long}")).expect_err("no end");
        assert!(why.contains("quote that opens in line 2 does not close"), "{why}");
        let why = passed(&format!("a,b\n1,2\n{}", "x".repeat(MAX_LINE_BYTES + 1))).expect_err("no end");
        assert!(why.contains("line 3 has more than 1048576 bytes"), "{why}");
        let comment = format!("# \"\n{}\na,b\n", "# \n".repeat(MAX_LINE_BYTES));
        assert_eq!(passed(&comment).expect("comments have no quotes"), comment);
        let Err(why) = table(&format!("a,b\n\"{}\",2\n", "x".repeat(1000))) else { panic!("no number") };
        assert!(why.len() < 300 && why.contains("xxx...' is not a number"), "{why}");
    }
}
