"""Logs as paths or as numpy arrays."""

from __future__ import annotations

import contextlib
import os
import tempfile
import typing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import _native
from .errors import Error

PathLike = typing.Union[str, "os.PathLike[str]"]


@dataclass(frozen=True, eq=False)
class Log:
    """Signals of one run as arrays, in SI units at the joint side of the gear.

    Attributes:
        time: (samples,), increasing [s].
        q: Measured joint positions, (samples, joints) [rad].
        tau: Measured joint torques, (samples, joints) [N m]; None for a log that is only predicted.
        q_des: Desired positions, (samples, joints) [rad].
        qd_des: Desired velocities, (samples, joints) [rad/s].
        qdd_des: Desired accelerations, (samples, joints) [rad/s^2].
        temperature: Motor temperatures, (samples, joints) [degC].
        name: Name of the run in reports.
    """

    time: np.ndarray
    q: np.ndarray
    tau: np.ndarray | None = None
    q_des: np.ndarray | None = None
    qd_des: np.ndarray | None = None
    qdd_des: np.ndarray | None = None
    temperature: np.ndarray | None = None
    name: str = "arrays"

    def __post_init__(self) -> None:
        time = np.asarray(self.time, dtype=float)
        if time.ndim != 1:
            raise Error(f"time of {self.name}: shape {time.shape}; it must be (samples,)", "data")
        object.__setattr__(self, "time", time)
        joints = None
        for signal in _SIGNALS:
            value = getattr(self, signal)
            if value is None:
                continue
            value = np.asarray(value, dtype=float)
            if value.ndim == 1:
                value = value[:, np.newaxis]
            joints = value.shape[-1] if joints is None else joints
            expected = (time.size, joints)
            if value.shape != expected:
                raise Error(f"{signal} of {self.name}: shape {value.shape}; it must be (samples, joints) = {expected}", "data")
            object.__setattr__(self, signal, value)

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    def save(self, path: PathLike) -> None:
        """Writes the log as Parquet, with the columns of docs/logs.md."""
        signals = {name: getattr(self, name) for name in _SIGNALS if getattr(self, name) is not None}
        _native.write_log(os.fspath(path), np.ascontiguousarray(self.time), signals)

    def __getitem__(self, rows: slice) -> Log:
        """The log of a slice of its samples."""
        cut = {name: getattr(self, name)[rows] for name in _SIGNALS if getattr(self, name) is not None}
        return Log(time=self.time[rows], name=self.name, **cut)


_SIGNALS = ("q", "tau", "q_des", "qd_des", "qdd_des", "temperature")

LogLike = typing.Union[PathLike, Log, typing.Sequence[np.ndarray]]


def is_one(log: object) -> bool:
    """Whether the argument is one log and no list of logs. A tuple of arrays (time, q, tau) is one."""
    return isinstance(log, (str, os.PathLike, Log)) or (
        isinstance(log, tuple) and len(log) > 0 and all(isinstance(part, np.ndarray) for part in log)
    )


def _listed(group: LogLike | typing.Iterable[LogLike]) -> list[LogLike]:
    """The logs of an argument that is one log or several."""
    if is_one(group):
        return [typing.cast(LogLike, group)]
    return list(typing.cast("typing.Iterable[LogLike]", group))


@contextlib.contextmanager
def as_files(*groups: LogLike | typing.Iterable[LogLike]) -> typing.Iterator[list[list[str]]]:
    """Paths of each group of logs. Arrays are stored as Parquet while the context lasts: every log passes the same checks."""
    with contextlib.ExitStack() as stack:
        folder: Path | None = None
        names: set[str] = set()

        def path_of(log: LogLike) -> str:
            nonlocal folder
            if isinstance(log, (str, os.PathLike)):
                return os.fspath(log)
            if not isinstance(log, Log):
                if not 2 <= len(log) <= 3:
                    raise Error(f"a log of {len(log)} arrays; it must be (time, q) or (time, q, tau), or a rivet.Log", "usage")
                log = Log(log[0], log[1], log[2] if len(log) == 3 else None)
            if folder is None:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rivet-")))
            stem = "".join(c if c.isalnum() or c in "-_. " else "_" for c in log.name) or "arrays"
            name, count = stem, 1
            while name in names:
                count += 1
                name = f"{stem}-{count}"
            names.add(name)
            path = folder / name
            log.save(path)
            return str(path)

        yield [[path_of(log) for log in _listed(group)] for group in groups]
