/* ASCII errors: whether an acknowledgement follows one (readings.md, error_ack). The board does one or the other, and the host
 * does not know which.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii/late_mark.rs. Every access to the DPRAM is one step. A line's
 * text is its number, which its responses carry for the assertions' eyes only.
 *
 * What holds, on a board of either reading: a response given to a line is its own.
 *
 * Times: an acknowledgement that follows an error does so within two passes of PMAC's, and FIRST, 0.3 s, is longer.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * NO_WAIT     the next line goes as soon as the error has come. FAILS: the acknowledgement behind the error ends its reply.
 * NO_MEMORY   what the board did after the last error is forgotten: after each one the host waits for FIRST. Holds, and is slow.
 * LATER       the acknowledgement comes when it likes. FAILS: the host has taken it that none comes. The code does not believe an
 *             acknowledgement while the line still lies in the buffer, for 10 s after it was wrong; that is not here.
 */
#define LINES 2
#define LINE 1
#define END 2
#define ERROR 3
#define FIRST 3                                       /* passes */

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
#define UNKNOWN 0
#define YES 1
#define NO 2

proctype Host() {
  byte state, job, what, whose, knows;
  bool quiet;
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
          :: state == REPLYING ->
             assert(whose == job);
             if
             :: what == END -> state = IDLE
             :: what == ERROR ->
#ifdef NO_WAIT
                state = IDLE
#else
                if :: knows == NO -> state = IDLE :: else -> state = MARK fi
#endif
             :: what == LINE
             fi
          :: state == MARK -> assert(what == END); knows = YES; state = IDLE
          :: state == IDLE                             /* stale */
          fi;
#ifdef NO_MEMORY
          knows = UNKNOWN;
#endif
        }
     :: what == 0 && state == MARK && quiet ->        /* `no_mark_came` */
        atomic { if :: knows == YES -> knows = UNKNOWN :: else -> knows = NO fi; state = IDLE }
     :: else
     fi;
     atomic { what = 0; whose = 0; quiet = false }
  od
}

init { atomic { if :: follows = true :: follows = false fi; run Pmac(); run Host() } }
