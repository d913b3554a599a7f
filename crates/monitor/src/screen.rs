//! The live view.

use crate::snapshot::{
    POLLS, Snapshot, controller_faults, drops, figure, flags, input_faults, input_state, instruments, is_state_lost,
    load, parameter_state, phases, quantiles, refusals, source, state_folder, worst,
};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::{Block, Cell, Paragraph, Row, Sparkline, Table, Wrap};

/// What the person at the keyboard has chosen.
#[derive(Clone, Copy, Debug, Default)]
pub struct View {
    /// First parameter shown.
    first: usize,
}

impl View {
    /// Goes down by so many parameters.
    pub fn scroll(&mut self, by: isize) {
        self.first = self.first.saturating_add_signed(by);
    }
}

const GOOD: Style = Style::new().fg(Color::Green);
const BAD: Style = Style::new().fg(Color::Red).add_modifier(Modifier::BOLD);
const QUIET: Style = Style::new().fg(Color::DarkGray);
const STRONG: Style = Style::new().add_modifier(Modifier::BOLD);

/// Bins of the histograms that are shown: 256 ns to 67 ms, which is where loops of 0.1 to 10 ms live.
const SHOWN: std::ops::Range<usize> = 8..27;

/// Draws what is known.
pub fn draw(frame: &mut Frame<'_>, s: &Snapshot, view: &mut View) {
    let joints = s.joints.len() as u16;
    let [head, top, middle, bottom, foot] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(11),
        Constraint::Length(joints + 3),
        Constraint::Min(3),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    let [timing, words] = Layout::horizontal([Constraint::Percentage(48), Constraint::Percentage(52)]).areas(top);
    let title = Line::from(vec![
        Span::styled(" rivet monitor ", STRONG),
        Span::raw(&s.robot),
        Span::styled(format!("  {}", s.bus), QUIET),
    ]);
    frame.render_widget(title, head);
    draw_timing(frame, timing, s);
    draw_words(frame, words, s);
    draw_joints(frame, middle, s);
    draw_parameters(frame, bottom, s, view);
    frame.render_widget(Line::styled(" q quit   up/down, space: parameters", QUIET), foot);
}

fn draw_timing(frame: &mut Frame<'_>, area: Rect, s: &Snapshot) {
    let block = Block::bordered().title(" loop of rivetd ");
    let inner = block.inner(area);
    frame.render_widget(block, area);
    let Some(report) = s.health else {
        return frame.render_widget(Line::styled("not on the bus", QUIET), inner);
    };
    let h = report.message;
    let rows = Layout::vertical([Constraint::Length(1); 9]).split(inner);
    let rate = if report.rate.is_finite() { format!("{:.0} samples/s", report.rate) } else { String::new() };
    frame.render_widget(Line::raw(format!("{} periods  {rate}", h.periods)), rows[0]);
    for (i, (name, counts, worst)) in
        [("wake", &h.wake_histogram, h.worst_wake_ns), ("work", &h.work_histogram, h.worst_work_ns)].iter().enumerate()
    {
        // On a logarithmic scale: a bin with one entry among a million is what one looks for.
        let logs: Vec<u64> =
            counts[SHOWN].iter().map(|&n| if n == 0 { 0 } else { 1 + (10.0 * f64::from(n).log10()) as u64 }).collect();
        let [label, bars] = Layout::horizontal([Constraint::Length(5), Constraint::Min(1)]).areas(rows[1 + 2 * i]);
        frame.render_widget(Line::styled(*name, STRONG), label);
        let [bars, scale] =
            Layout::horizontal([Constraint::Length(SHOWN.len() as u16), Constraint::Min(0)]).areas(bars);
        frame.render_widget(Sparkline::default().data(&logs).max(80), bars);
        frame.render_widget(Line::styled(" 256 ns .. 67 ms, log", QUIET), scale);
        frame.render_widget(Line::raw(quantiles(counts, *worst)), rows[2 + 2 * i]);
    }
    if let Some(timing) = &s.timing {
        // Two rows: on a narrow screen one does not hold all phases.
        let area = Rect { height: 2, ..rows[5] };
        let text = format!("p99 us: {}", phases(timing));
        frame.render_widget(Paragraph::new(text).wrap(Wrap { trim: true }), area);
        frame.render_widget(Line::raw(format!("worst {}", worst(timing))), rows[7]);
    }
    frame.render_widget(labelled("drops ", &drops(&h)), rows[8]);
}

