/* The quadratic programme of a step (see mpc/riccati.py), solved and certified.

   The functions backward, forward and slope above are one stage each, written by CasADi from the same expressions that
   the Python form uses (mpc/programme.py); here stand the loops around them. No memory is taken, every loop is bounded. */

enum { N = STATES, M = STATES + 1, TRIANGLE = M * (M + 1) / 2, LAW = 2 * M + 3 };

#define CERTIFIED 1e-6 /* largest residual of an accepted solution, in units of the greatest torque */

static real larger(real a, real b) { return a > b ? a : b; }
static real smaller(real a, real b) { return a < b ? a : b; }
static real clipped(real x, real low, real high) { return x < low ? low : x > high ? high : x; }

/* Backward for the law, forward for the torques; how many bounds have changed. */
static int sweep(struct controller *c)
{
  int k, changes = 0, shift = N * c->late;
  real V[2][TRIANGLE] = {{0}}, v[2][M] = {{0}}, now;
  const real *P = c->tuning + 1;
  V[0][0] = P[0], V[0][1] = P[1], V[0][2] = P[2];
  v[0][0] = P[0] * c->end[0] + P[1] * c->end[1];
  v[0][1] = P[1] * c->end[0] + P[2] * c->end[1];
  for (k = c->horizon - 1; k >= 0; --k) {
    int from = (c->horizon - 1 - k) & 1;
    backward(V[from], v[from], c->A + N * (shift + N * k), c->B + 2 * (shift + N * k), c->data + 4 * k,
             c->bounds + 3 * k, c->tuning, V[!from], v[!from], c->law + LAW * k);
  }
  for (k = 0; k < M; ++k) c->s[k] = 0;
  for (k = 0; k < c->horizon; ++k) {
    real *bounds = c->bounds + 3 * k;
    forward(c->s + M * k, c->A + N * (shift + N * k), c->B + 2 * (shift + N * k), c->law + LAW * k, bounds,
            c->s + M * (k + 1), c->e + k, &now);
    changes += now != bounds[0];
    c->held[k] = now;
  }
  return changes;
}

/* How far from optimal, in units of the greatest torque; NaN or infinite if there is no saying. */
static real residual(struct controller *c)
{
  int k, shift = N * c->late;
  real costate[2][M] = {{0}}, slope_e, worst = 0, miss;
  const real *P = c->tuning + 1, *s = c->s + M * c->horizon;
  costate[0][0] = P[0] * (c->end[0] + s[0]) + P[1] * (c->end[1] + s[1]);
  costate[0][1] = P[1] * (c->end[0] + s[0]) + P[2] * (c->end[1] + s[1]);
  for (k = c->horizon - 1; k >= 0; --k) {
    int from = (c->horizon - 1 - k) & 1;
    const real *bounds = c->bounds + 3 * k;
    if (!(bounds[1] <= bounds[2])) return INFINITY;
    slope(costate[from], c->s + M * k, c->e + k, c->A + N * (shift + N * k), c->B + 2 * (shift + N * k),
          c->data + 4 * k, c->tuning, costate[!from], &slope_e);
    miss = fabs(c->e[k] - clipped(c->e[k] - slope_e / c->law[LAW * k + LAW - 1], bounds[1], bounds[2]));
    if (!(miss <= worst)) worst = miss;
  }
  return worst / c->unit[0];
}

/* Newton steps until the active bounds repeat. */
static void active_set(struct controller *c)
{
  int round, k, changes = 1;
  for (round = 0; round < c->rounds && changes; ++round) {
    changes = sweep(c);
    for (k = 0; k < c->horizon; ++k) c->bounds[3 * k] = c->held[k];
  }
}

/* The primal-dual interior point method (see mpc/interior_point.py): a guess of the active bounds from inside. Torques
   are counted from the middle between their bounds. */
static void interior_point(struct controller *c)
{
  int k, round, count = c->horizon;
  real most = 0, mu, target, centring = 0.1, length;
  real *x = c->inside, *half = c->half, *middle = c->middle, *lower = c->lower, *upper = c->upper;
  for (k = 0; k < count; ++k) c->bounds[3 * k] = 0;
  sweep(c);
  for (k = 0; k < count; ++k) {
    const real *bounds = c->bounds + 3 * k;
    x[k] = 0;
    middle[k] = (bounds[1] + bounds[2]) / 2;
    half[k] = larger((bounds[2] - bounds[1]) / 2, 1e-7 * c->unit[0]);
    c->curvature[k] = c->law[LAW * k + LAW - 1];
    most = larger(most, c->curvature[k] * larger(fabs(c->e[k] - middle[k]), half[k]));
  }
  for (k = 0; k < count; ++k) lower[k] = upper[k] = most;
  for (round = 0; round < c->rounds; ++round) {
    for (mu = 0, k = 0; k < count; ++k) mu += lower[k] * (half[k] + x[k]) + upper[k] * (half[k] - x[k]);
    mu /= 2 * count;
    if (!(mu > 1e-12 * most * c->unit[0])) break;
    target = centring * mu;
    for (k = 0; k < count; ++k) {
      real left = half[k] + x[k], right = half[k] - x[k], d = lower[k] / left + upper[k] / right;
      c->data[4 * k + 2] = d;
      c->data[4 * k + 3] = -d * (middle[k] + x[k]) - target / left + target / right;
    }
    sweep(c);
    length = 1;
    for (k = 0; k < count; ++k) {
      real left = half[k] + x[k], right = half[k] - x[k], change = c->e[k] - middle[k] - x[k];
      real down = target / left - lower[k] - lower[k] / left * change;
      real up = target / right - upper[k] + upper[k] / right * change;
      c->change[3 * k] = change, c->change[3 * k + 1] = down, c->change[3 * k + 2] = up;
      if (-change * length > 0.995 * left) length = 0.995 * left / -change;
      if (change * length > 0.995 * right) length = 0.995 * right / change;
      if (-down * length > 0.995 * lower[k]) length = 0.995 * lower[k] / -down;
      if (-up * length > 0.995 * upper[k]) length = 0.995 * upper[k] / -up;
    }
    for (k = 0; k < count; ++k) {
      x[k] += length * c->change[3 * k];
      lower[k] += length * c->change[3 * k + 1];
      upper[k] += length * c->change[3 * k + 2];
    }
    centring = larger(0.01, (1 - length) * (1 - length));
  }
  for (k = 0; k < count; ++k) {
    real push = (lower[k] - upper[k]) / c->curvature[k];
    c->bounds[3 * k] = x[k] - push < -half[k] ? -1 : x[k] - push > half[k] ? 1 : 0;
    c->data[4 * k + 2] = c->data[4 * k + 3] = 0;
  }
}

/* The solution of the programme, certified; its residual, infinite if there is none. */
real solve(struct controller *c)
{
  real worst;
  active_set(c);
  worst = residual(c);
  if (worst <= CERTIFIED) return worst;
  interior_point(c);
  active_set(c);
  worst = residual(c);
  return worst <= CERTIFIED ? worst : INFINITY;
}
