/*
 * pmac_dpram.h: live data and commands of a Delta Tau PMAC motion controller, from pmacd. Link with -lpmac_dpram.
 * The manual page is pmac_dpram(3). tests/header.rs makes this file from the library's source.
 *
 * Every function that can fail returns a pmac_status and, unless `error` is NULL, fills *error: the number, a text, and
 * a cure. pmac_error needs no preparation, and belongs to the caller: so errors of two threads never mix. A new handle
 * is NULL after an error. Every pointer may be NULL, and is then an error or left out; other pointers must be valid.
 *
 * Threads may share every handle; no call of one thread waits for another one's, except calls for the next update, for
 * the next message and for the end of a jog, by one handle. Free a handle when no thread uses it any more.
 *
 * A forked child may go on with boards and updates: it gets connections of its own. Messages, jogs and gathered samples
 * are the parent's: calls with messages and jogs then return PMAC_OTHER_PROCESS.
 *
 * The library has no global state, handles no signal, and never ends the process. Texts are UTF-8.
 *
 * Structs grow at their end: pass sizeof, and an older program goes on with a newer library.
 */

#ifndef PMAC_DPRAM_H
#define PMAC_DPRAM_H

#include <stddef.h>
#include <stdint.h>

/* Start the program when its first lines are there. */
#define PMAC_ROTARY_RUN 1

/* Clear lines that an earlier program has left in the board's rotary buffer. */
#define PMAC_ROTARY_CLEAR 2

/* Run such lines first. */
#define PMAC_ROTARY_CONTINUE 4

/* The data of a snapshot may be old; its moment tells why. */
#define PMAC_STALE_OK 1

/* Also sends a line or control character that ends command lines for everybody, or others' work (`^Z`, `$$$`, `SAVE`). */
#define PMAC_CONFIRMED 1

/* The first status word is known. */
#define PMAC_KNOWN_STATUS_1 1

/* The second status word is known. */
#define PMAC_KNOWN_STATUS_2 2

/* The third status word is known. */
#define PMAC_KNOWN_STATUS_3 4

/* `raw_position` is known. */
#define PMAC_KNOWN_RAW_POSITION 8

/* `lines_remaining` is known. */
#define PMAC_KNOWN_LINES_REMAINING 16

/* How a call ended. A number keeps its meaning; new ones may follow. */
typedef enum {
    /* The library did what the call asks. */
    PMAC_OK = 0,
    /* Nothing came within the time-out. This is no fault: wait again. */
    PMAC_TIMED_OUT = 1,
    /* The call is wrong: NULL, a bad size, or a name, number or line that the board does not have. */
    PMAC_ARGUMENT = 2,
    /* The data are not live; the text says why. */
    PMAC_STALE = 3,
    /* There is no daemon: nothing was carried out. */
    PMAC_GONE = 4,
    /* This process cannot read the board's data. */
    PMAC_UNREADABLE = 5,
    /* The daemon refuses the call and has done nothing. */
    PMAC_REFUSED = 6,
    /* The board refuses the line; the code is the number of its `ERRnnn`. Commands before the refused one have acted. */
    PMAC_BOARD = 7,
    /* The caller lacks a role; the daemon has done nothing. */
    PMAC_NOT_PERMITTED = 8,
    /* Other commands took the board's time; the daemon has sent nothing. */
    PMAC_BUSY = 9,
    /* The board may or may not have carried the command out. */
    PMAC_UNCERTAIN = 10,
    /* A stop did not go as asked: a motor may still move. */
    PMAC_STOP_FAILED = 11,
    /* The handle belongs to the process from which this one was forked. */
    PMAC_OTHER_PROCESS = 12,
    /* The caller's function ended the work. */
    PMAC_HALTED = 13,
    /* A gather or a stream ended early; the text tells how far it came. */
    PMAC_ENDED = 14,
    /* A fault of this library. */
    PMAC_INTERNAL = 15
} pmac_status;

