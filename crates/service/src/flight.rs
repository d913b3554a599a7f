//! The flight recorder: what was measured and made of it in the last second, written by the real-time thread, kept as a log by
//! another one when something has gone wrong.

use rivet_files::{CONVENTIONS_OF_THE_MODEL, Draft};
use rivet_realtime::RecentRows;
use std::fmt::Write as _;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Samples that are kept.
pub const RECORDED: usize = 1000;

/// Room for so many times as much: the loop goes on while the last ones are copied.
const ROOM: usize = 2;

/// Flight records of one name that are kept, the newest with number 0.
const FILES: usize = 8;

/// A record that follows another one of its name within this time belongs to the same burst.
const BURST: Duration = Duration::from_secs(60);

/// A panic waits this long for the record at most.
const PATIENCE: Duration = Duration::from_millis(500);

/// Words of a row that are integers: stamp \[ns\], sequence number, fault bits.
const INTEGERS: usize = 3;

/// Why there is a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// A thread panicked.
    Panic,
    /// The real-time loop stands still.
    Stuck,
    /// Something was wrong with the samples, or they stopped.
    Fault,
    /// The service was stopped.
    Stop,
}

impl Reason {
    const ALL: [Reason; 4] = [Reason::Panic, Reason::Stuck, Reason::Fault, Reason::Stop];

    /// As it stands in file names.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Reason::Panic => "panic",
            Reason::Stuck => "stuck",
            Reason::Fault => "fault",
            Reason::Stop => "stop",
        }
    }

    fn bit(self) -> u32 {
        1 << self as u32
    }
}

/// The last samples with what was made of them, and where they go.
#[derive(Debug)]
pub struct Flight {
    rows: RecentRows,
    header: String,
    /// What is taken off each number.
    folder: PathBuf,
    /// What the files are called before their number.
    name: String,
    asked: AtomicU32,
    panic_written: AtomicBool,
    bursts: Mutex<Vec<Burst>>,
}

/// Records of one name in quick succession: a link that chatters, say.
#[derive(Debug)]
struct Burst {
    name: String,
    last: Instant,
    /// How many of them are kept: the first, and the newest.
    kept: u8,
}

impl Burst {
    /// What earlier processes left, by the age of their records: one that dies again and again must not push out what was
    /// before it.
    fn of_before(name: &str, path: impl Fn(usize) -> PathBuf, now: Instant) -> Burst {
        let age = |number| fs::metadata(path(number)).ok()?.modified().ok()?.elapsed().ok();
        let (last, kept) = match (age(0), age(1)) {
            (None, _) => (Some(now), 0),
            (Some(newest), Some(before)) if before.saturating_sub(newest) < BURST => (now.checked_sub(newest), 2),
            (Some(newest), _) => (now.checked_sub(newest), 1),
        };
        Burst { name: name.to_owned(), last: last.unwrap_or(now), kept }
    }
}

impl Flight {
    /// Records go to `folder` and are called `name`. `columns`: what a row has after time, sequence number and fault bits, each
    /// with how many there are of it; one is called as it is, several are numbered from 1. Numbers are those of the bus; the record states this.
    #[must_use]
    pub fn new(folder: &Path, name: &str, columns: &[(&str, usize)]) -> Flight {
        let mut header = format!("# rivet: {CONVENTIONS_OF_THE_MODEL}\nt,seq,faults");
        for &(column, count) in columns {
            for j in 1..=count {
                let number = if count == 1 { String::new() } else { j.to_string() };
                let _ = write!(header, ",{column}{number}");
            }
        }
        let width = columns.iter().map(|(_, count)| count).sum::<usize>();
        Flight {
            rows: RecentRows::new(ROOM * RECORDED, INTEGERS + width),
            header,
            folder: folder.to_owned(),
            name: name.to_owned(),
            asked: AtomicU32::new(0),
            panic_written: AtomicBool::new(false),
            bursts: Mutex::new(Vec::new()),
        }
    }

    /// Where records go.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Takes in a sample; the oldest goes. Real-time safe; one thread only.
    pub fn push(&self, stamp_ns: u64, seq: u64, faults: u32, numbers: impl IntoIterator<Item = f64>) {
        let numbers = numbers.into_iter().map(f64::to_bits);
        self.rows.push([stamp_ns, seq, u64::from(faults)].into_iter().chain(numbers));
    }

