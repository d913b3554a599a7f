/* Made by `cargo xtask mirrors` from src/messages and rivet.h.in. Do not edit. */
/* rivet's messages for C and C++: the same bytes as the Rust structs in src/messages. The type names are what the bus
 * compares; a new layout or meaning gets a new one.
 *
 * Services of a robot, rivet/<robot>/...:
 *
 *   joint-state: Publish-subscribe, and an event of the same name: robot controller -> all.
 *   setpoint: Publish-subscribe: planner -> all.
 *   link-state: Publish-subscribe: robot controller -> all, where joints have second encoders.
 *   command: Blackboard: controller -> robot.
 *   parameters: Publish-subscribe with history 1, and a blackboard of the same name: daemon -> all.
 *   parameters-consistent: Publish-subscribe with history 1: daemon -> all; the same as an arm that can be built.
 *   health: Publish-subscribe: daemon -> all.
 *   timing: Publish-subscribe: daemon -> all.
 *   drift: Publish-subscribe: daemon -> all.
 *   controller-health: Publish-subscribe: controller -> all.
 *   control: Request-response: anyone -> daemon.
 *   controller-control: Request-response: anyone -> controller.
 *
 * The comment of a message names its service. A blackboard has one entry, key uint64_t 0, and the attribute rivet.type
 * that names the type. After each joint-state the robot controller notifies the event service of the same name,
 * rivet/<robot>/joint-state, with event id 0: it wakes rivet-controller. Stamps are CLOCK_MONOTONIC [ns]. */
#ifndef RIVET_H
#define RIVET_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define RIVET_ASSERT(condition) static_assert(condition, #condition)
#else
#define RIVET_ASSERT(condition) _Static_assert(condition, #condition)
#endif

/* Most joints a message carries; entries from joints on are zero (or NaN where the field says so). */
#define RIVET_MAX_JOINTS 8
/* Most base parameters a message carries; entries from count on are zero. */
#define RIVET_MAX_PARAMETERS 128
/* Numbers of rivet_consistent_parameters_v1.bodies: ten a joint. */
#define RIVET_BODY_VALUES 80
/* Longest rivet_control_reply_v2.text [bytes]. */
#define RIVET_REPLY_TEXT 1000
/* Entries of rivet_controller_health_v5.refusals. */
#define RIVET_REFUSALS 16
/* Entries of rivet_controller_health_v5.stop_causes. */
#define RIVET_STOP_CAUSES 24
/* Entries of RIVET_DRIFT_REGIME_*. */
#define RIVET_DRIFT_REGIMES 4
/* Bins of the histograms in rivet_health_v7: bin 0 counts 0 and 1 ns, bin b counts 2^b ..= 2^(b+1) - 1 ns, the last
 * bin everything from 2^31 ns (2.1 s) on. */
#define RIVET_HISTOGRAM_BINS 32
/* Entries of rivet_health_v7.input_faults. */
#define RIVET_INPUT_FAULTS 24
/* Phases of a period (RIVET_LOOP_PHASE_*). */
#define RIVET_PHASES 7
/* Worst periods that are kept. */
#define RIVET_WORST_PERIODS 32

/* An encoder reading is not to be trusted. */
#define RIVET_FAULT_ENCODER (UINT32_C(1) << 0)
/* A torque (current) reading is not to be trusted. */
#define RIVET_FAULT_TORQUE (UINT32_C(1) << 1)
/* The drives are off or the brakes are closed: the torques do not belong to the motion. */
#define RIVET_FAULT_STOPPED (UINT32_C(1) << 2)
/* Any other reason of the robot's not to learn from this sample. */
#define RIVET_FAULT_OTHER (UINT32_C(1) << 31)

/* The estimator stands still for want of usable samples or excitation. */
#define RIVET_FLAG_SUSPENDED (UINT32_C(1) << 0)
/* The estimator was stopped by a control request. */
#define RIVET_FLAG_FROZEN (UINT32_C(1) << 1)
/* Too little data so far for the values to be used in a controller. */
#define RIVET_FLAG_PROVISIONAL (UINT32_C(1) << 2)
/* Something is wrong with the samples (rivet_health_v7.input_fault): the values are those from before. */
#define RIVET_FLAG_BAD_INPUT (UINT32_C(1) << 3)
/* Late: further behind its sample than `[realtime] stale_periods`. */
#define RIVET_FLAG_LATE (UINT32_C(1) << 4)
/* Where the RIVET_LOAD_LEVEL_* stands in the flags: two bits from this one on. */
#define RIVET_FLAG_LOAD_SHIFT 8

/* Which model the torque of a rivet_command_v1 was computed with. */
enum {
    /* No torque is asked for: the robot uses its own control (tau is zero). */
    RIVET_COMMAND_MODE_NONE = 0,
    /* The nominal parameters of the robot file. */
    RIVET_COMMAND_MODE_NOMINAL = 1,
    /* The parameters published by the daemon. */
    RIVET_COMMAND_MODE_IDENTIFIED = 2,
};

/* A wish to the daemon or the controller. */
enum {
    /* Keep the parameters as they are. */
    RIVET_CONTROL_COMMAND_FREEZE = 0,
    /* Learn again. */
    RIVET_CONTROL_COMMAND_RESUME = 1,
    /* Forget everything: nominal parameters, empty window. */
    RIVET_CONTROL_COMMAND_RESET = 2,
    /* Write the parameters to the store. */
    RIVET_CONTROL_COMMAND_SAVE = 3,
    /* Take the parameters from the store. */
    RIVET_CONTROL_COMMAND_LOAD = 4,
    /* Read the robot file anew: filters, window and thresholds change between two samples. */
    RIVET_CONTROL_COMMAND_RELOAD = 5,
    /* Controller: follow the plan again after a stop, once it is within reach. */
    RIVET_CONTROL_COMMAND_FOLLOW = 6,
};

/* How a rivet_control_request_v1 ended. */
enum {
    /* Done, or handed to the loop that does it within the next period. */
    RIVET_CONTROL_STATUS_DONE = 0,
    /* Not possible in the present state. */
    RIVET_CONTROL_STATUS_REFUSED = 1,
    /* The command is not known to this daemon. */
    RIVET_CONTROL_STATUS_UNKNOWN = 2,
    /* Tried and failed (the store, say); the daemon's log has the reason. */
    RIVET_CONTROL_STATUS_FAILED = 3,
};

/* Whose parameters make the torque (rivet_controller_health_v5.source). */
enum {
    /* Those of the robot file. */
    RIVET_PARAMETER_SOURCE_NOMINAL = 0,
    /* The last ones that were found good: of the daemon's store, or in use when it fell silent. */
    RIVET_PARAMETER_SOURCE_LAST_GOOD = 1,
    /* Those that the daemon publishes. */
    RIVET_PARAMETER_SOURCE_LIVE = 2,
};

