/* Latency of states (or whole fields: second argument `field`) from publish to here, as one JSON object. Woken by event.
 *   cc latency.c $(pkg-config --cflags --libs softtwin) -o latency && ./latency 10 field finger
 */
#include <softtwin.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int compare(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static void check(softtwin_status status) {
    if (status == SOFTTWIN_OK || status == SOFTTWIN_TIMEOUT) return;
    fprintf(stderr, "%s\n", softtwin_last_error());
    exit(1);
}

int main(int argc, char **argv) {
    double seconds = argc > 1 ? atof(argv[1]) : 10.0;
    int whole = argc > 2 && strcmp(argv[2], "field") == 0;
    const char *actuator = argc > 3 ? argv[3] : "finger";
    size_t room = (size_t)(seconds * 10000) + 1000, count = 0;
    uint64_t *latency = malloc(room * sizeof *latency), last = 0, lost = 0;
    softtwin_bus *bus = NULL;
    softtwin_state_reader *states = NULL;
    softtwin_field_reader *fields = NULL;
    if (!latency) return 1;
    check(softtwin_bus_open(NULL, NULL, &bus));
    if (whole) check(softtwin_field_reader_open(bus, actuator, NULL, &fields));
    else check(softtwin_state_reader_open(bus, actuator, &states));

    uint64_t begin = softtwin_now_ns(), end = begin + (uint64_t)(seconds * 1e9);
    while (softtwin_now_ns() < end && count < room) {
        uint64_t sent = 0, seq = 0;
        if (whole) {
            softtwin_field *field = NULL;
            softtwin_status status = softtwin_field_reader_next(fields, 100, &field);
            check(status);
            if (status == SOFTTWIN_TIMEOUT) continue;
            sent = softtwin_field_get_header(field)->t_publish_ns;
            seq = softtwin_field_get_header(field)->seq;
            softtwin_field_release(field);
        } else {
            softtwin_state state;
            softtwin_status status = softtwin_state_reader_next(states, 100, &state);
            check(status);
            if (status == SOFTTWIN_TIMEOUT) continue;
            sent = state.t_publish_ns;
            seq = state.seq;
        }
        if (sent < begin) continue; /* sent before the start */
        latency[count++] = softtwin_now_ns() - sent;
        if (last) lost += seq - last - 1;
        last = seq;
    }
    if (count == 0) return fprintf(stderr, "nothing came\n"), 1;
    qsort(latency, count, sizeof *latency, compare);
    printf("{\"what\":\"%s\",\"lost\":%llu,\"latency\":{\"count\":%zu,\"p50_us\":%.3f,\"p99_us\":%.3f,\"max_us\":%.3f}}\n",
           whole ? "field" : "state", (unsigned long long)lost, count, latency[count / 2] / 1e3,
           latency[count * 99 / 100] / 1e3, latency[count - 1] / 1e3);
    softtwin_state_reader_close(states);
    softtwin_field_reader_close(fields);
    softtwin_bus_close(bus);
    free(latency);
    return 0;
}
