//! Priority, processor and memory of a real-time thread.

use std::fs;
use std::io;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CpuSet, sched_setaffinity};

/// Stack touched in advance \[bytes\], so that no page fault happens in the loop.
const PREFAULT: usize = 256 * 1024;

/// `CAP_IPC_LOCK` in `CapEff` of `/proc/self/status`.
const CAP_IPC_LOCK: u32 = 14;

/// How a real-time thread is scheduled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheduling {
    /// `SCHED_FIFO` with this priority, 1..=99.
    Fifo(u8),
    /// `SCHED_DEADLINE`: `runtime_ns` in each `period_ns`, not bound to a processor.
    Deadline {
        /// Time granted in a period \[ns\].
        runtime_ns: u64,
        /// The period, and the deadline in it \[ns\].
        period_ns: u64,
    },
}

impl std::fmt::Display for Scheduling {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Scheduling::Fifo(priority) => write!(f, "SCHED_FIFO priority {priority}"),
            Scheduling::Deadline { runtime_ns, period_ns } => {
                write!(f, "SCHED_DEADLINE with {} of every {} us", runtime_ns / 1000, period_ns / 1000)
            }
        }
    }
}

/// What a real-time thread wants of the system.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RealTimeSettings {
    /// The scheduler; `None`: time-sharing as usual.
    pub scheduling: Option<Scheduling>,
    /// The processor to stay on; `None`: any.
    pub cpu: Option<usize>,
    /// Keep all memory of the process, present and future, in RAM.
    pub lock_memory: bool,
    /// Refuse to run when something is not granted; else run with what there is and report it.
    pub required: bool,
}

/// What the system granted.
#[derive(Debug, Default)]
pub struct Granted {
    /// The scheduler in force.
    pub scheduling: Option<Scheduling>,
    /// Processor the thread stays on.
    pub cpu: Option<usize>,
    /// Whether memory is locked.
    pub memory_locked: bool,
    /// What was asked for and refused; empty when `required` was set.
    pub refused: Vec<RealTimeError>,
}

/// What the system refused, and what to change.
#[derive(Debug, thiserror::Error)]
pub enum RealTimeError {
    /// Memory was not locked.
    #[error(
        "cannot lock memory: {why}; raise the memlock limit to unlimited (systemd: LimitMEMLOCK=infinity; \
         /etc/security/limits.d: `memlock unlimited`) or grant CAP_IPC_LOCK"
    )]
    Memory {
        /// What the system said.
        why: String,
    },
    /// The thread may not stay on the processor.
    #[error(
        "cannot stay on processor {cpu}: {source}; it must exist and be in the process's cpuset (see `taskset -p`)"
    )]
    Processor {
        /// The processor asked for.
        cpu: usize,
        /// What the system said.
        source: io::Error,
    },
    /// The scheduler was not granted.
    #[error(
        "cannot use {scheduling}: {source}; raise the rtprio limit, now {limit} (systemd: \
         LimitRTPRIO=; /etc/security/limits.d: `rtprio 95`) or grant CAP_SYS_NICE, which SCHED_DEADLINE needs in any \
         case{cgroup}"
    )]
    Scheduler {
        /// What was asked for.
        scheduling: Scheduling,
        /// What the system said.
        source: io::Error,
        /// `RLIMIT_RTPRIO` of the process.
        limit: u64,
        /// A word about the cgroup where that may be the cause, or empty.
        cgroup: String,
    },
}

/// Makes the calling thread real-time as far as wanted and granted. Call it in the thread that loops, after
/// everything it needs was made.
///
/// Threads and processes started afterwards do not inherit the priority.
///
/// # Errors
/// The first refusal, if `settings.required`.
pub fn enter(settings: &RealTimeSettings) -> Result<Granted, RealTimeError> {
    let mut granted = Granted::default();
    let mut refuse = |why| {
        if settings.required {
            return Err(why);
        }
        granted.refused.push(why);
        Ok(())
    };
    if settings.lock_memory {
        match lock_memory() {
            Ok(()) => granted.memory_locked = true,
            Err(why) => refuse(why)?,
        }
    }
    prefault_stack();
    if let Some(cpu) = settings.cpu {
        match stay_on(cpu) {
            Ok(()) => granted.cpu = Some(cpu),
            Err(why) => refuse(why)?,
        }
    }
    // Last: whatever comes before takes its time at normal priority.
    if let Some(scheduling) = settings.scheduling {
        match schedule(scheduling) {
            Ok(()) => granted.scheduling = Some(scheduling),
            Err(why) => refuse(why)?,
        }
    }
    Ok(granted)
}

