/* Where the fields of the status structures lie: the bit of the board's word that each one names. */
#include "check.h"

#define BIT(type, field, number)                         \
    do {                                                 \
        struct type status;                              \
        DWORD words[2] = {0, 0};                         \
        memset(&status, 0, sizeof status);               \
        status.field = 1;                                \
        memcpy(words, &status, sizeof status);           \
        CHECK(words[(number) / 32] == 1u << (number) % 32); \
        CHECK(words[1 - (number) / 32] == 0);            \
    } while (0)

int main(void)
{
    BIT(ss, home_search, 10);
    BIT(ss, desired_vel_0, 13);
    BIT(ss, integration, 16);
    BIT(ss, open_loop, 18);
    BIT(ss, neg_limit, 22);
    BIT(ss, activated, 23);
    BIT(ssTURBO, home_search, 10);
    BIT(ssTURBO, dwelling, 15);
    BIT(ssTURBO, run_program, 17);
    BIT(ssTURBO, amp_enabled, 19);
    BIT(ssTURBO, activated, 23);
    BIT(msTURBO, in_position, 0);
    BIT(msTURBO, amp_fault, 3);
    BIT(msTURBO, home_complete, 10);
    BIT(msTURBO, stopped_on_limit, 11);
    BIT(msTURBO, cs_assigned, 15);
    BIT(msTURBO, coord_sys, 20);
    BIT(gs, buffer_full, 11);
    BIT(gs, dpram_response, 15);
    BIT(gs, plc_buf_open, 17);
    BIT(gs, host_comm_mode, 22);
    BIT(gs, end_gather, 32 + 7);
    BIT(gs, dpram_error, 32 + 11);
    BIT(gs, stimulus_ent, 32 + 16);
    BIT(gs, servo_err, 32 + 20);
    BIT(gs, intr_active, 32 + 23);
    BIT(gsTURBO, plc_buf_open, 17);
    BIT(gsTURBO, bin_rot_buf_open, 20);
    BIT(gsTURBO, ring_error, 32 + 4);
    BIT(gsTURBO, wdt2, 32 + 16);
    BIT(gsTURBO, intr_active, 32 + 23);
    return finish("layout");
}
