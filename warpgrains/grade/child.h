/* What the parts of the child share: the answer that says how it ended, what confines it, guarded arrays. */

#ifndef CHILD_H
#define CHILD_H

#include <stddef.h>

enum { ANSWERED, CALLED, CRASHED, OUTSIDE, CHANGED, TOO_LONG };
enum { FILES, PROCESSES, NETWORK, MEMORY, ABORT, TERMINAL, WAITING, SIGNALS, OTHER };

/* What is answered to a request; arrays follow if it is ANSWERED. */
typedef struct {
    int kind;  /* the first of the two lists above */
    int what;  /* CALLED: the second list; CRASHED: the signal; OUTSIDE: the array, in the struct's order */
    int where; /* CALLED: number of the system call; OUTSIDE: the index */
    int calls; /* of femGrainsContactIterate */
    double zeta;
} Answer;

/* Answer why the process cannot go on, and end it. */
void end(int kind, int what, int where);

/* Open a file that the process may still open by this name, once, after `confine`. */
void prepareFile(const char *path);
/* Limit what the process may use, from now on; 0: this system has no filter of system calls. */
int confine(size_t bytes, int seconds);
/* Begin to measure the time of a call. */
void startClock(double seconds);

#define ARRAYS 8

/* Make room for arrays of such lengths, each between pages that cannot be touched. */
void placeArrays(const size_t lengths[ARRAYS], double *arrays[ARRAYS]);
/* Which array is next to an address, and the index there; -1: none. */
int findArray(const void *address, int *index);
/* The first array that was written to before its begin; -1: none. */
int findWritten(int *index);

#endif