/* Why the source is what it is (rivet_controller_health_v5.source_reason). */
enum {
    /* Nothing else was there at the start. */
    RIVET_SOURCE_REASON_START = 0,
    /* Found in the daemon's store at the start. */
    RIVET_SOURCE_REASON_STORED = 1,
    /* Enough published sets in a row passed the gate. */
    RIVET_SOURCE_REASON_ADOPTED = 2,
    /* No set came for too long. */
    RIVET_SOURCE_REASON_SILENT = 3,
    /* Sets came, but none passed the gate for too long. */
    RIVET_SOURCE_REASON_REFUSED = 4,
    /* What was in use predicted recent torques worse than the robot file's parameters, for some time. */
    RIVET_SOURCE_REASON_WORSE_THAN_NOMINAL = 5,
    /* The last good ones have predicted recent torques better than the robot file's, for some time. */
    RIVET_SOURCE_REASON_BETTER_THAN_NOMINAL = 6,
    /* The inertia matrix of what was in use fell below a tenth of the robot file's in some direction, at the pose of
     * the time. */
    RIVET_SOURCE_REASON_INERTIA_NOT_POSITIVE = 7,
};

/* Why a published set may not act (rivet_controller_health_v5.last_refusal). */
enum {
    /* It passed. */
    RIVET_PARAMETER_REFUSAL_NONE = 0,
    /* Made for another model: kinematics, gravity, structure or base columns differ. */
    RIVET_PARAMETER_REFUSAL_OTHER_MODEL = 1,
    /* Its number of parameters is not the model's. */
    RIVET_PARAMETER_REFUSAL_WRONG_COUNT = 2,
    /* Made from samples not newer than those of the set before: a repeated or replayed message. */
    RIVET_PARAMETER_REFUSAL_OLD = 3,
    /* Made from samples that have not come yet. */
    RIVET_PARAMETER_REFUSAL_FUTURE = 4,
    /* Made from samples too long ago. */
    RIVET_PARAMETER_REFUSAL_STALE = 5,
    /* Its epoch is not newer than that of the set before, while the daemon is alive: a second publisher, or a
     * replayed message. */
    RIVET_PARAMETER_REFUSAL_EPOCH_BACK = 6,
    /* The daemon itself says that it has too little data. */
    RIVET_PARAMETER_REFUSAL_PROVISIONAL = 7,
    /* A value is not finite. */
    RIVET_PARAMETER_REFUSAL_NOT_FINITE = 8,
    /* Friction would drive a joint. */
    RIVET_PARAMETER_REFUSAL_DRIVING_FRICTION = 9,
    /* The inertia matrix is not positive definite, at the present pose or at a stored one. */
    RIVET_PARAMETER_REFUSAL_INERTIA_NOT_POSITIVE = 10,
    /* It would change the torque of the present setpoint by more than permitted. */
    RIVET_PARAMETER_REFUSAL_TORQUE_CHANGE = 11,
    /* It predicts recent torques worse than what is in use, or than the robot file. */
    RIVET_PARAMETER_REFUSAL_PREDICTS_WORSE = 12,
    /* It differs from what is in use, and the arm has not moved enough to tell which is better. */
    RIVET_PARAMETER_REFUSAL_NOT_JUDGED = 13,
    /* Made by a daemon that reckons with another sample period, or while samples come at another rate than the robot
     * file's. */
    RIVET_PARAMETER_REFUSAL_OTHER_PERIOD = 14,
    /* The arm would need several times its drives' torque to carry itself, or against friction. */
    RIVET_PARAMETER_REFUSAL_IMPLAUSIBLE = 15,
};

/* What the controller is doing (rivet_controller_health_v5.state). */
enum {
    /* No joint state has come yet. */
    RIVET_CONTROLLER_STATE_WAITING = 0,
    /* The arm is held where it is: nobody plans, or the plan is far from the arm. */
    RIVET_CONTROLLER_STATE_HOLDING = 1,
    /* The plan is followed. */
    RIVET_CONTROLLER_STATE_FOLLOWING = 2,
    /* The stop reaction acts; rivet_controller_health_v5.stop_cause says why. */
    RIVET_CONTROLLER_STATE_STOPPING = 3,
    /* The arm came too far from its plan: the stop reaction acts. */
    RIVET_CONTROLLER_STATE_STRAYED = 4,
    /* Stamps say that samples come at another rate than the robot file's sample_period_s: none is answered. */
    RIVET_CONTROLLER_STATE_WRONG_PERIOD = 5,
};

/* Why the stop reaction began (rivet_controller_health_v5.stop_cause). */
enum {
    /* Nothing: the stop reaction has not acted yet. */
    RIVET_STOP_CAUSE_NONE = 0,
    /* No joint state came for `[controller] stale_periods`. */
    RIVET_STOP_CAUSE_SILENCE = 1,
    /* Joint states came whose sequence numbers did not go forward. */
    RIVET_STOP_CAUSE_OLD_SAMPLES = 2,
    /* The robot controller set fault bits. */
    RIVET_STOP_CAUSE_ROBOT_FAULT = 3,
    /* Joint states have another number of joints. */
    RIVET_STOP_CAUSE_WRONG_SHAPE = 4,
    /* A position or a torque is not finite. */
    RIVET_STOP_CAUSE_NOT_FINITE = 5,
    /* A position or a torque is beyond all that an arm can have. */
    RIVET_STOP_CAUSE_IMPLAUSIBLE = 6,
    /* Joint states come at another rate than the robot file's sample_period_s. */
    RIVET_STOP_CAUSE_WRONG_PERIOD = 7,
    /* A position repeats although its joint moves, or its plan has left it. */
    RIVET_STOP_CAUSE_FROZEN = 8,
    /* A position changed faster than any drive moves its joint. */
    RIVET_STOP_CAUSE_ENCODER_JUMP = 9,
    /* A joint is beyond its speed limit. */
    RIVET_STOP_CAUSE_TOO_FAST = 10,
    /* A joint does not move as the commanded torque moves it. */
    RIVET_STOP_CAUSE_NO_RESPONSE = 11,
    /* A measured torque is opposite to the commanded one. */
    RIVET_STOP_CAUSE_SIGN_FLIPPED = 12,
    /* A measured torque repeats although the commanded one changes. */
    RIVET_STOP_CAUSE_TORQUE_STUCK = 13,
    /* A commanded torque was at its limit for longer than `[controller] saturation_ms`. */
    RIVET_STOP_CAUSE_SATURATED = 14,
    /* A joint is further from its plan than `[controller] tracking_error`. */
    RIVET_STOP_CAUSE_TRACKING_ERROR = 15,
    /* The plan has a number that is not finite, or another number of joints. */
    RIVET_STOP_CAUSE_PLAN_NOT_FINITE = 16,
    /* The plan has a number beyond all that an arm can do. */
    RIVET_STOP_CAUSE_PLAN_IMPLAUSIBLE = 17,
    /* The plan jumps further than the joint can follow. */
    RIVET_STOP_CAUSE_PLAN_JUMP = 18,
    /* The plan needs more torque than the drives have. */
    RIVET_STOP_CAUSE_PLAN_ACCELERATION = 19,
};

/* How a joint moves. */
enum {
    /* Near a reversal: at less than a tenth of its speed limit, and changing quickly. */
    RIVET_DRIFT_REGIME_REVERSAL = 0,
    /* At less than a tenth of its speed limit. */
    RIVET_DRIFT_REGIME_SLOW = 1,
    /* Faster, at about constant speed. */
    RIVET_DRIFT_REGIME_CRUISE = 2,
    /* Faster, and changing its speed by itself in a quarter of a second. */
    RIVET_DRIFT_REGIME_ACCELERATING = 3,
};

