//! rivet-realtime
