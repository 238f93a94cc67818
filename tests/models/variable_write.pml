/* Background variable write. The control panel's requests go by the same handshake. The host writes what is
 * to be done (two words here: a record's address and data; the request words of two motors), then the count (0x07D4) or
 * enable mask (0x0000). PMAC does it, and writes 0 to say so.
 *
 * Pmac mirrors src/sim/functions/variable_write.rs (panel.rs), word by word; Host src/function/variable_write.rs and
 * src/daemon/bus/work/write.rs (src/function/panel.rs and src/daemon/bus/work/panel.rs). Every access to the DPRAM is one step;
 * so is the deed itself. Jobs are numbered, and both words of a job carry its number. PMAC may take any time between the deed
 * and its 0, whatever the host has written meanwhile.
 *
 * A question is a job that does nothing but leave its number where the host reads it (variable write), or nothing at all
 * (a panel request for nothing, told from its mask's being cleared once: PMAC clears at most once for what it was at).
 *
 * What holds: a job told to be done was done exactly once and as asked; a job given up was done once or not at all.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * PANEL       the question is the panel's: its number is not read
 * CRASH       the host is killed anywhere, any number of times, and started again
 * NO_QUESTION the next job after one given up goes without a question. FAILS: PMAC has done the job; the host, at its
 *             deadline, takes the count back, and writes the next job with its count; PMAC writes the 0 of the first one,
 *             which the host takes for the next job done.
 * NO_START_QUESTION the new host asks no question either. FAILS with CRASH: the same, across a restart.
 * NO_REST     what lies in the words is written over before a pass that may have seen it has read it. FAILS: PMAC does half of
 *             the one and half of the other. (The rest is SETTLE; a panel request of one word each needs none.)
 * RESET       the board is reset anywhere, once, and clears the count. FAILS: the host takes it for done. From the word
 *             alone nobody could tell; the host learns of a reset from the servo timer, too late for this.
 * NO_RELEASE  the host does not clear the count at its start. FAILS with CRASH: PMAC begins with what a dead host left while the
 *             question is written over it.
 */
#define JOBS 4
#define QUESTION 4                                    /* the words of a question; 5 is the other number it may have */

byte count;
byte word[2];
byte answer;

byte done[JOBS];                                      /* how often; 2 is too often */
byte job = 0;                                         /* the one that the host is at */
byte asked = QUESTION;
bool reading = false;                                 /* PMAC has seen the count and not read all words */
bool killed = false, resetting = false;

proctype Pmac() {
  byte a, b;
  do
  :: {
    do
    :: atomic { count != 0 -> reading = true };            /* one background pass */
       a = word[0];
       atomic {
         b = word[1];
         reading = false;
         assert(a == b);                              /* never half of one and half of another */
         if
         :: a >= QUESTION -> answer = a
         :: else -> assert(done[a] == 0); done[a]++
         fi;
         a = 0; b = 0
       };
       count = 0
    od
  } unless { atomic { resetting -> resetting = false; reading = false; count = 0; a = 0; b = 0 } }
  od
}

/* Asks until PMAC has shown that it is at nothing else. */
inline ask() {
#ifndef NO_REST
  !reading;                                           /* SETTLE */
#endif
  asked = (asked == QUESTION -> QUESTION + 1 : QUESTION);
  word[0] = asked;
  word[1] = asked;
#ifndef PANEL
  answer = 0;
#endif
  count = 1;
  do
  :: atomic { count == 0 ->
#ifdef PANEL
       break
#else
       if
       :: answer == asked -> break
       :: else
       fi
#endif
     };
     count = 1
  od
}

proctype Host() {
  do
  :: {
#ifndef NO_RELEASE
    count = 0;                                        /* VariableWriter::release, Panel::withdraw */
#endif
#ifndef NO_START_QUESTION
    ask();
#endif
    do
    :: atomic { count == 0 -> job = (job + 1) % JOBS; done[job] = 0 };
       word[0] = job;
       word[1] = job;
       count = 1;
       if
       :: atomic { count == 0 -> assert(done[job] == 1) }                 /* told: done */
       :: count = 0;                                                      /* told: given up, perhaps done */
#ifndef NO_QUESTION
          ask()
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
