//! The forms of the tables of messages and enumerations.

/// Where each field of a message lies; asserted at compile time beside the message.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// The struct's name: `JointState`.
    pub name: &'static str,
    /// Name and version on the bus: `rivet.JointState.v1`.
    pub type_name: &'static str,
    /// Size \[bytes\].
    pub size: usize,
    /// Alignment \[bytes\].
    pub align: usize,
    /// Fields and their offsets \[bytes\], in order.
    pub fields: &'static [(&'static str, usize)],
}

/// The numbers of an enumeration on the wire.
#[derive(Clone, Copy, Debug)]
pub struct Enumeration {
    /// The enumeration's name: `DaemonMode`.
    pub name: &'static str,
    /// Variants and their numbers.
    pub values: &'static [(&'static str, u32)],
}
