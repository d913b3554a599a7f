//! `rivet monitor`: what daemon and controller say of themselves, live or once.
//!
//! It subscribes to health and parameters, which the daemon's bus thread and the controller's service thread send; the
//! real-time loops do not know that it is there.

use crate::control::OnBus;
use crate::table::{show, show_json};
use anyhow::{Result, bail};
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use rivet_ipc_schema::{Bus, RobotName};
use rivet_monitor::{Ports, Snapshot, View, as_json, as_text, draw};
use rivet_realtime::Shutdown;
use std::io::IsTerminal as _;
use std::process::ExitCode;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Shows loop timing, drops, residuals, parameters, supervision, faults, and the controller beside it.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    bus: OnBus,
    /// Print one report as text and end (default without a terminal). Exit code 0: rivetd reported; 1: rivet-controller
    /// only; 70: neither
    #[arg(long)]
    once: bool,
    /// Print one report as JSON and end, as --once does (docs/operating.md)
    #[arg(long)]
    json: bool,
    /// Seconds to wait for the first report with --once
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = crate::number::seconds)]
    patience: f64,
}

/// Time between two looks at the bus; the daemon tells of what is new a few times a second at most.
const TURN: Duration = Duration::from_millis(100);

/// Time that others have once somebody has been heard.
const GRACE: Duration = Duration::from_millis(200);

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = rivet_config::load(&args.bus.robot)?;
    let config = args.bus.config(&robot.config.bus);
    let bus = Bus::open(&config, &RobotName::new(&robot.config.name)?, "rivet-monitor")?;
    let ports = Ports::open(&bus)?;
    let mut snapshot = Snapshot::new(&robot, &config);
    if args.once || args.json || !std::io::stdout().is_terminal() {
        let patience = Duration::try_from_secs_f64(args.patience).unwrap_or(Duration::ZERO);
        return once(&ports, &mut snapshot, patience, args.json);
    }
    let shutdown = Shutdown::on_signals()?;
    let mut terminal = ratatui::init();
    let result = live(&mut terminal, &ports, &mut snapshot, &shutdown);
    // A terminal that is gone needs nothing restored, and cannot be told so either.
    let _ = ratatui::try_restore();
    result.map(|()| ExitCode::SUCCESS)
}

/// What a look tells the shell where only the controller was heard.
const NO_DAEMON: u8 = 1;

fn once(ports: &Ports, snapshot: &mut Snapshot, patience: Duration, as_document: bool) -> Result<ExitCode> {
    let begin = Instant::now();
    // Late subscribers get the last message of each within some milliseconds: once one has come, the others soon have.
    // That the daemon is not there is said only when patience has ended.
    let mut first: Option<Instant> = None;
    while begin.elapsed() < patience
        && (first.is_none_or(|first| first.elapsed() < GRACE) || snapshot.health.is_none())
        && !snapshot.is_complete()
    {
        std::thread::sleep(Duration::from_millis(5));
        snapshot.take(ports)?;
        if first.is_none() && !snapshot.is_empty() {
            first = Some(Instant::now());
        }
    }
    if snapshot.is_empty() {
        bail!("neither rivetd nor rivet-controller is on this bus");
    }
    if as_document {
        show_json(&as_json(snapshot))?;
    } else {
        show(&as_text(snapshot))?;
    }
    Ok(if snapshot.health.is_some() { ExitCode::SUCCESS } else { ExitCode::from(NO_DAEMON) })
}

/// Keys as they are pressed. A thread of their own reads them: on a terminal that has vanished the library looks for more without
/// end, which must keep nobody from ending the program.
fn keys() -> Receiver<KeyEvent> {
    let (pressed, keys) = mpsc::channel();
    std::thread::spawn(move || {
        while let Ok(event) = event::read() {
            if let Event::Key(key) = event
                && pressed.send(key).is_err()
            {
                return;
            }
        }
    });
    keys
}

fn live(
    terminal: &mut ratatui::DefaultTerminal,
    ports: &Ports,
    snapshot: &mut Snapshot,
    shutdown: &Shutdown,
) -> Result<()> {
    let mut view = View::default();
    let keys = keys();
    // A terminal that is gone is no terminal any more.
    while !shutdown.is_requested() && std::io::stdin().is_terminal() {
        snapshot.take(ports)?;
        if terminal.draw(|frame| draw(frame, snapshot, &mut view)).is_err() {
            // It went meanwhile.
            return Ok(());
        }
        let key = match keys.recv_timeout(TURN) {
            Ok(key) => key,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        };
        if key.kind == KeyEventKind::Press {
            match key.code {
                KeyCode::Char('q') | KeyCode::Esc => return Ok(()),
                KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => return Ok(()),
                KeyCode::Down | KeyCode::Char('j') => view.scroll(1),
                KeyCode::Up | KeyCode::Char('k') => view.scroll(-1),
                KeyCode::PageDown | KeyCode::Char(' ') => view.scroll_screens(1),
                KeyCode::PageUp => view.scroll_screens(-1),
                KeyCode::Home => view.scroll(isize::MIN),
                KeyCode::End => view.scroll(isize::MAX),
                KeyCode::Right | KeyCode::Char('l') => view.scroll_columns(1),
                KeyCode::Left | KeyCode::Char('h') => view.scroll_columns(-1),
                KeyCode::Tab | KeyCode::BackTab => view.turn(),
                _ => {}
            }
        }
    }
    Ok(())
}
