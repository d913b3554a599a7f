//! What is declared of a key: its shape, range, default and meaning.

/// What a value looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// One number; an integer is accepted.
    Number,
    /// One whole number.
    Integer,
    /// `true` or `false`.
    Bool,
    /// Free text; its rule is in the meaning.
    Text,
    /// One of the words.
    Choice(&'static [&'static str]),
    /// Three numbers: x, y, z in base axes.
    Vector,
    /// One number per joint, base to flange.
    PerJoint,
    /// One number for all joints, or one per joint.
    PerJointOrOne,
    /// A joint: its number from 1, or its name in the URDF.
    Joint,
    /// `{ joint = position }`: joints of the URDF by name.
    JointPositions,
    /// `{ name = "...", value = ..., std = ... }`, one per base parameter.
    Parameters,
}

/// Which numbers are allowed (of an array: each entry). All are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bounds {
    /// The shape says it all.
    None,
    /// `low <= x <= high`
    Within(f64, f64),
    /// `low < x <= high`
    Above(f64, f64),
    /// `|x| <= high`
    Magnitude(f64),
    /// `0 < |x| <= high`
    NonZero(f64),
}

impl Bounds {
    /// Whether `x` keeps the rule.
    pub fn allow(self, x: f64) -> bool {
        match self {
            Bounds::None => true,
            Bounds::Within(low, high) => (low..=high).contains(&x),
            Bounds::Above(low, high) => low < x && x <= high,
            Bounds::Magnitude(high) => x.abs() <= high,
            Bounds::NonZero(high) => x != 0.0 && x.abs() <= high,
        }
    }

    /// The rule as text, for example `0 < x <= 100`.
    pub fn text(self) -> String {
        let n = figure;
        match self {
            Bounds::None => String::new(),
            Bounds::Within(low, high) => format!("{} <= x <= {}", n(low), n(high)),
            Bounds::Above(low, high) => format!("{} < x <= {}", n(low), n(high)),
            Bounds::Magnitude(high) => format!("|x| <= {}", n(high)),
            Bounds::NonZero(high) => format!("0 < |x| <= {}", n(high)),
        }
    }
}

/// A limit or default as short text.
fn figure(x: f64) -> String {
    if x.abs() >= 1e5 || (x != 0.0 && x.abs() < 1e-3) { format!("{x:e}") } else { format!("{x}") }
}

/// What holds when the file does not give the key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fallback {
    /// The file must give it (inside an optional section: once the section is there).
    Required,
    /// Nothing: the meaning says what happens then.
    Absent,
    /// Made from other values of the file, as the text says.
    Derived(&'static str),
    /// A number (of an array: for every joint).
    Number(f64),
    /// A whole number.
    Integer(i64),
    /// A switch.
    Bool(bool),
    /// A word or text.
    Text(&'static str),
}

impl Fallback {
    /// The default as text for the documentation.
    pub fn text(self) -> String {
        match self {
            Fallback::Required => "required".into(),
            Fallback::Absent => "none".into(),
            Fallback::Derived(rule) => rule.into(),
            Fallback::Number(x) => figure(x),
            Fallback::Integer(x) => format!("{x}"),
            Fallback::Bool(x) => format!("{x}"),
            Fallback::Text(x) => format!("\"{x}\""),
        }
    }
}

/// One key.
#[derive(Debug)]
pub struct Key {
    /// Section, empty for the top of the file.
    pub section: &'static str,
    /// Name inside the section.
    pub name: &'static str,
    /// What the value looks like.
    pub shape: Shape,
    /// Unit, `-` for a pure number, empty for text.
    pub unit: &'static str,
    /// Allowed numbers.
    pub bounds: Bounds,
    /// What holds without it.
    pub fallback: Fallback,
    /// What it does, in a line or two.
    pub meaning: &'static str,
}

impl Key {
    /// ` [unit]` behind a number, nothing for a pure number or text.
    pub(crate) fn unit_text(&self) -> String {
        if matches!(self.unit, "" | "-") { String::new() } else { format!(" [{}]", self.unit) }
    }

    /// `section.name`, or `name` at the top of the file.
    pub fn path(&self) -> String {
        if self.section.is_empty() { self.name.into() } else { format!("{}.{}", self.section, self.name) }
    }
}
