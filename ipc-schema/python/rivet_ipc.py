# Made by `cargo xtask mirrors` from src/messages and rivet_ipc.py.in. Do not edit.
"""rivet's messages for Python: the same bytes as the Rust structs in src/messages.

With the `iceoryx2` package of the version that the workspace uses:

    import iceoryx2 as iox2, rivet_ipc
    config = iox2.config.global_config()
    config.global_cfg.prefix = iox2.FileName.new("rivet_")            # [bus] prefix and root of the robot file
    config.global_cfg.root_path = iox2.Path.new("/tmp/rivet")
    node = (iox2.NodeBuilder.new().config(config)
            .signal_handling_mode(iox2.SignalHandlingMode.Disabled).create(iox2.ServiceType.Ipc))
    service = node.service_builder(iox2.ServiceName.new("rivet/ur10e/parameters"))
    subscriber = service.publish_subscribe(rivet_ipc.Parameters).open().subscriber_builder().create()
    sample = subscriber.receive()                                     # None, or a sample
    parameters = sample.payload().contents

Open services without requirements of your own, on the user account of the other processes. Stamps are
CLOCK_MONOTONIC [ns]. Run this file to check the layout on this machine.
"""

import ctypes

#: Most joints a message carries; entries from joints on are zero (or NaN where the field says so).
MAX_JOINTS = 8
#: Most base parameters a message carries; entries from count on are zero.
MAX_PARAMETERS = 128
#: Numbers of ConsistentParameters.bodies: ten a joint.
BODY_VALUES = 80
#: Longest ControlReply.text [bytes].
REPLY_TEXT = 1000
#: Entries of ControllerHealth.refusals.
REFUSALS = 16
#: Entries of ControllerHealth.stop_causes.
STOP_CAUSES = 24
#: Entries of DRIFT_REGIME.
DRIFT_REGIMES = 4
#: Bins of the histograms in Health: bin 0 counts 0 and 1 ns, bin b counts 2^b ..= 2^(b+1) - 1 ns, the last bin
#: everything from 2^31 ns (2.1 s) on.
HISTOGRAM_BINS = 32
#: Entries of Health.input_faults.
INPUT_FAULTS = 24
#: Phases of a period (LOOP_PHASE).
PHASES = 7
#: Worst periods that are kept.
WORST_PERIODS = 32

#: An encoder reading is not to be trusted.
FAULT_ENCODER = 1 << 0
#: A torque (current) reading is not to be trusted.
FAULT_TORQUE = 1 << 1
#: The drives are off or the brakes are closed: the torques do not belong to the motion.
FAULT_STOPPED = 1 << 2
#: Any other reason of the robot's not to learn from this sample.
FAULT_OTHER = 1 << 31

#: The estimator stands still for want of usable samples or excitation.
FLAG_SUSPENDED = 1 << 0
#: The estimator was stopped by a control request.
FLAG_FROZEN = 1 << 1
#: Too little data so far for the values to be used in a controller.
FLAG_PROVISIONAL = 1 << 2
#: Something is wrong with the samples (Health.input_fault): the values are those from before.
FLAG_BAD_INPUT = 1 << 3
#: Late: further behind its sample than `[realtime] stale_periods`.
FLAG_LATE = 1 << 4
#: Where the LOAD_LEVEL stands in the flags: two bits from this one on.
FLAG_LOAD_SHIFT = 8

