/* The valve of valve.h as a Functional Mock-up Unit for co-simulation, FMI 3.0
   (https://fmi-standard.org/docs/3.0/). It needs no header of the standard; with
   FMI3_STANDARD_HEADERS it takes these instead of its own declarations.

   The valve samples OP every sample_time, at the first time of the simulation and so on. A
   communication step from t to t + h brings the samples in [t, t + h), each with the OP that was
   set for this step: OP is held, whatever the step. The position at t is that of the last sample
   before t. */

#ifdef FMI3_STANDARD_HEADERS
#include "fmi3Functions.h"
#define FULL_NAME(name) name
#else
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent }
    fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged }
    fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean,
    fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)();
typedef void (*fmi3UnlockPreemptionCallback)();
#ifdef FMI3_FUNCTION_PREFIX
#define PASTE(a, b) a##b
#define PASTED(a, b) PASTE(a, b)
#define FULL_NAME(name) PASTED(FMI3_FUNCTION_PREFIX, name)
#define FMI3_Export
#else
#define FULL_NAME(name) name
#if defined _WIN32 || defined __CYGWIN__
#define FMI3_Export __declspec(dllexport)
#elif defined __GNUC__
#define FMI3_Export __attribute__((visibility("default")))
#else
#define FMI3_Export
#endif
#endif
#endif

#include "valve.h"

#define EXPORT(type, name) FMI3_Export type FULL_NAME(name)

/* Value references; those of the parameters follow in the order of start_values.h. */
enum { TIME, OP, POSITION, STEM, CURVE_OP, CURVE_TRAVEL, FIRST_PARAMETER };

#define WITHIN 1e-6 /* of a sample: a sample that falls on the end of a step belongs to the next */

typedef enum { INSTANTIATED, INITIALIZATION, STEPPING, TERMINATED } Mode;

typedef struct {
    Valve valve;
    Mode mode;
    double start, time, samples;
    bool tuned;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Instance;

static const bool TUNABLE[N_PARAMETERS] = {TUNABLE_PARAMETERS};

static fmi3Status refused(Instance *instance, const char *why)
{
    if (instance->log) instance->log(instance->environment, fmi3Error, "logStatusError", why);
    return fmi3Error;
}

static void begin(Instance *instance)
{
    static const double VALUES[N_PARAMETERS] = {
#define VALUE(name, value) value,
        PARAMETERS(VALUE)
#undef VALUE
    };
    Valve *v = &instance->valve;
    free(v->waiting);
    memset(v, 0, sizeof *v);
    memcpy(v->q, VALUES, sizeof VALUES);
#if CURVE_POINTS > 0
    static const double OPS[] = {CURVE_OP_VALUES}, TRAVELS[] = {CURVE_TRAVEL_VALUES};
    memcpy(v->curve_op, OPS, sizeof OPS);
    memcpy(v->curve_travel, TRAVELS, sizeof TRAVELS);
#endif
    v->op = OP_START;
    v->position = v->x = v->z = v->q[POSITION_START];
    instance->mode = INSTANTIATED;
    instance->start = instance->time = instance->samples = 0.0;
    instance->tuned = false;
}

/* ---------------------------------------------------------------- life of an instance */

EXPORT(const char *, fmi3GetVersion)(void) { return "3.0"; }

EXPORT(fmi3Instance, fmi3InstantiateCoSimulation)(fmi3String name, fmi3String token,
    fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
    fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t n_intermediate,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)event_mode;
    (void)early_return, (void)intermediate, (void)n_intermediate, (void)update;
    if (token == NULL || strcmp(token, INSTANTIATION_TOKEN) != 0) {
        if (log) log(environment, fmi3Error, "logStatusError",
            "The instantiation token is not that of this valve: modelDescription.xml and sources "
            "or binary are of different FMUs.");
        return NULL;
    }
    Instance *instance = calloc(1, sizeof *instance);
    if (instance == NULL) return NULL;
    instance->environment = environment;
    instance->log = log;
    begin(instance);
    return instance;
}

EXPORT(void, fmi3FreeInstance)(fmi3Instance given)
{
    Instance *instance = given;
    if (instance == NULL) return;
    free(instance->valve.waiting);
    free(instance);
}

