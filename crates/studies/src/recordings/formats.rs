//! In which format and order a drawn recording is written.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rivet_logs::{Log, write_columns, write_log};
use rivet_simulation::Random;

use super::meanings::below;

/// Writes a log to a file without an ending; returns the path that it has.
type Write = fn(&Path, &Log, &[String], &mut Random) -> Result<PathBuf, String>;

/// A format: its name, and the writer.
pub(super) struct Format {
    pub(super) name: &'static str,
    pub(super) write: Write,
}

/// Every format, equally probable.
pub(super) const FORMATS: [Format; 7] = [
    Format { name: "Parquet, columns q1..N", write: |path, log, joints, _| by_ending(path, "parquet", log, joints) },
    Format { name: "Parquet, joints by name in any order", write: named_parquet },
    Format { name: "MCAP", write: |path, log, joints, _| by_ending(path, "mcap", log, joints) },
    Format { name: "NPZ", write: |path, log, joints, _| by_ending(path, "npz", log, joints) },
    Format { name: "HDF5", write: |path, log, joints, _| by_ending(path, "h5", log, joints) },
    Format { name: "text, joints by name in any order", write: named_text },
    Format { name: "text, columns of a driver", write: driver_text },
];

fn by_ending(path: &Path, ending: &str, log: &Log, joints: &[String]) -> Result<PathBuf, String> {
    let path = path.with_extension(ending);
    write_log(&path, log, joints).map_err(|why| why.to_string())?;
    Ok(path)
}

/// Time, then positions and torques of the joints, `[name][values]`.
type Table<'a> = Vec<(String, &'a [f64])>;

/// The signals of joints in any order; `name`: joint and field.
fn shuffled<'a>(log: &'a Log, joints: &[String], random: &mut Random, name: fn(&str, &str) -> String) -> Table<'a> {
    let mut order: Vec<usize> = (0..joints.len()).collect();
    for last in (1..order.len()).rev() {
        order.swap(last, below(random, last + 1));
    }
    let mut table: Table<'a> = vec![("timestamp".to_owned(), &log.t)];
    let tau = log.tau.as_ref().map(|(_, tau)| tau);
    for (field, signals) in [("position", Some(&log.q)), ("effort", tau)] {
        for j in &order {
            table.extend(signals.map(|signals| (name(&joints[*j], field), signals[*j].as_slice())));
        }
    }
    table
}

fn named_parquet(path: &Path, log: &Log, joints: &[String], random: &mut Random) -> Result<PathBuf, String> {
    let path = path.with_extension("parquet");
    let table = shuffled(log, joints, random, |joint, field| format!("{field}.{joint}"));
    write_columns(&path, &table).map_err(|why| why.to_string())?;
    Ok(path)
}

fn named_text(path: &Path, log: &Log, joints: &[String], random: &mut Random) -> Result<PathBuf, String> {
    let table = shuffled(log, joints, random, |joint, field| format!("/joint_states/{joint}/{field}"));
    text(path, &table, random)
}

fn driver_text(path: &Path, log: &Log, _joints: &[String], random: &mut Random) -> Result<PathBuf, String> {
    let mut table: Table<'_> = vec![("timestamp".to_owned(), &log.t)];
    let tau = log.tau.as_ref().map(|(_, tau)| tau);
    for (name, signals) in [("actual_q", Some(&log.q)), ("actual_torque", tau)] {
        let signals = signals.into_iter().flatten().enumerate();
        table.extend(signals.map(|(j, signal)| (format!("{name}_{j}"), signal.as_slice())));
    }
    text(path, &table, random)
}

/// A table as text: commas, semicolons with decimal commas, tabs or blanks.
fn text(path: &Path, table: &Table<'_>, random: &mut Random) -> Result<PathBuf, String> {
    let (separator, decimal) = [(",", "."), (";", ","), ("\t", "."), (" ", ".")][below(random, 4)];
    let names: Vec<&str> = table.iter().map(|(name, _)| name.as_str()).collect();
    let mut out = names.join(separator);
    out.push('\n');
    for row in 0..table[0].1.len() {
        for (k, (_, values)) in table.iter().enumerate() {
            // Writing to a String cannot fail.
            let _ =
                write!(out, "{}{}", if k > 0 { separator } else { "" }, values[row].to_string().replace('.', decimal));
        }
        out.push('\n');
    }
    let path = path.with_extension("csv");
    std::fs::write(&path, out).map_err(|why| why.to_string())?;
    Ok(path)
}
