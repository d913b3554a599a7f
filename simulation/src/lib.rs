//! rivet-simulation
