/* One sample of the controller: measured angle in, pinion torques out.

   The functions estimate, begin, govern, ... above compute one stage each. CasADi generates them from the expressions
   of the Python form (mpc/step.py); this file has the loops around them. No memory is allocated, all loops are bounded. */

enum { NO_ANGLE = 1, ANGLE_PREDICTED = 2, ANGLE_JUMPED = 4, ESTIMATE_RESTARTED = 8, ESTIMATE_DIVERGED = 16,
       NO_REFERENCE = 32, UNCERTIFIED = 64, CONTACT_AT_RISK = 128, LIMIT_VIOLATED = 256, NOT_FOLLOWING = 512,
       ENCODER_FAULT = 1024 };

#define CONVERGED 1e-9 /* change of the torques below which the iteration ends, in units of the greatest torque */

/* Fill the wanted angle over the horizon and its changes; a scalar reference is extrapolated. */
static int look(struct controller *c, int previewed)
{
  int k, trouble = 0;
  real speed = 0, history[4], angle = c->kalman[KALMAN_ANGLE];
  real *wanted = c->wanted;
  for (k = 0; k <= (previewed ? HORIZON : 0); ++k)
    if (!isfinite(wanted[k])) trouble = NO_REFERENCE;
  if (trouble) previewed = 0, wanted[0] = angle;
  if (previewed) {
    for (k = 0; k < HORIZON; ++k) c->steps[k] = wanted[k + 1] - wanted[k];
    c->history[HISTORY_COUNT] = 0;
    return trouble;
  }
  preview(c->history, wanted, TABLE(tuning) + TUNING_ATTAINABLE, history, &speed);
  memcpy(c->history, history, sizeof history);
  for (k = 1; k <= HORIZON; ++k) wanted[k] = wanted[0] + speed * k, c->steps[k - 1] = speed;
  return trouble;
}

/* The wanted angle at a sample; after the horizon it continues at its last speed. */
static real wanted_at(const struct controller *c, int k)
{
  int last = HORIZON;
  return k <= last ? c->wanted[k] : c->wanted[last] + (k - last) * (c->wanted[last] - c->wanted[last - 1]);
}

/* The sample of a previewed jump to which a move starts now (0: none), and the change of the wanted angle per sample
   there. After the last sample the reference continues at its speed, so there is no jump. */
static int lead(const struct controller *c, const real *path, const real *limits, real *change)
{
  int k;
  real jumps = 0, due = 0, count;
  const real *dt = TABLE(model) + PARAMETERS - 1;
  for (k = 0; k < HORIZON - 1 && !jumps; ++k) jump(c->wanted + k, TABLE(tuning) + TUNING_ATTAINABLE, &jumps);
  count = k;
  if (jumps) early(path, c->wanted + k - 1, &count, limits, dt, TABLE(rubbing) + RUBBING_JERK, &due, change);
  if (due) return k;
  *change = 0;
  return 0;
}

