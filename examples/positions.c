/* positions PATH: where the motors of a PMAC are, in counts, from the latest servo report. Written from docs/segment.md alone.
 *
 *     cc -std=c11 -O2 -o positions positions.c && ./positions /dev/shm/pmac0
 *
 * Exit status 0: they are live, 1: they are old, 2: they cannot be had. */
#define _GNU_SOURCE
#include "pmac_segment.h"

#include <errno.h>
#include <fcntl.h>
#include <pwd.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define MOST_WORDS 1024

static const unsigned char *segment;

static void give_up(const char *why)
{
    fprintf(stderr, "positions: %s\n", why);
    exit(2);
}

static uint64_t load(pmac_word *word)
{
    return atomic_load_explicit(word, memory_order_relaxed);
}

struct sample {
    uint64_t number, time_ns, servo_timer;
    bool valid;
    size_t length;
    uint64_t payload[MOST_WORDS];
};

static const struct pmac_region *region(uint64_t id)
{
    const struct pmac_header *header = (const void *)segment;
    for (uint64_t index = 0; index < load(&header->region_count); index++) {
        const struct pmac_region *entry =
            (const void *)(segment + load(&header->region_table) + index * load(&header->region_stride));
        if (load(&entry->id) == id)
            return entry;
    }
    give_up("the daemon does not publish this region");
    return NULL;
}

/* The latest sample, copied as the page says. */
static void latest(const struct pmac_region *entry, struct sample *sample)
{
    uint64_t words = (load(&entry->payload_bytes) + 7) / 8;
    if (words > MOST_WORDS)
        give_up("a payload is longer than this program knows");
    for (int attempt = 0; attempt < 16; attempt++) {
        uint64_t number = load((pmac_word *)(segment + load(&entry->head)));
        atomic_thread_fence(memory_order_acquire);
        if (number == 0)
            give_up("there is no sample yet");
        uint64_t place = (number - 1) % load(&entry->slot_count) * load(&entry->slot_stride);
        const struct pmac_slot *slot = (const void *)(segment + load(&entry->slots) + place);
        sample->number = number;
        sample->time_ns = load(&slot->time_ns);
        sample->servo_timer = load(&slot->servo_timer);
        uint64_t flags_length = load(&slot->flags_length);
        for (uint64_t word = 0; word < words; word++)
            sample->payload[word] = load(&slot->payload[word]);
        atomic_thread_fence(memory_order_acquire);
        if (load(&slot->sequence) != 2 * number)
            continue;
        sample->valid = flags_length & 1;
        sample->length = flags_length >> 32;
        if (sample->length > words * 8)
            give_up("a sample is corrupt");
        return;
    }
    give_up("overtaken again and again");
}

static bool is_old(uint64_t now, uint64_t since, uint64_t limit)
{
    /* A time more than a second ahead of now is by another clock. */
    return limit != 0 && (now > since ? now - since > limit : since - now > 1000000000);
}

static int64_t fixed48(const uint32_t halves[2])
{
    uint64_t value = (uint64_t)(halves[1] & 0xFFFFFF) << 24 | (halves[0] & 0xFFFFFF);
    return (int64_t)(value << 16) / 65536;
}

int main(int argc, char **argv)
{
    if (argc != 2)
        give_up("usage: positions /dev/shm/pmac0");
    int file = open(argv[1], O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    struct stat there;
    if (file < 0 || fstat(file, &there) != 0)
        give_up(strerror(errno));
    const struct passwd *pmacd = getpwnam("pmacd");
    bool is_trusted = there.st_uid == 0 || there.st_uid == geteuid() || (pmacd && there.st_uid == pmacd->pw_uid);
    if (!S_ISREG(there.st_mode) || !is_trusted || there.st_mode & 022 || there.st_size < 0x300)
        give_up("this is no segment to be trusted");
    segment = mmap(NULL, (size_t)there.st_size, PROT_READ, MAP_SHARED, file, 0);
    if (segment == MAP_FAILED)
        give_up(strerror(errno));
    const struct pmac_header *header = (const void *)segment;
    uint64_t magic;
    memcpy(&magic, "PMACDPRM", 8);
    if (load(&header->magic) != magic || load(&header->abi_major) != 1 ||
        load(&header->total_length) != (uint64_t)there.st_size || load(&header->byte_order) != 0x0102030405060708 ||
        load(&header->clock_kind) < PMAC_MONOTONIC || load(&header->clock_kind) > PMAC_OWN_CLOCK)
        give_up("this is no segment that this program can read");

    const struct pmac_region *servo = region(PMAC_SERVO);
    static struct sample motors, identity;
    latest(region(PMAC_BOARD), &identity);
    latest(servo, &motors);
    const struct pmac_board *board = (const void *)identity.payload;
    if (board->family != 1 && board->family != 2)
        give_up("the blocks of this family are laid out otherwise");

    const unsigned char *payload = (const void *)motors.payload;
    for (uint64_t number = 1; number <= load(&servo->block_count); number++) {
        uint64_t begin = load(&servo->block_start) + (number - 1) * load(&servo->block_stride);
        if (begin + sizeof(struct pmac_motor) > motors.length)
            break;
        bool is_read = !(load(&servo->unread_numbers) >> (number - 1) & 1) && !(load(&servo->unread_words) >> 4 & 0xF);
        bool is_scaled = board->ix08_known >> (number - 1) & 1 && board->ix08[number - 1] > 0;
        if (!is_read)
            continue;
        struct pmac_motor motor;
        memcpy(&motor, payload + begin, sizeof motor);
        int64_t raw = fixed48(motor.actual_position);
        if (is_scaled)
            printf("%d %.5f\n", (int)number, (double)raw / (board->ix08[number - 1] * 32.0));
        else
            printf("%d raw %lld\n", (int)number, (long long)raw);
    }

    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    uint64_t now = load(&header->clock_kind) == PMAC_MONOTONIC
        ? (uint64_t)time.tv_sec * 1000000000 + (uint64_t)time.tv_nsec
        : load(&header->now_ns);
    bool is_live = load(&header->state) == PMAC_LIVE && load(&servo->state) == PMAC_LIVE && motors.valid &&
        !is_old(now, load(&header->heartbeat_ns), load(&header->heartbeat_limit_ns)) &&
        !is_old(now, motors.time_ns, load(&servo->stale_after_ns));
    if (!is_live)
        fprintf(stderr, "positions: they are old\n");
    return is_live ? 0 : 1;
}
