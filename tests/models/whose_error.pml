/* ASCII errors: whose an error is. No <ACK> follows one. With I6 other than 2 the board reports errors of its programs' CMD in the
 * same way as a line's, at any moment. The board answers lines in their order.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii.rs and src/daemon/bus/work/ascii/unsettled.rs. Every access to
 * the DPRAM is one step. A response's text is whose it is; the host looks at it only in assertions, and at that of its own line, whose
 * reply is unmistakable. What it asserts: a reply is that of the line it is told of, a line that is told refused was refused, one that
 * is told done was done, and no reply is left over for the next line.
 *
 * PROGRAM     programs make errors. The host's own line settles whose an error is. Holds.
 * AT_ONCE     an error is believed at once. FAILS beside programs, and holds without.
 * FIRST_END   the first reply that ends behind the error is taken for that of the host's own line. FAILS beside programs.
 * NO_CHECK    the next line goes without one of the host's own. FAILS beside programs.
 */
#define LINES 2
#define CHECK 3                                       /* the host's own line */
#define PROGRAM_S 4                                   /* the text of a program's error */
#define LINE 1
#define END 2
#define ERROR 3
#define ROOM 4

byte command, command_text;                           /* 0x062C, 0x0630 */
byte response, response_text;                         /* 0x06D0, 0x06D4 */
byte queue[ROOM], queue_text[ROOM], queued = 0;       /* PMAC's own: responses not put out yet */

inline say(what, whose) { queue[queued] = what; queue_text[queued] = whose; queued++ }

proctype Pmac() {
  byte taken;
  do
  :: if                                               /* one background pass */
     :: command != 0 && queued <= ROOM - 3 ->
        taken = command_text;
        atomic {
          if
          :: say(LINE, taken); say(END, taken)
          :: taken != CHECK -> say(END, taken)
          :: taken != CHECK -> say(ERROR, taken)
          fi;
          taken = 0
        };
        command = 0
#ifdef PROGRAM
     :: atomic { queued <= ROOM - 3 -> say(ERROR, PROGRAM_S) }
#endif
     :: else
     fi;
     if
     :: queued > 0 && response == 0 ->                /* `respond` */
        response_text = queue_text[0];
        atomic {
          response = queue[0];
          queued--;
          queue[0] = queue[1]; queue_text[0] = queue_text[1];
          queue[1] = queue[2]; queue_text[1] = queue_text[2];
          queue[2] = queue[3]; queue_text[2] = queue_text[3];
          queue[3] = 0; queue_text[3] = 0
        }
     :: else
     fi
  od
}

#define IDLE 0
#define REPLYING 1
#define REFUSED 2                                     /* an error came: the line's, or a program's */
#define CHECKING 3

proctype Host() {
  byte state, job, what, whose;
  bool refused, told, own;
  do
  :: if
     :: state == IDLE && command == 0 && response == 0 ->
        atomic { job = (job + 1) % LINES };
        command_text = job;
        command = 1;
        state = REPLYING
     :: state == REFUSED && command == 0 && response == 0 ->
        command_text = CHECK;
        command = 1;
        state = CHECKING
     :: else
     fi;
     what = response;
     if
     :: what != 0 ->
        whose = response_text;
        atomic {
          response = 0;
          if
          :: state == REPLYING && what == ERROR ->
#ifdef AT_ONCE
             assert(whose == job);
#endif
             refused = (whose == job);
             told = false;
             own = false;
#ifdef AT_ONCE
             state = IDLE
#else
#ifdef NO_CHECK
             state = IDLE
#else
             state = REFUSED
#endif
#endif
          :: state == REPLYING && what != ERROR ->
             assert(whose == job);
             if :: what == END -> state = IDLE :: else fi
          :: state >= REFUSED && what == ERROR -> refused = (refused || whose == job)
          :: state >= REFUSED && what == LINE ->
             if :: whose == CHECK -> own = true :: else -> assert(whose == job && !told) fi
          :: state >= REFUSED && what == END ->
#ifdef FIRST_END
             own = (state == CHECKING);
#endif
             if
             :: own -> assert(told || refused); state = IDLE
             :: !own -> assert(whose == job && !told); told = true
             fi
          :: state == IDLE -> assert(what == ERROR && whose == PROGRAM_S)
          fi
        }
     :: else
     fi;
     atomic { what = 0; whose = 0 }
  od
}

init { atomic { run Pmac(); run Host() } }
