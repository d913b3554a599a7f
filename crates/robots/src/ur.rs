//! Universal Robots by RTDE: joint states and targets of a Universal Robots controller on the bus.

use std::fmt::Write as _;
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use rivet::{OpenError, Robot, Sample, Status, sample_flags};
use rivet_files::{StatusLine, note, printable};
use rivet_ipc_schema::{BusConfig, faults};
use rivet_realtime::{Shutdown, now_ns};
use rivet_rtde::robot::{CANDIDATES, JOINTS, Missing};
use rivet_rtde::{
    Arrival, Client, ControllerVersion, Event, Fields, Listener, Reading, RobotMode, RtdeError, SafetyMode,
    TextMessage, Timeline, Torque,
};

use crate::backoff::Backoff;

/// Time for a connection to be made, and for the answer to a request.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest wait of a read: the shutdown flag is checked between two.
const LOOK: Duration = Duration::from_millis(50);
/// Silence after which the connection is given up: the controller sends in every mode.
const LONGEST_SILENCE: Duration = Duration::from_secs(2);
/// Time between two pictures of the status line.
const BETWEEN_PICTURES: Duration = Duration::from_secs(1);
/// Texts of the controller that are shown in a second; the rest is counted.
const TEXTS_PER_SECOND: u32 = 10;
/// Largest relative difference of two rates that are the same.
const RATE_TOLERANCE: f64 = 1e-6;

/// Which controller is read, and how long.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Where the samples go.
    pub bus: BusConfig,
    /// Name or address of the controller.
    pub host: String,
    /// TCP port of RTDE.
    pub port: u16,
    /// Samples a second \[Hz\]; it must be 1 / sample_period_s of the robot file.
    pub rate_hz: Option<f64>,
    /// The end after so many seconds of samples \[s\].
    pub seconds: Option<f64>,
    /// Draw a status line where standard error is a terminal.
    pub draws_status: bool,
}

/// Why a controller cannot be read. Whatever another attempt may mend is no error.
#[derive(Debug, thiserror::Error)]
pub enum UrError {
    /// Settings that do not fit the robot file.
    #[error("{0}")]
    Settings(String),
    /// A robot file that does not fit the controller.
    #[error("{0}")]
    RobotFile(String),
    /// The controller does not speak the protocol.
    #[error("{0}")]
    Protocol(RtdeError),
    /// The controller lacks a field.
    #[error("{0}")]
    Missing(#[from] Missing),
    /// The bus cannot be joined.
    #[error("{0}")]
    Bus(#[from] OpenError),
    /// The bus takes no sample any more.
    #[error("the sample cannot be published ({status:?}): {why}")]
    Publish {
        /// What the library returned.
        status: Status,
        /// What failed last on its thread.
        why: String,
    },
}

/// What came, over all connections.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Version of the controller's software, of the last handshake.
    pub controller: Option<String>,
    /// Field that became the torque.
    pub torque_field: Option<&'static str>,
    /// Connections that got as far as data.
    pub connections: u64,
    /// Times that the controller started anew.
    pub restarts: u64,
    /// Samples published.
    pub samples: u64,
    /// Samples that are missing by the controller's timestamps.
    pub lost: u64,
    /// Packages without a new timestamp.
    pub repeated: u64,
    /// Samples published with a fault bit.
    pub with_fault_bit: u64,
    /// Samples published that the bus did not get.
    pub not_sent: u64,
    /// Texts of the controller.
    pub texts: u64,
}

/// Reads the controller and publishes its samples until `shutdown` asks for the end, or the settings do.
///
/// # Errors
/// Somebody has to change something: settings, robot file, controller, bus.
pub fn run(robot: &rivet_config::Robot, settings: &Settings, shutdown: &Shutdown) -> Result<Summary, UrError> {
    let mut bridge = Bridge::new(robot, settings, shutdown.clone())?;
    let mut backoff = Backoff::new();
    let mut shown = String::new();
    while let Err(why) = bridge.session() {
        let why = match why {
            Failure::Final(why) => return Err(why),
            Failure::Again(why) => why,
        };
        bridge.status.remove();
        if shutdown.is_requested() {
            break;
        }
        if bridge.has_samples {
            backoff.reset();
            shown.clear();
        }
        // The same words once, not at every attempt.
        if why != shown {
            let (host, port) = (&settings.host, settings.port);
            note(format_args!("rivet robot: {host}:{port}: {why}; trying again at least every 5 s"));
            shown = why;
        }
        backoff.wait(shutdown);
    }
    bridge.status.remove();
    Ok(bridge.finish())
}

/// Why a session ended.
enum Failure {
    /// Another attempt may succeed.
    Again(String),
    /// Somebody has to change something.
    Final(UrError),
}

impl From<RtdeError> for Failure {
    fn from(why: RtdeError) -> Failure {
        match why {
            RtdeError::Protocol => Failure::Final(UrError::Protocol(why)),
            _ => Failure::Again(why.to_string()),
        }
    }
}

struct Bridge<'a> {
    settings: &'a Settings,
    shutdown: Shutdown,
    name: String,
    /// Closed between the end of one incarnation of the controller and the first sample of the next.
    robot: Option<Robot>,
    period_s: f64,
    gain: Option<[f64; JOINTS]>,
    from_current: bool,
    timeline: Timeline,
    counts: Summary,
    /// Of the last handshake.
    controller: Option<(ControllerVersion, Torque)>,
    modes: (Option<RobotMode>, Option<SafetyMode>),
    texts: Texts,
    status: Picture,
    /// A sample came on this connection.
    has_samples: bool,
    full: bool,
}

