/* The step for this process: sizes, tables and all that is remembered are where a struct says. */

#include <math.h>
#include <string.h>

typedef double real;

#define CERTIFIED 1e-6 /* largest residual of an accepted solution, in units of the greatest torque */
#define DIGITS 2.3e-16 /* what a number is rounded by, in units of itself */
#define FIRM 1e4       /* how steep the cost is beyond an end that is held: see mpc/active_set.py */
#define STIFF 1e11     /* how steep the barrier of the interior point method may be, */
#define CLOSE 1e-9     /* and how near it ends: see mpc/interior_point.py */

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
