/* Messages between the parent (sandbox.py, diagnosis.py) and the sandbox (sandbox.c) or the model (model.c). The parent reads
 * the lists of names from this file. */

#define RECORDED 1024 /* largest number of calls of femGrainsContactIterate in an answer */

typedef struct {
    int n, iter, times; /* iter < 0: femGrainsUpdate; times: number of calls from the same state; the last is answered */
    double dt, tol, iterMax, radiusIn, radiusOut, gravity[2], gamma;
} Request; /* the arrays of femGrains follow, in the order of the struct */

/* Kinds of answers. After ANSWERED follow all arrays; x, y, vx, vy before the first call; and iter, dt, zeta of the calls. */
enum { ANSWERED, CALLED, CRASHED, OUTSIDE, CHANGED, TOO_LONG };
enum { FILES, PROCESSES, NETWORK, MEMORY, ABORT, TERMINAL, WAITING, SIGNALS, OTHER };

/* Bits of the first answer. MAIN: a library defines main. UNGUARDED: it defines a function that a macro should exclude. */
enum { CONFINED, UPDATES, ITERATES, MAIN, UNGUARDED };

typedef struct {
    int kind;
    int what;  /* CALLED: number in the second list; CRASHED: signal; OUTSIDE: number of the array in the struct */
    int where; /* CALLED: number of the system call; OUTSIDE: the index */
    int calls; /* number of calls of femGrainsContactIterate */
    double zeta;
} Header;

typedef struct {
    double iter, dt, zeta;
} Call;