EXPORT(fmi3Status, fmi3EnterInitializationMode)(fmi3Instance given, fmi3Boolean has_tolerance,
    fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    Instance *instance = given;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    if (instance->mode != INSTANTIATED)
        return refused(instance, "Only a new or reset valve can be initialised.");
    instance->mode = INITIALIZATION;
    instance->start = instance->time = start;
    return fmi3OK;
}

static bool usable(const Valve *v)
{
    const double *q = v->q;
    bool ok = q[SAMPLE_TIME] > 0.0 && q[TIGHT_WIDTH] > 0.0 && q[SUPPLY_RECOVERY] > 0.0
        && q[DWELL_TIME] > 0.0 && q[RECORD_TIME] > 0.0 && q[READING_GAIN] != 0.0 && q[STOP_LOW] <= q[STOP_HIGH];
#if CURVE_POINTS > 0
    for (int i = 1; i < CURVE_POINTS; i++) ok = ok && v->curve_op[i] > v->curve_op[i - 1];
#endif
    return ok;
}

static fmi3Status restarted(Instance *instance)
{
    if (!usable(&instance->valve))
        return refused(instance, "sample_time, tight_width, supply_recovery, dwell_time and "
            "record_time must be above 0, reading_gain not 0, stop_low no higher than stop_high, curve_op rising.");
    if (!restart(&instance->valve))
        return refused(instance, "dead_time must be 0 or more and at most ten million samples of "
            "sample_time.");
    return fmi3OK;
}

EXPORT(fmi3Status, fmi3ExitInitializationMode)(fmi3Instance given)
{
    Instance *instance = given;
    if (instance->mode != INITIALIZATION)
        return refused(instance, "The valve is not being initialised.");
    instance->mode = STEPPING;
    instance->samples = 0.0;
    return restarted(instance);
}

EXPORT(fmi3Status, fmi3Terminate)(fmi3Instance given)
{
    Instance *instance = given;
    if (instance->mode != STEPPING) return refused(instance, "The valve is not running.");
    instance->mode = TERMINATED;
    return fmi3OK;
}

EXPORT(fmi3Status, fmi3Reset)(fmi3Instance given)
{
    begin(given);
    return fmi3OK;
}

/* ---------------------------------------------------------------- values */

/* Where the values of a variable stand, and how many they are; NULL for a reference that has none. */
static double *values_of(Instance *instance, fmi3ValueReference reference, size_t *count)
{
    Valve *v = &instance->valve;
    *count = 1;
    if (reference == TIME) return &instance->time;
    if (reference == OP) return &v->op;
    if (reference == POSITION) return &v->position;
    if (reference == STEM) return &v->x;
#if CURVE_POINTS > 0
    if (reference == CURVE_OP || reference == CURVE_TRAVEL) {
        *count = CURVE_POINTS;
        return reference == CURVE_OP ? v->curve_op : v->curve_travel;
    }
#endif
    if (reference < FIRST_PARAMETER || reference >= FIRST_PARAMETER + N_PARAMETERS) return NULL;
    return &v->q[reference - FIRST_PARAMETER];
}

EXPORT(fmi3Status, fmi3GetFloat64)(fmi3Instance given, const fmi3ValueReference references[],
    size_t n_references, fmi3Float64 values[], size_t n_values)
{
    Instance *instance = given;
    size_t at = 0, count;
    for (size_t i = 0; i < n_references; i++, at += count) {
        const double *found = values_of(instance, references[i], &count);
        if (found == NULL || at + count > n_values)
            return refused(instance, "No variable has this value reference, or too few values are "
                "asked for.");
        memcpy(values + at, found, count * sizeof *values);
    }
    return fmi3OK;
}

