// A simulated arm of one joint as a robot controller, at 1 kHz: publishes samples and applies the commanded torque.
//   c++ -std=c++17 robot.cpp -o robot $(pkg-config --cflags --libs librivet) && ./robot [SAMPLES [PREFIX ROOT]]
#include <librivet.hpp>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <thread>

// The true arm; arm/robot.toml has other values.
struct Arm {
    double q = 0, qd = 0, tau = 0; // [rad], [rad/s], [N m]

    // Moves for 1 ms. The drive brings its torque to `commanded` within the period.
    void move(double commanded) {
        for (int i = 0; i < 10; i++) {
            const double torque = tau + (commanded - tau) * (i + 0.5) / 10;
            qd += 1e-4 * (torque - 1.5 * 9.81 * std::sin(q) - 1.5 * qd - 2.0 * std::tanh(qd / 0.1)) / 0.9;
            q += 1e-4 * qd;
        }
        tau = commanded;
    }
};

int main(int argc, char **argv) try {
    const long samples = argc > 1 ? std::atol(argv[1]) : 10000;
    rivet::Robot robot("example-arm", 1, argc > 3 ? argv[2] : "", argc > 3 ? argv[3] : "");
    Arm arm;
    long answered = 0, missed = 100;
    auto wake = std::chrono::steady_clock::now(); // CLOCK_MONOTONIC
    for (long k = 0; k < samples; k++) {
        const double t = 1e-3 * static_cast<double>(k), a = 3.0, b = 8.0; // two sines, from rest
        rivet::Sample sample{};
        sample.flags = RIVET_SAMPLE_SETPOINT;
        sample.stamp_ns = static_cast<std::uint64_t>(std::chrono::nanoseconds(wake.time_since_epoch()).count());
        sample.q[0] = arm.q;
        sample.tau[0] = arm.tau;
        sample.q_des[0] = 0.5 * (1 - std::cos(a * t)) + 0.2 * (1 - std::cos(b * t));
        sample.qd_des[0] = 0.5 * a * std::sin(a * t) + 0.2 * b * std::sin(b * t);
        sample.qdd_des[0] = 0.5 * a * a * std::cos(a * t) + 0.2 * b * b * std::cos(b * t);
        if (robot.publish(sample) != RIVET_STATUS_OK) std::fprintf(stderr, "robot: sample %ld is lost\n", k + 1);
        const auto command = robot.wait_command(800);
        const bool ok = command && command->mode != RIVET_COMMAND_MODE_NONE;
        answered += ok;
        missed = ok ? 0 : missed + 1;
        const double own = 100 * (sample.q_des[0] - arm.q) + 10 * (sample.qd_des[0] - arm.qd); // the arm's own controller
        arm.move(ok ? command->tau[0] : missed < 20 ? arm.tau : own);
        std::this_thread::sleep_until(wake += std::chrono::milliseconds(1));
    }
    std::printf("published %ld, lost %ld, answered %ld\n", long(robot.counters().published), long(robot.counters().lost), answered);
    if (rivet::Parameters p; robot.read(p))
        for (unsigned i = 0; i < p.count; i++)
            std::printf("parameter %u: %9.4f +- %.4f, state %d\n", i + 1, p.values[i], p.std[i], int(p.state[i]));
} catch (const std::exception &error) {
    std::fprintf(stderr, "robot: %s\n", error.what());
    return 1;
}
