"""Homeworks that crash, hang, or do what a homework has no business to do."""

from right_homeworks import PLAIN

_START = "    double zeta = 0.0;\n"


def contact_that(does: str, before: str = "") -> str:
    """Return a homework whose femGrainsContactIterate does something else first."""
    return PLAIN.replace(_START, f"{_START}    {does}\n").replace("\n\n", f"\n\n{before}", 1)


HOSTILE = {
    "an endless loop": ("volatile int go = 1; while (go) zeta += 1.0;", "", "does not end within"),
    "a null pointer": ("*(volatile int *)0 = 1;", "", "reads or writes where there is no memory"),
    "a wrong index": ("dvContacts[n * n] = 1.0;", "", "reads or writes dvContacts[1], which is outside"),
    "10 GB": ("volatile char *p = malloc(10000000000); if (p) p[0] = 1;", "", "takes more memory"),
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
    "much memory bit by bit": ("for (;;) *(volatile char *)malloc(1 << 22) = 1;", "", "takes more memory"),
    "a program": ('system("touch hacked");', "", "such as starting a program"),
    "a secret file": (
        'FILE *f = fopen("/etc/passwd", "r"); if (f) fclose(f);',
        "",
        "opens or changes a file",
    ),
    "a removed file": ('remove("child");', "", "opens or changes a file"),
    "an exit": ("exit(0);", "", "ends the program: exit(0)"),
    "a kill": ("kill(getppid(), 9);", "#include <signal.h>\n#include <unistd.h>\n", "makes system call"),
    "an assertion": ("assert(n < 0);", "#include <assert.h>\n", "aborts"),
    "a changed struct": ("myGrains->n = 0;", "", "changes n, radiusIn"),
    "before main": (
        "",
        '__attribute__((constructor)) void early(void) { fopen("hacked", "w"); }\n',
        "opens or changes a file",
    ),
}
"""What is done, what stands before it, and what is said of it."""
