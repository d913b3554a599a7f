//! The thread that stores accepted parameters: files are slow, and a full disk is nobody else's concern.

use crate::core::Core;
use crate::error::StartError;
use rivet_config::Robot;
use rivet_ipc_schema::{ParameterState, Parameters, RobotName, parameter_flags};
use rivet_realtime::Shutdown;
use rivet_store::{Knowledge, Store, Supervision};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two files: what a crash loses at most.
const INTERVAL: Duration = Duration::from_secs(5);
/// How often the thread looks for something to do.
const TURN: Duration = Duration::from_millis(50);

#[derive(Default)]
struct Waiting {
    set: Option<Parameters>,
    now: bool,
}

/// The last set worth keeping, between the bus thread and this one.
#[derive(Default)]
pub(crate) struct Latest(Mutex<Waiting>);

impl Latest {
    fn waiting(&self) -> std::sync::MutexGuard<'_, Waiting> {
        // The content is whole after every statement; a thread that panicked elsewhere does not spoil it.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps `set` if the estimator stands by it.
    pub(crate) fn offer(&self, set: &Parameters) {
        if set.flags & (parameter_flags::PROVISIONAL | parameter_flags::SUSPENDED) == 0 {
            self.waiting().set = Some(*set);
        }
    }

    /// Asks for a file without waiting for the interval; false when there is nothing new to write.
    pub(crate) fn save_now(&self) -> bool {
        let mut waiting = self.waiting();
        waiting.now = waiting.set.is_some();
        waiting.now
    }
}

/// The store of one robot, and the model whose numbers it holds.
pub(crate) struct Keeper {
    store: Store,
    hash: u64,
}

impl Keeper {
    /// Opens the store and lets `core` go on from what it holds; files of another model are set aside.
    pub(crate) fn open(folder: &Path, name: &RobotName, robot: &Robot, core: &mut Core) -> Result<Keeper, StartError> {
        let store = Store::open(folder, name.as_str())?;
        let loaded = store.load(robot.hash);
        for (path, problem) in &loaded.problems {
            log::warn!(rivet_event = "state-refused"; "{} {problem}", path.display());
        }
        for path in store.set_others_aside(robot.hash)? {
            log::warn!(rivet_event = "state-set-aside"; "kept aside as {}", path.display());
        }
        match loaded.knowledge.map(|knowledge| recall(core, &knowledge)) {
            Some(true) => log::info!(rivet_event = "state-restored"; "goes on from stored parameters"),
            Some(false) => {
                log::warn!(rivet_event = "state-refused"; "stored parameters do not fit the model and are not used");
            }
            None => log::info!(rivet_event = "state-none"; "no stored parameters: starts from the robot file's"),
        }
        Ok(Keeper { store, hash: robot.hash })
    }

    /// Stores what comes until shut down, then what is left.
    pub(crate) fn run(mut self, latest: &Latest, shutdown: &Shutdown) {
        let mut next = Instant::now() + INTERVAL;
        let mut complained = false;
        loop {
            let stopping = shutdown.is_requested();
            if stopping {
                // The bus thread hands over what the loop left behind in its last turn.
                std::thread::sleep(TURN);
            }
            let due = stopping || Instant::now() >= next;
            let set = {
                let mut waiting = latest.waiting();
                let now = std::mem::take(&mut waiting.now);
                if due || now { waiting.set.take() } else { None }
            };
            if due {
                next = Instant::now() + INTERVAL;
            }
            if let Some(set) = set {
                match self.store.save(&knowledge(&set, self.hash)) {
                    Ok(()) => complained = false,
                    Err(why) if !complained => {
                        complained = true;
                        log::error!(rivet_event = "state-not-stored"; "parameters are not stored: {why} (said once)");
                    }
                    Err(_) => {}
                }
            }
            if stopping {
                return;
            }
            std::thread::sleep(TURN);
        }
    }
}

/// Lets `core` go on from what was stored: values, how well they are known, and what had been identified.
fn recall(core: &mut Core, knowledge: &Knowledge) -> bool {
    let stored = &knowledge.parameters;
    match &knowledge.supervision {
        Some(supervision) => {
            let identified: Vec<bool> =
                supervision.state.iter().map(|s| *s != u8::from(ParameterState::Unidentified)).collect();
            core.recall(&stored.values, &stored.std, &identified)
        }
        None => core.load(&stored.values),
    }
}

fn knowledge(set: &Parameters, model_hash: u64) -> Knowledge {
    let n = set.len();
    let parameters = rivet_store::Parameters {
        epoch: set.epoch,
        seq: set.seq,
        values: set.values[..n].to_vec(),
        std: set.std[..n].to_vec(),
    };
    let supervision = Supervision { state: set.state[..n].to_vec(), excitation: set.excitation[..n].to_vec() };
    Knowledge { model_hash, parameters, supervision: Some(supervision) }
}
