/* A stop (^A, ^K) goes over the line under way, of one part or of two (DPRAM manual p. 28). A board may look at the control
 * character before the line that lies there, or while it is at one.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii/stop.rs with ascii/hold.rs. Every access to the DPRAM is one
 * step. What the board is told to do is to move. Replies are ascii.pml's: that the host's own line was answered is one bit here.
 *
 * What holds: before the next line nothing moves that was sent before the stop. No half of a line is carried out.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * GO_ON       the second part is handed over after the stop. FAILS: PMAC has forgotten the first, and carries the second out alone.
 * EMPTY_LINE  an empty line is handed over with the stop, whatever PMAC has. FAILS: it ends the first part, which PMAC carries out.
 * NO_CANCEL   PMAC is not told to forget the first part. FAILS: the next line is put behind it.
 * ONCE        the stop goes once. FAILS: PMAC had seen the line, takes the stop, and carries the line out.
 * NO_SETTLE   the stop goes once more when it was taken the first time. FAILS: PMAC is still at the line.
 * LEFT        a line that lies there stays, and the stop goes once. FAILS: PMAC takes the stop before the line.
 */
#define EMPTY 0
#define WHOLE 1
#define FIRST 2                                       /* has no NUL */
#define SECOND 3
#define CHECK 4                                       /* the host's own line */

byte flag, text;                                      /* 0x062C, 0x0630 */
bool stop, cancel;                                    /* the control character in 0x062E */
bool moves = false;
bool working = false;                                 /* PMAC is between the flag's two changes */
bool answered = false;

proctype Pmac() {
  byte taken;
  bool half = false;                                  /* it has the first part of a line */
  do
  :: atomic { flag != 0 -> working = true };
     taken = text;
     do
     :: atomic { stop -> moves = false; stop = false }
     :: break
     od;
     atomic {
       if
       :: taken == FIRST -> assert(!half); half = true
       :: taken == SECOND -> assert(half); half = false; moves = true
       :: taken == WHOLE -> assert(!half); moves = true
       :: taken == EMPTY -> assert(!half)
       :: taken == CHECK -> assert(!half); answered = true
       fi;
       taken = EMPTY
     };
     atomic { flag = 0; working = false }
  :: atomic { stop -> moves = false; stop = false }
  :: atomic { cancel -> half = false; cancel = false }
  od
}

inline hand_over(part) {
  text = part;
  flag = 1;
  if
  :: flag == 0
  :: stops = true
  fi
}

proctype Host() {
  bool stops = false, two = false;
  do
  :: if
     :: two = false; hand_over(WHOLE)
     :: two = true; hand_over(FIRST);
        if
        :: !stops -> if :: hand_over(SECOND) :: stops = true fi
        :: else
        fi
     fi;
     if
     :: stops ->
#ifndef LEFT
        if
        :: two -> flag = 0
        :: !two -> if :: flag != 0 -> text = EMPTY :: else fi
        fi;
#endif
        stop = true;
#ifdef EMPTY_LINE
        if :: flag == 0 -> text = EMPTY; flag = 1 :: else fi;
#endif
        !stop;
#ifdef GO_ON
        if :: two -> text = SECOND; flag = 1 :: else fi;
#endif
#ifndef NO_CANCEL
        if :: two -> cancel = true; !cancel :: else fi;
#endif
#ifndef NO_SETTLE
        answered = false;
        do
        :: answered -> break
        :: atomic { !answered && flag == 0 && !working -> text = CHECK; flag = 1 }   /* again, where PMAC cleared it for another */
        od;
#endif
#if !defined(ONCE) && !defined(LEFT)
        stop = true;
        !stop;
#endif
        !working;
        assert(!moves);
        stops = false
     :: else
     fi
  od
}

init { atomic { run Pmac(); run Host() } }
