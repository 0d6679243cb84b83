/* The step for use in this process: a struct has the sizes and the addresses of tables and state. */

#include <math.h>
#include <string.h>

typedef double real;

#define CERTIFIED 1e-6 /* largest residual of an accepted solution, in units of the greatest torque */
#define DIGITS 2.3e-16 /* relative rounding error */
#define FIRM 1e4       /* penalty weight of a held interval end: see mpc/active_set.py */
#define STIFF 1e11     /* greatest curvature of the barrier of the interior point method, */
#define CLOSE 1e-9     /* and its tolerance: see mpc/interior_point.py */

${stages}
${counts}

struct controller {
${members}
};

#define HORIZON c->horizon
#define LATE c->late
#define PASSES c->passes
#define ROUNDS c->rounds
#define TABLE(name) c->name
#define STEP

${loops}
