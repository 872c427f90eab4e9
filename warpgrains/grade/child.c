/* The process in which a homework runs: what it is asked for is one call, what it answers what the call did.
 *
 *     child REQUESTS ANSWERS UPDATE.so CONTACT.so UPDATE CONTACT BYTES SECONDS
 *
 * REQUESTS and ANSWERS are descriptors of pipes, UPDATE and CONTACT names of the functions. It knows of no expected result, and of one request at a time:
 * the process that asks has to judge. */

#define _GNU_SOURCE

#include <dlfcn.h>
#include <unistd.h>

#include "child.h"
#include "grains.h"

#define MOST_CALLS 1024 /* whose records are answered */
#define CPU_SECONDS 20 /* in all */

/* The first answer: what there is. MAIN, UNGUARDED: a library defines main, or a function that its marker leaves out. */
enum { CONFINED = 1, UPDATES = 2, ITERATES = 4, MAIN = 8, UNGUARDED = 16 };

typedef struct {
    int n, iter; /* iter < 0: femGrainsUpdate */
    double dt, tol, iterMax, radiusIn, radiusOut, gravity[2], gamma;
} Request;

typedef struct {
    double iter, dt, zeta;
} Call;

static int requests, answers;
static void (*update)(femGrains *, double, double, double);
static double (*iterate)(femGrains *, double, int);

static femGrains grains;
static double *before; /* x, y, vx, vy as the first call of femGrainsContactIterate finds them */
static Call record[MOST_CALLS];
static int calls;

static void say(const void *what, size_t bytes) {
    for (const char *next = what; bytes > 0;) {
        ssize_t written = write(answers, next, bytes);
        if (written <= 0) _exit(1);
        next += written;
        bytes -= written;
    }
}

static int hear(void *what, size_t bytes) {
    for (char *next = what; bytes > 0;) {
        ssize_t got = read(requests, next, bytes);
        if (got <= 0) return 0;
        next += got;
        bytes -= got;
    }
    return 1;
}

void end(int kind, int what, int where) {
    Answer answer = {kind, what, where, calls, 0.0};
    say(&answer, sizeof answer);
    _exit(0);
}

/* What a homework calls by this name: the function of CONTACT.so, and a record of the call. */
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter) {
    if (calls == 0) {
        double *arrays[] = {grains.x, grains.y, grains.vx, grains.vy};
        for (int k = 0; k < 4; k++) memcpy(before + k * grains.n, arrays[k], grains.n * sizeof(double));
    }
    int call = calls++;
    double zeta = iterate(myGrains, dt, iter);
    if (call < MOST_CALLS) record[call] = (Call){iter, dt, zeta};
    return zeta;
}

static void *load(const char *path) {
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) fprintf(stderr, "%s\n", dlerror());
    return library;
}

/* A function that a library defines itself; NULL if there is none. */
static void *find(void *library, const char *path, const char *name) {
    if (!library) return NULL;
    Dl_info where;
    void *function = dlsym(library, name);
    return function && dladdr(function, &where) && strcmp(where.dli_fname, path) == 0 ? function : NULL;
}

static int answerRequest(double seconds) {
    Request request;
    if (!hear(&request, sizeof request)) return 0;
    size_t n = request.n, bytes = n * sizeof(double);
    const size_t lengths[ARRAYS] = {n, n, n, n, n, n, n, n * (n - 1) / 2};
    double *arrays[ARRAYS];
    placeArrays(lengths, arrays);
    for (int k = 0; k < ARRAYS; k++)
        if (!hear(arrays[k], lengths[k] * sizeof(double))) return 0;
    before = realloc(before, 4 * bytes);
    memset(before, 0, 4 * bytes);
    memset(&grains, 0, sizeof grains);
    grains.n = request.n;
    grains.radiusIn = request.radiusIn;
    grains.radiusOut = request.radiusOut;
    memcpy(grains.gravity, request.gravity, sizeof grains.gravity);
    grains.gamma = request.gamma;
    double **fields[ARRAYS] = {&grains.x, &grains.y, &grains.vx,         &grains.vy,
                               &grains.r, &grains.m, &grains.dvBoundary, &grains.dvContacts};
    for (int k = 0; k < ARRAYS; k++) *fields[k] = arrays[k];
    femGrains given;
    memcpy(&given, &grains, sizeof grains);
    calls = 0;
    Answer answer = {ANSWERED, 0, 0, 0, 0.0};
    startClock(seconds);
    if (request.iter < 0)
        update(&grains, request.dt, request.tol, request.iterMax);
    else
        answer.zeta = iterate(&grains, request.dt, request.iter);
    startClock(0.0);
    fflush(stdout);
    int index, array = findWritten(&index);
    if (array >= 0) end(OUTSIDE, array, index);
    if (memcmp(&given, &grains, sizeof given) != 0) end(CHANGED, 0, 0);
    answer.calls = calls;
    say(&answer, sizeof answer);
    for (int k = 0; k < ARRAYS; k++) say(arrays[k], lengths[k] * sizeof(double));
    say(before, 4 * bytes);
    say(record, (calls < MOST_CALLS ? calls : MOST_CALLS) * sizeof(Call));
    return 1;
}

int main(int count, char **words) {
    if (count != 9) return 1;
    requests = atoi(words[1]);
    answers = atoi(words[2]);
    double seconds = atof(words[8]);
    const char *updates = words[3], *iterates = words[4];
    prepareFile(updates);
    prepareFile(iterates);
    int has = confine(strtoull(words[7], NULL, 10), CPU_SECONDS) ? CONFINED : 0;
    startClock(seconds);
    void *ofUpdate = load(updates), *ofContact = load(iterates);
    startClock(0.0);
    update = (void (*)(femGrains *, double, double, double))find(ofUpdate, updates, words[5]);
    iterate = (double (*)(femGrains *, double, int))find(ofContact, iterates, words[6]);
    has |= (update ? UPDATES : 0) | (iterate ? ITERATES : 0);
    if (find(ofUpdate, updates, "main") || find(ofContact, iterates, "main")) has |= MAIN;
    if (strcmp(updates, iterates) != 0 && (find(ofUpdate, updates, words[6]) || find(ofContact, iterates, words[5])))
        has |= UNGUARDED;
    Answer hello = {ANSWERED, has, 0, 0, 0.0};
    say(&hello, sizeof hello);
    while (answerRequest(seconds)) {
    }
    return 0;
}
