"""Identification and sim-to-real diagnosis of geared robot arms.

    import rivet
    found = rivet.identify("robots/ur10e/robot.toml", ["a.parquet", "b.parquet"])
    print(found.names, found.values, found.std)

All quantities are SI, at the joint side of the gear. Arrays of signals are (samples, joints).
"""

from __future__ import annotations

import os
import typing
import warnings as _warnings
from pathlib import Path

import numpy as np

from . import _native
from .errors import Error, InternalError, LogWarning
from .live import ControllerHealth, Health, LiveParameters, Robot
from .logs import Log, LogLike, PathLike, as_files
from .results import (
    Cause,
    Diagnosis,
    Finding,
    Identification,
    Inspection,
    JointGap,
    Model,
    Prediction,
    Reading,
    Simulation,
    Size,
    Warned,
    entries,
)

__version__: str = _native.__version__

__all__ = [
    "Cause",
    "ControllerHealth",
    "Diagnosis",
    "Error",
    "Finding",
    "Health",
    "Identification",
    "Inspection",
    "InternalError",
    "JointGap",
    "LiveParameters",
    "Log",
    "LogWarning",
    "Model",
    "Prediction",
    "Reading",
    "Robot",
    "Simulation",
    "Size",
    "Warned",
    "diagnose",
    "identify",
    "inspect",
    "predict",
    "robot_file",
    "simulate",
]

Progress = typing.Callable[[str, float], object]