EXPORT(fmi3Status, fmi3SetFloat64)(fmi3Instance given, const fmi3ValueReference references[],
    size_t n_references, const fmi3Float64 values[], size_t n_values)
{
    Instance *instance = given;
    bool before = instance->mode == INSTANTIATED || instance->mode == INITIALIZATION;
    size_t at = 0, count;
    for (size_t i = 0; i < n_references; i++, at += count) {
        fmi3ValueReference reference = references[i];
        double *found = values_of(instance, reference, &count);
        if (found == NULL || at + count > n_values)
            return refused(instance, "No variable has this value reference, or too few values are "
                "given.");
        if (reference == TIME || reference == POSITION || reference == STEM)
            return refused(instance, "The valve tells time, position and stem; they cannot be set.");
        bool tuned = reference >= FIRST_PARAMETER && TUNABLE[reference - FIRST_PARAMETER];
        if (!before && reference != OP && !tuned)
            return refused(instance, "A fixed parameter can be set before the run only.");
        for (size_t k = 0; k < count; k++)
            if (!isfinite(values[at + k]))
                return refused(instance, "A value that is no number was given to the valve.");
        memcpy(found, values + at, count * sizeof *found);
        instance->tuned = instance->tuned || reference != OP;
    }
    return fmi3OK;
}

/* ---------------------------------------------------------------- time */

EXPORT(fmi3Status, fmi3DoStep)(fmi3Instance given, fmi3Float64 now, fmi3Float64 step,
    fmi3Boolean no_set_state, fmi3Boolean *event_needed, fmi3Boolean *terminate,
    fmi3Boolean *early_return, fmi3Float64 *last_time)
{
    Instance *instance = given;
    Valve *v = &instance->valve;
    double dt = v->q[SAMPLE_TIME];
    (void)no_set_state;
    *event_needed = *terminate = *early_return = false;
    *last_time = instance->time;
    if (instance->mode != STEPPING) return refused(instance, "The valve is not running.");
    if (!(step > 0.0) || fabs(now - instance->time) > WITHIN * dt)
        return refused(instance, "A step begins where the one before ended, and is longer than 0.");
    if (instance->tuned && !usable(v)) return restarted(instance); /* says what is wrong */
    if (instance->tuned) prepare(v);
    instance->tuned = false;
    double end = now + step;
    for (; instance->start + instance->samples * dt < end - WITHIN * dt; instance->samples += 1.0) {
        if (instance->samples > 0.0) advance(v);
        else if (restarted(instance) != fmi3OK) return fmi3Error; /* by the OP of the first step */
    }
    *last_time = instance->time = end;
    return fmi3OK;
}

/* ---------------------------------------------------------------- state, to go back to */

EXPORT(fmi3Status, fmi3GetFMUState)(fmi3Instance given, fmi3FMUState *state)
{
    Instance *instance = given, *copy = *state;
    size_t size = (size_t)(instance->valve.delay + 2) * sizeof(double);
    if (copy == NULL) copy = calloc(1, sizeof *copy);
    if (copy == NULL) return refused(instance, "There is no memory left for a state.");
    free(copy->valve.waiting);
    *copy = *instance;
    if (instance->valve.waiting != NULL) {
        copy->valve.waiting = malloc(size);
        if (copy->valve.waiting == NULL) {
            free(copy);
            *state = NULL;
            return refused(instance, "There is no memory left for a state.");
        }
        memcpy(copy->valve.waiting, instance->valve.waiting, size);
    }
    *state = copy;
    return fmi3OK;
}

EXPORT(fmi3Status, fmi3SetFMUState)(fmi3Instance given, fmi3FMUState state)
{
    if (state == NULL) return refused(given, "There is no state to go back to.");
    return FULL_NAME(fmi3GetFMUState)(state, &given);
}

EXPORT(fmi3Status, fmi3FreeFMUState)(fmi3Instance given, fmi3FMUState *state)
{
    (void)given;
    if (state != NULL) {
        FULL_NAME(fmi3FreeInstance)(*state);
        *state = NULL;
    }
    return fmi3OK;
}

/* ---------------------------------------------------------------- what this valve has not */

static fmi3Status none(fmi3Instance given)
{
    return refused(given, "This valve has no such thing: it is for co-simulation, its variables are "
        "Float64, and it has no clocks, events or derivatives.");
}

