//! The messages, one file each: fixed layout, the same bytes in Rust, C and Python.
//!
//! A new message is a file here and its `mod` line below. `cargo xtask mirrors` then writes `list.rs`, the C header and the
//! Python module.

mod command;
mod consistent_parameters;
mod control;
mod controller_health;
mod drift;
mod health;
mod joint_state;
mod link_state;
mod list;
mod parameters;
mod setpoint;
mod timing;

pub use list::*;

use iceoryx2::prelude::ZeroCopySend;

/// Most joints a message carries; entries from `joints` on are zero (or NaN where the field says so).
pub const MAX_JOINTS: usize = 8;

/// Most base parameters a message carries; entries from `count` on are zero.
pub const MAX_PARAMETERS: usize = 128;

/// A type that may travel on the bus.
///
/// A new layout *or meaning* is a new [`VERSION`](Message::VERSION) and so a new type name: the bus
/// compares only name, size and alignment, never fields.
pub trait Message: Copy + core::fmt::Debug + ZeroCopySend + 'static {
    /// The name between `rivet.` and `.v`: `JointState`.
    const NAME: &'static str;
    /// The version this program speaks.
    const VERSION: u32;
    /// `rivet.<NAME>.v<VERSION>`, as the bus stores and compares it.
    const TYPE_NAME: &'static str;
    /// The message that says nothing: zeros, and NaN where a field uses it for "none".
    const EMPTY: Self;
}

/// A message that says when it was made; blackboard readers judge staleness by it.
pub trait Stamped: Message {
    /// `CLOCK_MONOTONIC` \[ns\].
    fn stamp_ns(&self) -> u64;
}

/// A number that no variant of an enumeration on the wire has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{value} is no {enumeration}")]
pub struct UnknownValue {
    /// The enumeration it was read as.
    pub enumeration: &'static str,
    /// The number found.
    pub value: u32,
}

/// Implements [`Message`] with its empty value and pins the layout: a field that moves does not compile.
macro_rules! message {
    ($type:ident v $version:literal, size $size:literal align $align:literal, empty $empty:expr,
     { $($field:ident @ $offset:literal),+ $(,)? }) => {
        impl $crate::messages::Message for $type {
            const NAME: &'static str = stringify!($type);
            const VERSION: u32 = $version;
            const TYPE_NAME: &'static str = concat!("rivet.", stringify!($type), ".v", $version);
            const EMPTY: Self = $empty;
        }
        impl Default for $type {
            fn default() -> Self {
                <Self as $crate::messages::Message>::EMPTY
            }
        }
        const _: () = {
            assert!(size_of::<$type>() == $size && align_of::<$type>() == $align);
            $(assert!(core::mem::offset_of!($type, $field) == $offset);)+
        };
        impl $type {
            /// The layout as a table for the C header and the Python mirror.
            pub(crate) const LAYOUT: $crate::layout::Layout = $crate::layout::Layout {
                name: stringify!($type),
                type_name: <$type as $crate::messages::Message>::TYPE_NAME,
                size: $size,
                align: $align,
                fields: &[$((stringify!($field), $offset)),+],
            };
        }
    };
}
pub(crate) use message;

/// An enumeration that travels as `u32`, or as the number type after `as`, and is checked where it is read.
macro_rules! wire_enum {
    ($(#[$doc:meta])* $name:ident { $($variants:tt)+ }) => {
        wire_enum!($(#[$doc])* $name as u32 { $($variants)+ });
    };
    ($(#[$doc:meta])* $name:ident as $number:ident {
        $($(#[$variant_doc:meta])* $variant:ident = $value:literal),+ $(,)?
    }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr($number)]
        pub enum $name {
            $($(#[$variant_doc])* $variant = $value),+
        }
        impl From<$name> for $number {
            fn from(value: $name) -> $number {
                value as $number
            }
        }
        impl TryFrom<$number> for $name {
            type Error = $crate::messages::UnknownValue;
            fn try_from(value: $number) -> Result<Self, Self::Error> {
                match value {
                    $($value => Ok(Self::$variant),)+
                    _ => Err($crate::messages::UnknownValue { enumeration: stringify!($name), value: value.into() }),
                }
            }
        }
        impl $name {
            /// Names and numbers, for the C header and the Python mirror.
            pub(crate) const TABLE: $crate::layout::Enumeration = $crate::layout::Enumeration {
                name: stringify!($name),
                values: &[$((stringify!($variant), $value)),+],
            };
        }
    };
}
pub(crate) use wire_enum;
