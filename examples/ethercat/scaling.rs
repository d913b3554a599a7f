//! The scaling table, and what it makes of the objects of a drive: radians and newton metres of its joint, and back.

use crate::drive::{Inputs, POSITION_MODE, TORQUE_MODE};
use std::f64::consts::TAU;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Range of a number in the table.
struct Key {
    name: &'static str,
    needed: bool,
    whole: bool,
    least: f64,
    most: f64,
    /// The range is that of the number without its sign.
    signed: bool,
    /// What the number is, with unit and where it is found.
    remedy: &'static str,
}

impl Key {
    const fn new(name: &'static str, least: f64, most: f64, remedy: &'static str) -> Key {
        Key { name, needed: true, whole: false, least, most, signed: false, remedy }
    }

    const fn whole(self) -> Key {
        Key { whole: true, ..self }
    }

    const fn optional(self) -> Key {
        Key { needed: false, ..self }
    }

    const fn signed(self) -> Key {
        Key { signed: true, ..self }
    }

    fn rule(&self) -> String {
        let Key { least, most, remedy, .. } = self;
        let (whole, signed) =
            (if self.whole { "whole " } else { "" }, if self.signed { ", or its negative" } else { "" });
        if least == most {
            return format!("it must be {least} or -{least}: {remedy}");
        }
        format!("it must be a {whole}number in {least} to {most}{signed}: {remedy}")
    }

    /// The number, if it is of the kind and in the range.
    fn number(&self, value: &DeValue<'_>) -> Option<f64> {
        let number = match value {
            DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix()).ok()? as f64,
            DeValue::Float(number) if !self.whole => number.as_str().parse().ok()?,
            _ => return None,
        };
        (self.least..=self.most).contains(&if self.signed { number.abs() } else { number }).then_some(number)
    }
}

const SLAVE: Key = Key::new("slave", 0.0, 65535.0, "position of the drive on the bus, 0 is the first").whole();
/// From one increment, a Hall sensor's or a coarser unit of the drive, to the counter's 32 bits.
const COUNTS: Key = Key::new("counts_per_rev", 1.0, COUNTER, "increments of 0x6064 per motor revolution");
/// Units of velocity are coarser than increments: rad/s give 6.28, thousands of 1/min 0.06.
const VELOCITY: Key = Key::new(
    "velocity_per_rev_s",
    1e-3,
    COUNTER,
    "0x606C at one motor revolution per second, 60 where its unit is 1/min",
);
/// Beyond the gears of arms (1 to 1000), on both sides.
const GEAR: Key =
    Key::new("gear_ratio", 1e-3, 1e5, "motor revolutions per joint revolution; the direction goes into sign");
const SIGN: Key =
    Key::new("sign", 1.0, 1.0, "-1 where positive increments turn the joint against its URDF axis").whole().signed();
const ZERO: Key =
    Key::new("zero_counts", i32::MIN as f64, i32::MAX as f64, "0x6064 at the joint's URDF zero, 32 bits").whole();
/// From 0.001 to 10 000 N m, the motor of a gripper to that of a press.
const TORQUE: Key = Key::new("rated_torque_mNm", 1.0, 1e7, "0x6076 of the drive, in mN m").optional();
/// From 1 mA to 10 kA.
const CURRENT: Key = Key::new("rated_current_mA", 1.0, 1e7, "0x6075 of the drive, in mA").optional();
/// From a motor of a watch to a direct drive of a telescope.
const CONSTANT: Key =
    Key::new("torque_constant_Nm_per_A", 1e-4, 1e3, "torque of the motor per ampere, from its data sheet").optional();
const LIMIT: Key = Key::new("max_torque_permille", 1.0, 32767.0, "0x6072 of the drive").whole();
const LINK: Key = Key::new(
    "link_counts_per_rev",
    1.0,
    COUNTER,
    "increments of 0x60E4:01 per joint revolution, negative against the URDF axis",
)
.optional()
.signed();
const LINK_ZERO: Key =
    Key::new("link_zero_counts", i32::MIN as f64, i32::MAX as f64, "0x60E4:01 at the joint's URDF zero, 32 bits")
        .whole()
        .optional();

/// Values of a 32-bit counter.
const COUNTER: f64 = 4_294_967_296.0;

