/* ASCII: command word (0x062C) with its text, control character (0x062E), response word (0x06D0) with its text.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii.rs with ascii/hold.rs (`begin`, `poll`, `give_up`, `hold`)
 * as src/daemon/bus/work/ascii.rs with ascii/check.rs uses them. Every access to the DPRAM is one step. A command's text is its
 * number; its reply is a line and an acknowledgement, which carry the number too, for the assertions' eyes only, but for those of
 * the daemon's own lines, which the host knows when he sees them. A program on the board sends messages.
 *
 * What holds: a line or an acknowledgement given to a caller belongs to his command; a command told to be done was
 * done once; nothing is done twice, nor a text mixed of two. Liveness: commands go on for ever.
 *
 * Times: a command's deadline may come at any moment, and so may the end of the host's patience with his question. SETTLE, 50 ms
 * without a response, is longer than PMAC takes for a pass that is not at a slow line: the end of it is modelled as "PMAC has
 * made two passes and there was no response". A slow line (SLOW) breaks that: the host takes its time for silence.
 *
 * Not here: lines in two parts, errors (whose_error.pml), the NUL that the host leaves in the text (reply_text.pml), the empty line
 * that goes with a control character (control_flag.pml), ^X, and that the daemon believes a board which answers three of its own
 * lines, but none of them as it should.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * TAKEN       PMAC clears the command word when it has taken the line. Else when it has processed it.
 * SLOW        a line takes PMAC as long as one likes, longer than any deadline and any silence
 * BESIDE      PMAC answers control characters while it is at a line. Else it looks at nothing meanwhile.
 * CRASH       the host is killed anywhere, once, and started again
 * RESET       the board is reset anywhere, once, and clears words and queue
 * QUIET       no program sends messages
 * COMMANDS    how many texts callers' lines have, 2
 * NO_HOLD     the host does not wait for the answer to his question. Holds all the same: his own line, which he can tell from the
 *             last one, is what counts. The question spares it where the board stands still.
 * NO_CHECK    the host sends no line of his own first. FAILS with SLOW, TAKEN and BESIDE: PMAC answers the question beside the
 *             line, whose reply comes when the next command is under way.
 * CHECKS_ALIKE the host's own lines cannot be told apart. FAILS there: the late reply to the first one passes for the
 *             second one's, whose own comes when the next command is under way.
 * START_ALIKE a new host begins with the first of his own lines, whatever lies in the command buffer. FAILS there with CRASH: the
 *             old host's line was the first one, too, and its reply passes for the new one's.
 * NO_START_HOLD the new host does not begin held. FAILS with CRASH: a host is killed in the middle of a
 *             reply; the next one clears the response word and begins a command before PMAC has put out the rest.
 * TOLD        a line given up while it still lies in the buffer is told to be not done, instead of perhaps. FAILS: PMAC
 *             has seen the command word and is at it; it clears the word only when it has processed the line.
 * INTERRUPT   the host looks only when an interrupt came, and interrupts get lost. FAILS (liveness): a lost one leaves the
 *             response lying; PMAC puts out no other, and so raises no other interrupt. Therefore the daemon looks from
 *             time to time although there is an interrupt; spurious ones make it look in vain, as every poll does.
 */
#ifndef COMMANDS
#define COMMANDS 2
#endif
#ifdef CHECKS_ALIKE
#define CHECKS 1
#else
#define CHECKS 3                                       /* how many of the host's own lines can be told apart */
#endif
#define QUESTION 6
#define LINE 1
#define END 2
#define MESSAGE 3
#define ANSWER 4
#define ROOM 5

byte command, command_text;                           /* 0x062C, 0x0630 */
byte character;                                       /* 0x062E */
byte response, response_text;                         /* 0x06D0, 0x06D4 */

byte queue[ROOM], queue_text[ROOM], queued = 0;       /* PMAC's own: responses not put out yet */

byte done[COMMANDS + CHECKS];                         /* how often PMAC did it */
byte told_not = COMMANDS + CHECKS;                     /* TOLD: the command that the caller believes not done */
byte passes = 0;                                      /* since the host last saw a response; saturates at 2 */
bool killed = false, resetting = false;
bool interrupt = false;
bool finished = false;
bool reading = false;                                 /* the host is between control word and text */

inline say(what, whose) { queue[queued] = what; queue_text[queued] = whose; queued++ }

inline forget() {
  queued = 0;
  queue[0] = 0; queue[1] = 0; queue[2] = 0; queue[3] = 0; queue[4] = 0;
  queue_text[0] = 0; queue_text[1] = 0; queue_text[2] = 0; queue_text[3] = 0; queue_text[4] = 0
}

inline put_out() {                                    /* `respond` */
  if
  :: queued > 0 && response == 0 ->
     response_text = queue_text[0];
     atomic {
       response = queue[0];
#ifdef INTERRUPT
       if :: interrupt = true :: skip fi;             /* or it is lost */
#endif
       queue[0] = queue[1]; queue_text[0] = queue_text[1]; queue[1] = queue[2]; queue_text[1] = queue_text[2];
       queue[2] = queue[3]; queue_text[2] = queue_text[3]; queue[3] = queue[4]; queue_text[3] = queue_text[4];
       queue[4] = 0; queue_text[4] = 0; queued--
     }
  :: else
  fi
}

inline take_character() {
  if
  :: character != 0 && queued < 2 -> atomic { character = 0; say(ANSWER, 0) }
  :: else
  fi
}