/// A line whose rest is green when it says that there is nothing to report.
fn labelled(label: &str, what: &str) -> Line<'static> {
    let style = if what == "none" { GOOD } else { BAD };
    Line::from(vec![Span::styled(label.to_owned(), STRONG), Span::styled(what.to_owned(), style)])
}

fn draw_words(frame: &mut Frame<'_>, area: Rect, s: &Snapshot) {
    let mut lines = Vec::new();
    let plain = |label: &'static str, text: String| Line::from(vec![Span::styled(label, STRONG), Span::raw(text)]);
    let state = |label: &'static str, text: Option<String>, good: &[&str]| {
        let text = text.unwrap_or_else(|| "not on the bus".to_owned());
        let style = if good.contains(&text.as_str()) { GOOD } else { BAD };
        Line::from(vec![Span::styled(label, STRONG), Span::styled(text, style)])
    };
    let lost = |state: u32| {
        let text = Span::styled(state_folder(state), BAD);
        is_state_lost(state).then(|| Line::from(vec![Span::styled("state       ", STRONG), text]))
    };
    let polls = |polls: u32| {
        let text = Span::styled(POLLS, BAD);
        (polls != 0).then(|| Line::from(vec![Span::styled("wake-up     ", STRONG), text]))
    };
    lines.push(state("daemon      ", s.mode(), &["estimating", "frozen"]));
    if let Some(report) = s.health {
        let h = report.message;
        lines.extend(lost(h.state_folder));
        lines.extend(polls(h.polls));
        let window = if h.window_s.is_finite() { format!("{:.1} s", h.window_s) } else { "endless".to_owned() };
        lines.push(plain("supervision ", format!("{} move, {} held; window {window}", h.active, h.held)));
        lines.push(plain("instruments ", instruments(h.instruments)));
        let input = input_state(s, &h);
        let style = if input == "none" || input.starts_with("sound") { GOOD } else { BAD };
        lines.push(Line::from(vec![Span::styled("input       ", STRONG), Span::styled(input, style)]));
        lines.push(labelled("samples     ", &input_faults(&h)));
        let style = if h.load_level == 0 { GOOD } else { BAD };
        lines.push(Line::from(vec![Span::styled("load        ", STRONG), Span::styled(load(&h), style)]));
    }
    lines.push(state("controller  ", s.state(), &["following", "holding"]));
    if let Some(report) = s.controller {
        let c = report.message;
        lines.extend(lost(c.state_folder));
        lines.extend(polls(c.polls));
        // What stopped the arm is not to be cut off by a small screen.
        for (label, text) in [("stops       ", s.stops(&c)), ("plan        ", s.refused_plan(&c))] {
            lines.extend(text.map(|text| Line::from(vec![Span::styled(label, STRONG), Span::styled(text, BAD)])));
        }
        let refused = refusals(&c).into_iter().next().map_or(String::new(), |(why, count)| format!("; {count} {why}"));
        lines.push(plain("parameters  ", format!("{}; {} sets accepted{refused}", source(&c), c.accepted)));
        lines.push(labelled("faults      ", &controller_faults(&c)));
    }
    frame.render_widget(Paragraph::new(lines).block(Block::bordered().title(" state ")), area);
}

fn right<'a>(text: impl Into<Text<'a>>) -> Cell<'a> {
    Cell::from(text.into().right_aligned())
}

