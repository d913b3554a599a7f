"""A robot on the bus: live parameters and health; samples and torque for a robot controller in Python."""

from __future__ import annotations

import os
import time
import typing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import _native
from .errors import Error
from .logs import PathLike
from .results import Model, _figures, _table

#: Robot files and buses of installed services.
_INSTALLED = Path("/etc/rivet")
_RUNNING = Path("/run/rivet")
#: Time between two looks at the bus [s].
_LOOK = 0.01


@dataclass(frozen=True, repr=False, eq=False)
class LiveParameters:
    """One parameter set of rivetd.

    Attributes:
        epoch: Number of the set, from 1.
        sequence: Number of the last sample that went in.
        stamp: Time of the estimate, CLOCK_MONOTONIC [s].
        names: Names of the base parameters; "parameter 1" and so on without the robot file.
        units: Their units; empty strings without the robot file.
        values: (parameters,), in `units`.
        std: Standard deviations, (parameters,), in `units`.
        excitation: Share of each variance that the window removed, (parameters,), 0 to 1.
        least_squares: The same parameters by least squares, (parameters,), in `units`.
        state: "active", "held" or "unidentified" for each parameter.
        residual_rms: RMS torque residual of each joint over the window, (joints,) [N m].
        torque_noise: Standard deviation of the torque noise of each joint, (joints,) [N m].
        instruments: Source of the instruments.
        flags: "suspended", "frozen", "provisional", "bad input", "late".
    """

    epoch: int
    sequence: int
    stamp: float
    names: list[str]
    units: list[str]
    values: np.ndarray
    std: np.ndarray
    excitation: np.ndarray
    least_squares: np.ndarray
    state: list[str]
    residual_rms: np.ndarray
    torque_noise: np.ndarray
    instruments: str
    flags: list[str]

    def value(self, name: str) -> tuple[float, float]:
        """Value and standard deviation of a parameter, in its unit."""
        at = self.names.index(name)
        return float(self.values[at]), float(self.std[at])

    def __repr__(self) -> str:
        active = self.state.count("active")
        return f"rivet.LiveParameters(epoch {self.epoch}, {len(self.names)} parameters, {active} active)"

    def _repr_html_(self) -> str:
        columns = zip(self.names, self.values, self.std, self.units, self.state)
        rows = [(n, _figures(v), _figures(s), u, state) for n, v, s, u, state in columns]
        return _table(["parameter", "value", "std", "unit", "state"], rows)


@dataclass(frozen=True, eq=False)
class Health:
    """State of rivetd.

    Attributes:
        mode: "estimating", "suspended", "frozen", "bad input" and so on.
        stamp: Time of the report, CLOCK_MONOTONIC [s].
        samples: Samples used.
        lost: Samples lost on the way.
        gaps: Gaps in the sequence.
        overruns: Missed periods.
        active: Directions of the parameter space that follow the data.
        held: Directions that are held.
        instruments: Source of the instruments.
        input_fault: Present fault of the input; None without one.
        residual_rms: RMS torque residual, (joints,) [N m].
        nominal_residual_rms: The same of the nominal model, (joints,) [N m].
        torque_rms: RMS torque, (joints,) [N m].
        worst_wake: Largest wake-up latency [s].
        worst_work: Longest work of a period [s].
        window: Length of the window [s].
        bias_p_value: p-value of the test of least squares for bias.
    """

    mode: str
    stamp: float
    samples: int
    lost: int
    gaps: int
    overruns: int
    active: int
    held: int
    instruments: str
    input_fault: str | None
    residual_rms: np.ndarray
    nominal_residual_rms: np.ndarray
    torque_rms: np.ndarray
    worst_wake: float
    worst_work: float
    window: float
    bias_p_value: float


@dataclass(frozen=True)
class ControllerHealth:
    """State of rivet-controller.

    Attributes:
        state: What it does.
        stamp: Time of the report, CLOCK_MONOTONIC [s].
        commands: Commands written.
        parameter_source: "live", "last good" or "nominal".
        stops: Stops so far.
        stop_cause: Cause of the last stop, such as "too fast"; None before the first.
        stop_joints: Joints that it names, from 0 at the base.
    """

    state: str
    stamp: float
    commands: int
    parameter_source: str
    stops: int
    stop_cause: str | None
    stop_joints: list[int]