#: Which model the torque of a Command was computed with.
COMMAND_MODE = {"none": 0, "nominal": 1, "identified": 2}
#: A wish to the daemon or the controller.
CONTROL_COMMAND = {"freeze": 0, "resume": 1, "reset": 2, "save": 3, "load": 4, "reload": 5, "follow": 6}
#: How a ControlRequest ended.
CONTROL_STATUS = {"done": 0, "refused": 1, "unknown": 2, "failed": 3}
#: Whose parameters make the torque (ControllerHealth.source).
PARAMETER_SOURCE = {"nominal": 0, "last_good": 1, "live": 2}
#: Why the source is what it is (ControllerHealth.source_reason).
SOURCE_REASON = {"start": 0, "stored": 1, "adopted": 2, "silent": 3, "refused": 4, "worse_than_nominal": 5, "better_than_nominal": 6, "inertia_not_positive": 7}
#: Why a published set may not act (ControllerHealth.last_refusal).
PARAMETER_REFUSAL = {"none": 0, "other_model": 1, "wrong_count": 2, "old": 3, "future": 4, "stale": 5, "epoch_back": 6, "provisional": 7, "not_finite": 8, "driving_friction": 9, "inertia_not_positive": 10, "torque_change": 11, "predicts_worse": 12, "not_judged": 13, "other_period": 14, "implausible": 15}
#: What the controller is doing (ControllerHealth.state).
CONTROLLER_STATE = {"waiting": 0, "holding": 1, "following": 2, "stopping": 3, "strayed": 4, "wrong_period": 5}
#: Why the stop reaction began (ControllerHealth.stop_cause).
STOP_CAUSE = {"none": 0, "silence": 1, "old_samples": 2, "robot_fault": 3, "wrong_shape": 4, "not_finite": 5, "implausible": 6, "wrong_period": 7, "frozen": 8, "encoder_jump": 9, "too_fast": 10, "no_response": 11, "sign_flipped": 12, "torque_stuck": 13, "saturated": 14, "tracking_error": 15, "plan_not_finite": 16, "plan_implausible": 17, "plan_jump": 18, "plan_acceleration": 19}
#: How a joint moves.
DRIFT_REGIME = {"reversal": 0, "slow": 1, "cruise": 2, "accelerating": 3}
#: Whether the arm is still the one that was accepted (Drift.verdict).
DRIFT_VERDICT = {"unresolved": 0, "within": 1, "left": 2}
#: What is wrong with the samples.
INPUT_FAULT = {"none": 0, "lost": 1, "duplicate": 2, "reordered": 3, "frozen": 4, "not_finite": 5, "saturated": 6, "sign_flipped": 7, "time_jump": 8, "encoder_jump": 9, "torque_stuck": 10, "publisher_gone": 11, "publisher_restarted": 12, "second_publisher": 13, "clock_suspended": 14, "robot_fault": 15, "wrong_period": 16, "wrong_shape": 17, "implausible": 18, "wrong_version": 19, "shared_memory_full": 20}
#: Whether a process can write its state folder (Health.state_folder, ControllerHealth.state_folder).
STATE_FOLDER = {"none": 0, "writable": 1, "unwritable": 2, "full": 3}
#: What is left out because periods have become too short for the work, each level beside those before it.
LOAD_LEVEL = {"normal": 0, "publish_less": 1, "decimate": 2, "hold": 3}
#: What the daemon is doing (Health.mode).
DAEMON_MODE = {"starting": 0, "estimating": 1, "suspended": 2, "frozen": 3, "stale": 4, "wrong_period": 5, "bad_input": 6}
#: What became of one parameter (Parameters.state). On the wire one byte.
PARAMETER_STATE = {"unidentified": 0, "active": 1, "held": 2}
#: Where the instruments of the instrumental-variable estimator come from.
INSTRUMENT_SOURCE = {"none": 0, "setpoint": 1, "delayed": 2, "setpoint_through_loop": 3, "second_encoder": 4, "previous_cycle": 5}
#: A part of a period.
LOOP_PHASE = {"wait": 0, "read": 1, "differentiate": 2, "model": 3, "estimate": 4, "supervise": 5, "publish": 6}
#: Why a period was long (Timing.worst_cause).
PERIOD_CAUSE = {"late_wake_up": 0, "long_read": 1, "own_work": 2, "page_fault": 3, "migration": 4, "involuntary_switch": 5}


class _Message(ctypes.Structure):
    TYPE_NAME = ""

    @classmethod
    def type_name(cls):
        """The name that the bus compares; read by the iceoryx2 package."""
        return cls.TYPE_NAME


class Command(_Message):
    """The torque the controller asks for, latest value on blackboard `rivet/<robot>/command`.

    A robot ignores a command whose stamp_ns is older than a few periods: a blackboard keeps the last value of a
    writer that has died.
    """

    TYPE_NAME = "rivet.Command.v1"
    _fields_ = [
        # seq of the joint state this answers.
        ("seq", ctypes.c_uint64),
        # When the torque was computed, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Torque each drive shall apply to its joint [N m, or N], positive about (along) the joint's axis.
        ("tau", ctypes.c_double * MAX_JOINTS),
        # How many entries of the array are in use, 1..=8.
        ("joints", ctypes.c_uint32),
        # A COMMAND_MODE.
        ("mode", ctypes.c_uint32),
    ]


