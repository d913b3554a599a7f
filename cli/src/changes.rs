//! `rivet compare`: what changed between two diagnoses.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use rivet_report::words::{self, effect, figure, joints, percent, quantity};
use rivet_report::{Changes, Document, Number, Pair};

use crate::documents::read_document;
use crate::exit::Mismatch;
use crate::outputs::{Outputs, write_json};
use crate::table::{Table, paragraph, show};

/// Arguments of `rivet compare`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A diagnosis, as `rivet diagnose --json` wrote it.
    #[arg(value_name = "A.json")]
    a: PathBuf,
    /// A later diagnosis.
    #[arg(value_name = "B.json")]
    b: PathBuf,
    /// Write the changes as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Exit codes: 0 the same verdict and causes, 1 something changed.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    Outputs::given(vec![&args.a, &args.b]).file("--json", args.json.as_ref()).check()?;
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    let changes = Changes::between(&a, &b).map_err(|rules| Mismatch { a: args.a.clone(), b: args.b.clone(), rules })?;
    write_json(args.json.as_ref(), &changes)?;
    show(&as_text(&changes, &a))?;
    Ok(ExitCode::from(u8::from(!changes.is_same())))
}

fn read(path: &Path) -> Result<Document> {
    read_document(path, "a diagnosis", "rivet diagnose --json")
}

fn as_text(changes: &Changes, a: &Document) -> String {
    let all = a.gap.per_joint.len();
    let arrow = |p: &Pair<Number>| format!("{} -> {}", percent(p.a), percent(p.b));
    let verdict = &changes.verdict;
    let head = if verdict.a == verdict.b {
        format!("compare {}: still {}", a.robot, words::verdict(&verdict.b))
    } else {
        format!("compare {}: {} became {}", a.robot, words::verdict(&verdict.a), words::verdict(&verdict.b))
    };
    let mut out = paragraph("", &head);
    out +=
        &paragraph("  ", &format!("gap nominal {} %, with causes {} %", arrow(&changes.before), arrow(&changes.after)));
    for (what, causes) in [("named now: ", &changes.appeared), ("no longer named: ", &changes.gone)] {
        for (name, on) in causes {
            out += &paragraph("  ", &format!("{what}{} on {}", effect(name), joints(on, all)));
        }
    }
    for kept in &changes.kept {
        let sizes: Vec<String> = kept
            .magnitude
            .iter()
            .filter(|(name, _)| !name.contains('.'))
            .map(|(name, size)| {
                let (name, unit) = quantity(name, a);
                let rounded = |x: Number| x.map_or_else(|| "-".to_owned(), |x| figure(x, 3));
                format!("{name} {} -> {} {unit}", rounded(size.a), rounded(size.b)).trim_end().to_owned()
            })
            .collect();
        let sizes = if sizes.is_empty() { String::new() } else { format!(": {}", sizes.join(", ")) };
        let text = format!(
            "still named: {} on {}{sizes}; shrink {} %",
            effect(&kept.effect),
            joints(&kept.joints, all),
            arrow(&kept.shrink)
        );
        out += &paragraph("  ", &text);
    }
    if !changes.joints.is_empty() {
        let mut table = Table::new(["gap by joint [%]", "nominal", "with causes"]);
        for j in &changes.joints {
            table.row([j.joint.clone(), arrow(&j.before), arrow(&j.after)]);
        }
        out += &table.text();
    }
    if !changes.values.is_empty() {
        let mut table = Table::new(["value, pinned in both", "was", "is", "unit"]);
        for v in &changes.values {
            let rounded = |x: Number| x.map_or_else(|| "-".to_owned(), |x| figure(x, 3));
            table.row([quantity(&v.name, a).0, rounded(v.found.a), rounded(v.found.b), v.unit.clone()]);
        }
        out += &table.text();
    }
    out + &paragraph("  ", &format!("made of: {}", changes.notes.join(", ")))
}
