/* The quadratic program of a step (see mpc/riccati.py), solved and certified.

   The functions backward, forward and slope above compute one stage each. CasADi generates them from the expressions of
   the Python form (mpc/riccati_sweeps.py); this file has the loops around them. It allocates no memory, and every loop is
   bounded. HORIZON, LATE, PASSES, ROUNDS, TABLE, STEP, CERTIFIED, DIGITS, FIRM, STIFF and CLOSE are defined earlier. */

enum { N = STATES, M = STATES + 1, TRIANGLE = M * (M + 1) / 2, LAW = 2 * M + 3, ROWS = BARRIER / 2 };

#define TRIES (ROWS > 1 && ROUNDS > 15 ? 15 : ROUNDS) /* rounds of the active set: see mpc/active_set.py */
#define BEGIN 1e3 /* initial products of the interior point method, see mpc/interior_point.py */

static real larger(real a, real b) { return a > b ? a : b; }
static real smaller(real a, real b) { return a < b ? a : b; }
static real clipped(real x, real low, real high) { return x < low ? low : x > high ? high : x; }

/* Forward by the law; returns how many active bounds have changed. */
static int course(struct controller *c)
{
  int k, changes = 0, shift = N * LATE;
  real now;
  for (k = 0; k < M; ++k) c->s[k] = 0;
  for (k = 0; k < HORIZON; ++k) {
    real *bounds = c->bounds + 3 * k;
    forward(c->s + M * k, c->A + N * (shift + N * k), c->B + 2 * (shift + N * k), c->law + LAW * k, bounds,
            c->s + M * (k + 1), c->e + k, &now);
    changes += now != bounds[0];
    c->held[k] = now;
  }
  return changes;
}

/* Backward for the law, forward for the torques; returns how many active bounds have changed. */
static int sweep(struct controller *c)
{
  int k, shift = N * LATE;
  real V[2][TRIANGLE] = {{0}}, v[2][M] = {{0}};
  const real *P = TABLE(tuning) + TUNING_END;
  V[0][0] = P[0], V[0][1] = P[1], V[0][2] = P[2];
  v[0][0] = P[0] * c->end[0] + P[1] * c->end[1];
  v[0][1] = P[1] * c->end[0] + P[2] * c->end[1];
  for (k = HORIZON - 1; k >= 0; --k) {
    int from = (HORIZON - 1 - k) & 1;
    backward(V[from], v[from], c->A + N * (shift + N * k), c->B + 2 * (shift + N * k), c->data + 2 * k,
             c->bounds + 3 * k, c->barrier + BARRIER * k, TABLE(tuning), V[!from], v[!from], c->law + LAW * k);
  }
  return course(c);
}

/* Compute the states for given torques. */
#ifndef STAT
#define STAT(x)
#endif
static void follow(struct controller *c, const real *torques)
{
  int k, i;
  for (k = 0; k < HORIZON; ++k) {
    for (i = 0; i < M; ++i) c->law[LAW * k + i] = 0;
    c->law[LAW * k + M] = torques[k];
  }
  course(c);
}

/* A constrained quantity of a stage: torque, its change, next angle or next velocity. */
static real number(const struct controller *c, int k, int row)
{
  const real *s = c->s + M * k;
  return row == 0 ? c->e[k] : row == 1 ? c->e[k] - s[N] : s[M + row - 2];
}

/* Residual of the optimality conditions, in units of the greatest torque; NaN or infinite if undefined. */
static real residual(struct controller *c)
{
  int k, i, shift = N * LATE;
  real costate[2][M] = {{0}}, slope_e, worst = 0, miss;
  const real *P = TABLE(tuning) + TUNING_END, *s = c->s + M * HORIZON;
  costate[0][0] = P[0] * (c->end[0] + s[0]) + P[1] * (c->end[1] + s[1]);
  costate[0][1] = P[1] * (c->end[0] + s[0]) + P[2] * (c->end[1] + s[1]);
  for (k = HORIZON - 1; k >= 0; --k) {
    int from = (HORIZON - 1 - k) & 1;
    const real *bounds = c->bounds + 3 * k, *forces = c->forces + ROWS * k, *fence = c->fence + BARRIER * k;
    real curvature = ROWS > 1 ? c->curvature[k] : c->law[LAW * k + LAW - 1];
    if (!(bounds[1] <= bounds[2])) return INFINITY;
    slope(costate[from], c->s + M * k, c->e + k, c->A + N * (shift + N * k), c->B + 2 * (shift + N * k),
          c->data + 2 * k, forces, TABLE(tuning), costate[!from], &slope_e);
    miss = fabs(c->e[k] - clipped(c->e[k] - slope_e / curvature, bounds[1], bounds[2]));
    if (!(miss <= worst)) worst = miss;
    for (i = 1; i < ROWS; ++i) { /* the other intervals, see `QuadraticProgram.residual` */
      real scale = TABLE(moved)[i], stiff = curvature / (scale * scale), q = number(c, k, i);
      real up = clipped(forces[i] + stiff * (q - fence[2 * i + 1]), 0, TABLE(prices)[i]);
      real down = clipped(forces[i] + stiff * (q - fence[2 * i]), -TABLE(prices)[i], 0);
      miss = larger(DIGITS * fabs(forces[i]), fabs(up + down - forces[i])) / stiff / scale;
      if (!(miss <= worst)) worst = miss;
    }
  }
  return worst / c->unit[0];
}

