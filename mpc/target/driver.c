/* Runs the controller on a recording: CSV on standard input, CSV on standard output.

   A line has ${angle},reference [${length}], or ${angle} and the ${NAME}_HORIZON + 1 references from now on. If motor encoders
   are used (${NAME}_MOTORS), their angles [rad] follow the ${angle}. The first line may have column names. "nan" is a missing
   measurement. Output: the torque of each drive [N m], and the status. */

#include <stdio.h>
#include <stdlib.h>

#include "${name}_controller.h"

enum { BEFORE = 1 + ${NAME}_DRIVES * ${NAME}_MOTORS, MOST = BEFORE + ${NAME}_HORIZON + 1 };

static struct ${name}_controller controller;
static char line[32 * MOST + 64];

/* Parse the numbers of a line; returns how many there are. */
static int numbers(const char *text, ${name}_real *found)
{
  int count = 0;
  char *end;
  while (count < MOST) {
    double number = strtod(text, &end);
    if (end == text) break;
    found[count++] = (${name}_real)number;
    if (*end != ',') break;
    text = end + 1;
  }
  return count;
}

int main(void)
{
  ${name}_real found[MOST], torques[${NAME}_DRIVES];
  int row = 0, count, status, drive;
  ${name}_init(&controller);
  for (drive = 1; drive <= ${NAME}_DRIVES; ++drive) printf("torque_%d,", drive);
  printf("status\n");
  while (fgets(line, sizeof line, stdin)) {
    count = numbers(line, found);
    if (!row++ && !count) continue; /* column names */
    if (count != BEFORE + 1 && count != MOST) {
      fprintf(stderr, "line %d has %d numbers instead of %d or %d\n", row, count, (int)BEFORE + 1, (int)MOST);
      return 2;
    }
    if (${NAME}_MOTORS) ${name}_motors(&controller, found[1], found[${NAME}_DRIVES]);
    status = count == MOST ? ${name}_step_ahead(&controller, found[0], found + BEFORE, torques)
                           : ${name}_step(&controller, found[0], found[BEFORE], torques);
    for (drive = 0; drive < ${NAME}_DRIVES; ++drive) printf("%.17g,", (double)torques[drive]);
    printf("%d\n", status);
  }
  return 0;
}
