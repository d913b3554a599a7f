//! The measured arms of the tests, as golden cases: the same robot files, changes and logs.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use super::cases::{Case, Identify, Source};

/// A change of a robot file.
#[derive(Clone, Debug)]
pub(crate) enum Edit {
    /// Every line that begins with a key gets another value.
    Key(&'static str, &'static str),
    /// A section goes, up to the next.
    WithoutSection(&'static str),
    /// What follows a heading goes, up to the end.
    CutAt(&'static str),
    /// One entry (from 0) of a list.
    Entry(&'static str, usize, &'static str),
}

impl Edit {
    /// The text with this change.
    ///
    /// # Errors
    /// The key or section is not there.
    pub(crate) fn apply(&self, text: &str) -> Result<String> {
        let found = match self {
            Edit::Key(key, _) | Edit::Entry(key, ..) => text.lines().any(|line| line.starts_with(key)),
            Edit::WithoutSection(head) | Edit::CutAt(head) => text.contains(head),
        };
        if !found {
            bail!("nothing to change: {self:?}");
        }
        let lines = |change: &dyn Fn(&str) -> String| text.lines().map(|line| change(line) + "\n").collect::<String>();
        Ok(match self {
            Edit::Key(key, values) => lines(&|line| {
                if line.starts_with(key) { format!("{key} = {values}") } else { line.to_owned() }
            }),
            Edit::WithoutSection(head) => {
                let start = text.find(head).unwrap_or(text.len());
                let end = text[start..].find("\n[").map_or(text.len(), |at| start + at);
                text[..start].to_owned() + &text[end..]
            }
            Edit::CutAt(head) => text[..text.find(head).unwrap_or(text.len())].to_owned(),
            Edit::Entry(key, place, value) => lines(&|line| {
                let list = line.split_once('[').and_then(|(head, rest)| Some((head, rest.split_once(']')?)));
                let Some((head, (values, tail))) = list.filter(|_| line.starts_with(key)) else {
                    return line.to_owned();
                };
                let entry =
                    |(k, entry): (usize, &str)| if k == *place { (*value).to_owned() } else { entry.to_owned() };
                let values: Vec<String> = values.split(',').enumerate().map(entry).collect();
                format!("{head}[{}]{tail}", values.join(","))
            }),
        })
    }
}

/// A measured case: name, robot file below the checkout, changes, what is identified first, logs below the data.
struct Measured {
    name: &'static str,
    robot: &'static str,
    edits: Vec<Edit>,
    /// Logs and flags of `rivet identify`, and changes of its model.
    identify: Option<(Vec<&'static str>, Vec<&'static str>, Vec<Edit>)>,
    logs: Vec<&'static str>,
}

const NO_FRICTION: &str = "[0, 0, 0, 0, 0, 0]";
const UR10E: &str = "robots/ur10e/robot.toml";
const KR300: &str = "robots/kuka-kr300-r2500/robot.toml";
const TX40: &str = "robots/staubli-tx40/robot.toml";
const GEN3: &str = "tests/robots/kinova-gen3/robot.toml";
const AIRBOT: &str = "tests/robots/airbot-play/robot.toml";
const KR300_LOGS: [&str; 2] = ["real/kuka_kr300/traj_A_10s.parquet", "real/kuka_kr300/traj_B_10s.parquet"];
const TX40_LOG: &str = "real/staubli_tx40/exciting_0.0-5.5s.parquet";
const AIRBOT_LOGS: [&str; 2] =
    ["real/airbot_play/chirp_motion_real.parquet", "real/airbot_play/chirp_motion_real_loaded.parquet"];
const GEN3_LOGS: [&str; 6] = [
    "real/kinova_gen3/joint_1_trapez.parquet",
    "real/kinova_gen3/joint_2_trapez.parquet",
    "real/kinova_gen3/joint_4_trapez.parquet",
    "real/kinova_gen3/joint_5_trapez.parquet",
    "real/kinova_gen3/joint_7_trapez.parquet",
    "real/kinova_gen3/RunTrajectory1.parquet",
];

fn table() -> Vec<Measured> {
    let plain = |name, robot, logs: &[&'static str]| Measured {
        name,
        robot,
        edits: Vec::new(),
        identify: None,
        logs: logs.to_vec(),
    };
    let changed = |name, robot, edits, logs: &[&'static str]| Measured {
        name,
        robot,
        edits,
        identify: None,
        logs: logs.to_vec(),
    };
    let identified = |name, robot, edits, from: &[&'static str], logs: &[&'static str]| Measured {
        name,
        robot,
        edits,
        identify: Some((from.to_vec(), Vec::new(), Vec::new())),
        logs: logs.to_vec(),
    };
    let without_friction = || vec![Edit::Key("coulomb", NO_FRICTION), Edit::Key("viscous", NO_FRICTION)];
    let half_friction = vec![
        Edit::Key("coulomb", "[7.45, 8.0, 3.1, 1.25, 1.55, 1.25]"),
        Edit::Key("viscous", "[10.7, 9.5, 5.35, 1.85, 1.35, 1.65]"),
    ];
    let gains = vec![Edit::Key("drive_gain", "[10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232]")];
    let sensor = || vec![Edit::Key("torque_from", "\"tau\"")];
    vec![
        changed(
            "ur10e-without-friction",
            UR10E,
            without_friction(),
            &[
                "real/ur10e_innopolis/20_02_10-30sec_12harm.parquet",
                "real/ur10e_innopolis/20_02_06-20sec_10harm.parquet",
            ],
        ),
        changed(
            "ur10e-half-friction",
            UR10E,
            half_friction,
            &[
                "real/ur10e_innopolis/20_01_22-joint_2.parquet",
                "real/ur10e_innopolis/20_01_22-joint_5.parquet",
                "real/ur10e_innopolis/20_02_05-20sec_8harm.parquet",
            ],
        ),
        plain("ur10e", UR10E, &["real/ur10e_innopolis/20_02_10-20sec_7harm.parquet"]),
        identified(
            "ur10e-payload",
            UR10E,
            gains,
            &["real/ur10e_innopolis/20_02_19_14harm50sec.parquet"],
            &["real/ur10e_innopolis/20_02_19_14harm50secLoad.parquet"],
        ),
        identified(
            "ur10e-second-payload",
            UR10E,
            Vec::new(),
            &["real/ur10e_innopolis/20_01_31-unload.parquet"],
            &["real/ur10e_innopolis/20_01_31-load.parquet"],
        ),
        plain("ur10", "robots/ur10/robot.toml", &["real/ur10_salerno/exciting_0.0-18.4s.parquet"]),
        plain("tx40", TX40, &[TX40_LOG]),
        changed("tx40-without-coupling", TX40, vec![Edit::WithoutSection("[coupling]")], &[TX40_LOG]),
        Measured {
            name: "tx40-without-rotor-2",
            robot: TX40,
            edits: Vec::new(),
            identify: Some((
                vec![TX40_LOG],
                vec!["--refine"],
                vec![Edit::CutAt("\n[identified]"), Edit::Entry("rotor_inertia", 1, " 0.0")],
            )),
            logs: vec![TX40_LOG],
        },
        plain(
            "shanghai",
            "tests/robots/shanghai/robot.toml",
            &["real/shanghai_electric_6dof/traj_1.parquet", "real/shanghai_electric_6dof/traj_2.parquet"],
        ),
        changed("gen3-sensor", GEN3, sensor(), &GEN3_LOGS[..5]),
        plain("gen3-motor", GEN3, &GEN3_LOGS[..5]),
        plain("gen3-two-joints", GEN3, &[GEN3_LOGS[1], GEN3_LOGS[2], GEN3_LOGS[5]]),
        plain("gen3-all", GEN3, &GEN3_LOGS),
        plain("airbot", AIRBOT, &AIRBOT_LOGS[..1]),
        plain("airbot-loaded", AIRBOT, &AIRBOT_LOGS[1..]),
        identified("airbot-payload", AIRBOT, Vec::new(), &AIRBOT_LOGS[..1], &AIRBOT_LOGS[1..]),
        identified("airbot-no-payload", AIRBOT, Vec::new(), &AIRBOT_LOGS[..1], &AIRBOT_LOGS[..1]),
        plain("kr300", KR300, &KR300_LOGS),
        changed("kr300-without-friction", KR300, without_friction(), &KR300_LOGS),
        identified("kr300-identified", KR300, Vec::new(), &KR300_LOGS, &KR300_LOGS),
        plain(
            "file-of-another-arm",
            "robots/ur5e/robot.toml",
            &["practice/case-24/log-a.parquet", "practice/case-24/log-b.parquet"],
        ),
    ]
}

/// Cases whose logs and robot file are there, and one line for each of the others.
pub(crate) fn cases(root: &Path, data: &Path) -> (Vec<Case>, Vec<String>) {
    let mut found = Vec::new();
    let mut absent = Vec::new();
    for measured in table() {
        let paths = |logs: &[&str]| logs.iter().map(|log| data.join(log)).collect::<Vec<PathBuf>>();
        let robot = root.join(measured.robot);
        let identify = measured.identify.map(|(logs, flags, edits)| Identify {
            logs: paths(&logs),
            flags: flags.into_iter().map(str::to_owned).collect(),
            edits,
        });
        let logs = paths(&measured.logs);
        let all = logs.iter().chain(identify.iter().flat_map(|identify| &identify.logs)).chain([&robot]);
        if let Some(missing) = all.into_iter().find(|path| !path.is_file()) {
            absent.push(format!("measured/{}: no {}", measured.name, missing.display()));
            continue;
        }
        let source = Source::Changed { robot, edits: measured.edits };
        found.push(Case { name: format!("measured/{}", measured.name), source, identify, logs });
    }
    (found, absent)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "name = \"arm\"\n[drive]\nrotor_inertia = [1.0, 2.0] # kg m^2\n[coupling]\na = 1\n\n[friction]\ncoulomb = [3.0]\n";

    #[test]
    fn edits_change_what_they_name() {
        let edited = |edit: Edit| edit.apply(FILE).expect("the key is there");
        assert!(edited(Edit::Key("coulomb", "[0]")).contains("\ncoulomb = [0]\n"));
        assert!(edited(Edit::Entry("rotor_inertia", 1, " 0.0")).contains("rotor_inertia = [1.0, 0.0] # kg m^2"));
        let without = edited(Edit::WithoutSection("[coupling]"));
        assert!(!without.contains("coupling") && !without.contains("a = 1") && without.contains("[friction]"));
        assert!(!edited(Edit::CutAt("\n[friction]")).contains("friction"));
    }

    #[test]
    fn edit_of_an_absent_key_is_an_error() {
        assert!(Edit::Key("viscous", "[0]").apply(FILE).is_err());
    }

    /// Robot files of the table are in the repository; names are distinct.
    #[test]
    fn every_measured_case_has_its_robot_file() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut names: Vec<&str> = table().iter().map(|measured| measured.name).collect();
        for measured in table() {
            assert!(root.join(measured.robot).is_file(), "{}", measured.robot);
        }
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), table().len());
    }
}
