/* Written by `antidrive export`; see ${name}_controller.h. Change the model and export anew instead of this file.

   NaN and infinity are asked for. With -ffp-contract=off the torques are those of the Python controller to the last
   bit. Valid as C++ too. */

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "A controller asks whether a number is NaN: compile it without -ffast-math, -Ofast, -ffinite-math-only, /fp:fast."
#endif

#include <string.h>
#ifdef __cplusplus
#include <math.h>
#define restrict __restrict
#else
#include <tgmath.h>
#endif

#include "${name}_controller.h"

#define controller ${name}_controller

typedef ${name}_real real;

enum { DRIVES = ${NAME}_DRIVES, HORIZON = ${NAME}_HORIZON, LATE = ${NAME}_LATE, PASSES = ${passes}, ROUNDS = ${rounds} };

#define CERTIFIED ${certified} /* largest residual of an accepted solution, in units of the greatest torque */
#define DIGITS ${digits} /* what a number is rounded by, in units of itself */
#define FIRM ${firm} /* how steep the cost is beyond an end that is held */
#define STIFF ${stiff} /* how steep the barrier of the interior point method may be, and how near it ends */
#define CLOSE ${close}
#define TABLE(name) name
#define STEP static

${constants}
${stages}
${counts}

${loops}
void ${name}_init(struct controller *c)
{
  memset(c, 0, sizeof *c);
  ${name}_motors(c, NAN, NAN);
}

void ${name}_motors(struct controller *c, real first, real second)
{
  c->readings[1] = first;
  c->readings[2] = DRIVES > 1 ? second : NAN;
}

void ${name}_elapsed(struct controller *c, real seconds) { c->elapsed[0] = seconds; }

/* A single drive is the pair of its own two senses. */
static int answered(struct controller *c, int status, real torques[DRIVES])
{
  torques[0] = DRIVES > 1 ? c->torques[0] : c->torques[0] + c->torques[1];
  if (DRIVES > 1) torques[DRIVES - 1] = c->torques[1];
  ${name}_motors(c, NAN, NAN);
  return status;
}

int ${name}_step(struct controller *c, real angle, real reference, real torques[DRIVES])
{
  c->wanted[0] = reference;
  return answered(c, control_step(c, angle, 0), torques);
}

int ${name}_step_ahead(struct controller *c, real angle, const real reference[HORIZON + 1], real torques[DRIVES])
{
  memcpy(c->wanted, reference, sizeof c->wanted);
  return answered(c, control_step(c, angle, 1), torques);
}
