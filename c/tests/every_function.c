/*
 * Calls every function of the library, rightly and wrongly, against a live board:
 *   every_function NAME SOCKET DAEMON
 * DAEMON is the process of pmacd; the last part kills it. The board has the words "count" (one value) and "pair" (two).
 */

#define _GNU_SOURCE
#include <pmac_dpram.h>

#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static int failures;
static pmac_error error;

#define CHECK(condition) check((condition), #condition, __LINE__)
/* The call gives this status. */
#define GIVES(status, call) gives((status), (call), #call, __LINE__)

static void check(int is_right, const char *text, int line)
{
    if (!is_right) {
        fprintf(stderr, "every_function.c:%d: %s\n", line, text);
        failures++;
    }
}

static void gives(pmac_status wanted, pmac_status found, const char *text, int line)
{
    if (wanted != found) {
        fprintf(stderr, "every_function.c:%d: %s: %s instead of %s: %s\n", line, text, pmac_status_name(found),
                pmac_status_name(wanted), error.text);
        failures++;
    }
}

static void pause_ms(long milliseconds)
{
    struct timespec time = {milliseconds / 1000, milliseconds % 1000 * 1000000};
    nanosleep(&time, NULL);
}

/* Motor 1 of a snapshot of now. */
static pmac_motor motor_now(pmac_board *board, uint32_t number)
{
    pmac_snapshot *snapshot = NULL;
    pmac_motor motor;
    memset(&motor, 0, sizeof motor);
    GIVES(PMAC_OK, pmac_snapshot_take(board, PMAC_STALE_OK, &snapshot, &error));
    GIVES(PMAC_OK, pmac_snapshot_motor(snapshot, number, &motor, sizeof motor, &error));
    pmac_snapshot_free(snapshot);
    return motor;
}

/* Waits until all that the tests read is live. */
static void until_live(pmac_board *board)
{
    int look;
    for (look = 0; look < 300; look++) {
        pmac_snapshot *snapshot = NULL;
        pmac_motor motor;
        pmac_moment moment;
        size_t count = 0;
        double values[2];
        pmac_status word = PMAC_STALE;
        memset(&motor, 0, sizeof motor);
        motor.position = NAN;
        memset(&moment, 0, sizeof moment);
        if (pmac_snapshot_take(board, 0, &snapshot, NULL) == PMAC_OK) {
            pmac_snapshot_motor(snapshot, 1, &motor, sizeof motor, NULL);
            pmac_snapshot_moment(snapshot, &moment, sizeof moment, NULL);
            word = pmac_snapshot_word(snapshot, "pair", values, 2, &count, NULL);
        }
        pmac_snapshot_free(snapshot);
        if (!isnan(motor.position) && moment.systems != 0 && word == PMAC_OK)
            return;
        pause_ms(100);
    }
    check(0, "the board is live within 30 s", __LINE__);
}

static void opening(const char *name, const char *socket)
{
    pmac_board *board = (pmac_board *)&board;
    CHECK(strcmp(pmac_version(), "0.1.0") == 0);
    CHECK(strcmp(pmac_status_name(PMAC_GONE), "daemon gone") == 0 && *pmac_status_name(99) == 0);
    GIVES(PMAC_GONE, pmac_board_open("no-such-board", NULL, &board, &error));
    CHECK(board == NULL && error.status == PMAC_GONE && strstr(error.text, "no-such-board") && *error.cure);
    GIVES(PMAC_ARGUMENT, pmac_board_open("../x", NULL, &board, NULL));
    GIVES(PMAC_ARGUMENT, pmac_board_open("\xff", NULL, &board, &error));
    GIVES(PMAC_GONE, pmac_board_open(NULL, "/nowhere/x.sock", &board, &error));
    GIVES(PMAC_ARGUMENT, pmac_board_open(name, NULL, NULL, &error));
    GIVES(PMAC_OK, pmac_board_open(name, socket, &board, &error));
    CHECK(error.status == PMAC_OK && *error.text == 0);
    CHECK(strcmp(pmac_board_name(board), name) == 0 && strcmp(pmac_board_socket(board), socket) == 0);
    pmac_board_close(board);
    GIVES(PMAC_OK, pmac_board_open(NULL, socket, &board, &error));
    CHECK(strcmp(pmac_board_name(board), name) == 0);
    pmac_board_close(board);
    pmac_board_close(NULL);
    CHECK(pmac_board_name(NULL) == NULL && pmac_board_socket(NULL) == NULL);
}