    /// Asks for a record; who [serves](Flight::serve) writes it. Real-time safe.
    pub fn ask(&self, reason: Reason) {
        self.asked.fetch_or(reason.bit(), Ordering::Release);
    }

    /// Writes what has been asked for and says so in the log. Not for a real-time thread.
    pub fn serve(&self) {
        let asked = self.asked.swap(0, Ordering::Acquire);
        for reason in Reason::ALL.into_iter().filter(|reason| asked & reason.bit() != 0) {
            let name = reason.name();
            if reason == Reason::Stop && self.rows.copy(1).is_empty() {
                continue; // Nothing has happened that could be looked at.
            }
            match self.write(&format!("{}-{name}", self.name)) {
                Ok(path) if reason == Reason::Stop => {
                    log::info!(rivet_event = "flight-record"; "{name}: flight record {}", path.display());
                }
                Ok(path) => log::warn!(rivet_event = "flight-record"; "{name}: flight record {}", path.display()),
                Err(why) => log::error!(rivet_event = "flight-record"; "{name}: no flight record: {why}"),
            }
            if reason == Reason::Panic {
                self.panic_written.store(true, Ordering::Release);
            }
        }
    }

    /// Writes what is kept to a file `<name>.0.flight.csv` and returns its path; older records of that name move up, the oldest
    /// goes. Of records that follow each other within a minute only the first and the newest are kept: the cause is in the
    /// first, and a stop that chatters must not push out what was before it. The file has the columns of a log; what is in it
    /// is what came, also where no log may have it (a number that is none, a time that goes back).
    ///
    /// # Errors
    /// It cannot be written; earlier records are as they were, under the same or the next number.
    pub fn write(&self, name: &str) -> io::Result<PathBuf> {
        self.write_at(name, Instant::now())
    }

    /// Whether the record of now takes the place of the newest one.
    fn replaces(&self, name: &str, path: impl Fn(usize) -> PathBuf, now: Instant) -> bool {
        let mut bursts = self.bursts.lock().unwrap_or_else(PoisonError::into_inner);
        let at = bursts.iter().position(|burst| burst.name == name).unwrap_or_else(|| {
            bursts.push(Burst::of_before(name, path, now));
            bursts.len() - 1
        });
        let burst = &mut bursts[at];
        let goes_on = burst.kept > 0 && now.saturating_duration_since(burst.last) < BURST;
        let replaces = goes_on && burst.kept == 2;
        burst.last = now;
        burst.kept = if goes_on { 2 } else { 1 };
        replaces
    }

    fn write_at(&self, name: &str, now: Instant) -> io::Result<PathBuf> {
        let path = |number: usize| self.folder.join(format!("{name}.{number}.flight.csv"));
        fs::create_dir_all(&self.folder)?;
        self.write_over(path, || self.replaces(name, path, now)).map(|()| path(0))
    }

    /// Writes a record and makes it number 0; unless it replaces that one, those before it move on by one.
    fn write_over(&self, path: impl Fn(usize) -> PathBuf, replaces: impl FnOnce() -> bool) -> io::Result<()> {
        let mut draft = Draft::new(&path(0))?;
        draft.file().write_all(self.text().as_bytes())?;
        draft.file().sync_all()?;
        let oldest = if replaces() { 0 } else { FILES - 1 };
        for number in (1..=oldest).rev() {
            match fs::rename(path(number - 1), path(number)) {
                Err(why) if why.kind() != io::ErrorKind::NotFound => return Err(why),
                _ => {}
            }
        }
        draft.publish().map(drop)
    }

    fn text(&self) -> String {
        let rows = self.rows.copy(RECORDED);
        let mut text = self.header.clone();
        text.push('\n');
        let first = rows.first().map_or(0, |row| row[0]);
        for row in &rows {
            let (integers, numbers) = row.split_at(INTEGERS);
            let t = integers[0].saturating_sub(first) as f64 * 1e-9;
            let _ = write!(text, "{t:.9},{},{}", integers[1], integers[2]);
            for bits in numbers {
                let _ = write!(text, ",{}", f64::from_bits(*bits));
            }
            text.push('\n');
        }
        text
    }

