/* ASCII: command word (0x062C) with its text, control character (0x062E), response word (0x06D0) with its text.
 *
 * Pmac mirrors src/sim/ascii.rs, Host src/function/ascii.rs (`begin`, `step`, `give_up`, `release`) as src/daemon/
 * ascii_desk.rs uses it. Every access to the DPRAM is one step. A command's text is its number; its reply is a line and
 * an acknowledgement, which carry the number too, for the assertions' eyes only. A program on the board sends messages.
 *
 * What holds: a line or an acknowledgement given to a caller belongs to his command; a command told to be done was
 * done once; one given up is told so; nothing is done twice, nor a text mixed of two. Liveness: commands go on for ever.
 *
 * Times: a command's deadline may come at any moment. SETTLE, 50 ms without a response, is longer than PMAC takes for a
 * pass: when it is over, PMAC has looked at the control character and put out what it had to say. The end of it is
 * therefore modelled as "PMAC has made two passes and there was no response".
 *
 * The code lets ten messages begin the silence anew, so that a program that never stops sending does not block the port. It tells
 * a line given up in the buffer as "perhaps" (TOLD), unless the board did not answer the command before either: there the port is
 * off, as far as can be known.
 *
 * MESSAGES_TOO a program's message does not begin the silence anew. FAILS: the host, stopped for a while, takes a message,
 *             finds nothing behind it at once, and begins a command before PMAC has put out the rest of the old reply.
 * -D...       what changes; what FAILS is told as the counterexample goes
 * EARLY       PMAC clears the command word only when the whole reply is in its queue and one response may be out already
 * CRASH       the host is killed anywhere, any number of times (LIVE: once), and started again
 * RESET       the board is reset anywhere, any number of times (LIVE: once), and clears words and queue
 * NO_CANCEL   giving up does not send <CTRL-X>, nor wait. FAILS: the host gives up on command 1; PMAC takes command 2 and
 *             still has the reply to 1 in its queue: its line is told as the answer to 2.
 * NO_START_SETTLE the new host does not let pass what still comes. FAILS with CRASH: a host is killed in the middle of a
 *             reply; the next one clears the response word and begins a command before PMAC has put out the rest.
 * TOLD        a line given up while it still lies in the buffer is told to be not done, instead of perhaps. FAILS: PMAC
 *             has seen the command word and is at it; it clears the word only when it has processed the line.
 * SLOW        PMAC takes longer for a command than a host that has given up on it waits (CANCEL_LIMIT, 500 ms). FAILS:
 *             <CTRL-X> is withdrawn untaken; the late reply comes when the next command is under way. What is known to
 *             take so long (SAVE, a reset) needs a longer deadline, then nothing is given up.
 * INTERRUPT   the host looks only when an interrupt came, and interrupts get lost. FAILS (liveness): a lost one leaves the
 *             response lying; PMAC puts out no other, and so raises no other interrupt. Therefore the desk looks from
 *             time to time although there is an interrupt; spurious ones make it look in vain, as every poll does.
 */
#define COMMANDS 4
#define CANCEL 24
#define LINE 1
#define END 2
#define MESSAGE 3

byte command, command_text;                           /* 0x062C, 0x0630 */
byte character;                                       /* 0x062E */
byte response, response_text;                         /* 0x06D0, 0x06D4 */

byte queue[3], queue_text[3], queued = 0;             /* PMAC's own: responses not put out yet */

byte done[COMMANDS];                                  /* how often PMAC did it */
byte told_not = COMMANDS;                              /* TOLD: the command that the caller believes not done */
byte passes = 0;                                      /* since the host last saw a response; saturates at 2 */
bool killed = false, resetting = false;
bool interrupt = false;
bool finished = false;
bool reading = false;                                 /* the host is between control word and text */

inline say(what, whose) { queue[queued] = what; queue_text[queued] = whose; queued++ }

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
       queue[2] = 0; queue_text[2] = 0; queued--
     }
  :: else
  fi
}