fn draw_joints(frame: &mut Frame<'_>, area: Rect, s: &Snapshot) {
    const BAR: usize = 20;
    let head = Row::new([
        Cell::from(""),
        right("torque"),
        right("residual"),
        right("share"),
        Cell::from("0.1 % .. 100 %, log"),
        right("nominal's"),
        right("in use's"),
        right("tracking"),
    ])
    .style(QUIET);
    let rows = s.joints.iter().enumerate().map(|(j, name)| {
        let [torque, residual, nominal] = s.health.map_or([f64::NAN; 3], |report| {
            let h = report.message;
            [h.torque_rms[j], h.residual_rms[j], h.nominal_residual_rms[j]]
        });
        let [used, tracking] = s
            .controller
            .map_or([f64::NAN; 2], |report| [report.message.prediction_rms[j], report.message.tracking_rms[j]]);
        let share = if residual.is_finite() && torque > 0.0 { (residual / torque).clamp(0.0, 1.0) } else { 0.0 };
        // On a logarithmic scale, from a thousandth of the torque to all of it.
        let filled = ((share.max(1e-3).log10() + 3.0) / 3.0 * BAR as f64).round() as usize;
        let style = if share > 0.5 { BAD } else { GOOD };
        Row::new(vec![
            Cell::from(name.clone()),
            right(figure(torque)),
            right(figure(residual)),
            right(if share > 0.0 { format!("{:.1} %", 100.0 * share) } else { String::new() }),
            Cell::from(Line::from(vec![
                Span::styled("█".repeat(filled), style),
                Span::styled("·".repeat(BAR - filled), QUIET),
            ])),
            right(figure(nominal)),
            right(figure(used)),
            right(figure(tracking)),
        ])
    });
    let widths = [
        Constraint::Min(14),
        Constraint::Length(10),
        Constraint::Length(10),
        Constraint::Length(8),
        Constraint::Length(BAR as u16),
        Constraint::Length(10),
        Constraint::Length(10),
        Constraint::Length(10),
    ];
    let block = Block::bordered().title(" joints: rms torque [N m], what the model leaves of it; tracking [rad] ");
    frame.render_widget(Table::new(rows, widths).header(head).block(block), area);
}

fn draw_parameters(frame: &mut Frame<'_>, area: Rect, s: &Snapshot, view: &mut View) {
    let Some(set) = &s.parameters else {
        let block = Block::bordered().title(" parameters ");
        return frame.render_widget(Paragraph::new("none yet").style(QUIET).block(block), area);
    };
    let visible = usize::from(area.height.saturating_sub(3));
    view.first = view.first.min(set.len().saturating_sub(visible));
    let last = (view.first + visible).min(set.len());
    let head = Row::new([
        Cell::from(""),
        right("value"),
        right("sigma"),
        right("robot file"),
        right("excitation"),
        Cell::from("  state"),
    ])
    .style(QUIET);
    let rows = (view.first..last).map(|i| {
        let state = parameter_state(set.state[i]);
        let style = match state {
            "active" => GOOD,
            "held" => Style::new(),
            _ => QUIET,
        };
        let nominal = if s.same_model() { s.nominal.get(i).map_or(f64::NAN, |x| *x) } else { f64::NAN };
        Row::new(vec![
            Cell::from(s.name(i)),
            right(figure(set.values[i])),
            right(figure(set.std[i])),
            right(figure(nominal)),
            right(figure(set.excitation[i])),
            Cell::from(format!("  {state}")).style(style),
        ])
    });
    let widths = [
        Constraint::Min(24),
        Constraint::Length(12),
        Constraint::Length(12),
        Constraint::Length(12),
        Constraint::Length(12),
        Constraint::Length(14),
    ];
    let model = if s.same_model() { "" } else { ", OF ANOTHER MODEL" };
    let (first, said) = (view.first + 1, flags(set));
    let title = format!(" parameters {first}-{last} of {}, epoch {}{said}{model} ", set.len(), set.epoch);
    frame.render_widget(Table::new(rows, widths).header(head).block(Block::bordered().title(title)), area);
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
        let text = screen(&s, 100, 30, &mut view);
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
            screen(&s, width, height, &mut View::default());
        }
        assert!(crate::as_text(&s).contains("mode 77"));
    }
}