impl<'a> Bridge<'a> {
    fn new(robot: &rivet_config::Robot, settings: &'a Settings, shutdown: Shutdown) -> Result<Bridge<'a>, UrError> {
        let (name, period_s) = (robot.config.name.clone(), robot.config.sample_period_s);
        if robot.dof() != JOINTS {
            let why = format!("{name} has {} joints; Universal Robots arms have {JOINTS}", robot.dof());
            return Err(UrError::RobotFile(why));
        }
        if let Some(rate) = settings.rate_hz
            && (rate * period_s - 1.0).abs() > RATE_TOLERANCE
        {
            let why =
                format!("--rate {rate}: sample_period_s of the robot file is {period_s}; set it to {}", 1.0 / rate);
            return Err(UrError::Settings(why));
        }
        Ok(Bridge {
            robot: Some(Robot::open(&settings.bus, &name, JOINTS as u32)?),
            settings,
            shutdown,
            name,
            period_s,
            gain: robot.config.drive.drive_gain.as_ref().and_then(|gain| gain[..].try_into().ok()),
            from_current: robot.config.log.torque_from_current,
            timeline: Timeline::new(period_s),
            counts: Summary::default(),
            controller: None,
            modes: (None, None),
            texts: Texts { second: Instant::now(), shown: 0, count: 0 },
            status: Picture { line: StatusLine::new(settings.draws_status), drawn: None },
            has_samples: false,
            full: false,
        })
    }

    /// One connection, from its first byte to the end that the user asked for.
    fn session(&mut self) -> Result<(), Failure> {
        self.has_samples = false;
        let stream = self.stream()?;
        let mut answers =
            Answers { texts: &mut self.texts, shutdown: &self.shutdown, until: Instant::now() + PATIENCE };
        let mut client = Client::connect(stream, &mut answers)?;
        answers.again();
        let version = client.version(&mut answers)?;
        let rate_hz = rate(version, self.period_s)?;
        answers.again();
        let known = client.set_up(rate_hz, &CANDIDATES, &mut answers)?;
        let torque = Torque::choose(&known, self.gain, self.from_current)
            .map_err(|why| Failure::Final(UrError::RobotFile(format!("PolyScope {version}: {why}"))))?;
        let names = Fields::names(&known, &torque);
        answers.again();
        let recipe = client.set_up(rate_hz, &names, &mut answers)?;
        let fields = Fields::new(&recipe, torque).map_err(|why| Failure::Final(why.into()))?;
        answers.again();
        client.start(&mut answers)?;
        self.counts.connections += 1;
        self.connected(version, torque, &fields, rate_hz);
        self.samples(&mut client, &fields)?;
        // What the controller does with it is its own affair: the connection ends here.
        let _ = client.pause();
        Ok(())
    }

    fn stream(&self) -> Result<TcpStream, Failure> {
        let again = |why: std::io::Error| Failure::Again(why.to_string());
        let mut last = std::io::Error::other("the name has no address");
        for address in (self.settings.host.as_str(), self.settings.port).to_socket_addrs().map_err(again)? {
            match TcpStream::connect_timeout(&address, PATIENCE) {
                Ok(stream) => {
                    stream.set_nodelay(true).map_err(again)?;
                    stream.set_read_timeout(Some(LOOK)).map_err(again)?;
                    stream.set_write_timeout(Some(PATIENCE)).map_err(again)?;
                    return Ok(stream);
                }
                Err(why) => last = why,
            }
        }
        Err(again(last))
    }

    /// What was agreed on, in two lines, where it differs from last time.
    fn connected(&mut self, version: ControllerVersion, torque: Torque, fields: &Fields, rate_hz: f64) {
        if self.controller == Some((version, torque)) {
            note("rivet robot: connected again");
        } else {
            let (host, port) = (&self.settings.host, self.settings.port);
            let plan = if fields.has_plan() { "target_q, target_qd, target_qdd" } else { "none in this software" };
            note(format_args!("rivet robot: {host}:{port}: PolyScope {version}, {rate_hz} Hz, setpoint: {plan}"));
            note(format_args!("rivet robot: torque: {torque}; target_moment is a model's and is not used"));
        }
        self.controller = Some((version, torque));
    }

    /// Publishes what comes, until the user ends it.
    fn samples(&mut self, client: &mut Client<TcpStream>, fields: &Fields) -> Result<(), Failure> {
        let mut quiet = Duration::ZERO;
        let mut ignored = false;
        while !self.shutdown.is_requested() && !self.is_done() {
            let (begin, before) = (Instant::now(), self.counts.samples);
            match client.poll()? {
                Event::Data(values) => {
                    let reading = fields.read(&values);
                    let arrival = self.timeline.take(reading.timestamp_s, now_ns(), !self.has_samples);
                    self.take(&reading, arrival).map_err(Failure::Final)?;
                    self.has_samples = true;
                }
                Event::Text(text) => self.texts.show(&text),
                Event::Ignored(kind) if !ignored => {
                    ignored = true;
                    note(format_args!("rivet robot: packages of type {kind} are ignored"));
                }
                Event::Nothing | Event::Ignored(_) => {}
            }
            // Time in which this process did not run is no silence of the controller's.
            quiet = if self.counts.samples > before { Duration::ZERO } else { quiet + begin.elapsed().min(2 * LOOK) };
            if quiet > LONGEST_SILENCE {
                return Err(Failure::Again(format!("no new sample for {} s", LONGEST_SILENCE.as_secs())));
            }
            self.status.draw(&self.counts, self.period_s, self.modes);
        }
        Ok(())
    }

    fn is_done(&self) -> bool {
        self.settings
            .seconds
            .is_some_and(|most| self.counts.samples as f64 * self.period_s >= most - 0.5 * self.period_s)
    }

    fn take(&mut self, reading: &Reading, arrival: Arrival) -> Result<(), UrError> {
        let stamp_ns = match arrival {
            Arrival::First { stamp_ns } => {
                if self.counts.samples > 0 {
                    self.counts.restarts += 1;
                    note("rivet robot: the controller has started anew: the samples count from 1 again");
                    self.close();
                }
                stamp_ns
            }
            Arrival::Next { stamp_ns, missing } => {
                self.counts.lost += missing;
                if let Some(robot) = self.robot.as_mut() {
                    robot.skip(missing);
                }
                stamp_ns
            }
            Arrival::Repeated | Arrival::Broken => {
                self.counts.repeated += 1;
                return Ok(());
            }
        };
        self.modes_changed(reading);
        let sample = sample(reading, stamp_ns);
        self.counts.with_fault_bit += u64::from(sample.faults != 0);
        let robot = match &mut self.robot {
            Some(robot) => robot,
            None => self.robot.insert(Robot::open(&self.settings.bus, &self.name, JOINTS as u32)?),
        };
        self.counts.samples += 1;
        match robot.publish(&sample) {
            Status::Ok => self.full = false,
            // The library counts it, and the daemon sees the gap.
            Status::Full if self.full => {}
            Status::Full => {
                self.full = true;
                note("rivet robot: the bus does not keep up and samples are lost; give the process more priority");
            }
            status => return Err(UrError::Publish { status, why: robot.problem() }),
        }
        Ok(())
    }

    /// Says which mode is in force, where it changed.
    fn modes_changed(&mut self, reading: &Reading) {
        let modes = (reading.robot_mode, reading.safety);
        if modes == self.modes {
            return;
        }
        self.modes = modes;
        let is_used = faults_of(reading) == 0;
        let mut line = String::new();
        // Writing to a string cannot fail.
        let _ = modes.0.map(|mode| write!(line, ": robot {mode}"));
        let _ = modes.1.map(|mode| write!(line, "{} safety {mode}", if line.is_empty() { ":" } else { "," }));
        let consequence = if is_used { "" } else { "; samples carry a fault bit until that ends" };
        self.status.remove();
        note(format_args!("rivet robot{line}{consequence}"));
    }

    /// Leaves the bus, with what it counted.
    fn close(&mut self) {
        if let Some(robot) = self.robot.take() {
            self.counts.not_sent += not_sent(&robot);
        }
    }

    fn finish(mut self) -> Summary {
        self.close();
        Summary {
            controller: self.controller.map(|(version, _)| version.to_string()),
            torque_field: self.controller.map(|(_, torque)| torque.field()),
            texts: self.texts.count,
            ..self.counts
        }
    }
}

/// Samples that did not reach the bus, once all that waited was sent.
fn not_sent(robot: &Robot) -> u64 {
    let begin = Instant::now();
    let waits = || {
        let counters = robot.counters();
        counters.sent + counters.failed + counters.lost < counters.published
    };
    while waits() && begin.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(1));
    }
    let counters = robot.counters();
    counters.published - counters.sent
}

