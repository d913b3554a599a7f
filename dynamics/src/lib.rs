//! rivet-dynamics