def identify(
    robot: PathLike,
    logs: LogLike | typing.Iterable[LogLike],
    *,
    held_out: LogLike | typing.Iterable[LogLike] = (),
    refine: bool = False,
    map: typing.Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identifies base parameters from logs, as `rivet identify` does.

    Args:
        robot: Robot file.
        logs: Paths, `Log` objects or tuples of arrays (time [s], q [rad], tau [N m]); one or several.
        held_out: Logs on which the result is evaluated.
        refine: Whether the method and the friction law are first chosen by cross-validation on parts of the logs.
        map: Channels of the logs as in `[log]` of the robot file, such as {"tau_sign": "-1"}.
        progress: Called with what is done and its share, 0 to 1.

    Raises:
        Error: A file cannot be used, or the logs do not determine anything.
    """
    with as_files(logs, held_out) as (paths, held_out_paths):
        native, notes = _native.identify(os.fspath(robot), paths, held_out_paths, refine, entries(map), progress)
    return Identification._of(native, _warn(notes))


def diagnose(
    robot: PathLike,
    logs: LogLike | typing.Iterable[LogLike],
    *,
    self_check: bool = False,
    map: typing.Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnoses the gap between nominal model and arm, as `rivet diagnose` does.

    Args:
        robot: Robot file with the nominal model.
        logs: Logs as of `identify`. With several logs the last is held out; a single log is cut at 60 %.
        self_check: Whether effects of graded strength are added to the logs to find what they would have shown.
        map: Channels of the logs, as of `identify`.
        progress: Called with what is done and its share, 0 to 1.

    Raises:
        Error: A file cannot be used.
    """
    with as_files(logs) as (paths,):
        native, notes = _native.diagnose(os.fspath(robot), paths, self_check, entries(map), _native.__file__, progress)
    return Diagnosis._of(native, _warn(notes))


def predict(
    model: PathLike | Model | Identification,
    log: LogLike,
    *,
    map: typing.Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> Prediction:
    """Predicts the torque of a model along a log, as `rivet predict` does.

    Args:
        model: Robot file (its identified parameters are used, else the nominal ones), `Model`, or result of `identify`.
        log: Path, `Log` or tuple of arrays (time [s], q [rad]) with or without tau [N m].
        map: Channels of the log, as of `identify`; for a robot file.
        progress: Called with what is done and its share, 0 to 1.

    Raises:
        Error: A file cannot be used.
    """
    if isinstance(model, Identification):
        model = model.model
    if not isinstance(model, Model):
        model = Model(model, map=map)
    elif map:
        raise Error("map: it belongs to the Model: rivet.Model(path, map=...)", "usage")
    with as_files(log) as ((path,),):
        parts, notes = _native.predict(model._native, path, progress)
    return Prediction._of(parts, _warn(notes))


def inspect(
    recording: LogLike,
    robot: PathLike | None = None,
    *,
    map: typing.Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> Inspection:
    """Shows what a recording holds and how it would be read, as `rivet inspect` does.

    Args:
        recording: MCAP, rosbag2 folder, LeRobot folder, Parquet, HDF5, NPZ or text table; or arrays.
        robot: URDF or robot file: joints are matched by name, and the readings of the log are compared.
        map: Channels of the log, as of `identify`.
        progress: Called with what is done and its share, 0 to 1.

    Raises:
        Error: The file cannot be opened. A recording that does not fit has a `refusal`.
    """
    with as_files(recording) as ((path,),):
        native, notes = _native.inspect(path, None if robot is None else os.fspath(robot), entries(map), progress)
    return Inspection._of(native, _warn(notes))


def robot_file(
    urdf: PathLike,
    logs: LogLike | typing.Iterable[LogLike] = (),
    *,
    output: PathLike = "robot.toml",
    gravity: typing.Sequence[float] = (0.0, 0.0, -9.81),
) -> list[str]:
    """Writes a robot file from a URDF and logs, as `rivet new` does. Replaces a file of that name.

    Args:
        urdf: URDF of the arm.
        logs: Logs as of `identify`: sample rate, encoder step and largest torques are taken from them.
        output: File to write.
        gravity: In base axes, (3,) [m/s^2].

    Returns:
        What is unknown; the file marks it.
    """
    folder = Path(output).resolve().parent
    with as_files(logs) as (paths,):
        text, unknown = _native.robot_file(os.fspath(urdf), paths, [float(g) for g in gravity], str(folder))
    Path(output).write_text(text)
    return unknown


def simulate(
    robot: PathLike,
    seconds: float = 20.0,
    *,
    seed: int = 1,
    motion: str = "fourier",
    speed: float = 0.5,
    noise: float = 1.0,
    bodies: float = 1.0,
    rotor_inertia: float = 1.0,
    friction: float = 1.0,
    payload: float | None = None,
    payload_com: typing.Sequence[float] = (0.0, 0.0, 0.1),
) -> Simulation:
    """Simulates a robot under computed torque of its nominal model, with encoder steps and torque noise of the robot file.

    Args:
        robot: Robot file.
        seconds: Length [s].
        seed: Decides motion and noise.
        motion: "fourier", "point-to-point", "paper", "single-joint" or "standstill".
        speed: Share of the arm's speed limits that the motion may use, 0 to 1.
        noise: Factor on the measurement noise of the robot file.
        bodies: Factor on mass, first moment and inertia of every true body.
        rotor_inertia: Factor on every true rotor inertia.
        friction: Factor on all true friction.
        payload: Mass of a ball that the last link carries [kg].
        payload_com: Its centre in the frame of the last joint, (3,) [m].
    """
    load = None if payload is None else (float(payload), [float(x) for x in payload_com])
    factors = [float(bodies), float(rotor_inertia), float(friction)]
    parts = _native.simulate(os.fspath(robot), float(seconds), seed, motion, float(speed), float(noise), factors, load)
    signals = {name: parts[name] for name in ("q", "tau", "q_des", "qd_des", "qdd_des")}
    log = Log(time=parts["time"], name=f"{motion}-{seed}", **signals)
    return Simulation(log=log, base=parts["base"], standard=parts["standard"])


def _warn(notes: list[str]) -> list[str]:
    """Issues each note as a warning at the caller of the package; returns the notes as lines."""
    lines = [" ".join(note.split()).removeprefix("rivet: ").removeprefix("warning: ") for note in notes]
    for line in lines:
        _warnings.warn(line, LogWarning, stacklevel=3)
    return lines
