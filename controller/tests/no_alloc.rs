//! Nothing allocates in the loop's own code: good and hostile samples, setpoints and parameter sets, stops, health.

mod common;

use allocation_counter::{AllocationInfo, measure};
use common::{Moving, core, published, robot_of};
use rivet_ipc_schema::{ControllerHealth, Parameters};

#[test]
fn ten_thousand_periods_with_everything_that_can_come_do_not_allocate() {
    let robot = robot_of("staubli-tx40");
    let mut core = core(&robot);
    let mut moving = Moving::new(&robot, &robot.nominal_base);
    let mut health = ControllerHealth::default();
    let (mut answered, mut accepted) = (0, 0);
    for k in 1..=10_000_u64 {
        let (mut sample, mut setpoint) = moving.next();
        // Every kind of message that a broken robot controller, planner or daemon can send.
        match k % 101 {
            1 => sample.q[0] = f64::NAN,
            2 => sample.tau[5] = f64::INFINITY,
            3 => sample.joints = u32::MAX,
            4 => sample.faults = 1,
            5 => sample.seq = 0,
            6 => sample.q = [1e300; 8],
            7 => setpoint.qdd[2] = f64::NAN,
            8 => setpoint.q = [1e300; 8],
            9 => setpoint.joints = 0,
            _ => {}
        }
        let mut set = published(&robot, sample.seq);
        set.epoch = k;
        match k % 13 {
            1 => set.values[2] = f64::NAN,
            2 => set.count = u32::MAX,
            3 => set.values = [f64::MAX; 128],
            4 => set = Parameters::default(),
            5 => set.values[3] *= 1.5,
            _ => {}
        }
        let seen = measure(|| {
            core.offer_setpoint(&setpoint);
            core.offer_parameters(&set, &sample);
            answered += u64::from(core.tick(&sample).is_ok());
            if k % 500 > 480 {
                core.observe(&sample);
                let _ = core.missing(k % 500 - 470);
            }
            if k.is_multiple_of(100) {
                core.write_health(&mut health);
            }
        });
        assert_eq!(seen, AllocationInfo::default(), "period {k}");
        accepted = core.counts().accepted;
    }
    assert!(answered > 9000 && accepted > 1000, "{answered} answered, {accepted} accepted");
    assert!(health.stops > 0 && health.largest_step.iter().all(|step| step.is_finite()));
}
