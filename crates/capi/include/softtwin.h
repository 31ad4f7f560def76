/* C interface of softtwin's shared memory, and of models without a daemon. Payloads, numbers and units: softtwin_layout.h and
 * docs/wire.md.
 * How to use it: docs/clients/c.md.
 *
 * Every call that can fail returns a status and leaves its text with softtwin_last_error. Handles are made by `..._open` and
 * ended by `..._close` (null is fine), belong to the thread that made them (models: to all threads), and outlive their bus. */
#ifndef SOFTTWIN_H
#define SOFTTWIN_H

#include "softtwin_layout.h"

#ifdef __cplusplus
extern "C" {
#endif

/** How a call ended. */
typedef enum {
  SOFTTWIN_OK = 0,           /**< Done. */
  SOFTTWIN_TIMEOUT = 1,      /**< Nothing came within the time that was given. */
  SOFTTWIN_ABSENT = 2,       /**< The topic does not exist, or no twin answers queries. */
  SOFTTWIN_INCOMPATIBLE = 3, /**< A program of another layout version or another iceoryx2 made the topic. */
  SOFTTWIN_TAKEN = 4,        /**< Another process writes this topic already, or all reader slots are taken. */
  SOFTTWIN_ARGUMENT = 5,     /**< An argument is null, no UTF-8, no name, or of another payload. */
  SOFTTWIN_FAILED = 6,       /**< The shared memory or the ports failed. */
  SOFTTWIN_REFUSED = 7       /**< The twin has no answer; the text of the last error is its reason. */
} softtwin_status;

/** A program's membership in a shared-memory domain. */
typedef struct softtwin_bus softtwin_bus;
/** A reader of one topic. */
typedef struct softtwin_reader softtwin_reader;
/** A set of readers that is waited for. */
typedef struct softtwin_waiter softtwin_waiter;
/** A received field. Its memory is unchanged until softtwin_field_release; at most 4 may be held of one topic. */
typedef struct softtwin_field softtwin_field;
/** The one writer of a topic of readings, commands, setpoints or targets. */
typedef struct softtwin_writer softtwin_writer;
/** A client of the twin of one actuator, for questions. */
typedef struct softtwin_client softtwin_client;
/** A model in this process, with the fields and nodes that it reconstructs. Any number of threads may use one. */
typedef struct softtwin_model softtwin_model;
typedef struct softtwin_motion softtwin_motion;
/** Controller of one actuator, stepped by its caller, without a bus. Used by one thread. */
typedef struct softtwin_control softtwin_control;

/** One input of a model. */
typedef struct {
  const char *name; /**< Name with its unit (pressure_mpa, gap_mm), or the name of a parameter. */
  const char *unit; /**< Unit. */
  double min;       /**< Smallest training value; infinite when it was never trained over. */
  double max;       /**< Largest training value. */
  double value;     /**< What NaN stands for in softtwin_model_predict; NaN: must be given. A number for a pressure or gap that the model does not have: give NaN. */
} softtwin_model_input;

/** Reconstructed field of a model. */
typedef struct {
  const char *name; /**< Name (x, von_mises). */
  const char *unit; /**< Unit. */
} softtwin_model_field;

/** A named list of nodes. */
typedef struct {
  const char *name;      /**< Name. */
  const uint32_t *nodes; /**< Their numbers in the model, from 0. */
  size_t count;          /**< How many. */
} softtwin_model_node_set;

/** What a model consists of; everything stays valid until the model is closed. */
typedef struct {
  const char *actuator;               /**< Name of the actuator. */
  const softtwin_model_input *inputs; /**< Inputs in order: pressure, gap, then parameters. */
  size_t input_count;
  const softtwin_model_field *fields; /**< Fields in the order in which they are reconstructed. */
  size_t field_count;
  size_t node_count;       /**< Nodes of each field: those selected. */
  size_t model_node_count; /**< Nodes of the whole model. */
  const softtwin_model_node_set *node_sets;
  size_t node_set_count;
  const float *undeformed_mm[3]; /**< x, y and z of all nodes without pressure, mm; null when the model has none. */
  const uint32_t *triangles;     /**< Three nodes a triangle of the surface. */
  size_t triangle_count;
  const softtwin_model_field *observables; /**< Observables of the shape, such as a bending angle. */
  size_t observable_count;
} softtwin_model_info;

/** What a model answers at one state. */
typedef struct {
  double contact_force_n;           /**< Contact force, N. */
  double force_gradient[8];         /**< Derivative of the force with respect to each input, N per unit. */
  double onset_pressure_mpa;        /**< Pressure at which contact begins, MPa: 0 under gravity alone, infinite out of reach, NaN: the model has no onset. */
  double force_halfwidth_n;         /**< Half-width with nominal coverage `coverage`, N; NaN outside the training states. */
  double displacement_halfwidth_mm; /**< The same of the worst node's displacement, mm. */
  double von_mises_halfwidth_mpa;   /**< The same of the worst node's stress, MPa. */
  double coverage;                  /**< Nominal coverage of the half-widths (0.9); NaN outside the training states. */
  double domain_distance;           /**< Distance to the training states over inputs scaled to [0, 1]; 0 among them. */
  double max_displacement_mm;       /**< Largest displacement of the reconstructed fields, mm; NaN: none of them has it. */
  double max_von_mises_mpa;         /**< Largest von Mises stress of them, MPa; NaN: none of them has it. */
  uint32_t max_displacement_node;   /**< Its node in the model; UINT32_MAX: none. */
  uint32_t max_von_mises_node;      /**< Its node in the model; UINT32_MAX: none. */
  uint32_t regime;                  /**< SOFTTWIN_REGIME_FREE or SOFTTWIN_REGIME_CONTACT. */
  uint32_t domain_status;           /**< SOFTTWIN_DOMAIN_INSIDE, ...: outside, the half-widths are NaN. */
  uint32_t force_clamped;           /**< 1: the interpolated force was negative and was set to 0. */
  uint32_t reserved;
  double observables[8];           /**< In the model's order, in the unit at the end of their names; NaN: no such observable. */
  double observable_halfwidths[8]; /**< Their half-widths; NaN outside the training states. */
  double observable_offsets[8];    /**< Part of each that is a measured difference from the finite elements; 0 without one. */
} softtwin_prediction;

/** Measurements of one control cycle. */
typedef struct {
  double pressure_mpa; /**< Gauge, MPa; of a model with memory the one before it. */
  double gap_mm;       /**< Gap, mm, measured or estimated; 1e4 without an obstacle. */
  double measured;     /**< The held quantity; NaN: not measured, the model's value is used. */
  double written_mpa;  /**< Pressure that the valve was last given, MPa; NaN: the last setpoint. */
} softtwin_control_reading;

/** Limits that bind in a control cycle, bits. */
typedef enum {
  SOFTTWIN_LIMITED_FORCE = 1,      /**< The target is beyond the force limit. */
  SOFTTWIN_LIMITED_RANGE = 2,      /**< The target is beyond the model's or the valve's range. */
  SOFTTWIN_LIMITED_RATE = 4,       /**< Line, slew or rate of the valve are slower than the reference. */
  SOFTTWIN_LIMITED_CORRECTION = 8, /**< The correction is at its largest. */
  SOFTTWIN_LIMITED_VALVE = 16,     /**< The valve was given another pressure than the setpoint. */
  SOFTTWIN_LIMITED_SUPPLY = 32     /**< The supply gives less than the target needs: what it gives is held. */
} softtwin_limited;

/** Result of one control cycle. */
typedef struct {
  double setpoint_mpa;   /**< Pressure for the valve, MPa; NaN: none, because of a fault. */
  double target;         /**< The target, cut at the force limit and at what a low supply gives. */
  double reference_mpa;  /**< Reference as a pressure in the cavity, MPa. */
  double followed;       /**< The held quantity: measured, or the model's. */
  double correction_mpa; /**< The model's error as a pressure, MPa. */
  double bias_mpa;       /**< The valve's error, MPa. */
  uint32_t limited;      /**< Sum of SOFTTWIN_LIMITED_...; 0: none. */
  uint32_t fault;        /**< 0: none; else see softtwin_control_fault_name. It stays until softtwin_control_release. */
} softtwin_control_cycle;

/** Why the last call on this thread failed: what was found, what to do. Valid until the next call on this thread. */
const char *softtwin_last_error(void);
/** Layout version of the library; it must be SOFTTWIN_LAYOUT_VERSION. */
uint32_t softtwin_layout_version(void);
/** The clock of all time stamps: ns of the machine's monotonic clock, the same in every process. */
uint64_t softtwin_now_ns(void);

/** Joins a shared-memory domain. Null: $SOFTTWIN_DOMAIN and $SOFTTWIN_ROOT, or the user's own domain. */
softtwin_status softtwin_bus_open(const char *domain, const char *root, softtwin_bus **out);
/** Leaves the shared-memory domain; its readers and writers stay open. */
void softtwin_bus_close(softtwin_bus *bus);
/** Name of `regime` of a state, a field, an answer or a prediction: "free", "contact" or "unknown". */
const char *softtwin_regime_name(uint32_t regime);

/** Opens a reader of softtwin/<name>/<kind>, a topic that must exist; `node_set` null: all nodes. The functions below it
 *  read one kind of topic each and check the payload's type at compile time; they are to be preferred. The kind of a further cavity's valve
 *  is "valve/<cavity>", of its setpoints "setpoint/<cavity>". */
softtwin_status softtwin_reader_open(softtwin_bus *bus, const char *name, const char *kind, const char *node_set,
                                     softtwin_reader **out);
/** As softtwin_reader_open for a topic that may come into being later: a controller may start before its twin. `wakes` 0: samples do
 *  not wake this reader, which costs the sender next to nothing; for loops with their own clock. */
softtwin_status softtwin_reader_attach(softtwin_bus *bus, const char *name, const char *kind, const char *node_set,
                                       int wakes, softtwin_reader **out);
/** How many samples were read, and how many were sent and never read: overwritten before, or skipped for a newer one. */
softtwin_status softtwin_reader_counts(softtwin_reader *reader, uint64_t *received, uint64_t *lost);
/** Copies the oldest waiting sample (`newest` not 0: the newest) to `payload` of `size` bytes. Waits for one at most
 *  `timeout_ms` (0: does not wait, below 0: no limit). */
softtwin_status softtwin_reader_read(softtwin_reader *reader, int newest, int64_t timeout_ms, void *payload, size_t size);
/** The oldest waiting field (`newest` not 0: the newest), without a copy; to be released. Waits as softtwin_reader_read. */
softtwin_status softtwin_reader_read_field(softtwin_reader *reader, int newest, int64_t timeout_ms, softtwin_field **out);
/** Ends a reader. */
void softtwin_reader_close(softtwin_reader *reader);

/** Makes a waiter over `count` readers of this thread. Readers that are never woken end no wait. */
softtwin_status softtwin_waiter_open(softtwin_reader **readers, size_t count, softtwin_waiter **out);
/** Sleeps until one of the readers may have something, a signal comes, or `timeout_us` is over (0: does not wait, below 0: no
 *  limit): SOFTTWIN_TIMEOUT. Then read all of them with a timeout of 0. Allocates nothing. */
softtwin_status softtwin_waiter_wait(softtwin_waiter *waiter, int64_t timeout_us);
/** A descriptor that is readable when one of the readers may have something, for poll, epoll or an event loop. When it is, call
 *  softtwin_waiter_wait with 0, then read. It belongs to the waiter: neither read nor close it. */
softtwin_status softtwin_waiter_descriptor(softtwin_waiter *waiter, int *descriptor);
/** Ends a waiter; its readers stay open. */
void softtwin_waiter_close(softtwin_waiter *waiter);

/** The header of a field, in shared memory. */
const softtwin_field_header *softtwin_field_get_header(const softtwin_field *field);
/** The values of one field (SOFTTWIN_FIELD_X, ...) in shared memory, one a node. */
softtwin_status softtwin_field_values(const softtwin_field *field, uint8_t field_id, const float **values, size_t *count);
/** Gives the memory of a field back. */
void softtwin_field_release(softtwin_field *field);

/** Becomes the writer of softtwin/<name>/<kind>; kind: sensor or command. */
softtwin_status softtwin_writer_open(softtwin_bus *bus, const char *name, const char *kind, softtwin_writer **out);
/** Sends one reading, stamped now: gauge pressure in MPa, gap in mm, measured contact force in N (NaN: not measured). */
softtwin_status softtwin_writer_send_reading(softtwin_writer *writer, double pressure_mpa, double gap_mm,
                                             double measured_force_n);
/** The same with further inputs of the model by name ("load_n"), in the unit at the end of each name: `count` (at most
 *  SOFTTWIN_PARAMETERS_MAX) names of 1 to 31 bytes and values; NaN: absent. */
softtwin_status softtwin_writer_send_inputs(softtwin_writer *writer, double pressure_mpa, double gap_mm,
                                            double measured_force_n, const char **names, const double *values,
                                            size_t count);
/** Sends one command: the gauge pressure wanted, MPa, and the stamp of the reading that it answers (0: none). */
softtwin_status softtwin_writer_send_command(softtwin_writer *writer, double pressure_mpa, uint64_t t_sensor_ns);
/** Becomes the owner of an actuator's valve, the writer of softtwin/<actuator>/setpoint, or of that of a further cavity (`cavity` not
 *  NULL), softtwin/<actuator>/setpoint/<cavity>. `owner` is the name (1 to 31 bytes) by which a second one is refused: SOFTTWIN_TAKEN, the last error has name and process. A program that ends loses the valve at once. */
softtwin_status softtwin_writer_open_setpoint(softtwin_bus *bus, const char *actuator, const char *cavity,
                                              const char *owner, softtwin_writer **out);
/** Sends one setpoint: the gauge pressure wanted, MPa (NaN: none, the valve takes its safe value), for how long it counts, ms,
 *  and the stamp of the reading that it answers (0: none). Without renewal the valve takes its safe value. */
softtwin_status softtwin_writer_send_setpoint(softtwin_writer *writer, double pressure_mpa, uint32_t valid_ms,
                                              uint64_t t_sensor_ns);
/** Becomes the owner of the target of an actuator's controller (softtwin hold), the writer of softtwin/<actuator>/target. `owner`: as for
 *  setpoints. */
softtwin_status softtwin_writer_open_target(softtwin_bus *bus, const char *actuator, const char *owner,
                                            softtwin_writer **out);
/** Sends one target, in the unit of the held quantity. `kind`: SOFTTWIN_TARGET_KIND_STEP (1 value), _RAMP (1 value, reached with
 *  `rate_per_s`), _SERIES (1 to 64 `values` every `interval_s` seconds). SOFTTWIN_ARGUMENT: nothing was sent. */
softtwin_status softtwin_writer_send_target(softtwin_writer *writer, uint32_t kind, const double *values, size_t count,
                                            double rate_per_s, double interval_s);
/** Ends a writer. */
void softtwin_writer_close(softtwin_writer *writer);

/** Opens a client of a twin, which must be running. */
softtwin_status softtwin_client_open(softtwin_bus *bus, const char *actuator, softtwin_client **out);
/** A question with nothing given: all quantities NaN, the layout version filled in. */
softtwin_query softtwin_query_new(uint32_t kind);
/** Asks and waits for the answer at most `timeout_ms`. With `want_field` set, the field is copied to `values` (room for
 *  `capacity` values; `count` gets how many there are). SOFTTWIN_REFUSED: no answer, `answer` and the last error say why. */
softtwin_status softtwin_client_ask(softtwin_client *client, const softtwin_query *query, uint32_t timeout_ms,
                                    softtwin_answer *answer, float *values, size_t capacity, size_t *count);
/** Ends a client. */
void softtwin_client_close(softtwin_client *client);

/** Reads a model file, all of its fields on all of its nodes. */
softtwin_status softtwin_model_open(const char *path, softtwin_model **out);
/** The same model with some of its fields (names with commas between; null: all) on some of its nodes: those of its set
 *  `node_set` or, where that is null, the `node_count` nodes at `nodes` (null: all). Both models are to be closed. */
softtwin_status softtwin_model_select(const softtwin_model *model, const char *fields, const char *node_set,
                                      const uint32_t *nodes, size_t node_count, softtwin_model **out);
/** What the model consists of. */
softtwin_status softtwin_model_describe(const softtwin_model *model, softtwin_model_info *out);
/** Predicts `states` states, bit-identical to `softtwin predict`. `inputs`: states x inputs in the model's order; NaN: the value of
 *  the model's description; an infinite gap: no obstacle. `predictions`: room for `states`. `values`: null, or room for
 *  states x fields x nodes. Nothing is clamped: `domain_status` says where a state lies outside the training states; one farther outside than
 *  they are wide, or of a shape that the body cannot have, is refused. On a
 *  failure the last error names the state; those before it are written. */
softtwin_status softtwin_model_predict(const softtwin_model *model, const double *inputs, size_t states,
                                       softtwin_prediction *predictions, float *values);
/** Ends a model. */
void softtwin_model_close(softtwin_model *model);

/** Motion of a model with inertia or memory, which must not be closed before it; used by one thread. It begins at equilibrium with
 *  the first reading. A static model follows at once. */
softtwin_status softtwin_motion_open(const softtwin_model *model, softtwin_motion **out);
/** Moves to a reading at `t_ns`, later than the last one; inputs as in softtwin_model_predict, straight lines between readings.
 *  `values`: null, or room for fields x nodes. On a failure the motion is unchanged, unless the reading was taken and the model has no
 *  answer at its state: the motion has then reached it, and the next reading goes on from there. */
softtwin_status softtwin_motion_step(softtwin_motion *motion, uint64_t t_ns, const double *inputs,
                                     softtwin_prediction *out, float *values);
/** Forgets the past: the next reading begins at equilibrium, at any time. */
void softtwin_motion_reset(softtwin_motion *motion);
/** Ends a motion. */
void softtwin_motion_close(softtwin_motion *motion);

/** Makes a controller of the quantity `held`: "force_n" (N), "tip_y_mm" (height of the scene's marker, or of the model's tip), "pressure_mpa",
 *  "angle_deg" (its only observable in degrees, or control.hold) or an observable of the model. `scene` is a scene's file, of which control, valve, sigma.force_n, markers and given inputs of `actuator`
 *  (null: the first) count; null: defaults. The model may be closed afterwards. The law: docs/control.md. */
softtwin_status softtwin_control_open(const softtwin_model *model, const char *scene, const char *actuator, const char *held,
                                      softtwin_control **out);
/** Sets the model's inputs for the cycles that follow, in the order of softtwin_model_predict; NaN: the model's value, and for
 *  gap and driven pressure, which are those of the readings. */
softtwin_status softtwin_control_inputs(softtwin_control *control, const double *inputs, size_t count);
/** One control cycle at `t_ns`, later than the last one (after more than 0.1 s the control starts again). `rate_per_s`: known change of the target, 0 of a step.
 *  Allocates nothing. SOFTTWIN_ARGUMENT for a time that is not later and for pressure, gap or target that are not finite: nothing has
 *  changed; send no setpoint. */
softtwin_status softtwin_control_step(softtwin_control *control, uint64_t t_ns, double target, double rate_per_s,
                                      const softtwin_control_reading *reading, softtwin_control_cycle *out);
/** The same with `count` targets that are known ahead, the first for now, each `interval_s` (more than 0) after the one before; the last stays.
 *  They should reach as far as the law looks: delay and a period of the swing, with the predictive law delay and horizon. */
softtwin_status softtwin_control_step_ahead(softtwin_control *control, uint64_t t_ns, const double *targets, size_t count,
                                            double interval_s, const softtwin_control_reading *reading,
                                            softtwin_control_cycle *out);
/** Begins again where the actuator is, for each cycle in which the valve does not follow the setpoint. */
softtwin_status softtwin_control_start(softtwin_control *control, const softtwin_control_reading *reading);
/** Releases a fault: the next cycle begins the control again. */
void softtwin_control_release(softtwin_control *control);
/** Name of a fault: "no-response", "opposite-sign", "unexplained", "measurement-lost"; "none". */
const char *softtwin_control_fault_name(uint32_t fault);
/** Ends a controller. */
void softtwin_control_close(softtwin_control *control);

/* Readers of one kind: softtwin_state_reader_open(bus, actuator, &reader), ..._next and ..._newest(reader, timeout_ms,
 * &state), ..._close. The handle types are distinct, so that a compiler rejects the wrong payload. */
#define SOFTTWIN_READER_(kind, payload)                                                                                  \
  typedef struct softtwin_##kind##_reader softtwin_##kind##_reader;                                                      \
  static inline softtwin_status softtwin_##kind##_reader_open(softtwin_bus *bus, const char *name,                       \
                                                              softtwin_##kind##_reader **out) {                          \
    softtwin_reader *reader = NULL;                                                                                      \
    softtwin_status status = softtwin_reader_open(bus, name, #kind, NULL, &reader);                                      \
    if (status == SOFTTWIN_OK) *out = (softtwin_##kind##_reader *)reader;                                                \
    return status;                                                                                                       \
  }                                                                                                                      \
  static inline softtwin_status softtwin_##kind##_reader_next(softtwin_##kind##_reader *reader, int64_t timeout_ms,      \
                                                              payload *out) {                                            \
    return softtwin_reader_read((softtwin_reader *)reader, 0, timeout_ms, out, sizeof *out);                             \
  }                                                                                                                      \
  static inline softtwin_status softtwin_##kind##_reader_newest(softtwin_##kind##_reader *reader, int64_t timeout_ms,    \
                                                                payload *out) {                                          \
    return softtwin_reader_read((softtwin_reader *)reader, 1, timeout_ms, out, sizeof *out);                             \
  }                                                                                                                      \
  static inline void softtwin_##kind##_reader_close(softtwin_##kind##_reader *reader) {                                  \
    softtwin_reader_close((softtwin_reader *)reader);                                                                    \
  }