/* Whether the arm is still the one that was accepted (rivet_drift_v1.verdict). */
enum {
    /* Too little motion since the model was accepted, or since then in other regimes only. */
    RIVET_DRIFT_VERDICT_UNRESOLVED = 0,
    /* The accepted model leaves about what it left at first. */
    RIVET_DRIFT_VERDICT_WITHIN = 1,
    /* It leaves clearly more. */
    RIVET_DRIFT_VERDICT_LEFT = 2,
};

/* What is wrong with the samples. */
enum {
    /* Nothing. */
    RIVET_INPUT_FAULT_NONE = 0,
    /* Samples are missing between sequence numbers. */
    RIVET_INPUT_FAULT_LOST = 1,
    /* A sample has come twice. */
    RIVET_INPUT_FAULT_DUPLICATE = 2,
    /* A sample is older than the one before it. */
    RIVET_INPUT_FAULT_REORDERED = 3,
    /* Positions stay as they are, to the bit, though the arm was moving. */
    RIVET_INPUT_FAULT_FROZEN = 4,
    /* A position or torque is NaN or infinite. */
    RIVET_INPUT_FAULT_NOT_FINITE = 5,
    /* A torque is pinned at the drive's limit. */
    RIVET_INPUT_FAULT_SATURATED = 6,
    /* Torques have the sign opposite to the one that the motion needs. */
    RIVET_INPUT_FAULT_SIGN_FLIPPED = 7,
    /* The stamp jumps, while sequence numbers go on. */
    RIVET_INPUT_FAULT_TIME_JUMP = 8,
    /* A position jumps as no drive can move its joint. */
    RIVET_INPUT_FAULT_ENCODER_JUMP = 9,
    /* A torque stays as it is, to the bit, though the motion needs another. */
    RIVET_INPUT_FAULT_TORQUE_STUCK = 10,
    /* No one publishes joint states any more. */
    RIVET_INPUT_FAULT_PUBLISHER_GONE = 11,
    /* The robot controller began its sequence anew. */
    RIVET_INPUT_FAULT_PUBLISHER_RESTARTED = 12,
    /* A second publisher of joint states is there; its samples are not used. */
    RIVET_INPUT_FAULT_SECOND_PUBLISHER = 13,
    /* The machine was suspended. */
    RIVET_INPUT_FAULT_CLOCK_SUSPENDED = 14,
    /* The robot controller set fault bits. */
    RIVET_INPUT_FAULT_ROBOT_FAULT = 15,
    /* Samples come at another rate than the robot file says. */
    RIVET_INPUT_FAULT_WRONG_PERIOD = 16,
    /* The joint count is not the arm's. */
    RIVET_INPUT_FAULT_WRONG_SHAPE = 17,
    /* A value is beyond anything an arm does. */
    RIVET_INPUT_FAULT_IMPLAUSIBLE = 18,
    /* Another version of a message that is read is spoken on its service: nothing is read until that has ended. */
    RIVET_INPUT_FAULT_WRONG_VERSION = 19,
    /* /dev/shm is full: samples are sound, but no one can join. */
    RIVET_INPUT_FAULT_SHARED_MEMORY_FULL = 20,
};

/* Whether a process can write its state folder (rivet_health_v7.state_folder,
 * rivet_controller_health_v5.state_folder). */
enum {
    /* It has none: nothing is stored or recorded. */
    RIVET_STATE_FOLDER_NONE = 0,
    /* It can be written. */
    RIVET_STATE_FOLDER_WRITABLE = 1,
    /* It is missing or cannot be written. */
    RIVET_STATE_FOLDER_UNWRITABLE = 2,
    /* It has no room. */
    RIVET_STATE_FOLDER_FULL = 3,
};

/* What is left out because periods have become too short for the work, each level beside those before it. */
enum {
    /* Nothing. */
    RIVET_LOAD_LEVEL_NORMAL = 0,
    /* Parameters are published at an eighth of the rate. */
    RIVET_LOAD_LEVEL_PUBLISH_LESS = 1,
    /* A quarter of the rows reaches the estimator. */
    RIVET_LOAD_LEVEL_DECIMATE = 2,
    /* Nothing is learnt: parameters are held. */
    RIVET_LOAD_LEVEL_HOLD = 3,
};

/* What the daemon is doing (rivet_health_v7.mode). */
enum {
    /* Waiting for the first joint state, or filling the filters. */
    RIVET_DAEMON_MODE_STARTING = 0,
    /* Estimating. */
    RIVET_DAEMON_MODE_ESTIMATING = 1,
    /* Standing still by itself: no usable samples, a fault bit, or too little motion. */
    RIVET_DAEMON_MODE_SUSPENDED = 2,
    /* Stopped by a control request. */
    RIVET_DAEMON_MODE_FROZEN = 3,
    /* Samples were flowing and have stopped: no joint state for `[realtime] stale_periods`. */
    RIVET_DAEMON_MODE_STALE = 4,
    /* Stamps say that samples come at another rate than the robot file's sample_period_s: none is used, nothing is
     * published. */
    RIVET_DAEMON_MODE_WRONG_PERIOD = 5,
    /* Something is wrong with the samples (rivet_health_v7.input_fault says what): none is learnt from. */
    RIVET_DAEMON_MODE_BAD_INPUT = 6,
};

/* What became of one parameter (rivet_parameters_v2.state). On the wire one byte. */
enum {
    /* Held at its nominal value: the data never said anything about it. */
    RIVET_PARAMETER_STATE_UNIDENTIFIED = 0,
    /* Follows the data. */
    RIVET_PARAMETER_STATE_ACTIVE = 1,
    /* Was identified; held since because the present motion does not excite it. */
    RIVET_PARAMETER_STATE_HELD = 2,
};

/* Where the instruments of the instrumental-variable estimator come from. */
enum {
    /* None: plain least squares. */
    RIVET_INSTRUMENT_SOURCE_NONE = 0,
    /* Regressor of the planned motion (service setpoint). */
    RIVET_INSTRUMENT_SOURCE_SETPOINT = 1,
    /* Regressor of the measured motion, delayed. */
    RIVET_INSTRUMENT_SOURCE_DELAYED = 2,
    /* Regressor of the planned motion through the identified closed loop. */
    RIVET_INSTRUMENT_SOURCE_SETPOINT_THROUGH_LOOP = 3,
    /* Regressor of the motion that second encoders see (service `link-state`). */
    RIVET_INSTRUMENT_SOURCE_SECOND_ENCODER = 4,
    /* Regressor of the same phase of the previous cycle. */
    RIVET_INSTRUMENT_SOURCE_PREVIOUS_CYCLE = 5,
};

