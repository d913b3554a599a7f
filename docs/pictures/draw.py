#!/usr/bin/env python3
"""Draw the pictures of the manual from files that rivet wrote. Standard library only.

usage: draw.py FOLDER        (FOLDER as docs/pictures/make.sh fills it)

Every number of a picture comes from such a file. Light and dark backgrounds are both served by CSS.
"""
import json
import math
import os
import re
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
STYLE = (
    "<style>svg{background:#fff;font:12px system-ui,sans-serif}text{fill:#444}.t{font-weight:600;fill:#111}"
    ".m{text-anchor:middle}.e{text-anchor:end}.g{stroke:#ddd}.a{stroke:#666;fill:none}"
    ".c0{stroke:#1f5fbf}.c1{stroke:#c9541b}.c2{stroke:#22823f}.c5{stroke:#5b6470}polyline{fill:none;stroke-width:1.4}"
    ".d{stroke-dasharray:6 4}.f0{fill:#1f5fbf}.f1{fill:#c9541b}.f2{fill:#22823f}.f5{fill:#5b6470}"
    "@media(prefers-color-scheme:dark){svg{background:#14171b}text{fill:#b5bdc8}.t{fill:#e6e9ee}.g{stroke:#2d333b}.a{stroke:#9aa4b1}"
    ".c0{stroke:#6aa8ff}.c1{stroke:#ff9a5c}.c2{stroke:#5fd07f}.c5{stroke:#9aa4b1}"
    ".f0{fill:#6aa8ff}.f1{fill:#ff9a5c}.f2{fill:#5fd07f}.f5{fill:#9aa4b1}}</style>"
)
# Causes of less confidence illustrate nothing.
LEAST_CONFIDENCE = 0.3
# Most points of a line of the paper's figures: more cannot be seen.
MOST_POINTS = 120