proctype Pmac() {
  byte taken;
  do
  :: {
    do
    :: if                                             /* one background pass */
       :: character != 0 ->
          atomic {
            character = 0;
            queued = 0; queue[0] = 0; queue[1] = 0; queue[2] = 0; queue_text[0] = 0; queue_text[1] = 0; queue_text[2] = 0
          }
       :: else
       fi;
       if
       :: command != 0 && queued < 2 ->
          taken = command_text;
#ifdef SLOW
          if :: passes = 2 :: skip fi;                /* what the host takes for silence */
#endif
          atomic { done[taken]++; assert(done[taken] == 1 && taken != told_not); say(LINE, taken); say(END, taken); taken = 0 };
#ifdef EARLY
          put_out();
#endif
          command = 0
       :: else
       fi;
       if
       #ifndef QUIET
       :: queued == 0 -> say(MESSAGE, COMMANDS)       /* SEND"..." of a program */
#endif
       :: true
       fi;
       put_out();
       atomic { if :: passes < 2 -> passes++ :: else fi }
    od
  } unless {
    atomic {
      resetting -> resetting = false; character = 0; command = 0; response = 0; taken = 0;
      queued = 0; queue[0] = 0; queue[1] = 0; queue[2] = 0; queue_text[0] = 0; queue_text[1] = 0; queue_text[2] = 0
    };
    !reading                                          /* it starts up for longer than the host takes to read a text */
  }
  od
}

/* What the host does next: nothing under way, a line lies there, PMAC has it, what comes is nobody's. */
#define IDLE 0
#define LOADED 1
#define REPLYING 2
#define SETTLING 3

proctype Host() {
  byte state, job, what, whose, seen;
  bool quiet;
  do
  :: {
    response = 0;                                     /* AsciiPort::release, at the start */
    character = 0;
    command = 0;
#ifdef NO_START_SETTLE
    state = IDLE;
#else
    atomic { state = SETTLING; passes = 0 };
#endif
    do
    :: if                                             /* one pass of the desk: the port's step */
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
          seen = command;                             /* is_stale: an acknowledgement while the line lies there still */
          atomic {
            response = 0;
#ifndef MESSAGES_TOO
            passes = 0;
#else
            if :: what != MESSAGE -> passes = 0 :: else fi;
#endif
            if
            :: what == MESSAGE
            :: what == END && state == LOADED && seen != 0                /* in doubt */
            :: what == LINE && (state == LOADED || state == REPLYING) -> assert(whose == job)
            :: what == END && (state == LOADED && seen == 0 || state == REPLYING) ->
               assert(whose == job && done[job] == 1);                    /* told: done */
               state = IDLE; finished = true
            :: what != MESSAGE && (state == IDLE || state == SETTLING)    /* stale */
            fi
          }
       :: else -> if
          :: state == SETTLING && quiet ->                                /* SETTLE is over */
             what = character;
             if
             :: what == 0 -> state = IDLE
#ifdef SLOW
             :: what != 0 -> character = 0; state = IDLE                  /* CANCEL_LIMIT is over */
#else
             :: what != 0
#endif
             fi
          :: else
          fi
       fi;
       atomic { what = 0; whose = 0; seen = 0; quiet = false; reading = false };
       if
       :: state == IDLE ->                            /* begin */
          if
          :: response == 0 ->
             if
             :: command == 0 ->
                atomic { job = (job + 1) % COMMANDS; done[job] = 0; told_not = COMMANDS };
                command_text = job;
                command = 1;
                state = LOADED
             :: else
             fi
          :: else
          fi
#ifndef PATIENT
       :: state == LOADED ->                          /* the deadline: give_up; told: not done, or in doubt */
#ifdef NO_CANCEL
          command = 0; state = IDLE
#else
          seen = command;
#ifdef TOLD
          if :: seen != 0 -> told_not = job :: else fi;
#endif
          command = 0;
          if
          :: seen == 0 -> character = CANCEL
          :: else
          fi;
          atomic { state = SETTLING; passes = 0; seen = 0 }
#endif
       :: state == REPLYING ->                        /* told: in doubt */
#ifdef NO_CANCEL
          state = IDLE
#else
          character = CANCEL;
          atomic { state = SETTLING; passes = 0 }
#endif
#endif
       :: else
#ifndef PATIENT
       :: true
#endif
       fi
    od
  } unless { atomic { killed -> killed = false; what = 0; whose = 0; seen = 0; quiet = false; reading = false; state = IDLE } }
  od
}

proctype Chaos() {
#ifdef CRASH
  do
  :: killed = true; !killed
#ifdef LIVE
     ; break
#endif
  :: break
  od;
#endif
#ifdef RESET
  do
  :: resetting = true; !resetting
#ifdef LIVE
     ; break
#endif
  :: break
  od;
#endif
  skip
}

/* Commands go on to be told done for ever, if the host may wait (PATIENT: no deadline). */
ltl commands_go_on { [] <> finished }

init { atomic { run Pmac(); run Host(); run Chaos() } }