/* A part of a period. */
enum {
    /* From when the period was due to the wake-up. */
    RIVET_LOOP_PHASE_WAIT = 0,
    /* Samples and requests out of shared memory. */
    RIVET_LOOP_PHASE_READ = 1,
    /* Checks of the samples, velocities and accelerations. */
    RIVET_LOOP_PHASE_DIFFERENTIATE = 2,
    /* Regressors, instruments and the model filter. */
    RIVET_LOOP_PHASE_MODEL = 3,
    /* Sums of the window, least squares, residuals. */
    RIVET_LOOP_PHASE_ESTIMATE = 4,
    /* What may move, the solution, standard deviations. */
    RIVET_LOOP_PHASE_SUPERVISE = 5,
    /* Messages for the publishing thread. */
    RIVET_LOOP_PHASE_PUBLISH = 6,
};

/* Why a period was long (rivet_timing_v1.worst_cause). */
enum {
    /* The thread woke late. */
    RIVET_PERIOD_CAUSE_LATE_WAKE_UP = 0,
    /* Reading took the most time. */
    RIVET_PERIOD_CAUSE_LONG_READ = 1,
    /* The work itself took it. */
    RIVET_PERIOD_CAUSE_OWN_WORK = 2,
    /* The thread met pages that were not in memory. */
    RIVET_PERIOD_CAUSE_PAGE_FAULT = 3,
    /* The thread was moved to another processor. */
    RIVET_PERIOD_CAUSE_MIGRATION = 4,
    /* The processor was taken from the thread. */
    RIVET_PERIOD_CAUSE_INVOLUNTARY_SWITCH = 5,
};

/* The torque the controller asks for, latest value on blackboard `rivet/<robot>/command`.
 *
 * A robot ignores a command whose stamp_ns is older than a few periods: a blackboard keeps the last value of a
 * writer that has died. */
#define RIVET_COMMAND_TYPE_NAME "rivet.Command.v1"
typedef struct {
    /* seq of the joint state this answers. */
    uint64_t seq;
    /* When the torque was computed, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Torque each drive shall apply to its joint [N m, or N], positive about (along) the joint's axis. */
    double tau[RIVET_MAX_JOINTS];
    /* How many entries of the array are in use, 1..=8. */
    uint32_t joints;
    /* A RIVET_COMMAND_MODE_*. */
    uint32_t mode;
} rivet_command_v1;
RIVET_ASSERT(sizeof(rivet_command_v1) == 88);
RIVET_ASSERT(offsetof(rivet_command_v1, seq) == 0);
RIVET_ASSERT(offsetof(rivet_command_v1, stamp_ns) == 8);
RIVET_ASSERT(offsetof(rivet_command_v1, tau) == 16);
RIVET_ASSERT(offsetof(rivet_command_v1, joints) == 80);
RIVET_ASSERT(offsetof(rivet_command_v1, mode) == 84);

/* Physically consistent parameters near estimated ones, a few times a second, on service
 * `rivet/<robot>/parameters-consistent`: of an arm that can be built, with a mass matrix that is positive definite
 * in every pose. The estimated set itself, without that constraint, is on `rivet/<robot>/parameters`.
 *
 * Which of the estimated sets is taken depends on when the projection has time; what becomes of one does not. */
#define RIVET_CONSISTENT_PARAMETERS_TYPE_NAME "rivet.ConsistentParameters.v1"
typedef struct {
    /* rivet_parameters_v2.epoch of the estimated set this was made from. */
    uint64_t epoch;
    /* seq of that set. */
    uint64_t seq;
    /* stamp_ns of that set, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* model_hash of that set. */
    uint64_t model_hash;
    /* How many entries of values are in use. */
    uint32_t count;
    /* How many joints there are, 1..=8. */
    uint32_t joints;
    /* flags of that set. */
    uint32_t flags;
    /* Zero. Padding is spelt out, so the layout can be read off the source. */
    uint32_t reserved;
    /* Base parameters, in the order and units of the estimated ones. */
    double values[RIVET_MAX_PARAMETERS];
    /* The link that each joint moves, ten numbers each: mass [kg], first moment x y z [kg m], inertia about the
     * joint frame's origin xx xy yy xz yz zz [kg m^2], in the joint frame. What torque cannot tell is as in the
     * URDF. */
    double bodies[RIVET_BODY_VALUES];
    /* Torque between this set and the estimated one on the reference workload, RMS of each joint [N m, or N]. */
    double torque_rms[RIVET_MAX_JOINTS];
    /* The same over all joints, each in parts of its own torque [%]. */
    double torque_percent;
    /* Smallest eigenvalue of any link's pseudo-inertia [kg, kg m, kg m^2]: above zero. */
    double smallest_eigenvalue;
} rivet_consistent_parameters_v1;
RIVET_ASSERT(sizeof(rivet_consistent_parameters_v1) == 1792);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, epoch) == 0);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, seq) == 8);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, stamp_ns) == 16);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, model_hash) == 24);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, count) == 32);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, joints) == 36);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, flags) == 40);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, reserved) == 44);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, values) == 48);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, bodies) == 1072);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, torque_rms) == 1712);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, torque_percent) == 1776);
RIVET_ASSERT(offsetof(rivet_consistent_parameters_v1, smallest_eigenvalue) == 1784);

/* What anyone may ask of the daemon, on service `rivet/<robot>/control`, and of the controller, on
 * `rivet/<robot>/controller-control`. */
#define RIVET_CONTROL_REQUEST_TYPE_NAME "rivet.ControlRequest.v1"
typedef struct {
    /* A RIVET_CONTROL_COMMAND_*. */
    uint32_t command;
    /* Zero. Padding is spelt out, so the layout can be read off the source. */
    uint32_t reserved;
} rivet_control_request_v1;
RIVET_ASSERT(sizeof(rivet_control_request_v1) == 8);
RIVET_ASSERT(offsetof(rivet_control_request_v1, command) == 0);
RIVET_ASSERT(offsetof(rivet_control_request_v1, reserved) == 4);

/* The daemon's answer to a rivet_control_request_v1. Version 2 says why. */
#define RIVET_CONTROL_REPLY_TYPE_NAME "rivet.ControlReply.v2"
typedef struct {
    /* A RIVET_CONTROL_STATUS_*. */
    uint32_t status;
    /* How many bytes of text are in use. */
    uint32_t length;
    /* Epoch of the parameters in force when the answer was given. */
    uint64_t epoch;
    /* What was done, or why it was not, in UTF-8; the rest is zero. */
    uint8_t text[RIVET_REPLY_TEXT];
} rivet_control_reply_v2;
RIVET_ASSERT(sizeof(rivet_control_reply_v2) == 1016);
RIVET_ASSERT(offsetof(rivet_control_reply_v2, status) == 0);
RIVET_ASSERT(offsetof(rivet_control_reply_v2, length) == 4);
RIVET_ASSERT(offsetof(rivet_control_reply_v2, epoch) == 8);
RIVET_ASSERT(offsetof(rivet_control_reply_v2, text) == 16);

/* How the controller is doing and which parameters it trusts, a few times a second and at every change, on service
 * `rivet/<robot>/controller-health`.
 *
 * Counters run since the controller's start and never go back. */