class ConsistentParameters(_Message):
    """Physically consistent parameters near estimated ones, a few times a second, on service
    `rivet/<robot>/parameters-consistent`: of an arm that can be built, with a mass matrix that is positive
    definite in every pose. The estimated set itself, without that constraint, is on `rivet/<robot>/parameters`.

    Which of the estimated sets is taken depends on when the projection has time; what becomes of one does not.
    """

    TYPE_NAME = "rivet.ConsistentParameters.v1"
    _fields_ = [
        # Parameters.epoch of the estimated set this was made from.
        ("epoch", ctypes.c_uint64),
        # seq of that set.
        ("seq", ctypes.c_uint64),
        # stamp_ns of that set, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # model_hash of that set.
        ("model_hash", ctypes.c_uint64),
        # How many entries of values are in use.
        ("count", ctypes.c_uint32),
        # How many joints there are, 1..=8.
        ("joints", ctypes.c_uint32),
        # flags of that set.
        ("flags", ctypes.c_uint32),
        # Zero. Padding is spelt out, so the layout can be read off the source.
        ("reserved", ctypes.c_uint32),
        # Base parameters, in the order and units of the estimated ones.
        ("values", ctypes.c_double * MAX_PARAMETERS),
        # The link that each joint moves, ten numbers each: mass [kg], first moment x y z [kg m], inertia about the
        # joint frame's origin xx xy yy xz yz zz [kg m^2], in the joint frame. What torque cannot tell is as in the
        # URDF.
        ("bodies", ctypes.c_double * BODY_VALUES),
        # Torque between this set and the estimated one on the reference workload, RMS of each joint [N m, or N].
        ("torque_rms", ctypes.c_double * MAX_JOINTS),
        # The same over all joints, each in parts of its own torque [%].
        ("torque_percent", ctypes.c_double),
        # Smallest eigenvalue of any link's pseudo-inertia [kg, kg m, kg m^2]: above zero.
        ("smallest_eigenvalue", ctypes.c_double),
    ]


class ControlRequest(_Message):
    """What anyone may ask of the daemon, on service `rivet/<robot>/control`, and of the controller, on
    `rivet/<robot>/controller-control`.
    """

    TYPE_NAME = "rivet.ControlRequest.v1"
    _fields_ = [
        # A CONTROL_COMMAND.
        ("command", ctypes.c_uint32),
        # Zero. Padding is spelt out, so the layout can be read off the source.
        ("reserved", ctypes.c_uint32),
    ]


class ControlReply(_Message):
    """The daemon's answer to a ControlRequest. Version 2 says why."""

    TYPE_NAME = "rivet.ControlReply.v2"
    _fields_ = [
        # A CONTROL_STATUS.
        ("status", ctypes.c_uint32),
        # How many bytes of text are in use.
        ("length", ctypes.c_uint32),
        # Epoch of the parameters in force when the answer was given.
        ("epoch", ctypes.c_uint64),
        # What was done, or why it was not, in UTF-8; the rest is zero.
        ("text", ctypes.c_uint8 * REPLY_TEXT),
    ]


