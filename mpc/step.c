/* One sample of the controller: measured angle in, pinion torques out.

   The functions estimate, begin, govern, ... above are one stage each, written by CasADi from the same expressions that
   the Python form uses (mpc/step.py); here stand the loops around them. No memory is taken, every loop is bounded. */

enum { LOST = 1, BRIDGED = 2, JUMPED = 4, STAYED = 8, DIVERGED = 16, AIMLESS = 32, UNCERTIFIED = 64, PARTING = 128,
       BEYOND = 256, ASTRAY = 512 };

#define CONVERGED 1e-9 /* change of the torques at which a full solution ends, in the same unit */

/* The wanted angle over the horizon; of a reference that is one number only that number is given. */
static int look(struct controller *c, int previewed)
{
  int k, trouble = 0;
  real speed = 0, numbers[4], angle = c->belief[3];
  real *wanted = c->wanted;
  for (k = 0; k <= (previewed ? c->horizon : 0); ++k)
    if (!isfinite(wanted[k])) trouble = AIMLESS;
  if (trouble) previewed = 0, wanted[0] = angle;
  if (previewed) {
    c->numbers[0] = 0;
    return trouble;
  }
  preview(c->numbers, wanted, c->tuning + 7, numbers, &speed);
  memcpy(c->numbers, numbers, sizeof numbers);
  for (k = 1; k <= c->horizon; ++k) wanted[k] = wanted[0] + speed * k;
  return trouble;
}

/* The wanted angle at a sample, also beyond the horizon: it goes on at its last speed. */
static real wanted_at(const struct controller *c, int k)
{
  int last = c->horizon;
  return k <= last ? c->wanted[k] : c->wanted[last] + (k - last) * (c->wanted[last] - c->wanted[last - 1]);
}

/* To which sample that is known ahead it sets out now, and by how much the wanted angle changes from there on. */
static int lead(const struct controller *c, const real *path, const real *limits, real *change)
{
  int k, i;
  real jumps = 0, due = 0, three[3], count;
  for (k = 1; k <= c->horizon && !jumps; ++k) {
    for (i = 0; i < 3; ++i) three[i] = wanted_at(c, k - 1 + i);
    count = k;
    early(path, three, &count, limits, c->tuning + 7, c->model + PARAMETERS - 1, &jumps, &due, change);
  }
  if (jumps && due) return k - 1;
  *change = 0;
  return 0;
}

/* What of it can be followed, over the horizon and as far beyond as a delay reaches: it goes on at its last
   acceleration. */
static void aim(struct controller *c, int previewed)
{
  int k, i, last = c->horizon, first = 0;
  real limits[2], near, speed, bend, now[2], next[2], three[3], change = 0, *ahead = c->ahead;
  followable(c->belief + 3, c->load, c->machine, c->tuning, limits, &near);
  if (!(c->path[0] && fabs(c->belief[3] - c->path[1]) <= near)) {
    c->path[0] = 1;
    c->path[1] = c->belief[3];
    c->path[2] = c->belief[4];
  }
  memcpy(now, c->path + 1, sizeof now);
  if (previewed) first = lead(c, now, limits, &change);
  for (k = 0; k <= last; ++k) {
    for (i = 0; i < 3; ++i) three[i] = wanted_at(c, first + k + i) - first * change;
    ahead[k] = now[0];
    govern(now, three, limits, c->soft, c->model + PARAMETERS - 1, next);
    memcpy(now, next, sizeof now);
    if (k == 0) memcpy(c->path + 1, next, sizeof next);
  }
  speed = ahead[last] - ahead[last - 1];
  bend = speed - (ahead[last - 1] - ahead[last - 2]);
  for (k = 1; k <= c->late + 1; ++k) ahead[last + k] = ahead[last] + speed * k + bend * k * (k + 1) / 2;
}

/* Whether the load has been beside the governed reference for long: the mean over a period of the loop of the squared
   error, in units of what is admitted, each counted as no more than 2 so that it is not said at once and over soon. */
static int astray(struct controller *c)
{
  const real *ahead = c->ahead;
  real step = c->model[PARAMETERS - 1] * c->tuning[6], *mean = c->astray;
  real admitted = c->tuning[9] + fabs(ahead[2] - 2 * ahead[1] + ahead[0]) / (2 * step * step);
  real miss = (ahead[0] - c->belief[3]) / admitted;
  if (!(*mean >= 0 && *mean <= 2)) *mean = 0;
  *mean += c->tuning[10] * (smaller(miss * miss, 2) - *mean);
  return *mean > 1 ? ASTRAY : 0;
}

/* What friction there will be on the way, and what is known of it by now. A disturbance that had a part of a friction
   that is over loses it; as much goes from what the torques did against friction to what they did besides. */
