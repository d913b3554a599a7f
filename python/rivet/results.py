"""Results of the analyses: numpy arrays with names and units."""

from __future__ import annotations

import html
import json
import math
import os
import typing
from dataclasses import dataclass, field

import numpy as np

from . import _native
from .logs import PathLike

if typing.TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ._native import Diagnosis as NativeDiagnosis
    from ._native import Identification as NativeIdentification


def _number(value: float | None) -> float:
    """JSON has null where a number is not known."""
    return math.nan if value is None else float(value)


def _table(head: typing.Sequence[str], rows: typing.Iterable[typing.Sequence[object]]) -> str:
    """An HTML table."""
    cells = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>"


def _figures(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g}"


class _Report:
    """A result with the text and the JSON of the command line."""

    _text: str
    _json: str

    def __str__(self) -> str:
        """The report as the command line prints it."""
        return self._text

    def to_json(self) -> str:
        """The JSON that the command line writes."""
        return self._json

    def to_dict(self) -> dict[str, typing.Any]:
        """The JSON that the command line writes, as Python objects."""
        return json.loads(self._json)


class Model:
    """A robot with the base parameters that predictions use.

    Args:
        path: Robot file (robot.toml, or a model.toml that `Identification.export` wrote).
        map: Channels of its logs as in `[log]` of the robot file, such as {"tau_sign": "-1"}.
    """

    def __init__(self, path: PathLike, *, map: typing.Mapping[str, str] | None = None) -> None:
        self._native = _native.Model(os.fspath(path), entries(map))

    @classmethod
    def _of(cls, native: _native.Model) -> Model:
        model = cls.__new__(cls)
        model._native = native
        return model

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self._native.name

    @property
    def joints(self) -> list[str]:
        """Joint names, base to flange."""
        return self._native.joints

    @property
    def sample_period(self) -> float:
        """Sample period of the robot [s]."""
        return self._native.sample_period

    @property
    def is_identified(self) -> bool:
        """Whether the parameters are identified; else they are nominal."""
        return self._native.is_identified

    @property
    def names(self) -> list[str]:
        """Names of the base parameters."""
        return self._native.names

    @property
    def units(self) -> list[str]:
        """Units of the base parameters."""
        return self._native.units

    @property
    def values(self) -> np.ndarray:
        """Base parameters that predictions use, (parameters,), in `units`."""
        return self._native.values

    @property
    def nominal(self) -> np.ndarray:
        """Nominal base parameters, (parameters,), in `units`."""
        return self._native.nominal

    def with_values(self, values: np.ndarray) -> Model:
        """The model with other base parameters, (parameters,), in `units`."""
        return Model._of(self._native.with_values([float(value) for value in values]))

    def __str__(self) -> str:
        """The resolved robot file."""
        return self._native.text()

    def __repr__(self) -> str:
        kind = "identified" if self.is_identified else "nominal"
        return f"rivet.Model({self.name!r}, {len(self.joints)} joints, {len(self.names)} {kind} base parameters)"


@dataclass(frozen=True)
class Warned:
    """A warning of an identification.

    Attributes:
        name: Identifier, such as "torque_sign".
        joint: Joint that it is about; None for a whole log.
        log: Log that it is about; None for all.
        text: The warning in words.
    """

    name: str
    joint: str | None
    log: str | None
    text: str


