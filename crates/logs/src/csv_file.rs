//! Text tables: a header line with the column names, then one line a sample. [`crate::csv_dialect`] finds how they are written.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use crate::columns::{EXACT, Table, Wanted};
use crate::csv_dialect::{Dialect, SNIFFED_BYTES, Separator, is_number, parse};
use crate::error::{LogError, LogFault};
use crate::listing::{Column, Listing, Topic};

use crate::units::split_unit;

/// The columns of a text table.
pub(crate) fn list(path: &Path) -> Result<Listing, LogError> {
    let table = TextTable::open(path)?;
    let first = &table.dialect.first;
    let column = |(k, name): (usize, &String)| {
        let text = first.get(k).filter(|cell| !cell.is_empty() && !is_number(cell, table.dialect.decimal_comma));
        let unit = split_unit(name).1.map(str::to_owned);
        Column { name: name.clone(), unit, text: text.cloned(), ..Column::default() }
    };
    let columns = table.names.iter().enumerate().map(column).collect();
    let topic = Topic { name: String::new(), kind: "table".to_owned(), messages: None, is_read: true };
    Ok(Listing { topics: vec![topic], columns, conventions: table.dialect.conventions, ..Listing::default() })
}

/// Reads the columns that `wanted` picks by name from a text table.
pub(crate) fn read(path: &Path, wanted: Wanted<'_>) -> Result<Table, LogError> {
    let mut source = TextTable::open(path)?;
    let mut known: Vec<(usize, Numbers)> = Vec::new();
    let mut table = Table::default();
    let mut taken = HashSet::new();
    for (k, name) in source.names.iter().enumerate() {
        if !wanted(name) {
            table.unused.push(name.clone());
        } else if !taken.insert(name) {
            return Err(LogFault::TwiceColumn { column: name.clone() }.at(path));
        } else {
            known.push((k, Numbers::default()));
        }
    }
    let mut record = csv::ByteRecord::new();
    let mut row = 0;
    while source.reader.read_byte_record(&mut record).map_err(|e| fault(e).at(path))? {
        row += 1;
        let columns = source.names.len();
        if record.len() != columns {
            let line = record.position().map_or(0, csv::Position::line);
            let why = format!("line: {line} has {} cells, the table has {columns} columns", record.len());
            return Err(LogFault::Format { format: "CSV", why }.at(path));
        }
        for (k, numbers) in &mut known {
            let cell = record.get(*k).unwrap_or(b"");
            if !numbers.push(cell, source.dialect.decimal_comma) {
                let value = format!("'{}' is not a number", shortened(&String::from_utf8_lossy(cell)));
                return Err(LogFault::Value { column: source.names[*k].clone(), row, value }.at(path));
            }
        }
    }
    table.columns = known.into_iter().map(|(k, numbers)| (source.names[k].clone(), numbers.values)).collect();
    Ok(table)
}

/// The numbers of a column. An empty cell is NaN.
#[derive(Default)]
struct Numbers {
    values: Vec<f64>,
    /// First number of a column whose numbers are beyond [`EXACT`].
    origin: Option<i64>,
}

impl Numbers {
    /// Whether the cell is a number, or empty.
    fn push(&mut self, cell: &[u8], decimal_comma: bool) -> bool {
        if cell.is_empty() {
            self.values.push(f64::NAN);
            return true;
        }
        // Stamps in ns have 19 digits.
        let whole = || std::str::from_utf8(cell).ok()?.parse::<i64>().ok();
        if self.values.is_empty()
            && let Some(first) = whole()
            && first.unsigned_abs() > EXACT
        {
            self.origin = Some(first);
        }
        let counted = self.origin.and_then(|origin| Some(whole()?.checked_sub(origin)? as f64));
        let value = counted.or_else(|| parse(cell, decimal_comma));
        self.values.extend(value);
        value.is_some()
    }
}

/// An open text table at its first row.
struct TextTable {
    dialect: Dialect,
    names: Vec<String>,
    reader: csv::Reader<Lines<File>>,
}

impl TextTable {
    fn open(path: &Path) -> Result<TextTable, LogError> {
        let open = || File::open(path).map_err(|e| LogFault::Io(e).at(path));
        let mut head = Vec::new();
        open()?.take(SNIFFED_BYTES).read_to_end(&mut head).map_err(|e| LogFault::Io(e).at(path))?;
        let dialect = Dialect::of(&String::from_utf8_lossy(&head));
        let byte = match dialect.separator {
            Separator::Byte(byte) => byte,
            Separator::Blanks => b' ',
        };
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .delimiter(byte)
            .has_headers(dialect.has_header)
            .flexible(true)
            .from_reader(Lines::new(open()?, dialect.separator));
        let names = if let Some(names) = &dialect.names {
            names.clone()
        } else {
            let header = reader.byte_headers().map_err(|e| fault(e).at(path))?;
            let name = |name: &[u8]| String::from_utf8_lossy(name).trim_start_matches('\u{feff}').to_owned();
            header.iter().map(name).collect()
        };
        Ok(TextTable { dialect, names, reader })
    }
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
    /// Nothing of the line came yet but blanks.
    LineStart,
    /// Behind a slash at the beginning of a line: a second one makes it a comment.
    Slash,
    /// Here a quote opens a quoted field.
    FieldStart,
    Field,
    Quoted,
    /// Behind a quote in a quoted field: a second one is a quote of its text, anything else ends the quotes.
    Closing,
    Comment,
}

