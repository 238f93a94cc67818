/* ASCII replies: what lies under the end mark (readings.md, reply_ack). The end comes with an empty text, over the text before, or
 * with the last line itself. The board does one of them, and the host does not know which.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii.rs with ascii/response_buffer.rs. Every access to the DPRAM is
 * one step. A text is the number of the line that it answers, 0 the NUL. A reply has one line, or none, or is an error, in
 * whose text the board may put anything. Between two replies a program may send a message.
 *
 * What holds, on a board of each reading: a reply has the line that belongs to it, once, and no other.
 *
 * Times: a new host begins when the board is done with what the one before had asked.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * CRASH       the host is killed anywhere, once, and started again
 * NO_NUL      the host leaves the text where it lies. FAILS: an end over the text before passes for a last line.
 * NUL_LATER   the host clears the control word, then the text. FAILS: the board has put the next text there meanwhile.
 * NOT_ERRORS  no NUL after an error, whose text is not read. FAILS: the next end lies over that text.
 * NO_QUESTION a new host does not wait until the board has answered a question of his own. FAILS: the text that the power-on or the
 *             host before left is still there.
 */
#define LINE 1
#define END 2
#define ERROR 3
#define MESSAGE 4
#define ALONE 0
#define OVER_TEXT 1
#define ON_LINE 2
#define OTHER 9                                       /* the text of a message or an error */

byte line, wanted;                                    /* the line under way: its number, and how many lines its reply has */
byte control, text;                                   /* 0x06D0, 0x06D4 */
byte ends;                                            /* the board's reading */
bool ended;                                           /* PMAC has put out the whole reply */
bool question = false;                                /* waits for PMAC */
bool killed = false;

inline put(what, whose) { control == 0; text = whose; control = what }

proctype Pmac() {
  byte taken;
  do
  :: line != 0 -> atomic { taken = line; line = 0 };
     if
     :: wanted == 3 -> if :: put(ERROR, OTHER) :: control == 0; control = ERROR fi
     :: wanted == 1 && ends == ON_LINE -> put(END, taken)
     :: wanted == 1 && ends != ON_LINE -> put(LINE, taken);
        if :: ends == ALONE -> put(END, 0) :: else -> control == 0; control = END fi
     :: wanted == 0 -> if :: ends == OVER_TEXT -> control == 0; control = END :: else -> put(END, 0) fi
     fi;
     ended = true
  :: line == 0 && ended && question -> atomic { question = false; ended = false }; put(LINE, OTHER); ended = true
  :: line == 0 && ended -> put(MESSAGE, OTHER)         /* SEND"..." of a program */
  od
}

inline take() {
  what = control;
  if
  :: what == ERROR
  :: else -> whose = text
  fi;
#ifdef NUL_LATER
  control = 0;
  text = 0
#else
  if
#ifdef NO_NUL
  :: skip
#else
#ifdef NOT_ERRORS
  :: what == ERROR
#endif
  :: what == END && whose == 0
  :: else -> text = 0
#endif
  fi;
  control = 0
#endif
}

proctype Host() {
  byte what, whose, number, lines;
  do
  :: {
    control = 0;                                      /* `release`, at the start */
#ifndef NO_QUESTION
    question = true;                                  /* held: the board answers a question */
#endif
    do
    :: control != 0 -> take()
    :: control == 0 && ended && !question -> break
    od;
    do
    :: control != 0 -> take()                         /* nobody's */
    :: control == 0 ->
       atomic {
         number = number % 3 + 1; lines = 0; what = 0; ended = false;
         if :: wanted = 0 :: wanted = 1 :: wanted = 3 fi;
         line = number
       };
       do
       :: control != 0 ->
          take();
          atomic {
            if
            :: what == LINE -> assert(whose == number); lines++
            :: what == END -> if :: whose != 0 -> assert(whose == number); lines++ :: else fi;
               assert(lines == wanted)
            :: else
            fi
          };
          if :: what == END || what == ERROR -> break :: else fi
       od
    od
  } unless { atomic { killed -> killed = false; what = 0; whose = 0; lines = 0 } }
  od
}

proctype Chaos() {
#ifdef CRASH
  if :: killed = true; !killed :: skip fi;
#endif
  skip
}

init {
  atomic {
    if :: ends = ALONE :: ends = OVER_TEXT :: ends = ON_LINE fi;
    text = OTHER;                                     /* as at power-on */
    ended = true;
    run Pmac(); run Host(); run Chaos()
  }
}