/// Rate to ask for \[Hz\]: an n-th of the controller's own.
fn rate(version: ControllerVersion, period_s: f64) -> Result<f64, Failure> {
    let (rate_hz, most_hz) = (1.0 / period_s, version.control_rate_hz());
    let parts = most_hz / rate_hz;
    if parts < 1.0 - RATE_TOLERANCE || (parts - parts.round()).abs() > RATE_TOLERANCE * parts {
        let why = format!(
            "sample_period_s is {period_s}; PolyScope {version} sends at {most_hz} Hz and whole parts of it; set sample_period_s = {}",
            1.0 / most_hz
        );
        return Err(Failure::Final(UrError::RobotFile(why)));
    }
    Ok(most_hz / parts.round())
}

/// Fault bits: the drives of an arm that does not run are off; in a stop something else than the drives may move the arm; what is
/// not finite is no measurement.
fn faults_of(reading: &Reading) -> u32 {
    let stopped = reading.robot_mode.is_some_and(|mode| !mode.is_running());
    let is_stopped_by_safety = reading.safety.is_some_and(|mode| !mode.is_free());
    let is_damaged = reading.q.iter().chain(&reading.tau).any(|value| !value.is_finite());
    (if stopped { faults::STOPPED } else { 0 }) | (if is_stopped_by_safety || is_damaged { faults::OTHER } else { 0 })
}

