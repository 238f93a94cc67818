/* Background fixed data: Data-Ready (0x0228), the report's servo timer (0x022A), and two words that stand for the data.
 *
 * Pmac mirrors src/sim/background_report.rs, Host src/function/background.rs with the order of src/mirror/background.rs: a
 * report is asked for when it is due. Every access to the DPRAM is one step.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * CRASH       the host is killed anywhere, any number of times (LIVE: once), and started again
 * RESET       the board is reset anywhere, once, and clears Data-Ready and timer; its timer goes on by one meanwhile (that
 *             the new report has the very timer of the old one is not modelled: 1 in 65536).
 * NO_REREAD   the host does not read Data-Ready and timer again before it believes the report. FAILS with RESET: the host
 *             has read the first word; the board is reset and makes a new report; the host reads the second word.
 * ASK_EARLY   the host asks for the next report when it has read one, not when one is due. FAILS: PMAC makes it at once,
 *             and what the host reads when it is due is a period old.
 */
#define NUMBERS 4

bit ready;
byte timer;
byte word[2];

byte number = 0;                                      /* of the report, modulo NUMBERS; the timer goes with it */
bool killed = false, resetting = false;
bool is_old = true;                                   /* ghost: the report was ready before one was due */
bool updated = false, taken = false;

proctype Pmac() {
  do
  :: {
    do
    :: !ready ->                                      /* one background pass */
       atomic { word[0] = number; updated = false };
       word[1] = number;
       timer = 1 + number;
       atomic { ready = 1; updated = true; is_old = false; number = (number + 1) % NUMBERS }
    od
  } unless { atomic { resetting -> resetting = false; ready = 0; timer = 0; number = (number + 1) % NUMBERS } }
  od
}

proctype Host() {
  byte copy[2], stamp, again;
  do
  :: {
    ready = 0;                                        /* BackgroundReader::release, at the start */
    do
    :: is_old = true;                                 /* a report is due */
#ifndef ASK_EARLY
       ready = 0;                                     /* BackgroundReader::ask */
#endif
look:  atomic { ready -> taken = false };
       stamp = timer;
       copy[0] = word[0];                             /* one look reads one block; servo data come between */
       copy[1] = word[1];
#ifndef NO_REREAD
       if
       :: !ready -> goto gone
       :: else
       fi;
       again = timer;
       if
       :: again != stamp -> goto gone
       :: else
       fi;
#endif
       atomic { assert(copy[0] == copy[1] && stamp == 1 + copy[0] && !is_old); taken = true };
#ifdef ASK_EARLY
       ready = 0;
#endif
       atomic { copy[0] = 0; copy[1] = 0; stamp = 0; again = 0; goto due };
gone:  atomic { copy[0] = 0; copy[1] = 0; stamp = 0; again = 0; goto look };
due:   skip
    od
  } unless { atomic { killed -> killed = false } }
  od
}

proctype Chaos() {
#ifdef CRASH
#ifdef LIVE
  if :: killed = true :: skip fi;
#else
  do
  :: killed = true; !killed
  :: break
  od;
#endif
#endif
#ifdef RESET
  resetting = true;
#endif
  skip
}

init { atomic { run Pmac(); run Host(); run Chaos() } }

/* PMAC is not stopped for ever, and the host gets reports for ever. */
ltl pmac_goes_on { [] <> updated }
ltl host_gets { [] <> taken }
