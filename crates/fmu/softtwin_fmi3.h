/* The functions of the library in binaries/PLATFORM of this FMU (FMI 3.0), for those who compile it for another platform or call it
   from another program. Signatures are those of fmi3FunctionTypes.h of the FMI standard, which may be included before this file;
   without it this file stands alone. A library for another platform exports all of these names. */
#ifndef SOFTTWIN_FMI3_H
#define SOFTTWIN_FMI3_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define SOFTTWIN_FMI3 __declspec(dllimport)
#else
#define SOFTTWIN_FMI3
#endif

#ifdef __cplusplus
extern "C" {
#endif

#ifndef fmi3FunctionTypes_h
typedef void *fmi3Instance;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
/* Why a call failed, or why there is no instance; null for none. */
typedef void (*fmi3LogMessageCallback)(void *environment, fmi3Status status, const char *category, const char *message);
/* Never called by this FMU. */
typedef void (*fmi3IntermediateUpdateCallback)(void *environment, double time, bool set_requested, bool get_allowed,
    bool step_finished, bool can_return_early, bool *early_return_requested, double *early_return_time);
typedef void (*fmi3ClockUpdateCallback)(void *environment);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);
#endif

/* Begin, end, modes. resource_path is the folder resources/ of the unpacked FMU; times in s. */
SOFTTWIN_FMI3 const char *fmi3GetVersion(void);
SOFTTWIN_FMI3 fmi3Status fmi3SetDebugLogging(fmi3Instance instance, bool on, size_t count, const char *const categories[]);
SOFTTWIN_FMI3 fmi3Instance fmi3InstantiateModelExchange(const char *name, const char *token, const char *resource_path,
    bool visible, bool logging, void *environment, fmi3LogMessageCallback log);
SOFTTWIN_FMI3 fmi3Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resource_path,
    bool visible, bool logging, bool event_mode, bool early_return, const uint32_t required[], size_t required_count,
    void *environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update);
SOFTTWIN_FMI3 void fmi3FreeInstance(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, bool has_tolerance, double tolerance, double start,
    bool has_stop, double stop);
SOFTTWIN_FMI3 fmi3Status fmi3ExitInitializationMode(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3EnterEventMode(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3EnterStepMode(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3Terminate(fmi3Instance instance);
SOFTTWIN_FMI3 fmi3Status fmi3Reset(fmi3Instance instance);

/* Inputs and outputs by their value references of modelDescription.xml. */
SOFTTWIN_FMI3 fmi3Status fmi3GetFloat64(fmi3Instance instance, const uint32_t references[], size_t count, double values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetFloat64(fmi3Instance instance, const uint32_t references[], size_t count, const double values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetInt32(fmi3Instance instance, const uint32_t references[], size_t count, int32_t values[],
    size_t value_count);

/* Steps. */
SOFTTWIN_FMI3 fmi3Status fmi3SetTime(fmi3Instance instance, double time);
SOFTTWIN_FMI3 fmi3Status fmi3DoStep(fmi3Instance instance, double time, double step, bool no_set_prior, bool *event_needed,
    bool *terminate, bool *early_return, double *last_time);
SOFTTWIN_FMI3 fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, bool no_set_prior, bool *enter_event_mode,
    bool *terminate);
SOFTTWIN_FMI3 fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, bool *needs_update, bool *terminate,
    bool *nominals_changed, bool *values_changed, bool *has_next_event, double *next_event);

/* There are no continuous states and no event indicators: counts are 0, arrays empty. */
SOFTTWIN_FMI3 fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *count);
SOFTTWIN_FMI3 fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *count);
SOFTTWIN_FMI3 fmi3Status fmi3GetContinuousStates(fmi3Instance instance, double values[], size_t count);
SOFTTWIN_FMI3 fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const double values[], size_t count);
SOFTTWIN_FMI3 fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, double values[], size_t count);
SOFTTWIN_FMI3 fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, double values[], size_t count);
SOFTTWIN_FMI3 fmi3Status fmi3GetEventIndicators(fmi3Instance instance, double values[], size_t count);