proctype Pmac() {
  byte taken;
  do
  :: {
    do
    :: take_character();                              /* one background pass */
       if
       :: command != 0 && queued < 3 ->
          taken = command_text;
#ifdef TAKEN
          command = 0;
#endif
#ifdef SLOW
          if :: passes = 2 :: skip fi;                /* what the host takes for silence */
#ifdef BESIDE
          take_character();
          put_out();
          if :: passes = 2 :: skip fi;
#endif
#endif
          atomic { done[taken]++; assert((done[taken] == 1 || taken >= COMMANDS) && taken != told_not); say(LINE, taken); say(END, taken); taken = 0 };
#ifndef TAKEN
          command = 0
#endif
       :: else
       fi;
       if
#ifndef QUIET
       :: queued == 0 -> say(MESSAGE, 0)              /* SEND"..." of a program */
#endif
       :: true
       fi;
       put_out();
       atomic { if :: passes < 2 -> passes++ :: else fi }
    od
  } unless {
    atomic { resetting -> resetting = false; character = 0; command = 0; response = 0; taken = 0; forget() };
    !reading                                          /* it starts up for longer than the host takes to read a text */
  }
  od
}

/* What the host does next: nothing under way, a line lies there, PMAC has it, the port is held. */
#define IDLE 0
#define LOADED 1
#define REPLYING 2
#define HELD 3

/* Where the host's question is: to be asked, in its word, taken, over. */
#define DUE 0
#define LIES 1
#define ASKED 2
#define OVER 3

inline hold(from) {
#ifdef NO_HOLD
  atomic { state = HELD; asking = OVER; passes = 0; job = 0; known = false }
#else
  atomic { state = HELD; asking = from; passes = 0; job = 0; known = false }
#endif
}

proctype Host() {
  byte state, asking, job, next, check, what, whose;
  bool quiet, doubt, known;
  do
  :: {
    response = 0;                                     /* `release`, at the start */
    character = 0;
    command = 0;
#ifdef START_ALIKE
    check = 0;
#else
    if :: command_text >= COMMANDS -> check = command_text - COMMANDS :: else -> check = 0 fi;
#endif
    doubt = true;
#ifdef NO_START_HOLD
    atomic { state = IDLE; doubt = false };
#else
    hold(DUE);
#endif
    do
    :: if                                             /* one poll */
       :: state == LOADED -> if :: command == 0 -> state = REPLYING :: else fi
       :: else
       fi;
#ifdef INTERRUPT
       if
       :: state == REPLYING -> atomic { interrupt -> interrupt = false }
       :: else
       fi;
#endif
       atomic { what = response; reading = (what != 0); quiet = (passes == 2); finished = false };
       if
       :: what != 0 ->
          whose = response_text;
          atomic {
            response = 0;
            passes = 0;
            if
            :: what == MESSAGE
            :: what != MESSAGE && state == HELD -> if :: asking == ASKED -> asking = OVER :: else fi
            :: what != MESSAGE && state == IDLE                           /* stale */
            :: what != MESSAGE && (state == LOADED || state == REPLYING) && job >= COMMANDS ->
               if
               :: what == LINE -> known = (whose == job)
               :: what == END && known -> state = HELD; asking = OVER; doubt = false; job = 0; known = false
               :: else
               fi
            :: what != MESSAGE && (state == LOADED || state == REPLYING) && job < COMMANDS ->
               assert(what != ANSWER && whose == job);
               if
               :: what == END -> assert(done[job] == 1); state = IDLE; job = 0; finished = true   /* told: done */
               :: else
               fi
            fi
          }
       :: else -> if                                  /* `go_on_holding` */
          :: state == HELD && asking == DUE -> if :: character == 0 -> character = QUESTION; asking = LIES :: else fi
          :: state == HELD && asking == LIES -> if
             :: character == 0 -> asking = ASKED
#ifndef PATIENT
             :: character != 0 -> character = 0; command = 0; asking = DUE               /* ASK_LIMIT */
#endif
             :: character != 0
             fi
          :: state == HELD && asking == ASKED -> if
             :: quiet -> asking = OVER                 /* ANSWER_LIMIT, for the answer that a killed host got */
#ifndef PATIENT
             :: asking = OVER
             :: skip
#else
             :: else
#endif
             fi
          :: state == HELD && asking == OVER -> if
             :: command != 0 -> passes = 0
             :: command == 0 -> if :: quiet -> state = IDLE; asking = DUE :: else fi
             fi
          :: else
          fi
       fi;
       atomic { what = 0; whose = 0; quiet = false; reading = false };
       if
       :: state == IDLE ->                            /* begin */
          if
          :: response == 0 ->
             if
             :: command == 0 ->
#ifdef NO_CHECK
                doubt = false;
#endif
                atomic {
                  known = false;
                  if
                  :: doubt -> check = (check + 1) % CHECKS; job = COMMANDS + check
                  :: else -> next = (next + 1) % COMMANDS; job = next
                  fi;
                  done[job] = 0; told_not = COMMANDS + CHECKS
                };
                command_text = job;
                command = 1;
                state = LOADED
             :: else
             fi
          :: else
          fi
#ifndef PATIENT
       :: state == LOADED || state == REPLYING ->     /* the deadline */
#ifdef TOLD
          if :: state == LOADED && command != 0 -> told_not = job :: else fi;
#endif
          atomic { doubt = true };
          hold(DUE)
#endif
       :: else
#ifndef PATIENT
       :: true
#endif
       fi
    od
  } unless { atomic { killed -> killed = false; what = 0; whose = 0; quiet = false; reading = false; known = false; job = 0; next = 0; doubt = false; asking = DUE; state = IDLE } }
  od
}

proctype Chaos() {
#ifdef CRASH
  if :: killed = true; !killed :: skip fi;
#endif
#ifdef RESET
  if :: resetting = true; !resetting :: skip fi;
#endif
  skip
}

/* Commands go on to be told done for ever, if the host may wait (PATIENT: no deadline). */
ltl commands_go_on { [] <> finished }

init { atomic { run Pmac(); run Host(); run Chaos() } }