    /// Waits for the record of a panic, but not for long.
    fn last_words(&self) {
        self.ask(Reason::Panic);
        let begin = Instant::now();
        while !self.panic_written.load(Ordering::Acquire) && begin.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// From now on a panic of any thread ends the process by SIGABRT, after it was told and `flight`, if there is one, was written
/// by the thread that serves it. Nothing is unwound, however the program was built.
pub fn abort_on_panic(flight: Option<Arc<Flight>>) {
    let tell = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |what| {
        tell(what);
        if let Some(flight) = &flight {
            flight.last_words();
        }
        std::process::abort();
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processes_that_die_again_and_again_leave_the_first_and_the_newest_record() {
        let folder = tempfile::tempdir().expect("a folder");
        let record = |seq: u64, name: &str| {
            let flight = Flight::new(folder.path(), "arm", &[("q", 2)]);
            flight.push(0, seq, 0, [0.0; 2]);
            flight.write(name).expect("written")
        };
        let mut path = PathBuf::new();
        for seq in 1..=9 {
            path = record(seq, "arm-panic");
        }
        let seq = |number: usize| {
            let path = path.with_file_name(format!("arm-panic.{number}.flight.csv"));
            let text = fs::read_to_string(path).ok()?;
            text.lines().last()?.split(',').nth(1)?.parse::<u64>().ok()
        };
        assert_eq!([0, 1, 2].map(seq), [Some(9), Some(1), None]);
        // A stop before the first sample leaves none.
        let idle = Flight::new(folder.path(), "idle", &[("q", 2)]);
        idle.ask(Reason::Stop);
        idle.serve();
        assert!(!folder.path().join("idle-stop.0.flight.csv").exists());
        idle.push(0, 1, 0, [0.0; 2]);
        idle.ask(Reason::Stop);
        idle.serve();
        assert!(folder.path().join("idle-stop.0.flight.csv").exists());
    }

    /// A stop that chatters for hours, with another one before it and one long after: what is left of each.
    #[test]
    fn the_first_and_the_newest_record_of_a_burst_stay_and_push_out_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let flight = Flight::new(folder.path(), "arm", &[("q", 2)]);
        let begin = Instant::now();
        let stop = |second: u64| {
            flight.push(0, second, 0, [0.0; 2]);
            flight.write_at("arm", begin + Duration::from_secs(second)).expect("written");
        };
        stop(1);
        (1000..8000).step_by(50).for_each(stop);
        stop(9000);
        // The last sample of each record says when its stop was.
        let last = |number: usize| {
            let text = fs::read_to_string(folder.path().join(format!("arm.{number}.flight.csv"))).ok()?;
            text.lines().last()?.split(',').nth(1)?.parse::<u64>().ok()
        };
        let kept: Vec<Option<u64>> = (0..5).map(last).collect();
        assert_eq!(kept, [Some(9000), Some(7950), Some(1000), Some(1), None]);
    }

    #[test]
    fn of_many_stops_far_apart_the_newest_stay_and_names_do_not_mix() {
        let folder = tempfile::tempdir().expect("a folder");
        let flight = Flight::new(folder.path(), "arm", &[("q", 2)]);
        let begin = Instant::now();
        for stop in 1..=20 {
            flight.write_at("arm", begin + Duration::from_secs(100 * stop)).expect("written");
        }
        flight.write_at("arm-fault", begin + Duration::from_secs(2001)).expect("written");
        assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), FILES + 1);
    }

    /// A folder stands where the oldest record would go: the error says so, and what was written for it is gone.
    #[test]
    fn a_record_that_cannot_take_its_place_leaves_nothing_behind() {
        let folder = tempfile::tempdir().expect("a folder");
        let flight = Flight::new(folder.path(), "arm", &[("q", 2)]);
        let path = |number: usize| folder.path().join(format!("arm.{number}.flight.csv"));
        fs::create_dir_all(path(FILES - 1).join("in the way")).expect("a folder");
        fs::write(path(FILES - 2), "old").expect("written");
        assert!(flight.write_at("arm", Instant::now()).is_err());
        assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), 2, "the folder and the old record");
    }
}
