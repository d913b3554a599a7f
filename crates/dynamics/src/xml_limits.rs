//! Limits of an XML text, checked in one pass without recursion before any parser sees it.
//!
//! The parsers of URDF and MJCF recurse with the nesting, or compare every attribute of an element with every other one.

/// Most elements inside each other. A URDF needs 5; MJCF nests a body a joint, [`MAX_JOINTS`](crate::MAX_JOINTS) at most.
const MAX_DEPTH: usize = 64;
/// Most elements of a file. A humanoid with all its meshes has some 3000.
const MAX_ELEMENTS: usize = 50_000;
/// Most comments, processing instructions and CDATA sections of a file: a parser keeps each, and the text between them.
const MAX_ASIDES: usize = 50_000;
/// Most attributes of an element. URDF and MJCF elements have at most 20.
const MAX_ATTRIBUTES: usize = 64;
/// Longest tag with its attributes \[bytes\].
const MAX_TAG_BYTES: usize = 64 << 10;

/// Which limit a text exceeds, and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {what}; at most {limit} are allowed")]
pub struct XmlExcess {
    /// Line, from 1.
    pub line: usize,
    /// What there is too much of.
    pub what: &'static str,
    /// How much is allowed.
    pub limit: usize,
}

/// Checks nesting, number of elements and of comments, attributes an element and length of a tag. Malformed XML passes: the parser names the fault.
///
/// # Errors
/// The first limit that is exceeded. A document type with declarations of its own is refused, since entities expand.
pub(crate) fn ensure_bounded(text: &str) -> Result<(), XmlExcess> {
    let bytes = text.as_bytes();
    let excess = |at: usize, what, limit| {
        let line = text[..at].matches('\n').count() + 1;
        Err(XmlExcess { line, what, limit })
    };
    let (mut at, mut depth, mut elements, mut asides) = (0, 0_usize, 0_usize, 0_usize);
    while let Some(step) = text[at..].find('<') {
        let start = at + step;
        let rest = &text[start..];
        let skip = |end: &str| rest.find(end).map_or(bytes.len(), |i| start + i + end.len());
        asides += usize::from(rest.starts_with("<!") || rest.starts_with("<?"));
        if asides > MAX_ASIDES {
            return excess(start, "comments and processing instructions", MAX_ASIDES);
        }
        if rest.starts_with("<!--") {
            at = skip("-->");
        } else if rest.starts_with("<![CDATA[") {
            at = skip("]]>");
        } else if rest.starts_with("<?") {
            at = skip("?>");
        } else if rest.starts_with("<!") {
            at = skip(">");
            if text[start..at].contains('[') {
                return excess(start, "declarations inside <!DOCTYPE>", 0);
            }
        } else {
            let tag = Tag::at(bytes, start);
            if tag.end - start > MAX_TAG_BYTES {
                return excess(start, "bytes of one element's tag", MAX_TAG_BYTES);
            }
            if tag.attributes > MAX_ATTRIBUTES {
                return excess(start, "attributes of one element", MAX_ATTRIBUTES);
            }
            at = tag.end;
            match tag.kind {
                Kind::End => depth = depth.saturating_sub(1),
                Kind::Start | Kind::Empty => {
                    elements += 1;
                    if elements > MAX_ELEMENTS {
                        return excess(start, "elements", MAX_ELEMENTS);
                    }
                    if depth + 1 > MAX_DEPTH {
                        return excess(start, "elements inside each other", MAX_DEPTH);
                    }
                    depth += usize::from(tag.kind == Kind::Start);
                }
            }
        }
    }
    Ok(())
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Start,
    Empty,
    End,
}

struct Tag {
    kind: Kind,
    attributes: usize,
    /// After its `>`.
    end: usize,
}

impl Tag {
    /// The tag that begins at byte `start`. A `>` in quotes does not end it.
    fn at(bytes: &[u8], start: usize) -> Tag {
        let (mut quote, mut attributes, mut i) = (None, 0, start + 1);
        while i < bytes.len() {
            match (bytes[i], quote) {
                (b, Some(q)) => quote = Some(q).filter(|q| *q != b),
                (b @ (b'"' | b'\''), None) => quote = Some(b),
                (b'=', None) => attributes += 1,
                (b'>', None) => break,
                _ => {}
            }
            i += 1;
        }
        let kind = match (bytes.get(start + 1), bytes[..i].last()) {
            (Some(b'/'), _) => Kind::End,
            (_, Some(b'/')) => Kind::Empty,
            _ => Kind::Start,
        };
        Tag { kind, attributes, end: (i + 1).min(bytes.len()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_each_excess_by_name() {
        let cases = [
            ("<a>".repeat(MAX_DEPTH + 1), "inside each other"),
            ("<a/>".repeat(MAX_ELEMENTS + 1), "elements"),
            (format!("<a {}/>", "b=\"\" ".repeat(MAX_ATTRIBUTES + 1)), "attributes"),
            (format!("<a b=\"{}\"/>", "x".repeat(MAX_TAG_BYTES)), "bytes"),
            ("<!---->".repeat(MAX_ASIDES + 1), "comments"),
            ("<?a?>".repeat(MAX_ASIDES + 1), "processing instructions"),
            ("<![CDATA[a]]>".repeat(MAX_ASIDES + 1), "comments"),
            ("<!DOCTYPE a [<!ENTITY b \"c\">]><a/>".to_owned(), "DOCTYPE"),
        ];
        for (text, what) in cases {
            let why = ensure_bounded(&text).expect_err(what).to_string();
            assert!(why.contains(what), "{why}");
        }
    }

    #[test]
    fn nesting_in_comments_text_and_quotes_does_not_count() {
        let hidden = "<a>".repeat(1000);
        let text = format!("<r><!--{hidden}--><![CDATA[{hidden}]]><?p {hidden}?><b c='{hidden}'/></r>");
        assert_eq!(ensure_bounded(&text), Ok(()));
        assert_eq!(ensure_bounded(&"<a></a>".repeat(1000)), Ok(()));
    }

    #[test]
    fn names_the_line() {
        let text = format!("<r>\n{}", "<a>\n".repeat(MAX_DEPTH));
        assert_eq!(ensure_bounded(&text).map_err(|e| e.line), Err(MAX_DEPTH + 1));
    }
}