/* Why data are not live. */
typedef enum {
    /* The data are live. */
    PMAC_STALE_LIVE = 0,
    /* The daemon has stopped or was killed. */
    PMAC_STALE_DAEMON_GONE = 1,
    /* The daemon's heartbeat has stopped. */
    PMAC_STALE_DAEMON_STOPPED = 2,
    /* The daemon's times are of another clock than this program's. */
    PMAC_STALE_OTHER_CLOCK = 3,
    /* The daemon is identifying the board. */
    PMAC_STALE_STARTING = 4,
    /* The board does not answer. */
    PMAC_STALE_BOARD_SILENT = 5,
    /* The daemon does not mirror these data. */
    PMAC_STALE_OFF = 6,
    /* The board has stopped updating these data. */
    PMAC_STALE_NO_UPDATES = 7,
    /* The sample is not whole. */
    PMAC_STALE_NOT_WHOLE = 8
} pmac_stale;

/* A board of a running `pmacd`. Threads may share the handle. */
typedef struct pmac_board pmac_board;

/* The samples of a gather. */
typedef struct pmac_gathered pmac_gathered;

/* A jog that lasts as long as its handle. */
typedef struct pmac_jog pmac_jog;

/* The texts that the board's programs send. */
typedef struct pmac_messages pmac_messages;

/* Lines of text. */
typedef struct pmac_reply pmac_reply;

/* The board's data at one moment. Nothing changes in it: threads may share it. */
typedef struct pmac_snapshot pmac_snapshot;

/* Servo updates of the present daemon and its successors. In a forked child they begin anew. */
typedef struct pmac_updates pmac_updates;

/* Why a call failed. This struct never grows. */
typedef struct {
    /* A `pmac_status`. */
    int32_t status;
    /* The number of the board's `ERRnnn`; 0: none. */
    int32_t code;
    /* What failed, and where; cut to the room that it has here. */
    char text[1792];
    /* What the user can do. */
    char cure[248];
} pmac_error;

/* The board, as it has told the daemon. A text is empty, a number 0 and a period NaN if the board has not told it. */
typedef struct {
    /* `pmac`, `pmac2`, `turbo` or `turbo2`. */
    char family[16];
    /* The board's answer to `TYPE`. */
    char board_type[128];
    /* Firmware version, as `1.16D`. */
    char firmware[32];
    /* Servo period in nanoseconds. */
    double servo_period_ns;
    /* Servo cycles from one update to the next. */
    uint32_t servo_report_cycles;
    /* How many motors the board has. */
    uint32_t motors;
    /* How many coordinate systems the board has. */
    uint32_t coordinate_systems;
    /* 1: the daemon replays a recording; nothing moves. */
    uint32_t replay;
} pmac_identity;

/* A motor's name and unit in the daemon's configuration. */
typedef struct {
    /* The name; empty without one. */
    char name[32];
    /* The unit's name, as `deg`; empty without one. */
    char unit[32];
    /* Counts in one unit, negative if the unit grows as the counts fall; 0 without a unit. */
    double counts_per_unit;
} pmac_motor_label;

/* A name that the daemon's configuration gives to words of the site's own programs. */
typedef struct {
    /* The name. */
    char name[64];
    /* The unit; empty without one. */
    char unit[32];
    /* How many values the name has. */
    uint32_t count;
    /* 0. */
    uint32_t reserved;
} pmac_word;

/* The moment of a snapshot or an update. */
typedef struct {
    /* The number of the servo update, from 1; it begins anew with each daemon. */
    uint64_t sequence;
    /* When the daemon read the update: nanoseconds of CLOCK_MONOTONIC. */
    uint64_t time_ns;
    /* The same in nanoseconds since 1970. */
    int64_t realtime_ns;
    /* The update's age when the library took it, in nanoseconds. */
    uint64_t age_ns;
    /* The board's servo counter, in servo cycles. */
    uint64_t servo_timer;
    /* In an update: updates before it that the daemon did not read in time. */
    uint64_t missed;
    /* In an update: updates before it that the daemon overwrote before this program took them. */
    uint64_t lost;
    /* In an update: how long the board or the daemon paused before it, in nanoseconds; no count has updates of that time. */
    uint64_t pause_ns;
    /* The activated motors; bit 0 is motor 1. */
    uint32_t activated_motors;
    /* The reported motors; bit 0 is motor 1. */
    uint32_t motors;
    /* The reported coordinate systems; bit 0 is coordinate system 1. An update has none. */
    uint32_t systems;
    /* A `pmac_stale` of the servo data. */
    uint32_t stale;
    /* A `pmac_stale` of the background data; 0 also without such data. */
    uint32_t background_stale;
    /* 0. */
    uint32_t reserved;
} pmac_moment;

