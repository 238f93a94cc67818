/* ASCII errors: whether an acknowledgement follows one (readings.md, error_ack). The board does one or the other, and the host
 * does not know which.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii/late_mark.rs. Every access to the DPRAM is one step. A line's
 * text is its number, which its responses carry for the assertions' eyes only.
 *
 * A program's error (-DPROGRAM) comes as a line's does, at any moment. What answers a line behind it tells that it may be one.
 *
 * What holds, on a board of either reading: a response given to a line is its own. On a board that is known to send no
 * acknowledgement behind errors, an error given to a line is its own, too; on the other nobody can know.
 *
 * Times: an acknowledgement that follows an error does so within two passes of PMAC's, and FIRST, 0.3 s, is longer.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * NO_WAIT     the next line goes as soon as the error has come. FAILS: the acknowledgement behind the error ends its reply.
 * PROGRAM     programs make errors. The host waits behind one as long as any answer takes.
 * AT_ONCE     an error is given to the line that is under way. FAILS with PROGRAM: it is a program's, the line was carried out.
 * NO_MEMORY   what the board did after the last error is forgotten: after each one the host waits for FIRST. Holds, and is slow.
 * LATER       the acknowledgement comes when it likes. FAILS: the host has taken it that none comes. The code does not believe an
 *             acknowledgement while the line still lies in the buffer, for 10 s after it was wrong; that is not here.
 */
#define LINES 2
#define LINE 1
#define END 2
#define ERROR 3
#define FIRST 3                                       /* passes */
#define PROGRAM_S LINES                               /* the text of a program's error */

byte command, command_text;                           /* 0x062C, 0x0630 */
byte response, response_text;                         /* 0x06D0, 0x06D4 */
byte queue[2], queue_text[2], queued = 0;             /* PMAC's own: responses not put out yet */
byte passes = 0;                                      /* since the host last saw a response */
bool follows;                                         /* the board's reading */

inline say(what, whose) { queue[queued] = what; queue_text[queued] = whose; queued++ }

proctype Pmac() {
  byte taken;
  bool held;
  do
  :: if                                               /* one background pass */
     :: command != 0 && queued == 0 ->
        taken = command_text;
        atomic {
          if
          :: say(LINE, taken); say(END, taken)
          :: say(ERROR, taken); if :: follows -> say(END, taken) :: else fi
          fi;
          taken = 0
        };
        command = 0
#ifdef PROGRAM
     :: queued == 0 -> say(ERROR, PROGRAM_S)
#endif
     :: else
     fi;
     if
     :: queued > 0 && response == 0 && !held ->       /* `respond` */
        response_text = queue_text[0];
        atomic {
          response = queue[0];
          queued--;
          queue[0] = queue[1]; queue_text[0] = queue_text[1]; queue[1] = 0; queue_text[1] = 0;
          if :: held = true :: skip fi                /* what comes next is late */
        }
#ifndef LATER
     :: held -> if :: response == 0 -> held = false :: else fi
#else
     :: held = false
     :: held
#endif
     :: else
     fi;
     atomic { if :: passes < FIRST -> passes++ :: else fi }
  od
}

#define IDLE 0
#define REPLYING 1
#define MARK 2
#define DOUBT 3
#define UNKNOWN 0
#define YES 1
#define NO 2

proctype Host() {
  byte state, job, what, whose, knows;
  bool quiet, mine;
  do
  :: if
     :: state == IDLE && command == 0 && response == 0 ->
        atomic { job = (job + 1) % LINES };
        command_text = job;
        command = 1;
        state = REPLYING
     :: else
     fi;
     atomic { what = response; quiet = (passes == FIRST) };
     if
     :: what != 0 ->
        whose = response_text;
        atomic {
          response = 0;
          passes = 0;
          if
          :: state == REPLYING && what == ERROR ->
#ifdef AT_ONCE
             assert(whose == job);
#endif
             mine = (whose == job);
#ifdef NO_WAIT
             state = IDLE
#else
             state = MARK
#endif
          :: state == REPLYING && what != ERROR ->
             assert(whose == job);
             if :: what == END -> state = IDLE :: else fi
          :: state == MARK && what == ERROR -> mine = (mine || whose == job)
          :: state == MARK && what == END && knows != NO -> knows = YES; state = IDLE
          :: state == MARK && what != ERROR && (what == LINE || knows == NO) ->
             if :: knows == NO -> knows = UNKNOWN :: else fi;
             state = DOUBT                            /* told: it may have been carried out */
          :: state == DOUBT || state == IDLE          /* stale */
          fi;
#ifdef NO_MEMORY
          knows = UNKNOWN;
#endif
        }
     :: what == 0 && (state == MARK || state == DOUBT) && command != 0 -> passes = 0
     :: what == 0 && state == DOUBT && quiet && command == 0 -> state = IDLE
     :: what == 0 && state == MARK && quiet && command == 0 ->        /* `no_mark_came` */
        atomic { assert(mine); if :: knows == YES -> knows = UNKNOWN :: else -> knows = NO fi; state = IDLE }
     :: else
     fi;
     atomic { what = 0; whose = 0; quiet = false }
  od
}

init { atomic { if :: follows = true :: follows = false fi; run Pmac(); run Host() } }