/* The governed reference over the horizon, and over the dead time after it, extrapolated at its last acceleration. */
static void aim(struct controller *c, int previewed)
{
  int k, i, last = HORIZON, first = 0;
  real limits[3], near, speed, bend, now[2], next[2], pair[2], wanted, change = 0, *ahead = c->ahead, *speeds = c->speeds;
  followable(c->kalman + KALMAN_ANGLE, c->load, TABLE(machine), TABLE(tuning), limits, &near);
  if (!(c->path[PATH_GOVERNED] && fabs(c->kalman[KALMAN_ANGLE] - c->path[PATH_ANGLE]) <= near)) {
    c->path[PATH_GOVERNED] = 1;
    c->path[PATH_ANGLE] = c->kalman[KALMAN_ANGLE];
    c->path[PATH_RATE] = c->kalman[KALMAN_VELOCITY];
    c->path[PATH_MOVE] = 0;
  }
  memcpy(now, c->path + PATH_ANGLE, sizeof now);
  if (previewed) first = lead(c, now, limits, &change);
  wanted = wanted_at(c, first) - first * change;
  hurry(now, &wanted, c->path + PATH_MOVE, TABLE(tuning) + TUNING_ATTAINABLE, TABLE(rubbing) + RUBBING_JERK, limits + 2);
  c->path[PATH_MOVE] = limits[2];
  now[0] -= wanted; /* from here on the distance from the wanted angle */
  for (k = 0; k <= last; ++k) {
    const real *steps = c->steps + k;
    wanted = wanted_at(c, first + k) - first * change;
    if (first || k + 2 > last) {
      for (i = 0; i < 2; ++i) pair[i] = c->steps[first + k + i < last ? first + k + i : last - 1];
      steps = pair;
    }
    ahead[k] = wanted + now[0], speeds[k] = now[1];
    govern(now, &wanted, steps, limits, TABLE(soft), TABLE(govern_numbers), next);
    memcpy(now, next, sizeof now);
  }
  c->path[PATH_ANGLE] = ahead[1], c->path[PATH_RATE] = speeds[1];
  speed = ahead[last] - ahead[last - 1];
  bend = speed - (ahead[last - 1] - ahead[last - 2]);
  for (k = 0; k <= LATE + 1; ++k) speeds[last + k] = speeds[last - 1] + (speeds[last - 1] - speeds[last - 2]) * (k + 1);
  for (k = 1; k <= LATE + 1; ++k) ahead[last + k] = ahead[last] + speed * k + bend * k * (k + 1) / 2;
}

/* Whether the load has not followed the governed reference for some time: mean square of the error over about a period
   of the loop, in units of the permitted error. A single squared error counts as at most 2, so that one large error
   neither triggers the status at once nor keeps it for long. */
static int following_error(struct controller *c)
{
  const real *ahead = c->ahead, *own = TABLE(tuning);
  real step = TABLE(model)[PARAMETERS - 1] * own[TUNING_WAVE], *mean = c->following_error;
  real admitted = own[TUNING_FOLLOWING_ERROR] + fabs(ahead[2] - 2 * ahead[1] + ahead[0]) / (2 * step * step);
  real miss = (ahead[0] - c->kalman[KALMAN_ANGLE]) / admitted;
  if (!(*mean >= 0 && *mean <= 2)) *mean = 0;
  *mean += own[TUNING_SHARE] * (smaller(miss * miss, 2) - *mean);
  return *mean > 1 ? NOT_FOLLOWING : 0;
}

/* Adapt friction, and compute its compensation along the path. If a part of friction is removed from the disturbance,
   the same amount moves from the past compensation torques to the past net torques. */
static void rubbed(struct controller *c)
{
  int k, lead;
  real now[5], learnt[LEARNT], disturbance, more, total, before;
  const real *ahead = c->ahead + LATE;
  total = c->past[LATE + 1] + c->rubs[LATE + 1];
  now[0] = c->rubs[1], now[1] = total, now[2] = ahead[0], now[3] = ahead[1], now[4] = c->ahead[HORIZON];
  learn(c->kalman, c->learnt, now, TABLE(model), TABLE(rubbing), TABLE(tuning), learnt, &disturbance);
  memcpy(c->learnt, learnt, sizeof learnt);
  more = c->kalman[KALMAN_DISTURBANCE] - disturbance;
  c->kalman[KALMAN_DISTURBANCE] = disturbance;
  for (k = 0; k < LATE + 3; ++k) c->past[k] += more, c->rubs[k] -= more;
  for (k = 1; k <= HORIZON; ++k) c->plan[k] += more;
  before = c->rubs[LATE + 1];
  lead = HORIZON; /* samples until friction is back at zero */
  if (fabs(before) / TABLE(rubbing)[RUBBING_MOST_CHANGE] < lead) lead = (int)(fabs(before) / TABLE(rubbing)[RUBBING_MOST_CHANGE]);
  for (k = 0; k < HORIZON; ++k) {
    rub(ahead + (k + lead < HORIZON ? k + lead : HORIZON - 1), &before, &total, c->learnt, TABLE(model), TABLE(rubbing), c->rub + k);
    before = c->rub[k];
  }
}

