/* Predictive controller of a preloaded pair of drives: one measured angle in, two pinion torques out.

   Written by `antidrive export`. C99 that depends on the mathematical library alone, takes no memory and bounds every
   loop. README.txt has the model, the cost of a step and the memory.

     static struct antidrive_controller arm;
     antidrive_real torques[2];
     antidrive_init(&arm);
     every ANTIDRIVE_SAMPLE_TIME: status = antidrive_step(&arm, angle, reference, torques);

   All that is remembered is in the struct, which belongs to the caller; there is no other state. Any number of machines
   of this kind run side by side, each with its own struct; one struct must not be used from two threads at once. */

#ifndef ANTIDRIVE_CONTROLLER_H
#define ANTIDRIVE_CONTROLLER_H

#ifdef __cplusplus
extern "C" {
#endif

typedef ${real} antidrive_real;

#define ANTIDRIVE_SAMPLE_TIME ${sample_time} /* [s], between two steps; nothing checks that it is kept */
#define ANTIDRIVE_MIN_TORQUE ${min_torque} /* [N m], least magnitude of each pinion's torque */
#define ANTIDRIVE_MAX_TORQUE ${max_torque} /* [N m], greatest */

enum {
  ANTIDRIVE_HORIZON = ${horizon}, /* samples looked ahead */
  ANTIDRIVE_LATE = ${late}, /* whole samples by which the model's command is late */
  ANTIDRIVE_MOTORS = ${motors} /* 1 if readings of encoders at the motors count, 0 if not */
};

/* Status of a step: 0 if the torques are optimal, else the sum of the reasons why not. The torques may always be
   applied: whatever the inputs, even NaN, they are finite and within their bounds. */
enum antidrive_status {
  ANTIDRIVE_OPTIMAL = 0,
${statuses}
};

/* One controller. The first three members may be read after a step; leave the others alone. */
struct antidrive_controller {
  antidrive_real outcome[3]; /* predicted flank torque above the minimum, least of both drives over the horizon, at the
                                pinion [N m], negative where the teeth may part; torque on the load that the model does
                                not know [N m]; residual of the programme, infinite if nothing was certified */
  antidrive_real torques[${torques}]; /* pinion torques 1 and 2 of each sample of the horizon [N m] */
  antidrive_real angles[${angles}]; /* predicted load angle from now on [rad]; NaN if nothing is known */
${members}
};

/* Forget everything. To be called once before the first step, and whenever the machine was moved without control. The
   estimate begins at the first reading, at rest. */
void antidrive_init(struct antidrive_controller *controller);

/* One sample.

   angle      measured angle of the load [rad], any finite number, continuous over turns; NaN if there is no reading,
              then the model's prediction stands in.
   reference  wanted angle of the load now [rad]; it is taken to go on at its speed while that is smooth. NaN holds the
              load where it is.
   torques    out: torques of pinion 1 and 2 to apply until the next step [N m];
              ANTIDRIVE_MIN_TORQUE <= torques[0] <= ANTIDRIVE_MAX_TORQUE, and torques[1] the same with a minus.
   returns    the status. */
int antidrive_step(struct antidrive_controller *controller, antidrive_real angle, antidrive_real reference,
                   antidrive_real torques[2]);

/* The same where the coming reference is known: from now on [rad], one a sample, all finite. */
int antidrive_step_ahead(struct antidrive_controller *controller, antidrive_real angle,
                         const antidrive_real reference[ANTIDRIVE_HORIZON + 1], antidrive_real torques[2]);

/* Measured angles of the two motor shafts for the next step [rad], NaN where there is none. They count only if
   ANTIDRIVE_MOTORS is 1, and for one step. */
void antidrive_motors(struct antidrive_controller *controller, antidrive_real first, antidrive_real second);

#ifdef __cplusplus
}
#endif

#endif
