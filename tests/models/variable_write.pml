/* Background variable write. The control panel's requests go by the same handshake. The host writes what is
 * to be done (two words here: a record's address and data; the request words of two motors), then the count (0x07D4) or
 * enable mask (0x0000). PMAC does it, and writes 0 to say so.
 *
 * Pmac mirrors src/sim/functions/variable_write.rs (panel.rs), word by word; Host src/function/variable_write.rs and
 * src/daemon/bus/work/write.rs (src/function/panel.rs and src/daemon/bus/work/panel.rs). Every access to the DPRAM is one step;
 * so is the deed itself. Jobs are numbered, and both words of a job carry its number. A host that gives a job up takes the count
 * back, and lets the words rest until a pass that may have seen it is over.
 *
 * What holds: a job told to be done was done exactly once and as asked; a job given up was done once or not at all.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * STOP        after a job that was given up, and after the start, a stop (of the panel) may come, which does not wait for the rest:
 *             it goes at once, and then once more. What holds: once it is told to be done, it is what both motors did last.
 * CRASH       the host is killed anywhere, any number of times, and started again
 * NO_REST     the next job after one given up goes at once. FAILS: PMAC does half of the one and half of the other, or its 0 for
 *             the first one is taken for the next one done.
 * NO_START_REST the new host does not wait either. FAILS with CRASH: the same, across a restart.
 * ONCE        the stop goes once. FAILS with STOP: PMAC's 0 for what was withdrawn is taken for the stop done.
 * RESET       the board is reset anywhere, once, and clears the count. FAILS: the host takes it for done. From the word
 *             alone nobody could tell; the host learns of a reset from the servo timer, too late for this.
 */
#define JOBS 4
#define A_STOP 4                                      /* the words of a stop; 5 is the other number it may have */

byte count;
byte word[2];

byte done[JOBS];                                      /* how often; 2 is too often */
byte last[2];                                         /* what each motor did last */
byte job = 0;                                         /* the one that the host is at */
byte stop = A_STOP;
bool in_pass = false;                                 /* PMAC has seen the count and not cleared it */
bool killed = false, resetting = false;

proctype Pmac() {
  byte a, b;
  do
  :: {
    do
    :: atomic { count != 0 -> in_pass = true };            /* one background pass */
       a = word[0];
       atomic {
         b = word[1];
         if
         :: a >= A_STOP || b >= A_STOP                /* a stop may lie over half of what was withdrawn */
         :: else -> assert(a == b && done[a] == 0); done[a]++
         fi;
         last[0] = a; last[1] = b;
         a = 0; b = 0
       };
       count = 0;
       in_pass = false
    od
  } unless { atomic { resetting -> resetting = false; in_pass = false; count = 0; a = 0; b = 0 } }
  od
}

inline put(number) {
  word[0] = number;
  word[1] = number;
  count = 1
}

/* What a host does before its next job, once it has taken a count back. */
inline rest() {
#ifdef STOP
  if
  :: stop = (A_STOP + A_STOP + 1) - stop;
     put(stop);
     count == 0;
#ifndef ONCE
     put(stop);
     count == 0;
#endif
     assert(last[0] == stop && last[1] == stop)
  :: skip
  fi;
#endif
  !in_pass                                            /* SETTLE */
}

proctype Host() {
  do
  :: {
    count = 0;                                        /* VariableWriter::release, Panel::withdraw */
#ifndef NO_START_REST
    rest();
#endif
    do
    :: atomic { count == 0 -> job = (job + 1) % JOBS; done[job] = 0 };
       put(job);
       if
       :: atomic { count == 0 -> assert(done[job] == 1) }                 /* told: done */
       :: count = 0;                                                      /* told: given up, perhaps done */
#ifndef NO_REST
          rest()
#endif
       fi
    od
  } unless { atomic { killed -> killed = false } }
  od
}

proctype Chaos() {
#ifdef CRASH
  do
  :: killed = true; !killed
  :: break
  od;
#endif
#ifdef RESET
  resetting = true;
#endif
  skip
}

init { atomic { run Pmac(); run Host(); run Chaos() } }
