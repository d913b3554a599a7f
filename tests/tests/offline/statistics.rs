//! What stated standard deviations are worth: on the simulated geared arm, whose residuals are coloured, and between
//! independent runs of a measured one.

use rivet_config::Robot;
use rivet_dynamics::Workspace;
use rivet_estimation::offline::{white_noise, white_noise_without};
use rivet_estimation::{Identifier, Motion, ParameterState};
use rivet_logs::interpolate;
use rivet_simulation::motion::{Fourier, FourierSettings, MotionLimits, load_ratio};
use rivet_simulation::process::nominal_joints;
use rivet_simulation::{Disturbances, FrictionLaw, Plant, PlantSettings, Sensors, Truth, closed_loop};
use rivet_tests::altered::Random;
use rivet_tests::{rivet, robot, shared, succeed};
use serde_json::Value;

/// Length of a run [s].
const SECONDS: f64 = 40.0;

/// Errors of one run over their stated standard deviations, `None` for what is not identified.
fn run(robot: &Robot, friction: FrictionLaw, motion: u64, seed: u64) -> Vec<Option<f64>> {
    let (config, n) = (&robot.config, robot.dof());
    let disturbances =
        Disturbances { bodies_spread: 0.1, rotor_inertia_spread: 0.2, friction_spread: 0.2, ..Disturbances::default() };
    let truth = Truth::new(&robot.model, &nominal_joints(robot), &disturbances);
    let sensors = Sensors {
        resolution: config.drive.encoder_resolution.clone(),
        position_noise: config.simulation.position_noise.clone(),
        torque_noise: config.simulation.torque_noise.clone(),
    };
    let period = config.sample_period_s;
    let mut plant_settings = PlantSettings::new(period, &config.drive.torque_limit);
    plant_settings.friction = friction;
    let mut plant = Plant::new(&truth, &sensors, &plant_settings, seed);
    let limits = MotionLimits::of(&robot.model.arm, 0.5);
    let mut load = load_ratio(&robot.model, &robot.nominal, &config.drive.torque_limit);
    let settings = FourierSettings { seed: motion, ..FourierSettings::default() };
    let trajectory = Fourier::new(&limits, &settings, &mut load);
    plant.place(&limits.home, &[0.0; 8][..n]);

    let estimation = config.estimation_settings();
    let mut identifier = Identifier::new(robot.model.clone(), robot.base.clone(), &robot.nominal_base, &estimation)
        .expect("sound settings");
    let standard = &robot.nominal;
    let mut ws = Workspace::new(&robot.model.arm);
    let mut rows = vec![0.0; n * robot.model.len()];
    let mut past = vec![vec![0.0; n]; 5];
    let mut count = 0_usize;
    // Computed torque with the nominal arm: 4 Hz, critically damped, velocity over five samples.
    let w = std::f64::consts::TAU * 4.0;
    closed_loop(
        &mut plant,
        &trajectory,
        |measured, setpoint, command| {
            let before = &mut past[count % 5];
            let speed = |j: usize, before: &[f64]| {
                if count < 5 { setpoint.qd[j] } else { (measured.q()[j] - before[j]) / (5.0 * period) }
            };
            let qdd: Vec<f64> = (0..n)
                .map(|j| {
                    let (e, ed) = (setpoint.q[j] - measured.q()[j], setpoint.qd[j] - speed(j, before));
                    setpoint.qdd[j] + w * w * e + 2.0 * w * ed
                })
                .collect();
            before.copy_from_slice(measured.q());
            count += 1;
            robot.model.regressor(&mut ws, measured.q(), setpoint.qd, &qdd, &mut rows);
            for (command, row) in command.iter_mut().zip(rows.chunks_exact(standard.len())) {
                *command = row.iter().zip(standard).map(|(y, x)| y * x).sum();
            }
        },
        (SECONDS / period) as usize,
        |record| {
            let s = record.setpoint;
            identifier.push(record.measured.q(), record.measured.tau(), Some(Motion { q: s.q, qd: s.qd, qdd: s.qdd }));
        },
    );
    let found = identifier.estimate();
    let x = robot.base.from_standard(&truth.standard(&robot.model));
    (0..x.len())
        .map(|i| (found.state[i] == ParameterState::Active).then(|| (found.values[i] - x[i]) / found.std[i]))
        .collect()
}

/// Share of ±2σ intervals that hold, mean square of error over σ, and the part of the latter that noise does not change.
struct Coverage {
    count: usize,
    inside: f64,
    /// The same for intervals wider by a tenth, a fifth and two fifths.
    wider: [f64; 3],
    square: f64,
    systematic: f64,
}

