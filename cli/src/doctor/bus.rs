//! What `rivet doctor` says of the bus: whose it is, what the dead have left there, who has taken the robot's names.

use super::Args;
use crate::control::bus_of;
use rivet_config::{Bus, Robot};
use rivet_ipc_schema::{
    BusConfig, BusError, Ownership, RobotName, Survey, User, cleanup, ownership, purge, survey, sweep_private,
};
use rivet_realtime::{Finding, Severity};

/// What lies on the bus; with `--clean`, what of it was freed first.
pub(super) fn findings(robot: Option<&Robot>, args: &Args) -> Vec<Finding> {
    let usual = BusConfig::default();
    let usual = Bus { prefix: usual.prefix, root: usual.root };
    let config = bus_of(robot.map_or(&usual, |robot| &robot.config.bus), args.prefix.as_deref(), args.root.as_deref());
    let name = robot.map_or("robot", |robot| &robot.config.name);
    let look = || RobotName::new(name).and_then(|name| survey(&config, &name));
    let mut findings = Vec::new();
    if args.clean {
        findings.push(clean(&config, look()));
    }
    let looked = look();
    let seen = Seen { whose: ownership(&config), me: User::me(), config };
    match looked {
        Ok(survey) => findings.extend([seen.owner(&survey), seen.stale(&survey), foreign(&survey)]),
        Err(why) => findings.push(seen.closed(&why)),
    }
    findings
}

/// Beside parties at work only what the dead have left is freed, and by their own user; an empty bus root may clear as
/// well.
fn clean(config: &BusConfig, seen: Result<Survey, BusError>) -> Finding {
    let cleaned = seen.and_then(|survey| if at_work(&survey) == 0 { purge(config) } else { cleanup(config) });
    match cleaned {
        Ok(freed) => {
            let private = match sweep_private() {
                0 => String::new(),
                count => format!("; {count} abandoned private buses removed (demonstrations, replays)"),
            };
            let done = format!("{} dead parties freed, {} files removed{private}", freed.dead_nodes, freed.files);
            Finding::fine("clean", Severity::Ok, done)
        }
        Err(why) => Finding::fine("clean", Severity::Failure, why.to_string()),
    }
}

fn at_work(survey: &Survey) -> usize {
    survey.alive.len() + survey.inaccessible
}

/// A bus, and who looks at it.
struct Seen {
    config: BusConfig,
    whose: Ownership,
    me: User,
}

impl Seen {
    fn place(&self) -> String {
        format!("prefix {}, root {}", self.config.prefix, self.config.root.display())
    }

    /// The command, as the user whose bus it is.
    fn as_owner(&self, command: &str) -> String {
        match self.whose.other_than(&self.me) {
            Some(owner) => format!("{} {command}", owner.run_as()),
            None => command.to_owned(),
        }
    }

    fn look_as_owner(&self) -> String {
        self.as_owner(&format!("rivet doctor {}", self.config.options()))
    }

    /// All parties must be one user's; a look as somebody else is no fault of theirs.
    fn owner(&self, survey: &Survey) -> Finding {
        let (check, place) = ("bus", self.place());
        if let Some(stray) = self.whose.strays.first() {
            let (path, theirs) = (stray.path.display(), User::of(stray.uid));
            let Some(owner) = self.whose.owner.map(User::of) else {
                // Files of the prefix, and no directory: whoever made them has another.
                let found = format!("{place}: not there, but {path} of the user {theirs} has this prefix");
                let change =
                    "look as their user, with their --root (the units: rivet, /run/rivet/<robot>); or another --prefix";
                return Finding::change(check, Severity::Warning, found, change);
            };
            let count = self.whose.strays.len();
            let found =
                format!("{place}: of {owner}, but {path} belongs to {theirs} ({count} such): {owner} has no access");
            let change = format!("stop what {theirs} runs on it; then, as root: {}", self.config.clean_command());
            return Finding::change(check, Severity::Failure, found, change);
        }
        match self.whose.other_than(&self.me) {
            Some(owner) => {
                let found = format!("{place}: of {owner}, {} parties at work; checked as {}", at_work(survey), self.me);
                Finding::change(check, Severity::Note, found, self.look_as_owner())
            }
            None if survey.inaccessible > 0 => {
                let found = format!("{place}: {} parties of another user", survey.inaccessible);
                Finding::change(check, Severity::Failure, found, "run all programs of a robot as one user")
            }
            None => Finding::fine(check, Severity::Ok, place),
        }
    }

