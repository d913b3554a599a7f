//! rivet-diagnosis
