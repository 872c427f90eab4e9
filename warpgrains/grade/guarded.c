/* Arrays that end where memory ends: the first wrong index behind them is a crash whose address tells it.
 *
 *     [page without access][marks][the array][page without access]
 */

#define _GNU_SOURCE

#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "child.h"

static const uint64_t MARK = 0x7ff8a5a5a5a5a5a5; /* a number that is none */

static struct {
    char *memory; /* the first page without access */
    size_t inside;
    uint64_t *first;
    size_t length;
} placed[ARRAYS];

void placeArrays(const size_t lengths[ARRAYS], double *arrays[ARRAYS]) {
    size_t page = sysconf(_SC_PAGESIZE);
    for (int k = 0; k < ARRAYS; k++) {
        if (!placed[k].memory || placed[k].length != lengths[k]) {
            size_t inside = (lengths[k] * sizeof(double) / page + 1) * page;
            if (placed[k].memory) munmap(placed[k].memory, placed[k].inside + 2 * page);
            char *memory =
                mmap(NULL, inside + 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
            if (memory == MAP_FAILED) end(CALLED, MEMORY, 0);
            mprotect(memory, page, PROT_NONE);
            mprotect(memory + page + inside, page, PROT_NONE);
            placed[k].memory = memory;
            placed[k].inside = inside;
            placed[k].first = (uint64_t *)(memory + page + inside) - lengths[k];
            placed[k].length = lengths[k];
        }
        for (uint64_t *mark = (uint64_t *)(placed[k].memory + page); mark < placed[k].first; mark++)
            *mark = MARK;
        arrays[k] = (double *)placed[k].first;
    }
}

int findArray(const void *address, int *index) {
    size_t page = sysconf(_SC_PAGESIZE);
    for (int k = 0; k < ARRAYS; k++) {
        const char *memory = placed[k].memory, *at = address;
        if (memory && at >= memory && at < memory + placed[k].inside + 2 * page) {
            ptrdiff_t bytes = at - (const char *)placed[k].first;
            *index = (int)((bytes < 0 ? bytes - 7 : bytes) / 8);
            return k;
        }
    }
    return -1;
}

int findWritten(int *index) {
    size_t page = sysconf(_SC_PAGESIZE);
    for (int k = 0; k < ARRAYS; k++) {
        const uint64_t *mark = (uint64_t *)(placed[k].memory + page);
        for (; mark < placed[k].first; mark++)
            if (*mark != MARK) {
                *index = (int)(mark - placed[k].first);
                return k;
            }
    }
    return -1;
}
