/* Turbo's motor report: Host-Busy (0x006A), the timer's low word (0x006C), PMAC's word (0x006E: Data-Ready, and the timer's high
 * bits), the mask of motors (0x0070), and one word each of two motors. The report of PMAC is in servo.pml.
 *
 * Pmac mirrors src/sim/functions/servo_report.rs, Host src/function/servo.rs (`poll`, `keep_mask`, `copy_held`, `copy`, `take`,
 * `release`). Every access to the DPRAM is one step; what a side thinks between two accesses goes with the access before it.
 * The data carry the number of their update, and so does the timer. That a reset may lose the mask is not here.
 *
 * What the rules rest on: PMAC tests Host-Busy, clears Data-Ready, copies the masked motors, stores the timer, sets Data-Ready
 * (Turbo User Manual p. 403). On request (I47=0) it makes a report only while Data-Ready is clear. With I57=1 PMAC makes the report with the one of the
 * background (p. 403), whether this one was taken or not: for its reader that is a report that comes by itself.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * ON_REQUEST  PMAC makes no report before the host has taken the last one; else reports come by themselves
 * HANDSHAKE   the host sets Host-Busy around each read; without it the reading is optimistic
 * NO_REREAD   PMAC's word and the timer are not read again after the data. FAILS, with HANDSHAKE too: PMAC has
 *             tested Host-Busy; the host sets it, reads Data-Ready, and the first motor; PMAC clears Data-Ready and writes both.
 * FLAG_LAST   they are, but the timer before the word with Data-Ready. FAILS: the first motor is read; PMAC clears Data-Ready and writes
 *             the second, which is read, too; the timer is read, still the old one; PMAC stores the new one and sets Data-Ready.
 * SPLIT       PMAC writes the timer's high bits, then sets Data-Ready beside them. FAILS: the host takes the
 *             report before by writing the word as it read it; the high bits of then meet Data-Ready of now. One update in 65536
 *             has other high bits than the one before, so this is a limit of the interface that is told and not mended.
 * NO_TAKE     the host does not clear Data-Ready. FAILS with ON_REQUEST (liveness): PMAC makes no other report.
 * BUSY_FIRST  the host sets Host-Busy, then waits for Data-Ready, as the steps are printed. FAILS with ON_REQUEST (liveness): where
 *             nothing is ready yet, PMAC waits for Host-Busy, and the host for PMAC.
 * CRASH       the host is killed anywhere, any number of times (LIVE: once), and started again
 * NO_RELEASE  ... and does not clear Host-Busy at its start. FAILS with HANDSHAKE: PMAC is stopped for ever.
 * RESET       the board is reset anywhere, once: Data-Ready and timer are cleared, and Host-Busy is set or as it was
 * NO_SPEAK    ... and the host does not clear Host-Busy when the data are stale. FAILS (liveness): PMAC is stopped for ever.
 * OTHER       another host takes motor 2 out of the mask, once. PMAC leaves its word as it was ("blocks of unmasked motors keep
 *             old data"); so may the host's copies for two updates, here, until it reads the mask again.
 * NO_MASK     the host does not read the mask again. FAILS with OTHER: an old word passes for new for ever.
 */
#define READY 2
#define NUMBERS 16   /* of updates: 3 bits in the low word of the timer, 1 in the high one */
#define NO_TIME 8    /* the timer of a board that was reset: that an update has the very same is not modelled, 1 in 65536 */
#define LIMIT 4      /* cycles; a copy that took so long is discarded, less than a turn of the timer */

bit host_busy;
byte low, flag;
byte mask = 3;
byte word[2];

byte number = 0;     /* of the update that PMAC makes */
byte cycles = 0;     /* since the copy began; saturates */
bool copying = false;
bool killed = false, taken_out = false;
bool resetting = false;
byte since = 0;      /* updates that the host took since motor 2 was taken out; saturates */
bool updated = false, taken = false;
byte looks_ended = 0; /* LIVE: since the last update ended */