class ControllerHealth(_Message):
    """How the controller is doing and which parameters it trusts, a few times a second and at every change, on
    service `rivet/<robot>/controller-health`.

    Counters run since the controller's start and never go back.
    """

    TYPE_NAME = "rivet.ControllerHealth.v5"
    _fields_ = [
        # seq of the last joint state answered.
        ("seq", ctypes.c_uint64),
        # When this was written, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Joint states answered with a command.
        ("commands", ctypes.c_uint64),
        # Joint states skipped over: the controller takes the newest.
        ("passed_over", ctypes.c_uint64),
        # Joint states not answered because their sequence number did not go forward.
        ("refused_stale", ctypes.c_uint64),
        # Joint states not answered because of fault bits, a wrong joint count, a position that is not finite or a wrong
        # rate.
        ("refused_invalid", ctypes.c_uint64),
        # Times the stop reaction began.
        ("stops", ctypes.c_uint64),
        # Commands in which the law gave a torque that is not finite.
        ("broken", ctypes.c_uint64),
        # Commands in which a joint was at its torque limit.
        ("saturated", ctypes.c_uint64),
        # Commands in which a joint's torque was held back by its rate limit.
        ("rate_limited", ctypes.c_uint64),
        # Setpoints that were beyond a joint's position or velocity limit and were brought back to it.
        ("setpoints_limited", ctypes.c_uint64),
        # Parameter sets that passed the gate.
        ("accepted", ctypes.c_uint64),
        # Times the source of the parameters changed.
        ("switches", ctypes.c_uint64),
        # Epoch of the set accepted last; 0 before the first.
        ("epoch", ctypes.c_uint64),
        # seq of the last joint state that went into that set.
        ("parameters_seq", ctypes.c_uint64),
        # Joint states of a second publisher, left out while the first one sends.
        ("foreign_joint_states", ctypes.c_uint64),
        # Setpoints of a second publisher, left out likewise.
        ("foreign_setpoints", ctypes.c_uint64),
        # Parameter sets of a second publisher, left out likewise.
        ("foreign_parameters", ctypes.c_uint64),
        # Times a joint came further from its plan than `[controller] tracking_error`.
        ("strayed", ctypes.c_uint64),
        # Setpoints that were refused: not finite, absurd, a jump, or beyond the drives' torque.
        ("setpoints_refused", ctypes.c_uint64),
        # Times the plan was followed again after a stop.
        ("resumed", ctypes.c_uint64),
        # How often the stop reaction began for which STOP_CAUSE; the entry is its number.
        ("stop_causes", ctypes.c_uint64 * STOP_CAUSES),
        # How many sets were refused for which PARAMETER_REFUSAL; the entry is its number.
        ("refusals", ctypes.c_uint64 * REFUSALS),
        # A PARAMETER_SOURCE: whose parameters make the torque.
        ("source", ctypes.c_uint32),
        # A SOURCE_REASON: why it is this source.
        ("source_reason", ctypes.c_uint32),
        # A PARAMETER_REFUSAL: what became of the last set.
        ("last_refusal", ctypes.c_uint32),
        # A CONTROLLER_STATE.
        ("state", ctypes.c_uint32),
        # A STOP_CAUSE: why the stop reaction began last.
        ("stop_cause", ctypes.c_uint32),
        # Joints that this concerns, bit 0 the base's; 0 where it concerns none or all.
        ("stop_joints", ctypes.c_uint32),
        # A STOP_CAUSE: why a setpoint was refused last.
        ("plan_refusal", ctypes.c_uint32),
        # Joints that this concerns, likewise.
        ("plan_joints", ctypes.c_uint32),
        # How many entries of the joint arrays are in use, 1..=8.
        ("joints", ctypes.c_uint32),
        # A STATE_FOLDER: whether flight records can be written.
        ("state_folder", ctypes.c_uint32),
        # RMS of planned minus measured position over about the last second [rad, or m].
        ("tracking_rms", ctypes.c_double * MAX_JOINTS),
        # RMS error of the acting parameters on the recent torques of each joint [N m, or N]; NaN where it did not move.
        ("prediction_rms", ctypes.c_double * MAX_JOINTS),
        # The same of the robot file's parameters.
        ("nominal_prediction_rms", ctypes.c_double * MAX_JOINTS),
        # Largest step of the command from one period to the next [N m, or N].
        ("largest_step", ctypes.c_double * MAX_JOINTS),
        # 1 while joint states come without the wake-up event, so that the controller polls; else 0.
        ("polls", ctypes.c_uint32),
        # Zero. Padding is spelt out, so the layout can be read off the source.
        ("reserved", ctypes.c_uint32),
    ]


class Drift(_Message):
    """What the accepted model leaves of each joint's torque, by how the joint moves, and whether the arm has left
    it; with every health message, on service `rivet/<robot>/drift`.

    The accepted model is the robot file's, as the daemon read it last. Arrays by regime have MAX_JOINTS numbers
    of the first regime, then of the next; NaN where nothing is known yet.
    """

    TYPE_NAME = "rivet.Drift.v1"
    _fields_ = [
        # seq of the last joint state taken in.
        ("seq", ctypes.c_uint64),
        # When this was written, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Hash of the model with its robot file, as in Parameters.
        ("model_hash", ctypes.c_uint64),
        # How many entries of the arrays are in use, 1..=8.
        ("joints", ctypes.c_uint32),
        # A DRIFT_VERDICT: left if any joint has, unresolved if none has left and any is unresolved.
        ("verdict", ctypes.c_uint32),
        # A DRIFT_VERDICT each.
        ("joint_verdict", ctypes.c_uint32 * MAX_JOINTS),
        # seq of the joint state with which each joint's verdict became what it is.
        ("since_seq", ctypes.c_uint64 * MAX_JOINTS),
        # RMS residual of now over that after acceptance, over the same regimes; NaN while unresolved.
        ("ratio", ctypes.c_double * MAX_JOINTS),
        # RMS torque residual with the accepted model over the last seconds of motion in a regime [N m, or N].
        ("residual_rms", ctypes.c_double * (DRIFT_REGIMES * MAX_JOINTS)),
        # The same over the first seconds in it after the model was accepted.
        ("reference_rms", ctypes.c_double * (DRIFT_REGIMES * MAX_JOINTS)),
    ]


