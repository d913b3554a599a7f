//! The fallback chain in motion, on three arms: `rivetd` is killed and started again beside `rivet-controller`. Real processes.

use rivet_ipc_schema::{ControllerHealth, ParameterSource, PrivateBus, SourceReason};
use rivet_tests::process::Process;
use rivet_tests::stage::{Stage, quality, turn};

/// One run of about 20 s of motion; `disturb` acts on the daemon some seconds after live parameters came into use. Returns step,
/// tracking error, and the health at the end.
fn run(arm: &str, name: &str, disturb: impl FnOnce(&Stage<'_>, &mut Process)) -> (f64, f64, ControllerHealth) {
    let private = PrivateBus::new(name);
    let folder = tempfile::tempdir().expect("a folder");
    let stage = Stage::new(private.config(), folder.path(), arm, "");
    let log = folder.path().join("log.csv");
    let mut daemon = stage.daemon();
    let _controller = stage.controller(&["--lockstep"]);
    let log_words = log.display().to_string();
    let mut plant = stage.plant(&["--lockstep", "2000", "--unpaced", "--log-out", &log_words]);
    let live = stage.wait_for(ParameterSource::Live);
    // Five seconds for the estimate to become good.
    let from = stage.wait("a good estimate", |health| health.seq >= live.seq + 5000).seq;
    disturb(&stage, &mut daemon);
    let enough = stage.wait("the end", |health| health.seq >= from + 14_000);
    plant.end("-TERM");
    // The log counts motion, the samples began before it: what is left out of the log's start is a little more.
    let robot = rivet_config::load(&stage.file).expect("sound");
    let (step, error) = quality(&log, &robot.config.drive.torque_limit, from as f64 * 0.001);
    (step, error, enough)
}

/// The daemon is killed in mid motion, and started again: the arm goes on tracking, the torque takes no step that an
/// undisturbed run does not take, and the new daemon's parameters are adopted.
fn check(arm: &str) {
    let _turn = turn();
    let (step, error, health) = run(arm, "undisturbed", |_, _| ());
    assert_eq!(health.stops, 0);
    let (killed_step, killed_error, killed_health) = run(arm, "killed", |stage, daemon| {
        // As a daemon that has been up for some time has done by itself.
        stage.save();
        daemon.end("-KILL");
        let health = stage.wait_for(ParameterSource::LastGood);
        assert_eq!(SourceReason::try_from(health.source_reason), Ok(SourceReason::Silent));
        let seq = health.seq;
        stage.wait("two seconds without a daemon", |health| health.seq >= seq + 2000);
        *daemon = stage.daemon();
        let health = stage.wait_for(ParameterSource::Live);
        assert_eq!(SourceReason::try_from(health.source_reason), Ok(SourceReason::Adopted));
    });
    assert_eq!(killed_health.stops, 0);
    println!(
        "{arm}: undisturbed: step {step:.5} of the limit, error {error:.3e} rad; killed: {killed_step:.5}, {killed_error:.3e} rad"
    );
    // The largest of 10⁴ noisy steps differs by some 15 % from run to run; the rate limit itself would be 1.45 times it.
    assert!(killed_step <= 1.25 * step, "largest step {killed_step} of the torque limit, undisturbed {step}");
    assert!(killed_error <= 1.1 * error, "tracking error {killed_error} rad, undisturbed {error}");
}

#[test]
fn manutec_r3() {
    check("manutec-r3");
}

#[test]
fn staubli_tx40() {
    check("staubli-tx40");
}

#[test]
fn ur10e() {
    check("ur10e");
}