/*
 One motor. Positions are in counts, velocities in counts a second. A number is NaN if the board does not report it,
 or its scale is not known.
 */
typedef struct {
    /* The motor's number, from 1. */
    uint32_t number;
    /* The bits `PMAC_KNOWN_...` of the words that are known. */
    uint32_t known;
    /* The two words of `?`. */
    uint32_t status[2];
    /* The number of the motor's coordinate system; 0 if the board does not report it. */
    uint32_t coordinate_system;
    /* Whether the motor is activated (Ix00). */
    uint32_t activated;
    /* Actual position. */
    double position;
    /* Commanded position. */
    double commanded_position;
    /* Following error. */
    double following_error;
    /* Velocity. */
    double velocity;
    /* Position of the master that the motor follows. */
    double master_position;
    /* The end of the motor's present move (background report). */
    double target_position;
    /* Actual position as the board holds it, in 1/(Ix08*32) count. */
    int64_t raw_position;
} pmac_motor;

/* One coordinate system, of the background report. */
typedef struct {
    /* Its number, from 1. */
    uint32_t number;
    /* The bits `PMAC_KNOWN_...` of the words that are known. */
    uint32_t known;
    /* The words of `??`: status, program status, and on Turbo boards the third word. */
    uint32_t status[3];
    /* Program lines that the board has still to execute, as `PR`. */
    int32_t lines_remaining;
    /* The targets of the axes A, B, C, U, V, W, X, Y, Z, in user units; NaN if the board does not report one. */
    double axis_targets[9];
} pmac_system;

/* A text that a program of the board has sent. */
typedef struct {
    /* When the daemon read the text: nanoseconds of CLOCK_MONOTONIC. */
    uint64_t time_ns;
    /* Texts that the daemon dropped before this one, because this program read too slowly. */
    uint64_t lost;
    /* 1: the response to a `CMD"..."`; 2: a `SEND"..."`; 3: a `CMD"..."` that the board refused, the text is the error. */
    uint32_t kind;
    /* 0. */
    uint32_t reserved;
    /* The text. */
    char text[512];
} pmac_message;

/* The size of a gather. */
typedef struct {
    /* Samples. */
    uint64_t rows;
    /* Values in each. */
    uint64_t columns;
    /* Samples that the board or the daemon overwrote before this program read them. Exact. */
    uint64_t lost;
} pmac_gathered_info;

/* How to stream a program. Set the whole struct to 0 first. */
typedef struct {
    /* The coordinate system that executes the program, from 1. */
    uint32_t coordinate_system;
    /* Not 0: define the board's own rotary buffer first, with so many words. */
    uint32_t define_longs;
    /* The bits `PMAC_ROTARY_...`. */
    uint32_t flags;
    /* How long the board may take no lines, in milliseconds; 0: 60 s. */
    uint32_t timeout_ms;
} pmac_rotary_options;

/* A program that the board has taken whole. */
typedef struct {
    /* Lines. */
    uint64_t lines;
    /* Commands in them. */
    uint64_t commands;
    /* How often the daemon found the buffer empty though more lines were to follow. */
    uint64_t underruns;
    /* Lines that an earlier program had left in the board's rotary buffer. */
    uint64_t found_lines;
} pmac_streamed;