/* Penalty weight rho of a quantity held at an interval end, see mpc/active_set.py. */
static real steepness(const struct controller *c, int j)
{
  real scale = TABLE(moved)[j % ROWS];
  return FIRM * (c->curvature[j / ROWS] / (scale * scale));
}

/* Keep the valid part of the previous active set besides the torques; returns its size. */
static int known(struct controller *c)
{
  int j, count = 0;
  for (j = 0; j < ROWS * HORIZON; ++j) {
    real at = c->pressed[j], price = TABLE(prices)[j % ROWS], *force = c->forces + j;
    int end = fabs(c->fence[2 * j + (at > 0)]) < INFINITY;
    if (fabs(at) == 2 && price < INFINITY) *force = at > 0 ? price : -price;
    if (!(j % ROWS && end && ((fabs(at) == 1 && fabs(*force) < INFINITY) || (fabs(at) == 2 && price < INFINITY))))
      c->pressed[j] = *force = 0;
    count += c->pressed[j] != 0;
  }
  return count;
}

/* Add the cost terms of the active set. */
static void press(struct controller *c)
{
  int j;
  for (j = 0; j < ROWS * HORIZON; ++j) {
    real at = c->pressed[j], firm = fabs(at) == 1 ? steepness(c, j) : 0;
    c->barrier[2 * j] = firm;
    c->barrier[2 * j + 1] = firm > 0 ? c->forces[j] - firm * c->fence[2 * j + (at > 0)] : c->forces[j];
  }
}

/* Update forces and active set (release, put at the price, hold again); returns the number of changes. */
static int settle(struct controller *c)
{
  int j, changes = 0;
  for (j = 0; j < ROWS * HORIZON; ++j) {
    real at = c->pressed[j], sense = at > 0 ? 1 : -1, price = TABLE(prices)[j % ROWS], beyond, force;
    if (at == 0) continue;
    beyond = sense * (number(c, j / ROWS, j % ROWS) - c->fence[2 * j + (at > 0)]);
    if (fabs(at) == 2) {
      if (beyond < 0) c->pressed[j] = sense, ++changes;
      continue;
    }
    if (fabs(beyond) > CLOSE * c->unit[0] * TABLE(moved)[j % ROWS]) ++changes; /* not yet within tolerance */
    force = sense * c->forces[j] + steepness(c, j) * beyond;
    if (!(force > 0)) c->pressed[j] = force = 0, ++changes;
    if (force > price) c->pressed[j] = 2 * sense, force = price, ++changes;
    c->forces[j] = sense * force;
  }
  return changes;
}

/* Violation of each free quantity, as the torque that causes it. */
static void look_beyond(struct controller *c)
{
  int j;
  for (j = 0; j < ROWS * HORIZON; ++j) {
    real q = number(c, j / ROWS, j % ROWS), far = larger(q - c->fence[2 * j + 1], c->fence[2 * j] - q);
    c->gap[j] = j % ROWS && c->pressed[j] == 0 ? far / TABLE(moved)[j % ROWS] : -INFINITY;
  }
}

/* Hold the quantities whose violation is a local maximum over time; returns how many. */
static int take_up(struct controller *c)
{
  int j, count = 0;
  for (j = 0; j < ROWS * HORIZON; ++j) {
    real far = c->gap[j];
    if (!(far > CLOSE * c->unit[0])) continue;
    if (j >= ROWS && !(far >= c->gap[j - ROWS])) continue;
    if (j < ROWS * (HORIZON - 1) && !(far > c->gap[j + ROWS])) continue;
    c->pressed[j] = number(c, j / ROWS, j % ROWS) > c->fence[2 * j + 1] ? 1 : -1;
    ++count;
  }
  return count;
}

/* Take over the active torque bounds of the last sweep. */
static void take(struct controller *c)
{
  int k;
  for (k = 0; k < HORIZON; ++k) c->bounds[3 * k] = c->held[k];
}

static void measure(struct controller *c)
{
  int k;
  for (k = 0; k < HORIZON; ++k) c->curvature[k] = c->law[LAW * k + LAW - 1];
}