@dataclass(frozen=True, repr=False, eq=False)
class Identification(_Report):
    """Identified base parameters.

    Attributes:
        robot: Name of the robot.
        joints: Joint names, base to flange.
        names: Names of the base parameters, (parameters,).
        units: Their units.
        values: Values, (parameters,), in `units`.
        std: Standard deviations, (parameters,), in `units`; nan for a parameter that a bound holds.
        nominal: Nominal values, (parameters,), in `units`.
        least_squares: Values by least squares, (parameters,), in `units`.
        instrumental: Values by instrumental variables, (parameters,), in `units`.
        decided_by: "data", "prior" or "bound" for each parameter.
        covariance: Covariance of the values, (parameters, parameters), in products of `units`.
        residual_percent: Residual 100*|tau - D x|/|tau| per joint, (joints,) [%].
        nominal_residual_percent: The same of the nominal model, (joints,) [%].
        torque_noise: Standard deviation of the torque noise below the model filter, (joints,) [N m].
        condition: Condition number of the equations.
        warnings: Findings about logs and result.
        notes: Notes of the analysis.
    """

    robot: str
    joints: list[str]
    names: list[str]
    units: list[str]
    values: np.ndarray
    std: np.ndarray
    nominal: np.ndarray
    least_squares: np.ndarray
    instrumental: np.ndarray
    decided_by: list[str]
    covariance: np.ndarray
    residual_percent: np.ndarray
    nominal_residual_percent: np.ndarray
    torque_noise: np.ndarray
    condition: float
    warnings: list[Warned]
    notes: list[str]
    _native: NativeIdentification
    _text: str
    _json: str

    @classmethod
    def _of(cls, native: NativeIdentification, notes: list[str]) -> Identification:
        text = native.json()
        document = json.loads(text)
        parameters, joints = document["parameters"], document["joints"]

        def column(key: str) -> np.ndarray:
            return np.array([_number(parameter[key]) for parameter in parameters])

        def residual(key: str) -> np.ndarray:
            return np.array([_number(joint["residual_percent"][key]) for joint in joints])

        std = np.where([parameter["std"] is None for parameter in parameters], np.nan, native.std)
        return cls(
            robot=document["robot"],
            joints=[joint["joint"] for joint in joints],
            names=[parameter["name"] for parameter in parameters],
            units=[parameter["unit"] for parameter in parameters],
            values=native.values,
            std=std,
            nominal=column("nominal"),
            least_squares=column("least_squares"),
            instrumental=column("instrumental"),
            decided_by=[parameter["decided_by"] for parameter in parameters],
            covariance=native.covariance,
            residual_percent=residual(document["estimator"]),
            nominal_residual_percent=residual("nominal"),
            torque_noise=np.array([_number(joint["noise"]) for joint in joints]),
            condition=_number(document["condition"]),
            warnings=[Warned(w["name"], w["joint"], w["log"], w["text"]) for w in document["warnings"]],
            notes=notes,
            _native=native,
            _text=native.text(),
            _json=text,
        )

    @property
    def model(self) -> Model:
        """The robot with the identified parameters that `export` writes."""
        return Model._of(self._native.model())

    def export(self, folder: PathLike) -> None:
        """Writes model.toml, robot.urdf and not-expressible.md into a folder."""
        self._native.export(os.fspath(folder))

    def value(self, name: str) -> tuple[float, float]:
        """Value and standard deviation of a parameter, in its unit."""
        at = self.names.index(name)
        return float(self.values[at]), float(self.std[at])

    def plot(self) -> Figure:
        """Identified and nominal parameters with two standard deviations. Needs matplotlib."""
        from .plots import identification

        return identification(self)

    def __repr__(self) -> str:
        rms = float(np.sqrt(np.nanmean(self.residual_percent**2)))
        return f"rivet.Identification({self.robot!r}, {len(self.names)} parameters, residual {rms:.1f} % rms over joints)"

    def _repr_html_(self) -> str:
        head = ["parameter", "value", "std", "nominal", "unit", "decided by"]
        columns = zip(self.names, self.values, self.std, self.nominal, self.units, self.decided_by)
        rows = [(n, _figures(v), _figures(s), _figures(o), u, d) for n, v, s, o, u, d in columns]
        return f"<p>{html.escape(repr(self))}</p>" + _table(head, rows)