fn sample(reading: &Reading, stamp_ns: u64) -> Sample {
    let mut sample = Sample { stamp_ns, faults: faults_of(reading), ..Sample::default() };
    sample.q[..JOINTS].copy_from_slice(&reading.q);
    sample.tau[..JOINTS].copy_from_slice(&reading.tau);
    if let Some([q, qd, qdd]) = &reading.plan {
        sample.flags |= sample_flags::SETPOINT;
        sample.q_des[..JOINTS].copy_from_slice(q);
        sample.qd_des[..JOINTS].copy_from_slice(qd);
        sample.qdd_des[..JOINTS].copy_from_slice(qdd);
    }
    if let Some(temperature) = &reading.temperature {
        sample.flags |= sample_flags::TEMPERATURE;
        sample.temperature[..JOINTS].copy_from_slice(temperature);
    }
    sample
}

/// Texts of the controller: a few a second are shown, all are counted.
struct Texts {
    second: Instant,
    shown: u32,
    count: u64,
}

impl Texts {
    fn show(&mut self, message: &TextMessage) {
        self.count += 1;
        if self.second.elapsed() >= Duration::from_secs(1) {
            (self.second, self.shown) = (Instant::now(), 0);
        }
        self.shown += 1;
        let TextMessage { text, source, level } = message;
        // A line break of the controller's must not begin a line that looks like this program's.
        let [text, source] = [text, source].map(|words| printable(words));
        match self.shown {
            ..=TEXTS_PER_SECOND => note(format_args!("rivet robot: the controller's {source} ({level}): {text}")),
            shown if shown == TEXTS_PER_SECOND + 1 => {
                note("rivet robot: more texts of the controller are counted only");
            }
            _ => {}
        }
    }
}

