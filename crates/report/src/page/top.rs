//! The top of the page: what to do, what it brings, and two pictures of it.

use super::causes::{key, stretch, worst};
use super::html::{escape, figure as framed};
use super::plot::{Axis, Plot};
use crate::actions::{LOST, distance};
use crate::document::Document;
use crate::rollout::Rollout;
use crate::scores::Score;
use crate::verdict::Line;

/// Lines of what to do that stand before the pictures: with more, those are below the first screen (1280 x 800).
const MOST_BEFORE_PICTURES: usize = 3;

pub(super) fn top(document: &Document, scores: &[Score]) -> String {
    let (behind, answer): (Vec<Line>, Vec<Line>) = document.lines(scores).into_iter().partition(|line| line.detail);
    let (answer, open): (Vec<Line>, Vec<Line>) =
        answer.into_iter().partition(|line| !["Next", "Not covered"].contains(&line.head));
    let (todo, result): (Vec<Line>, Vec<Line>) = answer.into_iter().partition(|line| line.head == "Do");
    let (first, more) = todo.split_at(todo.len().min(MOST_BEFORE_PICTURES));
    let list = |lines: &[Line]| {
        let each = |line: &Line| format!("<dt>{}</dt><dd>{}</dd>", line.head, escape(&line.text));
        lines.iter().map(each).collect::<String>()
    };
    let torque = document.figures.as_ref().and_then(|figures| worst(document, figures));
    let torque = torque.map(|excerpt| stretch(excerpt, ", where the nominal model is far off", document));
    let rollout = document.rollout.as_ref().filter(|rollout| rollout.points.len() > 1).map(errors);
    let pictures: String = [torque, rollout].into_iter().flatten().collect();
    let pictures = if pictures.is_empty() {
        String::new()
    } else {
        format!("{}<div class=\"figures wide\">{pictures}</div>\n", key(document))
    };
    let behind = if behind.is_empty() {
        String::new()
    } else {
        let lines = list(&behind);
        format!(
            "<details><summary>Cause, gap, place and shrink in figures</summary><dl class=\"verdict\">{lines}</dl></details>\n"
        )
    };
    let more = if more.is_empty() {
        String::new()
    } else {
        let lines = list(more);
        format!("<details><summary>{} more to do</summary><dl class=\"verdict\">{lines}</dl></details>\n", more.len())
    };
    let before = list(&[first, &result].concat());
    let open = if open.is_empty() { String::new() } else { format!("<dl class=\"verdict\">{}</dl>\n", list(&open)) };
    let note = if first.iter().any(|line| line.text.contains('[')) {
        "<p class=\"soft\">In brackets: 90 % interval of the size. The confidence is that of the name.</p>\n"
    } else {
        ""
    };
    format!("<dl class=\"verdict\" aria-label=\"Verdict\">{before}</dl>\n{note}{pictures}{more}{open}{behind}")
}