/* One sample of the smoothing of a torque, in place. */
static real eased(const struct controller *c, real *torque, real taken)
{
  real next[2];
  (void)c; /* unused if the tables are not in the struct */
  ease(&taken, torque, TABLE(rubbing), next);
  memcpy(torque, next, sizeof next);
  return *torque;
}

/* The torque required by the governed reference, and the feedforward torque. The feedforward of the sample before the
   first one is the acting torque. */
static void feed_forward(struct controller *c)
{
  int k, last = HORIZON - 1, known = c->fed[FED_KNOWN] == 1;
  real bend, bent, torque[2], *taken = c->taken, *fed = c->fed, *feeds = c->feed + 1;
  const real *ahead = c->ahead + LATE, *speeds = c->speeds + LATE;
  for (k = FED_VELOCITY_CHANGE; k <= FED_CHANGE; ++k) known = known && isfinite(fed[k]);
  if (!known) {
    fed[FED_VELOCITY_CHANGE] = speeds[1] - speeds[0], bend = -fed[FED_VELOCITY_CHANGE];
    demand(ahead, speeds, &bend, TABLE(model), fed + FED_EASED, &bent);
    fed[FED_TORQUE] = fed[FED_EASED], fed[FED_EASED_CHANGE] = fed[FED_CHANGE] = 0;
  }
  c->feed[0] = known ? fed[FED_TORQUE] : c->past[LATE + 1] + c->kalman[KALMAN_DISTURBANCE];
  bend = fed[FED_VELOCITY_CHANGE];
  for (k = 0; k <= last; ++k) {
    demand(ahead + k, speeds + k, &bend, TABLE(model), taken + k, &bent);
    bend = bent;
    if (k == 0) fed[FED_VELOCITY_CHANGE] = bend;
  }
  memcpy(torque, fed + FED_EASED, sizeof torque);
  for (k = 0; k <= last; ++k) {
    feeds[k] = eased(c, torque, taken[k]);
    if (k == 0) memcpy(fed + FED_EASED, torque, sizeof torque);
  }
  torque[0] = taken[last], torque[1] = taken[last - 1] - taken[last];
  for (k = last; k >= 0; --k) feeds[k] = (feeds[k] + eased(c, torque, taken[k])) / 2;
  memcpy(torque, fed + FED_TORQUE, sizeof torque);
  for (k = 0; k <= last; ++k) {
    feeds[k] = eased(c, torque, feeds[k]);
    if (k == 0) memcpy(fed + FED_TORQUE, torque, sizeof torque);
  }
  fed[FED_KNOWN] = 1;
}

/* The intervals of the constrained quantities other than the torque, relative to their values with the guess. */
static void confine(struct controller *c)
{
  int k, i;
  real memory[2][8], ends[4];
  const real *ahead = c->ahead + LATE, *dt = TABLE(model) + PARAMETERS - 1;
  enter(c->states + N * LATE, TABLE(soft), memory[0]);
  for (k = 0; k < HORIZON; ++k) {
    const real *state = c->states + N * (LATE + k + 1);
    real *fence = c->fence + BARRIER * k;
    corridor(memory[k & 1], ahead + k, TABLE(soft), dt, memory[!(k & 1)], ends);
    for (i = 0; i < 4; ++i) fence[4 + i] = ends[i] - state[i / 2];
  }
}

