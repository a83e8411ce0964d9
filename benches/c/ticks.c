/* A thread that does nothing but wake: whatever is late here, the machine itself held up. */
#ifdef __linux__
#define _GNU_SOURCE
#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <stdint.h>
#include <sys/mman.h>
#include <time.h>

enum { LOST = 10 }; /* so many periods late the clock is set anew, as that of the physics thread is */

static int64_t now(void) {
    struct timespec at;
    clock_gettime(CLOCK_MONOTONIC, &at);
    return at.tv_sec * INT64_C(1000000000) + at.tv_nsec;
}

/* Wake every `period` seconds by absolute deadlines while *going is not 0, at this SCHED_FIFO priority and
 * with locked memory. told (4): ticks, those that began more than half a period after they were due, the
 * latest [ns], the priority granted (-1: none). */
void ticks(int64_t priority, double period, const volatile int64_t *going, int64_t *told) {
    struct sched_param asked = {.sched_priority = (int)priority};
    int refused = pthread_setschedparam(pthread_self(), SCHED_FIFO, &asked);
    told[0] = told[1] = told[2] = 0;
    told[3] = refused ? -1 : priority;
    mlockall(MCL_CURRENT);
    int64_t begin = now(), length = (int64_t)(period * 1e9), n = 0;
    while (*going) {
        int64_t due = begin + (int64_t)(++n * (period * 1e9));
        struct timespec at = {due / 1000000000, due % 1000000000};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, 0) == EINTR) {
        }
        int64_t late = now() - due;
        told[0]++;
        told[1] += late > length / 2;
        if (late > told[2])
            told[2] = late;
        if (late > LOST * length) {
            begin = now();
            n = 0;
        }
    }
    munlockall();
}
#endif
