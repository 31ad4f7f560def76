/* Steps the control law along a table of readings, without a bus.
 *   cc control.c $(pkg-config --cflags --libs softtwin) -lm -o control && ./control finger.twin finger.toml force_n < readings
 * Each line: t_ns target pressure_mpa gap_mm measured ("nan": not measured). Each answer: setpoint in MPa, limits, fault.
 */
#include <inttypes.h>
#include <math.h>
#include <softtwin.h>
#include <stdio.h>
#include <stdlib.h>

static void check(softtwin_status status) {
    if (status == SOFTTWIN_OK) return;
    fprintf(stderr, "%s\n", softtwin_last_error());
    exit(1);
}

int main(int argc, char **argv) {
    if (argc != 4) return fprintf(stderr, "expected MODEL SCENE QUANTITY\n"), 2;
    softtwin_model *model = NULL;
    softtwin_control *control = NULL;
    check(softtwin_model_open(argv[1], &model));
    check(softtwin_control_open(model, argv[2], NULL, argv[3], &control));
    softtwin_model_close(model); /* the controller has what it needs */

    uint64_t t_ns;
    double target;
    softtwin_control_reading reading = {0.0, 0.0, NAN, NAN};
    while (scanf("%" SCNu64 " %lf %lf %lf %lf", &t_ns, &target, &reading.pressure_mpa, &reading.gap_mm, &reading.measured) == 5) {
        softtwin_control_cycle cycle;
        check(softtwin_control_step(control, t_ns, target, 0.0, &reading, &cycle));
        printf("%.17g %" PRIu32 " %s\n", cycle.setpoint_mpa, cycle.limited, softtwin_control_fault_name(cycle.fault));
    }
    softtwin_control_close(control);
    return 0;
}
