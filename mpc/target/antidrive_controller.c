/* Written by `antidrive export`; see antidrive_controller.h. Change the model and export anew instead of this file.

   Do not compile with -ffast-math: NaN and infinity are asked for. With -ffp-contract=off the torques are those of the
   Python controller to the last bit. */

#include <string.h>
#include <tgmath.h>

#include "antidrive_controller.h"

typedef antidrive_real real;

enum { HORIZON = ANTIDRIVE_HORIZON, LATE = ANTIDRIVE_LATE, PASSES = ${passes}, ROUNDS = ${rounds} };

${constants}
${code}
void antidrive_init(struct antidrive_controller *controller)
{
  memset(controller, 0, sizeof *controller);
  antidrive_motors(controller, NAN, NAN);
}

void antidrive_motors(struct antidrive_controller *controller, antidrive_real first, antidrive_real second)
{
  controller->readings[1] = first;
  controller->readings[2] = second;
}

static int answered(struct antidrive_controller *controller, int status, antidrive_real torques[2])
{
  memcpy(torques, controller->torques, 2 * sizeof torques[0]);
  antidrive_motors(controller, NAN, NAN);
  return status;
}

int antidrive_step(struct antidrive_controller *controller, antidrive_real angle, antidrive_real reference,
                   antidrive_real torques[2])
{
  controller->wanted[0] = reference;
  return answered(controller, control_step(controller, angle, 0), torques);
}

int antidrive_step_ahead(struct antidrive_controller *controller, antidrive_real angle,
                         const antidrive_real reference[ANTIDRIVE_HORIZON + 1], antidrive_real torques[2])
{
  memcpy(controller->wanted, reference, sizeof controller->wanted);
  return answered(controller, control_step(controller, angle, 1), torques);
}
