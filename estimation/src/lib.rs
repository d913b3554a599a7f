//! rivet-estimation