class Health(_Message):
    """How the daemon is doing, a few times a second, on service `rivet/<robot>/health`.

    Counters run since the daemon's start and never go back. Version 2 adds what the estimator says about its
    instruments and its window, version 3 how far least squares can be trusted beside them, version 4 what is
    wrong with the input and how much of the work is done, version 5 what was left aside, version 6 whether the
    state folder can be written, version 7 whether samples come without the wake-up event.
    """

    TYPE_NAME = "rivet.Health.v7"
    _fields_ = [
        # seq of the last joint state taken in.
        ("seq", ctypes.c_uint64),
        # When this was written, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Joint states taken into the estimator.
        ("samples", ctypes.c_uint64),
        # Joint states missing between sequence numbers.
        ("lost", ctypes.c_uint64),
        # Joint states refused because their sequence number or stamp did not go forward.
        ("refused_stale", ctypes.c_uint64),
        # Joint states refused because a value was not finite or could not be true, or joint count or period were wrong.
        ("refused_invalid", ctypes.c_uint64),
        # Joint states not used because the robot set a fault bit.
        ("rejected_faults", ctypes.c_uint64),
        # Interruptions of the stream after which the filters started anew.
        ("gaps", ctypes.c_uint64),
        # Joint states without a setpoint of their own sequence number.
        ("setpoints_missing", ctypes.c_uint64),
        # Periods that ended with samples still queued: the bound on catching up was reached.
        ("catch_up_limited", ctypes.c_uint64),
        # Periods of the real-time thread.
        ("periods", ctypes.c_uint64),
        # Periods that were missed because the thread woke or finished too late.
        ("overruns", ctypes.c_uint64),
        # Messages the real-time thread could not hand to the publishing thread.
        ("dropped_messages", ctypes.c_uint64),
        # Parameters held at present.
        ("held", ctypes.c_uint32),
        # Parameters following the data at present.
        ("active", ctypes.c_uint32),
        # A DAEMON_MODE.
        ("mode", ctypes.c_uint32),
        # An INSTRUMENT_SOURCE.
        ("instruments", ctypes.c_uint32),
        # RMS torque residual of each joint with the estimated parameters over the window [N m, or N].
        ("residual_rms", ctypes.c_double * MAX_JOINTS),
        # The same with the nominal parameters [N m, or N].
        ("nominal_residual_rms", ctypes.c_double * MAX_JOINTS),
        # RMS filtered torque of each joint over the same rows [N m, or N].
        ("torque_rms", ctypes.c_double * MAX_JOINTS),
        # Lateness of the wake-ups, see HISTOGRAM_BINS.
        ("wake_histogram", ctypes.c_uint32 * HISTOGRAM_BINS),
        # Work of a period from wake-up to done, see HISTOGRAM_BINS.
        ("work_histogram", ctypes.c_uint32 * HISTOGRAM_BINS),
        # Latest wake-up [ns].
        ("worst_wake_ns", ctypes.c_uint64),
        # Longest work of a period [ns].
        ("worst_work_ns", ctypes.c_uint64),
        # Delay of each joint behind its setpoint in slow motion [s], by the identified closed loop; NaN while unknown.
        ("loop_lag_s", ctypes.c_double * MAX_JOINTS),
        # Length of the cycle that the motion repeats [s]; NaN while none is known.
        ("cycle_s", ctypes.c_double),
        # Length of the window [s of motion]; infinite while nothing is forgotten.
        ("window_s", ctypes.c_double),
        # Durbin-Wu-Hausman statistic of the window: least squares (Parameters.reference) against the instruments; NaN
        # while unknown.
        ("hausman", ctypes.c_double),
        # Probability of a statistic as large as that if the regressor has no noise and the model is complete; NaN while
        # unknown.
        ("hausman_p_value", ctypes.c_double),
        # What noise in each joint's regressor puts on least squares, over what is left of it with instruments; NaN
        # while unknown, and with delayed instruments, near 1 where the instruments see the same noise or the arm is far
        # from its setpoint.
        ("instrument_ratio", ctypes.c_double * MAX_JOINTS),
        # Degrees of freedom of the statistic: joints whose regressor and instruments differ.
        ("hausman_degrees", ctypes.c_uint32),
        # An INPUT_FAULT: what is wrong with the samples now.
        ("input_fault", ctypes.c_uint32),
        # The joints that it concerns, bit 0 the base's; zero where it concerns all or none.
        ("input_joints", ctypes.c_uint32),
        # An INPUT_FAULT: what was wrong last, now or before.
        ("last_input_fault", ctypes.c_uint32),
        # A LOAD_LEVEL: what is left out because periods have become too short for the work.
        ("load_level", ctypes.c_uint32),
        # Publishers of joint states at present: one, and one more where a network bridge mirrors them.
        ("publishers", ctypes.c_uint32),
        # Times that each INPUT_FAULT was met, by number: samples, or events where it is none of a sample.
        ("input_faults", ctypes.c_uint64 * INPUT_FAULTS),
        # From the last faulty sample to the next row that was learnt from, of the last fault that is over [s]; NaN
        # before.
        ("recovery_s", ctypes.c_double),
        # Times that the load level changed.
        ("load_changes", ctypes.c_uint64),
        # seq of the first sample under the present load level.
        ("load_seq", ctypes.c_uint64),
        # Parameter sets that were late: more than `[realtime] stale_periods` behind the sample they were made from,
        # reckoned from the least such delay seen. They carry that sample's stamp, as all do.
        ("late_sets", ctypes.c_uint64),
        # Sound joint states that were left aside under LOAD_LEVEL["hold"]; they are not among samples.
        ("samples_held", ctypes.c_uint64),
        # Rows that were not learnt from because their torques are in doubt: signs, stuck sensors.
        ("rows_doubted", ctypes.c_uint64),
        # A STATE_FOLDER: whether parameters and flight records can be written.
        ("state_folder", ctypes.c_uint32),
        # 1 while joint states come without the wake-up event, so that a daemon that waits for it polls; else 0.
        ("polls", ctypes.c_uint32),
    ]


