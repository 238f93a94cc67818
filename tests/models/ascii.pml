/* ASCII: command word (0x062C) with its text, control character (0x062E), response word (0x06D0) with its text.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii.rs (`begin`, `poll`, `give_up`) as src/daemon/bus/work/ascii.rs
 * with ascii/check.rs and ascii/unsettled.rs uses them. Every access to the DPRAM is one step. A command's text is its number; its
 * reply is a line and an acknowledgement, which carry the number too, for the assertions' eyes only, but for those of the daemon's
 * own lines, which the host knows when he sees them. A program on the board sends messages.
 *
 * What holds: a line or an acknowledgement given to a caller belongs to his command; a command told to be done was
 * done once; nothing is done twice; a control character's answer is no line's. Liveness: commands go on for ever.
 *
 * Times: a command's deadline may come at any moment; a slow line (SLOW) takes longer than any. The host waits for no silence: the
 * order of the answers tells. A line that is given up in the buffer becomes empty there. REST, 50 ms, which a new host takes, is longer than PMAC takes from seeing the command word to having read the text.
 *
 * Not here: lines in two parts (two_parts.pml), errors (whose_error.pml), ^X.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * TAKEN       PMAC clears the command word when it has taken the line. Else when it has processed it.
 * SLOW        a line takes PMAC as long as one likes, longer than any deadline
 * BESIDE      PMAC answers control characters while it is at a line. Else it looks at nothing meanwhile.
 * CRASH       the host is killed anywhere, once, and started again
 * RESET       the board is reset anywhere, once, and clears words and queue
 * QUIET       no program sends messages
 * COMMANDS    how many texts callers' lines have, 2
 * NO_CHECK    the host sends no line of his own first. FAILS with SLOW and TAKEN: the reply to the line that was given up comes when
 *             the next command is under way.
 * CHECKS_ALIKE the host's own lines cannot be told apart. FAILS there: the late reply to the first one passes for the
 *             second one's, whose own comes when the next command is under way.
 * START_ALIKE a new host begins with the first of his own lines, whatever lies in the command buffer. FAILS there with CRASH: the
 *             old host's line was the first one, too, and its reply passes for the new one's.
 * NO_START_CHECK the new host begins with a caller's line. FAILS with CRASH: a host is killed in the middle of a
 *             reply; the next one clears the response word and begins a command before PMAC has put out the rest.
 * NO_ANSWER_CHECK the host sends no line of his own behind a control character. FAILS: its answer comes when a line is under way.
 * NO_REST     a new host does not rest. FAILS with CRASH: PMAC has seen the command word, takes the new line under it, and once
 *             more when its command word is set.
 * CHECK_ENDED the host gives up his own line, too, while it lies untaken. FAILS there with CRASH: lines that were never carried out use
 *             up those that can be told apart.
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
#define CHECKS 4                                       /* how many of the host's own lines can be told apart */
#endif
#define QUESTION 6
#define EMPTY 9                                       /* added to a text: it was made empty, by its first byte */
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
bool killed = false, resetting = false;
bool interrupt = false;
bool finished = false;
bool reading = false;                                 /* the host is between control word and text */
bool looking = false;                                 /* PMAC is between command word and text */
bool working = false;                                 /* and at a line */

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
       :: atomic { command != 0 && queued < 3 -> looking = true; working = true };
          taken = command_text;
#ifdef TAKEN
          command = 0;
#endif
          looking = false;
#ifdef SLOW
#ifdef BESIDE
          take_character();
          put_out();
#endif
#endif
          atomic {
            if
            :: taken >= EMPTY -> if :: say(END, EMPTY) :: skip fi
            :: else -> done[taken]++; assert((done[taken] == 1 || taken >= COMMANDS) && taken != told_not); say(LINE, taken); say(END, taken)
            fi;
            taken = 0; working = false };
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
       put_out()
    od
  } unless {
    atomic { resetting -> resetting = false; character = 0; command = 0; response = 0; taken = 0; looking = false; working = false; forget() };
    !reading                                          /* it starts up for longer than the host takes to read a text */
  }
  od
}

/* What the host does next: nothing under way, a line lies there, PMAC has it, a control character lies there, it rests, an empty line lies there. */
#define IDLE 0
#define LOADED 1
#define REPLYING 2
#define ASKING 3
#define RESTING 4
#define EMPTIED 5

proctype Host() {
  byte state, job, next, check, what, whose;
  bool doubt, known;
  do
  :: {
    response = 0;                                     /* `release`, at the start */
    character = 0;
    command = 0;
#ifdef START_ALIKE
    check = 0;
#else
    if
    :: command_text % EMPTY >= COMMANDS -> check = command_text % EMPTY - COMMANDS
    :: else -> check = 0
    fi;
#endif
    atomic {
      state = RESTING;
#ifdef NO_START_CHECK
      doubt = false
#else
      doubt = true
#endif
    };
    do
    :: if                                             /* one poll */
       :: state == LOADED -> if :: command == 0 -> state = REPLYING :: else fi
       :: state == ASKING ->
          if
          :: character == 0 ->
             atomic {
               state = IDLE;
#ifndef NO_ANSWER_CHECK
               doubt = true
#endif
             }
          :: else
          fi
       :: else
       fi;
#ifdef INTERRUPT
       if
       :: state == REPLYING -> atomic { interrupt -> interrupt = false }
       :: else
       fi;
#endif
       atomic { what = response; reading = (what != 0); finished = false };
       if
       :: what != 0 ->
          whose = response_text;
          atomic {
            response = 0;
            if
            :: what == MESSAGE
            :: what != MESSAGE && (state == IDLE || state == ASKING || state >= RESTING)      /* stale, or the character's answer */
            :: what != MESSAGE && (state == LOADED || state == REPLYING) && job >= COMMANDS ->
               if
               :: what == LINE -> known = (whose == job)
               :: what == END && known -> state = IDLE; doubt = false; job = 0; known = false
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
       :: else
       fi;
       atomic { what = 0; whose = 0; reading = false };
       if
#ifdef NO_REST
       :: state == RESTING -> state = IDLE
#else
       :: state == RESTING -> if :: !looking -> state = IDLE :: else fi
#endif
       :: state == EMPTIED -> if :: command == 0 -> state = IDLE :: else fi
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
       :: state == IDLE && !doubt && character == 0 ->
          character = QUESTION; state = ASKING
       :: state == ASKING ->                          /* the deadline */
          character = 0;
          atomic { doubt = true; state = IDLE }
#ifdef CHECK_ENDED
       :: state == LOADED || state == REPLYING ->
#else
       :: state == REPLYING || state == LOADED && job < COMMANDS ->
#endif
#ifdef TOLD
          if :: state == LOADED && command != 0 -> told_not = job :: else fi;
#endif
          if
          :: state == LOADED -> command_text = EMPTY + job; atomic { doubt = true; state = EMPTIED; job = 0; known = false }
          :: state == REPLYING -> atomic { doubt = true; state = IDLE; job = 0; known = false }
          fi
#else
       :: atomic { state == REPLYING && job >= COMMANDS && command == 0 && response == 0 && queued == 0 && !working ->
             state = IDLE; job = 0; known = false }                       /* it was lost: PMAC cleared the word for another */
#endif
       :: else
#ifndef PATIENT
       :: true
#endif
       fi
    od
  } unless { atomic { killed -> killed = false; what = 0; whose = 0; reading = false; known = false; job = 0; next = 0; doubt = false; state = IDLE } }
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