#define RIVET_CONTROLLER_HEALTH_TYPE_NAME "rivet.ControllerHealth.v5"
typedef struct {
    /* seq of the last joint state answered. */
    uint64_t seq;
    /* When this was written, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Joint states answered with a command. */
    uint64_t commands;
    /* Joint states skipped over: the controller takes the newest. */
    uint64_t passed_over;
    /* Joint states not answered because their sequence number did not go forward. */
    uint64_t refused_stale;
    /* Joint states not answered because of fault bits, a wrong joint count, a position that is not finite or a wrong
     * rate. */
    uint64_t refused_invalid;
    /* Times the stop reaction began. */
    uint64_t stops;
    /* Commands in which the law gave a torque that is not finite. */
    uint64_t broken;
    /* Commands in which a joint was at its torque limit. */
    uint64_t saturated;
    /* Commands in which a joint's torque was held back by its rate limit. */
    uint64_t rate_limited;
    /* Setpoints that were beyond a joint's position or velocity limit and were brought back to it. */
    uint64_t setpoints_limited;
    /* Parameter sets that passed the gate. */
    uint64_t accepted;
    /* Times the source of the parameters changed. */
    uint64_t switches;
    /* Epoch of the set accepted last; 0 before the first. */
    uint64_t epoch;
    /* seq of the last joint state that went into that set. */
    uint64_t parameters_seq;
    /* Joint states of a second publisher, left out while the first one sends. */
    uint64_t foreign_joint_states;
    /* Setpoints of a second publisher, left out likewise. */
    uint64_t foreign_setpoints;
    /* Parameter sets of a second publisher, left out likewise. */
    uint64_t foreign_parameters;
    /* Times a joint came further from its plan than `[controller] tracking_error`. */
    uint64_t strayed;
    /* Setpoints that were refused: not finite, absurd, a jump, or beyond the drives' torque. */
    uint64_t setpoints_refused;
    /* Times the plan was followed again after a stop. */
    uint64_t resumed;
    /* How often the stop reaction began for which RIVET_STOP_CAUSE_*; the entry is its number. */
    uint64_t stop_causes[RIVET_STOP_CAUSES];
    /* How many sets were refused for which RIVET_PARAMETER_REFUSAL_*; the entry is its number. */
    uint64_t refusals[RIVET_REFUSALS];
    /* A RIVET_PARAMETER_SOURCE_*: whose parameters make the torque. */
    uint32_t source;
    /* A RIVET_SOURCE_REASON_*: why it is this source. */
    uint32_t source_reason;
    /* A RIVET_PARAMETER_REFUSAL_*: what became of the last set. */
    uint32_t last_refusal;
    /* A RIVET_CONTROLLER_STATE_*. */
    uint32_t state;
    /* A RIVET_STOP_CAUSE_*: why the stop reaction began last. */
    uint32_t stop_cause;
    /* Joints that this concerns, bit 0 the base's; 0 where it concerns none or all. */
    uint32_t stop_joints;
    /* A RIVET_STOP_CAUSE_*: why a setpoint was refused last. */
    uint32_t plan_refusal;
    /* Joints that this concerns, likewise. */
    uint32_t plan_joints;
    /* How many entries of the joint arrays are in use, 1..=8. */
    uint32_t joints;
    /* A RIVET_STATE_FOLDER_*: whether flight records can be written. */
    uint32_t state_folder;
    /* RMS of planned minus measured position over about the last second [rad, or m]. */
    double tracking_rms[RIVET_MAX_JOINTS];
    /* RMS error of the acting parameters on the recent torques of each joint [N m, or N]; NaN where it did not move. */
    double prediction_rms[RIVET_MAX_JOINTS];
    /* The same of the robot file's parameters. */
    double nominal_prediction_rms[RIVET_MAX_JOINTS];
    /* Largest step of the command from one period to the next [N m, or N]. */
    double largest_step[RIVET_MAX_JOINTS];
    /* 1 while joint states come without the wake-up event, so that the controller polls; else 0. */
    uint32_t polls;
    /* Zero. Padding is spelt out, so the layout can be read off the source. */
    uint32_t reserved;
} rivet_controller_health_v5;
RIVET_ASSERT(sizeof(rivet_controller_health_v5) == 792);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, seq) == 0);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, stamp_ns) == 8);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, commands) == 16);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, passed_over) == 24);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, refused_stale) == 32);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, refused_invalid) == 40);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, stops) == 48);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, broken) == 56);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, saturated) == 64);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, rate_limited) == 72);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, setpoints_limited) == 80);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, accepted) == 88);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, switches) == 96);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, epoch) == 104);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, parameters_seq) == 112);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, foreign_joint_states) == 120);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, foreign_setpoints) == 128);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, foreign_parameters) == 136);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, strayed) == 144);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, setpoints_refused) == 152);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, resumed) == 160);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, stop_causes) == 168);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, refusals) == 360);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, source) == 488);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, source_reason) == 492);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, last_refusal) == 496);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, state) == 500);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, stop_cause) == 504);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, stop_joints) == 508);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, plan_refusal) == 512);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, plan_joints) == 516);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, joints) == 520);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, state_folder) == 524);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, tracking_rms) == 528);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, prediction_rms) == 592);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, nominal_prediction_rms) == 656);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, largest_step) == 720);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, polls) == 784);
RIVET_ASSERT(offsetof(rivet_controller_health_v5, reserved) == 788);

/* What the accepted model leaves of each joint's torque, by how the joint moves, and whether the arm has left it;
 * with every health message, on service `rivet/<robot>/drift`.
 *
 * The accepted model is the robot file's, as the daemon read it last. Arrays by regime have RIVET_MAX_JOINTS numbers
 * of the first regime, then of the next; NaN where nothing is known yet. */
#define RIVET_DRIFT_TYPE_NAME "rivet.Drift.v1"
typedef struct {
    /* seq of the last joint state taken in. */
    uint64_t seq;
    /* When this was written, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Hash of the model with its robot file, as in rivet_parameters_v2. */
    uint64_t model_hash;
    /* How many entries of the arrays are in use, 1..=8. */
    uint32_t joints;
    /* A RIVET_DRIFT_VERDICT_*: left if any joint has, unresolved if none has left and any is unresolved. */
    uint32_t verdict;
    /* A RIVET_DRIFT_VERDICT_* each. */
    uint32_t joint_verdict[RIVET_MAX_JOINTS];
    /* seq of the joint state with which each joint's verdict became what it is. */
    uint64_t since_seq[RIVET_MAX_JOINTS];
    /* RMS residual of now over that after acceptance, over the same regimes; NaN while unresolved. */
    double ratio[RIVET_MAX_JOINTS];
    /* RMS torque residual with the accepted model over the last seconds of motion in a regime [N m, or N]. */
    double residual_rms[RIVET_DRIFT_REGIMES * RIVET_MAX_JOINTS];
    /* The same over the first seconds in it after the model was accepted. */
    double reference_rms[RIVET_DRIFT_REGIMES * RIVET_MAX_JOINTS];
} rivet_drift_v1;
RIVET_ASSERT(sizeof(rivet_drift_v1) == 704);
RIVET_ASSERT(offsetof(rivet_drift_v1, seq) == 0);
RIVET_ASSERT(offsetof(rivet_drift_v1, stamp_ns) == 8);
RIVET_ASSERT(offsetof(rivet_drift_v1, model_hash) == 16);
RIVET_ASSERT(offsetof(rivet_drift_v1, joints) == 24);
RIVET_ASSERT(offsetof(rivet_drift_v1, verdict) == 28);
RIVET_ASSERT(offsetof(rivet_drift_v1, joint_verdict) == 32);
RIVET_ASSERT(offsetof(rivet_drift_v1, since_seq) == 64);
RIVET_ASSERT(offsetof(rivet_drift_v1, ratio) == 128);
RIVET_ASSERT(offsetof(rivet_drift_v1, residual_rms) == 192);
RIVET_ASSERT(offsetof(rivet_drift_v1, reference_rms) == 448);

