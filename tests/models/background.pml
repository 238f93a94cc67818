/* Background fixed data: Data-Ready (0x0228), the report's servo timer (0x022A), and two words that stand for the data. On Turbo
 * (0x067A, 0x0678) the same, with a Host-Busy (0x0676), and PMAC clears Data-Ready before it copies (Turbo User Manual p. 405).
 * With I50=0 it makes a report while Data-Ready is clear, as on PMAC; else by itself (p. 403).
 *
 * Pmac mirrors src/sim/background_report.rs, Host src/function/background.rs with the order of src/mirror/background.rs: a
 * report is asked for when it is due. Every access to the DPRAM is one step.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * CRASH       the host is killed anywhere, any number of times (LIVE: once), and started again
 * RESET       the board is reset anywhere, once, and clears Data-Ready and timer; its timer goes on by one meanwhile (that
 *             the new report has the very timer of the old one is not modelled: 1 in 65536). With TURBO Host-Busy is set then, or
 *             as it was.
 * TURBO       PMAC makes reports by itself, unless Host-Busy is set, which a dead or other host may have left
 * FAST        with TURBO and LIVE: PMAC makes the next report as soon as the host has seen that one is there, and each read takes
 *             longer than that. Neither acts between the other's look at a bit and what it does then.
 * NO_HOLD     it is not set. FAILS with FAST (liveness): each report is overtaken while it is read.
 * NO_RELEASE  the host does not clear Host-Busy when it asks. FAILS with TURBO (liveness): PMAC makes no report.
 * NO_AGAIN    the host does not ask again when no report comes. FAILS with TURBO and RESET (liveness): Host-Busy is set at the
 *             reset, and nobody clears it.
 * TIMER_FIRST at the end the host reads the timer again, then Data-Ready. FAILS with TURBO: PMAC has cleared Data-Ready and
 *             written the second word, which the host reads; it reads the timer, still the old one, and Data-Ready when PMAC
 *             has set it.
 * NO_REREAD   the host does not read Data-Ready and timer again before it believes the report. FAILS with RESET: the host
 *             has read the first word; the board is reset and makes a new report; the host reads the second word.
 *             FAILS with TURBO without a reset.
 * ASK_EARLY   the host asks for the next report when it has read one, not when one is due. FAILS: PMAC makes it at once,
 *             and what the host reads when it is due is a period old.
 */
#define NUMBERS 4

bit ready;
#ifdef TURBO
bit host_busy = 1;
bool copying = false, looked = false;                 /* ghosts, and how many reports were begun since the copy was */
byte made = 0;
#endif
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
#ifdef TURBO
    :: atomic {                                       /* one is due; no copy lasts a turn of the numbers */
#ifdef LIVE
         (!ready || looked) ->                        /* there is time for a look between two reports */
#endif
         (!copying || made < NUMBERS - 2) ->
         if :: copying -> made++ :: else fi;
         updated = false; if :: host_busy -> goto pass :: else fi;
#ifndef FAST
       };
       ready = 0;
#else
         ready = 0
       };
#endif
       word[0] = number;
#else
    :: !ready ->                                      /* one background pass */
       atomic { word[0] = number; updated = false };
#endif
       word[1] = number;
       timer = 1 + number;
       atomic { ready = 1; updated = true; is_old = false; number = (number + 1) % NUMBERS };
#ifdef TURBO
pass:  looked = false
#endif
    od
  } unless { atomic { resetting -> resetting = false; ready = 0; timer = 0; number = (number + 1) % NUMBERS
#ifdef TURBO
    ; looked = false;
    if :: copying -> made++ :: else fi;
    if :: host_busy = 1 :: skip fi                    /* as its power finds it, or as before */
#endif
  } }
  od
}

proctype Host() {
  byte copy[2], stamp, again;
#ifdef TURBO
  bit overtaken = 0;                                  /* the last report was, by the next one */
#endif
  do
  :: {
    ready = 0;                                        /* BackgroundReader::release, at the start */
    do
    :: is_old = true;                                 /* a report is due */
#ifndef ASK_EARLY
#if defined(TURBO) && !defined(NO_RELEASE)
       host_busy = 0;
#endif
       ready = 0;                                     /* BackgroundReader::ask */
#endif
#ifdef TURBO
#ifdef FAST
look:  if
       :: atomic { ready -> taken = false; copying = true; made = 0; looked = true;
#ifndef NO_HOLD
            if :: overtaken -> host_busy = 1 :: else fi
#endif
          }
#if defined(RESET) && !defined(NO_AGAIN)
       :: !ready && host_busy -> goto due
#endif
       fi;
#else
look:  if
       :: atomic { ready -> taken = false; copying = true; made = 0 }
#if defined(RESET) && !defined(NO_AGAIN)
       :: !ready && host_busy -> goto due             /* nothing for so long that the reports are stale */
#endif
       fi;
       if
       :: overtaken ->
          host_busy = 1;                              /* PMAC begins no other meanwhile */
          if
          :: !ready -> host_busy = 0; goto gone
          :: else
          fi
       :: else
       fi;
#endif
#else
look:  atomic { ready -> taken = false };
#endif
       stamp = timer;
       copy[0] = word[0];                             /* one look reads one block; servo data come between */
       copy[1] = word[1];
#ifndef NO_REREAD
#ifdef TIMER_FIRST
       again = timer;
#endif
       if
       :: !ready -> goto gone
       :: else
       fi;
#ifndef TIMER_FIRST
       again = timer;
#endif
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
gone:  atomic { copy[0] = 0; copy[1] = 0; stamp = 0; again = 0;
#ifdef TURBO
         copying = false; looked = true; overtaken = 1;
#endif
       };
#ifdef TURBO
       host_busy = 0;                                 /* BackgroundReader::let_go */
#endif
       goto look;
#ifdef TURBO
due:   atomic { copying = false; looked = true };
       if
       :: overtaken -> host_busy = 0
       :: else
       fi;
       overtaken = 0
#else
due:   skip
#endif
    od
  } unless { atomic { killed -> killed = false
#ifdef TURBO
    ; copying = false; overtaken = 0
#endif
  } }
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
