/* Preloaded: the wall clock of a process is ahead by the nanoseconds that a file says.
 *
 * What waits until an instant of the wall clock waits for that of the shifted clock: such a wait is
 * cut into slices, so that a jump is noticed as it is by the kernel, within SLICE_NS. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define NS_PER_S 1000000000
#define SLICE_NS 20000000
/* instants below are those of the steady clock, which counts from the start of the machine */
#define FIRST_OF_WALL_NS 1000000000000000000

typedef int wait_until(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);

static const volatile int64_t *ahead_ns;
static wait_until *kernel_timedwait;
static int (*kernel_timedlock)(pthread_mutex_t *, const struct timespec *);
static int (*kernel_sem_timedwait)(sem_t *, const struct timespec *);

static int64_t to_ns(struct timespec t)
{
    return (int64_t)t.tv_sec * NS_PER_S + t.tv_nsec;
}

static struct timespec from_ns(int64_t ns)
{
    return (struct timespec){.tv_sec = ns / NS_PER_S, .tv_nsec = ns % NS_PER_S};
}

static int64_t kernel_ns(void)
{
    struct timespec now;
    syscall(SYS_clock_gettime, CLOCK_REALTIME, &now);
    return to_ns(now);
}

__attribute__((constructor)) static void open_file(void)
{
    /* the default version: an older one of glibc 2.2.5 knows another layout of the condition */
    kernel_timedwait = (wait_until *)dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
    if (!kernel_timedwait)
        kernel_timedwait = (wait_until *)dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    kernel_timedlock = dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
    kernel_sem_timedwait = dlsym(RTLD_NEXT, "sem_timedwait");
    const char *name = getenv("JUMPING_CLOCK");
    int file = name ? open(name, O_RDONLY) : -1;
    if (file < 0)
        return;
    void *page = mmap(NULL, sizeof *ahead_ns, PROT_READ, MAP_SHARED, file, 0);
    if (page != MAP_FAILED)
        ahead_ns = page;
    close(file);
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    int code = (int)syscall(SYS_clock_gettime, clock, now);
    if (code == 0 && clock == CLOCK_REALTIME && ahead_ns) {
        *now = from_ns(to_ns(*now) + *ahead_ns);
    }
    return code;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    struct timespec exact;
    int code = clock_gettime(CLOCK_REALTIME, &exact);
    (void)zone;
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return code;
}

time_t time(time_t *now)
{
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (now)
        *now = exact.tv_sec;
    return exact.tv_sec;
}

/* Return where to stop waiting next, in the time of the kernel. */
static struct timespec slice_end(const struct timespec *until)
{
    int64_t end = to_ns(*until) - (ahead_ns ? *ahead_ns : 0);
    int64_t slice = kernel_ns() + SLICE_NS;
    return from_ns(end < slice ? end : slice);
}

/* Tell whether an instant of the shifted clock has come: it may have jumped in the last slice, too. */
static int has_come(const struct timespec *until)
{
    return kernel_ns() + (ahead_ns ? *ahead_ns : 0) >= to_ns(*until);
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex,
                           const struct timespec *until)
{
    if (to_ns(*until) < FIRST_OF_WALL_NS)
        return kernel_timedwait(condition, mutex, until);
    for (;;) {
        struct timespec next = slice_end(until);
        int code = kernel_timedwait(condition, mutex, &next);
        /* no return for nothing between slices: who waits would take the new time, as it cannot from
         * the kernel; a signal between two slices, within microseconds, is lost for that */
        if (code != ETIMEDOUT || has_come(until))
            return code;
    }
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *until)
{
    for (;;) {
        struct timespec next = slice_end(until);
        int code = kernel_timedlock(mutex, &next);
        if (code != ETIMEDOUT || has_come(until))
            return code;
    }
}

int sem_timedwait(sem_t *semaphore, const struct timespec *until)
{
    for (;;) {
        struct timespec next = slice_end(until);
        int code = kernel_sem_timedwait(semaphore, &next);
        if (code == 0 || errno != ETIMEDOUT || has_come(until))
            return code;
    }
}
