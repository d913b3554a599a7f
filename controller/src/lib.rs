//! rivet-controller
