/* Plays recorded angles through the controller: CSV on standard input, CSV on standard output.

   A line is angle,reference [rad], or angle and the ANTIDRIVE_HORIZON + 1 references from now on; where encoders at the
   motors count (ANTIDRIVE_MOTORS) their two angles stand behind the first. The first line may hold names. "nan" is a
   reading that is missing. Out: torque_1,torque_2 [N m],status. */

#include <stdio.h>
#include <stdlib.h>

#include "antidrive_controller.h"

enum { BEFORE = 1 + 2 * ANTIDRIVE_MOTORS, MOST = BEFORE + ANTIDRIVE_HORIZON + 1 };

static struct antidrive_controller controller;
static char line[32 * MOST + 64];

/* How many numbers stand in a line, and the numbers. */
static int numbers(const char *text, antidrive_real *found)
{
  int count = 0;
  char *end;
  while (count < MOST) {
    double number = strtod(text, &end);
    if (end == text) break;
    found[count++] = (antidrive_real)number;
    if (*end != ',') break;
    text = end + 1;
  }
  return count;
}

int main(void)
{
  antidrive_real found[MOST], torques[2];
  int row = 0, count, status;
  antidrive_init(&controller);
  printf("torque_1,torque_2,status\n");
  while (fgets(line, sizeof line, stdin)) {
    count = numbers(line, found);
    if (!row++ && !count) continue; /* names */
    if (count != BEFORE + 1 && count != MOST) {
      fprintf(stderr, "line %d has %d numbers instead of %d or %d\n", row, count, (int)BEFORE + 1, (int)MOST);
      return 2;
    }
    if (ANTIDRIVE_MOTORS) antidrive_motors(&controller, found[BEFORE - 2], found[BEFORE - 1]);
    status = count == MOST ? antidrive_step_ahead(&controller, found[0], found + BEFORE, torques)
                           : antidrive_step(&controller, found[0], found[BEFORE], torques);
    printf("%.17g,%.17g,%d\n", (double)torques[0], (double)torques[1], status);
  }
  return 0;
}
