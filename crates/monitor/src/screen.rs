//! The live view: all of it on a large terminal, else one page with joints and parameters and one with state and loop.

use crate::lines::{Column, STRONG, Section, cells, columns_that_fit, rule, window, wrapped};
use crate::snapshot::{
    POLLS, Snapshot, controller_faults, drops, figure, flags, input_faults, input_state, instruments, is_state_lost,
    load, parameter_state, phases, quantiles, refusals, source, state_folder, worst,
};
use ratatui::Frame;
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

/// What the person at the keyboard has chosen.
#[derive(Clone, Copy, Debug, Default)]
pub struct View {
    page: Page,
    /// First row of joints and parameters that is shown; joints count only where they scroll, too.
    first_row: usize,
    /// First column of numbers that is shown.
    first_column: usize,
    /// First line of the page with state and loop that is shown.
    first_line: usize,
    /// Rows that the last screen had room for, without titles and heads.
    screenful: usize,
}

/// What a terminal shows that has no room for everything.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Page {
    #[default]
    Values,
    Health,
}

impl View {
    /// Goes down by so many rows; beyond the last one [`draw`] stops.
    pub fn scroll(&mut self, by: isize) {
        let first = if self.page == Page::Health { &mut self.first_line } else { &mut self.first_row };
        *first = first.saturating_add_signed(by);
    }

    /// Goes down by so many screens; no row is passed over.
    pub fn scroll_screens(&mut self, by: isize) {
        self.scroll(by.saturating_mul(isize::try_from(self.screenful.max(1)).unwrap_or(1)));
    }

    /// Goes right by so many columns of numbers.
    pub fn scroll_columns(&mut self, by: isize) {
        self.first_column = self.first_column.saturating_add_signed(by);
    }

    /// Turns to the other page.
    pub fn turn(&mut self) {
        self.page = if self.page == Page::Values { Page::Health } else { Page::Values };
    }
}

const GOOD: Style = Style::new().fg(Color::Green);
const BAD: Style = Style::new().fg(Color::Red).add_modifier(Modifier::BOLD);
const QUIET: Style = Style::new().fg(Color::DarkGray);

/// Bins of the histograms that are shown: 256 ns to 67 ms, which is where loops of 0.1 to 10 ms live.
const SHOWN_BINS: std::ops::Range<usize> = 8..27;
/// From so many columns on state and loop stand side by side.
const SIDE_BY_SIDE_COLUMNS: usize = 100;
/// Rows of parameters without which joints scroll with them.
const MIN_PARAMETER_ROWS: usize = 5;
/// Rows of parameters without which a terminal has no room for everything.
const AMPLE_PARAMETER_ROWS: usize = 8;

/// Draws what is known.
pub fn draw(frame: &mut Frame<'_>, s: &Snapshot, view: &mut View) {
    let area = frame.area();
    let (columns, rows) = (usize::from(area.width), usize::from(area.height));
    let mut lines = vec![title(s, columns)];
    let (joints, parameters) = (joints(s, columns, view), parameters(s, columns, view));
    view.first_column = view.first_column.min(joints.first_column.max(parameters.first_column));
    let health = health(s, columns);
    // Title and keys have a row each.
    let room = rows.saturating_sub(2);
    let ample = parameters.rows.len().min(AMPLE_PARAMETER_ROWS) + Section::HEAD_ROWS;
    let has_pages = health.len() + joints.len() + ample > room;
    if has_pages && view.page == Page::Health {
        view.first_line = view.first_line.min(health.len().saturating_sub(room));
        view.screenful = room;
        lines.extend(health.into_iter().skip(view.first_line).take(room));
    } else {
        if has_pages {
            lines.extend(alarms(s, columns, room / 3));
        } else {
            lines.extend(health);
        }
        let rest = room.saturating_sub(lines.len() - 1);
        let least = parameters.rows.len().min(MIN_PARAMETER_ROWS) + Section::HEAD_ROWS;
        if joints.len() + least <= rest {
            let below = rest - joints.len();
            view.screenful = below.saturating_sub(Section::HEAD_ROWS);
            lines.extend(window(&[joints], &mut 0, rest));
            lines.extend(window(&[parameters], &mut view.first_row, below));
        } else {
            view.screenful = rest.saturating_sub(2 * Section::HEAD_ROWS);
            lines.extend(window(&[joints, parameters], &mut view.first_row, rest));
        }
    }
    lines.resize(rows.saturating_sub(1), Line::default());
    lines.push(keys(columns, has_pages.then_some(view.page)));
    frame.render_widget(Paragraph::new(lines), area);
}

