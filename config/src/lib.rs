//! rivet-config
