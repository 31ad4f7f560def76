/* Reads one state and one field of a running twin, then asks it two questions.
 *   cc twin.c $(pkg-config --cflags --libs softtwin) -lm -o twin && ./twin finger
 */
#include <math.h>
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
    softtwin_bus *bus = NULL;
    check(softtwin_bus_open(NULL, NULL, &bus), "domain");

    softtwin_state_reader *states = NULL;
    softtwin_state state;
    check(softtwin_state_reader_open(bus, actuator, &states), "state");
    check(softtwin_state_reader_newest(states, 5000, &state), "state");
    printf("state %llu: %s, %.4f N at %.5f MPa\n", (unsigned long long)state.seq, softtwin_regime_name(state.regime),
           state.contact_force_n, state.pressure_mpa);
    for (uint32_t at = 0; at < state.observable_count; at++)
        printf("%.32s: %.3f +- %.3f, measured difference %.3f\n", (const char *)&state.observable_names[32 * at],
               state.observables[at], state.observable_halfwidths[at], state.observable_offsets[at]);
    softtwin_state_reader_close(states);

    softtwin_field_reader *fields = NULL;
    softtwin_field *field = NULL;
    const float *stress = NULL;
    size_t nodes = 0;
    check(softtwin_field_reader_open(bus, actuator, NULL, &fields), "field");
    check(softtwin_field_reader_newest(fields, 5000, &field), "field");
    check(softtwin_field_values(field, SOFTTWIN_FIELD_VON_MISES, &stress, &nodes), "von Mises stress");
    float largest = 0;
    for (size_t node = 0; node < nodes; node++) largest = fmaxf(largest, stress[node]);
    printf("field: %zu nodes, largest stress %.4f MPa (header: %.4f)\n", nodes, largest,
           softtwin_field_get_header(field)->max_von_mises_mpa);
    softtwin_field_release(field);
    softtwin_field_reader_close(fields);

    softtwin_client *twin = NULL;
    softtwin_answer answer;
    check(softtwin_client_open(bus, actuator, &twin), "questions");
    softtwin_query query = softtwin_query_new(SOFTTWIN_QUERY_WHATIF);
    query.pressure_mpa = 0.05;
    query.gap_mm = 25.0;
    check(softtwin_client_ask(twin, &query, 1000, &answer, NULL, 0, NULL), "what if");
    printf("what if: %.4f +- %.4f N\n", answer.contact_force_n, answer.force_halfwidth_n);
    query = softtwin_query_new(SOFTTWIN_QUERY_PRESSURE);
    query.force_n = 1000.0;
    query.gap_mm = 25.0;
    softtwin_status status = softtwin_client_ask(twin, &query, 1000, &answer, NULL, 0, NULL);
    if (status == SOFTTWIN_REFUSED) printf("refused: %s\n", softtwin_last_error());
    softtwin_client_close(twin);
    softtwin_bus_close(bus);
    return status == SOFTTWIN_REFUSED ? 0 : 1;
}
