//! `rivet blind make`: draws cases and seals their answers.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use anyhow::{Context, Result, bail};
use rivet_config::Robot;
use rivet_files::write_whole;
use rivet_logs::write_columns;
use rivet_simulation::two_mass::Recording;
use rivet_studies::blind::{Case, PERIOD_S, case};
use serde_json::{Value, json};

use crate::table::{show, show_json};
use rivet_analysis::passport::sha256;

/// Arms of which cases are made when no robot file is named.
const ARMS: [&str; 3] = ["ur10e", "staubli-tx40", "manutec-r3"];
/// What of a robot file goes into a case: what a simulator knows.
const KEPT: [&str; 5] = ["name", "gravity", "drive", "friction", "coupling"];

/// Arguments of `rivet blind make`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Cases to draw.
    #[arg(long, default_value_t = 20)]
    count: u64,
    /// Folder for the cases; it must be empty or not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// File for the answers [default: DIR-answers.json]; it must not exist.
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    /// Arms to draw from [default: robots/{ur10e,staubli-tx40,manutec-r3}/robot.toml]
    #[arg(value_name = "ROBOT.toml")]
    robots: Vec<PathBuf>,
    /// Cases in parallel.
    #[arg(long, default_value_t = thread::available_parallelism().map_or(1, usize::from))]
    jobs: usize,
    /// Print where the cases and answers are as JSON (docs/operating.md).
    #[arg(long)]
    json: bool,
}

/// A robot with what a case keeps of its file.
struct Nominal {
    robot: Robot,
    toml: String,
    urdf: String,
}

