"""Prints the parameters of a robot as a table, one a second. It only reads: any number of these may run.

PYTHONPATH=/usr/local/share/rivet python3 subscribe.py ROBOT [TABLES [PREFIX ROOT]]
"""

import sys
import time

import librivet

STATES = ["not identified", "active", "held"]


def main(robot, tables=1_000_000, prefix=None, root=None):
    epoch, tables = 0, int(tables)
    with librivet.Robot(robot, joints=0, prefix=prefix, root=root) as robot:
        while tables > 0:
            parameters, health = robot.parameters(), robot.health()
            if parameters and parameters.epoch != epoch:
                epoch = parameters.epoch
                print(f"epoch {epoch}, sample {parameters.seq}")
                for i in range(parameters.count):
                    value, std = parameters.values[i], parameters.std[i]
                    print(f"{i + 1:4} {value:12.5f} +- {std:<10.5f} {STATES[parameters.state[i]]}")
                if health:
                    print(f"samples {health.samples}, lost {health.lost}", flush=True)
                tables -= 1
            time.sleep(1)


if __name__ == "__main__":
    main(*sys.argv[1:])
