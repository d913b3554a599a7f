//! The thread that stores accepted parameters: files are slow, and a full disk is nobody else's concern.

use crate::core::Core;
use crate::error::StartError;
use crate::progress::Progress;
use crate::reload::Outcome;
use crate::snapshot::{Asking, Snapshot};
use rivet_config::Robot;
use rivet_ipc_schema::{ControlStatus, ParameterState, Parameters, RobotName, StateFolder, parameter_flags};
use rivet_realtime::Shutdown;
use rivet_service::{Flight, Reason, Storage};
use rivet_store::{Knowledge, Memory, Store, Supervision};
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
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
    /// Everything was forgotten: nothing counts until the estimator has begun anew.
    forgotten: bool,
    /// What is on the disk is to be forgotten as well, and someone waits for that.
    aside: bool,
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
        let mut waiting = self.waiting();
        if accepted(set) {
            if !waiting.forgotten {
                waiting.set = Some(*set);
            }
        } else {
            waiting.forgotten = false;
        }
    }

    /// What was learnt was forgotten by request: it is not to be stored any more. Sets that are still on the way are from before.
    /// The keeper answers when the disk has forgotten, too. Nothing else may be under way for it: that is never answered.
    pub(crate) fn forget(&self) {
        *self.waiting() = Waiting { forgotten: true, aside: true, ..Waiting::default() };
    }

    fn take_aside(&self) -> bool {
        std::mem::take(&mut self.waiting().aside)
    }

    /// What could not be stored is news still, unless there are newer ones.
    fn put_back(&self, set: &Parameters) {
        let mut waiting = self.waiting();
        if !waiting.forgotten {
            waiting.set.get_or_insert(*set);
        }
    }

    fn has_news(&self) -> bool {
        self.waiting().set.is_some()
    }

    fn take_news(&self) -> Option<Parameters> {
        self.waiting().set.take()
    }

    fn take_request(&self) -> bool {
        std::mem::take(&mut self.waiting().now)
    }

    /// Asks for a file without waiting for the interval: the keeper answers when the disk has it. False when there is nothing
    /// new to write.
    pub(crate) fn save_now(&self) -> bool {
        let mut waiting = self.waiting();
        waiting.now = waiting.set.is_some();
        waiting.now
    }
}

/// Whether the estimator stands by it.
fn accepted(set: &Parameters) -> bool {
    set.flags & (parameter_flags::PROVISIONAL | parameter_flags::SUSPENDED) == 0
}

/// The store of one robot, and the model whose numbers it holds.
pub(crate) struct Keeper {
    store: Store,
    hash: u64,
    folder: PathBuf,
}

/// How long the loop may take to hand over what it knows before the parameters alone are stored.
const HAND_OVER: Duration = Duration::from_secs(1);
/// The same on the way out.
const LAST_WORDS: Duration = Duration::from_millis(300);

impl Keeper {
    /// Opens the store and lets `core` go on from what it holds; files of another model are set aside.
    /// `before`: the folder of an earlier installation.
    pub(crate) fn open(
        folder: &Path,
        before: Option<&Path>,
        name: &RobotName,
        robot: &Robot,
        core: &mut Core,
    ) -> Result<Keeper, StartError> {
        let store = Store::open(folder, name.as_str())?;
        if let Some(why) = store.refused() {
            log::warn!(rivet_event = "state-unwritable"; "{why}; runs without storing until the folder can be written");
        }
        let is_writable = store.refused().is_none();
        if let Some(before) = before.filter(|_| is_writable) {
            for path in store.copy_from(before)? {
                log::info!(rivet_event = "state-copied"; "copied from {} to {}", before.display(), path.display());
            }
        }
        let mut loaded = store.load(robot.hash);
        for (path, problem) in &loaded.problems {
            log::warn!(rivet_event = "state-refused"; "{} {problem}", path.display());
        }
        if is_writable {
            for path in store.set_others_aside(robot.hash)? {
                log::warn!(rivet_event = "state-set-aside"; "kept aside as {}", path.display());
            }
        }
        if loaded.knowledge.is_none() && is_writable {
            for path in store.take_back(robot.hash)? {
                log::info!(rivet_event = "state-taken-back"; "the robot file is what it was: {} is in its place again", path.display());
            }
            loaded = store.load(robot.hash);
        }
        match loaded.knowledge.map(|knowledge| (recall(core, &knowledge), knowledge.parameters.seq)) {
            Some((Recalled::All, seq)) => {
                log::info!(rivet_event = "state-restored"; "goes on from stored parameters, window and supervision, as of sample {seq}");
            }
            Some((Recalled::Parameters, seq)) => {
                log::info!(
                    rivet_event = "state-restored";
                    "goes on from stored parameters, as of sample {seq}; the window begins anew"
                );
            }
            Some((Recalled::Nothing, _)) => {
                log::warn!(rivet_event = "state-refused"; "stored parameters do not fit the model and are not used");
            }
            None => log::info!(rivet_event = "state-none"; "no stored parameters: starts from the robot file's"),
        }
        Ok(Keeper { store, hash: robot.hash, folder: folder.to_owned() })
    }

