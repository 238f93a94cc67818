/* The segment of pmacd, layout version 1 (docs/segment.md), for C11 on a 64-bit machine. Written from that page alone.
 *
 * Every word of the header and of a region entry is read by atomic_load_explicit(…, memory_order_relaxed). */
#ifndef PMAC_SEGMENT_H
#define PMAC_SEGMENT_H

#include <assert.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

typedef const _Atomic uint64_t pmac_word;

enum pmac_region_id {
    PMAC_SERVO = 1, PMAC_BACKGROUND = 2, PMAC_BOARD = 3, PMAC_PANEL = 4, PMAC_VARIABLES = 5, PMAC_GATHER = 6,
    PMAC_USER = 7, PMAC_USER_TABLE = 8
};
enum pmac_state { PMAC_INIT = 0, PMAC_LIVE = 1, PMAC_STALE = 2, PMAC_DEAD = 3 };
enum pmac_clock { PMAC_MONOTONIC = 1, PMAC_OWN_CLOCK = 2 };

struct pmac_header {
    pmac_word magic, abi_major, abi_minor, header_length, layout_hash, total_length, byte_order, word_bytes;
    pmac_word state, generation, owner_pid, owner_uid, clock_kind, created_ns, heartbeat_limit_ns, reserved_078;
    pmac_word heartbeat_ns, beats, realtime_offset_ns, realtime_taken_ns, now_ns, reserved_0a8[3];
    pmac_word region_table, region_count, region_stride, counter_table, counter_count, reserved_0e8[3];
};

struct pmac_region {
    pmac_word id, head, slots, slot_count, slot_stride, payload_bytes, first_host_offset, reserved_38;
    pmac_word state, period_ns, stale_after_ns, unread_words, unread_numbers, block_start, block_stride, block_count;
};

struct pmac_slot {
    pmac_word sequence, time_ns, servo_timer, flags_length;
    pmac_word payload[];
};

/* A motor's block of the servo payload, on PMAC and PMAC2. 48-bit registers: Y, then X, 24 bits of each. */
struct pmac_motor {
    uint32_t commanded_position[2], actual_position[2], master_position[2], compensation_position[2];
    uint32_t previous_dac, servo_status, actual_velocity, time_left, handwheel_pointer, spare[2];
};

/* The payload of the board region. */
struct pmac_board {
    uint32_t known, family, motors, coordinate_systems;
    uint64_t servo_period_ps;
    uint32_t i10, servo_report_cycles, servo_report, background_report, motor_mask;
    uint32_t ix07_known, ix08_known, ix09_known, ix60_known, global_words;
    char firmware[16], board_type[64];
    int32_t ix07[32], ix08[32], ix09[32], ix60[32];
    double counts_per_unit[32];
    char names[32][16], units[32][16];
};