#ifdef __cplusplus
extern "C" {
#endif

/* The version of this library: `0.1.0`. */
const char *pmac_version(void);

/*
 Opens the board called `name` (NULL: `pmac0`). With `socket`: the board of the daemon at that path; with both, they
 must agree. Needs no connection unless there is a socket.
 */
pmac_status pmac_board_open(const char *name, const char *socket, pmac_board **board, pmac_error *error);

/* Frees the board. Handles made from it stay good. */
void pmac_board_close(pmac_board *board);

/* The board's name, as long as the handle lives; NULL for NULL. */
const char *pmac_board_name(const pmac_board *board);

/* The path of the daemon's socket, as long as the handle lives; NULL for NULL. */
const char *pmac_board_socket(const pmac_board *board);

/* The words for a `pmac_status`: `daemon gone`; empty for a number that is none. */
const char *pmac_status_name(int32_t status);

/* The board, as it has told the daemon. `size` is `sizeof(pmac_identity)`. */
pmac_status pmac_board_identity(const pmac_board *board, pmac_identity *identity, size_t size, pmac_error *error);

/* Name and unit of motor `motor` (from 1) in the daemon's configuration. `size` is `sizeof(pmac_motor_label)`. */
pmac_status pmac_board_motor_label(const pmac_board *board,
                                   uint32_t motor,
                                   pmac_motor_label *label,
                                   size_t size,
                                   pmac_error *error);

/*
 The site's own word number `index`, from 0; with `count` (or NULL) also how many there are. `size` is
 `sizeof(pmac_word)`. `word` may be NULL to ask for the count alone.
 */
pmac_status pmac_board_word(const pmac_board *board,
                            size_t index,
                            pmac_word *word,
                            size_t size,
                            size_t *count,
                            pmac_error *error);

/* The number of the latest servo update; 0 before the first. */
pmac_status pmac_board_sequence(const pmac_board *board, uint64_t *sequence, pmac_error *error);

/*
 Sleeps until there is a servo update newer than number `*after` (NULL: than the latest), at most `timeout_ms`.
 PMAC_OK, or PMAC_TIMED_OUT without one.
 */
pmac_status pmac_board_wait(const pmac_board *board, const uint64_t *after, uint32_t timeout_ms, pmac_error *error);

/*
 Takes everything that the segment has now. Data that are not live are an error, unless `flags` has PMAC_STALE_OK.
 If only the background data are not live, the snapshot leaves them out.
 */
pmac_status pmac_snapshot_take(const pmac_board *board, uint32_t flags, pmac_snapshot **snapshot, pmac_error *error);

/* Frees the snapshot. */
void pmac_snapshot_free(pmac_snapshot *snapshot);

/*
 When the snapshot was, of which motors and coordinate systems, and why its data are old if they are. `size` is
 `sizeof(pmac_moment)`.
 */
pmac_status pmac_snapshot_moment(const pmac_snapshot *snapshot, pmac_moment *moment, size_t size, pmac_error *error);

/* Motor `number`, from 1. `size` is `sizeof(pmac_motor)`. */
pmac_status pmac_snapshot_motor(const pmac_snapshot *snapshot,
                                uint32_t number,
                                pmac_motor *motor,
                                size_t size,
                                pmac_error *error);

/* Coordinate system `number`, from 1. `size` is `sizeof(pmac_system)`. */
pmac_status pmac_snapshot_system(const pmac_snapshot *snapshot,
                                 uint32_t number,
                                 pmac_system *system,
                                 size_t size,
                                 pmac_error *error);

/*
 Whether the flag `name` (as `in_position`) of motor `number` is set: 1 or 0, or -1 if the board does not report its
 word. pmacctl motor tells the names.
 */
pmac_status pmac_snapshot_motor_flag(const pmac_snapshot *snapshot,
                                     uint32_t number,
                                     const char *name,
                                     int32_t *is_set,
                                     pmac_error *error);

/*
 Whether the flag `name` (as `running_program`) of coordinate system `number` is set: 1 or 0, or -1 if the board does
 not report its word. pmacctl system tells the names.
 */
pmac_status pmac_snapshot_system_flag(const pmac_snapshot *snapshot,
                                      uint32_t number,
                                      const char *name,
                                      int32_t *is_set,
                                      pmac_error *error);

/* The values of the site's own word `name`: at most `room`, and in `*count` how many there are. */
pmac_status pmac_snapshot_word(const pmac_snapshot *snapshot,
                               const char *name,
                               double *values,
                               size_t room,
                               size_t *count,
                               pmac_error *error);

/* Every servo update from now on, each once. In a forked child they begin anew. */
pmac_status pmac_updates_open(const pmac_board *board, pmac_updates **updates, pmac_error *error);

/* Frees the updates. No thread may use them then. */
void pmac_updates_free(pmac_updates *updates);

/*
 The next update; waits for it at most `timeout_ms`. It has servo data alone, and its moment tells the updates missing
 before it. Without one, PMAC_TIMED_OUT if the data are live, else PMAC_STALE or PMAC_GONE; a later call goes on. If
 several threads call this, each update goes to one of them.
 */
pmac_status pmac_updates_next(const pmac_updates *updates,
                              uint32_t timeout_ms,
                              pmac_snapshot **update,
                              pmac_error *error);

/*
 How many updates the daemon overwrote before this program took them (`lost`), and how many of the board's the daemon
 did not read in time (`missed`), since these began. Exact.
 */
pmac_status pmac_updates_counts(const pmac_updates *updates, uint64_t *lost, uint64_t *missed, pmac_error *error);

/* The texts that the board's programs send from now on (`SEND`, `CMD`), for every reader each. */
pmac_status pmac_messages_open(const pmac_board *board, pmac_messages **messages, pmac_error *error);

/* Frees the messages. No thread may use them then. */
void pmac_messages_free(pmac_messages *messages);

/* The next text; PMAC_TIMED_OUT if none has come within `timeout_ms`. `size` is `sizeof(pmac_message)`. */
pmac_status pmac_messages_next(const pmac_messages *messages,
                               uint32_t timeout_ms,
                               pmac_message *message,
                               size_t size,
                               pmac_error *error);

/*
 Sends a command line and waits for the board's answer, at most `timeout_ms`. The line enters no program buffer but one
 that this process's lines have opened. `*reply` (or NULL) gets the lines of the answer, after an error those that had
 come: free it in either case. `flags`: PMAC_CONFIRMED or 0.
 */
pmac_status pmac_command(const pmac_board *board,
                         const char *line,
                         uint32_t timeout_ms,
                         uint32_t flags,
                         pmac_reply **reply,
                         pmac_error *error);

/* As pmac_command, for a mere question: the daemon refuses a line that would enter an open program buffer. */
pmac_status pmac_question(const pmac_board *board,
                          const char *line,
                          uint32_t timeout_ms,
                          pmac_reply **reply,
                          pmac_error *error);

/*
 Sends a control character, as "^K", before all waiting lines. It waits for no command of another thread. `flags`:
 PMAC_CONFIRMED or 0.
 */
pmac_status pmac_control(const pmac_board *board,
                         const char *character,
                         uint32_t flags,
                         pmac_reply **reply,
                         pmac_error *error);

/* How many lines the reply has; 0 for NULL. */
size_t pmac_reply_count(const pmac_reply *reply);

/* Line `index` of the reply, from 0, as long as the reply lives; NULL without such a line. */
const char *pmac_reply_line(const pmac_reply *reply, size_t index);

/* All lines, a newline between two, as long as the reply lives; NULL for NULL. */
const char *pmac_reply_text(const pmac_reply *reply);

/* Frees the reply. */
void pmac_reply_free(pmac_reply *reply);

/*
 A request to the control panel for the motors or coordinate systems `numbers`: "jog+", "jog-", "jog-stop", "pre-jog",
 "home" for motors, "start", "step", "stop", "hold" for coordinate systems. Returns when the board has taken it.
 */
pmac_status pmac_panel(const pmac_board *board,
                       const char *action,
                       const uint8_t *numbers,
                       size_t count,
                       pmac_error *error);

/* Moves motor `motor` to `position`, in counts. Returns when the board has taken the command; the motor moves then. */
pmac_status pmac_jog_to(const pmac_board *board, uint8_t motor, double position, pmac_error *error);

/*
 Jogs motor `motor` until pmac_jog_stop; `direction` is positive or negative. A thread of the library renews the jog:
 the daemon stops the motor if this process dies or hangs. A forked child has no part in it.
 */
pmac_status pmac_jog_begin(const pmac_board *board,
                           uint8_t motor,
                           int32_t direction,
                           pmac_jog **jog,
                           pmac_error *error);

/*
 1 while the motor is held; 0 after pmac_jog_stop, however that ended, and when the daemon has stopped the motor. During
 pmac_jog_stop of another thread it waits.
 */
pmac_status pmac_jog_is_held(const pmac_jog *jog, int32_t *is_held, pmac_error *error);

/*
 Stops the motor, and returns when the board has taken the stop. PMAC_STOP_FAILED: the motor may be moving. Every
 further call by the handle, also of a thread that waited meanwhile, returns the same, and stops nothing.
 */
pmac_status pmac_jog_stop(const pmac_jog *jog, pmac_error *error);

/* Frees the jog, and stops the motor if it is held; pmac_jog_stop also tells how that went. */
void pmac_jog_free(pmac_jog *jog);

/*
 The values of the variables `names` (as "P1", "Q2", "I122"), by lines that enter no program buffer. A Q-variable is
 that of the addressed coordinate system.
 */
pmac_status pmac_variables_read(const pmac_board *board,
                                const char *const *names,
                                size_t count,
                                double *values,
                                uint32_t timeout_ms,
                                pmac_error *error);

/* Sets the variable `name`, by a line that enters no program buffer. */
pmac_status pmac_variable_write(const pmac_board *board,
                                const char *name,
                                double value,
                                uint32_t timeout_ms,
                                pmac_error *error);

/*
 Has the board gather the `count` sources (as "1.actual_position", "servo_timer", "Y:$C003") each `period` servo cycles
 for `seconds`, and returns at the end. `keep_going` (or NULL) is called many times a second with `context`; when it returns
 0, the gather ends with PMAC_HALTED, or, if the daemon does not end it, with that error. It must not throw.
 */
pmac_status pmac_gather(const pmac_board *board,
                        const char *const *sources,
                        size_t count,
                        uint32_t period,
                        double seconds,
                        int32_t (*keep_going)(void*),
                        void *context,
                        pmac_gathered **gathered,
                        pmac_error *error);

/* How many samples, values in each, and lost samples. `size` is `sizeof(pmac_gathered_info)`. */
pmac_status pmac_gathered_size(const pmac_gathered *gathered, pmac_gathered_info *info, size_t size, pmac_error *error);

/*
 The title of column `index`, from 0, as long as the handle lives: the source, and its unit in brackets; NULL without
 such a column.
 */
const char *pmac_gathered_title(const pmac_gathered *gathered, size_t index);

/* The values, row by row, as long as the handle lives; NULL for NULL. */
const double *pmac_gathered_values(const pmac_gathered *gathered);

/* When the board made each sample, in seconds since the first, as long as the handle lives; NULL for NULL. */
const double *pmac_gathered_times(const pmac_gathered *gathered);

/* Frees the samples. */
void pmac_gathered_free(pmac_gathered *gathered);

/*
 Streams the motion program `text` of `length` bytes to a rotary buffer, and returns when the board has all of it.
 Errors name it `name`. `options_size` is `sizeof(pmac_rotary_options)`, `streamed_size` `sizeof(pmac_streamed)`;
 `streamed` may be NULL.
 `*warnings` (or NULL) gets how the board's program differs from the text: free it. `keep_going`: as in pmac_gather.
 If an error or the caller ends the stream early, the daemon ends the program, too. PMAC_STOP_FAILED: the caller ended the
 stream, but the program may run on.
 */
pmac_status pmac_rotary(const pmac_board *board,
                        const char *name,
                        const uint8_t *text,
                        size_t length,
                        const pmac_rotary_options *options,
                        size_t options_size,
                        int32_t (*keep_going)(void*),
                        void *context,
                        pmac_streamed *streamed,
                        size_t streamed_size,
                        pmac_reply **warnings,
                        pmac_error *error);

#ifdef __cplusplus
}
#endif

#endif  /* PMAC_DPRAM_H */
