//! What a step costs.

use super::super::{Estimator, EstimatorSettings};
use super::Stage;
use crate::linear::{STEP_WORK, tests::Random};
use crate::operations::counted;
use crate::report::Instrument;
use crate::scales::Scales;
use crate::settings::{EigenSettings, Supervision};

/// Parameters and joints of an arm of six axes.
const SIX_AXIS_PARAMETERS: usize = 61;
const SIX_AXIS_JOINTS: usize = 6;
/// What a step may do beyond `STEP_WORK`: the last thing that it began, at most a standard deviation.
const LAST: usize = 8 * SIX_AXIS_PARAMETERS * SIX_AXIS_PARAMETERS;

fn estimator() -> Estimator {
    let settings = EstimatorSettings::whitened(Supervision::Eigen(EigenSettings::default()));
    Estimator::new(&[1.0; SIX_AXIS_PARAMETERS], &Scales::unit(SIX_AXIS_JOINTS, SIX_AXIS_PARAMETERS), &settings)
}

/// With a row before every step, whatever the rows say: no step costs more than its bound, and a cycle has ended after 30.
/// Instruments that have little to do with the motion are found out only when the solution is verified, again and again.
#[test]
fn no_step_of_the_eigen_scheme_exceeds_its_bound() {
    for (name, size, columns, against) in [
        ("rich motion", 1.0, SIX_AXIS_PARAMETERS, 0.0),
        ("standstill", 0.0, SIX_AXIS_PARAMETERS, 0.0),
        ("few columns", 1e-3, 5, 0.0),
        ("small", 1e-100, SIX_AXIS_PARAMETERS, 0.0),
        ("large", 1e50, SIX_AXIS_PARAMETERS, 0.0),
        ("noisy instruments", 1.0, SIX_AXIS_PARAMETERS, 1.5),
    ] {
        let mut random = Random(92);
        let mut estimator = estimator();
        let (mut most, mut steps, mut longest, mut cycles) = (0, 0, 0, 0);
        for _ in 0..600 {
            let d: Vec<f64> = (0..SIX_AXIS_JOINTS * SIX_AXIS_PARAMETERS)
                .map(|i| if i % SIX_AXIS_PARAMETERS < columns { size * random.normal() } else { 0.0 })
                .collect();
            let z: Vec<f64> = d.iter().map(|d| d + against * size * random.normal()).collect();
            let tau: Vec<f64> = (0..SIX_AXIS_JOINTS).map(|_| size * random.normal()).collect();
            estimator.update(&d, Some((&z, Instrument::Setpoint)), &tau, &[1.0; SIX_AXIS_JOINTS]).expect("sound rows");
            most = most.max(counted(|| estimator.work())[0]);
            steps += 1;
            if estimator.cycle.stage == Stage::Idle {
                (longest, steps, cycles) = (longest.max(steps), 0, cycles + 1);
            }
        }
        let active = estimator.estimate().verdict.active;
        println!("{name}: a step at most {most}, {cycles} cycles of at most {longest} steps, {active} move in the end");
        assert!(most <= STEP_WORK + LAST, "{name}: {most}");
        assert!(
            cycles >= 20 && longest <= 30 && steps <= 30,
            "{name}: {cycles} cycles of {longest} steps, {steps} more"
        );
    }
}
