//! The scaling table, and what it makes of the objects of a drive: radians and newton metres of its joint, and back.

use crate::drive::{Inputs, POSITION_MODE, TORQUE_MODE};
use serde::Deserialize;
use std::f64::consts::TAU;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTable {
    mode: Spanned<String>,
    joint: Spanned<Vec<Spanned<RawJoint>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case, reason = "keys have their units")]
struct RawJoint {
    slave: Spanned<usize>,
    counts_per_rev: Spanned<f64>,
    velocity_per_rev_s: Spanned<f64>,
    gear_ratio: Spanned<f64>,
    sign: Spanned<i64>,
    zero_counts: Spanned<i64>,
    rated_torque_mNm: Option<Spanned<f64>>,
    rated_current_mA: Option<Spanned<f64>>,
    torque_constant_Nm_per_A: Option<Spanned<f64>>,
    max_torque_permille: Spanned<i64>,
    link_counts_per_rev: Option<Spanned<f64>>,
    link_zero_counts: Option<Spanned<i64>>,
}

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
/// Every broken rule on a line of its own: file, line, column, key, value, rule and what to do.
pub(crate) fn read(path: &Path) -> Result<Table, String> {
    let text = std::fs::read_to_string(path).map_err(|why| format!("{}: {why}", path.display()))?;
    parse(path, &text)
}

fn parse(path: &Path, text: &str) -> Result<Table, String> {
    let mut rules = Rules { path, text, broken: Vec::new() };
    let raw: RawTable = toml::from_str(text).map_err(|why| {
        rules
            .broken(&why.span().unwrap_or(0..0), &format!("{}; arm.toml of this example has every key", why.message()));
        rules.broken.join("\n")
    })?;
    let mode = match raw.mode.get_ref().as_str() {
        "torque" => TORQUE_MODE,
        "position" => POSITION_MODE,
        other => {
            rules.broken(&raw.mode.span(), &format!("mode is \"{other}\"; it must be \"torque\" or \"position\""));
            0
        }
    };
    let joints: Vec<Joint> = raw.joint.get_ref().iter().map(|joint| rules.joint(joint)).collect();
    let most = rivet::Sample::default().q.len();
    if !(1..=most).contains(&joints.len()) {
        let text =
            format!("{} joints; there must be 1 to {most}, one [[joint]] for each joint of the arm", joints.len());
        rules.broken(&raw.joint.span(), &text);
    }
    for (i, joint) in raw.joint.get_ref().iter().enumerate() {
        let slave = &joint.get_ref().slave;
        if joints[..i].iter().any(|other| other.slave == *slave.get_ref()) {
            rules.broken(&slave.span(), &format!("slave is {} for two joints; give each its own", slave.get_ref()));
        }
    }
    if rules.broken.is_empty() { Ok(Table { mode, joints }) } else { Err(rules.broken.join("\n")) }
}

/// Looks for broken rules in a file.
struct Rules<'a> {
    path: &'a Path,
    text: &'a str,
    broken: Vec<String>,
}

