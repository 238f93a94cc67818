/* Prints ten updates of a board's motors: watch [NAME [SOCKET]]. C of 1989 and stdint.h. */

#include <pmac_dpram.h>
#include <stdio.h>

static int fail(const pmac_error *error)
{
    fprintf(stderr, "watch: %s: %s (%s)\n", pmac_status_name(error->status), error->text, error->cure);
    return 1;
}

int main(int count, char **arguments)
{
    pmac_board *board;
    pmac_updates *updates;
    pmac_snapshot *update;
    pmac_moment moment;
    pmac_motor motor;
    pmac_error error;
    uint64_t lost, missed;
    uint32_t number;
    int left;

    if (pmac_board_open(count > 1 ? arguments[1] : NULL, count > 2 ? arguments[2] : NULL, &board, &error) != PMAC_OK)
        return fail(&error);
    if (pmac_updates_open(board, &updates, &error) != PMAC_OK)
        return fail(&error);
    for (left = 10; left > 0; left--) {
        if (pmac_updates_next(updates, 2000, &update, &error) != PMAC_OK)
            return fail(&error);
        pmac_snapshot_moment(update, &moment, sizeof moment, NULL);
        printf("update %lu:", (unsigned long)moment.sequence);
        for (number = 1; number <= 32; number++) {
            if ((moment.activated_motors >> (number - 1) & 1) == 0)
                continue;
            if (pmac_snapshot_motor(update, number, &motor, sizeof motor, &error) != PMAC_OK)
                return fail(&error);
            printf(" #%u %.1f", (unsigned)number, motor.position);
        }
        printf("\n");
        pmac_snapshot_free(update);
    }
    if (pmac_updates_counts(updates, &lost, &missed, &error) != PMAC_OK)
        return fail(&error);
    printf("lost %lu, missed %lu\n", (unsigned long)lost, (unsigned long)missed);
    pmac_updates_free(updates);
    pmac_board_close(board);
    return 0;
}