/// Robot and bus; the bus where there is room for it.
fn title(s: &Snapshot, columns: usize) -> Line<'static> {
    let name = format!(" {}", s.robot);
    let bus = format!("  {}", s.bus);
    let label = " rivet monitor";
    let mut spans = vec![Span::styled(label, STRONG), Span::raw(name)];
    if spans.iter().map(Span::width).sum::<usize>() + bus.chars().count() <= columns {
        spans.push(Span::styled(bus, QUIET));
    }
    Line::from(spans)
}

/// The keys, as many as there is room for; `page` is the one that is shown, where there are pages.
fn keys(columns: usize, page: Option<Page>) -> Line<'static> {
    let other = match page {
        None => None,
        Some(Page::Values) => Some("Tab: state, loop"),
        Some(Page::Health) => Some("Tab: joints, parameters"),
    };
    let mut kept: Vec<&str> = Vec::new();
    let mut used = 0;
    for key in other.into_iter().chain(["q: quit", "up, down, space: rows", "left, right: columns"]) {
        used += key.len() + 3;
        if used <= columns {
            kept.push(key);
        }
    }
    let text = format!(" {}", kept.join("   "));
    Line::styled(text, QUIET)
}

/// A fact about daemon or controller.
struct Fact {
    label: &'static str,
    text: String,
    style: Style,
}

impl Fact {
    /// Coloured by whether there is something to look after.
    fn judged(label: &'static str, text: String, is_good: bool) -> Fact {
        Fact { label, text, style: if is_good { GOOD } else { BAD } }
    }

    /// Green when it says that there is nothing to report.
    fn count(label: &'static str, text: String) -> Fact {
        let is_good = text == "none";
        Fact::judged(label, text, is_good)
    }

    fn plain(label: &'static str, text: String) -> Fact {
        Fact { label, text, style: Style::new() }
    }

    fn lines(self, columns: usize) -> Vec<Line<'static>> {
        wrapped(self.label, &self.text, self.style, columns)
    }
}

/// Daemon, controller and parameter set.
fn facts(s: &Snapshot) -> Vec<Fact> {
    let state = |label, text: Option<String>, good: &[&str]| {
        let text = text.unwrap_or_else(|| "not on the bus".to_owned());
        let is_good = good.contains(&text.as_str());
        Fact::judged(label, text, is_good)
    };
    let folder = |label, state: u32| is_state_lost(state).then(|| Fact::judged(label, state_folder(state), false));
    let polls = |label, polls: u32| (polls != 0).then(|| Fact::judged(label, POLLS.to_owned(), false));
    let mut facts = vec![state("daemon", s.mode(), &["estimating", "frozen"])];
    if let Some(report) = s.health {
        let h = report.message;
        facts.extend(folder("state", h.state_folder));
        facts.extend(polls("wake-up", h.polls));
        let window = if h.window_s.is_finite() { format!("{:.1} s", h.window_s) } else { "endless".to_owned() };
        facts.push(Fact::plain("supervision", format!("{} move, {} held; window {window}", h.active, h.held)));
        facts.push(Fact::plain("instruments", instruments(h.instruments)));
        let input = input_state(s, &h);
        let is_good = input == "none" || input.starts_with("sound");
        facts.push(Fact::judged("input", input, is_good));
        facts.push(Fact::count("samples", input_faults(&h)));
        facts.push(Fact::judged("load", load(&h), h.load_level == 0));
        facts.push(Fact::count("drops", drops(&h)));
    }
    facts.push(state("controller", s.state(), &["following", "holding"]));
    if let Some(report) = s.controller {
        let c = report.message;
        facts.extend(folder("c-state", c.state_folder));
        facts.extend(polls("c-wake-up", c.polls));
        for (label, text) in [("stops", s.stops(&c)), ("plan", s.refused_plan(&c))] {
            facts.extend(text.map(|text| Fact::judged(label, text, false)));
        }
        let refused = refusals(&c).into_iter().next().map_or(String::new(), |(why, count)| format!("; {count} {why}"));
        facts.push(Fact::plain("source", format!("{}; {} sets accepted{refused}", source(&c), c.accepted)));
        facts.push(Fact::count("c-faults", controller_faults(&c)));
    }
    if let Some(set) = &s.parameters {
        let model = if s.same_model() { "" } else { "; OF ANOTHER MODEL" };
        let text = format!("epoch {}{}{model}", set.epoch, flags(set));
        facts.push(Fact { label: "set", style: if text.contains(';') { BAD } else { Style::new() }, text });
    }
    facts
}

