//! Writes `docs/diagnosis.schema.json`: `cargo run -p rivet-report --example schema > docs/diagnosis.schema.json`.

fn main() -> Result<(), serde_json::Error> {
    println!("{}", serde_json::to_string_pretty(&rivet_report::Document::schema())?);
    Ok(())
}
