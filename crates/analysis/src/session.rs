//! What a program sees of an analysis while it runs: notes, progress, and the end that it asks for.
//!
//! Without a session notes go to standard error, and progress is drawn on a terminal. A program that embeds rivet runs an analysis in
//! a [`Session`] of its own.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Payload of the unwinding that ends an analysis after the hook of [`Session::new`] returned false.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cancelled;

/// Gets what is done and its share, 0 to 1; returns whether the analysis goes on.
type OnProgress = Box<dyn FnMut(&str, f64) -> bool + Send>;

/// Notes and progress of the analyses on one thread.
pub struct Session {
    notes: Vec<String>,
    on_progress: OnProgress,
    /// Files whose reading was noted, by the kind of the note.
    noted: BTreeSet<(&'static str, PathBuf)>,
}

thread_local! {
    static CURRENT: RefCell<Option<Session>> = const { RefCell::new(None) };
}

/// Ends the session of this thread, unwinding included.
struct Guard;

impl Drop for Guard {
    fn drop(&mut self) {
        CURRENT.with_borrow_mut(|current| *current = None);
    }
}

impl Session {
    /// A session whose `on_progress` gets what is done and its share, 0 to 1. When it returns false, the analysis unwinds with
    /// [`Cancelled`].
    pub fn new(on_progress: impl FnMut(&str, f64) -> bool + Send + 'static) -> Session {
        Session { notes: Vec::new(), on_progress: Box::new(on_progress), noted: BTreeSet::new() }
    }

    /// Runs `work` on this thread; returns its result and the notes in their order.
    ///
    /// ```
    /// use rivet_analysis::session::{Session, note};
    /// let (sum, notes) = Session::new(|_, _| true).run(|| { note("rivet: two rows were left out"); 1 + 1 });
    /// assert_eq!((sum, notes), (2, vec!["rivet: two rows were left out".to_owned()]));
    /// ```
    pub fn run<T>(self, work: impl FnOnce() -> T) -> (T, Vec<String>) {
        CURRENT.with_borrow_mut(|current| *current = Some(self));
        let guard = Guard;
        let result = work();
        let notes = CURRENT.with_borrow_mut(|current| current.take().map(|session| session.notes));
        drop(guard);
        (result, notes.unwrap_or_default())
    }
}

/// Reports what the user has to know in addition to the result.
pub fn note(text: impl Display) {
    let noted = CURRENT.with_borrow_mut(|current| match current {
        Some(session) => {
            session.notes.push(text.to_string());
            true
        }
        None => false,
    });
    if !noted {
        rivet_files::note(text);
    }
}

/// Passes progress on; returns whether there is a session for it.
pub(crate) fn progress(what: &str, share: f64) -> bool {
    // Taken out while the program runs its own code: that may note something.
    let Some(mut session) = CURRENT.with_borrow_mut(Option::take) else { return false };
    let goes_on = (session.on_progress)(what, share);
    CURRENT.with_borrow_mut(|current| *current = Some(session));
    if !goes_on {
        std::panic::resume_unwind(Box::new(Cancelled));
    }
    true
}

/// Passes progress on where there is a session, and draws nothing elsewhere.
pub(crate) fn checkpoint(what: &str, share: f64) {
    progress(what, share);
}

/// Whether this is the first note of `kind` about a file, in the session or, without one, in the process.
pub(crate) fn is_first(kind: &'static str, path: &Path) -> bool {
    static NOTED: Mutex<BTreeSet<(&str, PathBuf)>> = Mutex::new(BTreeSet::new());
    let key = (kind, path.to_owned());
    let in_session = CURRENT.with_borrow_mut(|current| current.as_mut().map(|s| s.noted.insert(key.clone())));
    in_session.unwrap_or_else(|| NOTED.lock().map_or(true, |mut noted| noted.insert(key)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_go_to_the_session_of_the_thread_and_progress_ends_it() {
        let (first, notes) = Session::new(|_, _| true).run(|| {
            note("a");
            [is_first("clock", Path::new("log")), is_first("clock", Path::new("log"))]
        });
        assert_eq!((first, notes), ([true, false], vec!["a".to_owned()]));
        let cancelled = std::panic::catch_unwind(|| {
            Session::new(|_, share| share < 0.5)
                .run(|| (0..10).for_each(|k| assert!(progress("fit", 0.1 * f64::from(k)))))
        });
        let payload = cancelled.expect_err("ended");
        assert_eq!(payload.downcast_ref::<Cancelled>(), Some(&Cancelled));
        assert!(!progress("fit", 0.0), "the session ended with it");
    }
}