/// Keys of a `[[joint]]`. Within these ranges every product and quotient of the scaling is finite and not zero.
const KEYS: [&Key; 12] =
    [&SLAVE, &COUNTS, &VELOCITY, &GEAR, &SIGN, &ZERO, &TORQUE, &CURRENT, &CONSTANT, &LIMIT, &LINK, &LINK_ZERO];

/// The checked table.
#[derive(Debug)]
pub(crate) struct Table {
    /// Mode of operation of all drives, 0x6060.
    pub(crate) mode: i8,
    /// Base to flange.
    pub(crate) joints: Vec<Joint>,
}

/// Scaling of a joint. Positive is about the joint's URDF axis; all joint quantities are behind the gear.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Joint {
    /// Position of the drive on the bus.
    pub(crate) slave: usize,
    /// Increments of 0x6064 per radian of the joint, with the sign.
    pub(crate) counts_per_rad: f64,
    /// Increments of 0x606C per rad/s of the joint, with the sign.
    pub(crate) velocity_counts: f64,
    /// 0x6064 where the joint is at zero.
    pub(crate) zero: i32,
    /// Torque on the joint per per mille of rated torque \[N m\], with the sign.
    pub(crate) permille: f64,
    /// 0x6072, at most 32767 \[per mille\].
    pub(crate) max_permille: i16,
    /// Increments of 0x60E4:01 per radian of the joint, with its own sign, and its value at joint zero.
    pub(crate) link: Option<(f64, i32)>,
}

impl Joint {
    /// Position \[rad\] of a counter of the motor that has no limits.
    pub(crate) fn position(&self, counts: i64) -> f64 {
        (counts - i64::from(self.zero)) as f64 / self.counts_per_rad
    }

    /// 0x607A for a finite position \[rad\]: the counter's low 32 bits, as the drive counts.
    pub(crate) fn target_position(&self, q: f64) -> i32 {
        i64::from(self.zero).wrapping_add((q * self.counts_per_rad).round() as i64) as i32
    }

    /// Torque on the joint \[N m\] from 0x6077.
    pub(crate) fn torque(&self, permille: i16) -> f64 {
        f64::from(permille) * self.permille
    }

    /// 0x6071 for a torque on the joint \[N m\]: rounded, limited to 0x6072. 0 for a torque that is not finite.
    pub(crate) fn target_torque(&self, tau: f64) -> i16 {
        if !tau.is_finite() {
            return 0;
        }
        let limit = f64::from(self.max_permille);
        (tau / self.permille).round().clamp(-limit, limit) as i16
    }

    /// Velocity of the joint \[rad/s\] from 0x606C.
    pub(crate) fn velocity(&self, counts: i32) -> f64 {
        f64::from(counts) / self.velocity_counts
    }
}

/// A 32-bit counter followed beyond its range. Between two looks it moves by less than half its range.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counter {
    last: i32,
    total: i64,
}

impl Counter {
    /// Starts at most half a range from `zero`.
    pub(crate) fn new(raw: i32, zero: i32) -> Counter {
        Counter { last: raw, total: i64::from(zero) + i64::from(raw.wrapping_sub(zero)) }
    }

    /// The counter without limits.
    pub(crate) fn follow(&mut self, raw: i32) -> i64 {
        self.total += i64::from(raw.wrapping_sub(self.last));
        self.last = raw;
        self.total
    }
}

/// Position of a joint over time, from the second encoder where the table has one, else from the motor's.
pub(crate) struct Encoder {
    counter: Counter,
    link: bool,
}

impl Encoder {
    pub(crate) fn new(joint: &Joint, inputs: &Inputs) -> Encoder {
        let (raw, zero) = joint.link.map_or((inputs.position, joint.zero), |(_, zero)| (inputs.link_position, zero));
        Encoder { counter: Counter::new(raw, zero), link: joint.link.is_some() }
    }

    /// Position of the joint \[rad\].
    pub(crate) fn position(&mut self, joint: &Joint, inputs: &Inputs) -> f64 {
        let total = self.counter.follow(if self.link { inputs.link_position } else { inputs.position });
        joint.link.map_or_else(|| joint.position(total), |(scale, zero)| (total - i64::from(zero)) as f64 / scale)
    }
}

