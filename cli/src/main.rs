//! rivet
fn main() {}
