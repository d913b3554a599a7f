//! Every key of a robot file, declared once: shape, unit, range, default, meaning.
//!
//! The reader, the error messages, `rivet check` and `docs/robot-toml.md` all come from this table.

mod declaration;

use std::fmt::Write as _;

pub use declaration::{Bounds, Fallback, Key, Shape};

/// A section's line in the documentation, in the order of the documentation.
pub const SECTIONS: &[(&str, &str)] = &[
    ("", "Top of the file (contract). Required in every file."),
    (
        "model",
        "How the URDF becomes the chain that is modelled. For a tree `rivet check` and `rivet new` write the lines. The section as a whole is optional.",
    ),
    ("drive", "Drives (contract). One value per joint, at the joint side of the gear."),
    ("friction", "Nominal friction (contract): `tau = coulomb*s(qd) + viscous*qd + offset`."),
    (
        "coupling",
        "A motor that turns with two joints, as the wrist of the TX40: motor angle of `driven` ~ q_driving + q_driven. Adds to the \
         torque of each of the two joints `rotor_inertia` times the acceleration and `viscous` times the velocity of the other, and \
         `coulomb*s(qd_driving + qd_driven)`. The section as a whole is optional.",
    ),
    (
        "log",
        "How log files of this machine differ from the convention of the URDF, and which channels of a recording are which (docs/logs.md).",
    ),
    ("signal", "From samples to equations: differentiation, model filter, decimation."),
    ("estimator", "The recursive estimator."),
    ("supervision", "Which directions of the parameter space may move."),
    ("publish", "How often results are published."),
    ("realtime", "The daemon's real-time thread."),
    ("controller", "The computed-torque controller."),
    ("simulation", "What `rivet-sim` adds to the nominal model to stand in for the real arm."),
    ("bus", "Where the shared memory of this robot lives. All processes of one robot must agree."),
    (
        "effects.friction_asymmetry",
        "Friction that differs between the two directions: adds `coulomb*|s(qd)| + viscous*|qd|`.",
    ),
    (
        "effects.stribeck_friction",
        "Friction that falls with speed at low speed: adds `excess*s(qd)*exp(-(qd/velocity)^2)`.",
    ),
    (
        "effects.viscous_nonlinearity",
        "Friction that grows not in proportion to speed: adds `quadratic*qd*|qd| + cubic*qd^3`.",
    ),
    (
        "effects.load_dependent_friction",
        "Friction that grows with the torque of the links: adds `ratio*s(qd)*|torque of the links|`, by the bodies of `urdf`. Known, while `friction.load_dependent` is identified.",
    ),
    (
        "effects.temperature_dependent_friction",
        "Friction that changes as the joint warms up: adds `(viscous*qd + coulomb*s(qd))*(T - reference)`. T is the temperature of the log. With a `time_constant`, T is the power of `[friction]` through a first-order lag, `reference` where a log begins, and all that is per K is per W.",
    ),
    (
        "effects.presliding_friction",
        "Friction that acts like a spring before it slides: adds `level*(z - s(qd))` with `dz = (dq - |dq|*z)/length`.",
    ),
    (
        "effects.position_dependent_friction",
        "Friction that varies with the joint's angle: adds `s(qd)*(cosine*cos(order*q) + sine*sin(order*q))`.",
    ),
    ("effects.torque_constant", "A drive whose reported torque is `1 + excess` times that which it gives."),
    ("effects.torque_ripple", "Torque that varies with the angle: adds `cosine*cos(order*q) + sine*sin(order*q)`."),
    ("effects.transmission_error", "A gear whose output is ahead by `cosine*cos(order*q) + sine*sin(order*q)`."),
    ("effects.backlash", "Play, and a spring with damping, between motor and link."),
    ("effects.joint_elasticity", "A spring with damping between motor and link."),
    (
        "effects.joint_spring",
        "A torque in proportion to the angle, as of a hose: adds `stiffness*q`; its zero is in `friction.offset`.",
    ),
    (
        "effects.counterbalance",
        "A balancing spring between points at distances 1 and `arm` from the axis, at the angle `q + phase`, of length `l = sqrt(1 + arm^2 - 2*arm*cos(q + phase))`: adds `arm*sin(q + phase)*(lever + free_length/l)`.",
    ),
    (
        "effects.joint_coupling",
        "A motor that turns with this joint and the one before it, v the sum of their speeds: adds `coulomb*s(v) + viscous*v` to both and `rotor_inertia` times the acceleration of the other to each. Known, while `[coupling]` is identified.",
    ),
    ("effects.transport_delay", "Torque acts later than it is reported."),
    ("effects.current_loop_lag", "Torque follows the reported one as a first-order lag."),
    ("effects.torque_saturation", "Reported (commanded) torque beyond a limit is not delivered."),
    ("effects.encoder_offset", "The joint's zero is elsewhere: the link is at `q + offset`."),
    (
        "effects.encoder_eccentricity",
        "The encoder's reading varies once a turn: motor and link are at `q + cosine*cos(q) + sine*sin(q)`.",
    ),
    (
        "effects.base_flexibility",
        "What the arm stands on turns on a spring about a horizontal axis through the base's origin, moved by the moment of the arm.",
    ),
    (
        "identified",
        "Written by `rivet identify --export`: identified base parameters. The section as a whole is optional; the hash ties it to \
         kinematics, gravity and structure of the model it was identified with.",
    ),
];

/// A model filter above this share of the rate it is followed by folds back (Nyquist: 0.5).
pub(crate) const HIGHEST_FILTER_SHARE: f64 = 0.45;
/// Highest corner of the state filter as a share of the sample rate: above, Tustin's rule bends its derivatives.
pub(crate) const HIGHEST_STATE_FILTER_SHARE: f64 = 0.2;

