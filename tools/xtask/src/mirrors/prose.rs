//! Doc comments of Rust as comments of another language.

use anyhow::{Result, ensure};
use std::collections::BTreeMap;

use super::schema::{Bit, Bits, Enumeration, EnumerationValue, Field, Message, Schema};

/// Longest line \[characters\].
const LINE: usize = 120;
/// Beginnings of lines that are more than prose.
const MARKS: [&str; 5] = ["* ", "- ", "# ", "| ", "```"];

/// How a language names what a doc comment refers to.
pub(crate) trait Naming {
    fn constant(&self, name: &str) -> String;
    fn bits(&self, bits: &Bits) -> String;
    fn bit(&self, bits: &Bits, bit: &Bit) -> String;
    fn enumeration(&self, enumeration: &Enumeration) -> String;
    fn value(&self, enumeration: &Enumeration, value: &EnumerationValue) -> String;
    fn message(&self, message: &Message) -> String;
    fn field(&self, message: &Message, field: &Field) -> String {
        format!("{}.{}", self.message(message), field.name)
    }
}

/// Names of Rust, and what a language has in their place.
#[derive(Debug, Default)]
pub(crate) struct Words(BTreeMap<String, String>);

impl Words {
    pub(crate) fn new(schema: &Schema, naming: &impl Naming) -> Words {
        let mut words = BTreeMap::new();
        for constant in &schema.constants {
            words.insert(constant.name.clone(), naming.constant(&constant.name));
        }
        for bits in &schema.bits {
            words.insert(bits.module.clone(), naming.bits(bits));
            for bit in &bits.bits {
                words.insert(format!("{}::{}", bits.module, bit.name), naming.bit(bits, bit));
            }
        }
        for enumeration in &schema.enumerations {
            words.insert(enumeration.name.clone(), naming.enumeration(enumeration));
            for value in &enumeration.variants {
                words.insert(format!("{}::{}", enumeration.name, value.name), naming.value(enumeration, value));
            }
        }
        for message in &schema.messages {
            words.insert(message.name.clone(), naming.message(message));
            for field in &message.fields {
                words.insert(format!("{}::{}", message.name, field.name), naming.field(message, field));
            }
        }
        Words(words)
    }

    /// A doc comment as paragraphs, without the marks of rustdoc.
    ///
    /// # Errors
    /// It is missing, has a list or a heading, or a path that names nothing.
    pub(crate) fn paragraphs(&self, doc: &str) -> Result<Vec<String>> {
        ensure!(!doc.is_empty(), "a doc comment is missing");
        let mut paragraphs = Vec::new();
        for paragraph in doc.split("\n\n") {
            let marked = paragraph.lines().find(|line| MARKS.iter().any(|mark| line.starts_with(mark)));
            ensure!(
                marked.is_none(),
                "{:?}: C and Python have no lists, tables and headings",
                marked.unwrap_or_default()
            );
            paragraphs.push(self.paragraph(&paragraph.replace('\n', " "))?);
        }
        Ok(paragraphs)
    }

    fn paragraph(&self, paragraph: &str) -> Result<String> {
        let paragraph = without_links(paragraph);
        let mut text = String::new();
        for (place, part) in paragraph.split('`').enumerate() {
            if place % 2 == 0 {
                text.push_str(&part.replace("\\[", "[").replace("\\]", "]"));
            } else {
                text.push_str(&self.code(part)?);
            }
        }
        // The article of a Rust name need not be that of another.
        Ok(["RIVET_", "rivet_"].iter().fold(text, |text, name| {
            text.replace(&format!("An {name}"), &format!("A {name}"))
                .replace(&format!("an {name}"), &format!("a {name}"))
        }))
    }

    fn code(&self, code: &str) -> Result<String> {
        let is_path = code.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == ':');
        match self.0.get(code) {
            Some(name) => Ok(name.clone()),
            None if !is_path => Ok(format!("`{code}`")),
            None => {
                ensure!(!code.contains("::"), "`{code}` names nothing that the mirrors have");
                Ok(code.to_owned())
            }
        }
    }
}

/// A link of rustdoc as its text: that of [`A`] or [`A`](super::A) is `A`.
fn without_links(text: &str) -> String {
    let mut rest = text;
    let mut plain = String::new();
    while let Some((before, link)) = rest.split_once("[`") {
        let Some((code, after)) = link.split_once("`]") else { break };
        plain.extend([before, "`", code, "`"]);
        rest = match after.strip_prefix('(').and_then(|target| target.split_once(')')) {
            Some((_, after)) => after,
            None => after,
        };
    }
    plain + rest
}

/// Breaks paragraphs into lines that fit; `width` is what stands before each. An empty line divides paragraphs.
pub(crate) fn lines(paragraphs: &[String], width: usize) -> Vec<String> {
    let mut lines = Vec::new();
    for paragraph in paragraphs {
        if !lines.is_empty() {
            lines.push(String::new());
        }
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            if !line.is_empty() && width + line.chars().count() + 1 + word.chars().count() > LINE {
                lines.push(std::mem::take(&mut line));
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
        lines.push(line);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words() -> Words {
        let pairs = [
            ("InputFault", "RIVET_INPUT_FAULT_*"),
            ("Health", "rivet_health_v7"),
            ("Health::mode", "rivet_health_v7.mode"),
        ];
        Words(pairs.map(|(rust, other)| (rust.to_owned(), other.to_owned())).into())
    }

    #[test]
    fn names_and_units_lose_the_marks_of_rustdoc() {
        let paragraph = |doc: &str| words().paragraphs(doc).expect("sound").join("|");
        assert_eq!(paragraph("An [`InputFault`]: `seq` \\[ns\\]."), "A RIVET_INPUT_FAULT_*: seq [ns].");
        assert_eq!(
            paragraph("As of [`Health`](super::Health), see\n[`Health::mode`]."),
            "As of rivet_health_v7, see rivet_health_v7.mode."
        );
        assert_eq!(paragraph("See `[log] torque_is`.\n\nMore."), "See `[log] torque_is`.|More.");
    }

    #[test]
    fn comments_that_cannot_be_mirrored_are_refused() {
        for doc in ["", "See [`Health::none`].", "One:\n* two", "# Head"] {
            assert!(words().paragraphs(doc).is_err(), "{doc:?}");
        }
    }

    #[test]
    fn lines_fit_with_what_stands_before_them() {
        let text = [["word"; 60].join(" "), "end".to_owned()];
        let broken = lines(&text, 7);
        assert!(broken.iter().all(|line| line.len() + 7 <= LINE), "{broken:?}");
        assert_eq!(broken.join(" ").split_whitespace().count(), 61);
        assert_eq!(broken[broken.len() - 2..], ["", "end"]);
    }
}
