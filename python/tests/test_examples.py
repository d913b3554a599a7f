"""Short examples, each of one use. Every number is compared with what the simulated arm really has."""

import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import rivet


def rms(values):
    return float(np.sqrt(np.nanmean(np.square(values))))


def true_values(run, found):
    """True values of the identified parameters; an offset that the robot file leaves open is 0 in the simulator."""
    return np.array([0.0 if name.endswith(".offset") else run.base[name] for name in found.names])


# Identification


def test_identifies_the_true_parameters_within_their_standard_deviations(run, found):
    truth = true_values(run, found)
    deviations = np.abs(found.values - truth) / found.std
    by_data = np.array([by == "data" for by in found.decided_by])
    assert by_data.sum() >= 8
    # A normal error is beyond three standard deviations in 0.3 % of all cases.
    assert np.mean(deviations[by_data] < 3.0) >= 0.85 and deviations[by_data].max() < 6.0


def test_identifies_friction_and_not_the_nominal_value(run, found):
    name = next(name for name in found.names if "coulomb" in name)
    value, std = found.value(name)
    nominal = found.nominal[found.names.index(name)]
    assert abs(value - run.base[name]) < 5.0 * std < abs(value - nominal)


def test_arrays_give_the_result_of_the_file(arm, run, found, tmp_path):
    run.log.save(tmp_path / "log.parquet")
    of_file = rivet.identify(arm, tmp_path / "log.parquet")
    of_tuple = rivet.identify(arm, (run.log.time, run.log.q, run.log.tau))
    np.testing.assert_array_equal(of_file.values, found.values)
    # Without the desired motion the instruments are others.
    assert of_tuple.values.shape == found.values.shape


def test_covariance_has_the_squares_of_the_standard_deviations(found):
    variances = np.diag(found.covariance)
    assert found.covariance.shape == (len(found.names),) * 2
    np.testing.assert_allclose(found.covariance, found.covariance.T, atol=1e-9 * variances.max())
    assert np.all(variances > 0.0)


def test_held_out_log_is_predicted_better_than_by_the_nominal_model(arm, run, other):
    found = rivet.identify(arm, run.log, held_out=other.log)
    (held_out,) = found.to_dict()["held_out"]
    assert rms(held_out["identified_percent"]) < 0.5 * rms(held_out["nominal_percent"])


def test_payload_shows_in_the_difference_of_two_identifications(arm):
    unloaded, loaded = (rivet.simulate(arm, 20.0, seed=3, payload=mass) for mass in (None, 2.0))
    before, after = (rivet.identify(arm, run.log) for run in (unloaded, loaded))
    change = after.values - before.values
    truth = true_values(loaded, after) - true_values(unloaded, before)
    std = np.hypot(after.std, before.std)
    largest = int(np.argmax(np.abs(truth) / std))
    assert abs(change[largest] - truth[largest]) < 4.0 * std[largest] < 0.1 * abs(truth[largest])


def test_sign_of_the_torque_can_be_stated(arm, run, found):
    flipped = rivet.Log(run.log.time, run.log.q, -run.log.tau, run.log.q_des, run.log.qd_des, run.log.qdd_des)
    stated = rivet.identify(arm, flipped, map={"tau_sign": "-1"})
    np.testing.assert_allclose(stated.values, found.values, rtol=1e-9, atol=1e-12)


# Prediction


def test_unseen_motion_is_predicted_better_than_by_the_nominal_model(found, other):
    prediction = rivet.predict(found, other.log)
    assert prediction.predicted.shape == prediction.measured.shape == other.log.tau.shape
    nominal = rivet.predict(found.model.with_values(found.nominal), other.log)
    assert np.all(prediction.error_percent < 0.6 * nominal.error_percent) and prediction.error_percent[0] < 2.0
    assert rms(prediction.residual[:, 0]) < 0.05 * rms(prediction.measured[:, 0])


def test_exported_model_predicts_as_the_identification(found, other, tmp_path):
    found.export(tmp_path)
    of_file = rivet.predict(tmp_path / "model.toml", other.log)
    assert of_file.is_identified
    np.testing.assert_allclose(of_file.predicted, rivet.predict(found, other.log).predicted, atol=1e-6)


def test_log_without_torque_is_predicted(found, other):
    prediction = rivet.predict(found, (other.log.time, other.log.q))
    assert prediction.measured is None and prediction.error_percent is None
    error = prediction.predicted - other.log.tau
    assert rms(error) < 0.1 * rms(other.log.tau)


def test_prediction_is_saved_as_the_command_line_writes_it(found, other, tmp_path):
    prediction = rivet.predict(found, other.log)
    prediction.save(tmp_path / "prediction.parquet")
    columns = rivet.inspect(tmp_path / "prediction.parquet").columns
    assert columns[:3] == ["t", "tau_pred1", "tau_pred2"]