class JointState(_Message):
    """The arm's measured state, one per control period, on service `rivet/<robot>/joint-state`.

    Joints run from base to flange. All joint quantities are on the output side of the gear.
    """

    TYPE_NAME = "rivet.JointState.v1"
    _fields_ = [
        # +1 each period; a jump is a lost sample.
        ("seq", ctypes.c_uint64),
        # When the encoders were latched, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Joint positions [rad, or m for a prismatic joint].
        ("q", ctypes.c_double * MAX_JOINTS),
        # Torque of each drive on its joint [N m, or N], positive about (along) the joint's axis; what the drive
        # applies, not what it feels.
        ("tau", ctypes.c_double * MAX_JOINTS),
        # Temperature of each drive [degC]; NaN where none is measured.
        ("temperature", ctypes.c_double * MAX_JOINTS),
        # How many entries of the arrays are in use, 1..=8.
        ("joints", ctypes.c_uint32),
        # Fault bits (FAULT_*); zero means every field may be used.
        ("faults", ctypes.c_uint32),
    ]


class LinkState(_Message):
    """What second encoders see, on service `rivet/<robot>/link-state`; only for robots that have them.

    It carries the seq of the joint state of the same period and is published *before* it, as the setpoint is:
    whoever takes in a joint state already holds what belongs to it. A service of its own leaves joint states as
    they are.
    """

    TYPE_NAME = "rivet.LinkState.v1"
    _fields_ = [
        # seq of the joint state this belongs to.
        ("seq", ctypes.c_uint64),
        # When the encoders were latched, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Joint positions by the second encoder of each joint, in the zero and sign of the first [rad, or m for a
        # prismatic joint]; NaN where a joint has none.
        ("q", ctypes.c_double * MAX_JOINTS),
        # How many entries of the array are in use, 1..=8.
        ("joints", ctypes.c_uint32),
        # Zero. No bit has a meaning yet; a reader ignores those it does not know.
        ("flags", ctypes.c_uint32),
    ]


class Parameters(_Message):
    """The base parameters as estimated, on service `rivet/<robot>/parameters` and, latest value, on the blackboard
    of the same name.

    What parameter i means follows from the robot file; two processes whose model_hash is equal mean the same by
    it. Units are those of the parameter (kg, kg m, kg m^2, N m, N m s/rad, ...). Version 2 adds the sample
    period.
    """

    TYPE_NAME = "rivet.Parameters.v2"
    _fields_ = [
        # +1 each publication of one daemon, from 1.
        ("epoch", ctypes.c_uint64),
        # seq of the last joint state that went in.
        ("seq", ctypes.c_uint64),
        # When the estimate was made, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Says what the numbers mean: kinematics, gravity, structure and base columns of the model.
        ("model_hash", ctypes.c_uint64),
        # How many entries of the parameter arrays are in use.
        ("count", ctypes.c_uint32),
        # How many entries of the joint arrays are in use, 1..=8.
        ("joints", ctypes.c_uint32),
        # Bits of FLAG_*.
        ("flags", ctypes.c_uint32),
        # An INSTRUMENT_SOURCE.
        ("instruments", ctypes.c_uint32),
        # Estimated values; a parameter not identified keeps its nominal value.
        ("values", ctypes.c_double * MAX_PARAMETERS),
        # Standard deviation (1 sigma) of each value.
        ("std", ctypes.c_double * MAX_PARAMETERS),
        # Information of the window on each parameter, over that from which it moves if it stands alone: below 1 nothing
        # is learnt about it.
        ("excitation", ctypes.c_double * MAX_PARAMETERS),
        # The same parameters by plain recursive least squares, for comparison.
        ("reference", ctypes.c_double * MAX_PARAMETERS),
        # A PARAMETER_STATE each.
        ("state", ctypes.c_uint8 * MAX_PARAMETERS),
        # Torque noise of each joint (1 sigma, after the model filter) that weighted its rows [N m, or N].
        ("torque_noise", ctypes.c_double * MAX_JOINTS),
        # RMS of the torque residual of each joint over the window [N m, or N].
        ("residual_rms", ctypes.c_double * MAX_JOINTS),
        # Sample period with which the daemon reckons [s]: derivatives are wrong where it is not the true one.
        ("sample_period_s", ctypes.c_double),
    ]


