//! What a real-time shell needs of Linux: a timer that does not drift, priority and locked memory with a
//! report of what was refused, a histogram that never allocates, and an orderly end. Beside it the one thing that work on whole logs
//! asks of the allocator.

mod clock;
mod doctor;
mod end;
mod heap;
mod histogram;
mod recent;
mod settings;
mod usage;
mod wakeups;

pub use clock::{Overrun, PeriodTimer, Suspension, Tick, now_ns};
pub use doctor::{Finding, Machine, Severity};
pub use end::{Hangup, PARENT_VARIABLE, Shutdown, die_with_parent};
pub use heap::keep_freed_memory;
pub use histogram::LogHistogram;
pub use recent::RecentRows;
pub use settings::{Granted, RealTimeError, RealTimeSettings, Scheduling, enter};
pub use usage::ThreadUsage;
pub use wakeups::{Latencies, measure_wakeups};
