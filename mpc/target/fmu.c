/* The controller as a machine of plant/fmu.c: a step when a sample begins, its torques until the next. The values are
   angle, reference, angles of the motors if they count, then torques, margin, disturbance and status. */

enum { SHOWN = 2 + 2 * ANTIDRIVE_MOTORS };

struct machine {
  struct antidrive_controller controller;
};

static void machine_init(struct machine *machine, double *values)
{
  antidrive_init(&machine->controller);
  for (int i = 0; i < 5; ++i) values[SHOWN + i] = 0;
}

static void machine_begin(struct machine *machine, double *values)
{
  struct antidrive_controller *controller = &machine->controller;
  if (ANTIDRIVE_MOTORS) antidrive_motors(controller, values[SHOWN - 2], values[SHOWN - 1]);
  values[SHOWN + 4] = antidrive_step(controller, values[0], values[1], values + SHOWN);
  values[SHOWN + 2] = controller->outcome[0];
  values[SHOWN + 3] = controller->outcome[1];
}

static void machine_end(struct machine *machine, double *values) { (void)machine, (void)values; }
