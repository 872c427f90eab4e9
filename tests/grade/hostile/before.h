#include <assert.h>
#include <linux/futex.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static void wait_for(double seconds) {
    static int word;
    struct timespec most = {(time_t)seconds, (long)(1e9 * (seconds - (time_t)seconds))};
    syscall(SYS_futex, &word, FUTEX_WAIT, 0, &most, 0, 0);
}

/* Write to all channels that may be open. */
static void tell(const char *text, long bytes) { for (int i = 3; i < 32; i++) write(i, text, bytes); }

#define SAY(text) __attribute__((constructor)) static void say(void) { puts(text); }

/* Print a file without the C library, which resolvers cannot call yet. */
#ifdef __x86_64__
#define CALL(result, number, a, b, c) \
    __asm__ volatile("syscall" : "=a"(result) : "0"(number), "D"(a), "S"(b), "d"(c) : "rcx", "r11", "memory")
#define PRINT(path) \
    static char text[4096]; \
    long file, length; \
    CALL(file, 2L, path, 0L, 0L); \
    CALL(length, 0L, file, text, 4095L); \
    CALL(file, 1L, 1L, text, length)
#else
#define PRINT(path) fopen(path, "r")
#endif
