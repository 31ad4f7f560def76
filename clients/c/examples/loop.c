/* A loop that is woken by states and fields of a twin, started before the twin or after it. It allocates nothing while it runs.
 *   cc loop.c $(pkg-config --cflags --libs softtwin) -o loop && ./loop finger 1000
 */
#include <inttypes.h>
#include <poll.h>
#include <softtwin.h>
#include <stdio.h>
#include <stdlib.h>

static void check(softtwin_status status, const char *what) {
    if (status == SOFTTWIN_OK) return;
    fprintf(stderr, "%s: %s\n", what, softtwin_last_error());
    exit(1);
}

int main(int argc, char **argv) {
    const char *actuator = argc > 1 ? argv[1] : "finger";
    const uint64_t wanted = argc > 2 ? strtoull(argv[2], NULL, 10) : 1000;
    softtwin_bus *bus = NULL;
    softtwin_reader *states = NULL, *fields = NULL;
    check(softtwin_bus_open(NULL, NULL, &bus), "domain");
    check(softtwin_reader_attach(bus, actuator, "state", NULL, 1, &states), "state");
    check(softtwin_reader_attach(bus, actuator, "field", NULL, 0, &fields), "field"); /* polled, never woken by */

    softtwin_reader *readers[] = {states, fields};
    softtwin_waiter *waiter = NULL;
    struct pollfd event = {.events = POLLIN};
    check(softtwin_waiter_open(readers, 2, &waiter), "waiter");
    check(softtwin_waiter_descriptor(waiter, &event.fd), "descriptor");
    puts("waiting");
    fflush(stdout);

    uint64_t received = 0, lost = 0;
    double force_n = 0;
    float largest_mpa = 0;
    while (received < wanted) {
        if (poll(&event, 1, 10000) <= 0) { /* with other descriptors of the program */
            fputs("nothing came within 10 s\n", stderr);
            return 1;
        }
        softtwin_waiter_wait(waiter, 0);
        softtwin_state state;
        while (softtwin_reader_read(states, 0, 0, &state, sizeof state) == SOFTTWIN_OK) force_n = state.contact_force_n;
        softtwin_field *field = NULL;
        if (softtwin_reader_read_field(fields, 1, 0, &field) == SOFTTWIN_OK) {
            largest_mpa = softtwin_field_get_header(field)->max_von_mises_mpa;
            softtwin_field_release(field);
        }
        check(softtwin_reader_counts(states, &received, &lost), "counts");
    }
    printf("%" PRIu64 " states, %" PRIu64 " lost, last %.4f N, %.4f MPa\n", received, lost, force_n, largest_mpa);
    softtwin_waiter_close(waiter);
    softtwin_reader_close(fields);
    softtwin_reader_close(states);
    softtwin_bus_close(bus);
    return 0;
}
