//! rivet-ipc-schema