/* How the daemon is doing, a few times a second, on service `rivet/<robot>/health`.
 *
 * Counters run since the daemon's start and never go back. Version 2 adds what the estimator says about its
 * instruments and its window, version 3 how far least squares can be trusted beside them, version 4 what is wrong
 * with the input and how much of the work is done, version 5 what was left aside, version 6 whether the state folder
 * can be written, version 7 whether samples come without the wake-up event. */
#define RIVET_HEALTH_TYPE_NAME "rivet.Health.v7"
typedef struct {
    /* seq of the last joint state taken in. */
    uint64_t seq;
    /* When this was written, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Joint states taken into the estimator. */
    uint64_t samples;
    /* Joint states missing between sequence numbers. */
    uint64_t lost;
    /* Joint states refused because their sequence number or stamp did not go forward. */
    uint64_t refused_stale;
    /* Joint states refused because a value was not finite or could not be true, or joint count or period were wrong. */
    uint64_t refused_invalid;
    /* Joint states not used because the robot set a fault bit. */
    uint64_t rejected_faults;
    /* Interruptions of the stream after which the filters started anew. */
    uint64_t gaps;
    /* Joint states without a setpoint of their own sequence number. */
    uint64_t setpoints_missing;
    /* Periods that ended with samples still queued: the bound on catching up was reached. */
    uint64_t catch_up_limited;
    /* Periods of the real-time thread. */
    uint64_t periods;
    /* Periods that were missed because the thread woke or finished too late. */
    uint64_t overruns;
    /* Messages the real-time thread could not hand to the publishing thread. */
    uint64_t dropped_messages;
    /* Parameters held at present. */
    uint32_t held;
    /* Parameters following the data at present. */
    uint32_t active;
    /* A RIVET_DAEMON_MODE_*. */
    uint32_t mode;
    /* A RIVET_INSTRUMENT_SOURCE_*. */
    uint32_t instruments;
    /* RMS torque residual of each joint with the estimated parameters over the window [N m, or N]. */
    double residual_rms[RIVET_MAX_JOINTS];
    /* The same with the nominal parameters [N m, or N]. */
    double nominal_residual_rms[RIVET_MAX_JOINTS];
    /* RMS filtered torque of each joint over the same rows [N m, or N]. */
    double torque_rms[RIVET_MAX_JOINTS];
    /* Lateness of the wake-ups, see RIVET_HISTOGRAM_BINS. */
    uint32_t wake_histogram[RIVET_HISTOGRAM_BINS];
    /* Work of a period from wake-up to done, see RIVET_HISTOGRAM_BINS. */
    uint32_t work_histogram[RIVET_HISTOGRAM_BINS];
    /* Latest wake-up [ns]. */
    uint64_t worst_wake_ns;
    /* Longest work of a period [ns]. */
    uint64_t worst_work_ns;
    /* Delay of each joint behind its setpoint in slow motion [s], by the identified closed loop; NaN while unknown. */
    double loop_lag_s[RIVET_MAX_JOINTS];
    /* Length of the cycle that the motion repeats [s]; NaN while none is known. */
    double cycle_s;
    /* Length of the window [s of motion]; infinite while nothing is forgotten. */
    double window_s;
    /* Durbin-Wu-Hausman statistic of the window: least squares (rivet_parameters_v2.reference) against the
     * instruments; NaN while unknown. */
    double hausman;
    /* Probability of a statistic as large as that if the regressor has no noise and the model is complete; NaN while
     * unknown. */
    double hausman_p_value;
    /* What noise in each joint's regressor puts on least squares, over what is left of it with instruments; NaN
     * while unknown, and with delayed instruments, near 1 where the instruments see the same noise or the arm is far
     * from its setpoint. */
    double instrument_ratio[RIVET_MAX_JOINTS];
    /* Degrees of freedom of the statistic: joints whose regressor and instruments differ. */
    uint32_t hausman_degrees;
    /* A RIVET_INPUT_FAULT_*: what is wrong with the samples now. */
    uint32_t input_fault;
    /* The joints that it concerns, bit 0 the base's; zero where it concerns all or none. */
    uint32_t input_joints;
    /* A RIVET_INPUT_FAULT_*: what was wrong last, now or before. */
    uint32_t last_input_fault;
    /* A RIVET_LOAD_LEVEL_*: what is left out because periods have become too short for the work. */
    uint32_t load_level;
    /* Publishers of joint states at present: one, and one more where a network bridge mirrors them. */
    uint32_t publishers;
    /* Times that each RIVET_INPUT_FAULT_* was met, by number: samples, or events where it is none of a sample. */
    uint64_t input_faults[RIVET_INPUT_FAULTS];
    /* From the last faulty sample to the next row that was learnt from, of the last fault that is over [s]; NaN
     * before. */
    double recovery_s;
    /* Times that the load level changed. */
    uint64_t load_changes;
    /* seq of the first sample under the present load level. */
    uint64_t load_seq;
    /* Parameter sets that were late: more than `[realtime] stale_periods` behind the sample they were made from,
     * reckoned from the least such delay seen. They carry that sample's stamp, as all do. */
    uint64_t late_sets;
    /* Sound joint states that were left aside under RIVET_LOAD_LEVEL_HOLD; they are not among samples. */
    uint64_t samples_held;
    /* Rows that were not learnt from because their torques are in doubt: signs, stuck sensors. */
    uint64_t rows_doubted;
    /* A RIVET_STATE_FOLDER_*: whether parameters and flight records can be written. */
    uint32_t state_folder;
    /* 1 while joint states come without the wake-up event, so that a daemon that waits for it polls; else 0. */
    uint32_t polls;
} rivet_health_v7;
RIVET_ASSERT(sizeof(rivet_health_v7) == 1016);
RIVET_ASSERT(offsetof(rivet_health_v7, seq) == 0);
RIVET_ASSERT(offsetof(rivet_health_v7, stamp_ns) == 8);
RIVET_ASSERT(offsetof(rivet_health_v7, samples) == 16);
RIVET_ASSERT(offsetof(rivet_health_v7, lost) == 24);
RIVET_ASSERT(offsetof(rivet_health_v7, refused_stale) == 32);
RIVET_ASSERT(offsetof(rivet_health_v7, refused_invalid) == 40);
RIVET_ASSERT(offsetof(rivet_health_v7, rejected_faults) == 48);
RIVET_ASSERT(offsetof(rivet_health_v7, gaps) == 56);
RIVET_ASSERT(offsetof(rivet_health_v7, setpoints_missing) == 64);
RIVET_ASSERT(offsetof(rivet_health_v7, catch_up_limited) == 72);
RIVET_ASSERT(offsetof(rivet_health_v7, periods) == 80);
RIVET_ASSERT(offsetof(rivet_health_v7, overruns) == 88);
RIVET_ASSERT(offsetof(rivet_health_v7, dropped_messages) == 96);
RIVET_ASSERT(offsetof(rivet_health_v7, held) == 104);
RIVET_ASSERT(offsetof(rivet_health_v7, active) == 108);
RIVET_ASSERT(offsetof(rivet_health_v7, mode) == 112);
RIVET_ASSERT(offsetof(rivet_health_v7, instruments) == 116);
RIVET_ASSERT(offsetof(rivet_health_v7, residual_rms) == 120);
RIVET_ASSERT(offsetof(rivet_health_v7, nominal_residual_rms) == 184);
RIVET_ASSERT(offsetof(rivet_health_v7, torque_rms) == 248);
RIVET_ASSERT(offsetof(rivet_health_v7, wake_histogram) == 312);
RIVET_ASSERT(offsetof(rivet_health_v7, work_histogram) == 440);
RIVET_ASSERT(offsetof(rivet_health_v7, worst_wake_ns) == 568);
RIVET_ASSERT(offsetof(rivet_health_v7, worst_work_ns) == 576);
RIVET_ASSERT(offsetof(rivet_health_v7, loop_lag_s) == 584);
RIVET_ASSERT(offsetof(rivet_health_v7, cycle_s) == 648);
RIVET_ASSERT(offsetof(rivet_health_v7, window_s) == 656);
RIVET_ASSERT(offsetof(rivet_health_v7, hausman) == 664);
RIVET_ASSERT(offsetof(rivet_health_v7, hausman_p_value) == 672);
RIVET_ASSERT(offsetof(rivet_health_v7, instrument_ratio) == 680);
RIVET_ASSERT(offsetof(rivet_health_v7, hausman_degrees) == 744);
RIVET_ASSERT(offsetof(rivet_health_v7, input_fault) == 748);
RIVET_ASSERT(offsetof(rivet_health_v7, input_joints) == 752);
RIVET_ASSERT(offsetof(rivet_health_v7, last_input_fault) == 756);
RIVET_ASSERT(offsetof(rivet_health_v7, load_level) == 760);
RIVET_ASSERT(offsetof(rivet_health_v7, publishers) == 764);
RIVET_ASSERT(offsetof(rivet_health_v7, input_faults) == 768);
RIVET_ASSERT(offsetof(rivet_health_v7, recovery_s) == 960);
RIVET_ASSERT(offsetof(rivet_health_v7, load_changes) == 968);
RIVET_ASSERT(offsetof(rivet_health_v7, load_seq) == 976);
RIVET_ASSERT(offsetof(rivet_health_v7, late_sets) == 984);
RIVET_ASSERT(offsetof(rivet_health_v7, samples_held) == 992);
RIVET_ASSERT(offsetof(rivet_health_v7, rows_doubted) == 1000);
RIVET_ASSERT(offsetof(rivet_health_v7, state_folder) == 1008);
RIVET_ASSERT(offsetof(rivet_health_v7, polls) == 1012);

