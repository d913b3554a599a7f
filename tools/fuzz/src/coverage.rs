//! The targets under libFuzzer, steered by what the compiler's counters have seen: `cargo xtask fuzz`.
//!
//! The command line is libFuzzer's own. The environment says which target (`RIVET_FUZZ`), the folder that is given its seeds
//! (`RIVET_FUZZ_SEEDS`; some lie elsewhere in the workspace), and for how long (`RIVET_FUZZ_SECONDS`, of the processor: a search
//! at the lowest priority may stand still for minutes).

#![no_main]

use libfuzzer_sys::fuzz_target;
use rivet_fuzz::{Run, TARGETS, Target, seeds};
use rustix::process::{Signal, getpid, kill_process};
use rustix::time::{ClockId, clock_gettime};
use std::cell::RefCell;

/// How often the time is looked at \[inputs\].
const LOOK: u32 = 16;

struct Search {
    run: Run,
    name: &'static str,
    seconds: i64,
    inputs: u32,
}

thread_local! {
    static SEARCH: RefCell<Search> = RefCell::new(Search::new());
}

fn target() -> &'static Target {
    let name = std::env::var("RIVET_FUZZ").unwrap_or_default();
    let known = || TARGETS.iter().map(|target| target.name).collect::<Vec<_>>().join(", ");
    TARGETS
        .iter()
        .find(|target| target.name == name)
        .unwrap_or_else(|| panic!("RIVET_FUZZ = {name:?}: not of {}", known()))
}

impl Search {
    fn new() -> Self {
        let seconds = std::env::var("RIVET_FUZZ_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(i64::MAX);
        Self { run: (target().make)(), name: target().name, seconds, inputs: 0 }
    }

    fn one(&mut self, input: &[u8]) {
        (self.run)(input);
        self.inputs = self.inputs.wrapping_add(1);
        if self.inputs.is_multiple_of(LOOK) {
            let used = clock_gettime(ClockId::ProcessCPUTime).tv_sec;
            if used >= self.seconds {
                eprintln!("{}: {used} s of the processor are used up", self.name);
                self.seconds = i64::MAX;
                // What libFuzzer takes for a wish to end after this input. There is no other trace of a failure to tell it.
                let _ = kill_process(getpid(), Signal::USR1);
            }
        }
    }
}

/// Puts seeds where libFuzzer will look for them.
fn begin() {
    // A panic that is caught further down is an answer, as it is in the programs; one that is not ends this one all the same.
    let _ = std::panic::take_hook();
    let Ok(folder) = std::env::var("RIVET_FUZZ_SEEDS") else { return };
    for seed in seeds(target()).expect("the corpus is there") {
        let name = format!("{folder}/seed-{:08x}-{}", crc32fast::hash(&seed), seed.len());
        std::fs::write(&name, seed).unwrap_or_else(|why| panic!("{name}: {why}"));
    }
}

fuzz_target!(init: begin(), |input: &[u8]| {
    SEARCH.with_borrow_mut(|search| search.one(input));
});