/// The states of daemon and controller, and what has to be looked after, in at most `rows`.
fn alarms(s: &Snapshot, columns: usize, rows: usize) -> Vec<Line<'static>> {
    let (states, others): (Vec<Fact>, Vec<Fact>) =
        facts(s).into_iter().partition(|fact| ["daemon", "controller"].contains(&fact.label));
    let others = others.into_iter().filter(|fact| fact.style == BAD);
    let mut lines: Vec<Line<'static>> = states.into_iter().chain(others).flat_map(|fact| fact.lines(columns)).collect();
    if lines.len() > rows.max(2) {
        lines.truncate(rows.max(2) - 1);
        lines.push(Line::styled("more: Tab", BAD));
    }
    lines
}

/// State and loop, side by side where there is room for both.
fn health(s: &Snapshot, columns: usize) -> Vec<Line<'static>> {
    if columns < SIDE_BY_SIDE_COLUMNS {
        let mut lines: Vec<Line<'static>> = facts(s).into_iter().flat_map(|fact| fact.lines(columns)).collect();
        lines.extend(timing(s, columns));
        return lines;
    }
    let left_columns = columns / 2;
    let mut left = timing(s, left_columns - 2);
    let mut right = vec![rule("state", columns - left_columns)];
    right.extend(facts(s).into_iter().flat_map(|fact| fact.lines(columns - left_columns)));
    let rows = left.len().max(right.len());
    left.resize(rows, Line::default());
    right.resize(rows, Line::default());
    let side_by_side = left.into_iter().zip(right).map(|(mut line, right)| {
        line.spans.push(Span::raw(" ".repeat(left_columns.saturating_sub(line.width()))));
        line.spans.extend(right.spans);
        line
    });
    side_by_side.collect()
}

/// The loop of the daemon.
fn timing(s: &Snapshot, columns: usize) -> Vec<Line<'static>> {
    let mut lines = vec![rule("loop of rivetd", columns)];
    let Some(report) = s.health else {
        lines.push(Line::styled("not on the bus", QUIET));
        return lines;
    };
    let h = report.message;
    let rate = if report.rate.is_finite() { format!(", {:.0} samples/s", report.rate) } else { String::new() };
    let mut plain = |label, text: &str| lines.extend(wrapped(label, text, Style::new(), columns));
    plain("periods", &format!("{}{rate}", h.periods));
    for (name, counts, worst) in
        [("wake", &h.wake_histogram, h.worst_wake_ns), ("work", &h.work_histogram, h.worst_work_ns)]
    {
        plain(name, &quantiles(counts, worst));
        plain("", &format!("{}  256 ns to 67 ms, logarithmic", bars(&counts[SHOWN_BINS])));
    }
    if let Some(timing) = &s.timing {
        plain("p99 [us]", &phases(timing));
        plain("worst", &worst(timing));
    }
    lines
}

