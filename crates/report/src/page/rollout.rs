//! What the corrected simulator does in closed loop.

use super::html::{Table, escape};
use crate::actions::distance;
use crate::document::Document;
use crate::words::{figure, percent};

pub(super) fn rollout(document: &Document) -> String {
    let Some(rollout) = &document.rollout else { return String::new() };
    if rollout.points.is_empty() {
        return format!("<p>{}.</p>\n", escape(&capital(&rollout.text())));
    }
    let mut out = format!(
        "<p>Both simulators, nominal and corrected, from {} instants of the held-out log: they get the torque of the \
         log and a weak position loop to its motion. {}.</p>\n",
        rollout.starts,
        escape(&capital(&rollout.text()))
    );
    let head = [
        "After [s]",
        "Position error, nominal [mrad]",
        "with causes [mrad]",
        "Torque of the loop, nominal [% of each joint's]",
        "with causes [%]",
    ];
    let mut table = Table::new("Error by time since the start, root mean square over starts and joints", &head);
    for p in &rollout.points {
        table.row(&[
            figure(p.horizon_s, 2),
            distance(p.position_before_rad),
            distance(p.position_after_rad),
            percent(Some(p.torque_before)),
            percent(Some(p.torque_after)),
        ]);
    }
    out += &table.html();
    out
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use crate::verdict::tests::document;

    #[test]
    fn the_page_shows_the_rollout() {
        let point = json!({"horizon_s": 1.0, "position_before_rad": 0.04321, "position_after_rad": 0.00123,
            "torque_before": 0.2, "torque_after": 0.012});
        let rollout = json!({"closer": true, "starts": 12, "not_simulated": [], "points": [point]});
        let page = crate::page(&document(&[("rollout", rollout)]), &[]);
        for text in ["<section id=\"closed-loop\"", "43.2", "1.23", "Closer to the log in closed loop"] {
            assert!(page.contains(text), "{text}");
        }
        assert!(!crate::page(&document(&[]), &[]).contains("closed-loop"));
        let undriven =
            json!({"closer": false, "starts": 0, "not_simulated": ["the torque of j is not believed"], "points": []});
        let page = crate::page(&document(&[("rollout", undriven)]), &[]);
        assert!(
            page.contains("Torque only: the torque of j is not believed.") && !page.contains("Position error"),
            "{page}"
        );
    }
}
