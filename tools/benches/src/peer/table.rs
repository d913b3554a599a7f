//! The table of ratios.

/// One comparison. Times in the unit of the table.
pub(crate) struct Item {
    pub(crate) name: String,
    pub(crate) rivet: Option<f64>,
    pub(crate) peer: Option<f64>,
    /// Ratio peer/rivet that must be held, and the one that is aimed at.
    pub(crate) goal: Option<(f64, f64)>,
}

/// Prints the items, at most 100 columns wide.
pub(crate) fn print(title: &str, items: &[Item]) {
    println!("\n{title:34} {:>10} {:>10} {:>8}  {:>12}  met", "rivet", "peer", "ratio", "least (goal)");
    for item in items {
        let number = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.*}", usize::from(x < 100.0)));
        let ratio = item.rivet.zip(item.peer).map(|(rivet, peer)| peer / rivet);
        let goal = item.goal.map_or(String::new(), |(least, goal)| format!("{least:.0} ({goal:.0})"));
        let met = match item.goal.zip(ratio) {
            None => "",
            Some(((_, goal), ratio)) if ratio >= goal => "goal",
            Some(((least, _), ratio)) if ratio >= least => "yes",
            Some(_) => "NO",
        };
        let ratio = ratio.map_or(String::new(), |ratio| format!("{ratio:.1}"));
        let row = format!(
            "{:34} {:>10} {:>10} {ratio:>8}  {goal:>12}  {met}",
            item.name,
            number(item.rivet),
            number(item.peer)
        );
        println!("{}", row.trim_end());
    }
}