proctype Pmac() {
  do
  :: {
    do
    :: atomic {                                       /* one servo cycle; the update is due */
         (!copying || cycles < LIMIT) ->
#ifdef ON_REQUEST
         !(flag & READY) ->
#elif defined(LIVE)
         looks_ended == 2 ->
#endif
         updated = false;
         if :: copying -> cycles++ :: else fi;
         if :: host_busy -> goto due :: else fi
       };
       atomic { flag = flag & (READY - 1); number = (number + 1) % NUMBERS };
       if :: mask & 1 -> word[0] = number :: else fi;
       if :: mask & 2 -> word[1] = number :: else fi;
       low = number & 7;
#ifdef SPLIT
       flag = number >> 3;
       atomic { flag = flag | READY; updated = true };
#else
       atomic { flag = number >> 3 | READY; updated = true };
#endif
due:   looks_ended = 0
    od
  } unless { atomic { resetting -> resetting = false; flag = 0; low = NO_TIME; number = (number + 1) % NUMBERS;
      if :: copying && cycles < LIMIT -> cycles++ :: else fi; updated = false; looks_ended = 0;
      if :: host_busy = 1 :: skip fi } }
  od
}

inline take(status) {
#ifndef NO_TAKE
  flag = status & (READY - 1)
#else
  skip
#endif
}

inline status_again() {
#ifdef FLAG_LAST
  again_low = low; again = flag
#else
  again = flag; again_low = low
#endif
}

proctype Host() {
  byte before, before_low, again, again_low, last, a, b, looks;
  byte motors = 3;
  bool first = true;
  do
  :: {
#ifndef NO_RELEASE
    host_busy = 0;                                    /* ServoReader::release, at the start */
#endif
    mask = 3;                                         /* keep_mask, at the start */
    do
    ::
#ifdef OTHER
#ifndef NO_MASK
       if
       :: since == 2 -> motors = mask                 /* 256 updates in the code */
       :: else
       fi;
#endif
#endif
#ifdef BUSY_FIRST
       host_busy = 1;
       flag & READY;
#endif
       atomic { before = flag; taken = false; copying = true; cycles = 0; if :: !(before & READY) -> goto silent :: else fi };
       before_low = low;
       if
       :: first -> first = false; goto old
       :: !first && ((before & 1) << 3 | before_low) == last -> goto old
       :: else
       fi;
#ifdef HANDSHAKE
       host_busy = 1;
       looks = 0;
       do
       :: atomic { before = flag; cycles = 0 };
          if
          :: before & READY -> before_low = low; break
          :: else -> looks++
          fi;
          if :: looks == 2 -> goto release :: else fi
       od;
#endif
       a = word[0];
       if :: motors & 2 -> b = word[1] :: else -> b = a fi;
#ifdef NO_REREAD
       atomic { again = before; again_low = before_low };
#else
       status_again();
#endif
       atomic {
         if
         :: again != before || again_low != before_low || cycles == LIMIT -> goto release
         :: else ->
            last = (before & 1) << 3 | before_low;
            assert(a == last && (b == a || since < 2));
            if :: taken_out && since < 2 -> since++ :: else fi;
            taken = true
         fi
       };
       take(before);
release:
#if defined(HANDSHAKE) || defined(BUSY_FIRST)
       host_busy = 0;
#endif
       goto done;
silent:
#if defined(RESET) && !defined(NO_SPEAK)
       if :: host_busy -> host_busy = 0 :: else fi;   /* BoardLoop::let_board_speak, when the data are stale */
#endif
       goto done;
old:   last = (before & 1) << 3 | before_low;
       take(before);
#ifdef BUSY_FIRST
       host_busy = 0;
#endif
done:  atomic {
         copying = false; cycles = 0; before = 0; before_low = 0; again = 0; again_low = 0; a = 0; b = 0; looks = 0;
         if :: looks_ended < 2 -> looks_ended++ :: else fi }
    od
  } unless { atomic { killed -> killed = false; copying = false; cycles = 0; first = true; last = 0; motors = 3; since = 0; taken_out = false;
      before = 0; before_low = 0; again = 0; again_low = 0; a = 0; b = 0; looks = 0 } }
  od
}

proctype Chaos() {
#ifdef OTHER
  atomic { mask = mask & 1; taken_out = true };
#endif
#ifdef RESET
  resetting = true;
#endif
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
  skip
}

init { atomic { run Pmac(); run Host(); run Chaos() } }

/* PMAC is not stopped for ever, and the host gets reports for ever. */
ltl pmac_goes_on { [] <> updated }
ltl host_gets { [] <> taken }
