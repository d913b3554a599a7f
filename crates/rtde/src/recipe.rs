//! Recipes: names and types of the fields of a data package, and the values in one.

use crate::package::{RtdeError, kind};

/// Type of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldType {
    /// One byte, 0 or 1.
    Bool,
    /// One byte.
    Uint8,
    /// Four bytes.
    Uint32,
    /// Eight bytes.
    Uint64,
    /// Four bytes.
    Int32,
    /// Eight bytes.
    Double,
    /// Three doubles.
    Vector3,
    /// Six doubles, base to flange where they are of joints.
    Vector6,
    /// Six signed integers of four bytes.
    Vector6Int32,
    /// Six unsigned integers of four bytes.
    Vector6Uint32,
}

impl FieldType {
    /// The type of that name; none for `NOT_FOUND` and names that the description does not have.
    pub fn from_name(name: &str) -> Option<FieldType> {
        Some(match name {
            "BOOL" => FieldType::Bool,
            "UINT8" => FieldType::Uint8,
            "UINT32" => FieldType::Uint32,
            "UINT64" => FieldType::Uint64,
            "INT32" => FieldType::Int32,
            "DOUBLE" => FieldType::Double,
            "VECTOR3D" => FieldType::Vector3,
            "VECTOR6D" => FieldType::Vector6,
            "VECTOR6INT32" => FieldType::Vector6Int32,
            "VECTOR6UINT32" => FieldType::Vector6Uint32,
            _ => return None,
        })
    }

    /// Bytes of a value.
    pub fn size(self) -> usize {
        match self {
            FieldType::Bool | FieldType::Uint8 => 1,
            FieldType::Uint32 | FieldType::Int32 => 4,
            FieldType::Uint64 | FieldType::Double => 8,
            FieldType::Vector3 | FieldType::Vector6Int32 | FieldType::Vector6Uint32 => 24,
            FieldType::Vector6 => 48,
        }
    }
}

/// What the controller answers to a recipe: its number and the types of the fields, in the order asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recipe {
    id: u8,
    /// Name, type and place in the payload; no type where the controller does not know the field.
    fields: Vec<(String, Option<FieldType>, usize)>,
    size: usize,
}

impl Recipe {
    /// Decodes the answer to a recipe of `names`.
    ///
    /// # Errors
    /// Another count of types than of names, or a type that the description does not have.
    pub fn decode(names: &[&str], payload: &[u8]) -> Result<Recipe, RtdeError> {
        let malformed = |why: String| RtdeError::malformed(kind::SETUP_OUTPUTS, why);
        let Some((&id, types)) = payload.split_first() else { return Err(malformed("it is empty".to_owned())) };
        let types = std::str::from_utf8(types).map_err(|_| malformed("its types are no text".to_owned()))?;
        let count = types.split(',').count();
        if count != names.len() {
            return Err(malformed(format!("{count} types for {} fields", names.len())));
        }
        let (mut fields, mut size) = (Vec::with_capacity(names.len()), 1);
        for (name, word) in names.iter().zip(types.split(',')) {
            let found = FieldType::from_name(word);
            if found.is_none() && word != "NOT_FOUND" {
                return Err(malformed(format!("{name} has type {word:?}, which the protocol's description lacks")));
            }
            fields.push(((*name).to_owned(), found, size));
            size += found.map_or(0, FieldType::size);
        }
        Ok(Recipe { id, fields, size })
    }

    /// Number of the recipe; each data package begins with it.
    pub fn id(&self) -> u8 {
        self.id
    }

    /// Type of a field; none where the controller does not know it or it was not asked for.
    pub fn type_of(&self, name: &str) -> Option<FieldType> {
        self.fields.iter().find(|field| field.0 == name)?.1
    }

    /// Names of the fields that the controller does not know.
    pub fn not_found(&self) -> impl Iterator<Item = &str> {
        self.fields.iter().filter(|field| field.1.is_none()).map(|field| field.0.as_str())
    }

    /// Place of a field of this type in a data package, for [`Values`].
    pub fn place(&self, name: &str, of: FieldType) -> Option<usize> {
        let field = self.fields.iter().find(|field| field.0 == name && field.1 == Some(of))?;
        Some(field.2)
    }

    /// The values of a data package; none where it belongs to another recipe.
    ///
    /// # Errors
    /// A payload of another size than that of the recipe.
    pub fn values<'a>(&self, payload: &'a [u8]) -> Result<Option<Values<'a>>, RtdeError> {
        let malformed = |why: String| Err(RtdeError::malformed(kind::DATA, why));
        match payload.first() {
            None => malformed("it is empty".to_owned()),
            Some(id) if *id != self.id => Ok(None),
            Some(_) if payload.len() != self.size => {
                malformed(format!("{} bytes instead of {}", payload.len(), self.size))
            }
            Some(_) => Ok(Some(Values { payload })),
        }
    }
}

/// Values of one data package.
#[derive(Clone, Copy, Debug)]
pub struct Values<'a> {
    payload: &'a [u8],
}

impl Values<'_> {
    fn bytes<const N: usize>(&self, place: usize) -> [u8; N] {
        // A place of another recipe reads as zeros.
        self.payload.get(place..).and_then(<[u8]>::first_chunk).copied().unwrap_or([0; N])
    }

    /// The double at `place` ([`Recipe::place`]).
    pub fn double(&self, place: usize) -> f64 {
        f64::from_be_bytes(self.bytes(place))
    }

    /// The six doubles at `place`.
    pub fn vector6(&self, place: usize) -> [f64; 6] {
        std::array::from_fn(|i| self.double(place + 8 * i))
    }

    /// The signed integer at `place`.
    pub fn int32(&self, place: usize) -> i32 {
        i32::from_be_bytes(self.bytes(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_stand_one_behind_the_other() {
        let names = ["timestamp", "actual_q", "nothing", "robot_mode"];
        let recipe = Recipe::decode(&names, b"\x01DOUBLE,VECTOR6D,NOT_FOUND,INT32").expect("sound");
        assert_eq!(recipe.not_found().collect::<Vec<_>>(), ["nothing"]);
        assert_eq!(recipe.place("actual_q", FieldType::Vector6), Some(9));
        assert_eq!(recipe.place("actual_q", FieldType::Double), None);
        let mut payload = vec![1];
        payload.extend(0.25_f64.to_be_bytes());
        (0..6).for_each(|j| payload.extend(f64::from(j).to_be_bytes()));
        payload.extend((-1_i32).to_be_bytes());
        let values = recipe.values(&payload).expect("sound").expect("of this recipe");
        assert_eq!((values.double(1), values.int32(57)), (0.25, -1));
        assert_eq!(values.vector6(9), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        assert!(recipe.values(&payload[..60]).is_err() && recipe.values(&[]).is_err());
        payload[0] = 2;
        assert!(recipe.values(&payload).expect("another's").is_none());
    }

    #[test]
    fn an_answer_that_does_not_fit_is_refused() {
        for broken in [&b""[..], b"\x01", b"\x01DOUBLE,DOUBLE", b"\x01COMPLEX", b"\x01IN_USE", b"\x01\xff"] {
            assert!(Recipe::decode(&["timestamp"], broken).is_err(), "{broken:?}");
        }
    }
}
