//! What on this machine would break real time, read from `/proc` and `/sys`.

use crate::settings::{RealTimeSettings, Scheduling};
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// As it should be.
    Ok,
    /// Worth knowing; nothing breaks.
    Note,
    /// Wake-ups will be late now and then.
    Warning,
    /// Real time is refused, or a daemon will not start.
    Failure,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Severity::Ok => "ok",
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Failure => "failure",
        })
    }
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What was looked at: `governor`.
    pub check: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// What was found.
    pub found: String,
    /// The line to run, or to put where it says; `None` where nothing is to be changed.
    pub change: Option<String>,
}

impl Finding {
    /// Nothing is to be changed.
    pub fn fine(check: &'static str, severity: Severity, found: impl Into<String>) -> Finding {
        Finding { check, severity, found: found.into(), change: None }
    }

    /// Something is.
    pub fn change(
        check: &'static str,
        severity: Severity,
        found: impl Into<String>,
        change: impl Into<String>,
    ) -> Finding {
        Finding { check, severity, found: found.into(), change: Some(change.into()) }
    }
}

/// Clock sources that are read without a system call.
const FAST_CLOCKS: [&str; 4] = ["tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"];
/// A processor that needs longer than this to wake from an idle state wakes a loop late \[us\].
const IDLE_EXIT_US: u64 = 10;
const CAP_IPC_LOCK: u32 = 14;
const CAP_SYS_NICE: u32 = 23;

/// The machine, as its kernel describes it.
#[derive(Clone, Debug)]
pub struct Machine {
    root: PathBuf,
}

impl Default for Machine {
    /// This one.
    fn default() -> Self {
        Machine::at(Path::new("/"))
    }
}

impl Machine {
    /// One whose `proc` and `sys` lie below `root`: a copy, for tests.
    pub fn at(root: &Path) -> Machine {
        Machine { root: root.to_owned() }
    }

    fn read(&self, path: &str) -> Option<String> {
        Some(fs::read_to_string(self.root.join(path)).ok()?.trim().to_owned())
    }

    /// Names in a folder that begin with `prefix`, by number.
    fn entries(&self, folder: &str, prefix: &str) -> Vec<(usize, String)> {
        let names = fs::read_dir(self.root.join(folder)).into_iter().flatten().flatten();
        let names = names.filter_map(|entry| entry.file_name().into_string().ok());
        let mut found: Vec<_> =
            names.filter_map(|name| Some((name.strip_prefix(prefix)?.parse().ok()?, name.clone()))).collect();
        found.sort_unstable();
        found
    }

    /// Every check, for a thread with these wishes.
    pub fn findings(&self, wish: &RealTimeSettings) -> Vec<Finding> {
        let mut all = vec![self.preemption(), self.clock_source(), self.governor()];
        match self.absent(wish.cpu) {
            // Advice for a processor that is not there would be followed, too.
            Some(absent) => all.push(absent),
            None => all.extend([self.idle_states(wish.cpu), self.isolation(wish.cpu), self.interrupts(wish.cpu)]),
        }
        all.extend([self.smt(), self.throttling()]);
        all.extend([self.rtprio(wish.scheduling), self.memlock(wish.lock_memory), self.group(), self.hypervisor()]);
        all
    }

    fn absent(&self, cpu: Option<usize>) -> Option<Finding> {
        let online = self.read("sys/devices/system/cpu/online")?;
        let cpu = cpu.filter(|cpu| !list_has(&online, *cpu))?;
        Some(Finding::change(
            "processor",
            Severity::Failure,
            format!("{cpu} is wanted, {online} are there"),
            "robot.toml: [realtime] cpu = one of those",
        ))
    }

    fn preemption(&self) -> Finding {
        let check = "preemption";
        let version = self.read("proc/version").unwrap_or_default();
        let line = self.read("proc/cmdline").unwrap_or_default();
        let chosen = line.split_whitespace().find_map(|word| word.strip_prefix("preempt="));
        let told = self.read("sys/kernel/debug/sched/preempt");
        let told = told.as_deref().and_then(|t| t.split(['(', ')']).nth(1));
        if self.read("sys/kernel/realtime").as_deref() == Some("1") || version.contains("PREEMPT_RT") {
            return Finding::fine(check, Severity::Ok, "PREEMPT_RT kernel");
        }
        let install = "install a PREEMPT_RT kernel (Debian: apt-get install linux-image-rt-amd64)";
        if !version.contains("PREEMPT") {
            return Finding::change(check, Severity::Warning, "the kernel does not preempt itself", install);
        }
        if version.contains("PREEMPT_DYNAMIC") {
            return match told.or(chosen) {
                Some("full") => Finding::change(check, Severity::Note, "PREEMPT_DYNAMIC, full", install),
                mode => Finding::change(
                    check,
                    Severity::Warning,
                    format!("PREEMPT_DYNAMIC, {}", mode.unwrap_or("the kernel's default, none or voluntary as a rule")),
                    "/etc/default/grub: add preempt=full to GRUB_CMDLINE_LINUX, then update-grub and reboot; or a \
                     PREEMPT_RT kernel",
                ),
            };
        }
        Finding::change(check, Severity::Note, "PREEMPT (full) kernel", install)
    }

