"""A simulated arm of one joint as a robot controller, at 1 kHz: publishes samples and applies the commanded torque.

PYTHONPATH=/usr/local/share/rivet python3 robot.py [SAMPLES [PREFIX ROOT]]
"""

import sys
import time
from math import cos, sin, tanh

import librivet


class Arm:
    """The true arm; arm/robot.toml has other values."""

    q = qd = tau = 0.0  # [rad], [rad/s], [N m]

    def move(self, commanded):
        """Moves for 1 ms. The drive brings its torque to `commanded` within the period."""
        for i in range(10):
            torque = self.tau + (commanded - self.tau) * (i + 0.5) / 10
            friction = 1.5 * self.qd + 2.0 * tanh(self.qd / 0.1)
            self.qd += 1e-4 * (torque - 1.5 * 9.81 * sin(self.q) - friction) / 0.9
            self.q += 1e-4 * self.qd
        self.tau = commanded


def main(samples=10_000, prefix=None, root=None):
    arm, answered, missed, a, b = Arm(), 0, 100, 3.0, 8.0
    with librivet.Robot("example-arm", joints=1, prefix=prefix, root=root) as robot:
        wake = time.monotonic_ns()
        for k in range(int(samples)):
            t = 1e-3 * k
            q_des = 0.5 * (1 - cos(a * t)) + 0.2 * (1 - cos(b * t))  # two sines, from rest
            qd_des = 0.5 * a * sin(a * t) + 0.2 * b * sin(b * t)
            sample = librivet.Sample(stamp_ns=wake, flags=librivet.SETPOINT)
            sample.q[0], sample.tau[0], sample.q_des[0], sample.qd_des[0] = arm.q, arm.tau, q_des, qd_des
            sample.qdd_des[0] = 0.5 * a * a * cos(a * t) + 0.2 * b * b * cos(b * t)
            robot.publish(sample)
            command = robot.wait_command(800)
            if command and command.mode:
                answered, missed = answered + 1, 0
                arm.move(command.tau[0])
            else:  # after 20 missed answers the arm's own controller
                missed += 1
                arm.move(arm.tau if missed < 20 else 100 * (q_des - arm.q) + 10 * (qd_des - arm.qd))
            wake += 1_000_000
            time.sleep(max(wake - time.monotonic_ns(), 0) * 1e-9)
        count, parameters = robot.counters(), robot.parameters()
        print(f"published {count.published}, lost {count.lost}, answered {answered}")
        for i in range(parameters.count if parameters else 0):
            print(f"parameter {i + 1}: {parameters.values[i]:9.4f} +- {parameters.std[i]:.4f}, state {parameters.state[i]}")


if __name__ == "__main__":
    main(*sys.argv[1:])
