"""Records a Franka arm, or franky-sim in its place, through libfranka while it follows sums of sines.

pip install pylibfranka franky-sim
franky-sim --simulator mujoco --hostname 127.0.0.1 &
python3 franka.py 127.0.0.1 log.csv 40 1
rivet new fr3.urdf log.csv -o robot.toml && rivet diagnose robot.toml log.csv

python3 franka.py HOST LOG [SECONDS [LAG]]. LAG: samples by which tau_J comes later than q; 0 on the robot, 1 on franky-sim.
The arm leaves its pose by up to 1.2 rad a joint: keep the space free, and check AMPLITUDE first.
"""

import csv
import sys
from math import cos, pi, sin

from pylibfranka import RealtimeConfig, Robot, Torques

JOINTS = 7
# Amplitudes of two sines a joint [rad], their frequencies [Hz], and where they have their middle, from the pose at the start [rad].
AMPLITUDE = [(0.7, 0.25), (0.45, 0.25), (0.7, 0.25), (0.4, 0.25), (0.7, 0.3), (0.6, 0.3), (0.8, 0.4)]
FREQUENCY = [(0.11 + 0.023 * j, 0.37 + 0.041 * j) for j in range(JOINTS)]
MIDDLE = [0.0, -0.4, 0.0, 0.0, 0.0, 0.0, 0.0]
STIFFNESS = [600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0]  # [N m/rad]
DAMPING = [50.0, 50.0, 50.0, 50.0, 30.0, 25.0, 15.0]  # [N m s/rad]


def plan(start, t, end):
    """Positions [rad], velocities [rad/s] and accelerations [rad/s^2] at `t` [s], from rest at `start` to rest there at `end`."""
    s, sign = (t / 2, 1) if t < end / 2 else ((end - t) / 2, -1)  # the amplitude rises and falls in 2 s
    s = min(max(s, 0.0), 1.0)
    blend, d_blend, dd_blend = s**3 * (10 - 15 * s + 6 * s * s), 15 * s * s * (1 - s) ** 2, 15 * s * (1 - s) * (1 - 2 * s)
    d_blend *= sign
    q, qd, qdd = list(start), [0.0] * JOINTS, [0.0] * JOINTS
    for j in range(JOINTS):
        for a, f in [(MIDDLE[j], 0.0), *zip(AMPLITUDE[j], FREQUENCY[j])]:
            w = 2 * pi * f
            x, dx, ddx = a * (sin(w * t) if f else 1.0), a * w * cos(w * t), -a * w * w * sin(w * t)
            q[j] += blend * x
            qd[j] += blend * dx + d_blend * x
            qdd[j] += blend * ddx + 2 * d_blend * dx + dd_blend * x
    return q, qd, qdd


def torque(state, planned):
    """Torque beside that of gravity, which the robot adds itself [N m]."""
    spring = [k * (planned[0][j] - state.q[j]) for j, k in enumerate(STIFFNESS)]
    return [spring[j] + d * (planned[1][j] - state.dq[j]) for j, d in enumerate(DAMPING)]


def main(host, log, seconds=40.0, lag=0):
    seconds, lag = float(seconds), int(lag)
    if seconds < 4.0 or lag < 0:
        sys.exit("SECONDS is at least 4, LAG at least 0")
    robot = Robot(host, RealtimeConfig.kIgnore)
    names = ["q", "tau", "q_des", "qd_des", "qdd_des"]
    with open(log, "x", newline="") as file:  # a recording replaces no file
        rows = csv.writer(file)
        rows.writerow(["t"] + [f"{name}{j + 1}" for name in names for j in range(JOINTS)])
        control = robot.start_torque_control()
        state, _ = control.readOnce()
        start, begin, t, waiting = list(state.q), state.time.to_sec(), 0.0, []
        while t < seconds:
            planned = plan(start, t, seconds)
            waiting.append((t, state.q, planned))
            if len(waiting) > lag:  # tau_J: torque of the joints, gravity included [N m]
                row_t, q, (q_des, qd_des, qdd_des) = waiting.pop(0)
                rows.writerow([f"{value:.9g}" for value in [row_t, *q, *state.tau_J, *q_des, *qd_des, *qdd_des]])
            control.writeOnce(Torques(torque(state, planned)))
            state, _ = control.readOnce()
            t = state.time.to_sec() - begin
        last = Torques([0.0] * JOINTS)  # the robot holds its own weight
        last.motion_finished = True
        control.writeOnce(last)
    print(f"{t:.1f} s in {log}")


if __name__ == "__main__":
    main(*sys.argv[1:])
