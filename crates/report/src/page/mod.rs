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
use crate::words::verdict_of;
use html::escape;

const STYLE: &str = include_str!("style.css");

/// A section: its anchor, its heading, its content, and whether that is folded away until asked for.
struct Section {
    id: &'static str,
    title: &'static str,
    body: String,
    folded: bool,
}

impl Section {
    fn open(id: &'static str, title: &'static str, body: String) -> Section {
        Section { id, title, body, folded: false }
    }

    fn folded(id: &'static str, title: &'static str, body: String) -> Section {
        Section { folded: true, ..Section::open(id, title, body) }
    }

    /// A link to a folded section opens nothing everywhere, so the heading itself is what opens it.
    fn html(&self) -> String {
        let (id, title, body) = (self.id, escape(self.title), &self.body);
        let heading = format!("<h2 id=\"{id}-h\">{title}</h2>");
        let inside = if self.folded {
            format!("<details><summary>{heading}</summary>\n{body}</details>\n")
        } else {
            format!("{heading}\n{body}")
        };
        format!("<section id=\"{id}\" aria-labelledby=\"{id}-h\">{inside}</section>\n")
    }
}

/// The page of a diagnosis. `scores` say how good the same procedure was on cases whose answers are known. What a reader needs to act on
/// stands open: the causes, the gap and where it lies. What stands behind it is folded.
pub fn page(document: &Document, scores: &[Score]) -> String {
    let mut sections = Vec::new();
    if document.remark.is_none() || document.needs_other_motion() {
        sections.push(Section::open("which", "Which effect", causes::causes(document)));
        sections.push(Section::open("how-far", "How far the gap shrinks", sections::stages(document)));
        sections.push(Section::open("ledger", "The gap, joint by joint", sections::ledger(document)));
        sections.push(Section::open("where", "Where", sections::place(document) + &views::views(document)));
        sections.push(Section::folded("closed-loop", "In closed loop", rollout::rollout(document)));
        sections.push(Section::folded("left", "Residual", left::left(document)));
        sections.push(Section::folded("parameters", "Parameters", sections::parameters(document)));
        sections.push(Section::folded("patch", "Patch", patch::patch(document)));
    }
    sections.push(Section::folded("power", "What these logs could show", power::power(document)));
    sections.push(Section::folded("trust", "How far to trust this", trust::trust(scores)));
    sections.push(Section::folded("passport", "Passport", sections::passport(document)));
    sections.retain(|s| !s.body.is_empty());
    let (mut entries, mut body) = (String::new(), String::new());
    for section in &sections {
        // Writing to a String cannot fail.
        let _ = write!(entries, "<li><a href=\"#{}\">{}</a></li>", section.id, escape(section.title));
        body += &section.html();
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
        verdict = escape(&verdict_of(document)),
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
