//! How good the procedure is, on cases with answers.

use std::fmt::Write as _;

use super::html::{Table, escape};
use crate::scores::Score;
use crate::words::{effect, list};

pub(super) fn trust(scores: &[Score]) -> String {
    let mut out = String::from(
        "<p>The same procedure on arms that an independent program simulated, with effects it was not told \
         (<code>rivet blind run</code>, then <code>rivet blind score --json</code>). The cases were looked at while the \
         procedure was built: expect somewhat less on others.</p>\n",
    );
    if scores.is_empty() {
        return "<p>No score of this build is at hand.</p>\n".to_owned();
    }
    let of = |part: usize, whole: usize| format!("{part} of {whole}");
    let mut head = vec!["What counts"];
    head.extend(scores.iter().map(|s| s.set.as_str()));
    let mut table = Table::new("In short", &head);
    let mut row = |name: &str, f: &dyn Fn(&Score) -> String| {
        let mut cells = vec![name.to_owned()];
        cells.extend(scores.iter().map(f));
        table.row(&cells);
    };
    row("effects named, or in a class that holds them", &|s| of(s.named(), s.visible()));
    row("right joint, of those", &|s| of(s.right_joint, s.named()));
    row("false alarms where nothing was wrong", &|s| {
        s.outcome("nothing").map_or_else(|| "-".to_owned(), |o| of(o.cases - o.right, o.cases))
    });
    row("effects outside the library that got a name", &|s| {
        s.outcome("outside").map_or_else(|| "-".to_owned(), |o| of(o.cases - o.right, o.cases))
    });
    row("names beside the truth", &|s| s.beside.to_string());
    row("shrink predicted within five points", &|s| of(s.close, s.predictions));
    row("shrink within its 90 % interval", &|s| of(s.covered, s.predictions));
    out += &table.html();
    for score in scores {
        let caption = format!("{}: what was said of each effect", score.set);
        let head = [
            "Truth",
            "Cases",
            "Its name",
            "In its class",
            "Another name",
            "Unexplained",
            "Nothing",
            "Names said instead",
        ];
        let mut table = Table::new(&caption, &head);
        for o in &score.outcomes {
            let truth = match o.truth.as_str() {
                "nothing" => "nothing wrong".to_owned(),
                "outside" => "outside the library".to_owned(),
                name => effect(name),
            };
            let rightly = |n: usize| if n == 0 { String::new() } else { n.to_string() };
            let instead: Vec<String> = o.said_instead.iter().map(|e| effect(e)).collect();
            table.row(&[
                truth,
                o.cases.to_string(),
                rightly(o.right),
                rightly(o.in_class),
                rightly(o.wrong),
                rightly(o.unexplained),
                rightly(o.missed),
                list(&instead),
            ]);
        }
        let _ = writeln!(
            out,
            "<details><summary>Confusion matrix: {} ({} cases, rivet {})</summary>{}<p class=\"soft\">Of nothing and outside, \
             \u{201c}its name\u{201d} counts cases rightly left without one. {} effects too weak to be seen are not counted.</p></details>",
            escape(&score.set),
            score.cases,
            escape(&score.version),
            table.html(),
            score.invisible
        );
    }
    out
}
