/* Predicts one state with a model file, without a daemon.
 *   cc model.c $(pkg-config --cflags --libs softtwin) -lm -o model && ./model finger.twin pressure_mpa=0.05 gap_mm=30
 */
#include <math.h>
#include <softtwin.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void check(softtwin_status status) {
    if (status == SOFTTWIN_OK) return;
    fprintf(stderr, "%s\n", softtwin_last_error());
    exit(1);
}

/* Puts NAME=VALUE into its place among the inputs. */
static void set(const softtwin_model_info *info, double *inputs, const char *setting) {
    const char *value = strchr(setting, '=');
    for (size_t at = 0; value && at < info->input_count; at++) {
        const char *name = info->inputs[at].name;
        if (strlen(name) != (size_t)(value - setting) || strncmp(name, setting, strlen(name)) != 0) continue;
        inputs[at] = atof(value + 1);
        return;
    }
    fprintf(stderr, "expected NAME=VALUE with an input of the model, found %s\n", setting);
    exit(2);
}

int main(int argc, char **argv) {
    softtwin_model *model = NULL;
    softtwin_model_info info;
    check(softtwin_model_open(argc > 1 ? argv[1] : "finger.twin", &model));
    check(softtwin_model_describe(model, &info));

    double inputs[8] = {0.05, 30.0, NAN, NAN, NAN, NAN, NAN, NAN}; /* NaN: the model's default of a parameter */
    for (int at = 2; at < argc; at++) set(&info, inputs, argv[at]);

    float *values = malloc(info.field_count * info.node_count * sizeof *values);
    softtwin_prediction found;
    check(softtwin_model_predict(model, inputs, 1, &found, values));
    printf("force %.17g +- %.3g N\n", found.contact_force_n, found.force_halfwidth_n);
    for (size_t at = 0; at < info.input_count; at++)
        printf("by %s %.17g N per %s\n", info.inputs[at].name, found.force_gradient[at], info.inputs[at].unit);
    if (found.domain_status != SOFTTWIN_DOMAIN_INSIDE) printf("outside the training states by %.3g\n", found.domain_distance);
    for (size_t field = 0; field < info.field_count; field++)
        printf("%s of node 0: %.9g %s\n", info.fields[field].name, values[field * info.node_count], info.fields[field].unit);
    printf("largest stress %.9g MPa at node %u\n", found.max_von_mises_mpa, found.max_von_mises_node);
    free(values);
    softtwin_model_close(model);
    return 0;
}