use Bounds::{Above, Magnitude, NonZero, Within};
use Fallback::{Absent, Derived, Required};
use Shape::{Bool, Choice, Integer, Number, PerJoint, PerJointOrOne, Text};

const fn key(
    section: &'static str,
    name: &'static str,
    shape: Shape,
    unit: &'static str,
    bounds: Bounds,
    fallback: Fallback,
    meaning: &'static str,
) -> Key {
    Key { section, name, shape, unit, bounds, fallback, meaning }
}

/// All keys, in the order of the documentation.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    key("", "name", Text, "", Bounds::None, Required,
        "Robot's name; part of every service name. 1 to 64 characters of a-z, 0-9, `-`, `_`, the first a letter or a digit."),
    key("", "urdf", Text, "", Bounds::None, Required,
        "URDF file, relative to the robot file: kinematics, bodies, limits."),
    key("", "sample_period_s", Number, "s", Within(1e-4, 0.1), Required,
        "Time from one sample to the next: of the controller, the daemon and the grid that logs are resampled to."),
    key("", "gravity", Shape::Vector, "m/s^2", Magnitude(100.0), Required,
        "Acceleration of free fall in base axes; `[0, 0, -9.81]` for an arm that stands upright."),

    key("model", "tip", Text, "", Bounds::None, Absent,
        "Link that the arm ends with, for a URDF that is a tree: joints on the way from the root to it are the arm's, all others are welded."),
    key("model", "fixed", Shape::JointPositions, "rad", Magnitude(1e3), Absent,
        "Joints of the URDF that are welded, with their positions [rad or m]: `{ finger_joint = 0.02 }`. The bodies behind them move as one with the link that \
         carries them. Joints outside the chain that are not listed are welded at 0 or at the limit next to 0, those with `<mimic>` at the position that follows."),
    key("model", "impossible_inertia", Choice(&["refuse", "project"]), "", Bounds::None, Fallback::Text("refuse"),
        "Treatment of a moving link whose inertia no body can have (not positive definite, or against the triangle inequality): the URDF is refused, or the \
         nearest feasible inertia is used, with a warning. An inertia without mass then counts as none."),

    key("drive", "gear_ratio", PerJoint, "-", NonZero(1e5), Required,
        "Motor angle over joint angle; negative where they turn against each other; 1 for a direct drive."),
    key("drive", "rotor_inertia", PerJoint, "kg m^2", Within(0.0, 1e5), Required,
        "Rotor inertia reflected to the joint, J_m*N^2 (what the joint feels); 0 where it is inside the link."),
    key("drive", "torque_limit", PerJoint, "N m", Above(0.0, 1e6), Required,
        "Largest torque at the joint; commands are clipped to it."),
    key("drive", "velocity_limit", PerJoint, "rad/s", Above(0.0, 1e4), Absent,
        "Largest speed of the joint (m/s for a sliding joint). Without it: `<limit velocity>` of the URDF. In a URDF `velocity=\"0\"` means that none is stated. A joint \
         without a limit has no check of speed in `rivet-controller`."),
    key("drive", "encoder_resolution", PerJoint, "rad", Within(0.0, 0.1), Required,
        "Smallest step of the position seen at the joint; 0 is not quantised."),
    key("drive", "drive_gain", PerJoint, "N m/A", NonZero(1e5), Absent,
        "Joint torque per ampere, for logs that carry currents instead of torques. Without it such logs are refused."),

    key("friction", "coulomb", PerJoint, "N m", Within(0.0, 1e5), Derived("`<dynamics friction>` of the URDF, else 0"),
        "Coulomb friction."),
    key("friction", "viscous", PerJoint, "N m s/rad", Within(0.0, 1e6), Derived("`<dynamics damping>` of the URDF, else 0"),
        "Viscous friction."),
    key("friction", "offset", PerJoint, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Constant torque, for example asymmetric friction or the zero of the torque signal."),
    key("friction", "load_dependent", PerJointOrOne, "-", Within(0.0, 1e4), Absent,
        "Coulomb friction per torque that the gear carries: adds `load_dependent*|tau of the links|*s(qd)`, tooth friction under \
         load (at most 1 when it is identified off line). With the key, 0 included, the model has the term and it is identified; without it, it has not."),
    key("friction", "viscous_quadratic", PerJointOrOne, "N m s^2/rad^2", Magnitude(1e6), Absent,
        "Adds `viscous_quadratic*qd*|qd|`; negative where friction flattens with speed (grease of harmonic drives). With the key, 0 included, \
         the model has the term and it is identified."),
    key("friction", "presliding_travel", Number, "rad", Within(0.0, 0.1), Fallback::Number(0.0),
        "Travel in which Coulomb friction builds up after a reversal, as one spring and one slider, and is kept at rest. Takes the place of \
         `signal.friction_velocity` wherever there is a motion to follow (estimator, `rivet predict`). At least the steps of the encoder; \
         0 switches it off."),
    key("friction", "load_urdf", Text, "", Bounds::None, Fallback::Text(""),
        "URDF whose bodies make the torque of `load_dependent`, relative to the robot file; `urdf` without it. Written by \
         `rivet identify --export`: better bodies must not change what the identified values mean."),

    key("coupling", "driving", Shape::Joint, "", Bounds::None, Required,
        "Joint whose motion the motor of `driven` takes part in (TX40: 5)."),
    key("coupling", "driven", Shape::Joint, "", Bounds::None, Required,
        "Joint whose motor turns with both (TX40: 6)."),
    key("coupling", "rotor_inertia", Number, "kg m^2", Magnitude(1e5), Required,
        "Inertia that couples the two joints (Ia_m)."),
    key("coupling", "viscous", Number, "N m s/rad", Magnitude(1e6), Required,
        "Viscous friction that couples the two joints (Fv_m)."),
    key("coupling", "coulomb", Number, "N m", Magnitude(1e5), Required,
        "Coulomb friction of the sum of both speeds (Fc_m)."),

    key("log", "joint_zero", PerJointOrOne, "rad", Magnitude(10.0), Fallback::Number(0.0),
        "Added to the position columns (`q`, `q_des`, `q_link`) of log files to reach the zero of the URDF. Live samples are never shifted."),
    key("log", "torque_from", Choice(&["tau", "current"]), "", Bounds::None, Fallback::Text("tau"),
        "Where a log has both torque and motor current: the `tau` columns, or `drive_gain` times the `current` columns. \
         A sensor behind the gear does not feel the drive, and some controllers log a computed torque; use `current` then."),
    key("log", "torque_is", Choice(&["auto", "torque", "gravity_free"]), "", Bounds::None, Fallback::Text("auto"),
        "Whether the torque of a log is all of the drive's, or without that of gravity, as some drivers publish it. \
         With \"auto\" physics decides: without gravity where that is 0.95 probable. For `identify`, `predict` and `diagnose`."),

    key("log", "time", Text, "", Bounds::None, Absent,
        "Column of time. Without it `t`, or the one column whose name fits; of two clocks of a message the stamp of the measurement (`header/stamp`)."),
    key("log", "time_unit", Choice(&["s", "ms", "us", "ns"]), "", Bounds::None, Absent,
        "Unit of time. Without it the one that the recording states; else the one in which rows are 0.15 to 120 ms apart. Column `t` is in s."),
    key("log", "q", Text, "", Bounds::None, Absent,
        "Columns of positions, as a pattern: `{joint}` is a joint's name in the URDF, `{i}` its number from 0 or from 1 (`\"/joint_states/{joint}/position\"`, `\"q[{i}]\"`). Or one column a joint, base to flange, separated by commas. \
         Without it `q1..N`, or the one group of columns whose names fit; `rivet inspect` prints which. `--map q=PATTERN` does the same for one command."),
    key("log", "q_unit", Choice(&["rad", "deg", "mrad", "turn", "m", "mm"]), "", Bounds::None, Absent,
        "Unit of the positions. Without it the one in the column's name (`q1 [deg]`), else rad (m of a prismatic joint)."),
    key("log", "q_sign", PerJointOrOne, "-", NonZero(1.0), Absent,
        "1 or -1: direction of the positions against the axes of the URDF."),
    key("log", "q_scale", PerJointOrOne, "-", NonZero(1e9), Absent,
        "Factor of the positions, such as 1/gear ratio of motor encoders. The zero is `joint_zero`, which is added last."),
    key("log", "tau", Text, "", Bounds::None, Absent,
        "Columns of torques, as `q`. Without it `tau1..N`, or the one group whose names fit (`effort`, `torque`, `tau`)."),
    key("log", "tau_unit", Choice(&["Nm", "mNm", "kNm", "Ncm", "kgfm", "N", "kN"]), "", Bounds::None, Absent,
        "Unit of the torques. Without it the one in the column's name, else N m (N of a prismatic joint)."),
    key("log", "tau_sign", PerJointOrOne, "-", NonZero(1.0), Absent,
        "1 or -1: direction of the torques."),
    key("log", "tau_scale", PerJointOrOne, "-", NonZero(1e9), Absent,
        "Factor of the torques, such as the gear ratio of motor torques."),
    key("log", "tau_zero", PerJointOrOne, "N m", Magnitude(1e6), Absent,
        "Added to the torques behind sign and factor."),
    key("log", "current", Text, "", Bounds::None, Absent,
        "Columns of motor currents, as `q`. Without it `current1..N`, or the one group whose names fit."),
    key("log", "current_unit", Choice(&["A", "mA"]), "", Bounds::None, Absent,
        "Unit of the currents. Without it the one in the column's name, else A."),
    key("log", "current_sign", PerJointOrOne, "-", NonZero(1.0), Absent,
        "1 or -1: direction of the currents."),
    key("log", "current_scale", PerJointOrOne, "-", NonZero(1e9), Absent,
        "Factor of the currents."),
    key("log", "current_zero", PerJointOrOne, "A", Magnitude(1e6), Absent,
        "Added to the currents behind sign and factor."),
    key("log", "q_des", Text, "", Bounds::None, Absent,
        "Columns of commanded positions, as `q`. Unit, sign and factor are those of `q`."),
    key("log", "temperature", Text, "", Bounds::None, Absent,
        "Columns of motor temperatures, as `q`."),
    key("log", "temperature_unit", Choice(&["degC", "K"]), "", Bounds::None, Absent,
        "Unit of the temperatures."),

    key("signal", "differentiator", Choice(&["savitzky-golay", "central", "state-filter"]), "", Bounds::None, Fallback::Text("savitzky-golay"),
        "How velocity and acceleration come from positions. `savitzky-golay`: local cubic. `central`: differences of three samples. `state-filter`: the states of a triple low-pass that positions, torques and setpoints all pass. \
         `state-filter` takes the direction of motion from filtered signals, which distorts friction at reversals: on simulated arms 56 to 92 % of the values lie within two standard deviations, with `savitzky-golay` 91 to 98 %. \
         On line only. Off line (`rivet identify`) it is always central differences through the zero-phase model filter."),
    key("signal", "half_width", Integer, "samples", Within(2.0, 200.0), Derived("10 ms, at least 2"),
        "Samples on each side of the centre of the Savitzky-Golay window. Everything is delayed by as many. Unused by `central` (1) and off line. \
         Reversals within the window are rounded off, friction above all, in the regressor and not in the setpoint's. The bias test then rejects (`operating.md`): try a shorter window, or `central`. \
         The test can miss it: with 0.2 s, 59 to 64 % of the values of simulated arms lie within two standard deviations, without a rejection on a UR10e. `rivet check` warns from 0.12 s on."),
    key("signal", "state_filter_hz", Number, "Hz", Within(0.1, 2000.0), Derived("60 Hz, at most 0.2 of the sample rate"),
        "Corner of each of the three sections of the `state-filter`. Everything is delayed by 3/(2 pi) of its period (8 ms at 60 Hz). \
         At most 0.2 of the sample rate; well above the motion, below the rate of stair-case positions."),
    key("signal", "filtering", Choice(&["model", "input", "none"]), "", Bounds::None, Fallback::Text("model"),
        "What the daemon's low-pass filters. `model`: every regressor and instrument column and the torque. `input`: the signals before the model, which changes the equation; for comparison. `none`: nothing. \
         On line only. Off line it is always `model`, forwards and backwards."),
    key("signal", "input_signals", Choice(&["all", "motion", "acceleration"]), "", Bounds::None, Fallback::Text("all"),
        "`input`: filters positions with their derivatives and torques (`all`), all but the torques (`motion`), or accelerations alone."),
    key("signal", "model_filter_hz", Number, "Hz", Within(0.1, 2000.0), Derived("20 Hz, at most 0.2 of the sample rate"),
        "Cut-off of that low-pass. At most 0.45 of the rate after decimation. `rivet identify` chooses it by the logs where neither this key nor `decimation` is given."),
    key("signal", "model_filter_order", Integer, "-", Within(2.0, 8.0), Fallback::Integer(4),
        "Order of that Butterworth filter; even."),
    key("signal", "decimation", Integer, "samples", Within(1.0, 1000.0), Derived("5 samples per period of the cut-off"),
        "Every n-th filtered sample reaches the estimator."),
    key("signal", "friction_velocity", Number, "rad/s", Within(0.0, 1.0), Fallback::Number(0.004),
        "v0 of the friction sign tanh(qd/v0); 0 is a hard sign."),
    key("signal", "dead_zone", PerJointOrOne, "rad/s", Within(0.0, 1.0), Fallback::Number(0.01),
        "A joint's equation is not used while the joint is slower than this, because its friction is then unknown. Rows in which the model filter still holds such motion count for less. 0 uses all."),
    key("signal", "torque_noise", PerJointOrOne, "N m", Within(1e-9, 1e5), Absent,
        "Standard deviation of the torque residual after the model filter; weighs the joints against each other. Without it, it is \
         estimated while running. On line only: off line it is estimated from the whole log."),

    key("estimator", "kind", Choice(&["riv", "rls", "energy", "rls-energy"]), "", Bounds::None, Fallback::Text("riv"),
        "Recursive instrumental variables (`riv`), or recursive least squares (`rls`; biased by position noise; for comparison). \
         `energy` and `rls-energy` use energies instead of torques. They need no acceleration, but slow disturbances accumulate. They are for simulation and comparison, not for measured arms. \
         A row is the energy of the whole arm: one equation for all joints. An unmodelled torque of one joint then biases the parameters of others. \
         Supervised on measured arms, `energy` moved 0 to 2 parameters and had a larger residual than the nominal values (KUKA joint 1: 68.1 % against 25.9; UR10e wrist 2: 21.8 against 6.7). \
         On simulated rich motion it moves 6 of 52 directions. Unsupervised it leaves j2.rotor_inertia at -74 +- 48 kg m^2 (true: 57.8)."),
    key("estimator", "energy_span_s", Number, "s", Within(0.0, 60.0), Fallback::Number(1.0),
        "`energy`, `rls-energy`: time whose work an equation compares with energies; 0 counts from the start. At most 4096 samples after \
         decimation."),
    key("estimator", "offsets", Bool, "", Bounds::None, Derived("true where friction.offset is not all 0"),
        "The model has a constant torque per joint, which is identified as well. May be false only where friction.offset is all 0. Off line (`rivet identify`) it is true without the key."),
    key("estimator", "window", Choice(&["exponential", "constant-trace", "none"]), "", Bounds::None, Fallback::Text("exponential"),
        "`exponential`: old samples are forgotten with a time constant. `none`: never. \
         `constant-trace`: the window keeps the average variance of the parameters (Sripada & Fisher 1987). Little excitation makes it long, but one direction without excitation makes it long for all. \
         On line only. Off line (`rivet identify`) all rows count alike."),
    key("estimator", "window_s", Number, "s", Within(0.05, 3600.0), Fallback::Number(10.0),
        "Time constant of the exponential window; the shortest of `constant-trace`. At least 20 samples after decimation. On line only."),
    key("estimator", "window_deviation", Number, "sigma", Above(0.0, 100.0), Fallback::Number(0.1),
        "`constant-trace`: standard deviation that parameters are kept at, rms over all of them, of each one's torque on the reference \
         workload [torque-noise sigma]. Nothing is forgotten until it is reached."),
    key("estimator", "instruments", Choice(&["auto", "setpoint-through-loop", "setpoint", "second-encoder", "previous-cycle", "delayed"]), "", Bounds::None, Fallback::Text("auto"),
        "Motion that the instruments are computed from. `setpoint-through-loop`: the desired motion as the arm follows it, by a model of each joint's position loop identified while running. `setpoint`: the desired motion as it is. \
         `second-encoder`: the motion of second encoders (service `link-state`, log columns `q_link`). `previous-cycle`: the same phase of the previous cycle of repetitive work; delayed while none is found. `delayed`: the measured motion `delay_s` ago. \
         `auto` takes the first of them that is available, in this order, and the raw setpoint only until the loop is known. Health reports which."),
    key("estimator", "delay_s", Number, "s", Within(0.001, 1.0), Derived("20 ms, at least 2 sample periods"),
        "Age of delayed instruments. At least one sample period, at most 4096 samples after decimation. Off line it acts where a log has no desired \
         motion that the joints follow."),
    key("estimator", "longest_cycle_s", Number, "s", Within(1.0, 120.0), Fallback::Number(20.0),
        "`auto`, `previous-cycle`: longest cycle that is looked for. At 100 rows a second and six joints, 20 s take 300 kB."),
    key("estimator", "prior", Number, "-", Above(0.0, 100.0), Fallback::Number(1.0),
        "Relative standard deviation of the nominal parameters at the start; large is weak. Off line ten times as much."),

    key("supervision", "kind", Choice(&["tracked", "eigen", "columns", "off"]), "", Bounds::None, Fallback::Text("eigen"),
        "`tracked`: directions that follow the information from sample to sample. `eigen`: its eigenvalues and eigenvectors. `columns`: its column norms, angles, trace and condition number. `off`: no supervision. \
         All of `[supervision]` acts on line only. Off line the prior decides what the motion leaves open."),
    key("supervision", "tolerance", Number, "sigma", Above(0.0, 100.0), Fallback::Number(0.5),
        "`tracked`, `eigen`, `columns`: a direction moves once its standard deviation is below this many standard deviations of the torque noise. Its deviation is measured as torque on a reference workload. \
         With `tracked` and `eigen`, a direction that is already known less well than that moves as soon as the window knows it better."),
    key("supervision", "workload", Choice(&["one-way", "both-ways"]), "", Bounds::None, Fallback::Text("one-way"),
        "The reference workload: 300 random states of the arm, or each of them in both directions. With both directions, friction and bodies are not correlated by chance. A held value then stays itself, not only its torque together with another's (figure 18). \
         On short measured logs `one-way` had a slightly smaller residual (docs/figures.md)."),
    key("supervision", "hysteresis", Number, "-", Above(0.0, 1.0), Fallback::Number(0.7),
        "`tracked`, `eigen`: a moving direction is held again below this share of the eigenvalue that made it move."),
    key("supervision", "relevance", Number, "-", Within(0.0, 0.99), Fallback::Number(0.3),
        "`tracked`, `eigen`: a direction moves only while measured and instrument motion agree within this factor and its inverse; 0 is no guard."),
    key("supervision", "dwell", Integer, "samples", Within(0.0, 100_000.0), Fallback::Integer(20),
        "`tracked`: a direction that has come to be held stays so for at least this many samples after decimation."),
    key("supervision", "rounds", Integer, "-", Within(1.0, 64.0), Fallback::Integer(10),
        "`tracked`: rounds of rotations between two decisions. Decisions come at every thousandth of the window, after at least one row and at most five. Where more rows come within 8 ms, up to ten rows share a decision, with as many more rounds. \
         As many rounds as there are parameters turn the directions after any change."),
    key("supervision", "min_angle", Number, "rad", Within(0.0, 1.5), Fallback::Number(0.0873),
        "`columns`: two parameters whose columns enclose less than this angle do not both move."),
    key("supervision", "max_condition", Number, "-", Within(100.0, 1e16), Fallback::Number(1e8),
        "`columns`: condition number of the information above which everything is held."),

    key("publish", "every", Integer, "samples", Within(1.0, 100_000.0), Fallback::Integer(100),
        "Samples from one parameter message to the next."),
    key("publish", "consistent_hz", Number, "Hz", Within(0.0, 50.0), Fallback::Number(5.0),
        "How often the latest parameters are projected onto an arm that can be built and published as `parameters-consistent`, by a \
         thread that is not real-time; 0 switches it off."),
    key("publish", "health_every", Integer, "samples", Within(1.0, 1_000_000.0), Derived("1 s"),
        "Samples from one health message to the next, of daemon and controller. Where samples come too slowly, or not at all, time replaces the count. \
         A fault that begins or ends is reported at once."),

    key("realtime", "trigger", Choice(&["timer", "sample"]), "", Bounds::None, Fallback::Text("timer"),
        "What starts a period: an absolute timer, or the arrival of a sample. The timer makes one system call a period; waiting for a sample makes several, and can allocate."),
    key("realtime", "overrun", Choice(&["skip", "catch-up"]), "", Bounds::None, Fallback::Text("skip"),
        "After a period that came too late: skip the ones that have passed, or run them at once, one after the other. Samples are taken either way."),
    key("realtime", "scheduler", Choice(&["fifo", "deadline"]), "", Bounds::None, Fallback::Text("fifo"),
        "SCHED_FIFO with `priority`, or SCHED_DEADLINE with `deadline_share` of each sample period; the latter cannot be bound to a processor (`cpu`)."),
    key("realtime", "deadline_share", Number, "-", Within(0.05, 0.95), Fallback::Number(0.6),
        "Share of the sample period that SCHED_DEADLINE grants; the thread waits for the next period when it has used it up."),
    key("realtime", "priority", Integer, "-", Within(0.0, 98.0), Fallback::Integer(80),
        "SCHED_FIFO priority; 0 leaves the scheduler alone."),
    key("realtime", "cpu", Integer, "-", Within(0.0, 1023.0), Absent,
        "Processor the thread is bound to. Without it, the system chooses."),
    key("realtime", "lock_memory", Bool, "", Bounds::None, Fallback::Bool(true),
        "Lock all memory, so that no page fault reaches the loop."),
    key("realtime", "required", Bool, "", Bounds::None, Fallback::Bool(false),
        "Refuse to start where priority, processor or locking are denied. Otherwise warn and run without them."),
    key("realtime", "catch_up", Integer, "samples", Within(1.0, 1000.0), Fallback::Integer(16),
        "Most queued samples the daemon takes in one period after a delay."),
    key("realtime", "stale_periods", Integer, "periods", Within(1.0, 100_000.0), Fallback::Integer(20),
        "Periods without a new sample after which the daemon reports the input as stale."),

    key("controller", "law", Shape::Choice(&["computed-torque", "feed-forward-pd"]), "", Bounds::None, Fallback::Text("computed-torque"),
        "`computed-torque`: feedback through the inertia matrix of the acting parameters. `feed-forward-pd`: torque of the planned motion plus constant PD gains (bandwidth times the nominal inertia in the middle of the joint ranges). \
         Use the second where the drives close their own position or velocity loop."),
    key("controller", "bandwidth_hz", PerJointOrOne, "Hz", Within(0.01, 200.0), Derived("5 Hz, at most 0.02 of the sample rate"),
        "Bandwidth of the closed position loop: gains are w^2 and 2*damping*w with w = 2*pi*bandwidth. At most a tenth of the sample rate."),
    key("controller", "damping", Number, "-", Within(0.1, 5.0), Fallback::Number(1.0),
        "Damping ratio of the closed position loop."),
    key("controller", "integral_hz", Number, "Hz", Within(0.0, 100.0), Fallback::Number(0.0),
        "Corner of the integral action: its gain is the proportional gain times 2*pi*this. 0 switches it off. At most damping times the lowest bandwidth."),
    key("controller", "velocity_filter_hz", Number, "Hz", Within(0.1, 2000.0), Derived("100 Hz, at most 0.2 of the sample rate"),
        "Cut-off of the low-pass over the velocity that the controller differentiates from the positions."),
    key("controller", "rate_limit", PerJointOrOne, "N m/s", Within(0.01, 1e9), Absent,
        "Fastest change of the commanded torque. Without it: full torque in 0.1 s, 10*torque_limit a second."),
    key("controller", "stale_periods", Integer, "periods", Within(1.0, 1000.0), Derived("10, fewer where that is longer than 20 ms, at least 2"),
        "Periods without a usable joint state after which the stop reaction acts. Also the age at which a setpoint is no longer followed and the arm is held where it is."),
    key("controller", "stop_reaction", Shape::Choice(&["damp", "hold", "ramp"]), "", Bounds::None, Fallback::Text("damp"),
        "On a stop: `damp` brakes the motion by the model, then holds the arm where it stands; `hold` gives the torque that holds the last known pose; `ramp` reduces the last torque to zero. After `ramp` only friction and brakes hold the arm."),
    key("controller", "stop_time_s", Number, "s", Within(0.01, 10.0), Fallback::Number(0.2),
        "How long `ramp` and `damp` take."),
    key("controller", "resume_after", Integer, "samples", Within(0.0, 1_000_000.0), Derived("0.2 s"),
        "Valid samples in a row after which a stopped arm follows its plan again, as soon as that is within reach (0.2 rad). 0: only on request (`rivet control ROBOT.toml follow`)."),
    key("controller", "tracking_error", PerJointOrOne, "rad", Within(1e-4, 10.0), Fallback::Number(0.25),
        "Largest distance of a joint from its plan (m for a sliding joint). Beyond it the stop reaction acts."),
    key("controller", "saturation_ms", Number, "ms", Within(1.0, 10_000.0), Fallback::Number(200.0),
        "Longest time for which a commanded torque may be at its limit. After it the stop reaction acts."),
    key("controller", "unmodelled_torque", PerJointOrOne, "-", Within(0.05, 10.0), Fallback::Number(0.6),
        "Largest torque on a joint of a load that is grasped or of a contact, as a share of `drive.torque_limit`. A joint whose motion and commanded torque come apart by more does not answer: the stop reaction acts. Lower: a wrong encoder is found sooner."),
    key("controller", "torque_change", Number, "-", Above(0.0, 10.0), Fallback::Number(0.5),
        "A parameter set that would change a joint's torque at the present setpoint by more than this share of `drive.torque_limit` is not adopted."),
    key("controller", "parameter_timeout_s", Number, "s", Within(0.01, 600.0), Derived("1 s, at least five publications"),
        "Age at which a published set is too old; without an acceptable one for this long the last good parameters act."),
    key("controller", "return_after", Integer, "sets", Within(1.0, 1000.0), Fallback::Integer(5),
        "Acceptable sets in a row, apart enough to be judged by other torques, after which published parameters act (again)."),

    key("simulation", "torque_noise", PerJointOrOne, "N m", Within(0.0, 1e5), Fallback::Number(0.0),
        "Standard deviation of the white noise on the published torque."),
    key("simulation", "position_noise", PerJointOrOne, "rad", Within(0.0, 0.1), Fallback::Number(0.0),
        "Standard deviation of the white noise on the position, before it is quantised."),
    key("simulation", "seed", Integer, "-", Within(0.0, 1e9), Fallback::Integer(1),
        "Seed of the noise: the same seed, the same run."),

    key("bus", "prefix", Text, "", Bounds::None, Fallback::Text("rivet_"),
        "Beginning of every shared-memory name. 3 to 32 characters of a-z, A-Z, 0-9, `-`, `_`."),
    key("bus", "root", Text, "", Bounds::None, Fallback::Text("/tmp/rivet"),
        "Directory of the bus's management files; absolute, at most 120 bytes. Under systemd: `/run/rivet/<robot>`."),

    // Effects of known size: all keys are 0 where they are not given.
    key("effects.friction_asymmetry", "coulomb", PerJointOrOne, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Half the difference of Coulomb friction between the directions."),
    key("effects.friction_asymmetry", "viscous", PerJointOrOne, "N m s/rad", Magnitude(1e6), Fallback::Number(0.0),
        "Half the difference of viscous friction between the directions."),
    key("effects.stribeck_friction", "excess", PerJointOrOne, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Friction at standstill above Coulomb friction."),
    key("effects.stribeck_friction", "velocity", PerJointOrOne, "rad/s", Within(0.0, 100.0), Fallback::Number(0.0),
        "Speed at which it has fallen to 37 %; above 0 where `excess` is not 0."),
    key("effects.viscous_nonlinearity", "quadratic", PerJointOrOne, "N m s^2/rad^2", Magnitude(1e6), Fallback::Number(0.0),
        "Factor of `qd*|qd|`."),
    key("effects.viscous_nonlinearity", "cubic", PerJointOrOne, "N m s^3/rad^3", Magnitude(1e6), Fallback::Number(0.0),
        "Factor of `qd^3`."),
    key("effects.load_dependent_friction", "ratio", PerJointOrOne, "-", Magnitude(10.0), Fallback::Number(0.0),
        "Friction over carried torque."),
    key("effects.temperature_dependent_friction", "viscous", PerJointOrOne, "N m s/(rad K)", Magnitude(1e5), Fallback::Number(0.0),
        "Change of viscous friction per kelvin."),
    key("effects.temperature_dependent_friction", "coulomb", PerJointOrOne, "N m/K", Magnitude(1e5), Fallback::Number(0.0),
        "Change of Coulomb friction per kelvin."),
    key("effects.temperature_dependent_friction", "reference", PerJointOrOne, "degC or W", Magnitude(1e6), Fallback::Number(0.0),
        "Temperature at which `[friction]` holds, at most 1e3 degC either way; with a `time_constant` the friction power at which it does, 0 to 1e6 W."),
    key("effects.temperature_dependent_friction", "time_constant", PerJointOrOne, "s", Within(0.0, 1e5), Fallback::Number(0.0),
        "Time in which the joint warms up; 0: temperatures are measured."),
    key("effects.presliding_friction", "level", PerJointOrOne, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Friction that the spring takes over, about `friction.coulomb`."),
    key("effects.presliding_friction", "length", PerJointOrOne, "rad", Within(0.0, 1.0), Fallback::Number(0.0),
        "Travel in which friction builds up; above 0 where `level` is not 0."),
    key("effects.position_dependent_friction", "cosine", PerJointOrOne, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Amplitude of the cosine."),
    key("effects.position_dependent_friction", "sine", PerJointOrOne, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Amplitude of the sine."),
    key("effects.position_dependent_friction", "order", PerJointOrOne, "1/turn", Within(0.0, 1e5), Fallback::Number(0.0),
        "Cycles a turn of the joint; above 0 where an amplitude is not 0."),
    key("effects.torque_constant", "excess", PerJointOrOne, "-", Within(-0.9, 9.0), Fallback::Number(0.0),
        "Reported over given torque, less 1."),
    key("effects.torque_ripple", "cosine", PerJointOrOne, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Amplitude of the cosine."),
    key("effects.torque_ripple", "sine", PerJointOrOne, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Amplitude of the sine."),
    key("effects.torque_ripple", "order", PerJointOrOne, "1/turn", Within(0.0, 1e5), Fallback::Number(0.0),
        "Cycles a turn of the joint; above 0 where an amplitude is not 0."),
    key("effects.transmission_error", "cosine", PerJointOrOne, "rad", Magnitude(0.1), Fallback::Number(0.0),
        "Amplitude of the cosine."),
    key("effects.transmission_error", "sine", PerJointOrOne, "rad", Magnitude(0.1), Fallback::Number(0.0),
        "Amplitude of the sine."),
    key("effects.transmission_error", "order", PerJointOrOne, "1/turn", Within(0.0, 1e5), Fallback::Number(0.0),
        "Cycles a turn of the joint; above 0 where an amplitude is not 0."),
    key("effects.backlash", "gap", PerJointOrOne, "rad", Within(0.0, 0.1), Fallback::Number(0.0),
        "Whole play."),
    key("effects.backlash", "stiffness", PerJointOrOne, "N m/rad", Within(0.0, 1e9), Fallback::Number(0.0),
        "Of the gear in contact; above 0 where `gap` is."),
    key("effects.backlash", "damping", PerJointOrOne, "-", Within(0.0, 10.0), Fallback::Number(0.0),
        "Damping ratio at the joint's mean inertia."),
    key("effects.backlash", "share", PerJointOrOne, "-", Within(0.0, 2.0), Fallback::Number(1.0),
        "Share of the simulated torque that the data showed; 1 by the physics."),
    key("effects.joint_elasticity", "stiffness", PerJointOrOne, "N m/rad", Within(0.0, 1e9), Fallback::Number(0.0),
        "Of the gear."),
    key("effects.joint_elasticity", "damping", PerJointOrOne, "-", Within(0.0, 10.0), Fallback::Number(0.0),
        "Damping ratio at the joint's mean inertia."),
    key("effects.joint_elasticity", "share", PerJointOrOne, "-", Within(0.0, 2.0), Fallback::Number(1.0),
        "Share of the simulated torque that the data showed; 1 by the physics."),
    key("effects.joint_spring", "stiffness", PerJointOrOne, "N m/rad", Magnitude(1e6), Fallback::Number(0.0),
        "Of the spring."),
    key("effects.counterbalance", "lever", PerJointOrOne, "N m", Magnitude(1e7), Fallback::Number(0.0),
        "Torque by the spring's stiffness."),
    key("effects.counterbalance", "free_length", PerJointOrOne, "N m", Magnitude(1e7), Fallback::Number(0.0),
        "Torque by its pre-tension."),
    key("effects.counterbalance", "arm", PerJointOrOne, "-", Within(0.0, 100.0), Fallback::Number(0.0),
        "Ratio of the two distances; above 0 where there is torque."),
    key("effects.counterbalance", "phase", PerJointOrOne, "rad", Magnitude(10.0), Fallback::Number(0.0),
        "Angle between the points at q = 0."),
    key("effects.joint_coupling", "coulomb", PerJointOrOne, "N m", Magnitude(1e5), Fallback::Number(0.0),
        "Of the shared motor."),
    key("effects.joint_coupling", "viscous", PerJointOrOne, "N m s/rad", Magnitude(1e6), Fallback::Number(0.0),
        "Of the shared motor."),
    key("effects.joint_coupling", "rotor_inertia", PerJointOrOne, "kg m^2", Magnitude(1e5), Fallback::Number(0.0),
        "That couples the two joints."),
    key("effects.transport_delay", "delay", Number, "s", Within(0.0, 1.0), Fallback::Number(0.0),
        "How much later."),
    key("effects.current_loop_lag", "time_constant", Number, "s", Within(0.0, 1.0), Fallback::Number(0.0),
        "Of the lag."),
    key("effects.torque_saturation", "limit", PerJointOrOne, "N m", Within(0.0, 1e6), Fallback::Number(0.0),
        "0 means no limit."),
    key("effects.encoder_offset", "offset", PerJointOrOne, "rad", Magnitude(1.0), Fallback::Number(0.0),
        "What the encoder leaves out."),
    key("effects.encoder_eccentricity", "cosine", PerJointOrOne, "rad", Magnitude(0.1), Fallback::Number(0.0),
        "Amplitude of the cosine."),
    key("effects.encoder_eccentricity", "sine", PerJointOrOne, "rad", Magnitude(0.1), Fallback::Number(0.0),
        "Amplitude of the sine."),
    key("effects.base_flexibility", "compliance", Number, "rad/(N m)", Within(0.0, 1.0), Fallback::Number(0.0),
        "Of the spring; 0 is a base that stands."),
    key("effects.base_flexibility", "inertia", Number, "kg m^2", Within(0.0, 1e6), Fallback::Number(0.0),
        "Of what turns, without the arm."),
    key("effects.base_flexibility", "damping", Number, "N m s/rad", Within(0.0, 1e7), Fallback::Number(0.0),
        "Beside the spring."),
    key("effects.base_flexibility", "heading", Number, "rad", Magnitude(10.0), Fallback::Number(0.0),
        "Direction of the axis, from the base's x towards its y."),

    key("identified", "hash", Text, "", Bounds::None, Required,
        "Hash of the model the values belong to, 16 hexadecimal digits."),
    key("identified", "parameters", Shape::Parameters, "", Bounds::None, Required,
        "Every base parameter of the model, with value and standard deviation in the parameter's unit."),
    key("identified", "not_excited", Text, "", Bounds::None, Fallback::Text(""),
        "Joints at rest in the training logs and directions of the parameter space that these logs do not determine. `rivet predict` prints it."),
];

/// The declaration of a key.
pub(crate) fn find(section: &str, name: &str) -> Option<&'static Key> {
    KEYS.iter().find(|k| k.section == section && k.name == name)
}

/// Names of the keys of a section.
pub(crate) fn names(section: &str) -> impl Iterator<Item = &'static str> {
    KEYS.iter().filter(move |k| k.section == section).map(|k| k.name)
}

/// `docs/robot-toml.md`, made from the table above (`cargo run -p rivet-config --example reference`).
pub fn reference() -> String {
    let mut out = String::from(include_str!("reference_head.md"));
    for (section, meaning) in SECTIONS {
        let title = if section.is_empty() { "(top)".into() } else { format!("[{section}]") };
        // Writing to a String cannot fail.
        let _ = write!(out, "\n## {title}\n\n{meaning}\n\n");
        out.push_str("| key | value | unit | range | default | meaning |\n|---|---|---|---|---|---|\n");
        for key in KEYS.iter().filter(|k| k.section == *section) {
            let shape = match key.shape {
                Shape::Number => "number".into(),
                Shape::Integer => "integer".into(),
                Shape::Bool => "true, false".into(),
                Shape::Text => "text".into(),
                Shape::Choice(words) => words.iter().map(|w| format!("\"{w}\"")).collect::<Vec<_>>().join(", "),
                Shape::Vector => "[x, y, z]".into(),
                Shape::PerJoint => "one per joint".into(),
                Shape::PerJointOrOne => "one, or one per joint".into(),
                Shape::Joint => "joint number from 1, or joint name".into(),
                Shape::JointPositions => "{ joint = position }".into(),
                Shape::Parameters => "array of { name, value, std }".to_string(),
            };
            let range = key.bounds.text().replace('|', "\\|");
            let (name, unit, default, meaning) = (key.name, key.unit, key.fallback.text(), key.meaning);
            let _ = writeln!(out, "| `{name}` | {shape} | {unit} | {range} | {default} | {meaning} |");
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_is_sound() {
        for (i, key) in KEYS.iter().enumerate() {
            assert!(SECTIONS.iter().any(|(s, _)| *s == key.section), "{}: section has no line", key.path());
            assert!(!KEYS[..i].iter().any(|k| k.path() == key.path()), "{} declared twice", key.path());
            match key.fallback {
                Fallback::Number(x) => assert!(key.bounds.allow(x), "{}: default outside its range", key.path()),
                Fallback::Integer(x) => {
                    assert!(key.bounds.allow(x as f64), "{}: default outside its range", key.path());
                }
                Fallback::Text(x) => {
                    if let Shape::Choice(words) = key.shape {
                        assert!(words.contains(&x), "{}: default is no choice", key.path());
                    }
                }
                Fallback::Required | Fallback::Absent | Fallback::Derived(_) | Fallback::Bool(_) => {}
            }
        }
    }
}