/* The arm's measured state, one per control period, on service `rivet/<robot>/joint-state`.
 *
 * Joints run from base to flange. All joint quantities are on the output side of the gear. */
#define RIVET_JOINT_STATE_TYPE_NAME "rivet.JointState.v1"
typedef struct {
    /* +1 each period; a jump is a lost sample. */
    uint64_t seq;
    /* When the encoders were latched, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Joint positions [rad, or m for a prismatic joint]. */
    double q[RIVET_MAX_JOINTS];
    /* Torque of each drive on its joint [N m, or N], positive about (along) the joint's axis; what the drive
     * applies, not what it feels. */
    double tau[RIVET_MAX_JOINTS];
    /* Temperature of each drive [degC]; NaN where none is measured. */
    double temperature[RIVET_MAX_JOINTS];
    /* How many entries of the arrays are in use, 1..=8. */
    uint32_t joints;
    /* Fault bits (RIVET_FAULT_*); zero means every field may be used. */
    uint32_t faults;
} rivet_joint_state_v1;
RIVET_ASSERT(sizeof(rivet_joint_state_v1) == 216);
RIVET_ASSERT(offsetof(rivet_joint_state_v1, seq) == 0);
RIVET_ASSERT(offsetof(rivet_joint_state_v1, stamp_ns) == 8);
RIVET_ASSERT(offsetof(rivet_joint_state_v1, q) == 16);
RIVET_ASSERT(offsetof(rivet_joint_state_v1, tau) == 80);
RIVET_ASSERT(offsetof(rivet_joint_state_v1, temperature) == 144);
RIVET_ASSERT(offsetof(rivet_joint_state_v1, joints) == 208);
RIVET_ASSERT(offsetof(rivet_joint_state_v1, faults) == 212);

/* What second encoders see, on service `rivet/<robot>/link-state`; only for robots that have them.
 *
 * It carries the seq of the joint state of the same period and is published *before* it, as the setpoint is: whoever
 * takes in a joint state already holds what belongs to it. A service of its own leaves joint states as they are. */
#define RIVET_LINK_STATE_TYPE_NAME "rivet.LinkState.v1"
typedef struct {
    /* seq of the joint state this belongs to. */
    uint64_t seq;
    /* When the encoders were latched, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Joint positions by the second encoder of each joint, in the zero and sign of the first [rad, or m for a
     * prismatic joint]; NaN where a joint has none. */
    double q[RIVET_MAX_JOINTS];
    /* How many entries of the array are in use, 1..=8. */
    uint32_t joints;
    /* Zero. No bit has a meaning yet; a reader ignores those it does not know. */
    uint32_t flags;
} rivet_link_state_v1;
RIVET_ASSERT(sizeof(rivet_link_state_v1) == 88);
RIVET_ASSERT(offsetof(rivet_link_state_v1, seq) == 0);
RIVET_ASSERT(offsetof(rivet_link_state_v1, stamp_ns) == 8);
RIVET_ASSERT(offsetof(rivet_link_state_v1, q) == 16);
RIVET_ASSERT(offsetof(rivet_link_state_v1, joints) == 80);
RIVET_ASSERT(offsetof(rivet_link_state_v1, flags) == 84);

/* The base parameters as estimated, on service `rivet/<robot>/parameters` and, latest value, on the blackboard of
 * the same name.
 *
 * What parameter i means follows from the robot file; two processes whose model_hash is equal mean the same by it.
 * Units are those of the parameter (kg, kg m, kg m^2, N m, N m s/rad, ...). Version 2 adds the sample period. */
