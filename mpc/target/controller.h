/* Predictive controller of ${machine}: one measured ${angle} in, ${torque_count} out.

   Written by `antidrive export`. C99 that depends on the mathematical library alone, takes no memory and bounds every
   loop. README.txt has the model, the cost of a step and the memory.

     static struct ${name}_controller arm;
     ${name}_real torques[${NAME}_DRIVES];
     ${name}_init(&arm);
     every ${NAME}_SAMPLE_TIME: status = ${name}_step(&arm, ${angle}, reference, torques);

   All that is remembered is in the struct, which belongs to the caller; there is no other state. Any number of machines
   of this kind run side by side, each with its own struct; one struct must not be used from two threads at once. */

#ifndef ${NAME}_CONTROLLER_H
#define ${NAME}_CONTROLLER_H

#ifdef __cplusplus
extern "C" {
#endif

typedef ${real} ${name}_real;

#define ${NAME}_SAMPLE_TIME ${sample_time} /* [s], between two steps; if it differs, call ${name}_elapsed */
#define ${NAME}_MIN_TORQUE ${min_torque} /* [N m], least magnitude of a drive's torque */
#define ${NAME}_MAX_TORQUE ${max_torque} /* [N m], greatest */
${intervals}

enum {
  ${NAME}_DRIVES = ${drives},
  ${NAME}_HORIZON = ${horizon}, /* samples looked ahead */
  ${NAME}_LATE = ${late}, /* whole samples by which the model's command is late */
  ${NAME}_MOTORS = ${motors} /* 1 if readings of encoders at the motors count, 0 if not */
};

/* Status of a step: 0 if the torques are optimal, else the sum of the reasons why not. The torques may always be
   applied: whatever the inputs, even NaN, they are finite and within their bounds. */
enum ${name}_status {
  ${NAME}_OPTIMAL = 0,
${statuses}
};

/* One controller. The first three members may be read after a step; leave the others alone. */
struct ${name}_controller {
  /* Predicted flank torque above the minimum, least of both drives over the horizon, at the pinion [N m], negative where
     the teeth may part; ${torque} on the load that the model does not know [${newton}]; residual of the quadratic
     program, infinite if nothing was certified. */
  ${name}_real outcome[3];
  ${name}_real torques[${torques}]; /* ${of_torques} */
  ${name}_real angles[${angles}]; /* predicted ${angle} of the load from now on [${length}]; NaN if nothing is known */
${members}
};

/* Forget everything. To be called once before the first step, and whenever the machine was moved without control. The
   estimate begins at the first reading, at rest. */
void ${name}_init(struct ${name}_controller *controller);

/* One sample.

   - ${angle}: measured ${angle} of the load [${length}], any finite number${turns}; NaN if there is no
     reading, then the model's prediction stands in.
   - reference: wanted ${angle} of the load now [${length}]; it is taken to go on at its speed while that is smooth. NaN
     holds the load where it is.
   - torques, out: of each drive to apply until the next step [N m], the first within
     ${NAME}_TORQUE_1_LOW .. ${NAME}_TORQUE_1_HIGH and so on.
   - returns the status. */
int ${name}_step(struct ${name}_controller *controller, ${name}_real ${angle}, ${name}_real reference,
    ${name}_real torques[${NAME}_DRIVES]);

/* The same where the coming reference is known: from now on [${length}], one a sample, all finite. */
int ${name}_step_ahead(struct ${name}_controller *controller, ${name}_real ${angle},
    const ${name}_real reference[${NAME}_HORIZON + 1], ${name}_real torques[${NAME}_DRIVES]);

/* Measured angles of the motor shafts for the next step [rad], NaN where there is none. They count only if
   ${NAME}_MOTORS is 1, and for one step. */
void ${name}_motors(struct ${name}_controller *controller, ${name}_real first, ${name}_real second);

/* The time since the last step [s] for the next one, where it is not ${NAME}_SAMPLE_TIME: in a loop that jitters or
   misses cycles. After more than a horizon of them the estimate begins anew. */
void ${name}_elapsed(struct ${name}_controller *controller, ${name}_real seconds);

#ifdef __cplusplus
}
#endif

#endif
