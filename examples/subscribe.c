/* Prints the parameters of a robot as a table, one a second. It only reads: any number of these may run.
 *   cc subscribe.c -o subscribe $(pkg-config --cflags --libs librivet) && ./subscribe ROBOT [TABLES [PREFIX ROOT]] */
#define _POSIX_C_SOURCE 200809L
#include <librivet.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

int main(int argc, char **argv) {
    static const char *const states[] = {"not identified", "active", "held"};
    rivet_robot *robot;
    if (argc < 2 || rivet_open(RIVET_ABI, argv[1], argc > 4 ? argv[3] : NULL, argc > 4 ? argv[4] : NULL, 0, &robot) != RIVET_STATUS_OK) {
        fprintf(stderr, "subscribe: %s\n", argc < 2 ? "which robot?" : rivet_error(NULL));
        return 1;
    }
    uint64_t epoch = 0;
    for (long tables = argc > 2 ? atol(argv[2]) : 1000000; tables > 0;) {
        rivet_parameters_v2 set;
        rivet_health_v7 health;
        if (rivet_read_parameters(robot, &set) == RIVET_STATUS_OK && set.epoch != epoch) {
            epoch = set.epoch;
            printf("epoch %llu, sample %llu\n", (unsigned long long)epoch, (unsigned long long)set.seq);
            for (uint32_t i = 0; i < set.count; i++)
                printf("%4u %12.5f +- %-10.5f %s\n", i + 1, set.values[i], set.std[i], set.state[i] < 3 ? states[set.state[i]] : "?");
            if (rivet_read_health(robot, &health) == RIVET_STATUS_OK)
                printf("samples %llu, lost %llu\n", (unsigned long long)health.samples, (unsigned long long)health.lost);
            fflush(stdout);
            tables--;
        }
        nanosleep(&(struct timespec){.tv_sec = 1}, NULL);
    }
    rivet_close(robot);
    return 0;
}
