//! The page of a diagnosis that was written as JSON: `cargo run -p rivet-report --example page -- FILE.json [SCORES.json]`.

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut files = std::env::args().skip(1);
    let file = files.next().ok_or("the JSON of a diagnosis is wanted")?;
    let document = serde_json::from_str(&std::fs::read_to_string(file)?)?;
    let scores = match files.next() {
        Some(scores) => serde_json::from_str(&std::fs::read_to_string(scores)?)?,
        None => Vec::new(),
    };
    print!("{}", rivet_report::page(&document, &scores));
    Ok(())
}
