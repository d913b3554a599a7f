//! `cargo xtask mirrors`: the messages of `ipc-schema` as a C header, as a Python module and as a Rust list.

mod c;
mod list;
mod prose;
mod python;
mod schema;

use anyhow::{Context as _, Result, bail, ensure};
use std::fs;
use std::path::Path;

use crate::install::workspace;
use prose::Words;
use schema::Schema;

/// The command that writes the files.
const COMMAND: &str = "cargo xtask mirrors";
/// Folder of the modules of the messages.
const MESSAGES: &str = "ipc-schema/src/messages";
/// Where the services are named.
const SERVICES: &str = "ipc-schema/src/service.rs";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Writes nothing; fails where a file differs from the messages.
    #[arg(long)]
    check: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let root = workspace()?;
    if args.check {
        return check(root);
    }
    for (path, text) in generate(root)? {
        let place = root.join(path);
        if fs::read_to_string(&place).is_ok_and(|kept| kept == text) {
            println!("unchanged  {path}");
            continue;
        }
        fs::write(&place, text).with_context(|| path.to_owned())?;
        println!("written    {path}");
    }
    Ok(())
}

/// The files, each by its path from the workspace's root.
fn generate(root: &Path) -> Result<[(&'static str, String); 3]> {
    let schema = Schema::read(&root.join(MESSAGES), &root.join(SERVICES))?;
    let template = |path: &str| fs::read_to_string(root.join(path)).with_context(|| path.to_owned());
    let header = c::header(&schema, &Words::new(&schema, &c::Names), &template("ipc-schema/include/rivet.h.in")?)?;
    let words = Words::new(&schema, &python::Names);
    let module = python::module(&schema, &words, &template("ipc-schema/python/rivet_ipc.py.in")?)?;
    Ok([
        ("ipc-schema/include/rivet.h", header),
        ("ipc-schema/python/rivet_ipc.py", module),
        ("ipc-schema/src/messages/list.rs", list::list(&schema)),
    ])
}

/// Compares the files with the messages.
///
/// # Errors
/// The first line that differs in each file.
fn check(root: &Path) -> Result<()> {
    let mut wrong = Vec::new();
    for (path, text) in generate(root)? {
        let kept = fs::read_to_string(root.join(path)).with_context(|| path.to_owned())?;
        wrong.extend(difference(path, &kept, &text));
    }
    ensure!(wrong.is_empty(), "{}\nwrite the files with `{COMMAND}`", wrong.join("\n"));
    Ok(())
}

/// The first line in which a file is not what it should be.
fn difference(path: &str, kept: &str, text: &str) -> Option<String> {
    let line = kept.lines().zip(text.lines()).take_while(|(kept, text)| kept == text).count();
    let shown = |text: &str| text.lines().nth(line).unwrap_or("(end of file)").trim().to_owned();
    (kept != text).then(|| format!("{path}:{}: {:?} instead of {:?}", line + 1, shown(kept), shown(text)))
}

/// Replaces the line `@name@` of a template.
fn fill(template: &str, parts: &[(&str, String)]) -> Result<String> {
    let mut text = template.to_owned();
    for (name, part) in parts {
        let mark = format!("@{name}@\n");
        if text.matches(&mark).count() != 1 {
            bail!("the template has not one line @{name}@");
        }
        text = text.replace(&mark, part);
    }
    Ok(text)
}

/// `JointState` as `joint_state`.
fn snake(name: &str) -> String {
    let mut snake = String::new();
    for letter in name.chars() {
        if letter.is_ascii_uppercase() && !snake.is_empty() {
            snake.push('_');
        }
        snake.push(letter.to_ascii_lowercase());
    }
    snake
}

/// `JointState` as `JOINT_STATE`.
fn upper(name: &str) -> String {
    snake(name).to_uppercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn committed_files_are_those_of_the_messages() {
        check(workspace().expect("the workspace")).expect("no difference");
    }

    #[test]
    fn first_line_that_differs_is_named() {
        assert_eq!(difference("f", "a\nb\n", "a\nb\n"), None);
        assert_eq!(difference("f", "a\nb\n", "a\nc\n").expect("differs"), "f:2: \"b\" instead of \"c\"");
        assert!(difference("f", "a\n", "a\nb\n").expect("differs").starts_with("f:2: \"(end of file)\""));
        assert!(difference("f", "a", "a\n").is_some());
    }

    #[test]
    fn template_needs_each_mark_once() {
        let part = [("messages", "a\n".to_owned())];
        assert_eq!(fill("x\n@messages@\ny\n", &part).expect("one mark"), "x\na\ny\n");
        assert!(fill("x\n", &part).is_err());
        assert!(fill("@messages@\n@messages@\n", &part).is_err());
    }
}
