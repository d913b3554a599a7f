//! `cargo xtask tables`: puts the tables that commands wrote into the pages that show them.
//!
//! ```text
//! <!-- table docs/tables/NAME.md: COMMAND --markdown docs/tables/NAME.md -->
//! content of the file
//! <!-- end of table -->
//! ```

use crate::install::workspace;
use anyhow::{Context as _, Result, bail, ensure};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

const START: &str = "<!-- table ";
const END: &str = "<!-- end of table -->";
/// Folder of the tables.
const TABLES: &str = "docs/tables";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Change nothing; end with 1 where a page does not show what its file holds.
    #[arg(long)]
    check: bool,
    /// Print the commands that write the tables, and stop.
    #[arg(long)]
    commands: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let source = workspace()?;
    let (mut shown, mut differing) = (BTreeSet::new(), Vec::new());
    for path in markdown_files(&source.join("docs"))? {
        let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let page = Page { text: &text };
        let in_page = |e: anyhow::Error| e.context(path.display().to_string());
        let tables = page.tables().map_err(in_page)?;
        if args.commands {
            for table in &tables {
                println!("{}", table.command);
            }
        }
        let renewed = page.with(&tables, |file| {
            let path = source.join(file);
            fs::read_to_string(&path).with_context(|| path.display().to_string())
        });
        let renewed = renewed.map_err(in_page)?;
        shown.extend(tables.iter().map(|table| source.join(table.file)));
        if renewed == text || args.commands {
            continue;
        }
        if !args.check {
            rivet_files::write_whole(&path, &renewed).with_context(|| path.display().to_string())?;
        }
        differing.push(path);
    }
    let all = markdown_files(&source.join(TABLES))?;
    let unused: Vec<_> = all.iter().filter(|path| !shown.contains(*path)).collect();
    ensure!(unused.is_empty(), "no page shows {unused:?}");
    ensure!(
        !args.check || differing.is_empty(),
        "{differing:?}: not what the files of {TABLES} hold; run `cargo xtask tables`"
    );
    Ok(())
}

/// Pages below a folder, in order.
fn markdown_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(markdown_files(&path)?);
        } else if path.extension().is_some_and(|e| e == "md") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// A table on a page.
#[derive(Debug, PartialEq)]
struct Table<'a> {
    /// File that holds it, from the root of the checkout.
    file: &'a str,
    /// Command that writes the file.
    command: &'a str,
    /// Bytes of the page that show it.
    content: std::ops::Range<usize>,
}

struct Page<'a> {
    text: &'a str,
}

impl<'a> Page<'a> {
    fn tables(&self) -> Result<Vec<Table<'a>>> {
        let mut tables = Vec::new();
        for (at, _) in self.text.match_indices(START) {
            let rest = &self.text[at + START.len()..];
            let (mark, _) = rest.split_once(" -->\n").context("a table's first mark does not end with ` -->`")?;
            let (file, command) = mark.split_once(": ").context("a table's first mark is not `FILE: COMMAND`")?;
            ensure!(
                command.ends_with(&format!("--markdown {file}")),
                "the command of {file} must end with `--markdown {file}`"
            );
            let start = at + START.len() + mark.len() + " -->\n".len();
            let after = &self.text[start..];
            let length = after.find(END).with_context(|| format!("{file}: `{END}` is missing"))?;
            if after[..length].contains(START) {
                bail!("{file}: `{END}` is missing before the next table");
            }
            tables.push(Table { file, command, content: start..start + length });
        }
        Ok(tables)
    }

    /// The page with the present contents of the files.
    fn with(&self, tables: &[Table], read: impl Fn(&str) -> Result<String>) -> Result<String> {
        let (mut out, mut done) = (String::new(), 0);
        for table in tables {
            out += &self.text[done..table.content.start];
            out += &read(table.file).with_context(|| format!("written by: {}", table.command))?;
            done = table.content.end;
        }
        Ok(out + &self.text[done..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "a\n<!-- table docs/tables/x.md: rivet study x --markdown docs/tables/x.md -->\nold\n<!-- end of table -->\nb\n";

    #[test]
    fn a_table_is_replaced_by_its_file() {
        let page = Page { text: PAGE };
        let tables = page.tables().expect("a table");
        assert_eq!((tables[0].file, &PAGE[tables[0].content.clone()]), ("docs/tables/x.md", "old\n"));
        let renewed = page.with(&tables, |_| Ok("new\n\nlines\n".to_owned())).expect("a page");
        assert_eq!(renewed, PAGE.replace("old\n", "new\n\nlines\n"));
    }

    #[test]
    fn marks_that_are_incomplete_are_errors() {
        for (from, to, named) in [
            ("<!-- end of table -->", "", "is missing"),
            ("--markdown docs/tables/x.md -->", "-->", "must end with"),
            ("<!-- end of table -->", PAGE, "before the next"),
            ("x.md: rivet", "x.md rivet", "FILE: COMMAND"),
        ] {
            let text = PAGE.replace(from, to);
            let error = Page { text: &text }.tables().expect_err(to);
            assert!(error.to_string().contains(named), "{error}");
        }
    }
}