/* Not supported: fmi3Error, or null. */
SOFTTWIN_FMI3 fmi3Status fmi3GetFloat32(fmi3Instance instance, const uint32_t references[], size_t count, float values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetInt8(fmi3Instance instance, const uint32_t references[], size_t count, int8_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetUInt8(fmi3Instance instance, const uint32_t references[], size_t count, uint8_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetInt16(fmi3Instance instance, const uint32_t references[], size_t count, int16_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetUInt16(fmi3Instance instance, const uint32_t references[], size_t count, uint16_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetUInt32(fmi3Instance instance, const uint32_t references[], size_t count, uint32_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetInt64(fmi3Instance instance, const uint32_t references[], size_t count, int64_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetUInt64(fmi3Instance instance, const uint32_t references[], size_t count, uint64_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetBoolean(fmi3Instance instance, const uint32_t references[], size_t count, bool values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetString(fmi3Instance instance, const uint32_t references[], size_t count, const char *values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetBinary(fmi3Instance instance, const uint32_t references[], size_t count, size_t sizes[],
    const uint8_t *values[], size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetClock(fmi3Instance instance, const uint32_t references[], size_t count, bool values[]);
SOFTTWIN_FMI3 fmi3Status fmi3SetInt32(fmi3Instance instance, const uint32_t references[], size_t count, const int32_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetFloat32(fmi3Instance instance, const uint32_t references[], size_t count, const float values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetInt8(fmi3Instance instance, const uint32_t references[], size_t count, const int8_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetUInt8(fmi3Instance instance, const uint32_t references[], size_t count, const uint8_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetInt16(fmi3Instance instance, const uint32_t references[], size_t count, const int16_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetUInt16(fmi3Instance instance, const uint32_t references[], size_t count, const uint16_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetUInt32(fmi3Instance instance, const uint32_t references[], size_t count, const uint32_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetInt64(fmi3Instance instance, const uint32_t references[], size_t count, const int64_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetUInt64(fmi3Instance instance, const uint32_t references[], size_t count, const uint64_t values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetBoolean(fmi3Instance instance, const uint32_t references[], size_t count, const bool values[],
    size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetString(fmi3Instance instance, const uint32_t references[], size_t count,
    const char *const values[], size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetBinary(fmi3Instance instance, const uint32_t references[], size_t count, const size_t sizes[],
    const uint8_t *const values[], size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3SetClock(fmi3Instance instance, const uint32_t references[], size_t count, const bool values[]);
SOFTTWIN_FMI3 fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, uint32_t reference, size_t *count);
SOFTTWIN_FMI3 fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, uint32_t reference, size_t elements[],
    uint32_t independents[], size_t independent_elements[], fmi3DependencyKind kinds[], size_t count);
SOFTTWIN_FMI3 fmi3Status fmi3GetFMUState(fmi3Instance instance, void **state);
SOFTTWIN_FMI3 fmi3Status fmi3SetFMUState(fmi3Instance instance, void *state);
SOFTTWIN_FMI3 fmi3Status fmi3FreeFMUState(fmi3Instance instance, void **state);
SOFTTWIN_FMI3 fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, void *state, size_t *size);
SOFTTWIN_FMI3 fmi3Status fmi3SerializeFMUState(fmi3Instance instance, void *state, uint8_t bytes[], size_t size);
SOFTTWIN_FMI3 fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const uint8_t bytes[], size_t size, void **state);
SOFTTWIN_FMI3 fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const uint32_t unknowns[], size_t unknown_count,
    const uint32_t knowns[], size_t known_count, const double seed[], size_t seed_count, double sensitivity[],
    size_t sensitivity_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const uint32_t unknowns[], size_t unknown_count,
    const uint32_t knowns[], size_t known_count, const double seed[], size_t seed_count, double sensitivity[],
    size_t sensitivity_count);
SOFTTWIN_FMI3 fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const uint32_t references[], size_t count,
    double intervals[], fmi3IntervalQualifier qualifiers[]);
SOFTTWIN_FMI3 fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const uint32_t references[], size_t count,
    uint64_t counters[], uint64_t resolutions[], fmi3IntervalQualifier qualifiers[]);
SOFTTWIN_FMI3 fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const uint32_t references[], size_t count, double shifts[]);
SOFTTWIN_FMI3 fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const uint32_t references[], size_t count,
    uint64_t counters[], uint64_t resolutions[]);
SOFTTWIN_FMI3 fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const uint32_t references[], size_t count,
    const double intervals[]);
SOFTTWIN_FMI3 fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const uint32_t references[], size_t count,
    const uint64_t counters[], const uint64_t resolutions[]);
SOFTTWIN_FMI3 fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const uint32_t references[], size_t count,
    const double shifts[]);
SOFTTWIN_FMI3 fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const uint32_t references[], size_t count,
    const uint64_t counters[], const uint64_t resolutions[]);
SOFTTWIN_FMI3 fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const uint32_t references[], size_t count,
    const int32_t orders[], double values[], size_t value_count);
SOFTTWIN_FMI3 fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, uint32_t clock, double time);
SOFTTWIN_FMI3 fmi3Instance fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resource_path,
    bool visible, bool logging, void *environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock);

#ifdef __cplusplus
}
#endif

#endif
