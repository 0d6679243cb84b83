/* A servo: samples of a command, a step ahead each. Before this file stand the steps that CasADi wrote, and STATES,
   PARAMETERS, PAST, DELAY, COMMANDS and the tables. The values are commands, reading, load angle, velocity, first
   angle, first velocity and the parameters. */

#include <math.h>
#include <string.h>

enum { READING = COMMANDS, ANGLE, VELOCITY, FIRST_ANGLE, FIRST_VELOCITY, NUMBERS };

struct machine {
  double state[STATES], past[PAST], time;
  int started;
};

static void machine_show(const struct machine *machine, double *values)
{
  const double *arg[READING_ARG + 1] = {machine->state, values + NUMBERS};
  double *res[READING_RES + 1] = {values + READING}, work[READING_W + 1];
  casadi_int places[READING_IW + 1];
  sample_reading(arg, res, places, work, 0);
  values[ANGLE] = machine->state[0];
  values[VELOCITY] = machine->state[1];
}

static void machine_init(struct machine *machine, double *values)
{
  memset(machine, 0, sizeof *machine);
  for (int i = 0; i < STATES; ++i) machine->state[i] = begins[i] ? values[READING + 2 + begins[i]] : 0;
  machine_show(machine, values);
}

/* The command is the newest of those under way; before the first one it was as then. */
static void machine_begin(struct machine *machine, double *values)
{
  double command = 0;
  for (int i = 0; i < COMMANDS; ++i) command += torque_map[i] * values[i];
  memmove(machine->past + 1, machine->past, sizeof machine->past - sizeof machine->past[0]);
  for (int i = 0; i < (machine->started ? 1 : PAST); ++i) machine->past[i] = command;
  machine->started = 1;
}

static void machine_end(struct machine *machine, double *values)
{
  double numbers[PARAMETERS], next[STATES], work[STEP_W + 1];
  casadi_int places[STEP_IW + 1];
  int whole = 0;
  memcpy(numbers, values + NUMBERS, sizeof numbers);
  if (DELAY >= 0) { /* whole samples of it are in the past, the rest is inside the sample */
    whole = (int)fmin(fmax(floor(numbers[DELAY] / SAMPLE_TIME + 1e-9), 0), PAST - 2);
    numbers[DELAY] -= whole * SAMPLE_TIME;
  }
  const double inputs[] = {machine->past[whole], machine->past[whole + 1], 0, INFINITY, machine->time, SAMPLE_TIME, 0, 0};
  const double *arg[STEP_ARG + 1] = {machine->state, inputs, numbers};
  double *res[STEP_RES + 1] = {next};
  sample_step(arg, res, places, work, 0);
  memcpy(machine->state, next, sizeof next);
  machine->time += SAMPLE_TIME;
  machine_show(machine, values);
}
