"""C code that arranges the instructions of a CasADi function for the loops that execute them.

Instructions of one kind are grouped as far as their operands allow; the kind with most ready instructions is always
next. Those that depend neither on the row nor on the carried values come first. Where rows are independent, results
share their places as soon as they are not needed any more, so that all stay in the cache.
"""

from __future__ import annotations

ARRANGEMENT = """
#include <stdlib.h>

/* Which instruction gave each operand: `value` has one number for each cell of CasADi's memory. Results are numbered
   after the `given` values, in the order of the code. Returns how many instructions there are beside inputs, constants
   and outputs. */
EXPORT int list_instructions(
    int n, int given, const int* kinds, const int* entering, const int* leaving, const int* input, const int* output,
    int* value, int* kind, int* a, int* b, int* outputs) {
  int k, m = 0;
  for (k = 0; k < n; ++k, entering += 2, leaving += 2) {
    if (kinds[k] == IS_INPUT || kinds[k] == IS_CONST) value[leaving[0]] = input[entering[0]] + entering[1];
    else if (kinds[k] == IS_OUTPUT) outputs[output[leaving[0]] + leaving[1]] = value[entering[0]];
    else {
      a[m] = value[entering[0]]; b[m] = value[entering[1]]; kind[m] = kinds[k];
      value[leaving[0]] = given + m++;
    }
  }
  return m;
}

EXPORT int arrange_tape(
    int m, const int* kind, const int* a, const int* b, int given, int moving, int shared, int seen, int* outputs,
    int* first, int* second, int* results, int* group_kinds, int* group_counts, int* sizes) {
  int k, i, part, done = 0, groups = 0, once = 0, still = 0;
  int* all = calloc(8 * (size_t) m + 4 * KINDS + 4, sizeof(int));
  if (!all) return 1;
  int *moved = all, *missing = moved + m, *users = missing + m, *queue = users + 2 * m, *turn = queue + m;
  int *order = turn + m, *from = order + m, *begun = from + m + 1, *head = begun + KINDS + 1, *tail = head + KINDS;
  int *last = queue, *free_cells = users;
  for (k = 0; k < m; ++k) {  /* users of each result: those of result k begin at from[k] */
    moved[k] = a[k] < moving || b[k] < moving;
    if (a[k] >= given) { moved[k] |= moved[a[k] - given]; ++from[a[k] - given + 1]; ++missing[k]; }
    if (b[k] >= given && b[k] != a[k]) { moved[k] |= moved[b[k] - given]; ++from[b[k] - given + 1]; ++missing[k]; }
    ++begun[kind[k] + 1];
  }
  for (k = 0; k < m; ++k) from[k + 1] += from[k];
  for (k = 0; k < KINDS; ++k) { begun[k + 1] += begun[k]; head[k] = tail[k] = begun[k]; }
  for (k = 0; k < m; ++k) {
    if (a[k] >= given) users[from[a[k] - given] + turn[a[k] - given]++] = k;
    if (b[k] >= given && b[k] != a[k]) users[from[b[k] - given] + turn[b[k] - given]++] = k;
  }
  for (part = 0; part < 2; ++part) {
    for (k = 0; k < m; ++k) if (moved[k] == part && !missing[k]) queue[tail[kind[k]]++] = k;
    for (;; ++groups) {
      int most = 0, size = 0;
      for (i = 0; i < KINDS; ++i) if (tail[i] - head[i] > size) { size = tail[i] - head[i]; most = i; }
      if (!size) break;
      group_kinds[groups] = most;
      group_counts[groups] = done;
      while (head[most] < tail[most]) {  /* grows while instructions become ready */
        const int now = queue[head[most]++];
        turn[now] = done;
        order[done++] = now;
        for (i = from[now]; i < from[now + 1]; ++i) {
          const int user = users[i];
          if (!--missing[user] && moved[user] == part) queue[tail[kind[user]]++] = user;
        }
      }
      group_counts[groups] = done - group_counts[groups];
    }
    if (!part) { once = groups; still = done; }
  }
  sizes[0] = groups; sizes[1] = once;
  if (!shared) for (k = 0; k < m; ++k) results[k] = given + k;
  else {  /* a place that is needed no more is taken over: `last` use of each result, and a stack of free places */
    int free_ones = 0, used = 0;
    for (k = 0; k < m; ++k) last[k] = k < still ? m : k;
    for (k = 0; k < m; ++k) {
      const int one = a[order[k]] - given, other = b[order[k]] - given;
      if (one >= 0 && last[turn[one]] < k) last[turn[one]] = k;
      if (other >= 0 && last[turn[other]] < k) last[turn[other]] = k;
    }
    for (k = 0; k < seen; ++k) if (outputs[k] >= given) last[turn[outputs[k] - given]] = m;
    for (k = 0; k < m; ++k) {  /* taken before its own operands are freed: none is overwritten while it is read */
      const int one = a[order[k]] - given, other = b[order[k]] - given;
      results[k] = given + (free_ones ? free_cells[--free_ones] : used++);
      if (last[k] == k) free_cells[free_ones++] = results[k] - given;
      if (one >= 0 && last[turn[one]] == k) free_cells[free_ones++] = results[turn[one]] - given;
      if (other >= 0 && other != one && last[turn[other]] == k) free_cells[free_ones++] = results[turn[other]] - given;
    }
  }
  for (k = 0; k < m; ++k) {
    const int one = a[order[k]], other = b[order[k]];
    first[k] = one < given ? one : results[turn[one - given]];
    second[k] = other < given ? other : results[turn[other - given]];
  }
  for (k = 0; k < seen; ++k) if (outputs[k] >= given) outputs[k] = results[turn[outputs[k] - given]];
  free(all);
  return 0;
}
"""