#define PMAC_AT(type, field, offset) \
    static_assert(offsetof(struct type, field) == (offset), #type "." #field " lies elsewhere")

PMAC_AT(pmac_header, magic, 0x000);
PMAC_AT(pmac_header, abi_major, 0x008);
PMAC_AT(pmac_header, abi_minor, 0x010);
PMAC_AT(pmac_header, header_length, 0x018);
PMAC_AT(pmac_header, layout_hash, 0x020);
PMAC_AT(pmac_header, total_length, 0x028);
PMAC_AT(pmac_header, byte_order, 0x030);
PMAC_AT(pmac_header, word_bytes, 0x038);
PMAC_AT(pmac_header, state, 0x040);
PMAC_AT(pmac_header, generation, 0x048);
PMAC_AT(pmac_header, owner_pid, 0x050);
PMAC_AT(pmac_header, owner_uid, 0x058);
PMAC_AT(pmac_header, clock_kind, 0x060);
PMAC_AT(pmac_header, created_ns, 0x068);
PMAC_AT(pmac_header, heartbeat_limit_ns, 0x070);
PMAC_AT(pmac_header, heartbeat_ns, 0x080);
PMAC_AT(pmac_header, beats, 0x088);
PMAC_AT(pmac_header, realtime_offset_ns, 0x090);
PMAC_AT(pmac_header, realtime_taken_ns, 0x098);
PMAC_AT(pmac_header, now_ns, 0x0A0);
PMAC_AT(pmac_header, region_table, 0x0C0);
PMAC_AT(pmac_header, region_count, 0x0C8);
PMAC_AT(pmac_header, region_stride, 0x0D0);
PMAC_AT(pmac_header, counter_table, 0x0D8);
PMAC_AT(pmac_header, counter_count, 0x0E0);
static_assert(sizeof(struct pmac_header) == 0x100, "the words behind it are reserved");

PMAC_AT(pmac_region, id, 0x00);
PMAC_AT(pmac_region, head, 0x08);
PMAC_AT(pmac_region, slots, 0x10);
PMAC_AT(pmac_region, slot_count, 0x18);
PMAC_AT(pmac_region, slot_stride, 0x20);
PMAC_AT(pmac_region, payload_bytes, 0x28);
PMAC_AT(pmac_region, first_host_offset, 0x30);
PMAC_AT(pmac_region, state, 0x40);
PMAC_AT(pmac_region, period_ns, 0x48);
PMAC_AT(pmac_region, stale_after_ns, 0x50);
PMAC_AT(pmac_region, unread_words, 0x58);
PMAC_AT(pmac_region, unread_numbers, 0x60);
PMAC_AT(pmac_region, block_start, 0x68);
PMAC_AT(pmac_region, block_stride, 0x70);
PMAC_AT(pmac_region, block_count, 0x78);
static_assert(sizeof(struct pmac_region) == 128, "an entry has at least 128 bytes");

PMAC_AT(pmac_slot, sequence, 0x00);
PMAC_AT(pmac_slot, time_ns, 0x08);
PMAC_AT(pmac_slot, servo_timer, 0x10);
PMAC_AT(pmac_slot, flags_length, 0x18);
PMAC_AT(pmac_slot, payload, 0x20);

PMAC_AT(pmac_motor, commanded_position, 0x00);
PMAC_AT(pmac_motor, actual_position, 0x08);
PMAC_AT(pmac_motor, master_position, 0x10);
PMAC_AT(pmac_motor, compensation_position, 0x18);
PMAC_AT(pmac_motor, previous_dac, 0x20);
PMAC_AT(pmac_motor, servo_status, 0x24);
PMAC_AT(pmac_motor, actual_velocity, 0x28);
PMAC_AT(pmac_motor, time_left, 0x2C);
PMAC_AT(pmac_motor, handwheel_pointer, 0x30);
PMAC_AT(pmac_motor, spare, 0x34);
static_assert(sizeof(struct pmac_motor) == 60, "a block has 30 words");

PMAC_AT(pmac_board, known, 0x000);
PMAC_AT(pmac_board, family, 0x004);
PMAC_AT(pmac_board, motors, 0x008);
PMAC_AT(pmac_board, coordinate_systems, 0x00C);
PMAC_AT(pmac_board, servo_period_ps, 0x010);
PMAC_AT(pmac_board, i10, 0x018);
PMAC_AT(pmac_board, servo_report_cycles, 0x01C);
PMAC_AT(pmac_board, servo_report, 0x020);
PMAC_AT(pmac_board, background_report, 0x024);
PMAC_AT(pmac_board, motor_mask, 0x028);
PMAC_AT(pmac_board, ix07_known, 0x02C);
PMAC_AT(pmac_board, ix08_known, 0x030);
PMAC_AT(pmac_board, ix09_known, 0x034);
PMAC_AT(pmac_board, ix60_known, 0x038);
PMAC_AT(pmac_board, global_words, 0x03C);
PMAC_AT(pmac_board, firmware, 0x040);
PMAC_AT(pmac_board, board_type, 0x050);
PMAC_AT(pmac_board, ix07, 0x090);
PMAC_AT(pmac_board, ix08, 0x110);
PMAC_AT(pmac_board, ix09, 0x190);
PMAC_AT(pmac_board, ix60, 0x210);
PMAC_AT(pmac_board, counts_per_unit, 0x290);
PMAC_AT(pmac_board, names, 0x390);
PMAC_AT(pmac_board, units, 0x590);
static_assert(sizeof(struct pmac_board) <= 1936, "the payload has 1936 bytes");

/* An entry of the user table, from byte 0x10 on: the next is the table's `entry` bytes further on. */
struct pmac_user_word {
    char name[32], unit[16];
    uint32_t host_offset;
    uint16_t place, count;
    uint8_t format, bit, width, is_signed;
    uint32_t guard;
};
PMAC_AT(pmac_user_word, unit, 0x20);
PMAC_AT(pmac_user_word, host_offset, 0x30);
PMAC_AT(pmac_user_word, place, 0x34);
PMAC_AT(pmac_user_word, count, 0x36);
PMAC_AT(pmac_user_word, format, 0x38);
PMAC_AT(pmac_user_word, guard, 0x3C);
static_assert(sizeof(struct pmac_user_word) == 64, "an entry has at least 64 bytes");

#endif