/// Error of both simulators by time since the start.
fn errors(rollout: &Rollout) -> String {
    // An arm that is lost has no error; its line runs along the top.
    let mrad = |rad: f64| 1e3 * rad.min(LOST);
    let points = &rollout.points;
    let x = Axis::around(points.iter().map(|p| p.horizon_s), true);
    let y = Axis::decades(points.iter().flat_map(|p| [mrad(p.position_before_rad), mrad(p.position_after_rad)]));
    let mut plot = Plot::new(420.0, 230.0, x, y);
    plot.line(points.iter().map(|p| (p.horizon_s, mrad(p.position_before_rad))), "given");
    plot.line(points.iter().map(|p| (p.horizon_s, mrad(p.position_after_rad))), "found");
    let said = points.last().map_or_else(String::new, |end| {
        format!(
            "Simulator in closed loop, {} starts: after {} s off by {} mrad, corrected model {} mrad",
            rollout.starts,
            end.horizon_s,
            distance(end.position_before_rad),
            distance(end.position_after_rad)
        )
    });
    framed(&plot.svg("time since the start [s]", "position error [mrad]", &said), &(said.clone() + "."))
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use crate::verdict::tests::{cause, document};

    /// The answer stands before the first section, its figures folded; each picture has the words of what it shows.
    #[test]
    fn the_answer_and_its_pictures_come_first() {
        // One sample at standstill that is 9 off, two in motion that are 1 off.
        let excerpt = |joint: &str| json!({"joint": joint, "from_s": 0.0, "step_s": 0.1, "measured": [9.0, 1.0, 2.0], "given": [0.0, 0.0, 1.0], "with_causes": [9.0, 1.0, 2.0], "standstill_s": [[0.0, 0.1]]});
        let gap_of = |joint: &str, before: f64| json!({"joint": joint, "before": 0.3, "after": 0.1, "noise_floor": 0.05, "in_motion": [before, 1.1]});
        let point = |at: f64| json!({"horizon_s": at, "position_before_rad": 0.04, "position_after_rad": 0.001, "torque_before": 0.2, "torque_after": 0.01});
        let more: [(&str, Value); 4] = [
            ("causes", json!([cause("joint_spring", &json!({"stiffness_Nm_rad": 8.0}))])),
            (
                "gap",
                json!({"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint": [gap_of("near", 2.0), gap_of("far", 30.0)]}),
            ),
            (
                "figures",
                json!({"floor": [], "stages": [], "parameters": [], "excerpts": [excerpt("near"), excerpt("far")], "left": [], "power": []}),
            ),
            ("rollout", json!({"closer": true, "starts": 12, "not_simulated": [], "points": [point(0.1), point(1.0)]})),
        ];
        let page = crate::page(&document(&more), &[]);
        let top = page.split("<section").next().expect("the top");
        assert!(top.contains("<dt>Do</dt><dd>Add joint spring: stiffness 8.00 N m/rad."), "{top}");
        assert!(top.contains("far: 30 \u{2192} 1.1"), "{top}");
        assert!(top.contains("residual in motion 1.00 N m rms") && top.matches("class=\"band\"").count() == 1, "{top}");
        assert_eq!(top.matches("<svg").count(), 2);
        assert!(top.contains("far, where") && !top.contains("near, where"), "the worst joint's torque: {top}");
        assert_eq!(page.matches("far, where the nominal model").count(), 2, "label and caption, once on the page");
        let (answer, behind) = top.split_once("<details>").expect("folded");
        assert!(behind.contains("<dt>Gap</dt>") && !answer.contains("<dt>Gap</dt>"));
    }

    /// Another joint may be further off: the picture is of the one to mend.
    #[test]
    fn the_picture_is_of_the_joint_that_the_cause_names() {
        let excerpt = |joint: &str| json!({"joint": joint, "from_s": 0.0, "step_s": 0.1, "measured": [1.0, 2.0], "given": [0.0, 1.0], "with_causes": [1.0, 2.0]});
        let gap = |joint: &str, before: f64| json!({"joint": joint, "before": 0.3, "after": 0.1, "noise_floor": 0.05, "in_motion": [before, 1.1]});
        let mut rotor = cause("rotor_inertia", &json!({"inertia_gain": 1.6}));
        rotor["joints"] = json!(["mended"]);
        let more = [
            ("causes", json!([rotor])),
            (
                "gap",
                json!({"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint": [gap("mended", 3.0), gap("other", 9.0)]}),
            ),
            (
                "figures",
                json!({"floor": [], "stages": [], "parameters": [], "excerpts": [excerpt("other"), excerpt("mended")], "left": [], "power": []}),
            ),
        ];
        let page = crate::page(&document(&more), &[]);
        assert!(page.split("<section").next().expect("the top").contains("mended, where"));
    }

    /// Nothing to show is no empty frame.
    #[test]
    fn a_document_without_figures_has_no_pictures() {
        let page = crate::page(&document(&[]), &[]);
        assert!(!page.split("<section").next().expect("the top").contains("<svg"));
    }
}