/// Bytes of a file, as long as its lines are of bounded length. Comment lines are left empty; where blanks separate, one stands between
/// two cells.
struct Lines<R> {
    inner: R,
    separator: Separator,
    /// From 1.
    line: usize,
    /// Line of the last quote that opened a field.
    opened: usize,
    bytes: usize,
    place: Place,
    /// Whether a blank is due before the next cell.
    gap: bool,
    /// Bytes that are ready, from `at` on.
    ready: Vec<u8>,
    at: usize,
}

/// Bytes that are read at a time.
const READ_BYTES: usize = 1 << 14;

impl<R: Read> Lines<R> {
    fn new(inner: R, separator: Separator) -> Lines<R> {
        let (place, ready) = (Place::LineStart, Vec::new());
        Lines { inner, separator, line: 1, opened: 1, bytes: 0, place, gap: false, ready, at: 0 }
    }

    fn pass(&mut self, byte: u8) -> io::Result<()> {
        self.line += usize::from(byte == b'\n');
        self.bytes += 1;
        let is_gap = self.separator == Separator::Blanks && matches!(byte, b' ' | b'\t');
        let is_separator = self.separator == Separator::Byte(byte);
        match (self.place, byte) {
            (Place::Quoted, b'"') => self.emit(byte, Place::Closing),
            (Place::Quoted, _) | (Place::Closing, b'"') => self.emit(byte, Place::Quoted),
            (_, b'\n' | b'\r') => {
                (self.bytes, self.gap) = (0, false);
                self.emit(byte, Place::LineStart);
            }
            (Place::Comment, _) | (Place::LineStart, b' ') => {}
            (Place::LineStart, b'\t') if !is_separator => {}
            (Place::LineStart, b'#' | b'%') | (Place::Slash, b'/') => self.place = Place::Comment,
            (Place::LineStart, b'/') => self.place = Place::Slash,
            _ => {
                if self.place == Place::Slash {
                    self.emit(b'/', Place::Field);
                }
                self.cell(byte, is_gap, is_separator);
            }
        }
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

    /// A byte of a line that is no comment, outside quotes.
    fn cell(&mut self, byte: u8, is_gap: bool, is_separator: bool) {
        let is_start = matches!(self.place, Place::LineStart | Place::FieldStart);
        if is_gap {
            (self.gap, self.place) = (true, Place::FieldStart);
        } else if is_separator {
            self.emit(byte, Place::FieldStart);
        } else if is_start && byte == b'"' {
            self.opened = self.line;
            self.emit(byte, Place::Quoted);
        } else {
            self.emit(byte, Place::Field);
        }
    }

    fn emit(&mut self, byte: u8, place: Place) {
        if std::mem::take(&mut self.gap) {
            self.ready.push(b' ');
        }
        self.ready.push(byte);
        self.place = place;
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        while self.at == self.ready.len() {
            let mut bytes = [0; READ_BYTES];
            self.ready.clear();
            self.at = 0;
            let count = self.inner.read(&mut bytes)?;
            if count == 0 {
                return Ok(0);
            }
            for byte in &bytes[..count] {
                self.pass(*byte)?;
            }
        }
        let count = to.len().min(self.ready.len() - self.at);
        to[..count].copy_from_slice(&self.ready[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passed(text: &str) -> Result<String, String> {
        let mut out = String::new();
        Lines::new(text.as_bytes(), Separator::Byte(b','))
            .read_to_string(&mut out)
            .map(|_| out)
            .map_err(|why| why.to_string())
    }

    fn table(text: &str) -> Result<Table, String> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        read(file.path(), &|name| name.len() == 1).map_err(|why| why.to_string())
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
    fn blanks_comments_and_decimal_commas_are_read() {
        let log = table("// by x\n  % y\na   \t b\n 0,5  \"1,5\" \r\n\n# z\n1,5 2,5\n").expect("a table");
        assert_eq!((&log.columns["a"], &log.columns["b"]), (&vec![0.5, 1.5], &vec![1.5, 2.5]));
        let log = table("a\tb\n\t1\n2\t3\n").expect("a table");
        assert!(log.columns["a"][0].is_nan() && log.columns["b"] == [1.0, 3.0]);
    }

    #[test]
    fn stamps_in_nanoseconds_keep_their_differences() {
        let log = table("a,b\n1700000000000000001,1\n1700000000000000003,2\n").expect("a table");
        assert_eq!(log.columns["a"], [0.0, 2.0]);
    }

    #[test]
    fn quote_that_never_closes_and_endless_lines_are_refused_with_their_line() {
        let long = "x\n".repeat(MAX_LINE_BYTES);
        let why = passed(&format!("a,b\n1,\"{long}")).expect_err("no end");
        assert!(why.contains("quote that opens in line 2 does not close"), "{why}");
        let why = passed(&format!("a,b\n1,2\n{}", "x".repeat(MAX_LINE_BYTES + 1))).expect_err("no end");
        assert!(why.contains("line 3 has more than 1048576 bytes"), "{why}");
        let comment = format!("# \"\n{}\na,b\n", "# \n".repeat(MAX_LINE_BYTES));
        assert_eq!(passed(&comment).expect("comments have no quotes").trim_start(), "a,b\n");
        let Err(why) = table(&format!("a,b\n\"{}\",2\n", "x".repeat(1000))) else { panic!("no number") };
        assert!(why.len() < 300 && why.contains("xxx...' is not a number"), "{why}");
    }
}
