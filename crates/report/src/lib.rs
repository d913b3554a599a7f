//! A diagnosis as a document: one set of figures, written as JSON, as a screen of text and as a page.
//!
//! Pure: what a [`Document`] holds is all that any of them shows, so no two of them can disagree.

mod actions;
mod changes;
mod document;
mod export;
mod next;
mod page;
mod rollout;
mod scores;
mod tally;
mod terms;
mod verdict;
mod views;
pub mod words;

pub use changes::{Changes, JointChange, Kept, Pair, ValueChange};
pub use document::{
    Cause, Cell, Clock, ClockOff, Curve, DataUse, Document, Excerpt, Figures, Format, FormatItem, Gap, Input, JointGap,
    Left, LogFinding, Magnitude, Number, Order, Parameter, Passport, Point, Power, SCHEMA, SelfCheck, Shrink, Stage,
    Tool, is_value,
};
pub use export::formats;
pub use page::page;
pub use rollout::{Rollout, RolloutPoint};
pub use scores::{Bin, CONFIDENCES, Group, Outcome, Prediction, STRENGTHS, Score, markdown as scores_markdown};
pub use tally::{Answer, Found, Tally};
pub use verdict::Line;
pub use views::{Contrast, View, Views};
