/* A sampled machine as a slave of FMI 2.0 for co-simulation. The code before this file defines its variables, GUID,
   SAMPLE_TIME, limits of its parameters, and struct machine with machine_init, machine_begin and machine_end.

   A sample begins at each whole multiple of SAMPLE_TIME after the start: the inputs are read then and held until it
   ends. The master may take any steps; it reads and sets values only at its communication points. */

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

/* Enumerations of FMI 2.0 (fmi2Status, fmi2Type), and its callback functions of the master. */
enum { OK, WARNING, DISCARD, ERROR };
enum { MODEL_EXCHANGE, CO_SIMULATION };
typedef struct {
  void (*logger)(void *environment, const char *instance, int status, const char *category, const char *message, ...);
  void *(*allocate)(size_t count, size_t size);
  void (*release)(void *memory);
  void (*finished)(void *environment, int status);
  void *environment;
} master;

struct slave {
  const master *calls;
  char name[128];
  double values[VARIABLES], start;
  long long samples; /* number of finished samples */
  int underway;      /* whether a sample has begun */
  struct machine machine;
};

static int refused(const struct slave *slave, const char *why)
{
  const master *calls = slave->calls;
  if (calls && calls->logger) calls->logger(calls->environment, slave->name, ERROR, "error", "%s", why);
  return ERROR;
}

PUBLIC const char *fmi2GetTypesPlatform(void) { return "default"; }
PUBLIC const char *fmi2GetVersion(void) { return "2.0"; }

PUBLIC int fmi2Reset(struct slave *slave)
{
  memcpy(slave->values, first, sizeof first);
  slave->start = 0;
  slave->samples = slave->underway = 0;
  machine_init(&slave->machine, slave->values);
  return OK;
}

PUBLIC void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const master *calls,
                             int visible, int logging)
{
  struct slave *slave = calloc(1, sizeof *slave);
  (void)resources, (void)visible, (void)logging;
  if (!slave) return NULL;
  slave->calls = calls;
  strncpy(slave->name, name ? name : "", sizeof slave->name - 1);
  if (type != CO_SIMULATION || !guid || strcmp(guid, GUID)) {
    refused(slave, "The library is for co-simulation, with the modelDescription.xml that came with it.");
    free(slave);
    return NULL;
  }
  fmi2Reset(slave);
  return slave;
}

PUBLIC void fmi2FreeInstance(struct slave *slave) { free(slave); }

PUBLIC int fmi2SetupExperiment(struct slave *slave, int tolerant, double tolerance, double start, int ends, double stop)
{
  (void)tolerant, (void)tolerance, (void)ends, (void)stop;
  slave->start = start;
  return OK;
}

PUBLIC int fmi2EnterInitializationMode(struct slave *slave)
{
  machine_init(&slave->machine, slave->values);
  return OK;
}

/* Parameters outside their limits, such as zero inertia, would make every output a NaN or meaningless. */
PUBLIC int fmi2ExitInitializationMode(struct slave *slave)
{
  for (int i = 0; limits[i].name; ++i) {
    double value = slave->values[limits[i].place];
    char why[256];
    if (isfinite(value) && value >= limits[i].lower && value <= limits[i].upper) continue;
    snprintf(why, sizeof why, "%s = %g must be finite and within %g .. %g.", limits[i].name, value, limits[i].lower,
             limits[i].upper);
    return refused(slave, why);
  }
  return fmi2EnterInitializationMode(slave);
}

PUBLIC int fmi2DoStep(struct slave *slave, double now, double length, int settled)
{
  double end = now + length, near = 1e-6 * SAMPLE_TIME;
  (void)settled;
  if (!(length > 0) || !isfinite(end)) return refused(slave, "A step must go forward by a finite time.");
  for (;;) {
    if (!slave->underway) {
      if (slave->start + (double)slave->samples * SAMPLE_TIME > end - near) return OK;
      machine_begin(&slave->machine, slave->values);
      slave->underway = 1;
    }
    if (slave->start + (double)(slave->samples + 1) * SAMPLE_TIME > end + near) return OK;
    machine_end(&slave->machine, slave->values);
    ++slave->samples;
    slave->underway = 0;
  }
}

