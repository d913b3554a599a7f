//! Nothing in the loop allocates, makes a system call that it should not, or meets a page that is not there, with samples of
//! every kind; and each guard sees it when something does.

mod watch;

use allocation_counter::AllocationInfo;
use rivet_config::Trigger;
use rivet_daemon::{Asking, Channels, Core, Incoming, LoopSettings, Outbound, Progress, RealTimeLoop, snapshots};
use rivet_ipc_schema::{
    Bus, ControlCommand, HISTOGRAM_BINS, Health, InputFault, JointState, LoadLevel, Notifier, PHASES, Parameters,
    PrivateBus, Publisher, RobotName, Setpoint, Timing, WORST_PERIODS, parameter_flags,
};
use rivet_realtime::{Overrun, RealTimeSettings, ThreadUsage};
use rivet_service::Flight;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use watch::{Seen, watch_this_thread, watched};

/// What the work of a period may call: the thread's own counters, with a message or a period that was one of the worst.
const WORK: &[i64] = &[libc::SYS_getrusage];

/// What a wait may call: the timer's sleep; of the bus, waiting for a datagram and taking it.
const TIMER_WAIT: &[i64] = &[libc::SYS_clock_nanosleep];
const SAMPLE_WAIT: &[i64] = &[libc::SYS_pselect6, libc::SYS_recvfrom];

/// Samples from one question of the store's to the next.
const ASK_EVERY: u64 = 500;

/// The loop and the robot's side of the bus, on one thread: period after period.
struct Bench {
    turning: RealTimeLoop,
    outbound: rtrb::Consumer<Outbound>,
    wait: &'static [i64],
    arrival: Notifier,
    _commands: rtrb::Producer<ControlCommand>,
    states: Publisher<JointState>,
    setpoints: Publisher<Setpoint>,
    seq: u64,
    /// What asks for all that the estimator knows, and how often it was answered.
    asking: Asking,
    answers: u64,
    /// System calls of the work so far, all of them allowed ones.
    calls: u32,
    parameters: Option<Parameters>,
    /// All sets so far, and the load levels with the first sample under each.
    sets: Vec<Parameters>,
    levels: Vec<(u64, LoadLevel)>,
    health: Option<Health>,
    timing: Option<Timing>,
    _bus: Bus,
    _private: PrivateBus,
}

impl Bench {
    fn new(label: &str, period: Duration, trigger: Trigger, health_every: u64) -> Bench {
        let private = PrivateBus::new(label);
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/staubli-tx40/robot.toml");
        let robot = rivet_config::load(file).expect("the robot file is sound");
        let name = RobotName::new(&robot.config.name).expect("a sound name");
        let core = Core::new(&robot).expect("sound settings");
        let settings = LoopSettings {
            period,
            trigger,
            overrun: Overrun::Skip,
            catch_up: 16,
            health_every,
            stale_ns: 200_000_000,
            realtime: RealTimeSettings::default(),
        };
        let (producer, outbound) = rtrb::RingBuffer::new(64);
        let (asking, snapshots) = snapshots(core.memory_len());
        let (commands, requests) = rtrb::RingBuffer::new(16);
        let progress = Arc::new(Progress::default());
        let folder = tempfile::tempdir().expect("a folder");
        let flight = Some(Arc::new(Flight::new(folder.path(), "guards", &[("q", 6), ("tau", 6), ("rest", 100)])));
        let channels =
            Channels { outbound: producer, commands: requests, reload: Incoming::none(), snapshots, progress, flight };
        let turning = RealTimeLoop::open(core, &settings, private.config(), &name, channels);
        let bus = Bus::open(private.config(), &name, "test-robot").expect("the bus opens");
        Bench {
            turning: turning.expect("the loop opens"),
            outbound,
            wait: if trigger == Trigger::Timer { TIMER_WAIT } else { SAMPLE_WAIT },
            arrival: bus.joint_state_notifier().expect("a notifier"),
            _commands: commands,
            states: bus.joint_state_publisher().expect("a publisher"),
            setpoints: bus.setpoint_publisher().expect("a publisher"),
            seq: 0,
            asking,
            answers: 0,
            calls: 0,
            parameters: None,
            sets: Vec::new(),
            levels: Vec::new(),
            health: None,
            timing: None,
            _bus: bus,
            _private: private,
        }
    }