@dataclass(frozen=True, repr=False, eq=False)
class Prediction:
    """Torque of a model along a log, on the rows of the log.

    Attributes:
        robot: Name of the robot.
        joints: Joint names, base to flange.
        log: Name of the log.
        time: (samples,) [s].
        predicted: Torque of the model, (samples, joints) [N m].
        measured: Measured torque, (samples, joints) [N m]; nan on rows that were not used; None of a log without torque.
        error_percent: 100*|tau - tau_pred|/|tau| below the model filter's cut-off, (joints,) [%]; None without torque.
        error_percent_raw: The same as logged, (joints,) [%].
        is_identified: Whether the parameters are identified; else they are nominal.
        notes: Notes of the analysis.
    """

    robot: str
    joints: list[str]
    log: str
    time: np.ndarray
    predicted: np.ndarray
    measured: np.ndarray | None
    error_percent: np.ndarray | None
    error_percent_raw: np.ndarray | None
    is_identified: bool
    notes: list[str]
    _text: str

    @classmethod
    def _of(cls, parts: dict[str, typing.Any], notes: list[str]) -> Prediction:
        raw, filtered = parts["errors_percent"] or (None, None)
        return cls(
            robot=parts["robot"],
            joints=parts["joints"],
            log=parts["log"],
            time=parts["time"],
            predicted=parts["predicted"],
            measured=parts["measured"],
            error_percent=filtered,
            error_percent_raw=raw,
            is_identified=parts["is_identified"],
            notes=notes,
            _text=parts["text"],
        )

    @property
    def residual(self) -> np.ndarray:
        """Measured minus predicted torque, (samples, joints) [N m]; nan without measured torque."""
        return np.full_like(self.predicted, np.nan) if self.measured is None else self.measured - self.predicted

    def save(self, path: PathLike) -> None:
        """Writes the columns t and tau_pred1..N as Parquet, as `rivet predict --out` does."""
        _native.write_log(os.fspath(path), self.time, {"tau_pred": self.predicted})

    def to_dict(self) -> dict[str, typing.Any]:
        """Everything as Python objects without arrays; nan is None."""

        def plain(array: np.ndarray | None) -> typing.Any:
            if array is None:
                return None
            objects = array.astype(object)
            objects[np.isnan(array)] = None
            return objects.tolist()

        return {
            "robot": self.robot,
            "log": self.log,
            "joints": self.joints,
            "is_identified": self.is_identified,
            "t": plain(self.time),
            "tau_pred": plain(self.predicted),
            "tau": plain(self.measured),
            "error_percent": plain(self.error_percent),
            "error_percent_raw": plain(self.error_percent_raw),
        }

    def plot(self, joint: int | str | None = None) -> Figure:
        """Measured and predicted torque of a joint (index from 0, or name), or of all. Needs matplotlib."""
        from .plots import prediction

        return prediction(self, joint)

    def __str__(self) -> str:
        """The report as the command line prints it."""
        return self._text

    def __repr__(self) -> str:
        return f"rivet.Prediction({self.robot!r} along {self.log!r}, {self.time.size} samples, {len(self.joints)} joints)"

    def _repr_html_(self) -> str:
        errors = [math.nan] * len(self.joints) if self.error_percent is None else self.error_percent
        return f"<p>{html.escape(repr(self))}</p>" + _table(
            ["joint", "error below the model filter %"], [(name, _figures(e)) for name, e in zip(self.joints, errors)]
        )


@dataclass(frozen=True)
class Size:
    """One figure of the size of a cause.

    Attributes:
        name: Quantity without its unit, such as "velocity".
        value: In `unit`; nan where it is not known.
        unit: SI unit; empty for a ratio.
    """

    name: str
    value: float
    unit: str


#: Units at the end of the names in `magnitude` of the JSON, such as `viscous_Nms_rad_K` (docs/diagnosis-json.md).
_UNITS = {
    "Nm": "N m",
    "Nm2": "N m^2",
    "Nms": "N m s",
    "Nms2": "N m s^2",
    "Nms3": "N m s^3",
    "kg": "kg",
    "kgm": "kg m",
    "kgm2": "kg m^2",
    "rad": "rad",
    "rad2": "rad^2",
    "rad3": "rad^3",
    "m": "m",
    "s": "s",
    "s2": "s^2",
    "K": "K",
    "hz": "Hz",
    "deg": "deg",
    "percent": "%",
}


def _size(key: str, value: float | None) -> Size:
    parts = key.split("_")
    first = len(parts)
    while first > 1 and parts[first - 1] in _UNITS:
        first -= 1
    units = [_UNITS[part] for part in parts[first:]]
    if parts[first - 1] == "per" and units:
        first, units = first - 1, ["1", *units]
    below = " ".join(units[1:])
    unit = "/".join(filter(None, [units[0], f"({below})" if len(units) > 2 else below])) if units else ""
    return Size("_".join(parts[:first]), _number(value), unit)


@dataclass(frozen=True)
class Cause:
    """A cause of the gap between nominal model and arm.

    Attributes:
        effect: Name of the effect (docs/effects).
        joints: Joints that have it; empty for an effect of the whole arm.
        sizes: Its size, one entry a figure.
        shrink: Predicted shrink of the gap, 1 - after/before, 0 to 1.
        interval: 90 % interval of the shrink.
        measured: Shrink measured on the held-out log.
        share: Share of the squared gap on the training logs, 0 to 1.
        confidence: 0 to 1.
        confounded_with: Effects that these logs do not separate from it.
        separating_motion: Motion that would separate them; None where none is known.
    """

    effect: str
    joints: list[str]
    sizes: list[Size]
    shrink: float
    interval: tuple[float, float]
    measured: float
    share: float
    confidence: float
    confounded_with: list[str]
    separating_motion: str | None

    @property
    def joint(self) -> str | None:
        """The joint, for a cause of exactly one."""
        return self.joints[0] if len(self.joints) == 1 else None

    @property
    def size(self) -> float:
        """Value of the first entry of `sizes`; nan without one."""
        return self.sizes[0].value if self.sizes else math.nan

    @property
    def unit(self) -> str:
        """Unit of `size`."""
        return self.sizes[0].unit if self.sizes else ""

    @classmethod
    def _of(cls, cause: dict[str, typing.Any]) -> Cause:
        shrink = cause["shrink"]
        return cls(
            effect=cause["effect"],
            joints=cause["joints"],
            sizes=[_size(key, value) for key, value in cause["magnitude"].items()],
            shrink=_number(shrink["predicted"]),
            interval=(_number(shrink["low"]), _number(shrink["high"])),
            measured=_number(shrink["measured"]),
            share=_number(cause["share"]),
            confidence=_number(cause["confidence"]),
            confounded_with=cause["indistinguishable_from"],
            separating_motion=cause.get("separating_motion"),
        )


