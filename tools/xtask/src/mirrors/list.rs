//! The list of messages for Rust.

use std::fmt::Write as _;

use super::COMMAND;
use super::schema::Schema;

/// The source: what the modules of messages export, and the tables of messages and enumerations.
pub(crate) fn list(schema: &Schema) -> String {
    let mut text = format!("//! Made by `{COMMAND}` from the modules beside this one. Do not edit.\n\n");
    let mut modules = schema.modules.clone();
    modules.sort();
    for module in modules {
        let _ = writeln!(text, "pub use super::{module}::*;");
    }
    text.push_str("\nuse crate::layout::{Enumeration, Layout};\n");
    let messages: Vec<_> = schema.messages.iter().map(|message| format!("{}::LAYOUT", message.name)).collect();
    let tables: Vec<_> = schema.enumerations.iter().map(|enumeration| format!("{}::TABLE", enumeration.name)).collect();
    text += &table("messages", "MESSAGES", "Layout", &messages);
    text + &table("enumerations", "ENUMERATIONS", "Enumeration", &tables)
}

fn table(what: &str, name: &str, kind: &str, rows: &[String]) -> String {
    let count = rows.len();
    format!("\n/// All {what}.\npub const {name}: [{kind}; {count}] = [\n    {},\n];\n", rows.join(",\n    "))
}
