/* A simulated arm of one joint as a robot controller, at 1 kHz: publishes samples and applies the commanded torque.
 *   cc robot.c -o robot $(pkg-config --cflags --libs librivet) -lm && ./robot [SAMPLES [PREFIX ROOT]] */
#define _POSIX_C_SOURCE 200809L
#include <librivet.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double q, qd, tau; /* [rad], [rad/s], [N m]: the arm's state */

/* The true arm for 1 ms; arm/robot.toml has other values. The drive brings its torque to `commanded` within the period. */
static void move(double commanded) {
    for (int i = 0; i < 10; i++) {
        double torque = tau + (commanded - tau) * (i + 0.5) / 10;
        qd += 1e-4 * (torque - 1.5 * 9.81 * sin(q) - 1.5 * qd - 2.0 * tanh(qd / 0.1)) / 0.9;
        q += 1e-4 * qd;
    }
    tau = commanded;
}

int main(int argc, char **argv) {
    long samples = argc > 1 ? atol(argv[1]) : 10000, answered = 0, missed = 100;
    rivet_robot *robot;
    if (rivet_open(RIVET_ABI, "example-arm", argc > 3 ? argv[2] : NULL, argc > 3 ? argv[3] : NULL, 1, &robot) != RIVET_STATUS_OK) {
        fprintf(stderr, "robot: %s\n", rivet_error(NULL));
        return 1;
    }
    struct timespec wake;
    clock_gettime(CLOCK_MONOTONIC, &wake);
    for (long k = 0; k < samples; k++) {
        double t = 1e-3 * (double)k, a = 3.0, b = 8.0; /* two sines, from rest */
        rivet_sample sample = {.flags = RIVET_SAMPLE_SETPOINT, .q = {q}, .tau = {tau}};
        sample.stamp_ns = (uint64_t)wake.tv_sec * 1000000000u + (uint64_t)wake.tv_nsec;
        sample.q_des[0] = 0.5 * (1 - cos(a * t)) + 0.2 * (1 - cos(b * t));
        sample.qd_des[0] = 0.5 * a * sin(a * t) + 0.2 * b * sin(b * t);
        sample.qdd_des[0] = 0.5 * a * a * cos(a * t) + 0.2 * b * b * cos(b * t);
        if (rivet_publish(robot, &sample) != RIVET_STATUS_OK) fprintf(stderr, "robot: sample %ld is lost\n", k + 1);
        rivet_command_v1 command;
        int ok = rivet_wait_command(robot, 800, &command) == RIVET_STATUS_OK && command.mode != RIVET_COMMAND_MODE_NONE;
        answered += ok;
        missed = ok ? 0 : missed + 1;
        double own = 100 * (sample.q_des[0] - q) + 10 * (sample.qd_des[0] - qd); /* the arm's own controller */
        move(ok ? command.tau[0] : missed < 20 ? tau : own);
        wake.tv_nsec += 1000000;
        if (wake.tv_nsec >= 1000000000) wake.tv_nsec -= 1000000000, wake.tv_sec++;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, NULL);
    }
    rivet_counters count;
    rivet_read_counters(robot, &count);
    printf("published %llu, lost %llu, answered %ld\n", (unsigned long long)count.published, (unsigned long long)count.lost, answered);
    rivet_parameters_v2 parameters;
    if (rivet_read_parameters(robot, &parameters) == RIVET_STATUS_OK)
        for (uint32_t i = 0; i < parameters.count; i++)
            printf("parameter %u: %9.4f +- %.4f, state %d\n", i + 1, parameters.values[i], parameters.std[i], parameters.state[i]);
    rivet_close(robot);
    return 0;
}
