//! Units of channels: how a number as recorded becomes SI.

/// What a channel measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Quantity {
    /// Time, SI unit s.
    Time,
    /// Joint position, SI unit rad (m for a prismatic joint).
    Position,
    /// Joint velocity, SI unit rad/s (m/s).
    Velocity,
    /// Joint acceleration, SI unit rad/s² (m/s²).
    Acceleration,
    /// Joint torque, SI unit N m (N for a prismatic joint).
    Torque,
    /// Motor current, SI unit A.
    Current,
    /// Temperature, here in degC.
    Temperature,
}

/// `SI value = factor * value + offset`
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Unit {
    pub(crate) factor: f64,
    pub(crate) offset: f64,
}

impl Unit {
    pub(crate) const SI: Unit = Unit { factor: 1.0, offset: 0.0 };

    pub(crate) const fn times(factor: f64) -> Unit {
        Unit { factor, offset: 0.0 }
    }
}

/// Kelvin at 0 degC.
const ZERO_CELSIUS_K: f64 = 273.15;
const TURN: f64 = std::f64::consts::TAU;
const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// The units of a quantity, the SI unit first. Spelling is compared without case, blanks, `*`, `.`, `^` and `_`.
pub(crate) fn units(quantity: Quantity) -> &'static [(&'static str, Unit)] {
    const TIME: &[(&str, Unit)] = &[
        ("s", Unit::SI),
        ("sec", Unit::SI),
        ("seconds", Unit::SI),
        ("ms", Unit::times(1e-3)),
        ("us", Unit::times(1e-6)),
        ("µs", Unit::times(1e-6)),
        ("ns", Unit::times(1e-9)),
    ];
    const POSITION: &[(&str, Unit)] = &[
        ("rad", Unit::SI),
        ("radians", Unit::SI),
        ("m", Unit::SI),
        ("deg", Unit::times(DEGREE)),
        ("degrees", Unit::times(DEGREE)),
        ("°", Unit::times(DEGREE)),
        ("mrad", Unit::times(1e-3)),
        ("turn", Unit::times(TURN)),
        ("turns", Unit::times(TURN)),
        ("rev", Unit::times(TURN)),
        ("mm", Unit::times(1e-3)),
    ];
    const VELOCITY: &[(&str, Unit)] = &[
        ("rad/s", Unit::SI),
        ("m/s", Unit::SI),
        ("deg/s", Unit::times(DEGREE)),
        ("°/s", Unit::times(DEGREE)),
        ("mrad/s", Unit::times(1e-3)),
        ("turn/s", Unit::times(TURN)),
        ("turns/s", Unit::times(TURN)),
        ("rev/s", Unit::times(TURN)),
        ("rpm", Unit::times(TURN / 60.0)),
        ("mm/s", Unit::times(1e-3)),
    ];
    const ACCELERATION: &[(&str, Unit)] = &[
        ("rad/s2", Unit::SI),
        ("rad/s²", Unit::SI),
        ("m/s2", Unit::SI),
        ("deg/s2", Unit::times(DEGREE)),
        ("deg/s²", Unit::times(DEGREE)),
    ];
    const TORQUE: &[(&str, Unit)] = &[
        ("nm", Unit::SI),
        ("n·m", Unit::SI),
        ("n", Unit::SI),
        ("mnm", Unit::times(1e-3)),
        ("ncm", Unit::times(1e-2)),
        ("knm", Unit::times(1e3)),
        ("kgfm", Unit::times(9.80665)),
        ("kn", Unit::times(1e3)),
    ];
    const CURRENT: &[(&str, Unit)] = &[("a", Unit::SI), ("ma", Unit::times(1e-3))];
    const TEMPERATURE: &[(&str, Unit)] =
        &[("degc", Unit::SI), ("°c", Unit::SI), ("c", Unit::SI), ("k", Unit { factor: 1.0, offset: -ZERO_CELSIUS_K })];
    match quantity {
        Quantity::Time => TIME,
        Quantity::Position => POSITION,
        Quantity::Velocity => VELOCITY,
        Quantity::Acceleration => ACCELERATION,
        Quantity::Torque => TORQUE,
        Quantity::Current => CURRENT,
        Quantity::Temperature => TEMPERATURE,
    }
}

/// The unit of a quantity by its name.
pub(crate) fn unit(quantity: Quantity, name: &str) -> Option<Unit> {
    let bare: String =
        name.to_lowercase().chars().filter(|c| !matches!(c, ' ' | '*' | '.' | '^' | '_' | '\u{fffd}')).collect();
    units(quantity).iter().find(|(known, _)| *known == bare).map(|(_, unit)| *unit)
}

/// Names of the units of a quantity, for a message.
pub(crate) fn names(quantity: Quantity) -> String {
    units(quantity).iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
}

/// A column's name without the unit behind it, and that unit: `q1 [rad]`, `tau1 (N m)`.
pub(crate) fn split_unit(name: &str) -> (&str, Option<&str>) {
    let trimmed = name.trim();
    for (open, close) in [('[', ']'), ('(', ')')] {
        let Some(inside) = trimmed.strip_suffix(close) else { continue };
        let Some((base, unit)) = inside.rsplit_once(open) else { continue };
        // `q[3]` is an index.
        let is_unit = !base.trim().is_empty() && unit.chars().any(|c| c.is_alphabetic() || c == '°');
        if is_unit {
            return (base.trim_end(), Some(unit.trim()));
        }
    }
    (trimmed, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_found_in_any_spelling() {
        assert_eq!(unit(Quantity::Torque, "N m"), Some(Unit::SI));
        assert_eq!(unit(Quantity::Torque, "mN*m"), Some(Unit::times(1e-3)));
        assert_eq!(unit(Quantity::Position, "Deg"), Some(Unit::times(DEGREE)));
        assert_eq!(unit(Quantity::Velocity, "deg/s"), Some(Unit::times(DEGREE)));
        assert_eq!(unit(Quantity::Time, "ns"), Some(Unit::times(1e-9)));
        assert_eq!(unit(Quantity::Torque, "A"), None);
        assert_eq!(unit(Quantity::Temperature, "K").map(|u| u.offset), Some(-273.15));
    }

    #[test]
    fn unit_behind_a_name_is_split_off_and_an_index_is_not() {
        assert_eq!(split_unit("q1 [rad]"), ("q1", Some("rad")));
        assert_eq!(split_unit("tau1(N m)"), ("tau1", Some("N m")));
        assert_eq!(split_unit("robot_state.q[3]"), ("robot_state.q[3]", None));
        assert_eq!(split_unit("q[3] [deg]"), ("q[3]", Some("deg")));
        assert_eq!(split_unit("[rad]"), ("[rad]", None));
    }
}
