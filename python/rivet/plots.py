"""Figures of the results. Needs matplotlib."""

from __future__ import annotations

import typing

import numpy as np

from .errors import Error

if typing.TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .results import Diagnosis, Identification, Inspection, Prediction


def _subplots(rows: int, height: float) -> tuple[Figure, list[Axes]]:
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as why:
        raise Error("plot() needs matplotlib: pip install matplotlib", "usage") from why
    # No pyplot: a figure belongs to who asked for it, and nothing has to be closed.
    figure = Figure(figsize=(9.0, 1.0 + height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(np.atleast_1d(figure.subplots(rows, 1, squeeze=False)[:, 0]))


def identification(found: Identification) -> Figure:
    """Identified parameters minus nominal ones, with two standard deviations, each over its standard deviation."""
    figure, (axes,) = _subplots(1, 0.25 * len(found.names) + 1.0)
    rows = np.arange(len(found.names))
    std = np.where(found.std > 0.0, found.std, np.nan)
    axes.errorbar((found.values - found.nominal) / std, rows, xerr=2.0 * np.isfinite(std), fmt="o", capsize=3)
    axes.axvline(0.0, color="0.5", linewidth=1.0)
    axes.set_yticks(rows, [f"{name} [{unit}]" for name, unit in zip(found.names, found.units)])
    axes.invert_yaxis()
    axes.set_xlabel("identified minus nominal value [standard deviations]; bars: two")
    axes.set_title(f"{found.robot}: base parameters")
    return figure


def prediction(found: Prediction, joint: int | str | None) -> Figure:
    """Measured and predicted torque over time."""
    if isinstance(joint, str):
        if joint not in found.joints:
            raise Error(f"joint {joint!r}: it must be one of {', '.join(found.joints)}", "usage")
        joint = found.joints.index(joint)
    joints = range(len(found.joints)) if joint is None else [joint]
    figure, all_axes = _subplots(len(joints), 1.6)
    for axes, j in zip(all_axes, joints):
        if found.measured is not None:
            axes.plot(found.time, found.measured[:, j], color="0.6", linewidth=1.0, label="measured")
        axes.plot(found.time, found.predicted[:, j], color="C0", linewidth=1.0, label="predicted")
        axes.set_ylabel(f"{found.joints[j]} [N m]")
    all_axes[0].legend(loc="upper right")
    all_axes[0].set_title(f"{found.robot}: torque along {found.log}")
    all_axes[-1].set_xlabel("time [s]")
    return figure


def diagnosis(found: Diagnosis) -> Figure:
    """Gap of each joint with the nominal model, with all causes, and its noise floor."""
    figure, (axes,) = _subplots(1, 3.5)
    at = np.arange(len(found.per_joint))
    for k, (label, values) in enumerate(
        [
            ("nominal model", [j.before for j in found.per_joint]),
            ("with causes", [j.after for j in found.per_joint]),
            ("noise floor", [j.noise_floor for j in found.per_joint]),
        ]
    ):
        axes.bar(at + 0.27 * (k - 1), 100.0 * np.array(values, dtype=float), 0.25, label=label)
    axes.set_xticks(at, [j.joint for j in found.per_joint], rotation=20, ha="right")
    axes.set_ylabel("gap on the held-out log [% of torque]")
    axes.set_title(f"{found.robot}: {found.verdict}; {', '.join(found.effects) or 'no cause'}")
    axes.legend()
    return figure


def inspection(found: Inspection) -> Figure:
    """Positions and torques over time."""
    if found.time is None or found.q is None:
        raise Error(f"{found.recording} is not usable: {found.refusal}", "data")
    figure, all_axes = _subplots(1 if found.tau is None else 2, 2.5)
    lines = all_axes[0].plot(found.time, found.q, linewidth=1.0)
    all_axes[0].legend(lines, found.joints, loc="upper right", fontsize="small")
    all_axes[0].set_ylabel("position [rad]")
    if found.tau is not None:
        all_axes[1].plot(found.time, found.tau, linewidth=1.0)
        all_axes[1].set_ylabel("torque [N m]")
    all_axes[-1].set_xlabel("time [s]")
    return figure
