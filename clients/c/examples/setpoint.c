/* Owns the valve of an actuator for some seconds: holds a pressure (MPa), renewed four times within its validity, and releases it.
 *   cc setpoint.c $(pkg-config --cflags --libs softtwin) -lm -o setpoint && ./setpoint finger 0.02 5
 */
#include <math.h>
#include <softtwin.h>
#include <stdio.h>
#include <stdlib.h>

enum { VALID_MS = 200 };

static void check(softtwin_status status, const char *what) {
    if (status == SOFTTWIN_OK) return;
    fprintf(stderr, "%s: %s\n", what, softtwin_last_error());
    exit(1);
}

int main(int argc, char **argv) {
    const char *actuator = argc > 1 ? argv[1] : "finger";
    const double pressure_mpa = argc > 2 ? atof(argv[2]) : 0.02, seconds = argc > 3 ? atof(argv[3]) : 5.0;
    softtwin_bus *bus = NULL;
    softtwin_writer *valve = NULL;
    softtwin_valve_reader *written = NULL;
    check(softtwin_bus_open(NULL, NULL, &bus), "domain");
    check(softtwin_valve_reader_open(bus, actuator, &written), "valve");
    check(softtwin_writer_open_setpoint(bus, actuator, NULL, "setpoint.c", &valve), "setpoint");

    const uint64_t end_ns = softtwin_now_ns() + (uint64_t)(seconds * 1e9);
    uint64_t next_ns = 0;
    int has_followed = 0;
    while (softtwin_now_ns() < end_ns) {
        if (softtwin_now_ns() >= next_ns) {
            check(softtwin_writer_send_setpoint(valve, pressure_mpa, VALID_MS, 0), "setpoint");
            next_ns = softtwin_now_ns() + VALID_MS * 1000000ull / 4;
        }
        softtwin_valve state;
        softtwin_status status = softtwin_valve_reader_newest(written, VALID_MS / 8, &state);
        if (status == SOFTTWIN_TIMEOUT) continue;
        check(status, "valve");
        const int follows = state.valve_reason == SOFTTWIN_VALVE_REASON_FOLLOWING;
        if (follows && !has_followed) {
            printf("follows: %.4f MPa\n", state.pressure_mpa);
            fflush(stdout);
        }
        has_followed = has_followed || follows;
    }
    check(softtwin_writer_send_setpoint(valve, NAN, VALID_MS, 0), "setpoint"); /* releases: the valve closes at once */
    softtwin_writer_close(valve);
    softtwin_valve_reader_close(written);
    softtwin_bus_close(bus);
    return has_followed ? 0 : 1;
}
