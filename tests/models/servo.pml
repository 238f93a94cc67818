/* Servo fixed data: Host-Busy (0x0024), PMAC's status word (0x0026), and two words that stand for the data.
 *
 * Pmac mirrors src/sim/servo_report.rs, Host src/function/servo.rs (`look`, `copy`, `release`) with the rules of
 * src/mirror/servo.rs. Every access to the DPRAM is one step; what a side thinks between two accesses goes with the
 * access before it. The data words carry the number of their update.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * HANDSHAKE   the host sets Host-Busy around each read; without it the reading is optimistic
 * NO_REREAD   the status word is not read again after the data: with HANDSHAKE this is the manual's procedure.
 *             FAILS: PMAC tests Host-Busy and finds it clear; the host sets it, and reads PMAC-Busy: clear; PMAC, which
 *             has tested already, sets PMAC-Busy and writes the first word; the host reads both words, the first new,
 *             the second old, and believes them.
 *             So the manual's procedure guarantees only that no update *begins by a test* made after Host-Busy was seen
 *             set. It is whole if PMAC makes test and set in one piece (ONE_PIECE) - about which no text says anything.
 * ONE_PIECE   PMAC tests Host-Busy and sets PMAC-Busy in one step
 * CRASH       the host is killed anywhere, any number of times (LIVE: once), and started again
 * NO_RELEASE  ... and does not clear Host-Busy at its start. FAILS: killed while Host-Busy is set, before an update it
 *             has not seen: PMAC skips every update from then on, the new host sees no new timer, and never gets as far
 *             as to set and clear the bit itself.
 * TURN        the host may sleep in the middle of a copy while the timer goes once around; FAILS with NO_LIMIT: the two
 *             readings of the status word are equal, the words read between them a turn apart. A copy that took longer
 *             than a limit has to be discarded; the code has no limit yet, it is NO_LIMIT.
 * RESET       the board is reset anywhere, once: it clears the buffer from its lowest address up, and its timer starts
 *             at 0, which the mirror sees as a jump that the clock does not explain; the copy that shows it is dropped.
 *             AT_ZERO, also while the timer is 0, FAILS: status 0 before, reset, status 0 after: of the resets that hit
 *             a copy, one in 32768. FROM_TOP, the board clears from the highest address down, FAILS: the copy ends when
 *             the data are cleared and the status word is not yet. No host can see either; a sample is wrong then.
 */
#define TURN_OF_TIMER 4
#define LIMIT 3  /* cycles; a copy that took so long is discarded. Less than a turn, as the timer runs ahead of its word */
#define BUSY 8
#ifdef LIVE
#define NUMBERS 1  /* what the data are does not matter */
#else
#define NUMBERS 4
#endif

bit host_busy;
byte status;
byte word[2];

/* Ghosts: nobody on either side reads them, but for the time that a clock would tell. */
byte number = 0;      /* of the update that PMAC makes, modulo NUMBERS */
byte cycles = 0;      /* servo cycles since the copy's first status reading; saturates */
bool copying = false;
bool killed = false, resetting = false;
bool updated = false, taken = false;
byte looks_ended = 0; /* PACE: since the last update ended */
bool jump = false;    /* the timer went back to 0 from somewhere else */

inline tick() { if :: copying && cycles < LIMIT -> cycles++ :: else fi; updated = false }

inline clear_status() { atomic { jump = (status & (BUSY - 1)) != 0; status = 0 } }

proctype Pmac() {
  byte timer = 0;
  do
  :: {
    do
    :: atomic {                                       /* one servo cycle; the update is due */
#ifdef PACE
         looks_ended == 2 ->
#endif
#ifndef TURN
         /* Without TURN no copy lasts as long as that. */
         (!copying || cycles < LIMIT - 1) ->
#endif
         timer = (timer + 1) % TURN_OF_TIMER; tick();
         if
         :: host_busy -> goto due                     /* test Host-Busy */
         :: else
         fi;
#ifdef ONE_PIECE
         status = status | BUSY; number = (number + 1) % NUMBERS;
       }
#else
       };
       atomic { status = status | BUSY; number = (number + 1) % NUMBERS };
#endif
       word[0] = number;
       word[1] = number;
       status = timer | BUSY;
       atomic { status = timer; updated = true };
due:   looks_ended = 0
    od
  } unless { atomic { resetting -> resetting = false; timer = 0 } };
#ifdef FROM_TOP
    word[1] = 0; word[0] = 0; clear_status();
#else
    clear_status(); word[0] = 0; word[1] = 0;
#endif
    cycles = LIMIT                                    /* it starts up for longer than a copy may last */
  od
}

proctype Host() {
  byte before, after, last, looks;
  byte copy[2];
  bool first;
  do
  :: {
#ifndef NO_RELEASE
    host_busy = 0;                                    /* ServoReader::release, at the start */
#endif
    atomic { first = true; last = 0; before = 0; after = 0; copy[0] = 0; copy[1] = 0; looks = 0; copying = false };
    do
    :: atomic {
         before = status; taken = false;
         copying = true; cycles = 0;
         if
         :: before & BUSY -> goto done
         :: else
         fi;
         if
         :: first -> first = false; last = before; goto done
         :: !first && before == last -> goto done
         :: else
         fi
       };
#ifdef HANDSHAKE
       host_busy = 1;
       looks = 0;
       do
       :: atomic {
            before = status; cycles = 0;
            if
            :: before & BUSY -> looks++
            :: else -> break
            fi;
            if
            :: looks == 2 -> goto release
            :: else
            fi
          }
       od;
#endif
       copy[0] = word[0];
       copy[1] = word[1];
#ifdef NO_REREAD
       after = before;
#else
       after = status;
#endif
       atomic {
         if
         :: after != before
#ifndef NO_LIMIT
         :: after == before && cycles == LIMIT                    /* the mirror's limit */
#endif
         :: after == before && cycles < LIMIT && jump && after == 0 -> jump = false; last = after  /* the mirror's rule */
         :: else -> assert(copy[0] == copy[1]); last = after; taken = true
         fi
       };
release:
#ifdef HANDSHAKE
       host_busy = 0;
#endif
done:  atomic { copying = false; cycles = 0; copy[0] = 0; copy[1] = 0; before = 0; after = 0; looks = 0;
#ifdef PACE
              if :: looks_ended < 2 -> looks_ended++ :: else fi
#endif
            }
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
  atomic {
#ifndef AT_ZERO
    (status & (BUSY - 1)) != 0 ->
#endif
    resetting = true
  }
#endif
  skip
}

init { atomic { run Pmac(); run Host(); run Chaos() } }

/* PMAC is not stopped for ever, whatever the host does or did. */
ltl pmac_goes_on { [] <> updated }
/* Where a look fits between two updates (PACE), the host gets data for ever. */
ltl host_gets { [] <> taken }