EXPORT(fmi3Status, fmi3SetDebugLogging)(fmi3Instance given, fmi3Boolean on, size_t n,
    const fmi3String categories[])
{
    (void)given, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

EXPORT(fmi3Instance, fmi3InstantiateModelExchange)(fmi3String name, fmi3String token,
    fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment;
    (void)log;
    return NULL;
}

EXPORT(fmi3Instance, fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token,
    fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment;
    (void)log, (void)update, (void)lock, (void)unlock;
    return NULL;
}

#define NO_TYPE(Type) \
    EXPORT(fmi3Status, fmi3Get##Type)(fmi3Instance given, const fmi3ValueReference references[], \
        size_t n_references, fmi3##Type values[], size_t n_values) \
    { \
        (void)references, (void)values, (void)n_values; \
        return n_references == 0 ? fmi3OK : none(given); \
    } \
    EXPORT(fmi3Status, fmi3Set##Type)(fmi3Instance given, const fmi3ValueReference references[], \
        size_t n_references, const fmi3##Type values[], size_t n_values) \
    { \
        (void)references, (void)values, (void)n_values; \
        return n_references == 0 ? fmi3OK : none(given); \
    }
NO_TYPE(Float32)
NO_TYPE(Int8)
NO_TYPE(UInt8)
NO_TYPE(Int16)
NO_TYPE(UInt16)
NO_TYPE(Int32)
NO_TYPE(UInt32)
NO_TYPE(Int64)
NO_TYPE(UInt64)
NO_TYPE(Boolean)
NO_TYPE(String)

#define NOT_HERE(name, parameters, unused) \
    EXPORT(fmi3Status, name) parameters \
    { \
        unused; \
        return none(given); \
    }
NOT_HERE(fmi3GetBinary, (fmi3Instance given, const fmi3ValueReference references[], size_t n,
    size_t sizes[], fmi3Binary values[], size_t n_values), ((void)references, (void)n,
    (void)sizes, (void)values, (void)n_values))
NOT_HERE(fmi3SetBinary, (fmi3Instance given, const fmi3ValueReference references[], size_t n,
    const size_t sizes[], const fmi3Binary values[], size_t n_values), ((void)references, (void)n,
    (void)sizes, (void)values, (void)n_values))
NOT_HERE(fmi3GetClock, (fmi3Instance given, const fmi3ValueReference references[], size_t n,
    fmi3Clock values[]), ((void)references, (void)n, (void)values))
NOT_HERE(fmi3SetClock, (fmi3Instance given, const fmi3ValueReference references[], size_t n, const
    fmi3Clock values[]), ((void)references, (void)n, (void)values))
NOT_HERE(fmi3GetNumberOfVariableDependencies, (fmi3Instance given, fmi3ValueReference reference,
    size_t *n), ((void)reference, (void)n))
NOT_HERE(fmi3GetVariableDependencies, (fmi3Instance given, fmi3ValueReference dependent, size_t
    elements[], fmi3ValueReference independents[], size_t their_elements[], fmi3DependencyKind
    kinds[], size_t n), ((void)dependent, (void)elements, (void)independents,
    (void)their_elements, (void)kinds, (void)n))
NOT_HERE(fmi3SerializedFMUStateSize, (fmi3Instance given, fmi3FMUState state, size_t *size),
    ((void)state, (void)size))
NOT_HERE(fmi3SerializeFMUState, (fmi3Instance given, fmi3FMUState state, fmi3Byte bytes[], size_t
    size), ((void)state, (void)bytes, (void)size))
NOT_HERE(fmi3DeserializeFMUState, (fmi3Instance given, const fmi3Byte bytes[], size_t size,
    fmi3FMUState *state), ((void)bytes, (void)size, (void)state))
NOT_HERE(fmi3GetDirectionalDerivative, (fmi3Instance given, const fmi3ValueReference unknowns[],
    size_t n_unknowns, const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64
    seed[], size_t n_seed, fmi3Float64 sensitivity[], size_t n), ((void)unknowns,
    (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed, (void)sensitivity,
    (void)n))
NOT_HERE(fmi3GetAdjointDerivative, (fmi3Instance given, const fmi3ValueReference unknowns[],
    size_t n_unknowns, const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64
    seed[], size_t n_seed, fmi3Float64 sensitivity[], size_t n), ((void)unknowns,
    (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed, (void)sensitivity,
    (void)n))
NOT_HERE(fmi3EnterConfigurationMode, (fmi3Instance given), ((void)0))
NOT_HERE(fmi3ExitConfigurationMode, (fmi3Instance given), ((void)0))
NOT_HERE(fmi3GetIntervalDecimal, (fmi3Instance given, const fmi3ValueReference references[],
    size_t n, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]), ((void)references,
    (void)n, (void)intervals, (void)qualifiers))
NOT_HERE(fmi3GetIntervalFraction, (fmi3Instance given, const fmi3ValueReference references[],
    size_t n, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier
    qualifiers[]), ((void)references, (void)n, (void)counters, (void)resolutions,
    (void)qualifiers))
NOT_HERE(fmi3GetShiftDecimal, (fmi3Instance given, const fmi3ValueReference references[], size_t
    n, fmi3Float64 shifts[]), ((void)references, (void)n, (void)shifts))
NOT_HERE(fmi3GetShiftFraction, (fmi3Instance given, const fmi3ValueReference references[], size_t
    n, fmi3UInt64 counters[], fmi3UInt64 resolutions[]), ((void)references, (void)n,
    (void)counters, (void)resolutions))
NOT_HERE(fmi3SetIntervalDecimal, (fmi3Instance given, const fmi3ValueReference references[],
    size_t n, const fmi3Float64 intervals[]), ((void)references, (void)n, (void)intervals))
NOT_HERE(fmi3SetIntervalFraction, (fmi3Instance given, const fmi3ValueReference references[],
    size_t n, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]), ((void)references,
    (void)n, (void)counters, (void)resolutions))
NOT_HERE(fmi3SetShiftDecimal, (fmi3Instance given, const fmi3ValueReference references[], size_t
    n, const fmi3Float64 shifts[]), ((void)references, (void)n, (void)shifts))
NOT_HERE(fmi3SetShiftFraction, (fmi3Instance given, const fmi3ValueReference references[], size_t
    n, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]), ((void)references, (void)n,
    (void)counters, (void)resolutions))
NOT_HERE(fmi3EvaluateDiscreteStates, (fmi3Instance given), ((void)0))
NOT_HERE(fmi3UpdateDiscreteStates, (fmi3Instance given, fmi3Boolean *again, fmi3Boolean
    *terminate, fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64
    *next), ((void)again, (void)terminate, (void)nominals, (void)states, (void)defined,
    (void)next))
NOT_HERE(fmi3EnterEventMode, (fmi3Instance given), ((void)0))
NOT_HERE(fmi3EnterContinuousTimeMode, (fmi3Instance given), ((void)0))
NOT_HERE(fmi3CompletedIntegratorStep, (fmi3Instance given, fmi3Boolean no_set_state, fmi3Boolean
    *event, fmi3Boolean *terminate), ((void)no_set_state, (void)event, (void)terminate))
NOT_HERE(fmi3SetTime, (fmi3Instance given, fmi3Float64 time), ((void)time))
NOT_HERE(fmi3SetContinuousStates, (fmi3Instance given, const fmi3Float64 states[], size_t n),
    ((void)states, (void)n))
NOT_HERE(fmi3GetContinuousStateDerivatives, (fmi3Instance given, fmi3Float64 derivatives[], size_t
    n), ((void)derivatives, (void)n))
NOT_HERE(fmi3GetEventIndicators, (fmi3Instance given, fmi3Float64 indicators[], size_t n),
    ((void)indicators, (void)n))
NOT_HERE(fmi3GetContinuousStates, (fmi3Instance given, fmi3Float64 states[], size_t n),
    ((void)states, (void)n))
NOT_HERE(fmi3GetNominalsOfContinuousStates, (fmi3Instance given, fmi3Float64 nominals[], size_t
    n), ((void)nominals, (void)n))
NOT_HERE(fmi3GetNumberOfEventIndicators, (fmi3Instance given, size_t *n), ((void)n))
NOT_HERE(fmi3GetNumberOfContinuousStates, (fmi3Instance given, size_t *n), ((void)n))
NOT_HERE(fmi3EnterStepMode, (fmi3Instance given), ((void)0))
NOT_HERE(fmi3GetOutputDerivatives, (fmi3Instance given, const fmi3ValueReference references[],
    size_t n, const fmi3Int32 orders[], fmi3Float64 values[], size_t n_values), ((void)references,
    (void)n, (void)orders, (void)values, (void)n_values))
NOT_HERE(fmi3ActivateModelPartition, (fmi3Instance given, fmi3ValueReference clock, fmi3Float64
    at), ((void)clock, (void)at))
