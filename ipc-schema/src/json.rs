//! Messages as JSON: what `serde` has no code for.

use serde::{Serialize, Serializer};

/// An array that is longer than those of `serde`.
pub(crate) fn array<S: Serializer, T: Serialize, const N: usize>(values: &[T; N], to: S) -> Result<S::Ok, S::Error> {
    values.as_slice().serialize(to)
}
