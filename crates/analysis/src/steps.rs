//! Steps of a diagnosis, from the lines that it says.

/// A step: how its line begins, its name, and how long it takes in parts of a usual diagnosis of two logs of 18 s and six joints.
struct Step {
    begins: &'static str,
    name: &'static str,
    weight: f64,
}

const STEPS: [Step; 9] = [
    Step { begins: "motion, regressors", name: "motion and regressors", weight: 3.0 },
    Step { begins: "torque and position in time", name: "delay between torque and position", weight: 1.0 },
    Step { begins: "a body at the flange", name: "nominal model and noise floor", weight: 3.5 },
    Step { begins: ROUND, name: "fit effects", weight: 7.0 },
    Step { begins: "residual over the noise floor", name: "residuals", weight: 1.2 },
    Step { begins: "prediction of the held-out log", name: "prediction of the held-out log", weight: 0.3 },
    Step { begins: "the sealed torque", name: "measurement on the held-out log", weight: 0.5 },
    Step { begins: "the model with what was found", name: "patched model", weight: 5.0 },
    Step { begins: "the simulator in closed loop", name: "simulator in closed loop", weight: 3.0 },
];

/// How the line of a round of the search for effects begins.
const ROUND: &str = "round ";

/// Place of that step.
const SEARCH: usize = 3;
/// Share of a round that is counted: candidates get their columns in it. Then the best are refined and tested.
const COUNTED_SHARE: f64 = 0.7;
/// What stands behind the counts of a line.
const CANDIDATES: &str = " candidates";

/// A line with counts of a round, as `--verbose` prints it: `  212 of 1100 candidates`.
pub(crate) fn count_line(done: usize, total: usize) -> String {
    format!("  {done} of {total}{CANDIDATES}")
}

/// The counts of such a line.
fn counts_of(line: &str) -> Option<(usize, usize)> {
    let (done, total) = line.trim().strip_suffix(CANDIDATES)?.split_once(" of ")?;
    Some((done.parse().ok()?, total.parse().ok()?))
}

/// Where a diagnosis is.
#[derive(Debug, Default)]
pub(crate) struct Steps {
    /// Place of the present step in [`STEPS`]; none before the first.
    at: Option<usize>,
    /// What its line adds to its name: the number of the round.
    detail: String,
    /// Parts of the step that are done, and all of them; none of a step that is not counted.
    counted: Option<(usize, usize)>,
    /// When it began \[s\].
    since_s: f64,
    /// When the first step began \[s\].
    begin_s: f64,
    /// Weight of the steps that are done.
    done: f64,
    /// Largest share so far.
    share: f64,
}

impl Steps {
    /// Takes a line that came `elapsed_s` after the beginning. One that neither begins a step nor [counts](count_line) changes nothing.
    pub(crate) fn take(&mut self, line: &str, elapsed_s: f64) {
        if let Some((done, total)) = counts_of(line) {
            self.count(done, total);
        }
        let Some(next) = STEPS.iter().position(|step| line.starts_with(step.begins)) else { return };
        match self.at {
            // A diagnosis that starts over with the log mended says its first lines again.
            Some(at) => self.done += STEPS[at].weight,
            None => self.begin_s = elapsed_s,
        }
        (self.at, self.since_s) = (Some(next), elapsed_s);
        self.detail = line.strip_prefix(ROUND).map_or(String::new(), |rest| format!(", round {rest}"));
        self.counted = None;
        self.share = self.share.max(self.share_at(next));
    }

    /// `done` of the `total` parts of the present step are done.
    pub(crate) fn count(&mut self, done: usize, total: usize) {
        self.counted = Some((done, total));
        self.share = self.share.max(self.at.map_or(0.0, |at| self.share_at(at)));
    }

    /// Share of the work before the step at a place, and in what was counted of it.
    fn share_at(&self, at: usize) -> f64 {
        let later: f64 = STEPS[at..].iter().map(|step| step.weight).sum();
        let part = self.counted.map_or(0.0, |(done, total)| COUNTED_SHARE * done as f64 / total.max(1) as f64);
        (self.done + part * STEPS[at].weight) / (self.done + later)
    }

    /// Name of the present step.
    pub(crate) fn name(&self) -> String {
        let Some(at) = self.at else { return "reading".to_owned() };
        let counted = self.counted.map_or(String::new(), |(done, total)| format!(": {done} of {total}"));
        format!("{}{}{counted}", STEPS[at].name, self.detail)
    }

    /// Share of the work that is done, 0 to 1. It does not fall: rounds that nobody knew of make it stand.
    pub(crate) fn share(&self) -> f64 {
        self.share
    }

    /// Time that is left \[s\] by the steps that are done, and whether it is the least: how often effects are looked for is not known
    /// before. None before the first step is done.
    pub(crate) fn remaining_s(&self, elapsed_s: f64) -> Option<(f64, bool)> {
        let at = self.at.filter(|_| self.done > 0.0)?;
        let per_weight_s = (self.since_s - self.begin_s) / self.done;
        let present_s = (per_weight_s * STEPS[at].weight - (elapsed_s - self.since_s)).max(0.0);
        let later: f64 = STEPS[at + 1..].iter().map(|step| step.weight).sum();
        Some((present_s + per_weight_s * later, at <= SEARCH))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_the_step_and_the_time_left() {
        let mut steps = Steps::default();
        assert_eq!((steps.name(), steps.remaining_s(1.0)), ("reading".to_owned(), None));
        steps.take("motion, regressors", 1.0);
        assert_eq!(steps.remaining_s(3.0), None);
        steps.take("torque and position in time", 4.0);
        steps.take("log-a.parquet: torque -5.47 ms after position", 4.5);
        steps.take("a body at the flange [0.2]", 5.0);
        assert_eq!(steps.name(), "nominal model and noise floor");
        steps.take("round 1", 8.5);
        steps.take("  1173.8 TwoMass { joint: 0 }", 10.0);
        assert_eq!(steps.name(), "fit effects, round 1");
        let before = steps.share();
        steps.take(&count_line(212, 1100), 10.2);
        assert_eq!(steps.name(), "fit effects, round 1: 212 of 1100");
        assert!(steps.share() > before);
        // A second for each part of the weight so far: 7 s of this round, 10 s of what follows, of which 2 s have gone.
        let (seconds, is_least) = steps.remaining_s(10.5).expect("steps are done");
        assert!((seconds - 15.0).abs() < 1e-9 && is_least, "{seconds}");
        let first = steps.share();
        steps.take("round 2", 15.5);
        assert!(steps.share() > first);
        assert_eq!(steps.name(), "fit effects, round 2");
        steps.take("residual over the noise floor, by joint: 4.6", 22.5);
        let (seconds, is_least) = steps.remaining_s(22.5).expect("steps are done");
        assert!((seconds - 10.0).abs() < 1e-9 && !is_least, "{seconds}");
    }

    #[test]
    fn share_never_falls() {
        let mut steps = Steps::default();
        let mut before = 0.0;
        for line in [
            "motion, regressors",
            "a body at the flange",
            "motion, regressors",
            "round 1",
            "  2 of 2 candidates",
            "round 2",
            "  1 of 2 candidates",
            "the sealed torque",
        ] {
            steps.take(line, 1.0);
            assert!(steps.share() >= before && steps.share() < 1.0, "{line}");
            before = steps.share();
        }
    }
}
