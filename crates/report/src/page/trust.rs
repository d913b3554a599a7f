//! How good the procedure is, on cases with answers.

use std::fmt::Write as _;

use super::html::{Table, escape, figure};
use super::plot::{Axis, Plot};
use crate::scores::Score;
use crate::words::{effect, list};

pub(super) fn trust(scores: &[Score]) -> String {
    let mut out = String::from(
        "<p>The same procedure on simulated arms with effects unknown to it (<code>rivet blind run</code>, then \
         <code>rivet blind score --json</code>). The practice sets come from another program, the others from \
         <code>rivet blind make</code>, whose physics differs from the forms that a diagnosis fits. The practice \
         sets were used during development, <code>never seen</code> was not. Expect the latter on your arms, or \
         less.</p>\n",
    );
    if scores.is_empty() {
        return "<p>No scores of this build are available.</p>\n".to_owned();
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
    row("effects named, or in the class of a name", &|s| of(s.named(), s.visible()));
    row("right joint, of those", &|s| of(s.right_joint, s.named()));
    row("false alarms where nothing was wrong", &|s| {
        s.outcome("nothing").map_or_else(|| "-".to_owned(), |o| of(o.cases - o.right, o.cases))
    });
    row("effects outside the library that got a name", &|s| {
        s.outcome("outside").map_or_else(|| "-".to_owned(), |o| of(o.cases - o.right, o.cases))
    });
    row("false positives", &|s| s.beside.to_string());
    row("names with a class, and its other members", &|s| format!("{}, {}", of(s.classes, s.names), s.class_members));
    row("shrink predicted within five points", &|s| of(s.close, s.predictions));
    row("shrink within its 90 % interval", &|s| of(s.covered, s.predictions));
    out += &table.html();
    for score in scores {
        let caption = format!("{}: verdict for each effect", score.set);
        let head =
            ["Truth", "Cases", "Its name", "In its class", "Another name", "Unexplained", "Nothing", "Wrong names"];
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
        let (sure, scatter) = (confidence(score), shrinks(score));
        let _ = writeln!(
            out,
            "<details><summary>Confusion matrix: {} ({} cases, rivet {})</summary>{}{sure}{scatter}<p class=\"soft\">In \
             the rows of nothing wrong and outside the library, \u{201c}its name\u{201d} counts cases that rightly \
             have none. {} effects too weak to be seen are not counted.</p></details>",
            escape(&score.set),
            score.cases,
            escape(&score.version),
            table.html(),
            score.invisible
        );
    }
    out
}

/// Whether causes are right as often as they are said to be sure.
fn confidence(score: &Score) -> String {
    let caption = format!("{}: confidence and observed rate", score.set);
    let mut table = Table::new(&caption, &["Confidence", "Names", "Right", "Share"]);
    for bin in score.confidence.iter().filter(|bin| bin.count > 0) {
        let share = bin.right as f64 / bin.count as f64;
        table.row(&[format!("{:.2}", bin.mean), bin.count.to_string(), bin.right.to_string(), format!("{share:.2}")]);
    }
    if table.is_empty() { String::new() } else { table.html() }
}

/// Predicted beside measured shrink of every cause; what lies on the diagonal came as predicted.
fn shrinks(score: &Score) -> String {
    if score.shrinks.is_empty() {
        return String::new();
    }
    // What made things worse by more than a half is drawn at the edge.
    let within = |v: f64| v.clamp(-0.5, 1.0);
    let mut plot = Plot::new(360.0, 300.0, Axis::fixed(-0.5, 1.02), Axis::fixed(-0.5, 1.02));
    plot.line([(-0.5, -0.5), (1.0, 1.0)].into_iter(), "found");
    for shrink in &score.shrinks {
        plot.dot(within(shrink.predicted), within(shrink.measured));
    }
    let said = format!("{} of {} causes within five points of their prediction", score.close, score.predictions);
    let caption = format!("{}: shrink of the gap by each cause, predicted and then measured.", score.set);
    figure(&plot.svg("predicted", "measured", &said), &caption)
}
