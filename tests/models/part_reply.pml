/* A long line in two parts, on a board that answers each part with an acknowledgement, and on one that answers the line at its end
 * (readings.md, part_reply); the same in every family. The host does not know which.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii.rs (`poll`, `is_stale`) with ascii/part_answer.rs. Every access to
 * the DPRAM is one step. A line's text is its number, which its responses carry, and the part, for the assertions' eyes only. The
 * board clears the line's flag before it answers, or behind the answer (reading line_flag).
 *
 * What holds, on a board of either reading: what ends a line's reply is the board's answer to all of that line.
 *
 * Times: an answer to the first part comes within two passes of PMAC's, and FIRST, 0.3 s, is longer.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * DONE        the flag is cleared behind the answer
 * NO_WAIT     the second part goes as soon as the first is taken. FAILS: the first one's answer ends the line's reply.
 * NO_MEMORY   what the board did is forgotten: after each first part the host waits for FIRST. Holds, and is slow.
 * NO_LOOK     the flag is not read again behind a response. FAILS: it was set when it was read, and the board took the first part and
 *             answered it before the response was read: the answer is taken for the line's.
 * NO_BELIEF   an answer that comes while the flag of a first part is set ends the line. FAILS with DONE.
 * LATER       the answer comes when it likes. FAILS: the host has taken it that none comes.
 */
#define LINES 2
#define LINE 1
#define END 2
#define FIRST 3                                       /* passes */

byte command, command_text, command_part;             /* 0x062C, 0x0630: whole (0), first (1), second (2) */
byte response, response_text, response_part;          /* 0x06D0, 0x06D4 */
byte queue[2], queue_text[2], queue_part[2], queued = 0;    /* PMAC's own: responses not put out yet */
byte passes = 0;                                      /* since the host last saw a response, or the flag cleared */
bool each;                                            /* the board's reading */

inline say(what, whose, part) { queue[queued] = what; queue_text[queued] = whose; queue_part[queued] = part; queued++ }

inline put_out() {
  response_text = queue_text[0];
  response_part = queue_part[0];
  atomic {
    response = queue[0];
    queued--;
    queue[0] = queue[1]; queue_text[0] = queue_text[1]; queue_part[0] = queue_part[1];
    queue[1] = 0; queue_text[1] = 0; queue_part[1] = 0
  }
}

proctype Pmac() {
  byte taken, part;
  bool held, clears;
  do
  :: if                                               /* one background pass */
     :: command != 0 && queued == 0 && !clears ->
        atomic { taken = command_text; part = command_part };
        atomic {
          if
          :: part == 1 -> if :: each -> say(END, taken, part) :: else fi
          :: else -> say(LINE, taken, part); say(END, taken, part)
          fi;
          taken = 0; part = 0
        };
#ifdef DONE
        clears = true
#else
        command = 0
#endif
     :: else
     fi;
     if
     :: queued > 0 && response == 0 && !held ->       /* `respond` */
        put_out();
        atomic { if :: held = true :: skip fi }       /* what comes next is late */
#ifndef LATER
     :: held -> if :: response == 0 -> held = false :: else fi
#else
     :: held = false
     :: queued > 0 -> held = true
#endif
     :: else
     fi;
     if
     :: clears && queued == 0 -> atomic { clears = false; command = 0 }
     :: else
     fi;
     atomic { if :: passes < FIRST -> passes++ :: else fi }
  od
}

#define IDLE 0
#define LOADED 1
#define TAKEN 2
#define SECOND 3
#define REPLYING 4
#define UNKNOWN 0
#define YES 1
#define NO 2

/* What lies in the line buffer may have been taken. */
inline look() {
  if
  :: (state == LOADED || state == SECOND) && command == 0 ->
     atomic {
       if
       :: state == LOADED && is_long -> state = TAKEN; passes = 0
       :: else -> state = REPLYING
       fi
     }
  :: else
  fi
}

inline load(part) {
  atomic { command_text = job; command_part = part };
  command = 1
}

proctype Host() {
  byte state, job, what, whose, part, knows;
  bool quiet, is_long, early;                         /* early: an answer was seen to come before the flag cleared */
  do
  :: if
     :: state == IDLE && command == 0 && response == 0 ->
        atomic { job = (job + 1) % LINES; if :: is_long = true :: is_long = false fi };
        if :: is_long -> load(1) :: else -> load(0) fi;
        state = LOADED
     :: else
     fi;
     look();
     atomic { what = response; quiet = (passes == FIRST) };
     if
     :: what == 0 && state == TAKEN && (quiet || knows == NO) ->        /* `second_part_is_due` */
        atomic { if :: knows == YES -> knows = UNKNOWN :: else -> knows = NO fi };
        load(2);
        state = SECOND
#ifdef NO_WAIT
     :: state == TAKEN -> load(2); state = SECOND
#endif
     :: what != 0 ->
        atomic { whose = response_text; part = response_part };
#ifndef NO_LOOK
        look();
#endif
        atomic {
          passes = 0;
          if
          :: state == TAKEN ->
             assert(what == END);                     /* the board has not all of the line */
             knows = YES;
#ifdef NO_MEMORY
             knows = UNKNOWN
#endif
#ifndef NO_BELIEF
          :: state == LOADED && is_long && what == END
#endif
          :: state == SECOND && what == END && command != 0 && !early -> knows = YES
          :: state == IDLE                            /* stale */
          :: else ->
             if
             :: state == LOADED && !is_long && what == LINE && command != 0 -> early = true
             :: else
             fi;
             assert(whose == job && part != 1);       /* its own, and the board has all of the line */
             if :: what == END -> state = IDLE :: else fi
          fi;
          response = 0
        };
        if
        :: state == TAKEN && what == END -> load(2); state = SECOND
        :: else
        fi
     :: else
     fi;
     atomic { what = 0; whose = 0; part = 0; quiet = false }
  od
}

init { atomic { if :: each = true :: each = false fi; run Pmac(); run Host() } }
