//! The resolved configuration as text, at most 80 columns wide: what `rivet check` prints.

use std::fmt::Write as _;

use crate::keys::SECTIONS;
use crate::load::Robot;
use crate::number_text::short;
use crate::reader::{Origin, Resolved, value_text};

const WIDTH: usize = 80;
/// Where the value, the unit and the origin of a key begin.
const VALUE_COLUMN: usize = 24;
const UNIT_COLUMN: usize = 54;
const ORIGIN_COLUMN: usize = 69;

impl Robot {
    /// Everything the file says and everything that follows from it: [`summary`](Self::summary), every value with its unit and its
    /// origin, the base parameters. Lines have at most 80 characters.
    pub fn describe(&self) -> String {
        let mut out = self.summary();
        for (section, _) in SECTIONS.iter().filter(|(s, _)| *s != "identified") {
            let mut values = self.config.resolved.iter().filter(|r| r.key.section == *section).peekable();
            if values.peek().is_some() {
                push(&mut out, "");
                push(&mut out, &if section.is_empty() { "(top)".into() } else { format!("[{section}]") });
            }
            for value in values {
                value_lines(&mut out, value);
            }
        }
        self.base_table(&mut out);
        out
    }

    /// Files, sizes of the model, and the joints with their limits. Lines have at most 80 characters.
    pub fn summary(&self) -> String {
        let mut out = String::new();
        let lines = [
            ("robot", self.config.name.clone()),
            ("file", self.config.path.display().to_string()),
            ("urdf", self.config.urdf.display().to_string()),
            ("joints", self.dof().to_string()),
            ("base parameters", format!("{} of {} standard parameters", self.base.len(), self.model.len())),
            (
                "rank gap",
                format!(
                    "{:.1e} (smallest kept {:.1e}, largest dropped {:.1e})",
                    self.base.gap.ratio(),
                    self.base.gap.smallest_kept,
                    self.base.gap.largest_dropped
                ),
            ),
            ("model hash", format!("{:016x}", self.hash)),
            (
                "identified",
                match &self.identified {
                    Some(_) => "yes: parameters of [identified]".into(),
                    None => "no: the nominal values hold".to_owned(),
                },
            ),
        ];
        for (what, text) in lines {
            push(&mut out, &format!("{what:<17}{}", tail(&text, WIDTH - 17)));
        }
        self.joints_table(&mut out);
        out
    }

    fn joints_table(&self, out: &mut String) {
        push(out, "");
        push(out, " joint                  kind       lower   upper   speed  ratio   rotor  torque");
        for (j, joint) in self.model.arm.joints.iter().enumerate() {
            let kind = format!("{:?}", joint.kind).to_lowercase();
            let (ratio, rotor) = (self.config.drive.gear_ratio[j], self.config.drive.rotor_inertia[j]);
            let limit = self.config.drive.torque_limit[j];
            push(
                out,
                &format!(
                    " {:>2} {:<19} {kind:<8.8} {:>7.7} {:>7.7} {:>7.7} {:>6.6} {:>7.7} {:>7.7}",
                    j + 1,
                    tail(&joint.name, 19),
                    short(joint.lower),
                    short(joint.upper),
                    short(joint.velocity),
                    short(ratio),
                    short(rotor),
                    short(limit),
                ),
            );
        }
        push(out, "                                   rad     rad   rad/s      -  kg m^2     N m");
    }

    fn base_table(&self, out: &mut String) {
        push(out, "");
        let names: Vec<_> = (0..self.base.len()).map(|i| self.base.name(&self.model, i)).collect();
        let unit = |i: usize| self.base.parameter(&self.model, i).unit(&self.model.arm);
        if let Some(identified) = &self.identified {
            push(out, " base parameter                nominal     identified            std  unit");
            for (i, name) in names.iter().enumerate() {
                let (x, std) = (identified.values[i], identified.std[i]);
                let nominal = self.nominal_base[i];
                push(out, &format!(" {name:<24} {nominal:>13.5e}  {x:>13.5e}  {std:>13.5e}  {}", unit(i)));
            }
            return;
        }
        // Two columns where names and units are those of most arms.
        let is_short = |i: usize| names[i].len() <= 17 && unit(i).len() <= 9;
        let columns = if (0..names.len()).all(is_short) { 2 } else { 1 };
        let head = " base parameter       nominal  unit     ";
        push(out, &head.repeat(columns));
        let cell = |i: usize| {
            let name = names.get(i)?;
            Some(format!(" {name:<17} {:>10.3e}  {:<9}", self.nominal_base[i], unit(i)))
        };
        let rows = names.len().div_ceil(columns);
        for i in 0..rows {
            let line: String = (0..columns).filter_map(|column| cell(i + column * rows)).collect();
            push(out, &line);
        }
    }
}

/// `  name   value   unit   origin`, the value wrapped between its entries where it is long.
fn value_lines(out: &mut String, resolved: &Resolved) {
    let origin = match resolved.origin {
        Origin::Line(line) => format!("line {line}"),
        Origin::Default => "default".to_owned(),
        Origin::Chosen => "chosen".to_owned(),
        Origin::Urdf => "URDF".to_owned(),
    };
    let mut rows = vec![String::new()];
    for part in value_text(&resolved.value).split_inclusive(", ") {
        let row = rows.last_mut().expect("one row at least");
        if !row.is_empty() && VALUE_COLUMN + row.len() + part.trim_end().len() > UNIT_COLUMN - 1 {
            rows.push(part.to_owned());
        } else {
            row.push_str(part);
        }
    }
    for (i, row) in rows.iter().enumerate() {
        let (name, tail) = match i {
            0 => (resolved.key.name, format!("{:<1$}{origin}", resolved.key.unit, ORIGIN_COLUMN - UNIT_COLUMN)),
            _ => ("", String::new()),
        };
        let (left, right) = (VALUE_COLUMN - 2, UNIT_COLUMN - VALUE_COLUMN);
        push(out, &format!("  {name:<left$}{:<right$}{tail}", row.trim_end()));
    }
}

/// One line, without blanks at its end and never wider than the page.
fn push(out: &mut String, line: &str) {
    let line: String = line.trim_end().chars().take(WIDTH).collect();
    // Writing to a String cannot fail.
    let _ = writeln!(out, "{line}");
}

/// The end of a long path, which is what tells it apart.
fn tail(text: &str, width: usize) -> String {
    let count = text.chars().count();
    if count <= width {
        return text.to_owned();
    }
    "...".chars().chain(text.chars().skip(count + 3 - width)).collect()
}