#define RIVET_PARAMETERS_TYPE_NAME "rivet.Parameters.v2"
typedef struct {
    /* +1 each publication of one daemon, from 1. */
    uint64_t epoch;
    /* seq of the last joint state that went in. */
    uint64_t seq;
    /* When the estimate was made, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Says what the numbers mean: kinematics, gravity, structure and base columns of the model. */
    uint64_t model_hash;
    /* How many entries of the parameter arrays are in use. */
    uint32_t count;
    /* How many entries of the joint arrays are in use, 1..=8. */
    uint32_t joints;
    /* Bits of RIVET_FLAG_*. */
    uint32_t flags;
    /* A RIVET_INSTRUMENT_SOURCE_*. */
    uint32_t instruments;
    /* Estimated values; a parameter not identified keeps its nominal value. */
    double values[RIVET_MAX_PARAMETERS];
    /* Standard deviation (1 sigma) of each value. */
    double std[RIVET_MAX_PARAMETERS];
    /* Information of the window on each parameter, over that from which it moves if it stands alone: below 1 nothing
     * is learnt about it. */
    double excitation[RIVET_MAX_PARAMETERS];
    /* The same parameters by plain recursive least squares, for comparison. */
    double reference[RIVET_MAX_PARAMETERS];
    /* A RIVET_PARAMETER_STATE_* each. */
    uint8_t state[RIVET_MAX_PARAMETERS];
    /* Torque noise of each joint (1 sigma, after the model filter) that weighted its rows [N m, or N]. */
    double torque_noise[RIVET_MAX_JOINTS];
    /* RMS of the torque residual of each joint over the window [N m, or N]. */
    double residual_rms[RIVET_MAX_JOINTS];
    /* Sample period with which the daemon reckons [s]: derivatives are wrong where it is not the true one. */
    double sample_period_s;
} rivet_parameters_v2;
RIVET_ASSERT(sizeof(rivet_parameters_v2) == 4408);
RIVET_ASSERT(offsetof(rivet_parameters_v2, epoch) == 0);
RIVET_ASSERT(offsetof(rivet_parameters_v2, seq) == 8);
RIVET_ASSERT(offsetof(rivet_parameters_v2, stamp_ns) == 16);
RIVET_ASSERT(offsetof(rivet_parameters_v2, model_hash) == 24);
RIVET_ASSERT(offsetof(rivet_parameters_v2, count) == 32);
RIVET_ASSERT(offsetof(rivet_parameters_v2, joints) == 36);
RIVET_ASSERT(offsetof(rivet_parameters_v2, flags) == 40);
RIVET_ASSERT(offsetof(rivet_parameters_v2, instruments) == 44);
RIVET_ASSERT(offsetof(rivet_parameters_v2, values) == 48);
RIVET_ASSERT(offsetof(rivet_parameters_v2, std) == 1072);
RIVET_ASSERT(offsetof(rivet_parameters_v2, excitation) == 2096);
RIVET_ASSERT(offsetof(rivet_parameters_v2, reference) == 3120);
RIVET_ASSERT(offsetof(rivet_parameters_v2, state) == 4144);
RIVET_ASSERT(offsetof(rivet_parameters_v2, torque_noise) == 4272);
RIVET_ASSERT(offsetof(rivet_parameters_v2, residual_rms) == 4336);
RIVET_ASSERT(offsetof(rivet_parameters_v2, sample_period_s) == 4400);

/* The planned motion of one period, on service `rivet/<robot>/setpoint`.
 *
 * It carries the seq of the joint state of the same period and is published *before* it, so that whoever takes in a
 * joint state already holds its setpoint. */
#define RIVET_SETPOINT_TYPE_NAME "rivet.Setpoint.v1"
typedef struct {
    /* seq of the joint state this plan belongs to. */
    uint64_t seq;
    /* The instant the plan is for, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Planned joint positions [rad, or m for a prismatic joint]. */
    double q[RIVET_MAX_JOINTS];
    /* Planned joint velocities [rad/s, m/s]. */
    double qd[RIVET_MAX_JOINTS];
    /* Planned joint accelerations [rad/s^2, m/s^2]. */
    double qdd[RIVET_MAX_JOINTS];
    /* How many entries of the arrays are in use, 1..=8. */
    uint32_t joints;
    /* Zero. No bit has a meaning yet; a reader ignores those it does not know. */
    uint32_t flags;
} rivet_setpoint_v1;
RIVET_ASSERT(sizeof(rivet_setpoint_v1) == 216);
RIVET_ASSERT(offsetof(rivet_setpoint_v1, seq) == 0);
RIVET_ASSERT(offsetof(rivet_setpoint_v1, stamp_ns) == 8);
RIVET_ASSERT(offsetof(rivet_setpoint_v1, q) == 16);
RIVET_ASSERT(offsetof(rivet_setpoint_v1, qd) == 80);
RIVET_ASSERT(offsetof(rivet_setpoint_v1, qdd) == 144);
RIVET_ASSERT(offsetof(rivet_setpoint_v1, joints) == 208);
RIVET_ASSERT(offsetof(rivet_setpoint_v1, flags) == 212);

/* Where the daemon's real-time thread spends its time, with every health message, on service `rivet/<robot>/timing`.
 *
 * Counts run since the daemon's start. */
#define RIVET_TIMING_TYPE_NAME "rivet.Timing.v1"
typedef struct {
    /* When this was written, CLOCK_MONOTONIC [ns]. */
    uint64_t stamp_ns;
    /* Periods of the real-time thread. */
    uint64_t periods;
    /* The time between periods that it is to keep [ns]. */
    uint64_t period_ns;
    /* How many entries of the arrays of worst periods are in use. */
    uint32_t count;
    /* Zero. Padding is spelt out, so the layout can be read off the source. */
    uint32_t reserved;
    /* Longest time of each phase [ns]. */
    uint64_t phase_max_ns[RIVET_PHASES];
    /* Time of each phase: 32 bins of the first phase, then of the next; bins as of rivet_health_v7. */
    uint32_t phase_histogram[RIVET_PHASES * RIVET_HISTOGRAM_BINS];
    /* When each of the worst periods of the last hour was due, CLOCK_MONOTONIC [ns], the worst first. */
    uint64_t worst_stamp_ns[RIVET_WORST_PERIODS];
    /* Time of each phase of it [ns], seven numbers a period; the wait is the lateness of the wake-up. */
    uint32_t worst_phase_ns[RIVET_WORST_PERIODS * RIVET_PHASES];
    /* A RIVET_PERIOD_CAUSE_* each. */
    uint32_t worst_cause[RIVET_WORST_PERIODS];
} rivet_timing_v1;
RIVET_ASSERT(sizeof(rivet_timing_v1) == 2264);
RIVET_ASSERT(offsetof(rivet_timing_v1, stamp_ns) == 0);
RIVET_ASSERT(offsetof(rivet_timing_v1, periods) == 8);
RIVET_ASSERT(offsetof(rivet_timing_v1, period_ns) == 16);
RIVET_ASSERT(offsetof(rivet_timing_v1, count) == 24);
RIVET_ASSERT(offsetof(rivet_timing_v1, reserved) == 28);
RIVET_ASSERT(offsetof(rivet_timing_v1, phase_max_ns) == 32);
RIVET_ASSERT(offsetof(rivet_timing_v1, phase_histogram) == 88);
RIVET_ASSERT(offsetof(rivet_timing_v1, worst_stamp_ns) == 984);
RIVET_ASSERT(offsetof(rivet_timing_v1, worst_phase_ns) == 1240);
RIVET_ASSERT(offsetof(rivet_timing_v1, worst_cause) == 2136);

#undef RIVET_ASSERT

#endif
