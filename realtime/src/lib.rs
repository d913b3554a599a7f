//! What a real-time shell needs of Linux: a timer that does not drift, priority and locked memory with a
//! report of what was refused, a histogram that never allocates, and an orderly end.

mod clock;
mod end;
mod histogram;
mod settings;

pub use clock::{PeriodTimer, Tick, now_ns};
pub use end::{Hangup, Shutdown, die_with_parent};
pub use histogram::LogHistogram;
pub use settings::{Granted, RealTimeError, RealTimeSettings, enter};
