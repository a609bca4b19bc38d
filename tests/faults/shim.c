/* Loaded before the C library: a file system that refuses locks, and a clock that jumps.
 *
 * FAULT_LOCKS=errno/percent   that share of requests for a lock fails with that error number
 * FAULT_CLOCK=seed            the wall clock is anywhere between 1971 and 2100 at every look
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>

static unsigned long state;

static unsigned long draw(void)
{
    if (!state) {
        const char *seed = getenv("FAULT_SEED");
        state = seed ? strtoul(seed, NULL, 10) * 2654435761UL + 1 : 1;
    }
    state = state * 6364136223846793005UL + 1442695040888963407UL;
    return state >> 33;
}

static int refused(int command, struct flock *lock)
{
    const char *rule = getenv("FAULT_LOCKS");
    int number, percent;
    if (!rule || (command != F_SETLK && command != F_SETLKW) || lock->l_type == F_UNLCK)
        return 0;
    if (sscanf(rule, "%d/%d", &number, &percent) != 2 || (int)(draw() % 100) >= percent)
        return 0;
    errno = number;
    return 1;
}

static int pass(const char *name, int file, int command, void *argument)
{
    int (*real)(int, int, ...) = (int (*)(int, int, ...))dlsym(RTLD_NEXT, name);
    if (refused(command, argument))
        return -1;
    return real(file, command, argument);
}

#define PASS(name)                                        \
    int name(int file, int command, ...)                  \
    {                                                     \
        va_list rest;                                     \
        va_start(rest, command);                          \
        void *argument = va_arg(rest, void *);            \
        va_end(rest);                                     \
        return pass(#name, file, command, argument);      \
    }
PASS(fcntl)
PASS(fcntl64)

static time_t jumped(void)
{
    return 31536000 + (time_t)(draw() % 130) * 31536000;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    static int (*real)(clockid_t, struct timespec *);
    if (!real)
        real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int result = real(clock, now);
    if (getenv("FAULT_CLOCK") && clock == CLOCK_REALTIME)
        now->tv_sec = jumped();
    return result;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    struct timespec time;
    int result = clock_gettime(CLOCK_REALTIME, &time);
    (void)zone;
    now->tv_sec = time.tv_sec;
    now->tv_usec = time.tv_nsec / 1000;
    return result;
}