fn lock_memory() -> Result<(), RealTimeError> {
    let limit = getrlimit(Resource::Memlock).current;
    if let Some(limit) = limit
        && !has_capability(CAP_IPC_LOCK)
    {
        // It would be granted now and make some allocation fail later, when the limit is reached.
        return Err(RealTimeError::Memory { why: format!("the memlock limit is {} KiB", limit / 1024) });
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|e| RealTimeError::Memory { why: e.to_string() })
}

/// Whether the process has an effective capability.
fn has_capability(bit: u32) -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    effective.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).is_some_and(|bits| bits >> bit & 1 == 1)
}

/// Touches the pages of the stack that the loop will use.
#[inline(never)]
#[allow(clippy::large_stack_arrays, reason = "using that much stack is the purpose")]
fn prefault_stack() {
    let mut pages = [0_u8; PREFAULT];
    for page in pages.chunks_mut(4096) {
        page[0] = 1;
    }
    // Keeps the compiler from leaving the array out.
    std::hint::black_box(&mut pages);
}

fn stay_on(cpu: usize) -> Result<(), RealTimeError> {
    let fail = |source| RealTimeError::Processor { cpu, source };
    if cpu >= CpuSet::MAX_CPU {
        return Err(fail(io::Error::from(io::ErrorKind::InvalidInput)));
    }
    let mut set = CpuSet::new();
    set.set(cpu);
    sched_setaffinity(None, &set).map_err(|e| fail(e.into()))
}

fn schedule(scheduling: Scheduling) -> Result<(), RealTimeError> {
    let set = match scheduling {
        Scheduling::Fifo(priority) => set_fifo(priority),
        Scheduling::Deadline { runtime_ns, period_ns } => set_deadline(runtime_ns, period_ns),
    };
    set.map_err(|source| {
        let permitted = source.kind() != io::ErrorKind::PermissionDenied;
        RealTimeError::Scheduler {
            scheduling,
            source,
            limit: getrlimit(Resource::Rtprio).current.unwrap_or(99),
            cgroup: if permitted { String::new() } else { cgroup_hint() },
        }
    })
}

#[allow(unsafe_code, reason = "no safe wrapper of sched_setscheduler exists in the crates at hand")]
fn set_fifo(priority: u8) -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: i32::from(priority) };
    // Reset on fork: a thread started later, and a child process, is an ordinary one.
    let policy = libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK;
    // SAFETY: 0 is the calling thread; `parameters` outlives the call, which only reads it.
    match unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

#[allow(unsafe_code, reason = "no safe wrapper of sched_setattr exists in the crates at hand")]
fn set_deadline(runtime_ns: u64, period_ns: u64) -> io::Result<()> {
    // `struct sched_attr` of sched_setattr(2), first version.
    #[repr(C)]
    struct Attributes {
        size: u32,
        policy: u32,
        flags: u64,
        nice: i32,
        priority: u32,
        runtime: u64,
        deadline: u64,
        period: u64,
    }
    let attributes = Attributes {
        size: size_of::<Attributes>() as u32,
        policy: libc::SCHED_DEADLINE.cast_unsigned(),
        // Reset on fork: such a thread could else start no other.
        flags: 1,
        nice: 0,
        priority: 0,
        runtime: runtime_ns,
        deadline: period_ns,
        period: period_ns,
    };
    // SAFETY: 0 is the calling thread; `attributes` has the layout and size that it states, and the call only reads it.
    match unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const attributes, 0) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// With real-time group scheduling a cgroup without real-time runtime refuses FIFO even to root.