    fn clock_source(&self) -> Finding {
        let check = "clock source";
        let folder = "sys/devices/system/clocksource/clocksource0";
        let Some(name) = self.read(&format!("{folder}/current_clocksource")) else {
            return Finding::fine(check, Severity::Note, "not known");
        };
        if FAST_CLOCKS.contains(&name.as_str()) {
            return Finding::fine(check, Severity::Ok, name);
        }
        let others = self.read(&format!("{folder}/available_clocksource")).unwrap_or_default();
        let better = others.split_whitespace().find(|other| FAST_CLOCKS.contains(other));
        let change = match better {
            Some(better) => format!("echo {better} > /{folder}/current_clocksource"),
            None => {
                "/etc/default/grub: add clocksource=tsc tsc=reliable to GRUB_CMDLINE_LINUX, then update-grub".into()
            }
        };
        Finding::change(check, Severity::Failure, format!("{name}: every look at the clock is a system call"), change)
    }

    fn governor(&self) -> Finding {
        let check = "governor";
        let mut slow = Vec::new();
        let mut any = false;
        for (cpu, name) in self.entries("sys/devices/system/cpu", "cpu") {
            if let Some(governor) = self.read(&format!("sys/devices/system/cpu/{name}/cpufreq/scaling_governor")) {
                any = true;
                if governor != "performance" {
                    slow.push(format!("{cpu} {governor}"));
                }
            }
        }
        if slow.is_empty() {
            let found = if any { "performance" } else { "no frequency scaling" };
            return Finding::fine(check, Severity::Ok, found);
        }
        Finding::change(
            check,
            Severity::Warning,
            format!("processor {}", slow.join(", ")),
            "cpupower frequency-set -g performance   # or: for g in /sys/devices/system/cpu/cpu*/cpufreq/\
             scaling_governor; do echo performance > $g; done",
        )
    }

    fn idle_states(&self, cpu: Option<usize>) -> Finding {
        let check = "idle states";
        let folder = format!("sys/devices/system/cpu/cpu{}/cpuidle", cpu.unwrap_or(0));
        let mut deep = Vec::new();
        for (_, state) in self.entries(&folder, "state") {
            let read = |what: &str| self.read(&format!("{folder}/{state}/{what}"));
            let latency: u64 = read("latency").and_then(|us| us.parse().ok()).unwrap_or(0);
            if latency > IDLE_EXIT_US && read("disable").as_deref() != Some("1") {
                let name = read("name").unwrap_or_else(|| state.clone());
                deep.push((format!("{name} {latency} us"), state));
            }
        }
        if deep.is_empty() {
            return Finding::fine(check, Severity::Ok, format!("none takes longer than {IDLE_EXIT_US} us to leave"));
        }
        let (names, states): (Vec<_>, Vec<_>) = deep.into_iter().unzip();
        let lines: Vec<_> = states.iter().map(|state| format!("echo 1 > /{folder}/{state}/disable")).collect();
        Finding::change(check, Severity::Warning, names.join(", "), lines.join("; "))
    }

    fn smt(&self) -> Finding {
        match self.read("sys/devices/system/cpu/smt/active").as_deref() {
            Some("1") => Finding::change(
                "SMT",
                Severity::Warning,
                "two threads share a core",
                "echo off > /sys/devices/system/cpu/smt/control   # permanently: nosmt in GRUB_CMDLINE_LINUX",
            ),
            _ => Finding::fine("SMT", Severity::Ok, "off"),
        }
    }

