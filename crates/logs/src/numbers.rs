//! Types of numbers as they are stored, and the column that they become.

use crate::columns::EXACT;

/// A type of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Kind {
    class: Class,
    bytes: usize,
    is_big_endian: bool,
    /// Unit of a time, which its type states.
    unit: Option<&'static str>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    Float,
    Signed,
    Unsigned,
}

impl Kind {
    /// Numbers with decimals (IEEE 754); none of a size other than 4 and 8.
    pub(crate) fn float(bytes: usize, is_big_endian: bool) -> Option<Kind> {
        matches!(bytes, 4 | 8).then_some(Kind { class: Class::Float, bytes, is_big_endian, unit: None })
    }

    /// Integers; none of a size other than 1, 2, 4 and 8.
    pub(crate) fn integer_of(bytes: usize, is_signed: bool, is_big_endian: bool) -> Option<Kind> {
        let class = if is_signed { Class::Signed } else { Class::Unsigned };
        matches!(bytes, 1 | 2 | 4 | 8).then_some(Kind { class, bytes, is_big_endian, unit: None })
    }

    /// The same type, which states a unit.
    pub(crate) fn with_unit(self, unit: Option<&'static str>) -> Kind {
        Kind { unit, ..self }
    }

    /// Bytes of a number.
    pub(crate) fn bytes(self) -> usize {
        self.bytes
    }

    /// The bits of a number, in the lowest bytes.
    fn bits(self, bytes: &[u8]) -> u64 {
        let fold = |bits: u64, byte: &u8| bits << 8 | u64::from(*byte);
        if self.is_big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) }
    }

    /// Unit of a time, which its type states.
    pub(crate) fn unit(self) -> Option<&'static str> {
        self.unit
    }

    /// Whether its numbers are integers.
    pub(crate) fn is_integer(self) -> bool {
        self.class != Class::Float
    }

    /// The integer; none of a type with decimals, or beyond 63 bits.
    pub(crate) fn integer(self, bytes: &[u8]) -> Option<i64> {
        let bits = self.bits(bytes);
        let unused = u32::try_from(64 - 8 * self.bytes).ok()?;
        match self.class {
            Class::Float => None,
            Class::Signed => Some((bits << unused).cast_signed() >> unused),
            Class::Unsigned => i64::try_from(bits).ok(),
        }
    }

    /// The number.
    pub(crate) fn value(self, bytes: &[u8]) -> f64 {
        let bits = self.bits(bytes);
        match (self.class, self.bytes) {
            (Class::Float, 4) => f64::from(f32::from_bits(bits as u32)),
            (Class::Float, _) => f64::from_bits(bits),
            _ => self.integer(bytes).map_or(bits as f64, |integer| integer as f64),
        }
    }
}

/// The numbers of a column. Integers that have no `f64` of their own count from the first.
#[derive(Default)]
pub(crate) struct Numbers {
    values: Vec<f64>,
    origin: Option<i64>,
}

impl Numbers {
    /// Appends the number that `bytes` stand for.
    pub(crate) fn push(&mut self, kind: Kind, bytes: &[u8]) {
        let integer = kind.integer(bytes);
        if self.values.is_empty() {
            self.origin = integer.filter(|first| first.unsigned_abs() > EXACT);
        }
        let counted = self.origin.zip(integer).and_then(|(origin, integer)| integer.checked_sub(origin));
        self.values.push(counted.map_or_else(|| kind.value(bytes), |counted| counted as f64));
    }

    /// The column.
    pub(crate) fn into_values(self) -> Vec<f64> {
        self.values
    }
}
