/* librivet: connects a robot controller to rivet. All quantities are SI, on the output side of the gear; joints run
 * from base to flange; torque is positive about the joint's URDF axis. rivet.h has the messages. */

#ifndef LIBRIVET_H
#define LIBRIVET_H

/* Written by `LIBRIVET_WRITE_HEADER=1 cargo test -p librivet --test header`. Do not edit. */

#include <stdint.h>
#include "rivet.h"

/*
 Version of this interface: functions, structs and the messages of rivet.h. The first argument of rivet_open.
 */
#define RIVET_ABI 1

/*
 `q_des`, `qd_des` and `qdd_des` are valid.
 */
#define RIVET_SAMPLE_SETPOINT (1 << 0)

/*
 `temperature` is valid.
 */
#define RIVET_SAMPLE_TEMPERATURE (1 << 1)

/*
 What a function returns. Negative values are errors.
 */
enum rivet_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /*
   Done; an output is valid.
   */
  RIVET_STATUS_OK = 0,
  /*
   Nothing has arrived yet; the output is unchanged.
   */
  RIVET_STATUS_NONE = 1,
  /*
   The value is older than asked for; the output has it.
   */
  RIVET_STATUS_STALE = 2,
  /*
   A pointer is NULL or a value breaks a rule.
   */
  RIVET_STATUS_ARGUMENT = -1,
  /*
   The program was compiled with the header of another version of the library.
   */
  RIVET_STATUS_VERSION = -2,
  /*
   The bus could not be opened.
   */
  RIVET_STATUS_BUS = -3,
  /*
   The queue is full, so the sample is lost; the library's thread gets no processor time.
   */
  RIVET_STATUS_FULL = -4,
  /*
   The library's thread has ended; close and open again.
   */
  RIVET_STATUS_ENDED = -5,
  /*
   An error inside the library.
   */
  RIVET_STATUS_INTERNAL = -6,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum rivet_status rivet_status;
#else
typedef int32_t rivet_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/*
 A robot on the bus. One thread at a time may use it.
 */
typedef struct rivet_robot rivet_robot;

/*
 One control period of the robot: what was measured, and what was planned.

 Joints run from base to flange. All quantities are on the output side of the gear, about the joint's URDF axis.
 Entries beyond the joint count are ignored. A sample of zeros is valid.
 */
typedef struct {
  /*
   When the encoders were latched, CLOCK_MONOTONIC [ns]; 0: at the call.
   */
  uint64_t stamp_ns;
  /*
   Measured joint positions [rad, or m for a prismatic joint].
   */
  double q[RIVET_MAX_JOINTS];
  /*
   Measured torque of each drive on its joint [N m, or N].
   */
  double tau[RIVET_MAX_JOINTS];
  /*
   Planned joint positions of this period [rad, or m].
   */
  double q_des[RIVET_MAX_JOINTS];
  /*
   Planned joint velocities [rad/s, or m/s].
   */
  double qd_des[RIVET_MAX_JOINTS];
  /*
   Planned joint accelerations [rad/s^2, or m/s^2].
   */
  double qdd_des[RIVET_MAX_JOINTS];
  /*
   Temperature of each drive [degC]; NaN where none is measured.
   */
  double temperature[RIVET_MAX_JOINTS];
  /*
   RIVET_SAMPLE_SETPOINT, RIVET_SAMPLE_TEMPERATURE: which optional fields are valid.
   */
  uint32_t flags;
  /*
   RIVET_FAULT_... bits of rivet.h; 0: every field may be used.
   */
  uint32_t faults;
} rivet_sample;

/*
 How many samples went where.
 */
typedef struct {
  /*
   Samples published; also the sequence number of the last one.
   */
  uint64_t published;
  /*
   Samples sent to the bus.
   */
  uint64_t sent;
  /*
   Samples lost because the queue was full; the others see a gap in the sequence.
   */
  uint64_t lost;
  /*
   Samples that the bus did not accept; rivet_error has the reason.
   */
  uint64_t failed;
} rivet_counters;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/*
 Returns version and interface of the library, for example "librivet 0.1.0, interface 1".
 */
const char *rivet_version(void);

