/* Control characters: whether 0x062E alone is enough, or the flag of a line (0x062C) has to be set, too (readings.md,
 * control_flag). The board does one or the other, and the host does not know which.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii/control.rs. Every access to the DPRAM is one step. A line's
 * text is its number; 0 is the empty line. What a board says to an empty line, nothing or an acknowledgement, no text tells.
 *
 * What holds, on a board of either reading: each character is taken once, each line is carried out once, and what is given to a
 * line is its own.
 *
 * A line that lies there when the character comes may be lost with its flag. Its caller is told that it may have been carried out.
 *
 * Times: the host loses his patience with the character at any moment. SETTLE, 50 ms, is longer than two passes.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * NO_FLAG     the host never sets the flag. FAILS (liveness): a board that wants it does not take the character.
 * NO_EMPTY    the host sets the flag and leaves the text of the last line in the buffer. FAILS: the board takes the character after
 *             all, and then carries the line out once more.
 * OVER_LINE   the host sets the flag without looking whether a line lies there. FAILS: it makes the line empty before the board
 *             has seen it.
 * NO_SETTLE   the next line goes as soon as the character is taken. FAILS: an acknowledgement of the empty line ends its reply.
 */
#define LINES 3                                       /* texts 1 and 2 */
#define CHARACTER 1

byte command, command_text;                           /* 0x062C, 0x0630 */
byte character;                                       /* 0x062E */
byte response, response_text;                         /* 0x06D0, 0x06D4 */
byte queued = 0, queue_text[2];                       /* PMAC's own: acknowledgements not put out yet */
byte passes = 0;                                      /* since the host last saw a response, or a command word; saturates at 2 */
byte done[LINES];
byte taken_characters = 0;
bool needs_flag, acknowledges_empty;                  /* the board's readings */
bool finished = false;

inline take_character() { atomic { taken_characters++; assert(taken_characters == 1); character = 0 } }

inline take_line() {
  text = command_text;
  atomic {
    if
    :: text != 0 -> done[text]++; assert(done[text] == 1); queue_text[queued] = text; queued++
    :: text == 0 && acknowledges_empty -> queue_text[queued] = 0; queued++
    :: else
    fi;
    text = 0
  };
  command = 0
}

proctype Pmac() {
  byte text;
  do
  :: if                                               /* one background pass */
     :: needs_flag && command != 0 && character != 0 -> take_character(); command = 0
     :: !needs_flag && character != 0 -> take_character()
     :: else
     fi;
     if
     :: command != 0 && queued < 2 && !(needs_flag && character != 0) -> take_line()
     :: else
     fi;
     if
     :: queued > 0 && response == 0 ->
        response_text = queue_text[0];
        atomic { response = 1; queue_text[0] = queue_text[1]; queue_text[1] = 0; queued-- }
     :: else
     fi;
     atomic { if :: passes < 2 -> passes++ :: else fi }
  od
}

#define IDLE 0
#define REPLYING 1
#define SETTLING 2

proctype Host() {
  byte state, job = 1, whose;
  bool lies, flagged, settles, there, quiet;
  do
  :: atomic { finished = false };
     if
     :: lies && character == 0 ->
        atomic {
          assert(taken_characters == 1);
          lies = false; finished = true; flagged = false;
          if :: settles && state == IDLE -> settles = false; state = SETTLING; passes = 0 :: else fi
        }
     :: lies && character != 0 && !flagged ->
        if
#ifndef NO_FLAG
#ifdef OVER_LINE
        :: true ->
#else
        :: command == 0 ->
#endif
#ifndef NO_EMPTY
           command_text = 0;
#endif
           command = 1;
#ifndef NO_SETTLE
           settles = true;
#endif
           flagged = true
#endif
#ifndef LIVE
        :: true                                       /* not yet */
#else
        :: else
#endif
        fi
     :: !lies && state != SETTLING -> atomic { taken_characters = 0; lies = true }; character = CHARACTER
     :: else
     fi;
     if
     :: state == IDLE && !lies && command == 0 && response == 0 ->
        atomic { job = 3 - job; done[job] = 0 };
        command_text = job;
        atomic { command = 1; passes = 0 };
        state = REPLYING
     :: else
     fi;
     atomic { there = (response != 0); quiet = (passes == 2 && command == 0) };
     if
     :: there ->
        whose = response_text;
        atomic {
          response = 0;
          passes = 0;
          if
          :: state == REPLYING ->
             assert(whose == job && done[job] == 1);
             if :: settles && !lies -> settles = false; state = SETTLING :: else -> state = IDLE fi
          :: else                                     /* stale */
          fi
        }
     :: !there && command != 0 -> passes = 0
     :: !there && quiet -> state = IDLE               /* settled; or the line was taken for the character's flag */
     :: else
     fi;
     atomic { whose = 0; there = false; quiet = false }
  od
}

/* Characters go on to be taken for ever. */
ltl characters_go_on { [] <> finished }

init {
  atomic {
    if :: needs_flag = true :: needs_flag = false fi;
    if :: acknowledges_empty = true :: acknowledges_empty = false fi;
    run Pmac(); run Host()
  }
}