def escaped(text):
    return str(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def plain(x):
    return f"{x:.4g}"


def ticks(low, high, log):
    if log:
        first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
        step = max(1, (last - first) // 5)
        return [10.0**k for k in range(first, last + 1, step) if low <= 10.0**k <= high]
    span = high - low
    step = 10 ** math.floor(math.log10(span / 4))
    step *= next(m for m in (1, 2, 5, 10) if span / (m * step) <= 5)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


class Chart:
    """Axes with lines, points, bars and a legend."""

    def __init__(self, title, x, y, xs, ys, width=640, height=300, log_y=False, x_ticks=True):
        self.box = (70, 34, width - 16, height - 70)
        self.x, self.y, self.log_y = xs, ys, log_y
        self.legend, self.parts = [], []
        left, top, right, bottom = self.box
        self.head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">{STYLE}'
        self.parts.append(f"<title>{escaped(title)}</title><text class='t' x='{left}' y='20'>{escaped(title)}</text>")
        for v in ticks(*ys, log_y):
            self.parts.append(f"<path class='g' d='M{left} {self.at_y(v):.1f}H{right}'/><text class='e' x='{left - 6}' y='{self.at_y(v) + 4:.1f}'>{plain(v)}</text>")
        for v in ticks(*xs, False) if x_ticks else []:
            self.parts.append(f"<path class='g' d='M{self.at_x(v):.1f} {top}V{bottom}'/><text class='m' x='{self.at_x(v):.1f}' y='{bottom + 16}'>{plain(v)}</text>")
        self.parts.append(f"<path class='a' d='M{left} {top}V{bottom}H{right}'/><text class='m' x='{(left + right) / 2}' y='{bottom + 34}'>{escaped(x)}</text>")
        self.parts.append(f"<text class='m' transform='translate(14 {(top + bottom) / 2}) rotate(-90)'>{escaped(y)}</text>")

    def at_x(self, v):
        left, _, right, _ = self.box
        return left + (v - self.x[0]) / (self.x[1] - self.x[0]) * (right - left)

    def at_y(self, v):
        _, top, _, bottom = self.box
        low, high = (math.log10(self.y[0]), math.log10(self.y[1])) if self.log_y else self.y
        v = math.log10(max(v, self.y[0])) if self.log_y else v
        return bottom - (v - low) / (high - low) * (bottom - top)

    def line(self, points, colour, label, dash=False):
        path = " ".join(f"{self.at_x(a):.1f},{self.at_y(b):.1f}" for a, b in points)
        self.parts.append(f"<polyline class='c{colour}{' d' if dash else ''}' points='{path}'/>")
        self.legend.append((colour, label))

    def dot(self, x, y, colour, low=None, high=None):
        if low is not None:
            self.parts.append(f"<path class='c{colour}' d='M{self.at_x(low):.1f} {self.at_y(y):.1f}H{self.at_x(high):.1f}'/>")
        self.parts.append(f"<circle class='f{colour}' cx='{self.at_x(x):.1f}' cy='{self.at_y(y):.1f}' r='3'/>")

    def bar(self, x, width, y, colour):
        _, _, _, bottom = self.box
        top, half = self.at_y(y), width / 2
        self.parts.append(f"<rect class='f{colour}' x='{self.at_x(x - half):.1f}' y='{top:.1f}' width='{self.at_x(x + half) - self.at_x(x - half):.1f}' height='{max(bottom - top, 0):.1f}'/>")

    def word(self, x, text, dy=16):
        self.parts.append(f"<text class='m' x='{self.at_x(x):.1f}' y='{self.box[3] + dy}'>{escaped(text)}</text>")

    def above(self, x, y, text):
        self.parts.append(f"<text class='m' x='{self.at_x(x):.1f}' y='{self.at_y(y) - 5:.1f}'>{escaped(text)}</text>")

    def write(self, name):
        left, _, _, bottom = self.box
        x = left
        for colour, label in self.legend:
            self.parts.append(f"<rect class='f{colour}' x='{x}' y='{bottom + 47}' width='14' height='4'/><text x='{x + 19}' y='{bottom + 54}'>{escaped(label)}</text>")
            x += 34 + 7 * len(label)
        write(name, self.head + "\n".join(self.parts) + "</svg>\n")


def write(name, text):
    path = os.path.join(HERE, name)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    print(f"{name}: {len(text)} bytes")


def span(values, room=0.06):
    low, high = min(values), max(values)
    margin = (high - low) * room or 1.0
    return low - margin, high + margin


def torque(found, name):
    """Measured torque, and that of the model before and after, of the first excerpt."""
    e = found["figures"]["excerpts"][0]
    t = [e["from_s"] + k * e["step_s"] for k in range(len(e["measured"]))]
    chart = Chart(f"{e['joint']}: torque of the held-out log", "time [s]", "torque [N m]", (t[0], t[-1]), span(e["measured"] + e["given"] + e["with_causes"]))
    for key, colour, label in (("given", 1, "nominal model"), ("measured", 5, "measured"), ("with_causes", 0, "corrected model")):
        chart.line(list(zip(t, e[key])), colour, label)
    chart.write(name)


def rollout(found):
    """Position error of both simulators in closed loop over the horizon."""
    points = found["rollout"]["points"]
    t = [p["horizon_s"] for p in points]
    rows = [[max(1e3 * p[key], 1e-3) for p in points] for key in ("position_before_rad", "position_after_rad")]
    chart = Chart("Error of the simulated arm in closed loop", "time after the start [s]", "position error [mrad]", (0, t[-1]), (min(map(min, rows)) / 1.5, max(map(max, rows)) * 1.5), log_y=True)
    for row, colour, label in zip(rows, (1, 0), ("nominal model", "corrected model")):
        chart.line(list(zip(t, row)), colour, label)
    chart.write("tutorial-rollout.svg")


def gap(found):
    joints = found["gap"]["per_joint"]
    chart = Chart("Gap by joint: residual torque over torque", "joint", "gap [%]", (0.5, len(joints) + 0.5), (0, 105), x_ticks=False)
    for k, j in enumerate(joints, 1):
        for offset, key, colour in ((-0.25, "before", 1), (0, "after", 0), (0.25, "noise_floor", 2)):
            chart.bar(k + offset, 0.22, 100 * j[key], colour)
            chart.above(k + offset, 100 * j[key], f"{100 * j[key]:.0f}")
        chart.word(k, k)
    chart.legend = [(1, "nominal model"), (0, "corrected model"), (2, "noise floor")]
    chart.write("gap.svg")


def held_out(cases):
    """Predicted against measured shrink of every cause."""
    shrinks = [c["shrink"] for case in cases.values() for c in case["causes"]]
    shrinks = [s for s in shrinks if None not in (s["predicted"], s["low"], s["high"], s["measured"])]
    chart = Chart(f"Shrink of the gap: {len(shrinks)} causes of the practice sets", "predicted, with 90 % interval", "measured", (-0.05, 1.0), (-0.05, 1.0), width=420, height=420)
    chart.line([(0, 0), (1, 1)], 5, "equal", dash=True)
    for s in shrinks:
        chart.dot(s["predicted"], s["measured"], 0, max(s["low"], -0.05), min(s["high"], 1.0))
    chart.write("held-out.svg")


def confidence(scores):
    """Share of right names by stated confidence, all sets together."""
    bins = {}
    for b in (b for score in scores for b in score["confidence"]):
        count, right, mean = bins.get((b["from"], b["to"]), (0, 0, 0.0))
        bins[b["from"], b["to"]] = (count + b["count"], right + b["right"], mean + b["count"] * b["mean"])
    known = [(mean / count, right / count, count) for count, right, mean in bins.values() if count]
    chart = Chart("Names that were right, by stated confidence", "stated confidence", "share of right names", (0, 1), (0, 1.1))
    chart.line([(0, 0), (1, 1)], 5, "equal", dash=True)
    for mean, rate, count in sorted(known):
        chart.dot(mean, rate, 0)
        chart.above(mean, rate, count)
    chart.write("confidence.svg")


def base_parameters(whole, one):
    """How much less a log of one joint determines, by base parameter."""
    std = lambda result: {p["name"]: p["std"] for p in result["parameters"] if p["std"]}
    wide, narrow = std(one), std(whole)
    ratios = sorted(wide[name] / narrow[name] for name in narrow if name in wide)
    chart = Chart("Standard deviation: log of joint 1 over log of all joints", f"{len(ratios)} base parameters, sorted", "ratio", (0, len(ratios) + 1), (min(ratios) / 2, max(ratios) * 2), log_y=True, x_ticks=False)
    chart.line([(0, 1), (len(ratios) + 1, 1)], 5, "equal", dash=True)
    for k, ratio in enumerate(ratios, 1):
        chart.dot(k, ratio, 0)
    chart.write("base-parameters.svg")


def panels(page, names, file):
    """Panels of `rivet figures` next to each other, with fewer points."""
    found = re.findall(r"<svg viewBox=\"0 0 (\d+) (\d+)\"[^>]*aria-label=\"([^\"]*)\">(.*?)</svg>", page, re.S)

    def fewer(match):
        points = match.group(1).split()
        return f'points="{" ".join(points[:: max(1, len(points) // MOST_POINTS)])}"'

    parts, x, height = [], 0, 0
    for name in names:
        width, high, _, body = next(panel for panel in found if panel[2] == name)
        body = re.sub(r'points="([^"]*)"', fewer, body)
        parts.append(f"<g transform='translate({x} 0)'>{body}</g>")
        x, height = x + int(width), max(height, int(high))
    legend = "<rect class='f0' x='62' y='%d' width='14' height='4'/><text x='82' y='%d'>%s</text><rect class='f5' x='300' y='%d' width='14' height='4'/><text x='320' y='%d'>true value</text>"
    words = "inertia (others: viscous, Coulomb)" if "RIV, six repetitions" in names else "estimate"
    parts.append(legend % (height + 8, height + 14, words, height + 8, height + 14))
    write(file, f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {x} {height + 24}" role="img">{STYLE}' + "".join(parts) + "</svg>\n")


# Where the curve of an effect comes from, for the line below its picture.
MEASURED = {"ur10e": "Measured logs of a UR10e", "kuka": "Measured logs of a KUKA KR300"}


def curves(found, source, drawn):
    """The curve of each cause on its first joint, once an effect."""
    for cause in found.get("causes", []):
        name = cause["effect"]
        if name == "external_force" and name not in drawn:
            # A contact has no quantity in which it shows but time.
            torque(found, f"effects/{name}.svg")
            drawn[name] = source
        if name in drawn or not cause.get("curves") or (cause["confidence"] or 0) < LEAST_CONFIDENCE:
            continue
        curve = max(cause["curves"], key=lambda c: c["rms_nm"] or 0)
        points = [p for p in curve["points"] if p["rows"] > 0]
        if len(points) < 4:
            continue
        xs = [p["at"] for p in points]
        ys = [p[key] for p in points for key in ("without", "with", "cause")]
        title = f"{name.replace('_', ' ')}, {curve['joint']}"
        along = " along the motion" if curve["along_motion"] else ""
        chart = Chart(title, f"{curve['variable']} [{curve['unit']}]", f"torque{along} [N m]", span(xs, 0.02), span(ys))
        for key, colour, label in (("without", 1, "residual without the cause"), ("cause", 5, "torque of the cause"), ("with", 0, "residual with it")):
            chart.line([(p["at"], p[key]) for p in points], colour, label, dash=key == "cause")
        chart.write(f"effects/{name}.svg")
        drawn[name] = source


def read(folder, name):
    with open(os.path.join(folder, name), encoding="utf-8") as file:
        return json.load(file) if name.endswith(".json") else file.read()


def main():
    folder = sys.argv[1]
    ur10e = read(folder, "ur10e.json")
    cases = {name[:-5]: read(folder, f"cases/{name}") for name in sorted(os.listdir(os.path.join(folder, "cases")))}
    torque(ur10e, "tutorial-torque.svg")
    rollout(ur10e)
    gap(ur10e)
    held_out({name: case for name, case in cases.items() if name.startswith("practice")})
    confidence(read(os.path.join(HERE, "../../crates/analysis/src"), "scores.json"))
    base_parameters(read(folder, "id-all.json"), read(folder, "id-one.json"))
    page = read(folder, "figures.html")
    panels(page, ["RLS (UD filter), six repetitions", "RIV, six repetitions"], "instruments.svg")
    panels(page, ["unsupervised least squares", "directions held (3.2.4)"], "supervision.svg")
    drawn = {}
    # The payload of the KUKA is a real one.
    curves(read(folder, "kuka.json"), MEASURED["kuka"], drawn)
    curves(ur10e, MEASURED["ur10e"], drawn)
    for name, found in cases.items():
        curves(found, f"Simulated case `{name}`", drawn)
    write("effects/sources.txt", "".join(f"{name}: {source}\n" for name, source in sorted(drawn.items())))


if __name__ == "__main__":
    main()