class Robot:
    """A robot on the bus.

        robot = rivet.Robot("ur10e")
        print(robot.health(), robot.parameters())
        for parameters in robot:
            print(parameters.values)

    Args:
        robot: Name of an installed robot (/etc/rivet/NAME/robot.toml), path of a robot file, or a `rivet.Model`. A name without a file
            gives parameters without names and units.
        prefix: Prefix of the bus; default: rivet_.
        root: Root directory of the bus; default: that of the installed service, else /tmp/rivet.
        publish: Whether this program is the robot controller: it calls `publish` once a period. Needs the robot file.

    Raises:
        Error: The robot file is wrong, or the bus cannot be opened.
    """

    def __init__(
        self,
        robot: PathLike | Model,
        *,
        prefix: str | None = None,
        root: PathLike | None = None,
        publish: bool = False,
    ) -> None:
        self.model, name, running = _found(robot)
        joints = len(self.model.joints) if self.model else 0
        if publish and not self.model:
            raise Error(f"publish: no robot file of {name}; give its path", "usage")
        if root is None and running is not None:
            root = running
        self.name = name
        self._joints = joints
        self._bus = _native.Bus(name, joints if publish else 0, prefix, None if root is None else os.fspath(root))

    def parameters(self, timeout: float = 2.0) -> LiveParameters | None:
        """The latest parameter set; None without one after `timeout` [s]."""
        parts = _waited(self._bus.parameters, timeout)
        return None if parts is None else self._set(parts)

    def health(self, timeout: float = 2.0) -> Health | None:
        """The latest health of rivetd; None without one after `timeout` [s]."""
        parts = _waited(self._bus.health, timeout)
        if parts is None:
            return None
        joints = self._joints or len(parts["residual_rms"])
        for name in ("residual_rms", "nominal_residual_rms", "torque_rms"):
            parts[name] = parts[name][:joints]
        renamed = {"worst_wake_s": "worst_wake", "worst_work_s": "worst_work", "window_s": "window"}
        parts = {renamed.get(name, name): value for name, value in parts.items()}
        return Health(stamp=parts.pop("stamp_ns") * 1e-9, **parts)

    def controller_health(self, timeout: float = 2.0) -> ControllerHealth | None:
        """The latest health of rivet-controller; None without one after `timeout` [s]."""
        parts = _waited(self._bus.controller_health, timeout)
        return None if parts is None else ControllerHealth(stamp=parts.pop("stamp_ns") * 1e-9, **parts)

    def stream(self, timeout: float = 5.0) -> typing.Iterator[LiveParameters]:
        """Yields each new parameter set; ends when none comes for `timeout` [s]. A slow reader gets the newest set only."""
        last, since = None, time.monotonic()
        while time.monotonic() - since < timeout:
            parts = self._bus.parameters()
            key = None if parts is None else (parts["epoch"], parts["stamp_ns"])
            if parts is None or key == last:
                time.sleep(_LOOK)
                continue
            last, since = key, time.monotonic()
            yield self._set(parts)

    def __iter__(self) -> typing.Iterator[LiveParameters]:
        return self.stream()

    def publish(
        self,
        q: np.ndarray,
        tau: np.ndarray,
        *,
        q_des: np.ndarray | None = None,
        qd_des: np.ndarray | None = None,
        qdd_des: np.ndarray | None = None,
        stamp_ns: int = 0,
        faults: int = 0,
    ) -> None:
        """Publishes the sample of one period.

        Args:
            q: Measured positions, (joints,) [rad].
            tau: Measured torques at the joint side of the gear, (joints,) [N m].
            q_des, qd_des, qdd_des: Planned motion, (joints,) [rad], [rad/s], [rad/s^2]; all or none.
            stamp_ns: When the encoders were latched, CLOCK_MONOTONIC [ns]; 0: now.
            faults: Fault bits; 0: every field may be used.

        Raises:
            Error: The sample is lost, or the robot was not opened with publish=True.
        """
        planned = [part for part in (q_des, qd_des, qdd_des) if part is not None]
        if len(planned) not in (0, 3):
            raise Error("planned motion: q_des, qd_des and qdd_des are needed, all or none", "usage")
        arrays = [np.ascontiguousarray(part, dtype=float) for part in (q, tau, *planned)]
        self._bus.publish(arrays[0], arrays[1], arrays[2:] if planned else None, stamp_ns, faults)

    def wait_command(self, timeout: float = 0.0005) -> np.ndarray | None:
        """Torque that answers the last sample, (joints,) [N m], waited for at most `timeout` [s]; None without an answer."""
        answer = self._bus.wait_command(timeout)
        return None if answer is None or answer[1] == 0 else answer[0]

    def counters(self) -> dict[str, int]:
        """How many samples were published, sent to the bus, lost because the queue was full, and not accepted by the bus."""
        return dict(zip(("published", "sent", "lost", "failed"), self._bus.counters()))

    def close(self) -> None:
        """Sends what is queued and leaves the bus."""
        self._bus.close()

    def __enter__(self) -> Robot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"rivet.Robot({self.name!r})"

    def _set(self, parts: dict[str, typing.Any]) -> LiveParameters:
        model = self.model
        # Another model's numbers mean something else.
        if model is not None and parts["model_hash"] != model._native.model_hash:
            model = None
        parts = {k: v for k, v in parts.items() if k not in ("model_hash", "sample_period")}
        count = len(parts["values"])
        names = model.names if model else [f"parameter {i + 1}" for i in range(count)]
        units = model.units if model else [""] * count
        return LiveParameters(stamp=parts.pop("stamp_ns") * 1e-9, names=names, units=units, **parts)


def _found(robot: PathLike | Model) -> tuple[Model | None, str, Path | None]:
    """Model, name and root directory of the bus of a robot."""
    if isinstance(robot, Model):
        return robot, robot.name, None
    text = os.fspath(robot)
    is_path = text.endswith(".toml") or os.sep in text
    if is_path:
        model = Model(text)
        return model, model.name, None
    installed = _INSTALLED / text / "robot.toml"
    if installed.is_file():
        model = Model(installed)
        return model, model.name, _RUNNING / text
    return None, text, None


def _waited(look: typing.Callable[[], dict[str, typing.Any] | None], timeout: float) -> dict[str, typing.Any] | None:
    end = time.monotonic() + timeout
    while (parts := look()) is None and time.monotonic() < end:
        time.sleep(_LOOK)
    return parts