    /// Stores what comes until shut down, then what is left.
    pub(crate) fn run(
        self,
        latest: &Latest,
        asking: Asking,
        flight: &Flight,
        answers: &Sender<Outcome>,
        progress: &Progress,
        shutdown: &Shutdown,
    ) {
        let mut rounds = StoreRounds {
            folder: rivet_service::StateFolder::new(&self.folder),
            keeper: self,
            latest,
            asking,
            answers,
            next: Instant::now() + INTERVAL,
            asked: None,
            owes_answer: false,
            complained: false,
            reset_pending: false,
        };
        loop {
            progress.store_turned();
            progress.set_state_folder(state_folder(rounds.folder.look(Instant::now())));
            let stopping = shutdown.is_requested();
            if stopping {
                // The bus thread hands over what the loop left behind in its last turn.
                std::thread::sleep(TURN);
                flight.ask(Reason::Stop);
            }
            rounds.turn(stopping);
            flight.serve();
            if stopping {
                return;
            }
            std::thread::sleep(TURN);
        }
    }

    /// Sets aside what is stored.
    fn forget(&mut self) -> Outcome {
        match self.store.set_aside(self.hash) {
            Ok(moved) if moved.is_empty() => (ControlStatus::Done, "nothing was stored".to_owned()),
            Ok(moved) => {
                let places: Vec<_> = moved.iter().map(|path| path.display().to_string()).collect();
                (ControlStatus::Done, format!("kept aside as {}", places.join(" and ")))
            }
            Err(why) => (
                ControlStatus::Failed,
                format!("forgotten, but what is stored stays for now, and is tried again: {why}"),
            ),
        }
    }

    /// A snapshot as it is stored, if the estimator stands by it.
    fn whole(&self, snapshot: &Snapshot) -> Option<Knowledge> {
        accepted(&snapshot.parameters).then(|| {
            let whole = snapshot.fingerprint != 0;
            let memory = Memory { fingerprint: snapshot.fingerprint, numbers: snapshot.memory.clone() };
            Knowledge { memory: whole.then_some(memory), ..knowledge(&snapshot.parameters, self.hash) }
        })
    }
}

/// What the store's thread knows from round to round.
struct StoreRounds<'a> {
    keeper: Keeper,
    folder: rivet_service::StateFolder,
    latest: &'a Latest,
    asking: Asking,
    answers: &'a Sender<Outcome>,
    /// When the next file of the interval is due.
    next: Instant,
    /// Since when the loop has been asked.
    asked: Option<Instant>,
    /// Whether someone waits for an answer.
    owes_answer: bool,
    /// Whether a failure has been reported.
    complained: bool,
    /// Whether a reset could not move what is stored.
    reset_pending: bool,
}

