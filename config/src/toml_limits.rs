//! Limits of a robot file's text, checked in one pass without recursion before the TOML parser sees it.

/// Longest robot file \[bytes\]. One with eight joints, all sections and all identified parameters has 20 kB.
pub(crate) const MAX_BYTES: usize = 256 << 10;
/// Most brackets and braces inside each other. The deepest value, `identified.parameters`, needs 2.
const MAX_DEPTH: usize = 32;
/// Most dots of one key. The longest, `effects.<name>.<key>`, has 2.
const MAX_DOTS: usize = 16;

/// The byte where a text exceeds a limit, and the rule it breaks.
pub(crate) type Excess = (usize, String);

/// Checks length, nesting and dotted keys. Text that is no TOML passes: the parser names the fault.
pub(crate) fn ensure_bounded(text: &str) -> Result<(), Excess> {
    if text.len() > MAX_BYTES {
        return Err((0, format!("the file has {} bytes; at most {MAX_BYTES} are allowed", text.len())));
    }
    let bytes = text.as_bytes();
    let (mut at, mut depth, mut dots) = (0, 0_usize, 0_usize);
    // Inside a bare word a quote opens no string.
    let mut word = false;
    while let Some(&byte) = bytes.get(at) {
        match byte {
            b'#' => (at, dots) = (line_end(bytes, at), 0),
            b'"' | b'\'' if !word => {
                at = string_end(bytes, at);
                continue;
            }
            b'[' | b'{' => (depth, dots) = (depth + 1, 0),
            b']' | b'}' => (depth, dots) = (depth.saturating_sub(1), 0),
            b'=' | b',' | b'\n' => dots = 0,
            b'.' => dots += 1,
            _ => {}
        }
        word = !b" \t\r\n=,.[]{}#".contains(&byte);
        if depth > MAX_DEPTH {
            return Err((at, format!("brackets are nested more than {MAX_DEPTH} deep")));
        }
        if dots > MAX_DOTS {
            return Err((at, format!("a key has more than {MAX_DOTS} dots")));
        }
        at += 1;
    }
    Ok(())
}

/// The line feed at or after `at`, or the end.
fn line_end(bytes: &[u8], at: usize) -> usize {
    bytes[at..].iter().position(|b| *b == b'\n').map_or(bytes.len(), |i| at + i)
}

/// Behind the string that begins at `at`; behind its line where one of a single line is not closed.
fn string_end(bytes: &[u8], at: usize) -> usize {
    let quote = bytes[at];
    let long = bytes[at..].starts_with(&[quote; 3]);
    let mut i = at + if long { 3 } else { 1 };
    while let Some(&byte) = bytes.get(i) {
        match byte {
            b'\\' if quote == b'"' && (long || bytes.get(i + 1) != Some(&b'\n')) => i += 1,
            b'\n' if !long => return i,
            _ if byte == quote && !long => return i + 1,
            _ if byte == quote && bytes[i..].starts_with(&[quote; 3]) => return i + 3,
            _ => {}
        }
        i += 1;
    }
    bytes.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_is_nested_too_deep() {
        let many = MAX_DEPTH + 1;
        for text in [
            format!("a = {}", "[".repeat(many)),
            format!("a = {}1{}", "[".repeat(many), "]".repeat(many)),
            format!("a = {}", "{ b = ".repeat(many)),
            format!("a = {}", "[{ b = ".repeat(many / 2 + 1)),
            format!("{} = 1", vec!["a"; MAX_DOTS + 2].join(".")),
            format!("[{}]", vec!["\"a\""; MAX_DOTS + 2].join(" . ")),
            format!("a = {{ {} = 1 }}", vec!["'a'"; MAX_DOTS + 2].join(".")),
            format!("a = [1'{}", "[".repeat(many)),
            format!("a = \"\\\nb = {}", "[".repeat(many)),
            "a".repeat(MAX_BYTES + 1),
        ] {
            assert!(ensure_bounded(&text).is_err(), "{}", &text[..text.len().min(80)]);
        }
    }

    #[test]
    fn strings_comments_and_neighbours_do_not_count() {
        let open = "[{.".repeat(100);
        for text in [
            format!("# {open}\na = 1"),
            format!("a = '{open}'\nb = \"\\\"{open}\""),
            format!("a = \"\"\"\n{open}\"\"\"\nb = '''\n{open}'''"),
            "a = [1.0, 2.0]\n".repeat(1000),
            format!("a = [{}]", "0.5, ".repeat(1000)),
        ] {
            assert_eq!(ensure_bounded(&text), Ok(()), "{}", &text[..20]);
        }
    }
}
