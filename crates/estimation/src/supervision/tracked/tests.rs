//! The scheme's work is the same whatever the rows say.

use super::*;
use crate::estimator::{Estimator, EstimatorSettings};
use crate::linear::tests::Random;
use crate::operations::counted;
use crate::report::Instrument;
use crate::scales::Scales;
use crate::settings::Supervision;

const THREE_AXIS_PARAMETERS: usize = 23;
const THREE_AXIS_JOINTS: usize = 3;
const ROWS: u32 = 300;
/// Periods from row to row.
const PERIODS: u32 = 4;

/// Multiply-adds and data-dependent writes of every period, and directions that moved at most, at least and in the end.
struct Run {
    periods: Vec<[usize; 2]>,
    active: [usize; 3],
}

fn run(mut rows: impl FnMut(u32) -> [Vec<f64>; 3]) -> Run {
    let mut scheme = Tracked::new(THREE_AXIS_PARAMETERS, THREE_AXIS_JOINTS, TrackedSettings::default(), 0.99, None);
    let (mut x, mut active, mut verdict) =
        (vec![0.5; THREE_AXIS_PARAMETERS], vec![false; THREE_AXIS_PARAMETERS], Verdict::NONE);
    let known = Known {
        variance: 1.0,
        belief: &[0.1; THREE_AXIS_PARAMETERS],
        width: &[1.0; THREE_AXIS_PARAMETERS],
        whitening: None,
    };
    let mut periods = Vec::new();
    let mut counts = [0, THREE_AXIS_PARAMETERS, 0];
    for k in 0..ROWS {
        let [z, d, tau] = rows(k);
        periods.push(counted(|| scheme.add(0.99, &z, &d, &tau)));
        for _ in 0..PERIODS {
            periods.push(counted(|| {
                if scheme.turn() {
                    scheme.solve(known, &mut x, &mut active, &mut verdict);
                }
            }));
        }
        counts = [counts[0].max(verdict.active), counts[1].min(verdict.active), verdict.active];
    }
    Run { periods, active: counts }
}

/// Rich motion, standstill, few directions, hostile sizes and signs, instruments that go against the motion, and all of it
/// by turns: each period does as many multiply-adds as any other in its place. What is left out of the solution costs writes,
/// at most two for every entry of a matrix.
#[test]
fn the_number_of_operations_does_not_depend_on_the_data() {
    let mut random = Random(91);
    let mut normal = |count: usize, size: f64| -> Vec<f64> { (0..count).map(|_| size * random.normal()).collect() };
    let mut rich = |size: f64| {
        let z = normal(THREE_AXIS_JOINTS * THREE_AXIS_PARAMETERS, size);
        let d =
            z.iter().zip(normal(THREE_AXIS_JOINTS * THREE_AXIS_PARAMETERS, 0.1 * size)).map(|(z, e)| z + e).collect();
        [z, d, normal(THREE_AXIS_JOINTS, size)]
    };
    let parallel = |[z, _, tau]: [Vec<f64>; 3]| {
        let z: Vec<f64> = z
            .iter()
            .enumerate()
            .map(|(i, _)| {
                z[i / THREE_AXIS_PARAMETERS * THREE_AXIS_PARAMETERS] * (1.0 + (i % THREE_AXIS_PARAMETERS) as f64)
            })
            .collect();
        [z.clone(), z, tau]
    };
    let still = || {
        [
            vec![0.0; THREE_AXIS_JOINTS * THREE_AXIS_PARAMETERS],
            vec![0.0; THREE_AXIS_JOINTS * THREE_AXIS_PARAMETERS],
            vec![0.0; THREE_AXIS_JOINTS],
        ]
    };
    let against = |[z, d, tau]: [Vec<f64>; 3]| [z, d.iter().map(|d| -d).collect(), tau];
    // Pivots are as promised, the solution is not: no step is taken.
    let mixed = |[z, _, tau]: [Vec<f64>; 3]| {
        let after = |i: usize| if i % THREE_AXIS_PARAMETERS + 1 < THREE_AXIS_PARAMETERS { 5.0 * z[i + 1] } else { 0.0 };
        let d = z.iter().enumerate().map(|(i, x)| x + after(i)).collect();
        [z, d, tau]
    };
    let usual = run(|_| rich(1.0));
    assert!(
        usual.active[1] < THREE_AXIS_PARAMETERS / 2 && usual.active[2] == THREE_AXIS_PARAMETERS,
        "it begins with little and ends with everything"
    );
    let most = usual.periods.iter().map(|[adds, _]| *adds).max().expect("periods");
    println!(
        "at most {:.1} n² multiply-adds a period, n = {THREE_AXIS_PARAMETERS}, n/3 of them the elimination",
        most as f64 / (THREE_AXIS_PARAMETERS * THREE_AXIS_PARAMETERS) as f64
    );
    let others = [
        ("standstill", run(|_| still())),
        ("one direction", run(|_| parallel(rich(1.0)))),
        ("tiny", run(|_| rich(1e-150))),
        ("huge", run(|_| rich(1e50))),
        ("sizes", run(|k| rich(10.0_f64.powi((k * 37 % 91).cast_signed() - 45)))),
        ("against the motion", run(|_| against(rich(1.0)))),
        (
            "by turns",
            run(|k| match k / 40 % 5 {
                0 => rich(1.0),
                1 => parallel(rich(3.0)),
                2 => still(),
                3 => mixed(rich(1.0)),
                _ => against(rich(0.3)),
            }),
        ),
    ];
    let stride = Rotations::new(THREE_AXIS_PARAMETERS, THREE_AXIS_JOINTS).stride();
    for (name, run) in others.iter().map(|(name, run)| (*name, run)).chain([("usual", &usual)]) {
        println!("{name}: {:?} of {THREE_AXIS_PARAMETERS} move at most, at least and in the end", run.active);
        for (at, ([adds, writes], [expected, _])) in run.periods.iter().zip(&usual.periods).enumerate() {
            assert_eq!(adds, expected, "{name}: period {at}");
            assert!(*writes <= 2 * THREE_AXIS_PARAMETERS * stride, "{name}: {writes} writes in period {at}");
        }
    }
    let moved = |name: &str| others.iter().find(|(other, _)| *other == name).expect("a run").1.active;
    assert_eq!((moved("standstill")[0], moved("against the motion")[0]), (0, 0));
    assert!(
        moved("one direction")[2] <= THREE_AXIS_JOINTS && moved("one direction")[0] > 0,
        "{:?}",
        moved("one direction")
    );
}