    /// The bus cannot be looked at.
    fn closed(&self, why: &BusError) -> Finding {
        if let Some(owner) = self.whose.other_than(&self.me) {
            let found = format!("{}: of {owner}, closed to {}, not checked", self.place(), self.me);
            return Finding::change("bus", Severity::Warning, found, self.look_as_owner());
        }
        let change = if self.whose.strays.is_empty() {
            "a --prefix and a --root that keep the rule, and that this user can write".to_owned()
        } else {
            format!("once nothing of theirs uses it, as root: {}", self.config.clean_command())
        };
        Finding::change("bus", Severity::Failure, why.to_string(), change)
    }

    fn stale(&self, survey: &Survey) -> Finding {
        let (check, alive) = ("stale shared memory", at_work(survey));
        if survey.dead == 0 {
            return Finding::fine(check, Severity::Ok, format!("none; {alive} parties alive"));
        }
        // Until it is freed it is memory and places that are taken. Not by hand: others may be at work, or have a prefix
        // that begins alike.
        let clean = self.as_owner(&self.config.clean_command());
        let change = if alive > 0 {
            format!("the next process that joins frees it, no program has to stop; or now: {clean}")
        } else {
            format!("rivetd frees it at its start; if none is to start: {clean}")
        };
        Finding::change(check, Severity::Warning, format!("{} dead processes left theirs", survey.dead), change)
    }
}

fn foreign(survey: &Survey) -> Finding {
    let check = "foreign services";
    if survey.foreign.is_empty() {
        return Finding::fine(check, Severity::Ok, "none of the robot's names is taken by another program");
    }
    let strange: Vec<String> = survey.foreign.iter().map(ToString::to_string).collect();
    Finding::change(
        check,
        Severity::Failure,
        strange.join("; "),
        "stop the other program, or give this robot another bus: robot.toml: [bus] prefix = \"rivet2_\" \
         (under the units: --prefix rivet2_ in ExecStart= and ExecReload=, systemctl edit)",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_ipc_schema::Owned;

    fn seen(owner: Option<u32>, strays: Vec<Owned>) -> Seen {
        let config = BusConfig { prefix: "rivet_".to_owned(), root: "/run/rivet".into() };
        Seen { config, whose: Ownership { owner, strays }, me: User::of(0) }
    }

    fn parties(alive: usize, dead: usize) -> Survey {
        Survey { alive: vec!["rivetd".to_owned(); alive], dead, ..Survey::default() }
    }

    /// Files that somebody removes by hand may be those of parties at work, or of another prefix that begins alike.
    #[test]
    fn nobody_is_told_to_remove_files_by_hand() {
        for alive in [0, 2] {
            for owner in [Some(0), Some(4242)] {
                let stale = seen(owner, Vec::new()).stale(&parties(alive, 1));
                let change = stale.change.expect("something to do");
                assert!(!change.contains("rm ") && !change.contains("chown"), "{change}");
                assert!(change.contains("--clean --prefix rivet_ --root /run/rivet"), "{change}");
                assert_eq!(change.contains("no program has to stop"), alive > 0, "{change}");
                assert_eq!(change.contains("sudo -u '#4242' rivet doctor"), owner == Some(4242), "{change}");
            }
        }
    }

    #[test]
    fn a_bus_of_another_user_is_no_failure_and_files_of_two_users_are() {
        let note = seen(Some(4242), Vec::new()).owner(&parties(4, 0));
        assert_eq!(note.severity, Severity::Note);
        assert_eq!(
            note.change.as_deref(),
            Some("sudo -u '#4242' rivet doctor --prefix rivet_ --root /run/rivet"),
            "{}",
            note.found
        );
        assert_eq!(foreign(&parties(4, 0)).severity, Severity::Ok);
        assert_eq!(seen(Some(0), Vec::new()).owner(&parties(4, 0)).severity, Severity::Ok);

        let nodes = Owned { path: "/run/rivet/nodes".into(), uid: 0 };
        let mixed = seen(Some(4242), vec![nodes.clone()]).owner(&parties(0, 0));
        assert_eq!(mixed.severity, Severity::Failure);
        assert!(mixed.found.contains("/run/rivet/nodes belongs to"), "{}", mixed.found);
        assert_eq!(seen(None, vec![nodes]).owner(&parties(0, 0)).severity, Severity::Warning, "another root's");
    }
}
