//! A controller of Universal Robots on a loopback address, driven by the plant of `rivet-sim`: the server's side of RTDE, protocol
//! version 2, written from the public description and with an encoder of its own.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rivet_config::Robot;
use rivet_controller::Core;
use rivet_ipc_schema::{JointState, Setpoint};
use rivet_realtime::now_ns;
use rivet_simulation::Disturbances;
use rivet_simulation::motion::{Fourier, FourierSettings, MotionLimits, load_ratio};

use crate::closed::ClosedLoop;

/// Control period of an e-Series controller \[s\].
pub const PERIOD_S: f64 = 0.002;
/// Torque per ampere of its drives \[N m/A\], the joints alike.
pub const GAIN: f64 = 10.0;
/// Its mode while the drives are on and the brakes open.
const RUNNING: i32 = 7;
/// Its mode while the brakes are closed.
const IDLE: i32 = 5;
/// Safety mode without a stop.
const NORMAL: i32 = 1;

/// One control period of the plant.
pub type Period = (JointState, Setpoint);

/// The plant of `robot` with `disturbances` on a Fourier motion under its controller, `seconds` long.
pub fn motion(robot: &Robot, disturbances: &Disturbances, seconds: f64) -> Vec<Period> {
    let mut load = load_ratio(&robot.model, &robot.nominal, &robot.config.drive.torque_limit);
    let limits = MotionLimits::of(&robot.model.arm, 0.6);
    let motion = Fourier::new(&limits, &FourierSettings::default(), &mut load);
    let mut arm = ClosedLoop::new(robot, disturbances, Box::new(motion), 4);
    let mut controller = Core::new(robot, 0).expect("sound settings");
    let mut periods = Vec::new();
    arm.run(&mut controller, seconds, |_, sample, plan| periods.push((*sample, *plan)), |_| ());
    periods
}

/// How the controller behaves.
#[derive(Clone)]
pub struct Behaviour {
    /// Version of its software.
    pub version: [u32; 4],
    /// Fields that it does not know.
    pub unknown: Vec<&'static str>,
    /// Whether protocol version 2 is accepted.
    pub accepts_protocol: bool,
    /// Whether the motion begins anew at its end; else it falls silent there.
    pub repeats: bool,
    /// Sends each package in pieces of so many bytes.
    pub piece: usize,
}

impl Default for Behaviour {
    fn default() -> Behaviour {
        Behaviour {
            version: [5, 23, 0, 1],
            unknown: Vec::new(),
            accepts_protocol: true,
            repeats: true,
            piece: usize::MAX,
        }
    }
}

/// A client that has started its data.
struct Reader {
    stream: TcpStream,
    fields: Vec<String>,
}

struct State {
    behaviour: Behaviour,
    periods: Vec<Period>,
    /// Control periods since the controller was started.
    ticks: u64,
    /// Time that stood at the start \[s\].
    began_s: f64,
    readers: Vec<Reader>,
    robot_mode: i32,
    safety_mode: i32,
    /// Periods that are computed and not sent.
    muted: u64,
    /// Whether time stands still.
    waits: bool,
    /// When each data package was sent, `CLOCK_MONOTONIC` \[ns\], over all clients.
    sent_ns: Vec<u64>,
}