static void facts(pmac_board *board)
{
    pmac_identity identity;
    pmac_motor_label label;
    pmac_word word;
    size_t count = 0;
    GIVES(PMAC_OK, pmac_board_identity(board, &identity, sizeof identity, &error));
    CHECK(strcmp(identity.family, "pmac") == 0 && identity.motors == 8 && identity.coordinate_systems == 8);
    CHECK(identity.servo_period_ns > 1e5 && identity.replay == 0 && *identity.firmware);
    GIVES(PMAC_ARGUMENT, pmac_board_identity(NULL, &identity, sizeof identity, &error));
    GIVES(PMAC_ARGUMENT, pmac_board_identity(board, NULL, sizeof identity, &error));
    GIVES(PMAC_ARGUMENT, pmac_board_identity(board, &identity, 0, &error));
    GIVES(PMAC_ARGUMENT, pmac_board_identity(board, &identity, (size_t)-1, &error));
    /* A program of an earlier header: nothing is written behind its struct. */
    memset(&identity, 'x', sizeof identity);
    GIVES(PMAC_OK, pmac_board_identity(board, &identity, 16, &error));
    CHECK(strcmp(identity.family, "pmac") == 0 && identity.board_type[0] == 'x');
    GIVES(PMAC_OK, pmac_board_motor_label(board, 1, &label, sizeof label, &error));
    CHECK(strcmp(label.name, "theta") == 0 && strcmp(label.unit, "deg") == 0 && label.counts_per_unit == 100.0);
    GIVES(PMAC_ARGUMENT, pmac_board_motor_label(board, 0, &label, sizeof label, &error));
    GIVES(PMAC_ARGUMENT, pmac_board_motor_label(board, 33, &label, sizeof label, &error));
    GIVES(PMAC_OK, pmac_board_word(board, 0, NULL, 0, &count, &error));
    CHECK(count == 2);
    GIVES(PMAC_OK, pmac_board_word(board, 0, &word, sizeof word, NULL, &error));
    CHECK(strcmp(word.name, "count") == 0 && strcmp(word.unit, "part") == 0 && word.count == 1);
    GIVES(PMAC_ARGUMENT, pmac_board_word(board, 2, &word, sizeof word, &count, &error));
    GIVES(PMAC_ARGUMENT, pmac_board_word(board, 0, NULL, 0, NULL, &error));
}