    /// Publishes a sample, and takes what was handed over.
    fn feed(&mut self) {
        self.seq += 1;
        // The store asks a thousand times as often as it would.
        if self.seq.is_multiple_of(ASK_EVERY) {
            self.asking.ask();
        }
        self.answers += u64::from(self.asking.is_answered());
        let (state, setpoint) = sample(self.seq);
        self.setpoints.send(&setpoint).expect("sent");
        self.states.send(&state).expect("sent");
        self.arrival.notify().expect("notified");
        while let Ok(message) = self.outbound.pop() {
            match message {
                Outbound::Parameters(set) => {
                    self.parameters = Some(set);
                    self.sets.push(set);
                }
                Outbound::Health(health) => {
                    // Every change is told of: a level lasts for longer than it takes to say so.
                    if health.load_changes > self.levels.len() as u64 {
                        self.levels.push((health.load_seq, LoadLevel::try_from(health.load_level).expect("a level")));
                    }
                    self.health = Some(health);
                }
                Outbound::Timing(timing) => self.timing = Some(timing),
                Outbound::Drift(_) => {}
            }
        }
    }

    /// Feeds and runs `periods`; what the work of all of them did that it should not, the period it did it in, and page faults.
    fn run(&mut self, periods: u64, mut creep: impl FnMut(u64)) -> (Option<(u64, Seen)>, u64) {
        let mut bad = None;
        let mut faults = 0;
        for k in 0..periods {
            self.feed();
            let mut wake = None;
            let waited = watched(self.wait, || wake = Some(self.turning.wait()));
            let before = ThreadUsage::now().faults;
            let worked = watched(WORK, || {
                self.turning.work(wake.expect("it has waited"));
                creep(k);
            });
            faults += ThreadUsage::now().faults - before;
            for seen in [waited, worked] {
                if (seen.heap != AllocationInfo::default() || seen.call.is_some()) && bad.is_none() {
                    bad = Some((k, seen));
                }
            }
            self.calls += worked.calls;
        }
        (bad, faults)
    }
}

