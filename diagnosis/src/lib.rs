//! Where a simulator differs from the arm, which effect causes it, how far the gap shrinks.
//!
//! So far: the measure of the gap itself ([`Gap`]), the one figure that every report uses.

mod gap;

pub use gap::Gap;