# Diagnosis


def test_no_gap_where_simulator_and_arm_are_the_same(arm):
    runs = [rivet.simulate(arm, 20.0, seed=seed).log for seed in (5, 6)]
    diagnosis = rivet.diagnose(arm, runs)
    assert diagnosis.verdict == "no_gap" and diagnosis.causes == []
    assert diagnosis.noise_floor < diagnosis.before < 0.02  # of the torque


def test_payload_is_named_with_its_mass(ur10e):
    runs = [rivet.simulate(ur10e, 25.0, seed=seed, payload=3.0).log for seed in (5, 6)]
    diagnosis = rivet.diagnose(ur10e, runs)
    cause = next(cause for cause in diagnosis.causes if cause.effect == "payload")
    mass = next(size for size in cause.sizes if size.name == "mass")
    assert mass.unit == "kg" and abs(mass.value - 3.0) < 0.3
    assert cause.interval[0] <= cause.shrink <= cause.interval[1] and cause.confidence > 0.5
    assert diagnosis.after < 0.5 * diagnosis.before


def test_diagnosis_has_the_document_and_the_page(arm, run, other, tmp_path):
    diagnosis = rivet.diagnose(arm, [run.log, other.log])
    document = diagnosis.to_dict()
    assert document["verdict"] == diagnosis.verdict != "no_gap"
    assert [joint.joint for joint in diagnosis.per_joint] == rivet.Model(arm).joints
    assert diagnosis.to_html().startswith("<!")
    assert diagnosis.export(tmp_path) and (tmp_path / "model.toml").is_file()


# Inspection


def test_inspection_shows_rate_and_signals(run, tmp_path):
    run.log.save(tmp_path / "log.parquet")
    inspection = rivet.inspect(tmp_path / "log.parquet")
    assert inspection.is_usable and inspection.format == "Parquet"
    assert abs(inspection.rate_hz * np.median(np.diff(run.log.time)) - 1.0) < 1e-6
    np.testing.assert_array_equal(inspection.q, run.log.q)


def test_inspection_reports_a_reversed_torque(arm):
    run = rivet.simulate(arm, 20.0, seed=8)
    reversed_torque = rivet.Log(run.log.time, run.log.q, -run.log.tau)
    readings = {reading.channel: reading for reading in rivet.inspect(reversed_torque, arm).readings}
    assert readings["q"].text == "as recorded"
    assert readings["tau"].text == "tau1..2 with the other sign" and readings["tau"].probability > 0.5


def test_robot_file_is_written_from_a_urdf(arm, run, tmp_path):
    unknown = rivet.robot_file(arm.parent / "robot.urdf", run.log, output=tmp_path / "robot.toml")
    model = rivet.Model(tmp_path / "robot.toml")
    assert model.joints == rivet.Model(arm).joints and "rotor_inertia" in unknown
    assert abs(model.sample_period - np.median(np.diff(run.log.time))) < 1e-9


# Errors


def test_missing_log_is_an_error_with_its_path(arm):
    with pytest.raises(rivet.Error, match="nowhere.parquet") as caught:
        rivet.identify(arm, "nowhere.parquet")
    assert caught.value.kind == "file" and isinstance(caught.value, ValueError)


def test_mistake_in_a_robot_file_is_an_error_with_its_line(arm, tmp_path):
    text = arm.read_text().replace("sample_period_s = ", "sample_period_s = -")
    (tmp_path / "robot.urdf").write_text((arm.parent / "robot.urdf").read_text())
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(rivet.Error, match=r"robot\.toml:\d+:\d+.*sample_period_s") as caught:
        rivet.Model(tmp_path / "robot.toml")
    assert caught.value.kind == "config"


def test_arrays_of_a_wrong_shape_are_an_error(arm, run):
    with pytest.raises(rivet.Error, match=r"tau of arrays: shape .* it must be \(samples, joints\)"):
        rivet.identify(arm, (run.log.time, run.log.q, run.log.tau[:-1]))


def test_log_of_another_arm_is_an_error(ur10e, run):
    with pytest.raises(rivet.Error, match="joints") as caught:
        rivet.identify(ur10e, run.log)
    assert caught.value.kind == "data"


def test_finding_about_a_log_is_a_warning(arm, run):
    broken = run.log.q.copy()
    broken[1000:1003] = np.nan
    log = rivet.Log(run.log.time, broken, run.log.tau, run.log.q_des, run.log.qd_des, run.log.qdd_des, name="broken")
    for _ in range(2):  # in each call anew
        with pytest.warns(rivet.LogWarning, match="broken"):
            assert rivet.identify(arm, log).notes


def test_panic_is_an_exception(capfd):
    with pytest.raises(rivet.InternalError, match="panics on request"):
        rivet._native.panic_on_request()
    assert rivet.__version__


