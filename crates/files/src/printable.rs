//! Text of files as a terminal may show it.

use std::borrow::Cow;
use std::fmt;
use std::io::{self, Write as _};

/// Whether a terminal would act on a character, show the text in another order, or show nothing, so that two names look alike: C0 and C1
/// controls, DEL, line and paragraph separators, format characters (Cf of Unicode 16), and fillers and selectors without a width.
pub fn is_unsafe(c: char) -> bool {
    c.is_control() || is_format(c) || is_invisible(c)
}

/// Unicode's category Cf, line and paragraph separators.
fn is_format(c: char) -> bool {
    matches!(c,
        '\u{ad}' | '\u{600}'..='\u{605}' | '\u{61c}' | '\u{6dd}' | '\u{70f}' | '\u{890}' | '\u{891}' | '\u{8e2}' | '\u{180e}'
        | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}'
        | '\u{110bd}' | '\u{110cd}' | '\u{13430}'..='\u{1343f}' | '\u{1bca0}'..='\u{1bca3}' | '\u{1d173}'..='\u{1d17a}'
        | '\u{e0000}'..='\u{e007f}')
}

/// Characters of other categories that show nothing: joiners, Hangul fillers, inherent vowels of Khmer, selectors of variants.
fn is_invisible(c: char) -> bool {
    matches!(c,
        '\u{34f}' | '\u{115f}' | '\u{1160}' | '\u{17b4}' | '\u{17b5}' | '\u{180b}'..='\u{180f}' | '\u{2800}' | '\u{3164}'
        | '\u{fe00}'..='\u{fe0f}' | '\u{ffa0}' | '\u{e0100}'..='\u{e01ef}')
}

/// The text with every unsafe character as its escape: `\n`, `\t`, `\u{9b}`. Text without one is not copied.
///
/// ```
/// assert_eq!(rivet_files::printable("a\u{9b}31mb\n"), "a\\u{9b}31mb\\n");
/// ```
pub fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(is_unsafe) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        // `escape_default` is no choice: it escapes letters beyond ASCII too.
        if is_unsafe(c) && matches!(c, '\n' | '\r' | '\t') {
            out.extend(c.escape_default());
        } else if is_unsafe(c) {
            out.extend(c.escape_unicode());
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// Shows another value with its unsafe characters escaped. Line feeds are kept: an error may have several lines.
pub struct Printable<T>(pub T);

impl<T: fmt::Display> fmt::Display for Printable<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = self.0.to_string();
        for (k, line) in text.split('\n').enumerate() {
            if k > 0 {
                f.write_str("\n")?;
            }
            f.write_str(&printable(line))?;
        }
        Ok(())
    }
}

/// A line on standard error, its unsafe characters escaped. One that is closed or full loses the line, and nothing else.
pub fn note(text: impl fmt::Display) {
    note_after("", text);
}

/// The same after a label of the program's own, which may have styles.
pub fn note_after(label: &str, text: impl fmt::Display) {
    // One write a line: lines of several processes on one terminal do not mix.
    let line = format!("{}{label}{}\n", crate::status_line::cleared(), Printable(text));
    let _ = io::stderr().write_all(line.as_bytes());
}

/// Writes to standard output as it is: the text was made printable before. A reader that has seen enough (`| head`) is no failure.
///
/// # Errors
/// It cannot be written: a full disk, a closed descriptor. The error names standard output.
pub fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(why) if why.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(why) => Err(io::Error::new(why.kind(), format!("standard output cannot be written: {why}"))),
        Ok(()) => Ok(()),
    }
}

/// Whether the arguments of this process can be shown as they are: a file's name may be one of them.
pub fn arguments_are_printable() -> bool {
    !std::env::args_os().any(|argument| argument.to_string_lossy().contains(is_unsafe))
}

/// A JSON text in which characters that are unsafe on a terminal stand as JSON's escapes: the same document.
///
/// ```
/// assert_eq!(rivet_files::printable_json("\"a\u{9b}31mb\"\n".to_owned()), "\"a\\u009b31mb\"\n");
/// ```
pub fn printable_json(text: String) -> String {
    let unsafe_here = |c: char| is_unsafe(c) && c != '\n';
    if !text.contains(unsafe_here) {
        return text;
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if unsafe_here(c) {
            // Outside strings JSON has none but white space, which serde_json does not write. Writing to a string cannot fail.
            for unit in c.encode_utf16(&mut [0; 2]) {
                let _ = fmt::Write::write_fmt(&mut out, format_args!("\\u{unit:04x}"));
            }
        } else {
            out.push(c);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_every_control_and_override() {
        let controls = (0..=0x1f).chain(0x7f..=0x9f).chain(0x202a..=0x202e).chain(0x2066..=0x2069);
        for c in controls.filter_map(char::from_u32) {
            let shown = printable(&format!("a{c}b")).into_owned();
            assert!(shown.starts_with("a\\") && shown.is_ascii() && !shown.contains(c), "{shown:?}");
        }
        for c in
            ['\u{ad}', '\u{200b}', '\u{200d}', '\u{2060}', '\u{feff}', '\u{3164}', '\u{fe0f}', '\u{e0041}', '\u{13430}']
        {
            let shown = printable(&format!("a{c}b")).into_owned();
            assert_eq!(shown, format!("a\\u{{{:x}}}b", u32::from(c)));
            let json = printable_json(format!("\"a{c}b\""));
            assert!(json.is_ascii() && json.starts_with("\"a\\u"), "{json}");
        }
        assert_eq!(printable_json("\u{e0041}".to_owned()), "\\udb40\\udc41");
        assert!(matches!(printable("Gelenk ü 関節"), Cow::Borrowed(_)));
        assert_eq!(Printable("a\n\u{1b}[2J").to_string(), "a\n\\u{1b}[2J");
    }
}
