"""Off-line identification as it is written today with numpy and Pinocchio; `rivet-peer` runs it beside rivet.

usage: offline.py MODEL SAMPLES [JOB]...    prints `JOB MILLISECONDS` of processor time and `JOB_passed MILLISECONDS` by the clock

MODEL is the problem of peer.cpp without its samples, SAMPLES those as 64 bit floats; both jobs unless one is named.

bare: central differences, regressor sample by sample, base columns, np.linalg.lstsq on all rows.
filtered: the same with every column and the torque low-passed forwards and backwards and thinned out, which is what
rivet identify does (it also fits instruments, standard deviations and physical consistency).
"""

import sys
import time

import numpy as np
import pinocchio as pin
import scipy.signal as signal

words = iter(open(sys.argv[1]).read().split())
take = lambda *shape: np.array([float(next(words)) for _ in range(int(np.prod(shape)))]).reshape(shape)
dof, period, _, v0, _ = take(5)
dof = int(dof)
driving, driven, offset = (int(x) for x in take(3))
model = pin.Model()
model.gravity.linear = take(3)
parent = 0
for j in range(dof):
    rotation, origin, axis, body = take(3, 3), take(3), take(3), take(10)
    place = pin.SE3(rotation, origin)
    kind = pin.JointModelRZ() if axis[2] == 1 else pin.JointModelRevoluteUnaligned(axis)
    parent = model.addJoint(parent, kind, place, f"joint{j + 1}")
    model.appendBodyToJoint(parent, pin.Inertia.FromDynamicParameters(body), pin.SE3.Identity())
data = model.createData()
base = take(int(take(1)[0])).astype(int)
sections = take(int(take(1)[0]), 5)
take(int(take(1)[0]), 3)
take(len(base))
take(dof)
samples = np.fromfile(sys.argv[2]).reshape(-1, 5 * dof)
rows = len(samples)
direction = (lambda v: np.tanh(v / v0)) if v0 > 0 else np.sign


def matrix():
    q, tau = samples[:, :dof], samples[:, dof : 2 * dof]
    v = np.gradient(q, period, axis=0)
    a = np.gradient(v, period, axis=0)
    links = np.empty((rows, dof, 10 * dof))
    for k in range(rows):
        links[k] = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])
    drives = np.zeros((rows, dof, (4 if offset else 3) * dof + (3 if driving >= 0 else 0)))
    for j in range(dof):
        drives[:, j, j], drives[:, j, dof + j], drives[:, j, 2 * dof + j] = a[:, j], v[:, j], direction(v[:, j])
        if offset:
            drives[:, j, 3 * dof + j] = 1
    if driving >= 0:
        both = direction(v[:, driving] + v[:, driven])
        for joint, other in ((driving, driven), (driven, driving)):
            drives[:, joint, -3:] = np.stack([a[:, other], v[:, other], both], axis=1)
    return np.concatenate([links, drives], axis=2)[:, :, base], tau


def bare():
    d, tau = matrix()
    return np.linalg.lstsq(d.reshape(-1, len(base)), tau.reshape(-1), rcond=None)[0]


def filtered(step=8):
    d, tau = matrix()
    sos = np.concatenate([sections[:, :3], np.ones((len(sections), 1)), sections[:, 3:]], axis=1)
    d = signal.sosfiltfilt(sos, d, axis=0)[::step]
    tau = signal.sosfiltfilt(sos, tau, axis=0)[::step]
    return np.linalg.lstsq(d.reshape(-1, len(base)), tau.reshape(-1), rcond=None)[0]


for job in (bare, filtered):
    if sys.argv[3:] and job.__name__ not in sys.argv[3:]:
        continue
    start, clock = time.process_time(), time.perf_counter()
    job()
    print(job.__name__, (time.process_time() - start) * 1e3)
    print(job.__name__ + "_passed", (time.perf_counter() - clock) * 1e3)