/// Counts as bars on a logarithmic scale: a bin with one entry among a million is what one looks for.
fn bars(counts: &[u32]) -> String {
    const BARS: [char; 9] = ['·', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let bar = |n: &u32| if *n == 0 { BARS[0] } else { BARS[(1 + n.ilog10() as usize).min(BARS.len() - 1)] };
    counts.iter().map(bar).collect()
}

/// Columns of the bar of a joint's share.
const BAR_COLUMNS: usize = 20;

/// Columns of the joints' table.
const JOINT_COLUMNS: [Column; 7] = [
    Column { head: "torque", width: 10 },
    Column { head: "residual", width: 10 },
    Column { head: "share", width: 9 },
    Column { head: "robot file", width: 11 },
    Column { head: "in use", width: 10 },
    Column { head: "tracking", width: 10 },
    Column { head: "share, 0.1 to 100 %", width: BAR_COLUMNS + 1 },
];

/// Torque and residuals of each joint.
fn joints(s: &Snapshot, columns: usize, view: &View) -> Section {
    let (names, shown) = columns_that_fit(s.joints.iter(), &JOINT_COLUMNS, columns, view.first_column);
    let rows = s.joints.iter().enumerate().map(|(j, name)| {
        // A message has room for so many joints, and an arm may have more.
        let at = |values: &[f64]| values.get(j).copied().unwrap_or(f64::NAN);
        let [torque, residual, nominal] = s.health.map_or([f64::NAN; 3], |report| {
            let h = report.message;
            [at(&h.torque_rms), at(&h.residual_rms), at(&h.nominal_residual_rms)]
        });
        let [used, tracking] = s
            .controller
            .map_or([f64::NAN; 2], |report| [at(&report.message.prediction_rms), at(&report.message.tracking_rms)]);
        let share = if residual.is_finite() && torque > 0.0 { (residual / torque).clamp(0.0, 1.0) } else { 0.0 };
        let style = if share > 0.5 { BAD } else { GOOD };
        let percent = if share > 0.0 { format!("{:.1} %", 100.0 * share) } else { "-".to_owned() };
        // On a logarithmic scale, from a thousandth of the torque to all of it.
        let filled = ((share.max(1e-3).log10() + 3.0) / 3.0 * BAR_COLUMNS as f64).round() as usize;
        let bar = "█".repeat(filled) + &"·".repeat(BAR_COLUMNS - filled);
        let texts = [figure(torque), figure(residual), percent, figure(nominal), figure(used), figure(tracking), bar];
        let plain = Style::new();
        cells(name, names, &JOINT_COLUMNS, &texts, &[plain, plain, style, plain, plain, plain, style], &shown)
    });
    let rows = rows.collect();
    let title = Box::new(|_, _| "joints, rms: torque and residuals [N m], tracking [rad]".to_owned());
    Section { title, head: heads(names, &JOINT_COLUMNS, &shown), rows, columns, first_column: shown.start }
}

fn heads(names: usize, columns: &[Column], shown: &std::ops::Range<usize>) -> Line<'static> {
    let texts: Vec<String> = columns.iter().map(|column| column.head.to_owned()).collect();
    cells("", names, columns, &texts, &vec![QUIET; columns.len()], shown)
}

/// Columns of the parameters' table.
const PARAMETER_COLUMNS: [Column; 5] = [
    Column { head: "value", width: 10 },
    Column { head: "sigma", width: 10 },
    Column { head: "robot file", width: 11 },
    Column { head: "excitation", width: 11 },
    Column { head: "state", width: 8 },
];

