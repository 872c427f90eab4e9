/* What the parent (sandbox.py, diagnosis.py), the sandbox (sandbox.c) and the model (model.c) exchange. The parent reads the
 * lists of names here. */

#define RECORDED 1024 /* calls of femGrainsContactIterate in an answer, at most */

typedef struct {
    int n, iter, times; /* iter < 0: femGrainsUpdate; times: calls from the same state, of which the last is answered */
    double dt, tol, iterMax, radiusIn, radiusOut, gravity[2], gamma;
} Request; /* the arrays of femGrains follow, in the order of the struct */

/* Kinds of answers; after ANSWERED follow the same arrays, x, y, vx, vy at the first call, and the calls. */
enum { ANSWERED, CALLED, CRASHED, OUTSIDE, CHANGED, TOO_LONG };
enum { FILES, PROCESSES, NETWORK, MEMORY, ABORT, TERMINAL, WAITING, SIGNALS, OTHER };

/* Bits of the first answer. MAIN, UNGUARDED: a library defines main, or a function that its marker leaves out. */
enum { CONFINED, UPDATES, ITERATES, MAIN, UNGUARDED };

typedef struct {
    int kind;
    int what;  /* CALLED: the second list; CRASHED: the signal; OUTSIDE: the array, in the struct's order */
    int where; /* CALLED: number of the system call; OUTSIDE: the index */
    int calls; /* of femGrainsContactIterate */
    double zeta;
} Header;

typedef struct {
    double iter, dt, zeta;
} Call;
