//! Nothing in the loop allocates, makes a system call that it should not, or meets a page that is not there, with samples of
//! every kind; and each guard sees it when something does.

mod watch;

use rivet_config::Trigger;
use rivet_daemon::{Channels, Core, Incoming, LoopSettings, Outbound, Progress, RealTimeLoop};
use rivet_ipc_schema::{
    Bus, ControlCommand, HISTOGRAM_BINS, Health, JointState, LoadLevel, PHASES, Parameters, PrivateBus, Publisher,
    RobotName, Setpoint, Timing, WORST_PERIODS, parameter_flags,
};
use rivet_realtime::{Overrun, RealTimeSettings, ThreadUsage};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use watch::{Seen, watch_this_thread, watched};

/// Reads the thread's own counters, with a message or a period that was one of the worst.
const GETRUSAGE: i32 = libc::SYS_getrusage as i32;

/// The loop and the robot's side of the bus, on one thread: period after period.
struct Bench {
    turning: RealTimeLoop,
    outbound: rtrb::Consumer<Outbound>,
    _commands: rtrb::Producer<ControlCommand>,
    states: Publisher<JointState>,
    setpoints: Publisher<Setpoint>,
    seq: u64,
    parameters: Option<Parameters>,
    health: Option<Health>,
    timing: Option<Timing>,
    _bus: Bus,
    _private: PrivateBus,
}

impl Bench {
    fn new(label: &str, period: Duration) -> Bench {
        let private = PrivateBus::new(label);
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/staubli-tx40/robot.toml");
        let robot = rivet_config::load(file).expect("the robot file is sound");
        let name = RobotName::new(&robot.config.name).expect("a sound name");
        let core = Core::new(&robot).expect("sound settings");
        let settings = LoopSettings {
            period,
            trigger: Trigger::Timer,
            overrun: Overrun::Skip,
            catch_up: 16,
            health_every: 250,
            stale_ns: 200_000_000,
            realtime: RealTimeSettings::default(),
        };
        let (producer, outbound) = rtrb::RingBuffer::new(64);
        let (commands, requests) = rtrb::RingBuffer::new(16);
        let progress = Arc::new(Progress::default());
        let channels = Channels { outbound: producer, commands: requests, reload: Incoming::none(), progress };
        let turning = RealTimeLoop::open(core, &settings, private.config(), &name, channels);
        let bus = Bus::open(private.config(), &name, "test-robot").expect("the bus opens");
        Bench {
            turning: turning.expect("the loop opens"),
            outbound,
            _commands: commands,
            states: bus.joint_state_publisher().expect("a publisher"),
            setpoints: bus.setpoint_publisher().expect("a publisher"),
            seq: 0,
            parameters: None,
            health: None,
            timing: None,
            _bus: bus,
            _private: private,
        }
    }

    /// Publishes a sample, every so often a spoilt one, and takes what was handed over.
    fn feed(&mut self) {
        self.seq += 1;
        let t = self.seq as f64 * 0.001;
        let mut state =
            JointState { seq: self.seq, stamp_ns: self.seq * 1_000_000, joints: 6, ..JointState::default() };
        let mut setpoint = Setpoint { seq: self.seq, stamp_ns: state.stamp_ns, joints: 6, ..Setpoint::default() };
        for j in 0..6 {
            let w = 1.0 + j as f64;
            state.q[j] = 0.3 * (w * t).sin();
            state.tau[j] = 10.0 * (w * t + 0.3).cos();
            (setpoint.q[j], setpoint.qd[j], setpoint.qdd[j]) =
                (state.q[j], 0.3 * w * (w * t).cos(), -0.3 * w * w * (w * t).sin());
        }
        match self.seq % 4001 {
            1 => state.q[0] = f64::NAN,
            2 => state.tau[5] = f64::INFINITY,
            3 => state.joints = u32::MAX,
            4 => state.faults = 1,
            5 => state.seq = 0,
            6 => state.q = [1e300; 8],
            7 => state.tau = [f64::MIN_POSITIVE / 2.0; 8],
            8 => setpoint.qdd[2] = f64::NAN,
            9 => state.q[3] += 1.0,
            10 => state.stamp_ns = u64::MAX,
            _ => {}
        }
        self.setpoints.send(&setpoint).expect("sent");
        self.states.send(&state).expect("sent");
        while let Ok(message) = self.outbound.pop() {
            match message {
                Outbound::Parameters(set) => self.parameters = Some(set),
                Outbound::Health(health) => self.health = Some(health),
                Outbound::Timing(timing) => self.timing = Some(timing),
            }
        }
    }

    /// Feeds and runs `periods`; what the work of all of them did that it should not, the period it did it in, and page faults.
    fn run(&mut self, periods: u64, mut creep: impl FnMut(u64)) -> (Option<(u64, Seen)>, u64) {
        let mut bad = None;
        let mut faults = 0;
        for k in 0..periods {
            self.feed();
            let wake = self.turning.wait();
            let before = ThreadUsage::now().faults;
            let seen = watched(|| {
                self.turning.work(wake);
                creep(k);
            });
            faults += ThreadUsage::now().faults - before;
            let allowed = seen.allocations == 0 && seen.call.is_none_or(|call| call == GETRUSAGE);
            if !allowed && bad.is_none() {
                bad = Some((k, seen));
            }
        }
        (bad, faults)
    }
}

