//! Every way to differentiate, on encoders as they are: read to a quantum, renewed at a slower rate than the loop's (stair
//! cases), read late by a little that changes (jitter). Torques are always those of the instant.

use crate::common::{Bench, Random, Wave};
use rivet_estimation::{Differentiator, Identifier, Settings, Window};

const PERIOD: f64 = 0.002;

/// What an encoder makes of the motion.
#[derive(Clone, Copy, Debug)]
enum Encoder {
    Exact,
    /// Read to this \[rad\].
    Quantised(f64),
    /// Renewed only every so many periods.
    StairCase(u32),
    /// Read at a time that is off by up to this \[s\], evenly.
    Jittered(f64),
}

/// Torque error of least squares and instruments on the reference workload after 30 s, torques late by `late` \[s\].
fn error(differentiator: Differentiator, encoder: Encoder, late: f64) -> Option<f64> {
    let mut bench = Bench::new("manutec-r3")?;
    let settings = Settings {
        differentiator,
        filter_hz: 15.0,
        decimation: 7,
        window: Window::Exponential { seconds: 10.0 },
        ..Settings::new(bench.dof(), PERIOD)
    };
    let identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, &settings);
    let mut identifier = identifier.expect("sound settings");
    let truth = bench.truth.clone();
    let (mut plan, mut arm, mut random) = (Wave::new(6, 1.0), Wave::new(6, 1.0), Random(9));
    for k in 0..15_000_u32 {
        let t = f64::from(k) * PERIOD;
        let mut tau = bench.torque(arm.at(t - late), &truth);
        for (tau, sigma) in tau.iter_mut().zip([0.6, 3.0, 1.0, 0.06, 0.04, 0.02]) {
            *tau += sigma * random.normal();
        }
        let seen = match encoder {
            Encoder::Exact | Encoder::Quantised(_) => t,
            // In the middle of its hold, as an encoder's stamp has it.
            Encoder::StairCase(hold) => (f64::from(k - k % hold) + 0.5 * f64::from(hold - 1)) * PERIOD,
            Encoder::Jittered(most) => t + most * (2.0 * random.unit() - 1.0),
        };
        let mut q = arm.at(seen).q.to_vec();
        if let Encoder::Quantised(quantum) = encoder {
            for q in &mut q {
                *q = (*q / quantum).round() * quantum;
            }
        }
        identifier.push(&q, &tau, Some(plan.at(t)));
    }
    Some(bench.torque_error(identifier.estimate().values))
}

/// Narrow windows are exact to the noise but need samples that are new; windows that cover two steps of a stair case, and the
/// state filter, take any encoder for half a per cent of torque: what they smooth of a nonlinear model's signals.
#[test]
fn every_differentiator_serves_the_encoders_it_is_for() {
    let golay = |half_width| Differentiator::SavitzkyGolay { half_width };
    let (narrow, wide) = ([Differentiator::Central, golay(5)], [golay(20), Differentiator::StateFilter { hz: 40.0 }]);
    let stairs = Encoder::StairCase(4);
    let check = |differentiator, encoder, bounds: std::ops::Range<f64>| {
        let Some(found) = error(differentiator, encoder, 0.0) else { return };
        println!("{encoder:?}, {differentiator:?}: torque error {found:.5}");
        assert!(bounds.contains(&found), "{encoder:?}, {differentiator:?}: {found}");
    };
    for encoder in [Encoder::Exact, Encoder::Quantised(5e-5), Encoder::Jittered(2e-4)] {
        for differentiator in narrow {
            check(differentiator, encoder, 0.0..0.002);
        }
    }
    for (differentiator, encoder) in wide
        .into_iter()
        .flat_map(|d| [Encoder::Exact, Encoder::Quantised(5e-5), Encoder::Jittered(2e-4), stairs].map(|e| (d, e)))
    {
        check(differentiator, encoder, 0.0..0.008);
    }
    check(golay(5), stairs, 0.0..0.02);
    // Three samples of a step of four see a standstill: `rivet identify` names the window that such a log needs.
    check(Differentiator::Central, stairs, 0.05..f64::INFINITY);
}

/// No differentiator hides that torque comes 10 ms after position: all signals are delayed alike, so nothing is traded against
/// anything, and the error is that of the log (which `rivet identify` estimates per joint).
#[test]
fn misaligned_torque_is_misaligned_whatever_differentiates() {
    for differentiator in [
        Differentiator::Central,
        Differentiator::SavitzkyGolay { half_width: 20 },
        Differentiator::StateFilter { hz: 40.0 },
    ] {
        let Some(late) = error(differentiator, Encoder::Exact, 0.01) else { return };
        println!("{differentiator:?}: torque error {late:.4} with torque 10 ms late");
        assert!((0.035..0.045).contains(&late), "{differentiator:?}: {late}");
    }
}