/// Reads a scaling table.
///
/// # Errors
/// Each error on a line of its own: file, line, column, key, value, rule and what to do; in the order of the file. While the text is
/// no TOML, these are the errors of the TOML reader alone.
pub(crate) fn read(path: &Path) -> Result<Table, String> {
    let text = std::fs::read_to_string(path).map_err(|why| format!("{}: {why}", path.display()))?;
    parse(path, &text)
}

fn parse(path: &Path, text: &str) -> Result<Table, String> {
    let mut rules = Rules { text, broken: Vec::new() };
    let (document, errors) = DeTable::parse_recoverable(text);
    for error in &errors {
        rules.broken(&error.span().unwrap_or(0..0), error.message());
    }
    let table = if errors.is_empty() { rules.table(document.get_ref()) } else { None };
    match table {
        Some(table) if rules.broken.is_empty() => Ok(table),
        _ => Err(rules.report(path)),
    }
}

/// Looks for broken rules in a text: where each begins, and the message.
struct Rules<'a> {
    text: &'a str,
    broken: Vec<(usize, String)>,
}

impl Rules<'_> {
    fn broken(&mut self, place: &Range<usize>, rule: impl Into<String>) {
        self.broken.push((place.start, rule.into()));
    }

    /// All messages in the order of the text.
    fn report(mut self, path: &Path) -> String {
        self.broken.sort_by_key(|(start, _)| *start);
        let line = |(start, rule): &(usize, String)| {
            let before = self.text.get(..*start).unwrap_or_default();
            let (line, column) =
                (before.split('\n').count(), before.chars().rev().take_while(|c| *c != '\n').count() + 1);
            format!("{}:{line}:{column}: {rule}", path.display())
        };
        self.broken.iter().map(line).collect::<Vec<_>>().join("\n")
    }

    /// Beginning of what is written at a place, on one line.
    fn written(&self, place: &Range<usize>) -> String {
        let line = self.text.get(place.clone()).unwrap_or_default().lines().next().unwrap_or_default();
        line.chars().take(40).collect()
    }

    fn unknown_keys(&mut self, table: &DeTable<'_>, known: &[&str]) {
        for key in table.keys().filter(|key| !known.contains(&key.get_ref().as_ref())) {
            let rule = format!("{} is unknown; remove it, or write one of {}", key.get_ref(), known.join(", "));
            self.broken(&key.span(), rule);
        }
    }

    fn table(&mut self, table: &DeTable<'_>) -> Option<Table> {
        self.unknown_keys(table, &["mode", "joint"]);
        let mode = match table.get("mode").map(|mode| (mode.span(), mode.get_ref())) {
            Some((_, DeValue::String(mode))) if mode == "torque" => TORQUE_MODE,
            Some((_, DeValue::String(mode))) if mode == "position" => POSITION_MODE,
            other => {
                let place = other.map_or(0..0, |(place, _)| place);
                let is = if place.is_empty() { "missing".into() } else { self.written(&place) };
                self.broken(&place, format!("mode is {is}; it must be \"torque\" or \"position\", in quotes"));
                0
            }
        };
        let most = rivet::Sample::default().q.len();
        let rule = format!("there must be 1 to {most}, one [[joint]] for each joint of the arm");
        let Some(joints) = table.get("joint") else {
            self.broken(&(0..0), format!("[[joint]] is missing; {rule}"));
            return None;
        };
        let Some(array) = joints.get_ref().as_array() else {
            self.broken(&joints.span(), format!("joint is {}; {rule}", self.written(&joints.span())));
            return None;
        };
        if !(1..=most).contains(&array.len()) {
            self.broken(&joints.span(), format!("{} joints; {rule}", array.len()));
        }
        let joints: Vec<Joint> = array.iter().filter_map(|joint| self.joint(joint)).collect();
        let mut slaves = Vec::new();
        for value in array.iter().filter_map(|joint| joint.get_ref().as_table()?.get(SLAVE.name)) {
            let slave = SLAVE.number(value.get_ref());
            if slave.is_some() && slaves.contains(&slave) {
                let rule = format!("slave is {} for two joints; give each its own", self.written(&value.span()));
                self.broken(&value.span(), rule);
            }
            slaves.push(slave);
        }
        Some(Table { mode, joints })
    }

    /// Number of a key; `None` where the key is missing or breaks a rule.
    fn number(&mut self, table: &DeTable<'_>, place: &Range<usize>, key: &Key) -> Option<f64> {
        let Some(value) = table.get(key.name) else {
            if key.needed {
                self.broken(place, format!("{} is missing; {}", key.name, key.rule()));
            }
            return None;
        };
        let number = key.number(value.get_ref());
        if number.is_none() {
            let rule = format!("{} is {}; {}", key.name, self.written(&value.span()), key.rule());
            self.broken(&value.span(), rule);
        }
        number
    }

    fn joint(&mut self, value: &Spanned<DeValue<'_>>) -> Option<Joint> {
        let place = value.span();
        let Some(table) = value.get_ref().as_table() else {
            let rule = format!("joint is {}; it must be a section [[joint]] with keys", self.written(&place));
            self.broken(&place, rule);
            return None;
        };
        self.unknown_keys(table, &KEYS.map(|key| key.name));
        let [slave, counts, per_rev_s, gear, sign, zero, torque, current, constant, limit, link, link_zero] =
            KEYS.map(|key| self.number(table, &place, key));
        let [has_torque, has_current, has_constant, has_link, has_link_zero] =
            [&TORQUE, &CURRENT, &CONSTANT, &LINK, &LINK_ZERO].map(|key| table.contains_key(key.name));
        if has_torque == (has_current || has_constant) || has_current != has_constant {
            let rule = "it must have either rated_torque_mNm (0x6076), or both rated_current_mA (0x6075) and \
                        torque_constant_Nm_per_A; state what 0x6077 is per mille of";
            self.broken(&place, rule);
        }
        if has_link != has_link_zero {
            self.broken(&place, "link_counts_per_rev and link_zero_counts must both stand here or neither");
        }
        let rated = 1e-3 * torque.or_else(|| Some(current? * constant?))?;
        let turns = sign? * gear? / TAU;
        Some(Joint {
            slave: slave? as usize,
            counts_per_rad: turns * counts?,
            velocity_counts: turns * per_rev_s?,
            zero: zero? as i32,
            permille: sign? * gear? * rated / 1000.0,
            max_permille: limit? as i16,
            link: link.zip(link_zero).map(|(per_rev, zero)| (per_rev / TAU, zero as i32)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const EXAMPLE: &str = include_str!("arm.toml");

    fn parsed(text: &str) -> Result<Table, String> {
        parse(Path::new("arm.toml"), text)
    }

    /// A joint of numbers as they occur.
    fn joints() -> impl Strategy<Value = Joint> {
        let sign = prop_oneof![Just(1.0), Just(-1.0)];
        (sign, 1.0..400.0_f64, 12..24_u32, any::<i32>(), 10.0..50_000.0_f64, 1..=32767_i16).prop_map(
            |(sign, gear, bits, zero, rated, max_permille)| {
                let counts = f64::from(1 << bits) * sign * gear / TAU;
                let permille = sign * gear * 1e-6 * rated;
                Joint {
                    slave: 0,
                    counts_per_rad: counts,
                    velocity_counts: counts,
                    zero,
                    permille,
                    max_permille,
                    link: None,
                }
            },
        )
    }

    proptest! {
        /// Position to radians and back, to the increment; beyond the range of the counter the low 32 bits come back.
        #[test]
        fn positions_come_back_to_the_increment(joint in joints(), counts in -(1_i64 << 40)..(1_i64 << 40)) {
            prop_assert_eq!(joint.target_position(joint.position(counts)), counts as i32);
        }

        #[test]
        fn torques_come_back_to_the_per_mille(joint in joints(), permille in any::<i16>()) {
            let expected = permille.clamp(-joint.max_permille, joint.max_permille);
            prop_assert_eq!(joint.target_torque(joint.torque(permille)), expected);
        }

        /// Whatever is asked for, the drive gets the nearest per mille within its limit.
        #[test]
        fn torque_is_rounded_and_limited(joint in joints(), tau in -1e6..1e6_f64) {
            let (target, limit) = (joint.target_torque(tau), f64::from(joint.max_permille));
            prop_assert!(f64::from(target).abs() <= limit);
            let error = joint.torque(target) - tau;
            let beyond = (tau / joint.permille).abs() > limit;
            let nearest = error.abs() <= 0.5001 * joint.permille.abs();
            prop_assert!(nearest || beyond && f64::from(target).abs() == limit, "{tau} N m: {target}");
            prop_assert!(f64::from(target) * tau * joint.permille >= 0.0, "never against what was asked for");
        }

        /// The counter follows any walk of steps below half its range, wherever it starts.
        #[test]
        fn counter_follows_beyond_its_range(start in any::<i32>(), steps in prop::collection::vec(-i32::MAX..=i32::MAX, 1..50)) {
            let (mut counter, mut total) = (Counter::new(start, 0), i64::from(start));
            for step in steps {
                total += i64::from(step);
                prop_assert_eq!(counter.follow(total as i32), total);
            }
        }

        /// A counter that starts beyond the wrap is at most half a range from zero.
        #[test]
        fn counter_starts_at_the_near_side_of_its_zero(zero in any::<i32>(), offset in any::<i32>()) {
            let mut counter = Counter::new(zero.wrapping_add(offset), zero);
            prop_assert_eq!(counter.follow(zero.wrapping_add(offset)), i64::from(zero) + i64::from(offset));
        }
    }

    /// Gear 100, 1048576 increments, sign -1: by hand.
    #[test]
    fn table_of_the_example_has_the_values_of_a_calculation_by_hand() {
        let table = parsed(EXAMPLE).expect("it is right");
        assert_eq!((table.mode, table.joints.len()), (TORQUE_MODE, 1));
        let joint = &table.joints[0];
        // A quarter turn of the joint is 25 turns of the motor, backwards.
        let quarter = 2_147_400_000_i64 - 25 * 1_048_576;
        assert!((joint.position(quarter) - TAU / 4.0).abs() < 1e-12);
        assert!((joint.velocity(-100 * 1_048_576) - TAU).abs() < 1e-12);
        // Half of 0.2 N m, times 100, against the motor's sign.
        assert!((joint.torque(500) + 10.0).abs() < 1e-12);
        assert_eq!(
            [60.1, -1e300, 0.011, f64::NAN, f64::INFINITY].map(|tau| joint.target_torque(tau)),
            [-3000, 3000, -1, 0, 0]
        );
    }

    #[test]
    fn torque_in_per_mille_of_current_uses_the_torque_constant() {
        let current =
            EXAMPLE.replace("rated_torque_mNm = 200 ", "rated_current_mA = 2000\ntorque_constant_Nm_per_A = 0.1 ");
        assert_eq!(parsed(&current).expect("it is right").joints, parsed(EXAMPLE).expect("it is right").joints);
    }

    #[test]
    fn second_encoder_gives_the_position_where_the_table_has_one() {
        let lines = "link_counts_per_rev = -524288\nlink_zero_counts = -2147483000\n";
        let table = parsed(&format!("{EXAMPLE}{lines}")).expect("it is right");
        let inputs = |link_position| Inputs { position: 12345, link_position, ..Inputs::default() };
        let mut encoder = Encoder::new(&table.joints[0], &inputs(-2_147_483_000));
        assert_eq!(encoder.position(&table.joints[0], &inputs(-2_147_483_000)), 0.0);
        // An eighth of a turn further, across the wrap.
        let q = encoder.position(&table.joints[0], &inputs((-2_147_483_000_i32).wrapping_sub(65536)));
        assert!((q - TAU / 8.0).abs() < 1e-12, "{q}");
    }

    /// Every rule with a table that breaks it: what is written instead, and the message.
    #[test]
    fn broken_rules_name_place_value_and_rule() {
        let (gear, counts, slave) = ("gear_ratio = 100 ", "counts_per_rev = 1048576 ", "slave = 0 ");
        let (rated, zero, mode) = ("rated_torque_mNm = 200", "zero_counts = 2147400000", "mode = \"torque\"");
        let in_gear = "it must be a number in 0.001 to 100000: motor revolutions per joint revolution; the direction";
        for (good, bad, message) in [
            (gear, "gear_ratio = 0 ", format!("8:14: gear_ratio is 0; {in_gear}")),
            (gear, "gear_ratio = inf ", format!("8:14: gear_ratio is inf; {in_gear}")),
            (gear, "gear_ratio = nan ", format!("8:14: gear_ratio is nan; {in_gear}")),
            (gear, "gear_ratio = 1e308 ", format!("8:14: gear_ratio is 1e308; {in_gear}")),
            (gear, "gear_ratio = 1e999 ", format!("8:14: gear_ratio is 1e999; {in_gear}")),
            (gear, "gear_ratio = \"100\" ", format!("8:14: gear_ratio is \"100\"; {in_gear}")),
            (gear, "", format!("4:1: gear_ratio is missing; {in_gear}")),
            (gear, "gear = 100 ", format!("4:1: gear_ratio is missing; {in_gear}")),
            (
                counts,
                "counts_per_rev = -1.0 ",
                "6:18: counts_per_rev is -1.0; it must be a number in 1 to 4294967296".into(),
            ),
            (counts, "counts_per_rev = 1e-300 ", "6:18: counts_per_rev is 1e-300; it must".into()),
            (
                "velocity_per_rev_s = 1048576",
                "velocity_per_rev_s = true",
                "7:22: velocity_per_rev_s is true; it must be a number in 0.001 to 4294967296".into(),
            ),
            (slave, "slave = -1 ", "5:9: slave is -1; it must be a whole number in 0 to 65535: position".into()),
            (slave, "slave = 0.0 ", "5:9: slave is 0.0; it must be a whole number".into()),
            ("sign = -1", "sign = 2", "9:8: sign is 2; it must be 1 or -1: -1 where".into()),
            (
                zero,
                "zero_counts = 2147483648",
                "10:15: zero_counts is 2147483648; it must be a whole number in -2".into(),
            ),
            (zero, "zero_counts = 99999999999999999999", "10:15: zero_counts is 99999999999999999999; it must".into()),
            (rated, "rated_torque_mNm = -200", "11:20: rated_torque_mNm is -200; it must".into()),
            (rated, "rated_torque_mNm = 1e-320", "11:20: rated_torque_mNm is 1e-320; it must".into()),
            (rated, "", "4:1: it must have either rated_torque_mNm (0x6076), or both".into()),
            (rated, "rated_current_mA = 1", "4:1: it must have either".into()),
            (rated, "rated_torque_mNm = 200\nrated_current_mA = 1", "4:1: it must have either".into()),
            (
                "max_torque_permille = 3000",
                "max_torque_permille = 0",
                "12:23: max_torque_permille is 0; it must be a whole number in 1 to 32767: 0x6072".into(),
            ),
            (mode, "mode = \"velocity\"", "2:8: mode is \"velocity\"; it must be \"torque\" or".into()),
            (mode, "mode = 10", "2:8: mode is 10; it must be \"torque\" or".into()),
            (mode, "", "1:1: mode is missing; it must be \"torque\" or".into()),
            (mode, "mode = torque", "2:8: ".into()),
            ("# link_c", "link_c", "4:1: link_counts_per_rev and link_".into()),
            ("# link_counts_per_rev = 524288", "link_counts_per_rev = -0.5", "4:1: link_counts_per_rev and".into()),
        ] {
            let text = EXAMPLE.replace(good, bad);
            assert_ne!(text, EXAMPLE, "{good}");
            let why = parsed(&text).expect_err(bad);
            assert!(why.starts_with(&format!("arm.toml:{message}")), "{why}\n{message}");
        }
    }

    #[test]
    fn all_broken_rules_of_a_table_are_reported_in_the_order_of_the_file() {
        let places = |why: &str| -> Vec<String> {
            why.lines().map(|line| line.split(' ').take(2).collect::<Vec<_>>().join(" ")).collect()
        };
        let text = EXAMPLE
            .replace("mode = \"torque\"", "mode = 1")
            .replace("slave = 0 ", "slav = 0 ")
            .replace("gear_ratio = 100 ", "gear = 100 ")
            .replace("sign = -1", "sign = 0");
        assert_eq!(
            places(&parsed(&text).expect_err("six errors")),
            [
                "arm.toml:2:8: mode",
                "arm.toml:4:1: slave",
                "arm.toml:4:1: gear_ratio",
                "arm.toml:5:1: slav",
                "arm.toml:8:1: gear",
                "arm.toml:9:8: sign"
            ]
        );
        let text = EXAMPLE.replace("mode = \"torque\"", "mode = torque").replace("sign = -1", "sign = -");
        assert_eq!(parsed(&text).expect_err("no TOML").lines().count(), 2);
        for (joints, message) in [
            ("joint = []", "arm.toml:2:9: 0 joints; there must be 1 to 8"),
            ("joint = 3", "arm.toml:2:9: joint is 3; there must be 1 to 8"),
            ("joint = [3]", "arm.toml:2:10: joint is 3; it must be a section"),
            ("", "arm.toml:1:1: [[joint]] is missing; there must be 1 to 8"),
        ] {
            let why = parsed(&format!("mode = \"torque\"\n{joints}")).expect_err(joints);
            assert!(why.starts_with(message), "{why}");
        }
    }

    #[test]
    fn two_joints_have_two_drives() {
        let joint = EXAMPLE.split_once("[[joint]]").expect("it has a joint").1;
        for slave in ["0", "0x0"] {
            let joint = joint.replace("slave = 0 ", &format!("slave = {slave} "));
            let why = parsed(&format!("{EXAMPLE}\n[[joint]]{joint}")).expect_err("one drive");
            assert_eq!(why.lines().count(), 1, "{why}");
            assert!(why.ends_with(&format!("slave is {slave} for two joints; give each its own")), "{why}");
        }
        let two = parsed(&format!("{EXAMPLE}\n[[joint]]{}", joint.replace("slave = 0 ", "slave = 1 ")));
        assert_eq!(two.expect("two drives").joints.len(), 2);
    }

    /// A joint whose numbers are each the least or the most of its key, or between, by `choices`; a float where the key takes one.
    fn corner(choices: &[u8; 12], by_current: bool) -> String {
        let mut text = String::from("mode = \"torque\"\n[[joint]]\n");
        let other = if by_current { vec![TORQUE.name] } else { vec![CURRENT.name, CONSTANT.name] };
        for (key, choice) in KEYS.iter().zip(choices).filter(|(key, _)| !other.contains(&key.name)) {
            let middle = (0.5 * (key.least + key.most)).round();
            let number = [key.least, key.most, middle, key.least][usize::from(*choice)];
            let number = if key.signed && *choice == 3 { -number } else { number };
            text.extend([key.name, " = ", &number.to_string(), if key.whole { "\n" } else { "e0\n" }]);
        }
        text
    }

    proptest! {
        /// At the corners of the ranges each product is finite, and torque, position and velocity are computed.
        #[test]
        fn scaling_is_finite_and_not_zero_at_the_corners(choices in prop::array::uniform12(0..4_u8), by_current: bool) {
            let text = corner(&choices, by_current);
            let table = parsed(&text).map_err(TestCaseError::fail)?;
            let joint = &table.joints[0];
            let link = joint.link.expect("it has one").0;
            for scale in [joint.counts_per_rad, joint.velocity_counts, joint.permille, link] {
                prop_assert!(scale.is_normal() && (1.0 / scale).is_normal(), "{joint:?}");
            }
            let least = joint.torque(1);
            prop_assert!(least.is_normal() && joint.velocity(i32::MIN).is_normal() && joint.velocity(1).is_normal());
            prop_assert_eq!(joint.target_torque(least), 1);
            prop_assert!(joint.position(i64::from(i32::MAX) << 20).is_normal());
        }

        /// Beyond a corner no number is accepted, by its key's name.
        #[test]
        fn numbers_beyond_a_corner_are_refused(which in 0..12_usize, above: bool, far: bool) {
            let key = KEYS[which];
            let by_current = [CURRENT.name, CONSTANT.name].contains(&key.name);
            let step = if key.whole { 1.0 } else { 1e-3 * key.least };
            let number = match (above, far && !key.whole) {
                (true, false) => key.most + step.max(key.most * 1e-9).ceil(),
                (true, true) => 1e308,
                (false, false) => key.least - step,
                (false, true) => 1e-320,
            };
            let text: String = corner(&[0; 12], by_current)
                .lines()
                .map(|line| match line.strip_prefix(&format!("{} = ", key.name)) {
                    Some(_) => format!("{} = {number:?}\n", key.name).replace(".0\n", "\n"),
                    None => format!("{line}\n"),
                })
                .collect();
            let why = parsed(&text).expect_err(&text);
            let named = format!(" {} is ", key.name);
            prop_assert!(why.lines().count() == 1 && why.contains(&named), "{}", why);
        }
    }
}
