/* Reads the newest contacts that `skinbus run ARM --share NAME` writes; layout: docs/shared-memory.md.
   cc -O2 -o read_skin read_skin.c && ./read_skin NAME
   Returns 0 for a cycle that may be used, 2 for one of a writer that was stopped, has died or hangs, 1 for what
   is no such memory: only a plain file of this user, of root or of group skinbus is read, and every number of it
   that says where something is, is checked. */
#define _GNU_SOURCE                             /* F_OFD_GETLK */
#include <fcntl.h>
#include <grp.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

typedef struct { uint64_t magic; uint32_t version, state; uint64_t newest, period_ns;
                 uint32_t n_slots, slot_bytes, first_slot, contacts_offset;
                 uint32_t n_links, n_buses, n_patches, n_tactels; char name[64];
                 uint64_t geometry; } header_t;
typedef struct { uint64_t sequence, number; int64_t t_ns, latency_ns;
                 uint32_t counter, level, flags, n_contacts; } cycle_t;
typedef struct { int64_t identity, seen_ns; uint32_t id, link, state, quality, level, has_covariance;
                 double s, a, force, point[3], normal[3], covariance[9]; } contact_t;
enum { VERSION = 3, RUNNING = 1, MAX_CONTACTS = 64, STALE_PERIODS = 3, MAX_BYTES = 16 << 20, TRIES = 1000 };

/* Opens an object without following links or waiting for anybody; returns its size, 0 for what is not trusted. */
static size_t open_trusted(const char *name, int *file)
{
    struct stat s;
    struct group *group = getgrnam("skinbus");
    *file = shm_open(name, O_RDONLY | O_NONBLOCK, 0);   /* which sets O_NOFOLLOW and O_CLOEXEC */
    if (*file < 0 || fstat(*file, &s) < 0)
        return perror(name), 0;
    int is_trusted = s.st_uid == geteuid() || s.st_uid == 0 || (group && s.st_gid == group->gr_gid);
    if (!S_ISREG(s.st_mode) || !is_trusted || s.st_mode & 022)
        return fprintf(stderr, "%s: no plain file, or of user %u\n", name, (unsigned)s.st_uid), 0;
    return s.st_size >= (off_t)sizeof(header_t) && s.st_size <= MAX_BYTES ? (size_t)s.st_size : 0;
}

/* Returns whether all slots of a header are in the memory, and all contacts in their slot. */
static int is_sound(const header_t *h, uint64_t size)
{
    return !memcmp(h, "SKINBUS1", 8) && h->version == VERSION && h->n_slots > 0 && h->slot_bytes % 8 == 0
        && h->first_slot % 8 == 0 && h->first_slot >= sizeof *h && h->contacts_offset % 8 == 0
        && h->contacts_offset >= sizeof(cycle_t)
        && (uint64_t)h->contacts_offset + MAX_CONTACTS * sizeof(contact_t) <= h->slot_bytes
        && h->first_slot + (uint64_t)h->n_slots * h->slot_bytes <= size;
}

/* Copies the newest cycle and its contacts; returns its number, 0 when there is none yet or none is whole. */
static uint64_t latest(const char *memory, const header_t *h, cycle_t *cycle, contact_t *contacts)
{
    const header_t *now = (const header_t *)memory;
    for (int k = 0; k < TRIES; k++) {
        uint64_t n = __atomic_load_n(&now->newest, __ATOMIC_ACQUIRE);
        if (n == 0)
            return 0;
        const char *slot = memory + h->first_slot + n % h->n_slots * (uint64_t)h->slot_bytes;
        const uint64_t *sequence = (const uint64_t *)slot;
        if (__atomic_load_n(sequence, __ATOMIC_ACQUIRE) != 2 * n)
            continue;                           /* written again meanwhile: there is a newer one */
        memcpy(cycle, slot, sizeof *cycle);
        if (cycle->n_contacts > MAX_CONTACTS)
            continue;
        memcpy(contacts, slot + h->contacts_offset, cycle->n_contacts * sizeof *contacts);
        __atomic_thread_fence(__ATOMIC_ACQUIRE);
        if (__atomic_load_n(sequence, __ATOMIC_RELAXED) == 2 * n)
            return n;
    }
    return 0;
}

/* Returns what the writer does; its lock is released when its process ends, however that ends. */
static const char *state_of(const header_t *h, int file, uint64_t n, double age_ms)
{
    struct flock lock = { .l_type = F_RDLCK, .l_whence = SEEK_SET };
    if (h->state != RUNNING)
        return "stopped";
    if (fcntl(file, F_OFD_GETLK, &lock) < 0 || lock.l_type == F_UNLCK)
        return "died";
    if (n == 0)
        return "starting";
    return age_ms > STALE_PERIODS * 1e-6 * h->period_ns ? "stale" : "running";
}

int main(int argc, char **argv)
{
    char name[80];
    snprintf(name, sizeof name, "/skinbus-%s", argc > 1 ? argv[1] : "arm");
    int file;
    size_t size = open_trusted(name, &file);
    if (!size)
        return 1;
    const char *memory = mmap(NULL, size, PROT_READ, MAP_SHARED, file, 0);
    header_t header;                            /* what is checked is what is used */
    if (memory == MAP_FAILED || !is_sound(memcpy(&header, memory, sizeof header), size))
        return fprintf(stderr, "%s: another layout\n", name), 1;

    static cycle_t cycle;
    static contact_t contacts[MAX_CONTACTS];
    struct timespec t;
    uint64_t n = latest(memory, &header, &cycle, contacts);
    clock_gettime(CLOCK_MONOTONIC, &t);
    double age_ms = (t.tv_sec * 1e9 + t.tv_nsec - cycle.t_ns) * 1e-6;
    const char *state = state_of((const header_t *)memory, file, n, age_ms);
    printf("cycle %llu, %.1f ms old, %s\n", (unsigned long long)n, n ? age_ms : -1.0, state);
    for (uint32_t i = 0; n && i < cycle.n_contacts; i++)
        printf("%u %.4f %.4f %.3f\n", contacts[i].id, contacts[i].s, contacts[i].a, contacts[i].force);
    return strcmp(state, "running") ? 2 : 0;
}
