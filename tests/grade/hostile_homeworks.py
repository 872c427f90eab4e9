"""Homeworks that crash, hang, or do what a homework has no business to do."""

from right_homeworks import PLAIN

from warpgrains.reference.reference import SOURCE

_START = "    double zeta = 0.0;\n"


def contact_that(does, before=""):
    """Return a homework whose femGrainsContactIterate does something else first."""
    return PLAIN.replace(_START, f"{_START}    {does}\n").replace("\n\n", f"\n\n{before}", 1)


def reading(attribute, path="/etc/passwd"):
    """Return a function that prints a file without the C library, which resolvers cannot call yet."""
    return f"""
static __attribute__(({attribute})) void read_it(void) {{
    static char text[4096];
#ifdef __x86_64__
#define CALL(result, number, a, b, c) \\
    __asm__ volatile("syscall" : "=a"(result) : "0"(number), "D"(a), "S"(b), "d"(c) : "rcx", "r11", "memory")
    long file, length;
    CALL(file, 2L, "{path}", 0L, 0L);
    CALL(length, 0L, file, text, 4095L);
    CALL(file, 1L, 1L, text, length);
#else
    fopen("{path}", "r");
#endif
}}
"""


HOSTILE = {
    "an endless loop": ("volatile int go = 1; while (go) zeta += 1.0;", "", "does not end within"),
    "a wrong index": ("dvContacts[n * n] = 1.0;", "", "reads or writes dvContacts[1], which is outside"),
    "a null pointer": ("*(volatile int *)0 = 1;", "", "reads or writes outside of its memory"),
    "10 GB": ("volatile char *p = malloc(10000000000); if (p) p[0] = 1;", "", "uses more memory"),
    "a fork bomb": ("for (;;) fork();", "#include <unistd.h>\n", "starts a process or a thread"),
    "a file": ('FILE *f = fopen("hacked", "w"); if (f) fclose(f);', "", "opens or changes a file"),
    "a network": ("socket(2, 1, 0);", "#include <sys/socket.h>\n", "opens a network connection"),
    "a gigabyte printed": (
        'for (i = 0; i < 1 << 20; i++) printf("%1024d", i);',
        "",
        "prints more than a megabyte",
    ),
    "an endless recursion": (
        "zeta = forever(iter);",
        "double forever(int k) { volatile double a[64]; a[k & 63] = k; return forever(k + 1) + a[1]; }\n",
        "crashes",
    ),
    "an index below 0": ("x[-1] = 1.0;", "", "reads or writes x[-1], which is outside"),
    "memory freed twice": ("char *volatile p = malloc(64); free(p); free(p);", "", "aborts"),
    "a whole number by zero": (
        "volatile int zero = 0; zeta = n / zero;",
        "",
        "divides a whole number by zero",
    ),
    "much memory bit by bit": ("for (;;) *(volatile char *)malloc(1 << 22) = 1;", "", "uses more memory"),
    "a program": ('system("touch hacked");', "", "such as starting a program"),
    "a secret file": (
        'FILE *f = fopen("/etc/passwd", "r"); if (f) fclose(f);',
        "",
        "opens or changes a file",
    ),
    "a removed file": ('remove("child");', "", "opens or changes a file"),
    "an exit": ("exit(0);", "", "ends the program: exit(0)"),
    "a kill": ("kill(getppid(), 9);", "#include <signal.h>\n#include <unistd.h>\n", "makes system call"),
    "a kill of itself": (
        "kill(getpid(), 9);",
        "#include <signal.h>\n#include <unistd.h>\n",
        "sends a signal (kill)",
    ),
    "a key press": ("getchar();", "", "reads the keyboard or asks for a terminal (getchar"),
    "a sleep": ("sleep(1);", "#include <unistd.h>\n", "waits (sleep"),
    "an assertion": ("assert(n < 0);", "#include <assert.h>\n", "aborts"),
    "a changed struct": ("myGrains->n = 0;", "", "changes n, radiusIn"),
    "a look for a file": ('access("/etc/passwd", 0);', "#include <unistd.h>\n", "opens or changes a file"),
    "before main": (
        "",
        '__attribute__((constructor)) void early(void) { fopen("hacked", "w"); }\n',
        "opens or changes a file",
    ),
    "before main, without end": (
        "",
        "__attribute__((constructor)) void stay(void) { volatile int go = 1; while (go); }\n",
        "an endless loop (when it is loaded, before any call)",
    ),
    "before main, by reading": ("", reading("constructor"), "opens or changes a file"),
    "before main, by a section": (
        "",
        reading("used")
        + 'static void (*first)(void) __attribute__((section(".init_array"), used)) = read_it;\n',
        "opens or changes a file",
    ),
    "before main, by a resolver": (
        "",
        reading("used") + "static void nothing(void) {}\n"
        "static void (*resolve(void))(void) { read_it(); return nothing; }\n"
        'void resolved(void) __attribute__((ifunc("resolve")));\nvoid (*address)(void) = resolved;\n',
        "opens or changes a file",
    ),
}
"""What is done, what stands before it, and what is said of it."""

