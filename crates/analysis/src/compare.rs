//! `rivet identify --compare`: do independent runs give the same parameters, within what each says of itself?

use anyhow::Result;
use rivet_config::Robot;
use rivet_estimation::offline::{Determined, Fit, Rows, torque_percent};
use serde_json::{Value, json};

use crate::evidence::{self, Distrust};
use crate::fault::Fault;
use crate::table::{Table, number, paragraph};

/// The interval of a difference, in its standard deviations.
const SIGMAS: f64 = 2.0;

/// One log, fitted on its own.
pub(crate) struct Alone {
    /// Name of the log.
    pub(crate) name: String,
    /// Its fit.
    pub(crate) fit: Fit,
    /// Its rows.
    pub(crate) rows: Vec<Rows>,
    /// Readings that were not taken.
    pub(crate) distrusts: Vec<Distrust>,
}

/// Two fits side by side.
struct Pair<'a> {
    names: [&'a str; 2],
    /// Difference over its standard deviation; `None` for a parameter that the prior decides in either run.
    deviations: Vec<Option<f64>>,
}

impl<'a> Pair<'a> {
    fn new(a: &'a Alone, b: &'a Alone) -> Pair<'a> {
        let deviation = |i: usize| {
            let by_data = [a, b].iter().all(|run| run.fit.determined[i] == Determined::ByData);
            by_data.then(|| (a.fit.values[i] - b.fit.values[i]) / a.fit.std[i].hypot(b.fit.std[i]))
        };
        Pair { names: [&a.name, &b.name], deviations: (0..a.fit.values.len()).map(deviation).collect() }
    }

    /// How many parameters agree, and of how many.
    fn agree(&self) -> (usize, usize) {
        let known = self.deviations.iter().flatten();
        (known.clone().filter(|d| d.abs() <= SIGMAS).count(), known.count())
    }
}

fn pairs(runs: &[Alone]) -> Vec<Pair<'_>> {
    runs.iter().enumerate().flat_map(|(k, a)| runs[k + 1..].iter().map(move |b| Pair::new(a, b))).collect()
}

/// Median over the parameters that the data decides of what one standard deviation does to torque \[%\].
fn median_torque(run: &Alone) -> f64 {
    let percent = torque_percent(&run.rows, &run.fit.std);
    let by_data = percent.iter().zip(&run.fit.determined).filter(|(_, d)| **d == Determined::ByData);
    let mut sizes: Vec<f64> = by_data.map(|(percent, _)| *percent).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() / 2).copied().unwrap_or(f64::NAN)
}

pub(crate) fn text(robot: &Robot, runs: &[Alone]) -> Result<String> {
    if runs.len() < 2 {
        return Err(Fault::Usage(format!("--compare takes at least two logs; {} is given", runs.len())).into());
    }
    let (model, base) = (&robot.model, &robot.base);
    let mut out = format!("identify {}: each log on its own\n", robot.config.name);
    out.extend(runs.iter().map(|run| evidence::distrust_text(&run.distrusts)));
    let all = pairs(runs);
    let mut table = Table::new(["log", "decided by data", "condition", "median std as torque %"]);
    for run in runs {
        let by_data = run.fit.determined.iter().filter(|d| **d == Determined::ByData).count();
        let decided = format!("{by_data} of {}", base.len());
        table.row([run.name.clone(), decided, number(run.fit.condition, 2), number(median_torque(run), 2)]);
    }
    out += &table.text();
    out += "\nparameters of which two runs differ by at most two standard deviations of the difference\n";
    let mut table = Table::new(["log", "and log", "agree", "%", "worst", "parameter"]);
    for pair in &all {
        let (within, of) = pair.agree();
        let worst = pair.deviations.iter().enumerate().filter_map(|(i, d)| d.map(|d| (i, d.abs())));
        let worst = worst.max_by(|a, b| a.1.total_cmp(&b.1));
        table.row([
            pair.names[0].to_owned(),
            pair.names[1].to_owned(),
            format!("{within} of {of}"),
            format!("{:.1}", share(within, of)),
            worst.map_or_else(String::new, |(_, d)| format!("{d:.1} std")),
            worst.map_or_else(String::new, |(i, _)| base.name(model, i)),
        ]);
    }
    out += &table.text();
    let (within, of) = total(&all);
    let text = format!("{within} of {of} ({:.1} %); with honest standard deviations about 95 %", share(within, of));
    Ok(out + &paragraph("in agreement: ", &text))
}

fn total(all: &[Pair<'_>]) -> (usize, usize) {
    all.iter().map(Pair::agree).fold((0, 0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1))
}

fn share(within: usize, of: usize) -> f64 {
    100.0 * within as f64 / of.max(1) as f64
}

pub(crate) fn to_json(robot: &Robot, runs: &[Alone]) -> Value {
    let all = pairs(runs);
    let (within, of) = total(&all);
    let run = |run: &Alone| {
        json!({
            "log": run.name,
            "values": run.fit.values,
            "std": run.fit.std,
            "decided_by_data": run.fit.determined.iter().map(|d| *d == Determined::ByData).collect::<Vec<_>>(),
            "median_std_torque_percent": median_torque(run),
            "warnings": evidence::distrust_json(&run.distrusts),
        })
    };
    let pair = |pair: &Pair<'_>| {
        let (within, of) = pair.agree();
        json!({"logs": pair.names, "within": within, "of": of, "deviations": pair.deviations})
    };
    json!({
        "robot": robot.config.name,
        "parameters": (0..robot.base.len()).map(|i| robot.base.name(&robot.model, i)).collect::<Vec<_>>(),
        "runs": runs.iter().map(run).collect::<Vec<_>>(),
        "pairs": all.iter().map(pair).collect::<Vec<_>>(),
        "within": within,
        "of": of,
    })
}
