// librivet for C++17: opening throws, the functions of the cycle are noexcept. The library frees the robot in the destructor.
#ifndef LIBRIVET_HPP
#define LIBRIVET_HPP

#include "librivet.h"

#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

namespace rivet {

using Sample = rivet_sample;
using Counters = rivet_counters;
using Command = rivet_command_v1;
using Parameters = rivet_parameters_v2;
using Health = rivet_health_v7;
using ControllerHealth = rivet_controller_health_v5;

// Why a robot could not be opened; `status` is a RIVET_STATUS_ value.
class Error : public std::runtime_error {
public:
    Error(rivet_status status, const char *text) : std::runtime_error(text), status(status) {}
    const rivet_status status;
};

// The robot's side of the bus. It may move; one thread at a time uses it.
class Robot {
public:
    // Empty prefix or root: the default. Throws Error.
    Robot(const std::string &name, std::uint32_t joints, const std::string &prefix = "", const std::string &root = "") {
        rivet_robot *opened = nullptr;
        const rivet_status status = rivet_open(RIVET_ABI, name.c_str(), prefix.empty() ? nullptr : prefix.c_str(),
                                               root.empty() ? nullptr : root.c_str(), joints, &opened);
        if (status != RIVET_STATUS_OK) throw Error(status, rivet_error(nullptr));
        robot_.reset(opened);
    }

    // Publishes the sample of one period. Real-time safe.
    rivet_status publish(const Sample &sample) noexcept { return rivet_publish(robot_.get(), &sample); }

    // The command that answers the last sample, waited for at most `timeout_us` [us].
    std::optional<Command> wait_command(std::uint32_t timeout_us) noexcept {
        Command command;
        if (rivet_wait_command(robot_.get(), timeout_us, &command) != RIVET_STATUS_OK) return std::nullopt;
        return command;
    }

    // The latest command if it is at most `max_age_us` [us] old. Real-time safe.
    std::optional<Command> command(std::uint32_t max_age_us) noexcept {
        Command command;
        if (rivet_read_command(robot_.get(), max_age_us, &command) != RIVET_STATUS_OK) return std::nullopt;
        return command;
    }

    // False before the first message. Real-time safe.
    bool read(Parameters &parameters) noexcept { return rivet_read_parameters(robot_.get(), &parameters) == RIVET_STATUS_OK; }
    bool read(Health &health) noexcept { return rivet_read_health(robot_.get(), &health) == RIVET_STATUS_OK; }
    bool read(ControllerHealth &health) noexcept {
        return rivet_read_controller_health(robot_.get(), &health) == RIVET_STATUS_OK;
    }

    // How many samples went where. Real-time safe.
    Counters counters() const noexcept {
        Counters counters{};
        rivet_read_counters(robot_.get(), &counters);
        return counters;
    }

    // What failed last on the library's thread; empty if nothing did.
    std::string problem() const { return rivet_error(robot_.get()); }

private:
    struct Close {
        void operator()(rivet_robot *robot) const noexcept { rivet_close(robot); }
    };
    std::unique_ptr<rivet_robot, Close> robot_;
};

} // namespace rivet

#endif // LIBRIVET_HPP
