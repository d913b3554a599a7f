//! rivet-tests
