//! rivet-logs