/* The program, linearised along the prediction of the model with the guess. */
static void linearise(struct controller *c)
{
  int k, late = LATE, total = late + HORIZON;
  real both[2], pace, acceleration, disturbance = c->kalman[KALMAN_DISTURBANCE], dt = TABLE(model)[PARAMETERS - 1];
  real low = c->past[late + 1] + c->rubs[late + 1], high = low, step = TABLE(tuning)[TUNING_TORQUE_STEP];
  real least, most, before_low, before_high, most_step;
  real rubbed_before = c->rubs[late + 1], change;
  const real *ahead = c->ahead + late, *state;
  memcpy(c->states, c->kalman + KALMAN_ANGLE, N * sizeof(real));
  for (k = 0; k < total; ++k) {
    both[0] = (k < late ? c->past[k + 2] : c->guess[k - late]) + disturbance;
    both[1] = (k <= late ? c->past[k + 1] : c->guess[k - late - 1]) + disturbance;
    stage(c->states + N * k, both, TABLE(stage_numbers), c->states + N * (k + 1), c->A + N * N * k, c->B + 2 * N * k);
  }
  c->unit[0] = 0;
  for (k = 0; k < HORIZON; ++k) {
    real *data = c->data + 2 * k, *bounds = c->bounds + 3 * k, *range = c->range + 2 * k;
    state = c->states + N * (late + k);
    pace = state[1];
    acceleration = (state[N + 1] - state[1]) / dt;
    reach(&pace, &acceleration, TABLE(reach_numbers), range);
    least = range[0], most = range[1]; /* below: the part that is reachable under the rate limit */
    before_low = low, before_high = high;
    low = range[0] = smaller(larger(low - step, least), most);
    high = range[1] = larger(smaller(high + step, most), least);
    most_step = larger(step, larger(low - before_high, before_low - high));
    c->unit[0] = larger(c->unit[0], larger(fabs(range[0]), fabs(range[1])));
    range[0] -= c->rub[k], range[1] -= c->rub[k]; /* from here on the range of the net torque */
    bounds[1] = range[0] - c->guess[k];
    bounds[2] = range[1] - c->guess[k];
    data[0] = k ? state[0] - ahead[k] : 0;
    change = c->guess[k] - (k ? c->guess[k - 1] : c->past[late + 1]);
    data[1] = change - (c->feed[k + 1] - c->feed[k]);
    if (ROWS > 1) {
      c->fence[BARRIER * k + 2] = -most_step - change - (c->rub[k] - rubbed_before);
      c->fence[BARRIER * k + 3] = most_step - change - (c->rub[k] - rubbed_before);
    }
    rubbed_before = c->rub[k];
  }
  if (ROWS > 1) confine(c);
  state = c->states + N * total;
  c->end[0] = state[0] - ahead[HORIZON];
  c->end[1] = state[1] - (ahead[HORIZON + 1] - ahead[HORIZON - 1]) / (2 * dt);
}

/* Linearise, solve, and repeat with the new torques if requested; returns the residual. */
static real optimise(struct controller *c)
{
  int k, pass;
  real worst = INFINITY, most = INFINITY;
  for (pass = 0; pass < PASSES && (!pass || most > CONVERGED * c->unit[0]); ++pass) {
    if (pass) memcpy(c->guess, c->plan + 1, HORIZON * sizeof(real));
    linearise(c);
    worst = solve(c);
    c->plan[0] = worst <= CERTIFIED;
    most = 0;
    if (!c->plan[0]) { /* fall back to the guess, clipped to the bounds */
      for (k = 0; k < HORIZON; ++k) {
        real *bounds = c->bounds + 3 * k;
        bounds[0] = -1;
        bounds[1] = bounds[2] = clipped(0, bounds[1], bounds[2]);
      }
      sweep(c);
    }
    for (k = 0; k < HORIZON; ++k) {
      c->plan[k + 1] = clipped(c->guess[k] + c->e[k], c->range[2 * k], c->range[2 * k + 1]);
      most = larger(most, fabs(c->e[k]));
    }
  }
  return worst;
}

/* Without an estimate: keep contact with as little torque on the load as possible. */
static void hold(struct controller *c)
{
  int k;
  real nothing = 0, given, margin, preload = c->preload[0], next;
  c->plan[0] = 0;
  c->outcome[OUTCOME_RESIDUAL] = INFINITY;
  for (k = 0; k < HORIZON; ++k) {
    allocation(&preload, &nothing, &nothing, &nothing, TABLE(allocation_numbers), &next, c->torques + 2 * k, &given, &margin);
    preload = next;
    c->angles[k] = NAN;
    if (k) continue;
    c->preload[0] = preload;
    c->outcome[OUTCOME_MARGIN] = margin;
    c->past[LATE + 2] = given;
    c->rubs[LATE + 2] = 0;
  }
  c->angles[k] = NAN;
}