static void rubbed(struct controller *c)
{
  int k, lead;
  real now[5], learnt[LEARNT], disturbance, more, total, before;
  const real *ahead = c->ahead + c->late;
  total = c->past[c->late + 1] + c->rubs[c->late + 1];
  now[0] = c->rubs[1], now[1] = total, now[2] = ahead[0], now[3] = ahead[1], now[4] = c->ahead[c->horizon];
  learn(c->belief, c->learnt, now, c->model, c->rubbing, c->tuning, learnt, &disturbance);
  memcpy(c->learnt, learnt, sizeof learnt);
  more = c->belief[2] - disturbance;
  c->belief[2] = disturbance;
  for (k = 0; k < c->late + 3; ++k) c->past[k] += more, c->rubs[k] -= more;
  for (k = 1; k <= c->horizon; ++k) c->plan[k] += more;
  before = c->rubs[c->late + 1];
  lead = c->horizon; /* samples until friction is back at zero */
  if (fabs(before) / c->rubbing[4] < lead) lead = (int)(fabs(before) / c->rubbing[4]);
  for (k = 0; k < c->horizon; ++k) {
    rub(ahead + (k + lead < c->horizon ? k + lead : c->horizon - 1), &before, &total, c->learnt, c->model, c->rubbing, c->rub + k);
    before = c->rub[k];
  }
}

/* The intervals of the numbers beside the torque, less what the guess makes of them. */
static void confine(struct controller *c)
{
  int k, i;
  real memory[2][8], ends[4];
  const real *ahead = c->ahead + c->late, *dt = c->model + PARAMETERS - 1;
  enter(c->states + N * c->late, c->soft, memory[0]);
  for (k = 0; k < c->horizon; ++k) {
    const real *state = c->states + N * (c->late + k + 1);
    real *fence = c->fence + BARRIER * k;
    corridor(memory[k & 1], ahead + k, c->soft, dt, memory[!(k & 1)], ends);
    for (i = 0; i < 4; ++i) fence[4 + i] = ends[i] - state[i / 2];
  }
}

/* The programme around the course of the model under the guess. */
static void linearise(struct controller *c)
{
  int k, late = c->late, total = late + c->horizon;
  real both[2], pace, acceleration, disturbance = c->belief[2], dt = c->model[PARAMETERS - 1];
  real low = c->past[late + 1] + c->rubs[late + 1], high = low, step = c->tuning[8], least, most, before_low, before_high, most_step;
  real rubbed_before = c->rubs[late + 1];
  const real *ahead = c->ahead + late, *state;
  memcpy(c->states, c->belief + 3, N * sizeof(real));
  for (k = 0; k < total; ++k) {
    both[0] = (k < late ? c->past[k + 2] : c->guess[k - late]) + disturbance;
    both[1] = (k <= late ? c->past[k + 1] : c->guess[k - late - 1]) + disturbance;
    stage(c->states + N * k, both, c->model, c->states + N * (k + 1), c->A + N * N * k, c->B + 2 * N * k);
  }
  c->unit[0] = 0;
  for (k = 0; k < c->horizon; ++k) {
    real *data = c->data + 2 * k, *bounds = c->bounds + 3 * k, *range = c->range + 2 * k;
    state = c->states + N * (late + k);
    pace = state[1];
    acceleration = (state[N + 1] - state[1]) / dt;
    reach(&pace, &acceleration, c->machine, range);
    least = range[0], most = range[1]; /* what of it can be reached in steps of bounded size */
    before_low = low, before_high = high;
    low = range[0] = smaller(larger(low - step, least), most);
    high = range[1] = larger(smaller(high + step, most), least);
    most_step = larger(step, larger(low - before_high, before_low - high));
    c->unit[0] = larger(c->unit[0], larger(fabs(range[0]), fabs(range[1])));
    range[0] -= c->rub[k], range[1] -= c->rub[k]; /* from now on what is left to the net torque */
    bounds[1] = range[0] - c->guess[k];
    bounds[2] = range[1] - c->guess[k];
    data[0] = k ? state[0] - ahead[k] : 0;
    data[1] = c->guess[k] - (k ? c->guess[k - 1] : c->past[late + 1]);
    if (ROWS > 1) {
      c->fence[BARRIER * k + 2] = -most_step - data[1] - (c->rub[k] - rubbed_before);
      c->fence[BARRIER * k + 3] = most_step - data[1] - (c->rub[k] - rubbed_before);
    }
    rubbed_before = c->rub[k];
  }
  if (ROWS > 1) confine(c);
  state = c->states + N * total;
  c->end[0] = state[0] - ahead[c->horizon];
  c->end[1] = state[1] - (ahead[c->horizon + 1] - ahead[c->horizon - 1]) / (2 * dt);
}

/* Linearise, solve, and go on with the torques found; the residual. */
static real optimise(struct controller *c)
{
  int k, pass;
  real worst = INFINITY, most = INFINITY;
  for (pass = 0; pass < c->passes && (!pass || most > CONVERGED * c->unit[0]); ++pass) {
    if (pass) memcpy(c->guess, c->plan + 1, c->horizon * sizeof(real));
    linearise(c);
    worst = solve(c);
    c->plan[0] = worst <= CERTIFIED;
    most = 0;
    if (!c->plan[0]) { /* the guess, as far as the bounds let it stand */
      for (k = 0; k < c->horizon; ++k) {
        real *bounds = c->bounds + 3 * k;
        bounds[0] = -1;
        bounds[1] = bounds[2] = clipped(0, bounds[1], bounds[2]);
      }
      sweep(c);
    }
    for (k = 0; k < c->horizon; ++k) {
      c->plan[k + 1] = clipped(c->guess[k] + c->e[k], c->range[2 * k], c->range[2 * k + 1]);
      most = larger(most, fabs(c->e[k]));
    }
  }
  return worst;
}

