/* The controller as a machine of plant/fmu.c: one step at the start of a sample, its torques are held until the next.
   The values are angle, reference, motor angles if motor encoders are used, torques, margin, disturbance and status. */

enum { SHOWN = 2 + ${NAME}_DRIVES * ${NAME}_MOTORS, MARGIN = SHOWN + ${NAME}_DRIVES, DISTURBANCE, STATUS };

struct machine {
  struct controller is;
};

static void machine_init(struct machine *machine, double *values)
{
  ${name}_init(&machine->is);
  for (int i = SHOWN; i <= STATUS; ++i) values[i] = 0;
}

static void machine_begin(struct machine *machine, double *values)
{
  struct controller *controller = &machine->is;
  if (${NAME}_MOTORS) ${name}_motors(controller, values[2], values[SHOWN - 1]);
  values[STATUS] = ${name}_step(controller, values[0], values[1], values + SHOWN);
  values[MARGIN] = controller->outcome[0];
  values[DISTURBANCE] = controller->outcome[1];
}

static void machine_end(struct machine *machine, double *values) { (void)machine, (void)values; }