/* Newton steps until the active set repeats; returns whether it does. */
static int active_set(struct controller *c)
{
  int round, j, changes = 1, once_more = 0, count, warm = ROWS > 1 && known(c), pressing = warm;
  for (j = 0; j < BARRIER * HORIZON; ++j) c->barrier[j] = 0;
  for (round = 0; round < TRIES && (changes || warm); ++round) {
    if (ROWS > 1 && round) press(c);
    changes = sweep(c);
    if (ROWS == 1 || !round) measure(c);
    if (!round && warm) continue; /* the first sweep only gives the curvature */
    warm = 0;
    take(c);
    if (ROWS == 1) continue;
    look_beyond(c);
    changes += settle(c);
    count = take_up(c);
    changes += count, pressing |= count > 0;
    once_more = !changes && pressing && !once_more; /* one more sweep with the converged forces */
    changes += once_more;
  }
  for (j = 0; j < BARRIER * HORIZON; ++j) c->barrier[j] = 0;
  return !changes;
}

/* Shift the origin of the program by the given share of the last sweep. */
static void begin_here(struct controller *c, real length)
{
  int k;
  const real *s = c->s;
  for (k = 0; k < HORIZON; ++k, s += M) {
    c->data[2 * k] += length * s[0];
    c->data[2 * k + 1] += length * (c->e[k] - s[N]);
  }
  c->end[0] += length * s[0];
  c->end[1] += length * s[1];
}

/* Slack, force, excess and spare force of each interval end, with both products equal to start. */
static void centred(struct controller *c, real start)
{
  int j;
  for (j = 0; j < BARRIER * HORIZON; ++j) {
    int k = j / BARRIER, row = j % BARRIER / 2;
    real gap = (j % 2 ? 1 : -1) * (c->fence[j] - number(c, k, row)), price = TABLE(prices)[row], worth = gap * price;
    if (price < INFINITY) {
      c->force[j] = 2 * start * (price / (worth + 2 * start + sqrt(worth * worth + 4 * start * start)));
      c->spare[j] = price - c->force[j];
      c->excess[j] = start / c->spare[j];
    } else {
      c->force[j] = start / larger(gap, row ? c->unit[0] * TABLE(moved)[row] : 0);
      c->spare[j] = INFINITY;
      c->excess[j] = 0;
    }
    c->gap[j] = gap;
    c->slack[j] = start / c->force[j];
  }
}

/* One step of the interior point method towards products equal to target; returns the feasible step length. */
static real step_inside(struct controller *c, real target)
{
  int j, i;
  real length = INFINITY;
  for (j = 0; j < BARRIER * HORIZON; j += 2) {
    real d[2] = {0, 0}, g[2] = {0, 0}, scale = TABLE(moved)[j % BARRIER / 2];
    real stiffest = STIFF * (c->curvature[j / BARRIER] / (scale * scale));
    for (i = 0; i < 2; ++i) {
      real force = c->force[j + i], spare = c->spare[j + i], stiff;
      if (!(fabs(c->fence[j + i]) < INFINITY)) continue; /* no limit, no force */
      stiff = smaller(1 / (c->slack[j + i] / force + c->excess[j + i] / spare), stiffest);
      c->pull[j + i] = stiff * (target / force - target / spare - c->gap[j + i]);
      c->stiff[j + i] = d[i] = stiff;
      g[i] = (i ? 1 : -1) * (force + c->pull[j + i]);
    }
    c->barrier[j] = d[0] + d[1];
    c->barrier[j + 1] = g[0] + g[1];
  }
  sweep(c);
  for (j = 0; j < BARRIER * HORIZON; ++j) {
    real force = c->force[j], spare = c->spare[j], slack = c->slack[j], excess = c->excess[j], harder, wider, farther;
    if (!(fabs(c->fence[j]) < INFINITY)) continue;
    c->nearer[j] = (j % 2 ? 1 : -1) * number(c, j / BARRIER, j % BARRIER / 2);
    c->harder[j] = harder = c->pull[j] + c->stiff[j] * c->nearer[j];
    c->wider[j] = wider = target / force - slack - slack / force * harder;
    c->farther[j] = farther = target / spare - excess + excess / spare * harder;
    if (wider < 0) length = smaller(length, slack / -wider);
    if (harder < 0) length = smaller(length, force / -harder);
    if (farther < 0) length = smaller(length, excess / -farther);
    if (harder > 0) length = smaller(length, spare / harder);
  }
  return smaller(1, 0.995 * length);
}