#[test]
fn a_hundred_thousand_periods_allocate_nothing_call_nothing_and_meet_no_page_fault() {
    if !watch_this_thread() {
        return;
    }
    // Long enough for the work, or it would be left out; short enough for a test.
    let mut bench = Bench::new("guards", Duration::from_micros(100));
    // As the daemon does, after everything was made; else the ring of samples meets each of its pages once.
    let locked = RealTimeSettings { lock_memory: true, ..RealTimeSettings::default() };
    let granted = rivet_realtime::enter(&locked).expect("best effort");
    bench.run(3000, |_| {});
    let (bad, faults) = bench.run(100_000, |_| {});
    assert_eq!(bad, None, "the first period that did something, and what");
    if granted.memory_locked {
        assert_eq!(faults, 0, "page faults after warm-up");
    } else {
        eprintln!("SKIPPED: page faults are not judged: memory cannot be locked ({:?})", granted.refused);
    }
    let health = bench.health.expect("reported");
    assert!(health.samples > 90_000 && health.refused_invalid > 50, "{health:?}");
    assert!(health.input_faults.iter().filter(|&&count| count > 0).count() >= 5, "{:?}", health.input_faults);
    let timing = bench.timing.as_ref().expect("reported");
    let counts = timing.phase_histogram.chunks(HISTOGRAM_BINS).map(|bins| bins.iter().map(|&n| u64::from(n)).sum());
    let counts: [u64; PHASES] = counts.collect::<Vec<u64>>().try_into().expect("seven phases");
    assert!(counts.iter().all(|&count| count > 50_000), "every phase is timed: {counts:?}");
    assert_eq!(timing.count as usize, WORST_PERIODS);

    // What the guards see when something creeps in, in one period of a hundred.
    let (bad, _) = bench.run(100, |k| {
        if k == 50 {
            std::hint::black_box(Box::new(k));
        }
    });
    assert_eq!(bad, Some((50, Seen { allocations: 2, call: None })), "a box: one allocation, one release");
    let (bad, _) = bench.run(100, |k| {
        if k == 51 {
            std::thread::sleep(Duration::from_nanos(1));
        }
    });
    let (period, seen) = bad.expect("a sleep is seen");
    assert!(period == 51 && seen.call == Some(libc::SYS_clock_nanosleep as i32), "{seen:?}");
    let (bad, _) = bench.run(100, |k| {
        if k == 52 {
            rustix::thread::sched_yield();
        }
    });
    assert_eq!(bad.map(|(k, seen)| (k, seen.call)), Some((52, Some(libc::SYS_sched_yield as i32))));
    let mut pages = Pages::new(16);
    let (bad, faults) = bench.run(100, |k| {
        if k == 53 {
            pages.touch();
        }
    });
    assert_eq!((bad, faults), (None, 16), "sixteen pages that are not there");
}

/// Memory whose pages the kernel has taken back.
struct Pages(Vec<u8>, usize);

/// Apart by more than a page of any size that the kernel may give at once.
const APART: usize = 2 << 20;

impl Pages {
    #[allow(unsafe_code, reason = "pages are given back by calls that have no safe wrapper")]
    fn new(count: usize) -> Pages {
        let mut memory = vec![1_u8; (count + 1) * APART];
        let size = memory.len() / 4096 * 4096;
        let begin = memory.as_mut_ptr().cast::<libc::c_void>();
        // To the next page: what lies before it in the first one is not ours alone.
        let begin = begin.wrapping_byte_add(begin.align_offset(4096));
        // SAFETY: the range lies within `memory`, which holds bytes that may become zero.
        let released = unsafe {
            libc::munlock(begin, size - 4096) == 0 && libc::madvise(begin, size - 4096, libc::MADV_DONTNEED) == 0
        };
        assert!(released, "{}", std::io::Error::last_os_error());
        Pages(memory, count)
    }

    fn touch(&mut self) {
        for page in 0..self.1 {
            self.0[page * APART + 8192] = 1;
        }
        std::hint::black_box(&mut self.0);
    }
}

/// Samples that lay about for a while before they were taken: what was made of them says so, and carries their stamp.
#[test]
fn a_set_that_is_late_says_so() {
    let mut bench = Bench::new("late", Duration::from_micros(100));
    let run = |bench: &mut Bench, periods: u64| {
        for _ in 0..periods {
            bench.feed();
            bench.turning.period();
        }
        bench.feed();
        bench.parameters.take()
    };
    let fresh = run(&mut bench, 150).expect("published");
    assert_eq!(fresh.flags & parameter_flags::LATE, 0);
    // A robot that stands still for a while and then goes on with the stamps of before.
    std::thread::sleep(Duration::from_millis(400));
    let late = run(&mut bench, 60).expect("published");
    assert_ne!(late.flags & parameter_flags::LATE, 0);
    assert_eq!(late.stamp_ns, late.seq * 1_000_000, "the sample's own");
}

/// Periods far too short for the work: the ladder goes up, and everything published says so.
#[test]
fn work_that_does_not_fit_is_left_out_step_by_step_and_said() {
    let mut bench = Bench::new("ladder", Duration::from_micros(1));
    let mut levels = Vec::new();
    for _ in 0..1500 {
        bench.feed();
        bench.turning.period();
        if let Some(health) = &bench.health
            && levels.last() != Some(&health.load_level)
        {
            levels.push(health.load_level);
        }
    }
    let health = bench.health.expect("reported");
    assert_eq!(health.load_level, u32::from(LoadLevel::Hold), "{levels:?}");
    assert_eq!(health.load_changes, 3, "one level after the other");
    let set = bench.parameters.expect("still published, if less often");
    assert_eq!(set.flags >> parameter_flags::LOAD_SHIFT & 3, u32::from(LoadLevel::Hold));
    assert!(health.samples < 300, "nothing is learnt any more: {}", health.samples);
}
