//! What is only shown: reports of daemon and controller, and diagnoses as they were written.

use crate::bytes::{Bytes, signature};
use crate::targets::{Run, robot};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use rivet_ipc_schema::{BusConfig, ControllerHealth, Drift, Health, Message, Parameters, Timing};
use rivet_monitor::{Snapshot, View, as_text, draw};
use rivet_report::{Changes, Document, page};

/// A message with the next bytes as its own, from its first to its last.
#[allow(unsafe_code, reason = "a message is what another process has put into shared memory: bytes, whatever they are")]
fn any<T: Message>(bytes: &mut Bytes<'_>) -> T {
    let mut message = T::EMPTY;
    let begin = (&raw mut message).cast::<u8>();
    for k in 0..size_of::<T>().min(bytes.len()) {
        // SAFETY: `k` is within the message, which is of numbers and arrays of numbers alone: they may have any bits.
        unsafe { begin.add(k).write(bytes.u8()) };
    }
    message
}

/// Reports into `rivet monitor`, as text and on a screen of some size.
pub(crate) fn reports() -> Run {
    let robot = robot("dd2");
    Box::new(move |input| {
        let mut snapshot = Snapshot::new(&robot, &BusConfig::default());
        let mut bytes = Bytes::new(input);
        let [width, height, scroll] = [bytes.u8(), bytes.u8(), bytes.u8()];
        while !bytes.is_empty() {
            match bytes.u8() % 8 {
                0 => snapshot.take_health(&any::<Health>(&mut bytes)),
                1 => snapshot.take_controller(&any::<ControllerHealth>(&mut bytes)),
                2 => snapshot.drift = Some(any::<Drift>(&mut bytes)),
                3 => snapshot.timing = Some(any::<Timing>(&mut bytes)),
                4 => snapshot.parameters = Some(any::<Parameters>(&mut bytes)),
                5 => {
                    // Of the model that the monitor has read, so that it has names for them.
                    let mut set = any::<Parameters>(&mut bytes);
                    (set.model_hash, set.count) = (robot.hash, robot.nominal_base.len() as u32);
                    snapshot.parameters = Some(set);
                }
                _ => {
                    bytes.u64();
                }
            }
        }
        let text = as_text(&snapshot);
        assert!(text.lines().count() < 300, "{text}");
        let mut view = View::default();
        view.scroll(isize::from(scroll));
        // Larger ones are drawn as these are, and take most of the time.
        let size = (u16::from(width) % 160 + 1, u16::from(height) % 64 + 1);
        let mut terminal = Terminal::new(TestBackend::new(size.0, size.1)).expect("a terminal in memory");
        terminal.draw(|frame| draw(frame, &snapshot, &mut view)).expect("drawn in memory");
        signature(&text)
    })
}

/// A diagnosis as `rivet compare` reads it: against itself and against a sound one, and as a page.
pub(crate) fn document() -> Run {
    let sound: Document = serde_json::from_str(SOUND).expect("a sound document");
    let scripts = ["<script", "</script"].map(|tag| page(&sound, &[]).matches(tag).count()).into();
    Box::new(move |input| {
        let document: Document = match serde_json::from_slice(input) {
            Ok(document) => document,
            Err(why) => return signature(&why.to_string()),
        };
        if let Ok(changes) = Changes::between(&document, &document) {
            assert!(changes.is_same(), "a document differs from itself");
        }
        let changes = Changes::between(&sound, &document);
        let said = changes.map_or_else(|rules| rules.join(" "), |changes| format!("{changes:?}"));
        let page = page(&document, &[]);
        let [begins, ends] = ["<script", "</script"].map(|tag| page.matches(tag).count());
        assert!((begins, ends) == scripts, "what a file says is run: {begins}, {ends}");
        signature(&said)
    })
}

/// The least that is a diagnosis.
const SOUND: &str = include_str!("../corpus/document/least.json");