_SAYS = "\n__attribute__((constructor)) static void say(void) { puts(stolen); }\n"

SNOOPING = {
    "a path": 'static const char *stolen =\n#include "PATH"\n;' + _SAYS,
    "a path in angles": "static const char *stolen =\n#include <PATH>\n;" + _SAYS,
    "a macro": '#define FILE_NAME "PATH"\nstatic const char *stolen =\n#include FILE_NAME\n;' + _SAYS,
    "folders above": 'static const char *stolen =\n#include "../../../../../../../../..PATH"\n;' + _SAYS,
    "a message": '# 1 "PATH"\nint wrong = nothing;\n',
    "an assembler's file": '__asm__(".data\\nstolen: .incbin \\"PATH\\"\\n.byte 0\\n.text");\n'
    "extern const char stolen[];" + _SAYS,
    "an assembler's macro": '__asm__(".macro copy a b\\n.\\\\a\\\\b \\"PATH\\"\\n.endm\\n'
    '.data\\nstolen: copy inc bin\\n.byte 0\\n.text");\nextern const char stolen[];' + _SAYS,
    "a section's name": '__attribute__((section(".data\\nstolen: .incbin \\"PATH\\"\\n.byte 0\\n.data#")))'
    " int placed = 1;\nextern const char stolen[];" + _SAYS,
    "a constructor": reading("constructor", "PATH"),
}
"""Ways of showing what is in another file, if it is a string of C."""

CHEATING = {
    "the reference": "#define REFERENCE\n#include <grains.c>\n",
    "the reference in quotes": '#define REFERENCE\n#include "grains.c"\n',
    "the reference above": '#define REFERENCE\n#include "../grains.c"\n',
    "the reference by its path": f'#include "{SOURCE}"\n',
    "the reference beside": "#include <../reference/grains.c>\n",
}

WAITS = """
#include <linux/futex.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
static void wait_for(double seconds) {
    static int word;
    struct timespec most = {(time_t)seconds, (long)(1e9 * (seconds - (time_t)seconds))};
    syscall(SYS_futex, &word, FUTEX_WAIT, 0, &most, 0, 0);
}
static void tell(const char *text, long bytes) { for (int i = 3; i < 32; i++) write(i, text, bytes); }
"""

SLOW_TO_ANSWER = {
    "it waits": ("for (;;) wait_for(1.0);", WAITS),
    "a byte now and then": ('for (;;) { tell("", 1); wait_for(0.2); }', WAITS),
    "a full pipe": (
        "",
        f"{WAITS}static int forged[1 << 17];\n"  # the first answer, again and again
        "__attribute__((constructor)) static void fill(void) {\n"
        "    for (int k = 1; k < 1 << 17; k += 6) forged[k] = 7;\n"
        "    tell((char *)forged, sizeof forged);\n}\n",
    ),
}
"""What keeps the grader waiting, and what stands before it."""