PUBLIC int fmi2GetReal(struct slave *slave, const unsigned *which, size_t count, double *values)
{
  for (size_t i = 0; i < count; ++i) {
    if (which[i] >= VARIABLES) return refused(slave, "There is no variable of that reference.");
    values[i] = slave->values[which[i]];
  }
  return OK;
}

PUBLIC int fmi2SetReal(struct slave *slave, const unsigned *which, size_t count, const double *values)
{
  for (size_t i = 0; i < count; ++i) {
    if (which[i] >= VARIABLES) return refused(slave, "There is no variable of that reference.");
    slave->values[which[i]] = values[i];
  }
  return OK;
}

PUBLIC int fmi2GetInteger(struct slave *slave, const unsigned *which, size_t count, int *values)
{
  for (size_t i = 0; i < count; ++i) {
    if (which[i] >= VARIABLES) return refused(slave, "There is no variable of that reference.");
    values[i] = (int)slave->values[which[i]];
  }
  return OK;
}

PUBLIC int fmi2SetDebugLogging(void *slave, int on, size_t count, const char *const *categories)
{
  (void)slave, (void)on, (void)count, (void)categories;
  return OK;
}

PUBLIC int fmi2Terminate(void *slave)
{
  (void)slave;
  return OK;
}

/* The state of a slave is a copy of it, apart from its master and name; serialised, the bytes of the copy. */
PUBLIC int fmi2GetFMUstate(const struct slave *slave, struct slave **state)
{
  if (!*state) *state = malloc(sizeof *slave);
  if (!*state) return refused(slave, "There is no memory for a state.");
  memcpy(*state, slave, sizeof *slave);
  return OK;
}

PUBLIC int fmi2SetFMUstate(struct slave *slave, const struct slave *state)
{
  const master *calls = slave->calls;
  char name[sizeof slave->name];
  memcpy(name, slave->name, sizeof name);
  memcpy(slave, state, sizeof *slave);
  memcpy(slave->name, name, sizeof name);
  slave->calls = calls;
  return OK;
}

PUBLIC int fmi2FreeFMUstate(struct slave *slave, struct slave **state)
{
  (void)slave;
  free(*state);
  *state = NULL;
  return OK;
}

PUBLIC int fmi2SerializedFMUstateSize(const struct slave *slave, const struct slave *state, size_t *size)
{
  (void)state;
  *size = sizeof *slave;
  return OK;
}

PUBLIC int fmi2SerializeFMUstate(const struct slave *slave, const struct slave *state, void *bytes, size_t size)
{
  if (size < sizeof *state) return refused(slave, "There is no room for the state.");
  memcpy(bytes, state, sizeof *state);
  return OK;
}

PUBLIC int fmi2DeSerializeFMUstate(const struct slave *slave, const void *bytes, size_t size, struct slave **state)
{
  if (size < sizeof *slave) return refused(slave, "These bytes are no state.");
  if (!*state) *state = malloc(sizeof *slave);
  if (!*state) return refused(slave, "There is no memory for a state.");
  memcpy(*state, bytes, sizeof *slave);
  return OK;
}

/* Functions that the description does not offer; they return an error with a message. */
#define NOT_OFFERED(name) \
  PUBLIC int name(struct slave *slave) { return refused(slave, #name " is not offered."); }

NOT_OFFERED(fmi2SetInteger)
NOT_OFFERED(fmi2GetBoolean)
NOT_OFFERED(fmi2SetBoolean)
NOT_OFFERED(fmi2GetString)
NOT_OFFERED(fmi2SetString)
NOT_OFFERED(fmi2GetDirectionalDerivative)
NOT_OFFERED(fmi2SetRealInputDerivatives)
NOT_OFFERED(fmi2GetRealOutputDerivatives)
NOT_OFFERED(fmi2CancelStep)
NOT_OFFERED(fmi2GetStatus)
NOT_OFFERED(fmi2GetRealStatus)
NOT_OFFERED(fmi2GetIntegerStatus)
NOT_OFFERED(fmi2GetBooleanStatus)
NOT_OFFERED(fmi2GetStringStatus)
