//! Work on a thread of its own: Python's other threads go on, Ctrl-C ends the call, and a panic becomes an exception.

use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::Result;
use pyo3::prelude::*;
use rivet_analysis::fault::{Kind, kind};
use rivet_analysis::session::{Cancelled, Session};

/// Time between two looks at Python's signals.
const SIGNALS: Duration = Duration::from_millis(20);
/// Stack of the thread, as a program's main thread has it \[bytes\].
const STACK_BYTES: usize = 16 << 20;
/// Progress reports that may wait; further ones are dropped.
const REPORTS: usize = 16;

/// The result of the work, and the notes.
type Outcome<T> = Result<(T, Vec<String>)>;

/// What the thread of the work sends.
enum Message<T> {
    Progress(String, f64),
    Done(Outcome<T>),
}

/// Runs `work` on its own thread without the interpreter's lock; returns its result and the notes.
///
/// * `progress`: called with what is done and its share, 0 to 1; an exception of it ends the work
///
/// # Errors
/// `rivet.Error` for a failure, `rivet.InternalError` for a panic, and the exception of a signal handler (`KeyboardInterrupt`). The work
/// then ends at its next report of progress.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce() -> Result<T> + Send + 'static,
) -> PyResult<(T, Vec<String>)> {
    let cancelled = Arc::new(AtomicBool::new(false));
    let (sender, receiver) = sync_channel(REPORTS);
    let thread = {
        let cancelled = Arc::clone(&cancelled);
        let body = move || in_session(&sender, cancelled, work);
        std::thread::Builder::new().name("rivet".to_owned()).stack_size(STACK_BYTES).spawn(body)?
    };
    let result = receive(py, receiver, progress);
    if let Err(why) = result {
        cancelled.store(true, Ordering::Relaxed);
        return Err(why);
    }
    match result? {
        Some(done) => done.map_err(|why| error(py, &format!("{why:#}"), kind(&why))),
        // It ended without a result: it panicked.
        None => Err(internal_error(py, py.detach(|| thread.join()).err())),
    }
}

fn in_session<T>(sender: &SyncSender<Message<T>>, cancelled: Arc<AtomicBool>, work: impl FnOnce() -> Result<T>)
where
    T: Send + 'static,
{
    let reports = sender.clone();
    let session = Session::new(move |what, share| {
        // A full queue loses a report and nothing else.
        let _ = reports.try_send(Message::Progress(what.to_owned(), share));
        !cancelled.load(Ordering::Relaxed)
    });
    let (result, notes) = session.run(work);
    // Nobody waits after an interrupt.
    let _ = sender.send(Message::Done(result.map(|value| (value, notes))));
}

/// Waits for the end; none where the thread ended without a result.
fn receive<T: Send>(
    py: Python<'_>,
    mut receiver: Receiver<Message<T>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Option<Outcome<T>>> {
    loop {
        let waiting = &mut receiver;
        match py.detach(move || waiting.recv_timeout(SIGNALS)) {
            Ok(Message::Done(result)) => return Ok(Some(result)),
            Ok(Message::Progress(what, share)) => {
                if let Some(progress) = &progress {
                    progress.call1(py, (what, share))?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(None),
        }
        py.check_signals()?;
    }
}

/// `rivet.Error` of a failure.
pub(crate) fn error(py: Python<'_>, message: &str, kind: Kind) -> PyErr {
    let name = match kind {
        Kind::Usage => "usage",
        Kind::Data => "data",
        Kind::Config => "config",
        Kind::InputOutput => "file",
        Kind::Interrupted | Kind::Other => "other",
    };
    raised(py, "Error", (message, name))
}

fn internal_error(py: Python<'_>, payload: Option<Box<dyn Any + Send>>) -> PyErr {
    let text = payload.as_deref().map_or("no result", |payload| {
        if payload.is::<Cancelled>() {
            return "cancelled";
        }
        let text = payload.downcast_ref::<&str>().copied();
        text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("panic")
    });
    raised(py, "InternalError", (format!("internal error: {text}; report it with the inputs"), "internal"))
}

/// An exception of `rivet.errors`.
fn raised<'py>(py: Python<'py>, class: &str, arguments: impl pyo3::call::PyCallArgs<'py>) -> PyErr {
    let made = py.import("rivet.errors").and_then(|m| m.getattr(class)).and_then(|class| class.call1(arguments));
    made.map_or_else(|why| why, PyErr::from_value)
}

/// Panics in the work: the tests of the package call it.
#[pyfunction]
pub(crate) fn panic_on_request(py: Python<'_>) -> PyResult<()> {
    run(py, None, || -> Result<()> { panic!("panics on request") }).map(drop)
}