/// A whole period of the estimator: standard deviations are refreshed only where something moved, nothing else differs.
#[test]
fn a_period_of_the_estimator_never_costs_more_than_with_rich_motion() {
    let settings = EstimatorSettings::whitened(Supervision::Tracked(TrackedSettings::default()));
    let run = |size: f64, columns: usize| {
        let mut random = Random(92);
        let mut estimator = Estimator::new(
            &[1.0; THREE_AXIS_PARAMETERS],
            &Scales::unit(THREE_AXIS_JOINTS, THREE_AXIS_PARAMETERS),
            &settings,
        );
        let mut periods = Vec::new();
        for _ in 0..ROWS {
            let z: Vec<f64> = (0..THREE_AXIS_JOINTS * THREE_AXIS_PARAMETERS)
                .map(|i| if i % THREE_AXIS_PARAMETERS < columns { size * random.normal() } else { 0.0 })
                .collect();
            // With rich motion the model fits: nothing that is found is refused.
            let fits = size == 1.0 && columns == THREE_AXIS_PARAMETERS;
            let torque_of_row = |row: &[f64]| if fits { row.iter().sum() } else { size * random.normal() };
            let tau: Vec<f64> = z.chunks_exact(THREE_AXIS_PARAMETERS).map(torque_of_row).collect();
            estimator
                .update(&z, Some((&z, Instrument::Setpoint)), &tau, &[1.0; THREE_AXIS_JOINTS])
                .expect("sound rows");
            periods.extend((0..PERIODS).map(|_| counted(|| estimator.work())[0]));
        }
        (periods, estimator.estimate().verdict.active)
    };
    let (usual, active) = run(1.0, THREE_AXIS_PARAMETERS);
    assert_eq!(active, THREE_AXIS_PARAMETERS);
    for (size, columns) in [
        (0.0, THREE_AXIS_PARAMETERS),
        (1.0, 2),
        (1e-100, THREE_AXIS_PARAMETERS),
        (1e50, THREE_AXIS_PARAMETERS),
        (1e-3, 5),
    ] {
        let (periods, active) = run(size, columns);
        println!("size {size:e}, {columns} columns: {active} move in the end");
        for (at, (count, usual)) in periods.iter().zip(&usual).enumerate() {
            assert!(count <= usual, "{size:e} {columns}: period {at}, {count} beside {usual}");
        }
    }
}