impl StoreRounds<'_> {
    fn turn(&mut self, stopping: bool) {
        let (due, now) = (Instant::now() >= self.next, self.latest.take_request());
        self.reset(due || stopping);
        if due {
            self.next = Instant::now() + INTERVAL;
        }
        self.owes_answer |= now;
        if (due || now) && self.asked.is_none() && self.latest.has_news() {
            self.asked = Some(Instant::now());
            self.asking.ask();
        }
        let (handed_over, found) = self.take_snapshots(stopping);
        let waited = self.asked.is_some_and(|since| since.elapsed() >= HAND_OVER);
        if handed_over || waited || stopping {
            self.asked = None;
            // What the estimator does not stand by now it may have stood by a moment ago.
            if let Some(news) = self.latest.take_news() {
                let parameters_alone = || knowledge(&news, self.keeper.hash);
                let knowledge = found.unwrap_or_else(parameters_alone);
                self.save(&news, &knowledge);
            }
        }
        if self.owes_answer && self.asked.is_none() && !self.latest.has_news() {
            // What was to be stored went into the file of the interval, between the request and now.
            self.owes_answer = false;
            let _ = self.answers.send((ControlStatus::Done, "what there was is stored".to_owned()));
        }
    }

    /// Sets aside what is stored where that was asked for; `again`: also where an earlier try failed.
    fn reset(&mut self, again: bool) {
        let asked_to_forget = self.latest.take_aside();
        if !(asked_to_forget || (self.reset_pending && again)) {
            return;
        }
        let outcome = self.keeper.forget();
        self.reset_pending = outcome.0 != ControlStatus::Done;
        if !self.reset_pending {
            log::info!(rivet_event = "state-set-aside"; "reset: {}", outcome.1);
        } else if asked_to_forget {
            log::error!(rivet_event = "state-not-stored"; "reset: {}", outcome.1);
        }
        if asked_to_forget {
            // The bus thread is gone when the daemon is on its way out.
            let _ = self.answers.send(outcome);
        }
    }

    /// Whether the loop handed over a snapshot, and what of the latest is worth storing. On the way out it waits for the loop's last
    /// one.
    fn take_snapshots(&mut self, stopping: bool) -> (bool, Option<Knowledge>) {
        let (mut handed_over, mut found) = (false, None);
        let mut last = !stopping;
        let begin = Instant::now();
        loop {
            let keeper = &self.keeper;
            while let Some((end, knowledge)) = self.asking.read_filled(|filled| (filled.last, keeper.whole(filled))) {
                (handed_over, found) = (true, knowledge);
                last |= end;
            }
            // What the loop knew when it ended.
            if last || begin.elapsed() >= LAST_WORDS {
                return (handed_over, found);
            }
            std::thread::sleep(TURN / 10);
        }
    }

    /// Writes one file, and answers who asked for it.
    fn save(&mut self, news: &Parameters, knowledge: &Knowledge) {
        let saved = self.keeper.store.save(knowledge);
        self.folder.note(saved.as_ref().map_or_else(|why| Storage::because(&why.source), |()| Storage::Writable));
        if saved.is_err() {
            self.latest.put_back(news);
        }
        if self.owes_answer {
            self.owes_answer = false;
            let outcome = match &saved {
                Ok(()) => (ControlStatus::Done, format!("stored as of sample {}", knowledge.parameters.seq)),
                Err(why) => (ControlStatus::Failed, format!("not stored: {why}")),
            };
            // The bus thread is gone when the daemon is on its way out.
            let _ = self.answers.send(outcome);
        }
        match saved {
            Ok(()) if std::mem::take(&mut self.complained) => {
                log::info!(rivet_event = "state-stored"; "parameters are stored again");
            }
            Err(why) if !self.complained => {
                self.complained = true;
                log::error!(rivet_event = "state-not-stored"; "parameters are not stored: {why} \
                                                               (reported once)");
            }
            Ok(()) | Err(_) => {}
        }
    }
}

/// As it stands in health.
fn state_folder(storage: Storage) -> StateFolder {
    match storage {
        Storage::Writable => StateFolder::Writable,
        Storage::Full => StateFolder::Full,
        Storage::Unwritable => StateFolder::Unwritable,
    }
}

/// What of the stored was taken up.
enum Recalled {
    All,
    Parameters,
    Nothing,
}

/// Lets `core` go on from what was stored: all that was learnt if it is made alike; else values, how well they are known, and
/// what had been identified.
fn recall(core: &mut Core, knowledge: &Knowledge) -> Recalled {
    let stored = &knowledge.parameters;
    let known = knowledge.memory.as_ref().filter(|memory| memory.fingerprint == core.memory_fingerprint());
    if known.is_some_and(|memory| core.resume(&memory.numbers)) {
        return Recalled::All;
    }
    let taken = match &knowledge.supervision {
        Some(supervision) => {
            let identified: Vec<bool> =
                supervision.state.iter().map(|s| *s != u8::from(ParameterState::Unidentified)).collect();
            core.recall(&stored.values, &stored.std, &identified)
        }
        None => core.load(&stored.values),
    };
    if taken { Recalled::Parameters } else { Recalled::Nothing }
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
    Knowledge { model_hash, parameters, supervision: Some(supervision), memory: None }
}