# Threads and signals


def test_other_threads_go_on_during_the_work(arm, run):
    counts, done = [], threading.Event()

    def count():
        while not done.is_set():
            counts.append(time.monotonic())
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    begin = time.monotonic()
    rivet.identify(arm, [run.log])
    end = time.monotonic()
    done.set()
    thread.join()
    during = [at for at in counts if begin < at < end]
    # With the lock held for the whole call there would be none.
    assert len(during) > 0.05 * (end - begin) / 0.001


def test_progress_grows_and_its_exception_ends_the_work(arm, run, other):
    reports = []
    rivet.diagnose(arm, [run.log, other.log], progress=lambda what, share: reports.append((what, share)))
    shares = [share for what, share in reports if what == "diagnosing"]
    assert shares and shares == sorted(shares) and shares[-1] <= 1.0

    def stop(what, share):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        rivet.diagnose(arm, [run.log, other.log], progress=stop)


def test_interrupt_ends_the_work(ur10e):
    # A test run in the background has no SIGINT; a terminal's program has.
    program = f"""
import signal
import rivet
signal.signal(signal.SIGINT, signal.default_int_handler)
runs = [rivet.simulate({str(ur10e)!r}, 60.0, seed=seed, payload=3.0).log for seed in (5, 6)]
print("ready", flush=True)
try:
    rivet.diagnose({str(ur10e)!r}, runs)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"
        assert process.wait(60) == 0


# Figures and notebooks


def test_results_are_drawn(found, other):
    pytest.importorskip("matplotlib")
    axes = rivet.predict(found, other.log).plot(joint=0).axes[0]
    assert [line.get_label() for line in axes.lines] == ["measured", "predicted"]
    assert len(found.plot().axes) == 1


def test_drawing_without_matplotlib_says_what_is_missing(found, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(rivet.Error, match="pip install matplotlib"):
        found.plot()


def test_results_are_shown_in_a_notebook(found):
    table = found._repr_html_()
    assert table.count("<tr>") == len(found.names) + 1
    assert all(f"<td>{name}</td>" in table for name in found.names)


# Live


def test_robot_controller_in_python_publishes_samples(arm, bus):
    with rivet.Robot(arm, **bus, publish=True) as robot:
        for k in range(20):
            robot.publish(np.full(2, 0.01 * k), np.zeros(2))
            time.sleep(0.001)
        deadline = time.monotonic() + 10.0
        while robot.counters()["sent"] < 20 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert robot.counters() == {"published": 20, "sent": 20, "lost": 0, "failed": 0}
        assert robot.health(timeout=0.05) is None and robot.wait_command() is None
        with pytest.raises(rivet.Error, match="2 joints"):
            robot.publish(np.zeros(3), np.zeros(3))


def test_live_parameters_and_health_come_from_rivetd(arm, run, programs, bus):
    daemon = subprocess.Popen(
        [programs / "rivetd", arm, "--prefix", bus["prefix"], "--root", bus["root"]], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        with rivet.Robot(arm, **bus, publish=True) as robot:
            deadline = time.monotonic() + 30.0
            while robot.health(timeout=0.1) is None and time.monotonic() < deadline:
                pass
            log = run.log
            wake = time.monotonic()
            for k in range(4000):
                robot.publish(log.q[k], log.tau[k], q_des=log.q_des[k], qd_des=log.qd_des[k], qdd_des=log.qdd_des[k])
                wake += robot.model.sample_period
                time.sleep(max(wake - time.monotonic(), 0.0))
            parameters = robot.parameters()
            assert parameters.names == robot.model.names and parameters.values.shape == parameters.std.shape
            assert np.all(np.isfinite(parameters.values)) and "active" in parameters.state
            health = robot.health()
            assert health.samples > 1000 and health.residual_rms.shape == (2,)
    finally:
        daemon.terminate()
        daemon.wait(20)


# Same code as the command line, and measured arms


def test_command_line_gives_the_same_json(arm, run, found, programs, tmp_path):
    log, result = tmp_path / "log.parquet", tmp_path / "result.json"
    run.log.save(log)
    subprocess.run([programs / "rivet", "identify", arm, log, "--json", result], check=True, capture_output=True)
    assert rivet.identify(arm, log).to_json() == result.read_text()


def test_measured_ur10e_is_predicted_on_an_unseen_motion(ur10e, measured):
    logs = measured / "ur10e_innopolis"
    found = rivet.identify(ur10e, [logs / "20_02_10-30sec_12harm.parquet", logs / "20_02_12-50sec_12harm.parquet"])
    prediction = rivet.predict(found, logs / "20_02_05-20sec_8harm.parquet")
    nominal = rivet.predict(ur10e, logs / "20_02_05-20sec_8harm.parquet")
    assert rms(prediction.error_percent) < min(20.0, rms(nominal.error_percent))
