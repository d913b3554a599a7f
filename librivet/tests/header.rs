//! The C header says what the code says, and C and C++ compile it.

use std::path::{Path, PathBuf};

/// Set to write the header anew.
const WRITE: &str = "LIBRIVET_WRITE_HEADER";

fn here(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn generated() -> String {
    let config = cbindgen::Config::from_file(here("cbindgen.toml")).expect("a sound configuration");
    let sources = ["src/abi.rs", "src/robot.rs", "src/sample.rs", "src/status.rs"];
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in sources {
        builder = builder.with_src(here(source));
    }
    let mut bytes = Vec::new();
    builder.generate().expect("bindings").write(&mut bytes);
    String::from_utf8(bytes).expect("text").replace(" # Safety\n", " Pointers:\n")
}

#[test]
fn the_header_is_the_one_that_the_code_gives() {
    let (path, text) = (here("include/librivet.h"), generated());
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(&path, text).expect("written");
        return;
    }
    let kept = std::fs::read_to_string(&path).expect("the header is there");
    let different = kept.lines().zip(text.lines()).position(|(kept, generated)| kept != generated);
    let line = different.map_or(kept.lines().count().min(text.lines().count()) + 1, |line| line + 1);
    assert!(
        kept == text,
        "include/librivet.h differs from the code from line {line} on; write it anew with {WRITE}=1 cargo test -p librivet --test header"
    );
}
