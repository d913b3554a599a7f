"""A robot on a graph of ROS 2, by Cyclone DDS with its own IDL classes: a simulated arm of one joint.

python3 peer.py DOMAIN SAMPLES [PERIOD_S] [best-effort] [no-setpoints] [no-wait] [listen] [other-arm] [malformed] [names=A,B]

Waits until the bridge reports a publisher on /diagnostics (not with no-wait), publishes SAMPLES joint states with setpoints, and
prints what came from the bridge meanwhile and two seconds longer as JSON. With listen it publishes nothing and does not end; with
other-arm it describes another arm; with malformed another program sends messages of another layout. Prints "publishing" when the first sample is sent.
"""
import json
import math
import sys
import time
from dataclasses import dataclass

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint8, uint32
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces::msg::dds_::Duration_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class Point(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    positions: sequence[float64]
    velocities: sequence[float64]
    accelerations: sequence[float64]
    effort: sequence[float64]
    time_from_start: Duration


@dataclass
class ControllerState(IdlStruct, typename="control_msgs::msg::dds_::JointTrajectoryControllerState_"):
    header: Header
    joint_names: sequence[str]
    reference: Point
    feedback: Point
    error: Point
    output: Point


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Dimension(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayDimension_"):
    label: str
    size: uint32
    stride: uint32


@dataclass
class Layout(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayLayout_"):
    dim: sequence[Dimension]
    data_offset: uint32


@dataclass
class Float64MultiArray(IdlStruct, typename="std_msgs::msg::dds_::Float64MultiArray_"):
    layout: Layout
    data: sequence[float64]


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class Status(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[Status]


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


@dataclass
class OtherLayout(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    values: sequence[uint32]


OTHER_ARM = """<robot name="other"><link name="base_link"/><link name="l"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><joint name="elbow" type="continuous">
<parent link="base_link"/><child link="l"/><axis xyz="0 0 1"/></joint></robot>"""


class Arm:
    """The true arm of the examples: position [rad], velocity [rad/s]."""

    def __init__(self):
        self.q = self.qd = 0.0

    def step(self, torque, period):
        """Moves with a constant torque [N m]."""
        parts = max(1, round(period / 1e-4))
        for _ in range(parts):
            friction = 1.5 * self.qd + 2.0 * math.tanh(self.qd / 0.1)
            self.qd += period / parts * (torque - 1.5 * 9.81 * math.sin(self.q) - friction) / 0.9
            self.q += period / parts * self.qd


def plan(t, a=3.0, b=8.0):
    """Position, velocity and acceleration of two sines, from rest."""
    return (
        0.5 * (1 - math.cos(a * t)) + 0.2 * (1 - math.cos(b * t)),
        0.5 * a * math.sin(a * t) + 0.2 * b * math.sin(b * t),
        0.5 * a * a * math.cos(a * t) + 0.2 * b * b * math.cos(b * t),
    )


def main():
    domain, samples = int(sys.argv[1]), int(sys.argv[2])
    words = sys.argv[3:]
    period = next((float(word) for word in words if word[0].isdigit()), 0.002)
    names = next((word[6:].split(",") for word in words if word.startswith("names=")), ["finger", "joint_1"])
    reliable = Policy.Reliability.Reliable(duration(milliseconds=100))
    sent = Policy.Reliability.BestEffort if "best-effort" in words else reliable

    participant = DomainParticipant(domain)

    def qos(reliability, durability=Policy.Durability.Volatile, depth=5000):
        return Qos(reliability, durability, Policy.History.KeepLast(depth))

    def writer(name, kind):
        # Ten messages, as ROS 2 does by default.
        return DataWriter(participant, Topic(participant, name, kind), qos=qos(sent, depth=10))

    def reader(name, kind, durability=Policy.Durability.Volatile, depth=5000):
        return DataReader(participant, Topic(participant, name, kind), qos=qos(reliable, durability, depth))

    if "listen" in words:
        kept = [
            reader("rt/rivet/example_arm/parameters", Float64MultiArray),
            reader("rt/diagnostics", DiagnosticArray),
        ]
        while not all(reader.get_matched_publications() for reader in kept):
            time.sleep(0.01)
        print("publishing", flush=True)
        while True:
            time.sleep(1)
    states = writer("rt/joint_states", JointState)
    plans = writer("rt/joint_trajectory_controller/controller_state", ControllerState)
    parameters = reader("rt/rivet/example_arm/parameters", Float64MultiArray)
    wrenches = reader("rt/rivet/example_arm/payload", WrenchStamped)
    diagnostics = reader("rt/diagnostics", DiagnosticArray)
    latched = Policy.Durability.TransientLocal

    if "other-arm" in words:
        description = Qos(reliable, latched, Policy.History.KeepLast(1))
        describe = DataWriter(participant, Topic(participant, "rt/robot_description", String), qos=description)
        describe.write(String(OTHER_ARM))

    if "malformed" in words:
        other = DomainParticipant(domain)
        layout = DataWriter(other, Topic(other, "rt/joint_states", OtherLayout), qos=qos(sent, depth=10))

    got = {"parameters": [], "labels": [], "wrenches": 0, "wrench": [], "reports": 0, "status": {}, "urdf": ""}

    def valid(reader):
        """Messages; not that a publisher has left."""
        return [message for message in reader.take(1000) if not isinstance(message, InvalidSample)]

    def take():
        for message in valid(parameters):
            head = message.layout.data_offset
            got["parameters"].append([int(message.data[0]), [value.hex() for value in message.data[head:]]])
            got["labels"] = [dimension.label for dimension in message.layout.dim]
        for message in valid(wrenches):
            got["wrenches"] += 1
            force, torque = message.wrench.force, message.wrench.torque
            got["wrench"] = [message.header.frame_id, force.x, force.y, force.z, torque.x, torque.y, torque.z]
        for message in valid(diagnostics):
            got["reports"] += 1
            for status in message.status:
                values = {value.key: value.value for value in status.values}
                got["status"][status.name] = {"level": status.level, "message": status.message, "values": values}

    def is_matched():
        if "no-wait" in words:
            return True
        take()
        bridge = got["status"].get("rivet example-arm: ROS 2", {"values": {}})["values"]
        return int(bridge.get("publishers of joint states", 0)) > 0 and all(
            writer.get_matched_subscriptions() for writer in ([states] if "no-setpoints" in words else [states, plans])
        )

    begin = time.time()
    while not is_matched():
        if time.time() - begin > 60:
            sys.exit("no bridge")
        time.sleep(0.01)
    print("publishing", flush=True)
    arm, nothing = Arm(), Duration(0, 0)
    empty = Point([], [], [], [], nothing)
    start, torque = time.time_ns(), 0.0
    for k in range(samples):
        due = start + round(k * period * 1e9)
        wait = due - time.time_ns()
        if wait > 0:
            time.sleep(wait * 1e-9)
        q, qd, qdd = plan(k * period)
        header = Header(Time(due // 10**9, due % 10**9), "base_link")
        if "no-setpoints" not in words:
            plans.write(ControllerState(header, ["joint_1"], Point([q], [qd], [qdd], [], nothing), empty, empty, empty))
        # The torque that moved the arm to where it is now.
        states.write(JointState(header, names, [0.01, arm.q], [], [0.5, torque]))
        torque = 400 * (q - arm.q) + 40 * (qd - arm.qd) + 1.5 * 9.81 * math.sin(q)
        arm.step(torque, period)
        if k % 10 == 0:
            take()
        if "malformed" in words and k % 100 == 0:
            layout.write(OtherLayout([2**32 - 1] * 20))
    got["moving"] = dict(got["status"])
    end = time.time() + 2
    while time.time() < end:
        take()
        time.sleep(0.01)
    # Who comes later gets the URDF.
    description = reader("rt/rivet/example_arm/robot_description", String, latched, 1)
    end = time.time() + 3
    while time.time() < end and not got["urdf"]:
        got["urdf"] = "".join(message.data for message in valid(description))
        time.sleep(0.01)
    take()
    print(json.dumps(got), flush=True)


main()