SOFTTWIN_READER_(sensor, softtwin_sensor_sample)
SOFTTWIN_READER_(state, softtwin_state)
SOFTTWIN_READER_(health, softtwin_health)
SOFTTWIN_READER_(grasp, softtwin_grasp)
SOFTTWIN_READER_(command, softtwin_command)
SOFTTWIN_READER_(estimate, softtwin_estimate)
SOFTTWIN_READER_(setpoint, softtwin_setpoint)
SOFTTWIN_READER_(valve, softtwin_valve)
#undef SOFTTWIN_READER_

/** A reader of fields. */
typedef struct softtwin_field_reader softtwin_field_reader;

/** Opens a reader of fields; `node_set` null: all nodes. The topic must exist. */
static inline softtwin_status softtwin_field_reader_open(softtwin_bus *bus, const char *actuator, const char *node_set,
                                                         softtwin_field_reader **out) {
  softtwin_reader *reader = NULL;
  softtwin_status status = softtwin_reader_open(bus, actuator, "field", node_set, &reader);
  if (status == SOFTTWIN_OK) *out = (softtwin_field_reader *)reader;
  return status;
}
/** The oldest waiting field; waits for one at most `timeout_ms`. To be released. */
static inline softtwin_status softtwin_field_reader_next(softtwin_field_reader *reader, int64_t timeout_ms,
                                                         softtwin_field **out) {
  return softtwin_reader_read_field((softtwin_reader *)reader, 0, timeout_ms, out);
}
/** The newest waiting field; older ones are given back. */
static inline softtwin_status softtwin_field_reader_newest(softtwin_field_reader *reader, int64_t timeout_ms,
                                                           softtwin_field **out) {
  return softtwin_reader_read_field((softtwin_reader *)reader, 1, timeout_ms, out);
}
/** Ends a reader. */
static inline void softtwin_field_reader_close(softtwin_field_reader *reader) {
  softtwin_reader_close((softtwin_reader *)reader);
}

#ifdef __cplusplus
}
#endif

#endif /* SOFTTWIN_H */