static void moments(pmac_board *board)
{
    pmac_snapshot *snapshot;
    pmac_moment moment;
    pmac_motor motor;
    pmac_system coordinates;
    uint64_t latest, last = 0;
    int32_t is_set;
    double values[2];
    size_t count;
    char roomy[sizeof moment + 64];
    GIVES(PMAC_OK, pmac_board_sequence(board, &latest, &error));
    GIVES(PMAC_OK, pmac_board_wait(board, &latest, 5000, &error));
    GIVES(PMAC_OK, pmac_board_wait(board, NULL, 5000, &error));
    GIVES(PMAC_OK, pmac_board_wait(board, &last, 0, &error));
    last = UINT64_MAX;
    GIVES(PMAC_TIMED_OUT, pmac_board_wait(board, &last, 20, &error));
    CHECK(error.status == PMAC_TIMED_OUT);
    GIVES(PMAC_ARGUMENT, pmac_board_wait(NULL, NULL, 1, &error));
    GIVES(PMAC_ARGUMENT, pmac_board_sequence(board, NULL, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_take(board, 0, NULL, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_take(NULL, 0, &snapshot, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_take(board, 0x80, &snapshot, &error));
    CHECK(snapshot == NULL);
    GIVES(PMAC_OK, pmac_snapshot_take(board, 0, &snapshot, &error));
    GIVES(PMAC_OK, pmac_snapshot_moment(snapshot, &moment, sizeof moment, &error));
    CHECK(moment.sequence >= latest && moment.motors == 0xFF && moment.systems == 0xFF && moment.stale == PMAC_STALE_LIVE);
    CHECK((moment.activated_motors & 1) == 1 && moment.time_ns > 0 && moment.realtime_ns > 0);
    /* A program of a later header: what this library does not know is 0. */
    memset(roomy, 'x', sizeof roomy);
    GIVES(PMAC_OK, pmac_snapshot_moment(snapshot, (pmac_moment *)(void *)roomy, sizeof roomy, &error));
    CHECK(memcmp(roomy, &moment, sizeof moment) == 0 && roomy[sizeof roomy - 1] == 0);
    GIVES(PMAC_OK, pmac_snapshot_motor(snapshot, 1, &motor, sizeof motor, &error));
    CHECK(motor.number == 1 && motor.activated == 1 && !isnan(motor.position) && !isnan(motor.velocity));
    CHECK(motor.known == (PMAC_KNOWN_STATUS_1 | PMAC_KNOWN_STATUS_2 | PMAC_KNOWN_RAW_POSITION));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_motor(snapshot, 9, &motor, sizeof motor, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_motor(snapshot, 1, &motor, 4, &error));
    GIVES(PMAC_OK, pmac_snapshot_system(snapshot, 1, &coordinates, sizeof coordinates, &error));
    CHECK(coordinates.number == 1 && (coordinates.known & PMAC_KNOWN_LINES_REMAINING) && !isnan(coordinates.axis_targets[6]));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_system(snapshot, 99, &coordinates, sizeof coordinates, &error));
    GIVES(PMAC_OK, pmac_snapshot_motor_flag(snapshot, 1, "motor_activated", &is_set, &error));
    CHECK(is_set == 1);
    GIVES(PMAC_ARGUMENT, pmac_snapshot_motor_flag(snapshot, 1, "nonsense", &is_set, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_motor_flag(snapshot, 1, NULL, &is_set, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_motor_flag(snapshot, 1, "motor_activated", NULL, &error));
    GIVES(PMAC_OK, pmac_snapshot_system_flag(snapshot, 1, "running_program", &is_set, &error));
    CHECK(is_set == 0);
    GIVES(PMAC_OK, pmac_snapshot_word(snapshot, "pair", values, 2, &count, &error));
    CHECK(count == 2);
    GIVES(PMAC_ARGUMENT, pmac_snapshot_word(snapshot, "pair", values, 1, &count, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_word(snapshot, "pair", NULL, 2, &count, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_word(snapshot, "none", values, 2, &count, &error));
    GIVES(PMAC_ARGUMENT, pmac_snapshot_moment(NULL, &moment, sizeof moment, &error));
    pmac_snapshot_free(snapshot);
    pmac_snapshot_free(NULL);
}

static void every_update(pmac_board *board)
{
    pmac_updates *updates;
    uint64_t last = 0, lost, missed, counted_lost = 0;
    int taken;
    GIVES(PMAC_OK, pmac_updates_open(board, &updates, &error));
    for (taken = 0; taken < 500; taken++) {
        pmac_snapshot *update;
        pmac_moment moment;
        pmac_status status = pmac_updates_next(updates, 5000, &update, &error);
        GIVES(PMAC_OK, status);
        if (status != PMAC_OK)
            break;
        GIVES(PMAC_OK, pmac_snapshot_moment(update, &moment, sizeof moment, &error));
        CHECK(last == 0 || moment.sequence == last + 1 + moment.lost);
        counted_lost += moment.lost;
        last = moment.sequence;
        pmac_snapshot_free(update);
    }
    GIVES(PMAC_OK, pmac_updates_counts(updates, &lost, &missed, &error));
    CHECK(lost >= counted_lost);
    GIVES(PMAC_ARGUMENT, pmac_updates_counts(updates, NULL, &missed, &error));
    GIVES(PMAC_ARGUMENT, pmac_updates_next(updates, 0, NULL, &error));
    pmac_updates_free(updates);
    GIVES(PMAC_ARGUMENT, pmac_updates_open(NULL, &updates, &error));
    CHECK(updates == NULL);
    pmac_updates_free(NULL);
}

static void commands(pmac_board *board)
{
    const char *const names[] = {"P201", "I122", "P202"};
    const char *const wrong[] = {"P201", "nonsense"};
    pmac_reply *reply;
    double values[3];
    GIVES(PMAC_OK, pmac_command(board, "P201=5 P202=-2.5", 5000, 0, &reply, &error));
    CHECK(pmac_reply_count(reply) == 0 && *pmac_reply_text(reply) == 0 && pmac_reply_line(reply, 0) == NULL);
    pmac_reply_free(reply);
    GIVES(PMAC_OK, pmac_command(board, "P201 P202", 5000, 0, &reply, &error));
    CHECK(pmac_reply_count(reply) == 2 && strcmp(pmac_reply_line(reply, 0), "5") == 0);
    CHECK(strcmp(pmac_reply_text(reply), "5\n-2.5") == 0 && pmac_reply_line(reply, 2) == NULL);
    pmac_reply_free(reply);
    GIVES(PMAC_BOARD, pmac_command(board, "P201 NONSENSE", 5000, 0, &reply, &error));
    CHECK(error.code == 3 && strncmp(error.text, "ERR003", 6) == 0 && strstr(error.cure, "explain"));
    pmac_reply_free(reply);
    GIVES(PMAC_OK, pmac_command(board, "P201", 5000, 0, NULL, NULL));
    GIVES(PMAC_ARGUMENT, pmac_command(board, "", 5000, 0, &reply, &error));
    pmac_reply_free(reply);
    GIVES(PMAC_ARGUMENT, pmac_command(board, NULL, 5000, 0, &reply, &error));
    pmac_reply_free(reply);
    GIVES(PMAC_ARGUMENT, pmac_command(NULL, "P201", 5000, 0, &reply, &error));
    pmac_reply_free(reply);
    GIVES(PMAC_ARGUMENT, pmac_command(board, "P201", 5000, 64, NULL, &error));
    GIVES(PMAC_REFUSED, pmac_command(board, "I58=0", 5000, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_question(board, "I122", 5000, &reply, &error));
    CHECK(pmac_reply_count(reply) == 1);
    pmac_reply_free(reply);
    pmac_reply_free(NULL);
    CHECK(pmac_reply_count(NULL) == 0 && pmac_reply_text(NULL) == NULL && pmac_reply_line(NULL, 0) == NULL);
    /* A line enters the buffer that this process's lines have opened, and no other line does. */
    GIVES(PMAC_OK, pmac_command(board, "CLOSE", 5000, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_command(board, "OPEN PROG 77 CLEAR", 5000, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_command(board, "X1", 5000, 0, NULL, &error));
    CHECK(pmac_question(board, "P201=7", 5000, NULL, &error) != PMAC_OK);
    GIVES(PMAC_OK, pmac_command(board, "CLOSE", 5000, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_control(board, "^A", 0, &reply, &error));
    pmac_reply_free(reply);
    GIVES(PMAC_ARGUMENT, pmac_control(board, "A", 0, NULL, &error));
    GIVES(PMAC_REFUSED, pmac_control(board, "^Z", 0, NULL, &error));

    GIVES(PMAC_OK, pmac_variable_write(board, "P201", 12.25, 5000, &error));
    GIVES(PMAC_ARGUMENT, pmac_variable_write(board, "P201", NAN, 5000, &error));
    GIVES(PMAC_ARGUMENT, pmac_variable_write(board, "J/", 0, 5000, &error));
    GIVES(PMAC_OK, pmac_variables_read(board, names, 3, values, 5000, &error));
    CHECK(values[0] == 12.25 && values[1] > 0 && values[2] == -2.5);
    GIVES(PMAC_ARGUMENT, pmac_variables_read(board, wrong, 2, values, 5000, &error));
    GIVES(PMAC_ARGUMENT, pmac_variables_read(board, NULL, 2, values, 5000, &error));
    GIVES(PMAC_ARGUMENT, pmac_variables_read(board, names, 3, NULL, 5000, &error));
    GIVES(PMAC_OK, pmac_variables_read(board, NULL, 0, NULL, 5000, &error));
}

static void messages(pmac_board *board)
{
    pmac_messages *found;
    pmac_message message;
    GIVES(PMAC_OK, pmac_messages_open(board, &found, &error));
    GIVES(PMAC_TIMED_OUT, pmac_messages_next(found, 10, &message, sizeof message, &error));
    GIVES(PMAC_OK, pmac_command(board, "&1 OPEN PROG 5 CLEAR SEND\"HELLO\" CLOSE", 5000, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_command(board, "&1 #1->X #2->Y", 5000, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_command(board, "&1 B5 R", 5000, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_messages_next(found, 10000, &message, sizeof message, &error));
    CHECK(strcmp(message.text, "HELLO") == 0 && message.kind == 2 && message.time_ns > 0 && message.lost == 0);
    GIVES(PMAC_ARGUMENT, pmac_messages_next(found, 10, NULL, 0, &error));
    GIVES(PMAC_ARGUMENT, pmac_messages_next(NULL, 10, &message, sizeof message, &error));
    pmac_messages_free(found);
    GIVES(PMAC_ARGUMENT, pmac_messages_open(NULL, &found, &error));
    pmac_messages_free(found);
}

/* Stops the jog. On a busy machine the library may have renewed it too late: then it tells so, and the daemon has stopped
 * the motor. Returns whether the jog was held until now. */
static int stopped(pmac_jog *jog)
{
    pmac_status status = pmac_jog_stop(jog, &error);
    if (status == PMAC_REFUSED && strstr(error.text, "not renewed in time") != NULL)
        return 0;
    GIVES(PMAC_OK, status);
    return 1;
}

static void motion(pmac_board *board)
{
    const uint8_t one = 1;
    pmac_jog *jog;
    int32_t is_held;
    int look, was_held;
    GIVES(PMAC_OK, pmac_jog_to(board, 1, 150.5, &error));
    for (look = 0; look < 100 && fabs(motor_now(board, 1).position - 150.5) > 1; look++)
        pause_ms(50);
    CHECK(fabs(motor_now(board, 1).position - 150.5) <= 1);
    CHECK(pmac_jog_to(board, 99, 0, &error) != PMAC_OK);
    GIVES(PMAC_OK, pmac_panel(board, "home", &one, 1, &error));
    GIVES(PMAC_OK, pmac_panel(board, "jog-stop", &one, 1, &error));
    GIVES(PMAC_ARGUMENT, pmac_panel(board, "dance", &one, 1, &error));
    GIVES(PMAC_ARGUMENT, pmac_panel(board, "home", NULL, 1, &error));
    CHECK(pmac_panel(board, "home", &one, 0, &error) != PMAC_OK);
    GIVES(PMAC_ARGUMENT, pmac_jog_begin(board, 1, 0, &jog, &error));
    GIVES(PMAC_OK, pmac_jog_begin(board, 2, -1, &jog, &error));
    pause_ms(400);
    GIVES(PMAC_OK, pmac_jog_is_held(jog, &is_held, &error));
    CHECK(motor_now(board, 2).position < 0);
    was_held = stopped(jog);
    CHECK(was_held <= is_held);
    GIVES(was_held ? PMAC_OK : PMAC_REFUSED, pmac_jog_stop(jog, &error));
    GIVES(PMAC_OK, pmac_jog_is_held(jog, &is_held, &error));
    CHECK(is_held == 0);
    pmac_jog_free(jog);
    GIVES(PMAC_OK, pmac_jog_begin(board, 2, 1, &jog, &error));
    pmac_jog_free(jog);
    GIVES(PMAC_ARGUMENT, pmac_jog_stop(NULL, &error));
    GIVES(PMAC_ARGUMENT, pmac_jog_is_held(NULL, &is_held, &error));
    pmac_jog_free(NULL);
}

static int32_t once(void *asked)
{
    return ++*(int *)asked < 2;
}

/* Waits until no program runs in coordinate system 1. */
static void until_ended(pmac_board *board)
{
    int look;
    int32_t is_set = 1;
    for (look = 0; look < 200 && is_set; look++) {
        pmac_snapshot *snapshot = NULL;
        pause_ms(50);
        /* On a busy machine the data may not be live for a moment. */
        if (pmac_snapshot_take(board, 0, &snapshot, NULL) == PMAC_OK)
            pmac_snapshot_system_flag(snapshot, 1, "running_program", &is_set, NULL);
        pmac_snapshot_free(snapshot);
    }
    CHECK(!is_set);
}

static void sequences(pmac_board *board)
{
    static const char program[] = "LINEAR INC TM50 TA20 TS5\nX100 Y50\nX-100 Y50\n";
    const char *const sources[] = {"servo_timer", "1.actual_position"};
    const char *const wrong[] = {"1.nonsense"};
    pmac_gathered *gathered;
    pmac_gathered_info info;
    pmac_rotary_options options;
    pmac_streamed streamed;
    pmac_reply *warnings;
    static char many[9000];
    int asked = 0, line;
    GIVES(PMAC_OK, pmac_gather(board, sources, 2, 1, 0.2, NULL, NULL, &gathered, &error));
    GIVES(PMAC_OK, pmac_gathered_size(gathered, &info, sizeof info, &error));
    CHECK(info.columns == 2 && info.rows > 300 && info.lost == 0);
    CHECK(strcmp(pmac_gathered_title(gathered, 0), "servo_timer") >= 0 && pmac_gathered_title(gathered, 2) == NULL);
    CHECK(pmac_gathered_values(gathered)[2] == pmac_gathered_values(gathered)[0] + 1);
    CHECK(pmac_gathered_times(gathered)[0] == 0 && pmac_gathered_times(gathered)[info.rows - 1] > 0.15);
    pmac_gathered_free(gathered);
    pmac_gathered_free(NULL);
    CHECK(pmac_gathered_values(NULL) == NULL && pmac_gathered_times(NULL) == NULL && pmac_gathered_title(NULL, 0) == NULL);
    GIVES(PMAC_ARGUMENT, pmac_gathered_size(NULL, &info, sizeof info, &error));
    GIVES(PMAC_REFUSED, pmac_gather(board, wrong, 1, 1, 0.1, NULL, NULL, &gathered, &error));
    CHECK(gathered == NULL && strstr(error.text, "nonsense"));
    GIVES(PMAC_ARGUMENT, pmac_gather(board, sources, 2, 1, -1, NULL, NULL, &gathered, &error));
    GIVES(PMAC_ARGUMENT, pmac_gather(board, sources, (size_t)-1, 1, 1, NULL, NULL, &gathered, &error));
    GIVES(PMAC_HALTED, pmac_gather(board, sources, 2, 1, 600, once, &asked, &gathered, &error));
    CHECK(asked == 2);

    memset(&options, 0, sizeof options);
    options.coordinate_system = 1;
    options.define_longs = 1000;
    options.flags = PMAC_ROTARY_RUN | PMAC_ROTARY_CLEAR;
    options.timeout_ms = 10000;
    GIVES(PMAC_OK, pmac_command(board, "&1 #1->X #2->Y", 5000, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_rotary(board, "zigzag", (const uint8_t *)program, strlen(program), &options, sizeof options, NULL,
                               NULL, &streamed, sizeof streamed, &warnings, &error));
    CHECK(streamed.lines == 3 && streamed.commands >= 3 && pmac_reply_count(warnings) == 0);
    pmac_reply_free(warnings);
    GIVES(PMAC_OK, pmac_command(board, "&1Q", 5000, 0, NULL, &error));
    until_ended(board);
    /* Of more lines than both buffers hold the board takes no more; a time-out of 0 is a minute and no immediate end. */
    for (line = 0; line < (int)sizeof many / 3; line++)
        memcpy(many + 3 * line, "X1\n", 3);
    options.define_longs = 0;
    options.flags = PMAC_ROTARY_CLEAR;
    options.timeout_ms = 0;
    asked = 0;
    GIVES(PMAC_HALTED, pmac_rotary(board, "many", (const uint8_t *)many, sizeof many, &options, sizeof options, once, &asked,
                                   NULL, 0, NULL, &error));
    CHECK(asked == 2);
    GIVES(PMAC_REFUSED, pmac_rotary(board, "wrong", (const uint8_t *)"IF (P1>2)", 9, &options, sizeof options, NULL, NULL,
                                    &streamed, sizeof streamed, NULL, &error));
    CHECK(strncmp(error.text, "wrong:1:1:", 10) == 0);
    options.flags = PMAC_ROTARY_CONTINUE | PMAC_ROTARY_CLEAR;
    GIVES(PMAC_ARGUMENT, pmac_rotary(board, "x", (const uint8_t *)"X1", 2, &options, sizeof options, NULL, NULL, NULL, 0,
                                     NULL, &error));
    options.flags = 0;
    options.coordinate_system = 9;
    GIVES(PMAC_REFUSED, pmac_rotary(board, "x", (const uint8_t *)"X1", 2, &options, sizeof options, NULL, NULL, NULL, 0,
                                    NULL, &error));
    GIVES(PMAC_ARGUMENT, pmac_rotary(board, "x", NULL, 2, &options, sizeof options, NULL, NULL, NULL, 0, NULL, &error));
    GIVES(PMAC_ARGUMENT, pmac_rotary(board, "x", (const uint8_t *)"X1", 2, NULL, 0, NULL, NULL, NULL, 0, NULL, &error));
    GIVES(PMAC_OK, pmac_control(board, "^A", 0, NULL, &error));
}

/* Each thread asks for a variable of its own, and takes snapshots: no reply reaches another thread. */
struct caller {
    pthread_t thread;
    pmac_board *board;
    int number, wrong;
};

static void *ask(void *argument)
{
    struct caller *caller = argument;
    char name[16];
    int asked;
    snprintf(name, sizeof name, "P%d", 300 + caller->number);
    for (asked = 0; asked < 40; asked++) {
        const char *const names[] = {name};
        double value = -1;
        pmac_snapshot *snapshot;
        pmac_error own;
        if (pmac_variables_read(caller->board, names, 1, &value, 20000, &own) != PMAC_OK || value != caller->number)
            caller->wrong++;
        if (pmac_snapshot_take(caller->board, PMAC_STALE_OK, &snapshot, &own) != PMAC_OK)
            caller->wrong++;
        pmac_snapshot_free(snapshot);
    }
    return NULL;
}

static void threads(pmac_board *board)
{
    struct caller callers[4];
    int number;
    for (number = 0; number < 4; number++) {
        char name[16];
        snprintf(name, sizeof name, "P%d", 300 + number);
        GIVES(PMAC_OK, pmac_variable_write(board, name, number, 5000, &error));
        callers[number] = (struct caller){.board = board, .number = number};
    }
    for (number = 0; number < 4; number++)
        pthread_create(&callers[number].thread, NULL, ask, &callers[number]);
    for (number = 0; number < 4; number++) {
        pthread_join(callers[number].thread, NULL);
        CHECK(callers[number].wrong == 0);
    }
}

#ifndef __SANITIZE_ADDRESS__
static int forked;

/* Takes updates as long as the parent forks. */
static void *take_updates(void *updates)
{
    while (!__atomic_load_n(&forked, __ATOMIC_SEQ_CST)) {
        pmac_snapshot *update;
        pmac_updates_next(updates, 1000, &update, NULL);
        pmac_snapshot_free(update);
    }
    return NULL;
}

/* A child goes on with boards and updates over its own connections, whatever the parent's threads hold. */
static void forks(pmac_board *board)
{
    const char *const names[] = {"P301"};
    pmac_updates *updates;
    pmac_messages *found;
    pmac_jog *jog;
    pthread_t taking;
    double value;
    int round, status;
    GIVES(PMAC_OK, pmac_updates_open(board, &updates, &error));
    GIVES(PMAC_OK, pmac_messages_open(board, &found, &error));
    GIVES(PMAC_OK, pmac_jog_begin(board, 1, 1, &jog, &error));
    pthread_create(&taking, NULL, take_updates, updates);
    for (round = 0; round < 5; round++) {
        pid_t child = fork();
        if (child == 0) {
            pmac_message message;
            pmac_snapshot *update;
            int32_t is_held;
            failures = 0;
            alarm(30);
            GIVES(PMAC_OK, pmac_variables_read(board, names, 1, &value, 10000, &error));
            CHECK(value == 1);
            GIVES(PMAC_OK, pmac_updates_next(updates, 10000, &update, &error));
            pmac_snapshot_free(update);
            GIVES(PMAC_OTHER_PROCESS, pmac_messages_next(found, 10, &message, sizeof message, &error));
            GIVES(PMAC_OTHER_PROCESS, pmac_jog_is_held(jog, &is_held, &error));
            GIVES(PMAC_OTHER_PROCESS, pmac_jog_stop(jog, &error));
            pmac_jog_free(jog);
            pmac_messages_free(found);
            pmac_updates_free(updates);
            pmac_board_close(board);
            /* No exit: what the parent's threads had in their hands here is no leak of the child. */
            raise(failures ? SIGUSR2 : SIGUSR1);
        }
        GIVES(PMAC_OK, pmac_variables_read(board, names, 1, &value, 10000, &error));
        waitpid(child, &status, 0);
        CHECK(WIFSIGNALED(status) && WTERMSIG(status) == SIGUSR1);
    }
    __atomic_store_n(&forked, 1, __ATOMIC_SEQ_CST);
    pthread_join(taking, NULL);
    /* The child's end has not ended the parent's jog. */
    stopped(jog);
    pmac_jog_free(jog);
    pmac_messages_free(found);
    pmac_updates_free(updates);
}

#endif

struct killer {
    pmac_board *board;
    pid_t daemon;
    pmac_jog *jog;
};

/* Begins a jog, kills the daemon, and ends the stream. */
static int32_t killed(void *context)
{
    struct killer *killer = context;
    GIVES(PMAC_OK, pmac_jog_begin(killer->board, 1, 1, &killer->jog, &error));
    kill(killer->daemon, SIGKILL);
    return 0;
}

struct stopper {
    pthread_t thread;
    pmac_jog *jog;
    pmac_status status;
};

static void *stop(void *argument)
{
    struct stopper *stopper = argument;
    stopper->status = pmac_jog_stop(stopper->jog, NULL);
    return NULL;
}

static void without_daemon(pmac_board *board, pid_t daemon)
{
    const char *const names[] = {"P301"};
    const char *const sources[] = {"servo_timer"};
    pmac_updates *updates;
    pmac_messages *found;
    pmac_message message;
    pmac_snapshot *snapshot;
    pmac_moment moment;
    pmac_jog *jog;
    pmac_gathered *gathered;
    struct stopper stoppers[2];
    pmac_rotary_options options;
    struct killer killer = {.board = board, .daemon = daemon};
    double value;
    int32_t is_held;
    int look, number;
    GIVES(PMAC_OK, pmac_updates_open(board, &updates, &error));
    GIVES(PMAC_OK, pmac_messages_open(board, &found, &error));
    memset(&options, 0, sizeof options);
    options.coordinate_system = 1;
    options.flags = PMAC_ROTARY_CLEAR;
    GIVES(PMAC_STOP_FAILED, pmac_rotary(board, "x", (const uint8_t *)"X1", 2, &options, sizeof options, killed, &killer, NULL,
                                        0, NULL, &error));
    CHECK(strstr(error.text, "the program may run on") != NULL);
    /* Of two threads that stop the jog, neither hears that it stands; nor does a later call. */
    for (number = 0; number < 2; number++) {
        stoppers[number] = (struct stopper){.jog = killer.jog, .status = PMAC_OK};
        pthread_create(&stoppers[number].thread, NULL, stop, &stoppers[number]);
    }
    for (number = 0; number < 2; number++) {
        pthread_join(stoppers[number].thread, NULL);
        CHECK(stoppers[number].status == PMAC_STOP_FAILED);
    }
    GIVES(PMAC_STOP_FAILED, pmac_jog_stop(killer.jog, &error));
    CHECK(strstr(error.text, "may be moving") != NULL);
    GIVES(PMAC_OK, pmac_jog_is_held(killer.jog, &is_held, &error));
    CHECK(is_held == 0);
    pmac_jog_free(killer.jog);
    GIVES(PMAC_GONE, pmac_messages_next(found, 5000, &message, sizeof message, &error));
    GIVES(PMAC_GONE, pmac_messages_next(found, 5000, &message, sizeof message, &error));
    pmac_messages_free(found);
    /* First come those that lie in the ring. */
    for (look = 0; look < 100000; look++) {
        pmac_status status = pmac_updates_next(updates, 200, &snapshot, &error);
        pmac_snapshot_free(snapshot);
        if (status == PMAC_GONE)
            break;
    }
    CHECK(look < 100000);
    pmac_updates_free(updates);
    GIVES(PMAC_GONE, pmac_snapshot_take(board, 0, &snapshot, &error));
    GIVES(PMAC_OK, pmac_snapshot_take(board, PMAC_STALE_OK, &snapshot, &error));
    GIVES(PMAC_OK, pmac_snapshot_moment(snapshot, &moment, sizeof moment, &error));
    CHECK(moment.stale == PMAC_STALE_DAEMON_GONE);
    pmac_snapshot_free(snapshot);
    GIVES(PMAC_TIMED_OUT, pmac_board_wait(board, NULL, 300, &error));
    GIVES(PMAC_GONE, pmac_variables_read(board, names, 1, &value, 1000, &error));
    GIVES(PMAC_GONE, pmac_command(board, "P1", 1000, 0, NULL, &error));
    CHECK(strstr(error.cure, "pmacd") != NULL);
    GIVES(PMAC_GONE, pmac_control(board, "^A", 0, NULL, &error));
    GIVES(PMAC_GONE, pmac_jog_begin(board, 1, 1, &jog, &error));
    GIVES(PMAC_GONE, pmac_gather(board, sources, 1, 1, 0.1, NULL, NULL, &gathered, &error));
    GIVES(PMAC_GONE, pmac_messages_open(board, &found, &error));
}

int main(int count, char **arguments)
{
    pmac_board *board;
    if (count != 4) {
        fprintf(stderr, "write: every_function NAME SOCKET DAEMON\n");
        return 2;
    }
    opening(arguments[1], arguments[2]);
    GIVES(PMAC_OK, pmac_board_open(arguments[1], arguments[2], &board, &error));
    until_live(board);
    facts(board);
    moments(board);
    every_update(board);
    commands(board);
    messages(board);
    motion(board);
    sequences(board);
    threads(board);
    /* A child of a program with threads hangs in gcc 12's address sanitizer: its allocator keeps a lock of theirs. */
#ifndef __SANITIZE_ADDRESS__
    forks(board);
#endif
    without_daemon(board, atoi(arguments[3]));
    pmac_board_close(board);
    return failures != 0;
}