fn coverage(robot: &Robot, friction: FrictionLaw, motions: u64) -> Coverage {
    let mut pairs: Vec<[Vec<Option<f64>>; 2]> = Vec::new();
    for motion in 1..=motions {
        pairs.push([1, 2].map(|seed| run(robot, friction, motion, 10 * motion + seed)));
    }
    let all: Vec<f64> = pairs.iter().flatten().flatten().flatten().copied().collect();
    let both: Vec<f64> =
        pairs.iter().flat_map(|[a, b]| a.iter().zip(b)).filter_map(|(a, b)| Some(a.as_ref()? * b.as_ref()?)).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let squares: Vec<f64> = all.iter().map(|e| e * e).collect();
    let within = |limit: f64| all.iter().filter(|e| e.abs() <= limit).count() as f64 / all.len().max(1) as f64;
    let (inside, wider) = (within(2.0), [2.2, 2.4, 2.8].map(within));
    Coverage { count: all.len(), inside, wider, square: mean(&squares), systematic: mean(&both) }
}

/// The geared arms, with encoder quanta, torque noise and residuals coloured by what friction has beyond the model: it really
/// sticks, where the model's is rounded. No covariance knows what a wrong law adds to the parameters themselves (most of the
/// wrist's error on the UR10e); with the law right it is noise. Four motions each.
#[test]
fn standard_deviations_cover_on_geared_arms() {
    let share = |arm: &str, friction: Option<FrictionLaw>, motions: u64| {
        let robot = rivet_config::load(robot(arm)).expect("a sound robot file");
        let rounded = FrictionLaw::Smooth { velocity: robot.model.structure.sign_velocity };
        let found = coverage(&robot, friction.unwrap_or(rounded), motions);
        println!(
            "{arm}, {}: {} values, {:.1} % within 2 std ({:.3?} 1.1, 1.2, 1.4 times wider); mean square error {:.2} variances, of which {:.2} are systematic",
            if friction.is_some() { "friction that sticks" } else { "friction as the model has it" },
            found.count,
            100.0 * found.inside,
            found.wider,
            found.square,
            found.systematic
        );
        (found.inside * found.count as f64, found.count as f64)
    };
    let (inside, of) = share("ur10e", None, 4);
    assert!((0.90..=0.98).contains(&(inside / of)), "{inside} of {of}");
    let [a, b] = ["ur10e", "manutec-r3"].map(|arm| share(arm, Some(FrictionLaw::Stick), 4));
    assert!(a.0 >= 0.85 * a.1 && b.0 >= 0.85 * b.1, "{a:?} {b:?}");
}

/// Parameters of independent runs of a measured arm differ as their standard deviations say.
#[test]
fn disjoint_runs_of_the_ur10e_agree() {
    let Some(data) = shared("data/real/ur10e_innopolis") else { return };
    let runs = ["20_02_10-30sec_12harm", "20_02_12-50sec_12harm", "20_02_19_14harm50sec"];
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("compared.json");
    let mut compare = rivet();
    compare.arg("identify").arg(robot("ur10e")).arg("--compare").arg("--json").arg(&out);
    let printed = succeed(compare.args(runs.map(|run| data.join(format!("{run}.parquet")))));
    println!("{}", String::from_utf8_lossy(&printed.stdout));
    let json: Value = serde_json::from_slice(&std::fs::read(&out).expect("a result")).expect("JSON");
    let pairs = json["pairs"].as_array().expect("pairs");
    assert_eq!(pairs.len(), 3);
    for pair in pairs {
        let (within, of) = (pair["within"].as_u64().expect("a count"), pair["of"].as_u64().expect("a count"));
        assert!(of >= 55, "{of} parameters are decided by the data in both runs");
        assert!(within as f64 >= 0.85 * of as f64, "{within} of {of}");
    }
    // Not by being huge: the median standard deviation makes less than a hundredth of a joint's torque.
    for run in json["runs"].as_array().expect("runs") {
        let percent = run["median_std_torque_percent"].as_f64().expect("a number");
        assert!(percent < 1.0, "{percent}");
    }
}

/// Rows that are interpolated are smoother than measured ones: beside them the noise is that of the measured rows.
#[test]
fn noise_is_that_of_measured_rows_where_others_are_interpolated() {
    let mut random = Random(3);
    let t: Vec<f64> = (0..4000).map(|k| 0.008 * f64::from(k)).collect();
    let x: Vec<f64> = t.iter().map(|t| 30.0 * t.sin() + 0.5 * random.normal()).collect();
    for share in [0.03, 0.1] {
        let missing: Vec<usize> = (1..t.len() - 1).filter(|_| random.uniform() + 0.5 < share).collect();
        let is_kept = |k: &usize| missing.binary_search(k).is_err();
        let [kept_t, kept_x] = [&t, &x].map(|of| (0..of.len()).filter(is_kept).map(|k| of[k]).collect::<Vec<f64>>());
        let filled = interpolate(&kept_t, &kept_x, &t);
        let (all, measured) = (white_noise(&filled, 6), white_noise_without(&filled, 6, &missing));
        println!("{share}: {all:.3} of all rows, {measured:.3} of those that were measured, 0.5 is right");
        assert!((measured / 0.5 - 1.0).abs() < 0.06, "{measured}");
        assert!(all < 0.95 * measured, "{all}, {measured}");
    }
}
