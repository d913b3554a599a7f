"""Writes golden bytes: python3 golden.py OUT_DIR. rosbags 0.11."""
import sys, pathlib, numpy as np
from importlib.metadata import version
from rosbags.typesys import Stores, get_typestore, get_types_from_msg
s = get_typestore(Stores.ROS2_HUMBLE)
P = "trajectory_msgs/JointTrajectoryPoint"
names = ["desired", "actual", "error"]
s.register(get_types_from_msg("std_msgs/Header header\nstring[] joint_names\n" + "".join(f"{P} {n}\n" for n in names),
                              "control_msgs/msg/JointTrajectoryControllerState"))
T = s.types
def t(name): return T[name]
H = t("std_msgs/msg/Header"); Tm = t("builtin_interfaces/msg/Time"); D = t("builtin_interfaces/msg/Duration")
def h(f): return H(stamp=Tm(sec=1764000000, nanosec=123456789), frame_id=f)
a = lambda *x: np.array(x, dtype=np.float64)
pt = t("trajectory_msgs/msg/JointTrajectoryPoint")
p = lambda k: pt(positions=a(k, -2.5), velocities=a(0.25), accelerations=a(), effort=a(float("inf")), time_from_start=D(sec=-1, nanosec=7))
V = t("geometry_msgs/msg/Vector3")
KV = t("diagnostic_msgs/msg/KeyValue"); DS = t("diagnostic_msgs/msg/DiagnosticStatus")
MD = t("std_msgs/msg/MultiArrayDimension"); ML = t("std_msgs/msg/MultiArrayLayout")
out = {
 "joint_state": ("sensor_msgs/msg/JointState", t("sensor_msgs/msg/JointState")(header=h("base"), name=["a", "joint_2", ""], position=a(1.5, -0.1, 1e-300), velocity=a(), effort=a(float("nan"), 3.0, -0.0))),
 "joint_state_empty": ("sensor_msgs/msg/JointState", t("sensor_msgs/msg/JointState")(header=H(stamp=Tm(sec=0, nanosec=0), frame_id=""), name=[], position=a(), velocity=a(), effort=a())),
 "joint_trajectory_point": ("trajectory_msgs/msg/JointTrajectoryPoint", p(1.0)),
 "controller_state": ("control_msgs/msg/JointTrajectoryControllerState", t("control_msgs/msg/JointTrajectoryControllerState")(header=h(""), joint_names=["b", "a"], desired=p(1.0), actual=p(2.0), error=p(3.0))),
 "string": ("std_msgs/msg/String", t("std_msgs/msg/String")(data="<robot name=\"ä\"/>")),
 "float64_multi_array": ("std_msgs/msg/Float64MultiArray", t("std_msgs/msg/Float64MultiArray")(layout=ML(dim=[MD(label="rows", size=2, stride=6), MD(label="c", size=3, stride=3)], data_offset=1), data=a(9, 1, 2, 3, 4, 5, 6))),
 "diagnostic_array": ("diagnostic_msgs/msg/DiagnosticArray", t("diagnostic_msgs/msg/DiagnosticArray")(header=h(""), status=[DS(level=2, name="rivet: arm", message="lost", hardware_id="arm", values=[KV(key="k", value="v"), KV(key="lost", value="17")]), DS(level=0, name="x", message="", hardware_id="", values=[])])),
 "wrench_stamped": ("geometry_msgs/msg/WrenchStamped", t("geometry_msgs/msg/WrenchStamped")(header=h("link_6"), wrench=t("geometry_msgs/msg/Wrench")(force=V(x=1.0, y=-2.0, z=3.5), torque=V(x=0.0, y=0.125, z=-9.0)))),
}
lines = [f"# CDR of rosbags {version('rosbags')}, by golden.py: name, bytes with the header of the encapsulation\n"]
for k, (n, m) in out.items():
    lines.append(f"{k} {bytes(s.serialize_cdr(m, n)).hex()}\n")
pathlib.Path(sys.argv[1], "golden.txt").write_text("".join(lines))