    fn isolation(&self, cpu: Option<usize>) -> Finding {
        let check = "isolated processors";
        let isolated = self.read("sys/devices/system/cpu/isolated").unwrap_or_default();
        let Some(cpu) = cpu else {
            return Finding::change(
                check,
                Severity::Note,
                format!("{}; the thread is bound to none", if isolated.is_empty() { "none" } else { &isolated }),
                "robot.toml: [realtime] cpu = N, a dedicated processor",
            );
        };
        if list_has(&isolated, cpu) {
            return Finding::fine(check, Severity::Ok, isolated);
        }
        Finding::change(
            check,
            Severity::Warning,
            format!("processor {cpu} is not among them ({})", if isolated.is_empty() { "none" } else { &isolated }),
            format!(
                "/etc/default/grub: add isolcpus=domain,managed_irq,{cpu} nohz_full={cpu} rcu_nocbs={cpu} to \
                 GRUB_CMDLINE_LINUX, then update-grub and reboot"
            ),
        )
    }

    fn interrupts(&self, cpu: Option<usize>) -> Finding {
        let check = "interrupt affinity";
        let Some(cpu) = cpu else {
            return Finding::fine(check, Severity::Note, "not checked: the thread is bound to no processor");
        };
        let mut here = Vec::new();
        for (irq, name) in self.entries("proc/irq", "") {
            let list = self
                .read(&format!("proc/irq/{name}/effective_affinity_list"))
                .or_else(|| self.read(&format!("proc/irq/{name}/smp_affinity_list")));
            if list.is_some_and(|list| list_has(&list, cpu)) {
                here.push(irq.to_string());
            }
        }
        if here.is_empty() {
            return Finding::fine(check, Severity::Ok, format!("no device interrupts processor {cpu}"));
        }
        let other = usize::from(cpu == 0);
        Finding::change(
            check,
            Severity::Warning,
            format!("interrupts {} go to processor {cpu}", here.join(", ")),
            format!(
                "for i in {}; do echo {other} > /proc/irq/$i/smp_affinity_list; done   # and IRQBALANCE_BANNED_CPULIST={cpu} in \
                 /etc/default/irqbalance",
                here.join(" ")
            ),
        )
    }

    fn throttling(&self) -> Finding {
        let check = "real-time throttling";
        let number = |name: &str| self.read(&format!("proc/sys/kernel/{name}")).and_then(|us| us.parse::<i64>().ok());
        match (number("sched_rt_runtime_us"), number("sched_rt_period_us").unwrap_or(1_000_000)) {
            (Some(-1) | None, _) => Finding::fine(check, Severity::Ok, "off"),
            (Some(0), _) => Finding::change(
                check,
                Severity::Failure,
                "real-time threads get no time at all",
                "sysctl -w kernel.sched_rt_runtime_us=950000",
            ),
            (Some(runtime), period) => Finding::change(
                check,
                Severity::Note,
                format!("{runtime} of {period} us: only a thread that never sleeps meets it"),
                "sysctl -w kernel.sched_rt_runtime_us=-1   # /etc/sysctl.d/rivet.conf keeps it",
            ),
        }
    }

    /// A limit of this process, and whether a capability makes it moot.
    fn limit(&self, name: &str, capability: u32) -> (String, bool) {
        let limits = self.read("proc/self/limits").unwrap_or_default();
        let line = limits.lines().find_map(|line| line.strip_prefix(name));
        let soft = line.and_then(|rest| rest.split_whitespace().next()).unwrap_or("0").to_owned();
        let status = self.read("proc/self/status").unwrap_or_default();
        let bits = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
        let bits = bits.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).unwrap_or(0);
        (soft, bits >> capability & 1 == 1)
    }

    fn rtprio(&self, wish: Option<Scheduling>) -> Finding {
        let check = "rtprio limit";
        let (soft, capable) = self.limit("Max realtime priority", CAP_SYS_NICE);
        if capable {
            return Finding::fine(check, Severity::Ok, "CAP_SYS_NICE");
        }
        let enough = match wish {
            None => true,
            Some(Scheduling::Fifo(priority)) => soft.parse::<u64>().is_ok_and(|limit| limit >= u64::from(priority)),
            Some(Scheduling::Deadline { .. }) => false,
        };
        if enough {
            return Finding::fine(check, Severity::Ok, soft);
        }
        let wish = wish.map_or_else(String::new, |wish| format!(", and {wish} is asked for"));
        Finding::change(
            check,
            Severity::Failure,
            format!("{soft}{wish}"),
            "/etc/security/limits.d/rivet.conf: \"rivet - rtprio 95\" and log in anew; in a unit: LimitRTPRIO=95 or \
             AmbientCapabilities=CAP_SYS_NICE (SCHED_DEADLINE needs the latter)",
        )
    }

    fn memlock(&self, wish: bool) -> Finding {
        let check = "memlock limit";
        let (soft, capable) = self.limit("Max locked memory", CAP_IPC_LOCK);
        if capable || soft == "unlimited" || !wish {
            return Finding::fine(check, Severity::Ok, if capable { "CAP_IPC_LOCK".to_owned() } else { soft });
        }
        Finding::change(
            check,
            Severity::Failure,
            format!("{soft} bytes"),
            "/etc/security/limits.d/rivet.conf: \"rivet - memlock unlimited\" and log in anew; in a unit: \
             LimitMEMLOCK=infinity",
        )
    }

    fn group(&self) -> Finding {
        let check = "control group";
        let groups = self.read("proc/self/cgroup").unwrap_or_default();
        for line in groups.lines() {
            let Some((controllers, path)) = line.split_once(':').and_then(|(_, rest)| rest.split_once(':')) else {
                continue;
            };
            if !controllers.split(',').any(|name| name == "cpu") {
                continue;
            }
            for mount in ["sys/fs/cgroup/cpu,cpuacct", "sys/fs/cgroup/cpu"] {
                let file = format!("{mount}{}/cpu.rt_runtime_us", path.trim_end_matches('/'));
                if self.read(&file).as_deref() == Some("0") {
                    let change = format!("echo 900000 > /{file}");
                    return Finding::change(check, Severity::Failure, format!("{path} has no real-time time"), change);
                }
            }
        }
        Finding::fine(check, Severity::Ok, "does not withhold real-time time")
    }

    fn hypervisor(&self) -> Finding {
        let flags = self.read("proc/cpuinfo").unwrap_or_default();
        let guest =
            flags.lines().any(|line| line.starts_with("flags") && line.split_whitespace().any(|f| f == "hypervisor"));
        if guest {
            let found =
                "a virtual one: its host takes processors away without a trace, and nothing here can change that";
            Finding::fine("machine", Severity::Note, found)
        } else {
            Finding::fine("machine", Severity::Ok, "not virtual, by its own report")
        }
    }
}

