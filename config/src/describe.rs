//! The resolved configuration as text, at most 100 columns wide: what `rivet check` prints.

use std::fmt::Write as _;

use crate::keys::SECTIONS;
use crate::load::Robot;
use crate::number_text::short;
use crate::reader::{Origin, Resolved, value_text};

const WIDTH: usize = 100;
/// Where the unit and the origin of a value begin.
const UNIT_COLUMN: usize = 78;
const VALUE_COLUMN: usize = 24;

impl Robot {
    /// Everything the file says and everything that follows from it: every value with its unit and its origin, the
    /// joints, the base parameters. Lines have at most 100 characters.
    pub fn describe(&self) -> String {
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
                    Some(_) => "yes, below".into(),
                    None => "no: the nominal values hold".to_owned(),
                },
            ),
        ];
        for (what, text) in lines {
            push(&mut out, &format!("{what:<17}{}", tail(&text, WIDTH - 17)));
        }
        self.joints_table(&mut out);
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

    fn joints_table(&self, out: &mut String) {
        push(out, "");
        push(
            out,
            " joint                       kind          lower     upper     speed    ratio    rotor  torque limit",
        );
        for (j, joint) in self.model.arm.joints.iter().enumerate() {
            let kind = format!("{:?}", joint.kind).to_lowercase();
            let (ratio, rotor) = (self.config.drive.gear_ratio[j], self.config.drive.rotor_inertia[j]);
            let limit = self.config.drive.torque_limit[j];
            push(
                out,
                &format!(
                    " {:>2} {:<24.24} {kind:<9.9} {:>9.9} {:>9.9} {:>9.9} {:>8.8} {:>8.8} {:>13.13}",
                    j + 1,
                    joint.name,
                    short(joint.lower),
                    short(joint.upper),
                    short(joint.velocity),
                    short(ratio),
                    short(rotor),
                    short(limit),
                ),
            );
        }
        push(
            out,
            "                                            rad       rad     rad/s        -   kg m^2           N m",
        );
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
        push(out, " base parameter             nominal  unit          base parameter             nominal  unit");
        let cell = |i: usize| {
            let name = names.get(i)?;
            Some(format!(" {name:<22} {:>11.4e}  {:<10}", self.nominal_base[i], unit(i)))
        };
        let rows = names.len().div_ceil(2);
        for i in 0..rows {
            let line = format!("{}  {}", cell(i).unwrap_or_default(), cell(i + rows).unwrap_or_default());
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
            0 => (resolved.key.name, format!("{:<11}{origin}", resolved.key.unit)),
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
