//! rivet-daemon