impl Rules<'_> {
    fn broken(&mut self, place: &Range<usize>, rule: &str) {
        let before = self.text.get(..place.start).unwrap_or_default();
        let (line, column) =
            (before.matches('\n').count() + 1, before.chars().rev().take_while(|c| *c != '\n').count() + 1);
        self.broken.push(format!("{}:{line}:{column}: {rule}", self.path.display()));
    }

    fn positive(&mut self, key: &str, value: &Spanned<f64>, what: &str) -> f64 {
        let number = *value.get_ref();
        if !(number.is_finite() && number > 0.0) {
            self.broken(&value.span(), &format!("{key} is {number}; it must be above 0: {what}"));
        }
        number
    }

    fn counter(&mut self, key: &str, value: &Spanned<i64>) -> i32 {
        let rule =
            format!("{key} is {}; it must be a value of the 32-bit object, -2147483648 to 2147483647", value.get_ref());
        i32::try_from(*value.get_ref()).unwrap_or_else(|_| {
            self.broken(&value.span(), &rule);
            0
        })
    }

    fn joint(&mut self, raw: &Spanned<RawJoint>) -> Joint {
        let (place, raw) = (raw.span(), raw.get_ref());
        let sign = *raw.sign.get_ref() as f64;
        if ![1, -1].contains(raw.sign.get_ref()) {
            self.broken(&raw.sign.span(), &format!("sign is {}; it must be 1 or -1", raw.sign.get_ref()));
        }
        let gear =
            self.positive("gear_ratio", &raw.gear_ratio, "motor per joint revolutions, direction goes into sign");
        let counts = self.positive("counts_per_rev", &raw.counts_per_rev, "increments of 0x6064 per motor revolution");
        let per_rev_s = self.positive(
            "velocity_per_rev_s",
            &raw.velocity_per_rev_s,
            "0x606C at one motor revolution per second, 60 where its unit is 1/min",
        );
        let limit = *raw.max_torque_permille.get_ref();
        if !(1..=32767).contains(&limit) {
            let rule = format!("max_torque_permille is {limit}; it must lie in 1..=32767, take 0x6072 of the drive");
            self.broken(&raw.max_torque_permille.span(), &rule);
        }
        let rated = match (&raw.rated_torque_mNm, &raw.rated_current_mA, &raw.torque_constant_Nm_per_A) {
            (Some(rated), None, None) => 1e-3 * self.positive("rated_torque_mNm", rated, "0x6076 of the drive"),
            (None, Some(current), Some(constant)) => {
                let current = self.positive("rated_current_mA", current, "0x6075 of the drive");
                1e-3 * current * self.positive("torque_constant_Nm_per_A", constant, "motor torque per ampere")
            }
            _ => {
                let rule = "it must have either rated_torque_mNm (0x6076), or both rated_current_mA (0x6075) and \
                            torque_constant_Nm_per_A; state what 0x6077 is per mille of";
                self.broken(&place, rule);
                1.0
            }
        };
        let link = match (&raw.link_counts_per_rev, &raw.link_zero_counts) {
            (None, None) => None,
            (Some(scale), Some(zero)) => {
                let per_rev = *scale.get_ref();
                if !(per_rev.is_finite() && per_rev != 0.0) {
                    let rule = "it must not be 0: increments of 0x60E4:01 per joint revolution, negative against the URDF axis";
                    self.broken(&scale.span(), &format!("link_counts_per_rev is {per_rev}; {rule}"));
                }
                Some((per_rev / TAU, self.counter("link_zero_counts", zero)))
            }
            _ => {
                self.broken(&place, "link_counts_per_rev and link_zero_counts must both stand here or neither");
                None
            }
        };
        Joint {
            slave: *raw.slave.get_ref(),
            counts_per_rad: sign * gear * counts / TAU,
            velocity_counts: sign * gear * per_rev_s / TAU,
            zero: self.counter("zero_counts", &raw.zero_counts),
            permille: sign * gear * rated / 1000.0,
            max_permille: limit.clamp(1, 32767) as i16,
            link,
        }
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
        for (good, bad, message) in [
            (
                "gear_ratio = 100 ",
                "gear_ratio = 0 ",
                "arm.toml:8:14: gear_ratio is 0; it must be above 0: motor per joint",
            ),
            (
                "counts_per_rev = 1048576",
                "counts_per_rev = -1.0",
                "arm.toml:6:18: counts_per_rev is -1; it must be above 0",
            ),
            (
                "velocity_per_rev_s = 1048576",
                "velocity_per_rev_s = nan",
                "arm.toml:7:22: velocity_per_rev_s is NaN; it must",
            ),
            ("sign = -1", "sign = 2", "arm.toml:9:8: sign is 2; it must be 1 or -1"),
            (
                "zero_counts = 2147400000",
                "zero_counts = 2147483648",
                "arm.toml:10:15: zero_counts is 2147483648; it must be",
            ),
            (
                "rated_torque_mNm = 200",
                "rated_torque_mNm = -200",
                "arm.toml:11:20: rated_torque_mNm is -200; it must be above",
            ),
            ("rated_torque_mNm = 200", "", "arm.toml:4:1: it must have either rated_torque_mNm (0x6076), or both"),
            (
                "rated_torque_mNm = 200",
                "rated_torque_mNm = 200\nrated_current_mA = 1",
                "arm.toml:4:1: it must have either",
            ),
            (
                "max_torque_permille = 3000",
                "max_torque_permille = 0",
                "arm.toml:12:23: max_torque_permille is 0; it must lie",
            ),
            (
                "mode = \"torque\"",
                "mode = \"velocity\"",
                "arm.toml:2:8: mode is \"velocity\"; it must be \"torque\" or",
            ),
            (
                "# link_counts_per_rev = 524288",
                "link_counts_per_rev = 524288",
                "arm.toml:4:1: link_counts_per_rev and link_",
            ),
            (
                "gear_ratio = 100 ",
                "",
                "arm.toml:4:1: missing field `gear_ratio`; arm.toml of this example has every key",
            ),
            ("gear_ratio = 100 ", "gear = 100 ", "arm.toml:8:1: unknown field `gear`"),
            ("gear_ratio = 100 ", "gear_ratio = \"100\" ", "arm.toml:8:14: invalid type: string \"100\""),
        ] {
            let text = EXAMPLE.replace(good, bad);
            assert_ne!(text, EXAMPLE, "{good}");
            let why = parsed(&text).expect_err(bad);
            assert!(why.starts_with(message), "{why}\n{message}");
        }
    }

    #[test]
    fn all_broken_rules_of_a_table_are_reported_and_two_joints_have_two_drives() {
        let joint = EXAMPLE.split_once("[[joint]]").expect("it has a joint").1;
        let two = format!("{EXAMPLE}\n[[joint]]{}", joint.replace("sign = -1", "sign = 0"));
        let why = parsed(&two).expect_err("two errors");
        assert_eq!(why.lines().count(), 2, "{why}");
        assert!(why.contains("slave is 0 for two joints; give each its own"), "{why}");
        let none = parsed("mode = \"torque\"\njoint = []").expect_err("no joint");
        assert!(none.starts_with("arm.toml:2:9: 0 joints; there must be 1 to 8"), "{none}");
    }
}