/* Keep the teeth together with as little torque on the load as that allows, and know nothing. */
static void hold(struct controller *c)
{
  int k;
  real nothing = 0, given, margin, preload = c->preload[0], next;
  c->plan[0] = 0;
  c->outcome[2] = INFINITY;
  for (k = 0; k < c->horizon; ++k) {
    split(&preload, &nothing, &nothing, &nothing, c->machine, &next, c->torques + 2 * k, &given, &margin);
    preload = next;
    c->angles[k] = NAN;
    if (k) continue;
    c->preload[0] = preload;
    c->outcome[0] = margin;
    c->past[c->late + 2] = given;
    c->rubs[c->late + 2] = 0;
  }
  c->angles[k] = NAN;
}

/* Whether a limit of angle or speed is predicted to be broken at a sample. */
static int broken(const struct controller *c, int k)
{
  real angle = c->angles[k], speed = c->states[N * (c->late + k) + 1] + c->s[M * k + 1];
  return angle < c->soft[0] - c->soft[5] || angle > c->soft[1] + c->soft[5] || fabs(speed) > c->soft[2] + c->soft[6];
}

/* The torques of the horizon for what was planned. */
static int plan_ahead(struct controller *c)
{
  int k, trouble = 0, beyond = 0, shift = c->late;
  real dt = c->model[PARAMETERS - 1], given, margin, sum = 0, preload = c->preload[0], next, total;
  for (k = 0; k < c->horizon; ++k) c->guess[k] = c->plan[0] ? c->plan[k + 2 - (k == c->horizon - 1)] : c->past[shift + 1];
  for (k = 0; k < c->horizon; ++k)
    c->bounds[3 * k] = c->plan[0] ? c->bounds[3 * (k + 1 - (k == c->horizon - 1))] : 0;
  c->outcome[2] = optimise(c);
  if (!c->plan[0]) trouble = UNCERTIFIED;
  for (k = 0; k <= c->horizon; ++k) {
    const real *state = c->states + N * (shift + k), *s = c->s + M * k;
    c->angles[k] = state[0] + s[0];
    if (k < c->horizon) c->acceleration[k] = (state[N + 1] + s[M + 1] - (state[1] + s[1])) / dt;
    if (ROWS > 1 && k && broken(c, k)) beyond = BEYOND;
    if (k < c->horizon) sum += fabs(c->acceleration[k]) + fabs(c->plan[k + 1]) + fabs(c->rub[k]);
  }
  if (!isfinite(sum)) {
    hold(c);
    return UNCERTIFIED;
  }
  c->load[0] = c->plan[1] + c->rub[0] - c->tuning[4] * c->acceleration[0];
  c->outcome[0] = INFINITY;
  for (k = 0; k < c->horizon; ++k) {
    total = c->plan[k + 1] + c->rub[k];
    split(&preload, &total, c->states + N * (shift + k) + 1, c->acceleration + k, c->machine,
          &next, c->torques + 2 * k, &given, &margin);
    preload = next;
    c->outcome[0] = margin < c->outcome[0] ? margin : c->outcome[0];
    if (k) continue;
    c->past[shift + 2] = given - c->rub[0];
    c->rubs[shift + 2] = c->rub[0];
    c->preload[0] = preload;
  }
  if (c->outcome[0] < -1e-9 * c->machine[1]) trouble |= PARTING;
  return trouble | beyond;
}

int control_step(struct controller *c, double angle, int previewed)
{
  int trouble;
  real acted[3], code, anew, belief[BELIEF];
  acted[0] = c->past[1], acted[1] = c->past[0], acted[2] = c->learnt[6] == 0 ? c->rubbing[3] : 0;
  c->readings[0] = angle; /* and behind it those of the motors */
  estimate(c->belief, c->readings, acted, c->model, c->levels, belief, &code, &anew);
  if (anew) begin(c->readings, acted, c->model, c->levels, belief);
  memcpy(c->belief, belief, sizeof belief);
  trouble = (int)code;
  if (!c->belief[0]) {
    hold(c);
  } else {
    trouble |= look(c, previewed);
    aim(c, previewed && !(trouble & AIMLESS));
    trouble |= astray(c);
    rubbed(c);
    trouble |= plan_ahead(c);
  }
  c->outcome[1] = c->belief[2];
  memmove(c->past, c->past + 1, (c->late + 2) * sizeof(real));
  memmove(c->rubs, c->rubs + 1, (c->late + 2) * sizeof(real));
  return trouble;
}