/*
 Joins the bus of a robot. Daemon and controller may start before or after. Not for the cycle.

 abi: RIVET_ABI. robot: `name` of the robot file. prefix, root: as --prefix and --root of rivetd; NULL: the default.
 joints: 1 to 8, as in the robot file; 0: only read. opened: where the robot is returned.

 Returns RIVET_STATUS_OK, or an error: rivet_error(NULL) has the reason. The library's thread gets the scheduling of the
 calling thread.

 Pointers:
 Strings are NULL or end with a zero byte; `opened` is NULL or points to memory for a pointer.
 */
rivet_status rivet_open(uint32_t abi,
                        const char *robot,
                        const char *prefix,
                        const char *root,
                        uint32_t joints,
                        rivet_robot **opened);

/*
 Sends what is queued, leaves the bus and frees the robot. NULL is allowed. Not for the cycle.

 Pointers:
 `robot` is NULL or came from rivet_open and was not closed before.
 */
void rivet_close(rivet_robot *robot);

/*
 Publishes the sample of one period: setpoint first, then joint state, then the wake-up event. Call it once in each
 control period. The sequence number is one more at each call.

 Real-time safe: no allocation, no blocking; one system call wakes the library's thread.
 Returns RIVET_STATUS_OK, RIVET_STATUS_FULL (the sample is lost) or RIVET_STATUS_ENDED.

 Pointers:
 `robot` as in rivet_close; `sample` is NULL or points to a sample.
 */
rivet_status rivet_publish(rivet_robot *robot, const rivet_sample *sample);

/*
 Waits for the command that answers the last published sample, at most timeout_us [us].

 Sleeps in steps of 20 us; no allocation. Returns RIVET_STATUS_OK with the answer, or RIVET_STATUS_NONE and leaves
 command unchanged.

 Pointers:
 `robot` as in rivet_close; `command` is NULL or points to memory for a command.
 */
rivet_status rivet_wait_command(rivet_robot *robot, uint32_t timeout_us, rivet_command_v1 *command);

/*
 Reads the latest command without waiting.

 Returns RIVET_STATUS_OK if it was computed at most max_age_us [us] ago, RIVET_STATUS_STALE if earlier, and
 RIVET_STATUS_NONE if there is none since rivet_open. The field seq has the sample that it answers.
 Real-time safe: no allocation, no system call.

 Pointers:
 As rivet_wait_command.
 */
rivet_status rivet_read_command(rivet_robot *robot, uint32_t max_age_us, rivet_command_v1 *command);

/*
 Reads the latest parameters: values, standard deviations, states. Their field epoch is one more at each publication.

 Returns RIVET_STATUS_OK, or RIVET_STATUS_NONE before the first. Real-time safe: no allocation, no system call.

 Pointers:
 `robot` as in rivet_close; `parameters` is NULL or points to memory for parameters.
 */
rivet_status rivet_read_parameters(rivet_robot *robot, rivet_parameters_v2 *parameters);

/*
 Reads the latest health of the daemon. As rivet_read_parameters.

 Pointers:
 `robot` as in rivet_close; `health` is NULL or points to memory for a health message.
 */
rivet_status rivet_read_health(rivet_robot *robot, rivet_health_v7 *health);

/*
 Reads the latest health of the controller. As rivet_read_parameters.

 Pointers:
 `robot` as in rivet_close; `health` is NULL or points to memory for a health message of the controller.
 */
rivet_status rivet_read_controller_health(rivet_robot *robot, rivet_controller_health_v5 *health);

/*
 Reads how many samples were published, sent and lost. Real-time safe: no allocation, no system call.

 Pointers:
 `robot` as in rivet_close; `counters` is NULL or points to memory for counters.
 */
rivet_status rivet_read_counters(rivet_robot *robot, rivet_counters *counters);

/*
 Returns what failed last on the library's thread, or with NULL why rivet_open failed last on this thread; "" if nothing did.

 The text is valid until the next call of this function or of rivet_open on this thread. Not for the cycle.

 Pointers:
 `robot` as in rivet_close.
 */
const char *rivet_error(rivet_robot *robot);

/*
 Returns a sentence about a status, never NULL. Real-time safe.
 */
const char *rivet_status_text(int32_t status);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* LIBRIVET_H */