fn cgroup_hint() -> String {
    let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let group = groups.lines().find_map(|line| {
        let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
        let cpu = controllers.is_empty() || controllers.split(',').any(|name| name == "cpu");
        (cpu && path != "/").then_some(path)
    });
    group.map_or_else(String::new, |path| {
        format!("; if neither helps, the control group {path} may have no real-time time (cpu.rt_runtime_us = 0)")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs in a thread of its own: affinity and priority stay with it.
    fn in_thread<R: Send + 'static>(work: impl FnOnce() -> R + Send + 'static) -> R {
        std::thread::spawn(work).join().expect("no panic")
    }

    #[test]
    fn nothing_asked_is_nothing_refused() {
        let granted = in_thread(|| enter(&RealTimeSettings { required: true, ..Default::default() })).expect("entered");
        assert!(granted.refused.is_empty() && granted.scheduling.is_none() && !granted.memory_locked);
    }

    #[test]
    fn the_impossible_is_refused_with_a_hint_or_reported() {
        let impossible =
            RealTimeSettings { cpu: Some(1023), scheduling: Some(Scheduling::Fifo(200)), ..Default::default() };
        let wish = impossible.clone();
        let granted = in_thread(move || enter(&wish)).expect("best effort");
        assert_eq!((granted.cpu, granted.scheduling, granted.refused.len()), (None, None, 2));
        let text: Vec<String> = granted.refused.iter().map(ToString::to_string).collect();
        assert!(text[0].contains("processor 1023") && text[0].contains("cpuset"), "{}", text[0]);
        assert!(text[1].contains("rtprio") && text[1].contains("CAP_SYS_NICE"), "{}", text[1]);
        let error = in_thread(move || enter(&RealTimeSettings { required: true, ..impossible })).unwrap_err();
        assert!(matches!(error, RealTimeError::Processor { cpu: 1023, .. }));
    }

    /// Whatever this machine grants, the report equals what the kernel says about the thread.
    #[test]
    fn the_report_is_the_truth() {
        let (granted, allowed, policy) = in_thread(|| {
            let first = rustix::thread::sched_getaffinity(None).expect("affinity");
            let cpu = (0..CpuSet::MAX_CPU).find(|&cpu| first.is_set(cpu));
            let granted = enter(&RealTimeSettings { scheduling: Some(Scheduling::Fifo(1)), cpu, ..Default::default() })
                .expect("best effort");
            let stat = fs::read_to_string("/proc/thread-self/stat").expect("stat");
            // Fields after the name in brackets; the policy is field 41 of proc(5), the third is the first here.
            let policy: u32 =
                stat.rsplit(')').next().and_then(|rest| rest.split_whitespace().nth(38)?.parse().ok()).expect("policy");
            (granted, rustix::thread::sched_getaffinity(None).expect("affinity"), policy)
        });
        assert_eq!(allowed.count(), 1);
        assert!(granted.cpu.is_some_and(|cpu| allowed.is_set(cpu)));
        assert_eq!(granted.scheduling.is_some(), policy & 0xff == 1, "policy {policy}, {:?}", granted.refused);
    }

    #[test]
    fn a_deadline_is_granted_or_refused_by_name() {
        let wish = Scheduling::Deadline { runtime_ns: 200_000, period_ns: 1_000_000 };
        let (granted, policy) = in_thread(move || {
            let settings = RealTimeSettings { scheduling: Some(wish), ..Default::default() };
            let granted = enter(&settings).expect("best effort");
            let stat = fs::read_to_string("/proc/thread-self/stat").expect("stat");
            let policy = stat.rsplit(')').next().and_then(|rest| rest.split_whitespace().nth(38)?.parse::<u32>().ok());
            (granted, policy)
        });
        match granted.scheduling {
            Some(scheduling) => assert_eq!((scheduling, policy), (wish, Some(6))),
            None => assert!(granted.refused[0].to_string().contains("SCHED_DEADLINE with 200 of every 1000 us")),
        }
        let absurd = Scheduling::Deadline { runtime_ns: 2_000_000, period_ns: 1_000_000 };
        let settings = RealTimeSettings { scheduling: Some(absurd), required: true, ..Default::default() };
        assert!(in_thread(move || enter(&settings)).is_err(), "more than all");
    }

    #[test]
    fn a_thread_started_by_a_real_time_thread_is_an_ordinary_one() {
        let inherited = in_thread(|| {
            let granted = enter(&RealTimeSettings { scheduling: Some(Scheduling::Fifo(1)), ..Default::default() })
                .expect("best effort");
            let child = in_thread(|| {
                let stat = fs::read_to_string("/proc/thread-self/stat").expect("stat");
                stat.rsplit(')').next().and_then(|rest| rest.split_whitespace().nth(38)?.parse().ok()).unwrap_or(99_u32)
            });
            (granted.scheduling, child)
        });
        assert_eq!(inherited.1, 0, "granted {:?}", inherited.0);
    }
}