/// Whether a list as the kernel writes them (`0-2,5`) has a number.
fn list_has(list: &str, wanted: usize) -> bool {
    list.split(',').any(|part| {
        let mut ends = part.trim().splitn(2, '-').map(str::parse::<usize>);
        match (ends.next(), ends.next()) {
            (Some(Ok(low)), Some(Ok(high))) => (low..=high).contains(&wanted),
            (Some(Ok(only)), None) => only == wanted,
            _ => false,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A machine of files, removed when dropped.
    struct Copy(PathBuf);

    impl Copy {
        fn new(name: &str, files: &[(&str, &str)]) -> Copy {
            let root = std::env::temp_dir().join(format!("rivet-doctor-{}-{name}", std::process::id()));
            for (path, text) in files {
                let path = root.join(path);
                fs::create_dir_all(path.parent().expect("a folder")).expect("made");
                fs::write(path, text).expect("written");
            }
            Copy(root)
        }

        fn says(&self, wish: &RealTimeSettings, check: &str) -> Finding {
            let all = Machine::at(&self.0).findings(wish);
            all.into_iter().find(|finding| finding.check == check).expect("looked at")
        }
    }

    impl Drop for Copy {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    fn wish() -> RealTimeSettings {
        RealTimeSettings { scheduling: Some(Scheduling::Fifo(80)), cpu: Some(2), lock_memory: true, required: true }
    }

    #[test]
    fn a_machine_with_everything_wrong_is_told_what_to_change() {
        let copy = Copy::new(
            "bad",
            &[
                ("proc/version", "Linux version 6.1.0 (x) #1 SMP PREEMPT_DYNAMIC Debian"),
                ("proc/cmdline", "quiet splash"),
                ("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n"),
                ("sys/devices/system/clocksource/clocksource0/available_clocksource", "hpet tsc acpi_pm\n"),
                ("sys/devices/system/cpu/cpu2/cpufreq/scaling_governor", "powersave\n"),
                ("sys/devices/system/cpu/cpu2/cpuidle/state0/latency", "0"),
                ("sys/devices/system/cpu/cpu2/cpuidle/state3/latency", "200"),
                ("sys/devices/system/cpu/cpu2/cpuidle/state3/name", "C6"),
                ("sys/devices/system/cpu/smt/active", "1"),
                ("sys/devices/system/cpu/isolated", "4-5\n"),
                ("proc/irq/24/smp_affinity_list", "0-3"),
                ("proc/irq/25/smp_affinity_list", "0-1"),
                ("proc/sys/kernel/sched_rt_runtime_us", "0"),
                (
                    "proc/self/limits",
                    "Limit\nMax locked memory         65536                65536     bytes\nMax realtime priority     0  0\n",
                ),
                ("proc/self/status", "CapEff:\t0000000000000000\n"),
                ("proc/self/cgroup", "4:cpu,cpuacct:/user\n"),
                ("sys/fs/cgroup/cpu,cpuacct/user/cpu.rt_runtime_us", "0"),
                ("proc/cpuinfo", "flags\t\t: fpu hypervisor tsc\n"),
            ],
        );
        for (check, severity, line) in [
            ("preemption", Severity::Warning, "preempt=full"),
            (
                "clock source",
                Severity::Failure,
                "echo tsc > /sys/devices/system/clocksource/clocksource0/current_clocksource",
            ),
            ("governor", Severity::Warning, "cpupower frequency-set -g performance"),
            ("idle states", Severity::Warning, "echo 1 > /sys/devices/system/cpu/cpu2/cpuidle/state3/disable"),
            ("SMT", Severity::Warning, "echo off > /sys/devices/system/cpu/smt/control"),
            ("isolated processors", Severity::Warning, "isolcpus=domain,managed_irq,2"),
            ("interrupt affinity", Severity::Warning, "for i in 24; do echo 0 > /proc/irq/$i/smp_affinity_list"),
            ("real-time throttling", Severity::Failure, "sysctl -w kernel.sched_rt_runtime_us=950000"),
            ("rtprio limit", Severity::Failure, "rivet - rtprio 95"),
            ("memlock limit", Severity::Failure, "rivet - memlock unlimited"),
            ("control group", Severity::Failure, "echo 900000 > /sys/fs/cgroup/cpu,cpuacct/user/cpu.rt_runtime_us"),
        ] {
            let finding = copy.says(&wish(), check);
            assert_eq!(finding.severity, severity, "{finding:?}");
            assert!(finding.change.as_ref().is_some_and(|change| change.contains(line)), "{finding:?}");
        }
        assert_eq!(copy.says(&wish(), "machine").severity, Severity::Note);
    }

    #[test]
    fn a_machine_that_was_set_up_has_nothing_to_change() {
        let copy = Copy::new(
            "good",
            &[
                ("proc/version", "Linux version 6.12.0-rt (x) #1 SMP PREEMPT_RT"),
                ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc"),
                ("sys/devices/system/cpu/cpu2/cpufreq/scaling_governor", "performance"),
                ("sys/devices/system/cpu/cpu2/cpuidle/state3/latency", "200"),
                ("sys/devices/system/cpu/cpu2/cpuidle/state3/disable", "1"),
                ("sys/devices/system/cpu/smt/active", "0"),
                ("sys/devices/system/cpu/isolated", "2-3"),
                ("proc/irq/24/effective_affinity_list", "0"),
                ("proc/irq/24/smp_affinity_list", "0-3"),
                ("proc/sys/kernel/sched_rt_runtime_us", "-1"),
                ("proc/self/limits", "Max locked memory  unlimited  unlimited bytes\nMax realtime priority 95 95\n"),
                ("proc/self/status", "CapEff:\t0000000000000000\n"),
                ("proc/cpuinfo", "flags\t\t: fpu tsc\n"),
            ],
        );
        for finding in Machine::at(&copy.0).findings(&wish()) {
            assert_eq!((finding.severity, &finding.change), (Severity::Ok, &None), "{finding:?}");
        }
        let deadline =
            RealTimeSettings { scheduling: Some(Scheduling::Deadline { runtime_ns: 1, period_ns: 2 }), ..wish() };
        assert_eq!(copy.says(&deadline, "rtprio limit").severity, Severity::Failure, "it needs the capability");
    }

    #[test]
    fn a_processor_that_is_not_there_gets_no_advice_of_its_own() {
        let copy = Copy::new("absent", &[("sys/devices/system/cpu/online", "0-1\n")]);
        let wish = |cpu| RealTimeSettings { cpu: Some(cpu), ..wish() };
        let found = copy.says(&wish(2), "processor");
        assert_eq!((found.severity, found.found.as_str()), (Severity::Failure, "2 is wanted, 0-1 are there"));
        let of = |cpu| Machine::at(&copy.0).findings(&wish(cpu)).iter().map(|f| f.check).collect::<Vec<_>>();
        assert!(!of(2).contains(&"isolated processors"), "{:?}", of(2));
        assert!(of(1).contains(&"isolated processors") && !of(1).contains(&"processor"), "{:?}", of(1));
    }

    #[test]
    fn lists_of_processors_are_read_as_the_kernel_writes_them() {
        assert!(list_has("0-2,5", 1) && list_has("0-2,5", 5) && list_has(" 7 ", 7));
        assert!(!list_has("0-2,5", 3) && !list_has("", 0) && !list_has("x-y", 0));
    }
}