@dataclass(frozen=True)
class JointGap:
    """Gap of one joint on the held-out log, relative to its torque.

    Attributes:
        joint: Name of the joint.
        before: |tau - tau_model|/|tau| of the nominal model.
        after: The same with all causes.
        noise_floor: Noise of the torque signal, relative to its torque.
    """

    joint: str
    before: float
    after: float
    noise_floor: float


@dataclass(frozen=True)
class Finding:
    """A finding about a log.

    Attributes:
        log: Run that it is about; empty for all.
        joint: Joint; empty for all.
        name: Identifier, such as "torque_sign".
        text: The finding in words.
    """

    log: str
    joint: str
    name: str
    text: str


@dataclass(frozen=True, repr=False, eq=False)
class Diagnosis(_Report):
    """Causes of the gap between nominal model and arm.

    Attributes:
        robot: Name of the robot.
        verdict: "no_gap", "parameter", "effect", "several", "unexplained" or "not_evaluated".
        before: Gap of the nominal model on the held-out log, all joints.
        after: Gap with all causes.
        noise_floor: Gap of the torque signal's noise.
        per_joint: Gap of each joint.
        causes: Causes in the order of adoption.
        hints: Causes that were considered and are not supported.
        findings: Findings about the logs.
        unexplained_share: Share of the squared gap above the noise floor without a cause; nan where it is not known.
        remark: Why nothing was evaluated; None otherwise.
        notes: Notes of the analysis.
    """

    robot: str
    verdict: str
    before: float
    after: float
    noise_floor: float
    per_joint: list[JointGap]
    causes: list[Cause]
    hints: list[Cause]
    findings: list[Finding]
    unexplained_share: float
    remark: str | None
    notes: list[str]
    _native: NativeDiagnosis
    _text: str
    _json: str

    @classmethod
    def _of(cls, native: NativeDiagnosis, notes: list[str]) -> Diagnosis:
        text = native.json()
        document = json.loads(text)
        gap = document["gap"]
        return cls(
            robot=document["robot"],
            verdict=document["verdict"],
            before=_number(gap["before"]),
            after=_number(gap["after"]),
            noise_floor=_number(gap["noise_floor"]),
            per_joint=[
                JointGap(j["joint"], _number(j["before"]), _number(j["after"]), _number(j["noise_floor"])) for j in gap["per_joint"]
            ],
            causes=[Cause._of(cause) for cause in document["causes"]],
            hints=[Cause._of(cause) for cause in document["hints"]],
            findings=[Finding(f["run"], f["joint"], f["fault"], f["text"]) for f in document["log"]],
            unexplained_share=_number(document["unexplained_share"]),
            remark=document["remark"],
            notes=notes,
            _native=native,
            _text=native.text(),
            _json=text,
        )

    @property
    def effects(self) -> list[str]:
        """Effects of the causes, in the order of adoption."""
        return [cause.effect for cause in self.causes]

    def export(self, folder: PathLike) -> bool:
        """Writes model.toml, robot.urdf, robot.xml and not-expressible.md into a folder.

        Returns:
            Whether there was a model to write; `notes` gets the reason.
        """
        written, notes = self._native.export(os.fspath(folder))
        self.notes.extend(" ".join(note.split()) for note in notes)
        return written

    def to_html(self) -> str:
        """The page that `rivet diagnose --html` writes, without external parts."""
        return self._native.html()

    def plot(self) -> Figure:
        """Gap of each joint with the nominal model, with all causes, and its noise floor. Needs matplotlib."""
        from .plots import diagnosis

        return diagnosis(self)

    def __repr__(self) -> str:
        causes = ", ".join(self.effects) or "no cause"
        return f"rivet.Diagnosis({self.robot!r}, {self.verdict}: {causes}; gap {self.before:.3g} -> {self.after:.3g})"

    def _repr_html_(self) -> str:
        head = ["cause", "joints", "size", "shrink", "90 %", "measured", "confidence"]
        rows = []
        for cause in self.causes:
            size = ", ".join(f"{s.name} {_figures(s.value)} {s.unit}".rstrip() for s in cause.sizes)
            interval = f"{_figures(cause.interval[0])} to {_figures(cause.interval[1])}"
            joints = ", ".join(cause.joints) or "all"
            rows.append((cause.effect, joints, size, _figures(cause.shrink), interval, _figures(cause.measured), _figures(cause.confidence)))
        return f"<p>{html.escape(repr(self))}</p>" + _table(head, rows)