/* Whether a limit of angle or speed is predicted to be violated at a sample. */
static int broken(const struct controller *c, int k)
{
  real angle = c->angles[k], speed = c->states[N * (LATE + k) + 1] + c->s[M * k + 1];
  const real *limits = TABLE(soft);
  return angle < limits[SOFT_LOWEST] - limits[SOFT_SHOWS] || angle > limits[SOFT_HIGHEST] + limits[SOFT_SHOWS] ||
         fabs(speed) > limits[SOFT_FASTEST] + limits[SOFT_SHOWS_SPEED];
}

/* Plan the net torques, and compute the drive torques over the horizon. */
static int plan_ahead(struct controller *c)
{
  int k, trouble = 0, beyond = 0, shift = LATE;
  real dt = TABLE(model)[PARAMETERS - 1], given, margin, sum = 0, preload = c->preload[0], next, total;
  for (k = 0; k < HORIZON; ++k) c->guess[k] = c->plan[0] ? c->plan[k + 2 - (k == HORIZON - 1)] : c->past[shift + 1];
  for (k = 0; k < HORIZON; ++k)
    c->bounds[3 * k] = c->plan[0] ? c->bounds[3 * (k + 1 - (k == HORIZON - 1))] : 0;
  for (k = 0; k < ROWS * HORIZON; ++k) {
    int next = k < ROWS * (HORIZON - 1) ? k + ROWS : k;
    c->pressed[k] = c->plan[0] ? c->pressed[next] : 0;
    c->forces[k] = c->plan[0] ? c->forces[next] : 0;
  }
  c->outcome[OUTCOME_RESIDUAL] = optimise(c);
  if (!c->plan[0]) trouble = UNCERTIFIED;
  for (k = 0; k <= HORIZON; ++k) {
    const real *state = c->states + N * (shift + k), *s = c->s + M * k;
    c->angles[k] = state[0] + s[0];
    if (k < HORIZON) c->acceleration[k] = (state[N + 1] + s[M + 1] - (state[1] + s[1])) / dt;
    if (ROWS > 1 && k && broken(c, k)) beyond = LIMIT_VIOLATED;
    if (k < HORIZON) sum += fabs(c->acceleration[k]) + fabs(c->plan[k + 1]) + fabs(c->rub[k]);
  }
  if (!isfinite(sum)) {
    hold(c);
    return UNCERTIFIED;
  }
  c->load[0] = c->plan[1] + c->rub[0] - TABLE(tuning)[TUNING_INERTIA] * c->acceleration[0];
  c->outcome[OUTCOME_MARGIN] = INFINITY;
  for (k = 0; k < HORIZON; ++k) {
    total = c->plan[k + 1] + c->rub[k];
    allocation(&preload, &total, c->states + N * (shift + k) + 1, c->acceleration + k, TABLE(allocation_numbers),
          &next, c->torques + 2 * k, &given, &margin);
    preload = next;
    c->outcome[OUTCOME_MARGIN] = margin < c->outcome[OUTCOME_MARGIN] ? margin : c->outcome[OUTCOME_MARGIN];
    if (k) continue;
    c->past[shift + 2] = given - c->rub[0];
    c->rubs[shift + 2] = c->rub[0];
    c->preload[0] = preload;
  }
  if (c->outcome[OUTCOME_MARGIN] < -1e-9 * TABLE(machine)[1]) trouble |= CONTACT_AT_RISK;
  return trouble | beyond;
}

/* Shift the past torques by one sample. */
static void move_on(struct controller *c)
{
  memmove(c->past, c->past + 1, (LATE + 2) * sizeof(real));
  memmove(c->rubs, c->rubs + 1, (LATE + 2) * sizeof(real));
}

/* A missed sample: the last torques were held, and there was no measurement. */
static void miss(struct controller *c)
{
  real measurements[3] = {NAN, NAN, NAN}, acted[3] = {0}, code, anew, kalman[KALMAN];
  acted[0] = c->past[1], acted[1] = c->past[0];
  estimate(c->kalman, measurements, acted, TABLE(model), TABLE(levels), kalman, &code, &anew);
  memcpy(c->kalman, kalman, sizeof kalman);
  move_on(c);
  memmove(c->plan + 1, c->plan + 2, (HORIZON - 1) * sizeof(real));
  c->watched[1] = 0; /* restart the free simulation of the fault detection */
}