class Setpoint(_Message):
    """The planned motion of one period, on service `rivet/<robot>/setpoint`.

    It carries the seq of the joint state of the same period and is published *before* it, so that whoever takes
    in a joint state already holds its setpoint.
    """

    TYPE_NAME = "rivet.Setpoint.v1"
    _fields_ = [
        # seq of the joint state this plan belongs to.
        ("seq", ctypes.c_uint64),
        # The instant the plan is for, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Planned joint positions [rad, or m for a prismatic joint].
        ("q", ctypes.c_double * MAX_JOINTS),
        # Planned joint velocities [rad/s, m/s].
        ("qd", ctypes.c_double * MAX_JOINTS),
        # Planned joint accelerations [rad/s^2, m/s^2].
        ("qdd", ctypes.c_double * MAX_JOINTS),
        # How many entries of the arrays are in use, 1..=8.
        ("joints", ctypes.c_uint32),
        # Zero. No bit has a meaning yet; a reader ignores those it does not know.
        ("flags", ctypes.c_uint32),
    ]


class Timing(_Message):
    """Where the daemon's real-time thread spends its time, with every health message, on service
    `rivet/<robot>/timing`.

    Counts run since the daemon's start.
    """

    TYPE_NAME = "rivet.Timing.v1"
    _fields_ = [
        # When this was written, CLOCK_MONOTONIC [ns].
        ("stamp_ns", ctypes.c_uint64),
        # Periods of the real-time thread.
        ("periods", ctypes.c_uint64),
        # The time between periods that it is to keep [ns].
        ("period_ns", ctypes.c_uint64),
        # How many entries of the arrays of worst periods are in use.
        ("count", ctypes.c_uint32),
        # Zero. Padding is spelt out, so the layout can be read off the source.
        ("reserved", ctypes.c_uint32),
        # Longest time of each phase [ns].
        ("phase_max_ns", ctypes.c_uint64 * PHASES),
        # Time of each phase: 32 bins of the first phase, then of the next; bins as of Health.
        ("phase_histogram", ctypes.c_uint32 * (PHASES * HISTOGRAM_BINS)),
        # When each of the worst periods of the last hour was due, CLOCK_MONOTONIC [ns], the worst first.
        ("worst_stamp_ns", ctypes.c_uint64 * WORST_PERIODS),
        # Time of each phase of it [ns], seven numbers a period; the wait is the lateness of the wake-up.
        ("worst_phase_ns", ctypes.c_uint32 * (WORST_PERIODS * PHASES)),
        # A PERIOD_CAUSE each.
        ("worst_cause", ctypes.c_uint32 * WORST_PERIODS),
    ]