/// Sample `seq` and the setpoint of its period; every so often one is spoilt.
fn sample(seq: u64) -> (JointState, Setpoint) {
    let t = seq as f64 * 0.001;
    let mut state = JointState { seq, stamp_ns: seq * 1_000_000, joints: 6, ..JointState::default() };
    let mut setpoint = Setpoint { seq, stamp_ns: state.stamp_ns, joints: 6, ..Setpoint::default() };
    for j in 0..6 {
        let w = 1.0 + j as f64;
        state.q[j] = 0.3 * (w * t).sin();
        state.tau[j] = 10.0 * (w * t + 0.3).cos();
        (setpoint.q[j], setpoint.qd[j], setpoint.qdd[j]) =
            (state.q[j], 0.3 * w * (w * t).cos(), -0.3 * w * w * (w * t).sin());
    }
    match seq % 4001 {
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
    (state, setpoint)
}

#[test]
fn a_hundred_thousand_periods_allocate_nothing_call_nothing_and_meet_no_page_fault() {
    // Long enough for the work, or it would be left out; short enough for a test.
    guarded("guards", Duration::from_micros(100), Trigger::Timer);
}

/// The same where samples begin the periods, as fast as they come.
#[test]
fn nor_do_they_when_samples_begin_them() {
    guarded("guards-sample", Duration::from_millis(1), Trigger::Sample);
}

/// Nor does the core when it takes over other filters and another window between two samples.
#[test]
fn nor_does_a_reload() {
    let _one = WATCHED.lock().unwrap_or_else(PoisonError::into_inner);
    // Without it allocations are still counted.
    watch_this_thread();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/staubli-tx40/robot.toml");
    let robot = rivet_config::load(file).expect("the robot file is sound");
    let mut core = Core::new(&robot).expect("sound settings");
    let mut changed = robot.clone();
    changed.config.signal.model_filter_hz *= 0.8;
    changed.config.estimator.window_s = Some(3.0);
    let mut fresh = Core::new(&changed).expect("sound settings");
    let (mut parameters, mut health, mut published) = (Parameters::default(), Health::default(), 0);
    let seen = watched(&[], || {
        for seq in 1..=100_000_u64 {
            let (state, setpoint) = sample(seq);
            if seq % 10_000 == 0 {
                core.reconfigure(&mut fresh);
            }
            // Now and then the robot has no plan.
            if core.tick(&state, (seq % 7 != 0).then_some(&setpoint)).publish {
                core.write_parameters(&mut parameters);
                core.write_health(&mut health);
                published += 1;
            }
        }
    });
    assert_eq!((seen.heap, seen.call), (AllocationInfo::default(), None), "{seen:?}");
    assert!(published > 100, "{published} publications");
    assert!(parameters.values.iter().all(|x| x.is_finite()));
}

/// What the kernel reads while it watches is one for all threads.
static WATCHED: Mutex<()> = Mutex::new(());

fn guarded(label: &str, period: Duration, trigger: Trigger) {
    let _one = WATCHED.lock().unwrap_or_else(PoisonError::into_inner);
    if !watch_this_thread() {
        return;
    }
    let mut bench = Bench::new(label, period, trigger, 250);
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
    // Where a sample begins the period there is no lateness.
    let phases = if trigger == Trigger::Timer { &counts[..] } else { &counts[1..] };
    assert!(phases.iter().all(|&count| count > 50_000), "every phase is timed: {counts:?}");
    assert_eq!(timing.count as usize, WORST_PERIODS);
    assert!(bench.answers > 90_000 / ASK_EVERY, "what the store asks for is part of the periods: {}", bench.answers);
    assert!(bench.calls >= 400, "the one allowed call is made with every message: {}", bench.calls);

    // What the guards see when something creeps in, in one period of a hundred.
    let (bad, _) = bench.run(100, |k| {
        if k == 50 {
            std::hint::black_box(Box::new(k));
        }
    });
    let (period, seen) = bad.expect("a box is seen");
    assert_eq!((period, seen.heap.count_total, seen.heap.count_current, seen.call), (50, 1, 0, None), "{seen:?}");
    let (bad, _) = bench.run(100, |k| {
        if k == 51 {
            std::thread::sleep(Duration::from_nanos(1));
        }
    });
    let (period, seen) = bad.expect("a sleep is seen");
    assert!(period == 51 && seen.call == Some(libc::SYS_clock_nanosleep as i32), "{seen:?}");
    // Behind an allowed call too.
    let (bad, _) = bench.run(100, |k| {
        if k == 52 {
            ThreadUsage::now();
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
    let mut bench = Bench::new("late", Duration::from_micros(100), Trigger::Timer, 250);
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

/// Health messages that were handed over.
fn reports(bench: &mut Bench) -> Vec<Health> {
    let mut all = Vec::new();
    while let Ok(message) = bench.outbound.pop() {
        if let Outbound::Health(health) = message {
            all.push(health);
        }
    }
    all
}

/// More samples than a test sends: health comes for other reasons or not at all.
const NEVER: u64 = 1_000_000;

/// A loop that samples start turns by its patience alone while there are none.
#[test]
fn health_comes_without_samples_too_whatever_starts_the_periods() {
    for trigger in [Trigger::Timer, Trigger::Sample] {
        let mut bench = Bench::new("no-samples", Duration::from_millis(8), trigger, NEVER);
        let begin = Instant::now();
        while begin.elapsed() < Duration::from_millis(1500) {
            bench.turning.period();
        }
        let all = reports(&mut bench);
        assert!((2..=20).contains(&all.len()), "{trigger:?}: {} reports in a second and a half", all.len());
    }
}

/// Nor does a fault wait for the next message, nor its end; and a stream that is always faulty is not one message after the
/// other.
#[test]
fn a_fault_that_begins_or_ends_is_told_of_at_once_but_not_often() {
    let mut bench = Bench::new("news", Duration::from_millis(1), Trigger::Timer, NEVER);
    // The first samples of the stream are spoilt ones.
    bench.seq = 20;
    let mut told = Vec::new();
    // `feed` takes what was handed over before the period: what comes after it is this period's.
    let mut turn = |bench: &mut Bench| {
        bench.feed();
        bench.turning.period();
        let new = reports(bench);
        told.extend(new.iter().map(|health| health.stamp_ns));
        new.last().map(|health| health.input_fault)
    };
    let fault = |fault: InputFault| Some(u32::from(fault));
    for _ in 0..400 {
        assert_eq!(turn(&mut bench), None, "there is nothing to tell");
    }
    bench.seq += 3;
    assert_eq!(turn(&mut bench), fault(InputFault::Lost), "in the period in which it is seen");
    let end = (0..3000).find_map(|_| turn(&mut bench));
    assert_eq!(end, fault(InputFault::None), "and no more than that before it is over");
    // Samples with fault bits and lost ones in turns: news every ten periods.
    for k in 0..800 {
        match k % 20 {
            0 => bench.seq += 2,
            10 => {
                bench.seq += 1;
                let state = JointState { faults: 1, ..sample(bench.seq).0 };
                bench.states.send(&state).expect("sent");
            }
            _ => {}
        }
        turn(&mut bench);
    }
    assert!(told.len() >= 4, "{} reports", told.len());
    for pair in told.windows(2) {
        assert!(pair[1] - pair[0] >= 200_000_000, "{} ns after the one before", pair[1] - pair[0]);
    }
}

/// Periods far too short for the work: the ladder goes up, everything published says so, and whoever is told when does the
/// same, bit for bit.
#[test]
fn work_that_does_not_fit_is_left_out_step_by_step_and_a_replay_does_the_same() {
    let mut bench = Bench::new("ladder", Duration::from_micros(1), Trigger::Timer, 10);
    for _ in 0..4500 {
        bench.feed();
        bench.turning.period();
    }
    bench.feed();
    let health = bench.health.expect("reported");
    let levels: Vec<LoadLevel> = bench.levels.iter().map(|(_, level)| *level).collect();
    assert_eq!(levels, [LoadLevel::PublishLess, LoadLevel::Decimate, LoadLevel::Hold], "one level after the other");
    assert_eq!((health.load_level, health.load_changes), (u32::from(LoadLevel::Hold), 3));
    assert!(health.samples < 300, "nothing is learnt any more: {}", health.samples);
    assert!(health.samples_held > 4000, "and what is left aside is counted: {}", health.samples_held);
    let level_at =
        |seq: u64| bench.levels.iter().rev().find(|(from, _)| seq >= *from).map_or(LoadLevel::Normal, |l| l.1);

    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/staubli-tx40/robot.toml");
    let mut core = Core::new(&rivet_config::load(file).expect("the robot file is sound")).expect("sound settings");
    let (mut replayed, mut set, mut last) = (Vec::new(), Parameters::default(), 0);
    for seq in 1..bench.seq {
        let (state, setpoint) = sample(seq);
        for (_, level) in bench.levels.iter().filter(|(from, _)| *from == last + 1) {
            core.set_load(*level);
        }
        last = last.max(state.seq);
        if core.tick(&state, Some(&setpoint)).publish {
            core.write_parameters(&mut set);
            replayed.push(set);
        }
    }
    assert!(bench.sets.len() >= 5, "{} sets, if fewer than before", bench.sets.len());
    assert_eq!(bench.sets.len(), replayed.len());
    for (live, again) in bench.sets.iter().zip(&replayed) {
        let fresh = Parameters { flags: live.flags & !parameter_flags::LATE, ..*live };
        assert_eq!(fresh, *again, "sample {}", again.seq);
        // None is passed off as newer than it is.
        let (state, _) = sample(live.seq);
        assert_eq!(live.stamp_ns, state.stamp_ns, "the stamp of the sample it was made from");
        assert_eq!(live.flags >> parameter_flags::LOAD_SHIFT & 3, u32::from(level_at(live.seq)), "sample {}", live.seq);
    }
}
