//! `Identifier::push` never allocates, whatever comes in; what is refused changes nothing that was learnt.

mod common;

use allocation_counter::{AllocationInfo, measure};
use common::{Bench, Random, Wave};
use rivet_estimation::{
    ColumnsSettings, EigenSettings, EstimatorKind, Filtering, Identifier, InputSignals, Motion, Refusal, Settings,
    Step, Supervision, TrackedSettings,
};

#[test]
fn pushing_never_allocates() {
    let Some(mut bench) = Bench::new("manutec-r3") else { return };
    let n = bench.dof();
    let (truth, loaded) = (bench.truth.clone(), bench.with_load(9.0, [0.02, 0.0, 0.1]));
    let mut wave = Wave::new(n, 1.0);
    let mut samples = Vec::new();
    for k in 0..20_000 {
        let motion = wave.at(f64::from(k) * 0.001);
        let tau = [bench.torque(motion, &truth), bench.torque(motion, &loaded)];
        samples.push((motion.q.to_vec(), motion.qd.to_vec(), motion.qdd.to_vec(), tau));
    }
    let still = vec![0.0; n];
    for (estimator, supervision) in [
        (EstimatorKind::Riv, Supervision::Eigen(EigenSettings::default())),
        (EstimatorKind::Riv, Supervision::Tracked(TrackedSettings::default())),
        (EstimatorKind::Riv, Supervision::Columns(ColumnsSettings::default())),
        (EstimatorKind::Riv, Supervision::Off),
        (EstimatorKind::Rls, Supervision::Off),
        (EstimatorKind::Energy, Supervision::Eigen(EigenSettings::default())),
        (EstimatorKind::RlsEnergy, Supervision::Off),
    ] {
        // The path without the model filter is another one as well.
        let filtering =
            if estimator == EstimatorKind::Energy { Filtering::Input(InputSignals::All) } else { Filtering::Model };
        let settings = Settings { estimator, supervision, filtering, ..Settings::new(n, 0.001) };
        let mut identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, &settings)
            .expect("sound settings");
        let mut random = Random(1);
        let mut counts = [0_u64; 5];
        let mut q = vec![0.0; n];
        let mut before = Vec::with_capacity(bench.len());
        let seen = measure(|| {
            for k in 0..110_000_usize {
                let (sample, qd, qdd, torques) = &samples[k % samples.len()];
                // From the middle on the arm carries something.
                let tau = &torques[usize::from(k >= 40_000)];
                q.copy_from_slice(sample);
                let setpoint = Motion { q: sample, qd, qdd };
                let what = random.unit();
                let step = if what < 0.0005 {
                    // Only `work` in progress may move the estimate, so compare what no step touches: the counts.
                    before.clear();
                    before.extend_from_slice(identifier.estimate().rls_values);
                    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e5, f64::MAX][k % 6];
                    q[k % n] = bad;
                    let step = identifier.push(&q, tau, Some(setpoint));
                    assert!(matches!(step, Step::Refused(_)), "{bad}: {step:?}");
                    assert!(before == identifier.estimate().rls_values);
                    step
                } else if what < 0.001 {
                    identifier.push(&q, &[f64::NAN; 8][..n], None)
                } else if what < 0.0012 {
                    identifier.push(&q[1..], tau, None)
                } else if (50_000..70_000).contains(&k) {
                    // Rest, with torques and speeds that are denormal.
                    q.fill(f64::MIN_POSITIVE * random.unit());
                    identifier.push(&q, &still, Some(Motion { q: &q, qd: &still, qdd: &still }))
                } else {
                    identifier.push(&q, tau, (k % 7000 > 1500).then_some(setpoint))
                };
                counts[match step {
                    Step::WarmingUp => 0,
                    Step::Between => 1,
                    Step::Updated { .. } => 2,
                    Step::Skipped(_) => 3,
                    Step::Refused(Refusal::NotFinite | Refusal::Implausible) => 4,
                }] += 1;
                if k % 10_000 == 9999 {
                    identifier.freeze();
                    identifier.resume();
                    if k > 100_000 {
                        identifier.reset();
                    }
                }
            }
        });
        println!(
            "{estimator:?} {supervision:?}: warming, between, updated, skipped, refused = {counts:?}, {} changes",
            identifier.estimate().changes
        );
        assert_eq!(seen, AllocationInfo::default());
        assert!(identifier.estimate().changes > 0, "the load is seen");
        assert!(counts.iter().all(|c| *c > 10), "{counts:?}");
        let estimate = identifier.estimate();
        assert!(estimate.values.iter().chain(estimate.std).chain(estimate.rls_values).all(|v| v.is_finite()));
    }
}
