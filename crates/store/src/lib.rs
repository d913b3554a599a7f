//! What a robot's daemon knows, on disk: two generations of one file, each whole or not there.
//!
//! A file is written beside its place, synchronised and renamed over the *older* generation, so that a crash, a full disk
//! or a lost mains supply at any instant leaves the newer one as it was. What is read has passed length, checksum, version,
//! robot and model; everything else is reported and not used.
//!
//! ```
//! # let folder = std::env::temp_dir().join(format!("rivet-store-doc-{}", std::process::id()));
//! use rivet_store::{Knowledge, Parameters, Store};
//!
//! let mut store = Store::open(&folder, "ur10e").expect("the folder can be made");
//! let parameters = Parameters { epoch: 7, seq: 700, values: vec![1.0, 2.0], std: vec![0.1, 0.2] };
//! store.save(&Knowledge { model_hash: 42, parameters, supervision: None, memory: None }).expect("written");
//! let found = store.load(42).knowledge.expect("it was just written");
//! assert_eq!(found.parameters.values, [1.0, 2.0]);
//! # std::fs::remove_dir_all(folder).expect("removed");
//! ```

mod error;
mod format;
mod generations;

pub use error::{Problem, StoreError};
pub use format::{FORMAT_VERSION, Knowledge, Memory, Parameters, Supervision};
pub use generations::{Loaded, Store};
