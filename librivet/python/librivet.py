"""librivet for Python, by ctypes: publishes samples of a robot and reads torque, parameters and health.

    import librivet
    with librivet.Robot("ur10e", joints=6) as robot:
        sample = librivet.Sample()
        sample.q[:6] = [0.0] * 6                        # measured, [rad]
        robot.publish(sample)
        command = robot.wait_command(500)               # [us]; None without an answer

rivet_ipc.py, beside this file, has the messages. RIVET_LIBRARY names the shared library where the system does not find it.
"""

import ctypes
import os

import rivet_ipc

ABI = 1
OK, NONE, STALE = 0, 1, 2
SETPOINT, TEMPERATURE = 1 << 0, 1 << 1


class Sample(ctypes.Structure):
    """One control period: what was measured, and what was planned. librivet.h states fields, units and signs."""

    _fields_ = [
        ("stamp_ns", ctypes.c_uint64),
        *[(name, ctypes.c_double * rivet_ipc.MAX_JOINTS) for name in ("q", "tau", "q_des", "qd_des", "qdd_des", "temperature")],
        ("flags", ctypes.c_uint32),
        ("faults", ctypes.c_uint32),
    ]


class Counters(ctypes.Structure):
    """How many samples were published, sent to the bus, lost because the queue was full, and not accepted by the bus."""

    _fields_ = [(name, ctypes.c_uint64) for name in ("published", "sent", "lost", "failed")]


class Error(Exception):
    """Why a robot could not be opened, or a function failed."""


def _load():
    library = ctypes.CDLL(os.environ.get("RIVET_LIBRARY", "librivet.so.1"))
    for name in ("rivet_version", "rivet_error", "rivet_status_text"):
        getattr(library, name).restype = ctypes.c_char_p
    text, robot, number = ctypes.c_char_p, ctypes.c_void_p, ctypes.c_uint32
    library.rivet_open.argtypes = [number, text, text, text, number, ctypes.POINTER(robot)]
    library.rivet_error.argtypes = library.rivet_close.argtypes = [robot]
    library.rivet_publish.argtypes = [robot, ctypes.POINTER(Sample)]
    for name in ("wait_command", "read_command"):
        getattr(library, "rivet_" + name).argtypes = [robot, number, ctypes.c_void_p]
    for name in ("parameters", "health", "controller_health", "counters"):
        getattr(library, "rivet_read_" + name).argtypes = [robot, ctypes.c_void_p]
    return library


_library = _load()


class Robot:
    """The robot's side of the bus. One thread at a time uses it."""

    def __init__(self, name, joints, prefix=None, root=None):
        """Joins the bus. prefix, root: as --prefix and --root of rivetd; None: the default. Raises Error."""
        self._robot = ctypes.c_void_p()
        encoded = [text and str(text).encode() for text in (name, prefix, root)]
        if _library.rivet_open(ABI, *encoded, joints, ctypes.byref(self._robot)) != OK:
            raise Error(_library.rivet_error(None).decode())

    def close(self):
        """Sends what is queued and leaves the bus."""
        _library.rivet_close(self._robot)
        self._robot = ctypes.c_void_p()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _read(self, function, kind, *arguments):
        value = kind()
        status = getattr(_library, function)(self._robot, *arguments, ctypes.byref(value))
        if status < 0:
            raise Error(_library.rivet_status_text(status).decode())
        return value if status == OK else None

    def publish(self, sample):
        """Publishes the sample of one period. Raises Error if it is lost."""
        status = _library.rivet_publish(self._robot, ctypes.byref(sample))
        if status != OK:
            raise Error(_library.rivet_status_text(status).decode())

    def wait_command(self, timeout_us):
        """The command that answers the last sample, waited for at most timeout_us [us]; else None."""
        return self._read("rivet_wait_command", rivet_ipc.Command, timeout_us)

    def command(self, max_age_us):
        """The latest command if it is at most max_age_us [us] old; else None."""
        return self._read("rivet_read_command", rivet_ipc.Command, max_age_us)

    def parameters(self):
        """The latest parameters; None before the first."""
        return self._read("rivet_read_parameters", rivet_ipc.Parameters)

    def health(self):
        """The latest health of the daemon; None before the first."""
        return self._read("rivet_read_health", rivet_ipc.Health)

    def controller_health(self):
        """The latest health of the controller; None before the first."""
        return self._read("rivet_read_controller_health", rivet_ipc.ControllerHealth)

    def counters(self):
        """How many samples went where."""
        return self._read("rivet_read_counters", Counters)

    def problem(self):
        """What failed last on the library's thread; "" if nothing did."""
        return _library.rivet_error(self._robot).decode()