impl Nominal {
    fn read(path: &Path) -> Result<Nominal> {
        let robot = rivet_config::load(path)?;
        let config = &robot.config;
        let refused = [
            ("[effects]", !robot.model.effects().list().is_empty()),
            ("[friction] load_dependent", config.friction.load_dependent.is_some()),
            ("[friction] viscous_quadratic", config.friction.viscous_quadratic.is_some()),
            ("[drive] rotor_inertia of 0", config.drive.rotor_inertia.contains(&0.0)),
        ];
        if let Some((what, _)) = refused.iter().find(|(_, there)| *there) {
            bail!("{}: {what}: the arm that cases are drawn from cannot have it", path.display());
        }
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        let all: toml::Table = toml::from_str(&text).with_context(|| path.display().to_string())?;
        let mut kept: toml::Table = all.into_iter().filter(|(key, _)| KEPT.contains(&key.as_str())).collect();
        kept.insert("urdf".to_owned(), "robot.urdf".into());
        kept.insert("sample_period_s".to_owned(), PERIOD_S.into());
        if let Some(drive) = kept.get_mut("drive").and_then(toml::Value::as_table_mut) {
            drive.remove("drive_gain"); // logs of cases are in N·m
        }
        let urdf = &robot.config.urdf;
        let urdf = std::fs::read_to_string(urdf).with_context(|| urdf.display().to_string())?;
        Ok(Nominal { robot, toml: toml::to_string(&kept)?, urdf })
    }
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let answers_path = args.answers.clone().unwrap_or_else(|| {
        let mut name = args.out.file_name().unwrap_or_default().to_owned();
        name.push("-answers.json");
        args.out.with_file_name(name)
    });
    if std::fs::read_dir(&args.out).is_ok_and(|mut entries| entries.next().is_some()) {
        bail!("{}: is not empty; a case of another draw among these would have no answer", args.out.display());
    }
    if answers_path.exists() {
        bail!("{}: exists; answers are not written over", answers_path.display());
    }
    let files = if args.robots.is_empty() {
        ARMS.map(|arm| Path::new("robots").join(arm).join("robot.toml")).to_vec()
    } else {
        args.robots.clone()
    };
    let robots: Vec<Nominal> = files.iter().map(|path| Nominal::read(path)).collect::<Result<_>>()?;
    std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    let answers_folder =
        answers_path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let real = |path: &Path| std::fs::canonicalize(path).with_context(|| path.display().to_string());
    if real(answers_folder)?.starts_with(real(&args.out)?) {
        bail!("{}: answers do not lie among the cases", answers_path.display());
    }
    let width = args.count.to_string().len().max(2);
    let next = AtomicUsize::new(0);
    let answers: Mutex<BTreeMap<String, Value>> = Mutex::new(BTreeMap::new());
    let failed: Mutex<Option<anyhow::Error>> = Mutex::new(None);
    thread::scope(|scope| {
        for _ in 0..args.jobs.clamp(1, 64) {
            scope.spawn(|| {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    if k as u64 >= args.count || lock(&failed).is_some() {
                        return;
                    }
                    let nominal = &robots[k % robots.len()];
                    // Each case has a stream of its own: more cases leave the first ones as they are.
                    let made = case(&nominal.robot, args.seed.wrapping_mul(1_000_003).wrapping_add(k as u64));
                    let name = format!("case-{:0width$}", k + 1);
                    let made = made.with_context(|| {
                        format!(
                            "{}: the arm does not follow its motion, however it is drawn",
                            nominal.robot.config.name
                        )
                    });
                    let written =
                        made.and_then(|made| write_case(&args.out.join(&name), nominal, &made).map(|()| made));
                    let made = match written {
                        Ok(made) => made,
                        Err(why) => {
                            *lock(&failed) = Some(why);
                            return;
                        }
                    };
                    let mut all = lock(&answers);
                    all.insert(name, answer(nominal, &made));
                    rivet_files::note(format_args!("{:>width$} of {} made", all.len(), args.count));
                }
            });
        }
    });
    if let Some(why) = lock(&failed).take() {
        return Err(why);
    }
    let text = rivet_files::printable_json(serde_json::to_string_pretty(&*lock(&answers))? + "\n");
    write_whole(&answers_path, &text).with_context(|| answers_path.display().to_string())?;
    let hash = sha256(&answers_path)?;
    if args.json {
        let [folder, answers] = [&args.out, &answers_path].map(|path| path.display().to_string());
        show_json(
            &json!({ "seed": args.seed, "cases": args.count, "folder": folder, "answers": answers, "answers_sha256": hash }),
        )?;
        return Ok(ExitCode::SUCCESS);
    }
    show(&format!(
        "answers  sha256 {hash}\n         {}\ncases    {} in {}\nnext     rivet blind run {} --out VERDICTS.json\n",
        answers_path.display(),
        args.count,
        args.out.display(),
        args.out.display()
    ))?;
    Ok(ExitCode::SUCCESS)
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn write_case(folder: &Path, nominal: &Nominal, made: &Case) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    for (name, text) in [("robot.toml", &nominal.toml), ("robot.urdf", &nominal.urdf)] {
        let path = folder.join(name);
        write_whole(&path, text).with_context(|| path.display().to_string())?;
    }
    for (name, run) in ["log-a.parquet", "log-b.parquet"].iter().zip(&made.runs) {
        write_log(&folder.join(name), run)?;
    }
    Ok(())
}

fn write_log(path: &Path, run: &Recording) -> Result<()> {
    let mut columns: Vec<(String, &[f64])> = vec![("t".to_owned(), &run.t)];
    let [q, qd, qdd] = &run.desired;
    let groups = [
        ("q", &run.q),
        ("tau", &run.tau),
        ("q_des", q),
        ("qd_des", qd),
        ("qdd_des", qdd),
        ("temperature", &run.temperature),
    ];
    for (name, values) in groups {
        columns.extend(values.iter().enumerate().map(|(j, x)| (format!("{name}{}", j + 1), x.as_slice())));
    }
    Ok(write_columns(path, &columns)?)
}

fn answer(nominal: &Nominal, made: &Case) -> Value {
    let effects: Vec<Value> = made
        .effects
        .iter()
        .zip(&made.change_of_each)
        .map(|(e, change)| {
            json!({ "effect": e.effect, "joints": e.joints, "magnitude": e.magnitude, "torque_change_over_noise": change })
        })
        .collect();
    let mut answer = json!({
        "arm": nominal.robot.config.name,
        "effects": effects,
        "torque_change_over_noise": made.torque_change_over_noise,
    });
    if let Some(error) = made.nominal_error {
        answer["nominal_error"] = json!(error);
    }
    answer
}
