//! A diagnosis as one page: HTML with its style and its charts in it, nothing to load and nothing to run.

mod causes;
mod html;
mod left;
mod patch;
mod plot;
mod power;
mod rollout;
mod sections;
mod top;
mod trust;
mod views;

use std::fmt::Write as _;

use crate::document::Document;
use crate::scores::Score;
use html::escape;

const STYLE: &str = include_str!("style.css");

/// A section: its anchor, its heading, its content.
struct Section {
    id: &'static str,
    title: &'static str,
    body: String,
}

/// The page of a diagnosis. `scores` say how good the same procedure was on cases whose answers are known.
pub fn page(document: &Document, scores: &[Score]) -> String {
    let mut sections = Vec::new();
    if document.remark.is_none() || document.needs_other_motion() {
        sections.push(Section { id: "ledger", title: "The gap, joint by joint", body: sections::ledger(document) });
        sections.push(Section {
            id: "where",
            title: "Where",
            body: sections::place(document) + &views::views(document),
        });
        sections.push(Section { id: "which", title: "Which effect", body: causes::causes(document) });
        sections.push(Section { id: "how-far", title: "How far the gap shrinks", body: sections::stages(document) });
        sections.push(Section { id: "closed-loop", title: "In closed loop", body: rollout::rollout(document) });
        sections.push(Section { id: "left", title: "Residual", body: left::left(document) });
        sections.push(Section { id: "parameters", title: "Parameters", body: sections::parameters(document) });
        sections.push(Section { id: "patch", title: "Patch", body: patch::patch(document) });
    }
    sections.push(Section { id: "power", title: "What these logs could show", body: power::power(document) });
    sections.push(Section { id: "trust", title: "How far to trust this", body: trust::trust(scores) });
    sections.push(Section { id: "passport", title: "Passport", body: sections::passport(document) });
    sections.retain(|s| !s.body.is_empty());
    let (mut entries, mut body) = (String::new(), String::new());
    for section in &sections {
        let (id, title) = (section.id, escape(section.title));
        // Writing to a String cannot fail.
        let _ = write!(entries, "<li><a href=\"#{id}\">{title}</a></li>");
        let _ = writeln!(
            body,
            "<section id=\"{id}\" aria-labelledby=\"{id}-h\"><h2 id=\"{id}-h\">{title}</h2>\n{}</section>",
            section.body
        );
    }
    let robot = escape(&document.robot);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <meta name=\"color-scheme\" content=\"light dark\"><link rel=\"icon\" href=\"data:,\">\
         <title>Diagnosis of {robot}: {verdict}</title><style>\n{STYLE}</style></head>\n<body>\
         <a class=\"skip\" href=\"#main\">To the verdict</a>\
         <header><p class=\"soft\">rivet: simulator against arm</p>\
         <h1>{robot} <span class=\"word\">{verdict}</span></h1></header>\n\
         <main id=\"main\">{lines}<nav aria-label=\"Sections\"><ul>{entries}</ul></nav>\n{body}</main>\n\
         <footer>Every figure here is in the JSON at the end of this file (schema {schema}), as \
         <code>rivet diagnose --json</code> writes it. Relative figures are of the held-out log. Colours separate \
         series and have no rank.</footer>\n\
         <script type=\"application/json\" id=\"diagnosis\">{data}</script>\n</body></html>\n",
        verdict = escape(&document.verdict.replace('_', " ")),
        lines = top::top(document, scores),
        schema = escape(&document.schema),
        data = data(document),
    )
}

/// The document itself, so that the page can be read by a program too.
fn data(document: &Document) -> String {
    // Of structs with plain fields: nothing in it can fail to be written. A `<` could end the script element, or begin a
    // comment that does not end.
    let text = serde_json::to_string(document).unwrap_or_default();
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if c == '<' || html::is_unsafe(c) {
            let _ = write!(out, "\\u{:04x}", u32::from(c));
        } else {
            out.push(c);
        }
    }
    out
}