/// Waits for answers in the handshake.
struct Answers<'a> {
    texts: &'a mut Texts,
    shutdown: &'a Shutdown,
    until: Instant,
}

impl Answers<'_> {
    /// Another request, with the whole time.
    fn again(&mut self) {
        self.until = Instant::now() + PATIENCE;
    }
}

impl Listener for Answers<'_> {
    fn waits(&mut self) -> bool {
        !self.shutdown.is_requested() && Instant::now() < self.until
    }

    fn text(&mut self, message: &TextMessage) {
        self.texts.show(message);
    }
}

/// The status line, drawn once a second.
struct Picture {
    line: StatusLine,
    drawn: Option<Instant>,
}

impl Picture {
    fn draw(&mut self, counts: &Summary, period_s: f64, modes: (Option<RobotMode>, Option<SafetyMode>)) {
        if !self.line.is_shown() || self.drawn.is_some_and(|drawn| drawn.elapsed() < BETWEEN_PICTURES) {
            return;
        }
        self.drawn = Some(Instant::now());
        let mut text =
            format!("{:.0} s, {} samples, {} lost", counts.samples as f64 * period_s, counts.samples, counts.lost);
        // Writing to a string cannot fail.
        let _ = modes.0.map(|mode| write!(text, "; robot {mode}"));
        let _ = modes.1.map(|mode| write!(text, ", safety {mode}"));
        self.line.draw(&(text + "; Ctrl-C ends"));
    }

    fn remove(&mut self) {
        self.drawn = None;
        self.line.remove();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(robot_mode: i32, safety: i32) -> Reading {
        Reading {
            timestamp_s: 1.0,
            q: [1.0; JOINTS],
            tau: [2.0; JOINTS],
            plan: Some([[3.0; JOINTS], [4.0; JOINTS], [5.0; JOINTS]]),
            temperature: Some([30.0; JOINTS]),
            robot_mode: Some(RobotMode(robot_mode)),
            safety: Some(SafetyMode(safety)),
        }
    }

    #[test]
    fn modes_become_fault_bits() {
        assert_eq!(faults_of(&reading(7, 1)), 0);
        assert_eq!(faults_of(&reading(7, 2)), 0, "reduced");
        assert_eq!(faults_of(&reading(3, 1)), faults::STOPPED, "power off");
        assert_eq!(faults_of(&reading(7, 3)), faults::OTHER, "protective stop");
        assert_eq!(faults_of(&reading(3, 7)), faults::STOPPED | faults::OTHER, "emergency stop");
        let damaged = Reading { tau: [f64::NAN; JOINTS], ..reading(7, 1) };
        assert_eq!(faults_of(&damaged), faults::OTHER, "not finite");
        let unknown = Reading { robot_mode: None, safety: None, ..reading(0, 0) };
        assert_eq!(faults_of(&unknown), 0);
    }

    #[test]
    fn a_reading_becomes_a_sample_of_six_joints() {
        let sample = sample(&reading(7, 1), 9);
        assert_eq!((sample.stamp_ns, sample.faults), (9, 0));
        assert_eq!(
            [sample.q[5], sample.tau[5], sample.q_des[5], sample.qd_des[5], sample.qdd_des[5]],
            [1.0, 2.0, 3.0, 4.0, 5.0]
        );
        assert_eq!((sample.temperature[5], sample.q[6]), (30.0, 0.0));
        assert_eq!(sample.flags, sample_flags::SETPOINT | sample_flags::TEMPERATURE);
    }

    #[test]
    fn rates_are_whole_parts_of_the_controller_s() {
        let version = |major| ControllerVersion { major, ..ControllerVersion::default() };
        let rate = |major, period_s| rate(version(major), period_s).map_err(|_| ());
        assert_eq!([rate(5, 0.002), rate(5, 0.004), rate(10, 0.008)], [Ok(500.0), Ok(250.0), Ok(125.0)]);
        assert_eq!([rate(3, 0.008), rate(3, 0.016)], [Ok(125.0), Ok(62.5)]);
        assert_eq!([rate(3, 0.002), rate(5, 0.001), rate(5, 0.003)], [Err(()); 3]);
    }
}
