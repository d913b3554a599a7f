//! The table of ratios.

use std::fmt::Write as _;

/// One comparison. Times in the unit of the table.
pub(crate) struct Item {
    pub(crate) name: String,
    pub(crate) rivet: Option<f64>,
    pub(crate) peer: Option<f64>,
    /// Ratio peer/rivet that must be held, and the one that is aimed at.
    pub(crate) goal: Option<(f64, f64)>,
}

/// The items as a table in Markdown.
pub(crate) fn markdown(title: &str, items: &[Item]) -> String {
    let mut out = format!("| {title} | rivet | peer | ratio | minimum (goal) |\n|---|---:|---:|---:|---|\n");
    for item in items {
        let number = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.*}", usize::from(x < 100.0)));
        let ratio = item.rivet.zip(item.peer).map(|(rivet, peer)| peer / rivet);
        let goal = item.goal.map_or(String::new(), |(least, goal)| {
            let reached = match ratio {
                None => "",
                Some(ratio) if ratio >= goal => ": goal reached",
                Some(ratio) if ratio >= least => ": reached",
                Some(_) => ": NOT reached",
            };
            format!("{least:.0} ({goal:.0}){reached}")
        });
        let ratio = ratio.map_or("-".to_owned(), |ratio| format!("{ratio:.1}"));
        let _ = writeln!(out, "| {} | {} | {} | {ratio} | {goal} |", item.name, number(item.rivet), number(item.peer));
    }
    out
}
