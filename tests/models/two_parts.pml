/* A command line in two parts: the first fills the buffer and has no NUL, the second ends with one (DPRAM manual p. 28, Turbo User
 * Manual p. 406; the same in every family). The board keeps the first part until the second has come.
 *
 * Pmac mirrors src/sim/functions/ascii.rs, Host src/function/ascii.rs with ascii/hold.rs (`load`, `give_up`,
 * `look_for_half_a_line`). Every access to the DPRAM is one step. A part is the number of its line; what ends it is its NUL. The first
 * part sets the last byte of the buffer; the second is shorter and leaves it.
 * Replies are ascii.pml's and left out: the board's having taken a part is all that the host waits for.
 *
 * What holds: what the board carries out is one line, both parts of it, once.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * CRASH       the host is killed anywhere, any number of times, and started again. That takes it longer than a pass takes PMAC.
 * NO_LOOK     the new host does not look at the last byte. FAILS with CRASH: PMAC has the first part of the dead host's line and puts
 *             the new one's behind it.
 * NUL         the new host looks for a NUL instead. FAILS with CRASH: a host that died as it wrote the second part has put one there.
 * GIVE_UP     the host may give up while it waits for the second part to be taken, or the first.
 * NO_CANCEL   it sends no ^X then. FAILS: the same, by one host.
 * RESET       the board is reset anywhere, once. FAILS: it forgets the first part and clears the flag; the host takes that for
 *             "taken" and sends the second, which the board carries out alone. The flag alone tells nobody; the host learns of the
 *             reset from the servo timer, too late for this.
 */
#define LINES 2

byte flag, part, cancel;                              /* the line's flag, its text (a line's number), ^X in its word */
bool end = true;                                      /* the text has its NUL */
bool last = false;                                    /* the last byte of the buffer is set */
byte done[LINES];                                     /* how often */
byte line = 0;                                        /* the one that the host is at */
bool taking = false;                                  /* PMAC is between the flag's two changes */
bool killed = false, resetting = false;

#define NONE 9

proctype Pmac() {
  byte half = NONE;                                   /* the line whose first part came */
  do
  :: {
    do
    :: atomic { flag != 0 -> taking = true };
       atomic {
         if
         :: !end ->
            assert(half == NONE);                     /* never behind another line's first part */
            half = part
         :: else ->
            assert(half == part);                     /* nor the second part behind it, nor alone */
            assert(done[part] == 0);
            done[part]++;
            half = NONE
         fi
       };
       atomic { flag = 0; taking = false }
    :: atomic { cancel != 0 -> half = NONE; flag = 0; cancel = 0 }
    od
  } unless { atomic { resetting -> resetting = false; taking = false; half = NONE; flag = 0; cancel = 0 } }
  od
}

/* The board is told to forget the first part that it may have. */
inline forget_half() {
  cancel = 1;
  cancel == 0
}

/* Hands a part over and waits until it is taken. */
inline hand_over(is_end) {
  atomic { part = line; end = is_end };
  if
  :: !is_end -> last = true
  :: else
  fi;
  flag = 1;
  if
  :: flag == 0
#ifdef GIVE_UP
  :: given_up = true
#endif
  fi
}

proctype Host() {
  bool given_up;
  do
  :: {
    flag = 0;                                         /* a new host */
    cancel = 0;
#ifndef NO_LOOK
    if
#ifdef NUL
    :: !end -> forget_half()
#else
    :: last -> forget_half()
#endif
    :: else
    fi;
#endif
    do
    :: atomic { line = (line + 1) % LINES; done[line] = 0; given_up = false };
       hand_over(false);
       if
       :: !given_up -> hand_over(true)
       :: else
       fi;
       if
       :: given_up ->
#ifndef NO_CANCEL
          forget_half();
#endif
          flag == 0
       :: else
       fi
    od
  } unless { atomic { killed && !taking -> killed = false; given_up = false } }
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