#: Size and offsets [bytes] as the Rust side has them.
LAYOUT = {
    Command: (88, {
        "seq": 0,
        "stamp_ns": 8,
        "tau": 16,
        "joints": 80,
        "mode": 84,
    }),
    ConsistentParameters: (1792, {
        "epoch": 0,
        "seq": 8,
        "stamp_ns": 16,
        "model_hash": 24,
        "count": 32,
        "joints": 36,
        "flags": 40,
        "reserved": 44,
        "values": 48,
        "bodies": 1072,
        "torque_rms": 1712,
        "torque_percent": 1776,
        "smallest_eigenvalue": 1784,
    }),
    ControlRequest: (8, {
        "command": 0,
        "reserved": 4,
    }),
    ControlReply: (1016, {
        "status": 0,
        "length": 4,
        "epoch": 8,
        "text": 16,
    }),
    ControllerHealth: (792, {
        "seq": 0,
        "stamp_ns": 8,
        "commands": 16,
        "passed_over": 24,
        "refused_stale": 32,
        "refused_invalid": 40,
        "stops": 48,
        "broken": 56,
        "saturated": 64,
        "rate_limited": 72,
        "setpoints_limited": 80,
        "accepted": 88,
        "switches": 96,
        "epoch": 104,
        "parameters_seq": 112,
        "foreign_joint_states": 120,
        "foreign_setpoints": 128,
        "foreign_parameters": 136,
        "strayed": 144,
        "setpoints_refused": 152,
        "resumed": 160,
        "stop_causes": 168,
        "refusals": 360,
        "source": 488,
        "source_reason": 492,
        "last_refusal": 496,
        "state": 500,
        "stop_cause": 504,
        "stop_joints": 508,
        "plan_refusal": 512,
        "plan_joints": 516,
        "joints": 520,
        "state_folder": 524,
        "tracking_rms": 528,
        "prediction_rms": 592,
        "nominal_prediction_rms": 656,
        "largest_step": 720,
        "polls": 784,
        "reserved": 788,
    }),
    Drift: (704, {
        "seq": 0,
        "stamp_ns": 8,
        "model_hash": 16,
        "joints": 24,
        "verdict": 28,
        "joint_verdict": 32,
        "since_seq": 64,
        "ratio": 128,
        "residual_rms": 192,
        "reference_rms": 448,
    }),
    Health: (1016, {
        "seq": 0,
        "stamp_ns": 8,
        "samples": 16,
        "lost": 24,
        "refused_stale": 32,
        "refused_invalid": 40,
        "rejected_faults": 48,
        "gaps": 56,
        "setpoints_missing": 64,
        "catch_up_limited": 72,
        "periods": 80,
        "overruns": 88,
        "dropped_messages": 96,
        "held": 104,
        "active": 108,
        "mode": 112,
        "instruments": 116,
        "residual_rms": 120,
        "nominal_residual_rms": 184,
        "torque_rms": 248,
        "wake_histogram": 312,
        "work_histogram": 440,
        "worst_wake_ns": 568,
        "worst_work_ns": 576,
        "loop_lag_s": 584,
        "cycle_s": 648,
        "window_s": 656,
        "hausman": 664,
        "hausman_p_value": 672,
        "instrument_ratio": 680,
        "hausman_degrees": 744,
        "input_fault": 748,
        "input_joints": 752,
        "last_input_fault": 756,
        "load_level": 760,
        "publishers": 764,
        "input_faults": 768,
        "recovery_s": 960,
        "load_changes": 968,
        "load_seq": 976,
        "late_sets": 984,
        "samples_held": 992,
        "rows_doubted": 1000,
        "state_folder": 1008,
        "polls": 1012,
    }),
    JointState: (216, {
        "seq": 0,
        "stamp_ns": 8,
        "q": 16,
        "tau": 80,
        "temperature": 144,
        "joints": 208,
        "faults": 212,
    }),
    LinkState: (88, {
        "seq": 0,
        "stamp_ns": 8,
        "q": 16,
        "joints": 80,
        "flags": 84,
    }),
    Parameters: (4408, {
        "epoch": 0,
        "seq": 8,
        "stamp_ns": 16,
        "model_hash": 24,
        "count": 32,
        "joints": 36,
        "flags": 40,
        "instruments": 44,
        "values": 48,
        "std": 1072,
        "excitation": 2096,
        "reference": 3120,
        "state": 4144,
        "torque_noise": 4272,
        "residual_rms": 4336,
        "sample_period_s": 4400,
    }),
    Setpoint: (216, {
        "seq": 0,
        "stamp_ns": 8,
        "q": 16,
        "qd": 80,
        "qdd": 144,
        "joints": 208,
        "flags": 212,
    }),
    Timing: (2264, {
        "stamp_ns": 0,
        "periods": 8,
        "period_ns": 16,
        "count": 24,
        "reserved": 28,
        "phase_max_ns": 32,
        "phase_histogram": 88,
        "worst_stamp_ns": 984,
        "worst_phase_ns": 1240,
        "worst_cause": 2136,
    }),
}


def check():
    """Raises AssertionError where ctypes lays a message out differently from Rust."""
    for message, (size, offsets) in LAYOUT.items():
        assert ctypes.sizeof(message) == size, message.TYPE_NAME
        assert [name for name, _ in message._fields_] == list(offsets), message.TYPE_NAME
        for name, offset in offsets.items():
            assert getattr(message, name).offset == offset, f"{message.TYPE_NAME}: {name}"


if __name__ == "__main__":
    check()
    print("layout ok:", ", ".join(message.TYPE_NAME for message in LAYOUT))