/// The controller; ends with its threads when dropped.
pub struct UrController {
    address: SocketAddr,
    state: Arc<Mutex<State>>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl UrController {
    /// Starts one at `address` (port 0: any) that plays `periods` once a client has started its data.
    pub fn start(address: &str, periods: Vec<Period>, behaviour: Behaviour) -> UrController {
        let listener = TcpListener::bind(address).unwrap_or_else(|why| panic!("{address}: {why}"));
        let address = listener.local_addr().expect("an address");
        listener.set_nonblocking(true).expect("a listener");
        let state = Arc::new(Mutex::new(State {
            behaviour,
            periods,
            ticks: 0,
            began_s: 1234.5,
            readers: Vec::new(),
            robot_mode: RUNNING,
            safety_mode: NORMAL,
            muted: 0,
            waits: true,
            sent_ns: Vec::new(),
        }));
        let stop = Arc::new(AtomicBool::new(false));
        let accept = {
            let (state, stop) = (Arc::clone(&state), Arc::clone(&stop));
            std::thread::spawn(move || accept(&listener, &state, &stop))
        };
        let tick = {
            let (state, stop) = (Arc::clone(&state), Arc::clone(&stop));
            std::thread::spawn(move || tick(&state, &stop))
        };
        UrController { address, state, stop, threads: vec![accept, tick] }
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Data packages that it has sent, over all clients.
    pub fn sent(&self) -> u64 {
        locked(&self.state).sent_ns.len() as u64
    }

    /// When it has sent each of them, `CLOCK_MONOTONIC` \[ns\].
    pub fn sent_ns(&self) -> Vec<u64> {
        locked(&self.state).sent_ns.clone()
    }

    /// Computes so many periods without sending them.
    pub fn mute(&self, periods: u64) {
        locked(&self.state).muted += periods;
    }

    /// Mode of the arm and of the safety system from now on.
    pub fn set_modes(&self, robot: i32, safety: i32) {
        let mut state = locked(&self.state);
        (state.robot_mode, state.safety_mode) = (robot, safety);
    }

    /// Sends bytes as they are to each client.
    pub fn inject(&self, bytes: &[u8]) {
        for reader in &mut locked(&self.state).readers {
            let _ = reader.stream.write_all(bytes);
        }
    }

    /// Sends a text.
    pub fn say(&self, text: &str, source: &str, level: u8) {
        let mut payload = vec![text.len() as u8];
        payload.extend(text.bytes());
        payload.push(source.len() as u8);
        payload.extend(source.bytes());
        payload.push(level);
        self.inject(&framed(b'M', &payload));
    }

    /// Closes all connections; time goes on.
    pub fn hang_up(&self) {
        for reader in locked(&self.state).readers.drain(..) {
            let _ = reader.stream.shutdown(std::net::Shutdown::Both);
        }
    }

    /// Closes all connections and begins its time and its motion anew.
    pub fn restart(&self) {
        self.hang_up();
        let mut state = locked(&self.state);
        (state.ticks, state.began_s, state.waits) = (0, 12.0, true);
    }
}

impl Drop for UrController {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.hang_up();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn framed(kind: u8, payload: &[u8]) -> Vec<u8> {
    let length = 3 + payload.len() as u16;
    [&[(length >> 8) as u8, (length & 0xff) as u8, kind], payload].concat()
}

fn accept(listener: &TcpListener, state: &Arc<Mutex<State>>, stop: &Arc<AtomicBool>) {
    let mut clients = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        match listener.accept() {
            Ok((stream, _)) => {
                let (state, stop) = (Arc::clone(state), Arc::clone(stop));
                clients.push(std::thread::spawn(move || serve(stream, &state, &stop)));
            }
            Err(_) => std::thread::sleep(Duration::from_millis(2)),
        }
    }
    for client in clients {
        let _ = client.join();
    }
}

/// Answers the requests of one client until it is gone.
fn serve(mut stream: TcpStream, state: &Mutex<State>, stop: &AtomicBool) {
    stream.set_nonblocking(false).expect("a stream");
    stream.set_nodelay(true).expect("a stream");
    stream.set_read_timeout(Some(Duration::from_millis(20))).expect("a stream");
    stream.set_write_timeout(Some(Duration::from_secs(2))).expect("a stream");
    let (mut waiting, mut fields) = (Vec::new(), Vec::new());
    while !stop.load(Ordering::Relaxed) {
        let mut bytes = [0; 512];
        match stream.read(&mut bytes) {
            Ok(0) => return,
            Ok(count) => waiting.extend(&bytes[..count]),
            Err(why) if matches!(why.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => continue,
            Err(_) => return,
        }
        while waiting.len() >= 3 {
            let length = usize::from(waiting[0]) << 8 | usize::from(waiting[1]);
            if waiting.len() < length {
                break;
            }
            let request: Vec<u8> = waiting.drain(..length).collect();
            let answer = answer(&request, &stream, &mut fields, &mut locked(state));
            if stream.write_all(&framed(request[2], &answer)).is_err() {
                return;
            }
            // Data follow the answer, and do not overtake it.
            if request[2] == b'S' {
                let reader = Reader { stream: stream.try_clone().expect("a stream"), fields: fields.clone() };
                let mut state = locked(state);
                state.waits = false;
                state.readers.push(reader);
            }
        }
    }
}

/// The payload of the answer to a request.
fn answer(request: &[u8], stream: &TcpStream, fields: &mut Vec<String>, state: &mut State) -> Vec<u8> {
    let payload = &request[3..];
    match request[2] {
        b'V' => vec![u8::from(state.behaviour.accepts_protocol && payload == [0, 2])],
        b'v' => state.behaviour.version.iter().flat_map(|number| number.to_be_bytes()).collect(),
        b'O' => {
            // A frequency of eight bytes, then names.
            let names = std::str::from_utf8(&payload[8..]).expect("names");
            // Some clients end the list with a comma.
            *fields = names.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect();
            let unknown = |name: &str| state.behaviour.unknown.contains(&name);
            let types: Vec<&str> =
                fields.iter().map(|name| if unknown(name) { "NOT_FOUND" } else { type_of(name) }).collect();
            // A recipe with a field that is not there is no recipe: its number is 0.
            let id = u8::from(!types.contains(&"NOT_FOUND"));
            [&[id], types.join(",").as_bytes()].concat()
        }
        b'S' => vec![1],
        b'P' => {
            let peer = stream.peer_addr().ok();
            state.readers.retain(|reader| reader.stream.peer_addr().ok() != peer);
            vec![1]
        }
        other => panic!("a request of type {other}"),
    }
}

/// Types of the fields, as the description lists them.
fn type_of(name: &str) -> &'static str {
    match name {
        "timestamp" | "speed_scaling" | "target_speed_fraction" | "actual_execution_time" => "DOUBLE",
        "robot_mode" | "safety_mode" | "safety_status" => "INT32",
        "runtime_state" | "robot_status_bits" | "safety_status_bits" => "UINT32",
        "actual_digital_input_bits" | "actual_digital_output_bits" => "UINT64",
        "joint_mode" => "VECTOR6INT32",
        "actual_q"
        | "actual_qd"
        | "target_q"
        | "target_qd"
        | "target_qdd"
        | "actual_current"
        | "target_current"
        | "target_moment"
        | "joint_control_output"
        | "joint_temperatures"
        | "actual_current_as_torque"
        | "actual_TCP_pose"
        | "actual_TCP_speed"
        | "actual_TCP_force" => "VECTOR6D",
        _ => "NOT_FOUND",
    }
}

/// Temperature of joint `j` \[degC\].
pub fn temperature(j: usize) -> f64 {
    30.0 + j as f64
}

/// The value of a field, encoded.
fn value(name: &str, period: &Period, state: &State) -> Vec<u8> {
    let (sample, plan) = period;
    let six = |of: &dyn Fn(usize) -> f64| (0..6).flat_map(|j| of(j).to_be_bytes()).collect::<Vec<u8>>();
    match name {
        "timestamp" => (state.began_s + state.ticks as f64 * PERIOD_S).to_be_bytes().to_vec(),
        "actual_q" => six(&|j| sample.q[j]),
        "target_q" => six(&|j| plan.q[j]),
        "target_qd" | "actual_qd" => six(&|j| plan.qd[j]),
        "target_qdd" => six(&|j| plan.qdd[j]),
        "actual_current_as_torque" => six(&|j| sample.tau[j]),
        "actual_current" => six(&|j| sample.tau[j] / GAIN),
        // Values that show at once where they are taken for a measurement.
        "target_moment" | "target_current" | "joint_control_output" => six(&|_| 1e4),
        "joint_temperatures" => six(&temperature),
        "robot_mode" if sample.faults != 0 && state.robot_mode == RUNNING => IDLE.to_be_bytes().to_vec(),
        "robot_mode" => state.robot_mode.to_be_bytes().to_vec(),
        "safety_mode" | "safety_status" => state.safety_mode.to_be_bytes().to_vec(),
        other => match type_of(other) {
            "UINT32" => vec![0; 4],
            "DOUBLE" | "UINT64" => vec![0; 8],
            "VECTOR6INT32" => vec![0; 24],
            _ => vec![0; 48],
        },
    }
}

/// The control loop: one period after the other, whoever reads.
fn tick(state: &Mutex<State>, stop: &AtomicBool) {
    let period = Duration::from_secs_f64(PERIOD_S);
    let mut due = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        due += period;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let mut state = locked(state);
        let count = state.periods.len() as u64;
        if state.waits || (!state.behaviour.repeats && state.ticks >= count) {
            due = Instant::now();
            continue;
        }
        let period = state.periods[(state.ticks % count) as usize];
        if state.muted > 0 {
            state.muted -= 1;
        } else {
            let mut readers = std::mem::take(&mut state.readers);
            readers.retain_mut(|reader| {
                let mut payload = vec![1];
                reader.fields.iter().for_each(|name| payload.extend(value(name, &period, &state)));
                let package = framed(b'U', &payload);
                let arrived = package.chunks(state.behaviour.piece).all(|piece| reader.stream.write_all(piece).is_ok());
                if arrived {
                    state.sent_ns.push(now_ns());
                }
                arrived
            });
            state.readers = readers;
        }
        state.ticks += 1;
    }
}