/// The parameter set.
fn parameters(s: &Snapshot, columns: usize, view: &View) -> Section {
    let Some(set) = &s.parameters else {
        let title = Box::new(|_, _| "parameters: none yet".to_owned());
        return Section { title, head: Line::default(), rows: Vec::new(), columns, first_column: 0 };
    };
    let all: Vec<String> = (0..set.len()).map(|i| s.name(i)).collect();
    let (names, shown) = columns_that_fit(all.iter(), &PARAMETER_COLUMNS, columns, view.first_column);
    let rows = all.iter().enumerate().map(|(i, name)| {
        let state = parameter_state(set.state[i]);
        let style = match state {
            "active" => GOOD,
            "held" => Style::new(),
            _ => QUIET,
        };
        let nominal = if s.same_model() { s.nominal.get(i).map_or(f64::NAN, |x| *x) } else { f64::NAN };
        let [value, std, nominal, excitation] = [set.values[i], set.std[i], nominal, set.excitation[i]].map(figure);
        let plain = Style::new();
        let texts = [value, std, nominal, excitation, state.to_owned()];
        cells(name, names, &PARAMETER_COLUMNS, &texts, &[plain, plain, plain, plain, style], &shown)
    });
    let rows = rows.collect();
    let count = set.len();
    let title = Box::new(move |first, last| format!("parameters {first}-{last} of {count}"));
    Section { title, head: heads(names, &PARAMETER_COLUMNS, &shown), rows, columns, first_column: shown.start }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use rivet_ipc_schema::{
        BusConfig, ControllerHealth, HISTOGRAM_BINS, Health, PHASES, Parameters, StateFolder, Timing, WORST_PERIODS,
    };
    use std::path::Path;

    fn snapshot() -> Snapshot {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/ur10e/robot.toml");
        Snapshot::new(&rivet_config::load(file).expect("the arm is there"), &BusConfig::default())
    }

    fn screen(s: &Snapshot, width: u16, height: u16, view: &mut View) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a terminal");
        terminal.draw(|frame| draw(frame, s, view)).expect("drawn");
        format!("{}", terminal.backend())
    }

    /// A snapshot of an arm with so many joints, with everything in it and long words.
    fn full(joints: usize) -> Snapshot {
        let mut s = snapshot();
        s.joints = (1..=joints).map(|j| format!("shoulder_lift_joint{j}")).collect();
        let filled = |x: f64| [x; rivet_ipc_schema::MAX_JOINTS];
        let mut health = Health { mode: 1, samples: 1000, overruns: 3, refused_invalid: 7, ..Health::default() };
        health.stamp_ns = s.now_ns;
        (health.torque_rms, health.residual_rms) = (filled(-12345.6), filled(1.2345));
        health.nominal_residual_rms = filled(1.23e-11);
        (health.input_fault, health.input_joints, health.load_level) = (9, 3, 2);
        (health.load_changes, health.load_seq) = (2, 777);
        health.wake_histogram[8..27].fill(12345);
        s.take_health(&health);
        s.timing = Some(Timing { count: 2, ..Timing::default() });
        let mut controller =
            ControllerHealth { state: 2, source: 2, stamp_ns: s.now_ns, ..ControllerHealth::default() };
        (controller.stops, controller.stop_cause, controller.stop_joints) = (3, 4, 3);
        controller.stop_causes[4] = 3;
        (controller.tracking_rms, controller.prediction_rms) = (filled(0.001), filled(0.5));
        s.take_controller(&controller);
        let mut set = Parameters { count: s.names.len() as u32, model_hash: s.hash, epoch: 5, ..Parameters::default() };
        set.values[..s.names.len()].fill(-1.5);
        s.parameters = Some(set);
        s
    }

    /// Lines of the picture without the quotation marks of the test's terminal.
    fn lines(picture: &str) -> Vec<String> {
        picture.lines().map(|line| line.trim_matches('"').to_owned()).collect()
    }

    #[test]
    fn shows_every_joint_and_parameter_on_usual_terminals() {
        for (width, height) in [(80, 24), (100, 30), (60, 20)] {
            for joints in [6, 10] {
                let s = full(joints);
                let mut seen = std::collections::BTreeSet::new();
                let mut most = 0;
                for first in 0..s.names.len() + joints {
                    let mut view = View { first_row: first, ..View::default() };
                    let picture = lines(&screen(&s, width, height, &mut view));
                    let names = picture.iter().filter_map(|line| line.split_whitespace().next().map(str::to_owned));
                    let names: Vec<_> = names.filter(|n| s.names.contains(n) || s.joints.contains(n)).collect();
                    most = most.max(names.iter().filter(|name| s.names.contains(name)).count());
                    seen.extend(names);
                }
                assert_eq!(seen.len(), s.names.len() + joints, "{width}x{height}, {joints} joints: {seen:?}");
                assert!(most >= MIN_PARAMETER_ROWS, "{width}x{height}, {joints} joints: {most} parameters");
                // On the first look both tables are seen where the terminal has 24 lines.
                let picture = screen(&s, width, height, &mut View::default());
                let visible = s.names.iter().filter(|name| picture.contains(&format!("\"{name} "))).count();
                assert!(height < 24 || joints > 6 || visible >= MIN_PARAMETER_ROWS, "{visible}:\n{picture}");
            }
        }
    }

    /// Every word of a narrow terminal is one of a wide terminal, which has room for all of them.
    #[test]
    fn cuts_no_word_on_usual_terminals() {
        let words = |picture: &str| -> std::collections::BTreeSet<String> {
            let text = picture.replace(['"', '─'], " ");
            text.split_whitespace().map(str::to_owned).collect()
        };
        for joints in [6, 10] {
            let s = full(joints);
            let mut known = words(&screen(&s, 300, 200, &mut View::default()));
            known.extend(["Tab:", "state,", "loop", "joints,", "parameters", "more:", "Tab"].map(str::to_owned));
            for (width, height) in [(80, 24), (100, 30), (60, 20), (40, 12)] {
                for (turned, first_column) in [(false, 0), (false, 1), (false, 9), (true, 0)] {
                    let mut view = View { first_column, ..View::default() };
                    if turned {
                        view.turn();
                    }
                    let picture = screen(&s, width, height, &mut view);
                    // Numbers of rows differ.
                    let cut: Vec<String> = words(&picture)
                        .into_iter()
                        .filter(|word| !known.contains(word) && !word.starts_with(|c: char| c.is_ascii_digit()))
                        .collect();
                    assert!(cut.is_empty(), "{width}x{height}: {cut:?}\n{picture}");
                }
            }
        }
    }

    /// Screen by screen every parameter is shown, whatever the terminal has room for.
    #[test]
    fn screens_pass_over_no_row() {
        let mut s = full(6);
        s.parameters =
            Some(Parameters { count: s.names.len() as u32, model_hash: s.hash, epoch: 5, ..Parameters::default() });
        for (width, height) in [(80, 24), (100, 30), (80, 14)] {
            let (mut view, mut seen) = (View::default(), String::new());
            for _ in 0..s.names.len() {
                seen += &screen(&s, width, height, &mut view);
                view.scroll_screens(1);
            }
            let missing: Vec<&String> = s.names.iter().filter(|name| !seen.contains(name.as_str())).collect();
            assert!(missing.is_empty(), "{width}x{height}: {missing:?}");
        }
    }

    #[test]
    fn columns_that_do_not_fit_are_reached_by_scrolling() {
        let s = full(6);
        let mut view = View::default();
        assert!(!screen(&s, 60, 20, &mut view).contains("tracking   "));
        view.scroll_columns(9);
        let picture = screen(&s, 60, 20, &mut view);
        assert!(picture.contains("  tracking") && picture.contains("0.0010"), "{picture}");
    }

    #[test]
    fn what_is_not_there_is_said() {
        let text = screen(&snapshot(), 120, 40, &mut View::default());
        assert_eq!(text.matches("not on the bus").count(), 3, "{text}");
        assert!(text.contains("none yet"), "{text}");
    }

    #[test]
    fn faults_parameters_and_silence_are_seen_on_a_small_screen() {
        let mut s = snapshot();
        let mut health = Health { mode: 1, samples: 1000, overruns: 3, refused_invalid: 7, ..Health::default() };
        health.stamp_ns = s.now_ns;
        health.wake_histogram[14] = 1000;
        health.torque_rms[0] = 10.0;
        health.residual_rms[0] = 8.0;
        (health.input_fault, health.input_joints, health.load_level) = (9, 2, 2);
        (health.load_changes, health.load_seq, health.rows_doubted) = (2, 777, 5);
        health.state_folder = StateFolder::Full.into();
        let mut timing = Timing { count: 2, ..Timing::default() };
        timing.phase_histogram[3 * HISTOGRAM_BINS + 13] = 100;
        timing.phase_max_ns[3] = 9_000;
        timing.worst_phase_ns[0] = 1_300_000;
        timing.worst_cause[1] = 2;
        s.timing = Some(timing);
        s.take_health(&health);
        s.take_controller(&ControllerHealth { state: 2, source: 2, stamp_ns: s.now_ns, ..ControllerHealth::default() });
        s.parameters =
            Some(Parameters { count: s.names.len() as u32, model_hash: s.hash, epoch: 5, ..Parameters::default() });
        let mut view = View::default();
        view.scroll(1000);
        let mut text = screen(&s, 100, 30, &mut view);
        view.turn();
        text += &screen(&s, 100, 30, &mut view);
        let last = s.names.last().expect("a parameter").clone();
        for part in [
            "ENCODER JUMP of shoulder_lift_joint",
            "decimate since sample 777; 2 changes",
            "model 9",
            "pub 0",
            "FOLDER IS FULL",
            "1.3 ms, late wake up",
            "estimating",
            "3 periods missed",
            "7 invalid",
            "following",
            "live",
            "epoch 5",
            last.as_str(),
        ] {
            assert!(text.contains(part), "{part}:\n{text}");
        }
        s.now_ns += 60_000_000_000;
        assert!(screen(&s, 100, 30, &mut view).contains("SILENT for 60 s"));
    }

    /// A stop that has ended by itself, on the smallest usual terminal.
    #[test]
    fn the_last_stop_is_seen_on_80_by_24() {
        let mut s = snapshot();
        s.take_health(&Health { stamp_ns: s.now_ns, ..Health::default() });
        let mut stop_causes = [0; rivet_ipc_schema::STOP_CAUSES];
        let cause = u32::from(rivet_ipc_schema::StopCause::Frozen);
        stop_causes[cause as usize] = 1;
        let (stop_cause, stop_joints) = (cause, 1);
        s.take_controller(&ControllerHealth {
            stamp_ns: s.now_ns,
            stops: 1,
            resumed: 1,
            stop_causes,
            stop_cause,
            stop_joints,
            ..ControllerHealth::default()
        });
        let text = screen(&s, 80, 24, &mut View::default());
        assert!(text.contains("stops       frozen"), "{text}");
    }

    /// Terminals act on C1 controls too.
    #[test]
    fn control_characters_of_names_are_escaped() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/ur10e");
        let mut robot = rivet_config::load(folder.join("robot.toml")).expect("the arm is there");
        let mut model = (*robot.model).clone();
        model.arm.joints[0].name = "a\u{9b}31mb".to_owned();
        robot.model = model.into();
        let text = screen(&Snapshot::new(&robot, &BusConfig::default()), 120, 40, &mut View::default());
        assert!(text.contains("a\\u{9b}31mb") && !text.contains('\u{9b}'), "{text}");
    }

    /// Whatever arrives, on whatever terminal.
    #[test]
    fn no_size_and_no_message_breaks_it() {
        let mut s = snapshot();
        let wild = Health {
            mode: 77,
            instruments: 9,
            worst_wake_ns: u64::MAX,
            wake_histogram: [u32::MAX; 32],
            ..Health::default()
        };
        s.take_health(&wild);
        s.timing = Some(Timing {
            count: u32::MAX,
            phase_histogram: [u32::MAX; PHASES * HISTOGRAM_BINS],
            phase_max_ns: [u64::MAX; PHASES],
            worst_phase_ns: [u32::MAX; PHASES * WORST_PERIODS],
            worst_cause: [99; WORST_PERIODS],
            ..Timing::default()
        });
        let nowhere =
            Health { input_fault: 55, input_joints: u32::MAX, last_input_fault: u32::MAX, load_level: 9, ..wild };
        s.take_health(&Health { residual_rms: [f64::NAN; 8], torque_rms: [f64::INFINITY; 8], ..nowhere });
        s.take_controller(&ControllerHealth {
            state: 99,
            source: 99,
            refusals: [u64::MAX; 16],
            ..ControllerHealth::default()
        });
        s.parameters =
            Some(Parameters { count: u32::MAX, values: [f64::MIN; 128], state: [9; 128], ..Parameters::default() });
        for (width, height) in [(1, 1), (10, 3), (40, 12), (80, 24), (300, 100)] {
            let mut view = View::default();
            screen(&s, width, height, &mut view);
            view.turn();
            screen(&s, width, height, &mut view);
        }
        assert!(crate::as_text(&s).contains("mode 77"));
    }
}