@dataclass(frozen=True)
class Reading:
    """The most probable reading of a channel.

    Attributes:
        channel: "q" or "tau".
        text: "as recorded", or how the channel has to be read.
        probability: 0 to 1.
    """

    channel: str
    text: str
    probability: float


@dataclass(frozen=True, repr=False, eq=False)
class Inspection(_Report):
    """What a recording holds, and how it would be read.

    Attributes:
        recording: Path of the recording.
        format: Name of its format.
        joints: Joint names, base to flange.
        columns: Names of its columns.
        channels: Patterns of the channels that names decided, by key of `[log]`.
        rate_hz: Mean sample rate [Hz]; nan where it is not known.
        duration: From the first to the last row [s]; nan where it is not known.
        readings: How channels have to be read, where the robot was given.
        doubts: What the user has to check.
        refusal: Why it cannot be used as it is; None where it can.
        time: (samples,) [s]; None where it is refused.
        q: Positions as read, (samples, joints) [rad].
        tau: Torque as read, (samples, joints) [N m]; None without torque.
        is_doubtful: Whether the user has to check a gap, a reading or a doubt.
        notes: Notes of the analysis.
    """

    recording: str
    format: str
    joints: list[str]
    columns: list[str]
    channels: dict[str, str]
    rate_hz: float
    duration: float
    readings: list[Reading]
    doubts: list[str]
    refusal: str | None
    is_doubtful: bool
    time: np.ndarray | None
    q: np.ndarray | None
    tau: np.ndarray | None
    notes: list[str]
    _text: str
    _json: str

    @classmethod
    def _of(cls, native: _native.Inspection, notes: list[str]) -> Inspection:
        text = native.json()
        document = json.loads(text)
        time, q, tau = native.signals() or (None, None, None)
        return cls(
            recording=document["recording"],
            format=document["format"],
            joints=[joint["name"] for joint in document["joints"]],
            columns=document["columns"],
            channels={channel["key"]: channel["pattern"] for channel in document["channels"]},
            rate_hz=_number((document["time"] or {}).get("rate_hz")),
            duration=_number(document["duration_s"]),
            readings=[Reading(r["channel"], r["reading"], r["probability"]) for r in document["readings"]],
            doubts=document["doubts"],
            refusal=document["not_usable"],
            is_doubtful=native.is_doubtful,
            time=time,
            q=q,
            tau=tau,
            notes=notes,
            _text=native.text(),
            _json=text,
        )

    @property
    def is_usable(self) -> bool:
        """Whether the recording can be used as it is."""
        return self.refusal is None

    def plot(self) -> Figure:
        """Positions and torques over time. Needs matplotlib."""
        from .plots import inspection

        return inspection(self)

    def __repr__(self) -> str:
        state = "not usable" if not self.is_usable else "doubtful" if self.is_doubtful else "usable"
        return f"rivet.Inspection({os.path.basename(self.recording)!r}, {self.format}, {len(self.joints)} joints, {state})"

    def _repr_html_(self) -> str:
        rows = [("reading of " + r.channel, f"{r.text} (probability {r.probability:.2f})") for r in self.readings]
        rows += [("doubt", doubt) for doubt in self.doubts]
        rows += [("not usable", self.refusal)] if self.refusal else []
        return f"<p>{html.escape(repr(self))}</p>" + _table(["finding", "text"], rows)


@dataclass(frozen=True, repr=False, eq=False)
class Simulation:
    """A simulated log with the true parameters.

    Attributes:
        log: Signals that a robot controller would have recorded (`rivet.Log`).
        base: True base parameters by name, in the units of `Model.units`.
        standard: True standard parameters by name.
    """

    log: typing.Any
    base: dict[str, float] = field(default_factory=dict)
    standard: dict[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"rivet.Simulation({self.log.time.size} samples, {self.log.joints} joints, {len(self.base)} base parameters)"


def entries(map: typing.Mapping[str, str] | None) -> list[str]:
    """KEY=VALUE of each channel that is stated."""
    return [f"{key}={value}" for key, value in (map or {}).items()]
