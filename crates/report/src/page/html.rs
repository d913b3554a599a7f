//! Pieces of HTML.

use std::fmt::Write as _;

/// What a terminal must not show, but line feeds and tabs: a name with one reads as another name.
pub(crate) fn is_unsafe(c: char) -> bool {
    rivet_files::is_unsafe(c) && !matches!(c, '\n' | '\t')
}

/// Text with everything escaped that means something to HTML, and with control characters shown.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if is_unsafe(c) => out.extend(c.escape_unicode()),
            c => out.push(c),
        }
    }
    out
}

/// A table that can be scrolled where the screen is narrow, by keyboard too.
pub(crate) struct Table {
    caption: String,
    class: &'static str,
    head: Vec<String>,
    rows: Vec<String>,
}

impl Table {
    pub(crate) fn new(caption: &str, head: &[&str]) -> Table {
        let head = head.iter().map(|h| escape(h)).collect();
        Table { caption: caption.to_owned(), class: "", head, rows: Vec::new() }
    }

    pub(crate) fn class(mut self, class: &'static str) -> Table {
        self.class = class;
        self
    }

    /// A row of text: the first cell is the row's header.
    pub(crate) fn row(&mut self, cells: &[String]) {
        let mut row = String::new();
        for (k, cell) in cells.iter().enumerate() {
            let cell = escape(cell);
            let _ = if k == 0 { write!(row, "<th scope=\"row\">{cell}</th>") } else { write!(row, "<td>{cell}</td>") };
        }
        self.rows.push(row);
    }

    /// A row of finished cells.
    pub(crate) fn raw(&mut self, cells: String) {
        self.rows.push(cells);
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(crate) fn html(&self) -> String {
        let mut out = format!(
            "<p class=\"caption\">{0}</p><div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{0}\">\
             <table class=\"{1}\" aria-label=\"{0}\"><thead><tr>",
            escape(&self.caption),
            self.class
        );
        for head in &self.head {
            let _ = write!(out, "<th scope=\"col\">{head}</th>");
        }
        out.push_str("</tr></thead><tbody>");
        for row in &self.rows {
            let _ = write!(out, "<tr>{row}</tr>");
        }
        out.push_str("</tbody></table></div>\n");
        out
    }
}

/// A figure with what it says in words.
pub(crate) fn figure(svg: &str, caption: &str) -> String {
    format!("<figure>{svg}<figcaption>{}</figcaption></figure>\n", escape(caption))
}

/// A list of terms.
pub(crate) fn facts(pairs: &[(&str, String)]) -> String {
    let each = |(name, value): &(&str, String)| format!("<dt>{}</dt><dd>{}</dd>", escape(name), escape(value));
    format!("<dl class=\"facts\">{}</dl>\n", pairs.iter().map(each).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_and_joints_are_text_and_nothing_else() {
        let mut table = Table::new("a<b", &["x & y"]);
        table.row(&["<script>alert(\"1\")</script>".to_owned(), "1".to_owned()]);
        let html = table.html();
        assert!(!html.contains("<script") && html.contains("a&lt;b") && html.contains("x &amp; y"), "{html}");
    }
}