/* Complementarity error of the worst interval end, and the mean of the products. */
static real left(const struct controller *c, real *mean)
{
  int j, ends = 0;
  real worst = 0, sum = 0;
  for (j = 0; j < BARRIER * HORIZON; ++j) {
    real scale = TABLE(moved)[j % BARRIER / 2], slack = c->slack[j], force = c->force[j], product = slack * force;
    real far = 1 / (c->unit[0] * scale), strong = scale / (c->unit[0] * TABLE(tuning)[TUNING_RATE_WEIGHT]);
    if (!(fabs(c->fence[j]) < INFINITY)) continue;
    worst = larger(smaller(slack * far, force * strong), worst);
    ++ends;
    if (c->spare[j] < INFINITY) {
      worst = larger(smaller(c->excess[j] * far, c->spare[j] * strong), worst);
      product += c->excess[j] * c->spare[j];
      ++ends;
    }
    sum += product;
  }
  *mean = sum / ends;
  return worst;
}

/* Active state of an interval end according to its force: free, held, or at the price of leaving it. */
static real pressed(const struct controller *c, int j)
{
  real scale = TABLE(moved)[j % BARRIER / 2], sense = j % 2 ? 1 : -1;
  real far = 1 / (c->unit[0] * scale), strong = scale / (c->unit[0] * TABLE(tuning)[TUNING_RATE_WEIGHT]);
  if (!(fabs(c->fence[j]) < INFINITY) || j % BARRIER < 2) return 0;
  if (c->excess[j] * far > c->spare[j] * strong) return 2 * sense;
  return c->slack[j] * far < c->force[j] * strong ? sense : 0;
}

/* The primal-dual interior point method (see mpc/interior_point.py): the solution, and the active torque bounds. */
static void interior_point(struct controller *c)
{
  int k, j, round, count = HORIZON;
  real most = 0, mean, centring = 0.1, length, *x = c->inside, *half = c->half, *kept = c->kept;
  memcpy(kept, c->data, 2 * count * sizeof(real));
  memcpy(kept + 2 * count, c->end, 2 * sizeof(real));
  for (k = 0; k < count; ++k) c->bounds[3 * k] = 0;
  sweep(c);
  for (k = 0; k < count; ++k) {
    const real *bounds = c->bounds + 3 * k;
    x[k] = c->middle[k] = (bounds[1] + bounds[2]) / 2;
    half[k] = larger((bounds[2] - bounds[1]) / 2, 1e-7 * c->unit[0]);
    c->fence[BARRIER * k] = x[k] - half[k];
    c->fence[BARRIER * k + 1] = x[k] + half[k];
    c->curvature[k] = c->law[LAW * k + LAW - 1];
    most = larger(most, c->curvature[k] * larger(fabs(c->e[k] - x[k]), half[k]));
  }
  follow(c, x);
  begin_here(c, 1);
  centred(c, BEGIN * most * c->unit[0]);
  for (round = 0; round < ROUNDS; ++round) {
    if (!(left(c, &mean) > CLOSE)) break;
    length = step_inside(c, centring * mean);
    for (j = 0; j < BARRIER * count; ++j) {
      if (!(fabs(c->fence[j]) < INFINITY)) continue;
      c->slack[j] += length * c->wider[j];
      c->force[j] += length * c->harder[j];
      c->excess[j] += length * c->farther[j];
      c->gap[j] -= length * c->nearer[j];
      c->spare[j] -= length * c->harder[j];
    }
    for (k = 0; k < count; ++k) x[k] += length * c->e[k];
    centring = larger(0.01, (1 - length) * (1 - length));
    begin_here(c, length);
  }
  memcpy(c->data, kept, 2 * count * sizeof(real));
  memcpy(c->end, kept + 2 * count, 2 * sizeof(real));
  follow(c, x);
  for (j = 0; j < BARRIER * count; j += 2) {
    real down = fabs(c->fence[j]) < INFINITY ? c->force[j] : 0, up = fabs(c->fence[j + 1]) < INFINITY ? c->force[j + 1] : 0;
    c->forces[j / 2] = up - down;
    c->pressed[j / 2] = pressed(c, j + (up > down));
    c->barrier[j] = c->barrier[j + 1] = 0;
  }
  for (k = 0; k < count; ++k) {
    real push = c->forces[ROWS * k] / c->curvature[k], inside = x[k] - c->middle[k];
    c->bounds[3 * k] = inside + push < -half[k] ? -1 : inside + push > half[k] ? 1 : 0;
  }
}

/* Solve and certify the program; returns the residual, infinite if the solution is not certified. */
STEP real solve(struct controller *c)
{
  int settled = active_set(c);
  real worst = residual(c);
  if (worst <= CERTIFIED && (settled || ROWS == 1)) return worst; /* see solve in mpc/quadratic_program.py */
  interior_point(c);
  if (ROWS == 1) active_set(c); /* with other intervals the interior point solution is final */
  worst = residual(c);
  return worst <= CERTIFIED ? worst : INFINITY;
}