/* Process the time since the last sample: whole missed samples, and the remaining time for the next prediction. The
   stored reference samples are moved on accordingly. */
static void lapse(struct controller *c)
{
  int k, missed;
  real dt = TABLE(model)[PARAMETERS - 1], elapsed = c->elapsed[0], shift, late, bend;
  memcpy(c->acting, TABLE(model), PARAMETERS * sizeof(real));
  c->elapsed[0] = 0;
  if (!(elapsed > 0 && isfinite(elapsed))) return;
  if (elapsed > (HORIZON + 0.5) * dt) { /* the estimate is out of date */
    c->kalman[KALMAN_KNOWN] = c->path[PATH_GOVERNED] = c->plan[0] = c->history[HISTORY_COUNT] = 0;
    return;
  }
  shift = c->history[HISTORY_COUNT] > 1 ? (elapsed / dt - 1) * (c->history[HISTORY_THIRD] - c->history[HISTORY_SECOND]) : 0;
  for (k = HISTORY_FIRST; k <= HISTORY_THIRD; ++k) c->history[k] += shift;
  late = elapsed - dt, bend = isfinite(c->fed[FED_VELOCITY_CHANGE]) ? c->fed[FED_VELOCITY_CHANGE] : 0;
  c->path[PATH_ANGLE] += late * (c->path[PATH_RATE] + late * (bend / (2 * dt)));
  c->path[PATH_RATE] += late * (bend / dt);
  missed = elapsed > dt ? (int)(elapsed / dt - 0.5) : 0;
  for (k = 0; k < missed; ++k) miss(c);
  c->acting[PARAMETERS - 1] = elapsed - missed * dt;
}

/* Unwrap the measurement, and discard those of faulty encoders; returns whether any encoder is faulty. */
static int watched(struct controller *c)
{
  real acted[3], kalman[KALMAN], memory[WATCHED], measurement, load_out, motors_out;
  acted[0] = c->past[1], acted[1] = c->past[0], acted[2] = c->past[1] + c->rubs[1];
  watch(c->kalman, c->measurements, c->watched, acted, c->acting, TABLE(watching), kalman, &measurement, memory, &load_out, &motors_out);
  memcpy(c->kalman, kalman, sizeof kalman);
  memcpy(c->watched, memory, sizeof memory);
  if (motors_out != 0) c->measurements[1] = c->measurements[2] = NAN;
  c->measurements[0] = load_out != 0 ? NAN : measurement;
  return load_out != 0 || motors_out != 0;
}

STEP int control_step(struct controller *c, real angle, int previewed)
{
  int trouble, out;
  real acted[3], code, anew, kalman[KALMAN];
  c->measurements[0] = angle; /* followed by those of the motors */
  lapse(c);
  out = watched(c);
  acted[0] = c->past[1], acted[1] = c->past[0], acted[2] = c->learnt[LEARNT_DIRECTION] == 0 ? TABLE(rubbing)[RUBBING_DEAF] : 0;
  estimate(c->kalman, c->measurements, acted, c->acting, TABLE(levels), kalman, &code, &anew);
  if (anew) begin(c->measurements, acted, TABLE(model), TABLE(levels), kalman);
  memcpy(c->kalman, kalman, sizeof kalman);
  trouble = (int)code;
  if (out) trouble = (trouble & ~ANGLE_PREDICTED) | ENCODER_FAULT;
  if (!c->kalman[KALMAN_KNOWN]) {
    hold(c);
  } else {
    trouble |= look(c, previewed);
    aim(c, previewed && !(trouble & NO_REFERENCE));
    trouble |= following_error(c);
    rubbed(c);
    feed_forward(c);
    trouble |= plan_ahead(c);
  }
  c->outcome[OUTCOME_DISTURBANCE] = c->kalman[KALMAN_DISTURBANCE];
  move_on(c);
  return trouble;
}
