/* Runs a compiler on an untrusted source, which may ask the compiler to read any file:
 *
 *     fence SECONDS MEMORY OUTPUT FOLDER PATH... -- COMMAND...
 *
 * COMMAND may compute for SECONDS, use MEMORY bytes, and write files of OUTPUT bytes. It can open files in FOLDER, and read
 * the PATHs and all that lies in them. The kernel (Landlock, from Linux 5.13 on) denies permission for all other files.
 * Without such a kernel only the limits hold. Without arguments, the exit code is 0 if the kernel has Landlock, else 1. */

#define _GNU_SOURCE

#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#ifdef __linux__
#if __has_include(<linux/landlock.h>)
#include <linux/landlock.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#define FENCED
#endif
#endif

static void limit(int what, const char *most) {
    rlim_t value = strtoull(most, NULL, 10);
    struct rlimit old;
    getrlimit(what, &old);
    if (old.rlim_max < value) value = old.rlim_max;
    setrlimit(what, &(struct rlimit){value, value});
}

#ifdef FENCED

#define ALL (2 * LANDLOCK_ACCESS_FS_MAKE_SYM - 1) /* all rights of Landlock's first version; MAKE_SYM is the last one */
#define OF_FILES (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_WRITE_FILE)
#define READ (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR)

static int create(void) {
    struct landlock_ruleset_attr handled = {.handled_access_fs = ALL};
    return syscall(SYS_landlock_create_ruleset, &handled, sizeof handled, 0);
}

static int permit(int rules, const char *path, uint64_t rights) {
    struct stat about;
    int file = open(path, O_PATH | O_CLOEXEC);
    if (file < 0) return 1; /* a path that does not exist needs no right */
    if (fstat(file, &about) != 0 || !S_ISDIR(about.st_mode)) rights &= OF_FILES;
    struct landlock_path_beneath_attr rule = {.allowed_access = rights, .parent_fd = file};
    int failed = syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0);
    close(file);
    return !failed;
}

static int restrictTo(const char *folder, char **paths, int count) {
    int rules = create();
    if (rules < 0) return 1;
    int done = permit(rules, folder, ALL);
    for (int k = 0; k < count; k++) done = done && permit(rules, paths[k], READ);
    done = done && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0;
    done = done && syscall(SYS_landlock_restrict_self, rules, 0) == 0;
    close(rules);
    return done;
}

#else

static int create(void) { return -1; }

static int restrictTo(const char *folder, char **paths, int count) {
    (void)folder, (void)paths, (void)count;
    return 1;
}

#endif

int main(int count, char **words) {
    if (count == 1) return create() < 0;
    int end = 5;
    while (end < count && strcmp(words[end], "--") != 0) end++;
    if (end + 1 >= count) return 126;
    limit(RLIMIT_CPU, words[1]);
    limit(RLIMIT_AS, words[2]);
    limit(RLIMIT_FSIZE, words[3]);
    limit(RLIMIT_CORE, "0");
    if (!restrictTo(words[4], words + 5, end - 5)) {
        perror("fence");
        return 126;
    }
    execvp(words[end + 1], words + end + 1);
    perror(words[end + 1]);
    return 127;
}
